//! Curves: points, spline bases, and the set of all curves of one frame.

#[cfg_attr(
    not(feature = "verify"),
    allow(dead_code, reason = "for the exact core")
)]
mod basis;
#[cfg(feature = "verify")]
mod bounds;
#[cfg(feature = "verify")]
mod boxes;
#[cfg(feature = "verify")]
mod builder;
#[cfg_attr(
    not(feature = "verify"),
    allow(dead_code, reason = "for the exact core")
)]
mod cell;
#[cfg(feature = "verify")]
mod coarse_boxes;
#[cfg(feature = "verify")]
mod coordinates;
#[cfg(feature = "verify")]
mod diagonals;
#[cfg(feature = "verify")]
mod extent;
#[cfg(feature = "verify")]
mod frame;
mod labels;
#[cfg(feature = "verify")]
mod lazy;
#[cfg(feature = "verify")]
mod leaf_boxes;
#[cfg(feature = "verify")]
mod local;
mod notation;
#[cfg(feature = "verify")]
mod parts;
#[cfg(feature = "verify")]
mod pool;
mod positions;
#[cfg(feature = "verify")]
mod set;
#[cfg(feature = "verify")]
mod stored;
#[cfg(feature = "verify")]
mod sums;
#[cfg(feature = "verify")]
mod support;
#[cfg(feature = "verify")]
mod tile;
#[cfg_attr(
    not(feature = "verify"),
    allow(dead_code, reason = "for the exact core")
)]
pub(crate) mod vector;

pub use basis::Basis;
#[cfg(feature = "verify")]
pub(crate) use basis::{Bezier, Bounds, bspline_knot, point_at, sub_segment};
#[cfg(feature = "verify")]
pub(crate) use bounds::{AXES, bounds, union};
#[cfg(feature = "verify")]
pub(crate) use boxes::{Box3, BoxGroup, above, below, larger, smaller};
#[cfg(feature = "verify")]
pub use builder::CurveSetBuilder;
pub(crate) use cell::is_home;
pub use cell::{Cell, Image};
#[cfg(feature = "verify")]
pub(crate) use cell::{minus, plus};
#[cfg(feature = "verify")]
pub(crate) use coordinates::{Axes, Knots, ReadKnots, Scalar};
#[cfg(feature = "verify")]
pub(crate) use diagonals::Diagonals;
#[cfg(feature = "verify")]
#[cfg(feature = "verify")]
pub(crate) use frame::{Frame, Images};
#[cfg(feature = "verify")]
pub(crate) use labels::CurveChange;
pub use labels::CurveLabels;
pub(crate) use labels::{words_of_change, words_of_curve};
#[cfg(feature = "verify")]
pub(crate) use lazy::Received;
#[cfg(feature = "verify")]
pub(crate) use local::{feature, nearest};
pub(crate) use notation::{Notation, significant};
#[cfg(feature = "verify")]
pub(crate) use parts::{Parts, multiple};
#[cfg(feature = "verify")]
pub(crate) use pool::FramePool;
pub use positions::{Positions, Precision};
#[cfg(feature = "verify")]
pub use set::{Curve, CurveSet};
#[cfg(feature = "verify")]
pub(crate) use set::{Hulls, Shape};
#[cfg(feature = "verify")]
pub(crate) use stored::StoredCurves;
#[cfg(feature = "verify")]
pub(crate) use sums::{SumEdges, SumPoint, TERMS, Translated, single};
#[cfg(feature = "verify")]
pub(crate) use tile::{Bad, largest_within};

/// A point in space, in the units of the simulation.
pub type Point = [f64; 3];

/// Returns `2^exponent`, for exponents of normal numbers (-1022 to 1023).
#[cfg(feature = "verify")]
pub(crate) const fn pow2(exponent: i32) -> f64 {
    assert!(-1022 <= exponent && exponent <= 1023);
    f64::from_bits(((1023 + exponent) as u64) << 52)
}
