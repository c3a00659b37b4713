//! Tests of the engine's options and errors.

use super::*;
use crate::curve::{Basis, CurveLabels, Point, Positions};
use crate::engine::known::Last;
use crate::incremental::Route;
use crate::kernels::Method;
use crate::thickness::ClearanceOptions;
use crate::verdict::{Change, DefectKind};
use std::time::Duration;

impl Engine {
    /// Verifies a frame that continues the last one.
    pub(crate) fn step(&mut self, seq: u64, time: f64, set: &CurveSet) -> Result<Report> {
        self.step_shared(seq, time, &Arc::new(set.clone()))
    }

    /// The same, of curves that are shared.
    pub(crate) fn step_shared(
        &mut self,
        seq: u64,
        time: f64,
        set: &Arc<CurveSet>,
    ) -> Result<Report> {
        let mut report = self.verify(Next::new(seq, time, set))?;
        report.abort = self.aborts(&report);
        Ok(report)
    }

    /// Falsifies a linking number of the last frame.
    fn falsify(&mut self) {
        let mut last = Last::clone(self.known.last.as_ref().expect("a frame before"));
        last.linking.comparison.changes.push(Change {
            i: 0,
            j: 1,
            image: Default::default(),
            expected: 1,
            found: 0,
            place: None,
        });
        self.known.last = Some(Arc::new(last));
    }
}

impl Default for Engine {
    fn default() -> Self {
        Engine::with_gpu(SessionOptions::default(), GpuUse::default())
    }
}

/// A square, another one through it, moved by `out`, and a wide ring that stands still.
fn squares(out: f64) -> CurveSet {
    squares_with(|[x, y, z]| [x + out, y, z])
}

/// The squares, with the points of the second one transformed by `moved`.
fn squares_with(moved: impl Fn(Point) -> Point) -> CurveSet {
    let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
    let flat = square.map(|[x, y]| [x, y, 0.0]);
    let upright = square.map(|[x, z]| moved([1.0 + x, 1.0, z - 1.0]));
    let ring = (0..64).map(|k| (f64::from(k) * std::f64::consts::TAU / 64.0).sin_cos());
    let ring: Vec<_> = ring.map(|(s, c)| [50.0 * s, 50.0 * c, s]).collect();
    let xyz = [&flat[..], &upright, &ring].concat().concat();
    CurveSet::from_counts(Basis::Polyline, &[-4, -4, -64], Positions::F64(&xyz)).unwrap()
}

fn verifier(strategy: Strategy, events: Events) -> Engine {
    Engine::new(SessionOptions {
        strategy,
        events,
        ..SessionOptions::default()
    })
    .unwrap()
}

/// A verifier that has seen three intact frames, and whose monitor no longer detects motion.
fn blind(strategy: Strategy) -> Engine {
    let mut verifier = verifier(strategy, Events::Between);
    for frame in 0..3 {
        let report = verifier.step(frame, 0.0, &squares(0.0)).unwrap();
        assert_eq!(report.verdict, Verdict::Intact);
        assert!(!verifier.work().disagreed);
        verifier.settle();
    }
    assert_eq!(verifier.work().route, Route::Quiet);
    verifier.monitor.make_allowances_infinite();
    verifier
}

#[test]
fn a_frame_with_too_many_pairs_is_an_error_and_the_next_one_is_verified() {
    let early = (Strategy::Full, true);
    for (strategy, early_exit) in [
        (Strategy::Full, false),
        early,
        (Strategy::Incremental, false),
    ] {
        for events in [Events::Off, Events::Between, Events::All] {
            if early_exit && events != Events::Off {
                continue;
            }
            let new = |max_pairs| {
                let options = SessionOptions {
                    strategy,
                    early_exit,
                    events,
                    max_pairs,
                    ..SessionOptions::default()
                };
                Engine::new(options).unwrap()
            };
            // The other one does not see the frame with too many pairs.
            let [mut limited, mut other] = [2, SessionOptions::MAX_PAIRS].map(new);
            for (seq, out) in [(0, 100.0), (1, 0.0), (2, 100.1), (3, 0.0), (4, 100.2)] {
                let set = squares(out);
                let found = limited.step(seq, 0.0, &set);
                if out == 0.0 {
                    let e = found.unwrap_err();
                    assert!(matches!(e, Error::TooManyPairs { limit: 2 }), "{e}");
                    continue;
                }
                let wanted = other.step(seq, 0.0, &set).unwrap();
                assert_eq!(
                    found.unwrap(),
                    wanted,
                    "{strategy:?}, {events}, frame {seq}"
                );
            }
        }
    }
}

