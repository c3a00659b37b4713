//! Log lines of the frames, and the status in words.

use super::passed::Passed;
use super::picture::SHOWN;
use super::status::status;
use super::style::{CYAN, ORANGE, QUIET, RED};
use crate::verdict::{Known, Report, Verdict};
use re_sdk_types::archetypes::TextLog;
use re_sdk_types::components::{Color, TextLogLevel};

/// Number of frames between log lines while nothing changes.
const QUIET_FRAMES: u64 = 200;

/// State of the log at the last frame, to log only what is new.
#[derive(Default)]
pub(super) struct Log {
    known: Known,
    /// First frame of the last verdict.
    since: u64,
    /// True if the status lists pull-throughs of the last frame.
    had_events: bool,
    /// Frame of the last line.
    last: u64,
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
        let novelty = self.known.update(report);
        let turned = novelty.before != Some(report.verdict);
        if turned {
            self.since = report.seq;
        }
        let has_events = !report.events.is_empty();
        let news = turned || has_events || novelty.changed;
        let news = news || !(report.appeared.is_empty() && report.gone.is_empty());
        let mut lines = Vec::new();
        if news || report.seq.abs_diff(self.last) >= QUIET_FRAMES {
            lines.push(line(report.verdict, report.headline()));
            self.last = report.seq;
        }
        let all = report.lasting().zip(report.findings_named(names));
        let mut new = all.zip(novelty.new).filter(|(_, new)| news && *new);
        for ((key, text), _) in new.by_ref().take(SHOWN) {
            let line = line(report.verdict, text);
            // In the colour of its mark.
            lines.push(match key {
                None => line.with_color(Color::from_u32(CYAN)),
                Some(_) => line,
            });
        }
        if let more @ 1.. = new.count() {
            lines.push(line(report.verdict, format!("and {more} more")));
        }
        let outdated = news || std::mem::replace(&mut self.had_events, has_events);
        let status = outdated.then(|| status(report, names, self.since, passed, SHOWN));
        News { lines, status }
    }
}

/// Returns a line in the colour of a verdict.
pub(super) fn line(verdict: Verdict, text: impl Into<String>) -> TextLog {
    let level = match verdict {
        Verdict::Intact => TextLogLevel::INFO,
        Verdict::Changed => TextLogLevel::ERROR,
        _ => TextLogLevel::WARN,
    };
    let color = match verdict {
        Verdict::Intact => QUIET,
        Verdict::Changed => RED,
        _ => ORANGE,
    };
    TextLog::new(text.into())
        .with_level(level)
        .with_color(Color::from_u32(color))
}
