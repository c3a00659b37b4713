//! Updates the positions of a set of curves, whose layout stays the same.

use super::received::{Bad, Received, largest_within};
use super::{CurveSet, Positions, Real, pow2};
use crate::error::{Error, Result};
use std::sync::atomic::{AtomicU64, Ordering};

/// Largest allowed coordinate of a spline. The discretization forms products of three differences
/// of points, which stay finite up to this limit. (Polylines have no limit.)
const SPLINE_RANGE: f64 = pow2(300);

/// Returns a new number of contents.
pub(super) fn next_contents() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

impl CurveSet {
    /// Replaces all positions by those of another frame of the same curves. Allocates nothing.
    ///
    /// If a value is not finite, or too large, all points are at the origin after the error, so
    /// that no verdict on the set is intact.
    ///
    /// # Errors
    ///
    /// [`Error::Count`](crate::Error::Count) if there is another number of coordinates;
    /// [`Error::NotFinite`](crate::Error::NotFinite).
    pub fn update(&mut self, positions: Positions<'_>) -> Result<()> {
        self.update_by(positions, |copy, limit| {
            copy.resize(0);
            copy.append(positions, limit)
        })
    }

    /// [`CurveSet::update`] by a function that copies all positions. It checks the copy, and fails
    /// with the first value that is not within the limit.
    pub(crate) fn update_by(
        &mut self,
        positions: Positions<'_>,
        copy: impl FnOnce(&mut Received, f64) -> Result<(), Bad>,
    ) -> Result<()> {
        self.check_precision(positions.precision())?;
        let (promised, found) = (3 * self.points, positions.len());
        if promised != found {
            return Err(Error::count("coordinates", promised, found));
        }
        let limit = self.limit();
        let copied = copy(self.begin_update(), limit);
        self.finish_update(copied)
    }

    /// [`CurveSet::update`] by a function that appends all positions, in double precision, to an
    /// empty list.
    pub(crate) fn update_with(&mut self, write: impl FnOnce(&mut Vec<f64>)) -> Result<()> {
        let (points, limit) = (self.points, f64::bits_within(self.limit()));
        let Received::F64(xyz) = self.begin_update() else {
            return Err(Error::Usage("the set is in single precision".into()));
        };
        xyz.clear();
        write(xyz);
        assert_eq!(xyz.len(), 3 * points, "points of the same curves");
        let checked = largest_within(xyz, limit, 0);
        self.finish_update(checked.map(drop))
    }

    /// Appends the positions of curves that were added.
    pub(super) fn append(&mut self, positions: Positions<'_>) -> Result<()> {
        let appended = self.received.append(positions, self.limit());
        self.finish_update(appended)
    }

    /// Returns the positions, to replace all of them.
    fn begin_update(&mut self) -> &mut Received {
        self.contents = next_contents();
        self.arrays.outdate();
        &mut self.received
    }

    fn finish_update(&mut self, updated: Result<(), Bad>) -> Result<()> {
        let Err((point, axis, value)) = updated else {
            return Ok(());
        };
        self.received.resize(0);
        self.received.resize(3 * self.points);
        let before = |c: &super::Curve| c.first_point as usize <= point;
        let curve = self.curves.partition_point(before) - 1;
        let point = point - self.curves[curve].first_point as usize;
        Err(match value.is_finite() {
            true => Error::TooLarge {
                curve,
                found: value.abs(),
                limit: SPLINE_RANGE,
            },
            false => Error::NotFinite {
                curve,
                point,
                axis: ['x', 'y', 'z'][axis],
                value,
            },
        })
    }

    /// Returns the largest allowed magnitude of a coordinate.
    fn limit(&self) -> f64 {
        match self.basis.is_polyline() {
            true => f64::INFINITY,
            false => SPLINE_RANGE,
        }
    }

    /// Writes the frame at a fraction of the step to another frame of the same curves,
    /// `x0 + f (x1 - x0)` with every operation rounded to the precision of the coordinates. `to` is
    /// an earlier one, whose memory is used again, or `None`. Fails if a coordinate overflows.
    pub(crate) fn toward(
        &self,
        other: &CurveSet,
        fraction: f64,
        to: &mut Option<CurveSet>,
    ) -> Result<()> {
        if let (Some(from), Some(end)) = (&self.sums, &other.sums) {
            return CurveSet::translated_toward([from, end], fraction, to);
        }
        self.check_precision(other.precision())?;
        let set = to.get_or_insert_with(|| self.clone());
        let at = match (self.positions(), other.positions()) {
            (Positions::F32(a), Positions::F32(b)) => Received::F32(mixed(a, b, fraction as f32)),
            (Positions::F64(a), Positions::F64(b)) => Received::F64(mixed(a, b, fraction)),
            _ => unreachable!("the same precision"),
        };
        set.update(at.positions())
    }
}

/// Returns `a + f (b - a)`.
fn mixed<T: Real>(a: &[T], b: &[T], fraction: T) -> Vec<T> {
    let both = a.iter().zip(b);
    both.map(|(&a, &b)| a + fraction * (b - a)).collect()
}
