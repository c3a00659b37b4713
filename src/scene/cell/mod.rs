//! Periodic scenes: the curves of a frame, and the images that may meet them.
//!
//! The set of images stays the same from frame to frame, so that frames are verified incrementally.
//! If other images come near, a new set replaces it, in the previous frame as well, so that no step
//! is skipped: the boxes of all pairs that are new were apart throughout the earlier frames.

mod state;
mod yarns;

pub(crate) use state::CellState;
pub(crate) use yarns::Compared as ComparedYarns;

use self::yarns::{Compared, Yarns};
use crate::certificate::{Certificate, undefined_entry};
use crate::curve::{Cell, CurveSet, Frame, Image, Images, Point, Shape, is_home};
use crate::error::Result;
use crate::incremental::{QuietBounds, sort_by_time};
use crate::pairs::{Pair, PairFilter, sorted};
use crate::periodic::{
    Bend, Boxer, FractionalBoxes, ImagePair, ImagePairs, QuietSlack, RingAndYarn, Searched,
    check_whole, period_of_pair,
};
use crate::verdict::{Change, Defect, Link, PullThrough, Report};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// A periodic scene, in its state after a frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct CellScene {
    /// Linking numbers of closed curves with yarns (curves that run through the cell).
    yarns: Yarns,
    /// Images that may meet, once they are known.
    found: Option<KnownImages>,
    before: Option<Before>,
    /// Map to the last quiet frame, and the slack of that frame.
    quiet: Option<QuietSlack>,
}

/// Images that may meet, as the last search found them.
#[derive(Clone, Debug)]
struct KnownImages {
    /// Shape of the frames for which these images are valid.
    of: Shape,
    pairs: Arc<ImagePairs>,
    /// `None` if no image may meet a curve.
    images: Option<Arc<Images>>,
}

/// Previous frame.
#[derive(Clone, Debug)]
struct Before {
    given: Arc<CurveSet>,
    cell: Cell,
    /// Slack of the frame ([`ImagePairs::slack`]).
    slack: Point,
}

/// Settings of a search for images.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Search {
    /// True if open curves are searched, too, although they have no linking numbers.
    pub open_too: bool,
    /// Maximum number of pairs.
    pub most: usize,
    /// True if torn curves are refused.
    pub check_torn: bool,
    /// True if bounds that replace a search are compared with exact values.
    pub paranoid: bool,
}

impl Search {
    /// Refuses a frame if one of these curves is torn.
    fn refuse_torn(self, given: &CurveSet, cell: &Cell, curves: &[usize]) -> Result<()> {
        let curves = curves.iter().copied().filter(|_| self.check_torn);
        check_whole(given, cell, curves)
    }
}

/// A frame with its images, as it is verified.
pub(crate) struct Followed {
    pub frame: Frame,
    /// True if the set of images differs from that of the previous frame.
    pub others: bool,
    /// True if the bound of the slack of a quiet frame exceeds the slack computed from its points.
    pub disagreed: bool,
}

impl CellScene {
    /// Returns the number of curves that run through the cell, in a first frame.
    pub fn count_yarns(given: &CurveSet, cell: &Cell) -> usize {
        let mut yarns = Yarns::default();
        yarns.find_periods(given, cell);
        yarns.list().len()
    }

    /// Finds the curves that run through the cell in the first frame. In later frames, returns a
    /// text that names those that no longer do.
    pub fn find_yarns(&mut self, given: &CurveSet, cell: &Cell) -> Option<String> {
        self.yarns.find_periods(given, cell)
    }

    /// Forgets the previous frame, because the next one does not continue it or has other points.
    pub fn cut(&mut self) {
        self.before = None;
        self.yarns.cut();
    }

    /// Returns the names of two curves of the verified set.
    pub fn pair(&self, a: u32, b: u32) -> ImagePair {
        let found = self.found.as_ref();
        found.map_or(ImagePair::new(a, b, Image::default()), |found| {
            found.pairs.pair(a, b)
        })
    }

    /// Returns the indices in the verified set of the pair with these names.
    pub fn find_pair(&self, pair: ImagePair) -> Option<Pair> {
        self.found.as_ref()?.pairs.find_pair(pair)
    }

    /// Returns true if the expected linking numbers of curves and yarns lack this pair.
    pub fn lacks_yarn(&self, pair: ImagePair) -> bool {
        let expected = self.yarns.expected.as_deref().unwrap_or_default();
        expected.contains(&(pair, None))
    }

