//! Facts of the run, as names and values.

use super::facts::Facts;
use crate::curve::significant;
use crate::incremental::Events;
use crate::words::{count, plural};
use std::path::Path;
use std::time::Duration;

impl Facts {
    /// Returns the most important facts of the run in a line. `name` is that of the recording.
    pub fn summary(&self, name: &str) -> String {
        let mut line = format!("{name}: {}", self.frames());
        if self.counts.verified > 0 {
            line += &format!("; {}", self.curves());
        }
        for (key, what) in [("service", "service"), ("version", "recorded by linkwatch")] {
            if let Some(value) = self.metadata.get(key) {
                line += &format!("; {what} {value}");
            }
        }
        line
    }

    /// Returns the numbers of frames.
    fn frames(&self) -> String {
        let counts = &self.counts;
        format!(
            "{} verified, {} skipped, {} rejected",
            plural(counts.verified, "frame"),
            count(counts.skipped),
            count(counts.rejected)
        )
    }

    /// Returns the numbers of curves and segments.
    fn curves(&self) -> String {
        let open = match self.stats.open_curves {
            0 => String::new(),
            n => format!(" ({} open)", count(n)),
        };
        let curves = plural(self.stats.curves, "curve");
        let segments = plural(self.stats.segments, "segment");
        format!("{curves}{open}, {segments}")
    }

    /// Returns the facts of the run as names and values.
    pub fn run(&self, recording: &Path) -> Vec<(String, String)> {
        let (counts, bins) = (&self.counts, &self.series.bins);
        let some = |there: bool, value: String| there.then_some(value);
        let rounded = |x: f64| significant((1e3 * x).round() / 1e3);
        let number = |n: u32| some(n > 0, count(n));
        let [start, end] = self.received_ns;
        let lasted = Duration::from_nanos(end.saturating_sub(start)).as_secs_f64();
        let recorded = format!("in {} s", rounded(lasted));
        let total: f64 = bins.iter().map(|b| b.total_ms).sum();
        let mean = rounded(total / bins.iter().map(|b| b.frames).sum::<u64>() as f64);
        let longest = rounded(bins.iter().map(|b| b.max_ms).fold(0.0, f64::max));
        let took = format!("{mean} ms on average, {longest} ms at most");
        let baseline = self.baseline.as_ref().map(|baseline| {
            let links = plural(baseline.links, "link");
            let undefined = match baseline.undefined {
                0 => String::new(),
                n => format!(", {} without a linking number", count(n)),
            };
            format!("{}: {links}{undefined}", baseline.origin)
        });
        let events = match self.events() {
            Events::Off => "not searched for",
            Events::Between => "between two curves",
            Events::All => "between two curves, and of a curve through itself",
        };
        let is_verified = counts.verified > 0;
        let rows = [
            ("recording", Some(recording.display().to_string())),
            ("frames", Some(self.frames())),
            ("from", self.span.map(|[first, _]| first.to_string())),
            ("to", self.span.map(|[_, last]| last.to_string())),
            ("recorded", some(start > 0, recorded)),
            (
                "rolled back or jumped",
                some(counts.cuts > 0, plural(counts.cuts, "time")),
            ),
            ("violations rolled back", number(counts.recovered)),
            ("violations accepted", number(counts.accepted)),
            ("curves", some(is_verified, self.curves())),
            (
                "extent",
                some(
                    is_verified && self.stats.extent > 0.0,
                    significant(self.stats.extent),
                ),
            ),
            ("a check took", some(is_verified, took)),
            ("baseline", baseline),
            (
                "pull-throughs",
                some(self.metadata.contains_key("events"), events.into()),
            ),
        ];
        let rows = rows.map(|(name, value)| Some((name.to_owned(), value?)));
        let metadata = self.metadata.iter().map(|(key, value)| {
            let name = match key.as_str() {
                "events" => return None,
                "abort_on" => "stops the simulator on",
                "version" => "recorded by linkwatch",
                "motion_limit" => "motion limit",
                "min_clearance" => "low clearance below",
                "replay_of" => "replay of",
                other => other,
            };
            Some((name.to_owned(), value.clone()))
        });
        rows.into_iter().chain(metadata).flatten().collect()
    }
}
