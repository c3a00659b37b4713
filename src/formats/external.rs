//! Reader of further formats, which the program around the command provides.

use super::frames::{FrameSource, ModelFrame, ReadOptions, Source};
use crate::error::{Error, Result};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};

/// Frames of an [`ExternalReader`].
pub type ExternalFrames = Box<dyn Iterator<Item = Result<ModelFrame>> + Send>;

/// A reader of further formats for the command, such as that of the Python package
/// ([`run_command`](crate::run_command)).
pub trait ExternalReader: Send + Sync {
    /// Returns true if it reads a file.
    ///
    /// # Errors
    ///
    /// The reader cannot be used.
    fn reads(&self, file: &Path) -> Result<bool>;

    /// Divides files into groups that are read together, such as a topology and its trajectories.
    /// Returns the number of files of each group, in their order. `format` is that of
    /// [`ReadOptions::format`].
    ///
    /// # Errors
    ///
    /// The reader cannot be used.
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

/// Sets the reader of this process. Later calls have no effect.
#[cfg(feature = "cli")]
pub(crate) fn install(reader: Box<dyn ExternalReader>) {
    READER.set(reader).ok();
}

/// Returns the reader of this process, if there is one.
pub(crate) fn reader() -> Option<&'static dyn ExternalReader> {
    READER.get().map(|reader| &**reader)
}

/// Returns the name of a group of files: that of a trajectory, after its topology, or the first and
/// the last name.
pub(crate) fn name_of(files: &[PathBuf]) -> PathBuf {
    match files {
        [] => PathBuf::new(),
        [one] => one.clone(),
        [topology, one] if topology.extension() != one.extension() => one.clone(),
        [first, .., last] => format!("{} .. {}", first.display(), last.display()).into(),
    }
}

/// Opens a group of files.
pub(super) fn open(files: &[PathBuf], options: &ReadOptions) -> Result<Source<'static>> {
    let none = "files that are read together, or by the option `format`: only the Python package \
                has readers for them";
    let reader = reader().ok_or_else(|| Error::unsupported("model", none))?;
    let frames = reader.open(files, options)?;
    let name = name_of(files);
    Ok(Box::new(External { name, frames }))
}

/// Frames, of which the notes are logged: each once, also if further files have the same.
struct External {
    name: PathBuf,
    frames: ExternalFrames,
}

impl FrameSource for External {
    fn next_frame(&mut self) -> Result<Option<ModelFrame>> {
        static KNOWN: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
        let frame = self.frames.next().transpose()?;
        for note in frame.iter().flat_map(|frame| &frame.notes) {
            if KNOWN
                .lock()
                .is_ok_and(|mut known| known.insert(note.clone()))
            {
                tracing::info!("{}: {note}", self.name.display());
            }
        }
        Ok(frame)
    }
}
