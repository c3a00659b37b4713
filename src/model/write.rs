//! Writes frames to model files.

use super::frames::ModelFrame;
use super::{Format, write_bcc};
use crate::error::{Error, Result};
use std::path::{Path, PathBuf};

/// A writer of one format.
pub(super) trait FrameSink {
    /// Writes a frame whose curves are valid.
    ///
    /// Errors: the format cannot hold these curves (the message says what it can hold), the frame
    /// has other curves than the first one where the format does not allow it, or the disk is full.
    fn frame(&mut self, frame: &ModelFrame) -> Result<()>;

    /// Completes the file.
    fn finish(self: Box<Self>) -> Result<()>;
}

/// Writes the frames of a motion to one model file.
pub struct FrameWriter {
    path: PathBuf,
    sink: Box<dyn FrameSink>,
}

impl FrameWriter {
    /// Creates a model file of a format, or truncates it.
    ///
    /// Errors: [`Error::Unsupported`] for formats that are only read; [`Error::File`].
    pub fn create(path: &Path, format: Format) -> Result<FrameWriter> {
        Ok(FrameWriter {
            path: path.into(),
            sink: format.create(path)?,
        })
    }

    /// Writes a frame.
    ///
    /// Errors: that of the curves, if they are invalid; [`Error::Unsupported`] if the format cannot
    /// hold them, or no second frame; [`Error::File`].
    pub fn frame(&mut self, frame: &ModelFrame) -> Result<()> {
        self.sink.frame(frame).map_err(|e| e.in_file(&self.path))
    }

    /// Completes the file. Without this call it may be incomplete.
    pub fn finish(self) -> Result<()> {
        self.sink.finish().map_err(|e| e.in_file(&self.path))
    }
}

/// A BCC file. Holds one frame.
pub(super) struct BccFile {
    path: PathBuf,
    written: bool,
}

impl BccFile {
    pub(super) fn new(path: &Path) -> BccFile {
        BccFile {
            path: path.into(),
            written: false,
        }
    }
}

impl FrameSink for BccFile {
    fn frame(&mut self, frame: &ModelFrame) -> Result<()> {
        only_one("BCC", &mut self.written)?;
        match &frame.curves {
            Ok(curves) => write_bcc(&self.path, curves),
            Err(e) => Err(Error::unsupported("BCC", e)),
        }
    }

    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}

/// Rejects a second frame in a file of a format that holds one.
pub(super) fn only_one(format: &'static str, written: &mut bool) -> Result<()> {
    match std::mem::replace(written, true) {
        true => Err(Error::unsupported(format, "a second frame in one file")),
        false => Ok(()),
    }
}
