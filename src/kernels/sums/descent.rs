//! Simultaneous descent in the trees of two curves, for [`super::barnes_hut`] and [`super::fmm`].
//! Node pairs that a kernel accepts are expanded, the remaining pairs of leaves are summed exactly,
//! and all others are split.

use super::Estimate;
use super::barnes_hut::{Bounds, Node, OUTWARD};
use rayon::prelude::*;
use std::f64::consts::PI;

/// A node of each tree.
pub(super) type NodePair = (Node, Node);

/// Sums over node pairs, with their errors and their work.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sum {
    /// Sum of the expansions, times 4 pi.
    pub far: f64,
    /// Sums of the remainders and of the magnitudes.
    pub bounds: Bounds,
    /// Bound of the rounding errors of the expansions.
    pub rounding: f64,
    /// Rounding error of the expansions relative to their magnitudes, unless `rounding` covers it.
    pub relative: f64,
    pub near: f64,
    pub near_error: f64,
    /// Published estimate of the error.
    pub estimate: f64,
    /// Node pairs expanded, leaf pairs summed and node pairs visited, in all passes.
    pub expanded: u64,
    pub summed: u64,
    pub visited: u64,
    /// Number of leaves of the smallest expanded node of each tree.
    pub smallest: Option<[u32; 2]>,
}

impl Sum {
    pub fn plus(mut self, other: Sum) -> Sum {
        self.far += other.far;
        self.bounds.tail += other.bounds.tail;
        self.bounds.size += other.bounds.size;
        self.rounding += other.rounding;
        self.near += other.near;
        self.near_error += other.near_error;
        self.estimate += other.estimate;
        self.smallest = match (self.smallest, other.smallest) {
            (Some([a, b]), Some([c, d])) => Some([a.min(c), b.min(d)]),
            (own, other) => own.or(other),
        };
        self.spent(&other);
        self
    }

    /// Adds the work of another pass, but not its sum.
    pub fn spent(&mut self, other: &Sum) {
        self.expanded += other.expanded;
        self.summed += other.summed;
        self.visited += other.visited;
    }

    /// Returns the error bound without the remainders: the part that does not decrease if
    /// remainders do.
    pub fn estimate_of_rounding(&self) -> f64 {
        // Every sum has at most as many terms as there are node pairs; each addition has an error
        // of one unit.
        let units = (self.expanded + self.summed + 64) as f64 * f64::EPSILON;
        let far = self.bounds.size * (self.relative + units);
        self.near_error + self.rounding + far + units * (1.0 + self.near.abs())
    }

    pub fn estimate(&self) -> Estimate {
        let bound = (self.bounds.tail + self.estimate_of_rounding()) * OUTWARD;
        if !bound.is_finite() {
            return Estimate::UNKNOWN;
        }
        Estimate::new(self.far / (4.0 * PI) + self.near, bound)
    }
}

/// Two trees, and the node pairs of them that a kernel expands.
pub(super) trait Descent: Sync {
    type Accepted;

    /// Approximate number of tasks of a pass.
    const TASKS: usize;

    /// Maximum number of leaves of two trees that are summed in one task.
    const SMALL: usize;

    fn roots(&self) -> NodePair;

    /// Returns the bounds of a node pair if it is accepted.
    fn accepted(&self, pair: NodePair) -> Option<Self::Accepted>;

    /// Returns the radius of a node of the first or second tree.
    fn radius(&self, side: usize, node: Node) -> f64;

    /// Returns true if both are the tree of one curve. Each pair of its nodes is then visited once.
    fn is_own(&self) -> bool {
        false
    }

    /// Sums all node pairs of the agenda.
    fn run(&self, agenda: Vec<NodePair>) -> Sum;

    /// Replaces the larger node of a pair by its children. A pair of a node and itself is replaced
    /// by all pairs of its children, each once.
    #[inline(always)]
    fn open(&self, (t, u): NodePair, next: &mut Vec<NodePair>) {
        if self.is_own() && t.place == u.place {
            let [a, b] = t.children();
            return next.extend([(a, a), (a, b), (b, b)]);
        }
        if u.is_leaf() || (!t.is_leaf() && self.radius(0, t) > self.radius(1, u)) {
            next.extend(t.children().map(|t| (t, u)));
        } else {
            next.extend(u.children().map(|u| (t, u)));
        }
    }

    /// Makes one pass.
    fn pass(&self) -> Sum {
        over(&self.tasks(), |agenda| self.run(agenda))
    }

    /// Returns some hundred tasks, independent of the number of threads; a single one for small
    /// trees.
    fn tasks(&self) -> Vec<NodePair> {
        let mut agenda = vec![self.roots()];
        if (agenda[0].0.leaves as usize + agenda[0].1.leaves as usize) <= Self::SMALL {
            return agenda;
        }
        while agenda.len() < Self::TASKS {
            let before = agenda.len();
            let mut next = Vec::with_capacity(4 * before);
            for (t, u) in agenda {
                if (t.is_leaf() && u.is_leaf()) || self.accepted((t, u)).is_some() {
                    next.push((t, u));
                } else {
                    self.open((t, u), &mut next);
                }
            }
            agenda = next;
            if agenda.len() == before {
                break;
            }
        }
        agenda
    }
}

/// Runs tasks and adds the results in their order.
pub(super) fn over(tasks: &[NodePair], run: impl Fn(Vec<NodePair>) -> Sum + Sync) -> Sum {
    if let [one] = tasks {
        return run(vec![*one]);
    }
    let parts = tasks.par_iter().map(|&pair| run(vec![pair]));
    let parts: Vec<Sum> = parts.collect();
    parts.into_iter().fold(Sum::default(), Sum::plus)
}
