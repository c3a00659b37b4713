//! Construction of curve sets from counts and positions, all at once or curve by curve.

use super::set::{Curve, CurveSet, slots_of};
use super::{Basis, Positions, Precision};
use crate::error::{Error, Result};
use std::sync::Arc;

impl CurveSet {
    /// Starts a set. `points` is a capacity hint that saves reallocation. Check it against the
    /// length of the data first.
    pub fn builder(basis: Basis, precision: Precision, points: usize) -> CurveSetBuilder {
        CurveSetBuilder {
            set: CurveSet::empty(basis, precision, points),
            written: 0,
        }
    }

    /// Starts a set of curves with these numbers of control points, negative if a curve is closed,
    /// with memory for all of them. Check the counts against the length of the data first.
    pub(crate) fn builder_of(
        basis: Basis,
        precision: Precision,
        counts: &[i32],
    ) -> CurveSetBuilder {
        let slots = counts
            .iter()
            .map(|&c| slots(basis, c.unsigned_abs() as usize, c < 0).unwrap_or(0));
        CurveSet::builder(basis, precision, slots.sum())
    }

    /// Returns the set of all curves of `positions`. Each count is the number of control points of
    /// a curve, negative if the curve is closed, as in a BCC file.
    pub fn from_counts(basis: Basis, counts: &[i32], positions: Positions<'_>) -> Result<CurveSet> {
        let points: u64 = counts.iter().map(|c| u64::from(c.unsigned_abs())).sum();
        if points.checked_mul(3) != Some(positions.len() as u64) {
            return Err(Error::count(
                "coordinates",
                points.saturating_mul(3),
                positions.len(),
            ));
        }
        let mut builder = CurveSet::builder_of(basis, positions.precision(), counts);
        let mut at = 0;
        for &c in counts {
            let n = c.unsigned_abs() as usize;
            builder.start_curve(n, c < 0)?;
            let end = at + 3 * n;
            builder.push(positions.part(at..end))?;
            at = end;
        }
        builder.finish()
    }
}

/// Returns the number of slots of a curve, or `None` if the basis does not allow this number of
/// points.
fn slots(basis: Basis, points: usize, closed: bool) -> Option<usize> {
    Some(slots_of(basis, basis.segments(points, closed)?))
}

/// Fills a [`CurveSet`] curve by curve, from a stream with chunks of any size.
#[derive(Debug)]
pub struct CurveSetBuilder {
    set: CurveSet,
    /// Number of control points of the last curve that are written.
    written: usize,
}

impl CurveSetBuilder {
    /// Starts a curve of `points` control points. The previous curve must be complete.
    ///
    /// Allocates memory for all points. Compare `points` with the length of the data first.
    pub fn start_curve(&mut self, points: usize, closed: bool) -> Result<()> {
        self.check_complete()?;
        // The bus and files store counts as signed 32-bit integers.
        if i32::try_from(points).is_err() {
            return Err(Error::count("points of a curve", points, i32::MAX));
        }
        let set = &mut self.set;
        let i = set.curves.len();
        let basis = set.basis;
        let (Some(segments), Some(slots)) =
            (basis.segments(points, closed), slots(basis, points, closed))
        else {
            return Err(Error::CurveTooShort {
                curve: i,
                points,
                kind: basis.describe(closed),
                needed: basis.needs(closed),
            });
        };
        // Checked before anything is allocated.
        let first = set.slots();
        if u32::try_from(first + slots).is_err() {
            return Err(Error::count(
                "points of all curves",
                first + slots,
                u32::MAX,
            ));
        }
        let arrays = set.coordinates.arrays_mut(first);
        arrays.coordinates.grow(slots);
        Arc::make_mut(&mut set.curves).push(Curve {
            first: first as u32,
            first_point: set.points as u32,
            points: points as u32,
            segments: segments as u32,
            closed,
        });
        set.points += points;
        set.segments += segments;
        set.open_curves += usize::from(!closed);
        self.written = 0;
        Ok(())
    }

    /// Appends control points to the last curve that was started.
    pub fn push(&mut self, positions: Positions<'_>) -> Result<()> {
        let i = self.set.curves.len().wrapping_sub(1);
        let missing = self.set.curves.last().map_or(0, |c| c.points as usize) - self.written;
        let n = positions.len() / 3;
        if n > missing || !positions.len().is_multiple_of(3) {
            return Err(Error::count(
                "coordinates of a curve",
                3 * missing,
                positions.len(),
            ));
        }
        if positions.precision() != self.set.precision() {
            return Err(Error::LayoutChanged {
                what: "bytes of a coordinate",
                before: self.set.precision().bytes() as u64,
                now: positions.precision().bytes() as u64,
            });
        }
        if n == 0 {
            return Ok(());
        }
        self.set.write(i, self.written, positions)?;
        self.written += n;
        if n == missing {
            self.set.wrap(i);
        }
        Ok(())
    }

    fn check_complete(&self) -> Result<()> {
        match self.set.curves.last() {
            Some(c) if (c.points as usize) != self.written => {
                Err(Error::count("points of a curve", c.points, self.written))
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
