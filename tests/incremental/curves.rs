//! Curves that are added, removed and reordered between frames.

use crate::movie::Movie;
use crate::sets::{random_set, values};
use crate::support::random::Random;
use crate::support::session::Step;
use linkwatch::{
    Basis, Cell, Certificate, Certifier, CurveLabels, CurveSet, Events, FrameInfo, Positions,
    Precision, RawFrame, Report, Session, SessionOptions, Stats, Strategy, Verdict,
};
use std::collections::BTreeMap;
use std::ops::Range;

/// Two curves, named by their indices among all curves, the smaller index first.
type Names = [usize; 2];

/// Returns some curves of a set, in this order.
pub fn some_curves(set: &CurveSet, curves: &[usize]) -> CurveSet {
    let mut bytes = Vec::new();
    set.write_positions(&mut bytes);
    let single: Vec<f32>;
    let double: Vec<f64>;
    let all = match set.precision() {
        Precision::F32 => {
            let numbers = bytes.as_chunks().0.iter();
            single = numbers.map(|b| f32::from_le_bytes(*b)).collect();
            Positions::F32(&single)
        }
        Precision::F64 => {
            let numbers = bytes.as_chunks().0.iter();
            double = numbers.map(|b| f64::from_le_bytes(*b)).collect();
            Positions::F64(&double)
        }
    };
    let all = values(all);
    let counts: Vec<i32> = set.counts().collect();
    let first = |i: usize| {
        let points = counts[..i].iter().map(|n| n.unsigned_abs() as usize);
        3 * points.sum::<usize>()
    };
    let of = |&i: &usize| &all[first(i)..first(i) + 3 * counts[i].unsigned_abs() as usize];
    let xyz: Vec<f64> = curves.iter().flat_map(of).copied().collect();
    let counts: Vec<i32> = curves.iter().map(|&i| counts[i]).collect();
    let single: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
    let positions = match set.precision() {
        Precision::F32 => Positions::F32(&single),
        Precision::F64 => Positions::F64(&xyz),
    };
    CurveSet::from_counts(set.basis(), &counts, positions).unwrap()
}

/// Adds, removes or swaps curves.
pub fn change(random: &mut Random, active: &mut Vec<usize>, waiting: &mut Vec<usize>) {
    match random.below(3) {
        0 if !waiting.is_empty() => {
            let at = random.below(active.len() + 1);
            active.insert(at, waiting.remove(0));
        }
        1 if active.len() > 2 => {
            active.remove(random.below(active.len()));
        }
        _ => {
            let [i, j] = [0; 2].map(|_: usize| random.below(active.len()));
            active.swap(i, j);
        }
    }
}

fn labels(curves: &[usize]) -> CurveLabels {
    CurveLabels::named(curves.iter().map(|i| format!("curve {i}")))
}

fn names(curves: &[usize], i: u32, j: u32) -> Names {
    let mut names = [i, j].map(|i| curves[i as usize]);
    names.sort_unstable();
    names
}

/// Returns the linking number of each pair of closed curves that has one.
fn linking_numbers(set: &CurveSet, certificate: &Certificate) -> Vec<(u32, u32, i64)> {
    let missing = |i: u32, j: Option<u32>| {
        let mut undefined = certificate.undefined().iter();
        undefined.any(|d| (d.i, d.j) == (i, j))
    };
    let closed = (0..set.len() as u32).filter(|&i| set.curve(i as usize).closed);
    let closed: Vec<u32> = closed.filter(|&i| !missing(i, None)).collect();
    let pairs = closed.iter().enumerate();
    let pairs = pairs.flat_map(|(k, &i)| closed[k + 1..].iter().map(move |&j| (i, j)));
    let defined = pairs.filter(|&(i, j)| !missing(i, Some(j)));
    let lambda = |(i, j)| {
        let link = certificate.links().iter().find(|l| (l.i, l.j) == (i, j));
        (i, j, link.map_or(0, |l| l.lambda))
    };
    defined.map(lambda).collect()
}

/// Returns the events: the names of the curves, the fraction of the step, and the sign.
fn events(report: &Report, curves: &[usize]) -> Vec<(Names, u64, i32)> {
    let events = report.events.iter();
    let mut events: Vec<_> = events
        .map(|e| (names(curves, e.i, e.j), e.fraction.to_bits(), e.sign))
        .collect();
    events.sort_unstable();
    events
}

