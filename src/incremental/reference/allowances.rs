//! Allowances: the distance that each control point may move before two curves may touch.
//!
//! # Proof: no curves touch while all points stay within their allowances
//!
//! If the hulls of two segments of different curves have a gap `g` along some unit vector, the
//! segments stay apart while every point of the hulls moves less than `g / 2`. Control points move
//! the hulls. The hull points of a Bezier segment and of a B-spline are convex combinations of
//! control points, so they move no further than these. Those of Catmull-Rom differ from a control
//! point by a sixth of the difference of two others, so they move at most `1 + 1/6 + 1/6 = 4/3`
//! times as far.
//!
//! The allowance of a control point is the minimum of these distances over all segments that depend
//! on it and all near segments of other closed curves. If hulls are much nearer than the curves in
//! them, the hulls of their halves are used. If no point moved further than its allowance, no two
//! curves touched on the straight path from the reference frame, so no linking number changed.
//!
//! # A curve and itself
//!
//! A reference frame may cover more: open curves in the same way, and a curve with itself. Segments
//! of one curve that are not adjacent stay apart like those of two curves. Adjacent edges lie in
//! one plane at all times. An adjacent pair of spline segments meets only at its joint while the
//! differences of consecutive Bezier control points have a positive component along one axis,
//! because the derivative of the curve is a convex combination of them. If control points move by
//! at most 1, such a difference moves by the sum `w` of the magnitudes of its coefficients. With a
//! component `c` along a unit vector, it stays positive while the points move less than `c / w`.
//! The condition is the same for a yarn and the image that continues it ([`CurveSet::joints`]).
//!
//! # Cost
//!
//! A descent of all pairs of curves within the reach of one another, and a test of hulls for each
//! pair of segments within it. Only pairs that may lower an allowance are examined more closely.

use super::gap::{DEPTH, GOOD, gap, least_component, typical_clearance};
use super::neighbours::{NearBlocks, Neighbours, near_leaves};
use crate::cancel::Cancel;
use crate::certificate::Certificate;
use crate::curve::vector::{distance, per_axis};
use crate::curve::{Basis, Box3, CurveSet, Point, pow2};
use crate::discretize::Hull;
use crate::incremental::covered::Covered;
use crate::pairs::{Agenda, Blocks, LinkSearch, Query, SegmentPairs, Trees, descend};
use crate::simd::{Lanes, dispatch};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

/// Share of a gap between two segments that allowances may use. The remainder is a margin for
/// rounding and for the discretization of splines.
const SHARE: f64 = 0.49;

/// Range of the list of neighbours, as a multiple of the distance within which pairs limit
/// allowances. The list is of no use for a block that moved by more than half of the range.
const RANGE: f64 = 2.0;

/// Number of segment pairs that are gathered before they are processed.
const BATCH: usize = 1024;

/// Maximum number of near pairs of blocks, of which each needs up to 40 bytes. Yarn has about ten
/// per block; the strands of a wound ball, which are all near one another, have thousands.
pub(in crate::incremental) const MOST_NEAR: usize = 1 << 24;

/// Number of new entries after which a list of near blocks is compacted.
const COMPACT: usize = 1 << 20;

/// Buffers of a task.
#[derive(Default)]
struct Buffers {
    agenda: Agenda,
    near: SegmentPairs,
    /// Blocks with near segments, of the current pair of curves.
    blocks: Vec<NearBlocks>,
    /// Number of entries at the start of the list that are distinct and already counted.
    counted: usize,
}

/// Allowances under construction.
pub(super) struct Allowances<'a> {
    covered: Covered<'a>,
    trees: &'a Trees,
    reach: f64,
    /// Bit patterns of the allowances. None is negative, so the patterns have the same order.
    slots: Vec<AtomicU32>,
    blocks: Blocks,
    /// Maximum number of near pairs of blocks.
    most: usize,
    /// Number of near pairs of blocks found so far.
    found: AtomicUsize,
    cancel: &'a Cancel,
}

