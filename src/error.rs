//! Error type of the library. Messages carry the numbers that disagree.

use std::path::{Path, PathBuf};

/// Extensions of the model files that linkwatch reads, for messages and help texts.
pub const MODEL_FILES: &str = concat!(
    ".bcc, .obj, .vect, .data, .lmp, .lammps, .dump, .lammpstrj, .npy, .npz, .xyz, ",
    ".extxyz, .mcap",
);

/// Failure on the way from bytes to a verdict.
///
/// A frame that breaks its contract gives an error of this type, and becomes
/// [`crate::Verdict::Rejected`] in a stream. A frame whose topology cannot be decided is not an
/// error: see [`crate::Defect`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be opened, read or written.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A stream without a file name could not be read or written.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The bytes do not follow their format.
    #[error("not a valid {format} ({place}): {what}")]
    Format {
        /// The format, "BCC" for example.
        format: &'static str,
        /// Position of the error: a line, a byte offset or a field.
        place: String,
        /// Value found and value expected.
        what: String,
    },
    /// linkwatch has no reader for this kind of file.
    #[error(
        "{path}: unknown kind of file (known: {MODEL_FILES}, and text with lines x y z, with the \
         option `closed` or the option `counts`); the Python package reads many others: `python -m \
         linkwatch convert {path} OUT.npz`"
    )]
    UnknownModel {
        /// The file.
        path: PathBuf,
    },
    /// A folder was given in place of a model file.
    #[error("{path}: not a regular file but a folder; {advice}")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Advice: how to name the models of the folder, or that it has none.
        advice: String,
    },
    /// A valid file of a kind that linkwatch does not read or cannot write.
    #[error("unsupported {format}: {what}")]
    Unsupported {
        /// The format, "BCC" for example.
        format: &'static str,
        /// Content found or requested, and the supported alternatives.
        what: String,
    },
    /// The content of a file cannot be used.
    #[error("{path}: {source}")]
    InFile {
        /// The file.
        path: PathBuf,
        /// Error in the file.
        source: Box<Error>,
    },
    /// A count does not agree with the data, or exceeds a limit.
    #[error("{what}: {promised} promised, {available} available")]
    Count {
        /// Name of the counted things.
        what: &'static str,
        /// Number given or needed.
        promised: u64,
        /// Number found, or the limit.
        available: u64,
    },
    /// A coordinate is NaN or infinite.
    #[error("curve {curve}, point {point}: coordinate {axis} is {value}")]
    NotFinite {
        /// Curve, from 0.
        curve: usize,
        /// Point within the curve, from 0.
        point: usize,
        /// `x`, `y` or `z`.
        axis: char,
        /// The value found.
        value: f64,
    },
    /// A coordinate of a spline is so large that its points cannot be computed.
    #[error(
        "curve {curve}: a coordinate of {found:.3e}; those of splines must stay below {limit:.3e}"
    )]
    TooLarge {
        /// Curve, from 0.
        curve: usize,
        /// Magnitude found.
        found: f64,
        /// Largest magnitude allowed.
        limit: f64,
    },
    /// No curve of the frame is closed, so there are no linking numbers, and the search for
    /// pull-throughs is off ([`SessionOptions::events`](crate::SessionOptions::events)).
    #[error(
        "nothing to verify: none of {curves} curves is closed{}; open ones are verified by a \
         search for pull-throughs, from one frame to the next",
        through_the_cell(*yarns)
    )]
    NothingClosed {
        /// Number of curves of the frame, all of them open.
        curves: usize,
        /// Number of those that run through the periodic cell.
        yarns: usize,
    },
    /// Braids do not fit the curves, or a frame breaks one of their conditions.
    #[error("{0}")]
    Braid(String),
    /// A curve has too few control points for its basis.
    #[error("curve {curve}: {points} control points, but {needed} are needed ({kind})")]
    CurveTooShort {
        /// Curve, from 0.
        curve: usize,
        /// Control points given.
        points: usize,
        /// Basis and closure, as text.
        kind: &'static str,
        /// Requirement of the basis, as text.
        needed: &'static str,
    },
    /// The curves of a frame differ from those of earlier frames.
    #[error("the curves changed between frames: {what} was {before}, is {now}")]
    LayoutChanged {
        /// Property that changed.
        what: &'static str,
        /// Value in the first frame.
        before: u64,
        /// Value in this frame.
        now: u64,
    },
    /// A curve that was closed in the first frame ends elsewhere than it starts.
    #[error(
        "curve {curve} is closed in the first frame, but its ends are {distance:.4e} apart now \
         (at most {within:.1e}): it was cut; if its ends met by chance, keep it open from the start"
    )]
    EndsApart {
        /// Curve, from 0.
        curve: usize,
        /// Distance of the ends.
        distance: f64,
        /// Largest distance of ends that meet.
        within: f64,
    },
    /// Data of another version of the format.
    #[error("{what} has version {found}; this build reads version {known}")]
    Version {
        /// The format.
        what: &'static str,
        /// The version found.
        found: u64,
        /// The version that this build knows.
        known: u64,
    },
    /// The certificate belongs to a model with another number of curves.
    #[error("the certificate is for {certificate} curves, the model has {model}")]
    CertificateMismatch {
        /// Number of curves of the certificate.
        certificate: usize,
        /// Number of curves of the model.
        model: usize,
    },
    /// A frame is compared with a baseline in which a curve is closed, but has that curve open.
    #[error(
        "curve {curve} is closed in the baseline, which has linking numbers or invariants of it, \
         but open in this frame: it cannot be verified with this baseline"
    )]
    OpenInFrame {
        /// Curve, from 0.
        curve: usize,
    },
    /// A frame has more pairs of curves that come close than
    /// [`SessionOptions::max_pairs`](crate::SessionOptions::max_pairs).
    #[error(
        "the boxes of more than {limit} pairs of curves overlap, which is the limit: raise it if \
         the memory suffices (--max-pairs)"
    )]
    TooManyPairs {
        /// The limit.
        limit: u64,
    },
    /// The description of a scene is invalid.
    #[error("scene {scene}: {what}")]
    Scene {
        /// The description.
        scene: String,
        /// Reason.
        what: String,
    },
    /// Arguments that cannot be combined, or cannot be used.
    #[error("{0}")]
    Usage(String),
    /// The device does not exist, or cannot be used.
    #[error("device: {0}")]
    Device(String),
    /// The work was cancelled ([`crate::Progress::cancel`]). The frame was not verified.
    #[error("cancelled")]
    Cancelled,
    /// This process was forked from one that used the library: it has none of its threads, and must
    /// not use its shared memory.
    #[error(
        "this process was forked from process {parent}, which used linkwatch: its threads and its \
         shared memory are not usable here. Start processes by `spawn` or `forkserver`, or use \
         linkwatch only after the fork"
    )]
    Forked {
        /// The process that used the library.
        parent: u32,
    },
    /// The state of a watch cannot be read or written, so that it cannot be continued.
    #[error("{0}")]
    State(String),
    /// The bus failed.
    #[error("bus: {0}")]
    Bus(String),
    /// A sink failed. It stays closed; the other sinks continue.
    #[error("{sink}: {what}")]
    Sink {
        /// Name of the sink.
        sink: &'static str,
        /// Reason.
        what: String,
    },
}

