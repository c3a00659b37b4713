//! Prints the results of the frames of a run.

use super::news::New;
use super::times::to_json;
use super::{Judged, Run, THE_FRAMES};
use crate::cli::live::Label;
use crate::cli::output::{self, count, millis, plural};
use crate::curve::Notation;
use linkwatch::LeftOut;
use linkwatch::Report;

/// Maximum number of sentences printed about one frame of a stream; the rest is counted.
const SENTENCES: usize = 8;

/// The same for a model file.
const MODEL_SENTENCES: usize = 100;

impl Run {
    /// Returns the number of curves that run through the cell, once a frame was verified.
    pub(super) fn yarns(&self) -> usize {
        self.session.baseline().map_or(0, |b| b.periods.len())
    }

    /// Warns of properties of the curves, after the first frame.
    pub(super) fn warn_of_scene(&self, judged: &Judged) {
        let name = judged.model.as_deref().unwrap_or(THE_FRAMES);
        output::warn_of_open_curves(name, &judged.report.stats, Some(self.options.events));
        output::tell_of_yarns(name, self.yarns(), Some(self.options.events));
        if let Some(curves) = &judged.curves {
            self.cell_args
                .warn_of_segments(name, curves, judged.info.cell);
        }
    }

    /// Prints the new findings of a report, and updates the status line.
    pub(super) fn print(&mut self, judged: &Judged) {
        let (report, times, model) = (&judged.report, &judged.times, &judged.model);
        let left_out = &report.left_out;
        let new_kind = LeftOut::merge(&mut self.sum.left_out, left_out);
        if !left_out.is_empty() {
            self.data_lost();
        }
        let names = &judged.info.labels.names;
        if self.json {
            let measured = judged.curves.is_some() && self.options.clearance.is_some();
            let mut line = serde_json::json!({
                "report": **report,
                "ms": times.check().as_secs_f64() * 1e3,
                "times_ms": to_json(times, measured.then_some(times.stages.clearance)),
                "work": judged.work,
                "offload": judged.offload,
                "verified": self.tally.verified,
                "skipped": self.tally.skipped,
                "rejected": self.tally.rejected,
            });
            if let Some(model) = model {
                line["model"] = model.as_str().into();
                line["left_out"] = serde_json::json!(left_out);
            }
            self.live.label.json(line);
        }
        if let Some(junit) = &mut self.junit {
            junit.add(report, names, model.as_deref(), times.check());
        }
        self.sum.unresolved.add(report);
        let news = self.news.of(report, names, model.as_deref());
        let violation = self.news.first_violation.as_ref();
        let low = self.sum.clearance.add(report, names, violation);
        match model {
            _ if self.json => {}
            Some(model) => {
                print_model(model, report, &news);
                if new_kind {
                    output::line(format_args!("  {}", LeftOut::sentence(left_out)));
                }
            }
            None if news.notable => print_frame(self.live.label, judged, &news),
            None => {}
        }
        if let Some(low) = low.filter(|_| !self.json) {
            match model {
                Some(_) => output::line(format_args!("  {low}")),
                None => self.live.label.line(low),
            }
            if report.abort && !news.notable {
                self.live.label.line(abort_words(judged));
            }
        }
        if model.is_none() {
            let links = self.session.baseline().map_or(0, |b| b.links().len());
            let closest = report.clearance.as_ref().and_then(|c| c.closest);
            let closest = closest.map_or_else(String::new, |c| {
                format!(
                    ", closest approach {}",
                    Notation::of_scene(report.stats.extent, c.points[0]).length(c.distance)
                )
            });
            let skipped = match self.tally.skipped {
                0 => String::new(),
                n => format!(", {} skipped", count(n)),
            };
            self.live.status(format_args!(
                "{} ({}): {} verified{skipped}, {}{closest}, verdict after {}",
                report.frame(),
                report.verdict,
                count(self.tally.verified),
                plural(links as u64, "link"),
                millis(judged.latency.unwrap_or(times.check())),
            ));
        }
    }
}

/// Prints the verdict on a frame of a stream, and its new findings.
fn print_frame(label: Label, judged: &Judged, news: &New) {
    let Judged { report, times, .. } = judged;
    label.line(format_args!(
        "{} (checked in {})",
        report.headline(),
        millis(times.check())
    ));
    label.first_lines("  ", &news.sentences, SENTENCES);
    if !news.sentences.is_empty()
        && let Some(words) = report.roll_back()
    {
        label.line(format_args!("  to roll back: {words}"));
    }
    if report.abort {
        label.line(abort_words(judged));
    }
}

/// Returns the line below a finding that asks the simulator to stop.
fn abort_words(judged: &Judged) -> &'static str {
    match judged.latency {
        Some(_) => "  abort sent: the simulator is asked to stop",
        None => "  abort: a watch asks the simulator to stop here",
    }
}

/// Prints the verdict on a model file, and its new findings.
fn print_model(model: &str, report: &Report, news: &New) {
    output::line(format_args!("{model}: {}", report.verdict));
    let others = report.missing.iter().chain(&report.rejected);
    for sentence in news.sentences.iter().take(MODEL_SENTENCES).chain(others) {
        output::line(format_args!("  {sentence}"));
    }
    if let Some(more @ 1..) = news.sentences.len().checked_sub(MODEL_SENTENCES) {
        output::line(format_args!("  and {more} more (--json prints all)"));
    }
    if let Some(words) = report.change_of_curves() {
        output::line(format_args!("  {words}"));
    }
    if news.known > 0 {
        let known = plural(news.known as u64, "finding");
        output::line(format_args!("  {known} as in the previous model"));
    }
    if report.stats.unchecked > 0 {
        let unchecked = plural(report.stats.unchecked, "pair");
        output::line(format_args!("  {unchecked} not checked"));
    }
}
