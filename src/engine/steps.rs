//! Steps between frames: pull-throughs, their consistency with the linking numbers, and the pairs
//! whose linking numbers they may have changed.

use super::Progress;
use super::known::{Across, Known, Last, LinkingNumbers};
use crate::certificate::{Certificate, Comparison};
use crate::curve::{CurveSet, Frame};
use crate::error::Result;
use crate::incremental::{Contacts, Coverage, Events, Ledger, Outcome, Touching};
use crate::pairs::{Pair, PairFilter, degenerate_curves, sorted};
use crate::verdict::{Defect, DefectKind, Place};
use std::sync::Arc;

/// The ledger that finds pull-throughs since the last verified frame.
#[derive(Debug, Default)]
pub(super) struct Steps {
    /// Pull-throughs that are reported.
    pub events: Events,
    /// True if linking numbers are proven by steps. Frames are then kept even if no pull-throughs
    /// are searched for.
    incremental: bool,
    ledger: Ledger,
    /// Contacts of the current frame.
    contacts: Contacts,
    /// True if a search found undecided pairs. A report may omit them.
    pub undecided: bool,
    /// Pairs of curves, open ones included, that may have met in the step to the current frame.
    /// `None` if pull-throughs are not searched for, or if there was no step.
    pub met: Option<Vec<Pair>>,
    /// Pairs whose passages are searched for; `None`: all.
    filter: Option<PairFilter>,
}

impl Steps {
    /// Creates the state, with a motion limit in segment lengths.
    pub fn new(events: Events, incremental: bool, motion_limit: f64) -> Self {
        let coverage = Coverage {
            self_crossings: events == Events::All,
            open_curves: events != Events::Off,
        };
        Steps {
            events,
            incremental,
            ledger: Ledger::new(motion_limit, coverage),
            ..Steps::default()
        }
    }

    /// Shares the cancellation and the pair limit of a run, which end a search early.
    pub fn end_with(&mut self, progress: &Progress) {
        let Progress { cancel, limit, .. } = progress;
        self.ledger.end_with(cancel.clone(), limit.clone());
    }

    /// Searches only the pairs of a filter from now on.
    pub fn set_filter(&mut self, filter: Option<PairFilter>) {
        self.filter = filter;
        self.search_loops(true);
        self.ledger.set_filter(self.filter.clone());
    }

    /// Sets whether passages of the loops of braids are searched for. They only prove linking
    /// numbers: a full run does not need them, and loops that jump would have swept boxes of the
    /// size of the scene.
    fn search_loops(&mut self, search: bool) {
        let Some(PairFilter::Loops(pairs) | PairFilter::WithoutLoops(pairs)) = &self.filter else {
            return;
        };
        let filter = match search && self.incremental {
            true => PairFilter::Loops(Arc::clone(pairs)),
            false => PairFilter::WithoutLoops(Arc::clone(pairs)),
        };
        if self.filter.as_ref() != Some(&filter) {
            self.filter = Some(filter);
            self.ledger.set_filter(self.filter.clone());
        }
    }

    /// Returns true if passages of this pair are reported.
    fn reports(&self, (i, j): Pair) -> bool {
        match &self.filter {
            Some(PairFilter::Loops(pairs) | PairFilter::WithoutLoops(pairs)) => {
                pairs.is_own(i) && pairs.is_own(j)
            }
            Some(PairFilter::Images(_)) | None => true,
        }
    }

    /// Removes the findings of a step that are not reported.
    pub fn keep_reported(&self, outcome: &mut Outcome) {
        if let Some(PairFilter::Loops(_)) = self.filter {
            outcome.retain(|pair| self.reports(pair));
        }
    }

    /// Returns the kinds of pull-throughs that the ledger finds.
    pub fn coverage(&self) -> Coverage {
        self.ledger.coverage
    }

