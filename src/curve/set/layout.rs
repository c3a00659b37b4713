//! Layout of a set, which is everything except the positions, and its comparison with other
//! layouts.

use super::curve::Curve;
use super::{Basis, CurveSet, Precision};
use crate::error::{Error, Result};
use std::sync::Arc;

/// Basis, precision and sizes of the curves of a set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Shape {
    basis: Basis,
    precision: Precision,
    /// Fast if both are the same allocation, because [`Curve`] is `Eq`.
    curves: Arc<Vec<Curve>>,
}

/// Creates the error of a set whose curves differ from those before.
fn changed(what: &'static str, before: u64, now: u64) -> Error {
    Error::LayoutChanged { what, before, now }
}

impl CurveSet {
    /// Returns everything but the positions.
    pub(crate) fn shape(&self) -> Shape {
        Shape {
            basis: self.basis,
            precision: self.precision(),
            curves: Arc::clone(&self.curves),
        }
    }

    /// Returns true if another set has the same curves in the same precision, so that only
    /// positions may differ.
    pub(crate) fn same_layout(&self, other: &CurveSet) -> bool {
        self.shape() == other.shape()
    }

    /// Fails if another set has other curves, or another precision.
    pub(crate) fn check_same_layout(&self, other: &CurveSet) -> Result<()> {
        match self.same_layout(other) {
            true => Ok(()),
            false => self.check_layout(other.basis(), other.precision(), other.counts()),
        }
    }

    /// Returns an error if basis, precision or counts differ from those of this set.
    pub(crate) fn check_layout(
        &self,
        basis: Basis,
        precision: Precision,
        counts: impl ExactSizeIterator<Item = i32>,
    ) -> Result<()> {
        if basis != self.basis {
            let [before, now] = [self.basis, basis].map(|basis| basis.code().into());
            return Err(changed("basis code", before, now));
        }
        if counts.len() != self.len() {
            let [before, now] = [self.len(), counts.len()].map(|n| n as u64);
            return Err(changed("number of curves", before, now));
        }
        if let Some((before, now)) = self.counts().zip(counts).find(|(a, b)| a != b) {
            let points = [before, now].map(|count| u64::from(count.unsigned_abs()));
            let closed = [before, now].map(|count| u64::from(count < 0));
            let (what, [before, now]) = match points[0] == points[1] {
                true => ("closed (1) or open (0)", closed),
                false => ("control points of a curve", points),
            };
            return Err(changed(what, before, now));
        }
        self.check_precision(precision)
    }

    /// Returns an error if the precision of the positions differs from that of this set.
    pub(super) fn check_precision(&self, precision: Precision) -> Result<()> {
        let [before, now] = [self.precision(), precision].map(|p| p.bytes() as u64);
        match before == now {
            true => Ok(()),
            false => Err(changed("bytes of a coordinate", before, now)),
        }
    }
}
