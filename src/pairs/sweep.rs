//! Potential links by a sort and a sweep along the axis with the largest spread of the boxes.
//!
//! Cost: `O(n log n)` for the sort. The sweep compares each box with a few neighbours on sheets and
//! garments. It is quadratic if all boxes overlap along the axis.

use super::buckets::BucketSort;
use super::{Pair, PairFilter, SMALL};
use crate::cancel::PairLimit;
use crate::curve::vector::per_axis;
use crate::curve::{Box3, CurveSet, Diagonals};
use crate::simd::{LANES, Lanes, dispatch};
use crate::verdict::Defect;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of pairs per curve above which the extents along the diagonals pay.
const MANY: usize = 2;

/// Number of boxes that a task sweeps.
const CHUNK: usize = 512;

/// Search for potential links. Its buffers are reused from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct LinkSearch {
    sweep: Sweep,
    /// Pairs found by each task.
    parts: Vec<Vec<Pair>>,
    pairs: Vec<Pair>,
    sort: BucketSort,
    /// Extents of the curves, if a search needed them.
    diagonals: Vec<Diagonals>,
    /// Number of potential links that [`LinkSearch::find_links`] discarded, because their curves
    /// are certainly not linked.
    pub discarded: usize,
    /// Pairs that are searched for; `None`: all.
    pub filter: Option<PairFilter>,
    /// If there are more pairs than this, none are found, and the limit records that.
    pub limit: PairLimit,
}

impl LinkSearch {
    /// Returns a search for the pairs of a filter, or for all pairs.
    pub fn new(filter: Option<PairFilter>) -> LinkSearch {
        LinkSearch {
            filter,
            ..LinkSearch::default()
        }
    }

    /// Returns the pairs found by the last search.
    pub fn pairs(&self) -> &[Pair] {
        &self.pairs
    }

    /// Returns the pairs found by the last search, so that the caller can reorder them.
    pub fn pairs_mut(&mut self) -> &mut [Pair] {
        &mut self.pairs
    }

    /// Finds all pairs of overlapping boxes, sorted. Empty boxes overlap nothing.
    pub fn find(&mut self, boxes: &[Box3]) -> &mut Vec<Pair> {
        self.sweep(boxes);
        self.collect(boxes.len())
    }

    /// Finds the potential links of curves, sorted, except those of curves with one of these
    /// defects, which are sorted. `boxes` are the bounding boxes of the curves.
    ///
    /// If there are many for the curves that have boxes, discards those that a plane orthogonal to
    /// a diagonal separates ([`Diagonals`]).
    pub fn find_links(
        &mut self,
        set: &CurveSet,
        boxes: &[Box3],
        degenerate: &[Defect],
    ) -> &mut Vec<Pair> {
        self.sweep(boxes);
        if !degenerate.is_empty() {
            let kept = |i: u32| degenerate.binary_search_by_key(&i, |d| d.i).is_err();
            self.retain(|i, j| kept(i) && kept(j));
        }
        let links = self.count();
        if links > MANY * self.sweep.order.len() && set.basis().is_polyline() {
            let mut diagonals = std::mem::take(&mut self.diagonals);
            diagonals.resize(set.len(), Diagonals::UNBOUNDED);
            let tasks = diagonals.par_chunks_mut(CHUNK).enumerate();
            tasks.for_each(|(task, part)| {
                dispatch!(simd => extents(simd, set, boxes, task, part));
            });
            self.retain(|i, j| !diagonals[i as usize].apart(&diagonals[j as usize]));
            self.diagonals = diagonals;
        }
        self.discarded = links - self.count();
        self.collect(boxes.len())
    }

    /// Keeps the found pairs for which this holds.
    fn retain(&mut self, keeps: impl Fn(u32, u32) -> bool + Sync) {
        let parts = self.parts.par_iter_mut();
        parts.for_each(|part| part.retain(|&(i, j)| keeps(i, j)));
    }

    /// Returns the number of found pairs.
    fn count(&self) -> usize {
        self.parts.iter().map(Vec::len).sum()
    }

