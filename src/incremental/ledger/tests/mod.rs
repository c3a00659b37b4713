//! Tests of the ledger: against linking numbers, against a search of all pairs of pieces, and
//! against passages that are known by construction.

mod dense;
pub(crate) mod planted;
mod safe_fraction;
mod speed;
mod splines;

use super::cancellation::{LocatedPassage, cancel};
use super::contact::Contact;
use super::pair::Part;
use super::*;
use crate::certificate::Certificate;
use crate::curve::vector::per_axis;
use crate::curve::{Basis, Point, Positions};
use crate::engine::Certifier;
use crate::random::Random;
use planted::{Plant, planted_step};
use std::f64::consts::TAU;

const ALL: Coverage = Coverage {
    self_crossings: true,
    open_curves: true,
};

fn certificate(set: &CurveSet) -> Certificate {
    Certifier::default().certify(set).0.clone()
}

/// Returns two frames of a few curves, with one of many kinds of motion.
fn random_step(r: &mut Random, basis: Basis) -> [CurveSet; 2] {
    let lattice = r.one_in(4);
    let closed: Vec<bool> = (0..2 + r.below(3)).map(|_| !r.one_in(5)).collect();
    let sizes: Vec<usize> = closed
        .iter()
        .map(|_| {
            let most = r.pick(&[12, 12, 12, 90]);
            let n = 4 + r.below(most);
            if basis == Basis::Bezier { 3 * n } else { n }
        })
        .collect();
    let counts: Vec<i32> = closed
        .iter()
        .zip(&sizes)
        .map(|(&closed, &n)| match (basis, closed) {
            (_, true) => -(n as i32),
            (Basis::Bezier, false) => n as i32 + 1,
            (_, false) => n as i32,
        })
        .collect();
    let smooth = r.one_in(2);
    let curve = |r: &mut Random, n: usize| -> Vec<Point> {
        if !smooth {
            return (0..n).map(|_| r.point(3.0)).collect();
        }
        let (center, u, v, w) = (r.point(1.5), r.point(2.0), r.point(2.0), r.point(0.7));
        (0..n)
            .map(|k| {
                let t = TAU * k as f64 / n as f64;
                let (c, s, f) = (t.cos(), t.sin(), (3.0 * t).cos());
                per_axis(|x| center[x] + c * u[x] + s * v[x] + f * w[x])
            })
            .collect()
    };
    let mut before: Vec<Vec<Point>> = counts
        .iter()
        .map(|n| curve(r, n.unsigned_abs() as usize))
        .collect();
    let mut after = before.clone();
    let size = 10f64.powf(r.between(-2.0, 0.5));
    match r.below(6) {
        // Each point moves separately.
        0 => {
            for p in after.iter_mut().flatten() {
                let v = r.point(size);
                *p = per_axis(|x| p[x] + v[x]);
            }
        }
        // Each curve moves as a whole; some are at rest.
        1 => {
            for curve in &mut after {
                let size = r.pick(&[0.0, size]);
                let v = r.point(size);
                curve
                    .iter_mut()
                    .for_each(|p| *p = per_axis(|x| p[x] + v[x]));
            }
        }
        // A rotation of all curves.
        2 => {
            let (s, c) = r.between(0.0, TAU).sin_cos();
            for p in after.iter_mut().flatten() {
                *p = [c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]];
            }
        }
        // A wave.
        3 => {
            let (k, v) = (r.point(2.0), r.point(size));
            for p in after.iter_mut().flatten() {
                let f = (k[0] * p[0] + k[1] * p[1] + k[2] * p[2]).sin();
                *p = per_axis(|x| p[x] + f * v[x]);
            }
        }
        // A few points jump far: pull-throughs.
        4 => {
            for curve in &mut after {
                let k = r.below(curve.len());
                curve[k] = r.point(3.0);
            }
        }
        // Unrelated curves.
        _ => {
            for curve in &mut after {
                curve.iter_mut().for_each(|p| *p = r.point(3.0));
            }
        }
    }
    if lattice {
        let frames = [&mut before, &mut after];
        for p in frames.into_iter().flatten().flatten() {
            *p = p.map(f64::round);
        }
    }
    let double = r.one_in(2);
    [before, after].map(|curves| {
        let xyz: Vec<f64> = curves.iter().flatten().flatten().copied().collect();
        let narrow: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
        let positions = if double {
            Positions::F64(&xyz)
        } else {
            Positions::F32(&narrow)
        };
        CurveSet::from_counts(basis, &counts, positions).unwrap()
    })
}

