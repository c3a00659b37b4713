//! Braids: open curves between rigid ends, verified as virtual closed loops.

#![cfg(feature = "verify")]

mod support;

use linkwatch::{
    Basis, Braid, BraidLoops, Braids, Certificate, Certifier, CurveSet, Events, FrameInfo,
    Positions, Report, Session, SessionOptions, Strategy, Verdict,
};
use support::session::Step;

type Point = [f64; 3];

/// A braid word: generator `k + 1`, or its inverse if negative.
type Word = Vec<i32>;

/// Length of a generator along z, in distances of neighbouring strands.
const STEP: f64 = 4.0;

/// Returns the distance of the bars of a braid word.
fn length(word: &[i32]) -> f64 {
    STEP * (word.len() as f64 + 2.0)
}

/// Returns the strands of a braid word on straight bars along x, from z = 0 to the end of the word.
fn strands(n: usize, word: &[i32]) -> Vec<Vec<Point>> {
    let mut at: Vec<usize> = (0..n).collect();
    let mut all: Vec<Vec<Point>> = (0..n).map(|k| vec![[k as f64, 0.0, 0.0]]).collect();
    for (step, &g) in word.iter().enumerate() {
        let (k, side) = (g.unsigned_abs() as usize - 1, 0.3 * f64::from(g.signum()));
        let z = STEP * (step as f64 + 1.0);
        for (slot, &strand) in at.iter().enumerate() {
            let (to, y) = match slot {
                s if s == k => (k + 1, side),
                s if s == k + 1 => (k, -side),
                s => (s, 0.0),
            };
            let (a, b) = (slot as f64, to as f64);
            let path = [
                [a, 0.0, z],
                [0.5 * (a + b), y, z + 0.5 * STEP],
                [b, 0.0, z + STEP],
            ];
            all[strand].extend(path);
        }
        at.swap(k, k + 1);
    }
    let end = length(word);
    for (slot, &strand) in at.iter().enumerate() {
        all[strand].push([slot as f64, 0.0, end]);
    }
    all
}

/// Returns the generator of pure braids that winds strand `i` around strand `j`, `i < j`.
fn winding(i: usize, j: usize) -> Word {
    let way: Word = (i + 1..j).rev().map(|k| k as i32 + 1).collect();
    let back = way.iter().rev().map(|g| -g);
    let twice = [i as i32 + 1; 2];
    way.iter().copied().chain(twice).chain(back).collect()
}

fn inverse(word: &[i32]) -> Word {
    word.iter().rev().map(|g| -g).collect()
}

/// Returns a set of open polylines.
fn open(strands: &[Vec<Point>]) -> CurveSet {
    of(Basis::Polyline, strands, |_| false)
}

fn of(basis: Basis, curves: &[Vec<Point>], closed: impl Fn(usize) -> bool) -> CurveSet {
    let sign = |k: usize| if closed(k) { -1 } else { 1 };
    let counts = curves.iter().enumerate();
    let counts: Vec<i32> = counts.map(|(k, c)| sign(k) * c.len() as i32).collect();
    let points: Vec<f64> = curves.iter().flatten().flatten().copied().collect();
    CurveSet::from_counts(basis, &counts, Positions::F64(&points)).unwrap()
}

fn new_session(braids: Braids) -> Session {
    let options = SessionOptions {
        braids: Some(braids),
        strategy: Strategy::Incremental,
        ..SessionOptions::default()
    };
    Session::new(options).unwrap()
}

fn certificate(set: &CurveSet) -> Certificate {
    let mut session = new_session(Braids::Auto);
    assert_eq!(session.step(0, set).report.verdict, Verdict::Intact);
    session.baseline().unwrap().clone()
}

