//! Moments of the nodes of a curve.

use super::harmonics::{Lanes, add_segments, add_shifted, count};
use super::norms;
use super::tree::{Ball, GRAIN, Tree, segments_of};
use crate::curve::vector::per_axis;
use crate::kernels::sums::barnes_hut::Node;
use crate::kernels::sums::join;
use crate::simd::dispatch;
use std::ops::Range;

/// Number of segments whose moments are computed together.
const TOGETHER: usize = 8;

/// Maximum number of leaves for which the segments of a node are expanded instead of shifting the
/// moments of its children, which costs as much as some hundred segments.
const DIRECT: usize = 16;

/// Moments of the nodes of a curve, and their norms for the error bound.
#[derive(Clone, Debug)]
pub(super) struct Expansions {
    pub order: usize,
    /// Minimum number of leaves of a node that has moments.
    pub least: u32,
    /// Moments of all nodes: `P`, then `T`, of each node.
    moments: Vec<f64>,
    /// Norms of all nodes, in units of the node.
    norms: Vec<f64>,
}

impl Expansions {
    /// Returns the upper bounds of the norms, without moments.
    pub fn outline(tree: &Tree, order: usize) -> Expansions {
        let mut norms = vec![0.0; tree.balls.len() * norms::width(order)];
        if !norms.is_empty() {
            norms::outline(tree, order, tree.root(), &mut norms);
        }
        Expansions {
            order,
            least: 0,
            moments: Vec::new(),
            norms,
        }
    }

    /// Computes the moments about their centres of all nodes with at least `least` leaves.
    pub fn fill(&mut self, tree: &Tree, least: u32) {
        let nodes = tree.balls.len();
        self.least = least.max(1);
        self.moments = vec![0.0; 2 * count(self.order) * nodes];
        let build = Build {
            tree,
            order: self.order,
            least: self.least,
        };
        if tree.root().leaves >= build.least {
            build.node(tree.root(), &mut self.moments, &mut self.norms);
        }
    }

    /// Returns `P`, then `T`, of a node.
    #[inline(always)]
    pub fn of(&self, place: usize) -> &[f64] {
        let size = 2 * count(self.order);
        self.moments
            .get(place * size..(place + 1) * size)
            .unwrap_or(&[])
    }

    /// Returns the norms of `P` and of `T` of a node, from degree 1 on.
    #[inline(always)]
    pub fn norms_of(&self, place: usize) -> [&[f64]; 2] {
        let width = norms::width(self.order);
        let both = &self.norms[place * width..][..width];
        let (p, t) = both.split_at(self.order + 1);
        [p, t]
    }
}

/// Common data of all nodes of a tree during the construction.
struct Build<'a> {
    tree: &'a Tree,
    order: usize,
    least: u32,
}

impl Build<'_> {
    /// Computes the moments of a subtree.
    fn node(&self, node: Node, moments: &mut [f64], norms: &mut [f64]) {
        let order = self.order;
        let (size, width) = (2 * count(order), norms::width(order));
        let (own, below) = moments.split_at_mut(size);
        let (own_norms, norms_below) = norms.split_at_mut(width);
        let ball = self.tree.balls[node.place as usize];
        let [a, b] = node.children();
        let both = a.leaves >= self.least;
        if !node.is_leaf() && b.leaves >= self.least {
            let nodes = (b.place - a.place) as usize;
            let (left, right) = below.split_at_mut(nodes * size);
            let (norms_left, norms_right) = norms_below.split_at_mut(nodes * width);
            let lower = || {
                if both {
                    self.node(a, left, norms_left);
                }
            };
            let upper = || self.node(b, right, norms_right);
            join(node.leaves as usize > GRAIN, lower, upper);
        }
        if node.leaves as usize <= DIRECT || !both {
            let range = segments_of(node);
            dispatch!(expand(self.tree, order, range, &ball, &mut *own));
        } else {
            for Node { place, .. } in [a, b] {
                let child = self.tree.balls[place as usize];
                let moments = &below[(place - a.place) as usize * size..][..size];
                let r = per_axis(|x| (child.centre[x] - ball.centre[x]) / ball.size);
                add_shifted(order, moments, child.size / ball.size, r, own);
            }
        }
        norms::tighten(order, &ball, own, own_norms);
    }
}

/// Computes the moments of a range of segments.
#[inline(always)]
fn expand(tree: &Tree, order: usize, range: Range<usize>, ball: &Ball, out: &mut [f64]) {
    let mut buffers = [(); 2].map(|()| vec![[0.0; TOGETHER]; count(order)]);
    let mut sums: Vec<Lanes<TOGETHER>> = vec![[0.0; TOGETHER]; 2 * count(order)];
    let [starts, ends] = &tree.ends;
    for start in range.step_by(TOGETHER) {
        let mut p = [[0.0; TOGETHER]; 3];
        let mut e = [[0.0; TOGETHER]; 3];
        for x in 0..3 {
            for l in 0..TOGETHER {
                let at = starts[x][start + l];
                p[x][l] = (at - ball.centre[x]) / ball.size;
                e[x][l] = (ends[x][start + l] - at) / ball.size;
            }
        }
        add_segments(order, &p, &e, &mut buffers, &mut sums);
    }
    for (out, lanes) in out.iter_mut().zip(&sums) {
        *out = lanes.iter().sum();
    }
}
