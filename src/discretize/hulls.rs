//! Separation of the convex hulls of two cubic segments, by more than rounding errors.

use crate::curve::vector::{add, add_scaled, cross, dot, norm, per_axis, sub};
use crate::curve::{Bezier, Point, larger, pow2, smaller};

/// Convex hull of a cubic segment, given by its control points: `points[axis][k]`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hull {
    pub(super) points: [[f64; 4]; 3],
}

impl Hull {
    /// Returns the hull of a segment, given the points from [`crate::CurveSet`].
    #[inline(always)]
    pub fn new(points: [[f64; 4]; 3]) -> Hull {
        Hull { points }
    }

    /// Returns one of the four control points.
    #[inline(always)]
    pub fn point(&self, k: usize) -> Point {
        per_axis(|x| self.points[x][k])
    }

    /// Returns the mean of the four control points.
    #[inline(always)]
    pub fn center(&self) -> Point {
        self.sum().map(|x| 0.25 * x)
    }

    /// Returns the hulls of both halves of the segment. Each mean is rounded once and does not
    /// amplify other errors, so the error is at most `3 M u` for coordinates of at most `M`.
    pub fn halves(&self) -> [Hull; 2] {
        let mut out = [*self; 2];
        for (x, p) in self.points.iter().enumerate() {
            let mean = |a: f64, b: f64| 0.5 * (a + b);
            let (a, b, c) = (mean(p[0], p[1]), mean(p[1], p[2]), mean(p[2], p[3]));
            let (d, e) = (mean(a, b), mean(b, c));
            let middle = mean(d, e);
            out[0].points[x] = [p[0], a, d, middle];
            out[1].points[x] = [middle, e, c, p[3]];
        }
        out
    }

    /// Returns, approximately, the point of the curve at the parameter of a point of its chord.
    pub fn curve_point_near(&self, p: Point) -> Point {
        let start = self.point(0);
        let d = self.chord();
        let t = dot(sub(p, start), d) / dot(d, d).max(f64::MIN_POSITIVE);
        let (s, t) = (1.0 - t, t);
        let [a, b, c, d] = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
        self.points
            .map(|p| a * p[0] + b * p[1] + c * p[2] + d * p[3])
    }

    /// Returns the heights of the control points of both hulls along a vector, relative to the
    /// first point of this hull.
    #[inline(always)]
    pub fn heights_of_both(&self, other: &Hull, n: Point) -> [[f64; 4]; 2] {
        let origin = self.point(0);
        [self.heights(origin, n), other.heights(origin, n)]
    }

    /// Returns the gap between two hulls along a vector from this one to the other one, within
    /// rounding errors, or 0 if there is no gap.
    #[inline(always)]
    pub fn gap_along(&self, other: &Hull, n: Point) -> f64 {
        let length_sq = dot(n, n);
        // Below this limit, squares may have lost digits.
        if !(length_sq > 1e-200 && length_sq.is_finite()) {
            return 0.0;
        }
        let [from, to] = self.heights_of_both(other, n).map(|h| extent(&h));
        ((to[0] - from[1]) / length_sq.sqrt()).max(0.0)
    }

    /// Returns the hull of a piece of a segment.
    pub fn of_piece(p: &Bezier) -> Hull {
        Hull::new(per_axis(|x| [0, 1, 2, 3].map(|k| p[k][x])))
    }

    /// Returns the vector from the start to the end.
    #[inline(always)]
    fn chord(&self) -> Point {
        let [x, y, z] = &self.points;
        [x[3] - x[0], y[3] - y[0], z[3] - z[0]]
    }

    #[inline(always)]
    fn sum(&self) -> Point {
        let [x, y, z] = &self.points;
        let sum = |v: &[f64; 4]| (v[0] + v[1]) + (v[2] + v[3]);
        [sum(x), sum(y), sum(z)]
    }

    /// Returns true if a tested axis separates the hulls, each of them dilated by `margin` in the
    /// maximum norm.
    ///
    /// The result `false` means unknown. `margin` bounds the distance of computed control points
    /// and computed curve points from the exact ones. See [`separation_margin`] for the other
    /// errors that it must cover.
    #[inline(always)]
    pub fn separated(&self, other: &Hull, margin: f64) -> bool {
        Self::separated_throughout([[self, other]], margin)
    }

