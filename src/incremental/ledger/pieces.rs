//! Polylines that replace splines from one frame to the next: their vertices, and the splits that
//! keep them link homotopic to the splines.

use super::pair::Task;
use crate::curve::vector::{add, add_scaled, dot, sub};
use crate::curve::{Point, bounds, point_at};
use crate::discretize::{Halving, Separation, Sieve, Splits, sort_splits};

/// Minimum number of pieces of a spline segment.
pub(super) const PIECES: u32 = 4;

/// Maximum number of halvings of segments that may meet between the frames. A chord of their pieces
/// deviates from the curve by a millionth of what the chord of the segment does.
pub(super) const ROUNDS: u32 = 10;

/// A vertex of a polyline that replaces a spline.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vertex {
    /// Parameter in the segment.
    pub at: f64,
    /// Position in both frames.
    pub points: [Point; 2],
}

/// Sieve for polylines whose vertices move from one frame to the next. Two parts are apart if a
/// plane separates them on the same side in both frames, and so at all times in between: along a
/// coordinate, which is also the first test for two pieces, or across their relative motion.
pub(super) struct MovingBoxes {
    /// [`Separation::margin`](crate::discretize::Separation)
    pub margin: f64,
}

/// Box in each frame: smallest and largest coordinates.
type MovingBox = [[Point; 2]; 2];

impl Sieve<Vertex> for MovingBoxes {
    type Bounds = MovingBox;

    fn bounds(&self, vertices: &[Vertex]) -> MovingBox {
        [0, 1].map(|frame| bounds(vertices.iter().map(|v| v.points[frame])))
    }

    fn apart(&self, first: &MovingBox, second: &MovingBox) -> bool {
        Self::are_beside(first, second) || self.pass_by(first, second)
    }
}

impl MovingBoxes {
    /// Returns true if two moving boxes are apart along a coordinate.
    pub fn are_beside(first: &MovingBox, second: &MovingBox) -> bool {
        let below =
            |a: &MovingBox, b: &MovingBox, x: usize| (0..2).all(|f| a[f][1][x] < b[f][0][x]);
        (0..3).any(|x| below(first, second, x) || below(second, first, x))
    }

    /// Returns true if two moving boxes are apart along the vector between their centres, made
    /// orthogonal to their relative motion.
    ///
    /// Lengths are doubled, and errors are below 90 units in the last place of the largest
    /// coordinate; four margins are at least 256. Comparisons with NaN are false.
    fn pass_by(&self, first: &MovingBox, second: &MovingBox) -> bool {
        let between = [0, 1].map(|f| {
            let center = |[lo, hi]: [Point; 2]| add(lo, hi);
            sub(center(second[f]), center(first[f]))
        });
        let motion = sub(between[1], between[0]);
        let sum = add(between[0], between[1]);
        let length_sq = dot(motion, motion).max(f64::MIN_POSITIVE);
        let normal = add_scaled(sum, -dot(sum, motion) / length_sq, motion);
        let sizes = |f: usize| {
            let size = |[lo, hi]: [Point; 2]| sub(hi, lo);
            let sizes = add(size(first[f]), size(second[f]));
            dot(sizes.map(|x| x + 4.0 * self.margin), normal.map(f64::abs)) + 1e-300
        };
        let gaps = [0, 1].map(|f| (dot(between[f], normal), sizes(f)));
        gaps.iter().all(|(d, size)| d > size) || gaps.iter().all(|(d, size)| -d > *size)
    }
}

/// Splits of the segments of both curves, in addition to the even split of all segments.
#[derive(Debug, Default)]
pub(super) struct Cuts {
    /// Segment and parameter, sorted.
    at: [Vec<(u32, f64)>; 2],
    close: Vec<(u32, u32)>,
    halving: Halving,
}

impl Cuts {
    /// Computes the splits of segments that are too near in one of the frames, and those of
    /// segments that may meet between the frames, which are halved up to `rounds` times. Returns
    /// true if these halvings suffice ([`MovingSeparation::refine`]). Fails with two segments that
    /// are too close in a frame to be split.
    pub fn fill(
        &mut self,
        task: &Task<'_>,
        near: &[(u32, u32)],
        rounds: u32,
    ) -> Result<bool, [u32; 2]> {
        let Cuts { at, close, halving } = self;
        at.iter_mut().for_each(Vec::clear);
        let mut add = |splits: &[Splits; 2]| {
            for (side, splits) in splits.iter().enumerate() {
                at[if task.is_self() { 0 } else { side }].extend_from_slice(&splits.at);
            }
        };
        for set in task.step.frames {
            let separation = Separation::new([set], task.curves);
            close.clear();
            separation.add_close(near, close);
            // Adjacent segments are joined, so no split separates them.
            close.retain(|&(s, t)| !task.adjacent(s, t));
            if close.is_empty() {
                continue;
            }
            separation.refine(close, halving)?;
            add(&halving.splits);
        }
        let fine = task.separation.refine(near, task.parts, rounds, halving);
        add(&halving.splits);
        at.iter_mut().for_each(sort_splits);
        Ok(fine)
    }

    /// Replaces `out` by the vertices of the polyline of a segment of one of the curves, including
    /// its ends.
    pub fn vertices(&self, task: &Task<'_>, side: usize, s: u32, out: &mut Vec<Vertex>) {
        let at = &self.at[if task.is_self() { 0 } else { side }];
        let start = at.partition_point(|c| c.0 < s);
        let splits = at[start..].iter().take_while(|c| c.0 == s).map(|c| c.1);
        out.clear();
        let (i, frames) = (task.curves[side], task.step.frames);
        let vertex = |at: f64, points: [Point; 2]| Vertex { at, points };
        let knot = |s: u32| frames.map(|set| set.knot(i, s as usize));
        out.push(vertex(0.0, knot(s)));
        let segments = frames.map(|set| set.segment(i, s as usize));
        let even = (1..PIECES).map(|k| f64::from(k) / f64::from(PIECES));
        let inner = even.chain(splits);
        out.extend(inner.map(|at| vertex(at, segments.map(|b| point_at(&b, at)))));
        out[1..].sort_unstable_by(|a, b| a.at.total_cmp(&b.at));
        out.dedup_by_key(|v| v.at);
        out.push(vertex(1.0, knot(s + 1)));
    }
}
