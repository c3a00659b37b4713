//! Affine map from a reference frame to a later frame. A rigid motion, rotation or stretch of the
//! whole scene changes no linking number, so the map removes it before points are compared.

use crate::curve::{Cell, CurveSet, Positions};
use nalgebra::{Matrix3, Vector3};

/// Number of points to which the affine map is fitted: enough to follow the scene at a negligible
/// cost.
const SAMPLES: usize = 1024;

/// Relative amount by which displacements may exceed the allowances without a contact of curves.
/// Two allowances add up to at most twice 0.49 of a gap. With this excess, they add up to less than
/// twice 0.4974 of it, which leaves a margin for rounding.
const FREE: f64 = 0.015;

/// Number of consecutive points that are sampled together, because they share cache lines.
const TOGETHER: usize = 8;

/// The map `q -> M q + t` from a reference frame to a later frame. Its determinant is positive, so
/// it is isotopic to the identity and changes no linking number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Affine {
    pub m: Matrix3<f64>,
    pub t: Vector3<f64>,
    pub inverse: Matrix3<f64>,
    /// Lower bound of the smallest singular value of `M`: `|M d| >= sigma |d|`.
    pub sigma: f64,
}

impl Affine {
    /// Returns the least-squares map from a sample of the reference frame to its positions in a
    /// later frame. Returns `None` if the map would flatten or mirror the scene.
    ///
    /// The positions may be unchecked, and another process may change them during the call:
    /// conclusions from the map are valid for every map, and a poor fit only proves less.
    ///
    /// If the points lie in a plane or on a line, `M` is the identity across it.
    pub fn fit(sample: &Sample, to: Positions<'_>) -> Option<Affine> {
        let share = 1.0 / sample.points.len() as f64;
        let mut mean = Vector3::zeros();
        let mut moved = Matrix3::zeros();
        // Sums of the differences from the identity, so that a scene at rest gives exactly the
        // identity.
        for (point, q) in &sample.points {
            let d = Vector3::from(to.point(*point)) - q;
            mean += d * share;
            moved += d * (q - sample.mean).transpose() * share;
        }
        let m = Matrix3::identity() + moved * sample.shape;
        Affine::new(m, sample.mean + mean - m * sample.mean)
    }

    /// Returns the least-squares map of a periodic scene. It maps the lattice vectors of the cell
    /// of the reference frame (`cells[0]`) to those of the cell of the later frame, so that it maps
    /// the images of a curve like the curve itself. Along axes that are not periodic, it is the map
    /// of [`Affine::fit`].
    pub fn fit_in_cell(sample: &Sample, to: Positions<'_>, cells: [&Cell; 2]) -> Option<Affine> {
        let free = Affine::fit(sample, to)?;
        let [from, now] = cells.map(|cell| cell.vectors.map(Vector3::from));
        let inverse = cells[0].inverse()?.map(Vector3::from);
        let mut m = free.m;
        for x in (0..3).filter(|&x| cells[0].periodic()[x]) {
            m += (now[x] - free.m * from[x]) * inverse[x].transpose();
        }
        let mean = free.m * sample.mean + free.t;
        Affine::new(m, mean - m * sample.mean)
    }

