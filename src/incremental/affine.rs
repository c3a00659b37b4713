//! The affine frame of a motion: rigid motion, rotation and stretch of the whole scene break nothing.

use crate::curve::{CurveSet, Point};
use nalgebra::{Matrix3, Vector3};

/// Points that the frame is fitted to: enough to follow the scene, few enough to cost nothing.
const SAMPLES: usize = 1024;

/// The map `q -> M q + t` from a reference frame to a later one. Its determinant is positive, so it is isotopic to
/// the identity and changes no linking number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Affine {
    pub m: Matrix3<f64>,
    pub t: Vector3<f64>,
    pub inverse: Matrix3<f64>,
    /// Least singular value of `M`, a lower bound: `|M d| >= sigma |d|`.
    pub sigma: f64,
}

impl Affine {
    /// The map that takes `from` to `to` best, in the least squares of a sample of closed curves' points; or none,
    /// where it would flatten or mirror the scene.
    ///
    /// Where the points lie in a plane or on a line, `M` is the identity across it. The result is any map: what
    /// is concluded from it holds for every one, only less may be concluded from a bad one.
    pub fn fit(from: &CurveSet, to: &CurveSet) -> Option<Affine> {
        let vector = |p: Point| Vector3::from(p);
        let step = (from.points() / SAMPLES).max(1);
        let mut samples = Vec::with_capacity(2 * SAMPLES);
        let mut skip = 0;
        for (i, c) in from.curves().iter().enumerate() {
            let n = c.points as usize;
            let mut k = skip;
            while k < n {
                if c.closed {
                    samples.push((vector(from.point(i, k)), vector(to.point(i, k))));
                }
                k += step;
            }
            skip = k - n;
        }
        let share = 1.0 / samples.len() as f64;
        let (mut from_mean, mut to_mean) = (Vector3::zeros(), Vector3::zeros());
        for (q, p) in &samples {
            from_mean += q * share;
            to_mean += p * share;
        }
        let (mut spread, mut moved) = (Matrix3::zeros(), Matrix3::zeros());
        for (q, p) in &samples {
            let (q, p) = (q - from_mean, p - to_mean);
            spread += q * q.transpose() * share;
            // What differs from the identity, so that a scene that stands still gives it exactly.
            moved += (p - q) * q.transpose() * share;
        }
        let floor = 1e-9 * spread.trace();
        let shape = spread + Matrix3::identity() * floor;
        let m = Matrix3::identity() + moved * shape.try_inverse()?;
        Affine::new(m, to_mean - m * from_mean)
    }

    /// The map, where it is one to work with.
    pub fn new(m: Matrix3<f64>, t: Vector3<f64>) -> Option<Affine> {
        let inverse = m.try_inverse()?;
        let singular = m.svd(false, false).singular_values;
        let (least, most) = (singular.min(), singular.max());
        let usable = m.determinant() > 0.0 && least > 0.1 && most < 10.0;
        let finite = t.iter().chain(inverse.iter()).all(|x| x.is_finite());
        (usable && finite).then_some(Affine {
            m,
            t,
            inverse,
            sigma: least * (1.0 - 1e-9),
        })
    }

    /// The point of the reference frame that is mapped to `p`.
    pub fn back(&self, p: Point) -> Point {
        (self.inverse * (Vector3::from(p) - self.t)).into()
    }
}
