//! Coordinates of the input, as they come from outside.

use super::Point;
use crate::curve::vector::per_axis;
use std::ops::Range;

/// Floating-point type of the input coordinates. They are stored in this type, without rounding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Single precision.
    F32,
    /// Double precision.
    F64,
}

impl Precision {
    /// Returns the number of bytes of one coordinate.
    pub fn bytes(self) -> usize {
        match self {
            Precision::F32 => 4,
            Precision::F64 => 8,
        }
    }
}

/// Control points of the input: `x y z x y z ..`, curve after curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Positions<'a> {
    /// Single precision.
    F32(&'a [f32]),
    /// Double precision.
    F64(&'a [f64]),
}

impl<'a> Positions<'a> {
    /// Returns the type of the coordinates.
    pub fn precision(&self) -> Precision {
        match self {
            Positions::F32(_) => Precision::F32,
            Positions::F64(_) => Precision::F64,
        }
    }

    /// Returns the number of coordinates (three per point).
    pub fn len(&self) -> usize {
        match self {
            Positions::F32(v) => v.len(),
            Positions::F64(v) => v.len(),
        }
    }

    /// Returns true if there are no coordinates.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns a point, counted over all curves.
    #[inline]
    pub(crate) fn point(&self, k: usize) -> Point {
        match self {
            Positions::F32(v) => per_axis(|x| v[3 * k + x].into()),
            Positions::F64(v) => per_axis(|x| v[3 * k + x]),
        }
    }

    /// Returns the coordinates in a range.
    pub(crate) fn part(&self, range: Range<usize>) -> Self {
        match self {
            Positions::F32(v) => Positions::F32(&v[range]),
            Positions::F64(v) => Positions::F64(&v[range]),
        }
    }
}
