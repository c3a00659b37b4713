//! Curves: points, spline bases, and the set of all curves of one frame.

mod basis;
mod boxes;
mod builder;
mod coordinates;
mod extent;
mod lanes;
mod notation;
mod set;

pub use basis::Basis;
pub(crate) use basis::{Bezier, Bounds, point_at, sub_segment};
pub(crate) use boxes::{Box3, BoxGroup, LANES};
pub use builder::CurveSetBuilder;
pub(crate) use coordinates::{Axes, Knots, ReadKnots};
pub use coordinates::{Positions, Precision};
pub use extent::LongSegment;
#[cfg(target_arch = "x86_64")]
pub(crate) use lanes::Avx2;
pub(crate) use lanes::{Lanes, Portable};
pub(crate) use notation::{Notation, significant};
pub use set::{Curve, CurveSet};

/// A point in space, in the units of the simulation.
pub type Point = [f64; 3];

/// Returns `2^exponent`, for exponents of normal numbers (-1022 to 1023).
pub(crate) const fn pow2(exponent: i32) -> f64 {
    assert!(-1022 <= exponent && exponent <= 1023);
    f64::from_bits(((1023 + exponent) as u64) << 52)
}
