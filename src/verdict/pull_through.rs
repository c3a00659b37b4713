//! A pull-through (strand passage) of one curve through another, or through itself.

use crate::curve::Point;

/// One curve was pulled through another, or through itself, between two frames.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PullThrough {
    /// First curve, from 0.
    pub i: u32,
    /// Second curve: greater than `i`, or equal where the curve passes through itself.
    pub j: u32,
    /// The segment of either curve.
    pub segments: [u32; 2],
    /// When, as a fraction of the step from one frame to the next, under linear motion.
    pub fraction: f64,
    /// What it adds to the linking number of two closed curves: 1 or -1. For a curve and itself, half of what it adds
    /// to its writhe.
    pub sign: i32,
    /// Where, in the units of the simulation.
    pub point: Point,
    /// Relative motion of the two segments at this place in the step, in lengths of the longer one.
    /// 0 for a passage through a contact in a frame, which does not depend on the motion.
    pub lengths: f64,
}
