//! Boxes of the segments of a curve, eight at once, and the pads that cover their rounding errors.

use super::basis::{Real, uniform_bounds};
use super::boxes::{BoxGroup, above, below, larger, smaller};
use super::coordinates::Coordinates;
use super::{Basis, CurveSet, pow2};
use crate::simd::LANES;

impl CurveSet {
    /// Returns an upper bound of the error of computed points and boxes of splines. Boxes are
    /// padded by it. It is 0 for polylines, whose vertices are the input, unless they are rounded
    /// sums ([`CurveSet::rounding`]).
    ///
    /// # Derivation: the error is below `32 M u = M 2^-48`
    ///
    /// `M` is the largest coordinate and `u = 2^-53`. Bezier control points have coordinates of at
    /// most `5/3 M` (B-spline and Bezier: `M`; Catmull-Rom: `4/3 M`), with an error of at most
    /// `4 M u` ([`Basis::hull`]). Sub-segments add at most `15 * 5/3 M u` ([`sub_segment`]).
    /// Together that is `29 M u`. The tiny constant covers underflow. Hull points move at most
    /// `5/3` times as far as control points, which are rounded.
    ///
    /// [`sub_segment`]: super::sub_segment
    pub(crate) fn pad(&self) -> f64 {
        match self.basis.is_polyline() {
            true => self.rounding(),
            false => self.max_abs() * pow2(-48) + 2.0 * self.rounding() + 1e-300,
        }
    }

    /// Returns the padding of boxes of uniform splines that are computed in single precision, or
    /// `None` if this computation could overflow.
    ///
    /// # Derivation: the error is below `8 M u = M 2^-21`
    ///
    /// `M` is the largest coordinate and `u = 2^-24`. In single precision, the operations of
    /// [`Basis::hull`] have an error below `4 M u`, as shown there. The padded bound has a
    /// magnitude of at most `5/3 M + pad`, and rounding it adds `1.7 M u`. Points that the
    /// discretization computes are within `M 2^-48` of the curve (see [`CurveSet::pad`]). The sum
    /// is below `6 M u`; the padding is `8 M u`. The constant covers underflow: each of the few
    /// products has an error of at most `2^-150`.
    fn single_pad(&self) -> Option<f32> {
        const LARGEST: f64 = pow2(120);
        const SHARE: f64 = pow2(-21);
        const TINY: f64 = pow2(-140);
        (self.max_abs() <= LARGEST).then_some((self.max_abs() * SHARE + TINY) as f32)
    }

    /// Returns the boxes of the segments `8 g .. 8 g + 8` of curve `i`. Lanes past the last segment
    /// are empty.
    ///
    /// Each box contains the segment, its chord, and every point that the discretization may
    /// compute on it.
    #[inline(always)]
    pub(crate) fn leaf_boxes(&self, i: usize, g: usize) -> BoxGroup {
        let count = self.curves[i].segments as usize - g * LANES;
        let first = self.slot(i, g * LANES);
        let mut group = match self.basis {
            Basis::Polyline => match self.coordinates() {
                Coordinates::F32(v) => edge_boxes(v, first, smaller, larger),
                Coordinates::F64(v) => {
                    // The bound covers the rounding of these differences.
                    let pad = self.rounding();
                    let below = |p: f64, q: f64| below(smaller(p, q) - pad);
                    let above = |p: f64, q: f64| above(larger(p, q) + pad);
                    edge_boxes(v, first, below, above)
                }
            },
            Basis::CatmullRom | Basis::BSpline => match self.coordinates() {
                Coordinates::F32(v) => match self.single_pad() {
                    Some(pad) => {
                        uniform_boxes(self.basis, v, first, |lo: f32| lo - pad, |hi: f32| hi + pad)
                    }
                    None => self.wide_boxes(v, first),
                },
                Coordinates::F64(v) => self.wide_boxes(v, first),
            },
            Basis::Bezier => self.bezier_boxes(i, g, count.min(LANES)),
        };
        if count < LANES {
            group.clear_from(count);
        }
        group
    }

    /// Returns the boxes of eight segments of a uniform cubic basis, computed in double precision.
    #[inline(always)]
    fn wide_boxes<T: Copy + Into<f64>>(&self, v: &[Vec<T>; 3], first: usize) -> BoxGroup {
        let pad = self.pad();
        let (below, above) = (|lo: f64| below(lo - pad), |hi: f64| above(hi + pad));
        uniform_boxes(self.basis, v, first, below, above)
    }

