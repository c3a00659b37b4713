//! Comparison of a frame with the baseline: in full, or incrementally.

use super::known::{Known, LinkingNumbers};
use super::{Engine, Strategy};
use crate::certificate::{Certificate, Comparison};
use crate::curve::{CurveSet, Frame};
use crate::error::Result;
use crate::incremental::{Events, Outcome, Route};
use crate::pairs::distinct;
use crate::pool;
use crate::verdict::Stats;
use std::sync::Arc;
use std::time::Instant;

/// Result of comparing a frame with the baseline.
pub(super) struct Compared {
    pub linking: LinkingNumbers,
    pub stats: Stats,
    /// Outcome of the step from the previous frame, if it was searched.
    pub step: Option<Outcome>,
}

/// Comparison and linking numbers of a frame that were proven without a full run, and the outcome
/// of the step from the previous frame, if it was searched.
type Proven = (Comparison, Arc<Certificate>, Option<Outcome>);

impl Engine {
    /// Compares a frame with the baseline, by the strategy of the engine. `quiet` is true if the
    /// frame is proven to be quiet. `appeared` has the curves that the baseline lacks.
    pub(super) fn compare(
        &mut self,
        known: &mut Known,
        frame: &Frame,
        quiet: bool,
        appeared: &[u32],
    ) -> Result<Compared> {
        let mut compared = self.compare_with_baseline(known, frame, quiet, appeared)?;
        if self.options.strategy.is_incremental() {
            // The work depends on earlier frames, so the report has only the sizes of the scene.
            compared.stats = Stats::default();
            if let Some(certificate) = &compared.linking.certificate
                && !known.has_broken_braids()
                && self.monitor.wants_reference()
            {
                let certificate = Arc::clone(certificate);
                self.monitor.make_reference(frame.clone(), certificate);
            }
        }
        Ok(compared)
    }

    fn compare_with_baseline(
        &mut self,
        known: &mut Known,
        frame: &Frame,
        quiet: bool,
        appeared: &[u32],
    ) -> Result<Compared> {
        let Some(baseline) = known.baseline.clone() else {
            let stats = self.certify_fully(frame.set()?)?;
            let baseline = Arc::new(self.full.certificate.clone());
            let comparison = baseline.compare(&baseline)?;
            known.baseline = Some(baseline);
            return Ok(self.of_full_run(comparison, stats));
        };
        let is_broken = known.has_broken_braids();
        let mut compared = match self.options.strategy {
            _ if !appeared.is_empty() => {
                let stats = self.certify_fully(frame.set()?)?;
                let certificate = &self.full.certificate;
                let mut all = Certificate::clone(&baseline);
                all.adopt_curves(appeared, certificate);
                let comparison = certificate.compare(&all)?;
                known.baseline = Some(Arc::new(all));
                self.of_full_run(comparison, stats)
            }
            // A change between loops of a broken braid means nothing, and would end the run early.
            Strategy::Full if self.options.early_exit && !is_broken => {
                let set = frame.set()?;
                let (comparison, stats) = self.full.compare_until_change(set, &baseline)?;
                self.of_full_run(comparison, stats)
            }
            Strategy::Full => self.compare_fully(frame.set()?, &baseline)?,
            Strategy::Incremental | Strategy::Paranoid => {
                self.compare_incrementally(known, frame, quiet, &baseline)?
            }
        };
        // After a cancellation, pairs are missing. They must not be missing in the baseline.
        self.full.progress.check()?;
        if let Some(scene) = &known.braids {
            scene.forget_broken(&mut compared.linking.comparison);
        }
        // With early exit, unchecked pairs have no linking number yet, so the baseline does not
        // adopt them.
        let comparison = &compared.linking.comparison;
        if compared.stats.unchecked == 0
            && !is_broken
            && comparison.has_fresh()
            && let Some(baseline) = &mut known.baseline
        {
            let baseline = Arc::make_mut(baseline);
            baseline.adopt(comparison);
            self.monitor.set_baseline(baseline);
        }
        Ok(compared)
    }

