//! Results of the frames of a run.

use linkwatch::kernels::Offload;
use linkwatch::{Continuation, CurveSet, FrameInfo, FrameTimes, Report, Work};
use std::sync::Arc;
use std::time::Duration;

/// Result of a frame, before it goes to the sinks.
pub struct Judged {
    pub report: Arc<Report>,
    pub times: FrameTimes,
    pub work: Work,
    /// Work done on the GPU.
    pub offload: Offload,
    pub curves: Option<Arc<CurveSet>>,
    /// Information of the simulator about the frame.
    pub info: FrameInfo,
    /// Model file of the frame, if it comes from one.
    pub model: Option<String>,
    /// Time from the receipt of the frame until its verdict was sent, if it is live.
    pub latency: Option<Duration>,
    /// How the frame follows the last one.
    pub step: Continuation,
}

impl Judged {
    /// Returns a result without the curves of the frame.
    pub fn of(report: Report, times: FrameTimes, work: Work) -> Judged {
        Judged {
            info: FrameInfo::at(report.seq, report.time),
            report: Arc::new(report),
            times,
            work,
            offload: Offload::default(),
            curves: None,
            model: None,
            latency: None,
            step: Continuation::Continues,
        }
    }
}