#[test]
fn paranoid_mode_detects_an_error_of_the_incremental_verification() {
    let report = blind(Strategy::Incremental)
        .step(3, 0.0, &squares(1.2))
        .unwrap();
    assert_eq!(
        report.verdict,
        Verdict::Intact,
        "the injected error takes effect"
    );

    let mut verifier = blind(Strategy::Paranoid);
    let report = verifier.step(3, 0.0, &squares(1.2)).unwrap();
    assert!(verifier.work().disagreed);
    assert_eq!((report.verdict, report.abort), (Verdict::Changed, true));
    assert_eq!((report.changes.len(), report.events.len()), (1, 1));
    // From then on, frames are computed in full.
    let report = verifier.step(4, 0.0, &squares(0.0)).unwrap();
    assert_eq!(verifier.work().route, Route::Full);
    assert_eq!((report.changes.len(), report.events.len()), (0, 1));
    assert_eq!(report.verdict, Verdict::Changed, "the link is back");
    let report = verifier.step(5, 0.0, &squares(0.0)).unwrap();
    assert_eq!(report.verdict, Verdict::Intact);
}

#[test]
fn a_kernel_that_sums_changes_the_work_but_no_report() {
    for method in Method::ALL {
        for strategy in [Strategy::Full, Strategy::Incremental] {
            let [mut with, mut without] = [method, Method::Auto].map(|kernel| {
                Engine::new(SessionOptions {
                    strategy,
                    kernel,
                    ..SessionOptions::default()
                })
                .unwrap()
            });
            for (frame, out) in [0.0, 0.1, 1.2, 2.0, 0.0].into_iter().enumerate() {
                let [found, expected] = [&mut with, &mut without]
                    .map(|verifier| verifier.step(frame as u64, 0.0, &squares(out)).unwrap());
                let work = with.work();
                // Pairs in contact are decided by counting.
                let all = work.route == Route::Full && out != 2.0;
                match method {
                    Method::Auto | Method::Crossings => assert_eq!(work.summed, 0),
                    _ if all => assert_eq!(work.summed, work.recomputed, "{method}, {out}"),
                    _ => assert!(work.summed <= work.recomputed),
                }
                let stats = expected.stats;
                assert_eq!(Report { stats, ..found }, expected, "{method}, {out}");
            }
        }
    }
}

#[test]
fn the_first_frame_has_no_pull_throughs() {
    // The first frame has no previous frame. With a baseline from elsewhere it has a change, but no
    // pull-through.
    let baseline = Certifier::default().certify(&squares(0.0)).0.clone();
    let mut verifier = Engine::new(SessionOptions {
        abort_on: AbortOn::Event,
        baseline: Some(baseline),
        events: Events::All,
        ..SessionOptions::default()
    })
    .unwrap();
    let report = verifier.step(0, 0.0, &squares(1.2)).unwrap();
    assert_eq!((report.changes.len(), report.events.len()), (1, 0));
    assert_eq!((report.abort, &report.defects[..]), (false, &[][..]));
    let report = verifier.step(1, 0.0, &squares(0.0)).unwrap();
    assert_eq!((report.changes.len(), report.events.len()), (0, 1));
    assert!(report.abort);
}

