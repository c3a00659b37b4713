//! Where verified frames go: a recording, a viewer. Each may fail without stopping the others or the watch.
//!
//! A [`Sink`] is plain, single-threaded code. [`SinkQueue`] gives it a thread, a bounded queue and a deadline, so
//! that a slow disk or a viewer that hangs delays no verdict.

mod queue;
#[cfg(feature = "mcap")]
mod recording;
#[cfg(feature = "rerun")]
mod viewer;

pub use queue::{Overflow, SinkQueue, SinkSummary};
#[cfg(feature = "mcap")]
pub use recording::{
    Ending, RecordedFrame, RecordedItem, RecordedProgress, RecordedVerdict, RecordingReader,
    RecordingSink,
};
#[cfg(feature = "rerun")]
pub use viewer::{ViewerSink, ViewerTarget};

use crate::certificate::Certificate;
use crate::curve::CurveSet;
#[cfg(any(feature = "mcap", feature = "rerun"))]
use crate::error::Error;
use crate::error::Result;
use crate::incremental::Work;
use crate::verdict::Report;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

/// What every frame is compared with, and where it came from.
#[derive(Clone, Debug, PartialEq)]
pub struct BaselineRecord {
    /// The expected linking numbers.
    pub certificate: Arc<Certificate>,
    /// How it was obtained, in words: "first frame", or the name of a certificate file.
    pub origin: String,
}

/// One frame with everything that was found out about it.
#[derive(Clone, Debug)]
pub struct FrameRecord {
    /// The curves; none where the frame was rejected before it became curves.
    pub curves: Option<Arc<CurveSet>>,
    /// Number of cuts that the simulator made before this frame. If it differs from that of the
    /// previous frame, this frame does not continue that one.
    pub cuts: u32,
    /// What was found. The same for every run over the same frames.
    pub report: Arc<Report>,
    /// Frames verified so far, this one included.
    pub verified: u64,
    /// Frames that the simulator published and nobody verified, so far.
    pub skipped: u64,
    /// Frames rejected so far.
    pub rejected: u64,
    /// How long the verification of this frame took.
    pub check: Duration,
    /// What it took: another run may take another way to the same report.
    pub work: Work,
    /// When the frame arrived.
    pub received: SystemTime,
}

/// A destination for verified frames.
///
/// Calls come from one thread. After the first error a sink is not called again.
pub trait Sink: Send {
    /// A short name for messages, "recording" for example.
    fn name(&self) -> &'static str;

    /// Takes note of the baseline. Comes once, before the first frame that is compared with it; rejected frames
    /// may come earlier.
    fn begin(&mut self, baseline: &BaselineRecord) -> Result<()>;

    /// Takes a frame.
    fn frame(&mut self, record: &FrameRecord) -> Result<()>;

    /// Makes what was taken so far safe from a crash of this process.
    fn flush(&mut self) -> Result<()>;

    /// Closes the destination properly. Dropping a sink without it may leave an unfinished file.
    fn finish(self: Box<Self>) -> Result<()>;
}

/// Creates a regular file, or truncates it. Rejects any other kind, since opening a pipe without a
/// reader would block without end.
#[cfg(any(feature = "mcap", feature = "rerun"))]
fn create_file(path: &std::path::Path) -> Result<std::fs::File> {
    if std::fs::metadata(path).is_ok_and(|m| !m.is_file()) {
        let source = std::io::Error::other("not a regular file");
        return Err(Error::file(path)(source));
    }
    std::fs::File::create(path).map_err(Error::file(path))
}
