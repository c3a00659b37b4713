//! Depth-first through both trees in the chosen direction, down to pairs of segments.

use super::Scene;
use crate::curve::{Box3, BoxGroup, LANES, Lanes};
use crate::pairs::Node;

/// Candidates at which a batch is handed on.
const BATCH: usize = 4096;

/// Pairs of segments, upper curve first.
#[derive(Debug, Default)]
pub(super) struct Candidates {
    /// Overlap in projection, and the upper one is not wholly below: to be tested for a crossing.
    pub tests: Vec<(u32, u32)>,
    /// Those of them whose boxes overlap in space as well: they may touch, or be too close to discretize.
    pub overlaps: Vec<(u32, u32)>,
}

impl Candidates {
    pub fn clear(&mut self) {
        self.tests.clear();
        self.overlaps.clear();
    }
}

/// Visits the node pairs on `stack`; calls `full` whenever many candidates have gathered, and at the end.
#[inline(always)]
pub(super) fn traverse<L: Lanes>(
    simd: L,
    scene: Scene<'_>,
    [over, under]: [usize; 2],
    w: usize,
    stack: &mut Vec<(Node, Node)>,
    candidates: &mut Candidates,
    mut full: impl FnMut(&mut Candidates),
) {
    let Scene { set, trees } = scene;
    let (mut room_t, mut room_u) = (BoxGroup::EMPTY, BoxGroup::EMPTY);
    while let Some((t, u)) = stack.pop() {
        if t.level > u.level {
            let other = trees.node_box(under, u);
            let group = trees.children(set, over, t, &mut room_t);
            // The upper curve's children: in the way, and not wholly below the lower one.
            let lanes = overlapping(simd, &other, group, w) & not_below(simd, group, &other, w);
            each_bit(lanes, |k| stack.push((t.child(k), u)));
            continue;
        }
        if u.level > t.level {
            let other = trees.node_box(over, t);
            let group = trees.children(set, under, u, &mut room_u);
            let lanes = overlapping(simd, &other, group, w) & not_above(simd, group, &other, w);
            each_bit(lanes, |k| stack.push((t, u.child(k))));
            continue;
        }
        let group_t = trees.children(set, over, t, &mut room_t);
        let group_u = trees.children(set, under, u, &mut room_u);
        for k in 0..LANES as u32 {
            let lane = group_t.lane(k as usize);
            let lanes = overlapping(simd, &lane, group_u, w) & not_above(simd, group_u, &lane, w);
            if t.level > 0 {
                each_bit(lanes, |l| stack.push((t.child(k), u.child(l))));
                continue;
            }
            each_bit(lanes, |l| {
                candidates.tests.push((t.segment(k), u.segment(l)))
            });
            each_bit(lanes & not_below(simd, group_u, &lane, w), |l| {
                candidates.overlaps.push((t.segment(k), u.segment(l)));
            });
        }
        if candidates.tests.len() >= BATCH {
            full(candidates);
        }
    }
    full(candidates);
}

/// Lanes that overlap a box in the projection along `w`.
#[inline(always)]
fn overlapping<L: Lanes>(lanes: L, b: &Box3, group: &BoxGroup, w: usize) -> u32 {
    let (u, v) = ((w + 1) % 3, (w + 2) % 3);
    let apart = lanes.greater(&group.lo[u], b.hi[u])
        | lanes.less(&group.hi[u], b.lo[u])
        | lanes.greater(&group.lo[v], b.hi[v])
        | lanes.less(&group.hi[v], b.lo[v]);
    !apart & 0xff
}

/// Lanes that are not wholly below a box.
#[inline(always)]
fn not_below<L: Lanes>(lanes: L, group: &BoxGroup, b: &Box3, w: usize) -> u32 {
    !lanes.less(&group.hi[w], b.lo[w]) & 0xff
}

/// Lanes that are not wholly above a box.
#[inline(always)]
fn not_above<L: Lanes>(lanes: L, group: &BoxGroup, b: &Box3, w: usize) -> u32 {
    !lanes.greater(&group.lo[w], b.hi[w]) & 0xff
}

#[inline(always)]
fn each_bit(mut mask: u32, mut f: impl FnMut(u32)) {
    while mask != 0 {
        f(mask.trailing_zeros());
        mask &= mask - 1;
    }
}
