//! Tests of the engine's options and errors.

mod steps;

use super::*;
use crate::curve::{Basis, CurveLabels, Point, Positions};
use crate::engine::known::Last;
use crate::incremental::Route;
use crate::ingest::FrameInfo;
use crate::kernels::Method;
use crate::measure::ClearanceOptions;
use crate::session::Session;
use crate::verdict::{Change, DefectKind};
use std::time::Duration;

impl Engine {
    /// Verifies a frame that continues the last one.
    pub(crate) fn step(&mut self, seq: u64, time: f64, set: &CurveSet) -> Result<Report> {
        self.step_shared(seq, time, &Arc::new(set.clone()))
    }

    /// Same as above, for shared curves.
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

    /// Changes a linking number of the last frame to a wrong one.
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

fn engine(strategy: Strategy, events: Events) -> Engine {
    Engine::new(SessionOptions {
        strategy,
        events,
        ..SessionOptions::default()
    })
    .unwrap()
}

/// Returns an engine that has verified three intact frames, and whose monitor no longer detects
/// motion, because its allowances are infinite.
fn blind(strategy: Strategy) -> Engine {
    let mut engine = engine(strategy, Events::Between);
    for frame in 0..3 {
        let report = engine.step(frame, 0.0, &squares(0.0)).unwrap();
        assert_eq!(report.verdict, Verdict::Intact);
        assert!(!engine.work().disagreed);
        engine.settle();
    }
    assert_eq!(engine.work().route, Route::Quiet);
    engine.monitor.make_allowances_infinite();
    engine
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
            // The other engine does not receive the frame with too many pairs.
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

    let mut engine = blind(Strategy::Paranoid);
    let report = engine.step(3, 0.0, &squares(1.2)).unwrap();
    assert!(engine.work().disagreed);
    assert_eq!((report.verdict, report.abort), (Verdict::Changed, true));
    assert_eq!((report.changes.len(), report.events.len()), (1, 1));
    // From then on, frames are computed in full.
    let report = engine.step(4, 0.0, &squares(0.0)).unwrap();
    assert_eq!(engine.work().route, Route::Full);
    assert_eq!((report.changes.len(), report.events.len()), (0, 1));
    assert_eq!(report.verdict, Verdict::Changed, "the link is back");
    let report = engine.step(5, 0.0, &squares(0.0)).unwrap();
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
                    .map(|engine| engine.step(frame as u64, 0.0, &squares(out)).unwrap());
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

/// Returns four parallel strands of a braid, each with a number of points.
fn parallel_strands(points: i32) -> Arc<CurveSet> {
    let along = |k: i32| (0..points).map(move |p| [f64::from(k), 0.0, f64::from(p)]);
    let xyz: Vec<f64> = (0..4).flat_map(along).flatten().collect();
    let set = CurveSet::from_counts(Basis::Polyline, &[points; 4], Positions::F64(&xyz));
    Arc::new(set.unwrap())
}

/// Regression test: the loops of braids were verified with one another, and with their own curves,
/// after a rejected frame.
#[test]
fn a_rejected_frame_keeps_the_filter_of_pairs() {
    let mut engine = Engine::new(SessionOptions {
        braids: Some(Braids::Auto),
        ..SessionOptions::default()
    })
    .unwrap();
    let first = parallel_strands(9);
    let _ = engine.verify(Next::new(0, 0.0, &first)).unwrap();
    let filter = engine.full.search.filter.clone();
    assert!(filter.is_some());
    let other = parallel_strands(8);
    assert!(engine.verify(Next::new(1, 0.0, &other)).is_err());
    assert_eq!(engine.full.search.filter, filter);
    let _ = engine.verify(Next::new(2, 0.0, &first)).unwrap();
    assert_eq!(engine.baseline().unwrap().curves, 4);
}

/// Regression test: pairs that touched in the first frame had no linking number until the end of
/// the run.
#[test]
fn a_pair_takes_its_number_from_the_first_frame_that_has_one() {
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let mut engine = engine(strategy, Events::Off);
        // In contact, linked, in contact, apart.
        let outs = [1.0, 0.0, 0.0, 1.0, 1.5, 0.0];
        let reports = outs.map(|out| {
            let report = engine.step(0, 0.0, &squares(out)).unwrap();
            engine.settle();
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
        let mut engine = Engine::new(SessionOptions {
            early_exit,
            events,
            ..SessionOptions::default()
        })
        .unwrap();
        let progress = engine.progress();
        let ended = std::thread::scope(|scope| {
            let step = scope.spawn(|| engine.step(0, 0.0, &frames[0]).err());
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
            engine.baseline(),
            None,
            "no baseline from an incomplete certificate"
        );
        // Every later step fails, too.
        let again = engine.step(1, 0.0, &frames[1]);
        assert!(matches!(again, Err(Error::Cancelled)));
    }
}

#[test]
fn a_curve_that_was_degenerate_in_the_first_frame_takes_its_numbers_later() {
    let collapsed = squares_with(|[_, y, z]| [1.0, y, 0.0 * z]);
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let mut engine = engine(strategy, Events::Off);
        let frames = [&collapsed, &squares(0.0), &squares(0.0), &squares(1.5)];
        let verdicts = frames.map(|set| {
            let verdict = engine.step(0, 0.0, set).unwrap().verdict;
            engine.settle();
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
    let mut engine = engine(Strategy::Full, Events::All);
    let _ = engine.step(0, 0.0, &still).unwrap();
    let progress = engine.progress();
    // Cancel once all linking numbers, or nearly all, are known.
    let ended = std::thread::scope(|scope| {
        let step = scope.spawn(|| engine.step(1, 0.0, &moved).err());
        let computed = || {
            let (done, total) = progress.pairs();
            done == total
        };
        // All linking numbers are known from the start.
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
fn a_baseline_with_links_of_a_curve_that_is_open_is_refused() {
    let squares = squares(0.0);
    let mut certifier = Certifier::default();
    let baseline = certifier.certify(&squares).0.clone();
    let mut counts: Vec<i32> = squares.counts().collect();
    counts[1] = -counts[1];
    let opened = CurveSet::from_counts(Basis::Polyline, &counts, squares.positions()).unwrap();
    let mut session = Session::new(SessionOptions {
        baseline: Some(baseline.clone()),
        ..SessionOptions::default()
    })
    .unwrap();
    let refused = session.feed(FrameInfo::at(0, 0.0), &opened);
    assert!(
        matches!(refused, Err(Error::OpenInFrame { curve: 1 })),
        "{refused:?}"
    );
    let report = session.feed(FrameInfo::at(1, 0.0), &squares).unwrap();
    assert_eq!(report.verdict, Verdict::Intact);
    // In a part of a run, a curve may have been opened since the baseline.
    session.begin_part(baseline);
    let report = session.feed(FrameInfo::at(2, 0.0), &opened).unwrap();
    assert_eq!(report.verdict, Verdict::Changed);
}

#[test]
fn a_contact_of_open_curves_that_ends_after_a_change_of_the_curves_is_undecided() {
    let mut engine = Engine::new(SessionOptions {
        events: Events::Between,
        ..SessionOptions::default()
    })
    .unwrap();
    let rod = [-1.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    let across = |z: f64| [0.0, -1.0, z, 0.0, 1.0, z];
    let mut step = |seq, rods: [[f64; 6]; 2]| {
        let positions = rods.concat();
        let set = CurveSet::from_counts(Basis::Polyline, &[2, 2], Positions::F64(&positions));
        engine.step(seq, 0.0, &set.unwrap()).unwrap()
    };
    assert_eq!(step(0, [rod, across(1.0)]).verdict, Verdict::Intact);
    assert_eq!(step(1, [rod, across(0.0)]).verdict, Verdict::Contact);
    let names = [["a", "b"], ["b", "a"]].map(CurveLabels::named);
    let change = CurveChange::by_name(&names[0], &names[1]).unwrap();
    let positions = [across(-1.0), rod].concat();
    let set = CurveSet::from_counts(Basis::Polyline, &[2, 2], Positions::F64(&positions));
    let report = engine
        .verify(Next {
            change: Some(&change),
            ..Next::new(2, 0.0, &Arc::new(set.unwrap()))
        })
        .unwrap();
    assert_eq!(report.verdict, Verdict::Undecided, "{report:?}");
    assert_eq!(report.last_intact, Some(0));
}
