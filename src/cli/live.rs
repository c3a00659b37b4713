//! Status line on a terminal while frames arrive, and the label of the results of a session, if a
//! watch has several in succession.

use super::{output, stream};
use serde_json::Value;
use std::cell::Cell;
use std::fmt;
use std::time::{Duration, Instant};

/// Minimum time between two updates of the status line.
const EVERY: Duration = Duration::from_secs(1);

/// A status line on a terminal, with results above it. Without a terminal, results only.
#[derive(Clone, Default)]
pub struct Live {
    /// Session that results belong to. The first one is 1. `None` if the command has only one run.
    pub session: Option<u64>,
    changed: Cell<Option<Instant>>,
}

impl Live {
    /// Returns the label of all results.
    fn label(&self) -> String {
        let label = |session| format!("session {session}: ");
        self.session.map_or_else(String::new, label)
    }

    /// Writes a line, or several, to stdout, each with the label of the session.
    pub fn line(&self, text: impl fmt::Display) {
        let (label, text) = (self.label(), text.to_string());
        let lines: Vec<String> = text.lines().map(|line| format!("{label}{line}")).collect();
        output::line(lines.join("\n"));
    }

    /// Writes an object as one line of JSON to stdout, with the number of the session.
    pub fn json(&self, mut object: Value) {
        if let Some(session) = self.session {
            object["session"] = session.into();
        }
        output::json(&object);
    }

    /// Replaces the status line, unless it was replaced less than [`EVERY`] ago.
    pub fn status(&self, text: impl fmt::Display) {
        if stream::is_terminal() && self.changed.get().is_none_or(|at| at.elapsed() >= EVERY) {
            self.changed.set(Some(Instant::now()));
            stream::status(format!("{}{text}", self.label()));
        }
    }

    /// Removes the status.
    pub fn clear(&self) {
        stream::status(String::new());
    }
}
