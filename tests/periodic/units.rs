//! Units of length: a scene in other units has the same findings, at the same cost.

use crate::scene::Scene;
use crate::support::session::Step;
use linkwatch::{Cell, Events, FrameInfo, Report, Session, SessionOptions, Strategy, Verdict};

/// Returns the scene in other units.
fn scaled(scene: &Scene, unit: f64) -> Scene {
    let mut scaled = scene.clone();
    let cell = &mut scaled.cell.vectors;
    let points = scaled.curves.iter_mut().flatten();
    points.chain(cell).flatten().for_each(|x| *x *= unit);
    scaled
}

/// Returns the frames of a scene that drifts, in a cell that changes by up to 3 %.
fn frames(seed: u64) -> Vec<Scene> {
    let first = Scene::random(seed);
    let frames = (0..6).map(|k| {
        let mut frame = first.moved(seed + 1000 * (k / 2), 0.3 * (k / 2) as f64);
        let factor = 1.0 - 0.03 * (k % 2) as f64;
        let shrunk = |p: &mut [f64; 3]| [p[0], p[1]] = [factor * p[0], factor * p[1]];
        frame.curves.iter_mut().flatten().for_each(shrunk);
        frame.cell.vectors.iter_mut().for_each(shrunk);
        frame
    });
    frames.collect()
}

/// Returns the report and the work of each frame.
fn verified(frames: &[Scene], unit: f64, strategy: Strategy) -> Vec<(Report, [u64; 3])> {
    let first = scaled(&frames[0], unit);
    let options = SessionOptions {
        cell: None,
        ..first.options(strategy, Events::Between)
    };
    let mut session = Session::new(options).unwrap();
    let verify = |(seq, frame): (usize, &Scene)| {
        let frame = scaled(frame, unit);
        let info = FrameInfo::at(seq as u64, 0.0).in_cell(frame.cell);
        let verified = session.step_at(info, frame.set());
        let work = verified.work;
        assert!(!work.disagreed);
        session.settle();
        (
            verified.report,
            [work.recomputed, work.searched, work.summed],
        )
    };
    frames.iter().enumerate().map(verify).collect()
}

/// What does not depend on the unit of length.
fn findings(report: &Report) -> String {
    let mut stats = report.stats;
    stats.extent = 0.0;
    let events = report.events.iter().chain(&report.unresolved);
    let events = events.map(|e| (e.i, e.j, e.image, e.segments, e.sign, e.fraction));
    let changes = report.changes.iter();
    let changes = changes.map(|c| (c.i, c.j, c.image, c.expected, c.found));
    let defects = report.defects.iter().map(|d| (d.i, d.j, d.image, d.kind));
    format!(
        "{:?} {:?} {:?} {:?} {:?} {:?}",
        report.verdict,
        events.collect::<Vec<_>>(),
        changes.collect::<Vec<_>>(),
        defects.collect::<Vec<_>>(),
        report.missing,
        stats,
    )
}

/// Regression test: along axes that are not periodic, the change of the cell was multiplied by a
/// length. Large units of length caused a search of many images, or the rejection of the frame.
#[test]
fn the_unit_of_length_changes_neither_a_finding_nor_the_work() {
    let mut changed = 0;
    for seed in 0..64 {
        let frames = frames(seed);
        for strategy in [Strategy::Full, Strategy::Paranoid] {
            let expected = verified(&frames, 1.0, strategy);
            changed += expected
                .iter()
                .filter(|(r, _)| r.verdict == Verdict::Changed)
                .count();
            // Powers of two scale all numbers exactly.
            for power in [-20, -7, 10, 20] {
                let found = verified(&frames, 2_f64.powi(power), strategy);
                for (seq, (found, expected)) in found.iter().zip(&expected).enumerate() {
                    let at = format!("seed {seed}, unit 2^{power}, frame {seq}");
                    assert_eq!(findings(&found.0), findings(&expected.0), "{at}");
                    // Other work depends on when a reference frame is ready.
                    if strategy == Strategy::Full {
                        assert_eq!(found.1, expected.1, "{at}");
                    }
                }
            }
        }
    }
    assert!(changed > 100, "{changed}");
}

/// A curve that is long where the scene does not repeat does not make the search of images larger.
#[test]
fn a_high_slab_may_change_its_cell() {
    let mut scene = Scene::random(1);
    for (cell, high) in [("4,4,0", 2), ("4,0,0", 1)] {
        scene.cell = cell.parse::<Cell>().unwrap();
        let mut potential = Vec::new();
        for height in [1.0, 1e3, 1e6] {
            let options = SessionOptions {
                cell: None,
                ..scene.options(Strategy::Full, Events::Off)
            };
            let mut session = Session::new(options).unwrap();
            let mut step = |factor: f64| {
                let mut frame = scene.clone();
                frame
                    .cell
                    .vectors
                    .iter_mut()
                    .flatten()
                    .for_each(|x| *x *= factor);
                let far = frame.curves.iter_mut().flatten();
                far.step_by(5).for_each(|p| p[high] *= height);
                let info = FrameInfo::at(0, 0.0).in_cell(frame.cell);
                session
                    .step_at(info, frame.set())
                    .report
                    .stats
                    .potential_links
            };
            step(1.0);
            potential.push(step(0.97));
        }
        if high > 0 {
            assert!(
                potential[2] <= 2 * potential[0] + 50,
                "{cell}: {potential:?}"
            );
        }
    }
}
