//! Operations on vectors of three numbers.
//!
//! Error bounds rely on the order of operations, which is fixed: sums are added from the first
//! component to the last, each product is rounded before it is added, and nothing is fused. All
//! functions are `#[inline(always)]`, so that code which is compiled for vector instructions may
//! use them (see [`crate::simd`]).

use super::Point;
use std::ops::{Add, Mul, Range, Sub};

/// Returns the vector whose component `x` is `of(x)`. The compiler does not always inline the
/// `map` of an array, nor what it calls.
#[inline(always)]
pub(crate) fn per_axis<T>(mut of: impl FnMut(usize) -> T) -> [T; 3] {
    [of(0), of(1), of(2)]
}

/// Returns `a + b`.
#[inline(always)]
pub(crate) fn add<T: Copy + Add<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Returns `a - b`.
#[inline(always)]
pub(crate) fn sub<T: Copy + Sub<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Returns `a + t b`.
#[inline(always)]
pub(crate) fn add_scaled<T: Copy + Add<Output = T> + Mul<Output = T>>(
    a: [T; 3],
    t: T,
    b: [T; 3],
) -> [T; 3] {
    [a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]]
}

/// Returns `(1 - t) a + t b`.
#[inline(always)]
pub(crate) fn mix(a: Point, b: Point, t: f64) -> Point {
    per_axis(|x| (1.0 - t) * a[x] + t * b[x])
}

/// Returns `a / 2 - b / 2`. The difference of two finite numbers may overflow, half of it does not.
#[inline(always)]
pub(crate) fn half_difference(a: Point, b: Point) -> Point {
    per_axis(|x| 0.5 * a[x] - 0.5 * b[x])
}

/// Returns `a . b`, as `(a0 b0 + a1 b1) + a2 b2`.
#[inline(always)]
pub(crate) fn dot<T: Copy + Add<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns `a x b`.
#[inline(always)]
pub(crate) fn cross<T: Copy + Sub<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Returns the length of a vector whose squares neither overflow nor underflow.
#[inline(always)]
pub(crate) fn norm(v: Point) -> f64 {
    dot(v, v).sqrt()
}

/// Squared lengths of vectors whose squares neither overflow nor underflow.
pub(crate) const SQUARES: Range<f64> = 1e-290..1e290;

/// Returns the length of any vector.
#[inline]
pub(crate) fn hypot(v: Point) -> f64 {
    let squared = dot(v, v);
    match SQUARES.contains(&squared) {
        true => squared.sqrt(),
        false => v[0].hypot(v[1]).hypot(v[2]),
    }
}

/// Returns the distance of two points, the squares of whose differences neither overflow nor
/// underflow.
#[inline(always)]
pub(crate) fn distance(a: Point, b: Point) -> f64 {
    norm(sub(a, b))
}

/// Returns a rounded sum and its error, which is a floating-point number (Knuth). The error is NaN
/// if the sum overflows.
#[inline(always)]
pub(crate) fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let part = sum - a;
    (sum, (a - (sum - part)) + (b - part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cross_product_is_orthogonal_and_right_handed() {
        let (a, b) = ([1, 2, 3], [-4, 5, 6]);
        let c = cross(a, b);
        assert_eq!((dot(a, c), dot(b, c)), (0, 0));
        assert_eq!(cross([1, 0, 0], [0, 1, 0]), [0, 0, 1]);
        assert_eq!(dot(c, c), dot(a, a) * dot(b, b) - dot(a, b) * dot(a, b));
    }

    #[test]
    fn lengths_agree_and_extreme_ones_do_not_overflow() {
        let v = [2.0, 3.0, 6.0];
        assert_eq!((norm(v), hypot(v), distance(v, [0.0; 3])), (7.0, 7.0, 7.0));
        for scale in [1e200, 1e-200] {
            let length = hypot(v.map(|x| x * scale)) / scale;
            assert!((length - 7.0).abs() < 1e-14, "{length}");
        }
        let most = [f64::MAX; 3];
        assert_eq!(half_difference(most, most.map(|x| -x)), most);
    }
}