#[test]
fn a_frame_after_a_cut_has_no_pull_throughs() {
    for strategy in [Strategy::Full, Strategy::Paranoid] {
        let mut verifier = verifier(strategy, Events::All);
        // Pulled out in frame 3, back in place after a cut, and out again.
        let frames = [0.0, 0.0, 0.0, 1.2, 0.0, 0.0, 1.2, 1.2, 0.0, 0.0];
        for (frame, out) in frames.into_iter().enumerate() {
            let cut = [4, 5, 8].contains(&frame);
            if cut {
                verifier.known.cut();
            }
            let report = verifier.step(frame as u64, 0.0, &squares(out)).unwrap();
            verifier.settle();
            let passed = [3, 6].contains(&frame);
            assert_eq!(report.events.len(), usize::from(passed), "frame {frame}");
            assert_eq!(report.defects, [], "frame {frame}");
            // The linking number is still compared with the baseline.
            let changed = out != 0.0;
            assert_eq!(report.changes.len(), usize::from(changed), "frame {frame}");
            assert_eq!(report.abort, changed, "frame {frame}");
            assert!(!verifier.work().disagreed);
        }
    }
}

#[test]
fn a_rejected_frame_follows_the_policy() {
    let nan = Error::Usage("coordinate x is NaN".into());
    for policy in AbortOn::ALL {
        let verifier = Engine::new(SessionOptions {
            abort_on: policy,
            events: Events::Between,
            clearance: Some(ClearanceOptions::new(Some(0.1))),
            ..SessionOptions::default()
        });
        let report = verifier.unwrap().reject(3, 0.5, &nan);
        let stops = [AbortOn::Any, AbortOn::Rejected, AbortOn::Clearance].contains(&policy);
        assert_eq!(report.abort, stops, "{policy}");
        assert_eq!(report.rejected.as_deref(), Some("coordinate x is NaN"));
    }
}

#[test]
fn reports_signs_that_contradict_the_linking_number() {
    let mut verifier = verifier(Strategy::Full, Events::Between);
    let _ = verifier.step(0, 0.0, &squares(0.0)).unwrap();
    // As if the previous frame had had another linking number.
    verifier.falsify();
    let report = verifier.step(1, 0.0, &squares(0.0)).unwrap();
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
    let mut verifier = Engine::default();
    let refused = verifier.step(0, 0.0, &strands(-1.0));
    assert!(matches!(
        refused,
        Err(Error::NothingClosed { curves: 2, .. })
    ));
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let mut verifier = Engine::new(SessionOptions {
            abort_on: AbortOn::Event,
            strategy,
            events: Events::Between,
            ..SessionOptions::default()
        })
        .unwrap();
        for (frame, y) in [-1.0, -0.99, -0.98, 0.5, 0.5, -0.5].into_iter().enumerate() {
            let report = verifier.step(frame as u64, 0.0, &strands(y)).unwrap();
            let found = [3, 5].contains(&frame);
            assert_eq!(report.events.len(), usize::from(found), "frame {frame}");
            assert_eq!(report.abort, found);
            verifier.settle();
        }
    }
}

#[test]
fn rejects_a_step_between_different_curves() {
    let mut verifier = verifier(Strategy::Full, Events::Between);
    let _ = verifier.step(0, 0.0, &squares(0.0)).unwrap();
    let xyz = vec![0.5; 3 * 73];
    let other =
        CurveSet::from_counts(Basis::Polyline, &[-4, -5, -64], Positions::F64(&xyz)).unwrap();
    let refused = verifier.step(1, 0.0, &other).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "the curves changed between frames: control points of a curve was 4, is 5"
    );
}

