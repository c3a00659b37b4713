//! Simultaneous depth-first descent of the trees of two curves to segment pairs.

use super::layout::Node;
use super::sorted;
use super::trees::{BoxTree, Trees};
use crate::curve::{Box3, BoxGroup, CurveSet};
use crate::simd::{LANES, Lanes, dispatch};

/// Node pairs to visit: node of the first curve, node of the second one.
pub(crate) type Agenda = Vec<(Node, Node)>;

/// Takes every second node pair out of an agenda, because those at one of its ends have more work
/// below them.
pub(crate) fn every_second(agenda: &mut Agenda) -> impl Iterator<Item = (Node, Node)> {
    let mut taken = true;
    agenda.extract_if(.., move |_| {
        taken = !taken;
        taken
    })
}

/// Segment pairs found by a descent: segment of the first curve, segment of the second one.
#[derive(Debug, Default)]
pub(crate) struct SegmentPairs {
    /// All pairs that match the query.
    pub all: Vec<(u32, u32)>,
    /// Pairs in `all` whose boxes overlap in space, if the query requests them.
    pub meeting: Vec<(u32, u32)>,
}

/// Query of a descent: segment pairs whose boxes overlap in the projection along the axis `w`, and
/// whose first box is not entirely below the second one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Query {
    /// Axis of projection.
    pub w: usize,
    /// True if pairs that overlap in space are listed in addition.
    pub meeting: bool,
    /// Distance along any axis up to which boxes count as overlapping. Used only if `IN_SPACE` is
    /// set.
    pub reach: f32,
}

impl Query {
    /// Returns the query for pairs whose boxes are within a distance in space.
    pub const fn in_space(reach: f32) -> Query {
        Query {
            w: 2,
            meeting: false,
            reach,
        }
    }
}

/// Visits the node pairs of the agenda and their descendants until the agenda is empty, `steps`
/// node pairs have been visited, or `limit` segment pairs have been found. If `IN_SPACE` is set,
/// only pairs whose boxes overlap in space are followed. Returns the number of visited node pairs.
#[inline(always)]
pub(crate) fn descend<L: Lanes, T: BoxTree, const IN_SPACE: bool>(
    simd: L,
    [first, second]: [T; 2],
    Query { w, meeting, reach }: Query,
    agenda: &mut Agenda,
    found: &mut SegmentPairs,
    (steps, limit): (usize, usize),
) -> usize {
    let (mut leaf_t, mut leaf_u) = (BoxGroup::EMPTY, BoxGroup::EMPTY);
    for step in 0..steps {
        if found.all.len() >= limit {
            return step;
        }
        let Some((t, u)) = agenda.pop() else {
            return step;
        };
        if t.level > u.level {
            let below = One::of_box(&second.node_box(u), w).dilated::<IN_SPACE>(reach);
            let above = Eight::load(simd, first.children(t, &mut leaf_t), w);
            let mut lanes = apart::<L, IN_SPACE, false>(simd, below, above) ^ 0xff;
            while lanes != 0 {
                agenda.push((t.child(lanes.trailing_zeros()), u));
                lanes &= lanes - 1;
            }
            continue;
        }
        if u.level > t.level {
            let above = One::of_box(&first.node_box(t), w).dilated::<IN_SPACE>(reach);
            let below = Eight::load(simd, second.children(u, &mut leaf_u), w);
            let mut lanes = apart::<L, IN_SPACE, true>(simd, above, below) ^ 0xff;
            while lanes != 0 {
                agenda.push((t, u.child(lanes.trailing_zeros())));
                lanes &= lanes - 1;
            }
            continue;
        }
        let group_t = first.children(t, &mut leaf_t);
        let below = Eight::load(simd, second.children(u, &mut leaf_u), w);
        // Bit `8 k + l` is for child `k` of the first node and child `l` of the second one: a
        // single mask, computed without a branch.
        let mut none = 0;
        for k in 0..LANES {
            let above = One::of_lane(group_t, k, w).dilated::<IN_SPACE>(reach);
            let lanes = apart::<L, IN_SPACE, true>(simd, above, below);
            none |= u64::from(lanes) << (LANES * k);
        }
        let mut pairs = !none;
        if t.level > 0 {
            while pairs != 0 {
                let bit = pairs.trailing_zeros();
                agenda.push((t.child(bit / 8), u.child(bit % 8)));
                pairs &= pairs - 1;
            }
            continue;
        }
        if meeting && pairs != 0 {
            let mut over = 0;
            for k in 0..LANES {
                let bottom = simd.splat(group_t.lo[w][k]);
                let lanes = simd.bits(simd.less(below.hi[2], bottom));
                over |= u64::from(lanes) << (LANES * k);
            }
            let mut meeting = pairs & !over;
            while meeting != 0 {
                let bit = meeting.trailing_zeros();
                found.meeting.push((t.lane(bit / 8), u.lane(bit % 8)));
                meeting &= meeting - 1;
            }
        }
        while pairs != 0 {
            let bit = pairs.trailing_zeros();
            found.all.push((t.lane(bit / 8), u.lane(bit % 8)));
            pairs &= pairs - 1;
        }
    }
    steps
}

