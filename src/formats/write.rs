//! Writes frames to model files.

use super::Format;
use super::frames::ModelFrame;
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufWriter, Write};
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
    /// Starts a model file of a format, which its first frame creates or truncates.
    ///
    /// Errors: [`Error::Unsupported`] for formats that are only read; [`Error::File`].
    pub fn create(path: &Path, format: Format) -> Result<FrameWriter> {
        Ok(FrameWriter {
            path: path.into(),
            sink: format.create(path)?,
        })
    }

    /// Writes a frame. Its cell is lost if the format cannot hold one ([`Format::holds_cells`]).
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

/// A writer of curves to a file of one frame.
type WriteOne = fn(&Path, &CurveSet) -> Result<()>;

/// A file of one frame.
pub(super) struct OneFrame {
    path: PathBuf,
    format: &'static str,
    write: WriteOne,
    written: bool,
}

impl OneFrame {
    pub(super) fn new(path: &Path, format: &'static str, write: WriteOne) -> OneFrame {
        OneFrame {
            path: path.into(),
            format,
            write,
            written: false,
        }
    }
}

impl FrameSink for OneFrame {
    fn frame(&mut self, frame: &ModelFrame) -> Result<()> {
        if std::mem::replace(&mut self.written, true) {
            return Err(Error::unsupported(
                self.format,
                "a second frame in one file",
            ));
        }
        let set = curves_of(self.format, frame)?;
        (self.write)(&self.path, set)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        match self.written {
            true => Ok(()),
            false => Err(Error::unsupported(self.format, "a file without a frame")),
        }
    }
}

/// Returns the curves of a frame.
pub(super) fn curves_of<'a>(format: &'static str, frame: &'a ModelFrame) -> Result<&'a CurveSet> {
    (frame.curves.as_ref()).map_err(|e| {
        Error::unsupported(
            format,
            format_args!("frame {}, which is invalid: {e}", frame.seq),
        )
    })
}

/// Rejects splines.
pub(super) fn check_polylines(format: &'static str, set: &CurveSet) -> Result<()> {
    match set.basis().is_polyline() {
        true => Ok(()),
        false => {
            let kind = set.basis().describe(true);
            let what = format!("splines ({kind}), only polylines");
            Err(Error::unsupported(format, what))
        }
    }
}

/// Rejects curves that have other numbers of points than those of the first frame.
pub(super) fn same_curves(format: &'static str, counts: &[i32], set: &CurveSet) -> Result<()> {
    if set.counts().eq(counts.iter().copied()) {
        return Ok(());
    }
    let what = match set.len() == counts.len() {
        true => "a frame whose curves have other numbers of points than those of the first".into(),
        false => format!("{} curves after a frame of {}", set.len(), counts.len()),
    };
    Err(Error::unsupported(format, what))
}

/// Writes a file. Errors name it.
pub(super) fn create(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<()> {
    let file = File::create(path).map_err(Error::file(path))?;
    let mut out = BufWriter::with_capacity(1 << 16, file);
    write(&mut out)
        .and_then(|()| out.flush())
        .map_err(Error::file(path))
}
