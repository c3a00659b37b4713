//! Distances of the ends of a curve.

use crate::curve::vector::{SQUARES, hypot, per_axis};
use crate::curve::{Basis, Metric, Point, Positions, Precision, are_three_distinct, bspline_knot};
use crate::error::{Error, Result};
use std::ops::Range;

/// Largest distance of ends that meet, in median segments.
const NEAR: f64 = 1e-3;

/// Largest distance of a last point from the first one that it repeats, in median segments, if the
/// source closes the curve. A closed curve may have short segments, so this is less than [`NEAR`].
const NEAR_IF_CLOSED: f64 = 1e-6;

/// Largest distance of ends that meet by rounding alone, in median segments.
const NEAR_IF_ROUNDED: f64 = 0.1;

/// Ends of an open curve.
pub(super) enum Ends {
    Apart,
    /// The curve ends where it starts, up to this distance.
    Meet {
        within: f64,
    },
    /// The ends or the control points there meet, but a closed spline would have another shape.
    Corner,
}

/// Points of a curve in the positions of a frame.
pub(super) struct Layout<'a> {
    basis: Basis,
    positions: Positions<'a>,
    pub first: usize,
    pub points: usize,
}

impl Layout<'_> {
    pub fn new(basis: Basis, positions: Positions<'_>, first: usize, count: i32) -> Layout<'_> {
        Layout {
            basis,
            positions,
            first,
            points: count.unsigned_abs() as usize,
        }
    }

    /// Returns the number of points that an open curve repeats at its end if it is closed.
    pub fn repeated(&self) -> usize {
        match self.basis {
            Basis::Polyline | Basis::Bezier => 1,
            Basis::CatmullRom | Basis::BSpline => 3,
        }
    }

    /// Returns the points of the closed curve: the segments keep their numbers.
    pub fn without_repeated(&self) -> Range<usize> {
        let lead = self.basis.lead(true);
        self.first + lead..self.first + self.points - self.repeated() + lead
    }

    #[inline(always)]
    fn point(&self, k: usize) -> Point {
        self.positions.point(self.first + k)
    }

    /// Returns the largest distance of a point at the end from the one that it repeats. `None` if
    /// the curve has too few points to be closed.
    fn gap(&self, metric: &Metric) -> Option<f64> {
        let left = self.points.checked_sub(self.repeated())?;
        if left < 3 || self.basis.segments(left, true).is_none() {
            return None;
        }
        let gap = |k: usize| metric.distance(self.point(k), self.point(left + k));
        let gaps = (0..self.repeated()).map(gap);
        // NaN if one of them is.
        gaps.reduce(|a, b| if a >= b || a.is_nan() { a } else { b })
    }

    /// Returns the largest distance at which points count as equal: `near` median segments, or
    /// rounding; 0 if distances overflow, so that such ends do not meet.
    fn tolerance(&self, metric: &Metric, near: f64) -> f64 {
        let step = |k: usize| metric.distance(self.point(k), self.point(k + 1));
        let mut steps: Vec<f64> = (0..self.points - 1).map(step).collect();
        let middle = steps.len() / 2;
        let (_, median, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
        let within = (near * *median).max(self.rounding().min(NEAR_IF_ROUNDED * *median));
        if within.is_finite() { within } else { 0.0 }
    }

    /// Returns the largest distance of two ends that can be caused by rounding, whatever the
    /// lengths of the segments.
    fn rounding(&self) -> f64 {
        let ends = [self.point(0), self.point(self.points - 1)];
        let numbers = ends.as_flattened().iter();
        let largest = numbers.fold(0.0, |m: f64, x| m.max(x.abs()));
        let unit = match self.positions.precision() {
            Precision::F32 => f64::from(f32::EPSILON),
            Precision::F64 => f64::EPSILON,
        };
        4.0 * unit * largest
    }

    fn has_three_distinct_points(&self) -> bool {
        are_three_distinct((0..self.points - self.repeated()).map(|k| self.point(k)))
    }

    /// Compares the ends of an open curve.
    pub fn ends(&self, metric: &Metric) -> Ends {
        let Some(gap) = self.gap(metric) else {
            return Ends::Apart;
        };
        let within = self.tolerance(metric, NEAR);
        if gap <= within && self.has_three_distinct_points() {
            return Ends::Meet { within };
        }
        if self.repeated() == 1 {
            return Ends::Apart;
        }
        // The control points, and the curve itself, which begins beside the second one.
        let last = self.points - 1;
        let [first, second, third] = per_axis(|k| self.point(k));
        let [end, before, third_last] = per_axis(|k| self.point(last - k));
        let [start, stop] = match self.basis {
            Basis::BSpline => [[first, second, third], [third_last, before, end]]
                .map(|p| per_axis(|x| bspline_knot(p[0][x], p[1][x], p[2][x]))),
            _ => [second, before],
        };
        let meet = |p, q| metric.distance(p, q) <= within;
        match meet(first, end) || meet(start, stop) {
            true => Ends::Corner,
            false => Ends::Apart,
        }
    }

    /// Returns the largest distance at which the last point of a closed polyline repeats the first
    /// one. `None` if it does not. `factor` is that of [`Layout::closing_factor`].
    pub fn repeats(&self, metric: &Metric, factor: f64) -> Option<f64> {
        let gap = self.gap(metric).filter(|_| self.basis.is_polyline())?;
        // The median segment is at most as long as the longest one.
        if factor > 2.0 * NEAR_IF_CLOSED && gap > self.rounding() {
            return None;
        }
        let within = self.tolerance(metric, NEAR_IF_CLOSED);
        (gap <= within && self.has_three_distinct_points()).then_some(within)
    }

    /// Checks that an open curve, which is closed in all frames, ends where it starts: within a
    /// distance that is known to be small, or a small part of a segment.
    ///
    /// # Errors
    ///
    /// [`Error::EndsApart`]; [`Error::NotFinite`] for a point that would not be copied.
    pub fn check_ends(&self, curve: usize, metric: &Metric, within: f64) -> Result<()> {
        let Some(gap) = self.gap(metric) else {
            // The frame has too few points, and is rejected for that.
            return Ok(());
        };
        if gap <= within {
            return Ok(());
        }
        let left = self.points - self.repeated();
        let ends = (0..self.repeated()).chain(left..self.points);
        for (point, axis) in ends.flat_map(|k| [(k, 0), (k, 1), (k, 2)]) {
            let value = self.point(point)[axis];
            if !value.is_finite() {
                let axis = ['x', 'y', 'z'][axis];
                return Err(Error::NotFinite {
                    curve,
                    point,
                    axis,
                    value,
                });
            }
        }
        let within = self.tolerance(metric, NEAR);
        match gap <= within {
            true => Ok(()),
            false => Err(Error::EndsApart {
                curve,
                distance: gap,
                within,
            }),
        }
    }

    /// Returns the length of the closing segment of a closed curve, as a multiple of the longest
    /// other one. For splines, between the control points at which segments begin.
    pub fn closing_factor(&self, metric: &Metric) -> f64 {
        let stride = self.basis.stride();
        let knots = self.points / stride;
        if knots < 3 {
            return 0.0;
        }
        let segment =
            |a: usize, b: usize| metric.difference(self.point(a * stride), self.point(b * stride));
        let points = 3 * self.first..3 * (self.first + self.points);
        let squared = match self.positions.part(points) {
            Positions::F32(v) => metric.longest_square(v, stride),
            Positions::F64(v) => metric.longest_square(v, stride),
        };
        let longest = match SQUARES.contains(&squared) {
            true => squared.sqrt(),
            false => (1..knots)
                .map(|k| hypot(segment(k - 1, k)))
                .fold(0.0, f64::max),
        };
        match longest > 0.0 {
            true => hypot(segment(knots - 1, 0)) / longest,
            false => 0.0,
        }
    }
}
