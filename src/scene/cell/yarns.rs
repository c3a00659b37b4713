//! Linking numbers of closed curves and yarns, the curves that run through the periodic cell.
//!
//! # Proof: which numbers of the previous frame still hold
//!
//! A yarn is an infinite curve: each of its periods ends where the next one starts. The ledger
//! searches the curves and their images, and so all periods that may come near the closed curve. To
//! decide ties, it translates the same one of the two curves in all periods. So the sum of the
//! signs of the passages of all periods is the change of the number, as for two closed curves. A
//! pair that had a number keeps it if none of its periods has a passage or a contact, or is
//! undecided.
//!
//! Two cases need more care:
//! - The polylines by which a ledger replaces a closed spline differ from period to period. So
//!   splines that a ledger could not prove apart count as undecided.
//! - The end of a period that is not translated is the given one, not the exact image of its start.
//!   If a closed curve may have passed between the two, the pair counts as undecided, too.

use crate::certificate::{Differences, no_baseline};
use crate::curve::vector::per_axis;
use crate::curve::{
    AXES, Cell, CurveSet, Image, Point, Precision, bounds, boxes_apart, pow2, union,
};
use crate::error::Result;
use crate::pairs::sorted;
use crate::periodic::{
    Entry, ImagePair, Number, RingAndYarn, YarnPeriod, almost_yarns, linking_numbers, period_in,
};
use crate::verdict::{Change, Defect};
use crate::words::if_any;
use std::collections::BTreeSet;
use std::sync::Arc;

/// The closed curves and yarns of a scene.
#[derive(Clone, Debug, Default)]
pub(super) struct Yarns {
    /// Period of each curve, if it is a yarn, once they are known.
    periods: Option<Arc<[Option<Image>]>>,
    /// Precision of the first frame. Later ones may be converted to a higher one.
    pub precision: Option<Precision>,
    /// Pairs that may be linked, sorted.
    pub pairs: Vec<RingAndYarn>,
    /// Expected linking numbers, sorted, once they are known.
    pub expected: Option<Vec<Entry>>,
    /// Linking numbers in the previous frame, sorted; `None` if they do not apply to the next
    /// frame.
    known: Option<Vec<Number>>,
}

/// Findings about closed curves and yarns in a frame.
#[derive(Debug, Default)]
pub(crate) struct Compared {
    pub changes: Vec<Change>,
    pub defects: Vec<Defect>,
    /// Pairs for which no number was expected. The baseline adopts the number of this frame.
    pub adopted: Vec<Entry>,
    /// Number of pairs whose numbers were computed.
    pub computed: u64,
    /// True if a number that was proven from the previous frame differs from the computed one.
    pub disagreed: bool,
}

/// Previous and current frame, with their cells.
pub(super) type Step<'a> = [(&'a Arc<CurveSet>, &'a Cell); 2];

impl Yarns {
    /// Begins with the periods of the curves, and the precision of the first frame.
    pub fn begin(&mut self, periods: Arc<[Option<Image>]>, precision: Precision) {
        (self.periods, self.precision) = (Some(periods), Some(precision));
    }

    /// Returns the period of each curve. [`Yarns::find_periods`] must have been called.
    pub fn periods(&self) -> Arc<[Option<Image>]> {
        self.periods.clone().unwrap_or_default()
    }

    /// Returns the curves that run through the cell, sorted, and their periods.
    pub fn list(&self) -> Vec<YarnPeriod> {
        let all = self.periods.iter().flat_map(|periods| periods.iter());
        let yarns = (0..).zip(all);
        let yarns = yarns.filter_map(|(i, period)| Some((i, (*period)?)));
        yarns.collect()
    }

    /// Finds the yarns in the first frame, and logs curves that almost run through the cell. In a
    /// later frame, returns a text that names yarns that no longer run through it.
    pub fn find_periods(&mut self, set: &CurveSet, cell: &Cell) -> Option<String> {
        let precision = *self.precision.get_or_insert(set.precision());
        let find = |i: usize| period_in(set, i, cell, precision);
        let Some(known) = &self.periods else {
            self.periods = Some((0..set.len()).map(find).collect());
            if let Some(words) = almost_yarns(set, cell) {
                tracing::warn!("{words}");
            }
            return None;
        };
        let differs = |&i: &usize| known[i].is_some() && find(i) != known[i];
        let mut others = (0..known.len()).filter(differs);
        let first = others.next()?;
        let n = others.count() as u64;
        let others = if_any(n, || format!(" (nor do {n} others)"));
        // The sums of passages mean nothing for it.
        self.known = None;
        Some(format!(
            "curve {first} no longer ends at the image of its start{others}: it does not run \
             through the cell as before"
        ))
    }

    /// Forgets the numbers of the previous frame, because the next one does not continue it.
    pub fn cut(&mut self) {
        self.known = None;
    }

    /// Returns the pair of two curves, the second one translated, if one is closed and the other a
    /// yarn.
    pub fn pair(&self, i: u32, j: u32, image: Image) -> Option<RingAndYarn> {
        let periods = self.periods.as_ref()?;
        RingAndYarn::between(i, j, image, [i, j].map(|i| periods[i as usize]))
    }

