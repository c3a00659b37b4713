//! Source of frames of `replay` and `play`: a recording, or a model file with one or several
//! frames.

use super::input::{self, FormatArgs};
use super::range::Range;
use super::sequence::{self, Sequence};
use crate::formats::container::truncated;
use linkwatch::{
    BaselineRecord, CurveSet, Ending, Error, FrameInfo, Positions, Precision, RawFrame,
    RecordedFrame, RecordedItem, RecordedVerdict, RecordingReader, Result,
};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Maximum wait for a blocked sink or standard output. After that, frames or lines are dropped and
/// counted.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// Reader of recordings.
pub type Recording = RecordingReader<BufReader<File>>;

/// A frame to replay.
pub struct Frame {
    pub seq: u64,
    /// Simulation time in seconds.
    pub time: f64,
    pub info: FrameInfo,
    /// Time at which the frame was received, in nanoseconds since 1970; `None` for a model.
    #[cfg_attr(
        not(feature = "bus"),
        expect(dead_code, reason = "the pace of frames that are published")
    )]
    pub received_ns: Option<u64>,
    /// True if the frame does not belong to the motion of the frames before it.
    pub begins_run: bool,
    curves: Curves,
}

enum Curves {
    Recorded(RecordedFrame),
    Model(Result<CurveSet>),
}

impl Frame {
    /// Calls `receive` with the curves.
    ///
    /// Errors: those of `receive`; the frame has no valid curves.
    pub fn read(self, receive: impl FnOnce(RawFrame<'_>) -> Result<()>) -> Result<()> {
        let set = match self.curves {
            Curves::Recorded(frame) => return frame.read(receive),
            Curves::Model(curves) => curves?,
        };
        let counts: Vec<i32> = set.counts().collect();
        let mut bytes = Vec::new();
        set.write_positions(&mut bytes);
        let frame = |positions| RawFrame {
            basis: set.basis(),
            counts: &counts,
            positions,
        };
        match set.precision() {
            Precision::F32 => {
                let values: Vec<f32> = values(&bytes, f32::from_le_bytes);
                receive(frame(Positions::F32(&values)))
            }
            Precision::F64 => {
                let values: Vec<f64> = values(&bytes, f64::from_le_bytes);
                receive(frame(Positions::F64(&values)))
            }
        }
    }

    /// Fails if the frame begins another run, for options that follow one.
    pub fn check_one_run(&self) -> Result<()> {
        match self.begins_run {
            false => Ok(()),
            true => Err(Error::Usage(format!(
                "frame {} is the first one of another file with several frames: give one file",
                self.seq
            ))),
        }
    }

    /// Returns the curves.
    pub fn curves(self) -> Result<CurveSet> {
        match self.curves {
            Curves::Recorded(frame) => {
                let mut set = None;
                frame.ingest(&mut set)?;
                Ok(set.expect("the frame was copied"))
            }
            Curves::Model(curves) => curves,
        }
    }
}

impl From<RecordedFrame> for Frame {
    fn from(frame: RecordedFrame) -> Frame {
        Frame {
            seq: frame.seq,
            time: frame.time,
            info: frame.info.clone(),
            received_ns: Some(frame.received_ns),
            begins_run: false,
            curves: Curves::Recorded(frame),
        }
    }
}

impl From<sequence::Frame> for Frame {
    fn from(frame: sequence::Frame) -> Frame {
        Frame {
            seq: frame.seq,
            time: frame.time,
            info: frame.info,
            received_ns: None,
            begins_run: frame.begins_run,
            curves: Curves::Model(frame.curves),
        }
    }
}

fn values<T, const N: usize>(bytes: &[u8], parse: fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks().0.iter().map(|b| parse(*b)).collect()
}

/// An item of a source.
pub enum Item {
    Baseline(BaselineRecord),
    Frame(Box<Frame>),
    Verdict(Box<RecordedVerdict>),
}

/// A recording, or model files.
pub struct Source {
    path: PathBuf,
    input: Input,
    /// True if a frame lacks elements of its file.
    lacks_curves: bool,
}

enum Input {
    Recording(Box<Recording>),
    Models(Box<Sequence>),
}

impl Source {
    /// Opens a recording, a model file, a folder or a pattern of model files. `wrapped` is true if
    /// the user says whether coordinates are wrapped.
    pub fn open(path: &Path, wrapped: bool) -> Result<Source> {
        let input = match input::is_recording(path)? {
            true => {
                let reader = RecordingReader::open(path).map_err(|e| e.in_file(path))?;
                Input::Recording(Box::new(reader))
            }
            false => {
                let files = input::expand(&[path.to_owned()], false)?;
                let format = FormatArgs::default().wrapped(wrapped);
                Input::Models(Box::new(Sequence::new(files, &format, false)))
            }
        };
        Ok(Source {
            path: path.into(),
            input,
            lacks_curves: false,
        })
    }

