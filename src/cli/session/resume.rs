//! A session that continues that of another process, which crashed.

use super::baseline::BaselineFrame;
use super::{FrameCounts, Judged, Session, Step};
use linkwatch::{
    Certificate, CurveLabels, FrameInfo, FrameTimes, Intactness, Report, Result, Verdict, Verifier,
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Reason why the first frame after a restart is undecided if pull-throughs are searched for.
const UNKNOWN_STEP: &str =
    "the watch crashed and was started again, so pull-throughs before this frame are unknown";

/// Expected linking numbers of a session, and the curves that they belong to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Expected {
    pub baseline: Certificate,
    /// Certificate file that they come from; `None` if it is the first frame.
    pub origin: Option<String>,
    pub layout: u32,
    pub labels: CurveLabels,
    /// See [`FrameInfo::baseline`].
    pub baseline_frame: u64,
}

impl Session {
    /// Returns the expected linking numbers, if they changed since the last call. Call this after a
    /// frame that was not rejected.
    pub fn take_changed_baseline(&mut self) -> Option<Expected> {
        let baseline = self.verifier.take_changed_baseline()?.clone();
        let last = self.last.as_ref()?;
        Some(Expected {
            baseline,
            origin: self.origin.clone(),
            layout: last.layout,
            labels: (*last.labels).clone(),
            baseline_frame: last.baseline,
        })
    }

    /// Begins after another process, which counted these frames.
    pub fn follow_on(&mut self, before: FrameCounts) {
        self.before = before;
        self.data_lost();
    }

    /// Continues the session of another process before the first frame. `cuts` is the number of
    /// cuts that the simulator had made.
    pub fn resume(&mut self, expected: Expected, cuts: u32, intactness: Intactness) -> Result<()> {
        self.options.baseline = Some(expected.baseline);
        self.verifier = Verifier::new(self.options.clone())?;
        self.verifier.resume(intactness, UNKNOWN_STEP.into());
        self.baseline_frame = Some(BaselineFrame {
            frame: Some(expected.baseline_frame).filter(|_| expected.origin.is_none()),
            unverified: 0,
        });
        self.origin = expected.origin;
        self.last = Some(FrameInfo {
            cuts,
            baseline: expected.baseline_frame,
            layout: expected.layout,
            labels: Arc::new(expected.labels),
            ..FrameInfo::default()
        });
        Ok(())
    }

    /// Returns the result of a frame that the other process did not finish. It is not verified
    /// again, because it may be the reason of the crash, and does not ask the simulator to stop.
    pub fn give_up(&self, seq: u64, time: f64, why: &str) -> Judged {
        let report = Report {
            rejected: Some(why.into()),
            last_intact: self.verifier.intactness().last_intact(),
            ..Report::new(seq, time, Verdict::Rejected)
        };
        Judged {
            report: Arc::new(report),
            times: FrameTimes::default(),
            work: Default::default(),
            offload: Default::default(),
            curves: None,
            info: FrameInfo::default(),
            model: None,
            left_out: Vec::new(),
            latency: None,
            clearance: None,
            step: Step::Continues,
        }
    }
}
