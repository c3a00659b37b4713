//! Segment pairs of two curves whose boxes overlap in space.

use super::trees::{Node, Trees};
use crate::curve::{BoxGroup, CurveSet};

/// All segment pairs of curves `i` and `j` with overlapping boxes, sorted.
pub(crate) fn overlapping_segments(
    set: &CurveSet,
    trees: &Trees,
    i: usize,
    j: usize,
) -> Vec<(u32, u32)> {
    let mut found = Vec::new();
    let mut stack: Vec<(Node, Node)> = vec![(trees.root(i), trees.root(j))];
    let (mut room_a, mut room_b) = (BoxGroup::EMPTY, BoxGroup::EMPTY);
    while let Some((a, b)) = stack.pop() {
        if a.level > b.level {
            let other = trees.node_box(j, b);
            let group = trees.children(set, i, a, &mut room_a);
            let near = (0..8u32).filter(|&k| group.lane(k as usize).overlaps(&other));
            stack.extend(near.map(|k| (a.child(k), b)));
        } else if b.level > a.level {
            let other = trees.node_box(i, a);
            let group = trees.children(set, j, b, &mut room_b);
            let near = (0..8u32).filter(|&k| group.lane(k as usize).overlaps(&other));
            stack.extend(near.map(|k| (a, b.child(k))));
        } else {
            let group_a = trees.children(set, i, a, &mut room_a);
            let group_b = trees.children(set, j, b, &mut room_b);
            for k in 0..8u32 {
                let lane = group_a.lane(k as usize);
                for l in (0..8u32).filter(|&l| lane.overlaps(&group_b.lane(l as usize))) {
                    if a.level == 0 {
                        found.push((a.segment(k), b.segment(l)));
                    } else {
                        stack.push((a.child(k), b.child(l)));
                    }
                }
            }
        }
    }
    found.sort_unstable();
    found
}
