//! Quiet frames: the search for images is skipped if the reference frame proves where curves are.

use crate::scene::{Point, Scene};
use crate::support::random::Random;
use crate::support::session::Step;
use linkwatch::{Events, FrameInfo, Report, Route, Session, SessionOptions, Strategy};
use std::sync::Arc;

/// Verdict, pull-throughs and changes of a frame.
fn findings(report: &Report) -> String {
    format!(
        "{} {:?} {:?}",
        report.verdict, report.events, report.changes
    )
}

/// Rings that drift slowly through one another and through the boundary, in a cell that is sheared
/// slowly: in every frame, the findings of incremental verification are those of a full one. Most
/// frames are quiet, and images that were apart come within reach during quiet frames.
#[test]
fn images_that_come_near_in_quiet_frames_are_found() {
    let (mut quiet, mut events) = (0, 0);
    for seed in 0..60 {
        let scene = Scene::random(2 * seed + 1);
        let mut random = Random::from_key([seed, 24]);
        let velocities: Vec<Point> = scene
            .curves
            .iter()
            .map(|_| [0; 3].map(|_| 0.02 * (2.0 * random.unit() - 1.0)))
            .collect();
        let shear = [0.0, 0.002][seed as usize % 2];
        let deformed = |p: &Point, t: f64| [p[0] + shear * t * p[1], p[1], p[2]];
        let strategies = [Strategy::Incremental, Strategy::Paranoid, Strategy::Full];
        let mut sessions = strategies
            .map(|strategy| SessionOptions {
                cell: None,
                ..scene.options(strategy, Events::Between)
            })
            .map(|options| Session::new(options).unwrap());
        for seq in 0..150_u32 {
            let t = f64::from(seq);
            let mut frame = scene.clone();
            for (curve, v) in frame.curves.iter_mut().zip(&velocities) {
                for p in curve {
                    *p = deformed(&[0, 1, 2].map(|x| p[x] + t * v[x]), t);
                }
            }
            frame.cell.vectors = scene.cell.vectors.map(|v| deformed(&v, t));
            let set = Arc::new(frame.set());
            let verified = sessions.each_mut().map(|session| {
                let info = FrameInfo::at(seq.into(), t).in_cell(frame.cell);
                let verified = session.step_at(info, &set);
                session.settle();
                verified
            });
            let [found, _, expected] = verified.each_ref().map(|v| findings(&v.report));
            assert_eq!(found, expected, "seed {seed}, frame {seq}");
            assert!(!verified[1].work.disagreed, "seed {seed}, frame {seq}");
            quiet += usize::from(verified[0].work.route == Route::Quiet);
            let with_images = verified[0]
                .report
                .events
                .iter()
                .filter(|e| e.image != [0; 3]);
            events += with_images.count();
        }
    }
    assert!(
        quiet > 1500 && events > 200,
        "{quiet} quiet frames, {events} pull-throughs"
    );
}
