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
//! Cost: a descent of all pairs of curves that come within the reach of one another, and some tests of hulls for
//! each pair of segments within it.

use super::affine::Sample;
use super::packed::Packed;
use crate::certificate::Certificate;
use crate::curve::{Basis, Bezier, Box3, CurveSet, Point, sub_segment};
use crate::pairs::{LinkSearch, Trees, closest_of_segments, closest_points, segments_within};
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

/// A frame with proven linking numbers, and what may move how far.
#[derive(Debug)]
pub(super) struct Reference {
    pub set: CurveSet,
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
    /// of an open curve.
    pub allowances: Vec<f32>,
    /// Points and allowances once more, small.
    pub packed: Vec<Packed>,
    /// The largest allowance: segments that are further apart than twice this were not compared.
    pub reach: f64,
}

impl Reference {
    pub fn build(
        set: CurveSet,
        certificate: Certificate,
        frame: u64,
        potential_links: usize,
    ) -> Reference {
        let mut trees = Trees::default();
        trees.refit(&set);
        let sample = Sample::new(&set);
        let blocks = set
            .curves()
            .iter()
            .map(|c| u64::from(c.segments.div_ceil(8)));
        let blocks = blocks.sum();
        let reach = typical_clearance(&set, &trees) * 0.5;
        let allowances = allowances(&set, &trees, &certificate, reach);
        let packed = Packed::blocks(&set, &allowances);
        Reference {
            set,
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
}

/// A distance that most segments have from all other curves: the upper quartile of a sample. Infinite where there is no
/// other curve.
fn typical_clearance(set: &CurveSet, trees: &Trees) -> f64 {
    let closed: Vec<usize> = (0..set.len()).filter(|&i| set.curve(i).closed).collect();
    let total: usize = closed.iter().map(|&i| set.curve(i).segments as usize).sum();
    let step = (total / SAMPLES).max(1);
    let mut samples = Vec::new();
    let mut at = step / 2;
    for &i in &closed {
        let n = set.curve(i).segments as usize;
        while at < n {
            samples.push((i, at as u32));
            at += step;
        }
        at -= n;
    }
    let mut distances: Vec<f64> = samples
        .par_iter()
        .map(|&(i, s)| clearance(set, trees, i, s))
        .collect();
    distances.sort_by(f64::total_cmp);
    let quartile = distances.get(distances.len() * 3 / 4);
    let all = 4.0 * set.max_abs().max(f64::MIN_POSITIVE);
    quartile.map_or(all, |d| d.min(all))
}

/// Distance of a segment from all other closed curves.
fn clearance(set: &CurveSet, trees: &Trees, i: usize, s: u32) -> f64 {
    let own = set.leaf_boxes(i, s as usize / 8).lane(s as usize % 8);
    let best = Cell::new(f64::INFINITY);
    let nearer = |b: &Box3| own.dist_sq_below(b) < best.get() * best.get();
    for (j, root) in trees.roots().iter().enumerate() {
        if j != i && *root != Box3::EMPTY && nearer(root) {
            trees.of(set, j).visit(nearer, |t| {
                let place = closest_of_segments(set, [i, j], [s, t]);
                best.set(best.get().min(place.distance));
            });
        }
    }
    best.get()
}

fn allowances(set: &CurveSet, trees: &Trees, certificate: &Certificate, reach: f64) -> Vec<f32> {
    let allowed: Vec<AtomicU32> = (0..set.slots())
        .map(|_| AtomicU32::new(f32::INFINITY.to_bits()))
        .collect();
    // Allowances are not negative, so their bits compare as they do.
    let lower = |slot: usize, to: f64| {
        // Infinity says that there is no bound.
        let to = to.clamp(0.0, f32::MAX.into()) as f32 * (1.0 - 1e-6);
        allowed[slot].fetch_min(to.to_bits(), Ordering::Relaxed);
    };
    let degenerate = |i: usize| {
        let mut undefined = certificate.undefined.iter();
        undefined.any(|d| d.j.is_none() && d.i as usize == i)
    };
    (0..set.len()).into_par_iter().for_each(|i| {
        if set.curve(i).closed {
            // A loop must keep three distinct points.
            let most = if degenerate(i) {
                0.0
            } else {
                reach.min(SHARE * spread_of_three(set, i))
            };
            set.body(i).for_each(|slot| lower(slot, most));
        }
    });
    let rounding = set.max_abs() * f64::from_bits((1023 - 22) << 52);
    let dilated: Vec<Box3> = trees
        .roots()
        .iter()
        .map(|b| b.dilated((reach + rounding) as f32))
        .collect();
    let mut search = LinkSearch::default();
    let slack = 4.0 * (set.pad() + set.max_abs() * f64::from_bits((1023 - 47) << 52)) + 1e-300;
    let stiffness = match set.basis() {
        Basis::CatmullRom => 0.75,
        _ => 1.0,
    };
    search.find(&dilated).par_iter().for_each(|&(i, j)| {
        let pair = [i as usize, j as usize];
        let within = (2.0 * reach + 2.0 * rounding) as f32;
        for (s, t) in segments_within(set, trees, pair[0], pair[1], within) {
            let hulls = [(pair[0], s), (pair[1], t)].map(|(i, s)| set.segment(i, s as usize));
            let gap = gap(&hulls[0], &hulls[1], DEPTH) - slack;
            if SHARE * stiffness * gap >= reach {
                continue;
            }
            for (i, s) in [(pair[0], s), (pair[1], t)] {
                for slot in set.support(i, s) {
                    lower(slot, SHARE * stiffness * gap);
                }
            }
        }
    });
    allowed
        .into_iter()
        .map(|a| f32::from_bits(a.into_inner()))
        .collect()
}

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
    let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
    if !(length > 0.0 && length.is_finite()) {
        return 0.0;
    }
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
