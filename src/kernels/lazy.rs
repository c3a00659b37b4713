//! Values that are computed at their first use.

use std::sync::OnceLock;

/// A value that is computed at its first use. Concurrent callers compute it as well instead of
/// blocking: the thread that computes it may steal tasks that request it too, and would deadlock.
pub(crate) struct Lazy<'a, T> {
    made: OnceLock<T>,
    make: Box<dyn Fn() -> T + Send + Sync + 'a>,
}

impl<'a, T> Lazy<'a, T> {
    /// Stores the function without calling it.
    pub fn new(make: impl Fn() -> T + Send + Sync + 'a) -> Lazy<'a, T> {
        Lazy {
            made: OnceLock::new(),
            make: Box::new(make),
        }
    }

    /// Returns true if the value has been computed.
    #[cfg(all(test, feature = "gpu"))]
    pub fn is_made(&self) -> bool {
        self.made.get().is_some()
    }

    /// Returns the value; computes it first if needed.
    pub fn get(&self) -> &T {
        match self.made.get() {
            Some(made) => made,
            None => {
                let made = (self.make)();
                self.made.get_or_init(|| made)
            }
        }
    }
}