    /// Fills the parts with the pairs of overlapping boxes.
    fn sweep(&mut self, boxes: &[Box3]) {
        let most = self.limit.most();
        let total = AtomicUsize::new(0);
        self.sweep.fill(boxes, &mut self.sort);
        let (sweep, filter) = (&self.sweep, self.filter.as_ref());
        let n = sweep.order.len();
        let tasks = Self::tasks(n).max(self.parts.len());
        self.parts.resize_with(tasks, Vec::new);
        let parts = self.parts.par_iter_mut().enumerate();
        parts.for_each(|(c, part)| {
            part.clear();
            if total.load(Ordering::Relaxed) > most {
                return;
            }
            let mut range = (c * CHUNK).min(n)..((c + 1) * CHUNK).min(n);
            while !range.is_empty() && part.len() <= most {
                let (first, rest, found) = (part.len(), range.clone(), &mut *part);
                range.start = dispatch!(simd => Sweep::run(sweep, simd, rest, most, found));
                // Other pairs neither count nor end the search.
                if let Some(filter) = filter {
                    part.extract_if(first.., |&mut (i, j)| !filter.contains(i, j))
                        .for_each(drop);
                }
            }
            total.fetch_add(part.len(), Ordering::Relaxed);
        });
        if total.into_inner() > most {
            self.limit.exceed();
            self.parts.fill_with(Vec::new);
        }
    }

    /// Sorts the pairs of all parts.
    fn collect(&mut self, curves: usize) -> &mut Vec<Pair> {
        let found = self.parts.iter().flatten().copied();
        let first = |&(i, _): &Pair| i as usize;
        self.sort.sort(found, curves, first, &mut self.pairs);
        &mut self.pairs
    }

    /// Returns the number of groups of eight boxes that the last search compared with a box.
    pub fn steps(&self) -> u64 {
        let (lo, hi) = (&self.sweep.lo[0], &self.sweep.hi[0]);
        let boxes = self.sweep.order.len();
        let steps = |k: usize| {
            let passed = lo[k + 1..boxes].partition_point(|&other| other <= hi[k]);
            passed.div_ceil(LANES) as u64
        };
        (0..boxes).map(steps).sum()
    }

    /// Returns the number of tasks of a search of this many boxes.
    pub fn tasks(boxes: usize) -> usize {
        boxes.div_ceil(CHUNK)
    }
}

/// Computes the bounds along the diagonals of the curves of a chunk that have a box and at most
/// [`SMALL`] segments. The others are unbounded.
#[inline(always)]
fn extents<L: Lanes>(
    simd: L,
    set: &CurveSet,
    boxes: &[Box3],
    chunk: usize,
    extents: &mut [Diagonals],
) {
    for (k, extent) in extents.iter_mut().enumerate() {
        let i = chunk * CHUNK + k;
        *extent = match boxes[i] != Box3::EMPTY && set.curve(i).segments <= SMALL {
            true => set.diagonals(simd, i),
            false => Diagonals::UNBOUNDED,
        };
    }
}

/// Boxes sorted by their lower bounds along an axis, structure of arrays. `lo` and `hi` end with
/// padding that overlaps nothing, so that eight values can be read from the index of any box.
#[derive(Debug, Default)]
struct Sweep {
    /// Sort keys. The high half orders the boxes by their lower bounds along the axis, the low half
    /// is the index of the box.
    keys: Vec<u64>,
    /// Indices of the boxes, sorted by their lower bounds.
    order: Vec<u32>,
    /// Bounds along the axis, and along the two other axes.
    lo: [Vec<f32>; 3],
    hi: [Vec<f32>; 3],
}

