//! The way in which a process waits for the other side.

use crate::error::{Error, Result};
use std::fmt;
use std::str::FromStr;

/// How a client or a watcher waits for the next message. Both sides choose independently.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WaitMode {
    /// Sleeps until the other side wakes it. Waking takes the system 10 to 50 microseconds. An idle
    /// watcher uses 0.2 % of a core.
    #[default]
    Sleep,
    /// Polls without a pause: receives a message within about a microsecond, but keeps one core
    /// busy as long as it waits. Needs a core of its own; without one, it delays the other side.
    Spin,
}

impl WaitMode {
    /// All modes.
    pub const ALL: [WaitMode; 2] = [WaitMode::Sleep, WaitMode::Spin];

    /// Returns the word for this mode on the command line.
    pub fn word(self) -> &'static str {
        match self {
            WaitMode::Sleep => "sleep",
            WaitMode::Spin => "spin",
        }
    }
}

impl fmt::Display for WaitMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl FromStr for WaitMode {
    type Err = Error;
    fn from_str(s: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|mode| mode.word() == s);
        found.ok_or_else(|| Error::Usage("expected sleep or spin".into()))
    }
}
