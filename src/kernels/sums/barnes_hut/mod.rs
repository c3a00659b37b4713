//! Barnes-Hut with two trees (Qu & James 2021, section 3.4.4), with a proven error bound.
//!
//! Pairs of nodes that are far enough apart contribute by an expansion up to the quadrupole; the
//! remaining pairs of leaves contribute by the exact sum. The published method accepts node pairs
//! by their distance alone and estimates the error from some terms of the next degree. It is
//! implemented here for comparison. Differences: the remainder of every expansion and the rounding
//! errors are bounded ([`bound`]), and node pairs are accepted by that bound. So work is spent on
//! the node pairs that reduce the error most, and an integer is proven.
//!
//! Cost: `N log N` for the trees, once; then a number of node pairs that grows as the length of the
//! curves divided by their distance.

mod bound;
mod evaluate;
mod moments;
mod near;
#[cfg(feature = "gpu")]
mod packed;
#[cfg(test)]
mod tests;
mod trees;

use super::descent::{Descent, NodePair, Sum};
use super::{Estimate, Summation, of_polylines};
use crate::curve::CurveSet;
use crate::curve::vector::{dot, per_axis};
use crate::pairs::Pair;
#[cfg(feature = "gpu")]
pub(crate) use packed::{LEAF_SEGMENTS, pack};

use crate::simd::dispatch;
pub(super) use bound::{Bounds, NEAREST, OUTWARD};
use bound::{ROUNDING, bounds};
use evaluate::{BATCH, expand_batch, next_order};
use std::f64::consts::PI;
use std::sync::Arc;
use trees::Tree;

pub(super) use near::Angles;
pub(super) use trees::Node;

/// Highest order of the expansion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// First-order terms.
    Dipole,
    /// Second-order terms.
    Quadrupole,
}

/// Criterion by which an expansion is accepted for a node pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Accept {
    /// One pass that accepts node pairs whose distance is above this times the sum of the radii.
    Beta(f64),
    /// The published criterion: if the estimated error is above `target`, a second pass follows
    /// with a larger beta (equation 15), at most `most`.
    Estimated {
        /// Beta of the first pass.
        beta: f64,
        /// Target of the estimated error.
        target: f64,
        /// Maximum beta.
        most: f64,
    },
    /// The proven error bound. Passes are repeated until the bound of the sum is below this, until
    /// rounding alone is above it, or until the limit.
    Bound(f64),
}

/// Options of the sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Options {
    /// Highest order of the expansion.
    pub order: Order,
    /// Criterion by which an expansion is accepted.
    pub accept: Accept,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            order: Order::Quadrupole,
            // Below 1 by a margin: the nearest other integer is then outside of the bound, unless
            // the actual error uses up most of it, which is unlikely.
            accept: Accept::Bound(0.8),
        }
    }
}

/// Barnes-Hut for all pairs of a set of polylines.
#[derive(Debug)]
pub(crate) struct BarnesHut {
    options: Options,
    /// Trees of the closed curves; `None` for other curves.
    trees: Arc<[Option<Tree>]>,
}

impl BarnesHut {
    /// Builds the trees of all closed polylines. Other curves have no linking numbers here.
    pub fn new(set: &CurveSet, options: Options) -> BarnesHut {
        BarnesHut {
            options,
            trees: of_polylines(set, |_| true, Tree::of).into(),
        }
    }

    /// Returns a kernel with the same trees and other options.
    pub fn with(&self, options: Options) -> BarnesHut {
        let trees = Arc::clone(&self.trees);
        BarnesHut { options, trees }
    }

    /// Returns the sum of a pair with its work, or `None` if a curve has no tree. A curve has no
    /// linking number with itself: the sum would be its writhe.
    fn sum(&self, (i, j): Pair) -> Option<Sum> {
        if i == j {
            return None;
        }
        let tree = |i: u32| self.trees.get(i as usize)?.as_ref();
        let trees = [tree(i)?, tree(j)?];
        let order = self.options.order;
        let quadrupole = order == Order::Quadrupole;
        match self.options.accept {
            Accept::Beta(beta) => Some(pass(order, trees, Criterion::Beta(beta))),
            Accept::Estimated { beta, target, most } => {
                let sum = pass(order, trees, Criterion::Estimated(beta));
                let power = if quadrupole { 0.25 } else { 1.0 / 3.0 };
                let raised = (beta * (sum.estimate / target).powf(power)).min(most);
                if raised > beta {
                    let mut again = pass(order, trees, Criterion::Beta(raised));
                    again.spent(&sum);
                    return Some(again);
                }
                Some(sum)
            }
            Accept::Bound(budget) => Some(within(order, budget, trees)),
        }
    }
}

/// Approximate maximum number of node pairs visited by all passes over a pair. A pass that is
/// expected to exceed it is not started. Other kernels are faster if the sum of all bounds is far
/// above the error, because the contributions of many strands cancel.
const LIMIT: f64 = (1u64 << 26) as f64;

/// Maximum number of passes after the first one.
const PASSES: usize = 12;

/// Maximum number of leaf pairs that are summed without expansions.
const UNEXPANDED: f64 = 64.0;

/// Makes one pass over two trees.
fn pass(order: Order, trees: [&Tree; 2], criterion: Criterion) -> Sum {
    let walk = Walk {
        trees,
        order,
        criterion,
    };
    Sum {
        relative: ROUNDING,
        ..walk.pass()
    }
}

