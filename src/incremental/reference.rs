//! Reference frame: the distance that each control point may move before two curves may touch.
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
//! A reference may [`Cover`] more: open curves in the same way, and a curve with itself. Segments
//! of one curve that are not adjacent stay apart like those of two curves. Adjacent edges lie in
//! one plane at all times. An adjacent pair of spline segments meets only at its joint while the
//! differences of consecutive Bezier control points have a positive component along one axis,
//! because the derivative of the curve is a convex combination of them. If control points move by
//! at most 1, such a difference moves by the sum `w` of the magnitudes of its coefficients. With a
//! component `c` along a unit vector, it stays positive while the points move less than `c / w`.
//!
//! # Cost
//!
//! A descent of all pairs of curves within the reach of one another, and a test of hulls for each
//! pair of segments within it. Only pairs that may lower an allowance are examined more closely.

use super::Cover;
use super::affine::Sample;
use super::packed::Packed;
use super::stream::CHUNK;
use crate::certificate::Certificate;
use crate::curve::{Basis, Box3, BoxGroup, Curve, CurveSet, Point, pow2};
use crate::discretize::Hull;
use crate::pairs::{
    Agenda, Leaves, LinkSearch, Node, Query, SegmentPairs, Trees, closest_points, descend,
};
use crate::simd::{LANES, Lanes, dispatch};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::atomic::{AtomicU32, Ordering};

/// Share of a gap between two segments that allowances may use. The remainder is a margin for
/// rounding and for the discretization of splines.
const SHARE: f64 = 0.49;

/// Number of blocks whose clearance is sampled to choose the reach.
const SAMPLES: usize = 32;

/// Maximum number of halvings of two segments whose hulls are much nearer than the segments.
const DEPTH: u32 = 5;

/// Number of segment pairs that are gathered before they are processed.
const BATCH: usize = 1024;

/// Maximum number of steps of the search for the best axis. Few are needed unless the gap is very
/// small.
const STEPS: usize = 8;

/// Share of the best possible value from which on an axis is good enough.
const GOOD: f64 = 0.9;

/// Share of the approximate distance of two segments below which the gap of their hulls is poor.
const POOR: f64 = 0.8;

/// A frame with proven linking numbers, and the allowances of its points.
#[derive(Debug)]
pub(super) struct Reference {
    pub set: CurveSet,
    /// Pairs for which the allowances are valid.
    pub cover: Cover,
    /// Trees of all covered curves.
    pub trees: Trees,
    pub certificate: Certificate,
    /// Number of the frame, counted by the monitor.
    pub frame: u64,
    /// Number of pairs of curves with overlapping boxes.
    pub potential_links: usize,
    /// Points to which affine frames are fitted.
    pub sample: Sample,
    /// Number of blocks of eight segments.
    pub blocks: u64,
    /// Distance that the point of each slot may move. Infinite for copies, padding, and curves that
    /// are not covered.
    pub allowances: Vec<f32>,
    /// Compressed points and allowances.
    pub packed: Vec<Packed>,
    /// Largest distance that hulls move while all control points stay within their allowances.
    /// Segments whose distance exceeds twice the reach were not compared.
    pub reach: f64,
}

impl Reference {
    pub fn build(
        set: CurveSet,
        certificate: Certificate,
        frame: u64,
        potential_links: usize,
        cover: Cover,
    ) -> Reference {
        let mut trees = Trees::default();
        trees.refit(Covered { set: &set, cover });
        let sample = Sample::new(&set, cover.open);
        let blocks = set
            .curves()
            .iter()
            .map(|c| u64::from(c.segments.div_ceil(8)));
        let blocks = blocks.sum();
        let allowances = Allowances::new(&set, &trees, cover);
        let reach = allowances.reach;
        let allowances = allowances.fill(&certificate);
        let packed = Packed::blocks(&set, &allowances);
        Reference {
            set,
            cover,
            trees,
            certificate,
            frame,
            potential_links,
            sample,
            blocks,
            allowances,
            packed,
            reach,
        }
    }

    /// Returns the number of chunks of slots.
    pub fn chunks(&self) -> usize {
        self.allowances.len().div_ceil(CHUNK)
    }
}

