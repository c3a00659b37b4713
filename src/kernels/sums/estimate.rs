//! Result of the kernels that sum angles: a value and a proven error bound.

use crate::pairs::Pair;
use rayon::prelude::*;
use std::fmt;

/// A Gauss integral (a linking number, for example) or a twist, as computed by a sum. The true
/// number differs from `value` by at most `bound`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Estimate {
    /// Sum of the angles, divided by 4 pi.
    pub value: f64,
    /// Proven error bound, of rounding and of every approximation. Infinite if nothing is known,
    /// for example for curves that touch.
    pub bound: f64,
}

impl Estimate {
    /// Estimate of an unknown number: its bound is infinite.
    pub const UNKNOWN: Estimate = Estimate::new(0.0, f64::INFINITY);

    /// Returns the estimate of a number within `bound` of `value`.
    pub(crate) const fn new(value: f64, bound: f64) -> Estimate {
        Estimate { value, bound }
    }

    /// Returns the sum of two numbers. The bound covers its rounding.
    pub(crate) fn plus(self, other: Estimate) -> Estimate {
        let value = self.value + other.value;
        let rounding = f64::EPSILON * value.abs();
        Estimate::new(value, 1.000_001 * (self.bound + other.bound + rounding))
    }

    /// Returns the negative number.
    pub(crate) fn negated(self) -> Estimate {
        Estimate::new(-self.value, self.bound)
    }

    /// Returns true if the bound admits the number `x`.
    #[cfg(test)]
    pub(crate) fn admits(&self, x: f64) -> bool {
        (self.value - x).abs() <= self.bound
    }

    /// Returns the only integer within the bound. Returns `None` if there are several integers, or
    /// if there is none (then the kernel returned a wrong bound).
    pub fn integer(&self) -> Option<i64> {
        /// Doubles above this do not distinguish neighbouring integers.
        const LARGEST: f64 = 4_503_599_627_370_496.0;
        let (lo, hi) = (self.value - self.bound, self.value + self.bound);
        // The rounding error of either end is less than its last place.
        let slack = 1e-15 * (self.value.abs() + self.bound);
        let (first, last) = ((lo - slack).ceil(), (hi + slack).floor());
        (first == last && first.abs() < LARGEST).then_some(first as i64)
    }
}

impl fmt::Display for Estimate {
    /// Formats the value with its bound, and with as many digits as the bound warrants.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Estimate { value, bound } = self;
        if !bound.is_finite() {
            return write!(f, "unknown");
        }
        let digits = (-bound.max(1e-15).log10()).ceil().clamp(0.0, 15.0) as usize + 1;
        write!(f, "{value:.digits$} ± {bound:.1e}")
    }
}

/// A kernel that sums angles, at a given accuracy, prepared for all pairs of a set of polylines.
///
/// Splines are converted to polylines first ([`crate::homotopic_polylines`]), with the same linking
/// numbers. The order of summation does not depend on the number of threads.
///
/// A kernel implements one of the two methods: the second one if all pairs together take less time
/// than one by one.
pub(crate) trait Summation: Send + Sync {
    /// Returns the linking number of two different closed curves.
    fn linking_number(&self, pair: Pair) -> Estimate {
        self.linking_numbers(&[pair])[0]
    }

    /// Returns the linking numbers of several pairs, in their order.
    fn linking_numbers(&self, pairs: &[Pair]) -> Vec<Estimate> {
        let each = pairs.par_iter().map(|&pair| self.linking_number(pair));
        each.collect()
    }
}

impl<F: Fn(Pair) -> Estimate + Send + Sync> Summation for F {
    fn linking_number(&self, pair: Pair) -> Estimate {
        self(pair)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shows_the_digits_that_the_bound_warrants() {
        let shown = |value, bound| Estimate { value, bound }.to_string();
        assert_eq!(shown(-1.23456789, 3e-4), "-1.23457 ± 3.0e-4");
        assert_eq!(shown(2.0, 1.5), "2.0 ± 1.5e0");
        assert_eq!(Estimate::UNKNOWN.to_string(), "unknown");
    }

    #[test]
    fn returns_an_integer_only_if_the_bound_admits_no_other() {
        let integer = |value, bound| Estimate { value, bound }.integer();
        assert_eq!(integer(0.9, 0.2), Some(1));
        assert_eq!(integer(-2.9, 0.2), Some(-3));
        assert_eq!(integer(0.5, 0.4), None);
        assert_eq!(integer(0.5, 0.6), None);
        assert_eq!(integer(0.0, 1.0), None);
        assert_eq!(integer(1e16, 0.1), None);
        assert_eq!(integer(f64::NAN, 0.1), None);
        assert_eq!(integer(1.0, f64::NAN), None);
        assert_eq!(Estimate::UNKNOWN.integer(), None);
        // At the end of the interval both integers are possible.
        assert_eq!(integer(0.6, 0.4), Some(1));
        assert_eq!(integer(0.5, 0.5), None);
    }
}
