//! Depth-first through the trees of two curves at once, down to pairs of segments.
//!
//! Node pairs are looked into a block at a time, and what survives is spread out afterwards: how many of 64 child
//! pairs survive is nothing that a processor can guess, so nothing branches on it.

use super::trees::{CurveTree, Node};
use crate::curve::{Box3, BoxGroup, LANES, Lanes};

/// Node pairs that are looked into at a time.
const BLOCK: usize = 64;

/// Node pairs to visit: numbers of the nodes of the first curve and of the second.
#[derive(Debug, Default)]
pub(crate) struct Agenda {
    pairs: Vec<(u32, u32)>,
    /// Runs of node pairs of the same levels.
    runs: Vec<Run>,
    /// Buffers of a descent: what survives, and what meets in space.
    survive: Survivors,
    meet: Survivors,
}

/// Consecutive entries of an agenda, up to the start of the next run.
#[derive(Clone, Copy, Debug)]
struct Run {
    start: usize,
    levels: [u8; 2],
}

impl Agenda {
    /// Whether there is nothing left.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Number of node pairs.
    pub fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Leaves nothing to do.
    pub fn clear(&mut self) {
        self.pairs.clear();
        self.runs.clear();
    }

    /// Adds a node pair.
    #[inline]
    pub fn push(&mut self, first: Node, second: Node) {
        self.run([first.level, second.level])
            .push((first.index, second.index));
    }

    /// Where node pairs of these levels are added.
    #[inline]
    fn run(&mut self, levels: [u8; 2]) -> &mut Vec<(u32, u32)> {
        if self.runs.last().is_none_or(|run| run.levels != levels) {
            self.runs.push(Run {
                start: self.pairs.len(),
                levels,
            });
        }
        &mut self.pairs
    }

    /// Hands every second node pair over: of each run, since those at the bottom have more below them.
    pub fn share(&mut self, other: &mut Agenda) {
        other.clear();
        let mut own = Agenda::default();
        for (k, run) in self.runs.iter().enumerate() {
            let end = self.runs.get(k + 1).map_or(self.len(), |next| next.start);
            for (at, &pair) in self.pairs[run.start..end].iter().enumerate() {
                let to = if at % 2 == 0 { &mut own } else { &mut *other };
                to.run(run.levels).push(pair);
            }
        }
        self.pairs.clear();
        self.pairs.append(&mut own.pairs);
        self.runs.clear();
        self.runs.append(&mut own.runs);
    }
}

/// Segment pairs that a descent found, first curve and second.
#[derive(Debug, Default)]
pub(crate) struct SegmentPairs {
    /// Those that the query asked for.
    pub all: Vec<(u32, u32)>,
    /// Those of them whose boxes overlap in space, where the query asked for them.
    pub meeting: Vec<(u32, u32)>,
}

/// What a descent looks for: segment pairs whose boxes' shadows along the axis `w` overlap, the first not wholly
/// below the second.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Query {
    /// Axis of projection.
    pub w: usize,
    /// Whether pairs that overlap in space are listed, beside the others.
    pub meeting: bool,
}

