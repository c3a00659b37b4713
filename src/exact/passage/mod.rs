//! Do two edges that move pass through each other, when, and with what sign?
//!
//! Between two frames every vertex moves on a straight line at constant speed: `(1 - t) p + t p'`. An edge `a b`
//! of one curve and an edge `c d` of another pass through each other at a time when they share an inner point
//! and the volume `orient3d(a, b, c, d)`, a cubic polynomial in `t`, changes its sign.
//!
//! **Sign.** Seen against an axis, the pair adds `o` to the linking number where `a b` passes over `c d`, with
//! `o` the sign of `orient2d(a, b, d)`, and it passes over where `orient3d` has the sign of `-o` ([`mod@super::crossing`]).
//! While the shadows cross, `orient3d` going from minus to plus therefore takes `o` away for `o = 1`, and adds
//! `o` for `o = -1`: `-1` in both cases. So a passage has the sign opposite to that of the change of `orient3d`.
//!
//! **What holds.** For two closed curves that touch in neither frame, the signs of all passages over all pairs
//! of their edges add up to the linking number after less the linking number before. Always, however degenerate
//! the motion.
//!
//! **The rule for ties.** The first curve is thought translated by `v = (e, e^16, e^256)`, with `e` positive and
//! as small as need be, the same at all times. Curves that do not touch in the two frames keep their linking
//! numbers there. With `F(s, u, t)` the difference of the points at `u` on the second edge and at `s` on the
//! first, a passage of the translated edges is a solution of `F = v` in the unit cube, and the sum of their
//! signs is (less a sign) the degree of `F` over `v`, which the boundary of the cube determines. Two things
//! make `v` general:
//!
//! - `v` is not on the image of a face of the cube. Such an image is part of a quadric or a plane, since `F` is
//!   linear in each of its variables, and no polynomial of degree 15 or less vanishes along `(e, e^16, e^256)`:
//!   its monomials are different powers of `e`. It has finitely many zeros there, none of them in some interval
//!   from 0. (Along `(e, e^2, e^3)`, which is enough where nothing moves, `z = x y` does vanish.)
//! - the line through `v` along an axis misses the images of the cube's edges, since those are straight segments
//!   (and points); likewise for the points and lines to which a face may degenerate.
//!
//! The degree is then the number of times, with signs, that a ray from `v` along axis `w` leaves through a face.
//! The faces of the first and the last moment count the crossings of the shadows; the other four count how
//! often one of the four ends moves over or under the other edge, and hands the crossing over to a neighbour of
//! its edge. Precisely, with `X(t)` the crossing that the pair adds to the linking number at time `t`: an end
//! `a` whose `orient2d(c, d, a)` changes from minus to plus (above an inner point of the shadow of `c d`) raises
//! `X` by 1, whether it makes a crossing of sign 1 or ends one of sign -1; `b` lowers it, since it is the other
//! end; `c` (below, by `orient2d(a, b, c)`) lowers it and `d` raises it. So
//!
//! ```text
//! passages in (t, t') = X(t') - X(t) - hand-overs of a + those of b + those of c - those of d
//! ```
//!
//! What `b` hands over is what `a` of the next edge does, by the same polynomials: in the sum over all edges of
//! the two curves the hand-overs cancel, and what is left is the change of the linking number. That the terms are
//! of one face each makes the sum right whatever the rule; that `v` is general makes every term a count of
//! passages.
//!
//! **The ladder.** Coordinates tell most pairs apart; floating point with proven bounds decides nearly all others
//! and finds the time ([`filter`]); the rest is exact ([`exact`]): the roots of the volume are isolated by Sturm's
//! theorem in integers, and the signs of the sides at the roots tell whether the edges are apart there, or
//! share inner points. Only where they do neither, the count above is made, in integers with an infinitesimal
//! `e`, for the surroundings of that root. Where the edges lie in one plane at all times, the translated ones do
//! infinitely near to the roots of the lowest coefficient of the volume as a polynomial in `e`.
//!
//! **Contact in a frame.** The faces of the first and the last moment are faces of the cube as
//! well, so the translated edges do not touch in a frame, even if the edges themselves do. Each
//! passage of the translated curves is in exactly one step. A contact in a frame is an event of
//! both adjacent steps ([`Moment::End`] of one, [`Moment::Start`] of the other). The signs of both
//! add up to the passages of the motion through that contact. Each sign alone depends on the
//! direction of the translation and means nothing. If the curves touch in a frame, their linking
//! number is undefined there. With the linking number of the translated curves in its place, the
//! sum over all passages of a step is the change of the linking number, whether the curves touch or
//! not.
//!
//! Touching without passing is nothing, at inner points and elsewhere: of the passages that the translation
//! makes infinitely near to one time, within one pair of edges, the sum is told. Ties that belong to several
//! pairs of edges may show passages that cancel.
//!
//! **One curve with itself.** There is no translating one edge without the other, and no number to be preserved.
//! [`Ties::Report`] decides what is no tie and tells the rest. Edges that share a vertex are always a tie.

