//! A fast multipole method for two curves (Qu & James 2021, section 3.4.3), with a proven error
//! bound.
//!
//! The published method passes points to a library for the Biot-Savart integral and corrects for
//! the length of segments afterwards. Differences: the segments themselves are expanded, exactly
//! ([`harmonics`]), up to order 20. Node pairs that are too close are summed exactly, segment by
//! segment, as in Barnes-Hut. A linking number is a single number, so there are no local expansions
//! and no downward pass: each accepted node pair contributes a number ([`interact`]), and the work
//! is proportional to the number of leaves. The remainder of every node pair and the rounding
//! errors are bounded ([`bound`]), and node pairs are accepted by that bound.
//!
//! A pair is planned before it is summed. Dry runs with upper bounds of the moments find the node
//! pairs to accept, and so the nodes that need moments at all. Once the moments are known, their
//! norms are smaller than the bounds, and so fewer node pairs are needed.
//!
//! The method is made for many strands in a small space, whose contributions cancel. The sum of
//! magnitudes is then large compared to an integer, and only a high order makes the remainder small
//! enough. Nodes are regions of space, not runs of segments ([`tree`]).

mod bound;
mod expansions;
mod gauss;
mod harmonics;
mod interact;
mod norms;
mod rotate;
#[cfg(test)]
mod tests;
mod tree;
mod walk;

use super::descent::{Descent, Sum};
use super::{Estimate, Summation, of_polylines};
use crate::cancel::Cancel;
use crate::curve::CurveSet;
use crate::pairs::{Pair, curves_of};
use expansions::Expansions;
pub(super) use gauss::{between, itself};
use rayon::prelude::*;
use tree::Tree;
use walk::{Criterion, Walk, work};

/// Criterion by which an expansion is accepted for a node pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Accept {
    /// Accepts if the sum of the radii is at most this times the distance of the centres.
    #[cfg_attr(
        not(test),
        expect(dead_code, reason = "used by tests that sweep the order")
    )]
    Separation(f64),
    /// Accepts by the proven error bound, so that the bound of the sum is below this, and only one
    /// integer is within it.
    Bound(f64),
    /// Same criterion as `Bound`, for sums that are not integers.
    Within(f64),
}

/// Options of the sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Options {
    /// Order of the expansions, 2 to 20. `None`: chosen from the required bound.
    pub order: Option<u32>,
    /// Criterion by which an expansion is accepted.
    pub accept: Accept,
    /// Approximate maximum work on a pair, in microseconds of one core. If more is expected, the
    /// pair is undecided, because other kernels are faster.
    pub limit: f64,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            order: None,
            accept: Accept::Bound(0.8),
            limit: 1e7,
        }
    }
}

/// The fast multipole method for all pairs of a set of polylines.
#[derive(Debug)]
pub(crate) struct Fmm {
    options: Options,
    /// Trees of the closed curves; `None` for other curves.
    trees: Vec<Option<Tree>>,
    /// Ends the sums early: all later estimates are unknown.
    pub cancel: Option<Cancel>,
}

/// Orders that are tried, lowest first.
const ORDERS: [usize; 5] = [4, 8, 12, 16, 20];

impl Fmm {
    /// Builds the trees of all closed polylines. Other curves have no linking numbers here.
    pub fn new(set: &CurveSet, options: Options) -> Fmm {
        Fmm::of_some(set, |_| true, options)
    }

    /// Builds the trees of the curves for which `some` holds. Other curves have no linking numbers
    /// here.
    pub fn of_some(set: &CurveSet, some: impl Fn(u32) -> bool + Sync, options: Options) -> Fmm {
        Fmm {
            options,
            trees: of_polylines(set, some, |points| Tree::of(points, true)),
            cancel: None,
        }
    }

    /// Returns the trees of a pair. A curve has no linking number with itself: the sum is its
    /// writhe.
    fn pair(&self, (i, j): Pair) -> Option<[&Tree; 2]> {
        if i == j && !matches!(self.options.accept, Accept::Within(_)) {
            return None;
        }
        let tree = |i: u32| self.trees.get(i as usize)?.as_ref();
        Some([tree(i)?, tree(j)?])
    }

    /// Returns the first order to try for a pair. `None` if there are so few leaf pairs that a
    /// direct sum is faster.
    fn order(&self, trees: [&Tree; 2]) -> Option<usize> {
        let [m, n] = trees.map(|t| t.root().leaves as usize);
        if m * n <= UNEXPANDED {
            return None;
        }
        let least = match self.options.accept {
            Accept::Separation(_) => ORDERS[0],
            Accept::Bound(budget) | Accept::Within(budget) => {
                let magnitude = Walk::magnitude(trees, self.cancel.as_ref());
                let digits = (magnitude / budget).log10().max(0.0);
                // Fitted so that expansions and the near field cost about the same.
                2 + (1.7 * digits) as usize
            }
        };
        let order = self.options.order.map_or(least, |p| p as usize);
        Some(order.clamp(2, harmonics::MOST))
    }

