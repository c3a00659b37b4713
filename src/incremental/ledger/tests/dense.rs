//! Curves so close to one another that a naive search would not end in time.

use super::*;
use crate::curve::vector::per_axis;

/// Returns a closed spline that follows a few random points several times, within `noise`, and
/// moves by as much.
fn doubled(r: &mut Random, basis: Basis, points: usize, turns: usize, noise: f64) -> [CurveSet; 2] {
    let ring: Vec<Point> = (0..points).map(|_| r.point(1.0)).collect();
    [(); 2].map(|()| {
        let around = ring.iter().cycle().take(points * turns);
        let xyz: Vec<f64> = around
            .flat_map(|p| {
                let v = r.point(noise);
                per_axis(|x| p[x] + v[x])
            })
            .collect();
        let counts = [-((points * turns) as i32)];
        CurveSet::from_counts(basis, &counts, Positions::F64(&xyz)).unwrap()
    })
}

/// Regression: every piece was tested with every other one, which took 12 s per step for curves of
/// about ten control points.
#[test]
fn pieces_of_doubled_splines_are_tested_with_near_ones_only() {
    let mut ledger = Ledger::default();
    let mut events = 0;
    for basis in [Basis::CatmullRom, Basis::BSpline] {
        for noise in [1e-4, 1e-6, 1e-8] {
            let mut r = Random::new(3);
            for _ in 0..4 {
                let [before, after] = doubled(&mut r, basis, 4, 2, noise);
                let outcome = ledger.first_step(&before, &after, ALL, None);
                assert_eq!(outcome.undecided, [], "{basis:?} {noise}");
                // A test of all pairs of pieces would need hundreds of millions of tests at the
                // smallest noise.
                let counts = outcome.counts;
                assert!(counts.tests < 2_000_000, "{basis:?} {noise}: {counts:?}");
                assert!(counts.exact < 2000, "{basis:?} {noise}: {counts:?}");
                events += outcome.events.len();
            }
        }
    }
    assert!(events > 20, "{events}");
}

/// Skipped pairs of pieces have no passages.
#[test]
fn doubled_splines_have_the_passages_of_all_their_pieces() {
    let mut ledger = Ledger::default();
    let mut events = 0;
    for basis in [Basis::CatmullRom, Basis::BSpline] {
        let mut r = Random::new(11);
        for (turns, noise) in [(2, 1e-4), (3, 1e-3), (2, 1e-5), (4, 1e-2)] {
            let [before, after] = doubled(&mut r, basis, 5, turns, noise);
            let outcome = ledger.first_step(&before, &after, ALL, None);
            let step = Step {
                frames: [&before, &after],
                trees: &ledger.trees,
                motion_limit: ledger.motion_limit,
                cancel: &ledger.cancel,
            };
            let mut part = Part::default();
            step.pair_by_brute_force((0, 0), &mut part);
            sort_by_time(&mut part.outcome.events);
            assert_eq!(outcome.events, part.outcome.events, "{basis:?} {noise}");
            let undecided = &part.outcome.undecided;
            assert_eq!(&outcome.undecided, undecided, "{basis:?} {noise}");
            events += outcome.events.len();
        }
    }
    assert!(events > 20, "{events}");
}

/// The distance of the strands is near the rounding error, so floating point decides nothing. The
/// step still ends in time, and reports the pair as too close.
#[test]
fn a_pair_that_needs_too_many_exact_tests_is_too_close() {
    let mut r = Random::new(7);
    let [before, after] = doubled(&mut r, Basis::Polyline, 10, 40, 1e-14);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let step = || Ledger::default().first_step(&before, &after, ALL, None);
        pool.unwrap().install(step)
    };
    let outcome = run(1);
    assert_eq!(outcome.events, []);
    let kinds: Vec<_> = outcome
        .undecided
        .iter()
        .map(|d| (d.i, d.j, d.kind))
        .collect();
    assert_eq!(kinds, [(0, Some(0), crate::verdict::DefectKind::TooClose)]);
    assert!(outcome.counts.exact < 20_000, "{:?}", outcome.counts);
    assert_eq!(run(3).undecided, outcome.undecided);
}

/// Regression: strands that move through one another everywhere are searched in long pieces, so
/// that passages that cancel may be missed. The pair counted as decided.
#[test]
fn splines_searched_in_long_pieces_are_undecided_and_their_signs_add_up() {
    let frames = doubled(&mut Random::new(5), Basis::CatmullRom, 10, 40, 1e-2).map(|set| {
        let xyz: Vec<f64> = (0..400).flat_map(|k| set.knot(0, k)).collect();
        CurveSet::from_counts(Basis::CatmullRom, &[-200, -200], Positions::F64(&xyz)).unwrap()
    });
    let mut ledger = Ledger::default();
    let outcome = ledger.first_step(&frames[0], &frames[1], Coverage::default(), None);
    let too_close = crate::verdict::DefectKind::TooClose;
    let kinds = outcome.undecided.iter().map(|d| (d.i, d.j, d.kind));
    assert_eq!(kinds.collect::<Vec<_>>(), [(0, Some(1), too_close)]);
    let numbers = frames
        .each_ref()
        .map(|set| match certificate(set).links[..] {
            [] => 0,
            [link] => link.lambda,
            _ => panic!("two curves have one linking number"),
        });
    let sums: Vec<i64> = outcome.sums.iter().map(|sum| sum.lambda).collect();
    assert_eq!(sums, [numbers[1] - numbers[0]]);
}