/// [`Outcome::check`] with the certificates of both frames.
fn unaccounted(outcome: &Outcome, [before, after]: &[Certificate; 2]) -> Vec<Pair> {
    let none = before.compare(before).unwrap();
    outcome.check(&none, &after.compare(before).unwrap())
}

#[test]
fn signs_add_up_to_the_change_of_the_linking_number() {
    check_signs(150);
}

#[test]
#[ignore = "takes minutes"]
fn signs_add_up_to_the_change_of_the_linking_number_in_many_steps() {
    check_signs(4000);
}

/// Checks that linking numbers change by the sum of the signs, in steps of every basis.
fn check_signs(steps: usize) {
    let mut ledger = Ledger::default();
    for basis in Basis::ALL {
        let mut r = Random::new(7 + basis as u64);
        let (mut changed, mut events, mut undecided, mut undefined) = (0, 0, 0, 0);
        for k in 0..steps {
            let [before, after] = random_step(&mut r, basis);
            let numbers = [&before, &after].map(certificate);
            let options = if k % 3 == 0 { ALL } else { Coverage::default() };
            let outcome = ledger.first_step(&before, &after, options, None);
            assert_eq!(
                unaccounted(&outcome, &numbers),
                [],
                "{basis:?} {k}: {outcome:?}"
            );
            changed += usize::from(numbers[0].links != numbers[1].links);
            events += outcome.events.len();
            undecided += outcome.undecided.len();
            undefined += numbers.iter().map(|n| n.undefined.len()).sum::<usize>();
            let in_order = |w: &[PullThrough]| w[0].fraction <= w[1].fraction;
            assert!(outcome.events.windows(2).all(in_order));
        }
        println!(
            "{basis:?}: {changed} of {steps} steps changed a linking number, {events} passages, \
             {undecided} undecided, {undefined} without a linking number"
        );
        assert!(changed > steps / 4);
    }
}

/// The ledger finds every constructed passage with its curves, segments, sign, time and place, and
/// no other passage.
#[test]
fn finds_the_planted_passages_and_no_others() {
    let mut ledger = Ledger {
        motion_limit: f64::INFINITY,
        ..Ledger::default()
    };
    for plant in [
        Plant::Single,
        Plant::Cancelling,
        Plant::SelfCrossing,
        Plant::Open,
    ] {
        let mut r = Random::new(40 + plant as u64);
        let (mut done, mut rejected) = (0, 0);
        while done < 1000 {
            let basis = Basis::ALL[done % 4];
            let Some(planted) = planted_step(&mut r, basis, plant) else {
                rejected += 1;
                assert!(rejected < 10_000, "{plant:?}");
                continue;
            };
            let signs: Vec<i32> = planted.known.iter().map(|k| k.sign).collect();
            let wanted = match plant {
                Plant::Cancelling => signs.len() == 2,
                _ => signs.len() == 1,
            };
            if !wanted {
                rejected += 1;
                continue;
            }
            done += 1;
            if plant == Plant::Cancelling {
                assert_eq!(signs.iter().sum::<i32>(), 0);
            }
            let [before, after] = &planted.frames;
            let outcome = ledger.first_step(before, after, ALL, None);
            assert_eq!(outcome.undecided, [], "{plant:?} {basis:?}");
            let found: Vec<_> = outcome
                .events
                .iter()
                .map(|e| ([e.i, e.j], e.segments, e.sign))
                .collect();
            let want: Vec<_> = planted
                .known
                .iter()
                .map(|k| (k.curves, k.segments, k.sign))
                .collect();
            assert_eq!(
                found, want,
                "{plant:?} {basis:?} {done}: {:?}",
                planted.known
            );
            let accuracy = if basis.is_polyline() { 1e-6 } else { 0.01 };
            for (e, k) in outcome.events.iter().zip(&planted.known) {
                assert!((e.fraction - k.fraction).abs() < accuracy, "{e:?} {k:?}");
            }
            let numbers = [before, after].map(certificate);
            assert_eq!(unaccounted(&outcome, &numbers), []);
            match plant {
                Plant::Single => assert_ne!(numbers[0].links, numbers[1].links),
                // These passages change no linking number.
                _ => assert_eq!(numbers[0].links, numbers[1].links),
            }
        }
        println!("{plant:?}: {done} scenes, {rejected} rejected");
    }
}

