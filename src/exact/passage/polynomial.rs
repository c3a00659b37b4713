//! Polynomials in the time of the step: their roots, and the signs of other polynomials at these
//! roots.

use super::super::big;
use super::ring::Ring;
use crate::curve::vector::per_axis;
use num_bigint::BigInt;

/// A rational time `numerator / 2^exponent`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Dyadic {
    numerator: BigInt,
    exponent: u32,
}

impl Dyadic {
    pub fn new(numerator: impl Into<BigInt>, exponent: u32) -> Self {
        Dyadic {
            numerator: numerator.into(),
            exponent,
        }
    }

    /// Returns `self + (other - self) * eighths / 8`.
    fn toward(&self, other: &Dyadic, eighths: u32) -> Dyadic {
        let exponent = self.exponent.max(other.exponent);
        let [from, to] = [self, other].map(|d| &d.numerator << (exponent - d.exponent));
        let twos = eighths.trailing_zeros().min(3);
        let (weight, parts) = (eighths >> twos, 8 >> twos);
        Dyadic {
            numerator: from * (parts - weight) + to * weight,
            exponent: exponent + 3 - twos,
        }
    }

    /// Returns true if both are the same time.
    fn is(&self, other: &Dyadic) -> bool {
        &self.numerator << other.exponent == &other.numerator << self.exponent
    }

    /// Returns a polynomial that is positive after this time and negative before it.
    pub fn linear_factor<R: Ring>(&self) -> Polynomial<R> {
        let slope = BigInt::from(1) << self.exponent;
        Polynomial::new([-&self.numerator, slope].map(R::from))
    }
}

/// An open interval of times.
#[derive(Clone, Debug)]
pub(super) struct Interval {
    pub from: Dyadic,
    pub to: Dyadic,
}

impl Interval {
    /// Copies the interval between two times.
    fn between(from: &Dyadic, to: &Dyadic) -> Self {
        let [from, to] = [from, to].map(Dyadic::clone);
        Interval { from, to }
    }

    /// Returns the interval of the whole step.
    pub fn step() -> Self {
        Interval::between(&Dyadic::new(0, 0), &Dyadic::new(1, 0))
    }

    pub fn halves(&self) -> [Interval; 2] {
        self.cut(&self.from.toward(&self.to, 4))
    }

    /// Returns the parts before and after a time.
    fn cut(&self, at: &Dyadic) -> [Interval; 2] {
        [
            Interval::between(&self.from, at),
            Interval::between(at, &self.to),
        ]
    }

    /// Halves this interval until its width is at most a rounding error. Keeps the single simple
    /// root of `f`.
    pub fn narrow<R: Ring>(&mut self, f: &Polynomial<R>) {
        let before = f.sign_at(&self.from);
        while self.is_wide() {
            let middle = self.from.toward(&self.to, 4);
            match f.sign_at(&middle) * before {
                0 => (self.from, self.to) = (middle.clone(), middle),
                1 => self.from = middle,
                _ => self.to = middle,
            }
        }
    }

    /// Shortens this interval until it does not begin at time 0 and does not end at time 1. Keeps
    /// the single simple root of `f`, which is at neither.
    pub fn exclude_ends<R: Ring>(&mut self, f: &Polynomial<R>) {
        let before = f.sign_at(&self.from);
        let ends = Interval::step();
        while self.from.is(&ends.from) || self.to.is(&ends.to) {
            let cut = f.no_root_between(&self.from, &self.to);
            if f.sign_at(&cut) == before {
                self.from = cut;
            } else {
                self.to = cut;
            }
        }
    }

    /// Returns the parts of this interval before the first and after the last of the `inner`
    /// intervals, which are in order, or both halves if there are none.
    pub fn around(&self, inner: &[Interval]) -> [Interval; 2] {
        let (Some(first), Some(last)) = (inner.first(), inner.last()) else {
            return self.halves();
        };
        [
            Interval::between(&self.from, &first.from),
            Interval::between(&last.to, &self.to),
        ]
    }

    /// Returns true if this is wider than `2^-56`.
    fn is_wide(&self) -> bool {
        let (from, to) = (&self.from, &self.to);
        let width = (&to.numerator << from.exponent) - (&from.numerator << to.exponent);
        width << 56 > BigInt::from(1) << (from.exponent + to.exponent)
    }

