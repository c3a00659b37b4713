//! Steps between frames: pull-throughs, their consistency with the linking numbers, and the pairs
//! whose linking numbers they may have changed.

use super::intactness::Intactness;
use crate::cancel::{Cancel, PairLimit};
use crate::certificate::{Certificate, Comparison};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::incremental::{Contacts, Coverage, Events, Ledger, Outcome, Touching};
use crate::pairs::{Pair, PairFilter, degenerate_curves};
use crate::verdict::{Defect, DefectKind, Place, Report};
use std::sync::Arc;

/// Last verified frame, and the ledger that finds pull-throughs since then.
#[derive(Debug, Default)]
pub(super) struct Steps {
    events: Events,
    /// True if steps prove linking numbers, so that frames are kept without a search for
    /// pull-throughs too.
    incremental: bool,
    ledger: Ledger,
    last: Option<Last>,
    /// Previous frame, if it had other curves; `last` is `None` then.
    across: Option<Arc<Across>>,
    /// `last` and `across` before a change of the curves, until a frame is verified.
    before_change: Option<(Option<Last>, Option<Arc<Across>>)>,
    /// Contacts of the current frame.
    contacts: Contacts,
    /// Pairs of curves that have touched since the very first frame, sorted, without pairs of
    /// closed curves; `None` before that frame.
    touching_from_the_start: Option<Vec<Pair>>,
    intactness: Intactness,
    /// True if a search found pairs that are undecided, which a report may omit.
    undecided: bool,
    /// Pairs that may have met in the step to the current frame; `None` if it was not searched.
    met: Option<Vec<Pair>>,
}

#[derive(Debug)]
struct Last {
    set: Arc<CurveSet>,
    linking: LinkingNumbers,
    contacts: Contacts,
}

/// Previous frame of other curves: those that continue, in the order of the current frame.
#[derive(Debug)]
struct Across {
    before: CurveSet,
    /// Their indices in the current frame, ascending.
    curves: Vec<u32>,
}

/// Linking numbers of a frame.
#[derive(Clone, Debug)]
pub(super) struct LinkingNumbers {
    /// Comparison with the baseline.
    pub comparison: Comparison,
    /// All linking numbers, if later frames are verified incrementally.
    pub certificate: Option<Arc<Certificate>>,
}

impl Steps {
    /// Creates the state, with a motion limit in segment lengths. `cancel` ends a search for
    /// pull-throughs early.
    pub fn new(
        events: Events,
        incremental: bool,
        motion_limit: f64,
        ends: (Cancel, PairLimit),
    ) -> Self {
        Steps {
            events,
            incremental,
            ledger: Ledger::new(motion_limit, ends),
            ..Steps::default()
        }
    }

    pub fn events(&self) -> Events {
        self.events
    }

    /// Searches only the pairs of a filter from now on.
    pub fn set_filter(&mut self, filter: Option<PairFilter>) {
        self.ledger.set_filter(filter);
    }

    /// Returns the pairs of curves, open ones included, that may have met in the step to the
    /// current frame. `None` if pull-throughs are not searched for, or if there was no step.
    pub fn met(&self) -> Option<&[Pair]> {
        self.met.as_deref()
    }

    /// Returns the kinds of pull-throughs that the ledger finds.
    pub fn coverage(&self) -> Coverage {
        Coverage {
            self_crossings: self.events == Events::All,
            open_curves: self.events != Events::Off,
        }
    }

    /// Returns the previous frame, if it was kept.
    pub fn before(&self) -> Option<&CurveSet> {
        self.last.as_ref().map(|last| &*last.set)
    }

    /// Returns the linking numbers of the previous frame, if every curve had linking numbers then,
    /// and still has.
    pub fn known(&self, set: &CurveSet) -> Option<Arc<Certificate>> {
        let last = self.last.as_ref()?;
        let certificate = last.linking.certificate.as_ref()?;
        let known = !certificate.has_degenerate_curves() && degenerate_curves(set).next().is_none();
        known.then(|| Arc::clone(certificate))
    }