    /// Returns a bound of the curvature of paths in the space of the reference frame. Points move
    /// on straight lines at constant speed between two frames, but each frame has its own map, so
    /// the mapped paths are curved. The bound is the deviation from a straight line, as a share of
    /// the length of the path. Returns `None` if the maps of the two frames are too different.
    ///
    /// # Derivation
    ///
    /// 1. With a map and a deviation `r`, `|r| <= sigma a`, at each end, a point is at
    ///    `M q + T + r` at any time in between, with all terms interpolated linearly. Mapped back
    ///    it is within `|r| / s` of `q`, where `s` is the smallest singular value of the
    ///    interpolated `M`. That may exceed `a` only by the share of the gaps that allowances leave
    ///    free; else the result is `None`.
    /// 2. A point at `y0` and `y1` is at `y0 + A (y1 - y0)` with `A = k M^-1 M1` at time `k`. With
    ///    `D = 1 - M1^-1 M0`, `A` differs from `k` by at most `|D| / (4 (1 - |D|))`, which is the
    ///    result.
    pub fn bend([from, to]: [&Affine; 2]) -> Option<f64> {
        /// Number of parts of the step, each of which is bounded separately.
        const PARTS: usize = 8;
        let step = to.m - from.m;
        let d = (to.inverse * step).norm();
        if d > 0.25 {
            return None;
        }
        let bend = d / (4.0 * (1.0 - d));
        let most = from.sigma.max(to.sigma);
        // All singular values differ from those of the first map by at most the norm of the step.
        if most <= (from.sigma - step.norm()) * (1.0 + FREE) {
            return Some(bend);
        }
        let half = 0.5 / PARTS as f64;
        for k in 0..PARTS {
            let at = (2 * k + 1) as f64 * half;
            let m = from.m + step * at;
            // For `|u| <= half`, `M (1 + u E)` shrinks vectors by at most the factor of `M` times
            // that of the symmetric part of E.
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

    /// Returns the map if it is well conditioned and preserves the orientation.
    pub fn new(m: Matrix3<f64>, t: Vector3<f64>) -> Option<Affine> {
        // The inverse and the singular values of infinite or NaN entries may not terminate.
        if !m.iter().chain(t.iter()).all(|x| x.is_finite()) {
            return None;
        }
        let inverse = m.try_inverse()?;
        let singular = m.svd(false, false).singular_values;
        let (least, most) = (singular.min(), singular.max());
        let usable = m.determinant() > 0.0 && least > 0.1 && most < 10.0;
        usable.then_some(Affine {
            m,
            t,
            inverse,
            sigma: least * (1.0 - 1e-9),
        })
    }

    /// Returns the largest absolute row sum of `M`, an upper bound of the factor by which `M`
    /// enlarges the largest coordinate of a point.
    pub fn largest_row(&self) -> f64 {
        let sums = self.m.row_iter().map(|row| row.abs().sum());
        sums.fold(0.0, f64::max)
    }
}

/// A sample of control points of a reference frame, and precomputed values for a fit.
#[derive(Debug)]
pub(super) struct Sample {
    /// Number, counted over all curves, and position of each point.
    points: Vec<(usize, Vector3<f64>)>,
    mean: Vector3<f64>,
    /// Inverse of the covariance of the points.
    shape: Matrix3<f64>,
}

impl Sample {
    /// Returns evenly spread points of closed curves, and of open curves if `open` is set.
    pub fn new(set: &CurveSet, open: bool) -> Sample {
        let step = (set.points() / SAMPLES).max(1);
        let positions = set.positions();
        let curves = (0..set.len()).filter(|&i| open || set.curve(i).closed);
        let points = curves.flat_map(|i| set.points_of(i)).enumerate();
        let points = points.filter(|(k, _)| (k / TOGETHER).is_multiple_of(step));
        let points = points.map(|(_, k)| (k, Vector3::from(positions.point(k))));
        let points: Vec<_> = points.collect();
        let share = 1.0 / points.len().max(1) as f64;
        let mean: Vector3<f64> = points.iter().map(|(_, q)| q * share).sum();
        let square = |(_, q): &(usize, Vector3<f64>)| (q - mean) * (q - mean).transpose() * share;
        let spread: Matrix3<f64> = points.iter().map(square).sum();
        // Regularization: across a plane or a line there is nothing to fit.
        let floor = Matrix3::identity() * (1e-9 * spread.trace() + f64::MIN_POSITIVE);
        let shape = (spread + floor).try_inverse();
        Sample {
            points,
            mean,
            shape: shape.unwrap_or_else(Matrix3::zeros),
        }
    }
}