/// Buffers of a task.
#[derive(Default)]
struct Buffers {
    agenda: Agenda,
    near: SegmentPairs,
}

/// Boxes of the covered curves.
#[derive(Clone, Copy)]
struct Covered<'a> {
    set: &'a CurveSet,
    cover: Cover,
}

impl Leaves for Covered<'_> {
    fn curves(&self) -> &[Curve] {
        self.set.curves()
    }

    fn has_tree(&self, i: usize) -> bool {
        self.cover.open || self.set.curve(i).closed
    }

    fn stored(&self, segments: u32) -> bool {
        Leaves::stored(&self.set, segments)
    }

    #[inline(always)]
    fn boxes(&self, i: usize, g: usize) -> BoxGroup {
        self.set.leaf_boxes(i, g)
    }
}

/// Allowances under construction.
struct Allowances<'a> {
    set: &'a CurveSet,
    trees: &'a Trees,
    cover: Cover,
    reach: f64,
    /// Bit patterns of the allowances. None is negative, so the patterns have the same order.
    slots: Vec<AtomicU32>,
}

impl<'a> Allowances<'a> {
    fn new(set: &'a CurveSet, trees: &'a Trees, cover: Cover) -> Self {
        let mut all = Allowances {
            set,
            trees,
            cover,
            reach: 0.0,
            slots: Vec::new(),
        };
        all.reach = all.typical_clearance() * SHARE * GOOD;
        let none = || AtomicU32::new(f32::INFINITY.to_bits());
        all.slots.resize_with(set.slots(), none);
        all
    }

