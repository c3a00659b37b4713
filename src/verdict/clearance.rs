//! Clearance: how far strands of a given radius are from one another.

use crate::curve::{Image, Point};

/// Clearance of a frame: the distance between the centre lines of two strands, as a share of the
/// sum of their radii. At 1 their surfaces touch, at 0 their centre lines meet.
///
/// The strands are different curves, or segments of one curve whose nearer ends are at least `pi`
/// radii apart along it: a curve that bends with the radius of its tube has that distance. In a
/// periodic cell they are also images of curves; the next period of a curve that runs through the
/// cell continues it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Clearance {
    /// Lower bound of the clearance of all strands. Below the level of the warning it is the
    /// clearance of the closest ones, less the error of splines. Above it, strands may be closer
    /// than the closest that were measured, by at most half of the sum of their radii.
    pub at_least: f64,
    /// Closest strands that were measured, if they are closer than one and a half times the sum of
    /// their radii.
    pub closest: Option<CloseStrands>,
    /// True if the clearance is below the level of the warning.
    pub low: bool,
    /// Number of frames after which the surfaces touch, or, if they do already, the centre lines
    /// meet, if the clearance goes on to shrink as in the last frames. `None` if it does not
    /// shrink.
    pub frames_left: Option<f64>,
}

/// Two strands that are close.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct CloseStrands {
    /// Distance of their centre lines, as a share of the sum of their radii.
    pub ratio: f64,
    /// Upper bound of the error of `ratio`: 0 for polylines, whose error is that of their
    /// coordinates. Splines are measured on chords.
    pub error: f64,
    /// First curve, from 0.
    pub i: u32,
    /// Second curve: greater than `i`, or equal for two parts of one curve, or for a curve and its
    /// image.
    pub j: u32,
    /// Translation of the second strand, in lattice vectors: zeros without a cell.
    #[serde(default)]
    pub image: Image,
    /// Segment of the first curve and segment of the second, from 0.
    pub segments: [u32; 2],
    /// Nearest points of the centre lines, in the units of the simulation. That of the second
    /// strand is translated by `image`.
    pub points: [Point; 2],
    /// Distance of these points.
    pub distance: f64,
}