    /// Finds the images that may meet in the step to a frame, unless the known ones suffice.
    /// `quiet` has bounds of the curves if the frame is quiet. `expected` has the expected linking
    /// numbers.
    ///
    /// # Errors
    ///
    /// The errors of [`ImagePairs::find`]; [`Error::Usage`](crate::Error::Usage) if a curve is
    /// torn.
    pub fn follow(
        &mut self,
        given: &Arc<CurveSet>,
        cell: &Cell,
        quiet: Option<&QuietBounds<'_>>,
        expected: Option<&Certificate>,
        search: Search,
    ) -> Result<Followed> {
        let other = |before: &mut Before| !before.given.same_layout(given);
        if self.before.take_if(other).is_some() {
            // There is no step from a frame with another layout.
            self.yarns.cut();
        }
        let known = self.found.as_ref();
        if known.is_some_and(|found| found.of != given.shape()) {
            // They are searched for again.
            (self.found, self.quiet) = (None, None);
        }
        let boxer = Boxer::new(given, cell)?;
        let bend = self.before.as_ref();
        let bend = bend.map(|before| Bend::between([&before.cell, cell]));
        let bend = bend.transpose()?.unwrap_or_default();
        let known = self.slack(&boxer, &bend, quiet, search)?;
        let disagreed = known.is_some_and(|known| known.disagreed);
        let (slack, others) = match known.filter(|known| known.is_enough) {
            Some(known) => {
                if !known.from_quiet
                    && let Some(found) = &self.found
                {
                    search.refuse_torn(given, cell, &found.pairs.state.wide)?;
                }
                (known.slack, false)
            }
            None => {
                let boxes = FractionalBoxes::new(&boxer);
                let swept = match &self.before {
                    None => boxes,
                    Some(before) => {
                        let at_first = Boxer::new(&before.given, &before.cell)?;
                        boxes.swept_from(&FractionalBoxes::new(&at_first), &bend)
                    }
                };
                let pairs = self.search(given, cell, &swept, expected, search)?;
                (pairs.slack(&boxer), true)
            }
        };
        self.before = Some(Before {
            given: Arc::clone(given),
            cell: *cell,
            slack,
        });
        Ok(Followed {
            frame: self.frame(given, *cell),
            others,
            disagreed,
        })
    }

    /// Returns the filter of the pairs that are verified, if there are images.
    pub fn filter(&self) -> Option<PairFilter> {
        let found = self.found.as_ref();
        let found = found.filter(|found| found.images.is_some());
        found.map(|found| found.pairs.filter())
    }

    /// Returns the number of curves in the verified set, images included.
    pub fn curves(&self, given: usize) -> usize {
        let found = self.found.as_ref();
        found.map_or(given, |found| found.pairs.curves.len())
    }

    /// Converts the previous frame to double precision. The set of images does not change.
    pub fn widen(&mut self) -> Result<()> {
        self.quiet = None;
        if let Some(before) = &mut self.before {
            before.given = Arc::new(before.given.widened()?);
            if let Some(found) = &mut self.found {
                found.of = before.given.shape();
            }
        }
        Ok(())
    }

    /// Returns a frame with the images that may meet.
    pub fn frame(&self, given: &Arc<CurveSet>, cell: Cell) -> Frame {
        let images = self.found.as_ref().and_then(|found| found.images.clone());
        Frame::new(given, Some(cell), images)
    }

    /// Returns the slack of a frame for the known images, or `None` if there are none.
    fn slack(
        &mut self,
        boxer: &Boxer<'_>,
        bend: &Bend,
        quiet: Option<&QuietBounds<'_>>,
        search: Search,
    ) -> Result<Option<Slack>> {
        let Some(KnownImages { pairs, .. }) = &self.found else {
            return Ok(None);
        };
        let was_inside = match &self.before {
            Some(before) if pairs.is_enough(before.slack, bend) => true,
            // The slack of a quiet frame is only a lower bound, so the exact one is computed.
            Some(before) => {
                let boxer = Boxer::new(&before.given, &before.cell)?;
                pairs.is_enough(pairs.slack(&boxer), bend)
            }
            None => true,
        };
        let at_least = quiet.map(|at| pairs.quiet_slack(boxer, at, bend, &mut self.quiet));
        let known = at_least.filter(|&slack| pairs.is_enough(slack, bend));
        let slack = match known {
            Some(known) if !search.paranoid => known,
            _ => pairs.slack(boxer),
        };
        Ok(Some(Slack {
            slack,
            is_enough: was_inside && pairs.is_enough(slack, bend),
            from_quiet: known.is_some(),
            disagreed: known.is_some_and(|known| !boxer.is_at_most(known, slack)),
        }))
    }

