//! Kinds of pull-throughs that a stream is searched for.

use crate::error::{Error, Result};
use std::fmt;
use std::str::FromStr;

/// Kinds of pull-throughs that are searched for between frames.
///
/// The search also finds pull-throughs that linking numbers do not show: two that cancel, those of
/// a curve through itself, and those of open curves.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    serde::Serialize,
    serde::Deserialize,
)]
pub enum Events {
    /// No search.
    #[default]
    Off,
    /// Pull-throughs between two different curves, closed or open.
    Between,
    /// All pull-throughs, including those of a curve through itself.
    All,
}

impl Events {
    const ALL: [(Events, &'static str); 3] = [
        (Events::Off, "off"),
        (Events::Between, "between"),
        (Events::All, "all"),
    ];
}

impl fmt::Display for Events {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = Self::ALL.iter().find(|e| e.0 == *self).map_or("", |e| e.1);
        f.pad(word)
    }
}

impl FromStr for Events {
    type Err = Error;
    fn from_str(s: &str) -> Result<Self> {
        let found = Self::ALL.iter().find(|e| e.1 == s).map(|e| e.0);
        found.ok_or_else(|| Error::Usage("expected off, between or all".into()))
    }
}
