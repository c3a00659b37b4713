//! Streams of frames with constructed pull-throughs, and a measurement of the cost of reference
//! frames.

use super::ledger::tests::planted::{Plant, PlantedStep, planted_step};
use super::reference::{MOST_NEAR, Reference};
use super::{Coverage, Events, Route};
use crate::cancel::Cancel;
use crate::curve::{Basis, CurveSet, Positions};
use crate::engine::{Certifier, Engine, SessionOptions, Strategy};
use crate::error::Error;
use crate::ingest::RawFrame;
use crate::random::Random;
use crate::scenes::{Frames, Motion, Scene};
use crate::verdict::{AbortOn, Report, Verdict};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

/// Number of frames before a planted step, and after it.
const AROUND: u64 = 3;

/// Verifies a stream that is at rest except for one planted step, each frame incrementally and in
/// full.
fn follow(planted: &PlantedStep, events: Events, routes: &mut [u64; 3]) -> Vec<Report> {
    let [mut incremental, mut full] = [Strategy::Paranoid, Strategy::Full].map(|strategy| {
        Engine::new(SessionOptions {
            abort_on: AbortOn::Event,
            strategy,
            events,
            motion_limit: Some(f64::INFINITY),
            ..SessionOptions::default()
        })
        .unwrap()
    });
    let [before, after] = &planted.frames;
    let frames = (0..2 * AROUND).map(|k| if k < AROUND { before } else { after });
    let verify = |(k, set): (usize, &CurveSet)| {
        let report = incremental.step(k as u64, 0.0, set).unwrap();
        let expected = full.step(k as u64, 0.0, set).unwrap();
        assert_eq!(report.events, expected.events);
        assert_eq!(report.verdict, expected.verdict);
        assert!(!incremental.work().disagreed);
        routes[incremental.work().route as usize] += 1;
        incremental.settle();
        report
    };
    frames.enumerate().map(verify).collect()
}

/// A thousand scenes of each kind: pull-throughs are reported in their frame, with curves,
/// segments, sign and moment, and in no other frame.
#[test]
fn reports_planted_pull_throughs_in_their_frame_and_no_others() {
    check_planted(160);
}

#[test]
#[ignore = "takes minutes"]
fn reports_many_planted_pull_throughs_in_their_frame_and_no_others() {
    check_planted(1600);
}

/// Checks this number of steps, a multiple of 4, for each kind of pull-throughs.
fn check_planted(steps: usize) {
    let mut routes = [0; 3];
    for plant in [
        Plant::Single,
        Plant::Cancelling,
        Plant::SelfCrossing,
        Plant::Open,
    ] {
        let mut r = Random::new(2000 + plant as u64);
        let mut done = 0;
        while done < steps {
            let basis = Basis::ALL[done % Basis::ALL.len()];
            let Some(planted) = planted_step(&mut r, basis, plant) else {
                continue;
            };
            done += 1;
            let reports = follow(&planted, Events::All, &mut routes);
            for report in reports {
                let planted_here = report.seq == AROUND;
                let known = if planted_here {
                    &planted.known[..]
                } else {
                    &[]
                };
                let found: Vec<_> = report
                    .events
                    .iter()
                    .map(|e| ([e.i, e.j], e.segments, e.sign))
                    .collect();
                let want: Vec<_> = known
                    .iter()
                    .map(|k| (k.curves, k.segments, k.sign))
                    .collect();
                assert_eq!(found, want, "{plant:?} {basis:?} {done}: {known:?}");
                assert_eq!((report.abort, &report.defects[..]), (planted_here, &[][..]));
                for (e, k) in report.events.iter().zip(known) {
                    assert!((e.fraction - k.fraction).abs() < 0.01, "{e:?} {k:?}");
                }
            }
            // Pull-throughs of different curves are also found if those of single curves are not
            // requested.
            if plant != Plant::SelfCrossing && done % 10 == 0 {
                let reports = follow(&planted, Events::Between, &mut routes);
                assert_eq!(reports[AROUND as usize].events.len(), planted.known.len());
            }
        }
    }
    assert!(
        routes[Route::Quiet as usize] > 10 * steps as u64,
        "{routes:?}"
    );
    assert!(
        10 * routes[Route::Partial as usize] > steps as u64,
        "{routes:?}"
    );
}

