//! The report as plain text and as JSON.

use super::facts::End;
use super::{RunReport, words_of_curves};
use crate::curve::{Image, is_home};
use crate::words::count;
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
        let pairs = &facts.violations.pairs;
        let strands = |[i, j]: [u32; 2], image: Image, names: &Option<[String; 2]>| {
            let noun = match i != j && is_home(&image) {
                true => "curves",
                false => "curve",
            };
            format!("{noun} {}", words_of_curves([i, j], image, names))
        };
        let links = pairs.iter().filter_map(|pair| {
            let link = pair.link.as_ref()?;
            let place = match (&link.words, link.segments) {
                (Some([place, distance]), Some([s, t])) => {
                    format!(", near {place}, segments {s} and {t}, {distance} apart")
                }
                _ => String::new(),
            };
            let lasted = match link.frames {
                1 => "1 frame".to_owned(),
                n => format!("{} frames, to {}", count(n), link.last.frame),
            };
            Some(format!(
                "{}: {}: link {}: expected {}, found {}{place}; {lasted}",
                link.first,
                strands(pair.curves, pair.image, &pair.names),
                link.kind.word(),
                link.expected,
                link.found,
            ))
        });
        list(f, "violated links", links.collect(), 0)?;
        let pulled = facts.pull_throughs.rows.iter().map(|row| {
            let unresolved = if row.unresolved { "unresolved: " } else { "" };
            let [s, t] = row.event.segments;
            format!(
                "{}: {unresolved}{} at {:.3} of the step ({:+}), at {}, segments {s} and {t}",
                row.moment,
                strands([row.event.i, row.event.j], row.event.image, &row.names),
                row.event.fraction,
                row.event.sign,
                row.place,
            )
        });
        list(
            f,
            "pull-throughs",
            pulled.collect(),
            facts.pull_throughs.more(),
        )?;
        let defects = pairs.iter().filter_map(|pair| {
            let defect = pair.defect.as_ref()?;
            Some(format!("{}: {}", defect.first, defect.sentence))
        });
        list(f, "pairs that could not be decided", defects.collect(), 0)?;
        let remarks = facts.remarks.rows.iter();
        let remarks = remarks.map(|r| format!("{} ({}): {}", r.moment, r.verdict, r.reason));
        let more = facts.remarks.more();
        list(f, "rejected and incomplete frames", remarks.collect(), more)
    }
}

/// Writes a table, unless it is empty.
fn list(f: &mut fmt::Formatter<'_>, title: &str, rows: Vec<String>, more: u64) -> fmt::Result {
    if rows.is_empty() {
        return Ok(());
    }
    write!(f, "\n\n{title}")?;
    for row in rows.iter().take(ROWS) {
        write!(f, "\n  {row}")?;
    }
    match more + rows.len().saturating_sub(ROWS) as u64 {
        0 => Ok(()),
        more => write!(f, "\n  and {} more", count(more)),
    }
}

impl RunReport {
    /// Returns the facts as JSON: those of the HTML page, but for the pictures.
    pub fn json(&self) -> serde_json::Value {
        let facts = &self.facts;
        let [intact, changed, contact, undecided, stale, rejected] = facts.verdicts;
        let (cut, damaged) = match &facts.end {
            End::Finished => (None, None),
            End::Cut(at, what) => (Some(serde_json::json!({ "byte": at, "in": what })), None),
            End::Damaged(why) => (None, Some(why)),
        };
        let found = |found: &super::facts::Found| {
            serde_json::json!({
                "frame": found.moment.frame,
                "time": found.moment.time,
                "verdict": found.verdict,
                "finding": found.what,
                "place": found.place,
            })
        };
        serde_json::json!({
            "recording": self.recording.to_string_lossy(),
            "conclusion": facts.conclusion(),
            "sentence": facts.sentence(),
            "notes": facts.notes(),
            "metadata": facts.metadata,
            "baseline": facts.baseline,
            "frames": facts.counts,
            "verdicts": {
                "intact": intact, "changed": changed, "contact": contact,
                "undecided": undecided, "stale": stale, "rejected": rejected,
            },
            "first": facts.span.map(|[first, _]| first),
            "last": facts.span.map(|[_, last]| last),
            "first_changed": facts.changed.as_ref().map(found),
            "first_violation": facts.unsettled.as_ref().map(found),
            "scene": {
                "curves": facts.stats.curves,
                "open_curves": facts.stats.open_curves,
                "segments": facts.stats.segments,
                "extent": facts.stats.extent,
            },
            "pairs": facts.violations.pairs,
            "more_pairs": facts.violations.more,
            "pull_throughs": facts.pull_throughs,
            "remarks": facts.remarks,
            "lowest_clearance": facts.closest,
            "cut": cut,
            "damaged": damaged,
            "series": { "frames_per_bin": facts.series.width, "bins": facts.series.bins },
        })
    }
}
