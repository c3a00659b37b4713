//! Facts of the run, as names and values.

use super::facts::Facts;
use crate::curve::significant;
use crate::incremental::Events;
use crate::words::{count, if_any, plural};
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
        let [skipped, rejected] = [self.counts.skipped, self.counts.rejected].map(count);
        let verified = plural(self.counts.verified, "frame");
        format!("{verified} verified, {skipped} skipped, {rejected} rejected")
    }

    /// Returns the numbers of curves and segments.
    fn curves(&self) -> String {
        let open = self.stats.open_curves;
        let open = if_any(open, || format!(" ({} open)", count(open)));
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
        let recorded = format!("{}, in {} s", date(start), rounded(lasted));
        let total: f64 = bins.iter().map(|b| b.total_ms).sum();
        let mean = rounded(total / bins.iter().map(|b| b.frames).sum::<u64>() as f64);
        let longest = rounded(bins.iter().map(|b| b.max_ms).fold(0.0, f64::max));
        let took = format!("{mean} ms on average, {longest} ms at most");
        let baseline = self.baseline.as_ref().map(|baseline| {
            let links = plural(baseline.links, "link");
            let n = count(baseline.undefined);
            let undefined = baseline.undefined as u64;
            let undefined = if_any(undefined, || format!(", {n} without a linking number"));
            format!("{}: {links}{undefined}", baseline.origin)
        });
        let events = match self.events() {
            Events::Off => "not searched for",
            Events::Between => "between two curves",
            Events::All => "between two curves, and of a curve through itself",
        };
        let is_verified = counts.verified > 0;
        let extent = self.stats.extent;
        let has_extent = is_verified && extent > 0.0;
        let cuts = plural(counts.cuts, "time");
        let has_events = self.metadata.contains_key("events");
        let rows = [
            ("recording", Some(recording.display().to_string())),
            ("frames", Some(self.frames())),
            ("from", self.span.map(|[first, _]| first.to_string())),
            ("to", self.span.map(|[_, last]| last.to_string())),
            ("recorded", some(start > 0, recorded)),
            ("rolled back or jumped", some(counts.cuts > 0, cuts)),
            ("violations rolled back", number(counts.recovered)),
            ("violations accepted", number(counts.accepted)),
            ("curves", some(is_verified, self.curves())),
            ("extent", some(has_extent, significant(extent))),
            ("a check took", some(is_verified, took)),
            ("baseline", baseline),
            ("pull-throughs", some(has_events, events.into())),
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

/// Formats a time in nanoseconds since 1970 as a date and a time of day, in UTC.
fn date(ns: u64) -> String {
    let seconds = ns / 1_000_000_000;
    let (days, second) = (seconds / 86_400, seconds % 86_400);
    // Days since March 1 of the year 0, in eras of 400 years (Howard Hinnant, "chrono-Compatible
    // Low-Level Date Algorithms").
    let days = days + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = 400 * era + year + u64::from(month <= 2);
    let [hour, minute, second] = [second / 3600, second / 60 % 60, second % 60];
    format!("{year}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::date;

    #[test]
    fn times_are_dates_in_utc() {
        for (seconds, expected) in [
            (0, "1970-01-01 00:00:00 UTC"),
            (951_782_399, "2000-02-28 23:59:59 UTC"),
            (951_782_400, "2000-02-29 00:00:00 UTC"),
            (1_767_225_599, "2025-12-31 23:59:59 UTC"),
            (4_107_542_400, "2100-03-01 00:00:00 UTC"),
        ] {
            assert_eq!(date(seconds * 1_000_000_000), expected);
        }
    }
}