    /// Finds the images that may meet as long as the curves are within these boxes, and returns
    /// them.
    fn search(
        &mut self,
        given: &Arc<CurveSet>,
        cell: &Cell,
        boxes: &FractionalBoxes,
        expected: Option<&Certificate>,
        search: Search,
    ) -> Result<Arc<ImagePairs>> {
        search.refuse_torn(given, cell, &boxes.wide(cell))?;
        let searched = Searched {
            curves: given.curves(),
            periods: &self.yarns.periods(),
            open_too: search.open_too,
            most: search.most,
        };
        let entries = expected.and_then(Certificate::entries).unwrap_or_default();
        let entries = entries.into_iter().map(|entry| entry.0);
        let is_of_yarn = self.is_of_yarn();
        let expected = entries.filter(|pair| !is_home(&pair.image) && !is_of_yarn(pair));
        let pairs = ImagePairs::find(boxes, cell, &searched, expected)?;
        Ok(self.know(given, pairs))
    }

    /// Makes these the known images, and returns them.
    fn know(&mut self, given: &CurveSet, pairs: ImagePairs) -> Arc<ImagePairs> {
        self.yarns.pairs.clone_from(&pairs.state.yarns);
        let has_images = pairs.has_images();
        let pairs = Arc::new(pairs);
        self.quiet = None;
        self.found = Some(KnownImages {
            of: given.shape(),
            images: has_images.then(|| Arc::new(Images::new(pairs.curves.clone()))),
            pairs: Arc::clone(&pairs),
        });
        pairs
    }

    /// Returns a predicate for pairs that contain a yarn.
    fn is_of_yarn(&self) -> impl Fn(&ImagePair) -> bool + use<> {
        let yarns = self.yarns.list();
        move |pair| period_of_pair(&yarns, pair.i, pair.j).is_some()
    }

    /// Returns a function from curve indices in an earlier state of this scene to those in this
    /// one.
    pub fn renamed<'a>(&'a self, earlier: &'a CellScene) -> impl Fn(u32) -> Option<u32> + 'a {
        move |a| match (&earlier.found, &self.found) {
            (Some(from), Some(to)) => to.pairs.find_curve(from.pairs.curves[a as usize]),
            // Only curves that are not translated are known, and they come first.
            _ => Some(a),
        }
    }

    /// Returns, for each curve, its index in an earlier state of this scene, if it existed there.
    pub fn origins(&self, earlier: &CellScene, given: usize) -> Vec<Option<u32>> {
        let renamed = earlier.renamed(self);
        (0..self.curves(given) as u32).map(renamed).collect()
    }

    /// Returns the expected linking numbers of the verified set, without those of yarns.
    pub fn expected(&self, all: &Certificate) -> Certificate {
        let mut out = Certificate {
            curves: self.curves(all.curves),
            ..Certificate::default()
        };
        // Curves that have no linking number with any other curve.
        for single in all.undefined.iter().filter(|d| d.j.is_none()) {
            let found = self.found.iter();
            let curves = found.flat_map(|found| found.pairs.curves.iter());
            let same = (0..).zip(curves).filter(|(_, of)| of.0 == single.i);
            out.undefined
                .extend(same.map(|(i, _)| Defect { i, ..*single }));
        }
        let places = all.undefined.iter();
        let places: BTreeMap<ImagePair, &Defect> =
            places.filter_map(|d| Some((d.pair()?, d))).collect();
        let is_of_yarn = self.is_of_yarn();
        for (pair, lambda) in all.entries().unwrap_or_default() {
            // All expected pairs are in the verified set, so only pairs with a yarn are skipped
            // here.
            let Some((i, j)) = self.find_pair(pair).filter(|_| !is_of_yarn(&pair)) else {
                continue;
            };
            if let Some(lambda) = lambda {
                out.links.push(Link { i, j, lambda });
                continue;
            }
            let known = places.get(&pair);
            let known = known.map(|d| Defect::of_pair((i, j), d.kind, d.place));
            let unknown = || undefined_entry(i, Some(j), Image::default());
            out.undefined.push(known.unwrap_or_else(unknown));
        }
        out.links.sort_unstable();
        Defect::sort(&mut out.undefined);
        out
    }

    /// Takes the expected linking numbers of yarns from `all`.
    pub fn expect(&mut self, all: &Certificate) {
        let entries = all.entries().unwrap_or_default();
        let is_of_yarn = self.is_of_yarn();
        let of_yarns = entries.into_iter().filter(|entry| is_of_yarn(&entry.0));
        self.yarns.expected = Some(sorted(of_yarns));
    }

