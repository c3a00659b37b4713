//! A yarn that runs through the cell, and its own later periods: compared with the yarn unrolled
//! over many periods, as one open curve in a search for self-crossings.

use crate::support::random::Random;
use crate::support::session::Step;
use crate::yarn::Yarn;
use linkwatch::{
    Basis, CurveSet, Events, FrameInfo, Image, PullThrough, Report, Route, Session, SessionOptions,
    Strategy, Verdict,
};
use std::sync::Arc;

/// A pull-through of a period of a yarn and the one that is some periods later: these periods, the
/// segments of the earlier and of the later one, sign, and millionths of the step.
type Found = (i32, [u32; 2], i32, i64);

fn key(e: &PullThrough, periods: i32, segments: [u32; 2]) -> Found {
    (periods, segments, e.sign, (1e6 * e.fraction).round() as i64)
}

/// Returns the last report on some frames.
fn last(frames: impl Iterator<Item = CurveSet>, options: SessionOptions) -> Report {
    let mut session = Session::new(options).unwrap();
    let steps = frames.enumerate().map(|(k, set)| {
        let set = Arc::new(set);
        session
            .step_at(FrameInfo::at(k as u64, k as f64), &set)
            .report
    });
    steps.last().unwrap()
}

/// Returns the number of periods, if a translation is a multiple of a period.
fn multiple(image: Image, period: Image) -> Option<i32> {
    (-9..10).find(|&k| image == period.map(|n| k * n))
}

/// Returns the pull-throughs of a periodic report among the periods of the yarn.
fn of_periodic(yarn: &Yarn, report: &Report) -> Vec<Found> {
    let all = report.events.iter().chain(&report.unresolved);
    let found = all.filter_map(|e| {
        let periods = multiple(e.image, yarn.period)?;
        let [s, t] = e.segments;
        // The image may be an earlier period.
        Some(match periods < 0 {
            true => key(e, -periods, [t, s]),
            false => key(e, periods, [s, t]),
        })
    });
    let mut found: Vec<Found> = found.collect();
    found.sort_unstable();
    found
}

/// Returns the pull-throughs of an unrolled yarn that begin in its second period.
fn of_unrolled(yarn: &Yarn, report: &Report) -> Vec<Found> {
    let n = yarn.segments();
    let all = report.events.iter().chain(&report.unresolved);
    let found = all.filter_map(|e| {
        let [s, t] = e.segments;
        let periods = (t / n) as i32 - (s / n) as i32;
        (s / n == 1).then(|| key(e, periods, [s % n, t % n]))
    });
    let mut found: Vec<Found> = found.collect();
    found.sort_unstable();
    found
}

fn is_unsure(report: &Report) -> bool {
    !report.defects.is_empty() || !report.missing.is_empty()
}

/// Compares the pull-throughs of a step of a yarn with those of the yarn unrolled. Returns their
/// number between different periods, or `None` if the periodic search is undecided.
fn compare(
    frames: &[Yarn],
    strategy: Strategy,
    agreement: &mut Agreement,
    name: &str,
) -> Option<usize> {
    let yarn = &frames[0];
    let reach = frames.iter().map(Yarn::reach).max().unwrap();
    let mut plain = yarn.options(strategy, Events::All);
    plain.cell = None;
    let unrolled = last(frames.iter().map(|f| f.unrolled(reach + 2)), plain);
    let options = yarn.options(strategy, Events::All);
    let periodic = last(frames.iter().map(|f| f.unrolled(1)), options);
    if is_unsure(&unrolled) {
        assert!(is_unsure(&periodic), "{name}: {unrolled:?}");
    }
    if is_unsure(&periodic) {
        assert_ne!(periodic.verdict, Verdict::Intact);
        return None;
    }
    let expected = of_unrolled(yarn, &unrolled);
    let found = of_periodic(yarn, &periodic);
    assert_equal(yarn, [&found, &expected], agreement, name);
    // Without a search of the yarn itself, those of different periods.
    let options = yarn.options(strategy, Events::Between);
    let between = last(frames.iter().map(|f| f.unrolled(1)), options);
    let different: Vec<Found> = expected.into_iter().filter(|f| f.0 > 0).collect();
    let found = of_periodic(yarn, &between);
    assert_equal(yarn, [&found, &different], agreement, name);
    Some(different.len())
}

