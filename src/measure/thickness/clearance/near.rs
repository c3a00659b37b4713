//! Pairs of near blocks, and the distances that they may move before they must be measured again.

use super::blocks::{BlockPair, Blocks, CHUNK};
use super::lattice::{Lattice, LatticeMotion};
use super::motion::{Displacements, Rigid, Step};
use super::strands::{Measured, Strands};
use crate::cancel::PairLimit;
use crate::curve::{Box3, Image, Received, above, below, larger, pow2};
use crate::error::{Error, Result};
use crate::pairs::{BlockLists, LinkSearch, Pair};
use crate::periodic::too_far;
use crate::simd::dispatch;
use rayon::prelude::*;

/// Number of blocks per task.
const GRAIN: usize = 4096;

/// Number of chunks per task.
const CHUNKS_PER_TASK: usize = 32;

/// Margin of a bound, in diameters, that covers all rounding to single precision.
const MARGIN: f64 = 1e-6;

/// Maximum number of near pairs of blocks, each of which needs up to 72 bytes. Yarn has about ten
/// per block.
pub(super) const MOST_NEAR: usize = 1 << 24;

/// Distances up to which pairs are listed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    /// Clearance up to which the list is complete.
    pub ratio: f64,
    /// Distance that each block may move, relative to a rigid motion, while the list stays
    /// complete.
    pub skin: f64,
}

/// A pair of near blocks.
#[derive(Clone, Copy, Debug)]
struct NearPair {
    pair: BlockPair,
    /// Sum of the radii.
    radii: f32,
    /// Lower bound of the clearance in the reference frame.
    bound: f32,
}

/// The near pairs of a reference frame.
#[derive(Debug)]
pub(super) struct NearList {
    /// The pairs, sorted.
    pairs: Vec<NearPair>,
    /// Indices in `pairs` of the pairs of each block, once a level was chosen.
    of: Option<BlockLists<u32>>,
    /// Positions of the reference frame.
    reference: Received,
    /// Lattice of the reference frame, if the scene is periodic.
    lattice: Option<Lattice>,
    pub reach: Reach,
    /// Largest distance that a block moved from the frame of the list to the reference frame.
    traveled: f64,
    /// Pairs of blocks that moved by less than their allowances stay above this level.
    pub level: f64,
    /// Distance that each block may move from the reference frame; then the minimum of each chunk.
    allowances: Vec<f32>,
    chunk_allowances: Vec<f32>,
    /// Lower bound of the clearance of all strands in the reference frame.
    pub least: f64,
}

/// Motion of all blocks from the reference frame to the current one.
pub(super) struct Moved {
    rigid: Rigid,
    chunks: Vec<Displacements>,
    /// Upper bound of the largest motion of a block, plus half of that of a lattice vector.
    pub farthest: f64,
    /// Half of the upper bound of the motion of lattice vectors between near strands.
    drift: f64,
    /// Motion of the lattice, if its cell changed.
    lattice: Option<LatticeMotion>,
    /// For each chunk, the index of its first block in `blocks`. `None` if its blocks share the
    /// displacements of the chunk.
    starts: Vec<Option<u32>>,
    blocks: Vec<Displacements>,
}

impl Moved {
    /// Computes separate displacements for the blocks of these chunks.
    fn divide(&mut self, step: &Step<'_>, strands: &Strands<'_>, chunks: &[usize]) {
        let (known, blocks) = (self.blocks.len(), &strands.layout.blocks);
        for &chunk in chunks {
            let count = blocks.numbers.len().min((chunk + 1) * CHUNK) - chunk * CHUNK;
            self.starts[chunk] = Some(self.blocks.len() as u32);
            let whole = self.chunks[chunk];
            self.blocks.extend(std::iter::repeat_n(whole, count));
        }
        let fill = |(&chunk, out): (&usize, &mut [Displacements])| {
            let from = chunk * CHUNK;
            let parts = &blocks.points[from..from + out.len()];
            dispatch!(Step::displacements(step, parts, out));
        };
        // Only the last chunk of the scene may have fewer blocks.
        let new = &mut self.blocks[known..];
        let parts = chunks.par_iter().zip(new.par_chunks_mut(CHUNK));
        parts.with_min_len(CHUNKS_PER_TASK).for_each(fill);
    }

