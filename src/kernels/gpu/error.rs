//! Failures of an adapter.

use std::fmt;

/// Failure of an adapter. The caller logs it once and falls back to the CPU.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Error {
    /// No adapter exists, or none or several match the choice; with a message.
    NoAdapter(String),
    /// The arithmetic of the adapter does not satisfy the assumptions of the error bounds.
    Arithmetic(String),
    /// The work exceeds a limit of the adapter; with a message.
    Limit(String),
    /// Out of memory, lost, or a driver error; with the message of the driver.
    Failed(String),
}

impl Error {
    /// Returns the error for a limit that is exceeded.
    pub fn limit(what: &str, needed: u64, limit: u64) -> Error {
        Error::Limit(format!(
            "{needed} {what} needed, the adapter allows {limit}"
        ))
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Arithmetic(what) => {
                write!(f, "the arithmetic of the adapter is wrong: {what}")
            }
            Error::NoAdapter(what) | Error::Limit(what) | Error::Failed(what) => f.write_str(what),
        }
    }
}
