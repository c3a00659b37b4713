//! Tests of the steps between frames: pull-throughs, cuts, and what is known to be intact.

use super::*;
use crate::verdict::AbortOn;

#[test]
fn the_first_frame_has_no_pull_throughs() {
    // The first frame has no previous frame, so with a baseline of another run it has a change, but
    // no pull-through.
    let baseline = Certifier::default().certify(&squares(0.0)).0.clone();
    let mut engine = Engine::new(SessionOptions {
        abort_on: AbortOn::Event,
        baseline: Some(baseline),
        events: Events::All,
        ..SessionOptions::default()
    })
    .unwrap();
    let report = engine.step(0, 0.0, &squares(1.2)).unwrap();
    assert_eq!((report.changes.len(), report.events.len()), (1, 0));
    assert_eq!((report.abort, &report.defects[..]), (false, &[][..]));
    let report = engine.step(1, 0.0, &squares(0.0)).unwrap();
    assert_eq!((report.changes.len(), report.events.len()), (0, 1));
    assert!(report.abort);
}

#[test]
fn a_frame_after_a_cut_has_no_pull_throughs() {
    for strategy in [Strategy::Full, Strategy::Paranoid] {
        let mut engine = engine(strategy, Events::All);
        // Pulled out in frame 3, back in place after a cut, and out again.
        let frames = [0.0, 0.0, 0.0, 1.2, 0.0, 0.0, 1.2, 1.2, 0.0, 0.0];
        for (frame, out) in frames.into_iter().enumerate() {
            let cut = [4, 5, 8].contains(&frame);
            if cut {
                engine.known.cut();
            }
            let report = engine.step(frame as u64, 0.0, &squares(out)).unwrap();
            engine.settle();
            let passed = [3, 6].contains(&frame);
            assert_eq!(report.events.len(), usize::from(passed), "frame {frame}");
            assert_eq!(report.defects, [], "frame {frame}");
            // The linking number is still compared with the baseline.
            let changed = out != 0.0;
            assert_eq!(report.changes.len(), usize::from(changed), "frame {frame}");
            assert_eq!(report.abort, changed, "frame {frame}");
            assert!(!engine.work().disagreed);
        }
    }
}

#[test]
fn a_rejected_frame_follows_the_policy() {
    let nan = Error::Usage("coordinate x is NaN".into());
    for policy in AbortOn::ALL {
        let engine = Engine::new(SessionOptions {
            abort_on: policy,
            events: Events::Between,
            clearance: Some(ClearanceOptions::new(Some(0.1))),
            ..SessionOptions::default()
        });
        let report = engine.unwrap().reject(3, 0.5, &nan);
        let stops = [AbortOn::Any, AbortOn::Rejected, AbortOn::Clearance].contains(&policy);
        assert_eq!(report.abort, stops, "{policy}");
        assert_eq!(report.rejected.as_deref(), Some("coordinate x is NaN"));
    }
}

#[test]
fn reports_signs_that_contradict_the_linking_number() {
    let mut engine = engine(Strategy::Full, Events::Between);
    let _ = engine.step(0, 0.0, &squares(0.0)).unwrap();
    // Simulates that the previous frame had another linking number.
    engine.falsify();
    let report = engine.step(1, 0.0, &squares(0.0)).unwrap();
    let kinds: Vec<_> = report.defects.iter().map(|d| (d.i, d.j, d.kind)).collect();
    assert_eq!(kinds, [(0, Some(1), DefectKind::Unaccounted)]);
    assert_eq!(report.verdict, Verdict::Undecided);
}

#[test]
fn open_curves_are_verified_for_pull_throughs_only() {
    let strands = |y: f64| {
        let xyz = [-1.0, y, 0.0, 1.0, y, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0];
        CurveSet::from_counts(Basis::Polyline, &[2, 2], Positions::F64(&xyz)).unwrap()
    };
    let mut engine = Engine::default();
    let refused = engine.step(0, 0.0, &strands(-1.0));
    assert!(matches!(
        refused,
        Err(Error::NothingClosed { curves: 2, .. })
    ));
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let mut engine = Engine::new(SessionOptions {
            abort_on: AbortOn::Event,
            strategy,
            events: Events::Between,
            ..SessionOptions::default()
        })
        .unwrap();
        for (frame, y) in [-1.0, -0.99, -0.98, 0.5, 0.5, -0.5].into_iter().enumerate() {
            let report = engine.step(frame as u64, 0.0, &strands(y)).unwrap();
            let found = [3, 5].contains(&frame);
            assert_eq!(report.events.len(), usize::from(found), "frame {frame}");
            assert_eq!(report.abort, found);
            engine.settle();
        }
    }
}