impl<'a> Allowances<'a> {
    pub fn new(covered: Covered<'a>, trees: &'a Trees, most: usize, cancel: &'a Cancel) -> Self {
        let unbounded = |_| AtomicU32::new(f32::INFINITY.to_bits());
        Allowances {
            covered,
            trees,
            reach: typical_clearance(covered, trees) * SHARE * GOOD,
            slots: (0..covered.set.slots()).map(unbounded).collect(),
            blocks: Blocks::new(covered.set),
            most,
            found: AtomicUsize::new(0),
            cancel,
        }
    }

    fn lower(&self, slots: impl Iterator<Item = usize>, to: f64) {
        // Infinity means unbounded, so bounds are finite.
        let to = to.clamp(0.0, f32::MAX.into()) as f32 * (1.0 - 1e-6);
        for slot in slots {
            if self.slots[slot].load(Ordering::Relaxed) > to.to_bits() {
                self.slots[slot].fetch_min(to.to_bits(), Ordering::Relaxed);
            }
        }
    }

    /// Returns a bound of the rounding errors of gaps, for the hulls of the reference frame and of
    /// a later frame. Points of hulls after [`DEPTH`] halvings have an error of at most
    /// `15 * 5/3 M u` ([`Hull::halves`]), which the pad covers as for sub-segments.
    fn slack(&self) -> f64 {
        let set = self.covered.set;
        4.0 * (set.pad() + set.max_abs() * pow2(-47)) + 1e-300
    }

    /// Returns the distance that control points may move if hulls may move by 1.
    fn stiffness(&self) -> f64 {
        match self.covered.set.basis() {
            Basis::CatmullRom => 0.75,
            _ => 1.0,
        }
    }

    /// Returns the allowances of all control points, in order, and the list of neighbours. `None`
    /// if there are too many neighbours, or if the build was cancelled.
    pub fn fill(self, certificate: &Certificate) -> Option<(Vec<f32>, Neighbours)> {
        let curves: Vec<usize> = self.covered.indices().collect();
        let set = self.covered.set;
        let splines = !set.basis().is_polyline();
        curves.par_iter().for_each(|&i| {
            self.bound(i, certificate);
            if self.covered.coverage.self_crossings && splines {
                self.bound_turns(i);
            }
        });
        if self.covered.coverage.open_curves && splines {
            set.joints().par_iter().for_each(|&(i, j)| {
                let [i, j] = [i, j].map(|i| i as usize);
                self.bound_turn([(i, set.curve(i).segments - 1), (j, 0)]);
            });
        }
        // Rounding of single-precision boxes.
        let rounding = set.max_abs() * pow2(-22);
        // Pairs that are further apart need no test: they cannot limit an allowance to less than
        // the reach.
        let at_most = |x: f64| (x + 2.0 * rounding).min(f32::MAX.into()) as f32;
        let within = at_most(self.reach / SHARE);
        let range = at_most(RANGE * self.reach / SHARE);
        let dilation = 0.5 * range + rounding as f32;
        let dilated = self.trees.roots().iter().map(|b| b.dilated(dilation));
        let dilated: Vec<Box3> = dilated.collect();
        let mut search = LinkSearch::new(self.covered.filter.cloned());
        let pairs = search.find(&dilated);
        pairs.extend(self.covered.self_pairs());
        let size = pairs.len().div_ceil(8 * rayon::current_num_threads());
        let near = pairs.par_chunks(size.max(1)).map(|pairs| {
            let (mut buffers, mut near) = (Buffers::default(), Vec::new());
            for &(i, j) in pairs {
                let (curves, own) = ([i as usize, j as usize], &mut buffers);
                dispatch!(simd => Self::keep_apart(&self, simd, curves, within, own));
                self.add_leaves(curves, range, &mut buffers);
                self.compact(&mut buffers);
                if self.is_over() {
                    return Vec::new();
                }
                near.append(&mut buffers.blocks);
                buffers.counted = 0;
            }
            near
        });
        let near: Vec<Vec<NearBlocks>> = near.collect();
        if self.is_over() {
            return None;
        }
        let neighbours = Neighbours::new(self.blocks, &near.concat(), RANGE * self.reach / SHARE);
        let slots = (0..set.len()).flat_map(|i| set.body(i));
        let allowances = slots.map(|slot| f32::from_bits(self.slots[slot].load(Ordering::Relaxed)));
        let allowances = allowances.collect();
        Some((allowances, neighbours))
    }

