//! Measures kernels on an adapter and on the CPU, and fits the costs of the automatic choice
//! ([`Calibration`]).

use crate::curve::CurveSet;
use crate::discretize::homotopic_polylines;
use crate::error::{Error, Result};
use crate::kernels::choice::Predictions;
use crate::kernels::crossings::{Input, Workspaces};
use crate::kernels::gpu::{self, Frame, Gpu};
use crate::kernels::{
    Accuracy, Calibration, CountingCost, CountingWork, Device, Estimate, GpuUse, Method, SumCost,
    segment_pairs, segments,
};
use crate::pairs::{LinkSearch, Pair, Trees, degenerate_curves, potential_links};
use crate::scenes::Scene as Model;
use crate::verifier::{Verifier, VerifierOptions};
use nalgebra::{DMatrix, DVector};
use std::time::{Duration, Instant};

/// Maximum number of runs of a median.
const RUNS: usize = 5;

/// Time after which no further run starts.
const ENOUGH: Duration = Duration::from_millis(500);

/// Scenes that measure sums: the smallest, which gives the round trip, and one that gives the
/// speed, for a hardware adapter and for a software renderer.
const SMALLEST: &str = "ribbon:segments=200,lambda=1";
const DIRECT: [&str; 2] = [
    "ribbon:segments=100000,lambda=10",
    "ribbon:segments=6000,lambda=10",
];
/// Scene that measures direct sums on the CPU.
const DIRECT_HERE: &str = "ribbon:segments=6000,lambda=10";
const BARNES_HUT: [&str; 2] = [
    "knit:rows=40,stitches=100,segments=48000",
    "knit:rows=10,stitches=40,segments=4000",
];

/// Scene that measures the round trip of counting: it has hardly any work.
const COUNTED_FIRST: &str = "ribbon:segments=60,lambda=1";
/// Scenes that measure the costs of counting: many small links, many segments, many crossings of
/// long curves and of short ones. For a hardware adapter, and for a software renderer.
const COUNTED: [[&str; 7]; 2] = [
    [
        "chainmail:rows=8,columns=8",
        "chainmail:rows=40,columns=40",
        "chainmail:rows=160,columns=160",
        "ribbon:segments=2000000,lambda=10",
        "woundball:segments=400000,crossings=300",
        "torus_link:segments=200000,toroidal=200,poloidal=200",
        "square_link:loops=300,segments=100000",
    ],
    [
        "chainmail:rows=4,columns=4",
        "chainmail:rows=20,columns=20",
        "chainmail:rows=50,columns=50",
        "ribbon:segments=100000,lambda=10",
        "woundball:segments=20001,crossings=100",
        "torus_link:segments=4000,toroidal=30,poloidal=20",
        "square_link:loops=60,segments=6000",
    ],
];

/// Measures kernels on whole frames, on an adapter and on the CPU, with the threads of the rayon
/// pool in which it is called. This takes some seconds.
///
/// Errors: [`Error::Device`].
pub fn calibrate(device: &Device) -> Result<Calibration> {
    let gpu = Gpu::shared(device).map_err(failed)?;
    let info = gpu.info();
    let software = usize::from(info.software);
    let subject = |text: &str| MeasuredScene::new(text);
    let direct = |s: &MeasuredScene| s.adapter_ms(|| gpu.sum_directly(&s.set, &s.links));
    let smallest = subject(SMALLEST)?;
    let (large, here) = (subject(DIRECT[software])?, subject(DIRECT_HERE)?);
    let direct = sum_cost(
        [direct(&smallest)?, direct(&large)?],
        segment_pairs(&large.set, &large.links),
        here.sum_ms(Method::Direct)?,
        segment_pairs(&here.set, &here.links),
    );
    let by_trees = |s: &MeasuredScene| s.adapter_ms(|| gpu.sum_by_trees(&s.set, &s.links));
    let large = subject(BARNES_HUT[software])?;
    let work = segments(&large.set, &large.links);
    let barnes_hut = sum_cost(
        [by_trees(&smallest)?, by_trees(&large)?],
        work,
        large.sum_ms(Method::BarnesHut)?,
        work,
    );
    let (_, round_trip_ms) = subject(COUNTED_FIRST)?.count(&gpu)?;
    let mut rows = Vec::new();
    let mut factors = 0.0;
    for text in COUNTED[software] {
        let subject = subject(text)?;
        rows.push(subject.count(&gpu)?);
        factors += (subject.cpu_ms()? / subject.predicted_ms()).ln();
    }
    usable(Calibration {
        adapter: info.name,
        backend: info.backend,
        driver: info.driver,
        threads: rayon::current_num_threads(),
        direct,
        barnes_hut,
        crossings: fit(&rows, round_trip_ms, (factors / rows.len() as f64).exp()),
    })
}

