//! Bounds of the control points of a curve, in any linear coordinates.

use super::vector::{dot, per_axis};
use super::{CurveSet, Point, Positions, larger, smaller};

/// Rows of the coordinates in which points are given.
pub(crate) const AXES: [Point; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Returns the smallest and the largest coordinates of points, which are not NaN.
#[inline(always)]
pub(crate) fn bounds(points: impl IntoIterator<Item = Point>) -> [Point; 2] {
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for p in points {
        for x in 0..3 {
            bounds[0][x] = smaller(p[x], bounds[0][x]);
            bounds[1][x] = larger(p[x], bounds[1][x]);
        }
    }
    bounds
}

/// Returns the bounds of points `x y z x y z ..` in the coordinates `row . x`.
#[inline(always)]
fn bounds_of<T: Copy + Into<f64>>(xyz: &[T], rows: &[Point; 3]) -> [Point; 2] {
    let points = xyz.as_chunks::<3>().0.iter();
    let points = points.map(|p| p.map(Into::into));
    let [[a, _, _], [_, b, _], [_, _, c]] = *rows;
    if *rows != [[a, 0.0, 0.0], [0.0, b, 0.0], [0.0, 0.0, c]] {
        return bounds(points.map(|p| rows.map(|row| dot(row, p))));
    }
    // The axes of an orthogonal cell. Products are in the order of the coordinates.
    let [lo, hi] = bounds(points);
    let ends = per_axis(|x| [lo[x], hi[x]].map(|at| rows[x][x] * at));
    [
        ends.map(|[a, b]| smaller(a, b)),
        ends.map(|[a, b]| larger(a, b)),
    ]
}

/// Returns the bounds around two others.
pub(crate) fn union(a: [Point; 2], b: [Point; 2]) -> [Point; 2] {
    [
        per_axis(|x| a[0][x].min(b[0][x])),
        per_axis(|x| a[1][x].max(b[1][x])),
    ]
}

/// Returns the bounds of points in the coordinates `row . x`.
fn bounds_along(points: Positions<'_>, rows: &[Point; 3]) -> [Point; 2] {
    match points {
        Positions::F32(v) => bounds_of(v, rows),
        Positions::F64(v) => bounds_of(v, rows),
    }
}

impl CurveSet {
    /// Returns the lowest and the highest corner of the bounding box of all control points. They
    /// are infinite if there are none.
    pub(crate) fn corners(&self) -> [Point; 2] {
        bounds_along(self.positions(), &AXES)
    }

    /// Returns the bounds of the control points of curve `i` in the coordinates `row . x`, up to
    /// rounding.
    pub(crate) fn bounds_along(&self, i: usize, rows: &[Point; 3]) -> [Point; 2] {
        bounds_along(self.positions_in(i), rows)
    }
}
