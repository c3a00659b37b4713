//! Rows of the tables of a report.

use crate::verdict::{PullThrough, Report, Verdict, words_of_frame};
use std::fmt;

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
    #[serde(skip)]
    limit: usize,
}

impl<T> Default for Rows<T> {
    fn default() -> Self {
        Rows::new(0)
    }
}

impl<T> Rows<T> {
    pub fn new(limit: usize) -> Rows<T> {
        Rows {
            rows: Vec::new(),
            total: 0,
            limit,
        }
    }

    /// Counts a row, and keeps it if it is one of the first.
    pub fn push(&mut self, row: impl FnOnce() -> T) {
        self.total += 1;
        if self.rows.len() < self.limit {
            self.rows.push(row());
        }
    }

    /// Returns the number of rows that were counted, but not kept.
    pub fn more(&self) -> u64 {
        self.total - self.rows.len() as u64
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
    /// The place in words.
    #[serde(skip)]
    pub place: String,
}

/// A rejected or incomplete frame.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct Remark {
    #[serde(flatten)]
    pub moment: Moment,
    pub verdict: Verdict,
    pub reason: String,
}

/// Returns the names of two curves, if they have some.
pub(super) fn names_of(curves: [u32; 2], names: &[String]) -> Option<[String; 2]> {
    let [a, b] = curves.map(|curve| names.get(curve as usize).cloned());
    Some([a?, b?])
}
