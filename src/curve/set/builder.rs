//! Construction of curve sets from counts and positions, all at once or curve by curve.

use super::curve::{Curve, count_of, slots_of};
use super::{Basis, CurveSet, Positions, Precision};
use crate::error::{Error, Result};
use std::sync::Arc;

impl CurveSet {
    /// Starts a set. `points` is a capacity hint that saves reallocation. Check it against the
    /// length of the data first.
    pub fn builder(basis: Basis, precision: Precision, points: usize) -> CurveSetBuilder {
        CurveSetBuilder {
            set: CurveSet::empty(basis, precision, points),
        }
    }

    /// Starts a set of curves with these numbers of control points, negative if a curve is closed,
    /// whose positions follow.
    pub(crate) fn builder_of(
        basis: Basis,
        precision: Precision,
        counts: &[i32],
    ) -> Result<CurveSetBuilder> {
        let points = counts.iter().map(|c| c.unsigned_abs() as usize).sum();
        let mut builder = CurveSet::builder(basis, precision, points);
        for &c in counts {
            builder.set.add_curve(c.unsigned_abs() as usize, c < 0)?;
        }
        Ok(builder)
    }

    /// Returns the set of all curves of `positions`. Each count is the number of control points of
    /// a curve, negative if the curve is closed, as in a BCC file.
    ///
    /// # Errors
    ///
    /// [`Error::Count`] if there is another number of positions; [`Error::CurveTooShort`];
    /// [`Error::NotFinite`].
    pub fn from_counts(basis: Basis, counts: &[i32], positions: Positions<'_>) -> Result<CurveSet> {
        let points: u64 = counts.iter().map(|c| u64::from(c.unsigned_abs())).sum();
        let (promised, found) = (points.saturating_mul(3), positions.len());
        if promised != found as u64 {
            return Err(Error::count("coordinates", promised, found));
        }
        let mut builder = CurveSet::builder_of(basis, positions.precision(), counts)?;
        builder.push(positions)?;
        builder.finish()
    }

    /// Adds a curve, whose positions follow.
    fn add_curve(&mut self, points: usize, closed: bool) -> Result<()> {
        count_of(points, closed)?;
        let (basis, first) = (self.basis, self.slots());
        let segments = basis.segments_of(self.len(), points, closed)?;
        let end = first + slots_of(basis, segments);
        if u32::try_from(end).is_err() {
            return Err(Error::count("points of all curves", end, u32::MAX));
        }
        Arc::make_mut(&mut self.curves).push(Curve {
            first: first as u32,
            first_point: self.points as u32,
            points: points as u32,
            segments: segments as u32,
            closed,
        });
        self.points += points;
        self.segments += segments;
        self.open_curves += usize::from(!closed);
        Ok(())
    }
}

/// Fills a [`CurveSet`] curve by curve, from a stream with chunks of any size.
#[derive(Debug)]
pub struct CurveSetBuilder {
    /// The positions of the last curve may be incomplete.
    set: CurveSet,
}

impl CurveSetBuilder {
    /// Starts a curve of `points` control points. The previous curve must be complete.
    pub fn start_curve(&mut self, points: usize, closed: bool) -> Result<()> {
        self.check_complete()?;
        self.set.add_curve(points, closed)
    }

    /// Appends control points of the curves that were started.
    pub fn push(&mut self, positions: Positions<'_>) -> Result<()> {
        let missing = 3 * self.set.points - self.set.positions().len();
        let given = positions.len();
        if given > missing || !given.is_multiple_of(3) {
            return Err(Error::count("coordinates of the curves", missing, given));
        }
        self.set.check_precision(positions.precision())?;
        self.set.append(positions)
    }

    fn check_complete(&self) -> Result<()> {
        let written = self.set.positions().len() / 3;
        match self.set.curves.last() {
            Some(c) if written < self.set.points => {
                let written = written - c.first_point as usize;
                Err(Error::count("points of a curve", c.points, written))
            }
            _ => Ok(()),
        }
    }

    /// Returns the finished set. Fails if the last curve is incomplete.
    pub fn finish(self) -> Result<CurveSet> {
        self.check_complete()?;
        Ok(self.set)
    }
}