    /// Returns the midpoint, with an error of at most 2^-53.
    pub fn middle(&self) -> f64 {
        let d = self.from.toward(&self.to, 4);
        // 62 fractional bits: truncation changes less than 2^-62, and the result fits into a `u64`.
        let bits = u64::try_from((d.numerator << 62u32) >> d.exponent);
        bits.map_or(0.0, |bits| bits as f64 / (1u64 << 62) as f64)
    }
}

/// Coefficients, the constant term first. The last one is not 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Polynomial<R>(Vec<R>);

impl<R: Ring> Polynomial<R> {
    pub fn new(coefficients: impl IntoIterator<Item = R>) -> Self {
        let mut coefficients: Vec<R> = coefficients.into_iter().collect();
        while coefficients.last().is_some_and(|c| c.sign() == 0) {
            coefficients.pop();
        }
        Polynomial(coefficients)
    }

    pub fn is_zero(&self) -> bool {
        self.0.is_empty()
    }

    pub fn coefficients(&self) -> &[R] {
        &self.0
    }

    /// Returns the coefficient of `t^k`.
    pub fn coefficient(&self, k: usize) -> R {
        self.0.get(k).cloned().unwrap_or_else(R::zero)
    }

    fn each(&self, other: &Self, f: impl Fn(&R, &R) -> R) -> Self {
        let n = self.0.len().max(other.0.len());
        Self::new((0..n).map(|k| f(&self.coefficient(k), &other.coefficient(k))))
    }

    pub fn plus(&self, other: &Self) -> Self {
        self.each(other, R::plus)
    }

    pub fn minus(&self, other: &Self) -> Self {
        self.each(other, R::minus)
    }

    pub fn times(&self, other: &Self) -> Self {
        if self.is_zero() || other.is_zero() {
            return Polynomial(Vec::new());
        }
        let mut out = vec![R::zero(); self.0.len() + other.0.len() - 1];
        for (i, x) in self.0.iter().enumerate() {
            for (j, y) in other.0.iter().enumerate() {
                out[i + j] = out[i + j].plus(&x.times(y));
            }
        }
        Self::new(out)
    }

    fn derivative(&self) -> Self {
        let terms = self.0.iter().enumerate().skip(1);
        Self::new(terms.map(|(k, c)| c.times(&R::from(BigInt::from(k)))))
    }

    /// Returns the sign of the value at `t`.
    pub fn sign_at(&self, t: &Dyadic) -> i32 {
        // Horner's rule, multiplied by the denominator.
        let mut value = R::zero();
        let mut denominator = BigInt::from(1);
        for c in self.0.iter().rev() {
            value = value
                .times(&R::from(t.numerator.clone()))
                .plus(&c.times(&R::from(denominator.clone())));
            denominator <<= t.exponent;
        }
        value.sign()
    }

    /// Returns quotient and remainder of a positive multiple of this polynomial by `divisor`, which
    /// is not 0.
    fn divided(&self, divisor: &Self) -> (Self, Self) {
        let lead = &divisor.0[divisor.0.len() - 1];
        let side = R::from(BigInt::from(lead.sign()));
        let magnitude = lead.times(&side);
        let mut rest = self.clone();
        let mut quotient = Polynomial(Vec::new());
        while rest.0.len() >= divisor.0.len() {
            let mut term = vec![R::zero(); rest.0.len() - divisor.0.len()];
            term.push(rest.0[rest.0.len() - 1].times(&side));
            let (term, scale) = (Polynomial(term), Self::new([magnitude.clone()]));
            rest = rest.times(&scale).minus(&term.times(divisor));
            quotient = quotient.times(&scale).plus(&term);
        }
        (quotient, rest)
    }

    /// Returns this polynomial, which is not 0, without its roots at the times 0 and 1. The result
    /// has the same sign between them.
    pub fn without_roots_at_ends(mut self) -> Self {
        let number = |n: i32| R::from(BigInt::from(n));
        for (end, factor) in [(0, [0, 1]), (1, [1, -1])] {
            while self.sign_at(&Dyadic::new(end, 0)) == 0 {
                self = self.divided(&Self::new(factor.map(number))).0;
            }
        }
        self
    }

