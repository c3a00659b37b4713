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
            Trouble::NoAdapter { wanted, found } => {
                match wanted {
                    Some(name) => write!(f, "no adapter is called {name}")?,
                    None => write!(f, "no adapter")?,
                }
                match &found[..] {
                    [] => write!(f, "; there are none"),
                    names => write!(f, "; there are: {}", names.join(", ")),
                }
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