    /// Returns true if there are too many near pairs of blocks, or if the build was cancelled.
    fn is_over(&self) -> bool {
        self.found.load(Ordering::Relaxed) > self.most || self.cancel.is_set()
    }

    /// Keeps each pair of blocks once, with its smallest gap, and counts the pairs that are new.
    fn compact(&self, buffers: &mut Buffers) {
        let (blocks, counted) = (&mut buffers.blocks, &mut buffers.counted);
        blocks.sort_unstable_by(|a, b| a.blocks.cmp(&b.blocks).then(a.gap.total_cmp(&b.gap)));
        blocks.dedup_by_key(|near| near.blocks);
        let new = blocks.len() - *counted;
        *counted = blocks.len();
        self.found.fetch_add(new, Ordering::Relaxed);
    }

    /// Calls [`Allowances::compact`] if the list is more than twice as long as after the last call.
    fn compact_if_large(&self, buffers: &mut Buffers) {
        if buffers.blocks.len() > 2 * buffers.counted + COMPACT.min(self.most) {
            self.compact(buffers);
        }
    }

    /// Applies the bounds that all points of a curve have.
    fn bound(&self, i: usize, certificate: &Certificate) {
        let mut undefined = certificate.undefined.iter();
        let mut most = self.stiffness() * self.reach;
        if undefined.any(|d| d.j.is_none() && d.i as usize == i) {
            most = 0.0;
        } else if self.covered.set.curve(i).closed {
            // A loop must keep three distinct points.
            most = most.min(SHARE * spread_of_three(self.covered.set, i, most / SHARE));
        }
        self.lower(self.covered.set.body(i), most);
    }

    /// Applies the bounds that keep segments of two curves apart, or of a curve and itself.
    #[inline(always)]
    fn keep_apart<L: Lanes>(&self, simd: L, curves: [usize; 2], reach: f32, buffers: &mut Buffers) {
        let trees = curves.map(|i| self.trees.of(self.covered.set, i));
        buffers.agenda.push((trees[0].root(), trees[1].root()));
        let query = Query::in_space(reach);
        while !buffers.agenda.is_empty() {
            let (agenda, near) = (&mut buffers.agenda, &mut buffers.near);
            descend::<L, _, true>(simd, trees, query, agenda, near, (usize::MAX, BATCH));
            self.keep_all_apart(curves, &near.all, &mut buffers.blocks);
            buffers.near.all.clear();
            self.compact_if_large(buffers);
            if self.is_over() {
                return;
            }
        }
    }

    /// Adds all pairs of blocks within the range. Segments of two blocks that are not added are
    /// further apart than any pair that limits an allowance.
    fn add_leaves(&self, curves: [usize; 2], range: f32, buffers: &mut Buffers) {
        let trees = curves.map(|i| self.trees.of(self.covered.set, i));
        let [i, j] = curves.map(|i| self.blocks.first[i]);
        let least = ((self.reach / SHARE).min(f32::MAX.into()) as f32) * (1.0 - 1e-6);
        near_leaves(trees, range, |a, b, gap| {
            if i != j || a <= b {
                buffers.blocks.push(NearBlocks {
                    blocks: [i + a, j + b],
                    gap: gap.max(least),
                });
                self.compact_if_large(buffers);
            }
            !self.is_over()
        });
    }