/// Fails if the fitted costs are invalid, because a stored calibration must be readable. This
/// happens on a busy machine.
///
/// Errors: [`Error::Device`].
fn usable(c: Calibration) -> Result<Calibration> {
    match c.is_valid() {
        true => Ok(c),
        false => Err(Error::Device(format!(
            "the measured times of {} fit no costs; repeat the calibration on an idle machine",
            c.adapter
        ))),
    }
}

/// Minimum of a measured time after the round trip is subtracted.
const SHORTEST_MS: f64 = 1e-3;

fn failed(error: gpu::Error) -> Error {
    Error::Device(error.to_string())
}

fn sum_cost([smallest_ms, large_ms]: [f64; 2], work: u64, cpu_ms: f64, cpu_work: u64) -> SumCost {
    SumCost {
        round_trip_ms: smallest_ms,
        adapter_ns: (large_ms - smallest_ms).max(SHORTEST_MS) * 1e6 / work as f64,
        cpu_ns: cpu_ms * 1e6 / cpu_work as f64,
    }
}

/// A generated scene of polylines, prepared for measurements.
struct MeasuredScene {
    set: CurveSet,
    trees: Trees,
    links: Vec<Pair>,
    workspaces: Workspaces,
}

impl MeasuredScene {
    fn new(text: &str) -> Result<MeasuredScene> {
        let mut set = text.parse::<Model>()?.build()?.curves;
        if !set.basis().is_polyline() {
            set = homotopic_polylines(&set)?.curves;
        }
        let mut trees = Trees::default();
        trees.refit(&set);
        let degenerate: Vec<_> = degenerate_curves(&set).collect();
        let links = potential_links(&trees, &mut LinkSearch::default(), &degenerate).clone();
        Ok(MeasuredScene {
            set,
            trees,
            links,
            workspaces: Workspaces::default(),
        })
    }

    fn input(&self) -> Input<'_> {
        Input {
            set: &self.set,
            trees: &self.trees,
            workspaces: &self.workspaces,
        }
    }

    /// Measures a kernel on an adapter, in wall-clock time.
    fn adapter_ms(&self, run: impl Fn() -> Result<Vec<Estimate>, gpu::Error>) -> Result<f64> {
        median_ms(|start| {
            run().map_err(failed)?;
            Ok(start.elapsed().as_secs_f64() * 1e3)
        })
    }

    /// Measures a sum on the CPU.
    fn sum_ms(&self, method: Method) -> Result<f64> {
        let none = GpuUse::default();
        median_ms(|start| {
            let sum = method.summation(&self.set, Accuracy::default(), &none, &self.links);
            sum.map(|sum| sum.linking_numbers(&self.links));
            Ok(start.elapsed().as_secs_f64() * 1e3)
        })
    }

    /// Measures counting on an adapter, from vertices in memory. Returns the work and the time.
    fn count(&self, gpu: &Gpu) -> Result<(CountingWork, f64)> {
        let mut work = CountingWork {
            segments: self.set.segments() as u64,
            links: self.links.len() as u64,
            tests: 0,
        };
        let ms = median_ms(|start| {
            let frame = Frame::new(&self.set);
            gpu.send(&frame).map_err(failed)?;
            let counted = gpu.count(&frame, self.input(), &self.links, None);
            let ((parts, _), _) = counted.map_err(failed)?;
            work.tests = parts.iter().map(|part| part.stats.tests).sum();
            Ok(start.elapsed().as_secs_f64() * 1e3)
        })?;
        Ok((work, ms))
    }

    /// Measures counting on the CPU.
    fn cpu_ms(&self) -> Result<f64> {
        let mut verifier = Verifier::new(VerifierOptions {
            kernel: Method::Crossings,
            ..VerifierOptions::default()
        })?;
        median_ms(|_| {
            verifier.certify(&self.set);
            Ok(verifier.timings().links.as_secs_f64() * 1e3)
        })
    }

    /// Returns the predicted time of counting on the CPU.
    fn predicted_ms(&self) -> f64 {
        Predictions::new(self.input(), &self.links, Method::Crossings).on_cpu_ms()
    }
}