/// Returns the loops closed by hand: connections of neighbours in the plane of the bars, that of
/// the last strand and the first one beyond all strands in y and in z.
fn closed_by_hand(strands: &[Vec<Point>]) -> CurveSet {
    let n = strands.len();
    let loops: Vec<Vec<Point>> = (0..n)
        .map(|k| {
            let (a, b) = (&strands[k], &strands[(k + 1) % n]);
            let around = |[x, _, z]: Point, way: f64| match k + 1 == n {
                true => vec![[x, 0.0, z + 2.0 * way], [x, 9.0, z + 2.0 * way]],
                false => vec![[x, 0.0, z + way]],
            };
            let last = |c: &[Point]| c[c.len() - 1];
            let mut path = a.clone();
            path.extend(around(last(a), 1.0));
            path.extend(around(last(b), 1.0).into_iter().rev());
            path.extend(b.iter().rev());
            path.extend(around(b[0], -1.0));
            path.extend(around(a[0], -1.0).into_iter().rev());
            path
        })
        .collect();
    of(Basis::Polyline, &loops, |_| true)
}

fn adjacent(n: usize, i: u32, j: u32) -> bool {
    let apart = i.abs_diff(j) as usize;
    apart == 1 || apart == n - 1
}

/// Returns a generator of pseudo-random numbers below a bound.
fn random(mut state: u64) -> impl FnMut(usize) -> usize {
    move |bound| {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 33) as usize % bound
    }
}

fn random_word(
    n: usize,
    length: usize,
    next: &mut impl FnMut(usize) -> usize,
) -> (Word, Vec<[usize; 2]>) {
    let (mut word, mut pairs) = (Word::new(), Vec::new());
    for _ in 0..length {
        let i = next(n - 1);
        let j = i + 1 + next(n - 1 - i);
        let a = winding(i, j);
        let back = next(2) == 1;
        word.extend(if back { inverse(&a) } else { a });
        pairs.push(if back { [j, i] } else { [i, j] });
    }
    (word, pairs)
}

/// Moves the braid as a whole, and turns and shifts its right end against the left one.
fn moved(strands: &[Vec<Point>], turn: f64, length: f64) -> Vec<Vec<Point>> {
    let turned = |[x, y, z]: Point| {
        let share = (z / length).clamp(0.0, 1.0);
        let (sin, cos) = (turn * share).sin_cos();
        let center = 0.5 * (strands.len() - 1) as f64;
        let (x, y) = (cos * (x - center) - sin * y, sin * (x - center) + cos * y);
        let (x, y, z) = (x + 0.4 * share, y - 0.3 * share, 1.05 * z);
        // A quarter turn about x, and a shift.
        [x + 100.0, 3.0 - z, y - 40.0]
    };
    // Long edges would pass through the strands, so they are divided.
    let fine = |c: &Vec<Point>| {
        let mut out = vec![c[0]];
        for e in c.windows(2) {
            out.extend((1..=8).map(|k| {
                let t = f64::from(k) / 8.0;
                [0, 1, 2].map(|x| (1.0 - t) * e[0][x] + t * e[1][x])
            }));
        }
        out.into_iter().map(turned).collect()
    };
    strands.iter().map(fine).collect()
}

#[test]
fn linking_numbers_are_those_of_loops_closed_by_hand() {
    for n in [4, 5, 7] {
        let mut next = random(n as u64);
        for _ in 0..12 {
            let (word, windings) = random_word(n, 4, &mut next);
            let strands = strands(n, &word);
            let found = certificate(&open(&strands));
            let mut certifier = Certifier::default();
            let (by_hand, _) = certifier.certify(&closed_by_hand(&strands));
            let mut expected = by_hand.links().to_vec();
            expected.retain(|l| !adjacent(n, l.i, l.j));
            assert_eq!(found.links(), expected, "{n} strands, {word:?}");
            // From the number of windings of each pair of strands, without any geometry.
            let count = |a: usize, b: usize| -> i64 {
                let (a, b) = (a.min(b), a.max(b));
                let sign = |w: &&[usize; 2]| if w[0] < w[1] { 1 } else { -1 };
                let of_pair = windings
                    .iter()
                    .filter(|w| [a, b] == [w[0].min(w[1]), w[0].max(w[1])]);
                of_pair.map(|w| sign(&w)).sum()
            };
            for l in (0..n).flat_map(|i| (i + 1..n).map(move |j| [i, j])) {
                let [i, j] = l;
                if adjacent(n, i as u32, j as u32) {
                    continue;
                }
                let (a, b) = ((i + 1) % n, (j + 1) % n);
                let want = count(i, j) - count(i, b) - count(a, j) + count(a, b);
                let link = found
                    .links()
                    .iter()
                    .find(|l| (l.i as usize, l.j as usize) == (i, j));
                assert_eq!(
                    link.map_or(0, |l| l.lambda).abs(),
                    want.abs(),
                    "{i} {j} {word:?}"
                );
            }
        }
    }
}

