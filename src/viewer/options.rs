//! Part of a run that a viewer shows.

use std::num::NonZeroU64;

/// Curves and frames that a viewer shows. The log and the plots have all frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewerOptions {
    /// Show the curves of every n-th frame, and of each frame whose verdict is not intact or
    /// differs from that of the previous one.
    pub every: NonZeroU64,
    /// Show only curves that took part in a finding so far, and their neighbours.
    pub only_violated: bool,
}

impl Default for ViewerOptions {
    /// All curves of all frames.
    fn default() -> ViewerOptions {
        ViewerOptions {
            every: NonZeroU64::MIN,
            only_violated: false,
        }
    }
}
