//! Orientation predicates in big integers: exact for all finite doubles, whatever their exponents.
//! Slow, and rarely needed.

use crate::curve::Point;
use num_bigint::{BigInt, Sign};

/// Returns the coordinates as integers in units of a common power of two: the largest one possible,
/// so that the integers stay short.
pub(super) fn integers<const N: usize>(values: [f64; N]) -> [BigInt; N] {
    // The number is `mantissa * 2^exponent` with an odd mantissa; `None` for 0.
    let split = |x: f64| {
        let bits = x.to_bits();
        let exponent = ((bits >> 52) & 0x7ff) as i32;
        let fraction = (bits & ((1 << 52) - 1)) as i64;
        let mantissa = if exponent == 0 {
            fraction
        } else {
            fraction | 1 << 52
        };
        let zeros = mantissa.trailing_zeros();
        let odd = mantissa.checked_shr(zeros)?;
        let signed = if x < 0.0 { -odd } else { odd };
        Some((signed, exponent.max(1) + zeros as i32))
    };
    let lowest = values
        .iter()
        .filter_map(|&x| split(x))
        .map(|(_, e)| e)
        .min();
    values.map(|x| match (split(x), lowest) {
        (Some((mantissa, exponent)), Some(lowest)) => BigInt::from(mantissa) << (exponent - lowest),
        _ => BigInt::ZERO,
    })
}

/// Returns the sign: -1, 0 or 1.
pub(super) fn sign(x: &BigInt) -> i32 {
    match x.sign() {
        Sign::Minus => -1,
        Sign::NoSign => 0,
        Sign::Plus => 1,
    }
}

/// See [`super::Predicates::orient2d`].
pub(super) fn orient2d(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> i32 {
    let [ax, ay, bx, by, cx, cy] = integers([a[0], a[1], b[0], b[1], c[0], c[1]]);
    sign(&((ax - &cx) * (by - &cy) - (ay - cy) * (bx - cx)))
}

/// See [`super::Predicates::orient3d`].
pub(super) fn orient3d(a: Point, b: Point, c: Point, d: Point) -> i32 {
    let v = integers([
        a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2], d[0], d[1], d[2],
    ]);
    let diff = |p: usize, x: usize| &v[3 * p + x] - &v[9 + x];
    let minor = |p: usize, q: usize| diff(p, 0) * diff(q, 1) - diff(q, 0) * diff(p, 1);
    sign(&(diff(0, 2) * minor(1, 2) + diff(1, 2) * minor(2, 0) + diff(2, 2) * minor(0, 1)))
}
