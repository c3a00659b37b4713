//! Blocks of eight segments, numbered over all curves, and lists of what belongs to each block.

use crate::curve::CurveSet;
use crate::simd::LANES;

/// Numbers of the blocks of all curves.
#[derive(Debug)]
pub(crate) struct Blocks {
    /// First block of each curve.
    first: Vec<u32>,
    /// Curve of each block.
    pub curves: Vec<u32>,
}

impl Blocks {
    pub fn new(set: &CurveSet) -> Blocks {
        let (mut first, mut curves) = (Vec::with_capacity(set.len()), Vec::new());
        for (i, curve) in (0..).zip(set.curves()) {
            first.push(curves.len() as u32);
            let count = (curve.segments as usize).div_ceil(LANES);
            curves.extend(std::iter::repeat_n(i, count));
        }
        Blocks { first, curves }
    }

    /// Returns the number of blocks.
    pub fn len(&self) -> usize {
        self.curves.len()
    }

    /// Returns the first block of curve `i`.
    pub fn first(&self, i: usize) -> u32 {
        self.first[i]
    }

    /// Returns the block that contains a segment of curve `i`.
    pub fn of(&self, i: usize, segment: u32) -> u32 {
        self.first[i] + segment / LANES as u32
    }

    /// Returns the curve of a block, and the index of the block in the curve.
    pub fn place(&self, block: u32) -> (usize, usize) {
        let i = self.curves[block as usize] as usize;
        (i, (block - self.first[i]) as usize)
    }
}

/// A list of items for each block.
#[derive(Debug)]
pub(crate) struct BlockLists<T> {
    /// First item of each block, and the number of all.
    starts: Vec<u32>,
    items: Vec<T>,
}

impl<T: Copy + Default> BlockLists<T> {
    /// Sorts items by their blocks. The items of a block stay in their order.
    pub fn new(blocks: usize, items: impl Iterator<Item = (u32, T)> + Clone) -> BlockLists<T> {
        let mut starts = vec![0; blocks + 1];
        for (block, _) in items.clone() {
            starts[block as usize + 1] += 1;
        }
        for k in 0..blocks {
            starts[k + 1] += starts[k];
        }
        let mut next = starts.clone();
        let mut sorted = vec![T::default(); starts[blocks] as usize];
        for (block, item) in items {
            let at = &mut next[block as usize];
            sorted[*at as usize] = item;
            *at += 1;
        }
        BlockLists {
            starts,
            items: sorted,
        }
    }

    /// Returns the items of a block.
    pub fn of(&self, block: u32) -> &[T] {
        let [from, to] = [0, 1].map(|k| self.starts[block as usize + k] as usize);
        &self.items[from..to]
    }
}