    /// Compares the linking numbers of a frame with the expected ones. If none are expected yet,
    /// those of this frame become the expected ones.
    ///
    /// `unsettled` has the pairs whose numbers may differ from those of the previous frame; `None`:
    /// all. If `check` is set, all numbers are computed.
    ///
    /// # Errors
    ///
    /// The errors of [`CurveSet::translate`].
    pub fn compare(
        &mut self,
        frame: &Arc<CurveSet>,
        cell: &Cell,
        unsettled: Option<&BTreeSet<RingAndYarn>>,
        check: bool,
    ) -> Result<Compared> {
        let known = self.known.take().unwrap_or_default();
        let kept = |pair: &RingAndYarn| -> Option<Number> {
            let k = known.binary_search_by_key(pair, |n| n.0).ok()?;
            let settled = known[k].1.is_ok() && unsettled.is_some_and(|u| !u.contains(pair));
            settled.then_some(known[k])
        };
        let pairs = self.pairs.iter().copied();
        let computed = pairs.filter(|pair| check || kept(pair).is_none());
        let computed: Vec<RingAndYarn> = computed.collect();
        let mut numbers = linking_numbers(frame, cell, &self.periods(), &computed)?;
        let differ = |n: &Number| kept(&n.0).is_some_and(|known| known.1.ok() != n.1.ok());
        let disagreed = numbers.iter().any(differ);
        if !check {
            numbers.extend(self.pairs.iter().filter_map(kept));
            numbers.sort_unstable_by_key(|n| n.0);
        }
        let mut compared = Compared {
            defects: defects(&numbers),
            computed: computed.len() as u64,
            disagreed,
            ..Compared::default()
        };
        self.add_differences(&numbers, &mut compared);
        self.known = Some(numbers);
        Ok(compared)
    }

    /// Adds the numbers that differ from the expected ones. For pairs without an expected number,
    /// adopts the number of this frame.
    fn add_differences(&mut self, numbers: &[Number], out: &mut Compared) {
        let found = entries(numbers);
        let Some(expected) = &mut self.expected else {
            self.expected = Some(found);
            return;
        };
        let Differences { changes, fresh } = Differences::between(expected.iter().copied(), found);
        out.changes.extend(changes);
        for (pair, lambda) in fresh {
            out.defects.push(no_baseline(pair));
            expected.retain(|e| e.0 != pair);
            if lambda != 0 {
                expected.push((pair, Some(lambda)));
            }
            out.adopted.push((pair, Some(lambda)));
        }
        expected.sort_unstable();
    }

    /// Returns the pairs whose closed curve may have passed through the gap between the end of a
    /// period and the start of the next one, which are equal only up to a tolerance.
    pub fn past_joints<'a>(&'a self, step: Step<'a>) -> impl Iterator<Item = RingAndYarn> + 'a {
        let pairs = self.pairs.iter().copied();
        pairs.filter(move |pair| {
            let joints = step.map(|(set, cell)| joint(set, cell, pair));
            if !step[0].0.basis().is_polyline() {
                // The margins of the separation of splines cover a gap of this size.
                let covered = |set: &CurveSet, [p, q]: [Point; 2]| {
                    let most = set.max_abs() * pow2(-47);
                    (0..3).all(|x| (p[x] - q[x]).abs() <= most)
                };
                let [(before, _), (now, _)] = step;
                return !(covered(before, joints[0]) && covered(now, joints[1]));
            }
            // Periods that are translated end exactly where the next one starts.
            if pair.image != Image::default() {
                return false;
            }
            let [before, now] = step.map(|(set, _)| set.bounds_along(pair.ring as usize, &AXES));
            let [a, b] = [bounds(joints.into_iter().flatten()), union(before, now)];
            let rounding = step.map(|(set, _)| set.max_abs());
            let slack = 1e-12 * rounding[0].max(rounding[1]);
            !boxes_apart([&a, &b], slack)
        })
    }
}

/// Returns the end of a yarn, and the image of its start, up to rounding.
fn joint(set: &CurveSet, cell: &Cell, pair: &RingAndYarn) -> [Point; 2] {
    let yarn = pair.yarn as usize;
    let by = cell.translation(pair.period);
    let [start, end] = [0, set.curve(yarn).segments as usize].map(|s| set.knot(yarn, s));
    [end, per_axis(|x| start[x] + by[x])]
}

/// Returns the entries that are not 0, sorted.
fn entries(numbers: &[Number]) -> Vec<Entry> {
    let entries = numbers.iter().map(|(pair, n)| (pair.pair(), n.ok()));
    sorted(entries.filter(|e| e.1 != Some(0)))
}

/// Returns the pairs that have no number.
fn defects(numbers: &[Number]) -> Vec<Defect> {
    let without = numbers.iter().filter_map(|(pair, n)| {
        let ImagePair { i, j, image } = pair.pair();
        let (kind, place) = n.err()?;
        let defect = Defect::of_pair((i, j), kind, place);
        Some(Defect { image, ..defect })
    });
    without.collect()
}
