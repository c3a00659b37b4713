//! A frame that later ones are compared with: how far may each control point move before two curves may touch?
//!
//! Two segments of different curves whose hulls have a gap `g` along some unit vector stay apart while every point
//! of the hulls moves less than `g / 2`. Control points move the hulls: those of a Bezier segment and of a B-spline
//! are convex combinations, so no further than the control points; those of Catmull-Rom are off a control point
//! by a sixth of the difference of two others, so at most `1 + 1/6 + 1/6 = 4/3` times as far. The allowance of a control
//! point is the least of these distances over all segments that depend on it and all near segments of other
//! closed curves; where hulls meet, over their halves. If no point has moved further, then no two curves touched on
//! the straight way from the reference frame, and every linking number is what it was.
//!
//! A reference may [`Cover`] more: open curves in the same way, and a curve with itself. For the latter, segments that
//! are no neighbours stay apart as those of two curves do. Neighbouring edges lie in one plane at all times. A
//! neighbouring pair of spline segments meets nowhere but at its joint while the differences of consecutive Bezier
//! control points have a positive component along one axis: the derivative of the curve is a convex combination of
//! them. If control points move by 1 at most, such a difference moves by the sum `w` of the magnitudes of its
//! coefficients: with a component `c` along a unit vector it stays positive while they move less than `c / w`.
//!
//! Cost: a descent of all pairs of curves that come within the reach of one another, and some tests of hulls for
//! each pair of segments within it.

use super::affine::Sample;
use crate::certificate::Certificate;
use crate::curve::{Basis, Bezier, Box3, BoxGroup, Curve, CurveSet, Point, sub_segment};
use crate::pairs::{
    Leaves, LinkSearch, Trees, closest_of_segments, closest_points, segments_within,
};
use rayon::prelude::*;
use std::cell::Cell;
use std::sync::atomic::{AtomicU32, Ordering};

/// Of the distance that keeps two segments apart, the share that may be used up: what is left keeps them apart by
/// more than rounding and by more than the discretization of splines needs.
const SHARE: f64 = 0.49;

/// Segments whose clearance is looked at to choose the reach.
const SAMPLES: usize = 64;

/// Halvings of two segments whose hulls meet, in search of a gap.
const DEPTH: u32 = 3;

/// Steps of the search for the axis along which a curve runs one way: few are needed but where it hardly does.
const TURNS: usize = 8;

/// Which segments a reference frame keeps apart, beside those of two different closed curves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Cover {
    /// Those of one curve.
    pub own: bool,
    /// Those of open curves.
    pub open: bool,
}

/// A frame with proven linking numbers, and what may move how far.
#[derive(Debug)]
pub(super) struct Reference {
    pub set: CurveSet,
    /// What the allowances hold for.
    pub cover: Cover,
    /// Trees of all curves that are covered.
    pub trees: Trees,
    pub certificate: Certificate,
    /// Number of the frame, as the monitor counts.
    pub frame: u64,
    /// Pairs of curves whose boxes overlapped.
    pub potential_links: usize,
    /// What affine frames are fitted to.
    pub sample: Sample,
    /// Blocks of eight segments in all.
    pub blocks: u64,
    /// For every slot of the coordinates, the distance that its point may move. Infinite where it is a copy, padding or
    /// of a curve that is not covered.
    pub allowances: Vec<f32>,
    /// How far hulls move at most while no control point moves further than it may: segments that are further apart
    /// than twice this were not compared.
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
        trees.refit_to(Covered { set: &set, cover });
        let sample = Sample::new(&set, cover.open);
        let blocks = set
            .curves()
            .iter()
            .map(|c| u64::from(c.segments.div_ceil(8)));
        let blocks = blocks.sum();
        let allowances = Allowances::new(&set, &trees, cover);
        let reach = allowances.reach;
        let allowances = allowances.fill(&certificate);
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
            reach,
        }
    }
}

