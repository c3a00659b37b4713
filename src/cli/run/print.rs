//! Prints the results of the frames of a run.

use super::news::New;
use super::times::to_json;
use super::{Judged, Run, THE_FRAMES};
use crate::cli::output::{self, count, listed, millis, milliseconds, plural};
use crate::curve::Notation;
use linkwatch::{LeftOut, Report};

/// Maximum number of sentences printed about one frame of a stream; the others are only counted.
const SENTENCES: usize = 8;

/// Maximum number of sentences printed about a model file.
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
        if let (Some(curves), args) = (&judged.curves, self.cell_args) {
            args.warn_of_segments(name, curves, judged.info.cell);
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
        if self.setup.json {
            let measured = judged.curves.is_some() && self.options.clearance.is_some();
            let mut line = serde_json::json!({
                "report": **report,
                "ms": milliseconds(times.check()),
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
            self.live.json(line);
        }
        if let Some(junit) = &mut self.junit {
            junit.add(report, names, model.as_deref(), times.check());
        }
        self.sum.unresolved.add(report);
        let news = self.news.of(report, names, model.as_deref());
        let violated = self.news.first_violation.is_some();
        let low = self.sum.clearance.add(report, names, violated);
        let mut lines = match model {
            Some(model) => lines_of_model(model, report, &news),
            None if news.notable => lines_of_frame(judged, &news),
            None => Vec::new(),
        };
        if new_kind && model.is_some() {
            lines.push(format!("  {}", LeftOut::sentence(left_out)));
        }
        if let Some(low) = low {
            let indent = if model.is_some() { "  " } else { "" };
            lines.push(format!("{indent}{low}"));
            if report.abort && !news.notable {
                lines.push(abort_words(judged).into());
            }
        }
        if !(self.setup.json || lines.is_empty()) {
            self.live.line(lines.join("\n"));
        }
        if model.is_none() {
            let closest = report.clearance.as_ref().and_then(|c| c.closest);
            let closest = closest.map_or_else(String::new, |c| {
                let notation = Notation::of_scene(report.stats.extent, c.points[0]);
                format!(", closest approach {}", notation.length(c.distance))
            });
            let links = self.session.baseline().map_or(0, |b| b.links().len());
            self.live.status(format_args!(
                "{} ({}): {} verified, {} skipped, {}{closest}, verdict after {}",
                report.frame(),
                report.verdict,
                count(self.tally.verified),
                count(self.tally.skipped),
                plural(links as u64, "link"),
                millis(judged.latency.unwrap_or(times.check())),
            ));
        }
    }
}

/// Returns the verdict on a frame of a stream, and its new findings.
fn lines_of_frame(judged: &Judged, news: &New) -> Vec<String> {
    let Judged { report, times, .. } = judged;
    let (headline, check) = (report.headline(), millis(times.check()));
    let mut lines = vec![format!("{headline} (checked in {check})")];
    lines.extend(listed("  ", &news.sentences, SENTENCES));
    if !news.sentences.is_empty() {
        let words = report.roll_back();
        lines.extend(words.map(|words| format!("  to roll back: {words}")));
    }
    if report.abort {
        lines.push(abort_words(judged).into());
    }
    lines
}

/// Returns the line below a finding that asks the simulator to stop.
fn abort_words(judged: &Judged) -> &'static str {
    match judged.latency {
        Some(_) => "  abort sent: the simulator is asked to stop",
        None => "  abort: `linkwatch watch` would ask the simulator to stop here",
    }
}

/// Returns the verdict on a model file, and its new findings.
fn lines_of_model(model: &str, report: &Report, news: &New) -> Vec<String> {
    let mut lines = vec![format!("{model}: {}", report.verdict)];
    lines.extend(listed("  ", &news.sentences, MODEL_SENTENCES));
    let others = report.missing.iter().chain(&report.rejected).cloned();
    let others = others.chain(report.change_of_curves());
    lines.extend(others.map(|sentence| format!("  {sentence}")));
    if news.known > 0 {
        let known = plural(news.known, "finding");
        lines.push(format!("  {known} as in the previous model"));
    }
    if report.stats.unchecked > 0 {
        let unchecked = plural(report.stats.unchecked, "pair");
        lines.push(format!("  {unchecked} not checked"));
    }
    lines
}
