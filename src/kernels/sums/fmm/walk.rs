//! Simultaneous descent in two trees.

use super::bound::{Bounding, WIDEST};
use super::expansions::Expansions;
use super::interact::{BATCH, Buffers, Side, interact};
use super::tree::{Ball, FILLER, Tree, segments_of};
use crate::cancel::Cancel;
use crate::curve::Point;
use crate::kernels::sums::barnes_hut::{Angles, Bounds, Node};
use crate::kernels::sums::descent::{Descent, NodePair, Sum, over};
use crate::simd::dispatch;
use std::f64::consts::PI;

/// Criterion of one pass.
#[derive(Clone, Copy, Debug)]
pub(super) enum Criterion {
    /// Accepts if the sum of the radii is at most this times the distance of the centres.
    Separation(f64),
    /// Accepts if the bound of the remainder is below this; with 0, accepts nothing.
    Share(f64),
}

/// Number of tasks of a dry run after which its limit is checked.
const GROUP: usize = 32;

/// Returns the approximate CPU time of a sum, in microseconds.
pub(super) fn work(sum: &Sum, order: usize) -> f64 {
    let p = order as f64;
    sum.expanded as f64 * 0.001 * p * p * p + sum.summed as f64 * 0.8
}

/// Two trees and a criterion.
#[derive(Clone, Copy)]
pub(super) struct Walk<'a> {
    trees: [&'a Tree; 2],
    expansions: Option<[&'a Expansions; 2]>,
    bounding: Bounding,
    criterion: Criterion,
    /// Ends the walk early.
    cancel: Option<&'a Cancel>,
    /// True if both are the tree of one curve. Each pair of its segments is then summed once,
    /// except adjacent ones, which lie in a plane and contribute nothing.
    own: bool,
}

/// An accepted node pair.
pub(super) struct Accepted {
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
            cancel: None,
            own: std::ptr::eq(trees[0], trees[1]),
        }
    }

    /// Returns the walk, which ends early with wrong sums once it is cancelled.
    pub fn until(self, cancel: Option<&'a Cancel>) -> Walk<'a> {
        Walk { cancel, ..self }
    }

    #[inline(always)]
    fn is_cancelled(&self) -> bool {
        self.cancel.is_some_and(Cancel::is_set)
    }

    /// Returns an estimate of the sum of the magnitudes of all contributions.
    pub fn magnitude(trees: [&'a Tree; 2], cancel: Option<&'a Cancel>) -> f64 {
        let walk = Walk::new(trees, [None; 2], Criterion::Share(0.0)).until(cancel);
        let smallest = trees.map(|t| t.balls[0].radius / 64.0);
        let mut agenda = vec![walk.roots()];
        let mut sum = 0.0;
        while let Some((t, u)) = agenda.pop()
            && !walk.is_cancelled()
        {
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

    /// Dry run: returns the work and the remainder of a pass, without the sum. Returns `None` as
    /// soon as the work exceeds `limit`, in microseconds, or the walk is cancelled.
    pub fn plan(&self, limit: f64) -> Option<Sum> {
        let dry = |mut agenda: Vec<NodePair>| {
            let mut sum = Sum::default();
            while let Some((t, u)) = agenda.pop()
                && !self.is_cancelled()
            {
                sum.visited += 1;
                if let Some(accepted) = self.accepted((t, u)) {
                    sum.bounds.tail += accepted.bounds.tail;
                    sum.expanded += 1;
                    let [a, b] = sum.smallest.unwrap_or([t.leaves, u.leaves]);
                    sum.smallest = Some([a.min(t.leaves), b.min(u.leaves)]);
                } else if t.is_leaf() && u.is_leaf() {
                    sum.summed += 1;
                } else {
                    self.open((t, u), &mut agenda);
                }
            }
            sum
        };
        let mut plan = Sum::default();
        let order = self.expansions.map_or(0, |e| e[0].order);
        for group in self.tasks().chunks(GROUP) {
            plan = plan.plus(over(group, dry));
            if work(&plan, order) > 1.2 * limit || self.is_cancelled() {
                return None;
            }
        }
        Some(plan)
    }

    #[inline(always)]
    fn run_inline(&self, mut agenda: Vec<NodePair>) -> Sum {
        let order = self.expansions.map_or(0, |e| e[0].order);
        let mut buffers = Buffers::new(order);
        let mut sum = Sum::default();
        let mut angles = Angles::ZERO;
        let mut batch: Vec<([Side; 2], Point)> = Vec::with_capacity(BATCH);
        while let Some((t, u)) = agenda.pop()
            && !self.is_cancelled()
        {
            sum.visited += 1;
            if let (Some(accepted), Some(expansions)) = (self.accepted((t, u)), self.expansions) {
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
                let (ends, ranges) = ([&first.ends, &second.ends], [t, u].map(segments_of));
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

impl Descent for Walk<'_> {
    type Accepted = Accepted;
    const TASKS: usize = 256;
    const SMALL: usize = 8;

    fn roots(&self) -> NodePair {
        self.trees.map(Tree::root).into()
    }

    #[inline(always)]
    fn accepted(&self, (t, u): NodePair) -> Option<Accepted> {
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
            expansions[0].norms_of(t.place as usize),
            expansions[1].norms_of(u.place as usize),
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

    #[inline(always)]
    fn radius(&self, side: usize, node: Node) -> f64 {
        self.ball(side, node).radius
    }

    #[inline(always)]
    fn is_own(&self) -> bool {
        self.own
    }

    fn run(&self, agenda: Vec<NodePair>) -> Sum {
        dispatch!(Self::run_inline(self, agenda))
    }
}

/// Sums a batch and empties it.
#[inline(always)]
fn expand(order: usize, batch: &mut Vec<([Side; 2], Point)>, buffers: &mut Buffers) -> f64 {
    let values = interact(order, batch, buffers);
    batch.clear();
    values.iter().sum()
}