#[test]
fn a_shared_frame_is_not_copied() {
    let mut verifier = verifier(Strategy::Full, Events::Between);
    let frames = [0.0, 1.2, 1.2].map(|out| Arc::new(squares(out)));
    for (k, frame) in frames.iter().enumerate() {
        let report = verifier.step_shared(k as u64, 0.0, frame).unwrap();
        assert_eq!(report.events.len(), usize::from(k == 1));
    }
    assert_eq!(frames.each_ref().map(Arc::strong_count), [1, 1, 2]);
    let last = verifier.known.last.as_ref().unwrap();
    assert!(Arc::ptr_eq(last.frame.given(), &frames[2]));
}

/// A finger of a closed curve that is pushed past a long strand, so that it passes the strand twice
/// in one step.
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
        let mut verifier = with_limit(limit);
        let frames = [-1.0, 4.0, 4.0].into_iter().enumerate();
        let verify = |(k, y)| verifier.step(k as u64, 0.0, &finger(y)).unwrap();
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
        // The finding belongs to that step only. But what happened in it is still unknown.
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
        let mut verifier = verifier(strategy, Events::Between);
        let step = |verifier: &mut Engine, seq, out| {
            let report = verifier.step(seq, 0.0, &squares(out)).unwrap();
            (report.verdict, report.last_intact, report.safe_fraction)
        };
        assert_eq!(
            step(&mut verifier, 3, 0.0),
            (Verdict::Intact, Some(3), None)
        );
        let quiet = (Verdict::Intact, Some(4), Some(1.0));
        assert_eq!(step(&mut verifier, 4, 0.5), quiet);
        // They touch at 1, after a quarter of the step.
        let (verdict, last_intact, fraction) = step(&mut verifier, 5, 2.5);
        assert_eq!((verdict, last_intact), (Verdict::Changed, Some(4)));
        let fraction = fraction.unwrap();
        assert!((0.25 - 1e-6..0.25).contains(&fraction), "{fraction}");
        // Apart as before, so nothing else is known.
        let apart = (Verdict::Changed, Some(4), None);
        assert_eq!(step(&mut verifier, 6, 2.5), apart);
        // Even if they are linked again.
        let linked = step(&mut verifier, 7, 0.5);
        assert_eq!((linked.1, linked.2), (Some(4), None));
        verifier.known.cut();
        let restored = (Verdict::Intact, Some(8), None);
        assert_eq!(step(&mut verifier, 8, 0.5 + 2.0 * fraction), restored);
    }
}

#[test]
fn no_frame_is_known_to_be_intact_after_a_change_until_a_cut() {
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let mut verifier = verifier(strategy, Events::Off);
        let mut known = Vec::new();
        for (seq, out) in [(0, 0.0), (1, 2.5), (2, 0.0), (3, 0.0)] {
            if seq == 3 {
                verifier.known.cut();
            }
            let report = verifier.step(seq, 0.0, &squares(out)).unwrap();
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
    // The curves touch in the first frame. A joint forms, moves, and opens with that contact.
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
    let mut verifier = verifier(Strategy::Full, Events::Between);
    let reports: Vec<Report> = (0..)
        .zip(frames)
        .map(|(seq, points)| verifier.step(seq, 0.0, &frame(points)).unwrap())
        .collect();
    let kinds: Vec<_> = reports[3].defects.iter().map(|d| d.kind).collect();
    assert_eq!(kinds, [DefectKind::NoBaseline]);
    assert_eq!(reports[4].verdict, Verdict::Intact);
    assert_eq!(reports[4].last_intact, None);
}

#[test]
fn a_contact_in_the_last_frame_is_after_the_safe_fraction() {
    let mut verifier = with_limit(None);
    let _ = verifier.step(0, 0.0, &squares(0.5)).unwrap();
    let report = verifier.step(1, 0.0, &squares(1.0)).unwrap();
    assert_eq!(
        (report.verdict, report.last_intact),
        (Verdict::Contact, Some(0))
    );
    let fraction = report.safe_fraction.unwrap();
    assert!((1.0 - 1e-6..1.0).contains(&fraction), "{fraction}");
}

#[test]
fn reports_a_single_pull_through_after_any_motion() {
    let mut verifier = with_limit(Some(0.0));
    let _ = verifier.step(0, 0.0, &squares(0.0)).unwrap();
    let report = verifier.step(1, 0.0, &squares(1.5)).unwrap();
    assert_eq!((report.events.len(), report.unresolved.len()), (1, 0));
    assert!(report.abort);
}

/// Regression test: pairs that touched in the first frame had no linking number until the end of
/// the run.
#[test]
fn a_pair_takes_its_number_from_the_first_frame_that_has_one() {
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let mut verifier = verifier(strategy, Events::Off);
        // In contact, linked, in contact, apart.
        let outs = [1.0, 0.0, 0.0, 1.0, 1.5, 0.0];
        let reports = outs.map(|out| {
            let report = verifier.step(0, 0.0, &squares(out)).unwrap();
            verifier.settle();
            report
        });
        use Verdict::*;
        let verdicts = reports.each_ref().map(|r| r.verdict);
        assert_eq!(
            verdicts,
            [Contact, Undecided, Intact, Contact, Changed, Intact]
        );
        assert_eq!(
            reports.each_ref().map(|r| r.abort),
            [false, false, false, true, true, false]
        );
        let lambda = reports[1].adopted[0].lambda;
        assert_eq!(lambda.abs(), 1);
        let said = reports[1].findings().next().unwrap();
        assert!(
            said.contains("no linking number to compare with until now"),
            "{said}"
        );
        assert!(
            said.ends_with(&format!("{lambda} is expected from here on")),
            "{said}"
        );
        assert_eq!(reports[4].changes[0].expected, lambda);
    }
}

