//! Blocks of eight segments, and chunks of blocks, whose motion is bounded together.

use super::motion::Ranges;
use crate::curve::{CurveSet, Image, is_home};
use crate::pairs;
use crate::simd::LANES;
use std::ops::Range;

/// Number of blocks in a chunk.
pub(super) const CHUNK: usize = 64;

/// A pair of a block and an image of another block, or of itself. Each pair is listed in one order
/// only: the first curve has the lower index, or, for one curve, the image is positive in
/// lexicographic order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct BlockPair {
    pub blocks: [u32; 2],
    /// Translation of the second block.
    pub image: Image,
}

/// The blocks of all curves, and the control points that they depend on.
#[derive(Debug)]
pub(super) struct Blocks {
    pub numbers: pairs::Blocks,
    /// Points that each block depends on.
    pub points: Vec<Ranges>,
    /// Points that each chunk of [`CHUNK`] blocks depends on.
    pub chunks: Vec<Ranges>,
}

impl Blocks {
    pub fn new(set: &CurveSet) -> Blocks {
        let basis = set.basis();
        let mut blocks = Blocks {
            numbers: pairs::Blocks::new(set),
            points: Vec::new(),
            chunks: Vec::new(),
        };
        let (stride, window) = (basis.stride(), basis.window());
        for (i, curve) in set.curves().iter().enumerate() {
            let points = set.points_of(i);
            let (n, lead) = (points.len(), basis.lead(curve.closed));
            let shifted = |range: Range<usize>| {
                [range.start, range.end].map(|point| (points.start + point) as u32)
            };
            for from in (0..curve.segments as usize).step_by(LANES) {
                let last = (from + LANES).min(curve.segments as usize) - 1;
                // Range of the control points, from `lead` points before the first point of the
                // curve.
                let (from, to) = (from * stride, last * stride + window);
                let own = (from.max(lead) - lead).min(n)..(to - lead).min(n);
                let before = n - (lead - from.min(lead))..n;
                let after = 0..(to - lead).saturating_sub(n).min(n);
                blocks.points.push([own, before, after].map(shifted));
            }
        }
        blocks.chunks = blocks.points.chunks(CHUNK).map(joined).collect();
        blocks
    }

    /// Returns the pair of a block and an image of another one, or of itself.
    pub fn pair(&self, a: u32, b: u32, image: Image) -> BlockPair {
        let backward = image.map(|n| -n);
        let [i, j] = [a, b].map(|k| self.numbers.curves[k as usize]);
        let forward = match is_home(&image) || i != j {
            true => a <= b,
            false => image > backward,
        };
        let (blocks, image) = match forward {
            true => ([a, b], image),
            false => ([b, a], backward),
        };
        BlockPair { blocks, image }
    }
}

/// Returns the points of consecutive blocks: the range from the first block to the last one, and
/// ranges at the start of closed curves on which the last blocks of a curve depend.
fn joined(blocks: &[Ranges]) -> Ranges {
    let from = blocks[0][0][0];
    let to = blocks.iter().map(|[own, ..]| own[1]).max();
    let mut out = [[from, to.expect("at least one block")], [0; 2], [0; 2]];
    let mut extra = 0;
    for &[first, end] in blocks.iter().flat_map(|[_, before, after]| [before, after]) {
        let [from, to] = out[0];
        if first == end || (from <= first && end <= to) {
            continue;
        }
        // The last two blocks of a curve may depend on its first points.
        if extra == 0 || out[extra][0] != first {
            extra += 1;
        }
        out[extra] = [first, end];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Point, Positions};
    use crate::random::Random;

    #[test]
    fn chunks_contain_the_points_of_their_blocks_and_blocks_those_of_their_segments() {
        let mut random = Random::new(11);
        for basis in Basis::ALL {
            for _ in 0..20 {
                let counts: Vec<i32> = (0..1 + random.below(40_usize))
                    .map(|_| -3 * (2 + random.below(400_usize) as i32))
                    .collect();
                let n: usize = counts.iter().map(|c| c.unsigned_abs() as usize).sum();
                let points: Vec<Point> = (0..n).map(|_| random.point(1.0)).collect();
                let positions = Positions::F64(points.as_flattened());
                let set = CurveSet::from_counts(basis, &counts, positions).unwrap();
                let blocks = Blocks::new(&set);
                let has = |ranges: &Ranges, point: u32| {
                    ranges.iter().any(|&[from, to]| (from..to).contains(&point))
                };
                for (k, ranges) in blocks.points.iter().enumerate() {
                    for point in ranges.iter().flat_map(|&[from, to]| from..to) {
                        assert!(has(&blocks.chunks[k / CHUNK], point));
                    }
                }
                for i in 0..set.len() {
                    let own = set.points_of(i);
                    let (start, n) = (own.start, own.len());
                    let (stride, lead) = (basis.stride(), basis.lead(true));
                    for s in 0..set.curve(i).segments as usize {
                        let block = blocks.numbers.of(i, s as u32) as usize;
                        for k in 0..basis.window() {
                            let point = start + (s * stride + k + n - lead) % n;
                            assert!(has(&blocks.points[block], point as u32));
                        }
                    }
                }
            }
        }
    }
}
