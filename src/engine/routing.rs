//! Choice between a search of the step from the previous frame and a full run, by the measured
//! times of both.

use std::time::Duration;

/// Maximum number of full runs between two searches, if the searches take longer.
const MAX_BACKOFF: u32 = 64;

/// Times of earlier frames. They affect only the route of a frame, not its result.
#[derive(Debug, Default)]
pub(super) struct Routing {
    /// Time of the last full run.
    pub full_run: Duration,
    /// Number of full runs that follow a search that took longer.
    backoff: u32,
    /// Number of these full runs that remain.
    left: u32,
}

impl Routing {
    /// Returns true if the step of this frame should be searched.
    pub fn search_pays(&mut self) -> bool {
        let pays = self.left == 0;
        self.left = self.left.saturating_sub(1);
        pays
    }

    /// Records the time of a search.
    pub fn took_search(&mut self, took: Duration) {
        self.backoff = match took <= self.full_run {
            true => 0,
            false => (2 * self.backoff).clamp(1, MAX_BACKOFF),
        };
        self.left = self.backoff;
    }
}
