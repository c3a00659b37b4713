//! Neighbours: the blocks of segments that are near one another in the reference frame, with lower
//! bounds of their distances. Molecular dynamics calls this a Verlet list.

use crate::simd::LANES;

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
