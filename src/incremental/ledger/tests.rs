//! The ledger against linking numbers, against all pairs of pieces, and against planted passages.

use super::planted::{Plant, Random, scene};
use super::*;
use crate::curve::{Basis, Positions};
use crate::verdict::AbortOn;
use crate::verifier::Verifier;
use std::f64::consts::TAU;

const ALL: LedgerOptions = LedgerOptions {
    self_crossings: true,
    open_curves: true,
};

fn certificate(set: &CurveSet) -> Certificate {
    Verifier::new(AbortOn::Never).certify(set).0.clone()
}

/// Two frames of a few curves, of one of many kinds of motion.
fn random_step(r: &mut Random, basis: Basis) -> [CurveSet; 2] {
    let lattice = r.below(4) == 0;
    let closed: Vec<bool> = (0..2 + r.below(3)).map(|_| r.below(5) != 0).collect();
    let sizes: Vec<usize> = closed
        .iter()
        .map(|_| {
            let most = [12, 12, 12, 90][r.below(4) as usize];
            let n = 4 + r.below(most) as usize;
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
    let smooth = r.below(2) == 0;
    let curve = |r: &mut Random, n: usize| -> Vec<Point> {
        if !smooth {
            return (0..n).map(|_| r.vector(3.0)).collect();
        }
        let (center, u, v, w) = (r.vector(1.5), r.vector(2.0), r.vector(2.0), r.vector(0.7));
        (0..n)
            .map(|k| {
                let t = TAU * k as f64 / n as f64;
                let (c, s, f) = (t.cos(), t.sin(), (3.0 * t).cos());
                [0, 1, 2].map(|x| center[x] + c * u[x] + s * v[x] + f * w[x])
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
        // Each point its own way.
        0 => {
            for p in after.iter_mut().flatten() {
                let v = r.vector(size);
                *p = [0, 1, 2].map(|x| p[x] + v[x]);
            }
        }
        // Each curve as a whole; some stand still.
        1 => {
            for curve in &mut after {
                let size = [0.0, size][r.below(2) as usize];
                let v = r.vector(size);
                curve
                    .iter_mut()
                    .for_each(|p| *p = [0, 1, 2].map(|x| p[x] + v[x]));
            }
        }
        // A turn of all.
        2 => {
            let (s, c) = r.between(0.0, TAU).sin_cos();
            for p in after.iter_mut().flatten() {
                *p = [c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]];
            }
        }
        // A wave.
        3 => {
            let (k, v) = (r.vector(2.0), r.vector(size));
            for p in after.iter_mut().flatten() {
                let f = (k[0] * p[0] + k[1] * p[1] + k[2] * p[2]).sin();
                *p = [0, 1, 2].map(|x| p[x] + f * v[x]);
            }
        }
        // A few points far away: pull-throughs.
        4 => {
            for curve in &mut after {
                let k = r.below(curve.len() as u64) as usize;
                curve[k] = r.vector(3.0);
            }
        }
        // Other curves.
        _ => {
            for curve in &mut after {
                curve.iter_mut().for_each(|p| *p = r.vector(3.0));
            }
        }
    }
    if lattice {
        let frames = [&mut before, &mut after];
        for p in frames.into_iter().flatten().flatten() {
            *p = p.map(f64::round);
        }
    }
    let double = r.below(2) == 0;
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

/// Thousands of motions of every basis: linking numbers change by the sum of the signs.
#[test]
fn signs_add_up_to_the_change_of_the_linking_number() {
    let mut ledger = Ledger::default();
    for basis in Basis::ALL {
        let mut r = Random::new(7 + basis as u64);
        let (mut changed, mut events, mut undecided, mut left_out) = (0, 0, 0, 0);
        for k in 0..2000 {
            let [before, after] = random_step(&mut r, basis);
            let numbers = [&before, &after].map(certificate);
            let options = if k % 3 == 0 {
                ALL
            } else {
                LedgerOptions::default()
            };
            let outcome = ledger.step(&before, &after, options, None);
            assert_eq!(
                outcome.check(&numbers[0], &numbers[1]),
                [],
                "{basis:?} {k}: {outcome:?}"
            );
            changed += usize::from(numbers[0].links != numbers[1].links);
            events += outcome.events.len();
            undecided += outcome.undecided.len();
            left_out += numbers.iter().map(|n| n.undefined.len()).sum::<usize>();
            let in_order = |w: &[PullThrough]| w[0].fraction <= w[1].fraction;
            assert!(outcome.events.windows(2).all(in_order));
        }
        println!(
            "{basis:?}: {changed} of 2000 steps changed a linking number, {events} passages, {undecided} undecided, \
             {left_out} without a number"
        );
        assert!(changed > 500);
    }
}

/// Every planted passage is told, with its curves, segments, sign, time and place; and nothing else.
#[test]
fn planted_passages_are_told_and_no_others() {
    let mut ledger = Ledger::default();
    for plant in [Plant::Single, Plant::Cancelling, Plant::Own, Plant::Open] {
        let mut r = Random::new(40 + plant as u64);
        let (mut done, mut refused) = (0, 0);
        while done < 1000 {
            let basis = Basis::ALL[done % 4];
            let Some(scene) = scene(&mut r, basis, plant) else {
                refused += 1;
                assert!(refused < 10_000, "{plant:?}");
                continue;
            };
            let signs: Vec<i32> = scene.known.iter().map(|k| k.sign).collect();
            let wanted = match plant {
                Plant::Cancelling => signs.len() == 2,
                _ => signs.len() == 1,
            };
            if !wanted {
                refused += 1;
                continue;
            }
            done += 1;
            if plant == Plant::Cancelling {
                assert_eq!(signs.iter().sum::<i32>(), 0);
            }
            let [before, after] = &scene.frames;
            let outcome = ledger.step(before, after, ALL, None);
            assert_eq!(outcome.undecided, [], "{plant:?} {basis:?}");
            let told: Vec<_> = outcome
                .events
                .iter()
                .map(|e| ([e.i, e.j], e.segments, e.sign))
                .collect();
            let want: Vec<_> = scene
                .known
                .iter()
                .map(|k| (k.curves, k.segments, k.sign))
                .collect();
            assert_eq!(told, want, "{plant:?} {basis:?} {done}: {:?}", scene.known);
            let accuracy = if basis.is_polyline() { 1e-6 } else { 0.01 };
            for (e, k) in outcome.events.iter().zip(&scene.known) {
                assert!((e.fraction - k.fraction).abs() < accuracy, "{e:?} {k:?}");
            }
            let numbers = [before, after].map(certificate);
            assert_eq!(outcome.check(&numbers[0], &numbers[1]), []);
            match plant {
                Plant::Single => assert_ne!(numbers[0].links, numbers[1].links),
                // What no linking number sees.
                _ => assert_eq!(numbers[0].links, numbers[1].links),
            }
        }
        println!("{plant:?}: {done} told, {refused} scenes refused");
    }
}