    /// Returns the acceptance criterion with which the remainder of a pair is small enough, and the
    /// planned sum. Returns `None` if its work exceeds the limit.
    fn plan(
        &self,
        trees: [&Tree; 2],
        expansions: [Option<&Expansions>; 2],
        start: Option<Criterion>,
    ) -> Option<(Criterion, Sum)> {
        let Some(order) = expansions[0].map(|e| e.order) else {
            return Some((Criterion::Share(0.0), Sum::default()));
        };
        let plan = |criterion| {
            let walk = Walk::new(trees, expansions, criterion).until(self.cancel.as_ref());
            walk.plan(self.options.limit)
        };
        let budget = match self.options.accept {
            Accept::Separation(q) => {
                let criterion = Criterion::Separation(q);
                return Some((criterion, plan(criterion)?));
            }
            Accept::Bound(budget) | Accept::Within(budget) => budget,
        };
        // A part of the budget is reserved for rounding errors.
        let aim = 0.8 * budget;
        let [m, n] = trees.map(|t| f64::from(t.root().leaves));
        let mut share = match start {
            Some(Criterion::Share(share)) => share,
            _ => aim / (16.0 * (m + n)),
        };
        let mut found = None;
        for _ in 0..TRIES {
            let criterion = Criterion::Share(share);
            let Some(sum) = plan(criterion) else {
                break;
            };
            let tail = sum.bounds.tail;
            if tail <= aim {
                found = Some((criterion, sum));
                if tail > 0.4 * aim || tail == 0.0 {
                    break;
                }
                share *= 0.7 * (aim / tail).min(1e3);
            } else if found.is_some() {
                break;
            } else {
                share *= 0.6 * (aim / tail).max(1e-4);
            }
        }
        found.filter(|(_, sum)| work(sum, order) <= self.options.limit)
    }
}

/// Maximum number of dry runs that adapt the bound up to which a node pair is accepted.
const TRIES: usize = 8;

/// Maximum number of leaf pairs that are summed without expansions.
const UNEXPANDED: usize = 9;

impl Summation for Fmm {
    /// Computes the expansions once for each curve and order, for all of its pairs. The Gauss
    /// integral of a curve and itself is over unordered pairs of its segments.
    fn linking_numbers(&self, pairs: &[Pair]) -> Vec<Estimate> {
        let mut estimates = vec![Estimate::UNKNOWN; pairs.len()];
        let order = |(at, &pair): (usize, &Pair)| Some((at, self.order(self.pair(pair)?)));
        let orders = pairs.par_iter().enumerate().filter_map(order);
        let mut agenda: Vec<(usize, Option<usize>)> = orders.collect();
        while !agenda.is_empty() {
            agenda = self.stage(pairs, &agenda, &mut estimates);
        }
        estimates
    }
}

impl Fmm {
    /// Returns true if a higher order is not needed, or cannot improve the sum.
    fn suffices(&self, sum: &Sum) -> bool {
        match self.options.accept {
            Accept::Separation(_) => true,
            Accept::Bound(_) => sum.estimate().integer().is_some(),
            Accept::Within(budget) => {
                sum.estimate().bound <= budget || sum.estimate_of_rounding() > 0.2 * budget
            }
        }
    }

    /// Sums the pairs of the lowest order. Returns the other pairs, and those that need a higher
    /// order.
    fn stage(
        &self,
        pairs: &[Pair],
        agenda: &[(usize, Option<usize>)],
        estimates: &mut [Estimate],
    ) -> Vec<(usize, Option<usize>)> {
        let order = agenda.iter().map(|a| a.1).min().flatten();
        let (now, mut later): (Vec<_>, Vec<_>) = agenda.iter().partition(|a| a.1 == order);
        let used = curves_of(now.iter().map(|&(at, _)| pairs[at]));
        // Dry runs with upper bounds of the moments find the nodes whose moments are needed.
        let outline = |(i, tree): (usize, &Option<Tree>)| {
            let is_used = used.binary_search(&(i as u32)).is_ok();
            let (tree, order) = (tree.as_ref().filter(|_| is_used)?, order?);
            Some(Expansions::outline(tree, order))
        };
        let outlines = self.trees.par_iter().enumerate().map(outline);
        let mut expansions: Vec<Option<Expansions>> = outlines.collect();
        let plan = |expansions: &[Option<Expansions>], at: usize, start| {
            let (i, j) = pairs[at];
            let of = [i, j].map(|i| expansions[i as usize].as_ref());
            self.plan(self.pair((i, j))?, of, start)
        };
        let first = now.par_iter().map(|&(at, _)| plan(&expansions, at, None));
        let plans: Vec<_> = first.collect();
        let mut least = vec![u32::MAX; self.trees.len()];
        for (&(at, _), plan) in now.iter().zip(&plans) {
            let Some((_, sum)) = plan else {
                continue;
            };
            let (i, j) = pairs[at];
            for (curve, smallest) in [i, j].into_iter().zip(sum.smallest.into_iter().flatten()) {
                least[curve as usize] = smallest.min(least[curve as usize]);
            }
        }
        let all = expansions.par_iter_mut().zip(&self.trees).zip(least);
        all.for_each(|((expansions, tree), least)| {
            if let (Some(expansions), Some(tree)) = (expansions, tree) {
                expansions.fill(tree, least);
            }
        });
        let sum = |(&(at, _), first): (&(usize, _), Option<(Criterion, Sum)>)| {
            // If most of the work is in the near field, a higher order increases the work.
            let more = self.options.order.is_none() && order.is_some() && first.is_some();
            // The moments may be smaller than their upper bounds, so larger nodes may be accepted.
            let again = first.and_then(|(criterion, _)| plan(&expansions, at, Some(criterion)));
            let (i, j) = pairs[at];
            let (Some((criterion, _)), Some(trees)) = (again, self.pair((i, j))) else {
                return (Estimate::UNKNOWN, more);
            };
            let of = [i, j].map(|i| expansions[i as usize].as_ref());
            let walk = Walk::new(trees, of, criterion).until(self.cancel.as_ref());
            let sum = walk.pass();
            if self.cancel.as_ref().is_some_and(Cancel::is_set) {
                return (Estimate::UNKNOWN, false);
            }
            (sum.estimate(), more && !self.suffices(&sum))
        };
        let sums: Vec<(Estimate, bool)> = now.par_iter().zip(plans).map(sum).collect();
        for (&(at, _), (estimate, more)) in now.iter().zip(sums) {
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