    /// Returns the linking numbers of the previous frame, unless a curve is degenerate in that
    /// frame or in this one, and has no linking numbers.
    pub fn numbers(&self, known: &Known, set: &CurveSet) -> Option<Arc<Certificate>> {
        if let Some(PairFilter::WithoutLoops(_)) = self.filter {
            return None;
        }
        let last = known.last.as_ref()?;
        let certificate = last.linking.certificate.as_ref()?;
        let known = !certificate.has_degenerate_curves() && degenerate_curves(set).next().is_none();
        known.then(|| Arc::clone(certificate))
    }

    /// Returns the outcome of a step in which curves appeared or disappeared. The contacts of
    /// curves that appeared begin in this frame.
    fn outcome_across(&mut self, known: &Known, across: &Across, set: &CurveSet) -> Outcome {
        let Across { before, curves } = across;
        let after = set.subset(curves);
        let (contacts, touched) = self.ledger.first_frame(before);
        let mut step = self.ledger.step([before, &after], &contacts, None);
        // Curves that came into contact before the change may have been on either side of each
        // other, so the step of their pair is undecided.
        let began = touched.iter().map(|t| t.defect).filter(|d| {
            let index = |i: u32| curves[i as usize];
            !known.touch_from_the_start(index(d.i), d.j.map(index))
        });
        step.undecided.extend(began);
        Defect::sort(&mut step.undecided);
        step.undecided.dedup_by_key(|d| (d.i, d.j));
        let mut outcome = step.with_curves(curves);
        let (contacts, mut touching) = self.ledger.first_frame(set);
        let pair = |t: &Touching| (t.defect.i, t.defect.j);
        let from_the_start = outcome.touching.iter().filter(|t| t.from_the_start);
        let from_the_start: Vec<_> = from_the_start.map(pair).collect();
        for t in &mut touching {
            t.from_the_start = from_the_start.contains(&pair(t));
        }
        (outcome.touching, outcome.contacts) = (touching, contacts);
        outcome
    }

    /// Returns the largest proven fraction of the step, during which nothing was pulled through.
    /// `outcome` is that of the step from the last verified frame. Returns `None` if that frame is
    /// not known to be intact.
    /// # Errors
    ///
    /// The errors of [`Frame::set`].
    pub fn safe_fraction(
        &mut self,
        known: &Known,
        frame: &Frame,
        outcome: &Outcome,
    ) -> Result<Option<f64>> {
        let last = known.last.as_ref().filter(|_| known.intactness.intact);
        let Some(last) = last else {
            return Ok(None);
        };
        if outcome.is_safe(&last.contacts) {
            return Ok(Some(1.0));
        }
        let mut contacts = last.contacts.clone();
        contacts.retain(|pair| self.reports(pair));
        let frames = match &known.braids {
            // With the coordinates as they were given, without the loops of braids.
            Some(scene) => scene.step(),
            None => [&**last.frame.set()?, &**frame.set()?],
        };
        let fraction = self.ledger.safe_fraction(frames, &contacts, outcome);
        Ok(Some(fraction))
    }

    /// Begins a frame. Fails if the curves differ from those of the previous frame, because no
    /// motion is defined between different curves. If pull-throughs are not reported, forgets the
    /// previous frame instead of failing.
    pub fn begin(&mut self, known: &mut Known, set: &CurveSet) -> Result<()> {
        (self.met, self.undecided, self.contacts) = (None, false, Contacts::default());
        let jumps = known.braids.as_ref().is_some_and(|braids| braids.jumps);
        self.search_loops(!jumps);
        known.widen_to(set)?;
        if self.events == Events::Off {
            let last = &mut known.last;
            last.take_if(|last| !last.frame.given().same_layout(set));
        }
        let last = known.last.as_ref();
        last.map_or(Ok(()), |last| last.frame.given().check_same_layout(set))
    }

    /// Keeps a verified frame if the next one will be compared with it.
    pub fn remember(&mut self, known: &mut Known, frame: Frame, linking: LinkingNumbers) {
        known.across = None;
        if self.incremental || self.events != Events::Off {
            known.last = Some(Arc::new(Last {
                frame,
                linking,
                contacts: std::mem::take(&mut self.contacts),
            }));
        }
    }

