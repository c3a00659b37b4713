//! Simultaneous descent in two trees.

use super::bound::{Bounding, WIDEST};
use super::expansions::Expansions;
use super::interact::{BATCH, Buffers, Side, interact};
use super::tree::{Ball, FILLER, LEAF, Tree};
use crate::curve::Point;
use crate::kernels::Estimate;
use crate::kernels::sums::barnes_hut::{Angles, Bounds, Node, OUTWARD};
use crate::simd::dispatch;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Criterion of one pass.
#[derive(Clone, Copy, Debug)]
pub(super) enum Criterion {
    /// Accepts if the sum of the radii is at most this times the distance of the centres.
    Separation(f64),
    /// Accepts if the bound of the remainder is below this; with 0, accepts nothing.
    Share(f64),
}

/// Sums over node pairs, with their errors and their work.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sum {
    /// Sum of the expansions, times 4 pi.
    pub far: f64,
    /// Sums of the remainders and of the magnitudes.
    pub bounds: Bounds,
    /// Bound of the rounding errors of the expansions.
    pub rounding: f64,
    near: f64,
    near_error: f64,
    /// Node pairs expanded, leaf pairs summed and node pairs visited.
    pub expanded: u64,
    pub summed: u64,
    pub visited: u64,
    order: usize,
    /// Number of leaves of the smallest expanded node of each tree.
    pub smallest: [u32; 2],
}

impl Sum {
    pub const ZERO: Sum = Sum {
        far: 0.0,
        bounds: Bounds {
            tail: 0.0,
            size: 0.0,
        },
        rounding: 0.0,
        near: 0.0,
        near_error: 0.0,
        expanded: 0,
        summed: 0,
        visited: 0,
        order: 0,
        smallest: [u32::MAX; 2],
    };

    /// Result without information.
    pub const UNKNOWN: Sum = Sum {
        near_error: f64::INFINITY,
        ..Sum::ZERO
    };

    fn plus(mut self, other: Sum) -> Sum {
        self.far += other.far;
        self.bounds.tail += other.bounds.tail;
        self.bounds.size += other.bounds.size;
        self.rounding += other.rounding;
        self.near += other.near;
        self.near_error += other.near_error;
        self.expanded += other.expanded;
        self.summed += other.summed;
        self.visited += other.visited;
        for (own, other) in self.smallest.iter_mut().zip(other.smallest) {
            *own = other.min(*own);
        }
        self
    }

    /// Returns the approximate CPU time, in microseconds.
    pub fn work(&self) -> f64 {
        let p = self.order as f64;
        self.expanded as f64 * 0.001 * p * p * p + self.summed as f64 * 0.8
    }

    /// Returns the bound without the remainders: the part that a higher order does not reduce.
    pub fn estimate_of_rounding(&self) -> f64 {
        // Every sum has at most as many terms as there are node pairs; each addition has an error
        // of one unit.
        let units = (self.expanded + self.summed + 64) as f64 * f64::EPSILON;
        self.near_error + self.rounding + self.bounds.size * units + units * (1.0 + self.near.abs())
    }

    pub fn estimate(&self) -> Estimate {
        let bound = (self.bounds.tail + self.estimate_of_rounding()) * OUTWARD;
        if !bound.is_finite() {
            return Estimate::UNKNOWN;
        }
        Estimate::new(self.far / (4.0 * PI) + self.near, bound)
    }
}

/// Approximate number of tasks of a pass.
const TASKS: usize = 256;

/// Number of tasks of a dry run after which its limit is checked.
const GROUP: usize = 32;

/// Maximum number of leaves of two trees that are summed in one task.
const SMALL: usize = 8;