    /// Applies the bounds of near segments. Fast if pairs with the same first segment are
    /// consecutive.
    #[inline(always)]
    fn keep_all_apart(
        &self,
        [i, j]: [usize; 2],
        pairs: &[(u32, u32)],
        blocks: &mut Vec<NearBlocks>,
    ) {
        let (set, slack, share) = (self.covered.set, self.slack(), self.stiffness() * SHARE);
        let allowance = |slot: usize| self.slots[slot].load(Ordering::Relaxed);
        let parts = set.parts(i, j);
        for pairs in pairs.chunk_by(|a, b| a.0 == b.0) {
            let s = pairs[0].0;
            let a = Hull::new(set.hull(i, s as usize));
            for &(_, t) in pairs {
                if i == j && s >= t || parts.is_some_and(|parts| parts.adjacent(s, t)) {
                    continue;
                }
                let support = || set.support(i, s).chain(set.support(j, t));
                // With a gap above this, all affected allowances are lower already, by more than
                // rounding errors.
                let most = f32::from_bits(support().map(allowance).max().unwrap_or(0));
                let enough = f64::from(most) * (1.0 + 1e-5) / share + slack;
                let b = Hull::new(set.hull(j, t as usize));
                let gap = gap(&a, &b, enough, DEPTH);
                blocks.push(NearBlocks {
                    blocks: [self.blocks.of(i, s), self.blocks.of(j, t)],
                    gap: (gap - slack).clamp(0.0, f32::MAX.into()) as f32 * (1.0 - 1e-6),
                });
                // A larger gap may depend on the order of tests, so it must not be used.
                if gap < enough {
                    self.lower(support(), share * (gap - slack));
                }
            }
        }
    }

    /// Applies the bounds that keep a curve monotonic along each segment together with the next
    /// one.
    fn bound_turns(&self, i: usize) {
        let curve = self.covered.set.curve(i);
        (0..curve.segments).for_each(|s| self.bound_turn([(i, s), (i, curve.after(s))]));
    }

    /// Applies the bounds that keep a curve monotonic along two consecutive segments, each given by
    /// its curve and its number.
    fn bound_turn(&self, ends: [(usize, u32); 2]) {
        let set = self.covered.set;
        let weights = weights(set.basis());
        let steps = |(i, s): (usize, u32)| -> [Point; 3] {
            let b = set.segment(i, s as usize);
            per_axis(|k| per_axis(|x| (b[k + 1][x] - b[k][x]) / weights[k]))
        };
        let both = ends.map(steps);
        // No weight is less than a third.
        let most = 2.0 * SHARE * (least_component(both.as_flattened()) - 3.0 * self.slack());
        let support = ends.into_iter().flat_map(|(i, s)| set.support(i, s));
        self.lower(support, most);
    }
}

/// Returns upper bounds of the motion of the differences of consecutive Bezier control points if
/// control points move by at most 1: the sums of the magnitudes of their coefficients (see
/// [`Basis::hull`]).
fn weights(basis: Basis) -> [f64; 3] {
    match basis {
        // (q2 - q0) / 6, 5/6 (q2 - q1) - (q3 - q0) / 6, (q3 - q1) / 6.
        Basis::CatmullRom => [1.0 / 3.0, 2.0, 1.0 / 3.0],
        // (q2 - q0) / 6, (q2 - q1) / 3, (q3 - q1) / 6.
        Basis::BSpline => [1.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0],
        Basis::Bezier | Basis::Polyline => [2.0; 3],
    }
}

/// Returns a distance that three control points of a curve have from one another: the first one
/// found that is at least `enough`, or approximately the largest.
fn spread_of_three(set: &CurveSet, i: usize, enough: f64) -> f64 {
    let furthest = |of: &dyn Fn(Point) -> f64| {
        let mut best = ([0.0; 3], 0.0);
        for p in (0..set.curve(i).points as usize).map(|k| set.point(i, k)) {
            let far = of(p);
            if far > best.1 {
                best = (p, far);
            }
            if far >= enough {
                break;
            }
        }
        best
    };
    let a = set.point(i, 0);
    let (b, ab) = furthest(&|p| distance(p, a));
    let (_, c) = furthest(&|p| distance(p, a).min(distance(p, b)));
    c.min(ab)
}