    fn bezier_boxes(&self, i: usize, g: usize, count: usize) -> BoxGroup {
        let mut group = BoxGroup::EMPTY;
        let pad = self.pad();
        for k in 0..count {
            for (x, points) in self.hull(i, g * LANES + k).iter().enumerate() {
                let lo = points.iter().fold(f64::INFINITY, |m, &p| m.min(p));
                let hi = points.iter().fold(f64::NEG_INFINITY, |m, &p| m.max(p));
                group.lo[x][k] = below(lo - pad);
                group.hi[x][k] = above(hi + pad);
            }
        }
        group
    }
}

/// Returns the boxes of eight edges of a polyline.
#[inline(always)]
fn edge_boxes<T: Copy>(
    v: &[Vec<T>; 3],
    first: usize,
    lo: impl Fn(T, T) -> f32,
    hi: impl Fn(T, T) -> f32,
) -> BoxGroup {
    let mut group = BoxGroup::EMPTY;
    for (x, v) in v.iter().enumerate() {
        let p = &v[first..first + LANES + 1];
        for k in 0..LANES {
            group.lo[x][k] = lo(p[k], p[k + 1]);
            group.hi[x][k] = hi(p[k], p[k + 1]);
        }
    }
    group
}

/// Returns the boxes of eight segments of a uniform cubic basis, computed in the type `R`.
#[inline(always)]
fn uniform_boxes<T: Copy + Into<R>, R: Real>(
    basis: Basis,
    v: &[Vec<T>; 3],
    first: usize,
    below: impl Fn(R) -> f32,
    above: impl Fn(R) -> f32,
) -> BoxGroup {
    let mut group = BoxGroup::EMPTY;
    for (x, v) in v.iter().enumerate() {
        let window = &v[first..first + LANES + 3];
        let mut q = [R::default(); LANES + 3];
        for (q, &p) in q.iter_mut().zip(window) {
            *q = p.into();
        }
        let [lo, hi] = uniform_bounds(basis, &q);
        for k in 0..LANES {
            group.lo[x][k] = below(lo[k]);
            group.hi[x][k] = above(hi[k]);
        }
    }
    group
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Box3, Positions};

    #[test]
    fn the_last_segment_of_a_closed_polyline_ends_at_its_start() {
        let square = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];
        let set = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F32(&square)).unwrap();
        assert_eq!(set.knot(0, 4), set.knot(0, 0));
        assert_eq!(set.curve(0).segments, 4);
        let b = set.leaf_boxes(0, 0);
        assert_eq!(b.lane(3).lo, [0.0, 0.0, 0.0]);
        assert_eq!(b.lane(3).hi, [0.0, 1.0, 0.0]);
        assert_eq!(b.lane(4), Box3::EMPTY);
    }

    #[test]
    fn segments_are_connected_and_boxes_contain_the_curve() {
        for basis in Basis::ALL {
            for closed in [true, false] {
                let n = if closed { 21 } else { 22 };
                let xyz: Vec<f32> = (0..3 * n)
                    .map(|k| ((k * k * 37) % 101) as f32 / 7.0)
                    .collect();
                let count = if closed { -n } else { n };
                let set = CurveSet::from_counts(basis, &[count], Positions::F32(&xyz)).unwrap();
                let m = set.curve(0).segments as usize;
                for s in 0..m {
                    let end = set.eval(0, s, 1.0);
                    let next = set.knot(0, s + 1);
                    assert!(
                        (0..3).all(|x| (end[x] - next[x]).abs() < 1e-12),
                        "{basis:?} {s}"
                    );
                    let b = set.leaf_boxes(0, s / 8).lane(s % 8);
                    for k in 0..=10 {
                        let p = set.eval(0, s, f64::from(k) / 10.0);
                        let inside =
                            |x: usize| f64::from(b.lo[x]) <= p[x] && p[x] <= f64::from(b.hi[x]);
                        assert!((0..3).all(inside));
                    }
                }
                if closed {
                    let (a, b) = (set.knot(0, 0), set.knot(0, m));
                    assert_eq!(a, b, "{basis:?}");
                }
            }
        }
    }
}
