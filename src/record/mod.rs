//! Recordings: MCAP files with every frame, every verdict and the baseline.
//!
//! A recording is complete evidence: [`RecordingReader`] returns the same bits that were verified
//! and the same report, so that a replay can be compared with it. The schema is
//! `schemas/linkwatch.proto`.
//!
//! The container module reads the records.

mod file;
mod messages;
#[cfg(feature = "cli")]
mod missing;
mod reader;
mod retention;
mod schema;
mod writer;

pub use crate::formats::container::Ending;
#[cfg(feature = "cli")]
pub(crate) use missing::MissingFrames;
pub use reader::{RecordedFrame, RecordedItem, RecordedVerdict, RecordingReader};
pub(crate) use retention::CONTINUED;
#[cfg(feature = "cli")]
pub(crate) use retention::PART;
#[cfg(feature = "cli")]
pub use retention::with_suffix;
pub use retention::{RecordingOptions, Retention};
pub use writer::RecordingSink;

/// Topic and message of each channel.
const LABELS: (&str, &str) = ("/linkwatch/labels", "Labels");
const FRAMES: (&str, &str) = ("/linkwatch/frames", "CurveFrame");
const VERDICTS: (&str, &str) = ("/linkwatch/verdicts", "Verdict");
const BASELINE: (&str, &str) = ("/linkwatch/baseline", "Baseline");
const ACCEPTED: (&str, &str) = ("/linkwatch/accepted", "Baseline");

/// Name of the metadata record, which describes the recorder and its settings.
const METADATA: &str = "linkwatch";

/// Key of the reason why the run has no end, in a metadata record after the last frame.
pub(crate) const CUT_OFF: &str = "cut_off";

/// Message encoding and schema encoding of every channel.
const PROTOBUF: &str = "protobuf";
