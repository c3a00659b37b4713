//! The choice of the direction: along which of six does the pair overlap the least?
//!
//! A breadth-first pass over both trees carries, for every node pair, the set of directions in which the nodes
//! overlap in projection and the upper one is not wholly below. A direction without any left proves that the
//! linking number is 0, at once: most pairs of a garment end here.

use super::Direction;
use crate::curve::{Box3, BoxGroup, LANES, Lanes};
use crate::pairs::{CurveTree, Node};

/// Node pairs at which the pass has seen enough to choose.
const ENOUGH: usize = 192;

/// A set of directions, a bit each in the order of [`Direction::ALL`].
type Directions = u32;
const ALL: Directions = 0x3f;

/// Buffers of the pass.
#[derive(Debug, Default)]
pub(super) struct Fronts {
    now: Front,
    next: Front,
}

/// Node pairs, structure of arrays; all first nodes are of one level, and so are all second ones. The arrays are
/// longer than what is in use, so that eight may be written everywhere.
#[derive(Debug, Default)]
struct Front {
    len: usize,
    first: Vec<u32>,
    second: Vec<u32>,
    /// Directions in which the nodes overlap.
    directions: Vec<Directions>,
}

/// The direction to count in, with the node pairs to start from on `stack` (upper curve first), or `None` where the
/// curves are proven to be unlinked.
#[inline(always)]
pub(super) fn choose<L: Lanes>(
    simd: L,
    [a, b]: [CurveTree<'_>; 2],
    fixed: Option<Direction>,
    fronts: &mut Fronts,
    stack: &mut Vec<(Node, Node)>,
) -> Option<Direction> {
    stack.clear();
    let (root_a, root_b) = (a.root(), b.root());
    let small = root_a.level <= 1 && root_b.level <= 1;
    if fixed.is_some() || small {
        let direction = fixed.unwrap_or_else(|| guess(&a.bounds, &b.bounds));
        stack.push(direction.upper_first(root_a, root_b));
        return Some(direction);
    }
    let Fronts { now, next } = fronts;
    let mut levels = [root_a.level, root_b.level];
    let mut alive = ALL;
    now.reset(ALL);
    loop {
        expand(simd, [a, b], levels, alive, now, next);
        std::mem::swap(now, next);
        let deepest = levels[0].max(levels[1]);
        for level in &mut levels {
            *level -= u8::from(*level == deepest);
        }
        let counts = now.counts();
        let fewest = fewest(&counts, alive);
        if fewest == 0 {
            return None;
        }
        for (d, count) in counts.iter().enumerate() {
            alive &= !(u32::from(*count != fewest) << d);
        }
        if alive.is_power_of_two() || now.len > ENOUGH || levels == [0, 0] {
            break;
        }
    }
    let best = alive.trailing_zeros();
    let direction = Direction::ALL[best as usize];
    for k in 0..now.len {
        if now.directions[k] >> best & 1 != 0 {
            let node = |level: u8, index: u32| Node { level, index };
            let first = node(levels[0], now.first[k]);
            stack.push(direction.upper_first(first, node(levels[1], now.second[k])));
        }
    }
    Some(direction)
}

fn fewest(counts: &[u32; 6], alive: Directions) -> u32 {
    let alive = (0..6).filter(|&d| alive >> d & 1 != 0);
    alive.map(|d| counts[d]).min().unwrap_or(0)
}

impl Front {
    /// The two roots alone.
    fn reset(&mut self, directions: Directions) {
        self.make_room();
        self.len = 1;
        (self.first[0], self.second[0], self.directions[0]) = (0, 0, directions);
    }

    /// Room for the children of one more node pair.
    #[inline(always)]
    fn make_room(&mut self) {
        let needed = self.len + LANES * LANES + LANES;
        if self.first.len() < needed {
            for v in [&mut self.first, &mut self.second, &mut self.directions] {
                v.resize(2 * needed, 0);
            }
        }
    }

    /// Adds those of eight node pairs that survive in some direction.
    #[inline(always)]
    fn push<L: Lanes>(&mut self, simd: L, first: L::Words, second: L::Words, directions: L::Words) {
        let survive = simd.nonzero(directions);
        let at = self.len..self.len + LANES;
        for (to, words) in [
            (&mut self.first, first),
            (&mut self.second, second),
            (&mut self.directions, directions),
        ] {
            if let Ok(to) = (&mut to[at.clone()]).try_into() {
                simd.store_packed(words, survive, to);
            }
        }
        self.len += survive.count_ones() as usize;
    }

    /// Node pairs of each direction.
    fn counts(&self) -> [u32; 6] {
        let mut counts = [0; 6];
        // A byte a direction, summed up before any can overflow.
        for part in self.directions[..self.len].chunks(255) {
            let sum: u64 = part.iter().map(|&d| SPREAD[(d & ALL) as usize]).sum();
            for (d, count) in counts.iter_mut().enumerate() {
                *count += (sum >> (8 * d)) as u32 & 0xff;
            }
        }
        counts
    }
}

/// For every set of directions, a byte each that is 1 where the set has it.
const SPREAD: [u64; 64] = {
    let mut table = [0; 64];
    let mut set = 0;
    while set < 64 {
        let mut d = 0;
        while d < 6 {
            table[set] |= (set as u64 >> d & 1) << (8 * d);
            d += 1;
        }
        set += 1;
    }
    table
};

/// Small loops: the direction by a formula on their boxes, the overlap in projection times the chance that
/// the upper one is not wholly below.
#[inline(always)]
fn guess(a: &Box3, b: &Box3) -> Direction {
    let mut overlap = [0.0; 3];
    let mut height = [0.0; 3];
    for x in 0..3 {
        let (a_size, b_size) = (a.hi[x] - a.lo[x], b.hi[x] - b.lo[x]);
        let common = a.hi[x].min(b.hi[x]) - a.lo[x].max(b.lo[x]);
        overlap[x] = common / a_size.max(b_size).max(f32::MIN_POSITIVE);
        // From -1, the first one wholly below, to 1, wholly above.
        let between = (a.lo[x] + a.hi[x]) - (b.lo[x] + b.hi[x]);
        height[x] = (between / (a_size + b_size).max(f32::MIN_POSITIVE)).clamp(-1.0, 1.0);
    }
    let cost = |w: usize| overlap[(w + 1) % 3] * overlap[(w + 2) % 3] * (1.0 - height[w].abs());
    let axis = (1..3).fold(0, |best, w| if cost(w) < cost(best) { w } else { best });
    Direction {
        axis,
        // The curve that lies lower is seldom on top, so it is the one to count.
        second_over: height[axis] > 0.0,
    }
}

/// One breadth-first step in the directions that are alive: the deeper of both trees, or both where they are
/// equally deep, go down one level.
#[inline(always)]
fn expand<L: Lanes>(
    simd: L,
    [a, b]: [CurveTree<'_>; 2],
    levels: [u8; 2],
    alive: Directions,
    now: &Front,
    next: &mut Front,
) {
    let (mut room_a, mut room_b) = (BoxGroup::EMPTY, BoxGroup::EMPTY);
    next.len = 0;
    for k in 0..now.len {
        let directions = now.directions[k] & alive;
        if directions == 0 {
            continue;
        }
        next.make_room();
        let [first, second] = [(levels[0], now.first[k]), (levels[1], now.second[k])]
            .map(|(level, index)| Node { level, index });
        if levels[1] > levels[0] {
            let group = b.children(second, &mut room_b);
            let words = survivors::<L, false>(simd, &a.node_box(first), group, directions);
            let children = simd.count_from(second.lane(0));
            next.push(simd, simd.splat_word(first.index), children, words);
            continue;
        }
        let group_a = a.children(first, &mut room_a);
        let words = survivors::<L, true>(simd, &b.node_box(second), group_a, directions);
        if levels[0] > levels[1] {
            let children = simd.count_from(first.lane(0));
            next.push(simd, children, simd.splat_word(second.index), words);
            continue;
        }
        // Only children of the first that overlap the whole of the second.
        let mut rows = simd.nonzero(words);
        let mut row_directions = [0; LANES];
        simd.store(words, &mut row_directions);
        let group_b = b.children(second, &mut room_b);
        let children = simd.count_from(second.lane(0));
        while rows != 0 {
            let k = rows.trailing_zeros();
            rows &= rows - 1;
            let own = group_a.lane(k as usize);
            let words = survivors::<L, false>(simd, &own, group_b, row_directions[k as usize]);
            next.push(simd, simd.splat_word(first.lane(k)), children, words);
        }
    }
}

/// For each lane of `group`, those of `directions` in which it overlaps the box `one` in projection while the upper
/// curve is not wholly below. `one` is of the first curve, or of the second where `SWAPPED`.
#[inline(always)]
fn survivors<L: Lanes, const SWAPPED: bool>(
    simd: L,
    one: &Box3,
    group: &BoxGroup,
    directions: Directions,
) -> L::Words {
    let directions = simd.splat_word(directions);
    let x = sides(simd, one, group, 0);
    let y = sides(simd, one, group, 1);
    let z = sides(simd, one, group, 2);
    let along_x = seen::<L, SWAPPED>(simd, [y, z, x], directions, 0);
    let along_y = seen::<L, SWAPPED>(simd, [z, x, y], directions, 1);
    let along_z = seen::<L, SWAPPED>(simd, [x, y, z], directions, 2);
    simd.or_words(simd.or_words(along_x, along_y), along_z)
}

/// Lanes that a box is wholly below, and lanes that it is wholly above, along an axis.
#[inline(always)]
fn sides<L: Lanes>(simd: L, one: &Box3, group: &BoxGroup, x: usize) -> [L::Mask; 2] {
    [
        simd.less(simd.splat(one.hi[x]), simd.load(&group.lo[x])),
        simd.less(simd.load(&group.hi[x]), simd.splat(one.lo[x])),
    ]
}

/// [`survivors`] in the two directions of the axis `w`.
#[inline(always)]
fn seen<L: Lanes, const SWAPPED: bool>(
    simd: L,
    [u, v, w]: [[L::Mask; 2]; 3],
    directions: L::Words,
    axis: u32,
) -> L::Words {
    let apart = simd.or(simd.or(u[0], u[1]), simd.or(v[0], v[1]));
    // The first curve on top: lost where it is wholly below.
    let below = simd.or(apart, if SWAPPED { w[1] } else { w[0] });
    let above = simd.or(apart, if SWAPPED { w[0] } else { w[1] });
    let first_over = simd.and_words(directions, simd.splat_word(1 << (2 * axis)));
    let second_over = simd.and_words(directions, simd.splat_word(2 << (2 * axis)));
    simd.or_words(
        simd.outside(below, first_over),
        simd.outside(above, second_over),
    )
}