#[test]
fn a_full_twist_of_each_pair_changes_the_certificate() {
    for n in [4, 6] {
        let mut next = random(7 + n as u64);
        for round in 0..3 {
            let (word, _) = random_word(n, round, &mut next);
            let before = certificate(&open(&strands(n, &word)));
            for i in 0..n {
                for j in i + 1..n {
                    let twisted = [word.clone(), winding(i, j)].concat();
                    let after = certificate(&open(&strands(n, &twisted)));
                    assert_ne!(before.links(), after.links(), "strands {i} and {j} of {n}");
                }
            }
        }
    }
}

#[test]
fn moved_ends_keep_the_certificate_and_a_pull_through_of_each_pair_changes_it() {
    let n = 5;
    let mut next = random(99);
    for round in 0..4 {
        let (word, _) = random_word(n, 2, &mut next);
        for i in 0..n {
            for j in i + 1..n {
                // The words differ by one crossing of the two strands, which has the opposite sign.
                let w = winding(i, j);
                let canceled: Word = {
                    let at = w.iter().rposition(|&g| g == i as i32 + 1).unwrap();
                    let mut w = w.clone();
                    w[at] = -w[at];
                    w
                };
                let intact = [word.clone(), w].concat();
                let broken = [word.clone(), canceled].concat();
                let length = length(&intact);
                let fine = |word: &[i32], turn: f64| open(&moved(&strands(n, word), turn, length));
                let mut session = new_session(Braids::Auto);
                let mut step = |seq, set: &CurveSet| session.step(seq, set).report;
                assert_eq!(step(0, &fine(&intact, 0.0)).verdict, Verdict::Intact);
                for turn in [0.2, 0.5, -0.4] {
                    let report = step(1, &fine(&intact, turn));
                    assert_eq!(report.verdict, Verdict::Intact, "{:?}", report.missing);
                }
                let report = step(2, &fine(&broken, 0.3 + 0.1 * f64::from(round)));
                assert_eq!(
                    report.verdict,
                    Verdict::Changed,
                    "strands {i} and {j}: {report:?}"
                );
                assert!(report.abort);
            }
        }
    }
}

/// Returns a straight braid with wide gaps between its curves, and a copy beside it.
fn two_braids() -> Vec<Vec<Point>> {
    let one = strands(4, &[1, 1, 3, 3]);
    let shifted = one
        .iter()
        .map(|c| c.iter().map(|p| [p[0] + 50.0, p[1], p[2]]).collect());
    one.iter().cloned().chain(shifted).collect()
}

