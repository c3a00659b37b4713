//! Depth-first through the trees of two curves at once, down to pairs of segments.

use super::trees::{CurveTree, Node};
use crate::curve::{Box3, BoxGroup, LANES, Lanes};

/// Which segment pairs a descent finds, and what becomes of them.
pub(crate) trait Visitor {
    /// Whether the boxes must overlap in space. If not, only their shadows along the axis must, and the first
    /// curve must not be wholly below the second.
    const IN_SPACE: bool;

    /// Whether it has gathered enough for now.
    fn full(&self) -> bool;

    /// Takes segment pairs of the leaves `t` of the first curve and `u` of the second: the bit `8 k + l` stands
    /// for the `k`-th segment of `t` and the `l`-th of `u`. There is at least one. `w` is the axis.
    fn visit<L: Lanes>(
        &mut self,
        simd: L,
        leaves: [Node; 2],
        boxes: [&BoxGroup; 2],
        w: usize,
        pairs: u64,
    );
}

/// Visits the node pairs on `stack` and everything below them, until none is left, `steps` node pairs were looked
/// into, or the visitor is full. `w` is the axis of projection.
#[inline(always)]
pub(crate) fn descend<L: Lanes, V: Visitor>(
    simd: L,
    [first, second]: [CurveTree<'_>; 2],
    w: usize,
    stack: &mut Vec<(Node, Node)>,
    visitor: &mut V,
    steps: u32,
) {
    let (mut room_t, mut room_u) = (BoxGroup::EMPTY, BoxGroup::EMPTY);
    for _ in 0..steps {
        if visitor.full() {
            return;
        }
        let Some((t, u)) = stack.pop() else { return };
        if t.level > u.level {
            let below = One::of_box(&second.node_box(u), w);
            let above = Eight::load(simd, first.children(t, &mut room_t), w);
            let mut lanes = near::<L, V>(simd, below, above, Side::Second);
            while lanes != 0 {
                stack.push((t.child(lanes.trailing_zeros()), u));
                lanes &= lanes - 1;
            }
            continue;
        }
        if u.level > t.level {
            let above = One::of_box(&first.node_box(t), w);
            let below = Eight::load(simd, second.children(u, &mut room_u), w);
            let mut lanes = near::<L, V>(simd, above, below, Side::First);
            while lanes != 0 {
                stack.push((t, u.child(lanes.trailing_zeros())));
                lanes &= lanes - 1;
            }
            continue;
        }
        let group_t = first.children(t, &mut room_t);
        let group_u = second.children(u, &mut room_u);
        let below = Eight::load(simd, group_u, w);
        let mut pairs = 0u64;
        for k in 0..LANES {
            let above = One::of_lane(group_t, k, w);
            pairs |= u64::from(near::<L, V>(simd, above, below, Side::First)) << (LANES * k);
        }
        if t.level == 0 {
            if pairs != 0 {
                visitor.visit(simd, [t, u], [group_t, group_u], w, pairs);
            }
            continue;
        }
        while pairs != 0 {
            let bit = pairs.trailing_zeros();
            pairs &= pairs - 1;
            stack.push((t.child(bit / 8), u.child(bit % 8)));
        }
    }
}

/// The curve that a single box belongs to.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    First,
    Second,
}

/// A box in the frame `(u, v, w)`. Kept in registers: a box in memory, written in parts and read whole, is what
/// the processor waits for longest.
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
}

/// Eight boxes in the same frame.
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

/// Lanes that go on with a box.
#[inline(always)]
fn near<L: Lanes, V: Visitor>(simd: L, one: One, eight: Eight<L>, side: Side) -> u32 {
    let mut apart = simd.or(
        simd.less(simd.splat(one.hi[0]), eight.lo[0]),
        simd.less(eight.hi[0], simd.splat(one.lo[0])),
    );
    apart = simd.or(apart, simd.less(simd.splat(one.hi[1]), eight.lo[1]));
    apart = simd.or(apart, simd.less(eight.hi[1], simd.splat(one.lo[1])));
    if V::IN_SPACE || side == Side::First {
        apart = simd.or(apart, simd.less(simd.splat(one.hi[2]), eight.lo[2]));
    }
    if V::IN_SPACE || side == Side::Second {
        apart = simd.or(apart, simd.less(eight.hi[2], simd.splat(one.lo[2])));
    }
    !simd.bits(apart) & 0xff
}
