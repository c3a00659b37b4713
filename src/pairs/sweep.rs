//! Potential links by sorting and sweeping along the axis on which the boxes are spread the most.
//!
//! Cost: `O(n log n)` for the sort and, on sheets and garments, a few neighbours a box for the sweep;
//! quadratic where all boxes overlap along the axis.

use super::Pair;
#[cfg(target_arch = "x86_64")]
use crate::curve::Avx2;
use crate::curve::{Box3, LANES, Lanes, Portable};
use rayon::prelude::*;
use std::ops::Range;

/// Boxes swept by one task.
const CHUNK: usize = 512;

/// All pairs of overlapping boxes, sorted. Empty boxes overlap nothing.
pub(crate) fn potential_links(boxes: &[Box3]) -> Vec<Pair> {
    let sweep = Sweep::new(boxes);
    let parts: Vec<Vec<Pair>> = (0..sweep.order.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|c| sweep.run(c * CHUNK..((c + 1) * CHUNK).min(sweep.order.len())))
        .collect();
    let mut pairs = parts.concat();
    pairs.par_sort_unstable();
    pairs
}

/// Boxes sorted along an axis, structure of arrays. Each array ends in values that overlap nothing, so that eight
/// may be read from everywhere.
struct Sweep {
    /// Numbers of the boxes, in the order of their lower ends.
    order: Vec<u32>,
    /// Bounds along the axis, and along the two others.
    lo: [Vec<f32>; 3],
    hi: [Vec<f32>; 3],
}

impl Sweep {
    fn new(boxes: &[Box3]) -> Sweep {
        let axis = widest_axis(boxes);
        let mut keys: Vec<(f32, u32)> = (0..boxes.len() as u32)
            .filter(|&i| boxes[i as usize] != Box3::EMPTY)
            .map(|i| (boxes[i as usize].lo[axis], i))
            .collect();
        keys.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let order: Vec<u32> = keys.iter().map(|k| k.1).collect();
        let column = |of: &dyn Fn(&Box3) -> f32, end: f32| -> Vec<f32> {
            let values = order.iter().map(|&i| of(&boxes[i as usize]));
            values.chain([end; LANES]).collect()
        };
        let axes = [axis, (axis + 1) % 3, (axis + 2) % 3];
        Sweep {
            lo: axes.map(|x| column(&|b| b.lo[x], f32::INFINITY)),
            hi: axes.map(|x| column(&|b| b.hi[x], f32::NEG_INFINITY)),
            order,
        }
    }

    /// Pairs whose first box in the order is in `range`.
    fn run(&self, range: Range<usize>) -> Vec<Pair> {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = Avx2::detect() {
            #[expect(unsafe_code, reason = "vector instructions")]
            // SAFETY: the token says that the processor has them.
            return unsafe { self.run_avx2(avx2, range) };
        }
        self.run_with(Portable, range)
    }

    /// [`Sweep::run_with`], compiled with AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn run_avx2(&self, avx2: Avx2, range: Range<usize>) -> Vec<Pair> {
        self.run_with(avx2, range)
    }

    #[inline(always)]
    fn run_with<L: Lanes>(&self, simd: L, range: Range<usize>) -> Vec<Pair> {
        let mut found = Vec::new();
        for k in range {
            let i = self.order[k];
            let mut at = k + 1;
            // Until the sweep has passed the box. The end of the array is beyond every box.
            while self.lo[0][at] <= self.hi[0][k] {
                let eight = |v: &Vec<f32>| -> [f32; LANES] {
                    let mut out = [0.0; LANES];
                    out.copy_from_slice(&v[at..at + LANES]);
                    out
                };
                let (lo0, lo1, lo2) = (eight(&self.lo[0]), eight(&self.lo[1]), eight(&self.lo[2]));
                let (hi1, hi2) = (eight(&self.hi[1]), eight(&self.hi[2]));
                let apart = simd.greater(&lo0, self.hi[0][k])
                    | simd.greater(&lo1, self.hi[1][k])
                    | simd.less(&hi1, self.lo[1][k])
                    | simd.greater(&lo2, self.hi[2][k])
                    | simd.less(&hi2, self.lo[2][k]);
                let mut lanes = !apart & 0xff;
                while lanes != 0 {
                    let j = self.order[at + lanes.trailing_zeros() as usize];
                    lanes &= lanes - 1;
                    found.push((i.min(j), i.max(j)));
                }
                at += LANES;
                if at >= self.order.len() {
                    break;
                }
            }
        }
        found
    }
}

/// The axis along which the boxes are spread the most, measured in mean box widths.
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
    use proptest::prelude::*;

    proptest! {
        /// No pair is missed and none is invented, ties and empty boxes included.
        #[test]
        fn sweep_equals_brute_force(
            raw in prop::collection::vec((prop::array::uniform3(0u8..20), prop::array::uniform3(0u8..6), 0u8..10), 0..120)
        ) {
            let boxes: Vec<Box3> = raw.iter().map(|(lo, size, kind)| {
                if *kind == 0 {
                    return Box3::EMPTY;
                }
                let lo = lo.map(f32::from);
                Box3 { lo, hi: [0, 1, 2].map(|x| lo[x] + f32::from(size[x])) }
            }).collect();
            let want = potential_links_brute(&boxes);
            prop_assert_eq!(&potential_links(&boxes), &want);
            let sweep = Sweep::new(&boxes);
            let mut portable = sweep.run_with(Portable, 0..sweep.order.len());
            portable.sort_unstable();
            prop_assert_eq!(&portable, &want);
        }
    }
}