#[derive(Debug, Default)]
struct Tally {
    changes_of_curves: u32,
    changed_links: u32,
    pull_throughs_across: u32,
    intact: u32,
}

/// Runs sequences in which a curve that disappeared never returns. Compares linking numbers with
/// those of full runs by name, and pull-throughs across a change with those of a session that has
/// only the curves that continue.
fn sequences(basis: Basis, precision: Precision, seeds: Range<u64>) -> Tally {
    let mut tally = Tally::default();
    for seed in seeds {
        let mut random = Random::new(seed);
        let all = 7;
        let set = random_set(&mut random, basis, precision, all);
        let what = format!("seed {seed}, {basis:?}, {precision:?}");
        let new = |strategy| {
            Session::new(SessionOptions {
                strategy,
                events: Events::All,
                keep_open: true,
                ..SessionOptions::default()
            })
            .unwrap()
        };
        let mut sessions = [Strategy::Full, Strategy::Incremental, Strategy::Paranoid].map(new);
        let mut active: Vec<usize> = (0..4).collect();
        let mut waiting: Vec<usize> = (4..all).collect();
        let mut movie = Movie::new(Random::new(random.next()), set);
        let mut expected: BTreeMap<Names, i64> = BTreeMap::new();
        let mut last: Option<CurveSet> = None;
        let mut layout = 0;
        for frame in 0..25 {
            movie.advance(frame);
            let before = active.clone();
            if frame > 0 && random.one_in(4) {
                change(&mut random, &mut active, &mut waiting);
            }
            let set = some_curves(&movie.set, &active);
            layout += u32::from(active != before);
            let info = FrameInfo::at(frame, 0.0).with_labels(layout, labels(&active));
            let reports = sessions.each_mut().map(|session| {
                let mut verified = session.step_at(info.clone(), &set);
                assert!(!verified.work.disagreed, "{what}, frame {frame}");
                verified.report.stats = Stats::default();
                verified.report
            });
            let [report, others @ ..] = reports;
            for other in others {
                assert_eq!(report, other, "{what}, frame {frame}");
            }

            let mut changes = BTreeMap::new();
            let mut certifier = Certifier::default();
            let (certificate, _) = certifier.certify(&set);
            for (i, j, found) in linking_numbers(&set, certificate) {
                let pair = names(&active, i, j);
                let expected = *expected.entry(pair).or_insert(found);
                if expected != found {
                    changes.insert(pair, (expected, found));
                }
            }
            let reported = report.changes.iter();
            let reported = reported.map(|c| (names(&active, c.i, c.j), (c.expected, c.found)));
            assert_eq!(
                reported.collect::<BTreeMap<_, _>>(),
                changes,
                "{what}, frame {frame}"
            );
            let listed = |names: &[String]| names.len();
            let appeared = active.iter().filter(|i| !before.contains(i)).count();
            let gone = before.iter().filter(|i| !active.contains(i)).count();
            assert_eq!(
                (listed(&report.appeared), listed(&report.gone)),
                (appeared, gone)
            );

            if let Some(last) = last.filter(|_| active != before) {
                tally.changes_of_curves += 1;
                let kept: Vec<usize> = active
                    .iter()
                    .copied()
                    .filter(|i| before.contains(i))
                    .collect();
                let old = |i: &usize| before.iter().position(|b| b == i).unwrap();
                let old: Vec<usize> = kept.iter().map(old).collect();
                let mut alone = new(Strategy::Full);
                alone.step(0, some_curves(&last, &old));
                let known = alone.step(1, some_curves(&movie.set, &kept)).report;
                assert_eq!(
                    events(&report, &active),
                    events(&known, &kept),
                    "{what}, frame {frame}"
                );
                tally.pull_throughs_across += report.events.len() as u32;
            }
            tally.changed_links += report.changes.len() as u32;
            tally.intact += u32::from(report.verdict == linkwatch::Verdict::Intact);
            last = Some(set);
        }
    }
    println!("{basis:?}, {precision:?}: {tally:?}");
    tally
}

