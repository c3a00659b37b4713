//! Lower bounds of the gap between two segments, and of the components of vectors along an axis.

use crate::curve::Point;
use crate::curve::vector::{add_scaled, distance, dot, per_axis, sub};
use crate::discretize::Hull;
use crate::pairs::closest_points;

/// Maximum number of halvings of two segments whose hulls are much nearer than the segments.
pub(super) const DEPTH: u32 = 5;

/// Maximum number of steps of the search for the best axis. Few are needed unless the gap is very
/// small.
const STEPS: usize = 8;

/// Share of the best possible value from which on an axis is good enough.
pub(super) const GOOD: f64 = 0.9;

/// Share of the approximate distance of two segments below which the gap of their hulls is poor.
const POOR: f64 = 0.8;

/// Squared lengths below this limit may have lost digits.
const TINY: f64 = 1e-200;

/// Returns a gap between two segments: a lower bound of their distance within rounding errors, or 0
/// if none was found. It is the gap between their hulls or, if that is poor, the minimum gap
/// between their halves.
///
/// A result of at least `enough` is some lower bound of that size. A smaller result does not depend
/// on `enough`.
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
pub(super) fn near_points(a: &Hull, b: &Hull) -> [Point; 2] {
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
