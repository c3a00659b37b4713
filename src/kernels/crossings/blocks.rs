//! Pairs of curves down to blocks of segments, for those who test all of a block at once.

use super::evaluate::Tally;
use super::gather::Task;
use super::{Direction, Scene, Workspace, direction};
#[cfg(target_arch = "x86_64")]
use crate::curve::Avx2;
use crate::curve::{Box3, BoxGroup, LANES, Lanes, Portable};
use crate::kernels::Linking;
use crate::pairs::{Node, Pair, SMALL, closest_of_segments};
use crate::verdict::DefectKind;

/// Segments of a block, at most.
pub(crate) const BLOCK: u32 = SMALL;

/// The level of the nodes that are blocks.
const LEVEL: u8 = 1;

/// First segments of a block of the upper curve and of one of the lower.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Block(pub [u32; 2]);

/// What was counted of a pair, for certain.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counted {
    /// The sum of the signs.
    pub sum: i64,
    /// Crossings.
    pub crossings: u64,
    /// Pairs of segments that were tested.
    pub tests: u64,
}

/// The direction to count a pair of polylines in, and the pairs of blocks that hold all its crossings; none where the curves
/// are proven to be unlinked.
pub(crate) fn blocks(
    scene: Scene<'_>,
    pair: Pair,
    workspace: &mut Workspace,
    out: &mut Vec<Block>,
) -> Option<Direction> {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = Avx2::detect() {
        #[expect(unsafe_code, reason = "vector instructions")]
        // SAFETY: the token says that the processor has them.
        return unsafe { blocks_avx2(avx2, scene, pair, workspace, out) };
    }
    find(Portable, scene, pair, workspace, out)
}

/// [`find`], compiled with AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
fn blocks_avx2(
    avx2: Avx2,
    scene: Scene<'_>,
    pair: Pair,
    workspace: &mut Workspace,
    out: &mut Vec<Block>,
) -> Option<Direction> {
    find(avx2, scene, pair, workspace, out)
}

#[inline(always)]
fn find<L: Lanes>(
    simd: L,
    scene: Scene<'_>,
    (i, j): Pair,
    workspace: &mut Workspace,
    out: &mut Vec<Block>,
) -> Option<Direction> {
    workspace.stats.potential_links += 1;
    let both = [i, j].map(|i| scene.trees.of(scene.set, i as usize));
    let Workspace { fronts, agenda, .. } = &mut *workspace;
    let Some(direction) = direction::choose(simd, both, None, fronts, agenda) else {
        workspace.stats.separated += 1;
        return None;
    };
    let (first, second) = direction.upper_first(both[0], both[1]);
    while let Some((s, t)) = agenda.pop() {
        let larger = s.level.max(t.level);
        if larger <= LEVEL {
            let segment = |node: Node| node.index * (LANES as u32).pow(u32::from(node.level) + 1);
            // Both node pairs of a front may end in one block.
            out.push(Block([segment(s), segment(t)].map(|s| s / BLOCK * BLOCK)));
            continue;
        }
        let mut room = BoxGroup::EMPTY;
        if s.level == larger {
            let below = second.node_box(t);
            let group = *first.children(s, &mut room);
            for k in (0..LANES).filter(|&k| may_cross(&group.lane(k), &below, direction.axis)) {
                agenda.push((s.child(k as u32), t));
            }
        } else {
            let above = first.node_box(s);
            let group = *second.children(t, &mut room);
            for k in (0..LANES).filter(|&k| may_cross(&above, &group.lane(k), direction.axis)) {
                agenda.push((s, t.child(k as u32)));
            }
        }
    }
    // The front may have gone down to nodes below blocks.
    out.sort_unstable_by_key(|b| b.0);
    out.dedup();
    Some(direction)
}

/// Whether the shadows overlap along the axis `w`, and the upper box is not wholly below.
fn may_cross(upper: &Box3, lower: &Box3, w: usize) -> bool {
    let meet = |x: usize| lower.lo[x] <= upper.hi[x] && upper.lo[x] <= lower.hi[x];
    meet((w + 1) % 3) && meet((w + 2) % 3) && lower.lo[w] <= upper.hi[w]
}

/// The linking number of a pair of polylines from what was counted for certain and what is left to decide: segments of the
/// upper and of the lower curve.
pub(crate) fn conclude(
    scene: Scene<'_>,
    (i, j): Pair,
    direction: Direction,
    counted: Counted,
    tests: &[(u32, u32)],
    workspace: &mut Workspace,
) -> Linking {
    let [i, j] = [i as usize, j as usize];
    let (upper, lower) = direction.upper_first(i, j);
    let mut tally = Tally::default();
    if !tests.is_empty() {
        let task = Task::new(scene, [upper, lower], direction.axis);
        tally.add_shared(&task, tests);
    }
    tally.stats.crossings += counted.crossings;
    tally.stats.tests += counted.tests;
    workspace.stats.add(&tally.stats);
    match tally.contact() {
        Some([s, t]) => {
            let (s, t) = direction.upper_first(s, t);
            let place = closest_of_segments(scene.set, [i, j], [s, t]);
            Linking::Undefined(DefectKind::Contact, place)
        }
        None => Linking::Number(counted.sum + tally.sum()),
    }
}