/// Visits the node pairs of the agenda and everything below them, until none is left, or `steps` node pairs have
/// been looked into, or `limit` segment pairs are found. Where `IN_SPACE`, only what overlaps in space counts.
#[inline(always)]
pub(crate) fn descend<L: Lanes, const IN_SPACE: bool>(
    simd: L,
    [first, second]: [CurveTree<'_>; 2],
    Query { w, meeting }: Query,
    agenda: &mut Agenda,
    found: &mut SegmentPairs,
    (mut steps, limit): (usize, usize),
) {
    let (mut room_t, mut room_u) = (BoxGroup::EMPTY, BoxGroup::EMPTY);
    while steps > 0 && found.all.len() < limit {
        let Some(&Run {
            start,
            levels: [level_t, level_u],
        }) = agenda.runs.last()
        else {
            return;
        };
        let Agenda {
            pairs: nodes,
            runs,
            survive,
            meet,
        } = &mut *agenda;
        // Up to a block off the end.
        let from = start.max(nodes.len().saturating_sub(BLOCK));
        steps = steps.saturating_sub(nodes.len() - from);
        survive.clear();
        meet.clear();
        for &(t, u) in &nodes[from..] {
            let (node_t, node_u) = (Node::new(level_t, t), Node::new(level_u, u));
            if level_t > level_u {
                let below = One::of_box(&second.node_box(node_u), w);
                let above = Eight::load(simd, first.children(node_t, &mut room_t), w);
                let lanes = apart::<L, IN_SPACE, false>(simd, below, above) ^ 0xff;
                survive.add((t, u), ROWS[lanes as usize]);
            } else if level_u > level_t {
                let above = One::of_box(&first.node_box(node_t), w);
                let below = Eight::load(simd, second.children(node_u, &mut room_u), w);
                let lanes = apart::<L, IN_SPACE, true>(simd, above, below) ^ 0xff;
                survive.add((t, u), lanes.into());
            } else {
                let group_t = first.children(node_t, &mut room_t);
                let below = Eight::load(simd, second.children(node_u, &mut room_u), w);
                let mut none = 0;
                for k in 0..LANES {
                    let above = One::of_lane(group_t, k, w);
                    let lanes = apart::<L, IN_SPACE, true>(simd, above, below);
                    none |= u64::from(lanes) << (LANES * k);
                }
                let pairs = !none;
                survive.add((t, u), pairs);
                if meeting && level_t == 0 {
                    let mut above = 0;
                    for k in 0..LANES {
                        let bottom = simd.splat(group_t.lo[w][k]);
                        let lanes = simd.bits(simd.less(below.hi[2], bottom));
                        above |= u64::from(lanes) << (LANES * k);
                    }
                    meet.add((t, u), pairs & !above);
                }
            }
        }
        nodes.truncate(from);
        if from == start {
            runs.pop();
        }
        // Levels that go down, and so how many numbers each has a level below.
        let deeper = [level_t >= level_u, level_u >= level_t];
        let fan = deeper.map(|down| if down { LANES as u32 } else { 1 });
        if level_t == 0 && level_u == 0 {
            survive.spread(fan, &mut found.all);
            meet.spread(fan, &mut found.meeting);
        } else if survive.total > 0 {
            let levels = [level_t - u8::from(deeper[0]), level_u - u8::from(deeper[1])];
            if runs.last().is_none_or(|run| run.levels != levels) {
                runs.push(Run {
                    start: from,
                    levels,
                });
            }
            survive.spread(fan, nodes);
        }
    }
}

/// For eight lanes as bits, the same as the first column of an 8 by 8 matrix of bits.
const ROWS: [u64; 256] = {
    let mut table = [0; 256];
    let mut lanes = 0;
    while lanes < 256 {
        let mut k = 0;
        while k < LANES {
            table[lanes] |= (lanes as u64 >> k & 1) << (LANES * k);
            k += 1;
        }
        lanes += 1;
    }
    table
};

/// Node pairs of a block with something that survives below: the bit `8 k + l` stands for the child `k` of the
/// first node and the child `l` of the second.
#[derive(Debug)]
struct Survivors {
    len: usize,
    nodes: [(u32, u32); BLOCK],
    /// None of those in use is 0. One more than there are nodes, so that the next one can always be read.
    masks: [u64; BLOCK + 1],
    /// Bits in all.
    total: usize,
}

impl Default for Survivors {
    fn default() -> Self {
        Survivors {
            len: 0,
            nodes: [(0, 0); BLOCK],
            masks: [0; BLOCK + 1],
            total: 0,
        }
    }
}

impl Survivors {
    #[inline(always)]
    fn clear(&mut self) {
        (self.len, self.total) = (0, 0);
    }

    /// Adds a node pair, of which there are at most a block.
    #[inline(always)]
    fn add(&mut self, nodes: (u32, u32), mask: u64) {
        let at = self.len % BLOCK;
        self.nodes[at] = nodes;
        self.masks[at] = mask;
        self.len += usize::from(mask != 0);
        self.total += mask.count_ones() as usize;
    }

    /// Writes the child pairs; `fan` is how many children the nodes of each curve have a number for.
    #[inline(always)]
    fn spread(&mut self, fan: [u32; 2], out: &mut Vec<(u32, u32)>) {
        let start = out.len();
        out.resize(start + self.total, (0, 0));
        let mut k = 0;
        let mut mask = self.masks[0];
        for child in &mut out[start..] {
            let bit = mask.trailing_zeros();
            let (t, u) = self.nodes[k % BLOCK];
            *child = (t * fan[0] + bit / 8, u * fan[1] + bit % 8);
            mask &= mask.wrapping_sub(1);
            // On to the next node pair without a branch.
            let last = mask == 0;
            k += usize::from(last);
            mask |= self.masks[k % (BLOCK + 1)] & u64::from(last).wrapping_neg();
        }
    }
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

/// Lanes that have nothing to do with a box, which is of the first curve or of the second.
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
