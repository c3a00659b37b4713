//! Curves that jump by a lattice vector from one frame to the next, and torn curves.

use crate::invariance::chain;
use crate::scene::{Point, Scene};
use crate::support::random::Random;
use crate::support::session::Step;
use linkwatch::{
    Basis, CurveSet, Events, FrameInfo, Image, Positions, Received, Report, Session,
    SessionOptions, Strategy, Verdict, VerifiedFrame,
};
use std::sync::Arc;

/// Returns the scene with all numbers on a grid, so that no sum of them is rounded.
fn snapped(mut scene: Scene) -> Scene {
    let snap = |x: &mut f64| *x = (1024.0 * *x).round() / 1024.0;
    let cell = &mut scene.cell.vectors;
    let points = scene.curves.iter_mut().flatten();
    points.chain(cell).flatten().for_each(snap);
    scene
}

/// Returns the scene with each curve given by some image of it.
fn reimaged(scene: &Scene, random: &mut Random) -> Scene {
    let mut other = scene.clone();
    let periodic = scene.cell.periodic();
    for curve in &mut other.curves {
        let image: Image = [0, 1, 2].map(|k| match periodic[k] {
            true => random.below(5) - 2,
            false => 0,
        });
        let by = scene.translation(image);
        curve
            .iter_mut()
            .for_each(|p| *p = [0, 1, 2].map(|x| p[x] + by[x]));
    }
    other
}

fn single(set: &CurveSet) -> CurveSet {
    let counts: Vec<i32> = set.counts().collect();
    let points = set.curves().iter().enumerate();
    let points = points.flat_map(|(i, c)| (0..c.points as usize).map(move |k| (i, k)));
    let xyz: Vec<f32> = points
        .flat_map(|(i, k)| set.point(i, k).map(|x| x as f32))
        .collect();
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap()
}

/// Regression test: links were reported as lost if a simulation moved a whole curve back into the
/// cell.
#[test]
fn curves_that_jump_by_a_lattice_vector_are_followed_and_nothing_else_changes() {
    let (mut jumps, mut events, mut changed) = (0, 0, 0);
    // Images that may meet were also forgotten if curves in single precision were converted, and
    // their numbers were then those of other images: seen in small motions.
    for seed in 0..160 {
        let motion = if seed < 80 { 0.5 } else { 0.05 };
        let mut random = Random::from_key([seed, 71]);
        let mut frame = snapped(Scene::random(seed));
        let frames = (0..8).map(|k| {
            frame = snapped(frame.moved(100 * seed + k, motion));
            frame.clone()
        });
        let frames: Vec<Scene> = frames.collect();
        for strategy in [Strategy::Full, Strategy::Incremental, Strategy::Paranoid] {
            // On a grid, curves touch.
            let is_single = seed % 6 == 3 || seed >= 80;
            let new = |wrapped| {
                let mut options = frames[0].options(strategy, Events::Between);
                options.wrapped = wrapped;
                Session::new(options).unwrap()
            };
            // Coarse rings have segments of more than half of the cell.
            let mut whole = new(Some(false));
            let mut jumping = new(None);
            let mut jumped = 0;
            for (seq, frame) in (0..).zip(&frames) {
                let given = match seq {
                    0 => frame.clone(),
                    _ => reimaged(frame, &mut random),
                };
                let given = match is_single {
                    true => single(&given.set()),
                    false => given.set(),
                };
                let received = Received::new(FrameInfo::at(seq, 0.0), Ok(Arc::new(given)));
                let verified = jumping.verify(received).unwrap();
                let found = verified.report;
                if let Some(why) = found.rejected {
                    assert!(why.contains("more than half"), "{why}");
                    break;
                }
                let expected = whole.step(seq, frame.set());
                assert_eq!(expected.jumps, 0);
                let expected = expected.report;
                assert_eq!(found, expected, "{strategy:?}, seed {seed}, frame {seq}");
                assert!(!verified.work.disagreed);
                jumping.settle();
                jumped = verified.jumps;
                events += found.events.len();
                changed += usize::from(found.verdict == Verdict::Changed);
            }
            jumps += jumped;
        }
    }
    assert!(
        jumps > 500 && events > 100 && changed > 100,
        "{jumps} {events} {changed}"
    );
}

