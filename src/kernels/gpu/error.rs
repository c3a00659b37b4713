//! Failures of an adapter.

/// Failure of an adapter. The caller logs it once and falls back to the CPU.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Error {
    /// No adapter exists, or none or several match the choice; with a message.
    #[error("{0}")]
    NoAdapter(String),
    /// The arithmetic of the adapter does not satisfy the assumptions of the error bounds.
    #[error("the arithmetic of the adapter is wrong: {0}")]
    Arithmetic(String),
    /// The work exceeds a limit of the adapter; with a message.
    #[error("{0}")]
    Limit(String),
    /// Out of memory, lost, or a driver error; with the message of the driver.
    #[error("{0}")]
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
