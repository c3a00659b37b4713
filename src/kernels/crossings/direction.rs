//! The choice of the direction: along which of six does the pair overlap the least?
//!
//! A breadth-first pass over both trees carries, for every node pair, the set of directions in which the nodes
//! overlap in projection and the upper one is not wholly below. A direction without any left proves that the
//! linking number is 0, at once: most pairs of a garment end here.

use super::{Direction, Scene, Scratch};
use crate::curve::{Box3, BoxGroup, Lanes};

/// Node pairs at which the coarse pass has seen enough to choose.
const ENOUGH: usize = 192;

/// A set of directions, a bit each in the order of [`Direction::ALL`].
type Mask = u8;
const ALL: Mask = 0x3f;

/// The direction to count in, with the node pairs to start from on `scratch.stack` (upper curve first), or
/// `None` where the curves are proven to be unlinked.
#[inline(always)]
pub(super) fn choose<L: Lanes>(
    simd: L,
    scene: Scene<'_>,
    i: usize,
    j: usize,
    fixed: Option<Direction>,
    scratch: &mut Scratch,
) -> Option<Direction> {
    let trees = scene.trees;
    let roots = (trees.root(i), trees.root(j));
    scratch.stack.clear();
    if let Some(direction) = fixed {
        scratch.front.clear();
        scratch.front.push((roots.0, roots.1, ALL));
        return Some(start(direction, scratch));
    }
    if roots.0.level <= 1 && roots.1.level <= 1 {
        let direction = guess(&trees.roots()[i], &trees.roots()[j]);
        scratch.front.clear();
        scratch.front.push((roots.0, roots.1, ALL));
        return Some(start(direction, scratch));
    }
    let mut alive = ALL;
    scratch.front.clear();
    scratch.front.push((roots.0, roots.1, ALL));
    loop {
        let (a, b, _) = scratch.front[0];
        if alive.is_power_of_two() || scratch.front.len() > ENOUGH || (a.level == 0 && b.level == 0)
        {
            break;
        }
        let counts = expand(simd, scene, i, j, alive, scratch);
        let fewest = fewest(&counts, alive);
        if fewest == 0 {
            return None;
        }
        alive = (0..6)
            .filter(|&d| alive >> d & 1 != 0 && counts[d] == fewest)
            .fold(0, |m, d| m | 1 << d);
    }
    let mut counts = [0; 6];
    for &(.., mask) in &scratch.front {
        count_bits(mask, &mut counts);
    }
    let fewest = fewest(&counts, alive);
    let best = (0..6).find(|&d| alive >> d & 1 != 0 && counts[d] == fewest)?;
    scratch.front.retain(|&(.., mask)| mask >> best & 1 != 0);
    Some(start(Direction::ALL[best], scratch))
}

/// Puts the node pairs of the front on the stack, upper curve first.
fn start(direction: Direction, scratch: &mut Scratch) -> Direction {
    let pairs = scratch.front.iter();
    scratch.stack.extend(pairs.map(|&(a, b, _)| {
        if direction.second_over {
            (b, a)
        } else {
            (a, b)
        }
    }));
    direction
}

fn fewest(counts: &[u32; 6], alive: Mask) -> u32 {
    let alive = (0..6).filter(|&d| alive >> d & 1 != 0);
    alive.map(|d| counts[d]).min().unwrap_or(0)
}

fn count_bits(mask: Mask, counts: &mut [u32; 6]) {
    for (d, count) in counts.iter_mut().enumerate() {
        *count += u32::from(mask >> d & 1);
    }
}

/// Small loops: the direction by a formula on their boxes, the overlap in projection times the chance that
/// the upper one is not wholly below.
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