/// The boxes of the curves that are covered.
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

/// Allowances in the making.
struct Allowances<'a> {
    set: &'a CurveSet,
    trees: &'a Trees,
    cover: Cover,
    reach: f64,
    /// Bits of each, which compare as they do: none is negative.
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
        all.reach = all.typical_clearance() * 0.5;
        let none = || AtomicU32::new(f32::INFINITY.to_bits());
        all.slots.resize_with(set.slots(), none);
        all
    }

    /// Curves that are covered.
    fn curves(&self) -> impl Iterator<Item = usize> + '_ {
        let Allowances { set, cover, .. } = *self;
        (0..set.len()).filter(move |&i| Covered { set, cover }.has_tree(i))
    }

    fn lower(&self, slots: impl Iterator<Item = usize>, to: f64) {
        let to = (to.max(0.0) as f32) * (1.0 - 1e-6);
        for slot in slots {
            self.slots[slot].fetch_min(to.to_bits(), Ordering::Relaxed);
        }
    }

    /// Rounding of gaps, of hulls now and of those of a later frame.
    fn slack(&self) -> f64 {
        let set = self.set;
        4.0 * (set.pad() + set.max_abs() * f64::from_bits((1023 - 47) << 52)) + 1e-300
    }

    /// How far control points may move for hulls to move by 1.
    fn stiffness(&self) -> f64 {
        match self.set.basis() {
            Basis::CatmullRom => 0.75,
            _ => 1.0,
        }
    }

    /// All allowances.
    fn fill(self, certificate: &Certificate) -> Vec<f32> {
        let curves: Vec<usize> = self.curves().collect();
        curves.par_iter().for_each(|&i| {
            self.bound(i, certificate);
            if self.cover.own && !self.set.basis().is_polyline() {
                self.bound_turns(i);
            }
        });
        let set = self.set;
        // Of single-precision boxes.
        let rounding = set.max_abs() * f64::from_bits((1023 - 22) << 52);
        // What is further apart bounds nothing below the reach.
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
        pairs.par_iter().for_each(|&(i, j)| {
            let (i, j) = (i as usize, j as usize);
            for (s, t) in segments_within(set, self.trees, i, j, within) {
                if i != j || (s < t && !set.curve(i).adjacent(s, t)) {
                    self.keep_apart([(i, s), (j, t)]);
                }
            }
        });
        self.slots
            .into_iter()
            .map(|a| f32::from_bits(a.into_inner()))
            .collect()
    }

    /// Bounds that all points of a curve have.
    fn bound(&self, i: usize, certificate: &Certificate) {
        let mut undefined = certificate.undefined.iter();
        let mut most = self.stiffness() * self.reach;
        if undefined.any(|d| d.j.is_none() && d.i as usize == i) {
            most = 0.0;
        } else if self.set.curve(i).closed {
            // A loop must keep three distinct points.
            most = most.min(SHARE * spread_of_three(self.set, i));
        }
        self.lower(self.set.body(i), most);
    }

    /// Bounds that keep two segments apart.
    #[inline(always)]
    fn keep_apart(&self, segments: [(usize, u32); 2]) {
        let [a, b] = segments.map(|(i, s)| self.set.segment(i, s as usize));
        let gap = gap(&a, &b, DEPTH) - self.slack();
        if SHARE * gap >= self.reach {
            return;
        }
        for (i, s) in segments {
            self.lower(self.set.support(i, s), self.stiffness() * SHARE * gap);
        }
    }

    /// Bounds that keep a curve running one way along each of its segments and the next one.
    fn bound_turns(&self, i: usize) {
        let (set, n) = (self.set, self.set.curve(i).segments);
        let weights = weights(set.basis());
        let steps = |s: u32| -> [Point; 3] {
            let b = set.segment(i, s as usize);
            [0, 1, 2].map(|k| [0, 1, 2].map(|x| (b[k + 1][x] - b[k][x]) / weights[k]))
        };
        for s in 0..n {
            // An open curve ends.
            let next = match (s + 1 < n, set.curve(i).closed) {
                (true, _) => s + 1,
                (false, true) => 0,
                (false, false) => s,
            };
            let both = [steps(s), steps(next)];
            // No weight is less than a third.
            let most = 2.0 * SHARE * (least_component(both.as_flattened()) - 3.0 * self.slack());
            self.lower(set.support(i, s).chain(set.support(i, next)), most);
        }
    }

    /// A distance that most segments have from all that they must be kept apart from: the upper quartile of a sample.
    /// Infinite where there is nothing.
    fn typical_clearance(&self) -> f64 {
        let set = self.set;
        let total: usize = self.curves().map(|i| set.curve(i).segments as usize).sum();
        let step = (total / SAMPLES).max(1);
        let mut samples = Vec::new();
        let mut at = step / 2;
        for i in self.curves() {
            let n = set.curve(i).segments as usize;
            while at < n {
                samples.push((i, at as u32));
                at += step;
            }
            at -= n;
        }
        let mut distances: Vec<f64> = samples
            .par_iter()
            .map(|&(i, s)| self.clearance(i, s))
            .collect();
        distances.sort_by(f64::total_cmp);
        let quartile = distances.get(distances.len() * 3 / 4);
        let all = 4.0 * set.max_abs().max(f64::MIN_POSITIVE);
        quartile.map_or(all, |d| d.min(all))
    }

    /// Distance of a segment from all that it must be kept apart from.
    fn clearance(&self, i: usize, s: u32) -> f64 {
        let (set, trees) = (self.set, self.trees);
        let own = set.leaf_boxes(i, s as usize / 8).lane(s as usize % 8);
        let best = Cell::new(f64::INFINITY);
        let nearer = |b: &Box3| own.dist_sq_below(b) < best.get() * best.get();
        for (j, root) in trees.roots().iter().enumerate() {
            if (j != i || self.cover.own) && *root != Box3::EMPTY && nearer(root) {
                trees.of(set, j).visit(nearer, |t| {
                    if j != i || !set.curve(i).adjacent(s, t) {
                        let place = closest_of_segments(set, [i, j], [s, t]);
                        best.set(best.get().min(place.distance));
                    }
                });
            }
        }
        best.get()
    }
}

