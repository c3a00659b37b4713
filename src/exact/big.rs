//! Orientation predicates in big integers: exact for all finite doubles, whatever their exponents.
//! Slow, and rarely needed.

use super::predicates::Orientation;
use crate::curve::vector::per_axis;
use crate::curve::{Point, SumPoint, TERMS, single};
use num_bigint::{BigInt, Sign};
use std::cmp::Ordering;

/// A point in units of a power of two that all points of a test share.
pub(super) type BigPoint = [BigInt; 3];

/// Returns a number as mantissa and exponent, `mantissa * 2^exponent` with an odd mantissa; `None`
/// for 0.
fn split(x: f64) -> Option<(i64, i32)> {
    let bits = x.to_bits();
    let exponent = ((bits >> 52) & 0x7ff) as i32;
    let fraction = (bits & ((1 << 52) - 1)) as i64;
    let mantissa = match exponent {
        0 => fraction,
        _ => fraction | 1 << 52,
    };
    let zeros = mantissa.trailing_zeros();
    let odd = mantissa.checked_shr(zeros)?;
    let signed = if x < 0.0 { -odd } else { odd };
    Some((signed, exponent.max(1) + zeros as i32))
}

/// Returns points whose coordinates are sums as integers in units of a common power of two: the
/// largest one possible, so that the integers stay short.
pub(super) fn points<const N: usize>(points: [SumPoint; N]) -> [BigPoint; N] {
    let all = points.as_flattened().as_flattened().iter();
    // Without an exponent, all numbers are 0.
    let lowest = all.filter_map(|&x| split(x)).map(|(_, e)| e).min();
    let lowest = lowest.unwrap_or(0);
    let sum = |terms: [f64; TERMS]| {
        let terms = terms.into_iter().filter_map(split);
        let terms = terms.map(|(mantissa, e)| BigInt::from(mantissa) << (e - lowest));
        terms.sum()
    };
    points.map(|p| p.map(sum))
}

/// Returns the sign: -1, 0 or 1.
pub(super) fn sign(x: &BigInt) -> i32 {
    match x.sign() {
        Sign::Minus => -1,
        Sign::NoSign => 0,
        Sign::Plus => 1,
    }
}

/// Orientation predicates of points in a common unit.
#[derive(Debug, Default)]
pub(super) struct BigPredicates;

impl Orientation for BigPredicates {
    type Point = BigPoint;

    fn orient2d(&mut self, [a, b, c]: [&BigPoint; 3], (u, v): (usize, usize)) -> i32 {
        let left = (&a[u] - &c[u]) * (&b[v] - &c[v]);
        let right = (&a[v] - &c[v]) * (&b[u] - &c[u]);
        sign(&(left - right))
    }

    fn orient3d(&mut self, [a, b, c, d]: [&BigPoint; 4]) -> i32 {
        let [a, b, c] = [a, b, c].map(|p| per_axis(|x| &p[x] - &d[x]));
        let minor = |p: &BigPoint, q: &BigPoint| &p[0] * &q[1] - &q[0] * &p[1];
        sign(&(&a[2] * minor(&b, &c) + &b[2] * minor(&c, &a) + &c[2] * minor(&a, &b)))
    }

    fn compare(p: &BigPoint, q: &BigPoint, axis: usize) -> Ordering {
        p[axis].cmp(&q[axis])
    }
}

/// See [`super::Predicates::orient2d`].
pub(super) fn orient2d(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> i32 {
    let [a, b, c] = points([a, b, c].map(|p| [p[0], p[1], 0.0].map(single)));
    BigPredicates.orient2d([&a, &b, &c], (0, 1))
}

/// See [`super::Predicates::orient3d`].
pub(super) fn orient3d(a: Point, b: Point, c: Point, d: Point) -> i32 {
    let [a, b, c, d] = points([a, b, c, d].map(|p| p.map(single)));
    BigPredicates.orient3d([&a, &b, &c, &d])
}
