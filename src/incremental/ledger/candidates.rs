//! Pairs of segments that may meet between two frames: a descent in both trees of swept boxes.
//! Candidates that are edges of polylines are tested at once.

use super::pair::Task;
use super::passages::Findings;
use super::swept::SweptTree;
use crate::curve::{Box3, BoxGroup};
use crate::pairs::{
    Agenda, BoxTree, Node, Query, SegmentPairs, descend, every_second, overlapping,
};
use crate::simd::{LANES, Lanes, Portable, dispatch};
use std::ops::Range;
use std::sync::atomic::Ordering;

/// Number of candidates that are gathered before they are tested.
const BATCH: usize = 4096;

/// Number of node pairs that are visited before the candidates are tested, even if there are few.
const STEPS: usize = 4096;

/// Number of rounds of visits and tests after which a task splits the rest of its agenda in two.
const ROUNDS: usize = 3;

/// Number of segments of a leaf.
const BLOCK: u32 = LANES as u32;

/// Number of blocks of one curve above which they are split into tasks.
const BLOCKS: usize = 1 << 12;

/// Buffers and results of the visits of one pair.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    agenda: Agenda,
    candidates: SegmentPairs,
    /// Spline segments that may meet.
    pub near: Vec<(u32, u32)>,
    pub found: Findings,
}

/// Work of a task: pairs of nodes or segments that it visits.
enum Visit {
    /// Descendants of the node pairs of the agenda.
    Agenda,
    /// Blocks of a curve, each with itself.
    Blocks(Range<u32>),
    /// All leaves of two small curves, with the number of leaves of each.
    Leaves([u32; 2]),
}

