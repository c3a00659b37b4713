//! Properties that do not depend on how a periodic scene is described.

use crate::scene::{Point, Scene};
use crate::support::random::Random;
use crate::support::session::Step;
use linkwatch::{
    Certificate, Events, FrameInfo, Image, Session, SessionOptions, Strategy, Verdict,
};
use std::sync::Arc;

/// Moves each curve by a lattice vector.
fn renamed(scene: &Scene, seed: u64) -> Scene {
    let mut random = Random::from_key([seed, 24]);
    let mut moved = scene.clone();
    for curve in &mut moved.curves {
        let image: Image = [0; 3].map(|_| random.below(7) - 3);
        let by = scene.translation(image);
        for p in curve {
            *p = [0, 1, 2].map(|x| p[x] + by[x]);
        }
    }
    moved
}

/// Returns true if a translation by a lattice vector rounds no coordinate.
fn is_on_grid(scene: &Scene) -> bool {
    let numbers = scene.curves.as_slice().concat().concat();
    let vectors = scene.cell.vectors.as_flattened();
    let fraction = |x: &f64| (64.0 * x).fract() == 0.0;
    numbers.iter().all(fraction) && vectors.iter().all(fraction)
}

#[test]
fn moving_a_curve_by_a_lattice_vector_changes_nothing() {
    let mut equal = 0;
    for seed in 0..200 {
        let scene = Scene::random(seed);
        let moved = renamed(&scene, seed);
        // Curves that touch may no longer touch after rounding.
        let [before, after] = [&scene, &moved].map(Scene::certificate);
        if is_on_grid(&scene) || before.undefined().is_empty() {
            assert_eq!(after.to_string(), before.to_string(), "seed {seed}");
            assert!(after.compare(&before).unwrap().changes.is_empty());
            equal += 1;
        }
    }
    assert!(equal > 150, "{equal}");
}

#[test]
fn a_baseline_of_other_images_is_intact() {
    for seed in 0..60 {
        let scene = Scene::random(2 * seed + 1);
        let mut options = scene.options(Strategy::Incremental, Events::Between);
        options.baseline = Some(scene.certificate());
        let moved = Arc::new(renamed(&scene, seed).set());
        let mut session = Session::new(options).unwrap();
        for seq in 0..3 {
            let report = session.step(seq, &moved).report;
            assert_eq!(report.verdict, Verdict::Intact, "seed {seed}: {report:?}");
        }
    }
}

/// Regression test: a refused first frame replaced the given baseline.
#[test]
fn a_refused_first_frame_does_not_replace_the_baseline() {
    let scene = chain();
    let mut options = scene.options(Strategy::Full, Events::Off);
    options.baseline = Some(scene.certificate());
    options.max_pairs = 1;
    let mut session = Session::new(options).unwrap();
    for seq in 0..2 {
        let report = session.feed(FrameInfo::at(seq, 0.0), scene.set()).unwrap();
        assert_eq!(report.verdict, Verdict::Rejected);
    }
    let mut options = scene.options(Strategy::Full, Events::Off);
    options.baseline = Some(Certificate::parse("4\n0,1,1\n").unwrap());
    let mut session = Session::new(options).unwrap();
    for seq in 0..2 {
        let report = session.feed(FrameInfo::at(seq, 0.0), scene.set()).unwrap();
        let why = report.rejected.unwrap();
        assert!(
            why.contains("not of a periodic scene"),
            "frame {seq}: {why}"
        );
    }
}

/// Another basis of the same lattice: the second vector is replaced by its sum with the first one.
#[test]
fn another_basis_of_the_lattice_has_the_same_linking_numbers() {
    let mut linked = 0;
    for seed in 0..400 {
        let scene = Scene::random(seed);
        if scene.cell.periodic() != [true; 3] || !is_on_grid(&scene) {
            continue;
        }
        let mut other = scene.clone();
        let [a, b, c] = scene.cell.vectors;
        other.cell.vectors = [a, [0, 1, 2].map(|x| a[x] + b[x]), c];
        other.cell.origin = [1.0, -2.0, 0.5];
        let [one, two] = [&scene, &other].map(Scene::certificate);
        // n1 a + n2 b = (n1 - n2) a + n2 (a + b)
        let rename = |[n1, n2, n3]: Image| [n1 - n2, n2, n3];
        let mut expected = Vec::new();
        for l in one.images().into_iter().flatten() {
            let image = rename(l.image);
            let backward = l.i == l.j && image < Image::default();
            let image = if backward { image.map(|n| -n) } else { image };
            expected.push((l.i, l.j, image, l.lambda));
        }
        expected.sort_unstable();
        let found = two.images().into_iter().flatten();
        let mut found: Vec<_> = found.map(|l| (l.i, l.j, l.image, l.lambda)).collect();
        found.sort_unstable();
        assert_eq!(found, expected, "seed {seed}");
        linked += found.len();
    }
    assert!(linked > 100, "{linked}");
}

