//! First frames of a session or of a part of a run, verified by a new engine beside the current
//! one.

use super::Session;
use crate::certificate::Certificate;
use crate::curve::Cell;
use crate::engine::{Engine, EngineState};
use crate::error::{Error, Result};
use crate::ingest::FrameInfo;

/// How a session begins with a frame.
#[derive(Clone, Copy)]
pub(super) enum Begin<'a> {
    /// The first frame. The options have the baseline and the braids.
    First,
    /// The frame is its own baseline.
    Accepted,
    /// The frame begins a part of a run with this baseline.
    Part(&'a PartBaseline),
    /// The frame follows the last frame of another session.
    Resumed(&'a EngineState),
}

/// Baseline of a part of a run.
#[derive(Debug)]
pub(super) struct PartBaseline {
    pub certificate: Certificate,
    /// True if it numbers images as the frames do.
    pub names_images: bool,
}

impl Begin<'_> {
    /// Returns the engine that verifies the frame in place of that of the session.
    pub fn engine(self, session: &Session, info: &FrameInfo) -> Result<Engine> {
        let mut options = session.options.clone();
        options.cell = info.cell;
        match self {
            Begin::First => {}
            Begin::Accepted => options.baseline = None,
            Begin::Part(baseline) => {
                options.baseline = Some(baseline.certificate.clone());
                options.braids = session.engine.braids().or(options.braids);
            }
            Begin::Resumed(state) => options = state.options(options)?,
        }
        let mut engine = Engine::new(options)?;
        engine.share_progress(session.engine.progress());
        if let Begin::Part(baseline) = self {
            engine.continue_after(&session.engine, baseline.names_images);
        }
        Ok(engine)
    }
}

/// Returns the cell of a frame, expressed in the lattice basis of the cell of the last frame,
/// because findings name images in that basis.
///
/// # Errors
///
/// The errors of [`Cell::check`]; [`Error::Usage`] if only one of both frames has a cell, or
/// they repeat along other vectors.
pub(super) fn check_cell(cell: Option<Cell>, last: Option<Option<Cell>>) -> Result<Option<Cell>> {
    cell.as_ref().map_or(Ok(()), Cell::check)?;
    let what = match (cell, last) {
        (cell, None) | (cell @ None, Some(None)) => return Ok(cell),
        (Some(cell), Some(Some(last))) if cell.periodic() == last.periodic() => {
            return Ok(Some(cell.in_basis_of(&last)));
        }
        (Some(_), Some(None)) => "this frame has a periodic cell, but the previous ones had none",
        (None, Some(Some(_))) => "this frame has no periodic cell, but the previous ones had one",
        (Some(_), Some(Some(_))) => "the cell repeats along other vectors than before",
    };
    Err(Error::Usage(what.into()))
}
