//! Blocks of eight segments, numbered over all curves, and lists of what belongs to each block.

use super::buckets::distribute;
use crate::curve::CurveSet;
use crate::simd::LANES;

/// Numbers of the blocks of all curves.
#[derive(Debug)]
pub(crate) struct Blocks {
    /// First block of each curve.
    pub first: Vec<u32>,
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
    /// End of each block in the items.
    ends: Vec<usize>,
    items: Vec<T>,
}

impl<T: Copy + Default> BlockLists<T> {
    /// Sorts items by their blocks. The items of a block stay in their order.
    pub fn new(blocks: usize, items: impl Iterator<Item = (u32, T)> + Clone) -> BlockLists<T> {
        let given = items.map(|(block, item)| (block as usize, item));
        let (mut ends, mut items) = (Vec::new(), Vec::new());
        distribute(given, blocks, &mut ends, &mut items);
        BlockLists { ends, items }
    }

    /// Returns the items of a block.
    pub fn of(&self, block: u32) -> &[T] {
        let end = self.ends[block as usize];
        let start = block.checked_sub(1).map_or(0, |k| self.ends[k as usize]);
        &self.items[start..end]
    }
}
