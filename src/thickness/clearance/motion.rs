//! Motion of a scene from one frame to the next: a rigid motion, and what remains.

use crate::curve::{Point, Positions, larger, smaller};
use nalgebra::{Matrix3, Vector3};

/// Number of points to which a rigid motion is fitted.
const SAMPLES: usize = 128;

/// A rigid motion `q -> q + (R - 1) (q - center) + shift`. It changes no distance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rigid {
    /// `R - 1`, for a rotation `R`.
    turn: Matrix3<f64>,
    center: Vector3<f64>,
    shift: Vector3<f64>,
    /// Upper bound of the norm of `R - 1`.
    pub spin: f64,
}

impl Rigid {
    /// Fits a motion to some of the points of two frames: the rotation is that of Kabsch (1976). A
    /// poor fit only makes points travel further.
    pub fn fit([before, after]: [Positions<'_>; 2]) -> Rigid {
        let count = before.len() / 3;
        let step = (count / SAMPLES).max(1);
        let points = || (0..count).step_by(step);
        let share = 1.0 / points().count().max(1) as f64;
        let mean = |positions: Positions<'_>| -> Vector3<f64> {
            let points = points().map(|k| Vector3::from(positions.point(k)) * share);
            points.sum()
        };
        let (center, to) = (mean(before), mean(after));
        let still = Rigid {
            turn: Matrix3::zeros(),
            center,
            shift: to - center,
            spin: 0.0,
        };
        let products = points().map(|k| {
            let q = Vector3::from(before.point(k)) - center;
            let p = Vector3::from(after.point(k)) - to;
            p * q.transpose() * share
        });
        let products: Matrix3<f64> = products.sum();
        // The decomposition need not end for other numbers.
        if !products.iter().all(|x| x.is_finite()) {
            return still;
        }
        let svd = products.svd(true, true);
        let (Some(u), Some(v)) = (svd.u, svd.v_t) else {
            return still;
        };
        let mut proper = Matrix3::identity();
        proper[(2, 2)] = (u.determinant() * v.determinant()).signum();
        let turn = u * proper * v - Matrix3::identity();
        let spin = turn.norm() * (1.0 + 1e-9);
        // Nothing turns: rounding errors must not move points.
        match spin < 1e-12 {
            true => still,
            false => Rigid {
                turn,
                spin,
                ..still
            },
        }
    }

    /// Returns the rotation, unless nothing turns.
    pub fn rotation(&self) -> Option<Matrix3<f64>> {
        (self.spin > 0.0).then(|| self.turn + Matrix3::identity())
    }

    /// Returns the displacement of a point.
    #[inline(always)]
    pub fn displacement(&self, point: Point) -> Point {
        let d = match self.spin {
            0.0 => self.shift,
            _ => self.turn * (Vector3::from(point) - self.center) + self.shift,
        };
        d.into()
    }
}

/// A floating-point type of coordinates.
pub(super) trait Real:
    Copy + Send + Sync + std::ops::Sub<Output = Self> + PartialOrd
{
    /// The largest number.
    const MOST: Self;
    /// The smallest number.
    const LEAST: Self;
    fn wide(self) -> f64;
}

impl Real for f32 {
    const MOST: f32 = f32::MAX;
    const LEAST: f32 = f32::MIN;
    #[inline(always)]
    fn wide(self) -> f64 {
        self.into()
    }
}

impl Real for f64 {
    const MOST: f64 = f64::MAX;
    const LEAST: f64 = f64::MIN;
    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }
}

/// Box of the displacements of some points, in the precision of their coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shifts<T> {
    lo: [T; 3],
    hi: [T; 3],
}

impl<T: Real> Shifts<T> {
    pub const EMPTY: Shifts<T> = Shifts {
        lo: [T::MOST; 3],
        hi: [T::LEAST; 3],
    };

