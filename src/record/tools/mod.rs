//! Messages with types that other tools draw, so that they show a recording without linkwatch.
//!
//! | tool | message | content |
//! |---|---|---|
//! | Foxglove | `foxglove.SceneUpdate` | curves as lines: in full if they have findings; labels |
//! | rerun | `foxglove.PointCloud` | points of the curves, with colours |
//!
//! Rerun 0.36 does not draw `foxglove.SceneUpdate`. Foxglove draws both.
//!
//! They follow from the frame and its report, so a reader skips them. A frame that was rejected
//! before it became curves has none.
//!
//! Their timestamps are the simulation time, in addition to the time in the log that all messages
//! of a recording have. Tools play the time in the log; rerun has a timeline for both.
//!
//! Cost: linear in the number of curves and in the number of points that are written, which is
//! bounded (see [`sample`]). Memory: a message. All on the thread of the recording.

mod points;
mod sample;
mod scene;

pub(super) use points::Points;
pub(super) use scene::Scene;

use crate::formats::container::foxglove::Time;
use crate::verdict::Report;

/// Compiled form of `schemas/foxglove.proto`.
pub(super) const DESCRIPTORS: &[u8] = include_bytes!("../../../schemas/foxglove.binpb");

/// Name of the coordinate system of all messages.
const FRAME_ID: &str = "world";

/// A tool that can show a recording without linkwatch, if the recording has messages for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum RecordingTool {
    /// Foxglove, by messages of the type `foxglove.SceneUpdate`.
    Foxglove,
    /// The rerun viewer, by messages of the type `foxglove.PointCloud`.
    Rerun,
}

impl RecordingTool {
    /// All tools.
    pub const ALL: [RecordingTool; 2] = [RecordingTool::Foxglove, RecordingTool::Rerun];

    /// Returns the topic and the schema of its messages.
    pub(super) fn channel(self) -> (&'static str, &'static str) {
        match self {
            RecordingTool::Foxglove => ("/linkwatch/scene", "foxglove.SceneUpdate"),
            RecordingTool::Rerun => ("/linkwatch/points", "foxglove.PointCloud"),
        }
    }
}

/// Returns the time of a frame; 0 if it is not a number.
fn time_of(report: &Report) -> Time {
    let (seconds, rest) = (report.time.floor(), report.time - report.time.floor());
    Time {
        // Conversions saturate.
        seconds: seconds as i64,
        nanos: ((rest * 1e9) as i32).clamp(0, 999_999_999),
    }
}

/// Findings on a curve, by the worst of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum State {
    Intact,
    /// It touches another curve, or a pair of it is undecided.
    Undecided,
    /// A link of it changed, or it was pulled through another curve.
    Broken,
}

impl State {
    /// Red, green, blue and alpha: the colours of the viewer.
    fn color(self) -> [u8; 4] {
        match self {
            State::Intact => [0x6f, 0x80, 0x9c, 0xff],
            State::Undecided => [0xff, 0x9f, 0x0a, 0xff],
            State::Broken => [0xff, 0x3b, 0x30, 0xff],
        }
    }
}

/// Returns the state of each curve.
fn states(report: &Report, curves: usize) -> Vec<State> {
    let mut states = vec![State::Intact; curves];
    for finding in report.all_findings() {
        let state = match finding.is_change() {
            true => State::Broken,
            false => State::Undecided,
        };
        for i in finding.curves() {
            if let Some(s) = states.get_mut(i as usize) {
                *s = state.max(*s);
            }
        }
    }
    states
}

#[cfg(test)]
mod tests;
