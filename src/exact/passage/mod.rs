//! Passages of two moving edges through each other: their times, places and signs.
//!
//! Between two frames every vertex moves on a straight line at constant speed: `(1 - t) p + t p'`.
//! An edge `a b` of one curve and an edge `c d` of another pass through each other at a time at
//! which they share an inner point and the volume `orient3d(a, b, c, d)`, a cubic polynomial in
//! `t`, changes its sign.
//!
//! # Sign of a passage
//!
//! Seen against an axis, the pair adds `o` to the linking number if `a b` passes over `c d`. Here
//! `o` is the sign of `orient2d(a, b, d)`, and `a b` is above if `orient3d` has the sign of `-o`
//! ([`mod@super::crossing`]). While the projections cross, a change of `orient3d` from minus to
//! plus therefore subtracts `o` if `o = 1`, and adds `o` if `o = -1`: the change is `-1` in both
//! cases. So the sign of a passage is opposite to the sign of the change of `orient3d`.
//!
//! # Invariant
//!
//! For two closed curves that touch in neither frame, the signs of all passages, summed over all
//! pairs of their edges, equal the linking number in the second frame minus the linking number in
//! the first one. This holds for every motion, however degenerate.
//!
//! # The translation rule for ties
//!
//! Ties are decided as if the first curve were translated by `v = (e, e^16, e^256)`, with `e`
//! positive and arbitrarily small, the same at all times. Curves that do not touch in the two
//! frames keep their linking numbers there.
//!
//! Let `F(s, u, t)` be the difference of the point at `u` on the second edge and the point at `s`
//! on the first one. A passage of the translated edges is a solution of `F = v` in the unit cube.
//! The sum of their signs is, up to its sign, the degree of `F` over `v`, which the boundary of the
//! cube determines.
//!
//! # Proof: `v` is in general position
//!
//! - `v` is not on the image of a face of the cube. Such an image is part of a quadric or a plane,
//!   because `F` is linear in each of its variables. No polynomial of degree 15 or less vanishes
//!   along `(e, e^16, e^256)`, because its monomials are different powers of `e`. So it has
//!   finitely many zeros there, and none in some interval that starts at 0. (Along `(e, e^2, e^3)`,
//!   which suffices if nothing moves, `z = x y` does vanish.)
//! - The line through `v` along an axis misses the images of the edges of the cube, which are
//!   straight segments (or points), and also the points and lines to which a face may degenerate.
//!
//! # Derivation: the count of passages
//!
//! The degree is the signed number of times that a ray from `v` along axis `w` leaves through a
//! face. The faces of the first and the last moment count the crossings of the projections. The
//! other four faces count the times at which one of the four ends moves over or under the other
//! edge, so that the crossing is handed over to the neighbour of its edge.
//!
//! Let `X(t)` be the crossing that the pair adds to the linking number at time `t`. If
//! `orient2d(c, d, a)` of the end `a` changes from minus to plus above an inner point of the
//! projection of `c d`, then `X` increases by 1: either a crossing of sign 1 begins, or one of sign
//! -1 ends. `b` is the other end of the edge and decreases `X`. Likewise `c` (below, by
//! `orient2d(a, b, c)`) decreases `X`, and `d` increases it. So
//!
//! ```text
//! passages in (t, t') = X(t') - X(t) - hand-overs of a + those of b + those of c - those of d
//! ```
//!
//! The hand-overs of `b` are those of `a` of the next edge, computed by the same polynomials. In
//! the sum over all edges of the two curves the hand-overs cancel, and the change of the linking
//! number remains. The sum is right for every rule, because each term belongs to a single face.
//! Every term is a count of passages because `v` is in general position.
//!
//! # Methods, from fast to exact
//!
//! 1. A coordinate separates most pairs of edges.
//! 2. Floating point with proven bounds decides nearly all others, and finds the time ([`filter`]).
//! 3. Exact arithmetic decides the rest ([`exact`]). The roots of the volume are isolated by
//!    Sturm's theorem in integers. The signs of the sides at the roots show if the edges are apart
//!    there, or share inner points. Only if neither holds, the count above is evaluated around that
//!    root, in integers with an infinitesimal `e`.
//!
//! If the edges lie in one plane at all times, the translated edges become coplanar only infinitely
//! near to the roots of the lowest coefficient of the volume, seen as a polynomial in `e`.
//!
//! # Contact in a frame
//!
//! The faces of the first and the last moment are faces of the cube as well, so the translated
//! edges do not touch in a frame, even if the edges themselves do. Each passage of the translated
//! curves is in exactly one step. A contact in a frame is an event of both adjacent steps
//! ([`Moment::End`] of one, [`Moment::Start`] of the other). The signs of both add up to the
//! passages of the motion through that contact. Each sign alone depends on the direction of the
//! translation and means nothing. If the curves touch in a frame, their linking number is undefined
//! there. With the linking number of the translated curves in its place, the sum over all passages
//! of a step is the change of the linking number, even if the curves touch.
//!
//! Contact without a passage is no event, at inner points and elsewhere: of the passages that the
//! translation makes infinitely near to one time, only the sum within one pair of edges is
//! reported. Ties that belong to several pairs of edges may show passages that cancel.
//!
//! # A curve and itself
//!
//! One edge cannot be translated without the other one, and there is no linking number to preserve.
//! [`Ties::Report`] decides everything except ties, and reports those. Edges that share a vertex
//! are always a tie.