#[test]
fn several_braids_and_closed_curves_are_verified_together() {
    let mut curves = two_braids();
    // A ring around strand 5, and the strand 6 runs backward.
    let ring = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
    curves.push(ring.map(|[x, y]| [51.0 + x, y, 0.6]).to_vec());
    curves[6].reverse();
    let set = of(Basis::Polyline, &curves, |k| k == 8);
    let options = SessionOptions {
        braids: Some(Braids::Auto),
        events: Events::Between,
        ..SessionOptions::default()
    };
    let mut session = Session::new(options).unwrap();
    assert_eq!(session.step(0, &set).report.verdict, Verdict::Intact);
    let Some(Braids::Given(found)) = session.braids() else {
        panic!("braids")
    };
    assert_eq!(found.len(), 2);
    assert_eq!(found[1].curves, [4, 5, 6, 7]);
    assert_eq!(found[1].reversed, [6]);
    let links = &session.baseline().unwrap().links();
    let with_ring: Vec<(u32, u32)> = links
        .iter()
        .map(|l| (l.i, l.j))
        .filter(|l| l.1 == 8)
        .collect();
    assert_eq!(with_ring, [(4, 8), (5, 8)]);
    // The ring jumps off: the real curve, and both loops.
    for p in &mut curves[8] {
        p[1] += 5.0;
    }
    let report = session
        .step_at(
            FrameInfo::at(1, 0.1),
            of(Basis::Polyline, &curves, |k| k == 8),
        )
        .report;
    assert_eq!(report.verdict, Verdict::Changed);
    assert_eq!(
        report.events.iter().map(|e| (e.i, e.j)).collect::<Vec<_>>(),
        [(5, 8)]
    );
    let sentences: Vec<String> = report.findings().collect();
    let text = "the virtual loop of curves 4 + 5 and curve 8 came apart: linking number was";
    assert!(
        sentences.iter().any(|s| s.starts_with(text)),
        "{sentences:?}"
    );
}

#[test]
fn splines_and_polylines_have_the_same_certificate() {
    let word = [winding(0, 2), winding(1, 3), inverse(&winding(0, 1))].concat();
    let lines = strands(4, &word);
    let polyline = certificate(&open(&lines));
    assert!(!polyline.links().is_empty());
    for basis in [Basis::CatmullRom, Basis::BSpline] {
        // Repeated end points make the spline end there; midpoints keep it near the polyline.
        let smooth = |c: &Vec<Point>| {
            let middle = |e: &[Point]| [0, 1, 2].map(|x| 0.5 * (e[0][x] + e[1][x]));
            let mut out = vec![c[0]; 2];
            out.extend(c.windows(2).flat_map(|e| [e[0], middle(e)]));
            out.extend([c[c.len() - 1]; 3]);
            out
        };
        let splines: Vec<Vec<Point>> = lines.iter().map(smooth).collect();
        let set = of(basis, &splines, |_| false);
        assert_eq!(certificate(&set).links(), polyline.links(), "{basis:?}");
    }
}

/// Verifies a straight braid of four curves, and then the braid after `change`.
fn after(change: impl FnOnce(&mut Vec<Vec<Point>>)) -> Report {
    let mut curves = strands(4, &[2, 2]);
    let mut session = new_session(Braids::Auto);
    assert_eq!(
        session.step(0, open(&curves)).report.verdict,
        Verdict::Intact
    );
    change(&mut curves);
    session.step(1, open(&curves)).report
}

fn assert_undecided(report: &Report, words: &[&str]) {
    assert_eq!(report.verdict, Verdict::Undecided, "{report:?}");
    assert_eq!(report.last_intact, Some(0));
    for word in words {
        assert!(
            report.missing[0].contains(word),
            "{word}: {:?}",
            report.missing
        );
    }
}

#[test]
fn a_curve_that_enters_an_end_volume_is_undecided() {
    // Through the box behind the left bar, and through the tube of another stub.
    let report = after(|curves| curves[3][1] = [1.5, 0.0, -3.0]);
    assert_undecided(
        &report,
        &[
            "curve 3 enters the volume of the left end of braid 0",
            "segment 0",
        ],
    );
    let report = after(|curves| curves[1][1] = [2.1, 0.0, -0.9]);
    assert_undecided(&report, &["curve 1 enters the volume of the left end"]);
}

