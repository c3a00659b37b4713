//! Waiting for what must happen, on a machine of any load.
//!
//! No test asserts a speed. A wait ends when its condition holds; the limit only makes a test fail
//! that would otherwise hang.

use std::fmt::Display;
use std::time::{Duration, Instant};

/// Limit of everything that must happen. A passing test does not wait for it.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// A time-out of the code under test that must not be reached: what ends within [`PATIENCE`] has
/// ended for another reason.
pub const LONG: Duration = Duration::from_secs(90);

/// Waits until `ready` returns a value.
pub fn until<T>(what: impl Display, mut ready: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(value) = ready() {
            return value;
        }
        let waited = start.elapsed();
        assert!(waited < PATIENCE, "waited {waited:?} for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Runs work that must not wait for a time-out.
pub fn without_time_out<T>(what: impl Display, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let value = work();
    let took = start.elapsed();
    assert!(took < PATIENCE, "{what} took {took:?}");
    value
}