    /// Converts the previous frame to double precision, like those that follow.
    pub fn widen(&mut self) -> Result<()> {
        if let Some(last) = &mut self.last {
            last.set = Arc::new(last.set.widened()?);
        }
        Ok(())
    }

    /// Returns true if frames are kept for the next step.
    fn keeps_frames(&self) -> bool {
        self.incremental || self.events != Events::Off
    }

    /// Discards the previous frame, so that the next one does not continue it.
    pub fn forget(&mut self) {
        self.last = None;
        self.across = None;
        self.before_change = None;
        self.intactness.cut();
    }

    /// Discards all that is known about the curves of earlier frames.
    pub fn restart(&mut self) {
        self.forget();
        self.contacts = Contacts::default();
        self.touching_from_the_start = None;
    }

    /// Prepares a step to a frame of other curves, of which `origins` has the indices in the
    /// previous frame. Pull-throughs are searched for among the curves that continue with the same
    /// number of points.
    pub fn change_curves(&mut self, origins: &[Option<u32>], set: &CurveSet) {
        let last = self.last.take();
        let across = last.as_ref().filter(|_| self.events != Events::Off);
        let across = across.and_then(|last| {
            let before = &*last.set;
            let same_kind = |a: &CurveSet, b: &CurveSet| {
                (a.basis(), a.precision()) == (b.basis(), b.precision())
            };
            if !same_kind(before, set) {
                return None;
            }
            let same_size = |&(i, origin): &(u32, u32)| {
                let (a, b) = (before.curve(origin as usize), set.curve(i as usize));
                (a.points, a.closed) == (b.points, b.closed)
            };
            let kept = (0_u32..).zip(origins).filter_map(|(i, o)| Some((i, (*o)?)));
            let (curves, origins): (Vec<u32>, Vec<u32>) = kept.filter(same_size).unzip();
            Some(Arc::new(Across {
                before: before.subset(&origins),
                curves,
            }))
        });
        let known = std::mem::replace(&mut self.across, across);
        self.before_change = Some((last, known));
        let index = |before: u32| {
            let i = origins.iter().position(|o| *o == Some(before))?;
            Some(i as u32)
        };
        if let Some(pairs) = &mut self.touching_from_the_start {
            let kept = pairs.iter().filter_map(|&(i, j)| {
                let (i, j) = (index(i)?, index(j)?);
                Some((i.min(j), i.max(j)))
            });
            *pairs = kept.collect();
            pairs.sort_unstable();
        }
    }

    /// Returns the outcome of a step to a frame of other curves. The curves that appeared start
    /// with their contacts in this frame.
    fn outcome_across(&mut self, across: &Across, set: &CurveSet) -> Outcome {
        let coverage = self.coverage();
        let Across { before, curves } = across;
        let after = set.subset(curves);
        let (contacts, touched) = self.ledger.first_frame(before, coverage);
        let frames = [before, &after];
        let mut step = self.ledger.step(frames, &contacts, coverage, None);
        // It is unknown on which side the curves were that came into contact before the change.
        let began = touched.iter().map(|t| t.defect).filter(|d| {
            let index = |i: u32| curves[i as usize];
            !self.touch_from_the_start(index(d.i), d.j.map(index))
        });
        step.undecided.extend(began);
        step.undecided.sort_by_key(|d| (d.i, d.j));
        step.undecided.dedup_by_key(|d| (d.i, d.j));
        let mut outcome = step.with_curves(curves);
        let (contacts, mut touching) = self.ledger.first_frame(set, coverage);
        let pair = |t: &Touching| (t.defect.i, t.defect.j);
        let from_the_start = outcome.touching.iter().filter(|t| t.from_the_start);
        let from_the_start: Vec<_> = from_the_start.map(pair).collect();
        for t in &mut touching {
            t.from_the_start = from_the_start.contains(&pair(t));
        }
        (outcome.touching, outcome.contacts) = (touching, contacts);
        outcome
    }

    /// Adds to a complete report the last frame that is known to be intact. `unknown` is true if
    /// the step to this frame is unknown.
    pub fn conclude(&mut self, report: &mut Report, unknown: bool) {
        let undecided = std::mem::take(&mut self.undecided);
        self.intactness.conclude(report, undecided || unknown);
    }

