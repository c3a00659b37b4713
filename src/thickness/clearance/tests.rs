//! The monitor against a comparison of all pairs of segments in every frame.

use super::*;
use crate::curve::vector::{add, distance, norm, sub};
use crate::curve::{Basis, Point};
use crate::pairs::nearest;
use crate::random::Random;
use crate::thickness::splines::deviation;
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::{PI, TAU};

/// Number of chords of a spline segment in the oracle.
const CHORDS: usize = 16;

/// Returns the smallest distance of two strands, as a share of the sum of their radii, by a
/// comparison of all pairs of segments, and its error. `first` is the set whose lengths separate
/// the strands of a curve.
fn smallest(set: &CurveSet, first: &CurveSet, radii: &[f64]) -> [f64; 2] {
    let chords = match set.basis() {
        Basis::Polyline => 1,
        _ => CHORDS,
    };
    struct Chord {
        curve: usize,
        segment: u32,
        ends: [Point; 2],
    }
    let mut all = Vec::new();
    let mut error = 0.0_f64;
    let mut starts: Vec<Vec<f64>> = Vec::new();
    for (i, radius) in radii.iter().enumerate() {
        let segments = set.curve(i).segments as usize;
        let mut arcs = vec![0.0];
        for s in 0..segments {
            let length = distance(first.knot(i, s), first.knot(i, s + 1));
            arcs.push(arcs[s] + length);
            let deviation = deviation(&set.segment(i, s)) / (chords * chords) as f64;
            error = error.max(deviation / radius);
            for k in 0..chords {
                let at = |k: usize| match (set.basis(), k) {
                    (Basis::Polyline, 0) => set.knot(i, s),
                    (Basis::Polyline, _) => set.knot(i, s + 1),
                    _ => set.eval(i, s, k as f64 / chords as f64),
                };
                all.push(Chord {
                    curve: i,
                    segment: s as u32,
                    ends: [at(k), at(k + 1)],
                });
            }
        }
        starts.push(arcs);
    }
    let mut least = f64::INFINITY;
    for (k, a) in all.iter().enumerate() {
        for b in &all[k + 1..] {
            let sum = radii[a.curve] + radii[b.curve];
            if a.curve == b.curve {
                let curve = set.curve(a.curve);
                let arcs = &starts[a.curve];
                let (s, t) = (a.segment as usize, b.segment as usize);
                let forward = arcs[t] - arcs[s + 1];
                let around = arcs[s] + arcs.last().unwrap() - arcs[t + 1];
                let apart = if curve.closed {
                    forward.min(around)
                } else {
                    forward
                };
                if curve.adjacent(a.segment, b.segment) || apart < PI * radii[a.curve] {
                    continue;
                }
            }
            let [d, e] = [a, b].map(|c| sub(c.ends[1], c.ends[0]));
            let apart = distance(a.ends[0], b.ends[0]);
            if apart > 1.01 * (least * sum + norm(d) + norm(e)) {
                continue;
            }
            let near = nearest([a.ends[0], d], [b.ends[0], e]);
            least = least.min(near.distance_sq.sqrt() / sum);
        }
    }
    match set.basis().is_polyline() {
        true => [least, 1e-9],
        false => [least, error + 1e-9],
    }
}

/// Motion of a test.
#[derive(Clone, Copy, Debug)]
enum Motion {
    Rest,
    /// The scene moves and turns as a whole.
    Rigid,
    /// Each curve moves on a line of its own.
    Curves,
    /// Each point moves on its own.
    Noise,
    /// All points are mixed up.
    Jump,
}

/// Returns wavy rings, open arcs, and a coil that comes near itself.
fn scene(random: &mut Random, basis: Basis) -> (Vec<i32>, Vec<Point>) {
    let mut counts = Vec::new();
    let mut points = Vec::new();
    for k in 0..3 + random.below(5_usize) {
        let n = 3 * (4 + random.below(12_usize));
        let (center, u, v) = (random.point(2.0), random.point(1.5), random.point(1.5));
        let turns = if k == 0 { 3.0 } else { 1.0 };
        let open = random.one_in(3) || k == 0;
        let n = match (basis, open) {
            (Basis::Bezier, true) => n + 1,
            _ => n,
        };
        for m in 0..n {
            let t = turns * TAU * m as f64 / n as f64;
            let drift = if k == 0 { 0.3 * t } else { 0.0 };
            let (c, s) = (t.cos(), t.sin());
            points.push([0, 1, 2].map(|x| center[x] + c * u[x] + s * v[x] + drift));
        }
        counts.push(if open { n as i32 } else { -(n as i32) });
    }
    (counts, points)
}

fn set(basis: Basis, counts: &[i32], points: &[Point], single: bool) -> CurveSet {
    let wide = points.as_flattened();
    let narrow: Vec<f32> = wide.iter().map(|&x| x as f32).collect();
    let positions = match single {
        true => Positions::F32(&narrow),
        false => Positions::F64(wide),
    };
    CurveSet::from_counts(basis, counts, positions).unwrap()
}

