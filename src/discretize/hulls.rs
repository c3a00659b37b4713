//! Are the convex hulls of two cubic segments apart, by more than rounding can hide?

use crate::curve::{Bezier, Bounds, Point, hull_bounds};

/// Whether some tested axis separates the hulls, each of them dilated by `margin` in the maximum norm.
///
/// "No" means not known. `margin` bounds how far computed control points and computed curve points lie from
/// the true ones; see [`separation_margin`] for what it must cover beyond that.
pub(super) fn separated(a: &Bezier, b: &Bezier, margin: f64) -> bool {
    if boxes_apart(&hull_bounds(a), &hull_bounds(b), margin) {
        return true;
    }
    let (da, db) = (sub(a[3], a[0]), sub(b[3], b[0]));
    // Strands that cross at an angle: the common normal of the chords.
    if apart_along(a, b, cross(da, db), margin) {
        return true;
    }
    let sum = |p: &Bezier| [0, 1, 2].map(|x| p[0][x] + p[1][x] + p[2][x] + p[3][x]);
    let between = sub(sum(b), sum(a));
    if apart_along(a, b, between, margin) {
        return true;
    }
    // Nearly parallel strands: the way from one to the other, made orthogonal to a chord.
    [da, db].into_iter().any(|d| {
        let length_sq = dot(d, d);
        length_sq > 0.0 && {
            let c = dot(between, d) / length_sq;
            apart_along(a, b, [0, 1, 2].map(|x| between[x] - c * d[x]), margin)
        }
    })
}

/// The margin for hulls whose control points are at most `max_abs` in magnitude times 5/3, and computed
/// within [`crate::CurveSet::pad`].
///
/// With `M = 5/3 max_abs` and `u = 2^-53`, [`apart_along`] computes `n . (p - o)` with an error of at most
/// `|n|_1 (2 M u + 3 * 2 M u (1 + u)^3)`: the difference is at most `2 M` and rounds once, the scalar product
/// of three terms at most three times each. Twice that for the two sides, and the pads of both hulls; `32 M u`
/// covers the first, the pad itself (`29 M u` at most, see there) the second.
pub(super) fn separation_margin(max_abs: f64, pad: f64) -> f64 {
    pad + max_abs * f64::from_bits((1023 - 47) << 52)
}

/// Whether the hulls, dilated by `margin`, lie on two sides of a plane with normal `n`.
fn apart_along(a: &Bezier, b: &Bezier, n: Point, margin: f64) -> bool {
    // The constant covers underflow, of this product and of those below.
    let slack = 2.0 * margin * (n[0].abs() + n[1].abs() + n[2].abs()) + 1e-300;
    let extent = |p: &Bezier| {
        p.iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), &p| {
                let t = dot(sub(p, a[0]), n);
                (lo.min(t), hi.max(t))
            })
    };
    let ((a_lo, a_hi), (b_lo, b_hi)) = (extent(a), extent(b));
    // Strict: a normal of zero separates nothing.
    a_hi + slack < b_lo || b_hi + slack < a_lo
}

/// The box of the curve itself, within rounding: its ends and its extremes.
pub(super) fn tight_bounds(p: &Bezier) -> Bounds {
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
        // A third of the derivative: q2 t^2 + 2 q1 t + q0.
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
    (lo, hi)
}

/// Whether two boxes are more than `2 margin` apart along an axis.
pub(super) fn boxes_apart(a: &Bounds, b: &Bounds, margin: f64) -> bool {
    (0..3).any(|x| a.1[x] + 2.0 * margin < b.0[x] || b.1[x] + 2.0 * margin < a.0[x])
}

fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::point_at;
    use proptest::prelude::*;

    fn bezier() -> impl Strategy<Value = Bezier> {
        prop::array::uniform4(prop::array::uniform3(-1.0f64..1.0))
    }

    proptest! {
        #[test]
        fn tight_boxes_are_tight_and_contain_the_curve(p in bezier()) {
            let (lo, hi) = tight_bounds(&p);
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

        /// Separated hulls have no curve points at the same place, and hulls that share a point never separate.
        #[test]
        fn separation_is_sound(a in bezier(), b in bezier(), shift in 0.0f64..2.5, s in 0.0f64..1.0, t in 0.0f64..1.0) {
            let mut moved = b;
            moved.iter_mut().for_each(|p| p[2] += shift);
            if separated(&a, &moved, 1e-14) {
                for k in 0..=20 {
                    for l in 0..=20 {
                        let (p, q) = (point_at(&a, f64::from(k) / 20.0), point_at(&moved, f64::from(l) / 20.0));
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
    fn strands_at_an_angle_and_side_by_side_separate() {
        let line =
            |p: Point, d: Point| [0.0, 1.0, 2.0, 3.0].map(|t| [0, 1, 2].map(|x| p[x] + t * d[x]));
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