    /// Continues with the knowledge of another verifier.
    pub fn resume(&mut self, intactness: Intactness) {
        self.intactness = intactness;
    }

    /// Returns the last frame that is known to be intact, and what happened since.
    pub fn intactness(&self) -> &Intactness {
        &self.intactness
    }

    /// Returns the largest proven share of the step from the last frame that is known to be intact,
    /// during which nothing was pulled through. `outcome` is that of the step from the last
    /// verified frame. Returns `None` if that is another one.
    pub fn safe_fraction(&mut self, set: &CurveSet, outcome: &Outcome) -> Option<f64> {
        let coverage = self.coverage();
        let last = self.last.as_ref();
        let last = last.filter(|_| self.intactness.is_intact())?;
        let frames = [&*last.set, set];
        let ledger = &mut self.ledger;
        Some(ledger.safe_fraction(frames, &last.contacts, coverage, outcome))
    }

    /// Returns the pairs that have touched since the very first frame, to roll a frame back.
    pub fn touching(&self) -> Option<Vec<Pair>> {
        self.touching_from_the_start.clone()
    }

    /// Discards what the current frame added, because it is rejected. `touching` is from before it.
    pub fn roll_back(&mut self, touching: Option<Vec<Pair>>) {
        if let Some(before) = self.before_change.take() {
            (self.last, self.across) = before;
        }
        self.touching_from_the_start = touching;
        self.contacts = Contacts::default();
        self.undecided = false;
        self.met = None;
    }

    /// Begins a frame. Fails if the curves differ from those of the previous frame, because there
    /// is no motion between different curves. If pull-throughs are not searched for, forgets that
    /// frame instead.
    pub fn begin(&mut self, set: &CurveSet) -> Result<()> {
        self.met = None;
        if self.events == Events::Off {
            self.last.take_if(|last| !last.set.same_layout(set));
            return Ok(());
        }
        let Some(before) = self.before().filter(|before| !before.same_layout(set)) else {
            return Ok(());
        };
        let curves = before.curves().iter().zip(set.curves());
        let points = curves.map(|(a, b)| ("control points of a curve", a.points, b.points));
        let bytes = [before, set].map(|set| set.precision().bytes() as u32);
        let open = [before, set].map(CurveSet::open_curves);
        let numbers = [
            ("curves", before.len() as u32, set.len() as u32),
            ("bytes of a coordinate", bytes[0], bytes[1]),
            ("open curves", open[0] as u32, open[1] as u32),
        ];
        let differs = |c: &(&str, u32, u32)| c.1 != c.2;
        let found = numbers.into_iter().chain(points).find(differs);
        // The basis is the only remaining difference.
        let basis = ("basis", before.basis() as u32, set.basis() as u32);
        let (what, before, now) = found.unwrap_or(basis);
        Err(Error::LayoutChanged {
            what,
            before: before.into(),
            now: now.into(),
        })
    }

    /// Falsifies a linking number of the previous frame, for a test.
    #[cfg(test)]
    pub fn falsify(&mut self) {
        let last = self.last.as_mut().expect("a frame before");
        last.linking
            .comparison
            .changes
            .push(crate::verdict::Change {
                i: 0,
                j: 1,
                image: Default::default(),
                expected: 1,
                found: 0,
                place: None,
            });
    }

    /// Keeps a verified frame, if the next one is compared with it.
    pub fn remember(&mut self, set: Arc<CurveSet>, linking: LinkingNumbers) {
        (self.across, self.before_change) = (None, None);
        if self.keeps_frames() {
            self.last = Some(Last {
                set,
                linking,
                contacts: std::mem::take(&mut self.contacts),
            });
        }
    }