fn sequences_of_each_basis(count: u64) {
    for (basis, first) in Basis::ALL
        .into_iter()
        .zip([300_000, 310_000, 320_000, 330_000])
    {
        for precision in [Precision::F32, Precision::F64] {
            let tally = sequences(basis, precision, first..first + count);
            assert!(u64::from(tally.changes_of_curves) > 2 * count, "{tally:?}");
            assert!(tally.changed_links > 10, "{tally:?}");
            assert!(tally.pull_throughs_across > 5, "{tally:?}");
            assert!(u64::from(tally.intact) > count, "{tally:?}");
        }
    }
}

#[test]
fn curves_that_come_and_go_are_compared_by_name() {
    sequences_of_each_basis(8);
}

/// The same test with 20 times as many sequences.
#[test]
#[ignore = "takes minutes"]
fn very_many_curves_that_come_and_go() {
    sequences_of_each_basis(160);
}

#[test]
fn a_curve_that_appeared_in_a_rejected_frame_is_expected_from_the_next_one() {
    let mut session = Session::new(SessionOptions {
        max_pairs: 1,
        ..SessionOptions::default()
    })
    .unwrap();
    let flat = |z: f64| [-1., -1., z, 1., -1., z, 1., 1., z, -1., 1., z];
    let upright = [0., 0., -1., 2., 0., -1., 2., 0., 1., 0., 0., 1.];
    let mut feed = |seq, rings: &[[f64; 12]], (layout, names): (u32, &[&str])| {
        let counts = vec![-4; rings.len()];
        let positions = rings.concat();
        let raw = RawFrame {
            basis: Basis::Polyline,
            counts: &counts,
            positions: Positions::F64(&positions),
        };
        let names = CurveLabels::named(names.iter().copied());
        let info = FrameInfo::at(seq, 0.0).with_labels(layout, names);
        session.feed(info, raw).unwrap()
    };
    let first = feed(0, &[flat(0.0), flat(9.0)], (0, &["a", "z"]));
    assert_eq!(first.verdict, Verdict::Intact);
    let rings = [flat(0.0), upright, flat(0.1)];
    let rejected = feed(1, &rings, (1, &["a", "b", "c"])).rejected.unwrap();
    assert!(rejected.contains("pairs of curves overlap"), "{rejected}");
    let rings = [upright, flat(0.0)];
    let report = feed(2, &rings, (2, &["b", "a"]));
    assert_eq!(report.verdict, Verdict::Intact, "{report:?}");
    assert_eq!(
        (report.appeared, report.gone),
        (vec!["b".into()], vec!["z".into()])
    );
    // From now on the link is expected.
    let report = feed(3, &[flat(5.0), flat(0.0)], (2, &["b", "a"]));
    assert_eq!(report.verdict, Verdict::Changed);
}

/// Regression test: a description of the curves replaces the decisions which of them are closed. A
/// ring that had been cut became an open curve, and the frame was intact although it lacked the
/// linking numbers of the ring.
#[test]
fn a_curve_that_is_open_when_it_is_described_again_is_not_intact() {
    let square =
        |x: f64| [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[a, b]| [a + x, b, 0.0]);
    let xyz: Vec<f64> = [square(0.0), square(5.0)]
        .as_flattened()
        .as_flattened()
        .to_vec();
    for events in [Events::Off, Events::Between] {
        let mut session = Session::new(SessionOptions {
            events,
            ..SessionOptions::default()
        })
        .unwrap();
        let mut report = |seq: u32, counts: [i32; 2], names: [&str; 2]| {
            let info = FrameInfo::at(seq.into(), 0.0).with_labels(seq, CurveLabels::named(names));
            let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz));
            session.feed(info, set.unwrap()).unwrap()
        };
        assert_eq!(report(0, [-4, -4], ["a", "b"]).verdict, Verdict::Intact);
        assert_eq!(report(1, [-4, -4], ["b", "a"]).verdict, Verdict::Intact);
        let cut = report(2, [-4, 4], ["a", "b"]);
        assert_eq!(cut.verdict, Verdict::Undecided, "{events:?}: {cut:?}");
        assert!(
            cut.missing[0].contains("curve b: closed in the previous frame"),
            "{cut:?}"
        );
    }
}