/// One breadth-first step in the directions that are alive; returns the surviving node pairs a direction.
#[inline(always)]
fn expand<L: Lanes>(
    simd: L,
    scene: Scene<'_>,
    i: usize,
    j: usize,
    alive: Mask,
    scratch: &mut Scratch,
) -> [u32; 6] {
    let Scene { set, trees } = scene;
    let mut counts = [0; 6];
    let (mut room_a, mut room_b) = (BoxGroup::EMPTY, BoxGroup::EMPTY);
    let Scratch { front, next, .. } = scratch;
    next.clear();
    for &(a, b, mask) in front.iter() {
        let mask = mask & alive;
        if mask == 0 {
            continue;
        }
        if b.level > a.level {
            let own = trees.node_box(i, a);
            let alive = survivors(simd, &own, trees.children(set, j, b, &mut room_b));
            let mut lanes = alive.count(mask, &mut counts);
            while let Some((k, m)) = alive.next(&mut lanes, mask) {
                next.push((a, b.child(k), m));
            }
            continue;
        }
        // Rows: children of `a` against the whole of `b`, with the roles exchanged.
        let group_a = trees.children(set, i, a, &mut room_a);
        let rows = survivors(simd, &trees.node_box(j, b), group_a).swapped();
        if a.level > b.level {
            let mut lanes = rows.count(mask, &mut counts);
            while let Some((k, m)) = rows.next(&mut lanes, mask) {
                next.push((a.child(k), b, m));
            }
            continue;
        }
        let group_b = trees.children(set, j, b, &mut room_b);
        let mut row_lanes = rows.any(mask);
        while let Some((k, m)) = rows.next(&mut row_lanes, mask) {
            let alive = survivors(simd, &group_a.lane(k as usize), group_b);
            let mut lanes = alive.count(m, &mut counts);
            while let Some((l, m)) = alive.next(&mut lanes, m) {
                next.push((a.child(k), b.child(l), m));
            }
        }
    }
    std::mem::swap(front, next);
    counts
}

/// For each direction, the lanes that overlap in projection while the upper one is not wholly below.
///
/// No closures here and in [`expand`]: what is called through one is compiled without the vector instructions.
#[derive(Clone, Copy)]
struct Survivors([u32; 6]);

/// The lanes of `b` that survive against `a`, the first curve.
#[inline(always)]
fn survivors<L: Lanes>(simd: L, a: &Box3, b: &BoxGroup) -> Survivors {
    let (mut below, mut above, mut overlap) = ([0; 3], [0; 3], [0; 3]);
    for x in 0..3 {
        below[x] = simd.greater(&b.lo[x], a.hi[x]);
        above[x] = simd.less(&b.hi[x], a.lo[x]);
        overlap[x] = !(below[x] | above[x]) & 0xff;
    }
    let mut out = [0; 6];
    for w in 0..3 {
        let projected = overlap[(w + 1) % 3] & overlap[(w + 2) % 3];
        out[2 * w] = projected & !below[w];
        out[2 * w + 1] = projected & !above[w];
    }
    Survivors(out)
}

impl Survivors {
    /// The same with the other curve as the first.
    #[inline(always)]
    fn swapped(self) -> Survivors {
        let m = self.0;
        Survivors([m[1], m[0], m[3], m[2], m[5], m[4]])
    }

    /// Lanes that survive in some direction of `mask`.
    #[inline(always)]
    fn any(&self, mask: Mask) -> u32 {
        let mut any = 0;
        for d in 0..6 {
            any |= self.0[d] * u32::from(mask >> d & 1);
        }
        any
    }

    /// [`Survivors::any`], counting the lanes of each direction.
    #[inline(always)]
    fn count(&self, mask: Mask, counts: &mut [u32; 6]) -> u32 {
        for (d, (count, lanes)) in counts.iter_mut().zip(self.0).enumerate() {
            *count += lanes.count_ones() * u32::from(mask >> d & 1);
        }
        self.any(mask)
    }

    /// Takes the next of `lanes`, with the directions of `mask` in which it survives.
    #[inline(always)]
    fn next(&self, lanes: &mut u32, mask: Mask) -> Option<(u32, Mask)> {
        if *lanes == 0 {
            return None;
        }
        let k = lanes.trailing_zeros();
        *lanes &= *lanes - 1;
        let mut directions = 0;
        for d in 0..6 {
            directions |= ((self.0[d] >> k & 1) as Mask) << d;
        }
        Some((k, directions & mask))
    }
}
