//! Motion of a scene from one frame to the next: a rigid motion, and what remains.

use crate::curve::{Point, Positions};
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

    /// Returns the displacement of a point.
    pub fn displacement(&self, point: Point) -> Point {
        let d = match self.spin {
            0.0 => self.shift,
            _ => self.turn * (Vector3::from(point) - self.center) + self.shift,
        };
        d.into()
    }
}

/// Box of the displacements of some points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shifts {
    lo: Point,
    hi: Point,
}

impl Shifts {
    pub const EMPTY: Shifts = Shifts {
        lo: [f64::INFINITY; 3],
        hi: [f64::NEG_INFINITY; 3],
    };

    /// Adds the displacements of a range of points.
    pub fn add(&mut self, [before, after]: [Positions<'_>; 2], points: std::ops::Range<usize>) {
        match (before, after) {
            (Positions::F32(q), Positions::F32(p)) => self.add_all(q, p, points),
            (Positions::F64(q), Positions::F64(p)) => self.add_all(q, p, points),
            _ => unreachable!("frames of the same curves have the same precision"),
        }
    }

    #[inline(always)]
    fn add_all<T>(&mut self, q: &[T], p: &[T], points: std::ops::Range<usize>)
    where
        T: Copy + std::ops::Sub<Output = T> + PartialOrd + Into<f64>,
    {
        let range = 3 * points.start..3 * points.end;
        let (q, p) = (&q[range.clone()], &p[range]);
        let mut rest = 0;
        // Eight points at once: minima and maxima of halves, in vectors.
        for (q, p) in q.as_chunks::<24>().0.iter().zip(p.as_chunks::<24>().0) {
            let d: [T; 24] = std::array::from_fn(|k| p[k] - q[k]);
            let least = |a: T, b: T| if a < b { a } else { b };
            let most = |a: T, b: T| if a > b { a } else { b };
            let lo: [T; 12] = std::array::from_fn(|k| least(d[k], d[k + 12]));
            let hi: [T; 12] = std::array::from_fn(|k| most(d[k], d[k + 12]));
            let lo: [T; 6] = std::array::from_fn(|k| least(lo[k], lo[k + 6]));
            let hi: [T; 6] = std::array::from_fn(|k| most(hi[k], hi[k + 6]));
            for x in 0..3 {
                self.lo[x] = self.lo[x].min(least(lo[x], lo[x + 3]).into());
                self.hi[x] = self.hi[x].max(most(hi[x], hi[x + 3]).into());
            }
            rest += 24;
        }
        for (q, p) in q[rest..]
            .as_chunks::<3>()
            .0
            .iter()
            .zip(p[rest..].as_chunks::<3>().0)
        {
            for x in 0..3 {
                let d = (p[x] - q[x]).into();
                self.lo[x] = self.lo[x].min(d);
                self.hi[x] = self.hi[x].max(d);
            }
        }
    }

    /// Returns an upper bound of the differences between the displacements and `shift`. Covers the
    /// rounding of the displacements to the precision of the coordinates.
    pub fn largest_from(&self, shift: Point) -> f64 {
        let most = [0, 1, 2].map(|x| {
            let far = (self.hi[x] - shift[x]).max(shift[x] - self.lo[x]);
            far + 1e-7 * (self.hi[x].abs() + self.lo[x].abs() + shift[x].abs())
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
                shifts.add(frames, k..k + 1);
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
            let frames = [&before, &after].map(|p| Positions::F32(p.as_flattened()));
            let mut shifts = Shifts::EMPTY;
            shifts.add(frames, 0..n);
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
