//! Pull-throughs that the frames are too far apart to resolve: those that cancel and moved further
//! than the limit.

use super::cancellation::LocatedPassage;
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

/// Returns the relative motion of points of two pieces in a step, in lengths of the longer of the
/// segments that contain them. `shares` are the lengths of the pieces relative to their segments.
pub(super) fn relative_motion(frames: [&Edges; 2], at: [f64; 2], shares: [f64; 2]) -> f64 {
    let between = |edges: &Edges| {
        let [p, q] = [0, 1].map(|side| mix(edges[side][0], edges[side][1], at[side]));
        half_difference(q, p)
    };
    let motion = half_difference(between(frames[1]), between(frames[0])).map(|x| 2.0 * x);
    let length = |side: usize, edges: &Edges| {
        let [a, b] = edges[side];
        hypot(half_difference(b, a)) / shares[side]
    };
    let lengths = frames.map(|edges| [0, 1].map(|side| length(side, edges)));
    hypot(motion) / lengths.as_flattened().iter().copied().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Point;

    #[test]
    fn motions_are_in_lengths_of_the_longer_segment_for_any_split() {
        let first = |y: f64| [[-1.0, y, 0.0], [1.0, y, 0.0]];
        let second = [[0.0, 0.0, -2.0], [0.0, 0.0, 2.0]];
        let [before, after] = [-3.0, 3.0].map(|y| [first(y), second]);
        assert_eq!(relative_motion([&before, &after], [0.5; 2], [1.0; 2]), 1.5);
        // The second half of the second segment, and coordinates whose squares overflow.
        for scale in [1.0, 1e200, 1e-200] {
            let scaled = |p: Point| p.map(|x| x * scale);
            let [before, after] = [before, after].map(|mut edges| {
                edges[1][0] = [0.0; 3];
                edges.map(|edge| edge.map(scaled))
            });
            let lengths = relative_motion([&before, &after], [0.5, 0.0], [1.0, 0.5]);
            assert!((lengths - 1.5).abs() < 1e-14, "{lengths}");
        }
    }
}