impl Sweep {
    fn fill(&mut self, boxes: &[Box3], sort: &mut BucketSort) {
        let axis = widest_axis(boxes);
        let Sweep { keys, order, .. } = self;
        let some = boxes.iter().enumerate().filter(|&(_, b)| *b != Box3::EMPTY);
        let starts = some.clone().map(|(_, b)| f64::from(b.lo[axis]));
        let first = starts.clone().fold(f64::INFINITY, f64::min);
        let last = starts.fold(f64::NEG_INFINITY, f64::max);
        let buckets = boxes.len();
        let scale = buckets as f64 / (last - first);
        let bucket = |&key: &u64| {
            let start = f64::from(boxes[key as u32 as usize].lo[axis]);
            // Rounding keeps the order. NaN, if all boxes start at one place, becomes 0.
            (((start - first) * scale) as usize).min(buckets - 1)
        };
        let key = |(i, b): (usize, &Box3)| u64::from(ordered_bits(b.lo[axis])) << 32 | i as u64;
        sort.sort(some.map(key), buckets, bucket, keys);
        order.clear();
        order.extend(keys.iter().map(|&key| key as u32));
        for (k, (lo, hi)) in self.lo.iter_mut().zip(&mut self.hi).enumerate() {
            let x = (axis + k) % 3;
            lo.clear();
            hi.clear();
            for &i in order.iter() {
                let b = &boxes[i as usize];
                lo.push(b.lo[x]);
                hi.push(b.hi[x]);
            }
            lo.extend([f32::INFINITY; LANES]);
            hi.extend([f32::NEG_INFINITY; LANES]);
        }
    }

    /// Adds the pairs whose first box in the order is in `range`. Ends early with more than `most`.
    /// Returns the box after the last one.
    #[inline(always)]
    fn run<L: Lanes>(
        &self,
        simd: L,
        range: Range<usize>,
        most: usize,
        found: &mut Vec<Pair>,
    ) -> usize {
        let after = range.end;
        for k in range {
            if found.len() > most {
                return k;
            }
            let i = self.order[k];
            let (end, lo1, hi1, lo2, hi2) = (
                simd.splat(self.hi[0][k]),
                simd.splat(self.lo[1][k]),
                simd.splat(self.hi[1][k]),
                simd.splat(self.lo[2][k]),
                simd.splat(self.hi[2][k]),
            );
            let mut at = k + 1;
            // Until the sweep has passed the box. The padding at the end is beyond every box.
            while at < self.order.len() && self.lo[0][at] <= self.hi[0][k] {
                let first = simd.less(end, eight(simd, &self.lo[0], at));
                let second = simd.or(
                    simd.less(hi1, eight(simd, &self.lo[1], at)),
                    simd.less(eight(simd, &self.hi[1], at), lo1),
                );
                let third = simd.or(
                    simd.less(hi2, eight(simd, &self.lo[2], at)),
                    simd.less(eight(simd, &self.hi[2], at), lo2),
                );
                let mut lanes = !simd.bits(simd.or(simd.or(first, second), third)) & 0xff;
                while lanes != 0 {
                    let j = self.order[at + lanes.trailing_zeros() as usize];
                    lanes &= lanes - 1;
                    found.push((i.min(j), i.max(j)));
                }
                at += LANES;
            }
        }
        after
    }
}

/// Loads eight numbers from index `at` on. The padding makes them available at every box.
#[inline(always)]
fn eight<L: Lanes>(simd: L, v: &[f32], at: usize) -> L::Floats {
    match v[at..].first_chunk() {
        Some(row) => simd.load(row),
        None => simd.splat(f32::INFINITY),
    }
}

/// Returns the bit pattern of a number that is not NaN, mapped so that the integers have the order
/// of the numbers.
fn ordered_bits(x: f32) -> u32 {
    // Both zeros are mapped to the same integer.
    let bits = (x + 0.0).to_bits();
    if bits >> 31 == 0 {
        bits | 1 << 31
    } else {
        !bits
    }
}