/// Random closed polylines in the same region, which take long to verify.
fn tangle(curves: usize, segments: usize, seed: u64) -> CurveSet {
    let mut x = seed;
    let coordinate = || {
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        (x >> 11) as f64 / (1u64 << 53) as f64
    };
    let xyz: Vec<f64> = std::iter::repeat_with(coordinate)
        .take(3 * curves * segments)
        .collect();
    let counts = vec![-(segments as i32); curves];
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap()
}

#[test]
fn a_cancelled_step_ends_early_without_a_report() {
    // The linking numbers come first, then the search for pull-throughs between frames with few
    // linking numbers.
    let frames = [tangle(60, 1000, 1), tangle(60, 1000, 2)];
    for (early_exit, events) in [(false, Events::All), (true, Events::Off)] {
        let mut verifier = Engine::new(SessionOptions {
            early_exit,
            events,
            ..SessionOptions::default()
        })
        .unwrap();
        let progress = verifier.progress();
        let ended = std::thread::scope(|scope| {
            let step = scope.spawn(|| verifier.step(0, 0.0, &frames[0]).err());
            std::thread::sleep(Duration::from_millis(300));
            while progress.pairs().1 == 0 {
                std::thread::yield_now();
            }
            progress.cancel();
            step.join().unwrap()
        });
        assert!(matches!(ended, Some(Error::Cancelled)), "{ended:?}");
        let (done, all) = progress.pairs();
        assert!(done < all, "{done} of {all} pairs");
        assert_eq!(
            verifier.baseline(),
            None,
            "no baseline from an incomplete certificate"
        );
        // Every later step fails, too.
        let again = verifier.step(1, 0.0, &frames[1]);
        assert!(matches!(again, Err(Error::Cancelled)));
    }
}

#[test]
fn a_curve_that_was_degenerate_in_the_first_frame_takes_its_numbers_later() {
    let collapsed = squares_with(|[_, y, z]| [1.0, y, 0.0 * z]);
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let mut verifier = verifier(strategy, Events::Off);
        let frames = [&collapsed, &squares(0.0), &squares(0.0), &squares(1.5)];
        let verdicts = frames.map(|set| {
            let verdict = verifier.step(0, 0.0, set).unwrap().verdict;
            verifier.settle();
            verdict
        });
        use Verdict::*;
        assert_eq!(verdicts, [Undecided, Undecided, Intact, Changed]);
    }
}

