//! State of an engine, from which another process continues.

use super::intactness::Intactness;
use super::known::Last;
use super::{Engine, SessionOptions};
use crate::certificate::Certificate;
use crate::curve::{Cell, CurveSet, Frame, StoredCurves};
use crate::diagram::HigherInvariants;
use crate::discretize::Braids;
use crate::error::{Error, Result};
use crate::incremental::{Contacts, Events};
use crate::pairs::Pair;
use crate::pool;
use crate::scene::{BraidScene, CellScene, CellState};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// State of an engine after a verified frame, without the curves of that frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct EngineState {
    /// All expected linking numbers.
    baseline: Arc<Certificate>,
    /// Braids, as JSON, with all values that were derived from the first frame, and that frame.
    braids: Option<(String, StoredCurves)>,
    higher: Arc<Vec<HigherInvariants>>,
    intactness: Intactness,
    extent: Option<f64>,
    /// True if the next frame continues the last one.
    continues: bool,
    unknown_step: Option<String>,
    /// Periodic images, if the scene has a cell.
    cell: Option<CellState>,
    /// Pairs of the curves that are verified that have touched since the first frame, and their
    /// contacts.
    touching: Option<Arc<Vec<Pair>>>,
    contacts: Contacts,
}

impl EngineState {
    /// Forgets the last frame, and records `why`. `last_intact` is the last frame that is known to
    /// be intact; `intact` is true if it was the last verified one.
    pub fn forget_last_frame(&mut self, last_intact: Option<u64>, intact: bool, why: String) {
        self.continues = false;
        self.intactness.doubt(last_intact, intact);
        self.unknown_step = Some(why);
    }

    /// Returns these options with the baseline and the braids of the state.
    pub fn options(&self, options: SessionOptions) -> Result<SessionOptions> {
        let braids = self.braids.as_ref();
        let braids = braids.map(|(json, _)| Braids::from_json(json));
        Ok(SessionOptions {
            baseline: None,
            braids: braids.transpose()?,
            ..options
        })
    }
}

impl Engine {
    /// Returns the state after the last verified frame; `None` before the first one.
    pub fn state(&self) -> Option<EngineState> {
        let known = &self.known;
        let last = known.last.as_deref();
        Some(EngineState {
            baseline: Arc::clone(known.joined()?),
            braids: known.braids.as_ref().map(|scene| {
                let (braids, first) = scene.braids();
                (braids.to_json(), StoredCurves(Arc::clone(first)))
            }),
            higher: Arc::clone(&known.higher),
            intactness: known.intactness,
            extent: known.extent,
            continues: last.is_some(),
            unknown_step: known.unknown_step.clone(),
            cell: known.cell.as_ref().map(CellScene::state),
            touching: known.touching.clone(),
            contacts: last.map_or_else(Contacts::default, |last| last.contacts.clone()),
        })
    }

    /// Continues after these curves, the last verified frame, with the options of
    /// [`EngineState::options`].
    ///
    /// # Errors
    ///
    /// [`Error::CertificateMismatch`] if the state has other curves; those of
    /// [`Engine::verify`].
    pub fn resume(
        &mut self,
        state: EngineState,
        curves: &Arc<CurveSet>,
        cell: Option<Cell>,
    ) -> Result<()> {
        let (certificate, model) = (state.baseline.curves, curves.len());
        if certificate != model {
            return Err(Error::CertificateMismatch { certificate, model });
        }
        self.begin_frame();
        let mut known = self.known.clone();
        (known.intactness, known.extent) = (state.intactness, state.extent);
        known.higher = state.higher;
        let searches = self.steps.events != Events::Off;
        known.unknown_step = state.unknown_step.filter(|_| searches);
        let mut frame = Frame::new(curves, None, None);
        let other = || Error::Usage("the state is of other curves, or of another cell".into());
        if known.cell.is_some() {
            let (cell, scene) = cell.zip(state.cell).ok_or_else(other)?;
            let mut scene = CellScene::restored(scene, curves, cell)?;
            scene.expect(&state.baseline);
            frame = scene.frame(curves, cell);
            self.set_filter(scene.filter());
            let own = scene.expected(&state.baseline);
            known.expect(Arc::clone(&state.baseline), own);
            known.cell = Some(scene);
        }
        if let (Some(braids), Some((_, first))) = (&self.options.braids, &state.braids) {
            let mut scene = BraidScene::new(braids, &first.0)?;
            self.set_filter(Some(scene.filter()));
            let own = scene.expected(&state.baseline);
            known.expect(Arc::clone(&state.baseline), own);
            frame = Frame::new(&scene.follow(curves)?.0, None, None);
            known.braids = Some(scene);
        }
        let baseline = known.baseline.get_or_insert(state.baseline);
        known.touching = state.touching;
        if state.continues {
            let set = frame.set()?;
            pool::run(set.segments(), || self.full.certify(set));
            self.full.progress.check()?;
            let comparison = self.full.certificate.compare(baseline)?;
            known.last = Some(Arc::new(Last {
                frame,
                linking: self.linking_of_full_run(comparison),
                contacts: state.contacts,
            }));
        }
        self.known = known;
        Ok(())
    }
}
