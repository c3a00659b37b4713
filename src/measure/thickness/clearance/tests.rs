//! The monitor against a comparison of all pairs of segments in every frame.

use super::*;
use crate::curve::vector::{add, distance, norm, per_axis, sub};
use crate::curve::{Basis, Point, Positions, is_home};
use crate::measure::thickness::splines::deviation;
use crate::pairs::nearest;
use crate::periodic::images_in;
use crate::random::Random;
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Number of chords of a spline segment in the oracle.
const CHORDS: usize = 16;

/// Returns all images, one of each two opposite ones, in which strands may be within a
/// distance.
fn images(set: &CurveSet, cell: Option<&Cell>, distance: f64) -> Vec<Image> {
    let Some(cell) = cell else {
        return vec![Image::default()];
    };
    let positions = set.positions();
    let points = || (0..positions.len() / 3).map(|k| positions.point(k));
    let most = cell.inverse().unwrap().map(|b| {
        let along = |p: Point| b[0] * p[0] + b[1] * p[1] + b[2] * p[2];
        let lo = points().map(along).fold(f64::INFINITY, f64::min);
        let hi = points().map(along).fold(f64::NEG_INFINITY, f64::max);
        // Splines leave the box of their control points by a sixth.
        (1.4 * (hi - lo) + norm(b) * distance).ceil() as i32
    });
    let range = |x: usize| if cell.periodic()[x] { most[x] } else { 0 };
    let all = images_in(per_axis(|x| -range(x)..=range(x)));
    all.filter(|image| *image >= Image::default()).collect()
}

/// Returns the smallest distance of two strands, as a share of the sum of their radii, by a
/// comparison of all pairs of segments and images, and its error. `first` is the set whose lengths
/// separate the strands of a curve, in its cell.
fn smallest(
    (set, cell): (&CurveSet, Option<&Cell>),
    (first, first_cell): (&CurveSet, Option<&Cell>),
    radii: &[f64],
) -> [f64; 2] {
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
    let mut periods: Vec<Image> = Vec::new();
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
        let period = first_cell.and_then(|cell| period(first, i, cell));
        periods.push(period.unwrap_or_default());
    }
    let mut least = f64::INFINITY;
    let largest = radii.iter().fold(0.0, |m: f64, r| m.max(*r));
    for image in images(set, cell, 2.0 * REACH * largest) {
        let by = cell.map_or([0.0; 3], |cell| cell.translation(image));
        let later: Vec<Option<i32>> = periods
            .iter()
            .map(|period| (-9..=9).find(|k| image == period.map(|n| n * k)))
            .collect();
        for (k, a) in all.iter().enumerate() {
            let others = if is_home(&image) { &all[k + 1..] } else { &all };
            for b in others {
                let sum = radii[a.curve] + radii[b.curve];
                let from = add(b.ends[0], by);
                let [d, e] = [a, b].map(|c| sub(c.ends[1], c.ends[0]));
                let apart = distance(a.ends[0], from);
                if apart > 1.01 * (least * sum + norm(d) + norm(e)) {
                    continue;
                }
                if let Some(later) = later[a.curve].filter(|_| a.curve == b.curve) {
                    let curve = set.curve(a.curve);
                    let arcs = &starts[a.curve];
                    let (s, t) = (a.segment as usize, b.segment as usize);
                    let length = arcs.last().unwrap();
                    let along = if is_home(&image) {
                        let forward = arcs[t] - arcs[s + 1];
                        let around = arcs[s] + length - arcs[t + 1];
                        if curve.closed {
                            forward.min(around)
                        } else {
                            forward
                        }
                    } else {
                        let by = f64::from(later) * length;
                        (arcs[t] + by - arcs[s + 1]).max(arcs[s] - arcs[t + 1] - by)
                    };
                    let adjacent = is_home(&image) && curve.adjacent(a.segment, b.segment);
                    if adjacent || along < PI * radii[a.curve] {
                        continue;
                    }
                }
                let near = nearest([a.ends[0], d], [from, e]);
                least = least.min(near.distance_sq.sqrt() / sum);
            }
        }
    }
    match set.basis().is_polyline() {
        true => [least, 1e-9],
        false => [least, error + 1e-9],
    }
}

/// A cell that changes from frame to frame.
struct MovingCell {
    cell: Cell,
    /// Change of each vector in a frame.
    speed: [Point; 3],
    /// True if the points move with the cell.
    is_affine: bool,
}

impl MovingCell {
    fn new(random: &mut Random) -> MovingCell {
        let cells = [
            "3,3,3",
            "2,0,0",
            "4,1.5,0",
            "0,0,1",
            "3,0,0,1,3,0,-1,0.5,4",
            "6,6,6",
        ];
        MovingCell {
            cell: random.pick(&cells).parse::<Cell>().unwrap(),
            speed: [[0.0; 3]; 3],
            is_affine: false,
        }
    }