/// The search misses nothing: a test of all pairs of pieces finds the same passages.
#[test]
fn the_search_finds_the_passages_of_all_pairs_of_segments() {
    let mut ledger = Ledger::new(MOTION_LIMIT, ALL);
    for basis in Basis::ALL {
        let mut r = Random::new(80 + basis as u64);
        let (mut events, mut undecided) = (0, 0);
        for k in 0..80 {
            let [before, after] = random_step(&mut r, basis);
            let frames = [&before, &after];
            let Part {
                mut outcome,
                mut contacts,
            } = ledger.search(frames, None);
            let step = Step {
                frames,
                trees: &ledger.trees,
                motion_limit: ledger.motion_limit,
                cancel: &ledger.cancel,
            };
            let mut part = Part::default();
            let n = before.len() as u32;
            for pair in (0..n).flat_map(|i| (i..n).map(move |j| (i, j))) {
                step.pair_by_brute_force(pair, &mut part);
            }
            sort_by_time(&mut part.outcome.events);
            sort_by_time(&mut outcome.events);
            assert_eq!(outcome.events, part.outcome.events, "{basis:?} {k}");
            for contacts in [&mut contacts, &mut part.contacts] {
                let key = |c: &Contact| {
                    (
                        c.event.i,
                        c.event.j,
                        c.event.segments,
                        c.event.fraction == 1.0,
                    )
                };
                contacts.sort_by_key(key);
            }
            assert_eq!(contacts, part.contacts, "{basis:?} {k}");
            assert_eq!(outcome.undecided, part.outcome.undecided, "{basis:?} {k}");
            assert_eq!(outcome.sums, part.outcome.sums, "{basis:?} {k}");
            events += outcome.events.len();
            undecided += outcome.undecided.len();
        }
        println!("{basis:?}: {events} passages, {undecided} undecided");
    }
}

/// The outcome is the same for pairs that are split into tasks, for a subset of the pairs, and for
/// any number of threads.
#[test]
fn the_outcome_depends_only_on_the_frames() {
    let n = 20_000;
    let mut r = Random::new(5);
    let strand = |r: &mut Random, f: f64, phase: f64| -> Vec<f64> {
        (0..n)
            .flat_map(|k| {
                let t = TAU * f64::from(k) / f64::from(n);
                let (s, c) = (400.0 * t + phase).sin_cos();
                let near = [
                    (10.0 + 0.5 * c) * t.cos(),
                    (10.0 + 0.5 * c) * t.sin(),
                    0.5 * s,
                ];
                let off = r.point(f);
                per_axis(|x| near[x] + off[x])
            })
            .collect()
    };
    for basis in [Basis::Polyline, Basis::CatmullRom] {
        let [before, after] = [0.001, 0.2].map(|f| {
            let mut xyz = strand(&mut r, f, 0.0);
            xyz.extend(strand(&mut r, f, 0.4));
            CurveSet::from_counts(basis, &[-n, -n], Positions::F64(&xyz)).unwrap()
        });
        let run = |threads: usize, pairs: Option<&[Pair]>| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.unwrap()
                .install(|| Ledger::default().first_step(&before, &after, ALL, pairs))
        };
        let one = run(1, None);
        assert!(one.events.len() > 1000, "{}", one.events.len());
        assert_eq!(run(5, None), one);
        // A subset of the pairs has the same passages.
        for pairs in [&[(0, 0), (0, 1)][..], &[(1, 1)]] {
            let subset = run(2, Some(pairs));
            let chosen = |e: &&PullThrough| pairs.contains(&(e.i, e.j));
            let want: Vec<PullThrough> = one.events.iter().filter(chosen).copied().collect();
            assert_eq!(subset.events, want);
            assert!(!want.is_empty() && want.len() < one.events.len());
        }
        println!("{basis:?}: {} passages, {:?}", one.events.len(), one.counts);
    }
}

#[test]
fn only_opposite_passages_at_one_time_and_place_cancel() {
    let curve = |closed| {
        let xyz = vec![0.0; 30];
        let counts = [if closed { -10 } else { 10 }];
        CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz))
            .unwrap()
            .curve(0)
    };
    let found = |along: [f64; 2], fraction, sign| LocatedPassage {
        event: PullThrough {
            i: 0,
            j: 1,
            image: Default::default(),
            segments: along.map(|x| x as u32),
            fraction,
            sign,
            point: [0.0; 3],
            lengths: 0.5,
        },
        along,
        tie: false,
    };
    let left = |list: &[LocatedPassage], closed| {
        let mut list = list.to_vec();
        cancel(&mut list, [curve(closed); 2]);
        list.len()
    };
    let p = |sign| found([3.0, 4.5], 0.5, sign);
    assert_eq!(left(&[p(1), p(-1)], true), 0);
    assert_eq!(left(&[p(1), p(1)], true), 2);
    assert_eq!(left(&[p(1), p(-1), p(1)], true), 1);
    // At the joint of two segments, and at the start of a closed curve.
    let q = [
        found([2.999_999_9, 4.5], 0.5, 1),
        found([3.0, 4.5], 0.500_000_001, -1),
    ];
    assert_eq!(left(&q, true), 0);
    let q = [
        found([9.999_999_9, 0.0], 0.5, 1),
        found([0.0, 9.999_999_9], 0.5, -1),
    ];
    assert_eq!(left(&q, true), 0);
    assert_eq!(left(&q, false), 2);
    // Two passages at another time, or at another place of one curve: a finger is pressed down on a
    // strand.
    let far = [
        found([3.0, 4.5], 0.500_001, -1),
        found([3.01, 4.5], 0.5, -1),
        found([3.0, 4.51], 0.5, -1),
    ];
    for q in far {
        assert_eq!(left(&[p(1), q], true), 2, "{q:?}");
    }
}

