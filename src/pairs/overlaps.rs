//! Segment pairs of two curves whose boxes overlap in space.

use super::descent::{Query, SegmentPairs, descend};
use super::trees::Trees;
#[cfg(target_arch = "x86_64")]
use crate::curve::Avx2;
use crate::curve::{CurveSet, Lanes, Portable};

/// Returns all segment pairs of curves `i` and `j` with overlapping boxes, sorted.
pub(crate) fn overlapping_segments(
    set: &CurveSet,
    trees: &Trees,
    i: usize,
    j: usize,
) -> Vec<(u32, u32)> {
    let mut found = {
        #[cfg(target_arch = "x86_64")]
        match Avx2::detect() {
            #[expect(unsafe_code, reason = "vector instructions")]
            // SAFETY: the token proves that the CPU has these instructions.
            Some(avx2) => unsafe { find_avx2(avx2, set, trees, [i, j]) },
            None => find(Portable, set, trees, [i, j]),
        }
        #[cfg(not(target_arch = "x86_64"))]
        find(Portable, set, trees, [i, j])
    };
    found.sort_unstable();
    found
}

/// [`find`], compiled with AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
fn find_avx2(avx2: Avx2, set: &CurveSet, trees: &Trees, pair: [usize; 2]) -> Vec<(u32, u32)> {
    find(avx2, set, trees, pair)
}

#[inline(always)]
fn find<L: Lanes>(simd: L, set: &CurveSet, trees: &Trees, pair: [usize; 2]) -> Vec<(u32, u32)> {
    let both = pair.map(|i| trees.of(set, i));
    let mut agenda = vec![(both[0].root(), both[1].root())];
    let mut found = SegmentPairs::default();
    let query = Query {
        w: 2,
        meeting: false,
        reach: 0.0,
    };
    let all = (usize::MAX, usize::MAX);
    descend::<L, true>(simd, both, query, &mut agenda, &mut found, all);
    found.all
}
