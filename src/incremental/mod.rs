//! Incremental verification: allowances of a reference frame, and the ledger of pull-throughs
//! between frames.
//!
//! ```text
//! frame ─▶ affine frame ─▶ one pass over all points ─┬▶ quiet: as the reference frame
//!              (affine)        (stream)              ├▶ partial: recompute affected pairs (motion)
//!                                                    └▶ full: recompute all ─▶ new reference frame
//!                                                       (reference, monitor; in the background)
//! previous and current frame ─▶ pairs that may have passed through each other (motion)
//!                            ─▶ ledger ─▶ pull-throughs
//! ```
//!
//! Linking numbers depend on no chain of frames: each frame is compared with the reference frame
//! itself, so errors do not accumulate.

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

/// Kinds of pull-throughs that are searched for between frames.
///
/// The search also finds pull-throughs that linking numbers do not show: two that cancel, those of
/// a curve through itself, and those of open curves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
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
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|e| e.1 == s).map(|e| e.0);
        found.ok_or_else(|| "expected off, between or all".into())
    }
}

/// Segments that are covered in addition to those of two different closed curves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Cover {
    /// Pairs of segments of the same curve.
    pub own: bool,
    /// Segments of open curves.
    pub open: bool,
}

/// Work counters of a frame. Not a part of [`Report`](crate::Report), because they depend on
/// previous frames and on the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Work {
    /// Route of the frame.
    pub route: Route,
    /// Number of blocks of eight segments, if the frame was compared with a reference frame.
    pub blocks: u64,
    /// Number of blocks that depend on a point that moved further than its allowance.
    pub marked: u64,
    /// Number of pairs of curves near such a block that the boxes of their motion proved unchanged.
    pub recertified: u64,
    /// Number of pairs with recomputed linking numbers: all potential links on the full route.
    pub recomputed: u64,
    /// Number of recomputed pairs that the bound of a sum decided
    /// ([`VerifierOptions::kernel`](crate::VerifierOptions::kernel)).
    pub summed: u64,
    /// Number of pairs of curves (and of curves with themselves) that were searched for
    /// pull-throughs since the previous frame.
    pub searched: u64,
    /// Number of frames since the reference frame, if the frame was compared with one.
    pub reference_age: Option<u64>,
    /// True if the full run gave another result
    /// ([`Strategy::Paranoid`](crate::Strategy::Paranoid)): an error of linkwatch. The
    /// report is that of the full run.
    pub disagreed: bool,
}

/// Route of a frame through the verifier.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Route {
    /// All linking numbers were computed.
    #[default]
    Full,
    /// No point moved further than its allowance, so all linking numbers are those of the reference
    /// frame.
    Quiet,
    /// Some pairs were checked or recomputed.
    Partial,
}

impl Route {
    /// All routes, in the order of their codes in recordings.
    pub const ALL: [Route; 3] = [Route::Full, Route::Quiet, Route::Partial];

    /// Returns the name of the route.
    pub fn word(self) -> &'static str {
        match self {
            Route::Full => "full",
            Route::Quiet => "quiet",
            Route::Partial => "partial",
        }
    }
}
