//! Frames that a recording lacks, by the counts of its verdicts.

use crate::sinks::RunProgress;

/// Counts of a recording up to a verdict.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MissingFrames {
    /// Number of frames that had a verdict by then; `None` before the first verdict that was read,
    /// if earlier ones may be in other files.
    pub answered: Option<u64>,
    /// Number of frames that were skipped on purpose before that.
    pub left_out: u64,
}

/// Frames between two verdicts that are not in the recording.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Gap {
    /// Number of all these frames.
    pub frames: u64,
    /// Number of these frames that the recorder dropped. The others were skipped on purpose.
    pub dropped: u64,
}

impl MissingFrames {
    /// Returns the counts before the first frame of a run.
    pub fn of_no_frames() -> MissingFrames {
        MissingFrames {
            answered: Some(0),
            left_out: 0,
        }
    }

    /// Returns the gap before the next verdict, which has these counts.
    pub fn before(&mut self, progress: &RunProgress) -> Gap {
        let answered = progress.verified.saturating_add(progress.rejected);
        let before = self.answered.replace(answered);
        let since = |before: u64| answered.saturating_sub(before.saturating_add(1));
        let frames = before.map_or(0, since);
        let left_out = progress.left_out.saturating_sub(self.left_out);
        self.left_out += left_out;
        Gap {
            frames,
            dropped: frames.saturating_sub(left_out),
        }
    }
}
