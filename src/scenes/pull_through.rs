//! Synthetic pull-throughs: a piece of one curve is moved through a neighbouring one.

use crate::curve::vector::{add_scaled, cross, distance, dot, norm, per_axis, sub};
use crate::curve::{CurveSet, Point, point_at};
use crate::pairs::{LinkSearch, Pair, Trees, closest_approach};
use crate::verdict::Place;
use rayon::prelude::*;

/// Displacement of a piece, in distances of the two curves: to the other side, and little further,
/// because other curves may be there.
const DISPLACEMENT: f64 = 1.5;

/// Minimum sine of the angle at which two curves pass one another. If they are parallel, a moved
/// piece may go around the other curve, which changes nothing.
const LEAST_SINE: f64 = 0.3;

/// Number of chords in which the nearest point of a spline segment is searched.
const CHORDS: usize = 16;

/// Segment of one curve that can be pulled through another; see
/// [`Frames::pull`](super::Frames::pull).
#[derive(Clone, Debug, PartialEq)]
pub struct Pull {
    /// The curves: first the one that is moved, whose number is smaller.
    pub pair: (u32, u32),
    /// Place of their closest approach, where one passes through the other.
    pub place: Place,
    /// Indices of the control points that move, over all curves.
    pub(super) points: Vec<usize>,
    /// Displacement of these points.
    pub(super) by: Point,
}

/// Returns the pull-throughs that can be applied to a set, those of the nearest curves first: one
/// for each pair of closed curves that is near enough to be linked and passes crosswise at its
/// closest approach.
///
/// The control points of one segment move along the shortest connection, to the other side of the
/// other curve. The linking number of the pair changes by one, and no other linking number changes,
/// unless a third curve or another piece of the second one is in the way. For dense curves, verify
/// this.
pub fn pull_throughs(set: &CurveSet) -> Vec<Pull> {
    let mut trees = Trees::default();
    trees.refit(set);
    let mut search = LinkSearch::default();
    let pairs = search.find(trees.roots());
    let found = |&pair: &Pair| pull_through(set, &trees, pair);
    let mut found: Vec<Pull> = pairs.par_iter().filter_map(found).collect();
    found.sort_by(|a, b| {
        let distances = a.place.distance.total_cmp(&b.place.distance);
        distances.then(a.pair.cmp(&b.pair))
    });
    found
}

/// Returns the pull-through of a pair, if it has one.
fn pull_through(set: &CurveSet, trees: &Trees, pair: Pair) -> Option<Pull> {
    let (i, j) = (pair.0 as usize, pair.1 as usize);
    let (basis, points) = (set.basis(), set.curve(i).points as usize);
    if points <= basis.window() {
        // The curve would be moved as a whole.
        return None;
    }
    let place = closest_approach(set, trees, i, j);
    let (p, u) = nearest(set, i, place.segments[0], place.point);
    let (q, v) = nearest(set, j, place.segments[1], place.point);
    let sine = norm(cross(u, v)) / (norm(u) * norm(v));
    // NaN if an edge has no length.
    if place.distance <= 0.0 || sine.is_nan() || sine < LEAST_SINE {
        return None;
    }
    let start = place.segments[0] as usize * basis.stride() + points - basis.lead(true);
    let first = set.points_of(i).start;
    let window = (start..start + basis.window()).map(|k| first + k % points);
    Some(Pull {
        pair,
        place,
        points: window.collect(),
        by: per_axis(|x| DISPLACEMENT * (q[x] - p[x])),
    })
}

/// Returns the point of a segment that is nearest to another point, and the direction of the curve
/// there.
///
/// For the middle of the shortest connection of two straight segments, the nearest points are the
/// ends of that connection.
fn nearest(set: &CurveSet, i: usize, segment: u32, to: Point) -> (Point, Point) {
    let b = set.segment(i, segment as usize);
    let chords = if set.basis().is_polyline() { 1 } else { CHORDS };
    let at = |k: usize| match k {
        0 => b[0],
        k if k == chords => b[3],
        k => point_at(&b, k as f64 / chords as f64),
    };
    let candidates = (0..chords).map(|k| {
        let (start, d) = (at(k), sub(at(k + 1), at(k)));
        let t = dot(sub(to, start), d) / dot(d, d);
        // A segment without length has no direction: NaN becomes 0.
        let t = if t > 0.0 { t.min(1.0) } else { 0.0 };
        (add_scaled(start, t, d), d)
    });
    let nearest = candidates.min_by(|a, b| distance(a.0, to).total_cmp(&distance(b.0, to)));
    nearest.expect("a segment has chords")
}
