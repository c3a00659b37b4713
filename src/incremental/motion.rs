//! What a frame moved further than it may since the reference frame, and what that may have broken.

use super::affine::Affine;
use super::reference::Reference;
use super::stream::CHUNK;
use crate::curve::{Bezier, Box3, CurveSet, LANES, Point};
use crate::discretize::{Hull, MovingSeparation};
use crate::pairs::{LinkSearch, Pair};
use rayon::prelude::*;

/// Segments that moved further than they may, of a step from one frame to another.
///
/// They are looked for in the space of the reference frame, into which both frames are mapped back.
pub(super) struct Motion<'a> {
    reference: &'a Reference,
    ends: [(&'a Affine, &'a CurveSet); 2],
    space: Space,
    /// Blocks of eight segments with one of these among them, sorted.
    blocks: Vec<Block>,
}

/// Where points move on straight lines at constant speed.
#[derive(Clone, Copy, Debug)]
pub(super) enum Space {
    /// In the space of the reference frame. For linking numbers any way will do, so long as every map between is
    /// isotopic to the identity.
    Reference,
    /// In the world. Mapped back, ways are bent by up to this share of their length ([`Affine::bend`]).
    World { bend: f64 },
}

/// A block of eight segments of a curve.
struct Block {
    curve: u32,
    /// Leaf of the curve's tree.
    leaf: u32,
    /// Segments that are marked, a bit each.
    marked: u32,
    /// The box of these in both frames, and so at all times between.
    swept: Box3,
}

