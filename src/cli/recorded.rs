//! Frames of a recording of linkwatch, for all commands that read files.

use super::output::{count, plural};
use super::source::Source;
use crate::record::CUT_OFF;
use linkwatch::formats::ModelFrame;
use linkwatch::{Ending, FrameInfo, RecordedFrame, RecordedItem, RecordedVerdict, Result, Verdict};
use std::path::Path;

/// Frames of a recording with what the simulator told about them: cell, cuts, layout, names, radii
/// and time step.
///
/// A frame that was rejected when it was recorded is an invalid frame. A frame after others without
/// curves does not continue the previous one, as after a cut.
#[derive(Default)]
pub struct Recorded {
    /// `None` after the end, and after an error.
    source: Option<Source>,
    /// True if a frame was read.
    begun: bool,
    /// Number of the last frame with curves, until its verdict is read.
    frame: Option<u64>,
    /// Number of frames that had a verdict when the last one was written.
    answered: u64,
    /// Number of places so far at which frames are missing, which count as cuts.
    gaps: u32,
    /// Number of frames without curves, and of those that the recorder dropped.
    absent: u64,
}

impl Recorded {
    /// Opens a recording. Errors name the file.
    pub fn open(path: &Path) -> Result<Recorded> {
        Ok(Recorded {
            source: Some(Source::new(path)?),
            ..Recorded::default()
        })
    }

    fn frame(&mut self, frame: RecordedFrame) -> ModelFrame {
        self.begun = true;
        self.frame = Some(frame.seq);
        let mut set = None;
        let curves = frame.ingest(&mut set);
        let mut info = frame.info;
        info.cuts = info.cuts.wrapping_add(self.gaps);
        let curves = curves.map(|()| set.expect("set by a frame without errors"));
        ModelFrame::of(info, curves)
    }

    /// Returns the frame of a verdict if that was rejected. Counts frames that are missing.
    fn verdict(&mut self, recorded: RecordedVerdict) -> Option<ModelFrame> {
        let RecordedVerdict { report, progress } = recorded;
        let has_curves = self.frame.take() == Some(report.seq);
        let answered = progress.verified.saturating_add(progress.rejected);
        let before = std::mem::replace(&mut self.answered, answered);
        if self.begun {
            self.miss(answered.saturating_sub(before.saturating_add(1)));
        }
        self.begun = true;
        if report.verdict == Verdict::Rejected && !has_curves {
            let why = report.rejected.unwrap_or_else(|| "invalid".into());
            let why = usage!("rejected when it was recorded: {why}");
            let info = FrameInfo::at(report.seq, report.time);
            return Some(ModelFrame::of(info, Err(why)));
        }
        self.miss(u64::from(!has_curves));
        None
    }

    fn miss(&mut self, frames: u64) {
        if frames > 0 {
            self.absent += frames;
            self.gaps = self.gaps.wrapping_add(1);
        }
    }

    /// Returns the end of the recording, which is an error if it was cut off.
    fn end(&mut self) -> Option<Result<ModelFrame>> {
        let Source { path, reader, .. } = self.source.take()?;
        if self.absent > 0 {
            tracing::warn!(
                "{}: the curves of {} are not in the recording; frames after them are read as \
                 after a cut",
                path.display(),
                plural(self.absent, "frame"),
            );
        }
        let why = match reader.ending() {
            Some(Ending::Cut { at, what }) => usage!(
                "the recording was cut off at byte {}, in {what}; all complete frames before that \
                 were read",
                count(*at)
            ),
            _ => {
                let why = reader.metadata().get(CUT_OFF)?;
                usage!("the recorded run has no end: {why}; all frames were read")
            }
        };
        Some(Err(why.in_file(path)))
    }
}

impl Iterator for Recorded {
    type Item = Result<ModelFrame>;

    fn next(&mut self) -> Option<Result<ModelFrame>> {
        loop {
            match self.source.as_mut()?.next() {
                Ok(Some(RecordedItem::Frame(frame))) => return Some(Ok(self.frame(frame))),
                Ok(Some(RecordedItem::Verdict(recorded))) => {
                    if let Some(rejected) = self.verdict(*recorded) {
                        return Some(Ok(rejected));
                    }
                }
                // A later baseline marks frames that are not in the recording.
                Ok(Some(RecordedItem::Baseline(_))) => {
                    self.gaps = self.gaps.wrapping_add(u32::from(self.begun));
                }
                Ok(None) => return self.end(),
                Err(e) => {
                    self.source = None;
                    return Some(Err(e));
                }
            }
        }
    }
}
