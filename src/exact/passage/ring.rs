//! Ordered rings: the integers, and the integers with an infinitesimal.

use super::super::big;
use num_bigint::BigInt;
use std::collections::BTreeMap;

/// An ordered commutative ring without zero divisors.
///
/// Sturm's theorem, and the signs at the roots of quadratic polynomials, require no more of their
/// coefficients: both hold over the real closure of the field of fractions of the ring.
pub(super) trait Ring: Clone + From<BigInt> {
    fn sign(&self) -> i32;
    fn plus(&self, other: &Self) -> Self;
    fn minus(&self, other: &Self) -> Self;
    fn times(&self, other: &Self) -> Self;

    fn zero() -> Self {
        Self::from(BigInt::ZERO)
    }
}

impl Ring for BigInt {
    fn sign(&self) -> i32 {
        big::sign(self)
    }

    fn plus(&self, other: &Self) -> Self {
        self + other
    }

    fn minus(&self, other: &Self) -> Self {
        self - other
    }

    fn times(&self, other: &Self) -> Self {
        self * other
    }
}

/// A polynomial in `e` with integer coefficients. The order is that of an `e` that is positive and
/// smaller than every positive rational: the sign is that of the lowest term. It equals the sign of
/// the value at every sufficiently small positive number `e`.
///
/// Stores the nonzero coefficients by their exponents.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Infinitesimal(BTreeMap<u32, BigInt>);

impl Infinitesimal {
    /// Returns `coefficient * e^exponent`.
    pub fn term(exponent: u32, coefficient: BigInt) -> Self {
        Self::normal([(exponent, coefficient)].into())
    }

    /// Returns the exponent of the lowest term.
    pub fn order(&self) -> Option<u32> {
        self.0.keys().next().copied()
    }

    /// Returns the coefficient of `e^exponent`.
    pub fn coefficient(&self, exponent: u32) -> BigInt {
        self.0.get(&exponent).cloned().unwrap_or_default()
    }

    /// Changes the coefficients by those of the other number.
    fn each(&self, other: &Self, change: impl Fn(&mut BigInt, &BigInt)) -> Self {
        let mut terms = self.0.clone();
        for (&k, x) in &other.0 {
            change(terms.entry(k).or_default(), x);
        }
        Self::normal(terms)
    }

    fn normal(mut terms: BTreeMap<u32, BigInt>) -> Self {
        terms.retain(|_, coefficient| big::sign(coefficient) != 0);
        Infinitesimal(terms)
    }
}

impl From<BigInt> for Infinitesimal {
    fn from(x: BigInt) -> Self {
        Self::term(0, x)
    }
}

impl Ring for Infinitesimal {
    fn sign(&self) -> i32 {
        self.0.values().next().map_or(0, big::sign)
    }

    fn plus(&self, other: &Self) -> Self {
        self.each(other, |own, x| *own += x)
    }

    fn minus(&self, other: &Self) -> Self {
        self.each(other, |own, x| *own -= x)
    }

    fn times(&self, other: &Self) -> Self {
        let mut products = BTreeMap::<u32, BigInt>::new();
        for (i, x) in &self.0 {
            for (j, y) in &other.0 {
                *products.entry(i + j).or_default() += x * y;
            }
        }
        Self::normal(products)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn infinitesimal() -> impl Strategy<Value = Infinitesimal> {
        let terms = prop::collection::vec((0u32..12, -5i64..=5), 0..5);
        terms.prop_map(|terms| {
            let terms = terms
                .into_iter()
                .map(|(k, c)| Infinitesimal::term(k, c.into()));
            terms.fold(Infinitesimal::zero(), |a, b| a.plus(&b))
        })
    }

    /// Value at `e = 2^-64`, times a power of two. Coefficients in this test are far below `2^64`.
    fn value(x: &Infinitesimal) -> BigInt {
        let terms = x.0.iter().map(|(k, c)| c << (64 * (32 - k)));
        terms.fold(BigInt::ZERO, |a, b| a + b)
    }

    proptest! {
        #[test]
        fn arithmetic_and_order_are_those_of_a_small_number(
            x in infinitesimal(), y in infinitesimal(), z in infinitesimal()
        ) {
            prop_assert_eq!(x.sign(), big::sign(&value(&x)));
            prop_assert_eq!(value(&x.plus(&y)), value(&x) + value(&y));
            prop_assert_eq!(value(&x.minus(&y)), value(&x) - value(&y));
            prop_assert_eq!(value(&x.times(&y)) << (64u32 * 32), value(&x) * value(&y));
            prop_assert_eq!(x.times(&y).sign(), x.sign() * y.sign());
            prop_assert_eq!(x.times(&y.plus(&z)), x.times(&y).plus(&x.times(&z)));
            prop_assert_eq!(x.minus(&x), Infinitesimal::zero());
            prop_assert_eq!(x.order(), x.0.first_key_value().map(|t| *t.0));
            prop_assert!(x.0.values().all(|c| big::sign(c) != 0));
        }
    }
}
