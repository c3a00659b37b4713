//! Kinds of pull-throughs that are searched for; work counters of a frame, and its route.

/// Work counters of a frame. Not a part of [`Report`](crate::Report), because they depend on
/// previous frames and on the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct Work {
    /// Route of the frame.
    pub route: Route,
    /// Number of blocks of eight segments, if the frame was compared with a reference frame.
    pub blocks: u64,
    /// Number of blocks that depend on a point that moved further than its allowance, in this frame
    /// or the previous one. 0 if too many points moved to list them.
    pub marked: u64,
    /// Number of pairs of near blocks, at least one of them marked, that cannot have met.
    pub recertified: u64,
    /// Number of pairs with recomputed linking numbers: all potential links on the full route; on
    /// the partial route, pairs with a passage or a contact, and pairs that had no number.
    pub recomputed: u64,
    /// Number of recomputed pairs that the bound of a sum decided
    /// ([`SessionOptions::kernel`](crate::SessionOptions::kernel)).
    pub summed: u64,
    /// Number of pairs of curves (and of curves with themselves) that were searched for passages
    /// since the previous frame.
    pub searched: u64,
    /// Number of frames since the reference frame, if the frame was compared with one.
    pub reference_age: Option<u64>,
    /// True if the full run gave another result
    /// ([`Strategy::Paranoid`](crate::Strategy::Paranoid)): an error of linkwatch. The
    /// report is that of the full run.
    pub disagreed: bool,
}

vocabulary! {
    /// Route of a frame through the engine.
    #[derive(Default)]
    pub enum Route {
        /// All linking numbers were computed.
        #[default]
        Full = "full",
        /// No point moved further than its allowance, so all linking numbers are those of the
        /// reference frame.
        Quiet = "quiet",
        /// Pairs that may have passed through each other since the previous frame were searched.
        /// All other pairs, and those without a passage, have the linking numbers of that frame.
        Partial = "partial",
    }
}

vocabulary! {
    /// Kinds of pull-throughs that are searched for between frames.
    ///
    /// The search also finds pull-throughs that linking numbers do not show: two that cancel, those
    /// of a curve through itself, and those of open curves.
    #[derive(Default)]
    pub enum Events {
        /// No search.
        #[default]
        Off = "off",
        /// Pull-throughs between two different curves, closed or open.
        Between = "between",
        /// All pull-throughs, including those of a curve through itself.
        All = "all",
    }
}