/// Returns the median time of some runs, after one that compiles shaders and allocates buffers.
/// Long runs are repeated less often.
fn median_ms(mut run: impl FnMut(Instant) -> Result<f64>) -> Result<f64> {
    run(Instant::now())?;
    let (begun, mut times) = (Instant::now(), Vec::new());
    while times.len() < RUNS && (times.is_empty() || begun.elapsed() < ENOUGH) {
        times.push(run(Instant::now())?);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}

/// Returns the costs that fit the measured times of counting best, by least squares of the
/// logarithms of the ratios, so that predictions are too low as often as too high. All costs are at
/// least 0: with so few unknowns, every subset of nonzero costs is tried.
fn fit(measured: &[(CountingWork, f64)], round_trip_ms: f64, cpu_factor: f64) -> CountingCost {
    let start = CountingCost {
        round_trip_ms,
        segment_ns: 0.0,
        link_ns: 0.0,
        test_ns: 0.0,
        error_factor: f64::INFINITY,
        cpu_factor,
    };
    let mut best = start;
    for chosen in 1..8u32 {
        let columns: Vec<usize> = (0..3).filter(|c| chosen >> c & 1 == 1).collect();
        let fitted = fit_some(measured, &columns, start);
        if let Some(found) = fitted.filter(|f| f.error_factor < best.error_factor) {
            best = found;
        }
    }
    best
}

/// Fits some of the costs. `None` if one of them is negative, or not determined by the
/// measurements.
fn fit_some(
    measured: &[(CountingWork, f64)],
    columns: &[usize],
    start: CountingCost,
) -> Option<CountingCost> {
    /// Number of rounds of weighted least squares, each with weights from the previous fit.
    const ROUNDS: usize = 30;
    let count = |work: &CountingWork, column: usize| {
        // In millions, because costs are in nanoseconds and times in milliseconds.
        [work.segments, work.links, work.tests][column] as f64 * 1e-6
    };
    let mut cost = start;
    let mut predicted: Vec<f64> = measured.iter().map(|m| m.1).collect();
    for _ in 0..ROUNDS {
        // Chosen so that w^2 (p - t) is the derivative of ln(p / t)^2 / 2, whose minimum is wanted.
        let weight = |r: usize| {
            let (p, t) = (predicted[r], measured[r].1);
            let ratio = p / t;
            let slope = match (ratio - 1.0).abs() < 1e-6 {
                true => 1.0,
                false => ratio.ln() / (ratio - 1.0),
            };
            (slope / (p * t)).sqrt()
        };
        let weighted = |r: usize, c: usize| count(&measured[r].0, c) * weight(r);
        let rows = measured.len();
        // Columns of very different sizes are scaled to the same size.
        let largest = |c| (0..rows).fold(1e-300, |m: f64, r| m.max(weighted(r, c)));
        let sizes: Vec<f64> = columns.iter().map(|&c| largest(c)).collect();
        let matrix = DMatrix::from_fn(rows, columns.len(), |r, k| {
            weighted(r, columns[k]) / sizes[k]
        });
        let wanted = DVector::from_fn(rows, |r, _| {
            (measured[r].1 - start.round_trip_ms) * weight(r)
        });
        let normal = (matrix.transpose() * &matrix).cholesky()?;
        let found = normal.solve(&(matrix.transpose() * &wanted));
        for ((&column, size), x) in columns.iter().zip(&sizes).zip(&found) {
            if x.is_nan() || *x < 0.0 {
                return None;
            }
            let to = [&mut cost.segment_ns, &mut cost.link_ns, &mut cost.test_ns];
            if let Some(to) = to.into_iter().nth(column) {
                *to = x / size;
            }
        }
        predicted = measured.iter().map(|m| cost.adapter_ms(m.0)).collect();
    }
    let squares = predicted
        .iter()
        .zip(measured)
        .map(|(p, m)| (p / m.1).ln().powi(2));
    cost.error_factor = (squares.sum::<f64>() / measured.len() as f64).sqrt().exp();
    Some(cost)
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNTS: [[u64; 3]; 6] = [
        [300, 20, 30],
        [40_000, 18_000, 20_000],
        [2_000_000, 1, 100],
        [400_000, 1, 7_000_000],
        [100_000, 40_000, 90_000],
        [1_000_000, 1, 3_000_000],
    ];

    /// Milliseconds of a round trip, and nanoseconds of a segment, a link and a test.
    fn times([round_trip, segment, link, test]: [f64; 4]) -> Vec<(CountingWork, f64)> {
        let cost = CountingCost {
            round_trip_ms: round_trip,
            segment_ns: segment,
            link_ns: link,
            test_ns: test,
            error_factor: 1.0,
            cpu_factor: 1.0,
        };
        let row = |[segments, links, tests]: [u64; 3]| {
            let work = CountingWork {
                segments,
                links,
                tests,
            };
            (work, cost.adapter_ms(work))
        };
        COUNTS.into_iter().map(row).collect()
    }

    #[test]
    fn a_fit_recovers_the_costs_of_exact_times() {
        for cost in [
            [0.4, 3.0, 20.0, 1.0],
            [0.1, 0.0, 200.0, 10.0],
            [0.01, 1.0, 0.0, 0.1],
        ] {
            let found = fit(&times(cost), cost[0], 1.5);
            let costs = [found.segment_ns, found.link_ns, found.test_ns];
            for (found, want) in costs.iter().zip(&cost[1..]) {
                assert!((found - want).abs() <= 1e-6, "{found} {want}");
            }
            assert!((found.error_factor - 1.0).abs() < 1e-6);
            assert_eq!((found.round_trip_ms, found.cpu_factor), (cost[0], 1.5));
        }
    }

    /// All frames took less time than the smallest one.
    #[test]
    fn rejects_a_fit_to_contradictory_times() {
        let rows = times([0.4, 3.0, 20.0, 1.0]);
        let c = Calibration {
            crossings: fit(&rows, 1e6, 1.0),
            ..Calibration::made_up(0.5, 10.0)
        };
        assert!(usable(c).is_err());
        assert!(usable(Calibration::made_up(0.5, 10.0)).is_ok());
    }

    #[test]
    fn a_fit_to_noisy_times_has_no_negative_costs_and_stays_close() {
        let mut rows = times([0.4, 3.0, 20.0, 1.0]);
        for ((_, ms), noise) in rows.iter_mut().zip([1.2, 0.85, 1.15, 0.9, 0.8, 1.1]) {
            *ms *= noise;
        }
        let found = fit(&rows, 0.5, 1.0);
        assert!(
            [found.segment_ns, found.link_ns, found.test_ns]
                .iter()
                .all(|&x| x >= 0.0)
        );
        assert!((1.0..1.3).contains(&found.error_factor), "{found:?}");
        for (work, ms) in rows {
            let ratio = found.adapter_ms(work) / ms;
            assert!((0.6..1.6).contains(&ratio), "{ratio}");
        }
    }

    /// If counts do not explain the times, predictions are too high and too low by the same factor.
    #[test]
    fn a_bad_fit_is_unbiased_and_reports_its_error() {
        let work = CountingWork {
            segments: 1_000_000,
            links: 1,
            tests: 1_000_000,
        };
        let rows = [1.0, 9.0, 1.0, 9.0].map(|ms| (work, ms));
        let found = fit(&rows, 0.01, 1.0);
        assert!((found.error_factor - 3.0).abs() < 0.1, "{found:?}");
        let ratios = rows
            .iter()
            .map(|(work, ms)| (found.adapter_ms(*work) / ms).ln());
        let bias = (ratios.sum::<f64>() / rows.len() as f64).exp();
        assert!((bias - 1.0).abs() < 0.1, "{bias}");
    }
}
