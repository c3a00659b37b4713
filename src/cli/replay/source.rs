//! Source of a replay: a recording, or a model file with one or several frames.

use super::range::Range;
use linkwatch::model::{self, ModelFrame, ReadOptions};
use linkwatch::{
    BaselineRecord, CurveSet, Ending, Error, FrameInfo, Positions, Precision, RawFrame,
    RecordedFrame, RecordedItem, RecordedVerdict, RecordingReader, Result,
};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Reader of recordings.
pub type Recording = RecordingReader<BufReader<File>>;

/// A frame to replay.
pub struct Frame {
    pub seq: u64,
    /// Simulation time in seconds.
    pub time: f64,
    pub info: FrameInfo,
    /// Time at which the frame was received, in nanoseconds since 1970; `None` for a model.
    pub received_ns: Option<u64>,
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
            curves: Curves::Recorded(frame),
        }
    }
}

fn values<T, const N: usize>(bytes: &[u8], parse: fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks().0.iter().map(|b| parse(*b)).collect()
}

/// An item of a source.
pub enum Item {
    Baseline(BaselineRecord),
    Frame(Frame),
    Verdict(Box<RecordedVerdict>),
}

/// A recording, or model files.
pub struct Source {
    path: PathBuf,
    input: Input,
}

enum Input {
    Recording(Box<Recording>),
    Models(Models),
}

impl Source {
    /// Opens a model file if its extension is that of one, else a recording.
    pub fn open(path: &Path) -> Result<Source> {
        let is_recording = path
            .extension()
            .is_some_and(|extension| extension.eq_ignore_ascii_case("mcap"));
        let models = match is_recording {
            true => None,
            false => match model::Frames::open(path, &ReadOptions::default()) {
                Ok(frames) => Some(frames),
                Err(Error::UnknownModel { .. }) => None,
                Err(e) => return Err(e),
            },
        };
        let input = match models {
            Some(frames) => Input::Models(Models::new(frames)),
            None => {
                let reader = RecordingReader::open(path).map_err(|e| e.in_file(path))?;
                Input::Recording(Box::new(reader))
            }
        };
        Ok(Source {
            path: path.into(),
            input,
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
            Input::Models(models) => return Ok(models.next()?.map(Item::Frame)),
            Input::Recording(reader) => reader.next_item().map_err(|e| e.in_file(&self.path))?,
        };
        Ok(item.map(|item| match item {
            RecordedItem::Baseline(baseline) => Item::Baseline(baseline),
            RecordedItem::Frame(frame) => Item::Frame(frame.into()),
            RecordedItem::Verdict(verdict) => Item::Verdict(verdict),
        }))
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

    /// Returns the end of a recording, once it is reached.
    pub fn ending(&self) -> Option<&Ending> {
        match &self.input {
            Input::Recording(reader) => reader.ending(),
            Input::Models(_) => None,
        }
    }
}

/// Frames of a model file, as a simulator would describe them.
struct Models {
    frames: model::Frames,
    /// What the last frame told, and the points of its curves.
    last: Option<(FrameInfo, Vec<i32>)>,
}

impl Models {
    fn new(frames: model::Frames) -> Models {
        Models { frames, last: None }
    }

    fn next(&mut self) -> Result<Option<Frame>> {
        let Some(frame) = self.frames.next().transpose()? else {
            return Ok(None);
        };
        Ok(Some(Frame {
            seq: frame.seq,
            time: frame.time,
            info: self.info(&frame),
            received_ns: None,
            curves: Curves::Model(frame.curves),
        }))
    }

    /// Returns what a simulator would tell about this frame: named curves are described again if
    /// they change. Curves without names keep the radii of the first frame.
    fn info(&mut self, frame: &ModelFrame) -> FrameInfo {
        let counts = frame.curves.as_ref().map(|set| set.counts().collect());
        let Ok(counts) = counts else {
            return self
                .last
                .as_ref()
                .map(|(info, _)| info.clone())
                .unwrap_or_default();
        };
        let info = match &self.last {
            None => FrameInfo {
                labels: Arc::clone(&frame.labels),
                ..FrameInfo::default()
            },
            Some((last, before)) => {
                let same = *last.labels == *frame.labels && *before == counts;
                match same || frame.labels.names.is_empty() {
                    true => last.clone(),
                    false => FrameInfo {
                        layout: last.layout + 1,
                        labels: Arc::clone(&frame.labels),
                        ..last.clone()
                    },
                }
            }
        };
        self.last = Some((info.clone(), counts));
        info
    }
}