mod exact;
mod filter;
mod polynomial;
mod ring;
#[cfg(test)]
mod tests;

use crate::curve::Point;

/// The ends of an edge of the first curve and of one of the second.
pub(crate) type Edges = [[Point; 2]; 2];

/// One edge passes through another, or touches it in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Passage {
    /// When, as a fraction of the step: proven to `1e-9`, and to a rounding error if decided exactly.
    pub time: f64,
    /// Moment of the passage: within the step, or in a frame.
    pub moment: Moment,
    /// Change of the linking number of the two curves: 1 or -1 within the step. For a contact in a
    /// frame, the contribution of this step to the passages of the translated curves: any number,
    /// including 0.
    pub sign: i32,
    /// Where along either edge, 0 at its start and 1 at its end: for display, as is the point.
    pub at: [f64; 2],
    /// Where in space.
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

/// What to do where a passage is not one of inner points of both edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ties {
    /// Translate the first curve by next to nothing: for two curves, of which the same one must come first in all
    /// pairs of edges.
    Translate,
    /// Report them: for a curve and itself, where a translation would move both edges.
    Report,
}

/// How a pair of edges was decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Decided {
    /// By a coordinate: one edge stays on one side of the other.
    Apart,
    /// By floating point with a proven bound.
    Certified,
    /// By exact arithmetic.
    Exact,
    /// Not at all: there are ties, and they are to be reported.
    Tie,
}

/// Calls `out` with every passage of a pair of edges and with every contact in a frame, in their
/// order in time.
///
/// With [`Ties::Report`], a translation decides contacts in a frame, too. They mean something only
/// if the caller can determine which other pairs of edges take part in the contact, and passes the
/// same curve first in all of them. If the result is [`Decided::Tie`], there are no events, and the
/// pair is undecided.
pub(crate) fn passages(
    before: &Edges,
    after: &Edges,
    ties: Ties,
    out: &mut impl FnMut(Passage),
) -> Decided {
    if filter::apart(before, after) {
        return Decided::Apart;
    }
    if before == after && !exact::touch(before) {
        return Decided::Certified;
    }
    if let Some(found) = filter::passages(before, after) {
        found.into_iter().flatten().for_each(out);
        return Decided::Certified;
    }
    exactly(before, after, ties, out)
}

/// [`passages`] by exact arithmetic alone.
#[cold]
fn exactly(before: &Edges, after: &Edges, ties: Ties, out: &mut impl FnMut(Passage)) -> Decided {
    let Some(events) = exact::events(before, after, ties) else {
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

/// The middle between two points on the edges, at a time.
fn along(before: &Edges, after: &Edges, time: f64, at: [f64; 2]) -> Point {
    let mix = |a: f64, b: f64, t: f64| (1.0 - t) * a + t * b;
    [0, 1, 2].map(|x| {
        let [p, q] = [0, 1].map(|side| {
            let [start, end] = [0, 1].map(|k| mix(before[side][k][x], after[side][k][x], time));
            mix(start, end, at[side])
        });
        // Not half their sum: that may overflow.
        0.5 * p + 0.5 * q
    })
}

/// Where along the edges they are nearest to each other at a time: in floating point, for display.
fn nearest(before: &Edges, after: &Edges, time: f64) -> [f64; 2] {
    let mix = |a: f64, b: f64| (1.0 - time) * a + time * b;
    let [[a, b], [c, d]] = [0, 1]
        .map(|side| [0, 1].map(|k| [0, 1, 2].map(|x| mix(before[side][k][x], after[side][k][x]))));
    let sub = |a: Point, b: Point| [0, 1, 2].map(|x| 0.5 * a[x] - 0.5 * b[x]);
    let [p, q, r] = [sub(b, a), sub(d, c), sub(c, a)];
    // To a size at which squares neither overflow nor underflow.
    let size = [p, q, r]
        .as_flattened()
        .iter()
        .fold(0.0, |m: f64, x| m.max(x.abs()));
    let [p, q, r] = [p, q, r].map(|v| v.map(|x| if size > 0.0 { x / size } else { 0.0 }));
    let dot = |a: Point, b: Point| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (pp, pq, qq, pr, qr) = (dot(p, p), dot(p, q), dot(q, q), dot(p, r), dot(q, r));
    let part = |x: f64, whole: f64| {
        if whole > 0.0 {
            (x / whole).clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    // The ends of either edge with what is next to them on the other, and the inside.
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
        let gap = [0, 1, 2].map(|x| r[x] + u * q[x] - s * p[x]);
        dot(gap, gap)
    };
    places
        .into_iter()
        .min_by(|&a, &b| distance(a).total_cmp(&distance(b)))
        .unwrap_or([0.0; 2])
}
