//! Destinations of verified frames: a recording and a viewer. A failure of one does not stop the
//! others or the watch.
//!
//! A [`Sink`] is plain, single-threaded code. [`SinkQueue`] runs it on a thread behind a bounded
//! queue with a time limit, so that a slow disk or a blocked viewer delays no verdict.

mod queue;
mod times;

pub use queue::{Overflow, SinkQueue, SinkSummary};
pub use times::{FrameTimes, LiveTimes, RunProgress};

use crate::certificate::Certificate;
use crate::curve::CurveSet;
use crate::error::Result;
use crate::ingest::FrameInfo;
use crate::verdict::Report;
use std::sync::Arc;

/// Certificate that every frame is compared with, and its origin.
#[derive(Clone, Debug, PartialEq)]
pub struct BaselineRecord {
    /// The expected linking numbers.
    pub certificate: Arc<Certificate>,
    /// Origin as text: "first frame", or the name of a certificate file.
    pub origin: String,
    /// The frame with these linking numbers; `None` if they come from a file.
    pub frame: Option<u64>,
    /// Number of frames that were published before it, but verified by nobody.
    pub unverified: u64,
}

/// A frame with all results of its verification.
#[derive(Clone, Debug)]
pub struct FrameRecord {
    /// The curves; `None` if the frame was rejected before it became curves.
    pub curves: Option<Arc<CurveSet>>,
    /// Information of the simulator about the frame.
    pub info: FrameInfo,
    /// Report on the frame. The same for every run over the same frames.
    pub report: Arc<Report>,
    /// State of the run.
    pub progress: RunProgress,
}

/// Destination for verified frames.
///
/// Calls come from one thread. After the first error a sink is not called again.
pub trait Sink: Send {
    /// Records the baseline. Called before the first frame that is compared with it. Rejected
    /// frames may precede it. Called again if the next frame does not continue the previous ones,
    /// and may have another baseline.
    ///
    /// # Errors
    ///
    /// The destination cannot be written.
    fn begin(&mut self, baseline: &BaselineRecord) -> Result<()>;

    /// Passes the baseline after the next frame, if that frame changes it, because curves appeared
    /// or disappeared, or because pairs have linking numbers again. A sink with all frames need not
    /// record it, because a replay of these frames changes it in the same way.
    ///
    /// # Errors
    ///
    /// The destination cannot be written.
    fn expect(&mut self, _baseline: &BaselineRecord) -> Result<()> {
        Ok(())
    }

    /// Records a frame.
    ///
    /// # Errors
    ///
    /// The destination cannot be written.
    fn frame(&mut self, record: &FrameRecord) -> Result<()>;

    /// Tells, after the last frame, why the run has no end, although all its frames are recorded.
    ///
    /// # Errors
    ///
    /// The destination cannot be written.
    fn cut_off(&mut self, _why: &str) -> Result<()> {
        Ok(())
    }

    /// Writes all frames so far, so that they survive a crash of this process.
    ///
    /// # Errors
    ///
    /// The destination cannot be written.
    fn flush(&mut self) -> Result<()>;

    /// Continues work that can wait, one frame of it, while no frame waits for the sink. Returns
    /// true if more is left.
    ///
    /// # Errors
    ///
    /// The destination cannot be written.
    fn work(&mut self) -> Result<bool> {
        Ok(false)
    }

    /// Returns words about the result for the summary of the run, if there is more to say than the
    /// number of frames.
    fn note(&self) -> Option<String> {
        None
    }

    /// Closes the destination. A sink that is dropped without this call may leave an incomplete
    /// file.
    ///
    /// # Errors
    ///
    /// The destination cannot be written.
    fn finish(self: Box<Self>) -> Result<()>;
}
