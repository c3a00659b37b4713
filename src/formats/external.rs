//! Files of formats that this crate does not read, but the program that runs the command does.

use super::frames::{FrameSource, Frames, ModelFrame, ReadOptions};
use crate::error::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Frames of an [`ExternalReader`].
pub type ExternalFrames = Box<dyn Iterator<Item = Result<ModelFrame>> + Send>;

/// A reader of further formats for the command, such as that of the Python package
/// ([`run_command`](crate::run_command)).
pub trait ExternalReader: Send + Sync {
    /// Returns true if it reads a file.
    fn reads(&self, file: &Path) -> bool;

    /// Divides files into groups that are read together, such as a topology and its trajectories.
    /// Returns the number of files of each group, in their order. `format` is that of
    /// [`ReadOptions::format`].
    ///
    /// # Errors
    ///
    /// There is no such format.
    fn groups(&self, files: &[PathBuf], format: Option<&str>) -> Result<Vec<usize>>;

    /// Returns a file with the content of a compressed one, or the file itself.
    ///
    /// # Errors
    ///
    /// The file is damaged.
    fn unpacked(&self, file: &Path) -> Result<PathBuf>;

    /// Opens a group of files.
    ///
    /// # Errors
    ///
    /// The files cannot be read.
    fn open(&self, files: &[PathBuf], options: &ReadOptions) -> Result<ExternalFrames>;
}

static READER: OnceLock<Box<dyn ExternalReader>> = OnceLock::new();

/// Adds the reader of this process. Only the first one counts.
#[cfg(feature = "cli")]
pub(crate) fn install(reader: Box<dyn ExternalReader>) {
    READER.set(reader).ok();
}

/// Returns the reader of this process, if there is one.
pub(crate) fn reader() -> Option<&'static dyn ExternalReader> {
    READER.get().map(|reader| &**reader)
}

/// Opens a group of files, of which errors name the last one.
pub(super) fn open(files: &[PathBuf], options: &ReadOptions) -> Result<Frames> {
    let none = "files that are read together, or by the option `format`: only the Python package \
                has readers for them";
    let reader = reader().ok_or_else(|| Error::unsupported("model", none))?;
    let frames = reader.open(files, options)?;
    let path = files.last().cloned().unwrap_or_default();
    let source = Box::new(External {
        path: path.clone(),
        frames,
    });
    Ok(Frames::new(path, source))
}

/// Frames, of which the notes are logged.
struct External {
    path: PathBuf,
    frames: ExternalFrames,
}

impl FrameSource for External {
    fn next_frame(&mut self) -> Result<Option<ModelFrame>> {
        let frame = self.frames.next().transpose()?;
        if let Some(frame) = &frame {
            let name = frame.file.as_ref().unwrap_or(&self.path).display();
            for note in &frame.notes {
                tracing::info!("{name}: {note}");
            }
        }
        Ok(frame)
    }
}
