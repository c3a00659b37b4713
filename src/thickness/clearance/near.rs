//! Near pairs of blocks, and how long each may be left alone.

use super::CloseBlock;
use super::motion::{Rigid, Shifts};
use super::strands::{Arcs, Measured};
use crate::curve::vector::distance;
use crate::curve::{Basis, Box3, CurveSet, Positions, above, below, pow2};
use crate::pairs::{AllCurves, LinkSearch, MOST_NEAR, Trees, near_leaves};
use crate::simd::LANES;
use rayon::prelude::*;
use std::cmp;
use std::f64::consts::PI;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of blocks per task.
const GRAIN: usize = 4096;

/// Margin of a bound, in diameters, that covers all rounding to single precision.
const MARGIN: f64 = 1e-6;

/// Distance up to which pairs are listed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    /// Clearance up to which strands are close.
    pub ratio: f64,
    /// Travel up to which the list is complete.
    pub skin: f64,
}

/// A block of eight segments of a curve.
#[derive(Clone, Debug)]
struct Block {
    curve: u32,
    /// Points that it depends on, counted over all curves: a range, and another one if it wraps
    /// around the end of a closed curve.
    points: Range<u32>,
    wrapped: Range<u32>,
    /// Upper bound of the distance of its points from the first one when the list was built.
    size: f32,
}

/// A pair of near blocks.
#[derive(Clone, Copy, Debug)]
struct NearPair {
    blocks: [u32; 2],
    /// Travel of the blocks when the pair was measured.
    travel: [f32; 2],
    /// Lower bound of the clearance at that time.
    bound: f32,
    /// Clearance at that time; infinite if it is unknown.
    ratio: f32,
    radii: f32,
}

impl NearPair {
    /// Returns the travel of one of the blocks up to which the pair is above a level.
    fn due(&self, side: usize, level: f64) -> f32 {
        let slack = 0.5 * (f64::from(self.bound) - level) * f64::from(self.radii);
        below(f64::from(self.travel[side]) + slack)
    }

    /// Returns the lower bound of the clearance for these travels.
    fn bound_at(&self, travel: [f32; 2]) -> f64 {
        let [a, b] = [0, 1].map(|k| f64::from(travel[k]) - f64::from(self.travel[k]));
        f64::from(self.bound) - (a + b) / f64::from(self.radii) * (1.0 + 1e-9)
    }

    /// Returns the order of the pairs in the list: by curves, then by blocks.
    fn order(&self, other: &NearPair, blocks: &[Block]) -> cmp::Ordering {
        let key = |pair: &NearPair| {
            let [i, j] = pair.blocks.map(|block| blocks[block as usize].curve);
            (i, j, pair.blocks)
        };
        key(self).cmp(&key(other))
    }
}

/// The near pairs of a frame, kept up to date in later ones.
#[derive(Debug)]
pub(super) struct NearList {
    blocks: Vec<Block>,
    /// First block of each curve.
    first: Vec<u32>,
    /// Travel of each block since the list was built.
    travel: Vec<f32>,
    /// Travel of each block up to which no pair of it is due.
    due: Vec<f32>,
    pairs: Vec<NearPair>,
    /// First pair of each block in `of`, and the number of all.
    starts: Vec<u32>,
    of: Vec<u32>,
    /// Bound of the motion of curves if their control points move by 1.
    stretch: f64,
    farthest: f32,
    age: u32,
}

