//! `linkwatch convert`: rewrites the frames of model files and recordings in another format.

use super::Outcome;
use super::cell_args::CellArgs;
use super::files::{Content, Files, Overwrite, with_suffix, write_whole};
use super::input::{self, FormatArgs};
use super::motion::{Motion, cut_at_gaps};
use super::output::{self, count, plural};
use super::run::MOTION_LIMIT;
use super::sequence::Frame;
use linkwatch::formats::{Format, FrameWriter, ModelFrame, ReadOptions};
use linkwatch::{
    Basis, Certifier, CurveSet, FrameInfo, LeftOut, Result, SessionOptions, chords,
    homotopic_polylines,
};
use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// Rewrite the frames of model files or of a recording in another format
///
/// The extension of OUT determines the format. If that format holds one frame a file, and there are
/// several, the number of the frame is added to the name of each file: OUT-00000.obj, .. If the
/// curves change, the frames from there on go to a further archive: OUT.npz, OUT-2.npz, ..
#[derive(Debug, clap::Args)]
#[command(override_usage = "linkwatch convert [OPTIONS] <IN>... <OUT>")]
pub struct Args {
    /// Model files, folders or patterns of them, or a recording; and the converted file
    // Two arguments would allow no option between them.
    #[arg(required = true, value_name = "IN|OUT")]
    files: Vec<PathBuf>,
    /// Convert only the frame with this number
    #[arg(long, value_name = "SEQ")]
    frame: Option<u64>,
    /// Replace each segment of a spline by N chords, and check that the linking numbers stay the
    /// same [default: as few chords as the linking numbers of a frame need]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    chords: Option<u32>,
    /// Keep the order in which the files are given
    #[arg(long)]
    keep_order: bool,
    /// Files with several frames each continue one another: write them as one motion
    #[arg(long)]
    one_motion: bool,
    #[command(flatten)]
    format: FormatArgs,
    #[command(flatten)]
    cell_args: CellArgs,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let Some((output, inputs @ [_, ..])) = args.files.split_last() else {
        return Err(usage!("the converted file, OUT, is missing"));
    };
    let inputs = input::expand(inputs, args.keep_order)?;
    let mut files = Files::new(args.overwrite);
    files.reads(&inputs);
    files.reads(args.format.bonds(&inputs));
    let (target, content) = match input::is_mcap(output) {
        true => (None, Content::Recording),
        false => (Some(Format::to_write(output)?), Content::Model),
    };
    files.writes("OUT", [output], content)?;
    let options = ReadOptions {
        keep_order: args.keep_order,
        one_motion: args.one_motion,
        ..args.format.options(&args.cell_args)
    };
    let mut motion = Motion::new(&inputs, options)?;
    let part = motion.part;
    let is_chosen = |frame: &Result<Frame>| match (frame, args.frame) {
        (Ok(frame), Some(seq)) => frame.info.seq == seq,
        _ => true,
    };
    let mut frames = motion.by_ref().filter(is_chosen);
    let Some(first) = frames.next().transpose()? else {
        let seq = args.frame.map(|seq| format!(" {seq}"));
        return Err(usage!("the input has no frame{}", seq.unwrap_or_default()));
    };
    let second = frames.next().transpose()?;
    let numbered = second.is_some() && !target.is_none_or(Format::holds_frames);
    let mut frames = [first].into_iter().chain(second).map(Ok).chain(frames);
    let mut converter = Converter {
        target,
        chords: args.chords,
        part,
        ..Converter::default()
    };
    let mut older = Vec::new();
    if numbered {
        let mut named = numbered_files(output);
        for frame in frames {
            let frame = frame?;
            if !converter.is_valid(&frame) {
                continue;
            }
            let path = with_suffix(output, &format!("{:05}", frame.info.seq));
            files.writes("OUT", [&path], Content::Model)?;
            let mut one = std::iter::once(Ok(frame));
            write_whole(&path, args.overwrite, |part| {
                converter.write(part, &mut one)
            })?;
            named.remove(&path.file_name().map(OsStr::to_owned));
        }
        older.extend(named.into_values());
    } else {
        let mut path = output.clone();
        loop {
            write_whole(&path, args.overwrite, |part| {
                converter.write(part, &mut frames)
            })?;
            converter.files.push(path);
            let number = converter.files.len() + 1;
            path = with_suffix(output, &number.to_string());
            if converter.waiting.is_none() {
                older.extend(path.exists().then_some(path));
                break;
            }
            files.writes("OUT", [&path], content).map_err(|e| {
                let before = quoted(&converter.files);
                usage!("{e}; the frames before it are in {before}")
            })?;
        }
    }
    if let Some(first) = older.first() {
        tracing::warn!(
            "{}: not of this conversion, but named as a further file of it ({} in all)",
            first.display(),
            older.len()
        );
    }
    converter.check_frames()?;
    converter.ends_in_gap = motion.sequence.ends_in_gap();
    converter.continues = args.frame.is_none() && motion.sequence.warn_of_unfinished();
    converter.print(output, numbered, json);
    let is_whole = converter.invalid.is_empty() && converter.left_out.is_empty();
    let lost = !is_whole || converter.continues;
    Ok(Outcome::undecided_if(lost || converter.undecided))
}

