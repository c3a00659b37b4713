//! Computes the boxes of trees from the boxes of their leaves, in parallel.

use super::layout::{Layout, Leaves};
use crate::curve::{Box3, BoxGroup, CurveSet};
use crate::simd::{LANES, Lanes, dispatch, per_lane};

/// Maximum number of segments that a single task refits.
const GRAIN: usize = 1 << 15;

/// Returns true if the boxes of this many segments are refitted by several threads. The segments
/// may belong to several curves or to a single one.
pub(crate) fn refits_in_parallel(segments: usize) -> bool {
    segments > GRAIN
}

/// Refits the trees of the curves from `first` on. Splits the range into tasks while it is large
/// enough.
pub(super) fn refit_range(
    source: Leaves<'_>,
    first: usize,
    layouts: &[Layout],
    groups: &mut [BoxGroup],
    roots: &mut [Box3],
) {
    let work: usize = layouts.iter().map(|l| l.segments as usize).sum();
    if layouts.len() > 1 && refits_in_parallel(work) {
        let mid = layouts.len() / 2;
        let (left, right) = layouts.split_at(mid);
        let split = left.iter().map(|l| l.groups as usize).sum();
        let (left_groups, right_groups) = groups.split_at_mut(split);
        let (left_roots, right_roots) = roots.split_at_mut(mid);
        rayon::join(
            || refit_range(source, first, left, left_groups, left_roots),
            || refit_range(source, first + mid, right, right_groups, right_roots),
        );
        return;
    }
    let mut at = 0;
    for (k, layout) in layouts.iter().enumerate() {
        let stored = &mut groups[at..at + layout.groups as usize];
        at += stored.len();
        roots[k] = refit_curve(source, first + k, layout, stored);
    }
}

/// Refits the tree of one curve. Returns its root box, which is empty if the curve has no tree.
pub(super) fn refit_curve(
    source: Leaves<'_>,
    i: usize,
    layout: &Layout,
    groups: &mut [BoxGroup],
) -> Box3 {
    if !(layout.tree && source.has_tree(i)) {
        return Box3::EMPTY;
    }
    let leaves = (layout.segments as usize).div_ceil(LANES);
    let (stored, upper) = groups.split_at_mut(if layout.leaves { leaves } else { 0 });
    if leaves == 1 {
        let leaf = source.set.leaf_boxes(i, 0);
        stored.fill(leaf);
        return leaf.bounds();
    }
    let (mut below, mut level) = upper.split_at_mut(leaves.div_ceil(LANES));
    refit_leaves(source.set, i, 0, below, stored);
    while !level.is_empty() {
        let (next, rest) = level.split_at_mut(below.len().div_ceil(LANES));
        dispatch!(simd => raise(simd, below, &mut *next));
        (below, level) = (next, rest);
    }
    below[0].bounds()
}

/// Refits leaves of a curve, from `first` on, and the groups `below` whose lanes they are. Stores
/// the leaves if `stored` is not empty. Splits the work into tasks while it is large enough.
fn refit_leaves(
    set: &CurveSet,
    i: usize,
    first: usize,
    below: &mut [BoxGroup],
    stored: &mut [BoxGroup],
) {
    if !refits_in_parallel(below.len() * LANES * LANES) {
        return dispatch!(simd => refit_part(simd, (set, i), first, below, stored));
    }
    let mid = below.len() / 2;
    let (left, right) = below.split_at_mut(mid);
    let (left_stored, right_stored) = stored.split_at_mut((mid * LANES).min(stored.len()));
    rayon::join(
        || refit_leaves(set, i, first, left, left_stored),
        || refit_leaves(set, i, first + mid * LANES, right, right_stored),
    );
}

/// [`refit_leaves`] in one task.
#[inline(always)]
fn refit_part<L: Lanes>(
    simd: L,
    (set, i): (&CurveSet, usize),
    first: usize,
    below: &mut [BoxGroup],
    stored: &mut [BoxGroup],
) {
    let mut eight = [BoxGroup::EMPTY; LANES];
    let rest = (set.curve(i).segments as usize).div_ceil(LANES) - first;
    for (k, group) in below.iter_mut().enumerate() {
        let at = k * LANES;
        let count = (rest - at).min(LANES);
        let leaves = &mut eight[..count];
        for (g, leaf) in leaves.iter_mut().enumerate() {
            *leaf = set.leaf_boxes(i, first + at + g);
        }
        if !stored.is_empty() {
            stored[at..at + count].copy_from_slice(leaves);
        }
        *group = bounds(simd, leaves);
    }
}

/// Refits a level from the level below.
#[inline(always)]
fn raise<L: Lanes>(simd: L, below: &[BoxGroup], level: &mut [BoxGroup]) {
    for (groups, parent) in below.chunks(LANES).zip(level) {
        *parent = bounds(simd, groups);
    }
}

/// Returns the bounding boxes of up to eight groups, one per lane.
#[inline(always)]
fn bounds<L: Lanes>(simd: L, groups: &[BoxGroup]) -> BoxGroup {
    let mut out = BoxGroup::EMPTY;
    let Ok(groups) = <&[BoxGroup; LANES]>::try_from(groups) else {
        for (k, group) in groups.iter().enumerate() {
            let Box3 { lo, hi } = group.bounds();
            for x in 0..3 {
                (out.lo[x][k], out.hi[x][k]) = (lo[x], hi[x]);
            }
        }
        return out;
    };
    for x in 0..3 {
        let lo = per_lane(
            #[inline(always)]
            |k| simd.load(&groups[k].lo[x]),
        );
        simd.store_floats(simd.least(lo), &mut out.lo[x]);
        let hi = per_lane(
            #[inline(always)]
            |k| simd.load(&groups[k].hi[x]),
        );
        simd.store_floats(simd.greatest(hi), &mut out.hi[x]);
    }
    out
}