mod exact;
mod filter;
mod polynomial;
mod ring;
#[cfg(test)]
mod tests;

use super::segments_touch;
use crate::curve::vector::{dot, half_difference, mix, per_axis, two_sum};
use crate::curve::{Point, SumEdges, SumPoint, TERMS};

/// Ends of an edge of the first curve and of an edge of the second one.
pub(crate) type Edges = [[Point; 2]; 2];

/// A passage of one edge through another, or a contact of two edges in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Passage {
    /// Time as a fraction of the step: proven to `1e-9`, and to a rounding error if decided
    /// exactly.
    pub time: f64,
    /// Moment of the passage: within the step, or in a frame.
    pub moment: Moment,
    /// Change of the linking number of the two curves: 1 or -1 within the step. For a contact in a
    /// frame, the contribution of this step to the passages of the translated curves: any number,
    /// including 0.
    pub sign: i32,
    /// Position along either edge, from 0 at its start to 1 at its end. For display, as is the
    /// point.
    pub at: [f64; 2],
    /// Position in space.
    pub point: Point,
}

/// Moment at which a passage takes place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Moment {
    /// The edges touch in the first frame of the step.
    Start,
    /// Between the frames. If `tie` is set, only the translated edges are known to pass through one
    /// another.
    Within { tie: bool },
    /// The edges touch in the last frame of the step.
    End,
}

/// Treatment of ties, in which a passage is not one of inner points of both edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ties {
    /// Translate the first curve infinitesimally. For two curves, of which the same one must come
    /// first in all pairs of edges.
    Translate,
    /// Report ties. For a curve and itself, because a translation would move both edges.
    Report,
}

/// Method that decided a pair of edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Decided {
    /// A coordinate: one edge stays on one side of the other.
    Apart,
    /// Floating point with a proven bound.
    Certified,
    /// Exact arithmetic.
    Exact,
    /// None: there are ties, and they are to be reported.
    Tie,
}

/// Calls `out` with every passage of a pair of edges and with every contact in a frame, in
/// chronological order. Coordinates may be rounded by at most `rounding`: the result is then that
/// of the exact coordinates in both frames, which `sums` returns.
///
/// With [`Ties::Report`], contacts in a frame are decided by a translation as well. They are
/// meaningful only if the caller can determine which other pairs of edges take part in the contact,
/// and passes the same curve first in all of them. If the result is [`Decided::Tie`], there are no
/// events, and the pair is undecided.
pub(crate) fn passages_of_sums(
    [before, after]: [&Edges; 2],
    rounding: f64,
    sums: impl FnOnce() -> [SumEdges; 2],
    ties: Ties,
    out: &mut impl FnMut(Passage),
) -> Decided {
    if filter::apart(before, after, rounding) {
        return Decided::Apart;
    }
    if rounding == 0.0 && before == after && !segments_touch(before) {
        return Decided::Certified;
    }
    if let Some(found) = filter::passages(before, after, rounding) {
        found.into_iter().flatten().for_each(out);
        return Decided::Certified;
    }
    if rounding == 0.0 {
        return exactly(before, after, ties, out);
    }
    // Relative to a vertex, because places along the edges are computed in floating point.
    let sums = sums();
    let origin = sums[0][0][0];
    let local = sums.map(|edges| edges.map(|edge| edge.map(|p| difference(&p, &origin))));
    report(
        [&local[0], &local[1]],
        exact::events_of_sums(sums, ties),
        &mut |mut p| {
            p.point = per_axis(|x| p.point[x] + before[0][0][x]);
            out(p);
        },
    )
}

