//! What a terminal shows while frames come in.

use super::output::{console_on_stderr, line};
use indicatif::ProgressBar;
use std::time::Duration;

/// A status line on a terminal, with results above it. Without a terminal, results only.
#[derive(Clone)]
pub struct Live(Option<ProgressBar>);

impl Live {
    /// Starts an empty status line.
    pub fn new() -> Live {
        Live(console_on_stderr().then(|| {
            let bar = ProgressBar::new_spinner();
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        }))
    }

    /// Replaces the status line.
    pub fn status(&self, text: impl std::fmt::Display) {
        if let Some(bar) = &self.0 {
            bar.set_message(text.to_string());
        }
    }

    /// Writes a line to stdout, above the status line.
    pub fn result(&self, text: &str) -> linkwatch::Result<()> {
        match &self.0 {
            Some(bar) => bar.suspend(|| line(text)),
            None => line(text),
        }
    }

    /// Writes a line to stderr, above the status line.
    pub fn note(&self, text: impl std::fmt::Display) {
        match &self.0 {
            Some(bar) => bar.suspend(|| tracing::info!("{text}")),
            None => tracing::info!("{text}"),
        }
    }

    /// Removes the status line.
    pub fn clear(&self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}
