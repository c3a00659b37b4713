//! Binary trees over the curves, with moments.
//!
//! A curve is spatially coherent, so its tree halves the list of its leaves recursively; a leaf is
//! a run of segments. Nodes are stored in preorder, so that the places of the children follow from
//! the number of leaves, and a subtree is a slice that a parallel task can own. Nodes have two
//! children, not eight as in the trees of boxes: the size of nodes then follows their distance more
//! closely, and fewer node pairs are needed.

use super::bound::Reach;
use super::moments::Moments;
use crate::curve::pow2;
use crate::curve::vector::{dot, norm, per_axis, sub};
use crate::curve::{Point, bounds, union};
use crate::kernels::sums::join;

/// Number of segments of a leaf, and number of lanes of the near field.
pub(super) const LEAF: usize = 4;

/// Number of leaves above which a subtree is built in a parallel task.
const GRAIN: usize = 1 << 10;

/// A node: its place in preorder, and its range of leaves.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernels) struct Node {
    pub place: u32,
    pub first: u32,
    pub leaves: u32,
}

impl Node {
    fn new(place: u32, first: u32, leaves: u32) -> Node {
        Node {
            place,
            first,
            leaves,
        }
    }

    /// Returns the root, which contains all leaves.
    pub fn root(leaves: u32) -> Node {
        Node::new(0, 0, leaves)
    }

    pub fn is_leaf(self) -> bool {
        self.leaves == 1
    }

    /// Returns both children of a node that is not a leaf.
    pub fn children(self) -> [Node; 2] {
        let Node { place, first, .. } = self;
        let half = self.leaves / 2;
        let right = Node::new(place + 2 * half, first + half, self.leaves - half);
        [Node::new(place + 1, first, half), right]
    }
}

/// Tree of a curve.
#[derive(Clone, Debug)]
pub(super) struct Tree {
    /// Vertices, as an array for each axis: one more than the leaves have segments. The end is
    /// padded with copies of the first vertex.
    pub vertices: [Vec<f64>; 3],
    pub reach: Vec<Reach>,
    pub moments: Vec<Moments>,
}

impl Tree {
    /// Builds the tree of a closed polyline, whose coordinates are at most 1.
    pub fn of(points: &[Point]) -> Tree {
        let leaves = points.len().div_ceil(LEAF);
        let vertices = per_axis(|x| {
            let mut v = Vec::with_capacity(leaves * LEAF + 1);
            v.extend(points.iter().map(|p| p[x]));
            let end = v.first().copied().unwrap_or_default();
            v.resize(leaves * LEAF + 1, end);
            v
        });
        let nodes = (2 * leaves).saturating_sub(1);
        let mut reach = vec![Reach::default(); nodes];
        let mut moments = vec![Moments::ZERO; nodes];
        let root = Node::root(leaves as u32);
        build(&vertices, root, &mut reach, &mut moments);
        Tree {
            vertices,
            reach,
            moments,
        }
    }

    pub fn root(&self) -> Node {
        Node::root(self.reach.len().div_ceil(2) as u32)
    }
}

/// Builds a subtree. Returns its bounding box.
fn build(
    vertices: &[Vec<f64>; 3],
    node: Node,
    reach: &mut [Reach],
    moments: &mut [Moments],
) -> [Point; 2] {
    let (Some((reach, below)), Some((own, moments_below))) =
        (reach.split_first_mut(), moments.split_first_mut())
    else {
        return [[0.0; 3]; 2];
    };
    if node.is_leaf() {
        return build_leaf(vertices, node.first as usize * LEAF, reach, own);
    }
    let [a, b] = node.children();
    let nodes = (b.place - a.place) as usize;
    let (left, right) = below.split_at_mut(nodes);
    let (moments_left, moments_right) = moments_below.split_at_mut(nodes);
    let build_left = || build(vertices, a, left, moments_left);
    let build_right = || build(vertices, b, right, moments_right);
    let (left_box, right_box) = join(node.leaves as usize > GRAIN, build_left, build_right);
    let extent = union(left_box, right_box);
    let parts = [(&left[0], &moments_left[0]), (&right[0], &moments_right[0])];
    let length = parts[0].0.length + parts[1].0.length;
    let shares = match length > 0.0 {
        true => parts.map(|(child, _)| child.length / length),
        false => [0.5; 2],
    };
    let centre = per_axis(|x| {
        let [p, q] = parts.map(|(child, _)| child.centre[x]);
        p + shares[1] * (q - p)
    });
    *reach = Reach {
        centre,
        length,
        ..Reach::default()
    };
    let mut by_children: f64 = 0.0;
    for ((child, child_moments), share) in parts.into_iter().zip(shares) {
        let r = sub(child.centre, centre);
        own.add_shifted(child_moments, r);
        let square = dot(r, r);
        let shift = square.sqrt();
        reach.second += share * (child.second + square);
        // The mean of p^2 (p . r), the only odd term that does not vanish, is at most |r|
        // root(<p^2> <p^4>).
        let odd = 4.0 * shift * (child.second * child.fourth).sqrt();
        let fourth = child.fourth + odd + square * (6.0 * child.second + square);
        reach.fourth += share * fourth;
        by_children = by_children.max(child.radius + shift);
        for (s, t) in reach.tangents.iter_mut().zip(child.tangents) {
            *s += share * t;
        }
    }
    let corner = per_axis(|x| (extent[1][x] - centre[x]).max(centre[x] - extent[0][x]));
    finish(reach, by_children.min(norm(corner)));
    extent
}