impl NearList {
    /// Lists the near pairs of a frame. Returns `None` if there are too many.
    pub fn build(
        set: &CurveSet,
        (radii, arcs): (&[f64], &Arcs),
        reach: Reach,
        level: f64,
        old: Option<NearList>,
    ) -> Option<NearList> {
        let mut trees = Trees::default();
        trees.refit(AllCurves(set));
        // Rounding of single-precision boxes.
        let rounding = set.max_abs() * pow2(-22);
        let range = |i: usize| above(reach.ratio * radii[i] + reach.skin + rounding);
        let boxes = trees.roots().iter().enumerate();
        let boxes: Vec<Box3> = boxes.map(|(i, b)| b.dilated(range(i))).collect();
        let mut search = LinkSearch::default();
        let curves = search.find(&boxes);
        let itself = |i: &u32| {
            let (length, radius) = (f64::from(arcs.lengths[*i as usize]), radii[*i as usize]);
            length > PI * radius
        };
        curves.extend((0..set.len() as u32).filter(itself).map(|i| (i, i)));
        curves.sort();
        let first = &arcs.first;
        let size = curves
            .len()
            .div_ceil(8 * rayon::current_num_threads())
            .max(1);
        let count = AtomicUsize::new(0);
        let found: Vec<Vec<NearPair>> = curves
            .par_chunks(size)
            .map(|curves| {
                let mut all: Vec<NearPair> = Vec::new();
                for &(i, j) in curves {
                    let (i, j) = (i as usize, j as usize);
                    let sum = radii[i] + radii[j];
                    let begin = all.len();
                    let both = [i, j].map(|i| trees.of(set, i));
                    let within = above(f64::from(range(i)) + f64::from(range(j)));
                    let curve = set.curve(i);
                    near_leaves(both, within, |a, b, gap| {
                        let is_pair = match i == j {
                            true => a <= b && arcs.are_apart(i, &curve, [a, b], radii[i]),
                            false => true,
                        };
                        if is_pair {
                            let gap = (f64::from(gap) - rounding).max(0.0);
                            all.push(NearPair {
                                blocks: [first[i] + a, first[j] + b],
                                travel: [0.0; 2],
                                bound: below(gap / sum - MARGIN),
                                ratio: f32::INFINITY,
                                radii: sum as f32,
                            });
                        }
                        all.len() - begin <= MOST_NEAR
                    });
                    all[begin..].sort_unstable_by_key(|pair| pair.blocks);
                    let new = all.len() - begin;
                    if count.fetch_add(new, Ordering::Relaxed) + new > MOST_NEAR {
                        return Vec::new();
                    }
                }
                all
            })
            .collect();
        if count.into_inner() > MOST_NEAR {
            return None;
        }
        let pairs = found.concat();
        let blocks = blocks(set, first);
        let mut list = NearList {
            travel: vec![0.0; blocks.len()],
            due: vec![f32::INFINITY; blocks.len()],
            starts: vec![0; blocks.len() + 1],
            of: Vec::new(),
            first: first.clone(),
            blocks,
            pairs,
            stretch: match set.basis() {
                Basis::CatmullRom => 4.0 / 3.0,
                Basis::Polyline | Basis::Bezier | Basis::BSpline => 1.0,
            },
            farthest: 0.0,
            age: 0,
        };
        list.index();
        if let Some(old) = old {
            list.inherit(&old);
        }
        list.set_level(level);
        Some(list)
    }

    /// Sorts the pairs by their blocks.
    fn index(&mut self) {
        let sides = |pair: &NearPair| {
            let [a, b] = pair.blocks;
            [a, b].into_iter().take(if a == b { 1 } else { 2 })
        };
        for block in self.pairs.iter().flat_map(sides) {
            self.starts[block as usize + 1] += 1;
        }
        for k in 1..self.starts.len() {
            self.starts[k] += self.starts[k - 1];
        }
        let mut next = self.starts.clone();
        self.of = vec![0; *next.last().expect("the number of all") as usize];
        for (k, pair) in self.pairs.iter().enumerate() {
            for block in sides(pair) {
                let at = &mut next[block as usize];
                self.of[*at as usize] = k as u32;
                *at += 1;
            }
        }
    }

    /// Takes over what an older list knows about the pairs of this one, so that they need not be
    /// measured again.
    fn inherit(&mut self, old: &NearList) {
        if old.first != self.first {
            return;
        }
        let mut known = old.pairs.iter().peekable();
        for pair in &mut self.pairs {
            while known
                .next_if(|k| k.order(pair, &self.blocks) == cmp::Ordering::Less)
                .is_some()
            {}
            let Some(same) = known.next_if(|k| k.blocks == pair.blocks) else {
                continue;
            };
            let travel = same.blocks.map(|block| old.travel[block as usize]);
            let bound = same.bound_at(travel);
            if bound > f64::from(pair.bound) {
                pair.bound = below(bound);
            }
            pair.ratio = same.ratio;
        }
    }

