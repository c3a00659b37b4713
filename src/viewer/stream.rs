//! Stream of data to the viewer.

use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::sinks::FrameRecord;
use re_sdk::{AsComponents, RecordingStream};
use re_sdk_types::archetypes::TextDocument;
use std::sync::Arc;

/// A frame whose curves are drawn, and the stream to the viewer.
pub(super) struct Drawing<'a> {
    pub rec: &'a RecordingStream,
    pub set: &'a Arc<CurveSet>,
    pub record: &'a FrameRecord,
}

impl Drawing<'_> {
    /// Logs components of an entity of the frame.
    pub fn log(&self, path: &str, what: &impl AsComponents) -> Result<()> {
        log(self.rec, path, what)
    }
}

/// Logs components of an entity at the current time.
pub(super) fn log(rec: &RecordingStream, path: &str, what: &impl AsComponents) -> Result<()> {
    rec.log(path, what).map_err(failed)
}

/// Logs components of an entity that are valid at all times.
pub(super) fn log_static(
    rec: &RecordingStream,
    path: &str,
    what: &impl AsComponents,
) -> Result<()> {
    rec.log_static(path, what).map_err(failed)
}

/// Shows a text in markdown from the current time on.
pub(super) fn write(rec: &RecordingStream, path: &str, text: &str) -> Result<()> {
    log(rec, path, &TextDocument::from_markdown(text))
}

/// Returns the error of the sink for an error of the stream.
pub(super) fn failed(error: impl std::fmt::Display) -> Error {
    Error::Sink {
        sink: "viewer",
        what: error.to_string(),
    }
}
