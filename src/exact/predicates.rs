//! Orientation of points: the floating-point rung, and the way down to the exact ones.

use super::big;
use crate::curve::Point;
use robust::{Coord, Coord3D};

/// Bound of the rounding error of [`Predicates::orient2d`]'s determinant relative to the sum of the
/// magnitudes of its two products: `(3 + 16 u) u` with `u = 2^-53` (Shewchuk 1997, stage A of ORIENT2D).
pub(crate) const ORIENT2D_BOUND: f64 = (3.0 + 16.0 * U) * U;

/// The same for the three-dimensional determinant, relative to its permanent: `(7 + 56 u) u` (Shewchuk 1997,
/// stage A of ORIENT3D).
pub(crate) const ORIENT3D_BOUND: f64 = (7.0 + 56.0 * U) * U;

/// Half a unit in the last place of 1: largest relative error of one operation.
const U: f64 = f64::EPSILON / 2.0;

/// What underflow can add to the error of a product, generously: a subnormal result is off by at most `2^-1075`.
/// With it the bounds hold for all finite numbers; overflow gives infinities and NaN, which meet no bound.
pub(crate) const UNDERFLOW: f64 = f64::from_bits(1 << 4);

/// Exact orientation predicates, with a count of how often floating point could not decide.
///
/// Signs are three-valued: -1, 0, 1. (`f64::signum` is not: it calls 0.0 positive.)
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Predicates {
    /// Calls that an exact rung decided.
    pub exact: u64,
}

impl Predicates {
    /// Sign of the area of the triangle `a b c`: 1 where it turns counterclockwise, 0 on one line.
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
        if ![a, b, c].as_flattened().iter().all(suits_expansions) {
            return big::orient2d(a, b, c);
        }
        let coord = |p: [f64; 2]| Coord { x: p[0], y: p[1] };
        sign(robust::orient2d(coord(a), coord(b), coord(c)))
    }

    /// Sign of `(a - d) . ((b - d) x (c - d))`; 0 where the four points lie in one plane.
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
        if ![a, b, c, d].as_flattened().iter().all(suits_expansions) {
            return big::orient3d(a, b, c, d);
        }
        let coord = |p: Point| Coord3D {
            x: p[0],
            y: p[1],
            z: p[2],
        };
        sign(robust::orient3d(coord(a), coord(b), coord(c), coord(d)))
    }
}

/// The determinant of [`Predicates::orient3d`] in floating point, and the bound of its error.
///
/// Underflow: the six products of two are off by [`UNDERFLOW`] at most and are multiplied by a difference;
/// the three products of those are off by as much again.
#[inline(always)]
pub(crate) fn volume([a, b, c, d]: [Point; 4]) -> (f64, f64) {
    let [ad, bd, cd] = [a, b, c].map(|p| [p[0] - d[0], p[1] - d[1], p[2] - d[2]]);
    let bc = [bd[0] * cd[1], cd[0] * bd[1]];
    let ca = [cd[0] * ad[1], ad[0] * cd[1]];
    let ab = [ad[0] * bd[1], bd[0] * ad[1]];
    let det = ad[2] * (bc[0] - bc[1]) + bd[2] * (ca[0] - ca[1]) + cd[2] * (ab[0] - ab[1]);
    let permanent = (bc[0].abs() + bc[1].abs()) * ad[2].abs()
        + (ca[0].abs() + ca[1].abs()) * bd[2].abs()
        + (ab[0].abs() + ab[1].abs()) * cd[2].abs();
    let heights = ad[2].abs() + bd[2].abs() + cd[2].abs();
    (
        det,
        ORIENT3D_BOUND * permanent + UNDERFLOW * heights + UNDERFLOW,
    )
}

/// Whether expansions of products of three such numbers neither overflow nor underflow: a number of at least
/// `2^-280` is a multiple of `2^-332`, and a product of three differences one of `2^-996`; at the other end it
/// stays below `2^906`.
fn suits_expansions(x: &f64) -> bool {
    const SMALLEST: f64 = f64::from_bits((1023 - 280) << 52);
    const LARGEST: f64 = f64::from_bits((1023 + 300) << 52);
    *x == 0.0 || (SMALLEST..=LARGEST).contains(&x.abs())
}

/// Three-valued sign.
fn sign(x: f64) -> i32 {
    i32::from(x > 0.0) - i32::from(x < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Coordinates that provoke ties and near-ties: small integers and their neighbours, and any float.
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

        /// The three rungs agree, and none of them guesses.
        #[test]
        fn rungs_agree(p in prop::array::uniform12(coordinate())) {
            let q = |k: usize| [p[3 * k], p[3 * k + 1], p[3 * k + 2]];
            let r = |k: usize| [p[2 * k], p[2 * k + 1]];
            let mut own = Predicates::default();
            let (a, b, c, d) = (q(0), q(1), q(2), q(3));
            prop_assert_eq!(own.orient3d(a, b, c, d), big::orient3d(a, b, c, d));
            prop_assert_eq!(own.orient2d(r(0), r(1), r(2)), big::orient2d(r(0), r(1), r(2)));
            prop_assert_eq!(own.orient3d(a, b, c, d), -own.orient3d(b, a, c, d));
            prop_assert_eq!(own.orient2d(r(0), r(1), r(2)), own.orient2d(r(1), r(2), r(0)));
        }

        /// Numbers of all exponents, so that products overflow and underflow in every way.
        #[test]
        fn no_exponent_misleads_the_filter(
            p in prop::array::uniform12((coordinate(), -1020i32..=1010)),
            near in 0i32..60,
        ) {
            let near = near - 30;
            for common in [None, Some(-990), Some(-680), Some(-510), Some(-340), Some(-300), Some(335), Some(500)] {
                let x = p.map(|(x, e)| x * 2f64.powi(common.map_or(e, |c: i32| c + near)));
                prop_assume!(x.iter().all(|x| x.is_finite()));
                let q = |k: usize| [x[3 * k], x[3 * k + 1], x[3 * k + 2]];
                let r = |k: usize| [x[2 * k], x[2 * k + 1]];
                let mut own = Predicates::default();
                let (a, b, c, d) = (q(0), q(1), q(2), q(3));
                prop_assert_eq!(own.orient3d(a, b, c, d), big::orient3d(a, b, c, d));
                prop_assert_eq!(own.orient2d(r(0), r(1), r(2)), big::orient2d(r(0), r(1), r(2)));
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
    fn the_filter_leaves_clear_cases_to_no_one() {
        let mut p = Predicates::default();
        assert_eq!(p.orient2d([0.0, 0.0], [1.0, 0.0], [0.0, 1.0]), 1);
        assert_eq!(p.exact, 0);
        assert_eq!(p.orient2d([0.0, 0.0], [1.0, 1.0], [2.0, 2.0]), 0);
        assert_eq!(p.exact, 1);
    }
}