fn build_leaf(
    vertices: &[Vec<f64>; 3],
    start: usize,
    reach: &mut Reach,
    moments: &mut Moments,
) -> [Point; 2] {
    let point = |k: usize| vertices.each_ref().map(|v| v[start + k]);
    let side = |k: usize| {
        let (p, q) = (point(k), point(k + 1));
        let c = sub(q, p);
        (c, norm(c))
    };
    let sides: [_; LEAF] = std::array::from_fn(side);
    let base = point(0);
    let length: f64 = sides.iter().map(|s| s.1).sum();
    let share = |k: usize| match length > 0.0 {
        true => sides[k].1 / length,
        false => 0.0,
    };
    let from = |centre: Point, k: usize| {
        let (p, q) = (point(k), point(k + 1));
        per_axis(|x| 0.5 * (p[x] - centre[x]) + 0.5 * (q[x] - centre[x]))
    };
    let mut centre = base;
    for k in 0..LEAF {
        let r = from(base, k);
        for x in 0..3 {
            centre[x] += share(k) * r[x];
        }
    }
    *reach = Reach {
        centre,
        length,
        ..Reach::default()
    };
    let distances = (0..=LEAF).map(|k| {
        let r = sub(point(k), centre);
        dot(r, r)
    });
    let farthest = distances.fold(0.0, f64::max);
    for (k, &(c, size)) in sides.iter().enumerate() {
        let r = from(centre, k);
        moments.add_segment(c, r);
        // Means over the points r + x h with x from -1 to 1.
        let (square, half, along) = (dot(r, r), dot(c, c) / 4.0, dot(r, c) / 2.0);
        reach.second += share(k) * (square + half / 3.0);
        let mixed = square * (square + 2.0 / 3.0 * half);
        reach.fourth += share(k) * (mixed + 4.0 / 3.0 * along * along + half * half / 5.0);
        if size > 0.0 {
            let t = c.map(|c| c / size);
            let weight = share(k);
            for (s, (i, j)) in reach.tangents.iter_mut().zip(super::moments::PAIRS) {
                *s += weight * t[i] * t[j];
            }
        }
    }
    finish(reach, farthest.sqrt());
    bounds((0..=LEAF).map(point))
}

/// Rounds the bounds up, because the centre is not exactly the centroid, and because all of them
/// are rounded.
///
/// Coordinates are at most 1, so the distance of a centre from the centroid is less than `2^-46`
/// after 32 levels. That changes the mean of `p^2` by less than 8 times this distance times the
/// radius, the mean of `p^4` by 32 times this distance times the cube of the radius, and the means
/// over `d` by less than the sums of both.
fn finish(reach: &mut Reach, radius: f64) {
    const SLACK: f64 = pow2(-40);
    const OFF: f64 = pow2(-46);
    let radius = radius * (1.0 + SLACK);
    let square = radius * radius;
    reach.radius = radius;
    let means = [square, square * reach.second.min(square)];
    reach.second = reach.second.min(means[0]) + SLACK * square + 8.0 * OFF * radius;
    let slack = SLACK * square * square + 32.0 * OFF * radius * square;
    reach.fourth = reach.fourth.min(means[1]) + slack;
}
