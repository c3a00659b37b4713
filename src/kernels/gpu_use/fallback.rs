//! Sums on an adapter, with the CPU as the fallback.

use super::GpuUse;
use crate::kernels::lazy::get_or_make;
use crate::kernels::{Estimate, Summation};
use crate::pairs::Pair;
use std::fmt;
use std::sync::OnceLock;

/// A sum on an adapter that falls back to the CPU if the adapter fails.
pub(in crate::kernels) struct WithFallback<'a, F, C> {
    gpu: &'a GpuUse,
    sum: F,
    make: C,
    /// The CPU kernel, built only if it is needed.
    cpu: OnceLock<Box<dyn Summation + 'a>>,
}

impl<'a, F, C> WithFallback<'a, F, C> {
    /// Combines both kernels. `sum` returns the linking numbers of several pairs, in their order;
    /// `make` builds the CPU kernel.
    pub fn new(gpu: &'a GpuUse, sum: F, make: C) -> Self {
        WithFallback {
            gpu,
            sum,
            make,
            cpu: OnceLock::new(),
        }
    }
}

impl<'a, F, C, E> Summation for WithFallback<'a, F, C>
where
    F: Fn(&[Pair]) -> Result<Vec<Estimate>, E> + Send + Sync,
    C: Fn() -> Box<dyn Summation + 'a> + Send + Sync,
    E: fmt::Display,
{
    fn linking_numbers(&self, pairs: &[Pair]) -> Vec<Estimate> {
        if !self.gpu.has_failed() {
            match (self.sum)(pairs) {
                Ok(found) => return found,
                Err(error) => self.gpu.fail(&error),
            }
        }
        get_or_make(&self.cpu, &self.make).linking_numbers(pairs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

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
        let (made, asked) = (AtomicU32::new(0), AtomicU32::new(0));
        let make = || -> Box<dyn Summation> {
            made.fetch_add(1, Ordering::Relaxed);
            Box::new(2.0)
        };
        let fixed = |result: Result<f64, &'static str>| {
            let asked = &asked;
            move |pairs: &[Pair]| {
                asked.fetch_add(1, Ordering::Relaxed);
                let value = result?;
                Ok::<_, &str>(vec![Estimate { value, bound: 0.0 }; pairs.len()])
            }
        };
        let gpu = GpuUse::default();
        let both = WithFallback::new(&gpu, fixed(Ok(1.0)), make);
        let integers = |sum: &dyn Summation, n| -> Vec<_> {
            let found = sum.linking_numbers(&vec![(0, 1); n]);
            found.iter().map(Estimate::integer).collect()
        };
        assert_eq!(integers(&both, 2), [Some(1); 2]);
        assert_eq!(both.linking_number((0, 1)).integer(), Some(1));
        assert_eq!(made.load(Ordering::Relaxed), 0);
        assert_eq!(asked.swap(0, Ordering::Relaxed), 2);
        let failed = WithFallback::new(&gpu, fixed(Err("lost")), make);
        assert_eq!(integers(&failed, 3), [Some(2); 3]);
        assert_eq!(integers(&failed, 3), [Some(2); 3]);
        assert_eq!(made.load(Ordering::Relaxed), 1);
        // The adapter is not used again, not even by another kernel.
        assert_eq!(integers(&both, 1), [Some(2)]);
        assert_eq!(asked.load(Ordering::Relaxed), 1);
        assert!(gpu.has_failed());
    }
}
