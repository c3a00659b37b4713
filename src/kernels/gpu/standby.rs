//! Sums on an adapter, with the processor standing by.

use super::Trouble;
use crate::kernels::{Estimate, Summation};
use crate::pairs::Pair;
use std::sync::OnceLock;

/// A sum on an adapter.
pub(crate) trait AdapterSum: Send + Sync {
    /// The linking numbers of several pairs, in their order.
    fn linking_numbers(&self, pairs: &[Pair]) -> Result<Vec<Estimate>, Trouble>;
}

/// A sum on an adapter; on the processor once that failed.
pub(crate) struct WithStandby<'a, S> {
    sum: S,
    /// What the processor needs is built when it is needed.
    processor: Lazy<'a, Box<dyn Summation + 'a>>,
}

impl<'a, S> WithStandby<'a, S> {
    /// Builds nothing of the processor's.
    pub fn new(
        sum: S,
        processor: impl Fn() -> Box<dyn Summation + 'a> + Send + Sync + 'a,
    ) -> WithStandby<'a, S> {
        WithStandby {
            sum,
            processor: Lazy::new(processor),
        }
    }
}

impl<S: AdapterSum> Summation for WithStandby<'_, S> {
    fn linking_number(&self, pair: Pair) -> Estimate {
        self.linking_numbers(&[pair])[0]
    }

    fn linking_numbers(&self, pairs: &[Pair]) -> Vec<Estimate> {
        self.sum.linking_numbers(pairs).unwrap_or_else(|trouble| {
            tracing::warn!("the sums are made on the processor: {trouble}");
            self.processor.get().linking_numbers(pairs)
        })
    }
}

/// What is made once it is asked for. Who asks meanwhile makes it as well, since nobody may wait here: a thread that makes it
/// takes up other work on the way, which may ask for it too.
pub(super) struct Lazy<'a, T> {
    made: OnceLock<T>,
    make: Box<dyn Fn() -> T + Send + Sync + 'a>,
}

impl<'a, T> Lazy<'a, T> {
    /// Makes nothing yet.
    pub fn new(make: impl Fn() -> T + Send + Sync + 'a) -> Lazy<'a, T> {
        Lazy {
            made: OnceLock::new(),
            make: Box::new(make),
        }
    }

    /// Whether it was asked for.
    #[cfg(test)]
    pub fn is_made(&self) -> bool {
        self.made.get().is_some()
    }

    /// What was made, or is made now.
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

    /// Says which of the two it is.
    struct Says(Result<f64, Trouble>);

    impl AdapterSum for Says {
        fn linking_numbers(&self, pairs: &[Pair]) -> Result<Vec<Estimate>, Trouble> {
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
    fn the_processor_is_made_ready_once_and_only_where_the_adapter_failed() {
        let made = AtomicU32::new(0);
        let make = || -> Box<dyn Summation> {
            made.fetch_add(1, Ordering::Relaxed);
            Box::new(2.0)
        };
        let both = WithStandby::new(Says(Ok(1.0)), make);
        let integers = |sum: &dyn Summation, n| -> Vec<_> {
            let found = sum.linking_numbers(&vec![(0, 1); n]);
            found.iter().map(Estimate::integer).collect()
        };
        assert_eq!(integers(&both, 2), [Some(1); 2]);
        assert_eq!(both.linking_number((0, 1)).integer(), Some(1));
        assert_eq!(made.load(Ordering::Relaxed), 0);
        let failed = WithStandby::new(Says(Err(Trouble::Failed("lost".into()))), make);
        assert_eq!(integers(&failed, 3), [Some(2); 3]);
        assert_eq!(integers(&failed, 3), [Some(2); 3]);
        assert_eq!(made.load(Ordering::Relaxed), 1);
    }
}
