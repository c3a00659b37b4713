//! What a simulator tells about a frame, beside its positions.

use crate::curve::CurveLabels;
use std::sync::Arc;

/// What a simulator tells about a frame, beside its number, its time and its curves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameInfo {
    /// Number of cuts that the simulator made before this frame. If it differs from that of the
    /// previous frame, this frame does not continue that one
    /// ([`Verifier::cut`](crate::Verifier::cut)).
    pub cuts: u32,
    /// Number of times that the simulator described its curves before this frame. If it differs
    /// from that of the previous frame, this frame has other curves
    /// ([`Verifier::change_curves`](crate::Verifier::change_curves)).
    pub layout: u32,
    /// Time step of the simulator in seconds; 0 if it is unknown.
    pub time_step: f64,
    /// Names and radii of the curves.
    pub labels: Arc<CurveLabels>,
}