/// Returns the axis along which the boxes are spread most, in units of the mean box width.
fn widest_axis(boxes: &[Box3]) -> usize {
    let spread = |x: usize| {
        let (mut lo, mut hi, mut width) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
        for b in boxes.iter().filter(|&b| *b != Box3::EMPTY) {
            lo = lo.min(f64::from(b.lo[x]));
            hi = hi.max(f64::from(b.hi[x]));
            width += f64::from(b.hi[x]) - f64::from(b.lo[x]);
        }
        let width = width / boxes.len().max(1) as f64;
        match width > 0.0 {
            true => (hi - lo) / width,
            false => f64::INFINITY,
        }
    };
    let spreads = per_axis(spread);
    let widest = (0..3).max_by(|&a, &b| spreads[a].total_cmp(&spreads[b]));
    widest.unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pairs::LoopPairs;
    use crate::simd::Portable;
    use proptest::prelude::*;
    use std::sync::Arc;

    /// Returns all pairs of overlapping boxes, sorted. Takes quadratic time.
    fn potential_links_brute(boxes: &[Box3]) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for (i, a) in boxes.iter().enumerate() {
            for (j, b) in boxes.iter().enumerate().skip(i + 1) {
                if a.overlaps(b) {
                    pairs.push((i as u32, j as u32));
                }
            }
        }
        pairs
    }

    proptest! {
        /// The sweep finds all pairs and no others, with ties and empty boxes.
        #[test]
        fn sweep_equals_brute_force(
            raw in prop::collection::vec(
                (prop::array::uniform3(0u8..20), prop::array::uniform3(0u8..6), 0u8..10),
                0..120,
            )
        ) {
            let boxes: Vec<Box3> = raw.iter().map(|(lo, size, kind)| {
                if *kind == 0 {
                    return Box3::EMPTY;
                }
                let lo = lo.map(f32::from);
                Box3 { lo, hi: per_axis(|x| lo[x] + f32::from(size[x])) }
            }).collect();
            let want = potential_links_brute(&boxes);
            let mut search = LinkSearch::default();
            // Buffers of another scene do not affect the result.
            search.find(&[Box3 { lo: [-1.0; 3], hi: [100.0; 3] }; 700]);
            prop_assert_eq!(&*search.find(&boxes), &want);
            let mut portable = Vec::new();
            let all = 0..search.sweep.order.len();
            search.sweep.run(Portable, all, usize::MAX, &mut portable);
            portable.sort_unstable();
            prop_assert_eq!(&portable, &want);
        }
    }

    #[test]
    fn more_pairs_than_the_limit_are_reported_and_none_are_kept() {
        let same = Box3 {
            lo: [0.0; 3],
            hi: [1.0; 3],
        };
        let limit = PairLimit::default();
        let mut search = LinkSearch {
            limit: limit.clone(),
            ..LinkSearch::default()
        };
        let all = 1200 * 1199 / 2;
        for (most, exceeded) in [(all, false), (all - 1, true), (10, true), (all, false)] {
            limit.begin(most);
            let found = search.find(&vec![same; 1200]).len();
            assert_eq!(limit.is_exceeded(), exceeded, "limit {most}");
            assert_eq!(found, if exceeded { 0 } else { all });
        }
    }

    /// Regression test: pairs that the filter excludes counted towards the limit, and others were
    /// missing.
    #[test]
    fn a_limit_counts_only_the_pairs_of_a_filter_and_hides_none() {
        let same = Box3 {
            lo: [0.0; 3],
            hi: [1.0; 3],
        };
        let boxes = vec![same; 600];
        // Two closed curves, and loops with a common curve.
        let filter = PairFilter::Loops(Arc::new(LoopPairs {
            closed: vec![true; 2],
            loops: (0..598).map(|k| [0, k]).collect(),
        }));
        let limit = PairLimit::default();
        let mut search = LinkSearch::new(Some(filter));
        search.limit = limit.clone();
        let all = 1 + 2 * 598;
        for most in [0, 1, 30, 512, all - 1, all, all + 1, usize::MAX] {
            limit.begin(most);
            let found = search.find(&boxes).len();
            assert_eq!(limit.is_exceeded(), all > most, "limit {most}");
            assert_eq!(found, if all > most { 0 } else { all });
        }
    }

    #[test]
    fn ordered_bits_are_in_order() {
        let numbers = [f32::MIN, -1.5, -1.0, -1e-45, 0.0, 1e-45, 1.0, 1.5, f32::MAX];
        assert!(numbers.is_sorted_by_key(|&x| ordered_bits(x)));
        assert_eq!(ordered_bits(-0.0), ordered_bits(0.0));
    }
}
