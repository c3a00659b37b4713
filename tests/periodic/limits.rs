//! Limits: a frame that exceeds one is rejected, and no report depends on a limit.

use crate::scene::Scene;
use crate::support::session::Step;
use linkwatch::{Events, FrameInfo, Session, Strategy};
use std::sync::Arc;

/// Regression test: a search for the pairs of images that found more pairs than the limit kept some
/// of them, and a frame that had lost a link was intact.
#[test]
fn with_any_limit_of_pairs_a_report_is_that_without_or_the_frame_is_rejected() {
    let (mut rejected, mut equal, mut changed) = (0, 0, 0);
    for seed in 0..60 {
        let scene = Scene::random(seed);
        let frames = (0..4).map(|k| scene.moved(9 * seed + k, 0.8 * (k % 2) as f64).set());
        let frames: Vec<_> = frames.map(Arc::new).collect();
        for (strategy, events) in [
            (Strategy::Full, Events::Off),
            (Strategy::Incremental, Events::Between),
        ] {
            for limit in [0, 1, 2, 4, 7, 11, 16, 24, 36, 60, 100] {
                let mut options = scene.options(strategy, events);
                let mut other = Session::new(options.clone()).unwrap();
                options.max_pairs = limit;
                let mut limited = Session::new(options).unwrap();
                for (seq, set) in (0..).zip(&frames) {
                    let found = limited.feed(FrameInfo::at(seq, 0.0), set).unwrap();
                    match &found.rejected {
                        Some(why) => {
                            assert!(why.contains("pairs of curves overlap"), "{why}");
                            rejected += 1;
                            break;
                        }
                        None => {
                            let wanted = other.step(seq, set).report;
                            changed += usize::from(!wanted.changes.is_empty());
                            assert_eq!(found, wanted, "seed {seed}, limit {limit}");
                            equal += 1;
                        }
                    }
                }
            }
        }
    }
    let counts = [rejected, equal, changed];
    assert!(counts.iter().all(|&n| n > 300), "{counts:?}");
}

/// A small frame whose curve spans many cells would need the memory of thousands of its images.
#[test]
fn a_frame_over_many_cells_is_refused_before_its_images_take_memory() {
    for (points, radius, accepted) in [(300, 2.0, true), (10_000, 6.0, false), (300, 90.0, false)] {
        let point = |k: u32| {
            let t = std::f64::consts::TAU * f64::from(k) / f64::from(points);
            [t.cos(), t.sin(), (2.0 * t).sin()].map(|x| radius * x)
        };
        let mut scene = Scene::random(0);
        scene.cell = "1,1,1".parse().unwrap();
        scene.curves = vec![(0..points).map(point).collect()];
        let mut options = scene.options(Strategy::Full, Events::Off);
        options.wrapped = Some(false);
        let mut session = Session::new(options).unwrap();
        let report = session.feed(FrameInfo::at(0, 0.0), scene.set()).unwrap();
        match report.rejected {
            None => assert!(accepted, "{points} {radius}"),
            Some(why) => assert!(
                !accepted && why.contains("too many periodic cells"),
                "{why}"
            ),
        }
    }
}
