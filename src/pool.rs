//! Division of work among the threads of the pool.
//!
//! Passing work from another thread to the pool and back takes 10 to 90 microseconds, because the
//! operating system has to wake a thread twice. A frame with few segments is verified in less time,
//! so the calling thread computes it alone.

use crate::error::{Error, Result};
use std::process;
use std::sync::atomic::{AtomicU32, Ordering};

/// Number of segments up to which the calling thread computes a frame alone.
const SMALL: usize = 2048;

/// Runs a function that works on the curves of a frame with `segments` segments. If they are many,
/// it runs in the pool, so that its parallel parts do not each pass to another thread and back.
pub(crate) fn run<R: Send>(segments: usize, work: impl FnOnce() -> R + Send) -> R {
    if segments <= SMALL {
        work()
    } else {
        rayon::scope(|_| work())
    }
}

/// Returns the number of pairs of one task, for a frame with `segments` segments: few enough to
/// balance the load, and enough to pay for the task. A single pair may be a whole model; it is
/// divided further.
pub(crate) fn pairs_per_task(pairs: usize, segments: usize) -> usize {
    if segments <= SMALL {
        pairs.max(1)
    } else {
        (pairs / (32 * rayon::current_num_threads())).clamp(1, 256)
    }
}

/// Returns an error if another process, from which this one was forked, has used the thread pool.
/// Otherwise records that this process uses it.
///
/// A fork copies only the thread that called it. The pool of the child has no threads, so parallel
/// work would wait for ever.
pub(crate) fn check_process() -> Result<()> {
    static USED_BY: AtomicU32 = AtomicU32::new(0);
    let this = process::id();
    match USED_BY.compare_exchange(0, this, Ordering::Relaxed, Ordering::Relaxed) {
        Err(parent) if parent != this => Err(Error::Forked { parent }),
        _ => Ok(()),
    }
}
