//! Frames at the stages of a session: given, received, verified.

use crate::curve::CurveSet;
use crate::engine::Timings;
use crate::error::Result;
use crate::incremental::Work;
use crate::ingest::{ClosingNote, FrameInfo, RawFrame};
use crate::kernels::Offload;
use crate::verdict::Report;
use std::sync::Arc;
use std::time::Duration;

/// Curves of a frame, as [`Session::feed`](super::Session::feed) takes them.
#[derive(Clone, Debug)]
pub enum Given<'a> {
    /// Numbers in memory, which are checked and copied.
    Raw(RawFrame<'a>),
    /// Curves that the caller shares until the next frame is verified.
    Curves(Arc<CurveSet>),
}

impl<'a> From<RawFrame<'a>> for Given<'a> {
    fn from(frame: RawFrame<'a>) -> Given<'a> {
        Given::Raw(frame)
    }
}

impl From<Arc<CurveSet>> for Given<'_> {
    fn from(curves: Arc<CurveSet>) -> Self {
        Given::Curves(curves)
    }
}

impl From<&Arc<CurveSet>> for Given<'_> {
    fn from(curves: &Arc<CurveSet>) -> Self {
        Given::Curves(Arc::clone(curves))
    }
}

impl From<CurveSet> for Given<'_> {
    fn from(curves: CurveSet) -> Self {
        Given::Curves(Arc::new(curves))
    }
}

impl From<&CurveSet> for Given<'_> {
    /// Copies the curves.
    fn from(curves: &CurveSet) -> Self {
        Given::Curves(Arc::new(curves.clone()))
    }
}

/// A frame that was received, but is not verified yet.
#[derive(Debug)]
pub struct Received {
    pub(super) info: FrameInfo,
    /// The curves, or the reason why the frame is rejected.
    pub(super) curves: Result<Arc<CurveSet>>,
    /// True if it is decided already which curves are closed.
    pub(super) is_closed: bool,
    /// Time of the copy.
    pub(super) took: Duration,
}

impl Received {
    /// Wraps curves that were read already, or the reason why they could not be.
    pub fn new(info: FrameInfo, curves: Result<Arc<CurveSet>>) -> Received {
        Received {
            info,
            curves,
            is_closed: false,
            took: Duration::ZERO,
        }
    }

    /// Returns what the simulator told about the frame.
    pub fn info(&self) -> &FrameInfo {
        &self.info
    }

    /// Returns the number of segments; 0 if the frame will be rejected.
    pub fn segments(&self) -> usize {
        self.curves.as_ref().map_or(0, |set| set.segments())
    }
}

/// Relation of a frame to the last verified one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Continuation {
    /// The frame continues the motion.
    #[default]
    Continues,
    /// The simulator rolled back or jumped.
    Cut,
    /// The simulator accepted this frame as the new baseline.
    Accepted,
}

/// A frame that was verified or rejected.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct VerifiedFrame {
    /// The findings.
    pub report: Report,
    /// Information of the simulator about the frame, with the cell in which the report names
    /// images.
    pub info: FrameInfo,
    /// The curves, unwrapped; `None` if the frame was rejected.
    pub curves: Option<Arc<CurveSet>>,
    /// Relation of the frame to the last verified one.
    pub continuation: Continuation,
    /// Decisions about closed and open curves since the last frame.
    pub notes: Vec<ClosingNote>,
    /// Number of curves that are closed because they end where they start.
    pub joined: usize,
    /// Number of times so far that a curve jumped by a lattice vector from one frame to the next,
    /// as simulations move molecules back into the cell, and was followed.
    pub jumps: u64,
    /// Reason why clearance is not measured, although the options ask for it.
    pub unmeasured: Option<String>,
    /// Time of the copy of the frame.
    pub ingest: Duration,
    /// Time of the verification.
    pub verification: Duration,
    /// Times of its stages.
    pub timings: Timings,
    /// Work of the verification.
    pub work: Work,
    /// Work done on the GPU.
    pub offload: Offload,
}