    /// Returns the displacements of a block, or those of its chunk.
    #[inline(always)]
    fn of(&self, block: u32) -> &Displacements {
        let block = block as usize;
        match self.starts[block / CHUNK] {
            Some(start) => &self.blocks[start as usize + block % CHUNK],
            None => &self.chunks[block / CHUNK],
        }
    }

    /// Returns a lower bound of the current clearance of a pair.
    #[inline(always)]
    fn bound(&self, pair: &NearPair) -> f64 {
        let BlockPair { blocks, image } = pair.pair;
        let [a, b] = blocks.map(|block| self.of(block));
        let moved = match &self.lattice {
            Some(lattice) => {
                let (by, rounding) = lattice.of(image);
                a.largest_between(&b.shifted(by, rounding))
            }
            None => a.largest_between(b),
        };
        f64::from(pair.bound) - moved / f64::from(pair.radii)
    }

    /// Returns an upper bound of the motion of a block, or of the blocks of a chunk, plus half of
    /// that of a lattice vector.
    #[inline(always)]
    fn largest(&self, moved: &Displacements) -> f64 {
        self.rigid.largest_from(moved) + self.drift
    }
}

impl NearList {
    /// Lists the near pairs of a frame, which becomes the reference frame.
    ///
    /// # Errors
    ///
    /// [`Error::Unsupported`] if there are too many; [`Error::Usage`] if curves span too many
    /// cells.
    pub fn build(strands: &Strands<'_>, reach: Reach, search: &mut LinkSearch) -> Result<NearList> {
        let (set, radii, blocks) = (strands.set, strands.radii, &strands.layout.blocks);
        let unsupported = |what: String| Error::unsupported("clearance", what);
        // Rounding of single-precision boxes.
        let rounding = set.max_abs() * pow2(-22);
        let bounds = |block: u32| {
            let (curve, number) = blocks.numbers.place(block);
            set.leaf_boxes(curve, number).bounds()
        };
        let count = blocks.numbers.len() as u32;
        let all = (0..count).into_par_iter().with_min_len(GRAIN / 4);
        let boxes: Vec<Box3> = all.map(bounds).collect();
        let dilation = |curve: u32| reach.ratio * radii[curve as usize] + reach.skin + rounding;
        let dilated = boxes.iter().zip(&blocks.numbers.curves);
        let dilated = dilated.map(|(b, &curve)| b.dilated(above(dilation(curve))));
        let dilated: Vec<Box3> = dilated.collect();
        let limit = PairLimit::default();
        limit.begin(MOST_NEAR);
        search.limit = limit.clone();
        let lattice = strands.cell.map(|cell| {
            let largest = radii.iter().fold(0.0, |a: f64, &b| a.max(b));
            Lattice::new(cell, &boxes, 2.0 * (reach.ratio * largest + reach.skin))
        });
        let lattice = lattice.transpose()?;
        let mut found: Vec<BlockPair> = match &lattice {
            None => {
                let home = |&(a, b): &Pair| blocks.pair(a, b, Image::default());
                search.find(&dilated).iter().map(home).collect()
            }
            Some(lattice) => {
                let near = lattice.near(&dilated, search);
                let near = near.map_err(|block| too_far(blocks.numbers.curves[block] as usize))?;
                near.map(|(a, b, image)| blocks.pair(a, b, image)).collect()
            }
        };
        if limit.is_exceeded() {
            return Err(unsupported(format!(
                "of more than {MOST_NEAR} pairs of close strands; is the radius too large?"
            )));
        }
        found.extend((0..count).map(|block| blocks.pair(block, block, Image::default())));
        found.sort_unstable();
        found.dedup();
        let listed = |pair: &BlockPair| {
            if !strands.are_apart(pair) {
                return None;
            }
            let [a, b] = pair.blocks.map(|k| k as usize);
            let radius = |block: usize| radii[blocks.numbers.curves[block] as usize];
            let sum = radius(a) + radius(b);
            let translated = |lattice: &Lattice| lattice.translated(&boxes[b], pair.image);
            let (other, more) = lattice.as_ref().map_or((boxes[b], 0.0), translated);
            let rounding = rounding + more;
            let gap = boxes[a].dist_sq_below(&other).sqrt();
            Some(NearPair {
                pair: *pair,
                radii: below(sum),
                bound: below((gap - 2.0 * rounding).max(0.0) / sum - MARGIN),
            })
        };
        let pairs = found.par_iter().with_min_len(GRAIN);
        let pairs: Vec<NearPair> = pairs.filter_map(listed).collect();
        Ok(NearList {
            pairs,
            of: None,
            reference: Received::from(strands.positions),
            lattice,
            reach,
            traveled: 0.0,
            level: 0.0,
            allowances: Vec::new(),
            chunk_allowances: Vec::new(),
            least: 0.0,
        })
    }