#[test]
fn permuting_the_axes_changes_no_linking_number() {
    for seed in 0..120 {
        let scene = Scene::random(seed);
        let turn = |p: &Point| [p[1], p[2], p[0]];
        let mut other = scene.clone();
        other.curves.iter_mut().flatten().for_each(|p| *p = turn(p));
        // The vectors keep their order.
        other.cell.vectors = scene.cell.vectors.each_ref().map(turn);
        let [one, two] = [&scene, &other].map(Scene::certificate);
        assert_eq!(one.links(), two.links(), "seed {seed}");
        assert_eq!(one.images(), two.images(), "seed {seed}");
        let pairs = |c: &linkwatch::Certificate| -> Vec<_> {
            c.undefined().iter().map(|d| (d.i, d.j, d.image)).collect()
        };
        assert_eq!(pairs(&one), pairs(&two), "seed {seed}");
    }
}

/// A cell of twice the length contains two copies of each curve, so each entry occurs twice.
#[test]
fn doubling_the_cell_doubles_every_linking_number() {
    for seed in 0..120 {
        let scene = Scene::random(seed);
        let Some(k) = (0..3).find(|&k| scene.cell.periodic()[k]) else {
            continue;
        };
        let mut image = Image::default();
        image[k] = 1;
        let by = scene.translation(image);
        let copy = |c: &Vec<Point>| c.iter().map(|p| [0, 1, 2].map(|x| p[x] + by[x])).collect();
        let mut double = scene.clone();
        double.curves.extend(scene.curves.iter().map(copy));
        double.cell.vectors[k] = scene.cell.vectors[k].map(|x| 2.0 * x);
        let [one, two] = [&scene, &double].map(Scene::certificate);
        if !is_on_grid(&scene) && !one.undefined().is_empty() {
            continue;
        }
        let total = |c: &linkwatch::Certificate| {
            let images = c.images().unwrap();
            let numbers = images.iter().map(|l| l.lambda);
            let touching = c.undefined().iter().filter(|d| d.j.is_some()).count();
            let all = c.links().iter().map(|l| l.lambda).chain(numbers);
            (
                all.map(|l| [l, l.abs()])
                    .fold([0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]),
                touching,
            )
        };
        let ([sum, size], touching) = total(&one);
        let (doubled, touch_twice) = total(&two);
        assert_eq!(doubled, [2 * sum, 2 * size], "seed {seed}");
        assert_eq!(touch_twice, 2 * touching, "seed {seed}");
    }
}

/// A chain of linked rings drifts through several cells, in unwrapped coordinates: no frame differs
/// from the first one, and nothing passes through anything.
#[test]
fn curves_that_drift_across_the_boundary_stay_intact() {
    for strategy in [Strategy::Full, Strategy::Incremental, Strategy::Paranoid] {
        let scene = chain();
        let mut session = Session::new(scene.options(strategy, Events::Between)).unwrap();
        for seq in 0..120_u32 {
            let mut frame = scene.clone();
            for (k, curve) in frame.curves.iter_mut().enumerate() {
                // The rings also wiggle a little.
                let wiggle = 0.02 * (f64::from(seq) * (1.0 + k as f64)).sin();
                for p in curve {
                    p[0] += 0.11 * f64::from(seq) + wiggle;
                    p[1] -= 0.07 * f64::from(seq);
                }
            }
            let set = Arc::new(frame.set());
            let verified = session.step(seq.into(), &set);
            let report = verified.report;
            assert_eq!(report.verdict, Verdict::Intact, "frame {seq}: {report:?}");
            assert!(!verified.work.disagreed);
            if seq == 0 {
                let images = session.baseline().unwrap().images().unwrap();
                assert_eq!(
                    images.len(),
                    1,
                    "the last ring is linked with an image of the first"
                );
            }
        }
    }
}