/// A finger is pulled through a strand as a whole: both its sides pass at once, which is no tie.
#[test]
fn a_finger_that_passes_at_once_has_two_passages() {
    let counts = [-4, -3];
    let at = |z: f64| {
        let finger = [[0., 0., z], [1., 3., z], [2., 0., z], [1., -9., z]];
        let strand = [[-10., 1., 0.], [10., 1., 0.], [0., 1., 50.]];
        finger
            .into_iter()
            .chain(strand)
            .flatten()
            .collect::<Vec<f64>>()
    };
    let [before, after] = [-1.0, 1.0]
        .map(|z| CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&at(z))).unwrap());
    let outcome = Ledger::default().first_step(&before, &after, ALL, None);
    let found: Vec<_> = outcome
        .events
        .iter()
        .map(|e| (e.segments, e.fraction))
        .collect();
    assert_eq!(found, [([0, 0], 0.5), ([1, 0], 0.5)]);
    assert_eq!(outcome.events[0].sign + outcome.events[1].sign, 0);
    assert_eq!(
        outcome.events[0].to_string(),
        "curves 0 and 1 passed through one another at 0.500 of the step (-1), \
         at (0.33333, 1.00000, 0.00000), segments 0 and 0"
    );
}

/// Curves with repeated vertices and curves with joined ends have no passages and no ties.
#[test]
fn joined_pieces_do_not_pass_through_each_other() {
    let [p, q, s, t] = [[0., 0., 0.], [1., 0., 0.2], [1., 1., -0.2], [0., 1., 0.3]];
    // A closed curve with a repeated vertex, and an open one from one of its vertices to another.
    let points = [p, q, q, s, t, p, [0.5, 0.5, 3.0], s];
    let [before, after] = [0.0, 0.3].map(|f| {
        let bend = |v: Point| {
            [
                v[0] + f * v[1] * v[2],
                v[1] - f * v[0],
                v[2] + f * v[0] * v[1],
            ]
        };
        let xyz: Vec<f64> = points.into_iter().flat_map(bend).collect();
        CurveSet::from_counts(Basis::Polyline, &[-5, 3], Positions::F64(&xyz)).unwrap()
    });
    let outcome = Ledger::default().first_step(&before, &after, ALL, None);
    assert_eq!((outcome.events, outcome.undecided), (vec![], vec![]));
}

/// Boxes are reused only if they belong to the first frame of the step.
#[test]
fn boxes_of_an_earlier_frame_are_not_used_after_a_step_without_a_search() {
    let mut events = 0;
    for seed in 0..100 {
        let mut r = Random::new(seed);
        let basis = Basis::ALL[seed as usize % Basis::ALL.len()];
        let [before, after] = random_step(&mut r, basis);
        let want = Ledger::default().first_step(&before, &after, ALL, None);
        let mut ledger = Ledger::new(MOTION_LIMIT, ALL);
        let none = Contacts::default();
        let (contacts, _) = ledger.first_frame(&before);
        let found = ledger.step([&before, &after], &contacts, None);
        assert_eq!(found, want, "seed {seed}");
        // A step without a search, and one of a single pair, end in the first frame again.
        for pairs in [&[][..], &[(0, 1)]] {
            // A copy of the first frame with the same positions.
            let mut again = before.clone();
            again.update(before.positions()).unwrap();
            let _ = ledger.step([&after, &again], &none, Some(pairs));
            let found = ledger.step([&again, &after], &contacts, None);
            assert_eq!(found, want, "seed {seed}, after {pairs:?}");
        }
        events += want.events.len();
    }
    assert!(events > 100, "{events}");
}
