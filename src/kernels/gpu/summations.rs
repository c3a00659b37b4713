//! The sums that an adapter makes, each with what it prepares of a set of polylines.

use super::barnes_hut::{self, Forest};
use super::standby::{AdapterSum, Lazy};
use super::{Frame, Gpu, Trouble, direct};
use crate::curve::CurveSet;
use crate::kernels::Estimate;
use crate::pairs::Pair;

/// The Gauss sum: in single precision, then in double precision, where the adapter has it, for pairs that the first
/// leaves open.
pub(crate) struct DirectSum<'a> {
    gpu: &'a Gpu,
    frame: Frame,
    pub(super) finer: Lazy<'a, Frame<f64>>,
}

impl<'a> DirectSum<'a> {
    /// Prepares the vertices of a set of polylines.
    pub fn new(gpu: &'a Gpu, set: &'a CurveSet) -> DirectSum<'a> {
        DirectSum {
            gpu,
            frame: Frame::new(set),
            finer: Lazy::new(|| Frame::new(set)),
        }
    }

    /// Sums once more what is open. Of curves that touch that is in vain, and not known before.
    fn refine(&self, pairs: &[Pair], found: &mut [Estimate]) -> Result<(), Trouble> {
        let open = |&k: &usize| found[k].integer().is_none() && self.frame.has_numbers(pairs[k]);
        let open: Vec<usize> = (0..pairs.len()).filter(open).collect();
        if open.is_empty() || !self.gpu.computes_in_double() {
            return Ok(());
        }
        // Before the adapter is locked: threads that make it may take up work that wants the adapter.
        let frame = self.finer.get();
        let again: Vec<Pair> = open.iter().map(|&k| pairs[k]).collect();
        let finer = direct::linking_numbers(&mut self.gpu.lock(), frame, &again)?;
        for (k, finer) in open.into_iter().zip(finer) {
            // Both bounds are proven.
            if finer.bound < found[k].bound {
                found[k] = finer;
            }
        }
        Ok(())
    }
}

impl AdapterSum for DirectSum<'_> {
    fn linking_numbers(&self, pairs: &[Pair]) -> Result<Vec<Estimate>, Trouble> {
        let mut found = direct::linking_numbers(&mut self.gpu.lock(), &self.frame, pairs)?;
        // Without it the sums are coarser, and no worse.
        if let Err(trouble) = self.refine(pairs, &mut found) {
            tracing::warn!("no sums in double precision: {trouble}");
        }
        Ok(found)
    }
}

/// Barnes-Hut.
pub(crate) struct BarnesHutSum<'a> {
    gpu: &'a Gpu,
    frame: Frame,
    forest: Forest,
    beta: Option<f64>,
}

impl<'a> BarnesHutSum<'a> {
    /// Builds the trees of a set of polylines; `beta` leaves it at one pass by distance.
    pub fn new(gpu: &'a Gpu, set: &CurveSet, beta: Option<f64>) -> BarnesHutSum<'a> {
        let frame = Frame::new(set);
        BarnesHutSum {
            gpu,
            forest: Forest::new(&frame),
            frame,
            beta,
        }
    }
}

impl AdapterSum for BarnesHutSum<'_> {
    fn linking_numbers(&self, pairs: &[Pair]) -> Result<Vec<Estimate>, Trouble> {
        // Locked for this alone, not where the processor sums: its threads may take up work that wants the adapter.
        let engine = &mut self.gpu.lock();
        barnes_hut::linking_numbers(engine, &self.frame, &self.forest, pairs, self.beta)
    }
}
