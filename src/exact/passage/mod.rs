//! Do two edges that move pass through each other, when, and with what sign?

#![cfg_attr(
    not(test),
    expect(dead_code, reason = "used by the ledger, which comes with it")
)]

mod exact;
mod filter;
mod polynomial;
mod ring;
#[cfg(test)]
mod tests;

use crate::curve::Point;

/// The ends of an edge of the first curve and of one of the second.
pub(crate) type Edges = [[Point; 2]; 2];

/// One edge passes through another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Passage {
    /// When, as a fraction of the step.
    pub time: f64,
    /// What it adds to the linking number of the two curves: 1 or -1.
    pub sign: i32,
    /// Where along either edge, 0 at its start and 1 at its end.
    pub at: [f64; 2],
    /// Where in space.
    pub point: Point,
}

/// What to do where a passage is not one of inner points of both edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ties {
    /// Translate the first curve by next to nothing: for two curves.
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

/// Calls `out` with every passage of a pair of edges, in their order in time.
pub(crate) fn passages(
    before: &Edges,
    after: &Edges,
    ties: Ties,
    out: &mut impl FnMut(Passage),
) -> Decided {
    if filter::apart(before, after) {
        return Decided::Apart;
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
        let passage = Passage {
            time: event.time,
            sign: event.sign.signum(),
            at,
            point: along(before, after, event.time, at),
        };
        (0..event.sign.abs()).for_each(|_| out(passage));
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
