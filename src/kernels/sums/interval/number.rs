//! Intervals of real numbers, rounded outward.

use crate::kernels::Estimate;
use std::f64::consts::PI;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// All numbers from `lo` to `hi`. An operation returns an interval that contains every result for
/// numbers in the operands: each end is rounded to the nearest and then moved outward by one unit
/// in the last place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Interval {
    pub lo: f64,
    pub hi: f64,
}

impl Interval {
    /// The interval of all numbers.
    pub const ENTIRE: Interval = Interval::new(f64::NEG_INFINITY, f64::INFINITY);

    /// The interval that contains 0 only.
    pub const ZERO: Interval = Interval::point(0.0);

    /// Pi. The constant is the nearest number below pi.
    pub const PI: Interval = Interval::new(PI, PI.next_up());

    /// All angles up to half a turn in either direction.
    pub const HALF_TURN: Interval = Interval::new(-Interval::PI.hi, Interval::PI.hi);
    /// Half of pi.
    const HALF_PI: Interval = Interval::new(0.5 * Interval::PI.lo, 0.5 * Interval::PI.hi);

    /// A quarter of pi.
    const QUARTER_PI: Interval = Interval::new(0.25 * Interval::PI.lo, 0.25 * Interval::PI.hi);

    /// Returns the interval of all numbers from `lo` to `hi`.
    pub const fn new(lo: f64, hi: f64) -> Interval {
        Interval { lo, hi }
    }

    /// Returns the interval of a single number.
    pub const fn point(x: f64) -> Interval {
        Interval::new(x, x)
    }

    /// Returns the interval of all numbers whose distance from `x` is at most `radius`.
    pub fn around(x: f64, radius: f64) -> Interval {
        match radius {
            0.0 => Interval::point(x),
            _ => Interval::outward(x - radius, x + radius),
        }
    }

    /// Returns an interval from ends that are rounded to the nearest, moved outward.
    fn outward(lo: f64, hi: f64) -> Interval {
        if lo.is_nan() || hi.is_nan() {
            return Interval::ENTIRE;
        }
        Interval::new(lo.next_down(), hi.next_up())
    }

    /// Returns the middle of the interval, with a bound that covers both ends.
    pub fn estimate(self) -> Estimate {
        let value = 0.5 * self.lo + 0.5 * self.hi;
        if !value.is_finite() {
            return Estimate::UNKNOWN;
        }
        let bound = (self.hi - value).max(value - self.lo).next_up();
        Estimate { value, bound }
    }

    /// Returns true if the interval contains `x`.
    pub fn contains(self, x: f64) -> bool {
        self.lo <= x && x <= self.hi
    }

    /// Returns the only integer in the interval, or `None` if there are several or none.
    #[cfg(test)]
    pub fn integer(self) -> Option<i64> {
        /// Doubles above this do not distinguish neighbouring integers.
        const LARGEST: f64 = 4_503_599_627_370_496.0;
        let (first, last) = (self.lo.ceil(), self.hi.floor());
        (first == last && first.abs() < LARGEST).then_some(first as i64)
    }

    /// Returns the intersection with another interval, which must not be disjoint.
    pub fn within(self, other: Interval) -> Interval {
        Interval::new(self.lo.max(other.lo), self.hi.min(other.hi))
    }

    /// Returns the interval of the squares.
    pub fn square(self) -> Interval {
        let (p, q) = (self.lo * self.lo, self.hi * self.hi);
        let least = match self.contains(0.0) {
            true => 0.0,
            false => p.min(q).next_down(),
        };
        Interval::new(least, p.max(q).next_up())
    }

    /// Returns the interval of the square roots of its non-negative numbers.
    pub fn root(self) -> Interval {
        Interval {
            lo: self.lo.max(0.0).sqrt().next_down().max(0.0),
            hi: self.hi.max(0.0).sqrt().next_up(),
        }
    }

    /// Returns the interval of the arguments of complex numbers, between `-pi` and `pi`. Returns
    /// `None` if one of them may be 0 or negative.
    pub fn argument(real: Interval, imaginary: Interval) -> Option<Interval> {
        if real.lo > 0.0 {
            Some((imaginary / real).arctangent())
        } else if imaginary.lo > 0.0 {
            Some(Interval::HALF_PI - (real / imaginary).arctangent())
        } else if imaginary.hi < 0.0 {
            Some(-Interval::HALF_PI - (real / imaginary).arctangent())
        } else {
            None
        }
    }

    /// Returns the interval of the arctangents, between `-pi/2` and `pi/2`.
    pub fn arctangent(self) -> Interval {
        Interval::new(arctangent(self.lo).lo, arctangent(self.hi).hi)
    }
}

impl Neg for Interval {
    type Output = Interval;

    fn neg(self) -> Interval {
        Interval::new(-self.hi, -self.lo)
    }
}

impl Add for Interval {
    type Output = Interval;

    fn add(self, other: Interval) -> Interval {
        Interval::outward(self.lo + other.lo, self.hi + other.hi)
    }
}

impl Sub for Interval {
    type Output = Interval;

    fn sub(self, other: Interval) -> Interval {
        Interval::outward(self.lo - other.hi, self.hi - other.lo)
    }
}

impl Mul for Interval {
    type Output = Interval;

    fn mul(self, other: Interval) -> Interval {
        span(self, other, |x, y| x * y)
    }
}