    /// Adds the displacements of points from one frame to the next.
    #[inline(always)]
    pub fn add(&mut self, q: &[T], p: &[T]) {
        let ((eights_q, q), (eights_p, p)) = (q.as_chunks::<24>(), p.as_chunks::<24>());
        // Eight points at once: minima and maxima of halves, in vectors.
        for (q, p) in eights_q.iter().zip(eights_p) {
            let d: [T; 24] = std::array::from_fn(|k| p[k] - q[k]);
            let lo: [T; 12] = std::array::from_fn(|k| smaller(d[k], d[k + 12]));
            let hi: [T; 12] = std::array::from_fn(|k| larger(d[k], d[k + 12]));
            let lo: [T; 6] = std::array::from_fn(|k| smaller(lo[k], lo[k + 6]));
            let hi: [T; 6] = std::array::from_fn(|k| larger(hi[k], hi[k + 6]));
            for x in 0..3 {
                self.lo[x] = smaller(self.lo[x], smaller(lo[x], lo[x + 3]));
                self.hi[x] = larger(self.hi[x], larger(hi[x], hi[x + 3]));
            }
        }
        for (q, p) in q.as_chunks::<3>().0.iter().zip(p.as_chunks::<3>().0) {
            for x in 0..3 {
                let d = p[x] - q[x];
                self.lo[x] = smaller(self.lo[x], d);
                self.hi[x] = larger(self.hi[x], d);
            }
        }
    }

    /// Returns an upper bound of the differences between the displacements and `shift`. Covers the
    /// rounding of the displacements to the precision of the coordinates.
    #[inline(always)]
    pub fn largest_from(&self, shift: Point) -> f64 {
        let most = [0, 1, 2].map(|x| {
            let (lo, hi) = (self.lo[x].wide(), self.hi[x].wide());
            let far = larger(hi - shift[x], shift[x] - lo);
            far + 1e-7 * (hi.abs() + lo.abs() + shift[x].abs())
        });
        (most[0] * most[0] + most[1] * most[1] + most[2] * most[2]).sqrt() * (1.0 + 1e-9)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use nalgebra::Rotation3;

    #[test]
    fn a_rigid_motion_leaves_nothing() {
        let mut random = Random::new(7);
        for k in 0..100 {
            let points: Vec<Point> = (0..50).map(|_| random.point(3.0)).collect();
            let rotation = Rotation3::new(Vector3::from(random.point(2.0)) * f64::from(k % 3));
            let shift = Vector3::from(random.point(10.0));
            let moved = points.iter().map(|&p| rotation * Vector3::from(p) + shift);
            let moved: Vec<Point> = moved.map(Point::from).collect();
            let frames = [&points, &moved].map(|p| Positions::F64(p.as_flattened()));
            let rigid = Rigid::fit(frames);
            for (k, &q) in points.iter().enumerate() {
                let mut shifts = Shifts::EMPTY;
                shifts.add(&points[k], &moved[k]);
                let rest = shifts.largest_from(rigid.displacement(q));
                assert!(rest < 1e-5, "{rest:e}");
            }
        }
    }

    #[test]
    fn shifts_bound_all_displacements() {
        let mut random = Random::new(3);
        for n in [1, 7, 8, 9, 11, 24, 40] {
            let mut point = || [0.0; 3].map(|_: f64| random.between(-1.0, 1.0) as f32);
            let before: Vec<[f32; 3]> = (0..n).map(|_| point()).collect();
            let after: Vec<[f32; 3]> = (0..n).map(|_| point()).collect();
            let mut shifts = Shifts::EMPTY;
            shifts.add(before.as_flattened(), after.as_flattened());
            let shift = [0.25, -0.5, 0.125];
            let far = |(q, p): (&[f32; 3], &[f32; 3])| {
                let d = [0, 1, 2].map(|x| f64::from(p[x]) - f64::from(q[x]) - shift[x]);
                crate::curve::vector::norm(d)
            };
            let farthest = before.iter().zip(&after).map(far).fold(0.0, f64::max);
            let bound = shifts.largest_from(shift);
            assert!(farthest <= bound && bound < 2.0 * farthest + 1e-6);
        }
    }
}