/// The cell is sheared and grows, and the curves deform with it. No frame differs from the first
/// one, until one ring is pulled out across the boundary.
#[test]
fn a_cell_that_changes_from_frame_to_frame_keeps_its_topology() {
    for strategy in [Strategy::Full, Strategy::Incremental, Strategy::Paranoid] {
        let scene = chain();
        let options = SessionOptions {
            cell: None,
            ..scene.options(strategy, Events::Between)
        };
        let mut session = Session::new(options).unwrap();
        for seq in 0..60_u32 {
            let t = 0.02 * f64::from(seq);
            let deformed = |p: &Point| {
                [
                    p[0] * (1.0 + 0.3 * t) + t * p[1],
                    p[1],
                    p[2] - 0.2 * t * p[0],
                ]
            };
            let mut frame = scene.clone();
            frame.cell.vectors = scene.cell.vectors.each_ref().map(deformed);
            frame
                .curves
                .iter_mut()
                .flatten()
                .for_each(|p| *p = deformed(p));
            let broken = seq == 59;
            if broken {
                // The last ring leaves the image of the first one.
                frame.curves[3].iter_mut().for_each(|p| p[2] += 1.4);
            }
            let info = FrameInfo::at(seq.into(), 0.0).in_cell(frame.cell);
            let verified = session.step_at(info, frame.set());
            let report = verified.report;
            let expected = if broken {
                Verdict::Changed
            } else {
                Verdict::Intact
            };
            assert_eq!(report.verdict, expected, "frame {seq}: {report:?}");
            assert!(!verified.work.disagreed);
            if broken {
                let changes = report.changes.iter();
                let changed: Vec<_> = changes.map(|c| (c.i, c.j, c.image)).collect();
                assert_eq!(changed, [(0, 3, [-1, 0, 0]), (2, 3, [0; 3])]);
                assert_eq!(
                    report.events.iter().map(|e| e.sign).sum::<i32>().abs() % 2,
                    0
                );
                assert!(report.events.iter().any(|e| e.image == [-1, 0, 0]));
            }
        }
    }
}

#[test]
fn a_cell_of_another_kind_or_none_is_refused() {
    let scene = chain();
    let refused = |cells: [Option<&str>; 2]| {
        let mut session = Session::new(SessionOptions::default()).unwrap();
        let info = |seq: u64, cell: Option<&str>| FrameInfo {
            cell: cell.map(|cell| cell.parse().unwrap()),
            ..FrameInfo::at(seq, 0.0)
        };
        session.step_at(info(0, cells[0]), scene.set());
        let report = session.feed(info(1, cells[1]), scene.set()).unwrap();
        report.rejected.unwrap()
    };
    let why = refused([Some("4,3,3"), Some("4,3,0")]);
    assert!(why.contains("other vectors"), "{why}");
    let why = refused([None, Some("4,3,3")]);
    assert!(why.contains("the previous ones had none"), "{why}");
    let why = refused([Some("4,3,3"), None]);
    assert!(why.contains("the previous ones had one"), "{why}");
    // Before the first frame, a cell makes the session periodic.
    let mut fresh = Session::new(SessionOptions::default()).unwrap();
    fresh.step_at(FrameInfo::at(0, 0.0).in_cell(scene.cell), scene.set());
    assert_eq!(
        fresh.baseline().unwrap().images().as_ref().unwrap().len(),
        1
    );
}

/// A chain along x that closes up across the boundary: four rings in a cell of length 4.
pub fn chain() -> Scene {
    let ring = |x: f64, upright: bool| -> Vec<Point> {
        let point = |k: i32| {
            let (s, c) = (std::f64::consts::TAU * f64::from(k) / 12.0 + 0.1).sin_cos();
            match upright {
                true => [x + 0.7 * c, 0.0, 0.5 * s],
                false => [x + 0.7 * c, 0.5 * s, 0.0],
            }
        };
        (0..12).map(point).collect()
    };
    Scene {
        cell: "4,3,3".parse().unwrap(),
        curves: (0..4).map(|k| ring(f64::from(k), k % 2 == 0)).collect(),
        closed: true,
        reach: 2,
    }
}
