//! State of an engine after a verified frame.

use super::intactness::Intactness;
use crate::certificate::{Certificate, Comparison};
use crate::curve::{CurveChange, CurveSet, Frame, Precision};
use crate::diagram::HigherInvariants;
use crate::error::{Error, Result};
use crate::incremental::{Contacts, Events};
use crate::pairs::{Pair, PairFilter, sorted};
use crate::scene::{BraidScene, CellScene, ComparedYarns};
use std::sync::Arc;

/// All state on which the reports on later frames depend. A copy is cheap.
#[derive(Clone, Debug, Default)]
pub(super) struct Known {
    /// Baseline that the caller gave. Moved to the fields below in the first frame.
    pub given: Option<Arc<Certificate>>,
    /// Expected linking numbers of the curves that the engine verifies: those of a frame with its
    /// images, or the loops of braids.
    pub baseline: Option<Arc<Certificate>>,
    /// Expected linking numbers of all curves, numbered as in reports, if this differs from
    /// `baseline`; and the `baseline` from which they were made.
    pub joined: Option<(Arc<Certificate>, Arc<Certificate>)>,
    /// Last verified frame, if the next frame continues it.
    pub last: Option<Arc<Last>>,
    /// Last verified frame, if curves appeared or disappeared after it; `last` is then `None`.
    pub across: Option<Arc<Across>>,
    /// Expected invariants of curves and of triples, if they are compared, from the first frame on.
    pub higher: Arc<Vec<HigherInvariants>>,
    /// Pairs that have touched in every frame since the first one, sorted, except pairs of closed
    /// curves. `None` before the first frame.
    pub touching: Option<Arc<Vec<Pair>>>,
    pub intactness: Intactness,
    /// Reason why pull-throughs in the step to the next frame are unknown, if they are.
    pub unknown_step: Option<String>,
    /// Extent of the first frame.
    pub extent: Option<f64>,
    /// Periodic images of the curves, if the scene has a cell.
    pub cell: Option<CellScene>,
    /// Loops that close the strands of braids, from the first frame on.
    pub braids: Option<BraidScene>,
}

/// A verified frame.
#[derive(Clone, Debug)]
pub(super) struct Last {
    pub frame: Frame,
    pub linking: LinkingNumbers,
    pub contacts: Contacts,
}

/// Previous frame with other curves: only the curves that still exist, in the order of the current
/// frame.
#[derive(Debug)]
pub(super) struct Across {
    pub before: CurveSet,
    /// Indices of these curves in the current frame, ascending.
    pub curves: Vec<u32>,
}

/// Linking numbers of a frame.
#[derive(Clone, Debug)]
pub(super) struct LinkingNumbers {
    /// Comparison with the baseline.
    pub comparison: Comparison,
    /// All linking numbers, if later frames are verified incrementally.
    pub certificate: Option<Arc<Certificate>>,
}

impl Last {
    /// Returns the frame with the curves and images of `scene` instead of those of `earlier`, or
    /// `None` if `pair` has no new numbers for a pair with a finding.
    fn renamed(
        &self,
        earlier: &CellScene,
        scene: &CellScene,
        pair: impl Fn(Pair) -> Option<Pair> + Copy,
    ) -> Option<Last> {
        let Last { frame, linking, .. } = self;
        let origins = scene.origins(earlier, frame.given().len());
        let certificate = linking.certificate.as_ref();
        Some(Last {
            frame: scene.frame(frame.given(), *frame.cell()?),
            linking: LinkingNumbers {
                comparison: linking.comparison.renamed(pair)?,
                certificate: certificate.map(|c| Arc::new(c.with_curves(&origins))),
            },
            contacts: self.contacts.renamed(pair)?,
        })
    }
}

impl Known {
    /// Returns all expected linking numbers.
    pub fn joined(&self) -> Option<&Arc<Certificate>> {
        let joined = self.joined.as_ref().map(|(joined, _)| joined);
        joined.or(self.baseline.as_ref())
    }

    /// Forgets the last frame, because the next one does not continue it.
    pub fn cut(&mut self) {
        (self.last, self.across, self.unknown_step) = (None, None, None);
        self.intactness.cut();
        if let Some(scene) = &mut self.cell {
            scene.cut();
        }
    }

    /// Returns the state before a first frame with the same expectations, whatever images of the
    /// curves that frame has; `None` if the scene has no cell.
    pub fn before_alignment(&self) -> Option<Known> {
        self.cell.as_ref()?;
        Some(Known {
            given: self.joined().cloned(),
            higher: Arc::clone(&self.higher),
            intactness: self.intactness,
            extent: self.extent,
            cell: Some(CellScene::default()),
            ..Known::default()
        })
    }

    /// Returns an error if the baseline has another number of curves than the frame.
    pub fn check_number(&self, curves: usize) -> Result<()> {
        let baseline = self.given.as_ref().or(self.joined());
        match baseline.filter(|baseline| baseline.curves != curves) {
            Some(baseline) => Err(Error::CertificateMismatch {
                certificate: baseline.curves,
                model: curves,
            }),
            None => Ok(()),
        }
    }

    /// Sets the expected linking numbers: `all` as in reports, `own` those of the curves that the
    /// engine verifies.
    pub fn expect(&mut self, all: Arc<Certificate>, own: Certificate) {
        let own = Arc::new(own);
        self.baseline = Some(Arc::clone(&own));
        self.joined = Some((all, own));
    }

