//! Spatial trees over the segments of the curves.
//!
//! Wound curves return to the same place again and again, so a node holds the segments of a region,
//! not a run of consecutive segments. A node is split at the median of the midpoints of its
//! segments, along the longest side of their box. Nodes are stored in preorder, as those of
//! [`super::super::barnes_hut`], so that the places of the children follow from the number of
//! leaves. All leaves but the last one are full.

use crate::curve::pow2;
use crate::curve::vector::{norm, per_axis, sub};
use crate::curve::{Point, bounds, union};
use crate::kernels::sums::barnes_hut::Node;
use crate::kernels::sums::join;
use std::ops::Range;

/// Number of segments of a leaf.
pub(super) const LEAF: usize = 16;

/// Number of leaves above which a subtree is built in a parallel task.
pub(super) const GRAIN: usize = 1 << 5;

/// A ball around the segments of a node.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ball {
    /// Centre of the expansions.
    pub centre: Point,
    /// Upper bound of the distance of its points from the centre.
    pub radius: f64,
    /// Radius of a ball around this centre that contains this ball and those of all descendants.
    pub spread: f64,
    /// Upper bound of the total length of the segments.
    pub length: f64,
    /// Unit of the moments: a power of two, at least the radius.
    pub size: f64,
}

/// Tree of a curve.
#[derive(Clone, Debug)]
pub(super) struct Tree {
    /// Start and end points of the segments, as an array for each axis, in the order of the leaves.
    /// The last leaf is padded with points.
    pub ends: [[Vec<f64>; 3]; 2],
    pub balls: Vec<Ball>,
    /// Indices of the segments along the curve; [`FILLER`] for the padding.
    pub numbers: Vec<u32>,
    /// Index of the last segment, if it is adjacent to the first one.
    pub last: Option<u32>,
}

/// Index of a segment that only pads a leaf.
pub(super) const FILLER: u32 = u32::MAX;

/// A segment before the tree is built.
#[derive(Clone, Copy, Debug, Default)]
struct Segment {
    ends: [Point; 2],
    number: u32,
}

impl Segment {
    fn middle(&self, x: usize) -> f64 {
        0.5 * self.ends[0][x] + 0.5 * self.ends[1][x]
    }
}

impl Tree {
    /// Builds the tree of a polyline with at least one segment, whose coordinates are at most 1.
    pub fn of(points: &[Point], closed: bool) -> Tree {
        let n = points.len();
        let mut segments: Vec<Segment> = (0..n - usize::from(!closed))
            .map(|k| Segment {
                ends: [points[k], points[if k + 1 < n { k + 1 } else { 0 }]],
                number: k as u32,
            })
            .collect();
        let last = closed.then(|| segments.len() as u32 - 1);
        let leaves = segments.len().div_ceil(LEAF);
        sort(&mut segments, leaves);
        let end = segments.last().map_or([0.0; 3], |s| s.ends[1]);
        let filler = Segment {
            ends: [end; 2],
            number: FILLER,
        };
        segments.resize(leaves * LEAF, filler);
        let ends = [0, 1].map(|e| per_axis(|x| segments.iter().map(|s| s.ends[e][x]).collect()));
        let mut balls = vec![Ball::default(); (2 * leaves).saturating_sub(1)];
        enclose(&ends, Node::root(leaves as u32), &mut balls);
        Tree {
            ends,
            balls,
            numbers: segments.iter().map(|s| s.number).collect(),
            last,
        }
    }

    pub fn root(&self) -> Node {
        Node::root(self.balls.len().div_ceil(2) as u32)
    }
}

/// Returns the range of the segments of a node.
pub(super) fn segments_of(node: Node) -> Range<usize> {
    node.first as usize * LEAF..(node.first + node.leaves) as usize * LEAF
}

/// Sorts segments into leaves, and within a leaf by their index, so that neighbours share end
/// points.
fn sort(segments: &mut [Segment], leaves: usize) {
    if leaves <= 1 {
        segments.sort_unstable_by_key(|s| s.number);
        return;
    }
    let middles = segments.iter().map(|s| per_axis(|x| s.middle(x)));
    let [lo, hi] = bounds(middles);
    let side = |x: usize| hi[x] - lo[x];
    let axis = (1..3).fold(0, |best, x| if side(x) > side(best) { x } else { best });
    let half = leaves / 2;
    let order = |a: &Segment, b: &Segment| {
        let by_place = a.middle(axis).total_cmp(&b.middle(axis));
        by_place.then(a.number.cmp(&b.number))
    };
    if half * LEAF < segments.len() {
        segments.select_nth_unstable_by(half * LEAF, order);
    }
    let (left, right) = segments.split_at_mut(half * LEAF);
    let lower = || sort(left, half);
    join(leaves > GRAIN, lower, || sort(right, leaves - half));
}

/// Minimum and maximum of each coordinate.
type Extent = [Point; 2];

/// Computes the balls of a subtree. Returns its bounding box.
fn enclose(ends: &[[Vec<f64>; 3]; 2], node: Node, balls: &mut [Ball]) -> Extent {
    let Some((ball, below)) = balls.split_first_mut() else {
        return [[0.0; 3]; 2];
    };
    let range = segments_of(node);
    let end = |e: usize, k: usize| per_axis(|x| ends[e][x][k]);
    let extent;
    if node.is_leaf() {
        extent = bounds(range.clone().flat_map(|k| [end(0, k), end(1, k)]));
        let length = |k: usize| norm(sub(end(1, k), end(0, k)));
        ball.length = range.clone().map(length).sum();
    } else {
        let [a, b] = node.children();
        let (left, right) = below.split_at_mut((b.place - a.place) as usize);
        let (lower, upper) = (|| enclose(ends, a, left), || enclose(ends, b, right));
        let (lower, upper) = join(node.leaves as usize > GRAIN, lower, upper);
        extent = union(lower, upper);
        ball.length = left[0].length + right[0].length;
    }
    let centre = per_axis(|x| 0.5 * extent[0][x] + 0.5 * extent[1][x]);
    let mut farthest: f64 = 0.0;
    for points in ends {
        let [x, y, z] = points.each_ref().map(|p| &p[range.clone()]);
        for ((x, y), z) in x.iter().zip(y).zip(z) {
            let r = [x - centre[0], y - centre[1], z - centre[2]];
            farthest = farthest.max(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
        }
    }
    ball.centre = centre;
    // Rounded up, and at least as large as lengths whose squares underflow.
    ball.radius = (farthest.sqrt() * SLACK).max(SMALLEST / 2.0);
    ball.spread = below.iter().fold(ball.radius, |spread, b| {
        let distance = norm(sub(b.centre, centre));
        spread.max((distance + b.radius) * SLACK + SMALLEST)
    });
    ball.length = ball.length * SLACK + SHORTEST;
    ball.size = power_above(ball.radius);
    extent
}

/// Factor that covers the rounding of radii and lengths, on every level.
const SLACK: f64 = 1.0 + 1e-12;

/// Upper bound of the lengths of segments whose squares underflow.
const SHORTEST: f64 = pow2(-500);

/// Minimum unit of the moments.
const SMALLEST: f64 = pow2(-400);

/// Returns the least power of two above a positive normal number.
fn power_above(x: f64) -> f64 {
    f64::from_bits(((x.to_bits() >> 52) + 1) << 52)
}
