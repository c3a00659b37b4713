//! Sessions that begin with a frame, beside the state of the frames before it.

use super::coordinates::Coordinates;
use super::{Next, Session};
use crate::curve::Cell;
use crate::engine::{Engine, EngineState, SessionOptions};
use crate::error::{Error, Result};
use crate::ingest::FrameInfo;

/// How a session begins with a frame.
#[derive(Clone, Copy)]
pub(super) enum Begin<'a> {
    /// With the baseline and the braids of the options.
    First,
    /// As its own baseline.
    Accepted,
    /// As a part of a run with this baseline.
    Part,
    /// After another session.
    Resumed(&'a EngineState),
}

/// State of a session that begins with a frame.
pub(super) struct Begun {
    pub engine: Engine,
    pub coordinates: Coordinates,
}

impl Begun {
    pub fn new(session: &Session, begin: Begin<'_>, info: &FrameInfo) -> Result<Begun> {
        let Session {
            options,
            engine,
            next,
            ..
        } = session;
        let part = match next {
            Next::Part(baseline) => Some(baseline),
            _ => None,
        };
        let mut options = SessionOptions {
            cell: info.cell,
            ..options.clone()
        };
        match begin {
            Begin::First => {}
            Begin::Accepted => options.baseline = None,
            Begin::Part => {
                options.baseline = part.cloned();
                options.braids = engine.braids().or(options.braids);
            }
            Begin::Resumed(state) => options = state.options(options)?,
        }
        let mut begun = Engine::new(options)?;
        begun.share_progress(engine.progress());
        if let Begin::Part = begin {
            begun.continue_after(engine);
        }
        Ok(Begun {
            engine: begun,
            coordinates: session.coordinates.restarted(),
        })
    }
}

/// Returns the cell of a frame in the basis of that of the last one, in which findings name images.
///
/// # Errors
///
/// The errors of [`Cell::check`]; [`Error::Usage`] if only one of both frames has a cell, or
/// they repeat along other vectors.
pub(super) fn check_cell(cell: Option<Cell>, last: Option<Option<Cell>>) -> Result<Option<Cell>> {
    let refuse = |what: &str| Err(Error::Usage(what.into()));
    if let Some(cell) = &cell {
        cell.check()?;
    }
    match (cell, last) {
        (cell, None) | (cell @ None, Some(None)) => Ok(cell),
        (Some(_), Some(None)) => {
            refuse("this frame has a periodic cell, but the previous ones had none")
        }
        (None, Some(Some(_))) => {
            refuse("this frame has no periodic cell, but the previous ones had one")
        }
        (Some(cell), Some(Some(last))) if cell.periodic() != last.periodic() => {
            refuse("the cell repeats along other vectors than before")
        }
        (Some(cell), Some(Some(last))) => Ok(Some(cell.in_basis_of(&last))),
    }
}