/// Repeats passes until the bound of the sum is at most `budget`, as far as possible
/// ([`Accept::Bound`]).
fn within(order: Order, budget: f64, trees: [&Tree; 2]) -> Sum {
    let leaves = trees.map(|t| f64::from(t.root().leaves));
    let all = leaves[0] * leaves[1];
    let mut share = match all <= UNEXPANDED {
        true => 0.0,
        // A good initial value for neighbouring rings; long curves need more node pairs.
        false => budget / (8.0 * (leaves[0] + leaves[1]).sqrt()),
    };
    let mut sum = pass(order, trees, Criterion::Share(share));
    for _ in 0..PASSES {
        let (bound, rounding) = (sum.estimate().bound, sum.estimate_of_rounding());
        if bound <= budget || rounding.is_nan() || rounding > budget {
            break;
        }
        // Heuristic: the bound grows approximately as the share to the power of 0.6 to 0.9, the
        // work as the share to the power of -0.5.
        let finer = (0.9 * budget / bound).powf(1.25).clamp(1e-4, 0.7);
        let expected = sum.visited as f64 / finer.sqrt();
        if expected.min(all) > LIMIT {
            break;
        }
        // A pass that is expected to visit more than half of all leaf pairs sums all of them
        // exactly instead, which costs less than one more pass.
        share *= if 2.0 * expected > all { 0.0 } else { finer };
        let mut again = pass(order, trees, Criterion::Share(share));
        again.spent(&sum);
        sum = again;
    }
    sum
}

impl Summation for BarnesHut {
    fn linking_number(&self, pair: Pair) -> Estimate {
        debug_assert!((pair.0.max(pair.1) as usize) < self.trees.len());
        let sum = self.sum(pair);
        sum.map_or(Estimate::UNKNOWN, |sum| sum.estimate())
    }
}

/// Criterion of one pass.
#[derive(Clone, Copy, Debug)]
enum Criterion {
    Beta(f64),
    /// Same criterion as `Beta`; also sums the published estimate.
    Estimated(f64),
    /// Accepts if the bound of the remainder is below this; with 0, accepts nothing.
    Share(f64),
}

/// Two trees and a criterion.
#[derive(Clone, Copy)]
struct Walk<'a> {
    trees: [&'a Tree; 2],
    order: Order,
    criterion: Criterion,
}

impl Walk<'_> {
    #[inline(always)]
    fn run_inline(&self, mut agenda: Vec<NodePair>) -> Sum {
        let reach = self.trees.map(|tree| &tree.reach[..]);
        let moments = self.trees.map(|tree| &tree.moments[..]);
        let mut sum = Sum::default();
        let mut angles = Angles::ZERO;
        let mut batch = [(0, 0); BATCH];
        let mut filled = 0;
        while let Some((t, u)) = agenda.pop() {
            sum.visited += 1;
            if let Some(bounds) = self.accepted((t, u)) {
                sum.bounds.tail += bounds.tail;
                sum.bounds.size += bounds.size;
                sum.expanded += 1;
                batch[filled] = (t.place, u.place);
                filled += 1;
                if let Criterion::Estimated(_) = self.criterion {
                    sum.estimate += self.published(t, u);
                }
                if filled == BATCH {
                    sum.far += expand_batch(self.order, &batch, reach, moments);
                    filled = 0;
                }
            } else if t.is_leaf() && u.is_leaf() {
                angles.add(self.trees, [t.first as usize, u.first as usize]);
                sum.summed += 1;
            } else {
                self.open((t, u), &mut agenda);
            }
        }
        if filled > 0 {
            sum.far += expand_batch(self.order, &batch[..filled], reach, moments);
        }
        (sum.near, sum.near_error) = angles.turns();
        sum
    }

    /// Returns the published estimate for a node pair. Its constant is not published, so the factor
    /// of the Gauss integral is used.
    fn published(&self, t: Node, u: Node) -> f64 {
        let [first, second] = self.trees;
        let (t, u) = (t.place as usize, u.place as usize);
        let (a, b) = (&first.reach[t], &second.reach[u]);
        let r = per_axis(|x| a.centre[x] - b.centre[x]);
        let moments = [&first.moments[t], &second.moments[u]];
        next_order(dot(r, r), [a, b], moments) / (4.0 * PI)
    }
}

impl Descent for Walk<'_> {
    type Accepted = Bounds;
    const TASKS: usize = 128;
    const SMALL: usize = 64;

    fn roots(&self) -> NodePair {
        self.trees.map(Tree::root).into()
    }

    #[inline(always)]
    fn accepted(&self, (t, u): NodePair) -> Option<Bounds> {
        let a = self.trees[0].reach.get(t.place as usize)?;
        let b = self.trees[1].reach.get(u.place as usize)?;
        let r = per_axis(|x| a.centre[x] - b.centre[x]);
        let square = dot(r, r);
        match self.criterion {
            Criterion::Beta(beta) | Criterion::Estimated(beta) => {
                let rho = a.radius + b.radius;
                let far = square > beta * beta * rho * rho;
                let bounds = far.then(|| bounds(self.order, square, a, b))?;
                (bounds.tail < f64::INFINITY).then_some(bounds)
            }
            Criterion::Share(0.0) => None,
            Criterion::Share(share) => {
                let bounds = bounds(self.order, square, a, b);
                (bounds.tail <= share).then_some(bounds)
            }
        }
    }

    #[inline(always)]
    fn radius(&self, side: usize, node: Node) -> f64 {
        self.trees[side].reach[node.place as usize].radius
    }

    fn run(&self, agenda: Vec<NodePair>) -> Sum {
        dispatch!(Self::run_inline(self, agenda))
    }
}
