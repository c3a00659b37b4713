//! Curves: points, spline bases, and the set of all curves of one frame.

#![cfg_attr(
    not(feature = "verify"),
    allow(dead_code, reason = "for the exact core")
)]

mod basis;
mod cell;
mod labels;
#[cfg(feature = "verify")]
mod metric;
mod notation;
mod positions;
#[cfg(feature = "verify")]
mod set;
pub(crate) mod vector;

pub use basis::Basis;
pub(crate) use cell::is_home;
pub use cell::{Cell, Image};
pub use labels::CurveLabels;
pub(crate) use labels::{words_of_change, words_of_curve};
#[cfg(feature = "verify")]
pub(crate) use metric::Metric;
pub(crate) use notation::{Notation, significant};
pub use positions::{Positions, Precision};
#[cfg(feature = "verify")]
pub use set::*;

/// A point in space, in the units of the simulation.
pub type Point = [f64; 3];

/// Returns `2^exponent`, for exponents of normal numbers (-1022 to 1023).
pub(crate) const fn pow2(exponent: i32) -> f64 {
    assert!(-1022 <= exponent && exponent <= 1023);
    f64::from_bits(((1023 + exponent) as u64) << 52)
}