    /// Returns the recording, if it is one. Its errors do not name the file.
    pub fn recording(&mut self) -> Option<&mut Recording> {
        match &mut self.input {
            Input::Recording(reader) => Some(reader),
            Input::Models(_) => None,
        }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the noun for the file: "recording" or "file".
    pub fn noun(&self) -> &'static str {
        match self.input {
            Input::Recording(_) => "recording",
            Input::Models(_) => "file",
        }
    }

    /// Returns the next item, or `None` at the end. Errors name the file.
    pub fn next(&mut self) -> Result<Option<Item>> {
        let item = match &mut self.input {
            Input::Models(models) => {
                let frame = models.next().transpose()?;
                frame.map(|frame| Item::Frame(Box::new(frame.into())))
            }
            Input::Recording(reader) => {
                let item = reader.next_item().map_err(|e| e.in_file(&self.path))?;
                item.map(|item| match item {
                    RecordedItem::Baseline(baseline) => Item::Baseline(baseline),
                    RecordedItem::Frame(frame) => Item::Frame(Box::new(frame.into())),
                    RecordedItem::Verdict(verdict) => Item::Verdict(verdict),
                })
            }
        };
        if let Some(Item::Frame(frame)) = &item {
            self.lacks_curves |= !frame.info.left_out.is_empty();
        }
        Ok(item)
    }

    /// Goes to the first frame or verdict of a range, if the file allows to skip those before it:
    /// it is a recording whose frames are in order. Returns the number of frames that were skipped.
    pub fn go_to_start(&mut self, range: &Range) -> Result<Option<usize>> {
        let Input::Recording(reader) = &mut self.input else {
            return Ok(None);
        };
        let in_file = |e: Error| e.in_file(&self.path);
        let outline = reader.outline().map_err(in_file)?;
        let mut frames = outline.frames.iter();
        let skipped = frames.position(|f| !range.is_after(f.seq, f.time));
        let Some(skipped) = skipped else {
            // At the end of the file. A last verdict may have no frame.
            let last = outline.frames.last();
            if let Some(last) = last {
                let what = "no frame in this range; the last one of the recording is frame";
                tracing::warn!("{}: {what} {}", self.path.display(), last.seq);
                reader.go_to(last).map_err(in_file)?;
            }
            return Ok(last.map(|_| outline.frames.len() - 1));
        };
        let mut start = &outline.frames[skipped];
        let mut verdicts = outline.verdicts.iter().map(|verdict| &verdict.at);
        if let Some(verdict) = verdicts.find(|v| !range.is_after(v.seq, v.time))
            && verdict.is_before(start)
        {
            start = verdict;
        }
        reader.go_to(start).map_err(in_file)?;
        Ok(Some(skipped))
    }

    /// Returns what is known about the recorded run; nothing for a model file. Complete once the
    /// first item was read.
    pub fn metadata(&self) -> BTreeMap<String, String> {
        match &self.input {
            Input::Recording(reader) => reader.metadata().clone(),
            Input::Models(_) => BTreeMap::new(),
        }
    }

    /// Returns true if a frame that was read lacks elements of its file.
    pub fn lacks_curves(&self) -> bool {
        self.lacks_curves
    }

    /// Returns the end of a recording, once it is reached.
    pub fn ending(&self) -> Option<&Ending> {
        match &self.input {
            Input::Recording(reader) => reader.ending(),
            Input::Models(_) => None,
        }
    }
}

/// Warns of a recording that was cut off, with its end if that was reached. Returns true if it was.
pub fn warn_of_cut(path: &Path, ending: Option<&Ending>) -> bool {
    let Some(Ending::Cut { at, what }) = ending else {
        return false;
    };
    tracing::warn!(
        "{}: {}; the complete frames were replayed",
        path.display(),
        truncated(*at, what),
    );
    true
}