#[test]
fn rejects_a_step_between_different_curves() {
    let mut engine = engine(Strategy::Full, Events::Between);
    let _ = engine.step(0, 0.0, &squares(0.0)).unwrap();
    let xyz = vec![0.5; 3 * 73];
    let other =
        CurveSet::from_counts(Basis::Polyline, &[-4, -5, -64], Positions::F64(&xyz)).unwrap();
    let refused = engine.step(1, 0.0, &other).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "the curves changed between frames: control points of a curve was 4, is 5"
    );
}

#[test]
fn a_shared_frame_is_not_copied() {
    let mut engine = engine(Strategy::Full, Events::Between);
    let frames = [0.0, 1.2, 1.2].map(|out| Arc::new(squares(out)));
    for (k, frame) in frames.iter().enumerate() {
        let report = engine.step_shared(k as u64, 0.0, frame).unwrap();
        assert_eq!(report.events.len(), usize::from(k == 1));
    }
    assert_eq!(frames.each_ref().map(Arc::strong_count), [1, 1, 2]);
    let last = engine.known.last.as_ref().unwrap();
    assert!(Arc::ptr_eq(last.frame.given(), &frames[2]));
}

/// A finger of a closed curve is pushed past a long strand, so that both sides of the finger pass
/// the strand in one step.
fn finger(y: f64) -> CurveSet {
    let loop_ = [
        [-0.5, y, 0.25],
        [0.5, y, -0.25],
        [0.5, y - 1.0, -0.25],
        [-0.5, y - 1.0, 0.25],
    ];
    let far = (0..3).map(|k| [90.0 + f64::from(k), 90.0, f64::from(k * k)]);
    let far: Vec<_> = far.collect();
    let strand = [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [40.0, 50.0, 0.0]];
    let xyz = [&loop_[..], &strand, &far].concat().concat();
    CurveSet::from_counts(Basis::Polyline, &[-4, 3, -3], Positions::F64(&xyz)).unwrap()
}

fn with_limit(motion_limit: Option<f64>) -> Engine {
    Engine::new(SessionOptions {
        events: Events::Between,
        motion_limit,
        ..SessionOptions::default()
    })
    .unwrap()
}

#[test]
fn pull_throughs_that_cancel_after_a_long_motion_are_unresolved() {
    // The longer segment of each has a length of 2.
    let reports = |limit: Option<f64>| -> Vec<Report> {
        let mut engine = with_limit(limit);
        let frames = [-1.0, 4.0, 4.0].into_iter().enumerate();
        let verify = |(k, y)| engine.step(k as u64, 0.0, &finger(y)).unwrap();
        frames.map(verify).collect()
    };
    for limit in [None, Some(0.0), Some(2.4)] {
        let reports = reports(limit);
        let report = &reports[1];
        assert_eq!((report.verdict, report.abort), (Verdict::Undecided, false));
        assert_eq!((report.events.len(), report.defects.len()), (0, 0));
        let signs: Vec<i32> = report.unresolved.iter().map(|e| e.sign).collect();
        assert_eq!(signs.iter().sum::<i32>(), 0);
        assert_eq!(signs.len(), 2);
        assert!(
            report.unresolved.iter().all(|e| e.lengths == 2.5),
            "{report:?}"
        );
        assert!(report.headline().contains("2 unresolved pull-throughs"));
        assert!(report.findings().all(|f| f.contains("2.5 segment lengths")));
        // The finding belongs to that step only. What happened in the step remains unknown.
        assert_eq!(reports[2].verdict, Verdict::Intact);
        assert_eq!(
            (reports[2].last_intact, reports[2].safe_fraction),
            (Some(0), None)
        );
    }
    for limit in [2.6, f64::INFINITY] {
        let report = &reports(Some(limit))[1];
        assert_eq!((report.verdict, report.abort), (Verdict::Changed, true));
        assert_eq!((report.events.len(), report.unresolved.len()), (2, 0));
    }
}

