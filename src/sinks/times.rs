//! Times of a frame, stage by stage.

use crate::engine::Timings;
use std::time::Duration;

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
