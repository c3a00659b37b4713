//! State of a run, from which the run of another process continues.

use super::baseline::Origin;
use super::{Judged, Run};
use linkwatch::{Counters, FrameTimes, Result, Session, SessionState, Work};
use serde::{Deserialize, Serialize};

/// State of a run after a frame.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct RunState {
    pub session: SessionState,
    /// Origin of the baseline. `None` until a frame was verified with the baseline.
    origin: Option<Origin>,
}

impl RunState {
    /// Returns true if this is the state after a frame, and no frame after a later cut was begun.
    /// `cuts` is the number of cuts before the last frame that was begun.
    pub fn is_after(&self, seq: Option<u64>, cuts: u32) -> bool {
        self.session.info().map(|info| (info.seq, info.cuts)) == seq.map(|seq| (seq, cuts))
    }
}

impl Run {
    /// Returns the state after the last frame.
    pub fn state(&self) -> RunState {
        RunState {
            session: self.session.state(),
            origin: self.origin.clone(),
        }
    }

    /// Begins after the frames of another process, whose numbers are `before`.
    pub fn follow_on(&mut self, before: Counters) {
        self.before = before;
        self.data_lost();
    }

    /// Continues the run of another process before the first frame.
    pub fn resume(&mut self, state: RunState) -> Result<()> {
        let progress = self.session.progress();
        let options = self.options.clone();
        self.session = Session::resume(options, state.session)?;
        self.session.share_progress(progress);
        self.origin = state.origin;
        self.resumed = true;
        Ok(())
    }

    /// Returns the result of a frame that the other process did not finish. The frame is not
    /// verified again, because it may have caused the crash. It does not ask the simulator to stop.
    pub fn give_up(&self, seq: u64, time: f64, why: &str) -> Judged {
        let report = self.session.give_up(seq, time, why);
        Judged::of(report, FrameTimes::default(), Work::default())
    }
}
