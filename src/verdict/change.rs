//! Changes of the topology: linking numbers, how one differs from the expected one, and
//! pull-throughs (strand passages).

use super::Place;
use crate::curve::{Image, Point};
use serde::{Deserialize, Serialize};

/// A nonzero entry of the linking matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Link {
    /// First curve, from 0; less than `j`.
    pub i: u32,
    /// Second curve.
    pub j: u32,
    /// Linking number of the curves, never 0.
    pub lambda: i64,
}

/// A linking number of a curve and a periodic image, of another curve or of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ImageLink {
    /// First curve, from 0.
    pub i: u32,
    /// Second curve: greater than `i`, or equal.
    pub j: u32,
    /// Translation of the second curve, not 0; positive in lexicographic order if `i = j`.
    pub image: Image,
    /// Linking number, never 0.
    pub lambda: i64,
}

vocabulary! {
    /// Kind of the difference between a linking number and the expected one.
    pub enum ChangeKind {
        /// The curves were linked in the baseline and no longer are.
        Lost = "lost",
        /// The curves were not linked in the baseline and now are.
        Gained = "gained",
        /// The curves are linked as in the baseline, but with another linking number.
        Changed = "changed",
    }
}

/// A pair of curves of a finding, at least one of which stands for a virtual loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LoopPair {
    /// First and second curve, as in the finding ([`Change::i`]).
    pub curves: [u32; 2],
    /// Other curve of each loop; `None` for a closed curve.
    pub partners: [Option<u32>; 2],
    /// Curve and segment of each loop at which the two are closest. `None` on a virtual
    /// connection.
    pub nearest: [Option<[u32; 2]>; 2],
}

/// Invariants of a knot, or the triple linking number of three curves, that differ from the
/// expected ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InvariantChange {
    /// The curve, or three curves; sorted.
    pub curves: Vec<u32>,
    /// Expected invariants as text: `v2 0, v3 0, determinant 1`, or `mu 1`.
    pub expected: String,
    /// Invariants of the frame as text.
    pub found: String,
}

/// A linking number that differs from the expected one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// First curve, from 0; less than `j`, or equal if a curve is linked with its own image.
    pub i: u32,
    /// Second curve.
    pub j: u32,
    /// Translation of the second curve, in multiples of the lattice vectors of the
    /// [`Cell`](crate::Cell). 0 without a cell.
    pub image: Image,
    /// Linking number in the baseline.
    pub expected: i64,
    /// Linking number in the current frame.
    pub found: i64,
    /// Place at which the curves are closest in the current frame. Right after a pull-through, this
    /// is its place.
    pub place: Option<Place>,
}

impl Change {
    /// Returns the kind of the change.
    pub fn kind(&self) -> ChangeKind {
        match (self.expected, self.found) {
            (_, 0) => ChangeKind::Lost,
            (0, _) => ChangeKind::Gained,
            _ => ChangeKind::Changed,
        }
    }
}

/// A pull-through: a passage of a curve through another one, or through itself, between two frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
