//! Cancellation of passages of one pair of curves. Two passages with opposite signs at the same
//! time and place are one tie, counted twice, and are removed. Two opposite passages at different
//! times or places are unresolved if both moved further than the limit, because the frames are too
//! far apart.

use crate::curve::vector::{half_difference, hypot, mix};
use crate::curve::{Curve, Point};
use crate::exact::Edges;
use crate::verdict::PullThrough;

/// A passage, and its position along both curves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LocatedPassage {
    pub event: PullThrough,
    /// Position along each curve, in segments from its start.
    pub along: [f64; 2],
    /// True if the edges touch without a clear passage, so that only the infinitesimally translated
    /// edges pass through one another.
    pub tie: bool,
}

/// Times that differ by less than this may be equal: the error of each is at most half of it.
const TIME: f64 = 2e-9;

/// Positions along a curve that differ by less than this, in segments, may be equal.
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

/// Returns the indices of passages that moved further than the limit and cancel in pairs of
/// opposite signs. If one sign has more of them than the other, prefers those that moved furthest.
pub(super) fn far_and_cancelling(passages: &[PullThrough], limit: f64) -> Vec<usize> {
    let event = |k: usize| &passages[k];
    let [forward, backward] = [1, -1].map(|sign| {
        let far = |k: &usize| event(*k).sign == sign && event(*k).lengths > limit;
        let mut far: Vec<usize> = (0..passages.len()).filter(far).collect();
        far.sort_by(|&a, &b| event(b).lengths.total_cmp(&event(a).lengths));
        far
    });
    let pairs = forward.into_iter().zip(backward);
    pairs.flat_map(|(a, b)| [a, b]).collect()
}

/// Returns how far a point of one piece moves relative to a point of the other piece in a step, in
/// lengths of the longest of their segments. `segments` has these segments in both frames, as
/// polylines.
pub(super) fn motion_in_lengths<'a>(
    frames: [&Edges; 2],
    at: [f64; 2],
    segments: impl Iterator<Item = &'a [Point]>,
) -> f64 {
    let between = |edges: &Edges| {
        let [p, q] = [0, 1].map(|side| mix(edges[side][0], edges[side][1], at[side]));
        half_difference(q, p)
    };
    let motion = half_difference(between(frames[1]), between(frames[0])).map(|x| 2.0 * x);
    let half_length = |points: &[Point]| -> f64 {
        let chords = points.array_windows();
        chords.map(|&[p, q]| hypot(half_difference(q, p))).sum()
    };
    hypot(motion) / segments.map(half_length).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_are_in_lengths_of_the_longer_segment_for_any_split() {
        let first = |y: f64| [[-1.0, y, 0.0], [1.0, y, 0.0]];
        let second = [[0.0, 0.0, -2.0], [0.0, 0.0, 2.0]];
        let whole = [-3.0, 3.0].map(|y| [first(y), second]);
        // The second half of the second segment, and coordinates whose squares overflow.
        let half = whole.map(|[first, second]| [first, [[0.0; 3], second[1]]]);
        let edges = whole.as_flattened().iter().map(|edge| &edge[..]);
        let lengths = motion_in_lengths([&whole[0], &whole[1]], [0.5; 2], edges);
        assert_eq!(lengths, 1.5);
        for (pieces, at) in [(whole, [0.5; 2]), (half, [0.5, 0.0])] {
            for scale in [1.0, 1e200, 1e-200] {
                let scaled = |edges: Edges| edges.map(|edge| edge.map(|p| p.map(|x| x * scale)));
                let ([before, after], segments) = (pieces.map(scaled), whole.map(scaled));
                let segments = segments.as_flattened().iter().map(|edge| &edge[..]);
                let lengths = motion_in_lengths([&before, &after], at, segments);
                assert!((lengths - 1.5).abs() < 1e-14, "{lengths}");
            }
        }
    }
}
