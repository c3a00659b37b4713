//! Near pairs of blocks, and how long each may be left alone.

use super::CloseBlock;
use super::motion::{Real, Rigid, Shifts};
use super::strands::{Arcs, Measured};
use crate::cancel::PairLimit;
use crate::curve::vector::{distance, norm, sub};
use crate::curve::{Basis, Box3, CurveSet, Point, Positions, above, below, larger, pow2};
use crate::pairs::LinkSearch;
use crate::simd::{LANES, dispatch};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// Number of blocks per task.
const GRAIN: usize = 4096;

/// Margin of a bound, in diameters, that covers all rounding to single precision.
const MARGIN: f64 = 1e-6;

/// Maximum number of near pairs of blocks, of which each needs up to 60 bytes. Yarn has about ten
/// per block.
pub(super) const MOST_NEAR: usize = 1 << 24;

/// Distance up to which pairs are listed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    /// Clearance below which the list is complete.
    pub ratio: f64,
    /// Travel up to which the list is complete.
    pub skin: f64,
}

/// A block of eight segments of a curve.
#[derive(Clone, Debug)]
struct Block {
    /// Number, counted over all curves.
    number: u32,
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
    radii: f32,
    /// Clearance when the pair was measured; infinite if it never was.
    ratio: f32,
    /// Lower bound of the clearance for these travels of the blocks.
    bound: f32,
    travel: [f32; 2],
    /// What is known from the time when the pair was measured, or listed.
    anchor: Anchor,
}

/// A lower bound of the clearance of a pair, and how its blocks were placed then.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    bound: f32,
    /// Vector between the first points of the blocks, turned back to the orientation that the scene
    /// had when the list was built.
    between: [f32; 3],
    /// Sum of the deformations of the blocks.
    deformation: f32,
}

impl NearPair {
    /// Returns the travel of one of the blocks up to which the pair is above a level.
    #[inline(always)]
    fn due(&self, side: usize, level: f64) -> f32 {
        let slack = 0.5 * (f64::from(self.bound) - level) * f64::from(self.radii);
        below(f64::from(self.travel[side]) + slack)
    }
}

/// Motion from one frame to the next.
struct Step {
    rigid: Rigid,
    stretch: f64,
}

impl Step {
    /// Adds the motion of some blocks. Returns their largest travel.
    #[inline(always)]
    fn advance<T: Real>(&self, [q, p]: [&[T]; 2], blocks: &[Block], paths: &mut [Path]) -> f32 {
        let mut farthest = 0.0_f32;
        for (block, path) in blocks.iter().zip(paths) {
            let own = 3 * block.points.start as usize..3 * block.points.end as usize;
            let (q_own, p_own) = (&q[own.clone()], &p[own]);
            let mut shifts = Shifts::EMPTY;
            shifts.add(q_own, p_own);
            if !block.wrapped.is_empty() {
                let rest = 3 * block.wrapped.start as usize..3 * block.wrapped.end as usize;
                shifts.add(&q[rest.clone()], &p[rest]);
            }
            let from = [0, 1, 2].map(|x| q_own[x].wide());
            let shift = [0, 1, 2].map(|x| p_own[x].wide() - from[x]);
            let size = f64::from(block.size) + 2.0 * f64::from(path.deformation);
            let deformed = shifts.largest_from(shift) + self.rigid.spin * size;
            let traveled = norm(sub(shift, self.rigid.displacement(from))) + deformed;
            path.travel = up(path.travel, self.stretch * traveled);
            path.deformation = up(path.deformation, self.stretch * deformed);
            farthest = larger(farthest, path.travel);
        }
        farthest
    }
}

/// Returns the sum of two numbers that are not negative, rounded up.
#[inline(always)]
fn up(x: f32, by: f64) -> f32 {
    ((f64::from(x) + by) * (1.0 + 2.0 * f64::from(f32::EPSILON))) as f32
}

/// State of a block.
#[derive(Clone, Copy, Debug, Default)]
struct Path {
    /// Sum, over all frames since the list was built, of the largest distance that one of its
    /// points moved relative to the rigid motion of the scene.
    travel: f32,
    /// The same, relative to the motion of its first point, but for the rotation of the scene.
    deformation: f32,
    /// Travel up to which no pair of the block is due.
    due: f32,
}

