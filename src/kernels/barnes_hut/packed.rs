//! Trees for those who cannot follow ours: nodes in one list for all curves, in single precision, without units.

use super::moments::COUNT;
use super::trees::{LEAF, Node, Tree};
use crate::curve::Point;

/// Leaves of ours in a leaf of theirs.
const LEAVES: u32 = 4;

/// Segments of a leaf, at most.
pub(crate) const LEAF_SEGMENTS: u32 = LEAVES * LEAF as u32;

/// A node. Upper bounds are rounded up, all else to the nearest; moments are about the centre, over the length and for
/// each order the radius.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PackedNode {
    /// Centre, in two parts: the second is what the first one lacks.
    pub centre: [[f32; 3]; 2],
    /// An upper bound of the distance of its points from the centre.
    pub radius: f32,
    /// Length.
    pub length: f32,
    /// Mean of the square of the distance from the centre over that of the radius, an upper bound.
    pub second: f32,
    /// Mean of its fourth power over that of the radius, an upper bound.
    pub fourth: f32,
    /// Mean of the products of the unit tangent's coordinates.
    pub tangents: [f32; 6],
    /// The second child; the first one comes next. 0: a leaf.
    pub right: u32,
    /// First segment.
    pub first: u32,
    /// Segments.
    pub segments: u32,
    /// Moments.
    pub moments: [f32; COUNT],
}

/// Appends the nodes of a closed polyline, root first; returns the number of levels. The vertices are between -1 and 1.
pub(crate) fn pack(points: &[Point], out: &mut Vec<PackedNode>) -> u32 {
    let tree = Tree::of(points);
    if tree.reach.is_empty() {
        return 0;
    }
    add(&tree, tree.root(), points.len() as u32, out)
}

fn add(tree: &Tree, node: Node, segments: u32, out: &mut Vec<PackedNode>) -> u32 {
    /// More than rounding to single precision costs.
    const UP: f64 = 1.0 + 2.0 * f32::EPSILON as f64;
    let reach = &tree.reach[node.place as usize];
    let radius = reach.radius * UP;
    // Without a radius or a length there is nothing to divide.
    let over = |x: f64| if x > 0.0 { 1.0 / x } else { 0.0 };
    let square = over(radius * radius);
    let high = reach.centre.map(|x| x as f32);
    let low = [0, 1, 2].map(|x| (reach.centre[x] - f64::from(high[x])) as f32);
    let first = node.first * LEAF as u32;
    let at = out.len();
    let mut packed = PackedNode {
        centre: [high, low],
        radius: (radius * UP) as f32,
        length: (reach.length * UP) as f32,
        second: ((reach.second * square * UP) as f32).min(1.0),
        fourth: ((reach.fourth * square * square * UP) as f32).min(1.0),
        tangents: reach.tangents.map(|t| t as f32),
        right: 0,
        first,
        segments: (node.leaves * LEAF as u32).min(segments - first),
        moments: [0.0; COUNT],
    };
    // Those by which the programs multiply.
    let (by_length, by_radius) = (
        over(f64::from(packed.length)),
        over(f64::from(packed.radius)),
    );
    for (k, (to, from)) in packed
        .moments
        .iter_mut()
        .zip(tree.moments[node.place as usize].0)
        .enumerate()
    {
        let order = match k {
            0..3 => 1.0,
            3..12 => by_radius,
            _ => by_radius * by_radius,
        };
        *to = (from * by_length * order) as f32;
    }
    out.push(packed);
    if node.leaves <= LEAVES {
        return 1;
    }
    let [left, right] = node.children();
    let below = add(tree, left, segments, out);
    out[at].right = out.len() as u32;
    1 + below.max(add(tree, right, segments, out))
}
