//! Neighbours: the blocks of segments that are near one another in the reference frame, with lower
//! bounds of their distances. Molecular dynamics calls this a Verlet list.

use crate::curve::{Box3, BoxGroup, CurveSet};
use crate::pairs::{CurveTree, overlapping};
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
#[derive(Clone, Copy, Debug)]
pub(in crate::incremental) struct Neighbour {
    pub block: Block,
    /// Lower bound of the distance between any two segments of both blocks that must stay apart.
    pub gap: f32,
}

/// The neighbours of every block.
#[derive(Debug)]
pub(in crate::incremental) struct Neighbours {
    /// First block of each curve, and the number of all blocks.
    first: Vec<Block>,
    /// Curve of each block.
    curves: Vec<u32>,
    /// First neighbour of each block, and the number of all neighbours.
    starts: Vec<u32>,
    all: Vec<Neighbour>,
    /// Lower bound of the distance between segments of two blocks that are not neighbours.
    pub range: f64,
}

impl Neighbours {
    /// Lists the neighbours. `first` is the result of [`first_blocks`].
    pub fn new(first: Vec<Block>, near: &[NearBlocks], range: f64) -> Neighbours {
        let count = *first.last().expect("the number of all blocks") as usize;
        let mut starts = vec![0u32; count + 1];
        // A block of a curve may be near itself.
        let ways = |n: &NearBlocks| {
            let [a, b] = n.blocks;
            let both = [(a, b), (b, a)];
            both.into_iter().take(if a == b { 1 } else { 2 })
        };
        for (a, _) in near.iter().flat_map(ways) {
            starts[a as usize + 1] += 1;
        }
        for k in 0..count {
            starts[k + 1] += starts[k];
        }
        let none = Neighbour { block: 0, gap: 0.0 };
        let mut all = vec![none; starts[count] as usize];
        let mut next = starts.clone();
        for n in near {
            for (a, b) in ways(n) {
                let at = &mut next[a as usize];
                all[*at as usize] = Neighbour {
                    block: b,
                    gap: n.gap,
                };
                *at += 1;
            }
        }
        let sizes = first.windows(2).map(|w| (w[1] - w[0]) as usize);
        let curves = sizes.enumerate();
        let curves = curves.flat_map(|(i, size)| std::iter::repeat_n(i as u32, size));
        Neighbours {
            curves: curves.collect(),
            first,
            starts,
            all,
            range,
        }
    }

    /// Returns the neighbours of a block.
    pub fn of(&self, block: Block) -> &[Neighbour] {
        let [from, to] = [0, 1].map(|k| self.starts[block as usize + k] as usize);
        &self.all[from..to]
    }

    /// Returns the block that contains a segment of curve `i`.
    pub fn block(&self, i: u32, segment: u32) -> Block {
        self.first[i as usize] + segment / LANES as u32
    }

    /// Returns the curve of a block, and the index of the block in the curve.
    pub fn place(&self, block: Block) -> (usize, usize) {
        let i = self.curves[block as usize] as usize;
        (i, (block - self.first[i]) as usize)
    }

    /// Returns the number of blocks.
    pub fn blocks(&self) -> usize {
        self.starts.len() - 1
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

/// Returns the first block of each curve, and the number of all blocks.
pub(super) fn first_blocks(set: &CurveSet) -> Vec<Block> {
    let mut first = vec![0];
    let mut count = 0;
    for curve in set.curves() {
        count += curve.segments.div_ceil(LANES as u32);
        first.push(count);
    }
    first
}
