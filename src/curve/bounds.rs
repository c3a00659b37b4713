//! Bounds of the control points of a curve, in any linear coordinates.

use super::{CurveSet, Point};

/// Rows of the coordinates in which points are given.
pub(crate) const AXES: [Point; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Returns the bounds of points in the coordinates `row . x`.
#[inline(always)]
fn bounds_of(points: impl Iterator<Item = Point>, rows: &[Point; 3]) -> [Point; 2] {
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for p in points {
        for (x, b) in rows.iter().enumerate() {
            let u = b[0] * p[0] + b[1] * p[1] + b[2] * p[2];
            bounds[0][x] = bounds[0][x].min(u);
            bounds[1][x] = bounds[1][x].max(u);
        }
    }
    bounds
}

/// Returns bounds around all of these.
pub(crate) fn union(all: &[[Point; 2]]) -> [Point; 2] {
    let mut around = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for [lo, hi] in all {
        for x in 0..3 {
            around[0][x] = around[0][x].min(lo[x]);
            around[1][x] = around[1][x].max(hi[x]);
        }
    }
    around
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
