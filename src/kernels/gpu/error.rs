//! Why work that was given to an adapter did not come back.

use std::fmt;

/// What went wrong. The caller goes on without the adapter, and says so once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Trouble {
    /// No adapter was found, or none, or several, fit the name; with a message.
    NoAdapter(String),
    /// Its arithmetic is not what the bounds rest on.
    Arithmetic(String),
    /// More than the adapter can take.
    Limit {
        /// Of what.
        what: &'static str,
        /// Asked for.
        needed: u64,
        /// Allowed.
        limit: u64,
    },
    /// Out of memory, lost, or an error of the driver; in its words.
    Failed(String),
}

impl Trouble {
    /// More than the adapter can take.
    pub fn limit(what: &'static str, needed: u64, limit: u64) -> Trouble {
        Trouble::Limit {
            what,
            needed,
            limit,
        }
    }
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Trouble::Arithmetic(what) => write!(f, "its arithmetic cannot be relied on: {what}"),
            Trouble::Limit {
                what,
                needed,
                limit,
            } => write!(f, "{needed} {what} needed, {limit} possible"),
            Trouble::NoAdapter(what) | Trouble::Failed(what) => f.write_str(what),
        }
    }
}