/// Numbers of pull-throughs of splines: of the periods, of the unrolled yarn, and common ones.
#[derive(Debug, Default)]
struct Agreement {
    found: usize,
    expected: usize,
    common: usize,
}

/// Compares pull-throughs. Splines are replaced by polylines that depend on what is near, so their
/// times differ a little, and two that cancel, where splines hardly touch or fold, may be missing
/// in one of both. So these are only counted.
fn assert_equal(yarn: &Yarn, both: [&[Found]; 2], agreement: &mut Agreement, name: &str) {
    let [found, expected] = both;
    if yarn.basis == Basis::Polyline {
        let apart = |(a, b): (&Found, &Found)| (a.3 - b.3).abs();
        let most = found.iter().zip(expected).map(apart).max();
        assert!(most.unwrap_or(0) <= 1, "{name}: {found:?} {expected:?}");
    }
    let keys = |all: &[Found]| all.iter().map(|f| (f.0, f.1, f.2)).collect::<Vec<_>>();
    let [found, mut expected] = [found, expected].map(keys);
    if yarn.basis == Basis::Polyline {
        assert_eq!(found, expected, "{name}");
    }
    agreement.found += found.len();
    agreement.expected += expected.len();
    for key in found {
        if let Some(k) = expected.iter().position(|other| *other == key) {
            expected.swap_remove(k);
            agreement.common += 1;
        }
    }
}

#[test]
fn pull_throughs_of_a_yarn_and_its_later_periods_are_those_of_the_unrolled_yarn() {
    for basis in Basis::ALL {
        let (mut total, mut decided, mut agreement) = (0, 0, Agreement::default());
        for seed in 0..160 {
            let mut random = Random::from_key([seed, 52]);
            let yarn = Yarn::random(seed, basis);
            let amplitude = [0.1, 0.8, 2.5][seed as usize % 3];
            let (first, second) = (
                yarn.moved(&mut random, 0.1),
                yarn.moved(&mut random, amplitude),
            );
            let strategy = [Strategy::Full, Strategy::Incremental][seed as usize % 2];
            let name = format!("{basis:?}, seed {seed}");
            let found = compare(&[yarn, first, second], strategy, &mut agreement, &name);
            total += found.unwrap_or(0);
            decided += usize::from(found.is_some());
        }
        println!("{basis:?}: {total} pull-throughs, {decided} decided; {agreement:?}");
        let most = agreement.found.max(agreement.expected);
        assert!(
            100 * agreement.common >= 98 * most,
            "{basis:?}: {agreement:?}"
        );
        assert!(decided >= 158, "{basis:?}: {decided} decided");
        assert!(total > 50, "{basis:?}: {total} pull-throughs");
    }
}

/// On a coarse grid, periods touch, lie in common planes, and pass through one another at vertices.
/// Whatever the unrolled yarn does not decide, the periods do not decide either.
#[test]
fn contacts_of_a_yarn_and_its_later_periods_are_never_overlooked() {
    let (mut total, mut decided) = (0, 0);
    for seed in 0..400 {
        let mut random = Random::from_key([seed, 53]);
        let yarn = Yarn::random(seed, Basis::Polyline).snapped(1.0);
        let next = yarn.moved(&mut random, 2.5).snapped(1.0);
        let name = format!("Polyline on a grid, seed {seed}");
        let found = compare(
            &[yarn, next],
            Strategy::Full,
            &mut Agreement::default(),
            &name,
        );
        total += found.unwrap_or(0);
        decided += usize::from(found.is_some());
    }
    println!("{total} pull-throughs, {decided} decided");
    assert!(decided > 50 && decided < 350, "{decided} decided");
    assert!(total > 50, "{total} pull-throughs");
}

/// A yarn along x of period 2 with a finger of seven segments that reaches over the next period:
/// its fourth segment is above the first segment of that period, at this height.
fn finger(height: f64) -> Yarn {
    Yarn {
        cell: "2,9,9".parse().unwrap(),
        period: [1, 0, 0],
        basis: Basis::Polyline,
        points: vec![
            [0.0, 0.0, 0.0],
            [0.5, 0.0, 0.0],
            [1.0, -1.0, 1.0],
            [2.25, -1.0, height],
            [2.25, 1.0, height],
            [1.0, 1.0, 1.0],
            [1.5, 0.0, 0.0],
        ],
    }
}

