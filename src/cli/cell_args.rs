//! The options `--cell`, `--wrapped` and `--keep-open` of every command that reads frames.

use super::output::plural_of;
use linkwatch::formats::{ModelFrame, ReadOptions};
use linkwatch::{
    Cell, Closing, ClosingKind, ClosingNote, CurveSet, CurveSource, FrameInfo, LeftOut, Result,
    Unwrap,
};
use std::fmt;

/// The options --keep-open and --wrapped=false in the metadata of a recording. Frames with
/// `--wrapped` are recorded unwrapped.
pub const KEEP_OPEN: &str = "keep_open";
pub const WRAPPED: &str = "wrapped";

/// Word for frames whose cell is ignored.
const NONE: &str = "none";

/// Periodic cell of the frames.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
#[command(next_help_heading = super::INPUT)]
pub struct CellArg {
    /// Periodic cell, instead of that of the frames
    ///
    /// Edges along the axes (0: does not repeat), nine numbers (three vectors) or twelve (and the
    /// corner); `none` ignores the cell of the frames
    #[arg(
        long, value_name = "10,10,10|..|none", allow_hyphen_values = true,
        value_parser = given_cell
    )]
    cell: Option<GivenCell>,
}

impl CellArg {
    /// Returns the cell that the user gave, or else the cell of the frame.
    pub fn cell(&self, of_frame: Option<Cell>) -> Option<Cell> {
        self.cell.unwrap_or(of_frame)
    }
}

/// Periodic cell of the frames, and the ends of their curves.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
#[command(next_help_heading = super::INPUT)]
pub struct CellArgs {
    #[command(flatten)]
    cell: CellArg,
    /// Coordinates are wrapped into the cell: unwrap them
    ///
    /// Curves are followed from frame to frame. `--wrapped=false`: take the coordinates as they
    /// are, without a search for torn curves and for curves that jump by a lattice vector
    #[arg(
        long, value_name = "true|false", num_args = 0..=1, require_equals = true,
        default_missing_value = "true", hide_possible_values = true
    )]
    pub wrapped: Option<bool>,
    /// Keep curves open that end where they start
    ///
    /// Otherwise they are closed, without the repeated point
    #[arg(long)]
    pub keep_open: bool,
}

/// Cell that the user gives; `None` ignores that of the frame.
type GivenCell = Option<Cell>;

/// Parses a cell, or `none`.
fn given_cell(text: &str) -> Result<GivenCell> {
    (text != NONE).then(|| text.parse()).transpose()
}

impl CellArgs {
    /// Returns the options that a reader has. Curves stay open, too, if `--closed=false` says so.
    pub fn of(options: &ReadOptions) -> CellArgs {
        CellArgs {
            cell: CellArg { cell: options.cell },
            wrapped: options.wrapped,
            keep_open: options.keep_open || options.closed == Some(false),
        }
    }

    /// Returns true if the user gave an option.
    pub fn are_given(&self) -> bool {
        self.given().is_some() || self.wrapped.is_some()
    }

    /// Warns if the coordinates of curves look wrapped into a periodic cell: segments span more
    /// than half of the scene, or are too long for the cell of the frame.
    pub fn warn_of_segments(&self, name: &str, curves: &CurveSet, cell: Option<Cell>) {
        if let Some(cell) = cell {
            if self.wrapped.is_none()
                && let Err(why) = Unwrap::default().unwrap(curves, &cell)
            {
                tracing::warn!(
                    "{name}: {why}; if the coordinates are wrapped into the cell, give --wrapped: \
                     otherwise the curves are taken as they are"
                );
            }
        } else if let Some(long) = curves.long_segment() {
            let others = match long.count {
                1 => String::new(),
                n => format!(", and so do {}", plural_of(n - 1, "other", "others")),
            };
            tracing::warn!(
                "{name}: {long}{others}; if the box is periodic and the coordinates are wrapped \
                 into it, links across its boundary are not detected: give --cell and --wrapped"
            );
        }
    }

    /// Returns the cell that the user gave; `Some(None)` ignores those of the frames.
    pub fn given(&self) -> Option<Option<Cell>> {
        self.cell.cell
    }

