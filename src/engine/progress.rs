//! Progress of a run, and the times of its stages.

use crate::cancel::{Cancel, PairLimit};
use crate::error::{Error, Result};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Progress of a long run, and a way to cancel it. Shared with other threads, which may show it.
#[derive(Debug, Default)]
pub struct Progress {
    pub(super) done: AtomicU64,
    pub(super) total: AtomicU64,
    pub(super) cancel: Cancel,
    pub(super) limit: PairLimit,
}

impl Progress {
    /// Returns the number of pairs computed so far, and of all pairs, of the current frame.
    pub fn pairs(&self) -> (u64, u64) {
        let count = |n: &AtomicU64| n.load(Ordering::Relaxed);
        (count(&self.done), count(&self.total))
    }

    /// Ends the current step as soon as possible, usually within a tenth of a second. The step
    /// fails with [`Error::Cancelled`], and so does every later step of the session. Certificates
    /// ([`Certifier::certify`](crate::Certifier::certify)) are computed to their end.
    ///
    /// Sums and GPU work are not interrupted; the step ends after them.
    pub fn cancel(&self) {
        self.cancel.set();
    }

    /// Returns true if [`Progress::cancel`] was called.
    pub fn is_cancelled(&self) -> bool {
        self.cancel.is_set()
    }

    /// Returns an error if the results of this frame are incomplete.
    pub(super) fn check(&self) -> Result<()> {
        if self.is_cancelled() {
            return Err(Error::Cancelled);
        }
        if self.limit.is_exceeded() {
            let limit = self.limit.most() as u64;
            return Err(Error::TooManyPairs { limit });
        }
        Ok(())
    }
}

/// Time that each stage of the last frame took. Not part of a [`Report`](crate::Report), because
/// reports do not depend on the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Timings {
    /// Time of the boxes of all segments, and of the trees over them.
    pub boxes: Duration,
    /// Time of the search for potential links.
    pub pairs: Duration,
    /// Time of the discretization and the linking numbers of all potential links.
    pub links: Duration,
    /// Time of the search for pull-throughs.
    pub events: Duration,
    /// Time of the clearance.
    pub clearance: Duration,
    /// Total time, comparison included.
    pub total: Duration,
}
