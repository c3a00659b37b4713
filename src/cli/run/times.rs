//! Times of the frames of a run, stage by stage.

use crate::cli::output::{millis, milliseconds, percent};
use linkwatch::FrameTimes;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::time::Duration;

/// Returns the times of a frame in milliseconds. `clearance` is a part of the verification.
pub fn to_json(times: &FrameTimes, clearance: Option<Duration>) -> Value {
    let stages = times.by_stage().into_iter().zip(STAGES);
    let all = stages.chain([(clearance, "clearance")]);
    all.filter_map(|(time, name)| Some((name, milliseconds(time?))))
        .collect()
}

/// Stages of a frame.
const STAGES: [&str; 4] = ["wait", "ingest", "verification", "send"];

impl FrameTimes {
    /// Returns the times of the [`STAGES`]; `None` for stages that only live frames have.
    fn by_stage(&self) -> [Option<Duration>; STAGES.len()] {
        let (wait, send) = self.live.map(|live| (live.wait, live.send)).unzip();
        [wait, Some(self.ingest), Some(self.verification), send]
    }
}

/// Times of all frames of a run.
#[derive(Default)]
pub struct RunTimes {
    pub checks: Durations,
    stages: [Durations; STAGES.len()],
    /// Sum of the intervals between live frames.
    intervals: Duration,
    /// Part of these intervals from the receipt of a frame until its verdict was sent.
    busy: Duration,
}

impl RunTimes {
    pub fn add(&mut self, times: &FrameTimes) {
        self.checks.add(times.check());
        for (all, time) in self.stages.iter_mut().zip(times.by_stage()) {
            time.into_iter().for_each(|time| all.add(time));
        }
        if let Some(live) = times.live {
            self.intervals += live.interval;
            self.busy += times.check() + live.send;
        }
    }

    /// Returns the share of the time between live frames during which a verdict was pending. `None`
    /// if no frames were live.
    fn share(&self) -> Option<f64> {
        (!self.intervals.is_zero()).then(|| self.busy.as_secs_f64() / self.intervals.as_secs_f64())
    }

    /// Returns the times of each stage in milliseconds, and the share of the time between frames.
    pub fn to_json(&self) -> Value {
        let stages = STAGES.into_iter().zip(&self.stages);
        let stages = stages.filter(|(_, d)| !d.buckets.is_empty());
        let stages = stages.map(|(name, d)| {
            let [median, p99] = [0.5, 0.99].map(|q| milliseconds(d.quantile(q)));
            let times = json!({ "median": median, "p99": p99, "max": milliseconds(d.longest) });
            (name.to_owned(), times)
        });
        json!({
            "stages": stages.collect::<serde_json::Map<_, _>>(),
            "share_of_interval": self.share(),
        })
    }

    /// Returns a text for the times, if the frames were live.
    pub fn words(&self) -> Option<String> {
        let share = percent(self.share()?);
        let stages = STAGES.iter().zip(&self.stages).map(|(name, d)| {
            let [median, p99] = [0.5, 0.99].map(|q| millis(d.quantile(q)));
            format!("{name} {median}, {p99}, {}", millis(d.longest))
        });
        let stages = stages.collect::<Vec<String>>().join("; ");
        Some(format!(
            "times (median, 99th percentile, maximum): {stages}; {share} of the time between \
             frames until the verdict was sent"
        ))
    }
}

/// Histogram of durations in buckets of 5 %, whose memory does not grow, because a run may last for
/// days.
#[derive(Default)]
pub struct Durations {
    buckets: BTreeMap<i32, u64>,
    pub longest: Duration,
}

impl Durations {
    /// Ratio of neighbouring buckets.
    const RATIO: f64 = 1.05;

    fn add(&mut self, d: Duration) {
        let bucket = d.as_secs_f64().max(1e-9).ln() / Self::RATIO.ln();
        *self.buckets.entry(bucket.round() as i32).or_default() += 1;
        self.longest = self.longest.max(d);
    }

    /// Returns the `q` quantile, with the precision of a bucket.
    fn quantile(&self, q: f64) -> Duration {
        let below = q * self.buckets.values().sum::<u64>() as f64;
        let mut seen = 0;
        let bucket = self.buckets.iter().find(|(_, n)| {
            seen += **n;
            seen as f64 > below
        });
        bucket.map_or(self.longest, |(&bucket, _)| {
            Duration::from_secs_f64(Self::RATIO.powi(bucket)).min(self.longest)
        })
    }

    /// Returns the median, with the precision of a bucket.
    pub fn median(&self) -> Duration {
        self.quantile(0.5)
    }

    /// Returns a text for the median and the maximum.
    pub fn words(&self) -> String {
        let [median, longest] = [self.median(), self.longest].map(millis);
        format!("a check took {median} (median), {longest} at most")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use linkwatch::LiveTimes;

    #[test]
    fn quantiles_are_right_within_a_bucket() {
        let mut d = Durations::default();
        assert_eq!(d.median(), Duration::ZERO);
        for ms in 1..=101 {
            d.add(Duration::from_millis(ms));
        }
        for (q, expected) in [(0.5, 0.051), (0.99, 0.100), (1.0, 0.101)] {
            let found = d.quantile(q).as_secs_f64();
            assert!((found / expected - 1.0).abs() < 0.05, "{q}: {found}");
        }
        assert_eq!(d.longest, Duration::from_millis(101));
    }

    #[test]
    fn the_share_counts_live_frames_only() {
        let ms = Duration::from_millis;
        let mut times = FrameTimes {
            ingest: ms(1),
            verification: ms(2),
            ..FrameTimes::default()
        };
        let mut run = RunTimes::default();
        run.add(&times);
        assert_eq!((run.share(), run.words()), (None, None));
        times.live = Some(LiveTimes {
            interval: ms(40),
            wait: ms(36),
            send: ms(1),
        });
        run.add(&times);
        assert_eq!(run.share(), Some(0.1));
        assert_eq!(run.to_json()["stages"]["wait"]["max"], 36.0);
    }
}