/// Receives a frame into a new set.
fn receive(verifier: &mut Engine, set: &CurveSet, xyz: &[f64]) -> crate::error::Result<CurveSet> {
    let mut memory = Some(set.clone());
    let frame = RawFrame {
        basis: set.basis(),
        counts: &set.counts().collect::<Vec<_>>(),
        positions: Positions::F64(xyz),
    };
    verifier.receive(frame, None, &mut memory)?;
    Ok(memory.expect("given"))
}

/// Returns a scene in double precision, and its coordinates.
fn double(scene: &str) -> (CurveSet, Vec<f64>) {
    let scene: Scene = scene.parse().unwrap();
    let set = scene.build().unwrap().curves;
    let positions = set.positions();
    let points = (0..set.points()).flat_map(|k| positions.point(k));
    let xyz: Vec<f64> = points.collect();
    let counts: Vec<i32> = set.counts().collect();
    let double = CurveSet::from_counts(set.basis(), &counts, Positions::F64(&xyz));
    (double.unwrap(), xyz)
}

#[test]
fn a_quiet_frame_needs_no_arrays() {
    let (set, xyz) = double("chainmail:rows=4,columns=4");
    for events in [Events::Off, Events::Between, Events::All] {
        let mut verifier = Engine::new(SessionOptions {
            strategy: Strategy::Incremental,
            events,
            ..SessionOptions::default()
        })
        .unwrap();
        for k in 0..6 {
            let moved: Vec<f64> = xyz.iter().map(|x| x + 0.01 * f64::from(k)).collect();
            let set = Arc::new(receive(&mut verifier, &set, &moved).unwrap());
            verifier.settle();
            let _ = verifier.step_shared(k as u64, 0.0, &set).unwrap();
            let quiet = verifier.work().route == Route::Quiet;
            assert_eq!(quiet, k > 0, "frame {k}");
            assert_eq!(set.has_arrays(), k < 1, "frame {k}");
        }
    }
}

/// A program may ignore the error, and verify the set anyway.
#[test]
fn a_set_after_a_rejected_frame_is_never_intact() {
    let (set, xyz) = double("chainmail:rows=1,columns=2");
    let counts: Vec<i32> = set.counts().collect();
    for bad in [f64::NAN, f64::INFINITY] {
        for at in [0, xyz.len() / 2, xyz.len() - 1] {
            let mut verifier = Engine::new(SessionOptions {
                strategy: Strategy::Incremental,
                events: Events::Between,
                ..SessionOptions::default()
            })
            .unwrap();
            let mut memory = Some(set.clone());
            for k in 0..6 {
                let mut moved = xyz.clone();
                if k > 3 {
                    moved[at] = bad;
                }
                let frame = RawFrame {
                    basis: set.basis(),
                    counts: &counts,
                    positions: Positions::F64(&moved),
                };
                let received = verifier.receive(frame, None, &mut memory);
                assert_eq!(received.is_ok(), k < 4);
                let report = verifier.step(k, 0.0, memory.as_ref().unwrap()).unwrap();
                assert_eq!(report.verdict == Verdict::Intact, k < 4, "{report:?}");
                verifier.settle();
            }
        }
    }
}

