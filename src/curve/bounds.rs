//! Bounds of the control points of a curve, in any linear coordinates.

use super::vector::{bounds, dot};
use super::{CurveSet, Point};

/// Rows of the coordinates in which points are given.
pub(crate) const AXES: [Point; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Returns the bounds of points in the coordinates `row . x`.
#[inline(always)]
fn bounds_of(points: impl Iterator<Item = Point>, rows: &[Point; 3]) -> [Point; 2] {
    bounds(points.map(|p| rows.map(|row| dot(row, p))))
}

/// Returns the bounds around two others.
pub(crate) fn union(a: [Point; 2], b: [Point; 2]) -> [Point; 2] {
    [
        [0, 1, 2].map(|x| a[0][x].min(b[0][x])),
        [0, 1, 2].map(|x| a[1][x].max(b[1][x])),
    ]
}

impl CurveSet {
    /// Returns the bounds of the control points of curve `i` in the coordinates `row . x`, up to
    /// rounding. Reads the positions as they were received, if the arrays are not built.
    pub(crate) fn bounds_along(&self, i: usize, rows: &[Point; 3]) -> [Point; 2] {
        match self.coordinates.received() {
            Some(positions) => bounds_of(self.points_of(i).map(|k| positions.point(k)), rows),
            None => bounds_of(self.body(i).map(|slot| self.at(slot)), rows),
        }
    }
}
