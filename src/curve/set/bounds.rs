//! Bounds of the control points of a curve, in any linear coordinates; the extent of a scene, and
//! segments that are too long for it.

use super::vector::{dot, half_difference, hypot, per_axis, sub};
use super::{CurveSet, Point, Positions, larger, significant, smaller};
use std::fmt;

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

/// Returns true if two boxes are further apart than `gap` along an axis.
pub(crate) fn boxes_apart([a, b]: [&[Point; 2]; 2], gap: f64) -> bool {
    (0..3).any(|x| a[1][x] + gap < b[0][x] || b[1][x] + gap < a[0][x])
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

/// Share of the extent of a scene along an axis above which the extent of a segment along it is
/// suspicious, if the segment is also much longer than the average ([`AVERAGES`]).
const SHARE: f64 = 0.5;

/// Number of average segment lengths above which the extent of a segment along an axis is
/// suspicious, if it is also a large share of the scene ([`SHARE`]).
const AVERAGES: f64 = 3.0;

/// A segment that spans more than half of the scene.
///
/// Curves in a periodic cell look like this if their coordinates are wrapped into the cell.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct LongSegment {
    /// Curve, from 0.
    pub curve: usize,
    /// Segment of the curve, from 0, counted in control points.
    pub segment: usize,
    /// Axis along which it is long: `x`, `y` or `z`.
    pub axis: char,
    /// Length along that axis, in the units of the simulation.
    pub length: f64,
    /// Extent of the scene along that axis.
    pub extent: f64,
    /// Number of segments that span more than half of the scene.
    pub count: usize,
}

impl fmt::Display for LongSegment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "segment {} of curve {} spans {:.0} % of the scene along {} ({} of {})",
            self.segment,
            self.curve,
            100.0 * self.length / self.extent,
            self.axis,
            significant(self.length),
            significant(self.extent),
        )
    }
}

/// Returns the sides of a box. An infinite side counts as the largest number.
fn sides([low, high]: [Point; 2]) -> Point {
    // Halved, since the difference of two finite numbers may be infinite.
    half_difference(high, low).map(|x| (2.0 * x).clamp(0.0, f64::MAX))
}

impl CurveSet {
    /// Returns the longest side of the bounding box of all control points, in the units of the
    /// simulation. Infinite extents count as the largest number. Costs a pass over all points.
    pub fn extent(&self) -> f64 {
        sides(self.corners()).into_iter().fold(0.0, f64::max)
    }

    /// Returns the longest of the segments that span more than half of the scene along an axis and
    /// are much longer than the average segment, or `None` if there are no such segments. Costs a
    /// pass over all points, and a second one if there is such a segment.
    ///
    /// In a scene without a periodic cell such a segment is unusual, but valid.
    pub fn long_segment(&self) -> Option<LongSegment> {
        let (mut sum, mut edges) = (0.0, 0.0);
        let mut most = [0.0f64; 3];
        self.for_each_edge(|_, _, a, b| {
            let d = sub(b, a);
            edges += 1.0;
            sum += hypot(d);
            most = per_axis(|x| most[x].max(d[x].abs()));
        });
        let sides = sides(self.corners());
        let limit = sides.map(|side| (SHARE * side).max(AVERAGES * sum / edges));
        if (0..3).all(|x| most[x] <= limit[x]) {
            return None;
        }
        let mut longest: Option<LongSegment> = None;
        let mut count = 0;
        self.for_each_edge(|curve, segment, a, b| {
            let d = sub(b, a);
            let axes = (0..3).filter(|&x| d[x].abs() > limit[x]);
            let Some(x) = axes.max_by(|&a, &b| d[a].abs().total_cmp(&d[b].abs())) else {
                return;
            };
            count += 1;
            let length = d[x].abs();
            if longest.is_none_or(|l| length > l.length) {
                longest = Some(LongSegment {
                    curve,
                    segment,
                    axis: ['x', 'y', 'z'][x],
                    length,
                    extent: sides[x],
                    count: 0,
                });
            }
        });
        longest.map(|l| LongSegment { count, ..l })
    }

    /// Visits each control point that has a next one in its curve, with that one: curve, index,
    /// both points.
    fn for_each_edge(&self, mut visit: impl FnMut(usize, usize, Point, Point)) {
        for (i, c) in self.curves().iter().enumerate() {
            for [k, next] in c.pairs_of_points() {
                visit(i, k, self.point(i, k), self.point(i, next));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::curve::{Basis, CurveSet, Positions};

    /// Rings of radius 2 and 40 points along a diagonal, in a box of 10 with coordinates wrapped
    /// into it if `wrapped`.
    fn rings(wrapped: bool) -> CurveSet {
        let mut xyz = Vec::new();
        for ring in 0..6 {
            for k in 0..40 {
                let angle = f64::from(k) / 40.0 * std::f64::consts::TAU;
                let center = f64::from(ring) * 1.7;
                let p = [2.0 * angle.cos(), 2.0 * angle.sin(), 0.1 * angle.sin()];
                xyz.extend(p.map(|x| match wrapped {
                    true => (x + center).rem_euclid(10.0),
                    false => x + center,
                }));
            }
        }
        CurveSet::from_counts(Basis::Polyline, &[-40; 6], Positions::F64(&xyz)).unwrap()
    }

    #[test]
    fn a_wrapped_curve_has_a_segment_longer_than_half_the_scene() {
        let long = rings(true).long_segment().unwrap();
        assert!(long.length > 9.0 && long.extent > 9.0, "{long:?}");
        assert!(long.count >= 4, "{long:?}");
        assert_eq!(rings(false).long_segment(), None);
    }

    #[test]
    fn coarse_curves_have_no_suspicious_segments() {
        // A side of a square spans the whole square. That is no warning, because all of its sides
        // do.
        let xyz = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];
        let square = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F64(&xyz)).unwrap();
        assert_eq!(square.long_segment(), None);
        assert_eq!(square.extent(), 1.0);
        // Two linked squares: only one of them extends along z.
        let other = [0.5, 0.5, -0.5, 1.5, 0.5, -0.5, 1.5, 0.5, 0.5, 0.5, 0.5, 0.5];
        let xyz = [xyz, other].concat();
        let link = CurveSet::from_counts(Basis::Polyline, &[-4; 2], Positions::F64(&xyz)).unwrap();
        assert_eq!(link.long_segment(), None);
    }

    #[test]
    fn the_extent_of_extreme_coordinates_is_finite() {
        let xyz = [-f64::MAX, 0., 0., f64::MAX, 0., 0., 0., 1., 0.];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&xyz)).unwrap();
        assert_eq!(set.extent(), f64::MAX);
        set.long_segment();
    }
}