    /// Returns true if a tested axis separates the hulls of two segments in all frames, with the
    /// same segment below. Then the axis separates them at all times in between, if control points
    /// move on straight lines at constant speed.
    ///
    /// Proof: `n . p` of every control point is linear in time. If all points of one segment are
    /// below all points of the other by some distance at both ends of a step, they are by that
    /// distance at all times in between.
    #[inline(always)]
    pub fn separated_throughout<const N: usize>(frames: [[&Hull; 2]; N], margin: f64) -> bool {
        // The axes are derived from sums over the frames. Any choice of axes is valid.
        let (mut da, mut db, mut between) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for [a, b] in frames {
            da = add(da, a.chord());
            db = add(db, b.chord());
            between = add(between, sub(b.sum(), a.sum()));
        }
        let motion = match N {
            1 => [0.0; 3],
            _ => {
                let ends = [frames[0], frames[N - 1]].map(|[a, b]| sub(b.sum(), a.sum()));
                sub(ends[1], ends[0])
            }
        };
        // Strands that cross at an angle: the common normal of the chords.
        if apart_along(frames, cross(da, db), margin) || apart_along(frames, between, margin) {
            return true;
        }
        // Nearly parallel strands: the vector from one to the other, made orthogonal to a chord.
        // Short pieces that move past one another: made orthogonal to their relative motion.
        for d in [da, db, motion] {
            let length_sq = dot(d, d);
            if length_sq > 0.0 {
                let c = dot(between, d) / length_sq;
                let normal = add_scaled(between, -c, d);
                if apart_along(frames, normal, margin) {
                    return true;
                }
            }
        }
        let mut apart = false;
        for x in 0..3 {
            let mut sides = [true; 2];
            for [a, b] in frames {
                let ([a_lo, a_hi], [b_lo, b_hi]) = (extent(&a.points[x]), extent(&b.points[x]));
                sides[0] &= a_hi + 2.0 * margin < b_lo;
                sides[1] &= b_hi + 2.0 * margin < a_lo;
            }
            apart |= sides[0] | sides[1];
        }
        apart
    }

    /// Returns `n . (p - origin)` for all control points.
    #[inline(always)]
    fn heights(&self, origin: Point, n: Point) -> [f64; 4] {
        let [x, y, z] = &self.points;
        let mut out = [0.0; 4];
        for k in 0..4 {
            out[k] =
                (x[k] - origin[0]) * n[0] + (y[k] - origin[1]) * n[1] + (z[k] - origin[2]) * n[2];
        }
        out
    }

    /// Returns true if the curves of these segments are monotonic along a common axis, in all
    /// frames and at all times in between, so that no two of their points, in this order, coincide.
    ///
    /// Proof: the derivative of a cubic is a convex combination of the differences of its control
    /// points. If all these differences are in the half-space of one axis at both ends of a step,
    /// they are at all times in between. The error of a computed difference is at most twice that
    /// of a control point, which `margin` covers as for heights.
    #[inline(always)]
    pub fn are_monotonic<const N: usize>(frames: &[[Hull; 2]; N], margin: f64) -> bool {
        let chords = frames.map(|[a, b]| add(a.chord(), b.chord()));
        if rise_along(frames, chords.into_iter().fold([0.0; 3], add), margin) {
            return true;
        }
        // The bisector, for chords of different lengths that turn by more than a right angle from
        // one frame to the next.
        let directions = chords.map(|v| v.map(|x| x / norm(v).max(f64::MIN_POSITIVE)));
        N > 1 && rise_along(frames, directions.into_iter().fold([0.0; 3], add), margin)
    }
}

/// Returns true if all control points of these segments are in ascending order along `n`, by more
/// than the errors, in every frame.
#[inline(always)]
fn rise_along<const N: usize>(frames: &[[Hull; 2]; N], n: Point, margin: f64) -> bool {
    let slack = 4.0 * margin * (n[0].abs() + n[1].abs() + n[2].abs()) + 1e-300;
    let mut all = true;
    for hull in frames.as_flattened() {
        let [x, y, z] = &hull.points;
        for k in 0..3 {
            let along =
                (x[k + 1] - x[k]) * n[0] + (y[k + 1] - y[k]) * n[1] + (z[k + 1] - z[k]) * n[2];
            all &= along > slack;
        }
    }
    all
}

/// Returns true if a plane with normal `n` is between the hulls, dilated by `margin`, in every
/// frame, with the same hull before it.
#[inline(always)]
fn apart_along<const N: usize>(frames: [[&Hull; 2]; N], n: Point, margin: f64) -> bool {
    // The constant covers underflow of this product and of those below.
    let slack = 2.0 * margin * (n[0].abs() + n[1].abs() + n[2].abs()) + 1e-300;
    let mut sides = [true; 2];
    for [a, b] in frames {
        let [a, b] = a.heights_of_both(b, n);
        let ([a_lo, a_hi], [b_lo, b_hi]) = (extent(&a), extent(&b));
        // Strict comparisons: a zero normal separates nothing.
        sides[0] &= a_hi + slack < b_lo;
        sides[1] &= b_hi + slack < a_lo;
    }
    sides[0] | sides[1]
}

/// Returns the smallest and the largest of four numbers that are not NaN.
#[inline(always)]
fn extent(v: &[f64; 4]) -> [f64; 2] {
    [
        smaller(smaller(v[0], v[1]), smaller(v[2], v[3])),
        larger(larger(v[0], v[1]), larger(v[2], v[3])),
    ]
}