    /// Returns all expected linking numbers as reports name them. `verified` has those of the
    /// verified set, and `defects` the places of contacts with images.
    pub fn joined(&self, verified: &Certificate, given: usize, defects: &[Defect]) -> Certificate {
        let links = verified.links.iter();
        let links = links.map(|l| (self.pair(l.i, l.j), Some(l.lambda)));
        let undefined = verified.undefined.iter();
        let undefined = undefined.filter_map(|d| Some((self.pair(d.i, d.j?), None)));
        let of_yarns = self.yarns.expected.iter().flatten().copied();
        let entries = sorted(links.chain(undefined).chain(of_yarns));
        // A curve without any linking number is listed once, not for each of its images.
        let single = |d: &&Defect| d.j.is_none() && (d.i as usize) < given;
        let singles = verified.undefined.iter().filter(single);
        let periodic = Certificate {
            curves: given,
            undefined: singles.copied().collect(),
            periods: self.yarns.list(),
            ..Certificate::default()
        };
        let named = |d: &Defect| {
            let ImagePair { i, j, image } = self.pair(d.i, d.j?);
            let j = Some(j);
            Some(Defect { i, j, image, ..*d })
        };
        let named = verified.undefined.iter().filter_map(named);
        let defects: Vec<Defect> = named.chain(defects.iter().copied()).collect();
        periodic.with_entries(&entries, &defects)
    }

    /// Compares the linking numbers of closed curves and yarns with the expected ones. If none are
    /// expected yet, those of this frame become the expected ones. `met` has the pairs of the
    /// verified set that may have met in the step to this frame, if they are known; `before` is the
    /// frame at its start. If `check` is set, all numbers are computed.
    ///
    /// # Errors
    ///
    /// The errors of [`CurveSet::translate`].
    pub fn compare_yarns(
        &mut self,
        frame: &Frame,
        before: Option<&Frame>,
        met: Option<&[Pair]>,
        check: bool,
    ) -> Result<Compared> {
        let Some(cell) = frame.cell() else {
            return Ok(Compared::default());
        };
        let now = (frame.given(), cell);
        let unsettled = || -> Option<BTreeSet<RingAndYarn>> {
            let before = before?;
            let met = met?.iter().map(|&(a, b)| self.pair(a, b));
            let met = met.filter_map(|p| self.yarns.pair(p.i, p.j, p.image));
            let step = [(before.given(), before.cell()?), now];
            Some(met.chain(self.yarns.past_joints(step)).collect())
        };
        let unsettled = unsettled();
        self.yarns.compare(now.0, now.1, unsettled.as_ref(), check)
    }

    /// Replaces the indices of the verified set in the findings of a frame by curves of the frame
    /// and names of images, and adds the findings about yarns.
    pub fn name(&self, report: &mut Report, given: usize, yarns: Compared) {
        let rename = |i: &mut u32, j: &mut u32, image: &mut Image| {
            let pair = self.pair(*i, *j);
            (*i, *j, *image) = (pair.i, pair.j, pair.image);
        };
        for Change { i, j, image, .. } in &mut report.changes {
            rename(i, j, image);
        }
        report.changes.extend(yarns.changes);
        report.changes.sort_by_key(|c| (c.i, c.j, c.image));
        for events in [&mut report.events, &mut report.unresolved] {
            for PullThrough { i, j, image, .. } in events.iter_mut() {
                rename(i, j, image);
            }
            sort_by_time(events);
        }
        // A defect of a single curve is reported once, not for each of its images.
        let is_given = |d: &Defect| d.j.is_some() || (d.i as usize) < given;
        report.defects.retain(is_given);
        for Defect { i, j, image, .. } in &mut report.defects {
            if let Some(j) = j {
                rename(i, j, image);
            }
        }
        report.defects.extend(yarns.defects);
        // Removes duplicates, because the search for pull-throughs also finds contacts with yarns.
        let key = |d: &Defect| (d.i, d.j, d.image, d.kind as u8);
        report.defects.sort_by_key(key);
        report.defects.dedup_by_key(|d| key(d));
        // Adopted links have no field for an image, so pairs with an image are named only by the
        // defects.
        report.adopted.retain_mut(|link| {
            let pair = self.pair(link.i, link.j);
            (link.i, link.j) = (pair.i, pair.j);
            is_home(&pair.image)
        });
        for (ImagePair { i, j, image }, lambda) in yarns.adopted {
            if let Some(lambda) = lambda.filter(|&lambda| lambda != 0 && is_home(&image)) {
                report.adopted.push(Link { i, j, lambda });
            }
        }
        report.adopted.sort_unstable();
    }
}

/// Slack of a frame for the known images.
#[derive(Clone, Copy)]
struct Slack {
    slack: Point,
    is_enough: bool,
    /// True if this is a lower bound, from the bounds of a quiet frame.
    from_quiet: bool,
    disagreed: bool,
}
