//! Writes frames to model files.

use super::format::only_read;
use super::frames::ModelFrame;
use super::{Format, numpy, obj, vect, write_bcc};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file of which the first frame is written.
pub(super) trait FrameSink {
    /// Writes another frame.
    ///
    /// # Errors
    ///
    /// The format cannot hold these curves (the message says what it can hold), the frame
    /// has other curves than the first one where the format does not allow it, or the disk is full.
    fn frame(&mut self, frame: &ModelFrame, set: &CurveSet) -> Result<()>;

    /// Completes the file.
    fn finish(self: Box<Self>) -> Result<()>;
}

/// Writes the frames of a motion to one model file.
pub struct FrameWriter {
    path: PathBuf,
    format: Format,
    /// `None` before the first frame. Inside, `None` for a file of one frame, which is complete.
    sink: Option<Option<Box<dyn FrameSink>>>,
}

impl FrameWriter {
    /// Starts a model file of a format, which its first frame creates or truncates.
    ///
    /// # Errors
    ///
    /// [`Error::Unsupported`] for formats that are only read.
    pub fn create(path: &Path, format: Format) -> Result<FrameWriter> {
        if !format.is_written() {
            return Err(only_read(path));
        }
        let (path, sink) = (path.into(), None);
        Ok(FrameWriter { path, format, sink })
    }

    /// Creates the file with its first frame. Returns `None` if it is complete.
    fn begin(&self, frame: &ModelFrame, set: &CurveSet) -> Result<Option<Box<dyn FrameSink>>> {
        let path = &self.path;
        match self.format {
            Format::Bcc => write_bcc(path, set)?,
            Format::Obj => obj::write(path, set)?,
            Format::Vect => vect::write(path, set)?,
            Format::Npy => return Ok(Some(Box::new(numpy::Stream::create_npy(path, set)?))),
            Format::Npz => return Ok(Some(Box::new(numpy::NpzFile::create(path, frame, set)?))),
            _ => return Err(only_read(path)),
        }
        Ok(None)
    }

    /// Writes a frame. Its cell is lost if the format cannot hold one ([`Format::holds_cells`]).
    ///
    /// # Errors
    ///
    /// The error of the curves, if they are invalid; [`Error::Unsupported`] if the format cannot
    /// hold them, or no second frame; [`Error::File`].
    pub fn frame(&mut self, frame: &ModelFrame) -> Result<()> {
        let set = frame.curves.as_ref().map_err(|e| {
            let what = format_args!("frame {}, which is invalid: {e}", frame.info.seq);
            Error::unsupported("output", what)
        });
        let written = set.and_then(|set| match &mut self.sink {
            Some(Some(sink)) => sink.frame(frame, set),
            Some(None) => {
                let what = "a second frame in one file of this format";
                Err(Error::unsupported("output", what))
            }
            None => {
                self.sink = Some(self.begin(frame, set)?);
                Ok(())
            }
        });
        written.map_err(|e| e.in_file(&self.path))
    }

    /// Completes the file. Without this call it may be incomplete.
    ///
    /// # Errors
    ///
    /// [`Error::Unsupported`] if there was no frame; [`Error::File`].
    pub fn finish(self) -> Result<()> {
        let none = || Error::unsupported("output", "a file without frames");
        let sink = self.sink.ok_or_else(none);
        let finished = sink.and_then(|sink| sink.map_or(Ok(()), FrameSink::finish));
        finished.map_err(|e| e.in_file(&self.path))
    }
}

/// Rejects splines.
pub(super) fn check_polylines(format: &'static str, set: &CurveSet) -> Result<()> {
    if set.basis().is_polyline() {
        return Ok(());
    }
    let kind = set.basis().describe(true);
    let what = format!("splines ({kind}), only polylines");
    Err(Error::unsupported(format, what))
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