/// Returns true if two points are equal.
pub(crate) fn equal_sums(p: &SumPoint, q: &SumPoint) -> bool {
    // The parts of a difference do not overlap, so their sum is 0 only if all of them are.
    difference(p, q) == [0.0; 3]
}

/// Returns the vector from one point to another, rounded once or twice.
fn difference(to: &SumPoint, from: &SumPoint) -> Point {
    per_axis(|x| {
        // A growing expansion (Shewchuk 1997): its parts add up to the exact sum.
        let mut parts = [0.0; 2 * TERMS];
        let terms = to[x].into_iter().chain(from[x].map(|term| -term));
        for (count, mut sum) in terms.enumerate() {
            for part in &mut parts[..count] {
                let (whole, error) = two_sum(sum, *part);
                (sum, *part) = (whole, error);
            }
            parts[count] = sum;
        }
        // The smallest parts come first.
        parts.iter().sum()
    })
}

/// [`passages_of_sums`] in exact arithmetic only, without rounding.
#[cold]
fn exactly(before: &Edges, after: &Edges, ties: Ties, out: &mut impl FnMut(Passage)) -> Decided {
    report([before, after], exact::events(before, after, ties), out)
}

/// Calls `out` with the passages at exact events.
fn report(
    [before, after]: [&Edges; 2],
    events: Option<Vec<exact::Event>>,
    out: &mut impl FnMut(Passage),
) -> Decided {
    let Some(events) = events else {
        return Decided::Tie;
    };
    for event in events {
        let at = nearest(before, after, event.time);
        let mut passage = Passage {
            time: event.time,
            moment: event.moment,
            sign: event.sign,
            at,
            point: along(before, after, event.time, at),
        };
        if let Moment::Within { .. } = event.moment {
            passage.sign = event.sign.signum();
            (0..event.sign.abs()).for_each(|_| out(passage));
        } else {
            out(passage);
        }
    }
    Decided::Exact
}

/// Returns the midpoint of two points on the edges at a time.
fn along(before: &Edges, after: &Edges, time: f64, at: [f64; 2]) -> Point {
    let [p, q] = [0, 1].map(|side| {
        let [start, end] = [0, 1].map(|k| mix(before[side][k], after[side][k], time));
        mix(start, end, at[side])
    });
    // Halves are added, because the sum may overflow.
    per_axis(|x| 0.5 * p[x] + 0.5 * q[x])
}

/// Returns the positions along the edges at which they are nearest to each other at a time. In
/// floating point, for display.
fn nearest(before: &Edges, after: &Edges, time: f64) -> [f64; 2] {
    let [[a, b], [c, d]] =
        [0, 1].map(|side| [0, 1].map(|k| mix(before[side][k], after[side][k], time)));
    let [p, q, r] = [(b, a), (d, c), (c, a)].map(|(to, from)| half_difference(to, from));
    // Scaled so that squares neither overflow nor underflow.
    let all = [p, q, r];
    let sizes = all.as_flattened().iter().map(|x| x.abs());
    let size = sizes.fold(0.0, f64::max);
    let [p, q, r] = [p, q, r].map(|v| v.map(|x| if size > 0.0 { x / size } else { 0.0 }));
    let (pp, pq, qq, pr, qr) = (dot(p, p), dot(p, q), dot(q, q), dot(p, r), dot(q, r));
    let part = |x: f64, whole: f64| match whole > 0.0 {
        true => (x / whole).clamp(0.0, 1.0),
        false => 0.0,
    };
    // Candidates: the ends of either edge with the nearest point of the other edge, and inner
    // points.
    let inner = part(pr * qq - qr * pq, pp * qq - pq * pq);
    let next_to_first = |s: f64| [s, part(s * pq - qr, qq)];
    let next_to_second = |u: f64| [part(u * pq + pr, pp), u];
    let places = [
        next_to_first(inner),
        next_to_first(0.0),
        next_to_first(1.0),
        next_to_second(0.0),
        next_to_second(1.0),
    ];
    let distance = |[s, u]: [f64; 2]| {
        let gap = per_axis(|x| r[x] + u * q[x] - s * p[x]);
        dot(gap, gap)
    };
    let nearer = |a: &[f64; 2], b: &[f64; 2]| distance(*a).total_cmp(&distance(*b));
    places.into_iter().min_by(nearer).unwrap_or_default()
}
