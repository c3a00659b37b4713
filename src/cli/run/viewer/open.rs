//! Opens the viewers.

use super::{Shown, ViewerArgs};
use crate::cli::files::{Overwrite, claim};
use crate::cli::run::sinks::{WAITING, WAITING_POINTS};
use linkwatch::{
    ClearanceOptions, Error, Overflow, Result, Sink, SinkQueue, ViewerOptions, ViewerSink,
    ViewerTarget,
};
use std::num::NonZeroU64;
use std::time::Duration;

/// Time limit for a viewer of a live simulation to open before the run begins. After that it opens
/// in the background.
const OPEN: Duration = Duration::from_secs(10);

impl ViewerArgs {
    /// Opens the viewer, or the file at the first frame. `title` names the run. The viewer shows
    /// the clearance if it is measured.
    ///
    /// Errors: a viewer cannot be reached or started.
    pub fn open(
        &self,
        title: &str,
        clearance: Option<ClearanceOptions>,
        (overflow, overwrite): (Overflow, Overwrite),
    ) -> Result<Option<SinkQueue>> {
        let title = title.to_owned();
        let options = ViewerOptions {
            every: self.view_every.unwrap_or(NonZeroU64::MIN),
            only_violated: self.view_only == Some(Shown::Violated),
        };
        let open = move |target: &ViewerTarget| {
            let sink = ViewerSink::open(target, &title)?.with_options(options);
            let sink = match clearance {
                Some(clearance) => sink.with_clearance(clearance)?,
                None => sink,
            };
            Ok(Box::new(sink) as Box<dyn Sink>)
        };
        if let Some(path) = self.rrd.clone() {
            let queue = SinkQueue::spawn("viewer", WAITING, overflow, move || {
                claim(&path, overwrite)?;
                open(&ViewerTarget::File(path))
            });
            return Ok(Some(queue?.with_points(WAITING_POINTS)));
        }
        let target = match (&self.connect, self.serve) {
            (Some(url), _) => ViewerTarget::Connect(url.clone()),
            (None, Some(port)) => ViewerTarget::Serve(port),
            (None, None) if self.view => ViewerTarget::Spawn,
            (None, None) => return Ok(None),
        };
        let others = match target {
            ViewerTarget::Spawn => ", and --serve shows the frames in a browser",
            _ => "",
        };
        let (overflow, limit) = of_viewer(overflow);
        let queue = SinkQueue::spawn("viewer", WAITING, overflow, move || open(&target))?;
        if !self.later {
            // If the viewer cannot be reached, the command fails at once, not at its first frame.
            queue.open(limit).map_err(|e| {
                let file = "--rrd FILE.rrd writes a file for a viewer on any machine";
                Error::Usage(format!("{e}; {file}{others}"))
            })?;
        }
        Ok(Some(queue))
    }
}

/// Returns the policy of a viewer if it is slower than the frames, and the time limit for it to
/// open, from the policy of a file.
///
/// No simulator waits for a replay, so that its viewer gets all frames. A file must be complete,
/// because a gap would mislead, but the viewer of a live simulation may miss a frame.
fn of_viewer(overflow: Overflow) -> (Overflow, Duration) {
    match overflow {
        Overflow::WaitForProgress(limit) => (overflow, limit),
        Overflow::Wait(_) | Overflow::DropOldest => (Overflow::DropOldest, OPEN),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_viewer_gets_all_frames_of_a_replay_and_delays_no_live_run() {
        let second = Duration::from_secs(1);
        let replay = Overflow::WaitForProgress(second);
        assert_eq!(of_viewer(replay), (replay, second));
        let live = Overflow::Wait(second);
        assert_eq!(of_viewer(live), (Overflow::DropOldest, OPEN));
    }
}