/// Regression test: the pairs of a curve that became closed were expected to be unlinked.
#[test]
fn a_curve_that_is_closed_later_is_expected_with_its_first_linking_numbers() {
    let ring = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| [x, y, 0.0]);
    let other = |shift: f64| {
        [[0.0, 1.0], [0.0, -1.0], [2.0, -1.0], [2.0, 1.0]].map(|[x, z]| [x + shift, 0.0, z])
    };
    let far = ring.map(|[x, y, z]| [x + 9.0, y, z]);
    for (events, cuts) in [(Events::Off, 0), (Events::Between, 0), (Events::Between, 1)] {
        let mut session = Session::new(SessionOptions {
            events,
            ..SessionOptions::default()
        })
        .unwrap();
        let mut report = |seq: u32, closed: bool, shift: f64| {
            let xyz = [ring, other(shift), far].concat();
            let counts = [-4, if closed { -4 } else { 4 }, -4];
            let labels = CurveLabels::named(["a", "b", "c"]);
            let info = FrameInfo {
                cuts: cuts * u32::from(closed),
                ..FrameInfo::at(seq.into(), 0.0).with_labels(u32::from(closed), labels)
            };
            let positions = Positions::F64(xyz.as_flattened());
            let set = CurveSet::from_counts(Basis::Polyline, &counts, positions).unwrap();
            session.feed(info, set).unwrap()
        };
        assert_eq!(report(0, false, 0.0).verdict, Verdict::Intact);
        let closed = report(1, true, 0.0);
        assert_eq!(closed.verdict, Verdict::Undecided, "{closed:?}");
        assert!(closed.missing[0].contains("curve b: open in the previous frame"));
        assert_eq!(report(2, true, 0.1).verdict, Verdict::Intact);
        let apart = report(3, true, 4.0);
        assert_eq!(apart.changes[0].expected.abs(), 1, "{apart:?}");
        assert_eq!(apart.changes[0].found, 0);
    }
    // In a cell, all frames have the same curves.
    for events in [Events::Off, Events::Between] {
        let mut session = Session::new(SessionOptions {
            events,
            cell: Some(Cell::orthogonal([0.0; 3], [40.0; 3])),
            ..SessionOptions::default()
        })
        .unwrap();
        for (layout, count, verdict) in [(0, 4, Verdict::Intact), (1, -4, Verdict::Rejected)] {
            let xyz = [ring, other(0.0), far].concat();
            let labels = CurveLabels::named(["a", "b", "c"]);
            let info = FrameInfo::at(layout.into(), 0.0).with_labels(layout, labels);
            let positions = Positions::F64(xyz.as_flattened());
            let counts = [-4, count, -4];
            let set = CurveSet::from_counts(Basis::Polyline, &counts, positions).unwrap();
            assert_eq!(session.feed(info, set).unwrap().verdict, verdict);
        }
    }
}

/// An open square whose ends meet if `gap` is 0, and an open strand beside its edge x = 1.
fn square_and_strand(gap: f64, x: f64) -> [Vec<[f64; 3]>; 2] {
    let square = [[-1., -1., 0.], [1., -1., 0.], [1., 1., 0.], [-1., 1., 0.]];
    let end = [-1., gap - 1., 0.];
    let strand = [-1., -0.4, 0.4, 1.].map(|z| [x, 0., z]);
    [[&square[..], &[end]].concat(), strand.to_vec()]
}

/// Returns a session that searches for pull-throughs.
fn searching() -> Session {
    let options = SessionOptions {
        events: Events::Between,
        ..SessionOptions::default()
    };
    Session::new(options).unwrap()
}

/// Feeds curves with names to a session, in the precision of the positions.
fn feed_named(
    session: &mut Session,
    (seq, layout): (u64, u32),
    names: [&str; 2],
    (curves, signs): (&[Vec<[f64; 3]>; 2], [i32; 2]),
    precision: Precision,
) -> Report {
    let counts = [0, 1].map(|i| signs[i] * curves[i].len() as i32);
    let double = curves.concat().concat();
    let single: Vec<f32> = double.iter().map(|&x| x as f32).collect();
    let frame = RawFrame {
        basis: Basis::Polyline,
        counts: &counts,
        positions: match precision {
            Precision::F32 => Positions::F32(&single),
            Precision::F64 => Positions::F64(&double),
        },
    };
    let info = FrameInfo::at(seq, 0.0).with_labels(layout, CurveLabels::named(names));
    session.feed(info, frame).unwrap()
}

