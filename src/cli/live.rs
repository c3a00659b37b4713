//! Status line on a terminal while frames arrive, and the label of the results of a session, if a
//! watch has several in succession.

use super::{output, stream};
use serde_json::Value;
use std::cell::Cell;
use std::fmt;
use std::time::{Duration, Instant};

/// Session that results belong to. The first one is 1. Empty if the command has only one run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Label(pub Option<u64>);

impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            None => Ok(()),
            Some(session) => write!(f, "session {session}: "),
        }
    }
}

impl Label {
    /// Writes a line, or several, to stdout, each with this label.
    pub fn line(self, text: impl fmt::Display) {
        let text = text.to_string();
        let lines: Vec<String> = text.lines().map(|line| format!("{self}{line}")).collect();
        output::line(lines.join("\n"));
    }

    /// Writes an object as one line of JSON to stdout, with this label.
    pub fn json(self, mut object: Value) {
        if let Some(session) = self.0 {
            object["session"] = session.into();
        }
        output::json(&object);
    }
}

/// Minimum time between two updates of the status line.
const EVERY: Duration = Duration::from_secs(1);

/// A status line on a terminal, with results above it. Without a terminal, results only.
#[derive(Clone, Default)]
pub struct Live {
    pub label: Label,
    changed: Cell<Option<Instant>>,
}

impl Live {
    /// Replaces the status line, unless it was replaced less than [`EVERY`] ago.
    pub fn status(&self, text: impl fmt::Display) {
        if stream::is_terminal() && self.changed.get().is_none_or(|at| at.elapsed() >= EVERY) {
            self.changed.set(Some(Instant::now()));
            stream::status(format!("{}{text}", self.label));
        }
    }

    /// Removes the status.
    pub fn clear(&self) {
        stream::status(String::new());
    }
}