fn check(seed: u64, frames: u64) {
    let mut random = Random::new(seed);
    let basis = random.pick(&Basis::ALL);
    let single = random.one_in(2);
    let (counts, mut points) = scene(&mut random, basis);
    let radii: Vec<f32> = counts
        .iter()
        .map(|_| random.between(0.02, 0.2) as f32)
        .collect();
    let wide: Vec<f64> = radii.iter().map(|&r| r.into()).collect();
    let mut options = ClearanceOptions::new(None);
    options.low = random.between(0.2, 1.0);
    let mut monitor = ClearanceMonitor::new(options);
    monitor.set_radii(&radii).unwrap();
    let mut first: Option<CurveSet> = None;
    let mut motion = Motion::Rest;
    let mut speeds: Vec<Point> = Vec::new();
    for seq in 0..frames {
        if seq % 8 == 0 {
            motion = random.pick(&[
                Motion::Rest,
                Motion::Rigid,
                Motion::Curves,
                Motion::Noise,
                Motion::Jump,
            ]);
            let speed = 10f64.powf(random.between(-4.0, -1.0));
            speeds = counts.iter().map(|_| random.point(speed)).collect();
        }
        let mut at = 0;
        let turn = Rotation3::new(Vector3::from(speeds[0]));
        for (count, speed) in counts.iter().zip(&speeds) {
            for p in &mut points[at..at + count.unsigned_abs() as usize] {
                *p = match motion {
                    Motion::Rest => *p,
                    Motion::Rigid => add((turn * Vector3::from(*p)).into(), speeds[0]),
                    Motion::Curves => add(*p, *speed),
                    Motion::Noise => add(*p, random.point(speed[0].abs())),
                    Motion::Jump => add(*p, random.point(0.3)),
                };
            }
            at += count.unsigned_abs() as usize;
        }
        let now = set(basis, &counts, &points, single);
        let found = monitor.measure(&now, seq).unwrap();
        let first = first.get_or_insert_with(|| now.clone());
        let [expected, oracle] = smallest(&now, first, &wide);
        let context = format!("seed {seed}, frame {seq}, {motion:?}: {expected} of {found:?}");
        assert!(found.at_least <= expected + oracle, "{context}");
        let (closest, error) = found.closest.map_or((REACH, 0.0), |c| (c.ratio, c.error));
        assert!(closest + error >= expected.min(REACH) - oracle, "{context}");
        // Other strands may be measured less precisely than the closest ones.
        let error = oracle
            + if basis.is_polyline() {
                0.0
            } else {
                closest - found.at_least
            };
        if expected < options.low - error {
            assert!(found.low && closest <= expected + error, "{context}");
        }
        let slack = closest - expected.min(REACH);
        assert!(slack <= MOST_SLACK + error, "{context}");
    }
}

#[test]
fn the_clearance_of_moving_strands_is_that_of_all_pairs() {
    for seed in (0..25).chain([1174]) {
        check(seed, 40);
    }
}

#[test]
#[ignore = "takes minutes"]
fn the_clearance_of_many_moving_strands_is_that_of_all_pairs() {
    for seed in 1000..2000 {
        check(seed, 128);
    }
}

#[test]
fn a_radius_that_makes_all_strands_close_is_refused() {
    let mut random = Random::new(5);
    let count = 6000;
    let points: Vec<Point> = (0..3 * count).map(|_| random.point(1.0)).collect();
    let scene = set(Basis::Polyline, &vec![-3; count], &points, false);
    let mut monitor = ClearanceMonitor::new(ClearanceOptions::new(Some(10.0)));
    let why = monitor.measure(&scene, 0).unwrap_err().to_string();
    assert!(why.contains("is the radius too large"), "{why}");
    let why = close_blocks(&scene, &vec![10.0; count]).unwrap_err();
    assert!(why.to_string().contains("is the radius too large"), "{why}");
    assert!(close_blocks(&scene, &[10.0]).is_err());
}

#[test]
fn close_blocks_are_the_parts_of_the_closest_strands() {
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let basis = random.pick(&Basis::ALL);
        let (counts, points) = scene(&mut random, basis);
        let now = set(basis, &counts, &points, false);
        let radii = vec![0.1; counts.len()];
        let [expected, error] = smallest(&now, &now, &radii);
        let blocks = close_blocks(&now, &radii).unwrap();
        let least = blocks.iter().map(|b| b.closest.ratio).fold(REACH, f64::min);
        let errors = blocks.iter().map(|b| b.closest.error).fold(error, f64::max);
        let difference = (least - expected.min(REACH)).abs();
        assert!(
            difference <= errors,
            "seed {seed}: {least}, expected {expected}"
        );
    }
}
