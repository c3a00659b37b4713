//! Frames of a recording of linkwatch, for all commands that read files.

use super::output::{count, plural};
use super::source::Source;
use crate::record::{CONTINUED, CUT_OFF, MissingFrames, PART};
use linkwatch::formats::{ModelFrame, without_compression};
use linkwatch::{
    Ending, FrameInfo, RecordedFrame, RecordedItem, RecordedVerdict, Result, Retention, Verdict,
};
use std::path::{Path, PathBuf};

/// A file of a recorded run.
pub struct Part {
    /// Its number among the files, from 1.
    pub number: u32,
    /// Path without this number, by which the files of one run are known.
    pub run: PathBuf,
    /// True if it has a window of frames around each violation. Then only the number of verdicts
    /// tells which frames are left out.
    pub has_window: bool,
}

/// Returns which file of a recorded run this is. `None` if it cannot be read as a recording.
pub fn part(path: &Path) -> Option<Part> {
    let mut source = Source::new(path).ok()?;
    // The metadata is before the first item.
    source.next().ok()?;
    let metadata = source.reader.metadata();
    let number = metadata.get(PART);
    let number = number.map_or(Some(1), |number| number.parse().ok())?;
    let path = without_compression(path);
    let stem = path.file_stem()?.to_string_lossy();
    let run = stem.strip_suffix(&format!("-part{number}"));
    Some(Part {
        number,
        run: path.with_file_name(run.unwrap_or(&stem)),
        has_window: metadata.contains_key(Retention::WINDOW),
    })
}

/// Frames of a recording, with the information of the simulator: cell, cuts, layout, names, radii
/// and time step.
///
/// A frame that was rejected when it was recorded is an invalid frame. Frames that were skipped on
/// purpose are a gap before the next frame. Frames that the recorder dropped are an error at the
/// end.
#[derive(Default)]
pub struct Recorded {
    /// `None` after the end, and after an error.
    source: Option<Source>,
    /// Number of the last frame with curves, until its verdict is read.
    frame: Option<u64>,
    /// Counts up to the last verdict. The next file of a run continues them.
    pub missing: MissingFrames,
    /// True if a frame was read that was not rejected.
    begun: bool,
    /// True if frames before the next one were skipped.
    pub after_gap: bool,
    /// Name of the file in which the run continues, once the end was read.
    pub continues_in: Option<String>,
    /// Number of frames whose curves were skipped on purpose.
    absent: u64,
    /// Number of frames that the recorder dropped.
    dropped: u64,
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
        let curves = curves.map(|()| set.expect("set by a frame without errors"));
        ModelFrame {
            after_gap: std::mem::take(&mut self.after_gap),
            ..ModelFrame::of(frame.info, curves)
        }
    }

    /// Returns the frame of a verdict if that was rejected. Counts frames that are missing.
    fn verdict(&mut self, recorded: RecordedVerdict) -> Option<ModelFrame> {
        let RecordedVerdict { report, progress } = recorded;
        let has_curves = self.frame.take() == Some(report.seq);
        let gap = self.missing.before(&progress);
        self.dropped += gap.dropped;
        if report.verdict == Verdict::Rejected && !has_curves {
            let why = report.rejected.unwrap_or_else(|| "invalid".into());
            let why = usage!("rejected when it was recorded: {why}");
            let info = FrameInfo::at(report.seq, report.time);
            return Some(ModelFrame::of(info, Err(why)));
        }
        self.begun = true;
        self.after_gap |= !has_curves;
        self.absent += gap.frames - gap.dropped + u64::from(!has_curves);
        None
    }

    /// Returns the end of the recording, which is an error if it was cut off.
    fn end(&mut self) -> Option<Result<ModelFrame>> {
        let Source { path, reader, .. } = self.source.take()?;
        if self.absent > 0 {
            tracing::warn!(
                "{}: the curves of {} were left out of the recording; the steps over them are \
                 not searched for pull-throughs",
                path.display(),
                plural(self.absent, "frame"),
            );
        }
        self.continues_in = reader.metadata().get(CONTINUED).cloned();
        let cut_off = reader.metadata().get(CUT_OFF);
        let why = match (reader.ending(), cut_off) {
            (Some(Ending::Cut { at, what }), _) => usage!(
                "the recording was cut off at byte {}, in {what}; all complete frames before that \
                 were read",
                count(*at)
            ),
            (_, Some(why)) => {
                usage!("the recorded run has no end: {why}; all frames were read")
            }
            _ if self.dropped > 0 => usage!(
                "{} missing: verified, but not recorded, because the disk of the recorder was too \
                 slow; all others were read",
                plural(self.dropped, "frame")
            ),
            _ => return None,
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
                    self.after_gap |= self.begun;
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

#[cfg(test)]
mod tests {
    use super::*;
    use linkwatch::scenes::Scene;
    use linkwatch::{FrameRecord, RecordingSink, Report, RunProgress, Sink};
    use std::collections::BTreeMap;
    use std::sync::Arc;

    /// Records frames, given by their number, whether they have curves, and the number of frames
    /// that were verified by then. Returns number and gap of the frames that are read, or an error.
    fn read(frames: &[(u64, bool, u64)]) -> Vec<Result<(u64, bool), String>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let scene: Scene = "chainmail:rows=2,columns=2".parse().unwrap();
        let curves = Arc::new(scene.build().unwrap().curves);
        let mut sink = Box::new(RecordingSink::create(&path, &BTreeMap::new()).unwrap());
        for &(seq, has_curves, verified) in frames {
            let report = Report::new(seq, 0.1 * seq as f64, Verdict::Intact);
            let progress = RunProgress {
                verified,
                ..RunProgress::default()
            };
            let record = FrameRecord {
                curves: has_curves.then(|| Arc::clone(&curves)),
                info: FrameInfo::at(seq, report.time),
                report: Arc::new(report),
                progress,
            };
            sink.frame(&record).unwrap();
        }
        sink.finish().unwrap();
        let frames = Recorded::open(&path).unwrap().map(|frame| match frame {
            Ok(frame) => Ok((frame.info.seq, frame.after_gap)),
            Err(e) => Err(e.to_string()),
        });
        frames.collect()
    }

    /// Regression test: the step over the gap was searched, and the step after it was not.
    #[test]
    fn a_gap_is_before_the_frame_that_follows_frames_without_curves() {
        let frames = [
            (3, true, 4),
            (4, false, 5),
            (5, false, 6),
            (6, true, 7),
            (7, true, 8),
        ];
        let found = read(&frames);
        assert_eq!(found, [Ok((3, false)), Ok((6, true)), Ok((7, false))]);
    }

    #[test]
    fn frames_that_the_recorder_dropped_are_an_error_at_the_end() {
        let found = read(&[(0, true, 1), (1, true, 2), (5, true, 6), (6, true, 7)]);
        let frames = [0, 1, 5, 6].map(|seq| Ok((seq, false)));
        assert_eq!(found[..4], frames);
        let error = found[4].as_ref().unwrap_err();
        assert!(error.contains("3 frames missing"), "{error}");
    }
}
