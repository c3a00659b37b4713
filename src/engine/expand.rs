//! The scene of a frame: changes of the curves, what the first frame decides, and images.

use super::known::Known;
use super::{Engine, Next, Strategy};
use crate::certificate::Certificate;
use crate::curve::{Cell, Frame};
use crate::error::{Error, Result};
use crate::incremental::{Events, Work};
use crate::pool;
use crate::scene::{BraidScene, CellScene, ComparedYarns, Search};
use std::sync::Arc;

impl Engine {
    /// Applies the change of the curves before this frame. Returns the curves that appeared.
    ///
    /// # Errors
    ///
    /// [`Error::CertificateMismatch`] if the baseline has another number of curves than the
    /// change; [`Error::Count`] if this frame has.
    pub(super) fn apply_change(&mut self, known: &mut Known, next: Next<'_>) -> Result<Vec<u32>> {
        let Some(change) = next.change else {
            return Ok(Vec::new());
        };
        if self.options.braids.is_some() {
            let what = "curves appeared, are gone or have another order, but braids need the same \
                        curves in all frames";
            return Err(Error::Braid(what.into()));
        }
        if next.cell.is_some() {
            let what = "curves appeared, are gone or have another order, but a periodic scene \
                        needs the same curves in all frames";
            return Err(Error::Usage(what.into()));
        }
        let origins = &change.origins;
        if origins.len() != next.curves.len() {
            return Err(Error::Count {
                what: "curves of a frame after a change",
                promised: origins.len() as u64,
                available: next.curves.len() as u64,
            });
        }
        self.set_filter(self.full.search.filter.clone());
        known.change_curves(change, next.curves, self.steps.events)
    }

    /// Prepares the first frame: splits a given baseline into the parts that are verified
    /// separately, and closes the strands of braids to loops.
    pub(super) fn begin_baseline(&mut self, known: &mut Known, next: Next<'_>) -> Result<()> {
        let has_images = known.given.as_ref().map(|given| given.images.is_some());
        match (has_images, next.cell) {
            (Some(true), None) => {
                let what = "the baseline is of a periodic scene, but the frame has no cell";
                return Err(Error::Usage(what.into()));
            }
            (Some(false), Some(_)) => {
                let what = "the baseline is not of a periodic scene, but the frame has a cell: \
                            make one with the cell";
                return Err(Error::Usage(what.into()));
            }
            (_, Some(cell)) if !self.names_images => self.align_baseline(known, next, cell)?,
            _ => {}
        }
        if let (Some(braids), None) = (&self.options.braids, &known.braids) {
            let scene = BraidScene::new(braids, next.curves)?;
            self.set_filter(Some(scene.filter()));
            known.braids = Some(scene);
        }
        if next.cell.is_none()
            && let Some(given) = known.given.take()
        {
            match &known.braids {
                Some(scene) => {
                    let own = scene.expected(&given);
                    known.expect(given, own);
                }
                None => known.baseline = Some(given),
            }
        }
        Ok(())
    }

    /// Renumbers the images of a given baseline: its run may have started with other images of the
    /// curves than this one.
    fn align_baseline(&mut self, known: &mut Known, next: Next<'_>, cell: Cell) -> Result<()> {
        let (Some(given), Some(scene)) = (known.given.clone(), &mut known.cell) else {
            return Ok(());
        };
        // Computes the linking numbers of this frame, to find the renumbering.
        scene.find_yarns(next.curves, &cell);
        let search = self.image_search();
        let followed = scene.follow(next.curves, &cell, None, None, search)?;
        let mut scene = scene.clone();
        self.set_filter(scene.filter());
        let set = Arc::clone(followed.frame.set()?);
        self.full.heed_cancel(false);
        pool::run(set.segments(), || self.full.certify(&set));
        self.full.progress.check()?;
        self.full.heed_cancel(true);
        scene.compare_yarns(&followed.frame, None, None, false)?;
        let frame = scene.joined(&self.full.certificate, next.curves.len(), &[]);
        known.given = Some(Arc::new(Certificate {
            periods: frame.periods.clone(),
            ..given.aligned_with(&frame)?
        }));
        // Resets the images, so that the next search also finds those of the baseline.
        known.cell = Some(CellScene::default());
        Ok(())
    }

    pub(super) fn image_search(&self) -> Search {
        Search {
            // Open curves have no linking numbers.
            open_too: self.steps.events != Events::Off,
            most: self.full.progress.limit.most(),
            check_torn: self.options.wrapped.is_none(),
            paranoid: self.options.strategy == Strategy::Paranoid,
        }
    }

    /// Returns the frame with the periodic images that may meet its curves, and true if it is
    /// quiet: proven to have the linking numbers of the reference frame. If the set of images
    /// differs from that of the previous frame, renumbers the state ([`Known::rename`]).
    pub(super) fn expand(
        &mut self,
        known: &mut Known,
        next: Next<'_>,
        missing: &mut Vec<String>,
    ) -> Result<(Frame, bool)> {
        let mut quiet = self.survey(known, next);
        let (Some(cell), Some(earlier)) = (next.cell, known.cell.take()) else {
            return Ok((Frame::new(next.curves, None, None), quiet));
        };
        let mut scene = earlier.clone();
        missing.extend(scene.find_yarns(next.curves, &cell));
        if let Some(given) = known.given.take() {
            scene.expect(&given);
            // The second value, the linking numbers with these images, is set once the images are
            // known.
            known.joined = Some((given, Arc::default()));
        }
        let bounds = self.monitor.quiet_bounds(next.curves).filter(|_| quiet);
        let search = self.image_search();
        let expected = known.joined.as_ref().map(|(joined, _)| &**joined);
        let followed = scene.follow(next.curves, &cell, bounds.as_ref(), expected, search)?;
        if followed.others {
            self.set_filter(scene.filter());
            self.work = Work::default();
            quiet = false;
            known.rename(&earlier, &scene, missing);
        }
        if followed.disagreed {
            self.disagree();
        }
        known.cell = Some(scene);
        Ok((followed.frame, quiet))
    }

    /// Compares the frame with the reference frame. Returns true if it is quiet.
    fn survey(&mut self, known: &Known, next: Next<'_>) -> bool {
        let baseline = known.baseline.as_ref().filter(|_| next.change.is_none());
        let Some(baseline) = baseline.filter(|_| self.options.strategy.is_incremental()) else {
            return false;
        };
        let before = known.last.as_deref().map(|last| &last.frame);
        let (cell, work) = (next.cell.as_ref(), &mut self.work);
        self.monitor
            .is_quiet(before, next.curves, cell, baseline, work)
    }

    /// Compares the linking numbers of pairs of a closed curve and a yarn (a curve that runs
    /// through the periodic cell), if there are any.
    pub(super) fn compare_yarns(
        &mut self,
        known: &mut Known,
        frame: &Frame,
    ) -> Result<ComparedYarns> {
        let Some(scene) = &mut known.cell else {
            known.join(frame.given().len(), &ComparedYarns::default());
            return Ok(ComparedYarns::default());
        };
        let incremental = self.options.strategy.is_incremental();
        let last = known.last.as_deref().filter(|_| incremental);
        let before = last.map(|last| &last.frame);
        let check = self.options.strategy == Strategy::Paranoid;
        let yarns = scene.compare_yarns(frame, before, self.steps.met.as_deref(), check)?;
        if yarns.disagreed {
            self.disagree();
        }
        known.join(frame.given().len(), &yarns);
        Ok(yarns)
    }
}