impl Div for Interval {
    type Output = Interval;

    /// Returns all numbers if the divisor may be 0.
    fn div(self, other: Interval) -> Interval {
        if other.contains(0.0) {
            return Interval::ENTIRE;
        }
        span(self, other, |x, y| x / y)
    }
}

/// Returns the interval from the minimum to the maximum of the values at the ends of two intervals,
/// which are rounded to the nearest.
fn span(p: Interval, q: Interval, f: impl Fn(f64, f64) -> f64) -> Interval {
    let ends = [f(p.lo, q.lo), f(p.lo, q.hi), f(p.hi, q.lo), f(p.hi, q.hi)];
    if ends.iter().any(|x| x.is_nan()) {
        return Interval::ENTIRE;
    }
    let lo = ends.into_iter().fold(f64::INFINITY, f64::min);
    let hi = ends.into_iter().fold(f64::NEG_INFINITY, f64::max);
    Interval::outward(lo, hi)
}

/// Returns the arctangent of a number, which is not NaN.
///
/// Symmetry about 0 and about 1 reduces the argument to the range from 0 to 1. From 1/3 on,
/// `atan(1/2) = pi/4 - atan(1/3)` is subtracted.
fn arctangent(x: f64) -> Interval {
    if x < 0.0 {
        return -arctangent(-x);
    }
    if x == f64::INFINITY {
        return Interval::HALF_PI;
    }
    let t = Interval::point(x);
    match x > 1.0 {
        true => Interval::HALF_PI - unit_arctangent(Interval::point(1.0) / t),
        false => unit_arctangent(t),
    }
}

/// Returns the arctangent of a narrow interval, approximately within 0 to 1.
fn unit_arctangent(t: Interval) -> Interval {
    let [one, two, three] = [1.0, 2.0, 3.0].map(Interval::point);
    if 3.0 * t.hi <= 1.0 {
        return series(t);
    }
    let half = Interval::QUARTER_PI - series(one / three);
    // A single occurrence of t keeps the interval narrow: 2 - 5 / (2 + t).
    half + series(two - Interval::point(5.0) / (two + t))
}

/// Returns the arctangent of numbers that are at most slightly larger than 1/3, by its series. The
/// series alternates, so the result is between the sums of 16 and of 17 terms.
fn series(t: Interval) -> Interval {
    let s = t.square();
    let mut sum = Interval::ZERO;
    for k in (0..16).rev() {
        let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
        let term = Interval::point(sign) / Interval::point(f64::from(2 * k + 1));
        sum = sum * s + term;
    }
    let power = (0..16).fold(Interval::point(1.0), |p, _| p * s);
    let rest = power / Interval::point(33.0);
    t * (sum + Interval::new(0.0, rest.hi))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_contain_all_results() {
        let all = [-3.0, -0.5, 0.0, 0.1, 2.0];
        for (i, &a) in all.iter().enumerate() {
            for &b in &all[i..] {
                for (k, &c) in all.iter().enumerate() {
                    for &d in &all[k..] {
                        let (p, q) = (Interval { lo: a, hi: b }, Interval { lo: c, hi: d });
                        for x in [a, 0.5 * (a + b), b] {
                            for y in [c, 0.25 * c + 0.75 * d, d] {
                                assert!((p + q).contains(x + y));
                                assert!((p - q).contains(x - y));
                                assert!((p * q).contains(x * y));
                                assert!(y == 0.0 || (p / q).contains(x / y));
                                assert!(p.square().contains(x * x));
                                assert!(x < 0.0 || p.root().contains(x.sqrt()));
                                assert!((-p).contains(-x));
                                assert!(p.arctangent().contains(x.atan()));
                            }
                        }
                    }
                }
            }
        }
        assert_eq!(Interval::ENTIRE * Interval::ZERO, Interval::ENTIRE);
        assert_eq!(Interval::ENTIRE - Interval::ENTIRE, Interval::ENTIRE);
        assert_eq!(Interval::ENTIRE.integer(), None);
        assert_eq!(Interval { lo: 0.2, hi: 0.8 }.integer(), None);
        assert_eq!(Interval { lo: 0.2, hi: 1.8 }.integer(), Some(1));
        assert_eq!(Interval { lo: 0.0, hi: 1.0 }.integer(), None);
    }

    #[test]
    fn arctangents_are_narrow_and_agree_with_the_standard_library() {
        let mut x = 1e-9;
        while x < 1e12 {
            for x in [x, -x] {
                let (found, near) = (arctangent(x), x.atan());
                let two = 2.0 * f64::EPSILON * near.abs();
                assert!(found.lo <= near + two && near - two <= found.hi, "{x}");
                assert!(
                    found.hi - found.lo <= 80.0 * f64::EPSILON * near.abs(),
                    "{x}"
                );
            }
            x *= 1.01;
        }
        assert_eq!(arctangent(0.0).integer(), Some(0));
        assert!(arctangent(f64::INFINITY).contains(std::f64::consts::FRAC_PI_2));
        // Machin's formula checks several arctangents together.
        let four = Interval::point(4.0);
        let pi = four
            * (four * arctangent(0.2)
                - (Interval::point(1.0) / Interval::point(239.0)).arctangent());
        assert!(pi.lo <= Interval::PI.lo && Interval::PI.hi <= pi.hi && pi.hi - pi.lo < 1e-13);
    }
}
