//! One curve of a set.

use super::Basis;
use crate::error::{Error, Result};
use crate::simd::LANES;

/// Size of one curve of a [`CurveSet`](crate::CurveSet), and the position of its control points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Curve {
    /// First slot of the curve in the coordinate arrays (a wrapped control point if the basis needs
    /// one).
    pub(super) first: u32,
    /// Number of control points of all curves before this one.
    pub(super) first_point: u32,
    /// Number of control points.
    pub points: u32,
    /// Number of spline segments (for polylines: edges).
    pub segments: u32,
    /// True if the end is joined to the start.
    pub closed: bool,
}

impl Curve {
    /// Returns the number of control points, negative for a closed curve.
    pub(crate) fn count(&self) -> i32 {
        let n = self.points as i32;
        if self.closed { -n } else { n }
    }

    /// Returns the control points that have a next one in the curve, each with that one.
    pub(crate) fn pairs_of_points(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let n = self.points as usize;
        (0..n - usize::from(!self.closed)).map(move |k| [k, (k + 1) % n])
    }

    /// Returns true if two segments of the curve are equal or consecutive.
    #[inline]
    pub(crate) fn adjacent(&self, s: u32, t: u32) -> bool {
        let apart = s.abs_diff(t);
        apart <= 1 || (self.closed && apart == self.segments - 1)
    }

    /// Returns the number of control point `k` of segment `s` in the curve.
    #[inline(always)]
    pub(crate) fn control_point(&self, basis: Basis, s: usize, k: usize) -> usize {
        let n = self.points as usize;
        // Rarely a division.
        match s * basis.stride() + k + n - basis.lead(self.closed) {
            at if at < n => at,
            at if at < 2 * n => at - n,
            at => at % n,
        }
    }

    /// Returns the segment after `s`, or `s` itself if it is the last one of an open curve.
    #[inline]
    pub(crate) fn after(&self, s: u32) -> u32 {
        match (s + 1 < self.segments, self.closed) {
            (true, _) => s + 1,
            (false, true) => 0,
            (false, false) => s,
        }
    }

    /// Returns the segment before `s`, or `s` itself if it is the first one of an open curve.
    #[inline]
    pub(crate) fn before(&self, s: u32) -> u32 {
        match (s, self.closed) {
            (1.., _) => s - 1,
            (0, true) => self.segments - 1,
            (0, false) => s,
        }
    }
}

/// Returns the number of points of a curve, negative if it is closed, as the bus and files store
/// it.
///
/// # Errors
///
/// [`Error::Count`] if there are too many.
pub(crate) fn count_of(points: usize, closed: bool) -> Result<i32> {
    let count = i32::try_from(points);
    let count = count.map_err(|_| Error::count("points of a curve", points, i32::MAX))?;
    Ok(if closed { -count } else { count })
}

/// Returns the number of slots of a curve: every window of the last, possibly partial, group of
/// eight segments fits.
pub(super) fn slots_of(basis: Basis, segments: usize) -> usize {
    (segments.next_multiple_of(LANES) - 1) * basis.stride() + basis.window()
}

/// Returns the number of slots of all curves.
pub(super) fn slots_of_all(curves: &[Curve], basis: Basis) -> usize {
    let end = |c: &Curve| c.first as usize + slots_of(basis, c.segments as usize);
    curves.last().map_or(0, end)
}
