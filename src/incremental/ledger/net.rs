//! Passages that are none: opposite signs at the same time and place.

use super::PullThrough;
use crate::curve::Curve;

/// A passage, and where it is along both curves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    pub event: PullThrough,
    /// Segments from the start of the curve.
    pub along: [f64; 2],
    /// True if only the translated edges are known to pass through one another.
    pub tie: bool,
}

/// Times closer than this may be the same: each is proven to half of it.
const TIME: f64 = 2e-9;

/// Places closer than this, in segments, may be the same.
const PLACE: f64 = 1e-6;

/// Takes out pairs of opposite passages of one pair of curves that are at the same time and place; puts the rest in
/// order of place.
pub(super) fn cancel(found: &mut Vec<Found>, curves: [Curve; 2]) {
    if found.len() < 2 {
        return;
    }
    // The start of a closed curve is its end.
    let around = |[p, q]: [f64; 2]| {
        let turn = |x: f64, c: Curve| {
            let n = f64::from(c.segments);
            if c.closed && x > n - PLACE { x - n } else { x }
        };
        [turn(p, curves[0]), turn(q, curves[1])]
    };
    found.iter_mut().for_each(|f| f.along = around(f.along));
    found.sort_by(|a, b| {
        let [p, q] = [a, b].map(|f| f.along);
        p[0].total_cmp(&q[0])
            .then(p[1].total_cmp(&q[1]))
            .then(a.event.fraction.total_cmp(&b.event.fraction))
            .then(a.event.segments.cmp(&b.event.segments))
            .then(a.event.sign.cmp(&b.event.sign))
    });
    let mut gone = vec![false; found.len()];
    for k in 1..found.len() {
        let now = found[k];
        let same = |before: &Found| {
            before.event.sign == -now.event.sign
                && (before.event.fraction - now.event.fraction).abs() <= TIME
                && (before.along[1] - now.along[1]).abs() <= PLACE
        };
        let near = |before: &Found| now.along[0] - before.along[0] <= PLACE;
        let opposite = (0..k)
            .rev()
            .take_while(|&m| near(&found[m]))
            .find(|&m| !gone[m] && same(&found[m]));
        if let Some(m) = opposite {
            (gone[m], gone[k]) = (true, true);
        }
    }
    let mut gone = gone.into_iter();
    found.retain(|_| gone.next() == Some(false));
}
