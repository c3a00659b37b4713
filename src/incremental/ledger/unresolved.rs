//! Pull-throughs that the frames are too far apart to resolve: those that cancel and moved further
//! than the limit.

use super::cancellation::LocatedPassage;
use crate::curve::Point;
use crate::curve::vector::{half_difference, hypot, mix};
use crate::exact::Edges;

/// Returns the indices of passages that cancel in pairs and moved further than the limit. Prefers
/// those that moved furthest.
pub(super) fn far_and_cancelling(passages: &[LocatedPassage], limit: f64) -> Vec<usize> {
    let event = |k: usize| &passages[k].event;
    let [forward, backward] = [1, -1].map(|sign| {
        let far = |k: &usize| event(*k).sign == sign && event(*k).lengths > limit;
        let mut far: Vec<usize> = (0..passages.len()).filter(far).collect();
        far.sort_by(|&a, &b| event(b).lengths.total_cmp(&event(a).lengths));
        far
    });
    let pairs = forward.into_iter().zip(backward);
    pairs.flat_map(|(a, b)| [a, b]).collect()
}

/// Returns the relative motion of points of two pieces in a step, in lengths of the longest of
/// their segments in both frames, given as polylines.
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
