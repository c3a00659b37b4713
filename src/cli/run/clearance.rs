//! Clearance of the frames of a run: warnings, and a summary.

use linkwatch::{CloseStrands, Report};

use crate::cli::output::{percent, plural};

/// Clearance of all frames so far.
#[derive(Default)]
pub struct ClearanceLog {
    /// Number of frames that were measured.
    measured: u64,
    /// Number of frames with a low clearance; and the first of them: its number among the measured
    /// frames, its sequence number, and a text about it.
    low: u64,
    first_low: Option<(u64, u64, String)>,
    /// The closest strands of all frames, and their frame.
    lowest: Option<(u64, String, CloseStrands)>,
    /// Clearance of the last warning, while it stays low.
    warned: Option<f64>,
    /// Number of frames that were measured before the first violation.
    before_violation: Option<u64>,
}

impl ClearanceLog {
    /// Adds a frame. Returns a warning if its clearance is low, unless the last warning was about
    /// nearly the same clearance. `violated` is true if a violation was found before.
    pub fn add(&mut self, report: &Report, names: &[String], violated: bool) -> Option<String> {
        let clearance = report.clearance.as_ref()?;
        self.measured += 1;
        if violated {
            self.before_violation.get_or_insert(self.measured);
        }
        let lowest = self.lowest.as_ref().map(|(.., lowest)| lowest.ratio);
        let is_lower = |c: &CloseStrands| lowest.is_none_or(|lowest| c.ratio < lowest);
        if let Some(closest) = clearance.closest.filter(is_lower) {
            self.lowest = Some((report.seq, report.frame(), closest));
        }
        let Some(closest) = clearance.closest.filter(|_| clearance.low) else {
            self.warned = None;
            return None;
        };
        self.low += 1;
        let first = || (self.measured, report.seq, report.frame());
        self.first_low.get_or_insert_with(first);
        // Warns again only at half the clearance of the last warning.
        let is_known = |warned: f64| closest.ratio > 0.5 * warned;
        if self.warned.is_some_and(is_known) {
            return None;
        }
        self.warned = Some(closest.ratio);
        let sentence = clearance.sentence_named(report.stats.extent, names)?;
        Some(format!("{}: low clearance: {sentence}", report.frame()))
    }

    /// Returns the number of measured frames between the first low clearance and the first
    /// violation; 0 if the clearance was low later.
    fn lead(&self) -> Option<u64> {
        let (first, ..) = self.first_low.as_ref()?;
        Some(self.before_violation?.saturating_sub(*first))
    }

    /// Returns the summary as text, if a frame was measured. `low` is the clearance below which
    /// warnings are given.
    pub fn words(&self, low: f64) -> Option<String> {
        if self.measured == 0 {
            return None;
        }
        let Some((_, frame, closest)) = &self.lowest else {
            return Some("clearance: no strands are close".into());
        };
        let lowest = percent(closest.ratio);
        let mut text = format!("clearance: at least {lowest} of the diameter, in {frame}");
        if let Some((_, _, first)) = &self.first_low {
            let (low, frames) = (percent(low), plural(self.low, "frame"));
            text += &format!("; below {low} in {frames}, first in {first}");
        }
        match (self.lead(), self.before_violation) {
            (Some(lead @ 1..), _) => {
                text += &format!(", {} before the first violation", plural(lead, "frame"));
            }
            (_, Some(_)) => text += ", not before the first violation",
            (_, None) => {}
        }
        Some(text)
    }

    /// Returns the summary as JSON, if a frame was measured.
    pub fn to_json(&self) -> Option<serde_json::Value> {
        (self.measured > 0).then(|| {
            serde_json::json!({
                "lowest": self.lowest.as_ref().map(|(.., closest)| closest),
                "lowest_frame": self.lowest.as_ref().map(|(seq, ..)| seq),
                "low_frames": self.low,
                "first_low_frame": self.first_low.as_ref().map(|(_, seq, _)| seq),
                "frames_before_violation": self.lead(),
            })
        })
    }
}