    /// Returns the outcome of the step from the previous frame, for these pairs or for all. For a
    /// first frame, the outcome has the curves that touch.
    ///
    /// # Errors
    ///
    /// The errors of [`Frame::set`].
    ///
    /// # Panics
    /// If the previous frame has other curves.
    pub fn outcome(
        &mut self,
        known: &mut Known,
        frame: &Frame,
        pairs: Option<&[Pair]>,
    ) -> Result<Outcome> {
        let reports = self.events != Events::Off;
        let outcome = match (known.across.clone(), known.last.clone()) {
            (Some(across), _) => {
                let outcome = self.outcome_across(known, &across, frame.set()?);
                self.undecided |= !outcome.undecided.is_empty();
                outcome
            }
            (None, Some(last)) => {
                let settled = pairs.is_some_and(<[Pair]>::is_empty) && last.contacts.is_empty();
                let outcome = match settled {
                    true => Outcome::default(),
                    false => {
                        let frames = [&**last.frame.set()?, &**frame.set()?];
                        self.ledger.step(frames, &last.contacts, pairs)
                    }
                };
                // Recorded here, because a report omits this defect if the pair has another one.
                let mut undecided = outcome.undecided.iter().map(|d| (d.i, d.j.unwrap_or(d.i)));
                self.undecided |= reports && undecided.any(|pair| self.reports(pair));
                self.met = reports.then(|| outcome.met_pairs().collect());
                outcome
            }
            (None, None) => {
                let (contacts, touching) = self.ledger.first_frame(frame.set()?);
                Outcome {
                    touching,
                    contacts,
                    ..Outcome::default()
                }
            }
        };
        self.contacts.clone_from(&outcome.contacts);
        note_touching(known, &outcome);
        Ok(outcome)
    }

    /// Adds defects of three kinds: curves that touch, pairs that are undecided in the step, and
    /// pairs whose passages contradict their linking numbers, located by `place`. Keeps only the
    /// first defect of a pair, but an undecided step is kept beside a contact.
    ///
    /// # Errors
    ///
    /// The errors of `place`.
    pub fn add_defects(
        &self,
        known: &Known,
        outcome: &Outcome,
        comparison: &Comparison,
        mut place: impl FnMut(Pair) -> Result<Place>,
        defects: &mut Vec<Defect>,
    ) -> Result<()> {
        let touching = outcome.touching.iter().map(|t| t.defect);
        let undecided = outcome.undecided.iter().map(|d| Defect {
            kind: DefectKind::UndecidedStep,
            ..*d
        });
        defects.extend(touching.chain(undecided));
        let last = known.last.as_ref();
        let unaccounted = last.map(|last| outcome.check(&last.linking.comparison, comparison));
        let unaccounted = unaccounted.into_iter().flatten();
        for pair in unaccounted.filter(|&pair| self.reports(pair)) {
            defects.push(Defect::of_pair(pair, DefectKind::Unaccounted, place(pair)?));
        }
        // The sort is stable: earlier defects of a pair stay first.
        Defect::sort(defects);
        defects.dedup_by(|next, first| {
            // A contact in this frame does not decide what happened since the previous frame.
            let other = first.kind == DefectKind::Contact && next.kind == DefectKind::UndecidedStep;
            (next.i, next.j) == (first.i, first.j) && !other
        });
        Ok(())
    }
}

/// Updates the pairs that have touched since the first frame: removes those that no longer touch.
fn note_touching(known: &mut Known, outcome: &Outcome) {
    let still = outcome.touching.iter().filter(|t| t.from_the_start);
    let still = still.map(|t| (t.defect.i, t.defect.j.unwrap_or(t.defect.i)));
    let before = known.touching.take();
    let kept = still.filter(|pair| before.as_ref().is_none_or(|k| k.contains(pair)));
    known.touching = Some(Arc::new(sorted(kept)));
}