/// How far the differences of consecutive Bezier control points move, at most, while control points move by 1: sums of
/// the magnitudes of their coefficients, see [`Basis::hull`].
fn weights(basis: Basis) -> [f64; 3] {
    match basis {
        // (q2 - q0) / 6, 5/6 (q2 - q1) - (q3 - q0) / 6, (q3 - q1) / 6.
        Basis::CatmullRom => [1.0 / 3.0, 2.0, 1.0 / 3.0],
        // (q2 - q0) / 6, (q2 - q1) / 3, (q3 - q1) / 6.
        Basis::BSpline => [1.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0],
        Basis::Bezier | Basis::Polyline => [2.0; 3],
    }
}

/// The least component of some vectors along a unit vector for which it is large: within rounding, and 0 where none
/// was found that makes all of them positive.
///
/// The best one points to where the convex hull of the vectors is nearest to the origin: the search goes there, from
/// their mean towards the vector that has the least component at a time.
fn least_component(vectors: &[Point]) -> f64 {
    let dot = |p: Point, q: Point| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let mut n = [0.0; 3];
    for v in vectors {
        n = [0, 1, 2].map(|x| n[x] + v[x] / vectors.len() as f64);
    }
    let mut best = 0.0f64;
    for _ in 0..TURNS {
        let (least, v) = vectors
            .iter()
            .map(|&v| (dot(v, n), v))
            .fold((f64::INFINITY, n), |a, b| if b.0 < a.0 { b } else { a });
        let length_sq = dot(n, n);
        if !(length_sq > TINY && length_sq.is_finite()) {
            break;
        }
        best = best.max(least / length_sq.sqrt());
        let d = [0, 1, 2].map(|x| v[x] - n[x]);
        let t = (length_sq - least) / dot(d, d);
        if t <= 0.0 || t.is_nan() {
            break;
        }
        n = [0, 1, 2].map(|x| n[x] + t.min(1.0) * d[x]);
    }
    best
}