/// Two rings in a cell of 12, and what is found if the second one moves along x.
fn moved(by: f64, wrapped: Option<bool>) -> [VerifiedFrame; 3] {
    let mut scene = chain();
    scene.cell = "12,12,12".parse().unwrap();
    let ring = |c: Point, [u, v]: [usize; 2]| {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        corners.map(|[a, b]| {
            let mut p = c;
            p[u] += a;
            p[v] += b;
            p
        })
    };
    let mut options = scene.options(Strategy::Incremental, Events::Between);
    options.cell = Some(scene.cell);
    options.wrapped = wrapped;
    let mut session = Session::new(options).unwrap();
    [(0, 0.0), (1, by), (2, by + 0.01)].map(|(seq, x)| {
        let curves = [ring([0.0; 3], [0, 1]), ring([3.5 + x, 0.1, 0.2], [0, 2])];
        let mut scene = scene.clone();
        scene.curves = curves.map(|c| c.to_vec()).to_vec();
        let set = Arc::new(scene.set());
        let received = Received::new(FrameInfo::at(seq, 0.0), Ok(set));
        session.verify(received).unwrap()
    })
}

/// Returns true if curves passed through one another, also after a long motion.
fn passed(report: &Report) -> bool {
    !report.events.is_empty() || !report.unresolved.is_empty()
}

/// All other moves are as given, so that no true motion is hidden.
#[test]
fn a_motion_is_taken_for_a_jump_only_near_a_whole_lattice_vector() {
    for (by, jumps) in [(12.1, 1), (-12.0, 1), (20.9, 1), (15.9, 1)] {
        let [_, VerifiedFrame { report, .. }, last] = moved(by, None);
        assert_eq!(report.rejected, None);
        assert_eq!(last.jumps, jumps, "{by}");
        // The way to the other ring is 1.5 long.
        let rest = by - 12.0 * (by / 12.0_f64).round();
        assert_eq!(passed(&report), rest < -1.5, "{by}: {report:?}");
        assert_eq!(moved(by, Some(false))[2].jumps, 0);
    }
    for by in [-5.9, 5.9, 6.4, -7.9] {
        for wrapped in [None, Some(false)] {
            let [_, VerifiedFrame { report, .. }, last] = moved(by, wrapped);
            assert_eq!(report.rejected, None);
            assert_eq!(last.jumps, 0, "{by}");
            assert_eq!(passed(&report), by < 0.0, "{by}: {report:?}");
        }
    }
}

/// Regression test: the frame after a rejected jump was intact. It is compared with the last
/// verified frame, so its image is a guess as well.
#[test]
fn the_frame_after_a_guess_is_rejected_too() {
    for frame in &moved(6.4, Some(true))[1..] {
        let why = frame.report.rejected.as_ref().unwrap();
        assert!(why.contains("so its image is a guess"), "{why}");
        assert_eq!(frame.report.last_intact, Some(0));
    }
}

/// Regression test: outside of `check`, torn curves were verified as given, with links that
/// appeared and disappeared.
#[test]
fn curves_that_the_boundary_tears_are_refused_unless_they_are_unwrapped() {
    for strategy in [Strategy::Full, Strategy::Incremental] {
        for (wrapped, drifts) in [(None, false), (None, true), (Some(true), true)] {
            let scene = chain();
            let mut options = scene.options(strategy, Events::Between);
            options.wrapped = wrapped;
            let mut session = Session::new(options).unwrap();
            let mut refused = 0;
            for seq in 0..60 {
                let mut frame = scene.clone();
                let edges = [0, 1, 2].map(|x| frame.cell.vectors[x][x]);
                for p in frame.curves.iter_mut().flatten() {
                    p[0] += if drifts { 0.1 * seq as f64 } else { 0.0 };
                    (p[1], p[2]) = (p[1] + 1.5, p[2] + 1.5);
                    *p = [0, 1, 2].map(|x| p[x].rem_euclid(edges[x]));
                }
                let report = session.feed(FrameInfo::at(seq, 0.0), frame.set()).unwrap();
                match report.rejected {
                    None => assert_eq!(report.verdict, Verdict::Intact),
                    Some(why) => {
                        let says = "pass the option `wrapped` if coordinates are wrapped";
                        assert!(why.contains(says), "{why}");
                        refused += 1;
                    }
                }
                session.settle();
            }
            assert_eq!(refused > 0, wrapped.is_none(), "{strategy:?}: {refused}");
        }
    }
}

