//! Potential links by a sort and a sweep along the axis with the largest spread of the boxes.
//!
//! Cost: `O(n log n)` for the sort. The sweep compares each box with a few neighbours on sheets and
//! garments. It is quadratic if all boxes overlap along the axis.

use super::Pair;
use crate::curve::Box3;
use crate::simd::{LANES, Lanes, dispatch};
use rayon::prelude::*;
use std::ops::Range;

/// Number of boxes that a task sweeps.
const CHUNK: usize = 512;

/// Search for potential links. Its buffers are reused from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct LinkSearch {
    sweep: Sweep,
    /// Pairs found by each task.
    parts: Vec<Vec<Pair>>,
    pairs: Vec<Pair>,
}

impl LinkSearch {
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
        let LinkSearch {
            sweep,
            parts,
            pairs,
        } = self;
        sweep.fill(boxes);
        let n = sweep.order.len();
        parts.resize_with(Self::tasks(n).max(parts.len()), Vec::new);
        parts.par_iter_mut().enumerate().for_each(|(c, part)| {
            part.clear();
            let range = (c * CHUNK).min(n)..((c + 1) * CHUNK).min(n);
            dispatch!(simd => Sweep::run(&*sweep, simd, range, part));
        });
        pairs.clear();
        for part in parts.iter() {
            pairs.extend_from_slice(part);
        }
        pairs.par_sort_unstable_by_key(|&(i, j)| u64::from(i) << 32 | u64::from(j));
        pairs
    }

    /// Returns the number of groups of eight boxes that the last search compared with a box.
    pub fn steps(&self) -> u64 {
        let [lo, ..] = &self.sweep.lo;
        let [hi, ..] = &self.sweep.hi;
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

    /// Returns the number of bytes of the sorted boxes and of the pairs found.
    pub fn bytes(&self) -> usize {
        let Sweep {
            keys,
            order,
            lo,
            hi,
        } = &self.sweep;
        let columns: usize = lo.iter().chain(hi).map(|v| size_of_val(&v[..])).sum();
        let parts: usize = self.parts.iter().map(|p| size_of_val(&p[..])).sum();
        size_of_val(&keys[..])
            + size_of_val(&order[..])
            + columns
            + parts
            + size_of_val(&self.pairs[..])
    }
}

/// Boxes sorted along an axis, structure of arrays. Each array ends with padding values that
/// overlap nothing, so that eight values can be read from every position.
#[derive(Debug, Default)]
struct Sweep {
    /// Lower bounds as integers with the same order in the high bits, index of the box in the low
    /// bits.
    keys: Vec<u64>,
    /// Indices of the boxes, sorted by their lower bounds.
    order: Vec<u32>,
    /// Bounds along the axis, and along the two other axes.
    lo: [Vec<f32>; 3],
    hi: [Vec<f32>; 3],
}

impl Sweep {
    fn fill(&mut self, boxes: &[Box3]) {
        let axis = widest_axis(boxes);
        let Sweep {
            keys,
            order,
            lo,
            hi,
        } = self;
        keys.clear();
        let some = boxes.iter().enumerate().filter(|&(_, b)| *b != Box3::EMPTY);
        keys.extend(some.map(|(i, b)| u64::from(ordered_bits(b.lo[axis])) << 32 | i as u64));
        keys.par_sort_unstable();
        order.clear();
        order.extend(keys.iter().map(|&key| key as u32));
        for (k, x) in [axis, (axis + 1) % 3, (axis + 2) % 3]
            .into_iter()
            .enumerate()
        {
            for (column, end) in [(&mut lo[k], f32::INFINITY), (&mut hi[k], f32::NEG_INFINITY)] {
                let lower = end > 0.0;
                column.clear();
                column.extend(order.iter().map(|&i| {
                    let b = &boxes[i as usize];
                    if lower { b.lo[x] } else { b.hi[x] }
                }));
                column.extend([end; LANES]);
            }
        }
    }

    /// Adds the pairs whose first box in the order is in `range`.
    #[inline(always)]
    fn run<L: Lanes>(&self, simd: L, range: Range<usize>, found: &mut Vec<Pair>) {
        for k in range {
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
        if width > 0.0 {
            (hi - lo) / width
        } else {
            f64::INFINITY
        }
    };
    let spreads = [0, 1, 2].map(spread);
    (0..3)
        .max_by(|&a, &b| spreads[a].total_cmp(&spreads[b]))
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pairs::potential_links_brute;
    use crate::simd::Portable;
    use proptest::prelude::*;

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
                Box3 { lo, hi: [0, 1, 2].map(|x| lo[x] + f32::from(size[x])) }
            }).collect();
            let want = potential_links_brute(&boxes);
            let mut search = LinkSearch::default();
            // Buffers of another scene do not affect the result.
            search.find(&[Box3 { lo: [-1.0; 3], hi: [100.0; 3] }; 700]);
            prop_assert_eq!(&*search.find(&boxes), &want);
            let mut portable = Vec::new();
            search.sweep.run(Portable, 0..search.sweep.order.len(), &mut portable);
            portable.sort_unstable();
            prop_assert_eq!(&portable, &want);
        }
    }

    #[test]
    fn ordered_bits_are_in_order() {
        let numbers = [f32::MIN, -1.5, -1.0, -1e-45, 0.0, 1e-45, 1.0, 1.5, f32::MAX];
        assert!(numbers.is_sorted_by_key(|&x| ordered_bits(x)));
        assert_eq!(ordered_bits(-0.0), ordered_bits(0.0));
    }
}
