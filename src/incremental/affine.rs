//! The affine frame of a motion: rigid motion, rotation and stretch of the whole scene break nothing.

use crate::curve::{CurveSet, Point};
use nalgebra::{Matrix3, Vector3};

/// Points that the frame is fitted to: enough to follow the scene, few enough to cost nothing.
const SAMPLES: usize = 1024;

/// Neighbours that are taken together: they share a line of the cache.
const TOGETHER: usize = 8;

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
    /// The map that takes a sample of the reference frame to where it is in the set `to` best, in the least squares;
    /// or none, where it would flatten or mirror the scene.
    ///
    /// Where the points lie in a plane or on a line, `M` is the identity across it. The result is any map: what
    /// is concluded from it holds for every one, only less may be concluded from a bad one.
    pub fn fit(sample: &Sample, to: &CurveSet) -> Option<Affine> {
        let share = 1.0 / sample.points.len() as f64;
        let mut mean = Vector3::zeros();
        let mut moved = Matrix3::zeros();
        // Sums of what differs from the identity, so that a scene that stands still gives it exactly.
        for (slot, q) in &sample.points {
            let d = Vector3::from(to.at(*slot)) - q;
            mean += d * share;
            moved += d * (q - sample.mean).transpose() * share;
        }
        let m = Matrix3::identity() + moved * sample.shape;
        Affine::new(m, sample.mean + mean - m * sample.mean)
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

    /// The largest sum of a row of `M`, without signs: `M` makes no coordinate larger by more than that.
    pub fn largest_row(&self) -> f64 {
        let rows = self.m.row_iter();
        rows.map(|r| r.iter().map(|m| m.abs()).sum())
            .fold(0.0, f64::max)
    }

    /// The point of the reference frame that is mapped to `p`.
    pub fn back(&self, p: Point) -> Point {
        (self.inverse * (Vector3::from(p) - self.t)).into()
    }
}

/// Some control points of a reference frame, and what a fit needs of them.
#[derive(Debug)]
pub(super) struct Sample {
    /// Slot, and position.
    points: Vec<(usize, Vector3<f64>)>,
    mean: Vector3<f64>,
    /// The inverse of the points' covariance.
    shape: Matrix3<f64>,
}

impl Sample {
    /// Points of closed curves, evenly spread over them.
    pub fn new(set: &CurveSet) -> Sample {
        let step = (set.points() / SAMPLES).max(1);
        let slots = (0..set.len())
            .filter(|&i| set.curve(i).closed)
            .flat_map(|i| set.body(i))
            .enumerate()
            .filter(|(k, _)| (k / TOGETHER).is_multiple_of(step));
        let points: Vec<_> = slots.map(|(_, k)| (k, Vector3::from(set.at(k)))).collect();
        let share = 1.0 / points.len().max(1) as f64;
        let mean: Vector3<f64> = points.iter().map(|(_, q)| q * share).sum();
        let spread: Matrix3<f64> = points
            .iter()
            .map(|(_, q)| (q - mean) * (q - mean).transpose() * share)
            .sum();
        // Across a plane or a line there is nothing to fit.
        let floor = Matrix3::identity() * (1e-9 * spread.trace() + f64::MIN_POSITIVE);
        let shape = (spread + floor)
            .try_inverse()
            .unwrap_or_else(Matrix3::zeros);
        Sample {
            points,
            mean,
            shape,
        }
    }
}
