//! Positions at which the curves of a frame are verified: unwrapped, and followed if they jump by a
//! lattice vector.

use crate::curve::{Cell, CurveSet, Precision};
use crate::error::{Error, Result};
use crate::periodic::{Jumps, Unwrap};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Follows the curves of successive frames through the periodic cell.
#[derive(Debug, Default)]
pub(super) struct Coordinates {
    /// [`SessionOptions::wrapped`](crate::SessionOptions::wrapped).
    wrapped: Option<bool>,
    /// State after the last verified frame, and after the current one.
    unwrap: Unwrap,
    unwrapped: Option<Unwrap>,
    jumps: Jumps,
    /// Number of jumps before this session began again.
    earlier: u64,
    /// Last verified frame, where it was verified.
    last: Option<Arc<CurveSet>>,
}

/// State after a verified frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct CoordinateState {
    unwrap: Unwrap,
    jumps: Jumps,
    earlier: u64,
}

impl Coordinates {
    pub fn new(wrapped: Option<bool>) -> Coordinates {
        Coordinates {
            wrapped,
            ..Coordinates::default()
        }
    }

    /// Returns the state before a first frame.
    pub fn restarted(&self) -> Coordinates {
        Coordinates {
            earlier: self.jumps(),
            ..Coordinates::new(self.wrapped)
        }
    }

    /// Returns the last verified frame, where it was verified.
    pub fn last(&self) -> Option<&Arc<CurveSet>> {
        self.last.as_ref()
    }

    /// Returns the state after the last verified frame.
    pub fn state(&self) -> CoordinateState {
        CoordinateState {
            unwrap: self.unwrap.clone(),
            jumps: self.jumps.clone(),
            earlier: self.earlier,
        }
    }

    /// Continues from a state and its frame.
    pub fn resume(&mut self, state: CoordinateState, last: Arc<CurveSet>) {
        (self.unwrap, self.jumps) = (state.unwrap, state.jumps);
        (self.earlier, self.last) = (state.earlier, Some(last));
    }

    /// Returns the number of jumps so far.
    pub fn jumps(&self) -> u64 {
        self.earlier + self.jumps.count()
    }

    /// Returns the curves of a frame where they are verified. `cell` is the one with which they
    /// are; `of_frame` also that of a frame whose images are not verified.
    ///
    /// # Errors
    ///
    /// The errors of [`Unwrap::unwrap`], and [`Error::Usage`] if a frame of wrapped coordinates
    /// has no cell.
    pub fn place(
        &mut self,
        given: &Arc<CurveSet>,
        cell: Option<Cell>,
        of_frame: Option<Cell>,
    ) -> Result<Arc<CurveSet>> {
        let placed = match (self.wrapped, cell) {
            (Some(true), _) => {
                let none = || {
                    let what = "wrapped coordinates need a periodic cell, but the frame has none";
                    Error::Usage(what.into())
                };
                let cell = cell.or(of_frame).ok_or_else(none)?;
                let mut unwrap = self.unwrap.clone();
                let curves = unwrap.unwrap(given, &cell)?;
                self.unwrapped = Some(unwrap);
                Some(curves)
            }
            (None, Some(cell)) => self.jumps.follow(given, &cell, self.last.as_deref())?,
            _ => None,
        };
        let precision = |set: &CurveSet| set.precision();
        let last = self.last.as_deref().map(precision);
        let set = placed.map_or_else(|| Arc::clone(given), Arc::new);
        match (last, set.precision()) {
            // Curves that were followed have double precision.
            (Some(Precision::F64), Precision::F32) if cell.is_some() => set.widened().map(Arc::new),
            _ => Ok(set),
        }
    }

    /// Continues from the current frame, where it was verified.
    pub fn commit(&mut self, placed: &Arc<CurveSet>) {
        if let Some(unwrap) = self.unwrapped.take() {
            self.unwrap = unwrap;
        }
        self.jumps.commit();
        self.last = Some(Arc::clone(placed));
    }
}
