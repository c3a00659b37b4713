//! Log lines of the frames, and the status as text.

use super::passed::Passed;
use super::picture::SHOWN;
use super::status::{Findings, status};
use super::style::{CYAN, ORANGE, QUIET, RED};
use crate::verdict::{Lasting, Report, Verdict};
use re_sdk_types::archetypes::TextLog;
use re_sdk_types::components::{Color, TextLogLevel};

/// Number of frames between log lines while nothing changes.
const QUIET_FRAMES: u64 = 200;

/// State of the log at the last frame, to log only what is new. A frame that differs in it gets a
/// log line.
#[derive(Default)]
pub(super) struct Log {
    /// `None` before the first frame.
    pub verdict: Option<Verdict>,
    /// First frame of this verdict.
    since: u64,
    findings: Findings,
    /// True if the status lists pull-throughs of its frame.
    events: bool,
    /// Frame of the last line.
    at: u64,
}

/// New lines of a frame, and the status if the previous one is outdated.
pub(super) struct News {
    pub lines: Vec<TextLog>,
    pub status: Option<String>,
}

impl Log {
    /// Returns a line for a frame with news, a sentence for each new finding, and occasionally a
    /// line for a frame without news. `names` are those of the curves, or empty.
    pub fn news(&mut self, report: &Report, names: &[String], passed: &Passed) -> News {
        let turned = self.verdict.replace(report.verdict) != Some(report.verdict);
        if turned {
            self.since = report.seq;
        }
        let has_events = !report.events.is_empty();
        let had_events = std::mem::replace(&mut self.events, has_events);
        let known = std::mem::take(&mut self.findings);
        let since_frame = |key| {
            let since = known.get(&key).copied().unwrap_or(report.seq);
            (key, since)
        };
        let findings: Findings = report.lasting().flatten().map(since_frame).collect();
        // The findings contain the first frame of each, so a finding that returns is new.
        let news = turned || has_events || findings != known;
        let news = news || !(report.appeared.is_empty() && report.gone.is_empty());
        let due = news || report.seq.abs_diff(self.at) >= QUIET_FRAMES;
        let mut lines = Vec::new();
        if due {
            self.at = report.seq;
            lines.push(line(report.verdict, report.headline()));
        }
        if news {
            let sentences = report.lasting().zip(report.findings_named(names));
            let is_new =
                |key: &Option<Lasting>| key.as_ref().is_none_or(|k| !known.contains_key(k));
            let mut new = sentences.filter(|(key, _)| is_new(key));
            for (key, text) in new.by_ref().take(SHOWN) {
                let line = line(report.verdict, text);
                // In the colour of its mark.
                lines.push(match key {
                    None => line.with_color(Color::from_u32(CYAN)),
                    Some(_) => line,
                });
            }
            let more = new.count();
            if more > 0 {
                lines.push(line(report.verdict, format!("and {more} more")));
            }
        }
        let outdated = news || had_events;
        let since = self.since;
        let status = outdated.then(|| status(report, names, since, &findings, passed, SHOWN));
        self.findings = findings;
        News { lines, status }
    }
}

/// Returns a line in the colour of a verdict.
pub(super) fn line(verdict: Verdict, text: impl Into<String>) -> TextLog {
    let (level, color) = match verdict {
        Verdict::Intact => (TextLogLevel::INFO, QUIET),
        Verdict::Changed => (TextLogLevel::ERROR, RED),
        _ => (TextLogLevel::WARN, ORANGE),
    };
    let line = TextLog::new(text.into()).with_level(level);
    line.with_color(Color::from_u32(color))
}