#[test]
fn a_cancelled_search_for_pull_throughs_gives_no_report() {
    let still = tangle(12, 1000, 3);
    let moved = tangle(12, 1000, 4);
    let mut verifier = verifier(Strategy::Full, Events::All);
    let _ = verifier.step(0, 0.0, &still).unwrap();
    let progress = verifier.progress();
    // Cancel once all linking numbers, or nearly all, are known.
    let ended = std::thread::scope(|scope| {
        let step = scope.spawn(|| verifier.step(1, 0.0, &moved).err());
        let computed = || {
            let (done, total) = progress.pairs();
            done == total
        };
        // All are known before the step begins, too.
        for known in [true, false] {
            while computed() == known && !step.is_finished() {
                std::thread::sleep(Duration::from_micros(100));
            }
        }
        progress.cancel();
        step.join().unwrap()
    });
    assert!(matches!(ended, Some(Error::Cancelled)), "{ended:?}");
}

#[test]
fn a_certificate_is_complete_even_if_it_is_cancelled() {
    let set = squares(0.0);
    let mut certifier = Certifier::default();
    let whole = certifier.certify(&set).0.clone();
    certifier.progress().cancel();
    assert_eq!(*certifier.certify(&set).0, whole);
}

#[test]
fn noise_is_refused_with_a_kernel_on_splines_and_with_invalid_lengths() {
    let set = squares(0.0);
    let usage = |certifier: &mut Certifier, set: &CurveSet, noise: f64| {
        matches!(certifier.certify_noisy(set, noise), Err(Error::Usage(_)))
    };
    for method in Method::ALL.into_iter().filter(|m| *m != Method::Auto) {
        let mut certifier = Certifier::new(&SessionOptions {
            kernel: method,
            ..SessionOptions::default()
        })
        .unwrap();
        assert!(usage(&mut certifier, &set, 0.1), "{method}");
    }
    let mut certifier = Certifier::default();
    for noise in [-0.1, f64::NAN, f64::INFINITY] {
        assert!(usage(&mut certifier, &set, noise), "{noise}");
    }
    let points: Vec<f64> = (0..24).map(|k| f64::from(k * k % 7)).collect();
    let splines = CurveSet::from_counts(Basis::BSpline, &[-8], Positions::F64(&points)).unwrap();
    assert!(usage(&mut certifier, &splines, 0.1));
    assert!(!usage(&mut certifier, &set, 0.1));
}

#[test]
fn a_contact_of_open_curves_that_ends_after_a_change_of_the_curves_is_undecided() {
    let mut verifier = Engine::new(SessionOptions {
        events: Events::Between,
        ..SessionOptions::default()
    })
    .unwrap();
    let rod = [-1.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    let across = |z: f64| [0.0, -1.0, z, 0.0, 1.0, z];
    let mut step = |seq, rods: [[f64; 6]; 2]| {
        let positions = rods.concat();
        let set = CurveSet::from_counts(Basis::Polyline, &[2, 2], Positions::F64(&positions));
        verifier.step(seq, 0.0, &set.unwrap()).unwrap()
    };
    assert_eq!(step(0, [rod, across(1.0)]).verdict, Verdict::Intact);
    assert_eq!(step(1, [rod, across(0.0)]).verdict, Verdict::Contact);
    let names = [["a", "b"], ["b", "a"]].map(CurveLabels::named);
    let change = CurveChange::by_name(&names[0], &names[1]).unwrap();
    let positions = [across(-1.0), rod].concat();
    let set = CurveSet::from_counts(Basis::Polyline, &[2, 2], Positions::F64(&positions));
    let report = verifier
        .verify(Next {
            change: Some(&change),
            ..Next::new(2, 0.0, &Arc::new(set.unwrap()))
        })
        .unwrap();
    assert_eq!(report.verdict, Verdict::Undecided, "{report:?}");
    assert_eq!(report.last_intact, Some(0));
}