impl<'a> Motion<'a> {
    /// The marked segments: those that depend on a point in one of the chunks of slots that breaks its allowance.
    pub fn new(
        reference: &'a Reference,
        ends: [(&'a Affine, &'a CurveSet); 2],
        chunks: &[u32],
        space: Space,
    ) -> Motion<'a> {
        let set = ends[1].1;
        let mut motion = Motion {
            reference,
            ends,
            space,
            blocks: Vec::new(),
        };
        let mut segments: Vec<(u32, u32)> = Vec::new();
        for &chunk in chunks {
            let slots = chunk as usize * CHUNK..(chunk as usize + 1) * CHUNK;
            set.segments_at(slots, reference.cover.open, |i, s| segments.push((i, s)));
        }
        segments.sort_unstable();
        segments.dedup();
        for (i, s) in segments {
            let (leaf, bit) = (s / LANES as u32, 1 << (s % LANES as u32));
            match motion.blocks.last_mut() {
                Some(b) if (b.curve, b.leaf) == (i, leaf) => b.marked |= bit,
                _ => motion.blocks.push(Block {
                    curve: i,
                    leaf,
                    marked: bit,
                    swept: Box3::EMPTY,
                }),
            }
        }
        let swept: Vec<Box3> = motion
            .blocks
            .par_iter()
            .map(|block| motion.swept(block))
            .collect();
        for (block, swept) in motion.blocks.iter_mut().zip(swept) {
            block.swept = swept;
        }
        motion
    }

    /// Number of marked blocks.
    pub fn blocks(&self) -> usize {
        self.blocks.len()
    }

    /// Closed curves with a marked segment, each once.
    pub fn loops(&self) -> impl Iterator<Item = usize> + '_ {
        let blocks = self.blocks.chunk_by(|a, b| a.curve == b.curve);
        let curves = blocks.map(|of_one| of_one[0].curve as usize);
        curves.filter(|&i| self.reference.set.curve(i).closed)
    }

    /// A segment at both ends, mapped back.
    fn both(&self, i: usize, s: u32) -> [Bezier; 2] {
        self.ends.map(|(affine, set)| {
            let back = |p: Point| affine.back(p);
            set.segment(i, s as usize).map(back)
        })
    }

    /// A segment at both ends, where it moves on straight lines between.
    fn straight(&self, i: usize, s: u32) -> [Bezier; 2] {
        match self.space {
            Space::Reference => self.both(i, s),
            Space::World { .. } => self.ends.map(|(_, set)| set.segment(i, s as usize)),
        }
    }

    /// Rounding of points that are mapped back, and of what is computed from them, generously.
    fn slack(&self) -> f64 {
        let ends = self.ends.iter();
        let size: f64 = ends
            .map(|(affine, set)| set.max_abs() + affine.t.amax())
            .sum();
        (self.reference.set.max_abs() + 10.0 * size) * 1e-12 + 1e-300
    }

    fn swept(&self, block: &Block) -> Box3 {
        let slack = self.slack();
        let mut out = Box3::EMPTY;
        for k in 0..LANES as u32 {
            if block.marked >> k & 1 != 0 {
                let s = block.leaf * LANES as u32 + k;
                let [from, to] = self.both(block.curve as usize, s);
                for (p, q) in from.iter().zip(&to) {
                    let bent = match self.space {
                        Space::Reference => 0.0,
                        Space::World { bend } => {
                            let way = [0, 1, 2].map(|x| q[x] - p[x]);
                            bend * way.iter().map(|d| d * d).sum::<f64>().sqrt() * (1.0 + 1e-9)
                        }
                    };
                    for p in [p, q] {
                        out = out.union(&Box3::around(*p, slack + bent));
                    }
                }
            }
        }
        out
    }

    /// Pairs of curves that may have touched on the way, sorted; and how many others came near and were proven apart.
    ///
    /// In the space of the reference frame: pairs of closed curves; one that is not among them has its linking number
    /// of the reference frame. In the world: all pairs that the reference frame covers, `(i, i)` for a curve and itself.
    pub fn affected(&self, search: &mut LinkSearch) -> (Vec<Pair>, usize) {
        let reference = self.reference;
        // What is not marked stays within the reach of where it was; a pair of unmarked segments does not touch.
        let reach = (reference.reach * (1.0 + 1e-6) + self.slack()) as f32;
        let reach = reach.next_up();
        let mut boxes: Vec<Box3> = reference
            .trees
            .roots()
            .iter()
            .map(|b| b.dilated(reach))
            .collect();
        let mut marked = vec![false; boxes.len()];
        for block in &self.blocks {
            let i = block.curve as usize;
            marked[i] = true;
            boxes[i] = boxes[i].union(&block.swept);
        }
        let pairs = search.find(&boxes);
        pairs.retain(|&(i, j)| marked[i as usize] || marked[j as usize]);
        match self.space {
            Space::Reference => {
                let closed = |i: u32| reference.set.curve(i as usize).closed;
                pairs.retain(|&(i, j)| closed(i) && closed(j));
            }
            Space::World { .. } if reference.cover.own => {
                let alone = (0..marked.len()).filter(|&i| marked[i]);
                pairs.extend(alone.map(|i| (i as u32, i as u32)));
                pairs.sort_unstable();
            }
            Space::World { .. } => {}
        }
        let near: Vec<(Pair, bool, bool)> = pairs
            .par_iter()
            .map(|&pair| {
                let (near, apart) = self.look_at(pair, reach);
                (pair, near, apart)
            })
            .collect();
        let affected = near.iter().filter(|n| !n.2).map(|n| n.0).collect();
        let recertified = near.iter().filter(|n| n.1 && n.2).count();
        (affected, recertified)
    }

    fn blocks_of(&self, i: u32) -> &[Block] {
        let start = self.blocks.partition_point(|b| b.curve < i);
        let end = start + self.blocks[start..].partition_point(|b| b.curve == i);
        &self.blocks[start..end]
    }

    /// Whether marked segments came near the other curve, and whether all that did are proven apart at all times.
    fn look_at(&self, (i, j): Pair, reach: f32) -> (bool, bool) {
        let own = i == j;
        if own && !self.runs_one_way(i) {
            return (true, false);
        }
        let mut near = false;
        // Marked ones against unmarked ones, both ways.
        let both = [(i, j), (j, i)];
        for &(a, b) in &both[..if own { 1 } else { 2 }] {
            let tree = self.reference.trees.of(&self.reference.set, b as usize);
            let others = self.blocks_of(b);
            for block in self.blocks_of(a) {
                let query = block.swept.dilated(reach);
                let mut apart = true;
                tree.visit(
                    |lane| lane.overlaps(&query),
                    |t| {
                        let leaf = t / LANES as u32;
                        let at = others.binary_search_by_key(&leaf, |o| o.leaf);
                        if at.is_ok_and(|at| others[at].marked >> (t % LANES as u32) & 1 != 0) {
                            // It may be elsewhere by now: see below.
                            return;
                        }
                        near = true;
                        apart = apart && self.block_apart(block, b, t);
                    },
                );
                if !apart {
                    return (true, false);
                }
            }
        }
        // Marked ones against marked ones.
        for a in self.blocks_of(i) {
            for b in self.blocks_of(j) {
                if !(own && b.leaf < a.leaf) && a.swept.overlaps(&b.swept) {
                    near = true;
                    let mut bits = b.marked;
                    while bits != 0 {
                        let t = b.leaf * LANES as u32 + bits.trailing_zeros();
                        bits &= bits - 1;
                        if !self.block_apart(a, j, t) {
                            return (true, false);
                        }
                    }
                }
            }
        }
        (near, true)
    }

    /// Whether a curve runs one way at all times along each marked segment with those before and after it, so that
    /// these do not pass through themselves or one another. Neighbouring edges never do.
    fn runs_one_way(&self, i: u32) -> bool {
        let set = &self.reference.set;
        if set.basis().is_polyline() {
            return true;
        }
        let curve = set.curve(i as usize);
        let frames = self.ends.map(|(_, set)| set);
        let separation = MovingSeparation::new(frames, [i as usize; 2]);
        let mut turns = Vec::new();
        for block in self.blocks_of(i) {
            for k in (0..LANES as u32).filter(|k| block.marked >> k & 1 != 0) {
                let s = block.leaf * LANES as u32 + k;
                for s in [curve.before(s), s] {
                    separation.add_turns(s..s + 1, curve.after(s), &mut turns);
                }
            }
        }
        turns.is_empty()
    }

    /// Whether the marked segments of a block are apart from the segment `t` of curve `j` at all times.
    fn block_apart(&self, block: &Block, j: u32, t: u32) -> bool {
        let hulls = |i: usize, s: u32| self.straight(i, s).map(|p| Hull::of_piece(&p));
        let [b_before, b_after] = hulls(j as usize, t);
        let curve = self.reference.set.curve(j as usize);
        let margin = 2.0 * (self.slack() + self.reference.set.pad());
        (0..LANES as u32)
            .filter(|k| block.marked >> k & 1 != 0)
            .map(|k| block.leaf * LANES as u32 + k)
            // Neighbours are joined.
            .filter(|&s| block.curve != j || !curve.adjacent(s, t))
            .all(|s| {
                let [before, after] = hulls(block.curve as usize, s);
                let frames = [[&before, &b_before], [&after, &b_after]];
                Hull::separated_throughout(frames, margin)
            })
    }
}