    /// Returns the sum of the signs of `other` at the distinct roots in `interval`. The ends must
    /// not be roots.
    ///
    /// # Theorem (Sturm and Tarski)
    ///
    /// Let `f` be this polynomial and `g` the other one. The sum equals the number of sign changes
    /// along the signed remainder sequence of `f` and `f' g` at the start of the interval, minus
    /// that number at its end (Basu, Pollack and Roy 2006, *Algorithms in Real Algebraic Geometry*,
    /// Theorem 2.73). Entries that are 0 at an end are skipped there. Their neighbours have
    /// opposite signs, because the end is not a root of the last entry, which divides `f`.
    pub fn signs_at_roots(&self, other: &Self, interval: &Interval) -> i32 {
        index(self, &self.derivative().times(other), interval)
    }

    /// Returns a time between two others that is no root of this polynomial, whose degree is at
    /// most 3.
    fn no_root_between(&self, from: &Dyadic, to: &Dyadic) -> Dyadic {
        [4, 3, 5, 2]
            .map(|eighths| from.toward(to, eighths))
            .into_iter()
            .find(|t| self.sign_at(t) != 0)
            .expect("a cubic has three roots at most")
    }

    /// Splits `interval` into parts with one root each, in chronological order. The polynomial must
    /// have a degree of at most 3, no multiple roots, and no roots at the ends.
    pub fn isolate(&self, interval: Interval, found: &mut Vec<Interval>) {
        let one = Self::new([R::from(BigInt::from(1))]);
        match self.signs_at_roots(&one, &interval) {
            0 => {}
            1 => found.push(interval),
            _ => {
                let between = self.no_root_between(&interval.from, &interval.to);
                for part in interval.cut(&between) {
                    self.isolate(part, found);
                }
            }
        }
    }
}

impl Polynomial<BigInt> {
    /// Returns a polynomial with the same roots, all of them simple.
    pub fn square_free(&self) -> Self {
        match chain(self.clone(), self.derivative()).pop() {
            Some(common) if common.0.len() > 1 => self.divided(&common.primitive()).0.primitive(),
            _ => self.clone(),
        }
    }

    /// Returns this polynomial divided by the greatest common divisor of its coefficients.
    /// Arithmetic with long integers is slow.
    fn primitive(&self) -> Self {
        let divisor = self.0.iter().fold(BigInt::ZERO, |a, b| {
            let (mut a, mut b) = (a, b.clone());
            while big::sign(&b) != 0 {
                (a, b) = (b.clone(), a % b);
            }
            a
        });
        let magnitude = BigInt::from(divisor.magnitude().clone());
        Polynomial(self.0.iter().map(|c| c / &magnitude).collect())
    }
}

/// Returns the Cauchy index of `g / f` in `interval`: the number of jumps from minus to plus
/// infinity, minus the number of jumps from plus to minus infinity.
pub(super) fn index<R: Ring>(f: &Polynomial<R>, g: &Polynomial<R>, interval: &Interval) -> i32 {
    let chain = chain(f.clone(), g.clone());
    let changes = |t: &Dyadic| {
        let mut last = 0;
        let mut count = 0;
        for sign in chain.iter().map(|p| p.sign_at(t)).filter(|&s| s != 0) {
            count += i32::from(sign == -last);
            last = sign;
        }
        count
    };
    changes(&interval.from) - changes(&interval.to)
}

/// Returns the signed remainder sequence of `f` and `g`, without zeros. The last entry is a
/// greatest common divisor.
fn chain<R: Ring>(f: Polynomial<R>, g: Polynomial<R>) -> Vec<Polynomial<R>> {
    let mut chain = vec![f];
    let mut next = g;
    while !next.is_zero() {
        let rest = chain[chain.len() - 1].divided(&next).1;
        chain.push(next);
        next = Polynomial(Vec::new()).minus(&rest);
    }
    chain
}

/// A root of a polynomial of degree at most 2 at which the polynomial changes its sign:
/// `(x + y sqrt(d)) / z`.
pub(super) struct Root<R> {
    x: R,
    y: R,
    z: R,
    d: R,
    /// Direction of the sign change: 1 from negative to positive, -1 from positive to negative.
    pub direction: i32,
}