/// Regression test: an open curve whose ends had met was closed when the curves were described
/// again, and pull-throughs in the step to that frame were not searched for.
#[test]
fn an_open_curve_stays_open_when_it_is_described_again() {
    let mut session = searching();
    let mut feed = |seq, gap, x, reordered| {
        let (mut curves, mut names) = (square_and_strand(gap, x), ["a", "b"]);
        if reordered {
            curves.reverse();
            names.reverse();
        }
        let place = (seq, u32::from(reordered));
        let report = feed_named(
            &mut session,
            place,
            names,
            (&curves, [1, 1]),
            Precision::F64,
        );
        (report.verdict, report.events.len())
    };
    assert_eq!(feed(0, 0.5, 0.7, false), (Verdict::Intact, 0));
    assert_eq!(feed(1, 0.0, 0.8, false), (Verdict::Intact, 0));
    assert_eq!(feed(2, 0.0, 1.2, true), (Verdict::Changed, 1));
    assert_eq!(feed(3, 0.0, 1.3, true), (Verdict::Intact, 0));
}

/// Regression test: steps to curves that were described again in another precision, or as closed,
/// were not searched for pull-throughs, and the frame was intact.
#[test]
fn a_step_that_cannot_be_searched_is_not_intact() {
    let square = square_and_strand(0.5, 0.8);
    for (precision, sign, words) in [
        (
            Precision::F64,
            1,
            "pull-throughs: the basis or the precision",
        ),
        (
            Precision::F32,
            -1,
            "pull-throughs of curve a: open in the previous frame",
        ),
    ] {
        let mut session = searching();
        let mut feed = |seq, layout, curves, signs, precision| {
            feed_named(
                &mut session,
                (seq, layout),
                ["a", "b"],
                (curves, signs),
                precision,
            )
        };
        let first = feed(0, 0, &square, [1, 1], Precision::F32);
        assert_eq!(first.verdict, Verdict::Intact);
        let passed = square_and_strand(0.5, 1.2);
        let report = feed(1, 1, &passed, [sign, 1], precision);
        assert_eq!(report.verdict, Verdict::Undecided, "{report:?}");
        assert!(report.missing[0].contains(words), "{:?}", report.missing);
        let next = feed(2, 1, &passed, [sign, 1], precision);
        assert_eq!(next.verdict, Verdict::Intact, "{next:?}");
    }
}

/// Regression test: after a rejected frame with other names, the curves of the last verified frame
/// counted as described again, and a contact that ended was undecided.
#[test]
fn a_rejected_description_leaves_no_trace() {
    let strands = |z: f64| -> [Vec<[f64; 3]>; 2] {
        let along = [-2., -1., 0., 1., 2.];
        [
            along.map(|x| [x, 0., 0.]).to_vec(),
            along.map(|y| [0.35, y, z]).to_vec(),
        ]
    };
    let verdicts = [false, true].map(|rejected| {
        let mut session = searching();
        let mut feed = |seq, layout, names, z| {
            let curves = strands(z);
            let place = (seq, layout);
            feed_named(
                &mut session,
                place,
                names,
                (&curves, [1, 1]),
                Precision::F64,
            )
            .verdict
        };
        let mut verdicts = vec![feed(0, 0, ["a", "b"], 0.5), feed(1, 0, ["a", "b"], 0.0)];
        if rejected {
            assert_eq!(feed(2, 1, ["b", "a"], f64::NAN), Verdict::Rejected);
        }
        verdicts.extend([feed(3, 2, ["a", "b"], 0.5), feed(4, 2, ["a", "b"], 0.5)]);
        verdicts
    });
    assert_eq!(verdicts[0], verdicts[1]);
    assert_eq!(verdicts[0][1], Verdict::Contact);
}