    /// Returns the covered curves.
    fn curves(&self) -> impl Iterator<Item = usize> + '_ {
        let Allowances { set, cover, .. } = *self;
        (0..set.len()).filter(move |&i| Covered { set, cover }.has_tree(i))
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
        let set = self.set;
        4.0 * (set.pad() + set.max_abs() * pow2(-47)) + 1e-300
    }

    /// Returns the distance that control points may move if hulls may move by 1.
    fn stiffness(&self) -> f64 {
        match self.set.basis() {
            Basis::CatmullRom => 0.75,
            _ => 1.0,
        }
    }

    /// Computes all allowances.
    fn fill(self, certificate: &Certificate) -> Vec<f32> {
        let curves: Vec<usize> = self.curves().collect();
        curves.par_iter().for_each(|&i| {
            self.bound(i, certificate);
            if self.cover.own && !self.set.basis().is_polyline() {
                self.bound_turns(i);
            }
        });
        let set = self.set;
        // Rounding of single-precision boxes.
        let rounding = set.max_abs() * pow2(-22);
        // Pairs that are further apart bound no allowance below the reach.
        let within = (self.reach / SHARE + 2.0 * rounding).min(f32::MAX.into()) as f32;
        let dilated: Vec<Box3> = self
            .trees
            .roots()
            .iter()
            .map(|b| b.dilated(0.5 * within + rounding as f32))
            .collect();
        let mut search = LinkSearch::default();
        let pairs = search.find(&dilated);
        if self.cover.own {
            pairs.extend(curves.iter().map(|&i| (i as u32, i as u32)));
        }
        pairs
            .par_iter()
            .for_each_init(Buffers::default, |buffers, &(i, j)| {
                let curves = [i as usize, j as usize];
                dispatch!(simd => self.keep_apart(simd, curves, within, buffers));
            });
        self.slots
            .into_iter()
            .map(|a| f32::from_bits(a.into_inner()))
            .collect()
    }

    /// Applies the bounds that all points of a curve have.
    fn bound(&self, i: usize, certificate: &Certificate) {
        let mut undefined = certificate.undefined.iter();
        let mut most = self.stiffness() * self.reach;
        if undefined.any(|d| d.j.is_none() && d.i as usize == i) {
            most = 0.0;
        } else if self.set.curve(i).closed {
            // A loop must keep three distinct points.
            most = most.min(SHARE * spread_of_three(self.set, i, most / SHARE));
        }
        self.lower(self.set.body(i), most);
    }

    /// Applies the bounds that keep segments of two curves apart, or of a curve and itself.
    #[inline(always)]
    fn keep_apart<L: Lanes>(
        &self,
        simd: L,
        curves: [usize; 2],
        reach: f32,
        Buffers { agenda, near }: &mut Buffers,
    ) {
        let trees = curves.map(|i| self.trees.of(self.set, i));
        agenda.push((trees[0].root(), trees[1].root()));
        let query = Query {
            w: 2,
            meeting: false,
            reach,
        };
        while !agenda.is_empty() {
            descend::<L, true>(simd, trees, query, agenda, near, (usize::MAX, BATCH));
            self.keep_all_apart(curves, &near.all);
            near.all.clear();
        }
    }

    /// Applies the bounds of near segments. Fast if pairs with the same first segment are
    /// consecutive.
    #[inline(always)]
    fn keep_all_apart(&self, [i, j]: [usize; 2], pairs: &[(u32, u32)]) {
        let (set, slack, share) = (self.set, self.slack(), self.stiffness() * SHARE);
        let allowance = |slot: usize| self.slots[slot].load(Ordering::Relaxed);
        for pairs in pairs.chunk_by(|a, b| a.0 == b.0) {
            let s = pairs[0].0;
            let a = Hull::new(set.hull(i, s as usize));
            for &(_, t) in pairs {
                if i == j && (s >= t || set.curve(i).adjacent(s, t)) {
                    continue;
                }
                let support = || set.support(i, s).chain(set.support(j, t));
                // A gap above which all affected allowances are lower already, by more than
                // rounding errors.
                let most = f32::from_bits(support().map(allowance).max().unwrap_or(0));
                let enough = f64::from(most) * (1.0 + 1e-5) / share + slack;
                let b = Hull::new(set.hull(j, t as usize));
                let gap = gap(&a, &b, enough, DEPTH);
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
        let (set, n) = (self.set, self.set.curve(i).segments);
        let weights = weights(set.basis());
        let steps = |s: u32| -> [Point; 3] {
            let b = set.segment(i, s as usize);
            [0, 1, 2].map(|k| [0, 1, 2].map(|x| (b[k + 1][x] - b[k][x]) / weights[k]))
        };
        for s in 0..n {
            let next = set.curve(i).after(s);
            let both = [steps(s), steps(next)];
            // No weight is less than a third.
            let most = 2.0 * SHARE * (least_component(both.as_flattened()) - 3.0 * self.slack());
            self.lower(set.support(i, s).chain(set.support(i, next)), most);
        }
    }

    /// Returns a distance that most blocks of segments have from all others that must stay apart
    /// from them: the upper quartile of a sample.
    fn typical_clearance(&self) -> f64 {
        let set = self.set;
        let count = |i: usize| (set.curve(i).segments as usize).div_ceil(LANES);
        let total: usize = self.curves().map(count).sum();
        let step = (total / SAMPLES).max(1);
        let mut samples = Vec::new();
        let mut at = step / 2;
        for i in self.curves() {
            let n = count(i);
            while at < n {
                samples.push((i, at));
                at += step;
            }
            at -= n;
        }
        let mut distances: Vec<f64> = samples
            .par_iter()
            .map(|&(i, g)| self.clearance(i, g))
            .collect();
        distances.sort_by(f64::total_cmp);
        let quartile = distances.get(distances.len() * 3 / 4);
        let all = 4.0 * set.max_abs().max(f64::MIN_POSITIVE);
        quartile.map_or(all, |d| d.min(all))
    }

    /// Returns the approximate distance of a block of segments from all others that must stay apart
    /// from it, by best-first search. Infinite if there are none.
    fn clearance(&self, i: usize, block: usize) -> f64 {
        let (set, trees) = (self.set, self.trees);
        let boxes = set.leaf_boxes(i, block);
        let bounds = boxes.bounds();
        let hull = |i: usize, s: u32| Hull::new(set.hull(i, s as usize));
        let segments = (0..LANES as u32).map(|k| (block * LANES) as u32 + k);
        let n = set.curve(i).segments;
        let block: Vec<_> = segments
            .filter(|&s| s < n)
            .map(|s| (s, hull(i, s)))
            .collect();
        // Distances are not negative, so their bit patterns have the same order.
        let entry = |j: usize, b: &Box3, node: Option<Node>, at: u32| {
            (
                Reverse(bounds.dist_sq_below(b).to_bits()),
                j,
                at,
                node.map(|n| n.level),
            )
        };
        let others = trees
            .roots()
            .iter()
            .enumerate()
            .filter(|&(j, root)| (j != i || self.cover.own) && *root != Box3::EMPTY);
        let mut heap: BinaryHeap<_> = others
            .map(|(j, root)| entry(j, root, Some(trees.of(set, j).root()), 0))
            .collect();
        let mut best = f64::INFINITY;
        let mut leaf = BoxGroup::EMPTY;
        while let Some((Reverse(bits), j, at, level)) = heap.pop() {
            if f64::from_bits(bits) >= best * best {
                break;
            }
            let Some(level) = level else {
                let other = hull(j, at);
                for (s, hull) in &block {
                    if j != i || !set.curve(i).adjacent(*s, at) {
                        best = best.min(distance(near_points(hull, &other)));
                    }
                }
                continue;
            };
            let node = Node::new(level, at);
            let group = *trees.of(set, j).children(node, &mut leaf);
            for k in 0..LANES {
                let lane = group.lane(k);
                if lane != Box3::EMPTY {
                    let below = (level > 0).then(|| node.child(k as u32));
                    heap.push(entry(j, &lane, below, node.lane(k as u32)));
                }
            }
        }
        best
    }
}

fn distance([p, q]: [Point; 2]) -> f64 {
    let d = [0, 1, 2].map(|x| p[x] - q[x]);
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
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

/// Returns the smallest component of some vectors along a unit vector for which it is large, within
/// rounding errors. Returns 0 if no unit vector was found that makes all components positive.
fn least_component(vectors: &[Point]) -> f64 {
    let share = 1.0 / vectors.len() as f64;
    let mean = [0, 1, 2].map(|x| vectors.iter().map(|v| v[x] * share).sum());
    let least = |n: Point| {
        let all = vectors.iter().map(|&v| (dot(v, n), v));
        all.fold((f64::INFINITY, n), |a, b| if b.0 < a.0 { b } else { a })
    };
    best_component(mean, f64::INFINITY, least)
}

/// Returns the smallest component of all vectors in a convex set, along a unit vector for which it
/// is large: the first value that is at least `enough`, or the best value found, or 0.
///
/// `n` is in the set, and `least` returns the smallest product of a vector of the set with the
/// argument, and this vector.
///
/// The best axis points to the point of the set that is nearest to the origin. The search
/// approaches this point: each step moves `n` on a straight line towards the vector with the
/// smallest component (the Frank-Wolfe method).
#[inline(always)]
fn best_component(mut n: Point, enough: f64, least: impl Fn(Point) -> (f64, Point)) -> f64 {
    let mut best = 0.0f64;
    for _ in 0..STEPS {
        let length_sq = dot(n, n);
        if !(length_sq > TINY && length_sq.is_finite()) {
            break;
        }
        let (height, v) = least(n);
        best = best.max(height / length_sq.sqrt());
        let d = [0, 1, 2].map(|x| v[x] - n[x]);
        let t = (length_sq - height) / dot(d, d);
        // No axis is better than the direction of a vector of the set.
        if best >= enough.min(GOOD * length_sq.sqrt()) || t <= 0.0 || t.is_nan() {
            break;
        }
        n = [0, 1, 2].map(|x| n[x] + t.min(1.0) * d[x]);
    }
    best
}

fn sub(p: Point, q: Point) -> Point {
    [p[0] - q[0], p[1] - q[1], p[2] - q[2]]
}

fn dot(p: Point, q: Point) -> f64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

/// Squared lengths below this limit may have lost digits.
const TINY: f64 = 1e-200;

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
    let (b, ab) = furthest(&|p| distance([p, a]));
    let (_, c) = furthest(&|p| distance([p, a]).min(distance([p, b])));
    c.min(ab)
}

/// Returns a gap between two segments: a lower bound of their distance within rounding errors, or 0
/// if none was found. It is the gap between their hulls or, if that is poor, the minimum gap
/// between their halves.
///
/// A result of at least `enough` is some lower bound of that size. A smaller result does not depend
/// on `enough`.
#[inline(always)]
fn gap(a: &Hull, b: &Hull, enough: f64, depth: u32) -> f64 {
    // Most segments are further apart than required.
    let quick = a.gap_along(b, sub(b.center(), a.center()));
    if quick >= enough {
        return quick;
    }
    quick.max(larger_gap(a, b, enough, depth))
}

/// [`gap`] by a more expensive search.
#[inline(never)]
fn larger_gap(a: &Hull, b: &Hull, enough: f64, depth: u32) -> f64 {
    let near = near_points(a, b);
    let best = gap_of_hulls(a, b, near, enough);
    if depth == 0 || best >= enough.min(POOR * distance(near)) {
        return best;
    }
    let (a, b) = (a.halves(), b.halves());
    let mut least = f64::INFINITY;
    for (a, b) in a.iter().flat_map(|a| b.iter().map(move |b| (a, b))) {
        if least > best {
            least = least.min(gap(a, b, enough.min(least), depth - 1));
        }
    }
    best.max(least)
}

/// Returns points of two segments that are approximately nearest to each other, at the parameters
/// of the nearest points of their chords. The chords may be much nearer if curves bend around each
/// other.
fn near_points(a: &Hull, b: &Hull) -> [Point; 2] {
    let [[p0, p3], [q0, q3]] = [a, b].map(|h| [0, 3].map(|k| h.point(k)));
    let [p, q] = closest_points(p0, p3, q0, q3);
    [a.beside(p), b.beside(q)]
}

/// Returns the gap between two hulls, each of which contains one of the points, along the best axis
/// found.
fn gap_of_hulls(a: &Hull, b: &Hull, [p, q]: [Point; 2], enough: f64) -> f64 {
    best_component(sub(q, p), enough, |n| {
        let [from, to] = a.heights_of_both(b, n);
        let (mut i, mut j) = (0, 0);
        for k in 1..4 {
            i = if from[k] > from[i] { k } else { i };
            j = if to[k] < to[j] { k } else { j };
        }
        (to[j] - from[i], sub(b.point(j), a.point(i)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Positions;
    use crate::incremental::ledger::Ledger;
    use crate::verdict::AbortOn;
    use crate::verifier::Verifier;
    use proptest::prelude::*;

    /// A few curves.
    #[derive(Clone, Debug)]
    struct Curves {
        basis: Basis,
        counts: Vec<i32>,
        xyz: Vec<f64>,
        double: bool,
    }

    impl Curves {
        fn set(&self, xyz: &[f64]) -> CurveSet {
            let narrow: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
            let positions = match self.double {
                true => Positions::F64(xyz),
                false => Positions::F32(&narrow),
            };
            CurveSet::from_counts(self.basis, &self.counts, positions).unwrap()
        }
    }

    /// Returns a wavy ring, an arc of one, or arbitrary points.
    fn points(n: usize) -> impl Strategy<Value = Vec<Point>> {
        let vector = || prop::array::uniform3(-1.0f64..1.0);
        let ring = (
            vector(),
            vector(),
            vector(),
            vector(),
            0.0..0.3f64,
            1u8..5,
            0.3..1.0f64,
        );
        let ring = ring.prop_map(move |(center, u, v, w, size, f, part)| -> Vec<Point> {
            (0..n)
                .map(|k| {
                    let t = part * std::f64::consts::TAU * k as f64 / n as f64;
                    let wave = size * (f64::from(f) * t).cos();
                    let at = |x: usize| t.cos() * u[x] + t.sin() * v[x] + wave * w[x];
                    [0, 1, 2].map(|x| center[x] + 2.0 * at(x))
                })
                .collect()
        });
        prop_oneof![3 => ring, 1 => prop::collection::vec(prop::array::uniform3(-2.0..2.0f64), n)]
    }

    fn random_curves() -> impl Strategy<Value = Curves> {
        let basis = prop::sample::select(Basis::ALL.to_vec());
        let curve = (any::<bool>(), 2usize..14);
        let curves = prop::collection::vec(curve, 1..4);
        (basis, curves, any::<bool>()).prop_flat_map(|(basis, curves, double)| {
            let counts: Vec<i32> = curves
                .iter()
                .map(|&(closed, n)| match (basis, closed) {
                    (Basis::Bezier, true) => -3 * n as i32,
                    (Basis::Bezier, false) => 3 * n as i32 + 1,
                    (_, true) => -(n as i32) - 1,
                    (_, false) => n as i32 + 3,
                })
                .collect();
            let all: Vec<_> = counts
                .iter()
                .map(|n| points(n.unsigned_abs() as usize))
                .collect();
            all.prop_map(move |points| Curves {
                basis,
                counts: counts.clone(),
                xyz: points.into_iter().flatten().flatten().collect(),
                double,
            })
        })
    }

    /// Direction in which points move.
    #[derive(Clone, Copy, Debug)]
    enum Direction {
        /// A separate random direction for each point.
        Each,
        /// One random direction for each curve.
        Together,
        /// Towards the nearest point of another curve, or of a distant part of the same one.
        Near,
        /// Towards the previous or the next point.
        Fold,
    }

    /// Moves every point as far as its allowance permits.
    fn moved(curves: &Curves, reference: &Reference, seed: u64, direction: Direction) -> CurveSet {
        let mut state = seed | 1;
        let mut random = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let set = &reference.set;
        let sub = |p: Point, q: Point| [0, 1, 2].map(|x| p[x] - q[x]);
        let length = |v: Point| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        let mut xyz = Vec::new();
        for i in 0..set.len() {
            let whole = [0; 3].map(|_| random());
            for slot in set.body(i) {
                let p = set.at(slot);
                let others = (0..set.len()).flat_map(|j| set.body(j));
                let v = match direction {
                    Direction::Each => [0; 3].map(|_| random()),
                    Direction::Together => whole,
                    Direction::Near => others
                        .filter(|&q| !set.body(i).contains(&q) || q.abs_diff(slot) > 2)
                        .map(|q| sub(set.at(q), p))
                        .min_by(|&v, &w| length(v).total_cmp(&length(w)))
                        .unwrap_or(whole),
                    Direction::Fold => {
                        let to = if random() < 0.0 {
                            slot.wrapping_sub(1)
                        } else {
                            slot + 1
                        };
                        match set.body(i).contains(&to) {
                            true => sub(set.at(to), p),
                            false => whole,
                        }
                    }
                };
                let allowed = f64::from(reference.allowances[slot]).min(10.0);
                let scale = 0.999_999 * allowed / length(v).max(1e-9);
                let mut q = [0, 1, 2].map(|x| p[x] + scale * v[x]);
                if !curves.double {
                    q = q.map(|x| f64::from(x as f32));
                }
                xyz.extend(if length(sub(q, p)) <= allowed { q } else { p });
            }
        }
        curves.set(&xyz)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        /// No covered curves meet between two frames within the allowances, so the ledger has no
        /// entry.
        #[test]
        fn no_covered_curves_meet_within_the_allowances(
            curves in random_curves(),
            own in any::<bool>(),
            open in any::<bool>(),
            seeds in prop::array::uniform2(any::<u64>()),
            directions in prop::array::uniform2(prop::sample::select(vec![
                Direction::Each,
                Direction::Together,
                Direction::Near,
                Direction::Fold,
            ])),
        ) {
            let set = curves.set(&curves.xyz);
            let certificate = Verifier::new(AbortOn::Never).certify(&set).0.clone();
            let mut ledger = Ledger::default();
            let cover = Cover { own, open };
            // Pairs that are too close to decide remain so.
            let unknown = ledger.first_step(&set, &set, cover, None).undecided;
            let reference = Reference::build(set.clone(), certificate, 0, 0, cover);
            prop_assert!(reference.allowances.iter().all(|&a| a >= 0.0));
            let [a, b] = [0, 1].map(|k| moved(&curves, &reference, seeds[k], directions[k]));
            for (before, after) in [(&set, &a), (&set, &b), (&a, &b)] {
                let outcome = ledger.first_step(before, after, cover, None);
                prop_assert_eq!(&outcome.events, &[]);
                for defect in &outcome.undecided {
                    let known = unknown.iter().any(|u| (u.i, u.j) == (defect.i, defect.j));
                    prop_assert!(known, "{defect:?}");
                }
            }
        }
    }
}