/// Squares of lengths below this may have lost digits.
const TINY: f64 = 1e-200;

/// A distance that three control points of a curve have from one another.
fn spread_of_three(set: &CurveSet, i: usize) -> f64 {
    let n = set.curve(i).points as usize;
    let distance = |a: Point, b: Point| {
        let d = [0, 1, 2].map(|x| a[x] - b[x]);
        (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
    };
    let points = || (0..n).map(|k| set.point(i, k));
    let furthest = |of: &dyn Fn(Point) -> f64| {
        points()
            .max_by(|&p, &q| of(p).total_cmp(&of(q)))
            .map_or(([0.0; 3], 0.0), |p| (p, of(p)))
    };
    let a = set.point(i, 0);
    let (b, ab) = furthest(&|p| distance(p, a));
    let (_, c) = furthest(&|p| distance(p, a).min(distance(p, b)));
    c.min(ab)
}

/// The gap of the hulls of two segments along the best of some directions, or of their halves where the hulls meet:
/// a lower bound of it, within rounding, and 0 where none was found.
fn gap(a: &Bezier, b: &Bezier, depth: u32) -> f64 {
    let mut best = 0.0f64;
    for n in normals(a, b) {
        best = best.max(signed_gap(a, b, n).abs());
    }
    if best > 0.0 || depth == 0 {
        return best;
    }
    let halves = |p: &Bezier| [sub_segment(p, 0.0, 0.5), sub_segment(p, 0.5, 1.0)];
    let (a, b) = (halves(a), halves(b));
    let mut least = f64::INFINITY;
    for a in &a {
        for b in &b {
            least = least.min(gap(a, b, depth - 1));
        }
    }
    least
}

/// Directions in which two segments may be apart: the shortest connection of their chords, the common normal of these,
/// the way from centre to centre, its parts across the chords, and the axes.
pub(super) fn normals(a: &Bezier, b: &Bezier) -> [Point; 8] {
    let sub = |p: Point, q: Point| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
    let dot = |p: Point, q: Point| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let sum = |p: &Bezier| [0, 1, 2].map(|x| p[0][x] + p[1][x] + p[2][x] + p[3][x]);
    let (da, db) = (sub(a[3], a[0]), sub(b[3], b[0]));
    let between = sub(sum(b), sum(a));
    let across = |d: Point| {
        let c = dot(between, d) / dot(d, d).max(f64::MIN_POSITIVE);
        [0, 1, 2].map(|x| between[x] - c * d[x])
    };
    let [p, q] = closest_points(a[0], a[3], b[0], b[3]);
    let cross = [
        da[1] * db[2] - da[2] * db[1],
        da[2] * db[0] - da[0] * db[2],
        da[0] * db[1] - da[1] * db[0],
    ];
    [
        sub(q, p),
        cross,
        between,
        across(da),
        across(db),
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ]
}

/// The gap of two hulls along a direction: positive where `a` lies below `b`, negative where it lies above, 0 where
/// neither does.
pub(super) fn signed_gap(a: &Bezier, b: &Bezier, n: Point) -> f64 {
    let length_sq = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    if !(length_sq > TINY && length_sq.is_finite()) {
        return 0.0;
    }
    let length = length_sq.sqrt();
    let extent = |p: &Bezier| {
        let mut out = [f64::INFINITY, f64::NEG_INFINITY];
        for p in p {
            let d = [0, 1, 2].map(|x| (p[x] - a[0][x]) * n[x]);
            let h = d[0] + d[1] + d[2];
            out = [out[0].min(h), out[1].max(h)];
        }
        out
    };
    let ([a_lo, a_hi], [b_lo, b_hi]) = (extent(a), extent(b));
    if a_hi < b_lo {
        (b_lo - a_hi) / length
    } else if b_hi < a_lo {
        (b_hi - a_lo) / length
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Positions;
    use crate::incremental::ledger::{Ledger, LedgerOptions};
    use crate::verdict::AbortOn;
    use crate::verifier::Verifier;
    use proptest::prelude::*;

    /// A few curves.
    #[derive(Clone, Debug)]
    struct Scene {
        basis: Basis,
        counts: Vec<i32>,
        xyz: Vec<f64>,
        double: bool,
    }

    impl Scene {
        fn set(&self, xyz: &[f64]) -> CurveSet {
            let narrow: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
            let positions = match self.double {
                true => Positions::F64(xyz),
                false => Positions::F32(&narrow),
            };
            CurveSet::from_counts(self.basis, &self.counts, positions).unwrap()
        }
    }

    /// A ring that waves, as a whole or a part of it, or any points.
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

    fn scene() -> impl Strategy<Value = Scene> {
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
            all.prop_map(move |points| Scene {
                basis,
                counts: counts.clone(),
                xyz: points.into_iter().flatten().flatten().collect(),
                double,
            })
        })
    }

    /// Where points go.
    #[derive(Clone, Copy, Debug)]
    enum Way {
        /// Each its own way.
        Each,
        /// Curve by curve.
        Together,
        /// To the nearest point of another curve, or further along its own.
        Near,
        /// To the point before it or after it.
        Fold,
    }

    /// Moves every point as far as it may.
    fn moved(scene: &Scene, reference: &Reference, seed: u64, way: Way) -> CurveSet {
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
                let v = match way {
                    Way::Each => [0; 3].map(|_| random()),
                    Way::Together => whole,
                    Way::Near => others
                        .filter(|&q| !set.body(i).contains(&q) || q.abs_diff(slot) > 2)
                        .map(|q| sub(set.at(q), p))
                        .min_by(|&v, &w| length(v).total_cmp(&length(w)))
                        .unwrap_or(whole),
                    Way::Fold => {
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
                if !scene.double {
                    q = q.map(|x| f64::from(x as f32));
                }
                xyz.extend(if length(sub(q, p)) <= allowed { q } else { p });
            }
        }
        scene.set(&xyz)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        /// Nothing that is covered meets between two frames within the allowances: the ledger has no entry.
        #[test]
        fn within_the_allowances_nothing_covered_meets(
            scene in scene(),
            own in any::<bool>(),
            open in any::<bool>(),
            seeds in prop::array::uniform2(any::<u64>()),
            ways in prop::array::uniform2(prop::sample::select(vec![Way::Each, Way::Together, Way::Near, Way::Fold])),
        ) {
            let set = scene.set(&scene.xyz);
            let certificate = Verifier::new(AbortOn::Never).certify(&set).0.clone();
            let mut ledger = Ledger::default();
            let options = LedgerOptions { self_crossings: own, open_curves: open };
            // What is too close to tell stays so.
            let unknown = ledger.step(&set, &set, options, None).undecided;
            let reference = Reference::build(set.clone(), certificate, 0, 0, Cover { own, open });
            prop_assert!(reference.allowances.iter().all(|&a| a >= 0.0));
            let [a, b] = [0, 1].map(|k| moved(&scene, &reference, seeds[k], ways[k]));
            for (before, after) in [(&set, &a), (&set, &b), (&a, &b)] {
                let outcome = ledger.step(before, after, options, None);
                prop_assert_eq!(&outcome.events, &[]);
                for defect in &outcome.undecided {
                    prop_assert!(unknown.iter().any(|u| (u.i, u.j) == (defect.i, defect.j)), "{defect:?}");
                }
            }
        }
    }
}