    /// Chooses another motion.
    fn turn(&mut self, random: &mut Random) {
        let size = random.pick(&[0.0, 0.0, 1e-4, 1e-3, 1e-2, 0.05]);
        self.is_affine = random.one_in(2);
        self.speed = self.cell.periodic().map(|periodic| match periodic {
            true => random.point(size),
            false => [0.0; 3],
        });
    }

    /// Moves the cell, and the points if they follow.
    fn step(&mut self, points: &mut [Point]) {
        let before = self.cell;
        for (v, by) in self.cell.vectors.iter_mut().zip(self.speed) {
            *v = add(*v, by);
        }
        if self.cell.check().is_err() {
            self.cell = before;
        }
        if self.is_affine {
            let (inverse, basis) = (before.inverse().unwrap(), self.cell.basis().unwrap());
            for p in points {
                let u = inverse.map(|b| b[0] * p[0] + b[1] * p[1] + b[2] * p[2]);
                *p = per_axis(|x| (0..3).map(|k| u[k] * basis[k][x]).sum());
            }
        }
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
    /// All points change places at random.
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
            points.push(per_axis(|x| center[x] + c * u[x] + s * v[x] + drift));
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

fn check(seed: u64, frames: u64, in_cell: bool) {
    let mut random = Random::new(seed);
    let basis = match in_cell && !random.one_in(4) {
        true => Basis::Polyline,
        false => random.pick(&Basis::ALL),
    };
    let single = random.one_in(2);
    let (mut counts, mut points) = scene(&mut random, basis);
    let mut cell = in_cell.then(|| MovingCell::new(&mut random));
    // The last curve runs through the cell.
    let period = match &cell {
        Some(cell) if basis.is_polyline() && random.one_in(2) => {
            let n = counts.last_mut().unwrap();
            *n = n.abs();
            per_axis(|x| i32::from(cell.cell.periodic()[x]))
        }
        _ => Image::default(),
    };
    let radii: Vec<f32> = counts
        .iter()
        .map(|_| random.between(0.02, 0.2) as f32)
        .collect();
    let wide: Vec<f64> = radii.iter().map(|&r| r.into()).collect();
    let mut options = ClearanceOptions::new(None);
    options.low = random.between(0.2, 1.0);
    let mut monitor = ClearanceMonitor::new(options);
    monitor.set_radii(&radii).unwrap();
    let mut first: Option<(CurveSet, Option<Cell>)> = None;
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
            if let Some(cell) = &mut cell {
                cell.turn(&mut random);
            }
        }
        if let Some(cell) = &mut cell {
            cell.step(&mut points);
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
        let cell = cell.as_ref().map(|cell| cell.cell);
        if period != Image::default() {
            let start = points.len() - *counts.last().unwrap() as usize;
            let by = cell.unwrap().translation(period);
            *points.last_mut().unwrap() = add(points[start], by);
        }
        let now = set(basis, &counts, &points, single);
        let found = monitor.measure(&now, cell.as_ref(), seq).unwrap();
        let first = first.get_or_insert_with(|| (now.clone(), cell));
        let first = (&first.0, first.1.as_ref());
        let [expected, oracle] = smallest((&now, cell.as_ref()), first, &wide);
        let context = format!("seed {seed}, frame {seq}, {motion:?}: {expected} of {found:?}");
        if let Some(closest) = &found.closest {
            let [p, q] = closest.points;
            assert!(
                (distance(p, q) - closest.distance).abs() < 1e-9,
                "{context}"
            );
            assert!(cell.is_some() || is_home(&closest.image), "{context}");
        }
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
    for seed in (0..8).chain([1174]) {
        check(seed, 40, false);
    }
}

#[test]
fn the_clearance_in_a_cell_is_that_of_all_pairs_and_images() {
    for seed in 0..6 {
        check(seed, 24, true);
    }
}

#[test]
#[ignore = "takes minutes"]
fn the_clearance_in_many_cells_is_that_of_all_pairs_and_images() {
    for seed in 1000..2000 {
        check(seed, 64, true);
    }
}

/// Rings of radius 1, 2.2 apart, in a cubic cell.
fn lattice_of_rings(shift: f64) -> CurveSet {
    let mut points = Vec::new();
    for k in 0..27_i32 {
        let center = [k % 3, k / 3 % 3, k / 9].map(|n| 2.2 * f64::from(n) + shift);
        points.extend((0..16).map(|m| {
            let (y, x) = (TAU * f64::from(m) / 16.0).sin_cos();
            add(center, [x, y, 0.0])
        }));
    }
    set(Basis::Polyline, &[-16; 27], &points, false)
}

/// Frames in which little moves, including the cell, need no new list of pairs.
#[test]
fn quiet_frames_in_a_cell_keep_the_list_of_pairs() {
    for shear in [0.0, 1e-4] {
        let mut monitor = ClearanceMonitor::new(ClearanceOptions::new(Some(0.1)));
        for seq in 0..40_u32 {
            let cell = Cell {
                origin: [0.0; 3],
                vectors: [
                    [6.6, 0.0, 0.0],
                    [shear * f64::from(seq), 6.6, 0.0],
                    [0.0, 0.0, 6.6],
                ],
            };
            let rings = lattice_of_rings(1e-4 * f64::from(seq));
            let found = monitor.measure(&rings, Some(&cell), seq.into()).unwrap();
            assert!(
                (found.closest.unwrap().ratio - 1.0).abs() < 0.1,
                "{found:?}"
            );
        }
        assert_eq!(monitor.ages[0], 39, "{shear}");
    }
}

/// The closest strands are a curve and an image. A frame in which only the cell changes is not
/// treated as quiet.
#[test]
fn a_cell_that_shrinks_brings_images_together() {
    let ring = lattice_of_rings(0.0);
    let mut monitor = ClearanceMonitor::new(ClearanceOptions::new(Some(0.1)));
    let mut low = None;
    for seq in 0..36_u32 {
        let edge = 6.6 - 0.005 * f64::from(seq);
        let cell = Cell::orthogonal([0.0; 3], [edge, 6.6, 6.6]);
        let found = monitor.measure(&ring, Some(&cell), seq.into()).unwrap();
        let expected = (edge - 6.4) / 0.2;
        let ratio = found.closest.map_or(REACH, |c| c.ratio);
        assert!(found.at_least <= expected + 1e-6, "{seq}: {found:?}");
        if found.low {
            assert!((ratio - expected).abs() < 1e-9, "{seq}: {found:?}");
            assert_ne!(found.closest.unwrap().image, Image::default());
            low.get_or_insert(seq);
        }
    }
    // At half a diameter, up to rounding.
    assert!(matches!(low, Some(20 | 21)), "{low:?}");
}

#[test]
#[ignore = "takes minutes"]
fn the_clearance_of_many_moving_strands_is_that_of_all_pairs() {
    for seed in 1000..2000 {
        check(seed, 128, false);
    }
}

/// Displacements of such coordinates may be NaN, which bounds of the motion would ignore.
#[test]
fn a_later_frame_with_coordinates_that_are_too_large_is_refused() {
    let ring = lattice_of_rings(0.0);
    let counts: Vec<i32> = ring.counts().collect();
    let mut xyz: Vec<f64> = (0..ring.len())
        .flat_map(|i| ring.points_in(i))
        .flatten()
        .collect();
    xyz[0] = 1e200;
    let far = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap();
    let mut monitor = ClearanceMonitor::new(ClearanceOptions::new(Some(0.1)));
    for seq in 0..3 {
        let _ = monitor.measure(&ring, None, seq).unwrap();
    }
    let refused = monitor.measure(&far, None, 3).unwrap_err().to_string();
    assert!(refused.contains("coordinates above 1e30"), "{refused}");
}

#[test]
fn a_radius_that_makes_all_strands_close_is_refused() {
    let mut random = Random::new(5);
    let count = 6000;
    let points: Vec<Point> = (0..3 * count).map(|_| random.point(1.0)).collect();
    let scene = set(Basis::Polyline, &vec![-3; count], &points, false);
    let mut monitor = ClearanceMonitor::new(ClearanceOptions::new(Some(10.0)));
    let why = monitor.measure(&scene, None, 0).unwrap_err().to_string();
    assert!(why.contains("is the radius too large"), "{why}");
    let why = close_blocks(&scene, None, &vec![10.0; count], REACH).unwrap_err();
    assert!(why.to_string().contains("is the radius too large"), "{why}");
    assert!(close_blocks(&scene, None, &[10.0], REACH).is_err());
}

#[test]
fn close_blocks_are_the_parts_of_the_closest_strands() {
    check_close_blocks(0..8);
}

#[test]
#[ignore = "takes minutes"]
fn close_blocks_of_many_scenes_are_the_parts_of_the_closest_strands() {
    check_close_blocks(1000..1200);
}

fn check_close_blocks(seeds: Range<u64>) {
    for seed in seeds {
        let mut random = Random::new(seed);
        let cell = random.one_in(2).then(|| MovingCell::new(&mut random).cell);
        let basis = random.pick(&Basis::ALL);
        let (counts, points) = scene(&mut random, basis);
        let now = set(basis, &counts, &points, false);
        let radii = vec![0.1; counts.len()];
        let now_in = (&now, cell.as_ref());
        let [expected, error] = smallest(now_in, now_in, &radii);
        let blocks = close_blocks(&now, cell.as_ref(), &radii, REACH).unwrap();
        let least = blocks.iter().map(|b| b.closest.ratio).fold(REACH, f64::min);
        let errors = blocks.iter().map(|b| b.closest.error).fold(error, f64::max);
        let difference = (least - expected.min(REACH)).abs();
        assert!(
            difference <= errors,
            "seed {seed}: {least}, expected {expected}"
        );
    }
}