/// The near pairs of a frame, kept up to date in later ones.
#[derive(Debug)]
pub(super) struct NearList {
    blocks: Vec<Block>,
    /// First block of each curve.
    first: Vec<u32>,
    paths: Vec<Path>,
    pairs: Vec<NearPair>,
    /// First pair of each block in `of`, and the number of all.
    starts: Vec<u32>,
    of: Vec<u32>,
    /// Bound of the motion of curves if their control points move by 1.
    stretch: f64,
    /// Rotation of the scene since the list was built.
    rotation: Matrix3<f64>,
    reach: Reach,
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
        old: Option<&NearList>,
    ) -> Option<NearList> {
        let first = &arcs.first;
        let blocks = blocks(set, first);
        // Rounding of single-precision boxes.
        let rounding = set.max_abs() * pow2(-22);
        let bounds = |block: &Block| {
            let number = block.number - first[block.curve as usize];
            set.leaf_boxes(block.curve as usize, number as usize)
                .bounds()
        };
        let boxes: Vec<Box3> = blocks.par_iter().with_min_len(GRAIN).map(bounds).collect();
        let dilated = boxes.iter().zip(&blocks).map(|(b, block)| {
            let radius = radii[block.curve as usize];
            b.dilated(above(reach.ratio * radius + reach.skin + rounding))
        });
        let dilated: Vec<Box3> = dilated.collect();
        let mut search = LinkSearch::default();
        let limit = PairLimit::default();
        limit.begin(MOST_NEAR);
        search.limit_to(limit.clone());
        let found = search.find(&dilated);
        if limit.is_exceeded() {
            return None;
        }
        let itself = blocks.iter().map(|block| (block.number, block.number));
        found.extend(itself);
        found.sort();
        let positions = set.positions();
        let positions = positions.as_positions();
        let listed = |&(a, b): &(u32, u32)| {
            let [p, q] = [a, b].map(|k| &blocks[k as usize]);
            let [i, j] = [p, q].map(|block| block.curve as usize);
            let pair = [a, b].map(|k| k - first[i]);
            if i == j && !arcs.are_apart(i, &set.curve(i), pair, radii[i]) {
                return None;
            }
            let sum = radii[i] + radii[j];
            let gap = boxes[a as usize].dist_sq_below(&boxes[b as usize]).sqrt();
            let bound = below((gap - 2.0 * rounding).max(0.0) / sum - MARGIN);
            let [x, y] = [p, q].map(|block| positions.point(block.points.start as usize));
            Some(NearPair {
                blocks: [a, b],
                radii: sum as f32,
                ratio: f32::INFINITY,
                bound,
                travel: [0.0; 2],
                anchor: Anchor {
                    bound,
                    between: sub(y, x).map(|d| d as f32),
                    deformation: 0.0,
                },
            })
        };
        let pairs: Vec<NearPair> = match found.len() {
            ..GRAIN => found.iter().filter_map(listed).collect(),
            _ => found
                .par_iter()
                .with_min_len(GRAIN)
                .filter_map(listed)
                .collect(),
        };
        let mut list = NearList {
            paths: vec![Path::default(); blocks.len()],
            starts: vec![0; blocks.len() + 1],
            of: Vec::new(),
            first: first.clone(),
            blocks,
            pairs,
            stretch: match set.basis() {
                Basis::CatmullRom => 4.0 / 3.0,
                Basis::Polyline | Basis::Bezier | Basis::BSpline => 1.0,
            },
            rotation: Matrix3::identity(),
            reach,
            farthest: 0.0,
            age: 0,
        };
        list.index();
        if let Some(old) = old {
            list.inherit(old, positions);
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
    fn inherit(&mut self, old: &NearList, positions: Positions<'_>) {
        let mut known = old.pairs.iter().peekable();
        for pair in &mut self.pairs {
            while known.next_if(|k| k.blocks < pair.blocks).is_some() {}
            let Some(same) = known.next_if(|k| k.blocks == pair.blocks) else {
                continue;
            };
            let bound = old.bound_now(same, positions);
            if bound > f64::from(pair.bound) {
                pair.bound = below(bound);
                pair.anchor.bound = pair.bound;
            }
            pair.ratio = same.ratio;
        }
    }

    /// Returns the list for the next frame, in which the blocks have moved.
    pub fn moved(mut self, frames: [Positions<'_>; 2]) -> NearList {
        let step = Step {
            rigid: Rigid::fit(frames),
            stretch: self.stretch,
        };
        self.farthest = match frames {
            [Positions::F32(q), Positions::F32(p)] => self.advance(&step, [q, p]),
            [Positions::F64(q), Positions::F64(p)] => self.advance(&step, [q, p]),
            _ => unreachable!("frames of the same curves have the same precision"),
        };
        if let Some(turn) = step.rigid.rotation() {
            self.rotation = turn * self.rotation;
        }
        self.age += 1;
        self
    }

    /// Adds the motion of all blocks. Returns the largest travel.
    fn advance<T: Real>(&mut self, step: &Step, frames: [&[T]; 2]) -> f32 {
        let NearList { blocks, paths, .. } = self;
        let chunks = blocks.chunks(GRAIN).zip(paths.chunks_mut(GRAIN));
        let run = |(blocks, paths): (&[Block], &mut [Path])| -> f32 {
            dispatch!(Step::advance(step, frames, blocks, paths))
        };
        match chunks.len() {
            ..2 => chunks.map(run).fold(0.0, f32::max),
            _ => chunks.par_bridge().map(run).reduce(|| 0.0, f32::max),
        }
    }

    /// Returns a lower bound of the clearance of a pair in the current frame: its blocks have moved
    /// relative to one another by the change of the vector between their first points, and by their
    /// deformations.
    fn bound_now(&self, pair: &NearPair, positions: Positions<'_>) -> f64 {
        let [a, b] = pair.blocks.map(|block| block as usize);
        let [x, y] = [a, b].map(|k| positions.point(self.blocks[k].points.start as usize));
        let between = self.rotation.tr_mul(&Vector3::from(sub(y, x)));
        let before = Vector3::from(pair.anchor.between.map(f64::from));
        // Rounding of the vector, also of its components far from the origin.
        let rounding = 1e-7 * (before.amax() + between.amax());
        let deformation = f64::from(self.paths[a].deformation)
            + f64::from(self.paths[b].deformation)
            - f64::from(pair.anchor.deformation);
        let moved = (between - before).norm() + 4.0 * rounding + deformation;
        f64::from(pair.anchor.bound) - moved / f64::from(pair.radii) * (1.0 + 1e-9)
    }

    /// Returns true if the list is complete up to a level in the current frame.
    pub fn covers(&self, level: f64) -> bool {
        f64::from(self.farthest) <= self.reach.skin && level <= self.reach.ratio
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
    /// lower one. `positions` are those of the current frame.
    pub fn due(&mut self, positions: Positions<'_>, level: f64) -> Vec<u32> {
        let mut due = Vec::new();
        for block in 0..self.blocks.len() {
            if self.paths[block].travel < self.paths[block].due {
                continue;
            }
            let mut next = f32::INFINITY;
            for at in self.starts[block]..self.starts[block + 1] {
                let k = self.of[at as usize];
                let mut pair = self.pairs[k as usize];
                let travel = pair.blocks.map(|block| self.paths[block as usize].travel);
                if (0..2).any(|side| travel[side] >= pair.due(side, level)) {
                    let bound = self.bound_now(&pair, positions);
                    pair.bound = below(bound);
                    pair.travel = travel;
                    self.pairs[k as usize] = pair;
                    if bound <= level {
                        due.push(k);
                        continue;
                    }
                    for side in 0..2 {
                        let due = &mut self.paths[pair.blocks[side] as usize].due;
                        *due = due.min(pair.due(side, level));
                    }
                }
                for side in 0..2 {
                    if pair.blocks[side] as usize == block {
                        next = next.min(pair.due(side, level));
                    }
                }
            }
            self.paths[block].due = next;
        }
        due.sort_unstable();
        due.dedup();
        due
    }

    /// Records the distance of a pair in the current frame.
    pub fn update(&mut self, pair: u32, measured: &Measured, positions: Positions<'_>, level: f64) {
        let NearList {
            blocks,
            paths,
            pairs,
            rotation,
            ..
        } = self;
        let pair = &mut pairs[pair as usize];
        let [a, b] = pair.blocks.map(|block| block as usize);
        let [x, y] = [a, b].map(|k| positions.point(blocks[k].points.start as usize));
        let between = rotation.tr_mul(&Vector3::from(sub(y, x)));
        pair.bound = below(measured.bound.min(f64::from(f32::MAX)) - MARGIN);
        pair.ratio = measured.ratio() as f32;
        pair.travel = [a, b].map(|k| paths[k].travel);
        pair.anchor = Anchor {
            bound: pair.bound,
            between: Point::from(between).map(|d| d as f32),
            deformation: below(f64::from(paths[a].deformation) + f64::from(paths[b].deformation)),
        };
        for side in 0..2 {
            let due = &mut paths[pair.blocks[side] as usize].due;
            *due = due.min(pair.due(side, level));
        }
    }

    /// Prepares the list for a level.
    pub fn set_level(&mut self, level: f64) {
        self.paths
            .iter_mut()
            .for_each(|path| path.due = f32::INFINITY);
        for pair in &self.pairs {
            for side in 0..2 {
                let due = &mut self.paths[pair.blocks[side] as usize].due;
                *due = due.min(pair.due(side, level));
            }
        }
    }

    /// Returns all blocks whose last measured clearance was below a limit.
    pub fn close_blocks(&self, limit: f64) -> Vec<CloseBlock> {
        let mut ratios = vec![f32::INFINITY; self.blocks.len()];
        for pair in &self.pairs {
            for block in pair.blocks {
                let ratio = &mut ratios[block as usize];
                *ratio = ratio.min(pair.ratio);
            }
        }
        let close = self.blocks.iter().zip(ratios).filter_map(|(block, ratio)| {
            let first = (block.number - self.first[block.curve as usize]) * LANES as u32;
            (f64::from(ratio) < limit).then_some(CloseBlock {
                curve: block.curve,
                first,
                ratio: ratio.into(),
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
                number: blocks.len() as u32,
                curve: i as u32,
                size: above(far.fold(0.0, f64::max)),
                points: own,
                wrapped,
            });
        }
    }
    blocks
}
