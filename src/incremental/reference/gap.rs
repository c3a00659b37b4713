//! Lower bounds of the gap between two segments, and of the components of vectors along an axis;
//! the typical clearance of the curves of a scene, which determines the reach of its reference
//! frame.

use crate::curve::vector::{add_scaled, distance, dot, per_axis, sub};
use crate::curve::{Box3, BoxGroup, Point};
use crate::discretize::Hull;
use crate::incremental::covered::Covered;
use crate::pairs::{BoxTree, Node, Trees, closest_points};
use crate::simd::LANES;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Maximum number of halvings of two segments whose hulls are much nearer than the segments.
pub(super) const DEPTH: u32 = 5;

/// Maximum number of steps of the search for the best axis. Few are needed unless the gap is very
/// small.
const STEPS: usize = 8;

/// Share of the best possible value from which an axis is good enough to end the search.
pub(super) const GOOD: f64 = 0.9;

/// Share of the approximate distance of two segments below which the gap of their hulls is poor.
const POOR: f64 = 0.8;

/// Squared lengths below this limit may have lost digits.
const TINY: f64 = 1e-200;

/// Returns a gap between two segments: a lower bound of their distance within rounding errors, or 0
/// if none was found. It is the gap between their hulls or, if that is poor, the minimum gap
/// between their halves.
///
/// The search ends at the first bound of at least `enough`, which need not be the best one. A
/// smaller result does not depend on `enough`.
#[inline(always)]
pub(super) fn gap(a: &Hull, b: &Hull, enough: f64, depth: u32) -> f64 {
    // Most segments are further apart than required.
    let quick = a.gap_along(b, sub(b.center(), a.center()));
    if quick >= enough {
        return quick;
    }
    quick.max(larger_gap(a, b, enough, depth))
}

/// [`gap`] by a more expensive search.
#[inline(never)]
fn larger_gap(a: &Hull, b: &Hull, enough: f64, depth: u32) -> f64 {
    let near = near_points(a, b);
    let best = gap_of_hulls(a, b, near, enough);
    if depth == 0 || best >= enough.min(POOR * distance(near[0], near[1])) {
        return best;
    }
    let (a, b) = (a.halves(), b.halves());
    let mut least = f64::INFINITY;
    for (a, b) in a.iter().flat_map(|a| b.iter().map(move |b| (a, b))) {
        if least > best {
            least = least.min(gap(a, b, enough.min(least), depth - 1));
        }
    }
    best.max(least)
}

/// Returns points of two segments that are approximately nearest to each other, at the parameters
/// of the nearest points of their chords. The chords may be much nearer if curves bend around each
/// other.
fn near_points(a: &Hull, b: &Hull) -> [Point; 2] {
    let [[p0, p3], [q0, q3]] = [a, b].map(|h| [0, 3].map(|k| h.point(k)));
    let [p, q] = closest_points(p0, p3, q0, q3);
    [a.curve_point_near(p), b.curve_point_near(q)]
}

/// Returns the gap between two hulls, each of which contains one of the points, along the best axis
/// found.
fn gap_of_hulls(a: &Hull, b: &Hull, [p, q]: [Point; 2], enough: f64) -> f64 {
    best_component(sub(q, p), enough, |n| {
        let [from, to] = a.heights_of_both(b, n);
        let (mut i, mut j) = (0, 0);
        for k in 1..4 {
            i = if from[k] > from[i] { k } else { i };
            j = if to[k] < to[j] { k } else { j };
        }
        (to[j] - from[i], sub(b.point(j), a.point(i)))
    })
}

/// Returns the smallest component of some vectors along a unit vector for which it is large, within
/// rounding errors. Returns 0 if no unit vector was found that makes all components positive.
pub(super) fn least_component(vectors: &[Point]) -> f64 {
    let share = 1.0 / vectors.len() as f64;
    let mean = per_axis(|x| vectors.iter().map(|v| v[x] * share).sum());
    let least = |n: Point| {
        let all = vectors.iter().map(|&v| (dot(v, n), v));
        all.fold((f64::INFINITY, n), |a, b| if b.0 < a.0 { b } else { a })
    };
    best_component(mean, f64::INFINITY, least)
}