/// Returns the existing files, by their names, that have the name of the output with a number.
fn numbered_files(output: &Path) -> BTreeMap<Option<OsString>, PathBuf> {
    let stem = output.with_extension("");
    let stem = glob::Pattern::escape(&stem.to_string_lossy());
    let extension = output.extension().unwrap_or_default().to_string_lossy();
    let pattern = format!("{stem}-[0-9][0-9][0-9][0-9][0-9]*.{extension}");
    let found = glob::glob(&pattern).into_iter().flatten().flatten();
    let named = found.map(|file| (file.file_name().map(OsStr::to_owned), file));
    named.collect()
}

/// Returns the names of files as arguments of a shell.
fn quoted(files: &[PathBuf]) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "_-./+=:,@%".contains(c);
    let quote = |file: &PathBuf| match file.display().to_string() {
        name if name.chars().all(is_plain) => name,
        name => format!("'{}'", name.replace('\'', r"'\''")),
    };
    files.iter().map(quote).collect::<Vec<_>>().join(" ")
}

/// Frames to convert.
type Frames<'a> = dyn Iterator<Item = Result<Frame>> + 'a;

/// A frame that is invalid, so not written.
#[derive(serde::Serialize)]
struct Invalid {
    #[serde(skip)]
    name: String,
    frame: u64,
    time: f64,
    error: String,
}

/// Conversion in progress.
#[derive(Default)]
struct Converter {
    /// Format of the output; `None` for a recording.
    target: Option<Format>,
    /// Chords per segment of a spline, if they are given.
    chords: Option<u32>,
    /// Number of the input among the files of a recorded run.
    part: Option<u32>,
    certifier: Certifier,
    /// Files written so far, unless each has one frame.
    files: Vec<PathBuf>,
    /// A frame to write. It waits for the next one, so that the last one of a file has the count of
    /// invalid frames. After a file, it is the first one of the next file.
    waiting: Option<(CurveSet, FrameInfo)>,
    frames: u64,
    invalid: Vec<Invalid>,
    /// Number of invalid frames that the files written so far count.
    counted: usize,
    /// Elements of the files that were not read.
    left_out: Vec<LeftOut>,
    /// Gaps in a recording so far, which are cuts in the output.
    gaps: Vec<LeftOut>,
    /// True if frames after the last one are not in the recording.
    ends_in_gap: bool,
    /// True if the recorded run continues after the last file.
    continues: bool,
    /// Number of frames whose cell the output cannot hold.
    lost_cells: u64,
    /// Number of cuts up to the last frame.
    cuts: Option<u32>,
    /// Number of cuts of the motion that the output cannot hold.
    lost_cuts: u64,
    /// Number of points of all frames before and after the conversion.
    points: [u64; 2],
    /// True if splines are so close that their linking numbers could not be kept for certain.
    undecided: bool,
}

