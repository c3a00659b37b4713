//! Segments that moved further than their allowances, and the pairs of curves that this may affect.

use super::affine::Affine;
use super::reference::Reference;
use super::slots::CHUNK;
use crate::curve::vector::distance;
use crate::curve::{Bezier, Box3, CurveSet, Point};
use crate::discretize::{Hull, MovingSeparation};
use crate::pairs::{LinkSearch, Pair};
use crate::simd::LANES;
use rayon::prelude::*;

/// Segments that moved further than their allowances in a step from one frame to another.
///
/// The search takes place in the space of the reference frame, into which both frames are mapped
/// back. Points move on straight lines in world space. Mapped back, their paths deviate from
/// straight lines by up to a share of their length ([`Affine::bend`]).
pub(super) struct MovedSegments<'a> {
    reference: &'a Reference,
    ends: [(&'a Affine, &'a CurveSet); 2],
    bend: f64,
    /// Blocks of eight segments with at least one marked segment, sorted.
    blocks: Vec<Block>,
}

/// A block of eight segments of a curve.
struct Block {
    curve: u32,
    /// Leaf of the curve's tree.
    leaf: u32,
    /// Marked segments, one bit each.
    marked: u32,
    /// Bounding box of the marked segments in both frames, and so at all times in between.
    swept: Box3,
}

impl<'a> MovedSegments<'a> {
    /// Marks the segments that depend on a point in one of the chunks, which contain the points
    /// that moved further than their allowances.
    pub fn new(
        reference: &'a Reference,
        ends: [(&'a Affine, &'a CurveSet); 2],
        chunks: &[u32],
        bend: f64,
    ) -> MovedSegments<'a> {
        let set = ends[1].1;
        let mut motion = MovedSegments {
            reference,
            ends,
            bend,
            blocks: Vec::new(),
        };
        let mut segments: Vec<(u32, u32)> = Vec::new();
        for &chunk in chunks {
            let slots = chunk as usize * CHUNK..(chunk as usize + 1) * CHUNK;
            set.segments_at(slots, reference.coverage.open_curves, |i, s| {
                segments.push((i, s))
            });
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

    /// Returns the number of marked blocks.
    pub fn blocks(&self) -> usize {
        self.blocks.len()
    }

    /// Returns a segment at both ends of the step, mapped back to the reference frame.
    fn both(&self, i: usize, s: u32) -> [Bezier; 2] {
        self.ends.map(|(affine, set)| {
            let back = |p: Point| affine.back(p);
            set.segment(i, s as usize).map(back)
        })
    }

    /// Returns a generous bound of the rounding errors of points that are mapped back, and of
    /// values computed from them.
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
                    let bent = self.bend * distance(*p, *q) * (1.0 + 1e-9);
                    for p in [p, q] {
                        out = out.union(&Box3::around(*p, slack + bent));
                    }
                }
            }
        }
        out
    }

    /// Returns the pairs of curves that may have touched during the step, sorted, and the number of
    /// other pairs that came near and were proven apart.
    ///
    /// The pair `(i, i)` is a curve and itself.
    pub fn affected(&self, search: &mut LinkSearch) -> (Vec<Pair>, usize) {
        let reference = self.reference;
        // Unmarked segments stay within the reach of their places, and two unmarked segments do not
        // touch.
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
        if reference.coverage.self_crossings {
            let alone = (0..marked.len()).filter(|&i| marked[i]);
            pairs.extend(alone.map(|i| (i as u32, i as u32)));
            pairs.sort_unstable();
        }
        let near: Vec<(Pair, bool, bool)> = pairs
            .par_iter()
            .map(|&pair| {
                let (near, apart) = self.check(pair, reach);
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

    /// Returns two results: true if marked segments came near the other curve, and true if all of
    /// these are proven apart at all times.
    fn check(&self, (i, j): Pair, reach: f32) -> (bool, bool) {
        let same = i == j;
        if same && !self.is_monotonic(i) {
            return (true, false);
        }
        let mut near = false;
        // Marked segments with unmarked ones, both ways.
        let both = [(i, j), (j, i)];
        for &(a, b) in &both[..if same { 1 } else { 2 }] {
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
                            // This one is marked as well and may have left its box: see below.
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
        // Marked segments with marked ones.
        for a in self.blocks_of(i) {
            for b in self.blocks_of(j) {
                if !(same && b.leaf < a.leaf) && a.swept.overlaps(&b.swept) {
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

    /// Returns true if the curve is monotonic at all times along each marked segment together with
    /// its neighbours, so that these do not pass through themselves or one another. Adjacent edges
    /// never do.
    fn is_monotonic(&self, i: u32) -> bool {
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

    /// Returns true if the marked segments of a block are proven apart from segment `t` of curve
    /// `j` at all times.
    fn block_apart(&self, block: &Block, j: u32, t: u32) -> bool {
        let hulls = |i: usize, s: u32| {
            self.ends
                .map(|(_, set)| Hull::of_piece(&set.segment(i, s as usize)))
        };
        let [b_before, b_after] = hulls(j as usize, t);
        let curve = self.reference.set.curve(j as usize);
        let margin = 2.0 * (self.slack() + self.reference.set.pad());
        (0..LANES as u32)
            .filter(|k| block.marked >> k & 1 != 0)
            .map(|k| block.leaf * LANES as u32 + k)
            // Adjacent segments are joined.
            .filter(|&s| block.curve != j || !curve.adjacent(s, t))
            .all(|s| {
                let [before, after] = hulls(block.curve as usize, s);
                let frames = [[&before, &b_before], [&after, &b_after]];
                Hull::separated_throughout(frames, margin)
            })
    }
}
