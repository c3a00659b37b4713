//! Frames of files for commands that consider each frame alone: the option `--frame`.

use super::cell_args::{CellArgs, Cells};
use super::input::{self, FileFrames, FormatArgs};
use super::{Outcome, output};
use crate::verdict::words_of_frame;
use linkwatch::formats::{ModelFrame, ReadOptions, name_of};
use linkwatch::{Cell, CurveSet, Error, LeftOut, Result, period};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Models whose frames are considered one by one.
#[derive(Clone, Debug, clap::Args)]
pub struct FrameArgs {
    /// Models, folders of them, recordings, or scenes as `linkwatch generate` takes them
    #[arg(required = true, value_name = "MODEL|SCENE")]
    models: Vec<PathBuf>,
    /// Frames of files with several: one by its number, those of a range of numbers (`3..9`, with
    /// both ends), `last` or `all` [default: all]
    #[arg(
        long, help_heading = super::INPUT, value_name = "SEQ|FROM..TO|last|all",
        value_parser = selection
    )]
    frame: Option<Selection>,
    #[command(flatten)]
    pub format: FormatArgs,
    #[command(flatten)]
    pub cell_args: CellArgs,
}

/// Frames to take of a file with several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Selection {
    #[default]
    All,
    Last,
    /// Frames with numbers in a range, both ends included.
    Numbers(u64, u64),
}

/// Parses the frames to take.
fn selection(text: &str) -> Result<Selection, &'static str> {
    let (from, to) = text.split_once("..").unwrap_or((text, text));
    match (text, from.trim().parse(), to.trim().parse()) {
        ("all", ..) => Ok(Selection::All),
        ("last", ..) => Ok(Selection::Last),
        (_, Ok(from), Ok(to)) if from <= to => Ok(Selection::Numbers(from, to)),
        _ => Err(
            "expected the number of a frame (28), a range of numbers from low to high \
                  (3..9), `last` or `all`",
        ),
    }
}

impl FrameArgs {
    /// Returns the scenes, and the files of each model.
    pub fn models(&self) -> Result<Vec<Vec<PathBuf>>> {
        let files = input::expand_models(&self.models)?;
        input::groups(&files, self.format.format.as_deref())
    }

    /// Opens each model, and calls `run` for the frames that are chosen. Returns the worst outcome.
    /// A model that fails does not keep the others from their results: the first error is returned,
    /// and others are logged. `single` is the option that takes one frame of a model, if there is
    /// one.
    pub fn for_each(
        &self,
        models: &[Vec<PathBuf>],
        single: Option<&str>,
        mut run: impl FnMut(Picked) -> Result<Outcome>,
    ) -> Result<Outcome> {
        let mut outcome = Outcome::Fine;
        let mut failed = None;
        let options = self.format.options(&self.cell_args);
        for files in models {
            let selected = Selected::open(files, self, &options);
            match selected.and_then(|frames| frames.each(single, &mut run)) {
                Ok(of_model) => outcome = outcome.max(of_model),
                Err(e) if failed.is_none() => failed = Some(e),
                Err(e) => tracing::error!("{e}"),
            }
        }
        failed.map_or(Ok(outcome), Err)
    }
}

/// A frame of an argument, with the curves and the cell that the user chose.
pub struct Picked {
    /// The argument.
    pub model: PathBuf,
    /// The argument; with the number and the time of the frame, if several frames are read or this
    /// one was chosen.
    pub name: String,
    pub curves: CurveSet,
    /// Radii of the curves, or none.
    pub radii: Vec<f32>,
    /// Number of the frame, if the file may have several.
    pub number: Option<u64>,
    /// Simulation time of the frame in seconds, if the file may have several.
    pub time: Option<f64>,
    /// Periodic cell of the frame, if it has one.
    pub cell: Option<Cell>,
    /// Elements of the file that may be curves of this frame, and were not read.
    pub left_out: Vec<LeftOut>,
    /// Number of curves that are closed because they end where they start.
    pub joined: usize,
    /// True for the first frame of the argument, with which the user is warned of the scene.
    pub is_first: bool,
    /// True if several frames of the argument are chosen.
    pub several: bool,
}

