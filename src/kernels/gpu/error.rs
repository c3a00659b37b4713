//! Why work that was given to an adapter did not come back.

use std::fmt;

/// What went wrong. The caller goes on without the adapter, and says so once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Trouble {
    /// There is no adapter, or none of that name; those there are.
    NoAdapter {
        /// The name asked for.
        wanted: Option<String>,
        /// Names of all adapters.
        found: Vec<String>,
    },
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
            Trouble::NoAdapter { found, .. } if found.is_empty() => {
                f.write_str("no adapter found (Vulkan, Metal or DX12)")
            }
            Trouble::NoAdapter { wanted, found } => {
                let wanted = wanted.as_deref().unwrap_or_default();
                let names = found.join(", ");
                write!(f, "no adapter is called {wanted}; there are: {names}")
            }
            Trouble::Arithmetic(what) => write!(f, "its arithmetic cannot be relied on: {what}"),
            Trouble::Limit {
                what,
                needed,
                limit,
            } => write!(f, "{needed} {what} needed, {limit} possible"),
            Trouble::Failed(what) => f.write_str(what),
        }
    }
}
