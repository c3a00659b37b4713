//! The report as plain text and as JSON.

use super::RunReport;
use super::facts::End;
use crate::verdict::Verdict;
use crate::words::count;
use serde_json::{Map, Value, json};
use std::fmt;

/// Maximum number of rows of each table of the text; the rest is counted.
const ROWS: usize = 30;

impl fmt::Display for RunReport {
    /// Writes the report as plain text: the sentence, notes, facts and tables.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let facts = &self.facts;
        f.write_str(&facts.sentence())?;
        for note in facts.notes() {
            write!(f, "\n  {note}")?;
        }
        let run = facts.run(&self.recording);
        let width = run.iter().map(|(name, _)| name.chars().count()).max();
        f.write_str("\n\nrun")?;
        for (name, value) in &run {
            write!(f, "\n  {name:width$}  {value}", width = width.unwrap_or(0))?;
        }
        for table in facts.tables() {
            write!(f, "\n\n{}", table.title.to_lowercase())?;
            for [frame, finding, lasted] in table.rows.iter().take(ROWS) {
                let separator = if lasted.is_empty() { "" } else { "; " };
                write!(f, "\n  {frame}: {finding}{separator}{lasted}")?;
            }
            if let more @ 1.. = table.rows.len().saturating_sub(ROWS) {
                write!(f, "\n  and {} more", count(more))?;
            }
            if let Some(more) = &table.more {
                write!(f, "\n  {more}")?;
            }
        }
        Ok(())
    }
}

impl RunReport {
    /// Returns the facts as JSON: those of the HTML page, but for the pictures.
    pub fn json(&self) -> Value {
        let facts = &self.facts;
        let verdicts = Verdict::ALL.map(|v| (v.word().to_owned(), facts.of(v).into()));
        let (cut, damaged) = match &facts.end {
            End::Finished => (None, None),
            End::Cut(at, what) => (Some(json!({ "byte": at, "in": what })), None),
            End::Damaged(why) => (None, Some(why)),
        };
        let (stats, series) = (&facts.stats, &facts.series);
        json!({
            "recording": self.recording.to_string_lossy(),
            "conclusion": facts.conclusion(),
            "sentence": facts.sentence(),
            "notes": facts.notes(),
            "metadata": facts.metadata,
            "baseline": facts.baseline,
            "frames": facts.counts,
            "left_out": facts.left_out,
            "verdicts": Map::from_iter(verdicts),
            "first": facts.span.map(|[first, _]| first),
            "last": facts.span.map(|[_, last]| last),
            "first_changed": facts.verdicts.changed,
            "first_violation": facts.lasting.unsettled,
            "scene": {
                "curves": stats.curves,
                "open_curves": stats.open_curves,
                "segments": stats.segments,
                "extent": stats.extent,
            },
            "pairs": facts.violations.pairs,
            "more_pairs": facts.violations.more,
            "pull_throughs": facts.pull_throughs,
            "remarks": facts.remarks,
            "lowest_clearance": facts.closest,
            "cut": cut,
            "damaged": damaged,
            "series": { "frames_per_bin": series.width(), "bins": series.bins },
        })
    }
}
