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
            let lanes = Shadow::of(&other, w).overlapping(simd, group, w)
                & not_below(simd, group, other.lo[w], w);
            each_bit(lanes, |k| stack.push((t.child(k), u)));
            continue;
        }
        if u.level > t.level {
            let other = trees.node_box(over, t);
            let group = trees.children(set, under, u, &mut room_u);
            let lanes = Shadow::of(&other, w).overlapping(simd, group, w)
                & not_above(simd, group, other.hi[w], w);
            each_bit(lanes, |k| stack.push((t, u.child(k))));
            continue;
        }
        let group_t = trees.children(set, over, t, &mut room_t);
        let group_u = trees.children(set, under, u, &mut room_u);
        for k in 0..LANES as u32 {
            let shadow = Shadow::of_lane(group_t, k as usize, w);
            let top = group_t.hi[w][k as usize];
            let lanes = shadow.overlapping(simd, group_u, w) & not_above(simd, group_u, top, w);
            if t.level > 0 {
                each_bit(lanes, |l| stack.push((t.child(k), u.child(l))));
                continue;
            }
            if lanes == 0 {
                continue;
            }
            each_bit(lanes, |l| {
                candidates.tests.push((t.segment(k), u.segment(l)));
            });
            let bottom = group_t.lo[w][k as usize];
            each_bit(lanes & not_below(simd, group_u, bottom, w), |l| {
                candidates.overlaps.push((t.segment(k), u.segment(l)));
            });
        }
        if candidates.tests.len() >= BATCH {
            full(candidates);
        }
    }
    full(candidates);
}

/// The projection of a box along an axis. Kept in registers: a box in memory, written in parts and read whole, is
/// what the processor waits for longest.
#[derive(Clone, Copy)]
struct Shadow {
    lo: [f32; 2],
    hi: [f32; 2],
}

impl Shadow {
    #[inline(always)]
    fn of(b: &Box3, w: usize) -> Shadow {
        let (u, v) = ((w + 1) % 3, (w + 2) % 3);
        Shadow {
            lo: [b.lo[u], b.lo[v]],
            hi: [b.hi[u], b.hi[v]],
        }
    }

    #[inline(always)]
    fn of_lane(group: &BoxGroup, k: usize, w: usize) -> Shadow {
        let (u, v) = ((w + 1) % 3, (w + 2) % 3);
        Shadow {
            lo: [group.lo[u][k], group.lo[v][k]],
            hi: [group.hi[u][k], group.hi[v][k]],
        }
    }

    /// Lanes that overlap it.
    #[inline(always)]
    fn overlapping<L: Lanes>(self, simd: L, group: &BoxGroup, w: usize) -> u32 {
        let (u, v) = ((w + 1) % 3, (w + 2) % 3);
        let apart = simd.greater(&group.lo[u], self.hi[0])
            | simd.less(&group.hi[u], self.lo[0])
            | simd.greater(&group.lo[v], self.hi[1])
            | simd.less(&group.hi[v], self.lo[1]);
        !apart & 0xff
    }
}

/// Lanes whose top is not below a height.
#[inline(always)]
fn not_below<L: Lanes>(simd: L, group: &BoxGroup, height: f32, w: usize) -> u32 {
    !simd.less(&group.hi[w], height) & 0xff
}

/// Lanes whose bottom is not above a height.
#[inline(always)]
fn not_above<L: Lanes>(simd: L, group: &BoxGroup, height: f32, w: usize) -> u32 {
    !simd.greater(&group.lo[w], height) & 0xff
}

#[inline(always)]
fn each_bit(mut mask: u32, mut f: impl FnMut(u32)) {
    while mask != 0 {
        f(mask.trailing_zeros());
        mask &= mask - 1;
    }
}
