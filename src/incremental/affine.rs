//! The affine frame of a motion: rigid motion, rotation and stretch of the whole scene break nothing.

use crate::curve::{CurveSet, Point};
use nalgebra::{Matrix3, Vector3};

/// Points that the frame is fitted to: enough to follow the scene, few enough to cost nothing.
const SAMPLES: usize = 1024;

/// By how much points may deviate further than by their allowances and still keep apart what these keep apart: those
/// use a share of 0.49 of each gap, and two times 0.4974 is less than all of it, with room for rounding.
const FREE: f64 = 0.015;

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

    /// The map that leaves everything where it is.
    pub fn identity() -> Affine {
        Affine {
            m: Matrix3::identity(),
            t: Vector3::zeros(),
            inverse: Matrix3::identity(),
            sigma: 1.0,
        }
    }

    /// What becomes of points that move on straight lines, at constant speed, from where one map has them to where
    /// another one does, as seen in the space of the reference frame; or none, where the maps are too far apart.
    ///
    /// With a map and a deviation `r` at each end, `|r| <= sigma a`, a point is at `M q + T + r` at any time between,
    /// all of them interpolated linearly. Mapped back it is within `|r| / s` of `q`, with `s` the least singular value
    /// of the interpolated `M`: no further than `a` by more than the share of the gaps that allowances leave free, or
    /// there is no result. A point at `y0` and `y1` is at `y0 + A (y1 - y0)` with `A = k M^-1 M1` at time `k`, and with
    /// `D = 1 - M1^-1 M0` that is within `|D| / (4 (1 - |D|))` of `k`. The result is a bound of that: how far such a
    /// point may be from the straight line, as a share of its way.
    pub fn bend([from, to]: [&Affine; 2]) -> Option<f64> {
        /// Of a whole, the part of the time that is looked at at once.
        const PARTS: usize = 8;
        let step = to.m - from.m;
        let d = (to.inverse * step).norm();
        if d > 0.25 {
            return None;
        }
        let bend = d / (4.0 * (1.0 - d));
        let most = from.sigma.max(to.sigma);
        // No singular value of any of them differs from the first one's by more than the step's norm.
        if most <= (from.sigma - step.norm()) * (1.0 + FREE) {
            return Some(bend);
        }
        let half = 0.5 / PARTS as f64;
        for k in 0..PARTS {
            let at = (2 * k + 1) as f64 * half;
            let m = from.m + step * at;
            // `M (1 + u E)`, for `|u| <= half`, shrinks nothing by more than `M`, and what the symmetric part of E does.
            let e = m.try_inverse()? * step;
            let shrinks = (e + e.transpose()).symmetric_eigenvalues().amax() * half;
            let least = m.svd(false, false).singular_values.min();
            let sigma = |at: f64| from.sigma + at * (to.sigma - from.sigma);
            let most = sigma(at - half).max(sigma(at + half));
            if shrinks > 0.5 || most > least * (1.0 - shrinks).sqrt() * (1.0 + FREE) {
                return None;
            }
        }
        Some(bend)
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
    /// Points of closed curves, and of open ones where asked for, evenly spread over them.
    pub fn new(set: &CurveSet, open: bool) -> Sample {
        let step = (set.points() / SAMPLES).max(1);
        let slots = (0..set.len())
            .filter(|&i| open || set.curve(i).closed)
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