/// Returns all segment pairs of curves `i` and `j` with overlapping boxes in space, sorted.
pub(crate) fn overlapping_segments(
    set: &CurveSet,
    trees: &Trees,
    i: usize,
    j: usize,
) -> Vec<(u32, u32)> {
    sorted(dispatch!(simd => find(simd, set, trees, [i, j])))
}

#[inline(always)]
fn find<L: Lanes>(simd: L, set: &CurveSet, trees: &Trees, pair: [usize; 2]) -> Vec<(u32, u32)> {
    let both = pair.map(|i| trees.of(set, i));
    let mut agenda = vec![(both[0].root(), both[1].root())];
    let mut found = SegmentPairs::default();
    let query = Query::in_space(0.0);
    let all = (usize::MAX, usize::MAX);
    descend::<L, _, true>(simd, both, query, &mut agenda, &mut found, all);
    found.all
}

/// Returns the lanes whose boxes overlap a box in space, one bit each.
#[inline(always)]
pub(crate) fn overlapping<L: Lanes>(simd: L, one: &Box3, group: &BoxGroup) -> u32 {
    let w = 2;
    apart::<L, true, true>(simd, One::of_box(one, w), Eight::load(simd, group, w)) ^ 0xff
}

/// A box in the coordinate frame `(u, v, w)`. Kept in registers, because a box that is written to
/// memory in parts and read as a whole stalls the CPU (no store forwarding).
#[derive(Clone, Copy)]
struct One {
    lo: [f32; 3],
    hi: [f32; 3],
}

impl One {
    #[inline(always)]
    fn of_box(b: &Box3, w: usize) -> One {
        let (u, v) = ((w + 1) % 3, (w + 2) % 3);
        One {
            lo: [b.lo[u], b.lo[v], b.lo[w]],
            hi: [b.hi[u], b.hi[v], b.hi[w]],
        }
    }

    #[inline(always)]
    fn of_lane(group: &BoxGroup, k: usize, w: usize) -> One {
        let (u, v) = ((w + 1) % 3, (w + 2) % 3);
        One {
            lo: [group.lo[u][k], group.lo[v][k], group.lo[w][k]],
            hi: [group.hi[u][k], group.hi[v][k], group.hi[w][k]],
        }
    }

    /// Returns the box grown by `reach` on all sides, or the same box if `ENABLED` is not set.
    #[inline(always)]
    fn dilated<const ENABLED: bool>(mut self, reach: f32) -> One {
        if ENABLED {
            for x in 0..3 {
                self.lo[x] -= reach;
                self.hi[x] += reach;
            }
        }
        self
    }
}

/// Eight boxes in the same coordinate frame.
#[derive(Clone, Copy)]
struct Eight<L: Lanes> {
    lo: [L::Floats; 3],
    hi: [L::Floats; 3],
}

impl<L: Lanes> Eight<L> {
    #[inline(always)]
    fn load(simd: L, group: &BoxGroup, w: usize) -> Self {
        let (u, v) = ((w + 1) % 3, (w + 2) % 3);
        let (lo, hi) = (&group.lo, &group.hi);
        Eight {
            lo: [simd.load(&lo[u]), simd.load(&lo[v]), simd.load(&lo[w])],
            hi: [simd.load(&hi[u]), simd.load(&hi[v]), simd.load(&hi[w])],
        }
    }
}

/// Returns the lanes whose pair with a box does not match the query, one bit each. The box belongs
/// to the first curve if `FIRST` is set.
#[inline(always)]
fn apart<L: Lanes, const IN_SPACE: bool, const FIRST: bool>(
    simd: L,
    one: One,
    eight: Eight<L>,
) -> u32 {
    let mut apart = simd.or(
        simd.less(simd.splat(one.hi[0]), eight.lo[0]),
        simd.less(eight.hi[0], simd.splat(one.lo[0])),
    );
    apart = simd.or(apart, simd.less(simd.splat(one.hi[1]), eight.lo[1]));
    apart = simd.or(apart, simd.less(eight.hi[1], simd.splat(one.lo[1])));
    if IN_SPACE || FIRST {
        apart = simd.or(apart, simd.less(simd.splat(one.hi[2]), eight.lo[2]));
    }
    if IN_SPACE || !FIRST {
        apart = simd.or(apart, simd.less(eight.hi[2], simd.splat(one.lo[2])));
    }
    simd.bits(apart)
}
