//! Cancellation of passages with opposite signs at the same time and place.

use crate::curve::Curve;
use crate::verdict::PullThrough;

/// A passage, and its position along both curves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LocatedPassage {
    pub event: PullThrough,
    /// Position along each curve, in segments from its start.
    pub along: [f64; 2],
    /// True if only the translated edges are known to pass through one another.
    pub tie: bool,
}

/// Times closer than this may be equal: the error of each is at most half of it.
const TIME: f64 = 2e-9;

/// Places closer than this, in segments, may be equal.
const PLACE: f64 = 1e-6;

/// Removes pairs of opposite passages of one pair of curves at the same time and place. Sorts the
/// remaining passages by place.
pub(super) fn cancel(found: &mut Vec<LocatedPassage>, curves: [Curve; 2]) {
    if found.len() < 2 {
        return;
    }
    // The end of a closed curve is its start.
    let places = found.iter_mut();
    for (x, c) in places.flat_map(|f| f.along.iter_mut().zip(curves)) {
        let n = f64::from(c.segments);
        if c.closed && *x > n - PLACE {
            *x -= n;
        }
    }
    found.sort_by(|a, b| {
        let [p, q] = [a, b].map(|f| f.along);
        p[0].total_cmp(&q[0])
            .then(p[1].total_cmp(&q[1]))
            .then(a.event.fraction.total_cmp(&b.event.fraction))
            .then(a.event.segments.cmp(&b.event.segments))
            .then(a.event.sign.cmp(&b.event.sign))
    });
    let mut cancelled = vec![false; found.len()];
    for k in 1..found.len() {
        let current = found[k];
        let same = |other: &LocatedPassage| {
            other.event.sign == -current.event.sign
                && (other.event.fraction - current.event.fraction).abs() <= TIME
                && (other.along[1] - current.along[1]).abs() <= PLACE
        };
        let near = |other: &LocatedPassage| current.along[0] - other.along[0] <= PLACE;
        let mut others = (0..k).rev().take_while(|&m| near(&found[m]));
        if let Some(m) = others.find(|&m| !cancelled[m] && same(&found[m])) {
            (cancelled[m], cancelled[k]) = (true, true);
        }
    }
    let mut cancelled = cancelled.into_iter();
    found.retain(|_| cancelled.next() == Some(false));
}