    /// Returns the list for the next frame, in which the blocks have moved.
    pub fn moved(mut self, frames: [Positions<'_>; 2]) -> NearList {
        let (rigid, stretch) = (Rigid::fit(frames), self.stretch);
        let advance = |blocks: &[Block], travel: &mut [f32]| -> f32 {
            let mut farthest = 0.0_f32;
            for (block, travel) in blocks.iter().zip(travel) {
                let shift = rigid.displacement(frames[0].point(block.points.start as usize));
                let mut shifts = Shifts::EMPTY;
                for range in [&block.points, &block.wrapped] {
                    shifts.add(frames, range.start as usize..range.end as usize);
                }
                let size = f64::from(block.size) + 2.0 * f64::from(*travel);
                let step = shifts.largest_from(shift) + rigid.spin * size;
                *travel = above(f64::from(*travel) + stretch * step);
                farthest = farthest.max(*travel);
            }
            farthest
        };
        let NearList { blocks, travel, .. } = &mut self;
        self.farthest = match blocks.len() {
            ..GRAIN => advance(blocks, travel),
            _ => blocks
                .par_chunks(GRAIN)
                .zip(travel.par_chunks_mut(GRAIN))
                .map(|(blocks, travel)| advance(blocks, travel))
                .reduce(|| 0.0, f32::max),
        };
        self.age += 1;
        self
    }

    /// Returns the largest travel of a block.
    pub fn farthest(&self) -> f64 {
        self.farthest.into()
    }

    /// Returns the number of frames since the list was built.
    pub fn age(&self) -> u32 {
        self.age
    }

    /// Returns curve and number of both blocks of a pair.
    pub fn pair(&self, pair: u32) -> [(u32, u32); 2] {
        self.pairs[pair as usize].blocks.map(|block| {
            let curve = self.blocks[block as usize].curve;
            (curve, block - self.first[curve as usize])
        })
    }

    /// Returns the pairs that may be below a level: the one for which the list was prepared, or a
    /// lower one.
    pub fn due(&self, level: f64) -> Vec<u32> {
        let mut due = Vec::new();
        let blocks = self.travel.iter().zip(&self.due).enumerate();
        for (block, _) in blocks.filter(|(_, (travel, due))| travel >= due) {
            for &k in self.pairs_of(block) {
                let pair = &self.pairs[k as usize];
                let sides = 0..2;
                let is_due =
                    |side: usize| self.travel[pair.blocks[side] as usize] >= pair.due(side, level);
                if sides.into_iter().any(is_due) {
                    due.push(k);
                }
            }
        }
        due
    }

    fn pairs_of(&self, block: usize) -> &[u32] {
        let [from, to] = [block, block + 1].map(|k| self.starts[k] as usize);
        &self.of[from..to]
    }

    /// Records the distance of a pair in the current frame.
    pub fn update(&mut self, pair: u32, measured: &Measured) {
        let pair = &mut self.pairs[pair as usize];
        pair.travel = pair.blocks.map(|block| self.travel[block as usize]);
        pair.bound = below(measured.bound.min(f64::from(f32::MAX)) - MARGIN);
        pair.ratio = measured.ratio() as f32;
    }

    /// Computes again up to which travel blocks that were due, and those of updated pairs, may be
    /// left alone.
    pub fn update_due(&mut self, pairs: &[u32], level: f64) {
        for block in 0..self.blocks.len() {
            if self.travel[block] >= self.due[block] {
                self.due[block] = self.due_of(block, level);
            }
        }
        for &k in pairs {
            let pair = &self.pairs[k as usize];
            for (side, &block) in pair.blocks.iter().enumerate() {
                let due = &mut self.due[block as usize];
                *due = due.min(pair.due(side, level));
            }
        }
    }

    fn due_of(&self, block: usize, level: f64) -> f32 {
        let pairs = self.pairs_of(block).iter();
        let due = pairs.flat_map(|&k| {
            let pair = &self.pairs[k as usize];
            let sides = (0..2).filter(move |&side| pair.blocks[side] as usize == block);
            sides.map(move |side| pair.due(side, level))
        });
        due.fold(f32::INFINITY, f32::min)
    }

    /// Prepares the list for a level.
    pub fn set_level(&mut self, level: f64) {
        for block in 0..self.blocks.len() {
            self.due[block] = self.due_of(block, level);
        }
    }

    /// Returns all blocks whose last measured clearance was below a limit.
    pub fn close_blocks(&self, limit: f64) -> Vec<CloseBlock> {
        let close = (0..self.blocks.len()).filter_map(|block| {
            let pairs = self.pairs_of(block).iter();
            let ratios = pairs.map(|&k| f64::from(self.pairs[k as usize].ratio));
            let ratio = ratios.fold(f64::INFINITY, f64::min);
            let curve = self.blocks[block].curve;
            let first = (block as u32 - self.first[curve as usize]) * LANES as u32;
            (ratio < limit).then_some(CloseBlock {
                curve,
                first,
                ratio,
            })
        });
        close.collect()
    }
}

/// Returns the blocks of all curves, with the points that they depend on.
fn blocks(set: &CurveSet, first: &[u32]) -> Vec<Block> {
    let positions = set.positions();
    let positions = positions.as_positions();
    let basis = set.basis();
    let (stride, window) = (basis.stride(), basis.window());
    let mut blocks = Vec::with_capacity(*first.last().expect("the number of blocks") as usize);
    for (i, curve) in set.curves().iter().enumerate() {
        let points = set.points_of(i);
        let lead = basis.lead(curve.closed);
        for block in 0..first[i + 1] - first[i] {
            let from = block as usize * LANES;
            let last = (from + LANES).min(curve.segments as usize) - 1;
            // Places in the curve, with the point before the first one as the last one.
            let (from, to) = (from * stride, last * stride + window);
            let n = points.len();
            let own = (from.max(lead) - lead).min(n)..(to - lead).min(n);
            let before = if from < lead { n - 1..n } else { 0..0 };
            let after = 0..(to - lead).saturating_sub(n).min(n);
            let wrapped = if before.is_empty() { after } else { before };
            let shifted =
                |r: Range<usize>| (points.start + r.start) as u32..(points.start + r.end) as u32;
            let (own, wrapped) = (shifted(own), shifted(wrapped));
            let start = positions.point(own.start as usize);
            let all = own.clone().chain(wrapped.clone());
            let far = all.map(|k| distance(positions.point(k as usize), start));
            blocks.push(Block {
                curve: i as u32,
                size: above(far.fold(0.0, f64::max)),
                points: own,
                wrapped,
            });
        }
    }
    blocks
}
