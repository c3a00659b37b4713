//! What kernels that sum angles owe: a value, and a proven bound of its error.

use crate::pairs::Pair;
use rayon::prelude::*;

/// A linking number as a sum gives it: no further than `bound` from the true one.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Estimate {
    /// The sum, divided by 4 pi.
    pub value: f64,
    /// Proven: of rounding and of every approximation. Infinite where nothing is known, as for curves that touch.
    pub bound: f64,
}

impl Estimate {
    /// Nothing is known.
    pub const UNKNOWN: Estimate = Estimate {
        value: 0.0,
        bound: f64::INFINITY,
    };

    /// The only integer within the bound; none where there are several, or none, which is an error of whoever made
    /// the estimate.
    pub fn integer(&self) -> Option<i64> {
        /// Beyond, neighbouring integers are not told apart.
        const LARGEST: f64 = 4_503_599_627_370_496.0;
        let (lo, hi) = (self.value - self.bound, self.value + self.bound);
        // Both ends round by less than their last place.
        let slack = 1e-15 * (self.value.abs() + self.bound);
        let (first, last) = ((lo - slack).ceil(), (hi + slack).floor());
        (first == last && first.abs() < LARGEST).then_some(first as i64)
    }
}

/// A kernel that sums angles, at some accuracy, ready for all pairs of a set of polylines.
///
/// Splines are made polylines first ([`crate::homotopic_polylines`]), with the same linking numbers. Sums are made in an
/// order that does not depend on the number of threads.
pub(crate) trait Summation: Send + Sync {
    /// The linking number of two different closed curves.
    fn linking_number(&self, pair: Pair) -> Estimate;

    /// Those of several pairs, in their order: for kernels that gain from knowing all of them.
    fn linking_numbers(&self, pairs: &[Pair]) -> Vec<Estimate> {
        let each = pairs.par_iter().map(|&pair| self.linking_number(pair));
        each.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_integer_is_given_only_where_it_is_the_only_one() {
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
        // On the edge both are possible.
        assert_eq!(integer(0.6, 0.4), Some(1));
        assert_eq!(integer(0.5, 0.5), None);
    }
}
