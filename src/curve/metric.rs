//! Distances of points.

use super::vector::{dot, hypot, per_axis, sub};
use super::{Cell, Point, larger};

/// Distances in space, or of nearest images in a periodic cell.
pub(crate) struct Metric {
    /// Lattice vectors, and the reciprocal vectors: their products with a vector are its fractional
    /// coordinates.
    lattice: Option<([Point; 3], [Point; 3])>,
}

impl Metric {
    pub fn new(cell: Option<&Cell>) -> Metric {
        let lattice = cell.and_then(|cell| {
            let (inverse, periodic) = (cell.inverse()?, cell.periodic());
            let along = |k: usize| if periodic[k] { inverse[k] } else { [0.0; 3] };
            Some((cell.vectors, per_axis(along)))
        });
        Metric { lattice }
    }

    /// Returns the vector from `a` to `b`.
    #[inline(always)]
    pub fn difference(&self, a: Point, b: Point) -> Point {
        let mut d = sub(b, a);
        if let Some((vectors, inverse)) = &self.lattice {
            let shares = inverse.map(|b| dot(b, d).round());
            for (v, share) in vectors.iter().zip(shares) {
                d = per_axis(|x| d[x] - share * v[x]);
            }
        }
        d
    }

    /// Returns the square of the longest distance of consecutive knots, which are every `stride`
    /// points `x y z x y z ..`.
    pub fn longest_square<T: Copy + Into<f64>>(&self, points: &[T], stride: usize) -> f64 {
        let knots = points.as_chunks::<3>().0.chunks_exact(stride);
        let mut knots = knots.map(|knot| per_axis(|x| knot[0][x].into()));
        let (mut last, mut longest) = (knots.next().unwrap_or_default(), 0.0);
        for next in knots {
            let d = self.difference(last, next);
            (last, longest) = (next, larger(dot(d, d), longest));
        }
        longest
    }

    pub fn distance(&self, a: Point, b: Point) -> f64 {
        hypot(self.difference(a, b))
    }
}
