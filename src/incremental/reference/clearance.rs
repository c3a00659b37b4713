//! Typical clearance of the curves of a scene, which determines the reach of its reference frame.

use super::gap::near_points;
use crate::curve::vector::distance;
use crate::curve::{Box3, BoxGroup};
use crate::discretize::Hull;
use crate::incremental::covered::Covered;
use crate::pairs::{BoxTree, Node, PairFilter, Trees};
use crate::simd::LANES;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Number of blocks whose clearance is sampled to choose the reach.
const SAMPLES: usize = 32;

/// Returns a distance that most blocks of segments have from all others that must stay apart
/// from them: the upper quartile of a sample.
pub(super) fn typical_clearance(
    covered: Covered<'_>,
    trees: &Trees,
    filter: Option<&PairFilter>,
) -> f64 {
    let set = covered.set;
    let count = |i: usize| (set.curve(i).segments as usize).div_ceil(LANES);
    let total: usize = covered.indices().map(count).sum();
    let step = (total / SAMPLES).max(1);
    let curves = covered.indices();
    let blocks = curves.flat_map(|i| (0..count(i)).map(move |g| (i, g)));
    let samples: Vec<(usize, usize)> = blocks.skip(step / 2).step_by(step).collect();
    let distance = |&block: &(usize, usize)| clearance(covered, trees, filter, block);
    let mut distances: Vec<f64> = samples.par_iter().map(distance).collect();
    distances.sort_by(f64::total_cmp);
    let quartile = distances.get(distances.len() * 3 / 4);
    let all = 4.0 * set.max_abs().max(f64::MIN_POSITIVE);
    quartile.map_or(all, |d| d.min(all))
}

/// Returns the approximate distance of a block of segments from all others that must stay apart
/// from it, by best-first search. Infinite if there are none.
fn clearance(
    covered: Covered<'_>,
    trees: &Trees,
    filter: Option<&PairFilter>,
    (i, block): (usize, usize),
) -> f64 {
    let set = covered.set;
    let boxes = set.leaf_boxes(i, block);
    let bounds = boxes.bounds();
    let hull = |i: usize, s: u32| Hull::new(set.hull(i, s as usize));
    let segments = (0..LANES as u32).map(|k| (block * LANES) as u32 + k);
    let n = set.curve(i).segments;
    let parts = |j: usize| set.parts(i, j);
    let block = segments.filter(|&s| s < n).map(|s| (s, hull(i, s)));
    let block: Vec<(u32, Hull)> = block.collect();
    // Distances are not negative, so their bit patterns have the same order.
    let entry = |j: usize, b: &Box3, node: Option<Node>, at: u32| {
        let distance = Reverse(bounds.dist_sq_below(b).to_bits());
        (distance, j, at, node.map(|n| n.level))
    };
    let others = trees.roots().iter().enumerate().filter(|&(j, root)| {
        (j != i || covered.coverage.self_crossings)
            && *root != Box3::EMPTY
            && filter.is_none_or(|filter| filter.contains(i as u32, j as u32))
    });
    let entries = others.map(|(j, root)| entry(j, root, Some(trees.of(set, j).root()), 0));
    let mut heap: BinaryHeap<_> = entries.collect();
    let mut best = f64::INFINITY;
    let mut leaf = BoxGroup::EMPTY;
    while let Some((Reverse(bits), j, at, level)) = heap.pop() {
        if f64::from_bits(bits) >= best * best {
            break;
        }
        let Some(level) = level else {
            let other = hull(j, at);
            for (s, hull) in &block {
                if !parts(j).is_some_and(|parts| parts.adjacent(*s, at)) {
                    let [p, q] = near_points(hull, &other);
                    best = best.min(distance(p, q));
                }
            }
            continue;
        };
        let node = Node::new(level, at);
        let group = *trees.of(set, j).children(node, &mut leaf);
        for k in 0..LANES {
            let lane = group.lane(k);
            if lane != Box3::EMPTY {
                let below = (level > 0).then(|| node.child(k as u32));
                heap.push(entry(j, &lane, below, node.lane(k as u32)));
            }
        }
    }
    best
}
