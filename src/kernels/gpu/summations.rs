//! Summation kernels on an adapter, prepared for a set of polylines.

use super::barnes_hut::{self, Forest};
use super::{Error, Frame, Gpu, direct};
use crate::curve::CurveSet;
use crate::kernels::Estimate;
use crate::kernels::gpu_use::AdapterSum;
use crate::kernels::lazy::get_or_make;
use crate::pairs::Pair;
use std::sync::OnceLock;
use std::sync::atomic::Ordering;

impl Gpu {
    /// Returns the kernel of direct sums for a set of polylines.
    pub fn direct_sum<'a>(&'a self, set: &'a CurveSet) -> AdapterSum<'a> {
        let sum = DirectSum::new(self, set);
        Box::new(move |pairs| sum.linking_numbers(pairs))
    }

    /// Returns the Barnes-Hut kernel for a set of polylines. With `beta` it makes one pass and
    /// accepts node pairs by distance, else by the proven error bound.
    pub fn barnes_hut<'a>(&'a self, set: &CurveSet, beta: Option<f64>) -> AdapterSum<'a> {
        let frame = Frame::new(set);
        let forest = Forest::new(&frame);
        // The lock ends before a fallback sums on the CPU, because rayon threads may steal tasks
        // that need the lock.
        Box::new(move |pairs| {
            barnes_hut::linking_numbers(&mut self.lock(), &frame, &forest, pairs, beta)
        })
    }
}

/// The Gauss sum: in single precision, then in double precision for the pairs that single precision
/// leaves undecided, if the adapter supports it.
pub(super) struct DirectSum<'a> {
    gpu: &'a Gpu,
    set: &'a CurveSet,
    frame: Frame,
    pub(super) finer: OnceLock<Frame<f64>>,
}

impl<'a> DirectSum<'a> {
    /// Prepares the vertices of a set of polylines.
    pub fn new(gpu: &'a Gpu, set: &'a CurveSet) -> DirectSum<'a> {
        DirectSum {
            gpu,
            set,
            frame: Frame::new(set),
            finer: OnceLock::new(),
        }
    }

    /// Sums the undecided pairs again, in double precision. For curves that touch this does not
    /// help, but they are not known in advance.
    fn refine(&self, pairs: &[Pair], found: &mut [Estimate]) -> Result<(), Error> {
        let open = |&k: &usize| found[k].integer().is_none() && self.frame.has_numbers(pairs[k]);
        let open: Vec<usize> = (0..pairs.len()).filter(open).collect();
        if open.is_empty() || !self.gpu.computes_in_double() {
            return Ok(());
        }
        // Built before the lock is taken: the rayon threads that build it may steal tasks that need
        // the lock.
        let frame = get_or_make(&self.finer, || Frame::new(self.set));
        let again: Vec<Pair> = open.iter().map(|&k| pairs[k]).collect();
        let finer = direct::linking_numbers(&mut self.gpu.lock(), frame, &again)?;
        for (k, finer) in open.into_iter().zip(finer) {
            // Both bounds are proven, so the smaller one holds.
            if finer.bound < found[k].bound {
                found[k] = finer;
            }
        }
        Ok(())
    }

    /// Returns the linking numbers of several pairs, in their order.
    pub fn linking_numbers(&self, pairs: &[Pair]) -> Result<Vec<Estimate>, Error> {
        let mut found = direct::linking_numbers(&mut self.gpu.lock(), &self.frame, pairs)?;
        // After a failure the single-precision bounds are larger, but still proven.
        if let Err(error) = self.refine(pairs, &mut found)
            && !self.gpu.only_single.swap(true, Ordering::Relaxed)
        {
            tracing::warn!(
                "double precision failed on the GPU; the single-precision sums are kept: {error}"
            );
        }
        Ok(found)
    }
}
