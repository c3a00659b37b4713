//! Frames that are rejected leave no trace: all other frames have the same reports without them.

use super::support::random::Random;
use linkwatch::{
    Basis, Cell, CurveChange, CurveLabels, CurveSet, Events, Point, Positions, Report, Strategy,
    Verdict, Verifier, VerifierOptions,
};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Number of curves of a scene.
const CURVES: usize = 9;

/// Pairs of curves that a frame may have. A frame of all curves in one place has 36.
const MOST: usize = 24;

/// Rings and rods in a row, each near the next one.
#[derive(Clone)]
struct Scene {
    cell: Option<Cell>,
    centers: Vec<Point>,
    /// Number of points of each curve.
    sizes: Vec<usize>,
}

impl Scene {
    fn random(random: &mut Random, cell: Option<Cell>) -> Scene {
        let center = |i: usize| [1.2 * i as f64, 0.0, 0.0];
        Scene {
            cell,
            centers: (0..CURVES).map(center).collect(),
            sizes: (0..CURVES).map(|_| 5 + random.below(6)).collect(),
        }
    }

    /// Moves each curve, some of them so far that links change.
    fn advance(&mut self, random: &mut Random) {
        for c in &mut self.centers {
            let far = if random.one_in(12) { 1.0 } else { 0.08 };
            let by: Point = [0, 1, 2].map(|_| far * (random.below(2001) as f64 / 1e3 - 1.0));
            *c = [0, 1, 2].map(|x| (c[x] + by[x]) * if x > 0 { 0.9 } else { 1.0 });
        }
    }

    fn points(&self, i: usize) -> (i32, Vec<Point>) {
        let n = self.sizes[i];
        let is_rod = i % 4 == 3;
        let point = |k: usize| {
            let (sin, cos) = (TAU * k as f64 / n as f64).sin_cos();
            let offset = match (is_rod, i % 2) {
                (true, _) => [0.0, 0.0, 3.0 * k as f64 / n as f64 - 1.5],
                (_, 0) => [cos, sin, 0.0],
                _ => [cos, 0.0, sin],
            };
            [0, 1, 2].map(|x| self.centers[i][x] + offset[x])
        };
        let sign = if is_rod { 1 } else { -1 };
        (sign * n as i32, (0..n).map(point).collect())
    }

    /// Returns these curves.
    fn set(&self, curves: &[usize]) -> Arc<CurveSet> {
        let (mut counts, mut xyz) = (Vec::new(), Vec::new());
        for &i in curves {
            let (count, points) = self.points(i);
            counts.push(count);
            xyz.extend(points);
        }
        let positions = Positions::F64(xyz.as_flattened());
        CurveSet::from_counts(Basis::Polyline, &counts, positions)
            .unwrap()
            .into()
    }

    /// Returns a frame that is rejected, and its curves.
    fn rejected(&self, random: &mut Random, active: &[usize]) -> (Scene, Vec<usize>) {
        let mut scene = self.clone();
        let mut curves = active.to_vec();
        match random.below(4) {
            // Too many pairs.
            0 | 1 => scene.centers = vec![[0.5, 0.1, 0.2]; CURVES],
            // The same, of other curves.
            2 => {
                scene.centers = vec![[0.5, 0.1, 0.2]; CURVES];
                curves.rotate_left(1);
            }
            // Other numbers of points than before, or than announced.
            _ => scene.sizes.iter_mut().for_each(|n| *n += 1),
        }
        (scene, curves)
    }
}

fn labels(curves: &[usize]) -> CurveLabels {
    CurveLabels::named(curves.iter().map(usize::to_string))
}

/// A verifier, and the curves of the last frame that it verified.
struct Side {
    verifier: Verifier,
    known: Option<Vec<usize>>,
}

impl Side {
    /// Verifies a frame as a session does. `announced` are the curves that the frame claims.
    fn step(
        &mut self,
        seq: u64,
        scene: &Scene,
        (curves, cut): (&[usize], bool),
    ) -> Result<Report, linkwatch::Error> {
        let known = self.known.as_deref().unwrap_or(curves);
        let change = CurveChange::by_name(&labels(known), &labels(curves)).unwrap();
        self.verifier
            .change_curves(Some(change).filter(|_| known != curves));
        if cut {
            self.verifier.cut();
        }
        if let Some(cell) = scene.cell {
            self.verifier.set_cell(cell)?;
        }
        let report = self.verifier.step_shared(seq, 0.0, &scene.set(curves))?;
        self.verifier.settle();
        self.known = Some(curves.to_vec());
        Ok(report)
    }
}

/// Verifies sequences with and without frames that are rejected.
fn sequences(seeds: std::ops::Range<u64>) {
    let mut verdicts = BTreeMap::<String, u64>::new();
    let mut rejected = 0;
    for seed in seeds {
        let mut random = Random::from_key([seed, 97]);
        let periodic = random.one_in(3);
        let cell = periodic.then(|| "40,12,12".parse().unwrap());
        let mut scene = Scene::random(&mut random, cell);
        let options = VerifierOptions {
            strategy: random.pick(&[Strategy::Full, Strategy::Incremental, Strategy::Incremental]),
            events: random.pick(&[Events::Off, Events::Between, Events::All]),
            max_pairs: MOST,
            cell: scene.cell,
            ..VerifierOptions::default()
        };
        let new = || Side {
            verifier: Verifier::new(options.clone()).unwrap(),
            known: None,
        };
        let (mut with, mut without) = (new(), new());
        let mut active: Vec<usize> = (0..CURVES).collect();
        for seq in 0..12 {
            scene.advance(&mut random);
            if !periodic && random.one_in(4) {
                let k = random.below(active.len());
                match active.len() < CURVES {
                    true => active = (0..CURVES).collect(),
                    false => drop(active.remove(k)),
                }
            }
            while random.one_in(2) {
                let (bad, curves) = scene.rejected(&mut random, &active);
                if with.step(seq, &bad, (&curves, false)).is_ok() {
                    // No reason to reject it: it is part of both sequences.
                    let report = without.step(seq, &bad, (&curves, false));
                    assert!(report.is_ok(), "seed {seed}, frame {seq}");
                } else {
                    rejected += 1;
                }
            }
            let cut = random.one_in(10);
            let [a, b] = [&mut with, &mut without].map(|side| {
                side.step(seq, &scene, (&active, cut))
                    .map_err(|e| e.to_string())
            });
            assert_eq!(a, b, "seed {seed}, frame {seq}, {options:?}");
            assert_eq!(with.verifier.baseline(), without.verifier.baseline());
            let verdict = a.map_or("rejected".into(), |report| report.verdict.to_string());
            *verdicts.entry(verdict).or_default() += 1;
        }
    }
    println!("{rejected} rejected frames inserted; {verdicts:?}");
    let intact = verdicts[&Verdict::Intact.to_string()];
    assert!(
        rejected > intact / 4 && intact > 0 && verdicts.len() > 2,
        "{verdicts:?}"
    );
}

#[test]
fn rejected_frames_leave_no_trace() {
    sequences(0..1000);
}

/// The same with 100,000 sequences.
#[test]
#[ignore = "takes minutes"]
fn very_many_rejected_frames_leave_no_trace() {
    sequences(1000..101_000);
}
