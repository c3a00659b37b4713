//! Moments of the nodes of a curve.

use super::harmonics::{Lanes, add_segments, add_shifted, count};
use super::norms::Norms;
use super::tree::{Ball, GRAIN, LEAF, Tree};
use crate::curve::vector::per_axis;
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
    pub norms: Norms,
}

impl Expansions {
    /// Returns the upper bounds of the norms, without moments.
    pub fn outline(tree: &Tree, order: usize) -> Expansions {
        Expansions {
            order,
            least: 0,
            moments: Vec::new(),
            norms: Norms::outline(order, tree),
        }
    }

    /// Computes the moments about their centres of all nodes with at least `least` leaves.
    pub fn fill(&mut self, tree: &Tree, least: u32) {
        let nodes = tree.balls.len();
        self.least = least.max(1);
        self.moments = vec![0.0; 2 * count(self.order) * nodes];
        let leaves = nodes.div_ceil(2);
        let build = Build {
            tree,
            order: self.order,
            least: self.least as usize,
        };
        if leaves >= build.least {
            let norms = &mut self.norms.values;
            build.node([0, 0, leaves], &mut self.moments, norms);
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
}

/// Common data of all nodes of a tree during the construction.
struct Build<'a> {
    tree: &'a Tree,
    order: usize,
    least: usize,
}

impl Build<'_> {
    /// Computes the moments of a subtree, given by its place, first leaf and number of leaves.
    fn node(&self, [place, first, leaves]: [usize; 3], moments: &mut [f64], norms: &mut [f64]) {
        let order = self.order;
        let (size, width) = (2 * count(order), Norms::width(order));
        let (own, below) = moments.split_at_mut(size);
        let (own_norms, norms_below) = norms.split_at_mut(width);
        let ball = self.tree.balls[place];
        let half = leaves / 2;
        let at = [
            [place + 1, first, half],
            [place + 2 * half, first + half, leaves - half],
        ];
        let both = half >= self.least;
        if leaves > 1 && leaves - half >= self.least {
            let (left, right) = below.split_at_mut((2 * half - 1) * size);
            let (norms_left, norms_right) = norms_below.split_at_mut((2 * half - 1) * width);
            let lower = || {
                if both {
                    self.node(at[0], left, norms_left);
                }
            };
            let upper = || self.node(at[1], right, norms_right);
            join(leaves > GRAIN, lower, upper);
        }
        if leaves <= DIRECT || !both {
            let range = first * LEAF..(first + leaves) * LEAF;
            dispatch!(expand(self.tree, order, range, &ball, &mut *own));
        } else {
            for place in [at[0][0], at[1][0]] {
                let child = self.tree.balls[place];
                let moments = &below[(place - at[0][0]) * size..][..size];
                let r = per_axis(|x| (child.centre[x] - ball.centre[x]) / ball.size);
                add_shifted(order, moments, child.size / ball.size, r, own);
            }
        }
        Norms::tighten(order, &ball, own, own_norms);
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
