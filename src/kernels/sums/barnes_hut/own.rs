//! Gauss integrals of single polylines, open or closed: of two of them, and of one and itself.
//!
//! # A curve and itself
//!
//! The walk visits every pair of different leaves once. Two nodes that share a vertex are never
//! expanded: their centres are at most as far apart as the sum of their radii. Leaf pairs that
//! share a vertex, and pairs within a leaf, have adjacent segments, which contribute nothing
//! because they lie in a plane. The kernel of leaf pairs would find that they touch. So these
//! `O(n)` leaf pairs are summed in interval arithmetic, without the adjacent segments.

use super::trees::{LEAF, Tree};
use super::{Options, within};
use crate::curve::Point;
use crate::kernels::Estimate;
use crate::kernels::sums::interval::{Interval, angle_of};
use rayon::prelude::*;

/// Number of leaves of a parallel task.
const GRAIN: usize = 64;

/// Returns true if segments of two leaves of a closed curve may be adjacent. The first and the last
/// leaf of an open curve are treated alike.
#[inline(always)]
pub(super) fn neighbours(leaves: u32, t: u32, u: u32) -> bool {
    let apart = t.abs_diff(u);
    apart <= 1 || apart + 1 == leaves
}

/// Returns the Gauss integral of two polylines, at an accuracy of `budget` if possible.
/// Coordinates are at most 1.
pub(in crate::kernels::sums) fn between(
    [first, second]: [(&[Point], bool); 2],
    budget: f64,
) -> Estimate {
    let trees = [first, second].map(|(points, closed)| Tree::of(points, closed));
    within(Options::default(), budget, [&trees[0], &trees[1]]).estimate()
}

/// Returns the Gauss integral of a polyline and itself over all unordered pairs of segments, at an
/// accuracy of `budget` if possible. Coordinates are at most 1, and no two consecutive points are
/// the same.
pub(in crate::kernels::sums) fn itself(points: &[Point], closed: bool, budget: f64) -> Estimate {
    let tree = Tree::of(points, closed);
    let far = within(Options::default(), budget, [&tree, &tree]).estimate();
    let near = near(points, closed) / (Interval::PI + Interval::PI);
    near.estimate().plus(far)
}

/// Returns the sum of the angles of all leaf pairs that the walk skips.
fn near(points: &[Point], closed: bool) -> Interval {
    let n = points.len() - usize::from(!closed);
    let leaves = n.div_ceil(LEAF);
    let at = |i: usize| [points[i], points[(i + 1) % points.len()]];
    let segments = |leaf: usize| leaf * LEAF..n.min((leaf + 1) * LEAF);
    let pairs = |t: usize, u: usize| {
        let mut sum = Interval::ZERO;
        for i in segments(t) {
            for j in segments(u) {
                let adjacent = i + 1 == j || (closed && i == 0 && j + 1 == n);
                if i < j && !adjacent {
                    sum = sum + angle_of(at(i), at(j));
                }
            }
        }
        sum
    };
    let of_leaf = |t: usize| {
        let next = if t + 1 < leaves {
            pairs(t, t + 1)
        } else {
            Interval::ZERO
        };
        pairs(t, t) + next
    };
    let parts: Vec<Interval> = (0..leaves.div_ceil(GRAIN))
        .into_par_iter()
        .map(|k| {
            let leaves = k * GRAIN..leaves.min((k + 1) * GRAIN);
            leaves.map(of_leaf).fold(Interval::ZERO, |a, b| a + b)
        })
        .collect();
    let ends = if leaves > 2 {
        pairs(0, leaves - 1)
    } else {
        Interval::ZERO
    };
    parts.into_iter().fold(ends, |a, b| a + b)
}
