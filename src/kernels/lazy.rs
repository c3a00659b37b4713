//! Values that are computed at their first use.

use std::sync::OnceLock;

/// Returns a value; computes it first if needed. Concurrent callers compute it as well instead of
/// blocking: the thread that computes it may steal tasks that request it too, and would deadlock.
pub(crate) fn get_or_make<T>(value: &OnceLock<T>, make: impl FnOnce() -> T) -> &T {
    value.get().unwrap_or_else(|| {
        let made = make();
        value.get_or_init(|| made)
    })
}