/// Two trees and a criterion.
#[derive(Clone, Copy)]
pub(super) struct Walk<'a> {
    trees: [&'a Tree; 2],
    expansions: Option<[&'a Expansions; 2]>,
    bounding: Bounding,
    criterion: Criterion,
    /// True if both trees are the same one: each pair of its segments is summed once, except for
    /// adjacent ones, which lie in a plane and contribute nothing.
    own: bool,
}

/// An accepted node pair.
struct Accepted {
    bounds: Bounds,
    r: Point,
    distance: f64,
}

impl<'a> Walk<'a> {
    pub fn new(
        trees: [&'a Tree; 2],
        expansions: [Option<&'a Expansions>; 2],
        criterion: Criterion,
    ) -> Walk<'a> {
        let expansions = match expansions {
            [Some(a), Some(b)] => Some([a, b]),
            _ => None,
        };
        let order = expansions.map_or(2, |e| e[0].order);
        Walk {
            trees,
            expansions,
            bounding: Bounding::new(order),
            criterion,
            own: std::ptr::eq(trees[0], trees[1]),
        }
    }

    /// Returns an estimate of the sum of the magnitudes of all contributions.
    pub fn magnitude(trees: [&Tree; 2]) -> f64 {
        let walk = Walk::new(trees, [None; 2], Criterion::Share(0.0));
        let smallest = trees.map(|t| t.balls[0].radius / 64.0);
        let mut agenda = vec![(trees[0].root(), trees[1].root())];
        let mut sum = 0.0;
        while let Some((t, u)) = agenda.pop() {
            let (a, b) = (walk.ball(0, t), walk.ball(1, u));
            let (_, distance, q) = Bounding::separation(a, b);
            let small =
                (t.is_leaf() || a.radius < smallest[0]) && (u.is_leaf() || b.radius < smallest[1]);
            if q < 0.7 || small {
                let distance = distance.max(a.radius + b.radius);
                sum += a.length / distance * (b.length / distance);
            } else {
                walk.open((t, u), &mut agenda);
            }
        }
        sum / (4.0 * PI)
    }

    #[inline(always)]
    fn ball(&self, side: usize, node: Node) -> &'a Ball {
        &self.trees[side].balls[node.place as usize]
    }

    /// Returns the bounds of a node pair if it is accepted.
    #[inline(always)]
    fn accepted(&self, t: Node, u: Node) -> Option<Accepted> {
        let expansions = self.expansions?;
        if t.leaves < expansions[0].least || u.leaves < expansions[1].least {
            return None;
        }
        let balls = [self.ball(0, t), self.ball(1, u)];
        let (r, distance, q) = Bounding::separation(balls[0], balls[1]);
        if let Criterion::Separation(most) = self.criterion
            && q > most
        {
            return None;
        }
        // Without a series the norms are not read.
        if q >= WIDEST {
            return None;
        }
        let norms = [
            expansions[0].norms.of(t.place as usize),
            expansions[1].norms.of(u.place as usize),
        ];
        let bounds = self.bounding.bounds(balls, norms, distance, q)?;
        let fits = match self.criterion {
            Criterion::Separation(_) => bounds.tail < f64::INFINITY,
            Criterion::Share(share) => bounds.tail <= share && share > 0.0,
        };
        fits.then_some(Accepted {
            bounds,
            r,
            distance,
        })
    }

    /// Replaces the larger node by its children. A node and itself are replaced by all pairs of its
    /// children, each pair once.
    #[inline(always)]
    fn open(&self, (t, u): (Node, Node), next: &mut Vec<(Node, Node)>) {
        if self.own && t.place == u.place {
            let [a, b] = t.children();
            return next.extend([(a, a), (a, b), (b, b)]);
        }
        if u.is_leaf() || (!t.is_leaf() && self.ball(0, t).radius > self.ball(1, u).radius) {
            next.extend(t.children().map(|t| (t, u)));
        } else {
            next.extend(u.children().map(|u| (t, u)));
        }
    }

    /// Returns some hundred tasks, independent of the number of threads; a single one for small
    /// trees.
    fn tasks(&self) -> Vec<(Node, Node)> {
        let mut agenda = vec![(self.trees[0].root(), self.trees[1].root())];
        let leaves = agenda[0].0.leaves as usize + agenda[0].1.leaves as usize;
        if leaves <= SMALL {
            return agenda;
        }
        while agenda.len() < TASKS {
            let before = agenda.len();
            let mut next = Vec::with_capacity(2 * before);
            for (t, u) in agenda {
                if (t.is_leaf() && u.is_leaf()) || self.accepted(t, u).is_some() {
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

    /// Runs tasks and adds the results in their order.
    fn over(tasks: &[(Node, Node)], run: impl Fn(Vec<(Node, Node)>) -> Sum + Sync) -> Sum {
        if let [one] = tasks {
            return run(vec![*one]);
        }
        let parts = tasks.par_iter().map(|&pair| run(vec![pair]));
        let parts: Vec<Sum> = parts.collect();
        parts.into_iter().fold(Sum::ZERO, Sum::plus)
    }

    /// Dry run: returns the work and the remainder of a pass, without the sum. Returns `None` as
    /// soon as the work exceeds `limit`, in microseconds.
    pub fn plan(&self, limit: f64) -> Option<Sum> {
        let dry = |mut agenda: Vec<(Node, Node)>| {
            let mut sum = Sum::ZERO;
            while let Some((t, u)) = agenda.pop() {
                sum.visited += 1;
                if let Some(accepted) = self.accepted(t, u) {
                    sum.bounds.tail += accepted.bounds.tail;
                    sum.expanded += 1;
                    sum.smallest = [t.leaves.min(sum.smallest[0]), u.leaves.min(sum.smallest[1])];
                } else if t.is_leaf() && u.is_leaf() {
                    sum.summed += 1;
                } else {
                    self.open((t, u), &mut agenda);
                }
            }
            sum
        };
        let mut plan = Sum::ZERO;
        plan.order = self.expansions.map_or(0, |e| e[0].order);
        for group in self.tasks().chunks(GROUP) {
            plan = plan.plus(Self::over(group, dry));
            if plan.work() > 1.2 * limit {
                return None;
            }
        }
        Some(plan)
    }

    /// Makes one pass.
    pub fn sum(&self) -> Sum {
        Self::over(&self.tasks(), |agenda| self.run(agenda))
    }

    /// Sums all node pairs of the agenda.
    pub fn run(&self, agenda: Vec<(Node, Node)>) -> Sum {
        dispatch!(Self::run_inline(self, agenda))
    }

    #[inline(always)]
    fn run_inline(&self, mut agenda: Vec<(Node, Node)>) -> Sum {
        let order = self.expansions.map_or(0, |e| e[0].order);
        let mut buffers = Buffers::new(order);
        let mut sum = Sum::ZERO;
        let mut angles = Angles::ZERO;
        let mut batch: Vec<([Side; 2], Point)> = Vec::with_capacity(BATCH);
        while let Some((t, u)) = agenda.pop() {
            sum.visited += 1;
            if let (Some(accepted), Some(expansions)) = (self.accepted(t, u), self.expansions) {
                sum.bounds.tail += accepted.bounds.tail;
                sum.bounds.size += accepted.bounds.size;
                let balls = [self.ball(0, t), self.ball(1, u)];
                sum.rounding += self.bounding.rounding(balls, accepted.distance);
                sum.expanded += 1;
                let side = |x: usize, node: Node| Side {
                    moments: expansions[x].of(node.place as usize),
                    degrees: order,
                    size: self.ball(x, node).size,
                };
                batch.push(([side(0, t), side(1, u)], accepted.r));
                if batch.len() == BATCH {
                    sum.far += expand(order, &mut batch, &mut buffers);
                }
            } else if t.is_leaf() && u.is_leaf() {
                let [first, second] = self.trees;
                let range = |n: Node| n.first as usize * LEAF..(n.first as usize + 1) * LEAF;
                let (ends, ranges) = ([&first.ends, &second.ends], [range(t), range(u)]);
                if self.own {
                    let numbers = &first.numbers;
                    let skipped = |k: usize, at: usize| {
                        std::array::from_fn(|l| {
                            let (a, b) = (numbers[k], numbers[at + l]);
                            let apart = a.abs_diff(b);
                            apart <= 1
                                || first.last == Some(apart)
                                || a == FILLER
                                || b == FILLER
                                || (t.place == u.place && b < a)
                        })
                    };
                    angles.add_segments(ends, ranges, skipped);
                } else {
                    angles.add_segments(ends, ranges, |_, _| Default::default());
                }
                sum.summed += 1;
            } else {
                self.open((t, u), &mut agenda);
            }
        }
        if !batch.is_empty() {
            sum.far += expand(order, &mut batch, &mut buffers);
        }
        (sum.near, sum.near_error) = angles.turns();
        sum
    }
}

/// Sums a batch and empties it.
#[inline(always)]
fn expand(order: usize, batch: &mut Vec<([Side; 2], Point)>, buffers: &mut Buffers) -> f64 {
    let values = interact(order, batch, buffers);
    batch.clear();
    values.iter().sum()
}
