//! Orientation of points: the floating-point filter, and the fallback to exact methods.

use super::big;
use crate::curve::{Point, pow2};
use robust::{Coord, Coord3D};
use std::cmp::Ordering;

/// Bound of the rounding error of the determinant in [`Predicates::orient2d`], relative to the sum
/// of the magnitudes of its two products: `(3 + 16 u) u` with `u = 2^-53` (Shewchuk 1997, stage A
/// of ORIENT2D).
pub(crate) const ORIENT2D_BOUND: f64 = (3.0 + 16.0 * U) * U;

/// Bound of the rounding error of the three-dimensional determinant, relative to its permanent:
/// `(7 + 56 u) u` (Shewchuk 1997, stage A of ORIENT3D).
pub(crate) const ORIENT3D_BOUND: f64 = (7.0 + 56.0 * U) * U;

/// Half a unit in the last place of 1: the largest relative error of one operation.
const U: f64 = f64::EPSILON / 2.0;

/// Bound of the error that underflow can add to a product, generously: the error of a subnormal
/// result is at most `2^-1075`. With this term the bounds hold for all finite numbers. Overflow
/// gives infinities or NaN, which never satisfy a bound.
pub(crate) const UNDERFLOW: f64 = f64::from_bits(1 << 4);

/// Exact orientation predicates of points of some type. Signs have three values: -1, 0, 1.
pub(super) trait Orientation {
    type Point;

    /// Returns the sign of the area of a triangle, projected to the plane of two axes: 1 if it is
    /// counterclockwise there, 0 if the points lie on one line.
    fn orient2d(&mut self, points: [&Self::Point; 3], plane: (usize, usize)) -> i32;

    /// Returns the sign of `(a - d) . ((b - d) x (c - d))`, which is 0 if the four points `a b c d`
    /// lie in one plane.
    fn orient3d(&mut self, points: [&Self::Point; 4]) -> i32;

    /// Compares a coordinate of two points.
    fn compare(p: &Self::Point, q: &Self::Point, axis: usize) -> Ordering;
}

impl Orientation for Predicates {
    type Point = Point;

    #[inline(always)]
    fn orient2d(&mut self, points: [&Point; 3], (u, v): (usize, usize)) -> i32 {
        let [a, b, c] = points.map(|p| [p[u], p[v]]);
        Predicates::orient2d(self, a, b, c)
    }

    #[inline(always)]
    fn orient3d(&mut self, [a, b, c, d]: [&Point; 4]) -> i32 {
        Predicates::orient3d(self, *a, *b, *c, *d)
    }

    #[inline(always)]
    fn compare(p: &Point, q: &Point, axis: usize) -> Ordering {
        // Coordinates are finite. -0.0 and 0.0 are equal here.
        p[axis].partial_cmp(&q[axis]).unwrap_or(Ordering::Equal)
    }
}

/// Exact orientation predicates, with a count of the calls that floating point could not decide.
///
/// Signs have three values: -1, 0, 1. (`f64::signum` has not: it returns 1 for 0.0.)
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Predicates {
    /// Number of calls that an exact method decided.
    pub exact: u64,
}

