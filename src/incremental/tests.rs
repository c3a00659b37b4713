//! Tests with pull-throughs planted into the frames of a stream, and a measurement of the cost of
//! references.

use super::ledger::planted::{Plant, PlantedStep, planted_step};
use super::reference::Reference;
use super::{Coverage, Events, Route};
use crate::curve::{Basis, CurveSet};
use crate::random::Random;
use crate::verdict::{AbortOn, Report};
use crate::verifier::{Strategy, Verifier, VerifierOptions};
use std::sync::Arc;
use std::time::Instant;

/// Number of frames before a planted step, and after it.
const AROUND: u64 = 3;

/// Verifies a stream that is at rest except for one planted step, each frame incrementally and in
/// full.
fn follow(planted: &PlantedStep, events: Events, routes: &mut [u64; 3]) -> Vec<Report> {
    let [mut incremental, mut full] = [Strategy::Paranoid, Strategy::Full].map(|strategy| {
        Verifier::new(VerifierOptions {
            abort_on: AbortOn::Event,
            strategy,
            events,
            motion_limit: Some(f64::INFINITY),
            ..VerifierOptions::default()
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
    let mut routes = [0; 3];
    for plant in [
        Plant::Single,
        Plant::Cancelling,
        Plant::SelfCrossing,
        Plant::Open,
    ] {
        let mut r = Random::new(2000 + plant as u64);
        let mut done = 0;
        while done < 1000 {
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
    assert!(routes[Route::Quiet as usize] > 10_000, "{routes:?}");
    assert!(routes[Route::Partial as usize] > 100, "{routes:?}");
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
        let certificate = Verifier::default().certify(&set).0.clone();
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
                let build = || Reference::build(set, Arc::new(certificate), 0, coverage);
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
    crate::model::read(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).ok()
}
