//! Motion of a scene since a reference frame: the rigid motion of the whole, and the remaining
//! motion of each part.

use crate::curve::vector::per_axis;
use crate::curve::{Point, Positions, Real, larger, smaller};
use nalgebra::{Matrix3, Vector3};

/// Number of points to which a rigid motion is fitted.
const SAMPLES: usize = 64;

/// A rigid motion, which changes no distance: points of a frame, turned back by `turn_back`, are
/// those of the reference frame plus `shift`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rigid {
    /// Inverse of the rotation about `center`; `None` if the motion is a translation.
    turn_back: Option<Matrix3<f64>>,
    center: Vector3<f64>,
    shift: Point,
}

impl Rigid {
    /// Fits a motion to some of the points of two frames. The rotation is that of Kabsch (1976). It
    /// is computed if some points differ by more than `small` after the translation alone, and is
    /// kept if it halves the difference. A poor fit only makes the remaining motion larger. With an
    /// infinite `small`, the motion is a translation.
    pub fn fit([before, after]: [Positions<'_>; 2], small: f64) -> Rigid {
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
            turn_back: None,
            center,
            shift: (to - center).into(),
        };
        let farthest = |rotation: &Matrix3<f64>| {
            let far = points().map(|k| {
                let q = rotation * (Vector3::from(before.point(k)) - center);
                (Vector3::from(after.point(k)) - to - q).norm()
            });
            far.fold(0.0, f64::max)
        };
        let rest = farthest(&Matrix3::identity());
        if rest <= small {
            return still;
        }
        let products = points().map(|k| {
            let q = Vector3::from(before.point(k)) - center;
            let p = Vector3::from(after.point(k)) - to;
            p * q.transpose() * share
        });
        let products: Matrix3<f64> = products.sum();
        // The decomposition may not terminate for infinities or NaN.
        if !products.iter().all(|x| x.is_finite()) {
            return still;
        }
        let svd = products.svd(true, true);
        let (Some(u), Some(v)) = (svd.u, svd.v_t) else {
            return still;
        };
        let mut proper = Matrix3::identity();
        proper[(2, 2)] = (u.determinant() * v.determinant()).signum();
        let rotation = u * proper * v;
        match farthest(&rotation) < 0.5 * rest {
            true => Rigid {
                turn_back: Some(rotation.transpose()),
                // The points are turned back about the centre of the reference frame.
                shift: (rotation.transpose() * (to - center)).into(),
                center,
            },
            false => still,
        }
    }

    /// Returns an upper bound of the distances between the motion of some points and this one.
    pub fn largest_from(&self, moved: &Displacements) -> f64 {
        let most = per_axis(|x| {
            let (lo, hi, shift) = (moved.lo[x], moved.hi[x], self.shift[x]);
            larger(hi - shift, shift - lo) + 1e-15 * shift.abs()
        });
        (most[0] * most[0] + most[1] * most[1] + most[2] * most[2]).sqrt() * (1.0 + 1e-9)
    }
}

/// Ranges of points, counted over all curves. Most parts have one range; parts that wrap around the
/// end of a closed curve have more. Unused ranges are empty.
pub(super) type Ranges = [[u32; 2]; 3];

/// Box of the displacements of all points of a part of the curves.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Displacements {
    lo: Point,
    hi: Point,
}

impl Displacements {
    /// Returns the displacements of an image whose lattice vector moved by `by`, rounded by at most
    /// `rounding`.
    #[inline(always)]
    pub fn shifted(&self, by: Point, rounding: f64) -> Displacements {
        Displacements {
            lo: per_axis(|x| self.lo[x] + by[x] - rounding),
            hi: per_axis(|x| self.hi[x] + by[x] + rounding),
        }
    }

    /// Returns an upper bound of the distance by which points of two parts moved relative to one
    /// another.
    #[inline(always)]
    pub fn largest_between(&self, other: &Displacements) -> f64 {
        let most = per_axis(|x| larger(self.hi[x] - other.lo[x], other.hi[x] - self.lo[x]));
        (most[0] * most[0] + most[1] * most[1] + most[2] * most[2]).sqrt() * (1.0 + 1e-9)
    }
}

/// Two frames, and the rigid motion between them.
#[derive(Clone, Copy)]
pub(super) struct Step<'a> {
    pub frames: [Positions<'a>; 2],
    pub rigid: Rigid,
    /// Share of the size of the box of the control points by which a curve can extend beyond it, on
    /// each side.
    pub widen: f64,
}