impl<R: Ring> Root<R> {
    /// Returns all roots of `f` with a sign change.
    ///
    /// The roots of `a t^2 + b t + c` are `(-b + s sqrt(b^2 - 4ac)) / 2a` with `s` 1 or -1. The
    /// derivative there, `2 a t + b = s sqrt(..)`, has the sign of `s`, whatever the sign of `a`
    /// is.
    pub fn all(f: &Polynomial<R>) -> Vec<Root<R>> {
        let number = |n: i32| R::from(BigInt::from(n));
        let [c, b, a] = per_axis(|k| f.coefficient(k));
        let negated = |x: &R| R::zero().minus(x);
        if a.sign() == 0 {
            return match b.sign() {
                0 => Vec::new(),
                direction => vec![Root {
                    x: negated(&c),
                    y: number(0),
                    z: b,
                    d: number(0),
                    direction,
                }],
            };
        }
        let d = b.times(&b).minus(&number(4).times(&a.times(&c)));
        if d.sign() <= 0 {
            return Vec::new();
        }
        let root = |direction| Root {
            x: negated(&b),
            y: number(direction),
            z: number(2).times(&a),
            d: d.clone(),
            direction,
        };
        vec![root(-1), root(1)]
    }

    /// Returns the sign of `g` at this root.
    pub fn sign_of(&self, g: &Polynomial<R>) -> i32 {
        // Horner's rule for numbers x + y sqrt(d), multiplied by the denominator.
        let (mut p, mut q) = (R::zero(), R::zero());
        let mut scale = R::from(BigInt::from(1));
        let mut side = self.z.sign();
        for c in g.coefficients().iter().rev() {
            (p, q) = (
                p.times(&self.x)
                    .plus(&q.times(&self.y).times(&self.d))
                    .plus(&c.times(&scale)),
                p.times(&self.y).plus(&q.times(&self.x)),
            );
            scale = scale.times(&self.z);
            side *= self.z.sign();
        }
        side * sign_of_surd(&p, &q, &self.d)
    }
}