    /// Updates the expected linking numbers in the numbering of reports, if they changed. `given`
    /// is the number of curves without images.
    pub fn join(&mut self, given: usize, yarns: &ComparedYarns) {
        let Some(baseline) = &self.baseline else {
            return;
        };
        let same = |known: &(_, Arc<Certificate>)| Arc::ptr_eq(&known.1, baseline);
        if self.joined.as_ref().is_some_and(same) && yarns.adopted.is_empty() {
            return;
        }
        let joined = match (&self.cell, &self.braids) {
            (Some(scene), _) => scene.joined(baseline, given, &yarns.defects),
            (_, Some(scene)) => scene.joined(baseline),
            _ => return,
        };
        self.joined = Some((Arc::new(joined), Arc::clone(baseline)));
    }

    /// Returns the curves of a frame with the loops of the braids, if there are braids, and a text
    /// on the condition of the braids that the frame breaks, if it does.
    ///
    /// # Errors
    ///
    /// The errors of [`BraidScene::follow`].
    pub fn close_braids(
        &mut self,
        given: &Arc<CurveSet>,
    ) -> Result<(Arc<CurveSet>, Option<String>)> {
        let Some(scene) = &mut self.braids else {
            return Ok((Arc::clone(given), None));
        };
        let (curves, broken) = scene.follow(given)?;
        let broken = broken.map(|why| format!("braids are not verified: {why}"));
        Ok((curves, broken))
    }

    /// Returns true if the frame breaks a condition of the braids.
    pub fn has_broken_braids(&self) -> bool {
        self.braids.as_ref().is_some_and(|braids| braids.is_broken)
    }

    /// Returns the pairs that are verified; `None`: all.
    pub fn filter(&self) -> Option<PairFilter> {
        let of_braids = self.braids.as_ref().map(BraidScene::filter);
        of_braids.or_else(|| self.cell.as_ref()?.filter())
    }

    /// Renumbers the state from the curves and images of `earlier` to those of `scene`. Adds a text
    /// to `missing` if the last frame cannot be renumbered.
    pub fn rename(&mut self, earlier: &CellScene, scene: &CellScene, missing: &mut Vec<String>) {
        if let Some((joined, _)) = self.joined.take() {
            let own = scene.expected(&joined);
            self.expect(joined, own);
        }
        let curve = scene.renamed(earlier);
        let renamed = |(a, b): Pair| Some((curve(a)?, curve(b)?));
        if let Some(touching) = &mut self.touching {
            let pairs = touching.iter().filter_map(|&pair| renamed(pair));
            *touching = Arc::new(sorted(pairs));
        }
        let Some(last) = self.last.take() else {
            return;
        };
        self.last = last.renamed(earlier, scene, renamed).map(Arc::new);
        if self.last.is_none() {
            // Does not happen, because all pairs that touch are among the images of both scenes.
            let what = "other images came near while some touched: passages through this contact \
                        may be missing";
            missing.push(what.into());
        }
    }

    /// Converts the last frame from single to double precision if the curves of the next frame have
    /// double precision.
    pub fn widen_to(&mut self, curves: &CurveSet) -> Result<()> {
        let (Some(scene), Some(last)) = (&mut self.cell, &self.last) else {
            return Ok(());
        };
        let before = last.frame.given().precision();
        if (before, curves.precision()) == (Precision::F32, Precision::F64) {
            scene.widen()?;
            self.last = Some(Arc::new(Last {
                frame: last.frame.widened()?,
                ..Last::clone(last)
            }));
        }
        Ok(())
    }

    /// Prepares a step to a frame after curves appeared or disappeared. Pull-throughs are searched
    /// for among the curves that still exist with the same number of points. Returns the curves
    /// that appeared or became closed, if there is a baseline that must get their linking numbers.
    ///
    /// # Errors
    ///
    /// [`Error::CertificateMismatch`] if the baseline has another number of curves than the
    /// change.
    pub fn change_curves(
        &mut self,
        change: &CurveChange,
        set: &CurveSet,
        events: Events,
    ) -> Result<Vec<u32>> {
        let origins = &change.origins;
        self.check_number(change.before)?;
        let mut appeared = Vec::new();
        if let Some(baseline) = &mut self.baseline {
            *baseline = Arc::new(baseline.with_curves(&change.expected));
            let all = (0_u32..).zip(&change.expected);
            appeared.extend(all.filter(|(_, o)| o.is_none()).map(|(i, _)| i));
        }
        let higher = self.higher.iter();
        let higher = higher.map(|of| of.with_curves(&change.expected));
        self.higher = Arc::new(higher.collect());
        let last = self.last.take().filter(|_| events != Events::Off);
        self.across = last.and_then(|last| {
            let before = &**last.frame.given();
            let kind = |set: &CurveSet| (set.basis(), set.precision());
            if kind(before) != kind(set) {
                let what = "pull-throughs: the basis or the precision is not that of the previous \
                            frame";
                self.unknown_step = Some(what.into());
                return None;
            }
            self.unknown_step = change.words_of_unsearched();
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
        if self.unknown_step.is_none() {
            // Also if the step is not searched, there are no numbers to compare with.
            self.unknown_step = change.words_of_closed();
        }
        if let Some(pairs) = &mut self.touching {
            let index = |before: u32| {
                let i = origins.iter().position(|o| *o == Some(before))?;
                Some(i as u32)
            };
            let kept = pairs.iter().filter_map(|&(i, j)| {
                let (i, j) = (index(i)?, index(j)?);
                Some((i.min(j), i.max(j)))
            });
            *pairs = Arc::new(sorted(kept));
        }
        Ok(appeared)
    }

    /// Returns true if these two curves, or two parts of one curve, have touched since the first
    /// frame. Always false for two closed curves, for which the baseline has no linking number
    /// instead.
    pub fn touch_from_the_start(&self, i: u32, j: Option<u32>) -> bool {
        let known = self.touching.as_ref().zip(j);
        known.is_some_and(|(pairs, j)| pairs.binary_search(&(i, j)).is_ok())
    }
}
