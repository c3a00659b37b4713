//! Blocks of segments that moved further than their allowances, and the pairs of curves that this
//! may affect.
//!
//! # Proof: neighbours stay apart
//!
//! Seen in the space of the reference frame, a control point is displaced by `d` from its position
//! there. Its displacements at the two ends of a step lie in a box. At any time in between, the
//! displacement is outside this box by at most `bend` times the diagonal ([`Affine::bend`]). The
//! points of the hulls of segments are combinations of control points with weights that add up to
//! 1, so their displacements are such combinations, too. For Catmull-Rom, the magnitudes of the
//! weights add up to at most `4/3`, so the displacements are in the box enlarged about its centre
//! by that factor. For the other bases, no weight is negative, and the displacements are in the box
//! itself.
//!
//! Let `g` be a lower bound of the distance between two convex hulls in the reference frame, and
//! `n` the unit vector between their nearest points. If no difference of a displacement in one box
//! and one in the other is longer than `g`, the hulls stay apart along `n`. The difference is
//! small if both move together, however far.
//!
//! Blocks that are no neighbours are further apart than the range of the list. If no hull point is
//! displaced by more than half of the range, they stay apart. A curve with a block that moved
//! further may have touched any curve.
//!
//! If the difference is too long, the segments are tested one by one.

use super::affine::Affine;
use super::blocks::{CHUNK, Real};
use super::covered::Covered;
use super::ledger::Observer;
use super::reference::{Block, Reference};
use crate::curve::vector::per_axis;
use crate::curve::{Coordinates, CurveSet, larger, smaller};
use crate::discretize::MovingSeparation;
use crate::exact::{Decided, Ties, passages_of_sums};
use crate::pairs::{Pair, overlapping};
use crate::simd::{LANES, Portable, dispatch};
use rayon::prelude::*;
use std::ops::Range;

/// Number of blocks whose displacements a task computes.
const GRAIN: usize = 256;

/// Number of curves beyond the range of the list of neighbours up to which a search of all their
/// pairs costs less than a search of all pairs of the scene.
const FEW_STRAYS: usize = 4;

/// Segments that moved further than their allowances in a step from one frame to another.
pub(super) struct MovedBlocks<'a> {
    reference: &'a Reference,
    ends: [(&'a Affine, &'a CurveSet); 2],
    bend: f64,
    /// Segments that depend on a point that moved further than its allowance, sorted.
    segments: Vec<(u32, u32)>,
    /// Blocks with such a segment, sorted.
    pub marked: Vec<Block>,
}

/// Pairs of curves that may have touched during a step.
pub(super) struct Affected {
    /// The pairs, sorted. `(i, i)` is a curve and itself.
    pub pairs: Vec<Pair>,
    /// Number of pairs of neighbours that are proven apart at all times.
    pub apart: usize,
}

/// Box of the displacements of the hull points of a block during a step.
#[derive(Clone, Copy, Debug)]
struct Displacement {
    lo: [f64; 3],
    hi: [f64; 3],
}

impl Displacement {
    /// Returns an upper bound of the squared lengths.
    fn largest_square(&self) -> f64 {
        square(per_axis(|x| larger(self.hi[x], -self.lo[x])))
    }

    /// Returns an upper bound of the squared lengths of the differences from another displacement.
    #[inline(always)]
    fn largest_difference_square(&self, other: &Displacement) -> f64 {
        square(per_axis(|x| {
            larger(other.hi[x] - self.lo[x], self.hi[x] - other.lo[x])
        }))
    }
}

/// Returns the squared length of a vector, rounded up. Infinite if it overflows.
#[inline(always)]
fn square([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z) * (1.0 + 1e-9)
}

