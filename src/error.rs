//! Errors, with the numbers that disagree.

use std::path::PathBuf;

/// What can go wrong between bytes and a verdict.
///
/// A frame that breaks its contract is an error of this type (and becomes [`crate::Verdict::Rejected`]
/// in a stream). A frame whose topology cannot be decided is not an error: see [`crate::Defect`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be opened, read or written.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A stream that is no named file could not be read or written.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The bytes are not what their format promises.
    #[error("not a valid {format} ({place}): {what}")]
    Format {
        /// The format, "BCC" for example.
        format: &'static str,
        /// Where: a line, a byte offset or a field.
        place: String,
        /// What was found and what was expected.
        what: String,
    },
    /// The file needs a reader that linkwatch does not have.
    #[error("{path}: unknown kind of file (known: .bcc, .obj, .vect)")]
    UnknownModel {
        /// The file.
        path: PathBuf,
    },
    /// A folder was given in place of a model file.
    #[error("{path}: not a regular file but a folder; {advice}")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// How to name its models, or that it holds none.
        advice: String,
    },
    /// A valid file of a kind that linkwatch does not read or cannot write.
    #[error("unsupported {format}: {what}")]
    Unsupported {
        /// The format, "BCC" for example.
        format: &'static str,
        /// What was found or asked for, and what is possible.
        what: String,
    },
    /// The content of a file cannot be used.
    #[error("{path}: {source}")]
    InFile {
        /// The file.
        path: PathBuf,
        /// What is wrong in it.
        source: Box<Error>,
    },
    /// A count promises more than the data holds.
    #[error("{what}: {promised} promised, {available} available")]
    Count {
        /// What was counted.
        what: &'static str,
        /// The number that the header gave.
        promised: u64,
        /// The number that the data can hold.
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
        /// Largest magnitude found.
        found: f64,
        /// Largest magnitude allowed.
        limit: f64,
    },
    /// A frame has no closed curve, and so no linking number, and no pull-throughs are looked for
    /// ([`Verifier::set_events`](crate::Verifier::set_events)).
    #[error(
        "nothing to verify: none of {curves} curves is closed (a closed curve has a count below 0); \
         --events looks for pull-throughs of open curves"
    )]
    NothingClosed {
        /// Curves of the frame, all of them open.
        curves: usize,
    },
    /// A curve has too few control points for its basis.
    #[error("curve {curve}: {points} control points, but a {kind} curve needs {needed}")]
    CurveTooShort {
        /// Curve, from 0.
        curve: usize,
        /// Control points given.
        points: usize,
        /// Basis and closure, in words.
        kind: &'static str,
        /// What it needs, in words.
        needed: &'static str,
    },
    /// A frame has other curves than the frames before it.
    #[error("the curves changed between frames: {what} was {before}, is {now}")]
    LayoutChanged {
        /// What changed.
        what: &'static str,
        /// In the first frame.
        before: u64,
        /// In this frame.
        now: u64,
    },
    /// Written by another version.
    #[error("{what} has version {found}; this build reads version {known}")]
    Version {
        /// The format.
        what: &'static str,
        /// The version found.
        found: u64,
        /// The version that this build knows.
        known: u64,
    },
    /// A certificate cannot be used with this model.
    #[error("the certificate is for {certificate} curves, the model has {model}")]
    CertificateMismatch {
        /// Curves of the certificate.
        certificate: usize,
        /// Curves of the model.
        model: usize,
    },
    /// The description of a scene cannot be used.
    #[error("scene {scene}: {what}")]
    Scene {
        /// The description.
        scene: String,
        /// What is wrong with it.
        what: String,
    },
    /// Arguments that do not go together.
    #[error("{0}")]
    Usage(String),
    /// There is no such device, or none that can be used.
    #[error("device: {0}")]
    Device(String),
    /// The work was cancelled ([`crate::Progress::cancel`]). The frame was not verified.
    #[error("cancelled")]
    Cancelled,
    /// The bus failed.
    #[error("bus: {0}")]
    Bus(String),
    /// A sink failed; it stays failed, the others go on.
    #[error("{sink}: {what}")]
    Sink {
        /// Which sink.
        sink: &'static str,
        /// What happened.
        what: String,
    },
}

/// Result with [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// A malformed file or message.
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

    /// A format that is understood, but not supported.
    pub(crate) fn unsupported(format: &'static str, what: impl std::fmt::Display) -> Self {
        Self::Unsupported {
            format,
            what: what.to_string(),
        }
    }

    /// Names the file in which this error was found, where it names none.
    pub fn in_file(self, path: impl Into<PathBuf>) -> Self {
        let path = path.into();
        match self {
            Self::Io(source) => Self::File { path, source },
            named @ (Self::File { .. } | Self::InFile { .. }) => named,
            other => Self::InFile {
                path,
                source: Box::new(other),
            },
        }
    }

    /// An I/O error with the path that it belongs to.
    pub(crate) fn file(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::File { path, source }
    }
}
