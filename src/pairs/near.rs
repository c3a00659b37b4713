//! Near leaves of two trees: blocks of eight segments whose boxes are not far apart.

use super::descent::overlapping;
use super::trees::CurveTree;
use crate::curve::{Box3, BoxGroup, CurveSet};
use crate::simd::{LANES, Portable};

/// Maximum number of near pairs of blocks that are listed, of which each needs up to 40 bytes. Yarn
/// has about ten per block; the strands of a wound ball, which are all near one another, have
/// thousands.
pub(crate) const MOST_NEAR: usize = 1 << 24;

/// Calls `near` with every leaf of one tree and every leaf of another one, and the distance of
/// their boxes along some axis, if that is not above the range.
pub(crate) fn near_leaves(
    [first, second]: [CurveTree<'_>; 2],
    range: f32,
    mut near: impl FnMut(u32, u32, f32) -> bool,
) {
    let mut agenda = vec![(first.root(), second.root())];
    let mut leaf = BoxGroup::EMPTY;
    while let Some((t, u)) = agenda.pop() {
        let [a, b] = [first.node_box(t), second.node_box(u)];
        let gap = gap_along_an_axis(&a, &b);
        if gap > range {
            continue;
        }
        let lanes = |other: &Box3, group: &BoxGroup| {
            let bits = overlapping(Portable, &other.dilated(range), group);
            (0..LANES as u32).filter(move |k| bits >> k & 1 != 0)
        };
        match (t.level, u.level) {
            (0, 0) => {
                if !near(t.index, u.index, gap) {
                    return;
                }
            }
            (p, q) if p >= q => {
                let group = first.children(t, &mut leaf);
                agenda.extend(lanes(&b, group).map(|k| (t.child(k), u)));
            }
            _ => {
                let group = second.children(u, &mut leaf);
                agenda.extend(lanes(&a, group).map(|k| (t, u.child(k))));
            }
        }
    }
}

/// Returns the largest distance of two boxes along an axis, rounded down; 0 if they overlap.
fn gap_along_an_axis(a: &Box3, b: &Box3) -> f32 {
    let gap = |x: usize| (a.lo[x] - b.hi[x]).max(b.lo[x] - a.hi[x]);
    let gap = gap(0).max(gap(1)).max(gap(2));
    gap.max(0.0) * (1.0 - 1e-6)
}

/// Returns the first block of each curve, and the number of all blocks.
pub(crate) fn first_blocks(set: &CurveSet) -> Vec<u32> {
    let mut first = vec![0];
    let mut count = 0;
    for curve in set.curves() {
        count += curve.segments.div_ceil(LANES as u32);
        first.push(count);
    }
    first
}