impl Predicates {
    /// Returns the sign of the area of the triangle `a b c`: 1 if it is counterclockwise, 0 if the
    /// points lie on one line.
    #[inline]
    pub fn orient2d(&mut self, a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> i32 {
        let l = (a[0] - c[0]) * (b[1] - c[1]);
        let r = (a[1] - c[1]) * (b[0] - c[0]);
        let det = l - r;
        if det.abs() > ORIENT2D_BOUND * (l.abs() + r.abs()) + UNDERFLOW {
            return if det > 0.0 { 1 } else { -1 };
        }
        self.orient2d_exact(a, b, c)
    }

    #[cold]
    #[inline(never)]
    fn orient2d_exact(&mut self, a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> i32 {
        self.exact += 1;
        if ![a, b, c].as_flattened().iter().all(is_in_expansion_range) {
            return big::orient2d(a, b, c);
        }
        let coord = |[x, y]: [f64; 2]| Coord { x, y };
        sign(robust::orient2d(coord(a), coord(b), coord(c)))
    }

    /// Returns the sign of `(a - d) . ((b - d) x (c - d))`, which is 0 if the four points lie in
    /// one plane.
    #[inline]
    pub fn orient3d(&mut self, a: Point, b: Point, c: Point, d: Point) -> i32 {
        let (det, bound) = volume([a, b, c, d]);
        if det.abs() > bound {
            return if det > 0.0 { 1 } else { -1 };
        }
        self.orient3d_exact(a, b, c, d)
    }

    #[cold]
    #[inline(never)]
    fn orient3d_exact(&mut self, a: Point, b: Point, c: Point, d: Point) -> i32 {
        self.exact += 1;
        let all = [a, b, c, d];
        if !all.as_flattened().iter().all(is_in_expansion_range) {
            return big::orient3d(a, b, c, d);
        }
        let coord = |[x, y, z]: Point| Coord3D { x, y, z };
        sign(robust::orient3d(coord(a), coord(b), coord(c), coord(d)))
    }
}

/// Returns the determinant of [`Predicates::orient3d`] in floating point, and a bound of its error.
#[inline(always)]
pub(crate) fn volume([a, b, c, d]: [Point; 4]) -> (f64, f64) {
    determinant([a, b, c].map(|p| [p[0] - d[0], p[1] - d[1], p[2] - d[2]]))
}

/// Returns the determinant of three rows, each exact or a difference that was rounded once, and a
/// bound of its error.
///
/// Underflow: the six products of two numbers have an error of at most [`UNDERFLOW`] each, and are
/// multiplied by a difference. The three products of those add as much again.
#[inline(always)]
pub(super) fn determinant([ad, bd, cd]: [Point; 3]) -> (f64, f64) {
    let bc = [bd[0] * cd[1], cd[0] * bd[1]];
    let ca = [cd[0] * ad[1], ad[0] * cd[1]];
    let ab = [ad[0] * bd[1], bd[0] * ad[1]];
    let det = ad[2] * (bc[0] - bc[1]) + bd[2] * (ca[0] - ca[1]) + cd[2] * (ab[0] - ab[1]);
    let permanent = (bc[0].abs() + bc[1].abs()) * ad[2].abs()
        + (ca[0].abs() + ca[1].abs()) * bd[2].abs()
        + (ab[0].abs() + ab[1].abs()) * cd[2].abs();
    let heights = ad[2].abs() + bd[2].abs() + cd[2].abs();
    let bound = ORIENT3D_BOUND * permanent + UNDERFLOW * heights + UNDERFLOW;
    (det, bound)
}

/// Returns true if expansions of products of three such numbers neither overflow nor underflow. A
/// number of at least `2^-280` is a multiple of `2^-332`, so a product of three differences is a
/// multiple of `2^-996`. At the other end, such a product stays below `2^906`.
fn is_in_expansion_range(x: &f64) -> bool {
    const SMALLEST: f64 = pow2(-280);
    const LARGEST: f64 = pow2(300);
    *x == 0.0 || (SMALLEST..=LARGEST).contains(&x.abs())
}

/// Returns the sign: -1, 0 or 1.
fn sign(x: f64) -> i32 {
    i32::from(x > 0.0) - i32::from(x < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Coordinates that provoke ties and near-ties: small integers, neighbours of decimal
    /// fractions, and any float.
    fn coordinate() -> impl Strategy<Value = f64> {
        prop_oneof![
            (-3i32..=3).prop_map(f64::from),
            (1i32..=7, -2i32..=2).prop_map(|(k, ulps)| {
                (0..ulps.abs()).fold(f64::from(k) * 0.1, |x, _| {
                    if ulps > 0 { x.next_up() } else { x.next_down() }
                })
            }),
            (-1e3f64..1e3),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        /// The methods agree, so each of them is exact.
        #[test]
        fn all_methods_agree(p in prop::array::uniform12(coordinate())) {
            let q = |k: usize| [p[3 * k], p[3 * k + 1], p[3 * k + 2]];
            let r = |k: usize| [p[2 * k], p[2 * k + 1]];
            let mut predicates = Predicates::default();
            let (a, b, c, d) = (q(0), q(1), q(2), q(3));
            prop_assert_eq!(predicates.orient3d(a, b, c, d), big::orient3d(a, b, c, d));
            prop_assert_eq!(predicates.orient2d(r(0), r(1), r(2)), big::orient2d(r(0), r(1), r(2)));
            prop_assert_eq!(predicates.orient3d(a, b, c, d), -predicates.orient3d(b, a, c, d));
            let turned = predicates.orient2d(r(1), r(2), r(0));
            prop_assert_eq!(predicates.orient2d(r(0), r(1), r(2)), turned);
        }

        /// Numbers with all exponents, so that products overflow and underflow in every way.
        #[test]
        fn the_filter_is_right_for_all_exponents(
            p in prop::array::uniform12((coordinate(), -1020i32..=1010)),
            near in 0i32..60,
        ) {
            let near = near - 30;
            let exponents = [-990, -680, -510, -340, -300, 335, 500].map(Some);
            for common in [None].into_iter().chain(exponents) {
                let x = p.map(|(x, e)| x * 2f64.powi(common.map_or(e, |c: i32| c + near)));
                prop_assume!(x.iter().all(|x| x.is_finite()));
                let q = |k: usize| [x[3 * k], x[3 * k + 1], x[3 * k + 2]];
                let r = |k: usize| [x[2 * k], x[2 * k + 1]];
                let mut predicates = Predicates::default();
                let (a, b, c, d) = (q(0), q(1), q(2), q(3));
                prop_assert_eq!(predicates.orient3d(a, b, c, d), big::orient3d(a, b, c, d));
                let expected = big::orient2d(r(0), r(1), r(2));
                prop_assert_eq!(predicates.orient2d(r(0), r(1), r(2)), expected);
            }
        }
    }

    #[test]
    fn extreme_exponents_are_decided() {
        let tiny = f64::from_bits(1);
        let mut p = Predicates::default();
        assert_eq!(p.orient2d([0.0, 0.0], [tiny, 0.0], [0.0, tiny]), 1);
        assert_eq!(p.orient2d([0.0, 0.0], [tiny, 0.0], [f64::MAX, tiny]), 1);
        assert_eq!(
            p.orient2d([0.0, 0.0], [f64::MAX, f64::MAX], [tiny, tiny]),
            0
        );
        let (o, x) = ([0.0; 3], [f64::MAX, 0.0, 0.0]);
        let (y, z) = ([0.0, tiny, 0.0], [0.0, 0.0, tiny]);
        assert_eq!(p.orient3d(x, y, z, o), 1);
        assert!(p.exact >= 3);
    }

    #[test]
    fn the_filter_decides_clear_cases_itself() {
        let mut p = Predicates::default();
        assert_eq!(p.orient2d([0.0, 0.0], [1.0, 0.0], [0.0, 1.0]), 1);
        assert_eq!(p.exact, 0);
        assert_eq!(p.orient2d([0.0, 0.0], [1.0, 1.0], [2.0, 2.0]), 0);
        assert_eq!(p.exact, 1);
    }
}