impl Task<'_> {
    /// Gathers the candidates and tests those that are edges.
    pub fn gather(&self, gathered: &mut Gathered) {
        gathered.near.clear();
        gathered.found.clear();
        gathered.found.counts.pairs = 1;
        gathered.agenda.clear();
        if let Some([s, t]) = self.parts.and_then(|parts| parts.joint())
            && self.splines()
            && self.separation.may_turn(s, t)
        {
            gathered.near.push((s, t));
        }
        let (first, second) = (self.tree(0), self.tree(1));
        if self.is_self() {
            let curve = self.step.frames[0].curve(self.curves[0]);
            self.visit(Visit::Blocks(0..curve.segments.div_ceil(BLOCK)), gathered);
            above_the_leaves(first, &mut gathered.agenda);
        } else if let (Some(p), Some(q)) = (first.few_leaves(), second.few_leaves()) {
            return self.visit(Visit::Leaves([p, q]), gathered);
        } else {
            gathered.agenda.push((first.root(), second.root()));
        }
        self.visit(Visit::Agenda, gathered);
    }

    /// Visits pairs, and tests the candidates among them.
    fn visit(&self, visit: Visit, gathered: &mut Gathered) {
        dispatch!(simd => Self::visit_with(self, simd, visit, gathered))
    }

    #[inline(always)]
    fn visit_with<L: Lanes>(&self, simd: L, visit: Visit, gathered: &mut Gathered) {
        match visit {
            Visit::Agenda => self.visit_agenda(simd, gathered),
            Visit::Leaves(counts) => self.visit_leaves(simd, counts, gathered),
            Visit::Blocks(blocks) if blocks.len() > BLOCKS => {
                let middle = blocks.start + blocks.len() as u32 / 2;
                let halves = [blocks.start..middle, middle..blocks.end].map(Visit::Blocks);
                self.visit_both(gathered, halves, vec![]);
            }
            Visit::Blocks(blocks) => {
                for block in blocks {
                    self.visit_block(simd, block, gathered);
                    if self.exceeds_limits() {
                        return;
                    }
                }
            }
        }
    }

    /// Visits all descendants of the node pairs of the agenda.
    #[inline(always)]
    fn visit_agenda<L: Lanes>(&self, simd: L, gathered: &mut Gathered) {
        let both = [self.tree(0), self.tree(1)];
        let query = Query::in_space(0.0);
        for round in 0.. {
            let (agenda, candidates) = (&mut gathered.agenda, &mut gathered.candidates);
            if agenda.is_empty() {
                return;
            }
            if round >= ROUNDS && agenda.len() > 1 {
                let others = every_second(agenda).collect();
                return self.visit_both(gathered, [Visit::Agenda, Visit::Agenda], others);
            }
            descend::<L, _, true>(simd, both, query, agenda, candidates, (STEPS, BATCH));
            self.test_candidates(gathered);
            if self.exceeds_limits() {
                gathered.agenda.clear();
            }
        }
    }

    /// Visits all leaves of two small curves, without a descent.
    #[inline(always)]
    fn visit_leaves<L: Lanes>(&self, simd: L, [p, q]: [u32; 2], gathered: &mut Gathered) {
        let [first, second] = [self.tree(0), self.tree(1)];
        let [bounds, other_bounds] = [first, second].map(|tree| tree.node_box(tree.root()));
        if !bounds.overlaps(&other_bounds) {
            return;
        }
        let mut buffer = BoxGroup::EMPTY;
        let mut others = [BoxGroup::EMPTY; LANES];
        for (h, other) in (0..q).zip(&mut others) {
            *other = *second.children(Node::new(0, h), &mut buffer);
        }
        for g in 0..p {
            let group = *first.children(Node::new(0, g), &mut buffer);
            let mut lanes = overlapping(simd, &other_bounds, &group);
            while lanes != 0 {
                let k = lanes.trailing_zeros();
                lanes &= lanes - 1;
                let one = group.lane(k as usize);
                for (h, eight) in (0..q).zip(&others) {
                    let mut found = overlapping(simd, &one, eight);
                    while found != 0 {
                        let l = found.trailing_zeros();
                        found &= found - 1;
                        let pair = (g * BLOCK + k, h * BLOCK + l);
                        gathered.candidates.all.push(pair);
                    }
                }
            }
        }
        self.test_candidates(gathered);
    }

    /// Visits the pairs of segments within a block of a curve. For splines, these include each
    /// segment with itself and with the next one.
    #[inline(always)]
    fn visit_block<L: Lanes>(&self, simd: L, block: u32, gathered: &mut Gathered) {
        let first = block * BLOCK;
        let mut leaf = BoxGroup::EMPTY;
        let boxes = *self.tree(0).children(Node::new(0, block), &mut leaf);
        for k in 0..BLOCK {
            // Skips the next segment, which is adjacent.
            let mut lanes = overlapping(simd, &boxes.lane(k as usize), &boxes) & !0 << (k + 2);
            while lanes != 0 {
                let l = lanes.trailing_zeros();
                gathered.candidates.all.push((first + k, first + l));
                lanes &= lanes - 1;
            }
        }
        self.test_candidates(gathered);
        if !self.splines() {
            return;
        }
        let curve = self.step.frames[0].curve(self.curves[0]);
        let last = (first + BLOCK).min(curve.segments);
        let after = curve.after(last - 1);
        self.separation
            .add_turns(first..last, after, &mut gathered.near);
    }

    /// Makes two visits in parallel. The second one has `agenda` as its node pairs.
    #[cold]
    fn visit_both(&self, gathered: &mut Gathered, [mine, others]: [Visit; 2], agenda: Agenda) {
        let mut other = Gathered {
            agenda,
            ..Gathered::default()
        };
        rayon::join(
            || self.visit(mine, gathered),
            || self.visit(others, &mut other),
        );
        gathered.near.append(&mut other.near);
        gathered.found.append(&mut other.found);
    }

    /// Tests candidates that are edges. Keeps spline segments that may meet.
    #[inline(always)]
    fn test_candidates(&self, gathered: &mut Gathered) {
        let candidates = &mut gathered.candidates.all;
        let (count, found) = (candidates.len() as u64, &mut gathered.found);
        self.candidates.fetch_add(count, Ordering::Relaxed);
        found.counts.candidates += count;
        for (s, t) in candidates.drain(..) {
            if self.adjacent(s, t) {
                continue;
            }
            if !self.splines() {
                let exact = found.counts.exact;
                self.add_edges(s, t, found);
                if self.count_exact(found.counts.exact - exact).is_break() {
                    break;
                }
            } else if !self.separation.apart(s, t) {
                gathered.near.push((s, t));
            }
        }
    }
}

/// Adds pairs of different children of the same node, above the leaves, with overlapping boxes.
/// Their descendants contain every pair of segments of different leaves once.
fn above_the_leaves(tree: SweptTree<'_>, agenda: &mut Agenda) {
    let mut nodes = vec![tree.root()];
    let mut leaf = BoxGroup::EMPTY;
    while let Some(node) = nodes.pop() {
        if node.level == 0 {
            continue;
        }
        let boxes = *tree.children(node, &mut leaf);
        for k in 0..BLOCK {
            let bounds = boxes.lane(k as usize);
            if bounds == Box3::EMPTY {
                break;
            }
            nodes.push(node.child(k));
            let lanes = overlapping(Portable, &bounds, &boxes);
            let later = (k + 1..BLOCK).filter(|l| lanes >> l & 1 != 0);
            agenda.extend(later.map(|l| (node.child(k), node.child(l))));
        }
    }
}