    /// Copies the bounds of an older list with the same reference frame, so that pairs in both
    /// lists need not be measured again.
    pub fn inherit(&mut self, old: &NearList) {
        let mut known = old.pairs.iter().peekable();
        for pair in &mut self.pairs {
            while known.next_if(|k| k.pair < pair.pair).is_some() {}
            if let Some(same) = known.next_if(|k| k.pair == pair.pair) {
                pair.bound = larger(pair.bound, same.bound);
            }
        }
    }

    fn step<'a>(&'a self, strands: &Strands<'a>, rigid: Rigid) -> Step<'a> {
        Step {
            frames: [self.reference.positions(), strands.positions],
            rigid,
            widen: strands.set.basis().overshoot(),
        }
    }

    /// Returns the motion of the blocks from the reference frame to this one. A motion of less than
    /// `small` is negligible.
    pub fn moved(&self, strands: &Strands<'_>, small: f64) -> Moved {
        // In a periodic scene, rotations are excluded, because they would turn the lattice, too.
        let small = self.lattice.as_ref().map_or(small, |_| f64::INFINITY);
        let rigid = Rigid::fit([self.reference.positions(), strands.positions], small);
        let parts = &strands.layout.blocks.chunks[..];
        let step = &self.step(strands, rigid);
        let mut chunks = vec![Displacements::default(); parts.len()];
        let outs = chunks.par_chunks_mut(CHUNKS_PER_TASK);
        let tasks = parts.par_chunks(CHUNKS_PER_TASK).zip(outs);
        tasks.for_each(|(parts, out)| {
            dispatch!(Step::displacements(step, parts, out));
        });
        let far = chunks.iter().map(|moved| rigid.largest_from(moved));
        let far = far.fold(0.0, f64::max);
        let lattice = self.lattice.as_ref().zip(strands.cell);
        let lattice = lattice.and_then(|(lattice, cell)| lattice.motion_to(cell));
        let half = |motion: &LatticeMotion| 0.5 * motion.largest(far);
        let drift = lattice.as_ref().map_or(0.0, half);
        Moved {
            rigid,
            farthest: far + drift,
            drift,
            lattice,
            starts: vec![None; chunks.len()],
            chunks,
            blocks: Vec::new(),
        }
    }

    /// Returns an upper bound of the distance that a block moved since the list was made, plus half
    /// of that of a lattice vector.
    pub fn traveled(&self, moved: &Moved) -> f64 {
        self.traveled + moved.farthest
    }

    /// Returns true if, after this motion, all strands that are not listed are still beyond the
    /// reach.
    pub fn is_complete(&self, moved: &Moved) -> bool {
        self.reach.skin > 0.0 && self.traveled(moved) <= self.reach.skin
    }

    /// Returns the number of pairs.
    pub fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Returns the pairs of blocks that may be closer than `limit` in a frame, and the number of
    /// pairs that were compared. `limit` is at most the level.
    pub fn due(
        &self,
        moved: &mut Moved,
        strands: &Strands<'_>,
        limit: f64,
    ) -> (Vec<BlockPair>, usize) {
        let far = (0..moved.chunks.len()).filter(|&chunk| {
            let largest = moved.largest(&moved.chunks[chunk]);
            largest > f64::from(self.chunk_allowances[chunk])
        });
        let far: Vec<usize> = far.collect();
        if far.is_empty() {
            return Default::default();
        }
        moved.divide(&self.step(strands, moved.rigid), strands, &far);
        let moved = &*moved;
        let count = strands.layout.blocks.numbers.len();
        let of = self.of.as_ref().expect("the level was chosen");
        let look = |&chunk: &usize| {
            let (mut due, mut compared) = (Vec::new(), 0);
            for block in chunk * CHUNK..count.min((chunk + 1) * CHUNK) {
                let largest = moved.largest(moved.of(block as u32));
                if largest <= f64::from(self.allowances[block]) {
                    continue;
                }
                let pairs = of.of(block as u32);
                compared += pairs.len();
                let pairs = pairs.iter().map(|&k| &self.pairs[k as usize]);
                let close = pairs.filter(|pair| moved.bound(pair) <= limit);
                due.extend(close.map(|pair| pair.pair));
            }
            (due, compared)
        };
        let join = |(mut due, count): (Vec<BlockPair>, usize), (more, compared)| {
            due.extend::<Vec<BlockPair>>(more);
            (due, count + compared)
        };
        let looked = far.par_iter().with_min_len(CHUNKS_PER_TASK).map(look);
        let (mut due, compared) = looked.reduce(Default::default, join);
        due.sort_unstable();
        due.dedup();
        (due, compared)
    }

