//! Positions that a set owns, and curves as numbers that can be stored.

use super::basis::Real;
use super::{Basis, CurveSet, Positions, Precision};
use crate::error::Error;
use crate::simd::dispatch;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Number of coordinates that are copied at once, so that they are checked in the first-level
/// cache.
const PART: usize = 3 * 1024;

/// A coordinate beyond the limit: point of the input, axis, value.
pub(crate) type Bad = (usize, usize, f64);

/// A private copy of positions, `x y z x y z ..`, in the order of the input.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) enum Received {
    F32(Vec<f32>),
    F64(Vec<f64>),
}

impl From<Positions<'_>> for Received {
    fn from(positions: Positions<'_>) -> Received {
        match positions {
            Positions::F32(v) => Received::F32(v.to_vec()),
            Positions::F64(v) => Received::F64(v.to_vec()),
        }
    }
}

impl Received {
    /// Returns no positions, with memory for so many coordinates.
    pub fn with_capacity(precision: Precision, coordinates: usize) -> Received {
        match precision {
            Precision::F32 => Received::F32(Vec::with_capacity(coordinates)),
            Precision::F64 => Received::F64(Vec::with_capacity(coordinates)),
        }
    }

    /// Returns the positions.
    #[inline]
    pub fn positions(&self) -> Positions<'_> {
        match self {
            Received::F32(v) => Positions::F32(v),
            Received::F64(v) => Positions::F64(v),
        }
    }

    /// Cuts off coordinates, or appends zeros.
    pub fn resize(&mut self, len: usize) {
        match self {
            Received::F32(v) => v.resize(len, 0.0),
            Received::F64(v) => v.resize(len, 0.0),
        }
    }

    /// Copies positions, into the existing buffer if they have the same precision.
    pub fn copy_from(&mut self, source: Positions<'_>) {
        match (self, source) {
            (Received::F32(to), Positions::F32(from)) => from.clone_into(to),
            (Received::F64(to), Positions::F64(from)) => from.clone_into(to),
            (to, from) => *to = from.into(),
        }
    }

    /// Appends positions of the same precision. Every value is read once, and its copy is checked:
    /// the input may be shared memory, where a second read may return another value. Fails with the
    /// first value whose magnitude is not within the limit.
    pub fn append(&mut self, source: Positions<'_>, limit: f64) -> Result<(), Bad> {
        match (self, source) {
            (Received::F32(to), Positions::F32(from)) => {
                dispatch!(append(to, from, f32::bits_within(limit)))
            }
            (Received::F64(to), Positions::F64(from)) => {
                dispatch!(append(to, from, f64::bits_within(limit)))
            }
            _ => unreachable!("callers compare the precision first"),
        }
    }
}

#[inline(always)]
fn append<T: Real>(to: &mut Vec<T>, from: &[T], limit: u64) -> Result<(), Bad> {
    to.reserve(from.len());
    for part in from.chunks(PART) {
        let at = to.len();
        to.extend_from_slice(part);
        largest_within(&to[at..], limit, at / 3)?;
    }
    Ok(())
}

/// Returns the bit pattern of the largest magnitude, or the first value above `limit`; `first` is
/// the number of the first point.
///
/// Magnitudes are compared as integers: without the sign bit, the bit pattern of a float increases
/// with its magnitude, and the patterns of infinities and NaN are larger than all others. So one
/// maximum gives the range and the check.
#[inline(always)]
pub(crate) fn largest_within<T: Real>(raw: &[T], limit: u64, first: usize) -> Result<u64, Bad> {
    let largest = T::largest(raw);
    if largest > limit {
        let above = |v: &T| T::largest(&[*v]) > limit;
        let k = raw.iter().position(above).unwrap_or(0);
        return Err((first + k / 3, k % 3, raw[k].into()));
    }
    Ok(largest)
}

/// Curves that can be stored with serde.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(into = "Numbers", try_from = "Numbers")]
pub(crate) struct StoredCurves(pub Arc<CurveSet>);

#[derive(Serialize, Deserialize)]
struct Numbers {
    basis: Basis,
    counts: Vec<i32>,
    positions: Received,
}

impl From<StoredCurves> for Numbers {
    fn from(StoredCurves(set): StoredCurves) -> Numbers {
        Numbers {
            basis: set.basis(),
            counts: set.counts().collect(),
            positions: set.positions().into(),
        }
    }
}

impl TryFrom<Numbers> for StoredCurves {
    type Error = Error;

    fn try_from(numbers: Numbers) -> Result<StoredCurves, Error> {
        let positions = numbers.positions.positions();
        let set = CurveSet::from_counts(numbers.basis, &numbers.counts, positions)?;
        Ok(StoredCurves(Arc::new(set)))
    }
}