    /// Returns the linking numbers of the last full run, with their comparison.
    pub(super) fn linking_of_full_run(&self, comparison: Comparison) -> LinkingNumbers {
        let keeps = self.options.strategy.is_incremental();
        LinkingNumbers {
            comparison,
            certificate: keeps.then(|| Arc::new(self.full.certificate.clone())),
        }
    }

    /// Returns the result of a full run.
    fn of_full_run(&self, comparison: Comparison, stats: Stats) -> Compared {
        Compared {
            linking: self.linking_of_full_run(comparison),
            stats,
            step: None,
        }
    }

    fn compare_fully(&mut self, set: &CurveSet, baseline: &Certificate) -> Result<Compared> {
        let stats = self.certify_fully(set)?;
        let comparison = self.full.certificate.compare(baseline)?;
        Ok(self.of_full_run(comparison, stats))
    }

    /// Computes a frame in full, and records the number of pairs decided by sums.
    fn certify_fully(&mut self, set: &CurveSet) -> Result<Stats> {
        let start = Instant::now();
        let stats = pool::run(set.segments(), || self.full.certify(set));
        self.full.progress.check()?;
        self.routing.full_run = start.elapsed();
        self.work.recomputed = stats.potential_links;
        self.work.summed = self.full.ladder.summed;
        Ok(stats)
    }

    /// Compares a frame with the baseline. Computes only linking numbers that neither the reference
    /// frame nor the step from the previous frame proves.
    fn compare_incrementally(
        &mut self,
        known: &mut Known,
        frame: &Frame,
        quiet: bool,
        baseline: &Certificate,
    ) -> Result<Compared> {
        let proven = match self.monitor.reference_result().filter(|_| quiet) {
            Some((certificate, comparison)) => {
                Some((comparison.clone(), Arc::clone(certificate), None))
            }
            None => self.compare_by_step(known, frame, baseline)?,
        };
        let Some((comparison, certificate, step)) = proven else {
            return self.compare_fully(frame.set()?, baseline);
        };
        if self.options.strategy == Strategy::Paranoid {
            let stats = self.full.certify(frame.set()?);
            self.full.progress.check()?;
            let full = self.full.certificate.compare(baseline)?;
            if full != comparison {
                self.disagree();
            }
            let full = self.of_full_run(full, stats);
            return Ok(Compared { step, ..full });
        }
        Ok(Compared {
            linking: LinkingNumbers {
                comparison,
                certificate: Some(certificate),
            },
            stats: Stats::default(),
            step,
        })
    }

    /// Compares a frame with the baseline by a search of the step from the previous frame: a pair
    /// without a passage or a contact keeps its linking number. Returns `None` if the previous
    /// frame cannot be used, or if a full run costs less.
    fn compare_by_step(
        &mut self,
        known: &mut Known,
        frame: &Frame,
        baseline: &Certificate,
    ) -> Result<Option<Proven>> {
        let start = Instant::now();
        let set = frame.set()?;
        let Some(certificate) = self.steps.numbers(known, set) else {
            return Ok(None);
        };
        let pairs = self.pairs_to_search(known, frame);
        let all = pairs.is_none();
        if all && self.steps.events == Events::Off && !self.routing.search_pays() {
            return Ok(None);
        }
        let step = self.search_step(known, frame, pairs)?;
        self.full.progress.check()?;
        let closed = |i: u32| set.curve(i as usize).closed;
        let unsettled = step.unsettled_pairs();
        let unsettled = unsettled.filter(|&(i, j)| i != j && closed(i) && closed(j));
        // Pairs that had no linking number in the previous frame must be computed.
        let undefined = &certificate.undefined;
        let unknown = undefined.iter().filter_map(|d| Some((d.i, d.j?)));
        let pairs = distinct(unsettled.chain(unknown));
        self.work.route = Route::Partial;
        self.work.recomputed = pairs.len() as u64;
        let certificate = if pairs.is_empty() {
            certificate
        } else {
            let recomputed = self.full.certify_pairs(set, &pairs);
            self.full.progress.check()?;
            Arc::new(certificate.with_replaced(&pairs, &recomputed))
        };
        let comparison = certificate.compare(baseline)?;
        if all {
            self.routing.took_search(start.elapsed());
        }
        Ok(Some((comparison, certificate, Some(step))))
    }
}
