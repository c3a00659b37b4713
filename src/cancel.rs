//! Reasons to end a check early: a request of another thread, and more pairs than the limit.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// A flag that long loops check with a relaxed load, once every few thousand tests. Once set, it
/// stays set.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Requests cancellation.
    pub fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Returns true if cancellation was requested.
    #[inline(always)]
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Maximum number of pairs of curves that a search may find in a frame, and whether one found more.
/// Its result is empty then, so a report must not depend on it.
#[derive(Clone, Debug)]
pub(crate) struct PairLimit(Arc<Limit>);

#[derive(Debug)]
struct Limit {
    most: AtomicUsize,
    exceeded: AtomicBool,
}

impl Default for PairLimit {
    /// Any number of pairs.
    fn default() -> Self {
        PairLimit(Arc::new(Limit {
            most: AtomicUsize::new(usize::MAX),
            exceeded: AtomicBool::new(false),
        }))
    }
}

impl PairLimit {
    /// Begins a frame, with this limit.
    pub fn begin(&self, most: usize) {
        self.0.most.store(most, Ordering::Relaxed);
        self.0.exceeded.store(false, Ordering::Relaxed);
    }

    pub fn most(&self) -> usize {
        self.0.most.load(Ordering::Relaxed)
    }

    /// Records that a search found more.
    pub fn exceed(&self) {
        self.0.exceeded.store(true, Ordering::Relaxed);
    }

    /// Returns true if a search of this frame found more.
    pub fn is_exceeded(&self) -> bool {
        self.0.exceeded.load(Ordering::Relaxed)
    }
}
