//! Frames of model files, one after the other.
//!
//! A file of most formats holds one frame; LAMMPS dumps and NumPy files hold the frames of a
//! motion. [`Frames`] reads both alike, one frame at a time, so that the memory is that of a frame
//! and not that of the file (unless the format has to be read as a whole).

use super::{Format, lammps};
use crate::curve::CurveSet;
use crate::error::Result;
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
    /// True if coordinates may be wrapped into the periodic cell: the caller unwraps the curves, so
    /// curves that are torn at the boundary are not refused.
    pub wrapped: bool,
    /// True if the caller has the cell of the frames, so that none in another form is missed.
    pub has_cell: bool,
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
            #[cfg(feature = "cli")]
            after_gap: false,
        }
    }
}

/// A reader of a file.
pub(super) type Source<'a> = Box<dyn FrameSource + 'a>;

/// A reader of one format.
pub(super) trait FrameSource {
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
    /// `None` after the last frame and after an error.
    source: Option<Source<'static>>,
}

impl Frames {
    /// Opens a model file. The extension determines the format.
    ///
    /// # Errors
    ///
    /// The errors of [`super::read`], as far as they show before the first frame is read.
    pub fn open(path: &Path, options: &ReadOptions) -> Result<Frames> {
        let source = Format::of(path)?.open(path, options);
        Ok(Frames {
            path: path.into(),
            source: Some(source.map_err(|e| e.in_file(path))?),
        })
    }
}

impl Iterator for Frames {
    type Item = Result<ModelFrame>;

    /// Returns the next frame. Errors name the file; after one there are no more frames.
    fn next(&mut self) -> Option<Result<ModelFrame>> {
        let next = self.source.as_mut()?.next_frame();
        if !matches!(next, Ok(Some(_))) {
            self.source = None;
        }
        next.map_err(|e| e.in_file(&self.path)).transpose()
    }
}

/// A file of one frame, which was read as a whole.
impl FrameSource for Option<ModelFrame> {
    fn next_frame(&mut self) -> Result<Option<ModelFrame>> {
        Ok(self.take())
    }
}
