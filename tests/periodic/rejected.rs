//! Frames after a rejected frame, after another baseline, and after a contact.

use crate::invariance::chain;
use crate::scene::Scene;
use crate::support::session::Step;
use linkwatch::{
    Basis, Cell, Certificate, CurveSet, DefectKind, Events, FrameInfo, Positions, Session,
    SessionOptions, Strategy, Verdict,
};
use std::sync::Arc;

/// Returns the chain almost at rest, with one ring moved out of it.
fn displaced(seq: u64, by: f64) -> Scene {
    let mut scene = chain();
    for p in scene.curves.iter_mut().flatten() {
        p[1] += 1e-5 * seq as f64;
    }
    scene.curves[1].iter_mut().for_each(|p| p[2] += by);
    scene
}

/// Regression test: the search of a step used the moved parts of a rejected frame, so that the
/// passage of a ring that returned was missed.
#[test]
fn a_rejected_frame_hides_no_pull_through() {
    for strategy in [Strategy::Full, Strategy::Incremental, Strategy::Paranoid] {
        let options = SessionOptions {
            cell: None,
            ..chain().options(strategy, Events::Between)
        };
        let mut session = Session::new(options).unwrap();
        let mut feed = |seq: u64, scene: Scene| {
            let info = FrameInfo::at(seq, 0.0).in_cell(scene.cell);
            session.feed(info, scene.set()).unwrap()
        };
        for seq in 0..6 {
            let report = feed(seq, displaced(seq, 0.0));
            assert_eq!(report.verdict, Verdict::Intact);
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        let out = feed(6, displaced(6, 1.4));
        assert!(!out.events.is_empty(), "{strategy:?}");
        let mut larger = displaced(7, 0.0);
        larger.cell.vectors = larger.cell.vectors.map(|v| v.map(|x| 3.0 * x));
        let why = feed(7, larger).rejected.unwrap();
        assert!(why.contains("more than half of its size"), "{why}");
        let back = feed(8, displaced(8, 0.0));
        assert_eq!(back.events.len(), out.events.len(), "{strategy:?}");
    }
}

/// Regression test: in a new part of a run, quiet frames were compared with the baseline of the
/// part before it.
#[test]
fn frames_of_another_part_are_compared_with_the_new_baseline() {
    for strategy in [Strategy::Full, Strategy::Incremental, Strategy::Paranoid] {
        let mut session = Session::new(chain().options(strategy, Events::Off)).unwrap();
        for seq in 0..6 {
            let set = Arc::new(displaced(seq, 0.0).set());
            let report = session.step(seq, &set).report;
            assert_eq!(report.verdict, Verdict::Intact);
            session.settle();
        }
        let baseline = session.baseline().unwrap();
        let link = baseline.links()[0];
        let pair = (link.i, link.j);
        let line = |lambda: i64| format!("\n{},{},0,0,0,{lambda}\n", link.i, link.j);
        let text = baseline.to_string();
        let other = text.replace(&line(link.lambda), &line(link.lambda + 1));
        assert_ne!(text, other);
        session.begin_part(Certificate::parse(&other).unwrap());
        let set = Arc::new(displaced(6, 0.0).set());
        let report = session.step(6, &set).report;
        let changed: Vec<_> = report.changes.iter().map(|c| (c.i, c.j)).collect();
        assert_eq!(changed, [pair], "{strategy:?}");
    }
}

/// Regression test: a ring and a yarn that touch in the first frame were never compared again.
#[test]
fn a_number_of_a_ring_and_a_yarn_that_touch_at_first_is_compared_from_the_next_frame_on() {
    let cell: Cell = "4,4,4".parse().unwrap();
    for strategy in [Strategy::Full, Strategy::Incremental, Strategy::Paranoid] {
        let mut options = SessionOptions::default();
        (options.strategy, options.cell) = (strategy, Some(cell));
        let mut session = Session::new(options).unwrap();
        let mut step = |seq: u64, y: f64| {
            let yarn = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [4.0, 0.0, 0.0]];
            let ring = [[0.0, -1.0], [0.0, 1.0], [2.0, 1.0], [2.0, -1.0]];
            let ring = ring.map(|p| [1.0, y + p[0], p[1]]);
            let xyz = [&yarn[..], &ring[..]].concat().concat();
            let positions = Positions::F64(&xyz);
            let set = CurveSet::from_counts(Basis::Polyline, &[3, -4], positions).unwrap();
            let verified = session.step(seq, set);
            assert!(!verified.work.disagreed);
            verified.report
        };
        let touching = step(0, 0.0);
        assert_eq!(touching.defects[0].kind, DefectKind::Contact);
        let around = step(1, -1.0);
        assert_eq!(around.defects[0].kind, DefectKind::NoBaseline);
        assert_eq!(step(2, -1.1).verdict, Verdict::Intact);
        let beside = step(3, 0.5);
        assert_eq!(beside.verdict, Verdict::Changed, "{strategy:?}");
        let change = beside.changes[0];
        assert_eq!((change.expected.abs(), change.found), (1, 0));
    }
}