/// Regression test: the first received frame decided which curves are closed, even if it was
/// rejected. The second frame was received before the rejection.
#[test]
fn a_rejected_first_frame_decides_nothing_for_a_frame_received_before() {
    let mut session = searching();
    let [square, strand] = square_and_strand(0.0, 0.8);
    let good = [square, strand].concat().concat();
    let mut bad = good.clone();
    bad[0] = f64::NAN;
    let receive = |session: &mut Session, seq, xyz: &[f64]| {
        session.receive(FrameInfo::at(seq, 0.0), |copy| {
            copy(RawFrame {
                basis: Basis::Polyline,
                counts: &[5, 4],
                positions: Positions::F64(xyz),
            })
        })
    };
    let first = receive(&mut session, 0, &bad);
    let second = receive(&mut session, 1, &good);
    assert_eq!(
        session.verify(first).unwrap().report.verdict,
        Verdict::Rejected
    );
    let verified = session.verify(second).unwrap();
    assert_eq!(verified.joined, 1);
    assert_eq!(verified.report.stats.open_curves, 1);
}

#[test]
fn a_frame_without_curves_is_rejected() {
    let mut session = searching();
    let none = RawFrame {
        basis: Basis::Polyline,
        counts: &[],
        positions: Positions::F64(&[]),
    };
    let report = session.feed(FrameInfo::at(0, 0.0), none).unwrap();
    assert_eq!(
        report.rejected.as_deref(),
        Some("the frame holds no curves")
    );
}

/// Regression test: these curves were intact, although no earlier frame has curves to compare with.
#[test]
fn curves_that_are_not_those_of_the_frame_before_are_undecided() {
    let pair = square_and_strand(0.5, 3.0);
    let longer = [pair[0].clone(), [&pair[1][..], &[[3.0, 0.0, 2.0]]].concat()];
    let missing = |session: &mut Session, k: u32, names, curves| {
        let report = feed_named(
            session,
            (k.into(), k),
            names,
            (curves, [1, 1]),
            Precision::F64,
        );
        (report.verdict, report.missing)
    };
    let intact = (Verdict::Intact, Vec::new());
    let undecided = |why: &str| (Verdict::Undecided, vec![why.to_owned()]);
    let mut session = searching();
    assert_eq!(missing(&mut session, 0, ["a", "b"], &pair), intact);
    let resized = "pull-throughs of curve b: another number of points than in the previous frame";
    assert_eq!(
        missing(&mut session, 1, ["a", "b"], &longer),
        undecided(resized)
    );
    assert_eq!(missing(&mut session, 2, ["a", "c"], &longer), intact);
    let returned = "what became of curve b while it was gone";
    // Also after its state was saved.
    let options = SessionOptions {
        events: Events::Between,
        ..SessionOptions::default()
    };
    session = Session::resume(options, session.state()).unwrap();
    assert_eq!(
        missing(&mut session, 3, ["a", "b"], &longer),
        undecided(returned)
    );
    let replaced = "all linking numbers: no curve kept its name";
    assert_eq!(
        missing(&mut session, 4, ["d", "e"], &longer),
        undecided(replaced)
    );
    assert_eq!(
        missing(
            &mut session,
            5,
            ["e", "d"],
            &[longer[1].clone(), longer[0].clone()]
        ),
        intact
    );
}

/// Regression test: a session that was resumed from a state took other curves for the same ones.
#[test]
fn a_resumed_session_rejects_other_curves_without_names() {
    let pair = square_and_strand(0.5, 3.0);
    let longer = [pair[0].clone(), [&pair[1][..], &[[3.0, 0.0, 2.0]]].concat()];
    let verdict = |session: &mut Session, seq: u64, curves: &[Vec<[f64; 3]>; 2]| {
        let counts = [-(curves[0].len() as i32), curves[1].len() as i32];
        let xyz = curves.concat();
        let frame = RawFrame {
            basis: Basis::Polyline,
            counts: &counts,
            positions: Positions::F64(xyz.as_flattened()),
        };
        let received = session.receive(FrameInfo::at(seq, 0.0), |copy| copy(frame));
        session.verify(received).unwrap().report.verdict
    };
    for events in [Events::Off, Events::Between] {
        let options = SessionOptions {
            events,
            ..SessionOptions::default()
        };
        let mut session = Session::new(options.clone()).unwrap();
        assert_eq!(verdict(&mut session, 0, &pair), Verdict::Intact);
        session = Session::resume(options, session.state()).unwrap();
        assert_eq!(verdict(&mut session, 1, &longer), Verdict::Rejected);
        assert_eq!(verdict(&mut session, 2, &pair), Verdict::Intact);
    }
}
