//! The options `--cell` and `--wrapped` of every command that verifies or measures frames.

use super::output;
use linkwatch::{Cell, CurveSet, Error, FrameInfo, Result, Unwrap};
use std::str::FromStr;

/// Word for frames whose cell is ignored.
const NONE: &str = "none";

/// Periodic cell of the frames.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
#[command(next_help_heading = super::INPUT)]
pub struct CellArgs {
    /// Periodic cell: edges along the axes (0: does not repeat), nine numbers (three vectors) or
    /// twelve (and the corner); `none` ignores the cell of the frames [default: as the frames have
    /// it]. It may be given for files without one
    #[arg(long, value_name = "10,10,10|..|none", allow_hyphen_values = true)]
    cell: Option<GivenCell>,
    /// Coordinates are wrapped into the periodic cell: unwrap the curves, and follow them from
    /// frame to frame
    #[arg(long)]
    wrapped: bool,
}

/// Cell that the user gives.
#[derive(Clone, Copy, Debug)]
enum GivenCell {
    Of(Cell),
    None,
}

impl FromStr for GivenCell {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            NONE => Ok(GivenCell::None),
            text => text.parse().map(GivenCell::Of),
        }
    }
}

impl CellArgs {
    /// Returns true if the user gave an option.
    #[cfg(feature = "mcap")]
    pub fn are_given(&self) -> bool {
        self.cell.is_some() || self.wrapped
    }

    /// Returns true if coordinates are wrapped.
    pub fn wrapped(&self) -> bool {
        self.wrapped
    }

    /// Warns of segments that are too long for the scene or for the cell of a frame.
    pub fn warn_of_segments(&self, name: &str, curves: &CurveSet, cell: Option<Cell>) {
        match cell {
            None => output::warn_of_long_segment(name, curves),
            Some(_) if self.wrapped => {}
            Some(cell) => output::warn_of_wrapped(name, curves, &cell),
        }
    }

    /// Returns the cell of a frame: that of the user, or that of the frame.
    pub fn cell(&self, of_frame: Option<Cell>) -> Option<Cell> {
        match self.cell {
            Some(GivenCell::Of(cell)) => Some(cell),
            Some(GivenCell::None) => None,
            None => of_frame,
        }
    }
}

/// The cells of successive frames, and the unwrapping of their curves.
#[derive(Debug, Default)]
pub struct Cells {
    pub args: CellArgs,
    unwrap: Unwrap,
}

impl Cells {
    pub fn new(args: CellArgs) -> Cells {
        Cells {
            args,
            unwrap: Unwrap::default(),
        }
    }

    /// Sets the cell of a frame to that with which it is verified.
    pub fn apply(&self, info: &mut FrameInfo) {
        info.cell = self.args.cell(info.cell);
    }

    /// Returns the curves of a frame, unwrapped; `None` if they are not wrapped. They are unwrapped
    /// with the cell of the frame also if that is ignored otherwise (`--cell none`).
    ///
    /// Errors: those of [`Unwrap::unwrap`], and [`Error::Usage`] if the frame has no cell.
    pub fn unwrap(&mut self, set: &CurveSet, of_frame: Option<Cell>) -> Result<Option<CurveSet>> {
        if !self.args.wrapped {
            return Ok(None);
        }
        let none = || {
            let what = "--wrapped needs a periodic cell, but the frame has none: give it, \
                        `--cell 10,10,10` for example";
            Error::Usage(what.into())
        };
        let cell = self.args.cell(of_frame).or(of_frame);
        self.unwrap.unwrap(set, &cell.ok_or_else(none)?).map(Some)
    }
}