/// The finger is pulled through the next period: from above, so the linking number of the segments,
/// closed in any way, grows by 1. The yarn may start at any of its vertices, and run backwards.
#[test]
fn a_finger_pulled_through_the_next_period_is_found_once() {
    for (start, backwards) in (0..7).flat_map(|start| [(start, false), (start, true)]) {
        let given = |height: f64| {
            let mut yarn = finger(height);
            yarn.points.rotate_left(start);
            for p in &mut yarn.points[7 - start..] {
                p[0] += 2.0;
            }
            if backwards {
                yarn.points.reverse();
                yarn.period = [-1, 0, 0];
            }
            yarn
        };
        let frames = [1.0, -1.0].map(|height| given(height).unrolled(1));
        let options = given(1.0).options(Strategy::Full, Events::All);
        let all = last(frames.clone().into_iter(), options);
        let name = format!("start {start}, backwards: {backwards}");
        assert_eq!(all.verdict, Verdict::Changed, "{name}: {all:?}");
        let [event] = &all.events[..] else {
            panic!("{name}: {all:?}")
        };
        assert_eq!((event.i, event.j, event.sign), (0, 0, 1), "{name}");
        assert!((event.fraction - 0.5).abs() < 1e-9, "{name}: {event:?}");
        // Four segments lie between the first segment and the fourth one of the period before.
        let [s, t] = event.segments.map(i64::from);
        let periods = i64::from(event.image[0] * given(1.0).period[0]);
        assert_eq!((7 * periods + t - s).abs(), 4, "{name}: {event:?}");
        let options = given(1.0).options(Strategy::Full, Events::Between);
        let between = last(frames.into_iter(), options);
        let expected = usize::from(periods != 0);
        assert_eq!(between.events.len(), expected, "{name}: {between:?}");
    }
}

/// Frames of a yarn that moves a little, or much.
fn motion(seed: u64, basis: Basis) -> Vec<Yarn> {
    let mut random = Random::from_key([seed, 54]);
    let mut frames = vec![Yarn::random(seed, basis)];
    for _ in 0..24 {
        let amplitude = random.pick(&[0.0, 1e-6, 1e-4, 1e-3, 0.01, 0.3]);
        let next = frames[frames.len() - 1].moved(&mut random, amplitude);
        frames.push(next);
    }
    frames
}

/// Frames that are verified incrementally have the findings of a search of all pairs.
#[test]
fn incremental_searches_of_yarns_find_what_full_ones_find() {
    for basis in Basis::ALL {
        let (mut quiet, mut partial, mut found) = (0, 0, 0);
        for seed in 0..24 {
            let frames = motion(seed, basis);
            let events = [Events::Between, Events::All][seed as usize % 2];
            let session = |strategy| Session::new(frames[0].options(strategy, events)).unwrap();
            let strategies = [Strategy::Full, Strategy::Incremental, Strategy::Paranoid];
            let mut sessions = strategies.map(session);
            for (seq, frame) in frames.iter().enumerate() {
                let set = Arc::new(frame.unrolled(1));
                let verified = sessions.each_mut().map(|session| {
                    session.settle();
                    session.step_at(FrameInfo::at(seq as u64, seq as f64), &set)
                });
                let findings = |r: &Report| {
                    (
                        r.verdict,
                        r.events.clone(),
                        r.unresolved.clone(),
                        r.defects.clone(),
                    )
                };
                let [full, incremental, paranoid] =
                    verified.each_ref().map(|v| findings(&v.report));
                assert_eq!(incremental, full, "{basis:?}, seed {seed}, frame {seq}");
                assert_eq!(paranoid, full, "{basis:?}, seed {seed}, frame {seq}");
                assert!(!verified[2].work.disagreed);
                let route = verified[1].work.route;
                quiet += usize::from(route == Route::Quiet);
                partial += usize::from(route == Route::Partial);
                found += full.1.len();
            }
        }
        println!("{basis:?}: {quiet} quiet, {partial} partial frames, {found} pull-throughs");
        assert!(
            quiet > 30 && partial > 100 && found > 10,
            "{basis:?}: {quiet} {partial} {found}"
        );
    }
}
