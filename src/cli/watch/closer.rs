//! Closes sessions, whose sinks may be slow, while the next simulator is watched.

use crate::cli::Outcome;
use crate::cli::run::{PATIENCE, Run};
use linkwatch::Result;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval at which a session that closes is looked at.
const POLL: Duration = Duration::from_millis(2);

/// Closes sessions, each in a separate thread, and keeps the worst outcome.
pub struct Closer {
    /// Worst outcome of the processes before this one.
    pub earlier: Outcome,
    worst: Outcome,
    /// Sessions that may not have closed. Each one ends within the time limit of the sinks.
    pending: Vec<JoinHandle<Outcome>>,
}

impl Closer {
    /// Begins with the worst outcome of the processes before this one.
    pub fn new(earlier: Outcome) -> Closer {
        Closer {
            earlier,
            worst: earlier,
            pending: Vec::new(),
        }
    }

    /// Adds an outcome.
    pub fn add(&mut self, outcome: Outcome) {
        self.worst = self.worst.max(outcome);
    }

    /// Closes a session. Returns after half a second at most: slow sinks finish later.
    pub fn close(&mut self, session: Box<Run>) -> Result<()> {
        let thread = std::thread::Builder::new().name("linkwatch-close".into());
        let thread = thread.spawn(move || session.finish())?;
        let start = Instant::now();
        while !thread.is_finished() && start.elapsed() < PATIENCE {
            std::thread::sleep(POLL);
        }
        self.pending.push(thread);
        let closed = self.pending.extract_if(.., |thread| thread.is_finished());
        self.worst = closed.fold(self.worst, with_outcome);
        Ok(())
    }

    /// Waits for all sessions. Returns the worst outcome.
    pub fn finish(self) -> Outcome {
        self.pending.into_iter().fold(self.worst, with_outcome)
    }
}

/// Waits for a session. Returns the worse of `outcome` and the outcome of the session.
fn with_outcome(worst: Outcome, session: JoinHandle<Outcome>) -> Outcome {
    // If the thread panicked, the panic was printed.
    worst.max(session.join().unwrap_or(Outcome::Undecided))
}