impl<'a> MovedBlocks<'a> {
    /// Marks the blocks that depend on a point in one of the chunks, which contain the points that
    /// moved further than their allowances in either frame.
    pub fn new(
        reference: &'a Reference,
        ends: [(&'a Affine, &'a CurveSet); 2],
        chunks: &[u32],
        bend: f64,
    ) -> MovedBlocks<'a> {
        let mut segments: Vec<(u32, u32)> = Vec::new();
        for &chunk in &*reference.with_images(chunks) {
            let points = chunk as usize * CHUNK..(chunk as usize + 1) * CHUNK;
            let set = &reference.set;
            set.segments_at(points, reference.coverage.open_curves, |i, s| {
                segments.push((i, s))
            });
        }
        segments.sort_unstable();
        segments.dedup();
        let block = |&(i, s): &(u32, u32)| reference.neighbours.blocks.of(i as usize, s);
        let mut marked: Vec<Block> = segments.iter().map(block).collect();
        marked.dedup();
        MovedBlocks {
            reference,
            ends,
            bend,
            segments,
            marked,
        }
    }

    /// Returns the pairs of curves that may have touched during the step. Returns `None` if many
    /// curves moved beyond the range of the list of neighbours.
    pub fn affected(&self) -> Option<Affected> {
        const NONE: u32 = u32::MAX;
        let neighbours = &self.reference.neighbours;
        // Marked blocks come first, then their neighbours.
        let mut blocks = self.marked.clone();
        let mut index = vec![NONE; neighbours.blocks.len()];
        for (k, &a) in self.marked.iter().enumerate() {
            index[a as usize] = k as u32;
        }
        for &a in &self.marked {
            for b in neighbours.lists.of(a) {
                let at = &mut index[b.block as usize];
                if *at == NONE {
                    *at = blocks.len() as u32;
                    blocks.push(b.block);
                }
            }
        }
        let displacements = blocks.par_iter().with_min_len(GRAIN);
        let displacements = displacements.map(|&block| self.displacement(block));
        let displacements: Vec<Displacement> = displacements.collect();
        let slack = self.slack();
        let within = |most: f64, square: f64| most > 0.0 && square < most * most;
        let most = 0.5 * neighbours.range - slack;
        let marked = self.marked.iter().zip(&displacements);
        let stray = marked.filter(|(_, d)| !within(most, d.largest_square()));
        let stray = stray.map(|(&a, _)| neighbours.blocks.curves[a as usize]);
        let mut stray: Vec<u32> = stray.collect();
        stray.dedup();
        if stray.len() > FEW_STRAYS {
            return None;
        }
        let mut affected = Affected {
            pairs: self.folded(),
            apart: 0,
        };
        affected.pairs.extend(self.folded_at_joints());
        let mut near: Vec<[Block; 2]> = Vec::new();
        for (k, &a) in self.marked.iter().enumerate() {
            for b in neighbours.lists.of(a) {
                let l = index[b.block as usize] as usize;
                // A pair of two marked blocks appears twice, because each is a neighbour of the
                // other.
                if l < k {
                    continue;
                }
                let square = displacements[k].largest_difference_square(&displacements[l]);
                if within(f64::from(b.gap) - 2.0 * slack, square) {
                    affected.apart += 1;
                } else {
                    near.push([a, b.block]);
                }
            }
        }
        let met: Vec<Option<Pair>> = near.par_iter().map(|&blocks| self.met(blocks)).collect();
        affected.apart += met.iter().filter(|pair| pair.is_none()).count();
        affected.pairs.extend(met.into_iter().flatten());
        self.add_all_pairs(&stray, &mut affected.pairs);
        affected.pairs.sort_unstable();
        affected.pairs.dedup();
        Some(affected)
    }

    /// Adds the pairs of some curves with all covered curves.
    fn add_all_pairs(&self, curves: &[u32], pairs: &mut Vec<Pair>) {
        let Reference { set, coverage, .. } = self.reference;
        let covered = Covered::new(set, *coverage, None);
        for &i in curves {
            let others = covered.indices().map(|j| j as u32);
            let others = others.filter(|&j| i != j || coverage.self_crossings);
            pairs.extend(others.map(|j| (i.min(j), i.max(j))));
        }
    }

    /// Returns the pair of curves of two blocks if any of their segments may have met during the
    /// step.
    fn met(&self, blocks: [Block; 2]) -> Option<Pair> {
        let [before, after] = self.ends.map(|(_, set)| set);
        let mut places = blocks.map(|block| self.reference.neighbours.blocks.place(block));
        places.sort_unstable();
        let [(i, a), (j, b)] = places;
        let boxes = places.map(|(i, g)| [before, after].map(|set| set.leaf_boxes(i, g)));
        let observer = Observer::of_leaves([before, after], &boxes);
        let [first, second] = boxes.map(|boxes| observer.swept_leaf(&boxes));
        let separation = MovingSeparation::new([before, after], [i, j]);
        let parts = before.parts(i, j);
        let may_meet = |s: u32, t: u32| {
            if i == j && s >= t || parts.is_some_and(|parts| parts.adjacent(s, t)) {
                return false;
            }
            match before.basis().is_polyline() {
                true => edges_may_meet([before, after], [i, j], [s, t]),
                false => !separation.apart(s, t),
            }
        };
        let lanes = 0..LANES as u32;
        let met = lanes.clone().any(|k| {
            let overlapping = overlapping(Portable, &first.lane(k as usize), &second);
            let mut others = lanes.clone().filter(|l| overlapping >> l & 1 != 0);
            let [s, t] = [a, b].map(|g| (g * LANES) as u32);
            others.any(|l| may_meet(s + k, t + l))
        });
        met.then_some((i as u32, j as u32))
    }

    /// Returns a generous bound of the rounding errors of displacements, and of values computed
    /// from them.
    fn slack(&self) -> f64 {
        let size = |(affine, set): (&Affine, &CurveSet)| set.max_abs() + affine.t.amax();
        let size = size(self.ends[0]) + size(self.ends[1]);
        (self.reference.set.max_abs() + 10.0 * size) * 1e-12 + 1e-300
    }

    /// Returns the displacements of the hull points of a block.
    fn displacement(&self, block: Block) -> Displacement {
        let set = &self.reference.set;
        let (i, block) = self.reference.neighbours.blocks.place(block);
        let first = block * LANES;
        let last = (first + LANES).min(set.curve(i).segments as usize);
        let slots = set.slots_of(i, first..last);
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for (affine, end) in self.ends {
            use Coordinates::{F32, F64};
            let bounds = match (end.coordinates(), set.coordinates()) {
                (F32(p), F32(q)) => dispatch!(bounds(affine, p, q, slots.clone())),
                (F64(p), F64(q)) => dispatch!(bounds(affine, p, q, slots.clone())),
                _ => unreachable!("the monitor compares the precision first"),
            };
            for x in 0..3 {
                lo[x] = smaller(lo[x], bounds[x][0]);
                hi[x] = larger(hi[x], bounds[x][1]);
            }
        }
        let diagonal = square(per_axis(|x| hi[x] - lo[x])).sqrt();
        let enlarged = set.basis().overshoot();
        for x in 0..3 {
            // The deviation by the bend comes first, because the control points themselves are
            // displaced by it.
            lo[x] -= self.bend * diagonal;
            hi[x] += self.bend * diagonal;
            let more = enlarged * (hi[x] - lo[x]) * (1.0 + 1e-9);
            lo[x] -= more;
            hi[x] += more;
        }
        Displacement { lo, hi }
    }

    /// Returns the pairs `(i, i)` of the curves that may have folded: that are not proven to be
    /// monotonic at all times along some marked segment together with its neighbours. Segments of a
    /// monotonic part do not pass through themselves or one another. Empty if self-crossings are
    /// not covered. Adjacent edges of a polyline never pass through one another.
    fn folded(&self) -> Vec<Pair> {
        let set = &self.reference.set;
        if !self.reference.coverage.self_crossings || set.basis().is_polyline() {
            return Vec::new();
        }
        let frames = self.ends.map(|(_, set)| set);
        let mut turns = Vec::new();
        let curves = self.segments.chunk_by(|a, b| a.0 == b.0);
        let folded = curves.filter_map(|segments| {
            let i = segments[0].0;
            let curve = set.curve(i as usize);
            let separation = MovingSeparation::new(frames, [i as usize; 2]);
            turns.clear();
            for &(_, s) in segments {
                for s in [curve.before(s), s] {
                    separation.add_turns(s..s + 1, curve.after(s), &mut turns);
                }
            }
            (!turns.is_empty()).then_some((i, i))
        });
        folded.collect()
    }

    /// Same as [`MovedBlocks::folded`], for yarns and the images that continue them.
    fn folded_at_joints(&self) -> impl Iterator<Item = Pair> {
        let Reference { set, coverage, .. } = self.reference;
        let frames = self.ends.map(|(_, set)| set);
        // The images of the reference frame are those of all frames.
        let covered = coverage.open_curves && !set.basis().is_polyline();
        let joints = frames[0].joints().iter().filter(move |_| covered);
        joints.filter_map(move |&(i, j)| {
            let last = set.curve(i as usize).segments - 1;
            let marked = |end: (u32, u32)| self.segments.binary_search(&end).is_ok();
            let turns = || {
                let separation = MovingSeparation::new(frames, [i, j].map(|i| i as usize));
                separation.may_turn(last, 0)
            };
            let folded = (marked((i, last)) || marked((j, 0))) && turns();
            folded.then_some((i.min(j), i.max(j)))
        })
    }
}

