//! Draws closed curves point by point, with little memory in addition to the set; points on tori.

use crate::curve::{Basis, CurveSet, CurveSetBuilder, Point, Positions, Precision};
use crate::error::Result;

/// Number of points computed before they are stored.
const CHUNK: usize = 4096;

/// Draws closed curves in single precision.
pub(super) struct Pen {
    builder: CurveSetBuilder,
    chunk: Vec<f32>,
}

impl Pen {
    /// Creates a pen for this number of points of all curves.
    pub fn new(basis: Basis, points: usize) -> Pen {
        Pen {
            builder: CurveSet::builder(basis, Precision::F32, points),
            chunk: Vec::with_capacity(3 * CHUNK.min(points)),
        }
    }

    /// Draws a closed curve of `n` points.
    pub fn closed(&mut self, n: usize, mut point: impl FnMut(usize) -> Point) -> Result<()> {
        self.builder.start_curve(n, true)?;
        for first in (0..n).step_by(CHUNK) {
            let points = (first..n.min(first + CHUNK)).map(&mut point);
            self.chunk.clear();
            self.chunk.extend(points.flatten().map(|x| x as f32));
            self.builder.push(Positions::F32(&self.chunk))?;
        }
        Ok(())
    }

    /// Returns the finished set.
    pub fn finish(self) -> Result<CurveSet> {
        self.builder.finish()
    }
}

/// Draws closed polylines with `segments` segments in all, which are distributed evenly. `point`
/// returns point `k` of the `n` points of curve `i`.
pub(super) fn polylines(
    curves: usize,
    segments: usize,
    point: impl Fn(usize, usize, usize) -> Point,
) -> Result<CurveSet> {
    let mut pen = Pen::new(Basis::Polyline, segments);
    for i in 0..curves {
        let n = segments / curves + usize::from(i < segments % curves);
        pen.closed(n, |k| point(i, k, n))?;
    }
    pen.finish()
}

/// Returns the point on the torus of this tube radius around the unit circle of the xy plane, at a
/// toroidal angle (along the circle) and a poloidal one (around it), in radians.
///
/// The linking number of a curve inside of a torus and one outside is the product of two numbers:
/// the toroidal turns of the inner one, which is homologous to that multiple of the core, and the
/// poloidal turns of the outer one. The direction of the poloidal angle makes two positive numbers
/// count +1.
pub(super) fn on_torus(tube: f64, toroidal: f64, poloidal: f64) -> Point {
    let ((s, c), (sp, cp)) = (toroidal.sin_cos(), poloidal.sin_cos());
    let r = 1.0 + tube * cp;
    [r * c, r * s, -tube * sp]
}
