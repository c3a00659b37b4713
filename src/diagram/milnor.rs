//! Milnor's triple linking number, from the Gauss code.
//!
//! # Derivation
//!
//! At a crossing of sign `e` below an arc `o`, the Wirtinger relation is `b = o^-e a o^e` for the
//! incoming and the outgoing arc. So an arc of component `i` is `l^-1 x l`, where `x` is its first
//! arc, and `l` the product of `o^e` over the crossings passed below since. The longitude of a
//! component is this product over all its crossings. `mu(123)` is the coefficient of `X1 X2` in the
//! Magnus expansion `x = 1 + X` of the longitude of component 3 (Milnor 1957, *Isotopy of links*).
//!
//! Up to degree 2, and without squares, an arc of component 1 is
//! `(1 - k X2) (1 + X1) (1 + k X2) = 1 + X1 + k (X1 X2 - X2 X1)`, where `k` is the sum of the signs
//! of the crossings below component 2 that were passed since the first arc; likewise with 1 and 2
//! exchanged. The inverse has the opposite terms. So
//!
//! `mu(123) = sum e f + sum e k12 - sum f k21`,
//!
//! over crossings of component 3 below component 1 (sign `e`) and component 2 (sign `f`): the
//! first sum over pairs with the former first. This is the Gauss diagram formula of Polyak 1997
//! (*On Milnor's triple linking number*, C. R. Acad. Sci. Paris 325). It depends on the first arcs
//! by multiples of the pairwise linking numbers, so that it is an invariant modulo their greatest
//! common divisor. It changes its sign if two components are exchanged or one is reversed.

use super::{Diagram, TripleLink};
use std::collections::BTreeMap;

/// A passage of a component below another one.
pub(super) struct Below {
    /// Position of the passage in its component, and position of the passage above it in the other
    /// one.
    at: u32,
    above_at: u32,
    sign: i64,
    /// Sum of the signs of the passages of these two components up to this one.
    sum: i64,
}

/// The passages of each component below each other one, in order: of the first below the second.
pub(super) type AllBelow = BTreeMap<(u32, u32), Vec<Below>>;

impl Diagram {
    /// Returns the passages of different components below one another.
    pub(super) fn all_below(&self) -> AllBelow {
        let positions = self.positions();
        let mut all = AllBelow::new();
        for (component, passages) in (0..).zip(&self.components) {
            for (at, &passage) in (0..).zip(passages) {
                let (above, above_at) = positions[passage as usize ^ 1];
                if passage % 2 == 1 || above == component {
                    continue;
                }
                let passed = all.entry((component, above)).or_default();
                let sign = i64::from(self.signs[passage as usize / 2]);
                let sum = sign + passed.last().map_or(0, |last: &Below| last.sum);
                passed.push(Below {
                    at,
                    above_at,
                    sign,
                    sum,
                });
            }
        }
        all
    }
}

/// Returns Milnor's number of three components, before it is reduced by the greatest common divisor
/// of their linking numbers.
pub(super) fn triple(all: &AllBelow, [first, second, third]: [u32; 3]) -> i64 {
    let of = |below: u32, above: u32| all.get(&(below, above)).map_or(&[][..], |passed| passed);
    // Sum of the signs of the passages before a position.
    let before = |passed: &[Below], at: u32| {
        let k = passed.partition_point(|passage| passage.at < at);
        if k == 0 { 0 } else { passed[k - 1].sum }
    };
    let (below_first, below_second) = (of(third, first), of(third, second));
    let (k12, k21) = (of(first, second), of(second, first));
    let ones = below_first.iter().map(|p| p.sign * before(k12, p.above_at));
    let other = |p: &Below| p.sign * (before(below_first, p.at) - before(k21, p.above_at));
    ones.chain(below_second.iter().map(other)).sum()
}

impl std::fmt::Display for TripleLink {
    /// Writes the number, `mu(0,1,2) = 1`, with its modulus if that is not 0.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [i, j, k] = self.curves;
        write!(f, "mu({i},{j},{k}) = {}", self.mu)?;
        match self.modulus {
            0 => Ok(()),
            n => write!(f, " mod {n}"),
        }
    }
}
