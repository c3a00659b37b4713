//! Passages in floating point, with proven bounds.

use super::Edges;

/// Whether one edge stays on one side of the other along a coordinate axis, from frame to frame.
///
/// If all ends of one are left of all ends of the other in both frames, they are at all times between: every
/// difference of coordinates is linear in time.
#[inline]
pub(super) fn apart(before: &Edges, after: &Edges) -> bool {
    let less = |a: f64, b: f64| if a < b { a } else { b };
    let more = |a: f64, b: f64| if a > b { a } else { b };
    (0..3).any(|x| {
        let side = |edges: &Edges| {
            let [[a, b], [c, d]] = edges.map(|edge| edge.map(|p| p[x]));
            (more(a, b) < less(c, d), less(a, b) > more(c, d))
        };
        let (s, t) = (side(before), side(after));
        (s.0 & t.0) | (s.1 & t.1)
    })
}