#[test]
fn a_report_names_the_frame_and_the_share_of_the_step_to_roll_back_to() {
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let mut engine = engine(strategy, Events::Between);
        let step = |engine: &mut Engine, seq, out| {
            let report = engine.step(seq, 0.0, &squares(out)).unwrap();
            (report.verdict, report.last_intact, report.safe_fraction)
        };
        assert_eq!(step(&mut engine, 3, 0.0), (Verdict::Intact, Some(3), None));
        let quiet = (Verdict::Intact, Some(4), Some(1.0));
        assert_eq!(step(&mut engine, 4, 0.5), quiet);
        // They touch at 1, after a quarter of the step.
        let (verdict, last_intact, fraction) = step(&mut engine, 5, 2.5);
        assert_eq!((verdict, last_intact), (Verdict::Changed, Some(4)));
        let fraction = fraction.unwrap();
        assert!((0.25 - 1e-6..0.25).contains(&fraction), "{fraction}");
        // The curves are still apart, and the last intact frame is still frame 4.
        let apart = (Verdict::Changed, Some(4), None);
        assert_eq!(step(&mut engine, 6, 2.5), apart);
        // Even a frame in which they are linked again is not known to be intact.
        let linked = step(&mut engine, 7, 0.5);
        assert_eq!((linked.1, linked.2), (Some(4), None));
        engine.known.cut();
        let restored = (Verdict::Intact, Some(8), None);
        assert_eq!(step(&mut engine, 8, 0.5 + 2.0 * fraction), restored);
    }
}

#[test]
fn no_frame_is_known_to_be_intact_after_a_change_until_a_cut() {
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let mut engine = engine(strategy, Events::Off);
        let mut known = Vec::new();
        for (seq, out) in [(0, 0.0), (1, 2.5), (2, 0.0), (3, 0.0)] {
            if seq == 3 {
                engine.known.cut();
            }
            let report = engine.step(seq, 0.0, &squares(out)).unwrap();
            assert_eq!(report.verdict == Verdict::Intact, seq != 1);
            assert_eq!(report.safe_fraction, None);
            known.push(report.last_intact);
        }
        assert_eq!(known, [Some(0), Some(0), Some(0), Some(3)]);
    }
}

/// Regression: the report omits the undecided step, because the pair has another defect.
#[test]
fn an_undecided_step_of_a_pair_without_a_baseline_ends_what_is_known() {
    // The curves touch in the first frame. Then a joint forms and moves, and it opens together with
    // that contact.
    let frame = |[a, b, touching]: [Point; 3]| {
        let first = [a, [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]];
        let second = [b, [1.0, -3.0, 2.0], touching, [3.0, 3.0, 2.0]];
        let xyz = [first, second].concat().concat();
        CurveSet::from_counts(Basis::Polyline, &[-4, -4], Positions::F64(&xyz)).unwrap()
    };
    let (origin, moved) = ([0.0; 3], [-0.1, 0.0, 0.0]);
    let (away, on, off) = ([0.0, 0.0, 1.0], [2.0, 1.0, 0.0], [2.0, 1.0, 0.5]);
    let frames = [
        [origin, away, on],
        [origin, origin, on],
        [moved, moved, on],
        [origin, away, off],
        [origin, away, off],
    ];
    let mut engine = engine(Strategy::Full, Events::Between);
    let reports: Vec<Report> = (0..)
        .zip(frames)
        .map(|(seq, points)| engine.step(seq, 0.0, &frame(points)).unwrap())
        .collect();
    let kinds: Vec<_> = reports[3].defects.iter().map(|d| d.kind).collect();
    assert_eq!(kinds, [DefectKind::NoBaseline]);
    assert_eq!(reports[4].verdict, Verdict::Intact);
    assert_eq!(reports[4].last_intact, None);
}

#[test]
fn a_contact_in_the_last_frame_is_after_the_safe_fraction() {
    let mut engine = with_limit(None);
    let _ = engine.step(0, 0.0, &squares(0.5)).unwrap();
    let report = engine.step(1, 0.0, &squares(1.0)).unwrap();
    assert_eq!(
        (report.verdict, report.last_intact),
        (Verdict::Contact, Some(0))
    );
    let fraction = report.safe_fraction.unwrap();
    assert!((1.0 - 1e-6..1.0).contains(&fraction), "{fraction}");
}

#[test]
fn reports_a_single_pull_through_after_any_motion() {
    let mut engine = with_limit(Some(0.0));
    let _ = engine.step(0, 0.0, &squares(0.0)).unwrap();
    let report = engine.step(1, 0.0, &squares(1.5)).unwrap();
    assert_eq!((report.events.len(), report.unresolved.len()), (1, 0));
    assert!(report.abort);
}