/// Returns the smallest component of all vectors in a convex set, along a unit vector for which it
/// is large: the first value that is at least `enough`, or the best value found, or 0.
///
/// `n` is in the set, and `least` returns the smallest product of a vector of the set with the
/// argument, and this vector.
///
/// The best axis points to the point of the set that is nearest to the origin. The search
/// approaches this point: each step moves `n` on a straight line towards the vector with the
/// smallest component (the Frank-Wolfe method).
#[inline(always)]
fn best_component(mut n: Point, enough: f64, least: impl Fn(Point) -> (f64, Point)) -> f64 {
    let mut best = 0.0f64;
    for _ in 0..STEPS {
        let length_sq = dot(n, n);
        if !(length_sq > TINY && length_sq.is_finite()) {
            break;
        }
        let (height, v) = least(n);
        best = best.max(height / length_sq.sqrt());
        let d = sub(v, n);
        let t = (length_sq - height) / dot(d, d);
        // No axis is better than the direction of a vector of the set.
        if best >= enough.min(GOOD * length_sq.sqrt()) || t <= 0.0 || t.is_nan() {
            break;
        }
        n = add_scaled(n, t.min(1.0), d);
    }
    best
}

/// Number of blocks whose clearance is sampled to choose the reach.
const SAMPLES: usize = 32;

/// Returns the upper quartile, over a sample of blocks of segments, of the distance to the nearest
/// segment that must stay apart from the block.
pub(super) fn typical_clearance(covered: Covered<'_>, trees: &Trees) -> f64 {
    let set = covered.set;
    let count = |i: usize| (set.curve(i).segments as usize).div_ceil(LANES);
    let total: usize = covered.indices().map(count).sum();
    let step = (total / SAMPLES).max(1);
    let curves = covered.indices();
    let blocks = curves.flat_map(|i| (0..count(i)).map(move |g| (i, g)));
    let samples: Vec<(usize, usize)> = blocks.skip(step / 2).step_by(step).collect();
    let distance = |&(i, block): &_| clearance(covered, trees, i, block);
    let mut distances: Vec<f64> = samples.par_iter().map(distance).collect();
    distances.sort_by(f64::total_cmp);
    let quartile = distances.get(distances.len() * 3 / 4);
    let all = 4.0 * set.max_abs().max(f64::MIN_POSITIVE);
    quartile.map_or(all, |d| d.min(all))
}

/// Returns the approximate distance of a block of segments from all others that must stay apart
/// from it, by best-first search. Infinite if there are none.
fn clearance(covered: Covered<'_>, trees: &Trees, i: usize, block: usize) -> f64 {
    let set = covered.set;
    let boxes = set.leaf_boxes(i, block);
    let bounds = boxes.bounds();
    let hull = |i: usize, s: u32| Hull::new(set.hull(i, s as usize));
    let segments = (0..LANES as u32).map(|k| (block * LANES) as u32 + k);
    let n = set.curve(i).segments;
    let parts = |j: usize| set.parts(i, j);
    let block = segments.filter(|&s| s < n).map(|s| (s, hull(i, s)));
    let block: Vec<(u32, Hull)> = block.collect();
    // Distances are not negative, so their bit patterns have the same order.
    let entry = |j: usize, b: &Box3, node: Option<Node>, at: u32| {
        let distance = Reverse(bounds.dist_sq_below(b).to_bits());
        (distance, j, at, node.map(|n| n.level))
    };
    let others = trees.roots().iter().enumerate().filter(|&(j, root)| {
        (j != i || covered.coverage.self_crossings)
            && *root != Box3::EMPTY
            && covered.has_pair(i as u32, j as u32)
    });
    let entries = others.map(|(j, root)| entry(j, root, Some(trees.of(set, j).root()), 0));
    let mut heap: BinaryHeap<_> = entries.collect();
    let mut best = f64::INFINITY;
    let mut leaf = BoxGroup::EMPTY;
    while let Some((Reverse(bits), j, at, level)) = heap.pop() {
        if f64::from_bits(bits) >= best * best {
            break;
        }
        let Some(level) = level else {
            let other = hull(j, at);
            for (s, hull) in &block {
                if !parts(j).is_some_and(|parts| parts.adjacent(*s, at)) {
                    let [p, q] = near_points(hull, &other);
                    best = best.min(distance(p, q));
                }
            }
            continue;
        };
        let node = Node::new(level, at);
        let group = *trees.of(set, j).children(node, &mut leaf);
        for k in 0..LANES {
            let lane = group.lane(k);
            if lane != Box3::EMPTY {
                let below = (level > 0).then(|| node.child(k as u32));
                heap.push(entry(j, &lane, below, node.lane(k as u32)));
            }
        }
    }
    best
}
