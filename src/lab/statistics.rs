//! Repeated runs, and the median and the percentiles of their times.

use super::clock::timed;
use std::time::{Duration, Instant};

/// Limits of a repeated measurement.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Maximum number of runs. At least one run takes place.
    pub runs: u32,
    /// Time after which no further run starts.
    pub limit: Duration,
}

impl Effort {
    /// Returns a number of runs without a time limit.
    pub fn runs(runs: u32) -> Effort {
        let limit = Duration::MAX;
        Effort { runs, limit }
    }

    /// Repeats a run, and returns the results one by one.
    pub fn repeat<T>(self, mut run: impl FnMut() -> T) -> impl Iterator<Item = T> {
        let (began, mut runs) = (Instant::now(), 0);
        std::iter::from_fn(move || {
            let starts = runs == 0 || !self.is_reached(runs, began);
            runs += 1;
            starts.then(&mut run)
        })
    }

    /// Repeats a run. Returns the median of its wall-clock times in milliseconds, and its last
    /// result.
    ///
    /// Errors: those of the run.
    pub fn median_ms<T, E>(self, mut run: impl FnMut() -> Result<T, E>) -> Result<(f64, T), E> {
        let (began, mut times) = (Instant::now(), Vec::new());
        loop {
            let (found, elapsed) = timed(&mut run);
            let found = found?;
            times.push(elapsed.wall_ms);
            if self.is_reached(times.len(), began) {
                return Ok((median(times), found));
            }
        }
    }

    fn is_reached(self, runs: usize, began: Instant) -> bool {
        runs >= self.runs as usize || began.elapsed() >= self.limit
    }
}

/// Returns the median of some values: the larger one of two in the middle. NaN if there are none.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    percentile(values, 50)
}

/// Returns the nearest value at or above a percentile of some values. NaN if there are none.
pub fn percentile(values: impl IntoIterator<Item = f64>, percent: usize) -> f64 {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1);
    let at = (sorted.len() * percent / 100).min(last);
    sorted.get(at).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn computes_percentiles_of_few_and_many_values() {
        assert_eq!((median([5.0]), percentile([5.0], 95)), (5.0, 5.0));
        let v = || (0..100).rev().map(f64::from);
        assert_eq!((median(v()), percentile(v(), 95)), (50.0, 95.0));
        assert!(median([]).is_nan());
    }

    #[test]
    fn a_measurement_ends_at_either_limit() {
        let count = |effort: Effort| effort.repeat(|| ()).count();
        assert_eq!((count(Effort::runs(3)), count(Effort::runs(0))), (3, 1));
        let limit = Duration::ZERO;
        assert_eq!(count(Effort { runs: 9, limit }), 1);
        let (ms, found) = Effort::runs(2).median_ms(|| Ok::<_, ()>(7)).unwrap();
        assert!(ms >= 0.0 && found == 7);
        assert!(Effort::runs(2).median_ms(|| Err::<(), _>("no")).is_err());
    }
}
