//! Pairs of pieces of two polylines that may meet while their vertices move.
//!
//! Splines that run near each other are split into thousands of pieces, and each piece is near a few others. Testing
//! every piece with every other is quadratic in their number, so long polylines are halved: two parts that a coordinate
//! keeps apart in both frames, on the same side, are apart at all times between, and so are all their pieces. That is
//! what the first test of two pieces says too, hence nothing is lost. Near-linear in pieces for polylines that are
//! spatially coherent.

use crate::curve::Point;
use std::ops::ControlFlow;

/// Vertices of a part that is not halved any more: those of the even split of a segment.
const FEW: usize = 5;

/// A vertex of a polyline that stands for a spline.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vertex {
    /// Its parameter in the segment.
    pub at: f64,
    /// Where it is in both frames.
    pub points: [Point; 2],
}

/// Calls `test` for pairs of pieces, one of each polyline, until it breaks: for all but those that are apart.
pub(super) fn between<F>(p: &[Vertex], q: &[Vertex], test: &mut F) -> ControlFlow<()>
where
    F: FnMut(&[Vertex], &[Vertex]) -> ControlFlow<()>,
{
    if p.len() <= FEW && q.len() <= FEW {
        return every(p, q, test);
    }
    parts(&Part::of(p), &Part::of(q), test)
}

/// [`between`] of a polyline and itself: every pair of different pieces once.
pub(super) fn within<F>(p: &[Vertex], test: &mut F) -> ControlFlow<()>
where
    F: FnMut(&[Vertex], &[Vertex]) -> ControlFlow<()>,
{
    if p.len() <= FEW {
        for k in 1..p.len() - 1 {
            every(&p[k - 1..=k], &p[k..], test)?;
        }
        return ControlFlow::Continue(());
    }
    let [left, right] = halves(p);
    within(left, test)?;
    within(right, test)?;
    between(left, right, test)
}

/// All pairs of pieces.
fn every<F>(p: &[Vertex], q: &[Vertex], test: &mut F) -> ControlFlow<()>
where
    F: FnMut(&[Vertex], &[Vertex]) -> ControlFlow<()>,
{
    for a in p.windows(2) {
        for b in q.windows(2) {
            test(a, b)?;
        }
    }
    ControlFlow::Continue(())
}

/// Both halves of a polyline. They share a vertex.
fn halves(p: &[Vertex]) -> [&[Vertex]; 2] {
    let middle = p.len() / 2;
    [&p[..=middle], &p[middle..]]
}

/// Some pieces that follow one another, and their box in both frames.
struct Part<'a> {
    vertices: &'a [Vertex],
    bounds: [[Point; 2]; 2],
}

impl<'a> Part<'a> {
    fn of(vertices: &'a [Vertex]) -> Self {
        let bounds = [0, 1].map(|frame| {
            let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
            for vertex in vertices {
                for (x, v) in vertex.points[frame].into_iter().enumerate() {
                    lo[x] = if v < lo[x] { v } else { lo[x] };
                    hi[x] = if v > hi[x] { v } else { hi[x] };
                }
            }
            [lo, hi]
        });
        Part { vertices, bounds }
    }

    fn halves(&self) -> [Self; 2] {
        halves(self.vertices).map(Part::of)
    }

    /// Whether a coordinate keeps all pieces of one part on one side of those of the other at all times.
    fn apart(&self, other: &Self) -> bool {
        let below =
            |a: &Self, b: &Self, x: usize| (0..2).all(|f| a.bounds[f][1][x] < b.bounds[f][0][x]);
        (0..3).any(|x| below(self, other, x) || below(other, self, x))
    }
}

fn parts<F>(p: &Part<'_>, q: &Part<'_>, test: &mut F) -> ControlFlow<()>
where
    F: FnMut(&[Vertex], &[Vertex]) -> ControlFlow<()>,
{
    let [n, m] = [p, q].map(|part| part.vertices.len());
    if p.apart(q) {
        ControlFlow::Continue(())
    } else if n <= FEW && m <= FEW {
        every(p.vertices, q.vertices, test)
    } else if n >= m {
        let [left, right] = p.halves();
        parts(&left, q, test)?;
        parts(&right, q, test)
    } else {
        let [left, right] = q.halves();
        parts(p, &left, test)?;
        parts(p, &right, test)
    }
}