/// Returns the margin for hulls whose control points have magnitudes of at most 5/3 `max_abs` and
/// errors of at most [`crate::CurveSet::pad`].
///
/// # Derivation
///
/// Let `M = 5/3 max_abs` and `u = 2^-53`. [`apart_along`] computes `n . (p - o)` with an
/// error of at most `|n|_1 (2 M u + 3 * 2 M u (1 + u)^3)`: the difference is at most `2 M` and is
/// rounded once; the scalar product has three terms, each rounded at most three times. The error
/// counts twice, for the two sides, and the errors of both hulls are added.
/// `64 u max_abs = max_abs 2^-47` covers the former, `pad` (at most `29 u max_abs`, see there) the
/// latter.
pub(super) fn separation_margin(max_abs: f64, pad: f64) -> f64 {
    pad + max_abs * pow2(-47)
}

/// Returns the bounding box of the curve itself, within rounding errors: of its ends and its
/// extremes.
pub(super) fn tight_bounds(p: &Bezier) -> [Point; 2] {
    let (mut lo, mut hi) = ([0.0; 3], [0.0; 3]);
    for x in 0..3 {
        let (a, b, c, d) = (p[0][x], p[1][x], p[2][x], p[3][x]);
        (lo[x], hi[x]) = (a.min(d), a.max(d));
        if b.min(c) >= lo[x] && b.max(c) <= hi[x] {
            continue;
        }
        let mut include = |t: f64| {
            if t > 0.0 && t < 1.0 {
                let s = 1.0 - t;
                let v = s * s * s * a + 3.0 * s * t * (s * b + t * c) + t * t * t * d;
                lo[x] = lo[x].min(v);
                hi[x] = hi[x].max(v);
            }
        };
        // One third of the derivative: q2 t^2 + 2 q1 t + q0.
        let (q0, q1, q2) = (b - a, a - 2.0 * b + c, d - a + 3.0 * (b - c));
        let discriminant = q1 * q1 - q2 * q0;
        if discriminant >= 0.0 {
            let r = -(q1 + discriminant.sqrt().copysign(q1));
            if q2 != 0.0 {
                include(r / q2);
            }
            if r != 0.0 {
                include(q0 / r);
            }
        }
    }
    [lo, hi]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::point_at;
    use proptest::prelude::*;

    fn separated(a: &Bezier, b: &Bezier, margin: f64) -> bool {
        Hull::of_piece(a).separated(&Hull::of_piece(b), margin)
    }

    fn bezier() -> impl Strategy<Value = Bezier> {
        prop::array::uniform4(prop::array::uniform3(-1.0f64..1.0))
    }

    proptest! {
        #[test]
        fn tight_boxes_are_tight_and_contain_the_curve(p in bezier()) {
            let [lo, hi] = tight_bounds(&p);
            let (mut seen_lo, mut seen_hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
            for k in 0..=2000 {
                let q = point_at(&p, f64::from(k) / 2000.0);
                for x in 0..3 {
                    seen_lo[x] = seen_lo[x].min(q[x]);
                    seen_hi[x] = seen_hi[x].max(q[x]);
                    prop_assert!(lo[x] - 1e-15 <= q[x] && q[x] <= hi[x] + 1e-15);
                }
            }
            for x in 0..3 {
                prop_assert!(seen_lo[x] - lo[x] < 1e-5 && hi[x] - seen_hi[x] < 1e-5);
            }
        }

        /// Curves in separated hulls have no common point, and hulls that share a point are never
        /// separated.
        #[test]
        fn separation_is_sound(
            a in bezier(),
            b in bezier(),
            shift in 0.0f64..2.5,
            s in 0.0f64..1.0,
            t in 0.0f64..1.0,
        ) {
            let mut moved = b;
            moved.iter_mut().for_each(|p| p[2] += shift);
            if separated(&a, &moved, 1e-14) {
                for k in 0..=20 {
                    for l in 0..=20 {
                        let [s, t] = [k, l].map(|k| f64::from(k) / 20.0);
                        let (p, q) = (point_at(&a, s), point_at(&moved, t));
                        prop_assert!((0..3).any(|x| (p[x] - q[x]).abs() > 1e-14));
                    }
                }
            }
            let (p, q) = (point_at(&a, s), point_at(&b, t));
            let mut meeting = b;
            meeting.iter_mut().for_each(|r| (0..3).for_each(|x| r[x] += p[x] - q[x]));
            prop_assert!(!separated(&a, &meeting, 1e-14));
        }
    }

    #[test]
    fn separates_strands_at_an_angle_and_side_by_side() {
        let line = |p: Point, d: Point| [0.0, 1.0, 2.0, 3.0].map(|t| per_axis(|x| p[x] + t * d[x]));
        let a = line([0.0; 3], [1.0, 1.0, 0.0]);
        // The boxes overlap in both cases.
        assert!(separated(
            &a,
            &line([0.0, 3.0, 0.1], [1.0, -1.0, -0.05]),
            1e-12
        ));
        assert!(separated(
            &a,
            &line([0.1, 0.0, 0.0], [1.0, 1.01, 0.0]),
            1e-12
        ));
        assert!(!separated(&a, &a, 0.0));
        assert!(!separated(
            &a,
            &line([0.0, 3.0, 0.0], [1.0, -1.0, 0.0]),
            1e-12
        ));
    }
}
