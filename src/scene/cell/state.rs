//! State of a periodic scene, from which another process continues.

use super::{Before, CellScene};
use crate::curve::{Cell, CurveSet, Image, Precision};
use crate::error::Result;
use crate::periodic::{Boxer, ImagePairs, ImageState};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// State of a scene, from which another process continues.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct CellState {
    /// Period of each curve that runs through the cell.
    periods: Vec<Option<Image>>,
    /// True if the first frame was in single precision.
    began_single: bool,
    images: Option<ImageState>,
}

impl CellScene {
    /// Returns the state after the last frame.
    pub fn state(&self) -> CellState {
        CellState {
            periods: self.yarns.periods().to_vec(),
            began_single: self.yarns.precision == Some(Precision::F32),
            images: self.found.as_ref().map(|found| found.pairs.state.clone()),
        }
    }

    /// Continues after a frame, without the expected linking numbers.
    ///
    /// # Errors
    ///
    /// The errors of [`Boxer::new`].
    pub fn restored(state: CellState, given: &Arc<CurveSet>, cell: Cell) -> Result<CellScene> {
        let mut scene = CellScene::default();
        let periods: Arc<[Option<Image>]> = state.periods.into();
        let images = state.images;
        let found = images.map(|images| scene.know(given, ImagePairs::restored(images, &periods)));
        let boxer = Boxer::new(given, &cell)?;
        scene.before = Some(Before {
            given: Arc::clone(given),
            cell,
            slack: found.map_or([0.0; 3], |pairs| pairs.slack(&boxer)),
        });
        let precision = match state.began_single {
            true => Precision::F32,
            false => given.precision(),
        };
        scene.yarns.begin(periods, precision);
        Ok(scene)
    }
}
