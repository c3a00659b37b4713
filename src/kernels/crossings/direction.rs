//! Choice of the direction: of six directions, the one in which the curves of a pair overlap the
//! least.
//!
//! A breadth-first pass over both trees carries, for every node pair, the set of directions in
//! which the nodes overlap in projection and the upper one is not wholly below. If no node pair
//! remains in a direction, the linking number is 0. Most pairs of a garment are decided here.

use super::Direction;
use crate::curve::{Box3, BoxGroup};
use crate::pairs::{Agenda, BoxTree, CurveTree, Node};
use crate::simd::{LANES, Lanes};

/// The breadth-first pass stops and chooses a direction once it has this many node pairs.
const ENOUGH: usize = 192;

/// Returns true if the direction of a pair is chosen by a formula on the bounding boxes, because
/// both curves are small.
#[inline(always)]
pub(crate) fn by_formula([a, b]: [CurveTree<'_>; 2]) -> bool {
    a.is_small() && b.is_small()
}

/// A set of directions as a bit mask, in the order of [`Direction::ALL`].
type Directions = u32;
const ALL: Directions = 0x3f;

/// Buffers of the breadth-first pass.
#[derive(Debug, Default)]
pub(super) struct Fronts {
    now: Front,
    next: Front,
    /// Number of node pairs visited since the last reset to 0.
    pub visited: u64,
}

/// Node pairs as a structure of arrays. All first nodes are of one level, and so are all second
/// nodes. The arrays are longer than the used part, so that eight lanes may be written at any
/// position.
#[derive(Debug, Default)]
struct Front {
    len: usize,
    first: Vec<u32>,
    second: Vec<u32>,
    /// Directions in which the nodes overlap.
    directions: Vec<Directions>,
}

/// Chooses the direction to count in and writes the node pairs to start from to the agenda (upper
/// curve first). Returns `None` if the curves are proven to be unlinked.
#[inline(always)]
pub(super) fn choose<L: Lanes>(
    simd: L,
    [a, b]: [CurveTree<'_>; 2],
    fixed: Option<Direction>,
    fronts: &mut Fronts,
    agenda: &mut Agenda,
) -> Option<Direction> {
    agenda.clear();
    let (root_a, root_b) = (a.root(), b.root());
    if fixed.is_some() || by_formula([a, b]) {
        let direction = fixed.unwrap_or_else(|| guess(&a.bounds, &b.bounds));
        agenda.push(direction.upper_first(root_a, root_b));
        return Some(direction);
    }
    let Fronts { now, next, visited } = fronts;
    let mut levels = [root_a.level, root_b.level];
    let mut alive = ALL;
    now.reset();
    while !alive.is_power_of_two() && now.len <= ENOUGH && levels != [0, 0] {
        next.reserve(now.len);
        *visited += now.len as u64;
        if levels[0] >= levels[1] {
            expand::<L, false>(simd, [a, b], levels, now, next);
            levels[0] -= 1;
        } else {
            expand::<L, true>(simd, [a, b], levels, now, next);
            levels[1] -= 1;
        }
        std::mem::swap(now, next);
        let counts = now.counts();
        let mut fewest = u32::MAX;
        for (d, &count) in counts.iter().enumerate() {
            let dead = (alive >> d & 1).wrapping_sub(1);
            fewest = fewest.min(count | dead);
        }
        if fewest == 0 {
            return None;
        }
        let mut fewer = alive;
        for (d, &count) in counts.iter().enumerate() {
            fewer &= !(u32::from(count != fewest) << d);
        }
        // Unless a direction was dropped, every node pair still overlaps in one.
        if fewer != alive {
            alive = fewer;
            now.keep(alive);
        }
    }
    let best = alive.trailing_zeros();
    if !alive.is_power_of_two() {
        now.keep(1 << best);
    }
    let direction = Direction::ALL[best as usize];
    let pairs = now.first[..now.len].iter().zip(&now.second);
    agenda.extend(pairs.map(|(&first, &second)| {
        let (first, second) = (Node::new(levels[0], first), Node::new(levels[1], second));
        direction.upper_first(first, second)
    }));
    Some(direction)
}

impl Front {
    /// Resets to the pair of both roots.
    fn reset(&mut self) {
        self.reserve(1);
        self.len = 1;
        (self.first[0], self.second[0], self.directions[0]) = (0, 0, ALL);
    }

    /// Clears the front and reserves space for the children of `parents` node pairs.
    fn reserve(&mut self, parents: usize) {
        let needed = LANES * (parents + 1);
        if self.first.len() < needed {
            for v in [&mut self.first, &mut self.second, &mut self.directions] {
                v.resize(2 * needed, 0);
            }
        }
        self.len = 0;
    }

    /// Keeps only the directions in `alive`, and the node pairs that overlap in one of them.
    fn keep(&mut self, alive: Directions) {
        let (first, second) = (&mut self.first[..self.len], &mut self.second[..self.len]);
        let directions = &mut self.directions[..self.len];
        let mut len = 0;
        for k in 0..first.len() {
            (first[len], second[len]) = (first[k], second[k]);
            directions[len] = directions[k] & alive;
            len += usize::from(directions[len] != 0);
        }
        self.len = len;
    }

    /// Returns the number of node pairs for each direction.
    fn counts(&self) -> [u32; 6] {
        let mut counts = [0; 6];
        // One byte per direction, summed before any byte can overflow.
        for part in self.directions[..self.len].chunks(255) {
            let mut sum = 0;
            for &set in part {
                sum += spread(set);
            }
            for (d, count) in counts.iter_mut().enumerate() {
                *count += (sum >> (8 * d)) as u32 & 0xff;
            }
        }
        counts
    }
}

/// Spreads a set of directions to six bytes, each of which is 1 if the set contains the direction.
/// The bit `d` moves to `8 d`; the product keeps the other terms apart.
#[inline(always)]
fn spread(set: Directions) -> u64 {
    const COPIES: u64 = 1 | 1 << 7 | 1 << 14 | 1 << 21 | 1 << 28 | 1 << 35;
    (u64::from(set) * COPIES) & 0x0101_0101_0101
}

/// Chooses the direction of small curves by a formula on their boxes: the overlap in projection
/// times the probability that the upper curve is not wholly below.
#[inline(always)]
fn guess(a: &Box3, b: &Box3) -> Direction {
    let mut overlap = [0.0; 3];
    let mut height = [0.0; 3];
    for x in 0..3 {
        let (a_size, b_size) = (a.hi[x] - a.lo[x], b.hi[x] - b.lo[x]);
        let common = a.hi[x].min(b.hi[x]) - a.lo[x].max(b.lo[x]);
        overlap[x] = common / a_size.max(b_size).max(f32::MIN_POSITIVE);
        // From -1 (the first box is wholly below) to 1 (wholly above).
        let between = (a.lo[x] + a.hi[x]) - (b.lo[x] + b.hi[x]);
        height[x] = (between / (a_size + b_size).max(f32::MIN_POSITIVE)).clamp(-1.0, 1.0);
    }
    let cost = |w: usize| overlap[(w + 1) % 3] * overlap[(w + 2) % 3] * (1.0 - height[w].abs());
    let axis = (1..3).fold(0, |best, w| if cost(w) < cost(best) { w } else { best });
    Direction {
        axis,
        // The lower curve is rarely above the other one, so its crossings are counted.
        second_over: height[axis] > 0.0,
    }
}

/// One breadth-first step: the nodes of one curve (the second one if `SECOND`) are replaced by
/// their children.
#[inline(always)]
fn expand<L: Lanes, const SECOND: bool>(
    simd: L,
    [a, b]: [CurveTree<'_>; 2],
    levels: [u8; 2],
    now: &Front,
    next: &mut Front,
) {
    let mut room = BoxGroup::EMPTY;
    let mut len = 0;
    let (first, second) = (&mut next.first[..], &mut next.second[..]);
    let (overlap, n) = (&mut next.directions[..], now.len);
    for ((&i, &j), &directions) in now.first[..n].iter().zip(&now.second).zip(&now.directions) {
        let nodes = [Node::new(levels[0], i), Node::new(levels[1], j)];
        let words = if SECOND {
            let group = b.children(nodes[1], &mut room);
            survivors::<L, false>(simd, &a.node_box(nodes[0]), group, directions)
        } else {
            let group = a.children(nodes[0], &mut room);
            survivors::<L, true>(simd, &b.node_box(nodes[1]), group, directions)
        };
        let children = simd.count_from(nodes[usize::from(SECOND)].lane(0));
        let (first, second, overlap) = (
            first[len..].first_chunk_mut(),
            second[len..].first_chunk_mut(),
            overlap[len..].first_chunk_mut(),
        );
        let (Some(first), Some(second), Some(overlap)) = (first, second, overlap) else {
            unreachable!("the next front has space for the children of this one");
        };
        // The survivors are stored contiguously.
        let survive = simd.nonzero(words);
        let order = simd.packed(survive);
        let (moved, kept) = if SECOND {
            (second, first)
        } else {
            (first, second)
        };
        simd.store(simd.permute(children, order), moved);
        simd.store(simd.splat_word(if SECOND { i } else { j }), kept);
        simd.store(simd.permute(words, order), overlap);
        len += survive.count_ones() as usize;
    }
    next.len = len;
}

/// Returns for each lane of `group` the subset of `directions` in which it overlaps the box `one`
/// in projection while the upper curve is not wholly below. `one` belongs to the first curve, or to
/// the second one if `SWAPPED`.
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

/// Returns the lanes that a box is wholly below and the lanes that it is wholly above, along an
/// axis.
#[inline(always)]
fn sides<L: Lanes>(simd: L, one: &Box3, group: &BoxGroup, x: usize) -> [L::Mask; 2] {
    [
        simd.less(simd.splat(one.hi[x]), simd.load(&group.lo[x])),
        simd.less(simd.load(&group.hi[x]), simd.splat(one.lo[x])),
    ]
}

/// Returns the [`survivors`] in the two directions of the axis `w`.
#[inline(always)]
fn seen<L: Lanes, const SWAPPED: bool>(
    simd: L,
    [u, v, w]: [[L::Mask; 2]; 3],
    directions: L::Words,
    axis: u32,
) -> L::Words {
    let apart = simd.or(simd.or(u[0], u[1]), simd.or(v[0], v[1]));
    // With the first curve as the upper one, a node pair is discarded if it is wholly below.
    let below = simd.or(apart, if SWAPPED { w[1] } else { w[0] });
    let above = simd.or(apart, if SWAPPED { w[0] } else { w[1] });
    let first_over = simd.and_words(directions, simd.splat_word(1 << (2 * axis)));
    let second_over = simd.and_words(directions, simd.splat_word(2 << (2 * axis)));
    simd.or_words(
        simd.outside(below, first_over),
        simd.outside(above, second_over),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_of_directions_are_spread_and_counted() {
        let directions: Vec<u32> = (0..640).map(|k| k % 64).collect();
        for set in &directions {
            let bytes = spread(*set).to_le_bytes();
            for (d, byte) in bytes.into_iter().enumerate() {
                assert_eq!(u32::from(byte), if d < 6 { set >> d & 1 } else { 0 });
            }
        }
        let front = Front {
            len: 640,
            directions,
            ..Front::default()
        };
        assert_eq!(front.counts(), [320; 6]);
    }
}