    /// Same as [`Steps::remember`], with a copy that reuses the memory of the previous frame.
    pub fn remember_copy(&mut self, set: &CurveSet, linking: LinkingNumbers) {
        (self.across, self.before_change) = (None, None);
        if !self.keeps_frames() {
            return;
        }
        let copy = match self.last.take().map(|last| last.set) {
            Some(mut old) => {
                match Arc::get_mut(&mut old) {
                    Some(old) => old.clone_from(set),
                    None => old = Arc::new(set.clone()),
                }
                old
            }
            None => Arc::new(set.clone()),
        };
        self.remember(copy, linking);
    }

    /// Returns the outcome of the step from the previous frame, for these pairs or for all. For a
    /// first frame, the outcome has the curves that touch.
    ///
    /// # Panics
    /// If the previous frame has other curves.
    pub fn outcome(&mut self, set: &CurveSet, pairs: Option<&[Pair]>) -> Outcome {
        let coverage = self.coverage();
        if let Some(across) = self.across.clone() {
            let outcome = self.outcome_across(&across, set);
            self.undecided |= !outcome.undecided.is_empty();
            self.contacts.clone_from(&outcome.contacts);
            self.note_touching(&outcome);
            return outcome;
        }
        let Some(last) = &self.last else {
            let (contacts, touching) = self.ledger.first_frame(set, coverage);
            self.contacts = contacts;
            let outcome = Outcome {
                touching,
                ..Outcome::default()
            };
            self.note_touching(&outcome);
            return outcome;
        };
        let frames = [&*last.set, set];
        let outcome = self.ledger.step(frames, &last.contacts, coverage, pairs);
        // Noted here, because a report omits such a defect if the pair has another one.
        self.undecided |= self.events != Events::Off && !outcome.undecided.is_empty();
        self.met = (self.events != Events::Off).then(|| outcome.met_pairs().collect());
        self.contacts.clone_from(&outcome.contacts);
        self.note_touching(&outcome);
        outcome
    }

    fn note_touching(&mut self, outcome: &Outcome) {
        let still = outcome.touching.iter().filter(|t| t.from_the_start);
        let still = still.map(|t| (t.defect.i, t.defect.j.unwrap_or(t.defect.i)));
        let known = self.touching_from_the_start.take();
        let kept = still.filter(|pair| known.as_ref().is_none_or(|k| k.contains(pair)));
        self.touching_from_the_start = Some(kept.collect());
    }

    /// Returns true if these curves, or parts of this curve, have touched since the first frame.
    /// Always false for two closed curves: their baseline lacks a linking number instead.
    pub fn touch_from_the_start(&self, i: u32, j: Option<u32>) -> bool {
        let pairs = self.touching_from_the_start.as_deref().unwrap_or_default();
        j.is_some_and(|j| pairs.binary_search(&(i, j)).is_ok())
    }

    /// Adds defects of three kinds: curves that touch, pairs that are undecided in the step, and
    /// pairs whose passages contradict their linking numbers, located by `place`. Keeps only the
    /// first defect of a pair, but an undecided step is kept beside a contact.
    pub fn add_defects(
        &self,
        outcome: &Outcome,
        comparison: &Comparison,
        mut place: impl FnMut(Pair) -> Place,
        defects: &mut Vec<Defect>,
    ) {
        let touching = outcome.touching.iter().map(|t| t.defect);
        let undecided = outcome.undecided.iter().map(|d| Defect {
            kind: DefectKind::UndecidedStep,
            ..*d
        });
        let last = self.last.as_ref();
        let unaccounted = last.map(|last| outcome.check(&last.linking.comparison, comparison));
        let unaccounted = unaccounted.into_iter().flatten().map(|pair| Defect {
            i: pair.0,
            j: Some(pair.1),
            image: Default::default(),
            kind: DefectKind::Unaccounted,
            place: place(pair),
        });
        defects.extend(touching.chain(undecided).chain(unaccounted));
        // The sort is stable: earlier defects of a pair stay first.
        defects.sort_by_key(|d| (d.i, d.j));
        defects.dedup_by(|next, first| {
            // A contact in this frame does not decide what happened since the previous frame.
            let other = first.kind == DefectKind::Contact && next.kind == DefectKind::UndecidedStep;
            (next.i, next.j) == (first.i, first.j) && !other
        });
    }
}
