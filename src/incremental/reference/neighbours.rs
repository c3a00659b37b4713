//! Neighbours: the blocks of segments that are near one another in the reference frame, with lower
//! bounds of their distances. Molecular dynamics calls this a Verlet list.

use crate::curve::{Box3, BoxGroup};
use crate::pairs::{BlockLists, Blocks, BoxTree, CurveTree, overlapping};
use crate::simd::{LANES, Portable};

/// A block of eight segments, counted over all curves.
pub(in crate::incremental) type Block = u32;

/// A pair of blocks, and a lower bound of the distance between any two of their segments that must
/// stay apart.
#[derive(Clone, Copy, Debug)]
pub(in crate::incremental) struct NearBlocks {
    pub blocks: [Block; 2],
    pub gap: f32,
}

/// A neighbour of a block.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::incremental) struct Neighbour {
    pub block: Block,
    /// Lower bound of the distance between any two segments of both blocks that must stay apart.
    pub gap: f32,
}

/// The neighbours of every block.
#[derive(Debug)]
pub(in crate::incremental) struct Neighbours {
    pub blocks: Blocks,
    pub lists: BlockLists<Neighbour>,
    /// Lower bound of the distance between segments of two blocks that are not neighbours.
    pub range: f64,
}

impl Neighbours {
    /// Lists the neighbours.
    pub fn new(blocks: Blocks, near: &[NearBlocks], range: f64) -> Neighbours {
        // A block of a curve may be near itself.
        let ways = |near: &NearBlocks| {
            let ([a, b], gap) = (near.blocks, near.gap);
            let both = [(a, b), (b, a)].map(|(a, block)| (a, Neighbour { block, gap }));
            both.into_iter().take(if a == b { 1 } else { 2 })
        };
        Neighbours {
            lists: BlockLists::new(blocks.len(), near.iter().flat_map(ways)),
            blocks,
            range,
        }
    }
}

/// Calls `near` for each pair of leaves, one from each tree, whose boxes are at most `range` apart
/// along every axis: with both leaves and the largest of the three gaps.
pub(super) fn near_leaves(
    [first, second]: [CurveTree<'_>; 2],
    range: f32,
    mut near: impl FnMut(u32, u32, f32) -> bool,
) {
    let mut stack = vec![(first.root(), second.root())];
    let mut leaf = BoxGroup::EMPTY;
    while let Some((t, u)) = stack.pop() {
        let [a, b] = [first.node_box(t), second.node_box(u)];
        let gap = gap_along_an_axis(&a, &b);
        if gap > range {
            continue;
        }
        let lanes = |other: &Box3, group: &BoxGroup| {
            let bits = overlapping(Portable, &other.dilated(range), group);
            (0..LANES as u32).filter(move |k| bits >> k & 1 != 0)
        };
        match (t.level, u.level) {
            (0, 0) => {
                if !near(t.index, u.index, gap) {
                    return;
                }
            }
            (p, q) if p >= q => {
                let group = first.children(t, &mut leaf);
                stack.extend(lanes(&b, group).map(|k| (t.child(k), u)));
            }
            _ => {
                let group = second.children(u, &mut leaf);
                stack.extend(lanes(&a, group).map(|k| (t, u.child(k))));
            }
        }
    }
}

/// Returns the largest distance of two boxes along an axis, rounded down; 0 if they overlap.
fn gap_along_an_axis(a: &Box3, b: &Box3) -> f32 {
    let gap = |x: usize| (a.lo[x] - b.hi[x]).max(b.lo[x] - a.hi[x]);
    let gap = gap(0).max(gap(1)).max(gap(2));
    gap.max(0.0) * (1.0 - 1e-6)
}