/// Two linked squares beside a braid come apart while a curve is in the end volume of the braid.
/// The certificate of the next frame equals that of a run without the frame in between.
#[test]
fn a_broken_braid_hides_no_change_of_closed_curves_and_adds_none() {
    let with_squares = |strands: &[Vec<Point>], apart: f64| {
        let square = |turn: fn(Point) -> Point, shift: f64| {
            let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
            let corner = |[x, y]: [f64; 2]| turn([x, y, 0.0]);
            let corners = corners
                .map(corner)
                .map(|[x, y, z]| [x + shift, y, z + 40.0]);
            corners.to_vec()
        };
        let mut curves = strands.to_vec();
        curves.push(square(|p| p, 0.0));
        curves.push(square(|[x, y, z]| [x, z, y], 1.0 + apart));
        of(Basis::Polyline, &curves, |k| k >= 4)
    };
    let whole = strands(4, &[2, 2]);
    let mut broken = whole.clone();
    broken[3][1] = [1.5, 0.4, -3.0];
    let passed = strands(4, &[-2, 2]);
    let strategies = [
        (Strategy::Full, false),
        (Strategy::Full, true),
        (Strategy::Incremental, false),
        (Strategy::Paranoid, false),
    ];
    for (strategy, early_exit) in strategies {
        let options = SessionOptions {
            braids: Some(Braids::Auto),
            strategy,
            early_exit,
            events: if early_exit { Events::Off } else { Events::All },
            ..SessionOptions::default()
        };
        let mut session = Session::new(options).unwrap();
        let mut step = |seq, set: CurveSet| session.step(seq, set).report;
        let found = |report: &Report| -> Vec<(u32, u32)> {
            report.changes.iter().map(|c| (c.i, c.j)).collect()
        };
        let report = step(0, with_squares(&whole, 0.0));
        assert_eq!(report.verdict, Verdict::Intact);
        let report = step(1, with_squares(&broken, 5.0));
        assert_eq!(found(&report), [(4, 5)], "{strategy:?}");
        assert!(report.loops.is_empty() && report.missing.len() == 1);
        for (seq, strands) in [(2, &broken), (3, &whole)] {
            let report = step(seq, with_squares(strands, 0.0));
            assert_eq!(
                (found(&report), report.defects),
                (vec![], vec![]),
                "{strategy:?}"
            );
        }
        // Passages of loops are not reported, and so do not account for their numbers.
        for (seq, strands) in [(4, &passed), (5, &broken), (6, &passed)] {
            let report = step(seq, with_squares(strands, 0.0));
            assert_eq!(report.loops.is_empty(), !report.missing.is_empty());
            assert!(!found(&report).contains(&(4, 5)));
            assert_eq!(report.defects, [], "{strategy:?}");
        }
    }
}

/// Regression test: in a frame with a broken braid, a ring that had been degenerate adopted its
/// linking numbers with loops, which are meaningless there. Later frames then reported changes.
#[test]
fn a_ring_takes_no_number_from_a_frame_with_a_broken_braid() {
    let whole = strands(4, &[2, 2]);
    let mut broken = whole.clone();
    broken[3][1] = [1.5, 0.4, -3.0];
    // Around strand 1, or a line with two distinct points.
    let with_ring = |strands: &[Vec<Point>], width: f64| {
        let corners = [[-0.4, -0.4], [0.4, -0.4], [0.4, 0.4], [-0.4, 0.4]];
        let ring = corners.map(|[x, y]| [1.0 + x, width * y, 2.0]);
        let ring = if width > 0.0 {
            ring
        } else {
            [ring[0], ring[1], ring[1], ring[0]]
        };
        let curves: Vec<Vec<Point>> = strands.iter().cloned().chain([ring.to_vec()]).collect();
        of(Basis::Polyline, &curves, |k| k == 4)
    };
    for strategy in [Strategy::Full, Strategy::Incremental] {
        let options = SessionOptions {
            braids: Some(Braids::Auto),
            strategy,
            ..SessionOptions::default()
        };
        let mut session = Session::new(options).unwrap();
        let _ = session.step(0, with_ring(&whole, 0.0));
        let report = session.step(1, with_ring(&broken, 1.0)).report;
        assert_eq!((report.adopted.len(), report.missing.len()), (0, 1));
        let report = session.step(2, with_ring(&whole, 1.0)).report;
        assert_eq!(report.changes, []);
        assert_eq!(report.adopted.len(), 2, "both loops with strand 1");
        let report = session.step(3, with_ring(&whole, 1.0)).report;
        assert_eq!((report.changes, report.defects), (vec![], vec![]));
    }
}

