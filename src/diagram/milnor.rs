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

impl Diagram {
    /// Returns Milnor's number of three components, before it is reduced by the greatest common
    /// divisor of their linking numbers.
    pub(super) fn triple(&self, [first, second, third]: [u32; 3], positions: &[(u32, u32)]) -> i64 {
        // Positions and sums of the signs of crossings of one component below another one.
        let passed = |component: u32, above: u32| {
            let mut sum = 0;
            let passages = (0..).zip(&self.components[component as usize]);
            let under = passages.filter(|(_, passage)| **passage % 2 == 0);
            let met = under.filter(|(_, passage)| positions[**passage as usize ^ 1].0 == above);
            met.map(|(at, passage)| {
                sum += i64::from(self.signs[*passage as usize / 2]);
                (at, sum)
            })
            .collect::<Vec<(u32, i64)>>()
        };
        let before = |passed: &[(u32, i64)], at: u32| {
            let k = passed.partition_point(|p| p.0 < at);
            if k == 0 { 0 } else { passed[k - 1].1 }
        };
        let (of_first, of_second) = (passed(first, second), passed(second, first));
        let (mut sum, mut mu) = (0, 0);
        let passages = self.components[third as usize].iter();
        for passage in passages.filter(|passage| *passage % 2 == 0) {
            let sign = i64::from(self.signs[*passage as usize / 2]);
            let (above, at) = positions[*passage as usize ^ 1];
            if above == first {
                sum += sign;
                mu += sign * before(&of_first, at);
            } else if above == second {
                mu += sign * (sum - before(&of_second, at));
            }
        }
        mu
    }
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