/// A ring of radius 1 in the plane of two axes.
fn ring(center: Point, [u, v]: [usize; 2], n: usize) -> Vec<Point> {
    let point = |k: usize| {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / n as f64).sin_cos();
        let mut p = center;
        p[u] += cos;
        p[v] += sin;
        p
    };
    (0..n).map(point).collect()
}

/// Curves in a cell of 10, all closed but the first `open` ones.
fn curves(curves: &[Vec<Point>], open: usize) -> CurveSet {
    let sign = |i: usize| if i < open { 1 } else { -1 };
    let counts = curves.iter().enumerate();
    let counts: Vec<i32> = counts.map(|(i, c)| sign(i) * c.len() as i32).collect();
    let xyz = curves.concat();
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(xyz.as_flattened())).unwrap()
}

fn new_session(strategy: Strategy, events: Events) -> Session {
    let options = SessionOptions {
        cell: Some("10,10,10".parse().unwrap()),
        strategy,
        events,
        ..SessionOptions::default()
    };
    Session::new(options).unwrap()
}

/// Regression test: the images kept the points of the previous frame, and a lost link was not
/// found.
#[test]
fn curves_of_other_sizes_are_verified_with_their_images() {
    for strategy in [Strategy::Full, Strategy::Incremental] {
        for sizes in [[27, 13], [20, 20], [30, 24], [12, 9]] {
            let mut session = new_session(strategy, Events::Off);
            // Linked through the boundary at x = 10.
            let pair = |[a, b]: [usize; 2], y: f64| {
                let first = ring([9.5, 5.0, 5.0], [0, 1], a);
                curves(&[first, ring([0.5, y, 5.0], [0, 2], b)], 0)
            };
            let frames = [([24, 16], 5.0), (sizes, 5.0), ([24, 16], 8.0), (sizes, 8.0)];
            let expected = [
                Verdict::Intact,
                Verdict::Intact,
                Verdict::Changed,
                Verdict::Changed,
            ];
            for ((seq, (sizes, y)), expected) in (0..).zip(frames).zip(expected) {
                let set = Arc::new(pair(sizes, y));
                let report = session.step(seq, &set).report;
                assert_eq!(
                    report.verdict, expected,
                    "{strategy:?} {sizes:?}: {report:?}"
                );
                assert!(report.defects.is_empty());
            }
        }
    }
}

/// Regression test: in the frame after a rejected one, a jump was reported as a lost link.
#[test]
fn a_jump_is_followed_across_a_rejected_frame() {
    for events in [Events::Off, Events::Between] {
        let mut session = new_session(Strategy::Incremental, events);
        let [a, b] = [(5.0, [0, 1]), (6.0, [0, 2])].map(|(x, axes)| ring([x, 5.0, 5.0], axes, 16));
        let jumped: Vec<Point> = b.iter().map(|p| [p[0], p[1] - 10.0, p[2]]).collect();
        let first = Arc::new(curves(&[a.clone(), b.clone()], 0));
        let report = session.step(0, &first).report;
        assert_eq!(report.verdict, Verdict::Intact);
        for other in [
            vec![a.clone()],
            vec![a.clone(), b[..12].to_vec(), b.clone()],
        ] {
            let other = Arc::new(curves(&other, 0));
            let report = session.feed(FrameInfo::at(1, 0.0), &other).unwrap();
            assert_eq!(report.verdict, Verdict::Rejected);
        }
        let last = Arc::new(curves(&[a, jumped], 0));
        let VerifiedFrame { report, jumps, .. } = session.step(2, &last);
        assert_eq!(report.verdict, Verdict::Intact, "{report:?}");
        assert_eq!((report.events.len(), jumps), (0, 1));
    }
}

