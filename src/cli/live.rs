//! Status line on a terminal while frames arrive.

use super::label::Label;
use super::output;
use std::cell::Cell;
use std::fmt::Display;
use std::time::{Duration, Instant};

/// Minimum time between two updates of the status line.
const EVERY: Duration = Duration::from_millis(100);

/// A status line on a terminal, with results above it. Without a terminal, results only.
#[derive(Clone, Default)]
pub struct Live {
    pub label: Label,
    changed: Cell<Option<Instant>>,
}

impl Live {
    /// Replaces the status line, unless it was replaced less than [`EVERY`] ago.
    pub fn status(&self, text: impl Display) {
        if output::console_on_stderr() && self.changed.get().is_none_or(|at| at.elapsed() >= EVERY)
        {
            self.changed.set(Some(Instant::now()));
            output::status(format!("{}{text}", self.label));
        }
    }

    /// Removes the status.
    pub fn clear(&self) {
        output::status(String::new());
    }
}
