//! Frame after frame: what moved, and what it may have broken.

mod ledger;

pub use ledger::PullThrough;

/// What a frame took. No part of a [`Report`](crate::Report): it depends on the frames before and on the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Work {
    /// The way that the frame took.
    pub route: Route,
    /// Blocks of eight segments in all.
    pub blocks: u64,
    /// Blocks with a point that moved further than it may without a closer look.
    pub marked: u64,
    /// Pairs of curves near such a block, proven to be as they were by the boxes of their motion.
    pub recertified: u64,
    /// Pairs whose linking numbers were computed anew.
    pub recomputed: u64,
    /// Frames since the reference frame, where the frame was compared with one.
    pub reference_age: Option<u64>,
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