/// Returns the sign of `p + q sqrt(d)`.
fn sign_of_surd<R: Ring>(p: &R, q: &R, d: &R) -> i32 {
    match (p.sign(), q.sign() * d.sign()) {
        (s, 0) => s,
        (0, s) => s,
        (s, t) if s == t => s,
        (s, _) => s * p.times(p).minus(&q.times(q).times(d)).sign(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::ring::Infinitesimal;
    use super::*;
    use proptest::prelude::*;

    fn polynomial(coefficients: &[i64]) -> Polynomial<BigInt> {
        Polynomial::new(coefficients.iter().map(|&c| BigInt::from(c)))
    }

    fn interval(from: i64, to: i64, exponent: u32) -> Interval {
        Interval {
            from: Dyadic::new(from, exponent),
            to: Dyadic::new(to, exponent),
        }
    }

    /// Numerator and denominator of each root. A root may occur several times.
    fn roots() -> impl Strategy<Value = Vec<(i64, i64)>> {
        prop::collection::vec((-8i64..16, 1i64..9), 1..4)
    }

    fn with_roots(roots: &[(i64, i64)]) -> Polynomial<BigInt> {
        let linear = roots.iter().map(|&(p, q)| polynomial(&[-p, q]));
        linear.fold(polynomial(&[3]), |f, g| f.times(&g))
    }

    /// Distinct roots in the open interval `from / 16 .. to / 16`, in order.
    fn inside(roots: &[(i64, i64)], from: i64, to: i64) -> Vec<(i64, i64)> {
        let mut all: Vec<_> = roots
            .iter()
            .copied()
            .filter(|&(p, q)| from * q < 16 * p && 16 * p < to * q)
            .collect();
        all.sort_by(|a, b| (a.0 * b.1).cmp(&(b.0 * a.1)));
        all.dedup_by(|a, b| a.0 * b.1 == b.0 * a.1);
        all
    }

    fn value_sign(g: &[i64], (p, q): (i64, i64)) -> i32 {
        let n = g.len() as u32;
        let terms = g.iter().enumerate();
        let value: i64 = terms
            .map(|(k, c)| c * p.pow(k as u32) * q.pow(n - k as u32))
            .sum();
        value.signum() as i32
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        /// Sums of signs at known roots, simple or multiple. Some of them are roots of both
        /// polynomials.
        #[test]
        fn signs_at_known_roots_are_summed(
            roots in roots(), g in prop::collection::vec(-9i64..=9, 0..5),
            common in 0usize..4, from in 0i64..8, length in 1i64..9,
        ) {
            let f = with_roots(&roots);
            let to = from + length;
            prop_assume!(!roots.iter().any(|&(p, q)| 16 * p == from * q || 16 * p == to * q));
            let (mut g_polynomial, shared) = (polynomial(&g), roots.get(common));
            if let Some(&(p, q)) = shared {
                g_polynomial = g_polynomial.times(&polynomial(&[-p, q]));
            }
            let sign = |root: (i64, i64)| value_sign(&g, root)
                * shared.map_or(1, |&(p, q)| (root.0 * q - p * root.1).signum() as i32);
            let all = inside(&roots, from, to);
            let want: i32 = all.iter().map(|&root| sign(root)).sum();
            let within = interval(from, to, 4);
            prop_assert_eq!(f.signs_at_roots(&g_polynomial, &within), want);

            // The same, with an infinitesimal factor that changes no sign.
            let lift = |f: &Polynomial<BigInt>| {
                let e = Infinitesimal::term(2, BigInt::from(1));
                let lifted = f.coefficients().iter().map(|c| Infinitesimal::from(c.clone()));
                Polynomial::new(lifted.map(|c| e.times(&c)))
            };
            prop_assert_eq!(lift(&f).signs_at_roots(&lift(&g_polynomial), &within), want);
        }

        /// Every root between the ends of the step gets a separate interval and its time.
        #[test]
        fn isolates_every_root_and_finds_its_time(roots in roots()) {
            let f = with_roots(&roots).without_roots_at_ends();
            let free = f.square_free();
            let mut found = Vec::new();
            free.isolate(Interval::step(), &mut found);
            let want = inside(&roots, 0, 16);
            prop_assert_eq!(found.len(), want.len());
            for (mut interval, (p, q)) in found.into_iter().zip(want) {
                let times = roots.iter().filter(|r| r.0 * q == p * r.1).count();
                let signs = [&interval.from, &interval.to].map(|t| f.sign_at(t));
                prop_assert_eq!(signs[0] * signs[1], if times % 2 == 1 { -1 } else { 1 });
                interval.narrow(&free);
                let time = p as f64 / q as f64;
                prop_assert!((interval.middle() - time).abs() <= f64::EPSILON / 2.0);
            }
        }

        /// Square roots and Sturm's theorem give the same signs for quadratic polynomials.
        #[test]
        fn closed_form_roots_agree_with_sturm(
            f in prop::array::uniform3(-12i64..=12), g in prop::collection::vec(-9i64..=9, 0..5),
            from in 0i64..8, length in 1i64..9,
        ) {
            let (f, g) = (polynomial(&f), polynomial(&g));
            let within = interval(from, from + length, 4);
            prop_assume!(!f.is_zero() && f.sign_at(&within.from) * f.sign_at(&within.to) != 0);
            prop_assume!(f.square_free().coefficients().len() == f.coefficients().len());
            let inside: Vec<_> = Root::all(&f).into_iter().filter(|root| {
                root.sign_of(&within.from.linear_factor()) > 0
                    && root.sign_of(&within.to.linear_factor()) < 0
            }).collect();
            let signs: i32 = inside.iter().map(|root| root.sign_of(&g)).sum();
            prop_assert_eq!(signs, f.signs_at_roots(&g, &within));
            let directed: i32 = inside.iter().map(|root| root.direction * root.sign_of(&g)).sum();
            // At a common root of both polynomials, the index counts no jump, or one of lower
            // order.
            if g.is_zero() || inside.iter().all(|root| root.sign_of(&g) != 0) {
                prop_assert_eq!(directed, index(&f, &g, &within));
            }
        }
    }

    /// The roots of `t^2 - e` are smaller than every positive number, but not smaller than `e`.
    #[test]
    fn infinitesimal_roots_are_between_0_and_every_positive_number() {
        let e = |k: u32| Infinitesimal::term(k, BigInt::from(1));
        let one = e(0);
        let f = Polynomial::new([
            Infinitesimal::zero().minus(&e(1)),
            Infinitesimal::zero(),
            one.clone(),
        ]);
        let roots = Root::all(&f);
        assert_eq!(roots.len(), 2);
        let root = roots.iter().find(|r| r.direction == 1).unwrap();
        assert_eq!(root.sign_of(&Dyadic::new(0, 0).linear_factor()), 1);
        assert_eq!(root.sign_of(&Dyadic::new(1, 1000).linear_factor()), -1);
        let less = |k: u32| Polynomial::new([Infinitesimal::zero().minus(&e(k)), one.clone()]);
        assert_eq!(root.sign_of(&less(1)), 1);
        assert_eq!(root.sign_of(&f), 0);
        assert_eq!(f.signs_at_roots(&less(1), &interval(0, 1, 0)), 1);
        let half = interval(1, 2, 1);
        assert_eq!(f.signs_at_roots(&less(1), &half), 0);
    }
}
