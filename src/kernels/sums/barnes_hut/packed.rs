//! Trees for the GPU kernel: the nodes of all curves in one list, in single precision, with
//! normalized moments.

use super::moments::COUNT;
use super::trees::{LEAF, Node, Tree};
use crate::curve::Point;

/// Number of leaves of the CPU tree in one packed leaf.
const LEAVES: u32 = 4;

/// Maximum number of segments of a packed leaf.
pub(crate) const LEAF_SEGMENTS: u32 = LEAVES * LEAF as u32;

/// A packed node. Upper bounds are rounded up, all other values to the nearest. Moments are about
/// the centre, divided by the length and, for each order, by the radius.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PackedNode {
    /// Centre, in two parts: the rounded value and its rounding error.
    pub centre: [[f32; 3]; 2],
    /// Upper bound of the distance of its points from the centre.
    pub radius: f32,
    /// Total length of the segments.
    pub length: f32,
    /// Upper bound of the mean of the squared distance from the centre, divided by the squared
    /// radius.
    pub second: f32,
    /// Upper bound of the mean of the fourth power of the distance, divided by that of the radius.
    pub fourth: f32,
    /// Means of the products of the coordinates of the unit tangent.
    pub tangents: [f32; 6],
    /// Index of the second child; the first child is the next node. 0 for a leaf.
    pub right: u32,
    /// Index of the first segment.
    pub first: u32,
    /// Number of segments.
    pub segments: u32,
    /// Moments about the centre.
    pub moments: [f32; COUNT],
}

/// Appends the nodes of a closed polyline, root first. Returns the number of levels. The
/// coordinates are between -1 and 1.
pub(crate) fn pack(points: &[Point], out: &mut Vec<PackedNode>) -> u32 {
    let tree = Tree::of(points, true);
    if tree.reach.is_empty() {
        return 0;
    }
    add(&tree, tree.root(), points.len() as u32, out)
}

fn add(tree: &Tree, node: Node, segments: u32, out: &mut Vec<PackedNode>) -> u32 {
    /// Factor that exceeds the rounding error of single precision.
    const UP: f64 = 1.0 + 2.0 * f32::EPSILON as f64;
    let reach = &tree.reach[node.place as usize];
    let radius = reach.radius * UP;
    // Without a radius or a length all moments are 0.
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
    // The rounded values that the shader multiplies by.
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