impl Converter {
    /// Writes valid frames to a file, until one has other curves than the file can hold.
    fn write(&mut self, path: &Path, frames: &mut Frames<'_>) -> Result<()> {
        match self.target {
            Some(format) => {
                let mut writer = FrameWriter::create(path, format)?;
                self.convert(frames, |curves, info| {
                    writer.frame(&ModelFrame::of(info, Ok(curves)))
                })?;
                writer.finish()
            }
            None => {
                use linkwatch::{RecordingSink, Sink};
                let limit = SessionOptions::MOTION_LIMIT.to_string();
                let metadata = BTreeMap::from([(MOTION_LIMIT.to_owned(), limit)]);
                let mut sink = RecordingSink::create(path, &metadata)?;
                self.convert(frames, |curves, info| sink.curves(&curves, &info))?;
                Box::new(sink).finish()
            }
        }
    }

    /// Converts the valid frames of a file, and passes them to `write`.
    fn convert(
        &mut self,
        frames: &mut Frames<'_>,
        mut write: impl FnMut(CurveSet, FrameInfo) -> Result<()>,
    ) -> Result<()> {
        for frame in frames {
            let mut frame = frame?;
            cut_at_gaps(&mut frame, &mut self.gaps);
            if !self.is_valid(&frame) {
                continue;
            }
            let info = frame.info;
            LeftOut::merge(&mut self.left_out, &info.left_out);
            let is_cut = self.cuts.replace(info.cuts).is_some_and(|n| n != info.cuts);
            if is_cut && !self.target.is_none_or(Format::holds_cuts) {
                if self.lost_cuts == 0 {
                    tracing::warn!(
                        "{}: the motion is cut before this frame, which the output cannot hold: \
                         its step may be taken for a pull-through; write .npz or .mcap",
                        frame.name
                    );
                }
                self.lost_cuts += 1;
            }
            let holds_cells = self.target.is_none_or(Format::holds_cells);
            if let Some(cell) = info.cell.filter(|_| !holds_cells) {
                if self.lost_cells == 0 {
                    tracing::warn!(
                        "{}: the output cannot hold its periodic cell, which is lost; give it with \
                         the curves (`--cell {cell}`), or write .npz or .mcap",
                        frame.name
                    );
                }
                self.lost_cells += 1;
            }
            let mut curves = frame.curves?;
            self.points[0] += curves.points() as u64;
            let keeps_splines =
                self.chords.is_none() && self.target.is_none_or(Format::holds_splines);
            if curves.basis() != Basis::Polyline && !keeps_splines {
                curves = self.polylines(&frame.name, &curves)?;
            }
            self.points[1] += curves.points() as u64;
            self.frames += 1;
            let begins_file = self.begins_file(&curves, &info);
            if let Some((curves, info)) = self.waiting.replace((curves, info)) {
                let info = self.with_invalid(info);
                write(curves, info)?;
            }
            if begins_file {
                return Ok(());
            }
        }
        if let Some((curves, info)) = self.waiting.take() {
            let info = self.with_invalid(info);
            write(curves, info)?;
        }
        self.check_frames()
    }

    /// Returns true if a frame belongs to the next file, because curves came, went or changed: an
    /// archive of NumPy holds the same curves in all frames.
    fn begins_file(&self, curves: &CurveSet, info: &FrameInfo) -> bool {
        let Some((last, last_info)) = &self.waiting else {
            return false;
        };
        let kind = |set: &CurveSet| (set.basis(), set.precision());
        let (labels, known) = (&info.labels, &last_info.labels);
        let is_same = last.counts().eq(curves.counts())
            && kind(last) == kind(curves)
            && labels.names == known.names
            && labels.radii.len() == known.radii.len();
        self.target == Some(Format::Npz) && !is_same
    }

