//! Sums on an adapter, with the CPU as the fallback.

use super::Error;
use crate::kernels::{Estimate, Summation};
use crate::pairs::Pair;
use std::sync::OnceLock;

/// A summation kernel on an adapter.
pub(crate) trait AdapterSum: Send + Sync {
    /// Returns the linking numbers of several pairs, in their order.
    fn linking_numbers(&self, pairs: &[Pair]) -> Result<Vec<Estimate>, Error>;
}

/// A sum on an adapter that falls back to the CPU if the adapter fails.
pub(crate) struct WithFallback<'a, S> {
    sum: S,
    /// The CPU kernel, built only if it is needed.
    cpu: Lazy<'a, Box<dyn Summation + 'a>>,
}

impl<'a, S> WithFallback<'a, S> {
    /// Combines both kernels. Does not build the CPU kernel.
    pub fn new(
        sum: S,
        cpu: impl Fn() -> Box<dyn Summation + 'a> + Send + Sync + 'a,
    ) -> WithFallback<'a, S> {
        WithFallback {
            sum,
            cpu: Lazy::new(cpu),
        }
    }
}

impl<S: AdapterSum> Summation for WithFallback<'_, S> {
    fn linking_number(&self, pair: Pair) -> Estimate {
        self.linking_numbers(&[pair])[0]
    }

    fn linking_numbers(&self, pairs: &[Pair]) -> Vec<Estimate> {
        self.sum.linking_numbers(pairs).unwrap_or_else(|error| {
            tracing::warn!("the GPU failed; these sums are computed on the CPU: {error}");
            self.cpu.get().linking_numbers(pairs)
        })
    }
}

/// A value that is computed at its first use. Concurrent callers compute it as well instead of
/// blocking: the thread that computes it may steal tasks that request it too, and would deadlock.
pub(super) struct Lazy<'a, T> {
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
    #[cfg(test)]
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    /// Returns a fixed result.
    struct FixedResult(Result<f64, Error>);

    impl AdapterSum for FixedResult {
        fn linking_numbers(&self, pairs: &[Pair]) -> Result<Vec<Estimate>, Error> {
            let value = self.0.clone()?;
            Ok(vec![Estimate { value, bound: 0.0 }; pairs.len()])
        }
    }

    impl Summation for f64 {
        fn linking_number(&self, _: Pair) -> Estimate {
            Estimate {
                value: *self,
                bound: 0.0,
            }
        }
    }

    #[test]
    fn the_fallback_is_built_once_and_only_after_a_failure() {
        let made = AtomicU32::new(0);
        let make = || -> Box<dyn Summation> {
            made.fetch_add(1, Ordering::Relaxed);
            Box::new(2.0)
        };
        let both = WithFallback::new(FixedResult(Ok(1.0)), make);
        let integers = |sum: &dyn Summation, n| -> Vec<_> {
            let found = sum.linking_numbers(&vec![(0, 1); n]);
            found.iter().map(Estimate::integer).collect()
        };
        assert_eq!(integers(&both, 2), [Some(1); 2]);
        assert_eq!(both.linking_number((0, 1)).integer(), Some(1));
        assert_eq!(made.load(Ordering::Relaxed), 0);
        let failed = WithFallback::new(FixedResult(Err(Error::Failed("lost".into()))), make);
        assert_eq!(integers(&failed, 3), [Some(2); 3]);
        assert_eq!(integers(&failed, 3), [Some(2); 3]);
        assert_eq!(made.load(Ordering::Relaxed), 1);
    }
}
