//! Coordinates of curves in a periodic cell: unwrapped, and translated if curves jump by a lattice
//! vector.

use crate::curve::{Cell, CurveSet, Image, Precision};
use crate::error::{Error, Result};
use crate::ingest::FrameInfo;
use crate::periodic::{Jumps, Unwrap};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Makes the coordinates of successive frames continuous across the boundary of the periodic cell.
#[derive(Debug, Default)]
pub(super) struct Coordinates {
    /// State after the last verified frame.
    pub state: CoordinateState,
    /// State of the unwrapping after the current frame, until that frame is verified.
    unwrapped: Option<Unwrap>,
    /// Curves of the last verified frame with these coordinates, and its cell.
    pub last: Option<(Arc<CurveSet>, Option<Cell>)>,
}

/// State after a verified frame.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct CoordinateState {
    unwrap: Unwrap,
    jumps: Jumps,
    /// Number of jumps before this session was restarted.
    earlier: u64,
}

impl Coordinates {
    /// Returns the state before a first frame.
    pub fn restarted(&self) -> Coordinates {
        let mut restarted = Coordinates::default();
        restarted.state.earlier = self.jumps();
        restarted
    }

    /// Returns the curves that are translated to another image, with their translations.
    pub fn translated(&self) -> Vec<(u32, Image)> {
        self.state.jumps.translated()
    }

    /// Returns the number of jumps so far.
    pub fn jumps(&self) -> u64 {
        self.state.earlier + self.state.jumps.count()
    }

    /// Returns the curves of a frame where they are verified. `info` has the cell with which they
    /// are; `of_frame` is also that of a frame whose images are not verified. `wrapped` is
    /// [`SessionOptions::wrapped`](crate::SessionOptions::wrapped). If the frame does not continue
    /// the last one (`cut`), wrapped curves begin at any of their images.
    ///
    /// # Errors
    ///
    /// The errors of [`Unwrap::unwrap`], and [`Error::Usage`] if a frame of wrapped coordinates
    /// has no cell.
    pub fn place(
        &mut self,
        given: &Arc<CurveSet>,
        info: &FrameInfo,
        of_frame: Option<Cell>,
        wrapped: Option<bool>,
        cut: bool,
    ) -> Result<Arc<CurveSet>> {
        let cell = info.cell;
        let placed = match (wrapped, cell) {
            (Some(true), _) => {
                let none = "wrapped coordinates need a periodic cell, but the frame has none";
                let cell = cell.or(of_frame).ok_or_else(|| Error::Usage(none.into()))?;
                let mut unwrap = match cut {
                    true => Unwrap::default(),
                    false => self.state.unwrap.clone(),
                };
                let curves = unwrap.unwrap(given, &cell)?;
                self.unwrapped = Some(unwrap);
                Some(curves)
            }
            (None, Some(cell)) => {
                let last = self.last.as_ref();
                let last = last.and_then(|(set, cell)| Some((&**set, (*cell)?)));
                self.state
                    .jumps
                    .follow(given, &cell, last, &info.translated)?
            }
            _ => None,
        };
        let last = self.last.as_ref().map(|(set, _)| set.precision());
        let set = placed.map_or_else(|| Arc::clone(given), Arc::new);
        match (last, set.precision()) {
            // Once a curve was translated, frames have double precision.
            (Some(Precision::F64), Precision::F32) if cell.is_some() => set.widened().map(Arc::new),
            _ => Ok(set),
        }
    }

    /// Makes the current frame the last one. `placed` has the coordinates at which it was verified.
    pub fn commit(&mut self, placed: &Arc<CurveSet>, cell: Option<Cell>) {
        if let Some(unwrap) = self.unwrapped.take() {
            self.state.unwrap = unwrap;
        }
        self.state.jumps.commit();
        self.last = Some((Arc::clone(placed), cell));
    }
}
