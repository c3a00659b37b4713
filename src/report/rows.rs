//! Tables of a report.

use super::facts::Facts;
use crate::verdict::{PullThrough, Report, Verdict, words_of_frame};
use crate::words::{count, if_any, plural};
use std::fmt;

/// Maximum number of rows of a table: the first ones.
pub(super) const MOST: usize = 400;

/// A frame, by its number and its simulation time in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub(super) struct Moment {
    pub frame: u64,
    pub time: f64,
}

impl Moment {
    pub fn of(report: &Report) -> Moment {
        Moment {
            frame: report.seq,
            time: report.time,
        }
    }
}

impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&words_of_frame(self.frame, self.time))
    }
}

/// The first rows of a table, and the number of all.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct Rows<T> {
    pub rows: Vec<T>,
    pub total: u64,
}

impl<T> Default for Rows<T> {
    fn default() -> Self {
        let (rows, total) = (Vec::new(), 0);
        Rows { rows, total }
    }
}

impl<T> Rows<T> {
    /// Counts a row, and keeps it if it is one of the first.
    pub fn push(&mut self, row: impl FnOnce() -> T) {
        self.total += 1;
        if self.rows.len() < MOST {
            self.rows.push(row());
        }
    }

    /// Returns a sentence about the rows that were counted, but not kept.
    fn more(&self) -> Option<String> {
        let n = self.total - self.rows.len() as u64;
        (n > 0).then(|| format!("{} more are not listed.", count(n)))
    }
}

/// A pull-through.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct PullThroughRow {
    #[serde(flatten)]
    pub moment: Moment,
    /// Names of both curves, if they have some.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub names: Option<[String; 2]>,
    #[serde(flatten)]
    pub event: PullThrough,
    /// True if it cannot be resolved, because the frames are too far apart.
    pub unresolved: bool,
    pub sentence: String,
}

/// A rejected or incomplete frame.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct Remark {
    #[serde(flatten)]
    pub moment: Moment,
    pub verdict: Verdict,
    pub reason: String,
}

/// A table, unless it is empty.
pub(super) struct Table {
    pub title: &'static str,
    /// The frame, the finding, and how long it lasted, if it did.
    pub rows: Vec<[String; 3]>,
    /// A sentence about rows that are not listed.
    pub more: Option<String>,
}

impl Facts {
    /// Returns the tables of all findings.
    pub fn tables(&self) -> impl Iterator<Item = Table> {
        let pairs = &self.violations.pairs;
        let lasted = |frames: u64, last: String| match frames {
            1 => "1 frame".to_owned(),
            n => format!("{} frames{last}", count(n)),
        };
        let links = pairs.iter().filter_map(|pair| {
            let link = pair.link.as_ref()?;
            let passages = plural(pair.pull_throughs, "pull-through");
            let passages = if_any(pair.pull_throughs, || format!("; {passages}"));
            let last = format!(", to {}", link.last.frame);
            let finding = format!("{}{passages}", link.sentence);
            Some([link.first.to_string(), finding, lasted(link.frames, last)])
        });
        let unlisted = format!("Only the first {} are listed.", plural(pairs.len(), "pair"));
        let passages = self.pull_throughs.rows.iter();
        let passages = passages.map(|p| [p.moment.to_string(), p.sentence.clone(), String::new()]);
        let defects = pairs.iter().filter_map(|pair| {
            let row = pair.defect.as_ref()?;
            let lasted = lasted(row.frames, String::new());
            Some([row.first.to_string(), row.sentence.clone(), lasted])
        });
        let remarks = self.remarks.rows.iter().map(|remark| {
            let reason = format!("{}: {}", remark.verdict, remark.reason);
            [remark.moment.to_string(), reason, String::new()]
        });
        let unlisted = self.violations.more.then_some(unlisted);
        let (unlisted_passages, unread) = (self.pull_throughs.more(), self.remarks.more());
        let table = |title, rows, more| Table { title, rows, more };
        let tables = [
            table("Violated links", links.collect(), unlisted),
            table("Pull-throughs", passages.collect(), unlisted_passages),
            table("Pairs that could not be decided", defects.collect(), None),
            table("Rejected and incomplete frames", remarks.collect(), unread),
        ];
        tables.into_iter().filter(|table| !table.rows.is_empty())
    }
}

/// Returns the names of two curves, if they have some.
pub(super) fn names_of(curves: [u32; 2], names: &[String]) -> Option<[String; 2]> {
    let [a, b] = curves.map(|curve| names.get(curve as usize).cloned());
    Some([a?, b?])
}
