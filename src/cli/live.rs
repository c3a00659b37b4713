//! Status line on a terminal while frames arrive.

use super::label::Label;
use super::output;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fmt::Display;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Minimum time between two updates of the status line.
const EVERY: Duration = Duration::from_millis(100);

/// Status of each run, by its label. The status line shows all of them.
static STATUS: Mutex<BTreeMap<String, String>> = Mutex::new(BTreeMap::new());

/// A status line on a terminal, with results above it. Without a terminal, results only.
#[derive(Clone)]
pub struct Live {
    label: Label,
    changed: Cell<Option<Instant>>,
}

impl Live {
    /// Creates it without a status line.
    pub fn new() -> Live {
        Live {
            label: Label::default(),
            changed: Cell::new(None),
        }
    }

    /// Marks the status with a label.
    #[cfg(feature = "bus")]
    pub fn labelled(mut self, label: Label) -> Live {
        self.label = label;
        self
    }

    /// Replaces the status line, unless it was replaced less than [`EVERY`] ago.
    pub fn status(&self, text: impl Display) {
        if output::console_on_stderr() && self.changed.get().is_none_or(|at| at.elapsed() >= EVERY)
        {
            self.changed.set(Some(Instant::now()));
            self.show(Some(text.to_string()));
        }
    }

    /// Writes a line to stderr, above the status line.
    pub fn note(&self, text: impl Display) {
        tracing::info!("{text}");
    }

    /// Removes the status.
    pub fn clear(&self) {
        self.show(None);
    }

    /// Replaces or removes the status of this run.
    fn show(&self, text: Option<String>) {
        let mut all = STATUS.lock().unwrap_or_else(PoisonError::into_inner);
        let label = self.label.to_string();
        match text {
            Some(text) => all.insert(label, text),
            None => all.remove(&label),
        };
        // Several runs share the width of the terminal, so their details in brackets are omitted.
        let several = all.len() > 1;
        let part = |(label, text): (&String, &String)| match text.split_once(" (") {
            Some((head, _)) if several => format!("{label}{head}"),
            _ => format!("{label}{text}"),
        };
        let parts: Vec<String> = all.iter().map(part).collect();
        output::status(parts.join(" | "));
    }
}