/// Frames that are received ahead of the one that is verified, as in a replay. Some are broken, and
/// some are never verified.
#[test]
fn frames_that_are_received_in_advance_have_the_reports_of_full_runs() {
    let (set, _) = double("knit:rows=3,stitches=16,segments=576");
    let mut routes = [0; 3];
    for seed in 0..30 {
        let mut r = Random::new(seed);
        let motion: Motion = r
            .pick(&["smooth+translate", "smooth+rotate", "iid"])
            .parse()
            .unwrap();
        let amplitude = r.pick(&[0.001, 0.02, 0.1, 0.4]);
        let mut frames = Frames::new(&set, 1.0).with_seed(seed);
        let [mut incremental, mut full] = [Strategy::Incremental, Strategy::Full].map(|strategy| {
            Engine::new(SessionOptions {
                strategy,
                events: Events::All,
                ..SessionOptions::default()
            })
            .unwrap()
        });
        let mut waiting = VecDeque::new();
        for frame in 0..40 {
            let Positions::F64(xyz) = frames.at(&motion, amplitude, frame) else {
                unreachable!("the set is in double precision");
            };
            let mut xyz = xyz.to_vec();
            if r.one_in(8) {
                let at = r.below(xyz.len());
                let good = std::mem::replace(&mut xyz[at], f64::NAN);
                let error = receive(&mut incremental, &set, &xyz).unwrap_err();
                assert!(matches!(error, Error::NotFinite { .. }), "{error}");
                xyz[at] = good;
            }
            let received = Arc::new(receive(&mut incremental, &set, &xyz).unwrap());
            if !r.one_in(8) {
                waiting.push_back((frame, received));
            }
            // Up to five frames wait, more than the surveys that are kept.
            while waiting.len() > r.below(6) {
                let (seq, set) = waiting.pop_front().expect("a frame");
                let found = incremental.step_shared(seq, 0.0, &set).unwrap();
                let mut expected = full.step(seq, 0.0, &set).unwrap();
                expected.stats = found.stats;
                assert_eq!(found, expected, "seed {seed}, frame {seq}");
                routes[incremental.work().route as usize] += 1;
                if r.one_in(2) {
                    incremental.settle();
                }
            }
        }
    }
    assert!(routes[Route::Quiet as usize] > 50, "{routes:?}");
    assert!(routes[Route::Partial as usize] > 50, "{routes:?}");
}

/// Run with
/// `cargo test --release --lib incremental::tests::reference_speed -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn reference_speed() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.unwrap();
    for input in [
        "knit",
        "chainmail",
        "glove",
        "knittubeinit",
        "knittubebroken",
    ] {
        let Some(set) = scene_or_model(input) else {
            continue;
        };
        let certificate = Certifier::default().certify(&set).0.clone();
        for all in [false, true] {
            let coverage = Coverage {
                self_crossings: all,
                open_curves: all,
            };
            let mut times = Vec::new();
            let mut allowances = Vec::new();
            for _ in 0..7 {
                let (set, certificate) = (set.clone(), certificate.clone());
                let start = Instant::now();
                let build = || {
                    Reference::build(
                        &set.into(),
                        Arc::new(certificate),
                        0,
                        coverage,
                        None,
                        MOST_NEAR,
                        &Cancel::default(),
                    )
                    .unwrap()
                };
                allowances = pool.install(build).allowances;
                times.push(start.elapsed().as_secs_f64() * 1e3);
            }
            times.sort_by(f64::total_cmp);
            allowances.retain(|a| a.is_finite());
            allowances.sort_by(f32::total_cmp);
            let at = |percent: usize| allowances[(allowances.len() - 1) * percent / 100];
            println!(
                "{input:15} {coverage:?}: {:.1} ms; allowances {:.4} (1 %) {:.4} (10 %) \
                 {:.4} (50 %) {:.4} (90 %)",
                times[3],
                at(1),
                at(10),
                at(50),
                at(90)
            );
        }
    }
}

/// Returns a generated scene, or one of the models if it is available.
fn scene_or_model(name: &str) -> Option<CurveSet> {
    if let Ok(scene) = name.parse::<crate::scenes::Scene>() {
        return Some(scene.build().unwrap().curves);
    }
    let path = format!("../shared/models/{name}.bcc");
    crate::formats::read(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).ok()
}
