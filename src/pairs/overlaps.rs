//! Segment pairs of two curves whose boxes overlap in space.

use super::descent::{Query, SegmentPairs, descend};
use super::trees::Trees;
use crate::curve::CurveSet;
use crate::simd::{Lanes, dispatch};

/// Returns all segment pairs of curves `i` and `j` with overlapping boxes, sorted.
pub(crate) fn overlapping_segments(
    set: &CurveSet,
    trees: &Trees,
    i: usize,
    j: usize,
) -> Vec<(u32, u32)> {
    let mut found = dispatch!(simd => find(simd, set, trees, [i, j]));
    found.sort_unstable();
    found
}

#[inline(always)]
fn find<L: Lanes>(simd: L, set: &CurveSet, trees: &Trees, pair: [usize; 2]) -> Vec<(u32, u32)> {
    let both = pair.map(|i| trees.of(set, i));
    let mut agenda = vec![(both[0].root(), both[1].root())];
    let mut found = SegmentPairs::default();
    let query = Query::in_space(0.0);
    let all = (usize::MAX, usize::MAX);
    descend::<L, _, true>(simd, both, query, &mut agenda, &mut found, all);
    found.all
}
