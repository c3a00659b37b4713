//! Polylines that replace splines from one frame to the next: their vertices, and the splits that
//! keep them link homotopic to the splines.

use super::task::Task;
use crate::curve::{Point, bounds, point_at};
use crate::discretize::{Halving, Separation, Sieve, sort_splits};

/// Minimum number of pieces of a spline segment.
pub(super) const PIECES: u32 = 4;

/// A vertex of a polyline that replaces a spline.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vertex {
    /// Parameter in the segment.
    pub at: f64,
    /// Position in both frames.
    pub points: [Point; 2],
}

/// Sieve for polylines whose vertices move from one frame to the next. Two parts are apart if a
/// coordinate separates them on the same side in both frames, and so at all times in between. The
/// same test comes first for two pieces.
pub(super) struct MovingBoxes;

impl Sieve<Vertex> for MovingBoxes {
    /// Box in each frame: smallest and largest coordinates.
    type Bounds = [[Point; 2]; 2];

    fn bounds(&self, vertices: &[Vertex]) -> Self::Bounds {
        [0, 1].map(|frame| bounds(vertices.iter().map(|v| v.points[frame])))
    }

    fn apart(&self, first: &Self::Bounds, second: &Self::Bounds) -> bool {
        let below = |a: &Self::Bounds, b: &Self::Bounds, x: usize| {
            (0..2).all(|frame| a[frame][1][x] < b[frame][0][x])
        };
        (0..3).any(|x| below(first, second, x) || below(second, first, x))
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
    /// Computes the splits for both frames, of all segments that are too near in them. Returns two
    /// segments if they are too close to split.
    pub fn fill(&mut self, task: &Task<'_>, near: &[(u32, u32)]) -> Result<(), [u32; 2]> {
        let Cuts { at, close, halving } = self;
        at.iter_mut().for_each(Vec::clear);
        for set in task.step.frames {
            let separation = Separation::new(set, task.curves);
            close.clear();
            separation.add_close(near, close);
            // Adjacent segments are joined, so no split separates them.
            close.retain(|&(s, t)| !task.adjacent(s, t));
            if close.is_empty() {
                continue;
            }
            separation.refine(close, halving)?;
            for (side, splits) in halving.splits.iter().enumerate() {
                at[if task.is_self() { 0 } else { side }].extend_from_slice(&splits.at);
            }
        }
        at.iter_mut().for_each(sort_splits);
        Ok(())
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
