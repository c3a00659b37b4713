//! A fast multipole method for two curves (Qu & James 2021, section 3.4.3), with a proven bound.
//!
//! The published way hands points to a library for the Biot-Savart integral and corrects for the length of segments
//! afterwards. Here the segments themselves are expanded, exactly ([`harmonics`]), to any order up to 20; node pairs that are
//! too close end in the exact sum of their segments, which is that of Barnes-Hut. A linking number is one number, so
//! there are no local expansions and no way down: each accepted node pair contributes a number ([`interact`]), and the
//! work is of the order of the number of leaves. The remainder of every node pair and rounding are bounded ([`bound`]),
//! and node pairs are accepted by that.
//!
//! What it is for: many strands in a small space, whose contributions cancel. Sums of magnitudes are then large beside an
//! integer, and only a high order makes the remainder small enough. Nodes are regions, not stretches ([`tree`]).

mod bound;
mod harmonics;
mod interact;
mod norms;
mod rotate;
#[cfg(test)]
mod tests;
mod tree;
mod walk;

use super::barnes_hut::normalizing;
use super::{Estimate, Summation};
use crate::curve::CurveSet;
use crate::pairs::Pair;
use bound::OUTWARD;
use rayon::prelude::*;
use tree::{Expansions, Tree};
use walk::{Criterion, Sum, Walk};

/// When an expansion is good enough for a node pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Accept {
    /// Where the sum of the radii is at most this times the distance of the centres.
    #[cfg_attr(not(test), expect(dead_code, reason = "sweeps of the error by order"))]
    Separation(f64),
    /// By the proven bound, such that the sum is below this.
    Bound(f64),
}

/// How to sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Options {
    /// The order of expansions, 2 to 20; by the bound that is asked for where there is none.
    pub order: Option<u32>,
    /// When they are taken.
    pub accept: Accept,
    /// Work on a pair that is not gone beyond, in node pairs and the like (about a microsecond each): where it is expected
    /// to be more, other kernels are better.
    pub limit: f64,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            order: None,
            accept: Accept::Bound(0.8),
            limit: 3e7,
        }
    }
}

/// The fast multipole method for all pairs of a set of polylines.
#[derive(Debug)]
pub(crate) struct Fmm {
    options: Options,
    /// Of closed curves.
    trees: Vec<Option<Tree>>,
}

/// Orders that are tried, one after the other.
const ORDERS: [usize; 5] = [4, 8, 12, 16, 20];

impl Fmm {
    /// Builds the trees of all closed curves. Other curves than polylines have no linking numbers here.
    pub fn new(set: &CurveSet, options: Options) -> Fmm {
        let scale = normalizing(set.max_abs());
        let polyline = set.basis().is_polyline();
        let trees = (0..set.len()).into_par_iter().map(|i| {
            let fits = polyline && set.curve(i).closed && set.curve(i).points > 0;
            fits.then(|| Tree::new(set, i, scale))
        });
        Fmm {
            options,
            trees: trees.collect(),
        }
    }

    fn pair(&self, (i, j): Pair) -> Option<[&Tree; 2]> {
        let tree = |i: u32| self.trees.get(i as usize)?.as_ref();
        Some([tree(i)?, tree(j)?])
    }

    /// The order for a pair: none where nothing is worth an expansion.
    fn order(&self, trees: [&Tree; 2]) -> Option<usize> {
        let [m, n] = trees.map(|t| t.root().leaves as usize);
        if m * n <= FEW {
            return None;
        }
        let least = match self.options.accept {
            Accept::Separation(_) => ORDERS[0],
            Accept::Bound(budget) => {
                let magnitude = Walk::magnitude(trees);
                let digits = (magnitude / budget).log10().max(0.0);
                // About what makes expansions and the near field cost the same.
                2 + (1.7 * digits) as usize
            }
        };
        let order = self.options.order.map_or(least, |p| p as usize);
        Some(order.clamp(2, harmonics::MOST))
    }