#[test]
fn loops_of_other_curves_are_an_error() {
    let four = open(&strands(4, &[2, 2]));
    let loops = BraidLoops::new(&Braids::Auto, &four).unwrap();
    assert_eq!(loops.close(&four).unwrap().len(), 4);
    for other in [strands(3, &[]), strands(5, &[]), strands(4, &[2])] {
        let e = loops.close(&open(&other)).unwrap_err().to_string();
        assert!(e.contains("other curves than the first one"), "{e}");
    }
}

#[test]
fn ends_that_move_against_one_another_are_undecided() {
    let report = after(|curves| curves[2][0][1] += 0.3);
    assert_undecided(
        &report,
        &[
            "the left end of braid 0 is not rigid: the end of curve",
            "more than",
        ],
    );
}

#[test]
fn swapped_curves_are_undecided() {
    let report = after(|curves| curves.swap(0, 1));
    assert_undecided(&report, &["is not rigid"]);
}

#[test]
fn end_volumes_that_overlap_are_undecided() {
    // A second braid along y approaches the volume behind the left bar from the side.
    let beside = |y: f64| {
        let one = strands(4, &[]);
        let turned = |p: &Point| [p[0], p[2] + y, -1.1];
        let other = one.iter().map(|c| c.iter().map(turned).collect());
        open(&one.iter().cloned().chain(other).collect::<Vec<_>>())
    };
    let mut session = new_session(Braids::Auto);
    assert_eq!(
        session.step(0, beside(30.0)).report.verdict,
        Verdict::Intact
    );
    let report = session.step(1, beside(1.2)).report;
    let words = "the volumes of the left end of braid 0 and the left end of braid 1 overlap";
    assert_undecided(&report, &[words]);
}