    /// Returns true if the cells of the frames are ignored.
    pub fn ignores_cells(&self) -> bool {
        matches!(self.cell.cell, Some(None))
    }

    /// Returns the cell that the user gave, or else the cell of the frame.
    pub fn cell(&self, of_frame: Option<Cell>) -> Option<Cell> {
        self.cell.cell(of_frame)
    }
}

/// The cells of successive frames, which curves are closed, and their unwrapping.
#[derive(Debug, Default)]
pub struct Cells {
    pub args: CellArgs,
    unwrap: Unwrap,
    closing: Closing,
    /// Layout of the last frame.
    layout: u32,
}

impl Cells {
    pub fn new(args: CellArgs) -> Cells {
        Cells {
            args,
            closing: Closing::new(args.keep_open),
            ..Cells::default()
        }
    }

    fn is_wrapped(&self) -> bool {
        self.args.wrapped == Some(true)
    }

    /// Returns the number of curves that are closed because they end where they start.
    pub fn joined(&self) -> usize {
        self.closing.joined()
    }

    /// Returns the curves of a frame with those closed that end where they start.
    ///
    /// # Errors
    ///
    /// The errors of [`Closing::close`].
    pub fn closed(&mut self, set: CurveSet, info: &FrameInfo) -> Result<CurveSet> {
        if std::mem::replace(&mut self.layout, info.layout) != info.layout {
            self.closing.forget();
        }
        let wrapped = self.is_wrapped();
        let of_frame = info.cell.filter(|_| wrapped);
        let source = CurveSource {
            cell: self.args.cell(info.cell).or(of_frame),
            wrapped,
            closed_by_default: info.closed_by_default,
        };
        Ok(self.closing.of_set(&set, source)?.unwrap_or(set))
    }

    /// Considers a frame that is not used: the first one decides which curves are closed.
    pub fn pass(&mut self, frame: ModelFrame) {
        let _ = frame.curves.and_then(|set| self.closed(set, &frame.info));
    }

    /// Returns the curves of a frame that was read, closed and unwrapped.
    pub fn settle(&mut self, set: CurveSet, info: &FrameInfo) -> Result<CurveSet> {
        let set = self.closed(set, info)?;
        self.unwrap(set, info.cell)
    }

    /// Prints once which curves were closed or stay open. Returns the curves that may be meant to
    /// be closed, but cannot be.
    pub fn say(&mut self, name: &dyn fmt::Display) -> Vec<LeftOut> {
        let notes = self.closing.take_notes();
        say(name, &notes);
        notes.iter().filter_map(ClosingNote::left_out).collect()
    }

    /// Returns the curves of a frame, unwrapped if they are wrapped. They are unwrapped with the
    /// cell of the frame also if that is ignored otherwise (`--cell none`).
    ///
    /// # Errors
    ///
    /// The errors of [`Unwrap::unwrap`], and [`Error::Usage`] if the frame has no cell.
    pub fn unwrap(&mut self, set: CurveSet, of_frame: Option<Cell>) -> Result<CurveSet> {
        if !self.is_wrapped() {
            return Ok(set);
        }
        let Some(cell) = self.args.cell(of_frame).or(of_frame) else {
            return Err(usage!(
                "--wrapped needs a periodic cell, but the frame has none: give it, `--cell \
                 10,10,10` for example"
            ));
        };
        self.unwrap.unwrap(&set, &cell)
    }
}

/// Prints which curves were closed or stay open.
pub fn say(name: &dyn fmt::Display, notes: &[ClosingNote]) {
    for note in notes {
        match note.kind {
            ClosingKind::Joined => {
                tracing::info!("{name}: {note}; --keep-open keeps such curves open");
            }
            ClosingKind::Opened => tracing::warn!(
                "{name}: {note}; a column closed:L:1 of extended XYZ, or --counts, decides"
            ),
            ClosingKind::Long => tracing::warn!(
                "{name}: {note} Open chains have a positive count, or F in a column closed:L:1"
            ),
            ClosingKind::Corner => {
                tracing::warn!("{name}: {note}; --keep-open takes it as an open curve");
            }
        }
    }
}
