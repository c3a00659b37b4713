//! From one frame to the next: what passed through what, and whether that accounts for the linking numbers.

use crate::cancel::Cancel;
use crate::certificate::Comparison;
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::incremental::{Cover, Events, Ledger, Outcome};
use crate::pairs::Pair;
use crate::verdict::{Defect, DefectKind, Place};
use std::sync::Arc;

/// The last frame that was verified, and the ledger of what happens from there.
#[derive(Debug, Default)]
pub(super) struct Steps {
    events: Events,
    ledger: Ledger,
    last: Option<Last>,
}

#[derive(Debug)]
struct Last {
    set: Arc<CurveSet>,
    /// With the baseline.
    comparison: Comparison,
}

impl Steps {
    /// `cancel` ends a search for pull-throughs early.
    pub fn new(events: Events, cancel: Cancel) -> Self {
        Steps {
            events,
            ledger: Ledger::new(cancel),
            last: None,
        }
    }

    pub fn events(&self) -> Events {
        self.events
    }

    /// What the ledger looks for.
    pub fn cover(&self) -> Cover {
        Cover {
            own: self.events == Events::All,
            open: self.events != Events::Off,
        }
    }

    /// The frame before, where pull-throughs are looked for.
    pub fn before(&self) -> Option<&CurveSet> {
        self.last.as_ref().map(|last| &*last.set)
    }

    /// Between other curves there is no motion.
    pub fn check_layout(&self, set: &CurveSet) -> Result<()> {
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
        // Nothing else is left.
        let basis = ("basis", before.basis() as u32, set.basis() as u32);
        let (what, before, now) = found.unwrap_or(basis);
        Err(Error::LayoutChanged {
            what,
            before: before.into(),
            now: now.into(),
        })
    }

    /// An error, to be noticed: the frame before had another linking number.
    #[cfg(test)]
    pub fn falsify(&mut self) {
        let last = self.last.as_mut().expect("a frame before");
        last.comparison.changes.push(crate::certificate::Change {
            i: 0,
            j: 1,
            expected: 1,
            found: 0,
            place: None,
        });
    }

    /// Keeps a frame that has been verified, where the next one is compared with it.
    pub fn remember(&mut self, set: Arc<CurveSet>, comparison: Comparison) {
        if self.events != Events::Off {
            self.last = Some(Last { set, comparison });
        }
    }

    /// [`Steps::remember`] of a copy, in the memory of the one before.
    pub fn remember_copy(&mut self, set: &CurveSet, comparison: Comparison) {
        if self.events == Events::Off {
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
        self.remember(copy, comparison);
    }

    /// What happened since the frame before, of these pairs or of all; and how many pairs were searched.
    ///
    /// # Panics
    /// If there is none, or of other curves.
    pub fn outcome(&mut self, set: &CurveSet, pairs: Option<&[Pair]>) -> (Outcome, u64) {
        let cover = self.cover();
        let last = self.last.as_ref().expect("callers look for it first");
        let outcome = match pairs {
            Some([]) => Outcome::default(),
            pairs => self.ledger.step(&last.set, set, cover, pairs),
        };
        let searched = outcome.counts.pairs;
        (outcome, searched)
    }

    /// Adds what is not known of the step: pairs of which it cannot be told what they did, and those that did other
    /// things than their linking numbers say, which are at some `place`. Pairs that have a defect already are left out.
    pub fn add_defects(
        &self,
        outcome: &Outcome,
        comparison: &Comparison,
        mut place: impl FnMut(Pair) -> Place,
        defects: &mut Vec<Defect>,
    ) {
        let Some(last) = &self.last else {
            return;
        };
        let untold = outcome.undecided.iter().map(|d| Defect {
            kind: DefectKind::Untold,
            ..*d
        });
        let unaccounted = outcome.check(&last.comparison, comparison);
        let unaccounted = unaccounted.into_iter().map(|pair| Defect {
            i: pair.0,
            j: Some(pair.1),
            kind: DefectKind::Unaccounted,
            place: place(pair),
        });
        defects.extend(untold.chain(unaccounted));
        // The sort is stable: those that were there come first.
        defects.sort_by_key(|d| (d.i, d.j));
        defects.dedup_by_key(|d| (d.i, d.j));
    }
}