impl Picked {
    /// Prints results about the frame as one line of JSON.
    pub fn print_json(&self, results: Value) {
        let model = self.model.to_string_lossy();
        let frame = json!({ "model": model, "frame": self.number, "time": self.time });
        output::json(&output::joined(&frame, results));
    }

    /// Returns the first curve that runs through the periodic cell, if one does.
    pub fn yarn(&self) -> Option<usize> {
        let (set, cell) = (&self.curves, self.cell.as_ref()?);
        (0..set.len()).find(|&i| period(set, i, cell).is_some())
    }

    /// Returns the error of a frame without closed curves.
    pub fn nothing_closed(&self) -> Error {
        let (curves, yarns) = (self.curves.len(), 0);
        Error::NothingClosed { curves, yarns }
    }
}

/// The chosen frames of an argument: a model file, a recording, or a scene. They are read one by
/// one; memory holds two of them.
struct Selected {
    path: PathBuf,
    selection: Selection,
    frames: FileFrames,
    /// True if all chosen frames were read.
    ended: bool,
    /// Number of the last frame that was read, for a range of numbers.
    last: Option<u64>,
    /// True if the file may have several frames.
    numbered: bool,
    /// True if several frames are chosen.
    several: bool,
    /// Elements that were not read, of which the user knows.
    left_out: Vec<LeftOut>,
    /// Decides for all frames which curves are closed.
    cells: Cells,
}

impl Selected {
    /// Opens a model file if the argument has the extension of one or names an existing file.
    /// Otherwise builds the scene that the argument describes.
    fn open(files: &[PathBuf], args: &FrameArgs, options: &ReadOptions) -> Result<Selected> {
        Ok(Selected {
            path: name_of(files),
            selection: args.frame.unwrap_or_default(),
            frames: input::open_or_build(files, options)?,
            ended: false,
            last: None,
            numbered: input::are_numbered(files, options, true),
            several: false,
            left_out: Vec::new(),
            cells: Cells::new(CellArgs::of(options)),
        })
    }

    /// Calls `run` for each chosen frame, and returns the worst outcome. Frames that are invalid,
    /// and a file that cannot be read to its end, are logged; they are no success.
    ///
    /// # Errors
    ///
    /// No chosen frame is valid; several frames are chosen and the option `single` takes one; and
    /// those of `run`.
    fn each(
        mut self,
        single: Option<&str>,
        run: &mut impl FnMut(Picked) -> Result<Outcome>,
    ) -> Result<Outcome> {
        let refuse = |path: &Path, what: &str| Err(usage!("{}: {what}", path.display()));
        let ahead: Vec<_> = std::iter::from_fn(|| self.read()).take(2).collect();
        self.several = ahead.len() > 1;
        if let Some(option) = single.filter(|_| self.several) {
            let what = "the file has several frames, and";
            let what = format!("{what} {option} takes one: choose it with --frame");
            return refuse(&self.path, &what);
        }
        if ahead.is_empty() {
            let what = match self.selection {
                Selection::Numbers(n, to) if n == to => format!("no frame {n}"),
                Selection::Numbers(from, to) => format!("no frame from {from} to {to}"),
                _ => "no frame".into(),
            };
            return refuse(&self.path, &what);
        }
        let mut ahead = ahead.into_iter();
        let (mut outcome, mut valid) = (Outcome::Fine, false);
        while let Some(frame) = ahead.next().or_else(|| self.read()) {
            let frame = match frame {
                Ok(frame) => frame,
                // The valid frames before this error keep their results; the file was cut off, for
                // example.
                Err(e) if valid => {
                    tracing::error!("{e}");
                    outcome = outcome.max(Outcome::Undecided);
                    continue;
                }
                Err(e) => return Err(e),
            };
            let name = self.name(&frame);
            match self.pick(frame, !valid) {
                Ok(picked) => {
                    valid = true;
                    outcome = outcome.max(Outcome::undecided_if(!picked.left_out.is_empty()));
                    outcome = outcome.max(run(picked)?);
                }
                Err(e) if !self.several => return Err(e.in_file(&self.path)),
                Err(e) => {
                    tracing::error!("{name}: {e}");
                    outcome = outcome.max(Outcome::Undecided);
                }
            }
        }
        if let Some(next) = self.frames.continues_in() {
            tracing::info!("{}: the run continues in {next}", self.path.display());
        }
        match valid {
            true => Ok(outcome),
            false => refuse(&self.path, "no valid frame"),
        }
    }