/// Regression test: translated curves have double precision, whose tolerance for the end of a yarn
/// is smaller than the rounding errors of single precision.
#[test]
fn a_yarn_in_single_precision_stays_one_after_a_jump() {
    for jumps in [0, 1] {
        let mut session = new_session(Strategy::Incremental, Events::Between);
        let yarn: Vec<Point> = (0..=20)
            .map(|k| [0.1 + 0.5 * f64::from(k), 5.0, 5.0])
            .collect();
        let around = ring([3.0, 5.0, 5.0], [1, 2], 16);
        for seq in 0..4_u64 {
            let mut frame = [yarn.clone(), around.clone()];
            let moved = frame[jumps].iter_mut().filter(|_| seq >= 2);
            moved.for_each(|p| p[1] += 10.0);
            let set = Arc::new(single(&curves(&frame, 1)));
            let VerifiedFrame { report, jumps, .. } = session.step(seq, &set);
            assert_eq!(report.verdict, Verdict::Intact, "{report:?}");
            assert_eq!(report.stats.open_curves, 0);
            assert_eq!(jumps, u64::from(seq >= 2));
        }
        assert_eq!(session.baseline().unwrap().periods(), [(0, [1, 0, 0])]);
    }
}

/// Regression test: after a cut, a curve that had jumped kept its translation, and an intact frame
/// was changed; wrapped coordinates were rejected, because the curves had moved too far.
#[test]
fn the_frame_after_a_cut_may_have_any_images_of_its_curves() {
    let mut verdicts = [0; 3];
    for seed in 0..60 {
        let mut random = Random::from_key([seed, 72]);
        let first = snapped(Scene::random(seed));
        for strategy in [Strategy::Full, Strategy::Incremental, Strategy::Paranoid] {
            let options = first.options(strategy, Events::Between);
            let mut session = Session::new(options.clone()).unwrap();
            let verify = |session: &mut Session, seq: u64, scene: &Scene| {
                let received = Received::new(FrameInfo::at(seq, 0.0), Ok(Arc::new(scene.set())));
                session.verify(received).unwrap().report
            };
            if verify(&mut session, 0, &first).rejected.is_some() {
                continue;
            }
            let baseline = session.baseline().unwrap().clone();
            // A pair without a number gets one in a later frame.
            if !baseline.undefined().is_empty() {
                continue;
            }
            for k in 0..4 {
                let mut fresh = Session::new(SessionOptions {
                    baseline: Some(baseline.clone()),
                    ..options.clone()
                });
                session.cut();
                let mut frame = snapped(first.moved(100 * seed + k, 0.2 * k as f64));
                for step in 0..2 {
                    let given = reimaged(&frame, &mut random);
                    let seq = 1 + 2 * k + step;
                    let found = verify(&mut session, seq, &given);
                    let fresh = fresh.as_mut().unwrap();
                    let expected = verify(fresh, seq, &given);
                    assert_eq!(
                        found.verdict, expected.verdict,
                        "seed {seed}, frame {seq}: {found:?}, {expected:?}"
                    );
                    verdicts[match found.verdict {
                        Verdict::Intact => 0,
                        Verdict::Changed => 1,
                        _ => 2,
                    }] += 1;
                    session.settle();
                    frame = snapped(frame.moved(7, 0.01));
                }
            }
        }
    }
    assert!(verdicts[0] > 200 && verdicts[1] > 200, "{verdicts:?}");
    // A pair that drifts, so that one ring jumps, and is rolled back by more than a third.
    for wrapped in [None, Some(true)] {
        let mut options = SessionOptions {
            cell: Some("10,10,10".parse().unwrap()),
            ..SessionOptions::default()
        };
        options.wrapped = wrapped;
        let mut session = Session::new(options).unwrap();
        for (seq, x) in (0..).zip([6.0, 7.0, 8.0, 9.0, 9.5, 9.8, 6.2, 6.5, 7.0]) {
            if seq == 6 {
                session.cut();
            }
            let in_cell = |x: f64| x.rem_euclid(10.0);
            let [a, b] = [(x, [0, 1]), (x + 0.3, [0, 2])]
                .map(|(x, axes)| ring([in_cell(x), 5.0, 5.0], axes, 16));
            let report = session.step(seq, Arc::new(curves(&[a, b], 0))).report;
            assert_eq!(
                report.verdict,
                Verdict::Intact,
                "{wrapped:?}, {x}: {report:?}"
            );
        }
    }
}
