//! Frame after frame: what moved, what it may have broken, and what passed through what.
//!
//! ```text
//! frame ─▶ affine frame ─▶ one pass over all points ─┬▶ nothing moved too far: as the reference frame
//!              (affine)        (stream)              ├▶ little did: which pairs? (motion) ─▶ only these anew
//!                                                    └▶ much did: all anew ─▶ a new reference, beside the stream
//!                                                    (reference, kept by the monitor)
//! frame before, frame ─▶ which pairs may have passed through one another? (motion) ─▶ ledger ─▶ pull-throughs
//! ```
//!
//! No chain of frames for linking numbers: each frame is compared with the reference frame itself, so nothing adds up.

mod affine;
mod ledger;
mod monitor;
mod motion;
mod packed;
mod reference;
mod stream;
#[cfg(test)]
mod tests;

pub use crate::verdict::PullThrough;
pub(crate) use ledger::{Contacts, Ledger, MOTION_LIMIT, Outcome};
pub(crate) use monitor::{Finding, Monitor};

use std::fmt;
use std::str::FromStr;

/// Which pull-throughs are looked for, from frame to frame.
///
/// Linking numbers do not see two that cancel, a curve pulled through itself, and open curves; this does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Events {
    /// None.
    #[default]
    Off,
    /// Of two different curves, open ones included.
    Between,
    /// These, and those of a curve through itself.
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
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|e| e.1 == s).map(|e| e.0);
        found.ok_or_else(|| "expected off, between or all".into())
    }
}

/// Which segments are looked at, beside those of two different closed curves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Cover {
    /// Those of one curve.
    pub own: bool,
    /// Those of open curves.
    pub open: bool,
}

/// What a frame took. No part of a [`Report`](crate::Report): it depends on the frames before and on the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Work {
    /// The way that the frame took.
    pub route: Route,
    /// Blocks of eight segments in all, where the frame was compared with a reference frame.
    pub blocks: u64,
    /// Blocks with a point that moved further than it may without a closer look.
    pub marked: u64,
    /// Pairs of curves near such a block, proven to be as they were by the boxes of their motion.
    pub recertified: u64,
    /// Pairs whose linking numbers were computed anew: all potential links on the full way.
    pub recomputed: u64,
    /// Those of them that the bound of a sum decided ([`Verifier::set_kernel`](crate::Verifier::set_kernel)).
    pub summed: u64,
    /// Pairs of curves (and curves by themselves) that were searched for pull-throughs since the frame before.
    pub searched: u64,
    /// Frames since the reference frame, where the frame was compared with one.
    pub reference_age: Option<u64>,
    /// Whether computing everything gave another result ([`Verifier::set_paranoid`](crate::Verifier::set_paranoid)):
    /// an error of linkwatch. The report is the one of the full run.
    pub disagreed: bool,
}

/// The way that a frame took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Route {
    /// All linking numbers were computed.
    #[default]
    Full,
    /// No point moved further than it may: everything is as in the reference frame.
    Quiet,
    /// Some pairs were looked at, or computed anew.
    Partial,
}

impl Route {
    /// Every route, in the order of its code in recordings.
    pub const ALL: [Route; 3] = [Route::Full, Route::Quiet, Route::Partial];

    /// One word.
    pub fn word(self) -> &'static str {
        match self {
            Route::Full => "full",
            Route::Quiet => "quiet",
            Route::Partial => "partial",
        }
    }
}
