//! Pull-throughs (strand passages).

use crate::curve::{Image, Point};

/// A pull-through: a passage of a curve through another one, or through itself, between two frames.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PullThrough {
    /// First curve, from 0.
    pub i: u32,
    /// Second curve: greater than `i`, or equal if the curve passes through itself.
    pub j: u32,
    /// Translation of the second curve, in multiples of the lattice vectors of the
    /// [`Cell`](crate::Cell). 0 without a cell.
    pub image: Image,
    /// Segment of each curve.
    pub segments: [u32; 2],
    /// Time as a fraction of the step from one frame to the next, under linear motion.
    pub fraction: f64,
    /// Change of the linking number of two closed curves: 1 or -1. For a curve and itself, half the
    /// change of its writhe.
    pub sign: i32,
    /// Place, in the units of the simulation.
    pub point: Point,
    /// Relative motion of the two segments at this place in the step, in lengths of the longer one.
    /// 0 for a passage through a contact in a frame, which does not depend on the motion.
    pub lengths: f64,
}
