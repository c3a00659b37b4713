//! Stream of data to the viewer.

use crate::error::{Error, Result};
use re_sdk::{AsComponents, RecordingStream};
use re_sdk_types::archetypes::TextDocument;

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