    /// Reads the next chosen frame.
    fn read(&mut self) -> Option<Result<ModelFrame>> {
        if self.selection == Selection::Last && !self.ended {
            return self.read_last();
        }
        while !self.ended {
            let Some(frame) = self.frames.next() else {
                break;
            };
            let (Selection::Numbers(from, to), Ok(read)) = (self.selection, &frame) else {
                return Some(frame);
            };
            // Numbers increase.
            let seq = read.info.seq;
            (self.ended, self.last) = (seq >= to, Some(seq));
            match frame {
                Ok(read) if !(from..=to).contains(&seq) => self.cells.pass(read),
                frame => return Some(frame),
            }
        }
        if !std::mem::replace(&mut self.ended, true)
            && let (Selection::Numbers(_, to), Some(last)) = (self.selection, self.last)
        {
            let path = self.path.display();
            tracing::warn!("{path}: no frame {to}: the last one is {last}");
        }
        None
    }

    /// Reads all frames, and returns the last one.
    fn read_last(&mut self) -> Option<Result<ModelFrame>> {
        self.ended = true;
        let mut last = None;
        for frame in &mut self.frames {
            match frame {
                Ok(frame) => {
                    if let Some(before) = last.replace(frame) {
                        self.cells.pass(before);
                    }
                }
                Err(e) if last.is_none() => return Some(Err(e)),
                Err(e) => {
                    tracing::warn!("{e}; the last frame before that is used");
                    break;
                }
            }
        }
        last.map(Ok)
    }

    fn name(&self, frame: &ModelFrame) -> String {
        let path = self.path.display();
        if !self.several && (!self.numbered || self.selection == Selection::All) {
            return path.to_string();
        }
        let words = words_of_frame(frame.info.seq, frame.info.time);
        format!("{path}, {words}")
    }

    /// Returns a frame with the cell that the user chose, and unwrapped curves.
    fn pick(&mut self, frame: ModelFrame, is_first: bool) -> Result<Picked> {
        let name = self.name(&frame);
        let (args, of_frame) = (self.cells.args, frame.info.cell);
        let set = self.cells.closed(frame.curves?, &frame.info)?;
        let mut left_out = frame.info.left_out.clone();
        left_out.extend(self.cells.say(&name));
        input::warn_of_new(&self.path, &mut self.left_out, &frame.info.left_out);
        let cell = args.cell(of_frame);
        let set = Cells::new(args).unwrap(set, of_frame)?;
        // Otherwise the curves may be torn at the boundary of the cell.
        if let (Some(cell), None) = (&cell, args.wrapped) {
            set.check_whole(cell)?;
        }
        Ok(Picked {
            model: self.path.clone(),
            name,
            curves: set,
            radii: frame.info.labels.radii.clone(),
            number: self.numbered.then_some(frame.info.seq),
            time: self.numbered.then_some(frame.info.time),
            cell,
            left_out,
            joined: self.cells.joined(),
            is_first,
            several: self.several,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_selection_is_a_number_a_range_the_last_frame_or_all() {
        for (text, expected) in [
            ("all", Selection::All),
            ("last", Selection::Last),
            ("28", Selection::Numbers(28, 28)),
            ("3..9", Selection::Numbers(3, 9)),
        ] {
            assert_eq!(selection(text), Ok(expected));
        }
        for bad in ["", "first", "9..3", "1..", "-1", "1.5"] {
            assert!(selection(bad).is_err(), "{bad}");
        }
    }
}
