//! Closes sessions, whose sinks may be slow, while the next simulator is watched.

use super::PATIENCE;
use crate::cli::Outcome;
use crate::cli::run::{FrameCounts, Run};
use linkwatch::Result;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::Duration;

/// Closes sessions, each in a thread of its own, and keeps the worst outcome.
pub struct Closer {
    worst: Outcome,
    /// Sessions whose sinks have not finished. Each one ends within the time limit of the sinks.
    pending: Vec<Receiver<Outcome>>,
}

impl Closer {
    /// Begins with the worst outcome of earlier sessions.
    pub fn new(worst: Outcome) -> Closer {
        Closer {
            worst,
            pending: Vec::new(),
        }
    }

    /// Adds an outcome.
    pub fn add(&mut self, outcome: Outcome) {
        self.worst = self.worst.max(outcome);
    }

    /// Closes a session. Returns after half a second at most: slow sinks finish later.
    pub fn close(&mut self, session: Box<Run>, tally: FrameCounts) -> Result<()> {
        let (to, from) = mpsc::channel();
        let finish = move || {
            // The receiver has ended if the watch has failed.
            let _ = to.send(session.finish(tally));
        };
        let thread = std::thread::Builder::new().name("linkwatch-close".into());
        thread.spawn(finish)?;
        self.pending.push(from);
        self.collect(PATIENCE);
        Ok(())
    }

    /// Waits for all sessions. Returns the worst outcome.
    pub fn finish(mut self) -> Outcome {
        while !self.pending.is_empty() {
            self.collect(Duration::MAX);
        }
        self.worst
    }

    /// Takes the outcomes of the sessions that have closed. Waits for the newest one, at most for
    /// `limit`.
    fn collect(&mut self, limit: Duration) {
        let newest = self.pending.len().saturating_sub(1);
        let mut open = Vec::new();
        for (k, session) in std::mem::take(&mut self.pending).into_iter().enumerate() {
            let wait = if k == newest { limit } else { Duration::ZERO };
            match session.recv_timeout(wait) {
                Ok(outcome) => self.add(outcome),
                // The thread panicked, and the panic was printed.
                Err(RecvTimeoutError::Disconnected) => self.add(Outcome::Undecided),
                Err(RecvTimeoutError::Timeout) => open.push(session),
            }
        }
        self.pending = open;
    }
}
