//! Costs of counting crossings on an adapter that fit measured times.

use linkwatch::kernels::CountingCost;

/// Counts of a frame, from which the cost of counting its crossings is predicted.
#[derive(Clone, Copy)]
pub struct Counts {
    pub segments: u64,
    pub links: u64,
    /// Number of segment pairs whose boxes overlap.
    pub tests: u64,
}

impl Counts {
    /// Returns the counts in millions, because costs are in nanoseconds and times in milliseconds.
    fn millions(self) -> [f64; 3] {
        [self.segments, self.links, self.tests].map(|n| n as f64 * 1e-6)
    }
}

fn adapter_ms(cost: &CountingCost, counts: Counts) -> f64 {
    let costs = [cost.segment_ns, cost.link_ns, cost.test_ns];
    let terms = counts.millions().into_iter().zip(costs);
    cost.round_trip_ms + terms.map(|(n, ns)| n * ns).sum::<f64>()
}

/// Returns the costs that fit the measured times of counting best, by least squares of the
/// logarithms of the ratios, so that predictions are too low as often as too high. All costs are at
/// least 0.
///
/// Weighted least squares, each round with weights from the previous fit, by coordinate descent.
pub fn fit(measured: &[(Counts, f64)], round_trip_ms: f64, cpu_factor: f64) -> CountingCost {
    const ROUNDS: usize = 30;
    const STEPS: usize = 3000;
    let mut cost = CountingCost {
        round_trip_ms,
        segment_ns: 0.0,
        link_ns: 0.0,
        test_ns: 0.0,
        error_factor: f64::INFINITY,
        cpu_factor,
    };
    let mut costs = [0.0f64; 3];
    let mut predicted: Vec<f64> = measured.iter().map(|m| m.1).collect();
    for _ in 0..ROUNDS {
        // Chosen so that w^2 (p - t) is the derivative of ln(p / t)^2 / 2, whose minimum is wanted.
        let squared_weight = |(p, t): (f64, f64)| {
            let ratio = p / t;
            let slope = match (ratio - 1.0).abs() < 1e-6 {
                true => 1.0,
                false => ratio.ln() / (ratio - 1.0),
            };
            slope / (p * t)
        };
        let rows = measured.iter().zip(&predicted);
        let rows = rows.map(|(&(counts, t), &p)| {
            (counts.millions(), t - round_trip_ms, squared_weight((p, t)))
        });
        let rows: Vec<([f64; 3], f64, f64)> = rows.collect();
        for step in 0..STEPS {
            let c = step % 3;
            let (mut above, mut below) = (0.0, 0.0);
            for &(n, ms, weight) in &rows {
                let others: f64 = (0..3).filter(|&k| k != c).map(|k| n[k] * costs[k]).sum();
                above += weight * n[c] * (ms - others);
                below += weight * n[c] * n[c];
            }
            costs[c] = (above / below).max(0.0);
        }
        [cost.segment_ns, cost.link_ns, cost.test_ns] = costs;
        predicted = measured.iter().map(|m| adapter_ms(&cost, m.0)).collect();
    }
    let ratios = predicted.iter().zip(measured).map(|(p, m)| p / m.1);
    let squares: f64 = ratios.map(|ratio| ratio.ln().powi(2)).sum();
    cost.error_factor = (squares / measured.len() as f64).sqrt().exp();
    cost
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
    fn times([round_trip_ms, segment_ns, link_ns, test_ns]: [f64; 4]) -> Vec<(Counts, f64)> {
        let cost = CountingCost {
            round_trip_ms,
            segment_ns,
            link_ns,
            test_ns,
            error_factor: 1.0,
            cpu_factor: 1.0,
        };
        let row = |[segments, links, tests]: [u64; 3]| {
            let counts = Counts {
                segments,
                links,
                tests,
            };
            (counts, adapter_ms(&cost, counts))
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
    fn a_fit_to_contradictory_times_reports_a_large_error() {
        let found = fit(&times([0.4, 3.0, 20.0, 1.0]), 1e6, 1.0);
        assert!(found.error_factor > 1e4, "{found:?}");
    }

    #[test]
    fn a_fit_to_noisy_times_has_no_negative_costs_and_stays_close() {
        let mut rows = times([0.4, 3.0, 20.0, 1.0]);
        for ((_, ms), noise) in rows.iter_mut().zip([1.2, 0.85, 1.15, 0.9, 0.8, 1.1]) {
            *ms *= noise;
        }
        let found = fit(&rows, 0.5, 1.0);
        let costs = [found.segment_ns, found.link_ns, found.test_ns];
        assert!(costs.iter().all(|&x| x >= 0.0));
        assert!((1.0..1.3).contains(&found.error_factor), "{found:?}");
        for (counts, ms) in rows {
            let ratio = adapter_ms(&found, counts) / ms;
            assert!((0.6..1.6).contains(&ratio), "{ratio}");
        }
    }

    /// If counts do not explain the times, predictions are too high and too low by the same factor.
    #[test]
    fn a_bad_fit_is_unbiased_and_reports_its_error() {
        let counts = Counts {
            segments: 1_000_000,
            links: 1,
            tests: 1_000_000,
        };
        let rows = [1.0, 9.0, 1.0, 9.0].map(|ms| (counts, ms));
        let found = fit(&rows, 0.01, 1.0);
        assert!((found.error_factor - 3.0).abs() < 0.1, "{found:?}");
        let ratios = rows.map(|(counts, ms)| (adapter_ms(&found, counts) / ms).ln());
        let bias = (ratios.iter().sum::<f64>() / rows.len() as f64).exp();
        assert!((bias - 1.0).abs() < 0.1, "{bias}");
    }
}