/// Returns false if two edges of two curves are proven not to meet during the step.
fn edges_may_meet(frames: [&CurveSet; 2], curves: [usize; 2], segments: [u32; 2]) -> bool {
    let edges = frames.map(|set| set.edges(curves, segments));
    let rounding = frames[0].rounding().max(frames[1].rounding());
    let sums = || frames.map(|set| set.exact_edges(curves, segments));
    let mut met = false;
    let mut meet = |_| met = true;
    let decided = passages_of_sums(edges.each_ref(), rounding, sums, Ties::Report, &mut meet);
    met || decided == Decided::Tie
}

/// Returns the smallest and the largest displacement along each axis of the points in these slots:
/// the differences between their places, mapped back to the reference frame, and their places
/// there.
#[inline(always)]
fn bounds<T: Real>(
    affine: &Affine,
    p: &[Vec<T>; 3],
    q: &[Vec<T>; 3],
    slots: Range<usize>,
) -> [[f64; 2]; 3] {
    let n = slots.len();
    let [p, q] = [p, q].map(|v| v.each_ref().map(|v| &v[slots.clone()][..n]));
    let t = affine.t;
    per_axis(|x| {
        let m = per_axis(|y| affine.inverse[(x, y)]);
        let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
        for k in 0..n {
            let v = per_axis(|y| p[y][k].into() - t[y]);
            let d = m[0] * v[0] + m[1] * v[1] + m[2] * v[2] - q[x][k].into();
            lo = smaller(lo, d);
            hi = larger(hi, d);
        }
        [lo, hi]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Cancel;
    use crate::curve::{Basis, Point, Positions};
    use crate::incremental::Coverage;
    use crate::incremental::ledger::Ledger;
    use crate::incremental::reference::MOST_NEAR;
    use crate::random::Random;
    use std::f64::consts::TAU;
    use std::sync::Arc;

    /// Returns rings of random shapes.
    fn rings(r: &mut Random, basis: Basis) -> (Vec<i32>, Vec<Vec<Point>>) {
        let curves = 2 + r.below(5);
        let rings = (0..curves).map(|_| {
            let n = 3 * (4 + r.below(12));
            let (center, u, v, w) = (r.point(2.0), r.point(1.5), r.point(1.5), r.point(0.3));
            let points = (0..n).map(|k| {
                let t = TAU * k as f64 / n as f64;
                let (c, s, f) = (t.cos(), t.sin(), (3.0 * t).cos());
                per_axis(|x| center[x] + c * u[x] + s * v[x] + f * w[x])
            });
            points.collect()
        });
        let rings: Vec<Vec<Point>> = rings.collect();
        let closed = rings.iter().map(|ring| -(ring.len() as i32));
        // The last curve is open.
        let mut counts: Vec<i32> = closed.collect();
        let mut rings = rings;
        let last = curves - 1;
        if basis == Basis::Bezier {
            rings[last].push([0.0; 3]);
        }
        counts[last] = rings[last].len() as i32;
        (counts, rings)
    }

    /// All pairs that meet in a step are affected, whatever the curves did since the reference
    /// frame, for all bases and coverages.
    #[test]
    fn every_pair_that_meets_is_affected() {
        let (mut met, mut excluded, mut beyond) = (0, 0, 0);
        for seed in 0..4000 {
            let mut r = Random::new(seed);
            let basis = r.pick(&Basis::ALL);
            let coverage = Coverage {
                self_crossings: r.one_in(2),
                open_curves: r.one_in(2),
            };
            let (counts, rings) = rings(&mut r, basis);
            let set = |rings: &[Vec<Point>]| {
                let xyz: Vec<f64> = rings.concat().concat();
                CurveSet::from_counts(basis, &counts, Positions::F64(&xyz)).unwrap()
            };
            let size = r.pick(&[0.001, 0.03, 0.1, 0.3]);
            let moved = |r: &mut Random| {
                let both = rings.iter().map(|ring| {
                    let (way, noise) = (r.point(size), 0.1 * size);
                    let place = |p: &Point| {
                        let jitter = r.point(noise);
                        per_axis(|x| p[x] + way[x] + jitter[x])
                    };
                    ring.iter().map(place).collect()
                });
                set(&both.collect::<Vec<Vec<Point>>>())
            };
            let frames = [moved(&mut r), moved(&mut r)];
            let reference = Reference::build(
                &set(&rings).into(),
                Arc::default(),
                0,
                coverage,
                None,
                MOST_NEAR,
                &Cancel::default(),
            )
            .unwrap();
            let affines = frames
                .each_ref()
                .map(|set| Affine::fit(&reference.sample, set.positions()));
            let [Some(from), Some(to)] = &affines else {
                continue;
            };
            let Some(bend) = Affine::bend([from, to]) else {
                continue;
            };
            let all: Vec<u32> = (0..reference.chunks() as u32).collect();
            let ends = [(from, &frames[0]), (to, &frames[1])];
            let Some(affected) = MovedBlocks::new(&reference, ends, &all, bend).affected() else {
                beyond += 1;
                continue;
            };
            let outcome = Ledger::default().first_step(&frames[0], &frames[1], coverage, None);
            let events = outcome.events.iter().chain(&outcome.unresolved);
            let undecided = outcome.undecided.iter().filter_map(|d| Some((d.i, d.j?)));
            for pair in events.map(|e| (e.i, e.j)).chain(undecided) {
                met += 1;
                assert!(affected.pairs.contains(&pair), "seed {seed}: {pair:?}");
            }
            excluded += usize::from(affected.pairs.is_empty() && affected.apart > 0);
        }
        assert!(
            met > 500 && excluded > 500 && beyond > 50,
            "{met} {excluded} {beyond}"
        );
    }
}
