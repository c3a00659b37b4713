//! State of a run at a frame, and the times of the frame, stage by stage.

use crate::engine::Timings;
use crate::incremental::Work;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// State of a run at a frame. It depends on the run, unlike the report on the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunProgress {
    /// Number of frames verified so far, this one included.
    pub verified: u64,
    /// Number of frames that were published but not verified, so far.
    pub skipped: u64,
    /// Number of frames rejected so far.
    pub rejected: u64,
    /// Number of violations so far that the simulator rolled back, so that a later frame is intact.
    pub recovered: u32,
    /// Number of violations so far that the simulator accepted as a new baseline.
    pub accepted: u32,
    /// Times of the frame. Recordings of earlier versions have only the sum of ingest and
    /// verification, as `verification`.
    pub times: FrameTimes,
    /// Work of the verification. Another run may take another route to the same report.
    pub work: Work,
    /// Time at which the frame arrived, in nanoseconds since 1970; 0 before that.
    pub received_ns: u64,
    /// In a recording: number of frames before this one that are not in the file on purpose.
    /// `verified` and `rejected` count them.
    pub left_out: u64,
}

impl RunProgress {
    /// Sets the time at which the frame arrived.
    pub fn received(self, at: SystemTime) -> RunProgress {
        let since_1970 = at.duration_since(UNIX_EPOCH).unwrap_or_default();
        RunProgress {
            received_ns: since_1970.as_nanos().try_into().unwrap_or(u64::MAX),
            ..self
        }
    }
}

/// Times of a frame in a run. They depend on the machine, unlike its report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameTimes {
    /// Copying and checking the coordinates, and comparing them with the reference frame.
    pub ingest: Duration,
    /// Comparison with the baseline, and the search for pull-throughs.
    pub verification: Duration,
    /// Stages of the verification, if it has stages: a frame that moved little has none, and a
    /// frame of a recording has not been verified. What remains of it is the comparison.
    pub stages: Timings,
    /// Exchange with the simulator, if the frame is a live one and not the first.
    pub live: Option<LiveTimes>,
}

/// Times of a live frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LiveTimes {
    /// Time since the previous frame was received.
    pub interval: Duration,
    /// Part of it that was spent waiting for this frame.
    pub wait: Duration,
    /// Sending the verdict.
    pub send: Duration,
}

impl FrameTimes {
    /// Returns the time from the receipt of the frame to its report.
    pub fn check(&self) -> Duration {
        self.ingest + self.verification
    }
}