    /// The sum for a pair, and whether a higher order may do better.
    fn sum(&self, trees: [&Tree; 2], expansions: [Option<&Expansions>; 2]) -> (Sum, bool) {
        let walk = |criterion| Walk::new(trees, expansions, criterion);
        let [m, n] = trees.map(|t| f64::from(t.root().leaves));
        let budget = match self.options.accept {
            _ if expansions[0].is_none() => return (walk(Criterion::Share(0.0)).sum(), false),
            Accept::Separation(q) => return (walk(Criterion::Separation(q)).sum(), false),
            Accept::Bound(budget) => budget,
        };
        // Rounding takes some.
        let aim = 0.8 * budget;
        let mut share = aim / (16.0 * (m + n));
        let mut found = None;
        for _ in 0..TRIES {
            let plan = walk(Criterion::Share(share)).plan();
            let fits = plan.bounds.tail <= aim;
            // The finest that is too coarse, or the coarsest that fits.
            if fits {
                found = Some((share, plan));
                if plan.bounds.tail > 0.4 * aim {
                    break;
                }
            } else if found.is_some() {
                break;
            }
            let factor = (aim / plan.bounds.tail).clamp(1e-4, 1e3);
            share *= if fits { 0.7 * factor } else { 0.6 * factor };
        }
        let more = self.options.order.is_none();
        match found {
            Some((share, plan)) if plan.work() <= self.options.limit => {
                let sum = walk(Criterion::Share(share)).sum();
                (sum, more && sum.estimate().bound > budget)
            }
            _ => (Sum::UNKNOWN, more),
        }
    }
}

/// Dry runs for the share of a node pair.
const TRIES: usize = 8;

/// Leaf pairs that are not worth an expansion.
const FEW: usize = 9;

impl Summation for Fmm {
    fn linking_number(&self, pair: Pair) -> Estimate {
        let estimates = self.linking_numbers(&[pair]);
        estimates.first().copied().unwrap_or(Estimate::UNKNOWN)
    }

    /// Expansions are made once for each curve and order, and serve all of its pairs.
    fn linking_numbers(&self, pairs: &[Pair]) -> Vec<Estimate> {
        let mut estimates = vec![Estimate::UNKNOWN; pairs.len()];
        let orders: Vec<Option<Option<usize>>> = pairs
            .par_iter()
            .map(|&pair| self.pair(pair).map(|trees| self.order(trees)))
            .collect();
        let mut agenda: Vec<(usize, Option<usize>)> = orders
            .into_iter()
            .enumerate()
            .filter_map(|(at, order)| Some((at, order?)))
            .collect();
        while !agenda.is_empty() {
            let next = self.stage(pairs, &agenda, &mut estimates);
            agenda = next;
        }
        estimates
    }
}

impl Fmm {
    /// Sums the pairs of the lowest order; returns the others, and those that need a higher one.
    fn stage(
        &self,
        pairs: &[Pair],
        agenda: &[(usize, Option<usize>)],
        estimates: &mut [Estimate],
    ) -> Vec<(usize, Option<usize>)> {
        let order = agenda.iter().map(|a| a.1).min().flatten();
        let (now, mut later): (Vec<_>, Vec<_>) = agenda.iter().partition(|a| a.1 == order);
        let mut used = vec![false; self.trees.len()];
        for &(at, _) in &now {
            let (i, j) = pairs[at];
            used[i as usize] = true;
            used[j as usize] = true;
        }
        let expansions: Vec<Option<Expansions>> = self
            .trees
            .par_iter()
            .zip(used)
            .map(|(tree, used)| {
                let (tree, order) = (tree.as_ref().filter(|_| used)?, order?);
                Some(Expansions::new(tree, order))
            })
            .collect();
        let sums: Vec<_> = now
            .par_iter()
            .map(|&(at, _)| {
                let (i, j) = pairs[at];
                let of = |i: u32| expansions[i as usize].as_ref();
                let trees = self.pair(pairs[at])?;
                Some(self.sum(trees, [of(i), of(j)]))
            })
            .collect();
        for (&(at, _), sum) in now.iter().zip(sums) {
            let Some((sum, more)) = sum else { continue };
            let estimate = sum.estimate();
            if estimate.bound < estimates[at].bound {
                estimates[at] = estimate;
            }
            let next = order.and_then(|p| ORDERS.into_iter().find(|&o| o > p + 1));
            if more && next.is_some() {
                later.push((at, next));
            }
        }
        later
    }
}
