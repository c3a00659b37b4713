//! Findings of a frame: places of changed pairs, and pull-throughs since the previous frame.

use super::known::Known;
use super::{Engine, Strategy};
use crate::certificate::Comparison;
use crate::curve::Frame;
use crate::error::Result;
use crate::incremental::{Events, Outcome, Route};
use crate::pairs::{Pair, closest_approach};
use crate::verdict::{Defect, DefectKind, Report};
use rayon::prelude::*;
use std::time::Instant;

impl Engine {
    /// Adds the places of closest approach of changed pairs, and of pairs that the baseline lacks.
    pub(super) fn add_places(&mut self, frame: &Frame, comparison: &mut Comparison) -> Result<()> {
        let changes = &mut comparison.changes;
        let fresh = |d: &&mut Defect| d.kind == DefectKind::NoBaseline;
        let mut fresh: Vec<_> = comparison.defects.iter_mut().filter(fresh).collect();
        if changes.is_empty() && fresh.is_empty() {
            return Ok(());
        }
        let set = frame.set()?;
        // After a partial run, the trees of some curves may be those of an earlier frame.
        if self.work.route != Route::Full {
            let changed = changes.iter().map(|c| (c.i, c.j));
            let fresh = fresh.iter().filter_map(|d| Some((d.i, d.j?)));
            let pairs: Vec<Pair> = changed.chain(fresh).collect();
            self.full.refit(set, &pairs);
        }
        let trees = self.full.trees();
        let cancel = &self.full.progress.cancel;
        let place = |i: u32, j: u32| {
            let (i, j) = (i as usize, j as usize);
            // Open curves have no tree and no linking number, so their only change is that a link
            // of the baseline is lost.
            let exists = !cancel.is_set() && set.curve(i).closed && set.curve(j).closed;
            exists.then(|| closest_approach(set, trees, i, j))
        };
        let changes = changes.par_iter_mut();
        changes.for_each(|c| c.place = place(c.i, c.j));
        fresh.par_iter_mut().for_each(|d| match d.j {
            Some(j) => d.place = place(d.i, j).unwrap_or(d.place),
            None => d.place.point = set.point(d.i as usize, 0),
        });
        Ok(())
    }

    /// Returns the pairs that may have passed through each other since the previous frame,
    /// according to the reference frame. `None` if all pairs may have.
    pub(super) fn pairs_to_search(&mut self, known: &Known, frame: &Frame) -> Option<Vec<Pair>> {
        if !self.options.strategy.is_incremental() {
            return None;
        }
        let before = &known.last.as_deref()?.frame;
        self.monitor
            .pairs_to_search([before, frame], &mut self.work)
    }

    /// Searches the step from the previous frame for passages: of the given pairs, or of all.
    pub(super) fn search_step(
        &mut self,
        known: &mut Known,
        frame: &Frame,
        pairs: Option<Vec<Pair>>,
    ) -> Result<Outcome> {
        let start = Instant::now();
        let mut outcome = self.steps.outcome(known, frame, pairs.as_deref())?;
        self.full.timings.events += start.elapsed();
        self.work.searched = outcome.counts.pairs;
        if self.options.strategy == Strategy::Paranoid && pairs.is_some() {
            let full = self.steps.outcome(known, frame, None)?;
            let findings = |o: Outcome| (o.events, o.unresolved, o.undecided, o.touching);
            if findings(full.clone()) != findings(outcome) {
                self.disagree();
            }
            outcome = full;
        }
        Ok(outcome)
    }

    /// Adds to a report the pull-throughs since the previous frame, if they are reported, and all
    /// defects: those of the comparison, and pairs that are undecided in the step. `step` is the
    /// outcome of the step, if the comparison has already searched it.
    pub(super) fn search_events(
        &mut self,
        known: &mut Known,
        frame: &Frame,
        step: Option<Outcome>,
        comparison: &Comparison,
        report: &mut Report,
    ) -> Result<()> {
        report.defects.clone_from(&comparison.defects);
        if self.steps.events == Events::Off {
            return Ok(());
        }
        let mut outcome = match step {
            Some(step) => step,
            None => {
                let pairs = self.pairs_to_search(known, frame);
                self.search_step(known, frame, pairs)?
            }
        };
        self.steps.keep_reported(&mut outcome);
        let full = &mut self.full;
        let place = |(i, j): Pair| {
            let set = frame.set()?;
            full.refit(set, &[(i, j)]);
            Ok(closest_approach(set, full.trees(), i as usize, j as usize))
        };
        let defects = &mut report.defects;
        self.steps
            .add_defects(known, &outcome, comparison, place, defects)?;
        defects.extend(self.unaccounted_passages(known, frame, &outcome)?);
        Defect::sort(defects);
        if !defects.iter().any(|d| d.kind == DefectKind::Unaccounted) {
            report.safe_fraction = self.steps.safe_fraction(known, frame, &outcome)?;
        }
        (report.events, report.unresolved) = (outcome.events, outcome.unresolved);
        Ok(())
    }
}
