//! Frames of model files, one after the other.
//!
//! A file of most formats holds one frame; LAMMPS dumps and NumPy files hold the frames of a
//! motion. [`Frames`] reads both alike, one frame at a time, so that the memory is that of a frame
//! and not that of the file (unless the format has to be read as a whole).

use super::{Format, external, lammps};
use crate::curve::{Cell, CurveSet};
use crate::error::{Error, Result};
use crate::ingest::FrameInfo;
use std::path::{Path, PathBuf};

/// Information on curves that some formats lack, and that the caller adds.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct ReadOptions {
    /// LAMMPS data file with the bonds of a dump.
    pub bonds: Option<PathBuf>,
    /// Number of points of each curve of a NumPy array, negative if the curve is closed.
    pub counts: Option<Vec<i32>>,
    /// True if curves are closed whose file does not say it, and false if they are open: those of
    /// plain text, and the molecules of a LAMMPS dump without bonds.
    pub closed: Option<bool>,
    /// Topic of an MCAP file, if several have curves.
    pub topic: Option<String>,
    /// `Some` if the caller decides about unwrapping, true if coordinates are wrapped into the
    /// periodic cell: curves that are torn at the boundary are then not refused.
    pub wrapped: Option<bool>,
    /// Cell that the caller uses instead of that of the frames, so that none in another form is
    /// missed; `Some(None)` if it ignores that.
    pub cell: Option<Option<Cell>>,
    /// True if curves stay open that end where they start. Only an
    /// [`ExternalReader`](super::ExternalReader) closes them.
    pub keep_open: bool,
    /// True if files that are read together keep their order.
    pub keep_order: bool,
    /// True if files of several frames each that are read together continue one another.
    pub one_motion: bool,
    /// Atoms to read of molecules, for an [`ExternalReader`](super::ExternalReader).
    pub select: Option<String>,
    /// Format of the files, for an [`ExternalReader`](super::ExternalReader).
    pub format: Option<String>,
}

impl ReadOptions {
    /// Returns the file that has the bonds of a LAMMPS dump, if there is one: that of the option,
    /// or a data file beside the dump with the same stem.
    #[must_use]
    pub fn bonds_of(&self, dump: &Path) -> Option<PathBuf> {
        self.bonds.clone().or_else(|| lammps::beside(dump))
    }
}

/// One frame of a model file.
#[derive(Debug)]
#[non_exhaustive]
pub struct ModelFrame {
    /// Number, time and cell of the frame, labels of its curves, and elements that were not read,
    /// as far as the file has them. Numbers are those of the file (the time step of LAMMPS), or
    /// counted from 0. They increase within a file.
    pub info: FrameInfo,
    /// The curves, or the reason why this frame is invalid although later ones can be read.
    pub curves: Result<CurveSet>,
    /// New notes of an [`ExternalReader`](super::ExternalReader) about the file: curves that it
    /// closed or unwrapped.
    pub notes: Vec<String>,
    /// True if frames before it are not in the file, so that the step to it is unknown.
    #[cfg(feature = "cli")]
    pub(crate) after_gap: bool,
}

impl ModelFrame {
    /// Creates a frame of curves without time and labels.
    pub fn new(seq: u64, curves: Result<CurveSet>) -> ModelFrame {
        ModelFrame::of(FrameInfo::at(seq, 0.0), curves)
    }

    /// Creates a frame.
    pub fn of(info: FrameInfo, curves: Result<CurveSet>) -> ModelFrame {
        ModelFrame {
            info,
            curves,
            notes: Vec::new(),
            #[cfg(feature = "cli")]
            after_gap: false,
        }
    }
}

/// A reader of a file.
pub(super) type Source<'a> = Box<dyn FrameSource + 'a>;

/// A reader of one format.
pub(super) trait FrameSource: Send {
    /// Reads the next frame. `None` at the end of the file.
    ///
    /// # Errors
    ///
    /// The file is invalid or truncated, so that nothing more can be read.
    fn next_frame(&mut self) -> Result<Option<ModelFrame>>;
}

/// Frames of a model file, in the order of the file.
///
/// ```
/// use linkwatch::{formats, scenes::Scene};
///
/// # let file = std::env::temp_dir().join(format!("linkwatch-frames-{}.bcc", std::process::id()));
/// let ring: Scene = "ribbon:segments=2000,lambda=10".parse()?;
/// formats::write_bcc(&file, &ring.build()?.curves)?;
/// for frame in formats::Frames::open(&file, &formats::ReadOptions::default())? {
///     let frame = frame?;
///     assert_eq!((frame.info.seq, frame.curves?.len()), (0, 2));
/// }
/// # std::fs::remove_file(file)?;
/// # Ok::<(), linkwatch::Error>(())
/// ```
pub struct Frames {
    path: PathBuf,
    /// For each file: the path that is read, and the path that was given. They differ if the file
    /// is compressed, because an unpacked copy is read.
    names: Vec<[PathBuf; 2]>,
    /// `None` after the last frame and after an error.
    source: Option<Source<'static>>,
}

impl Frames {
    /// Opens a model file. The extension determines the format, unless [`ReadOptions::format`]
    /// does.
    ///
    /// # Errors
    ///
    /// The errors of [`super::read`] that occur before the first frame is read.
    pub fn open(path: &Path, options: &ReadOptions) -> Result<Frames> {
        let format = match options.format {
            Some(_) => Format::External,
            None => Format::of(path)?,
        };
        Frames::of(format, &[path.into()], options)
    }

    /// Opens files together by the [`ExternalReader`](super::ExternalReader) of this process.
    ///
    /// # Errors
    ///
    /// The errors of [`ExternalReader::open`](super::ExternalReader::open);
    /// [`Error::Unsupported`](crate::Error::Unsupported) if there is no such reader, or it does not
    /// have an option.
    pub fn open_together(files: &[PathBuf], options: &ReadOptions) -> Result<Frames> {
        Frames::of(Format::External, files, options)
    }

    fn of(format: Format, files: &[PathBuf], options: &ReadOptions) -> Result<Frames> {
        let path = external::name_of(files);
        format.check(options, &path)?;
        let plain = |file: &PathBuf| external::unpacked(file, |plain| Ok(plain.to_owned()));
        let plain = files.iter().map(plain).collect::<Result<Vec<_>>>()?;
        let source = match &plain[..] {
            [one] => format.open(one, options),
            all => external::open(all, options),
        };
        let names = plain.into_iter().zip(files);
        let mut frames = Frames {
            path,
            names: names.map(|(plain, file)| [plain, file.clone()]).collect(),
            source: None,
        };
        frames.source = Some(source.map_err(|e| frames.named(e))?);
        Ok(frames)
    }

    /// Returns an error that names a file that was given.
    fn named(&self, e: Error) -> Error {
        let named = |e: Error, [plain, file]: &[PathBuf; 2]| e.renamed(plain, file);
        self.names.iter().fold(e, named).in_file(&self.path)
    }
}

impl Iterator for Frames {
    type Item = Result<ModelFrame>;

    /// Returns the next frame. Errors name the file; after one there are no more frames.
    fn next(&mut self) -> Option<Result<ModelFrame>> {
        let next = self.source.as_mut()?.next_frame();
        match &next {
            Ok(Some(frame)) => external::log_notes(&self.path, frame),
            _ => self.source = None,
        }
        next.map_err(|e| self.named(e)).transpose()
    }
}

/// A file of one frame, which was read as a whole.
impl FrameSource for Option<ModelFrame> {
    fn next_frame(&mut self) -> Result<Option<ModelFrame>> {
        Ok(self.take())
    }
}