/// Result with [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// Creates the error of a malformed file or message.
    pub(crate) fn format(
        format: &'static str,
        place: impl std::fmt::Display,
        what: impl std::fmt::Display,
    ) -> Self {
        Self::Format {
            format,
            place: place.to_string(),
            what: what.to_string(),
        }
    }

    /// Creates the error of a count that promises more than is available, or allowed.
    pub(crate) fn count(
        what: &'static str,
        promised: impl TryInto<u64>,
        available: impl TryInto<u64>,
    ) -> Self {
        Self::Count {
            what,
            promised: promised.try_into().unwrap_or(u64::MAX),
            available: available.try_into().unwrap_or(u64::MAX),
        }
    }

    /// Creates the error of a valid format that is not supported.
    pub(crate) fn unsupported(format: &'static str, what: impl std::fmt::Display) -> Self {
        Self::Unsupported {
            format,
            what: what.to_string(),
        }
    }

    /// Adds the name of the file in which the error occurred, unless the error names one already.
    pub fn in_file(self, path: impl Into<PathBuf>) -> Self {
        let path = path.into();
        match self {
            Self::Io(source) => Self::File { path, source },
            named @ (Self::File { .. }
            | Self::InFile { .. }
            | Self::UnknownModel { .. }
            | Self::Folder { .. }) => named,
            other => Self::InFile {
                path,
                source: Box::new(other),
            },
        }
    }

    /// Names another file if the error names a file, or one beside it, under a temporary name.
    pub(crate) fn renamed(mut self, temporary: &Path, file: &Path) -> Self {
        if let Self::File { path, .. }
        | Self::InFile { path, .. }
        | Self::UnknownModel { path }
        | Self::Folder { path, .. } = &mut self
        {
            if path == temporary {
                *path = file.into();
            } else if let (Some(name), true) =
                (path.file_name(), path.parent() == temporary.parent())
            {
                *path = file.with_file_name(name);
            }
        }
        self
    }

    /// Returns a function that adds a path to an I/O error.
    pub(crate) fn file(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::File { path, source }
    }
}

/// Returns how many of the open curves run through the cell, as text.
fn through_the_cell(yarns: usize) -> String {
    match yarns {
        0 => String::new(),
        n => format!(
            ", and {n} of them run through the cell, which have no linking numbers with one another"
        ),
    }
}
