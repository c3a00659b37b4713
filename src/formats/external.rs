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

    /// Returns a file with the content of a compressed one. Later calls return the same file.
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

/// Extensions of compressed files that the reader unpacks.
const COMPRESSED: [&str; 3] = ["gz", "bz2", "xz"];

/// Returns the name of a file without the extension of a compressed one.
pub(crate) fn without_compression(file: &Path) -> PathBuf {
    let extension = file.extension().unwrap_or_default();
    match COMPRESSED.iter().any(|e| extension.eq_ignore_ascii_case(e)) {
        true => file.with_extension(""),
        false => file.into(),
    }
}

/// Calls `read` with a file that has the content of a compressed one, or with the file itself.
/// Errors name the file that was given.
pub(crate) fn unpacked<T>(file: &Path, read: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
    let is_packed = |_: &_| file.is_file() && without_compression(file) != file;
    let plain = reader()
        .filter(is_packed)
        .map(|reader| reader.unpacked(file));
    let plain = plain.transpose()?.unwrap_or_else(|| file.into());
    read(&plain).map_err(|e| e.renamed(&plain, file))
}

/// Opens a group of files.
pub(super) fn open(files: &[PathBuf], options: &ReadOptions) -> Result<Source<'static>> {
    let none = "files that are read together, or by the option `format`: only the Python package \
                has readers for them";
    let reader = reader().ok_or_else(|| Error::unsupported("model", none))?;
    Ok(Box::new(reader.open(files, options)?))
}

impl FrameSource for ExternalFrames {
    fn next_frame(&mut self) -> Result<Option<ModelFrame>> {
        self.next().transpose()
    }
}

/// Logs the notes of a frame: each once, also if further files have the same.
pub(super) fn log_notes(path: &Path, frame: &ModelFrame) {
    static KNOWN: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    for note in &frame.notes {
        let is_new = KNOWN.lock().map(|mut known| known.insert(note.clone()));
        if is_new.is_ok_and(|is_new| is_new) {
            tracing::info!("{}: {note}", path.display());
        }
    }
}