    /// Makes a frame the reference frame.
    pub fn rebase(&mut self, mut moved: Moved, strands: &Strands<'_>, small: f64) {
        let far = (0..moved.chunks.len()).filter(|&chunk| {
            let whole = moved.starts[chunk].is_none();
            whole && moved.rigid.largest_from(&moved.chunks[chunk]) > small
        });
        let far: Vec<usize> = far.collect();
        moved.divide(&self.step(strands, moved.rigid), strands, &far);
        let lower = |pair: &mut NearPair| pair.bound = below(moved.bound(pair));
        let pairs = self.pairs.par_iter_mut().with_min_len(GRAIN);
        pairs.for_each(lower);
        self.traveled = self.traveled(&moved);
        self.reference.copy_from(strands.positions);
        if let Some((lattice, cell)) = self.lattice.as_mut().zip(strands.cell) {
            lattice.rebase(cell, moved.farthest);
        }
    }

    /// Returns the pairs whose bound in the reference frame is at most this clearance.
    pub fn below(&self, ratio: f64) -> Vec<u32> {
        let pairs = self.pairs.iter().zip(0..);
        let close = pairs.filter(|(pair, _)| f64::from(pair.bound) <= ratio);
        close.map(|(_, k)| k).collect()
    }

    /// Returns the blocks of these pairs.
    pub fn blocks_of(&self, pairs: &[u32]) -> Vec<BlockPair> {
        let blocks = pairs.iter().map(|&k| self.pairs[k as usize].pair);
        blocks.collect()
    }

    /// Records lower bounds of the clearance in the reference frame.
    pub fn improve<'a>(&mut self, found: impl Iterator<Item = (u32, &'a Measured)>) {
        for (pair, measured) in found {
            let bound = &mut self.pairs[pair as usize].bound;
            let known = below(measured.bound.min(f64::from(f32::MAX)) - MARGIN);
            *bound = larger(*bound, known);
        }
    }

    /// Sets the level, and computes how far each block may move before its pairs are compared.
    pub fn set_level(&mut self, level: f64, blocks: &Blocks) {
        self.level = level;
        let bounds = self.pairs.iter().map(|pair| f64::from(pair.bound));
        self.least = bounds.fold(self.reach.ratio, f64::min);
        if self.reach.skin == 0.0 {
            return;
        }
        let pairs = (0..).zip(&self.pairs);
        let sides = pairs.flat_map(|(k, NearPair { pair, .. })| {
            let [a, b] = pair.blocks;
            let sides = [a, b].into_iter().take(if a == b { 1 } else { 2 });
            sides.map(move |block| (block, k))
        });
        self.of
            .get_or_insert_with(|| BlockLists::new(blocks.numbers.len(), sides));
        self.allowances.clear();
        self.allowances.resize(blocks.numbers.len(), f32::MAX);
        for pair in &self.pairs {
            let slack = (f64::from(pair.bound) - level) * f64::from(pair.radii);
            let allowance = below(0.5 * slack);
            for block in pair.pair.blocks {
                let least = &mut self.allowances[block as usize];
                *least = least.min(allowance);
            }
        }
        let chunks = self.allowances.chunks(CHUNK);
        let least = chunks.map(|chunk| chunk.iter().fold(f32::MAX, |a, &b| a.min(b)));
        self.chunk_allowances = least.collect();
    }
}
