//! Trees for the GPU kernel: the nodes of all curves in one list, in single precision, with
//! normalized moments.

use super::trees::{LEAF, Node, Tree};
use crate::curve::Point;
use crate::curve::vector::per_axis;
use crate::kernels::gpu::Node as Packed;
use std::ops::Range;

/// Number of leaves of the CPU tree in one packed leaf.
const LEAVES: u32 = 4;

/// Maximum number of segments of a packed leaf.
pub(crate) const LEAF_SEGMENTS: u32 = LEAVES * LEAF as u32;

/// Appends the nodes of a closed polyline to `out`, root first. Returns the number of levels. The
/// coordinates are between -1 and 1. `first_vertex` is the index of the first uploaded vertex.
pub(crate) fn pack(points: &[Point], first_vertex: u32, out: &mut Vec<Packed>) -> u32 {
    let tree = Tree::of(points);
    if tree.reach.is_empty() {
        return 0;
    }
    let vertices = first_vertex..first_vertex + points.len() as u32;
    add(&tree, tree.root(), vertices, out)
}

fn add(tree: &Tree, node: Node, vertices: Range<u32>, out: &mut Vec<Packed>) -> u32 {
    /// Factor that exceeds the rounding error of single precision.
    const UP: f64 = 1.0 + 2.0 * f32::EPSILON as f64;
    let reach = &tree.reach[node.place as usize];
    let radius = reach.radius * UP;
    // The reciprocal of 0 is replaced by 0, because all moments are 0 without radius or length.
    let over = |x: f64| if x > 0.0 { 1.0 / x } else { 0.0 };
    let square = over(radius * radius);
    let high = reach.centre.map(|x| x as f32);
    let low = per_axis(|x| (reach.centre[x] - f64::from(high[x])) as f32);
    let first = vertices.start + node.first * LEAF as u32;
    let at = out.len();
    let mut packed = Packed {
        centre: high,
        centre_rest: low,
        radius: (radius * UP) as f32,
        length: (reach.length * UP) as f32,
        second: ((reach.second * square * UP) as f32).min(1.0),
        fourth: ((reach.fourth * square * square * UP) as f32).min(1.0),
        tangents: reach.tangents.map(|t| t as f32),
        first,
        segments: (node.leaves * LEAF as u32).min(vertices.end - first),
        leaf: u32::from(node.leaves <= LEAVES),
        ..Packed::default()
    };
    // Moments are divided by the rounded values, because the shader multiplies by these.
    let [by_length, by_radius] = [packed.length, packed.radius].map(|x| over(f64::from(x)));
    let moments = tree.moments[node.place as usize].0;
    for (k, (to, from)) in packed.moments.iter_mut().zip(moments).enumerate() {
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
    let below = add(tree, left, vertices.clone(), out);
    out[at].right = out.len() as u32;
    1 + below.max(add(tree, right, vertices, out))
}
