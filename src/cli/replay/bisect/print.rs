//! Result of `replay --bisect`, in words and as JSON.

use super::Step;
use crate::cli::Outcome;
use crate::cli::output::{self, count, millis, plural};
use linkwatch::{Report, Verdict};
use std::path::Path;
use std::time::Duration;

/// Maximum number of findings, and of pull-throughs, that are printed.
const FINDINGS: usize = 8;

/// What the search found.
pub struct Found {
    /// Frames of the file within the range.
    pub frames: usize,
    /// Frames that were verified.
    pub verified: usize,
    /// The first changed frame.
    pub changed: Option<Report>,
    /// The frame before it, or the last frame.
    pub before: Option<Report>,
    /// Names of the curves.
    pub names: Vec<String>,
    /// Comparison with the recorded verdicts, if there are any.
    pub recorded: Option<Recorded>,
    pub step: Option<Step>,
}

/// Comparison of the result with the recorded verdicts.
#[derive(serde::Serialize)]
pub struct Recorded {
    /// True if both call the same frame the first changed one, or none.
    pub agrees: bool,
    pub words: String,
}

impl Found {
    pub fn outcome(&self) -> Outcome {
        let agrees = self
            .recorded
            .as_ref()
            .is_none_or(|recorded| recorded.agrees);
        match (&self.changed, &self.before) {
            (Some(_), _) => Outcome::Changed,
            (None, Some(last)) if agrees => Outcome::of(last.verdict),
            (None, _) => Outcome::Undecided,
        }
    }

    pub fn print(&self, path: &Path, took: Duration, json: bool) {
        if json {
            return output::json(&self.to_json(path, took));
        }
        match &self.changed {
            Some(changed) => {
                output::line(format_args!("first changed frame: {}", changed.headline()));
                self.print_findings(changed);
                if let Some(before) = &self.before {
                    output::line(format_args!("the frame before it: {}", before.headline()));
                }
            }
            None => output::line("no changed frame found"),
        }
        if let Some(step) = &self.step {
            step.print(&self.names);
        }
        output::line(self.proof());
        if let Some(recorded) = &self.recorded {
            output::line(&recorded.words);
        }
        output::line(format_args!(
            "verified {} of {} in {}",
            count(self.verified as u64),
            plural(self.frames as u64, "frame"),
            millis(took)
        ));
    }

    /// Prints the findings of the changed frame. Pull-throughs are printed with their causes.
    fn print_findings(&self, changed: &Report) {
        let mut findings = changed.clone();
        if self.step.is_some() {
            findings.events.clear();
        }
        let all: Vec<String> = findings.findings_named(&self.names).collect();
        output::first_lines("  ", &all, FINDINGS);
    }

    /// Returns a sentence about what is proven, and what is assumed.
    fn proof(&self) -> String {
        let seq = |report: &Option<Report>| report.as_ref().map(|r| r.seq);
        match (seq(&self.changed), seq(&self.before), &self.before) {
            (Some(changed), Some(before), Some(report)) => {
                let state = match report.verdict {
                    Verdict::Intact => "intact".to_owned(),
                    other => format!("not known to be intact ({other})"),
                };
                format!(
                    "proven: frame {changed} is changed, and frame {before} is {state}; frame \
                     {changed} is the first one if no earlier change reverted"
                )
            }
            (Some(changed), ..) => {
                format!("proven: frame {changed}, the first one, is changed")
            }
            (None, last, _) => format!(
                "proven: the last frame, {}, is not changed; an earlier change may have reverted",
                last.unwrap_or_default()
            ),
        }
    }

    fn to_json(&self, path: &Path, took: Duration) -> serde_json::Value {
        serde_json::json!({
            "bisect": {
                "file": path,
                "frames": self.frames,
                "verified": self.verified,
                "changed": self.changed,
                "before": self.before,
                "proof": self.proof(),
                "recorded_verdicts": self.recorded,
                "step": self.step.as_ref().map(Step::to_json),
                "ms": took.as_secs_f64() * 1e3,
            }
        })
    }
}

impl Step {
    fn print(&self, names: &[String]) {
        let [from, to] = self.frames;
        if self.cut {
            return output::line(format_args!(
                "frame {to} does not continue frame {from}: the simulator rolled back or jumped, \
                 so nothing is known about the step"
            ));
        }
        let events = &self.report.events;
        if events.is_empty() {
            return output::line(format_args!(
                "no pull-through was found in the step from frame {from} to {to}"
            ));
        }
        output::line(format_args!(
            "{} in the step from frame {from} to {to}:",
            plural(events.len() as u64, "pull-through")
        ));
        let extent = self.report.stats.extent;
        for (event, cause) in events.iter().zip(&self.causes).take(FINDINGS) {
            output::line(format_args!("  {}", event.sentence_named(extent, names)));
            output::line(format_args!("    {}", cause.motion(self.frames)));
        }
        if events.len() > FINDINGS {
            let more = count((events.len() - FINDINGS) as u64);
            output::line(format_args!("  and {more} more"));
        }
        if let Some(first) = self.causes.first() {
            output::line(first.advice(from, self.report.safe_fraction));
        }
    }

    fn to_json(&self) -> serde_json::Value {
        serde_json::json!({
            "frames": self.frames,
            "cut": self.cut,
            "pull_throughs": self.report.events,
            "causes": self.causes,
            "safe_fraction": self.report.safe_fraction,
            "advice": self.causes.first().map(|first| {
                first.advice(self.frames[0], self.report.safe_fraction)
            }),
            "unresolved": self.report.unresolved,
        })
    }
}