impl Step<'_> {
    /// Computes the displacements of parts, turned back if the scene turned. They include the
    /// rounding errors of the coordinates.
    #[inline(always)]
    pub fn displacements(&self, parts: &[Ranges], out: &mut [Displacements]) {
        for (ranges, out) in parts.iter().zip(out) {
            *out = match (self.frames, self.rigid.turn_back) {
                ([Positions::F32(q), Positions::F32(p)], None) => self.moved(ranges, q, p),
                ([Positions::F64(q), Positions::F64(p)], None) => self.moved(ranges, q, p),
                (frames, Some(turn)) => self.turned_back(ranges, frames, &turn),
                _ => unreachable!("frames of the same curves have the same precision"),
            };
        }
    }

    #[inline(always)]
    fn moved<T: Real>(&self, ranges: &Ranges, q: &[T], p: &[T]) -> Displacements {
        let mut extremes = Extremes::none();
        for [from, to] in ranges.map(|ends| ends.map(|point| 3 * point as usize)) {
            if from < to {
                extremes.add(&q[from..to], &p[from..to]);
            }
        }
        self.widened(extremes.bounds(), 0.0)
    }

    #[inline(always)]
    fn turned_back(
        &self,
        ranges: &Ranges,
        [before, after]: [Positions<'_>; 2],
        turn: &Matrix3<f64>,
    ) -> Displacements {
        let center = self.rigid.center;
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let mut magnitude = 0.0;
        for k in ranges.iter().flat_map(|&[from, to]| from..to) {
            let q = Vector3::from(before.point(k as usize)) - center;
            let p = Vector3::from(after.point(k as usize)) - center;
            let d: Point = (turn * p - q).into();
            magnitude = larger(magnitude, q.amax() + p.amax());
            for x in 0..3 {
                lo[x] = smaller(lo[x], d[x]);
                hi[x] = larger(hi[x], d[x]);
            }
        }
        // Rounding errors of the rotation matrix, its deviation from orthogonality included, and of
        // the centre.
        let rounding = 1e-14 * (magnitude + center.amax());
        self.widened([lo, hi], rounding)
    }

    #[inline(always)]
    fn widened(&self, [lo, hi]: [Point; 2], rounding: f64) -> Displacements {
        let by = per_axis(|x| {
            self.widen * (hi[x] - lo[x]) + 1.3e-7 * larger(hi[x].abs(), lo[x].abs()) + rounding
        });
        Displacements {
            lo: per_axis(|x| lo[x] - by[x]),
            hi: per_axis(|x| hi[x] + by[x]),
        }
    }
}

/// Smallest and largest differences of coordinates, eight points in parallel.
struct Extremes<T> {
    lo: [T; 24],
    hi: [T; 24],
}

impl<T: Real> Extremes<T> {
    /// Returns the extremes of no differences. Larger ones than these numbers only widen the range.
    fn none() -> Extremes<T> {
        Extremes {
            lo: [T::from(f32::MAX); 24],
            hi: [T::from(f32::MIN); 24],
        }
    }

    #[inline(always)]
    fn add(&mut self, q: &[T], p: &[T]) {
        let ((eights_q, q), (eights_p, p)) = (q.as_chunks::<24>(), p.as_chunks::<24>());
        for (q, p) in eights_q.iter().zip(eights_p) {
            for k in 0..24 {
                let d = p[k] - q[k];
                self.lo[k] = smaller(self.lo[k], d);
                self.hi[k] = larger(self.hi[k], d);
            }
        }
        for (k, (&q, &p)) in q.iter().zip(p).enumerate() {
            let d = p - q;
            self.lo[k] = smaller(self.lo[k], d);
            self.hi[k] = larger(self.hi[k], d);
        }
    }

    #[inline(always)]
    fn bounds(&self) -> [Point; 2] {
        let lo: [T; 12] = std::array::from_fn(|k| smaller(self.lo[k], self.lo[k + 12]));
        let hi: [T; 12] = std::array::from_fn(|k| larger(self.hi[k], self.hi[k + 12]));
        let lo: [T; 6] = std::array::from_fn(|k| smaller(lo[k], lo[k + 6]));
        let hi: [T; 6] = std::array::from_fn(|k| larger(hi[k], hi[k + 6]));
        [
            per_axis(|x| smaller(lo[x], lo[x + 3]).into()),
            per_axis(|x| larger(hi[x], hi[x + 3]).into()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::vector::{norm, sub};
    use crate::random::Random;
    use nalgebra::Rotation3;

    fn step<'a>(frames: [Positions<'a>; 2], small: f64) -> Step<'a> {
        Step {
            frames,
            rigid: Rigid::fit(frames, small),
            widen: 0.0,
        }
    }

    fn displacements(step: &Step<'_>, ranges: Ranges) -> Displacements {
        let mut out = [Displacements::default()];
        step.displacements(&[ranges], &mut out);
        out[0]
    }

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
            let step = step(frames, 1e-12);
            let moved = displacements(&step, [[0, 50], [0; 2], [0; 2]]);
            let rest = step.rigid.largest_from(&moved);
            assert!(rest < 1e-5, "{rest:e}");
        }
    }

    #[test]
    fn displacements_bound_all_motions() {
        let mut random = Random::new(3);
        for n in [2, 7, 8, 9, 11, 24, 40] {
            let mut point = || [0.0; 3].map(|_: f64| random.between(-1.0, 1.0) as f32);
            let before: Vec<[f32; 3]> = (0..n).map(|_| point()).collect();
            let after: Vec<[f32; 3]> = (0..n).map(|_| point()).collect();
            let frames = [&before, &after].map(|p| Positions::F32(p.as_flattened()));
            // No rotation.
            let step = step(frames, 10.0);
            let half = n / 2;
            let [a, b] = [
                [[0, half], [0; 2], [0; 2]],
                [[half, n - 1], [n - 1, n], [0; 2]],
            ]
            .map(|ranges| displacements(&step, ranges));
            let moved = |k: u32| {
                let [q, p] = frames.map(|f| f.point(k as usize));
                sub(p, q)
            };
            let mut farthest = 0.0_f64;
            for x in 0..half {
                for y in half..n {
                    farthest = farthest.max(norm(sub(moved(x), moved(y))));
                }
            }
            let bound = a.largest_between(&b);
            assert!(
                farthest <= bound && bound < 2.5 * farthest,
                "{farthest} {bound}"
            );
            let own = (0..half).map(|k| norm(sub(moved(k), step.rigid.shift)));
            assert!(own.fold(0.0, f64::max) <= step.rigid.largest_from(&a));
        }
    }
}