#[test]
fn braids_of_few_unknown_or_closed_curves_are_errors() {
    let set = of(Basis::Polyline, &strands(5, &[]), |k| k == 4);
    let fails = |json: &str| {
        let braids = Braids::from_json(json).unwrap();
        let error = new_session(braids)
            .feed(FrameInfo::at(0, 0.0), &set)
            .unwrap_err();
        error.to_string()
    };
    let given = |curves: &str| fails(&format!(r#"{{"braids": [{{"curves": {curves}}}]}}"#));
    assert!(given("[0, 1, 2]").contains("at least 4"));
    assert!(given("[0, 1, 2, 9]").contains("the frame has 5 curves"));
    assert!(given("[0, 1, 2, 4]").contains("curve 4, which is closed"));
    assert!(given("[0, 1, 2, 2]").contains("curve 2, which is named twice"));
    let points = r#"{"braids": [{"curves": [0,1,2,3], "left": {"points": [[0,0,0]]}}]}"#;
    assert!(fails(points).contains("1 points of its left end"));
    let reversed = r#"{"braids": [{"curves": [0,1,2,3], "reversed": [7]}]}"#;
    assert!(fails(reversed).contains("curve 7 as reversed"));
    for bad in [
        "",
        "{}",
        r#"{"braids": []}"#,
        r#"{"braids": [{"curve": []}]}"#,
    ] {
        assert!(Braids::from_json(bad).is_err(), "{bad}");
    }
    let three = new_session(Braids::Auto)
        .feed(FrameInfo::at(0, 0.0), open(&strands(3, &[])))
        .unwrap_err();
    assert!(three.to_string().contains("needs at least 4"), "{three}");
}

#[test]
fn written_ends_give_the_same_certificate_in_a_later_frame() {
    let word = [winding(0, 2), winding(1, 3)].concat();
    let length = length(&word);
    let (first, later) = (strands(4, &word), moved(&strands(4, &word), 0.4, length));
    let mut one = new_session(Braids::Auto);
    assert_eq!(one.step(0, open(&first)).report.verdict, Verdict::Intact);
    let json = one.braids().unwrap().to_json();
    let mut other = new_session(Braids::from_json(&json).unwrap());
    assert_eq!(other.step(0, open(&later)).report.verdict, Verdict::Intact);
    assert_eq!(
        one.baseline().unwrap().links(),
        other.baseline().unwrap().links()
    );
}

#[test]
fn ends_that_are_not_on_a_line_turn_with_their_points() {
    // A ring of six rods, turned about their axis and apart.
    let rods = |turn: f64, shift: f64| -> Vec<Vec<Point>> {
        (0..6)
            .map(|k| {
                let at = |z: f64, turn: f64| {
                    let angle = f64::from(k) * std::f64::consts::FRAC_PI_3 + turn;
                    [2.0 * angle.cos(), 2.0 * angle.sin(), z]
                };
                let steps = (0..=20).map(|s| f64::from(s) / 20.0);
                steps.map(|t| at(t * (10.0 + shift), t * turn)).collect()
            })
            .collect()
    };
    let mut session = new_session(Braids::Given(vec![Braid {
        curves: vec![0, 1, 2, 3, 4, 5],
        ..Braid::default()
    }]));
    for (seq, turn) in [0.0, 0.4, 1.1, 2.0, 3.2, 4.5, 6.2].into_iter().enumerate() {
        let report = session.step(seq as u64, open(&rods(turn, turn))).report;
        assert_eq!(report.verdict, Verdict::Intact, "{report:?}");
    }
}

#[cfg(feature = "cli")]
#[test]
fn the_command_verifies_braids_and_writes_their_ends() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, word: &[i32]| {
        let curves = strands(4, word);
        let counts: Vec<String> = curves.iter().map(|c| c.len().to_string()).collect();
        let points: usize = curves.iter().map(Vec::len).sum();
        let mut text = format!("VECT\n4 {points} 0\n{}\n0 0 0 0\n", counts.join(" "));
        for [x, y, z] in curves.into_iter().flatten() {
            text += &format!("{x} {y} {z}\n");
        }
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let intact = write("a1.vect", &[1, -1, 2, 2]);
    let broken = write("a2.vect", &[1, 1, 2, 2]);
    let ends = folder.path().join("ends.json").display().to_string();
    let run = |args: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_linkwatch"));
        let output = command.args(args).output().unwrap();
        let text = [output.stdout, output.stderr].concat();
        (output.status.code(), String::from_utf8(text).unwrap())
    };
    let (code, text) = run(&[
        "certify",
        &intact,
        "--braid",
        "auto",
        "--write-braid",
        &ends,
    ]);
    assert_eq!(code, Some(0), "{text}");
    for braid in ["auto", &ends] {
        let (code, text) = run(&["check", &intact, &broken, "--braid", braid]);
        assert_eq!(code, Some(1), "{text}");
        assert!(text.contains("the virtual loop of curves 1 + 2"), "{text}");
        assert!(!text.contains("not verified"), "{text}");
        let (code, text) = run(&["check", &intact, &intact, "--braid", braid]);
        assert_eq!(code, Some(0), "{text}");
    }
    std::fs::write(&ends, r#"{"braids": [{"curves": [0, 1, 2]}]}"#).unwrap();
    let (code, text) = run(&["check", &intact, &broken, "--braid", &ends]);
    assert_eq!(code, Some(2), "{text}");
    assert!(text.contains("a braid needs at least 4"), "{text}");
}