    /// Adds the invalid frames that no file counts yet to the skipped elements, so that the output
    /// counts as incomplete.
    fn with_invalid(&mut self, mut info: FrameInfo) -> FrameInfo {
        let new = &self.invalid[std::mem::replace(&mut self.counted, self.invalid.len())..];
        if let Some(first) = new.first() {
            let (count, kind) = (new.len(), ["invalid frame", "invalid frames"]);
            info.left_out
                .push(LeftOut::new(count as u64, kind, &first.name));
        }
        info
    }

    /// Returns true if a frame is valid. Otherwise reports that it is skipped.
    fn is_valid(&mut self, frame: &Frame) -> bool {
        if let Err(e) = &frame.curves {
            tracing::error!("{}: left out: {e}", frame.name);
            self.invalid.push(Invalid {
                name: frame.name.clone(),
                frame: frame.info.seq,
                time: frame.info.time,
                error: e.to_string(),
            });
        }
        frame.curves.is_ok()
    }

    /// Fails if no frame was written.
    fn check_frames(&self) -> Result<()> {
        let any = (self.frames > 0).then_some(());
        any.ok_or_else(|| usage!("the input has no valid frame"))
    }

    /// Replaces splines by polylines with the same linking numbers.
    fn polylines(&mut self, name: &str, splines: &CurveSet) -> Result<CurveSet> {
        let curves = match self.chords {
            Some(n) => chords(splines, n as usize)?,
            None => homotopic_polylines(splines)?.curves,
        };
        let expected = self.certifier.certify(splines).0.clone();
        let found = self.certifier.certify(&curves).0;
        if let Some(change) = found.compare(&expected)?.changes.first() {
            let (i, j, before, after) = (change.i, change.j, change.expected, change.found);
            return Err(usage!(
                "{name}: as polylines, curves {i} and {j} have the linking number {after} instead \
                 of {before}: give more --chords"
            ));
        }
        if !expected.undefined.is_empty() && !self.undecided {
            let pairs = plural(expected.undefined.len(), "pair of curves");
            tracing::warn!("{name}: {pairs} without a linking number, which may get another one");
            self.undecided = true;
        }
        Ok(curves)
    }

    /// Prints the result.
    fn print(&self, path: &Path, numbered: bool, json: bool) {
        let [before, after] = self.points;
        if json {
            output::json(&serde_json::json!({
                "output": path.to_string_lossy(),
                "files": self.files.iter().map(|file| file.to_string_lossy()).collect::<Vec<_>>(),
                "numbered": numbered,
                "frames": self.frames,
                "invalid": self.invalid.len(),
                "invalid_frames": self.invalid,
                "left_out": self.left_out,
                "lost_cells": self.lost_cells,
                "lost_cuts": self.lost_cuts,
                "part": self.part,
                "ends_in_gap": self.ends_in_gap,
                "continues": self.continues,
                "points": after,
                "points_before": before,
            }));
            return;
        }
        let files = if numbered { " (numbered files)" } else { "" };
        let frames = plural(self.frames, "frame");
        let points = plural(after, "point");
        let before = match before == after {
            true => String::new(),
            false => format!(", {} before", count(before)),
        };
        out!("{}{files}: {frames}, {points}{before}", path.display());
        if self.files.len() > 1 {
            let (count, files) = (self.files.len(), quoted(&self.files));
            out!(
                "  the curves or names change, so there are {count} files: check them with \
                 `linkwatch check {files} --one-motion`"
            );
        }
        if self.lost_cells > 0 {
            let cells = plural(self.lost_cells, "frame");
            out!("  lost: the periodic cell of {cells}");
        }
        if self.lost_cuts > 0 {
            out!("  lost: {}", plural(self.lost_cuts, "cut"));
        }
        if !self.invalid.is_empty() {
            out!(
                "  left out: {}",
                plural(self.invalid.len(), "invalid frame")
            );
        }
        if !self.left_out.is_empty() {
            out!("  {}", LeftOut::sentence(&self.left_out));
        }
    }
}
