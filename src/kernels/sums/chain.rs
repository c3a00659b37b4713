//! Gauss integrals of open and closed polylines, with proven bounds.
//!
//! The Gauss integral of two curves is the mean, over all directions of projection, of the signed
//! number of crossings in which the first curve is above, or half of that of all crossings. It is
//! the linking number if both curves are closed, and a real number otherwise. The integral of a
//! curve and itself, over ordered pairs of points, is its writhe.
//!
//! For polylines both are sums over segment pairs (Banchoff 1976; Klenin & Langowski 2000, method
//! 1a), with the terms of [`super::direct`]: `1 / (2 pi)` times half the solid angle of a segment
//! pair. In the writhe every unordered pair counts twice; a segment and itself, and adjacent
//! segments, lie in a plane and contribute 0.
//!
//! # Kernels
//!
//! | curves | kernel | cost |
//! |---|---|---|
//! | two, up to [`DIRECT`] segment pairs | direct sum; intervals if not precise enough | n^2 |
//! | two, more segments | fast multipole method | n |
//! | one, up to [`FEW`] segments | intervals | n^2 |
//! | one, more segments | fast multipole method on one tree | n |
//!
//! The fast multipole method plans its expansions so that its proven bound is within the tolerance.
//! If that takes too much work, or if rounding alone exceeds the tolerance, the bound is larger.
//!
//! # Limits
//!
//! Segments that touch or nearly touch have an uncertain angle, of up to half a turn either way.
//! They raise the bound by 1/2 or more (by 1 or more in a writhe, which jumps by 2 there).

use super::direct::Formula;
use super::direct::block::gauss_sum;
use super::fmm::{between, itself};
use super::interval::{Interval, angle_of};
use super::{Estimate, direct::Scale};
use crate::curve::vector::per_axis;
use crate::curve::{CurveSet, Point};

/// Maximum number of segment pairs that are summed directly.
const DIRECT: usize = 1 << 20;

/// Maximum number of segments of a curve whose writhe is summed in intervals alone.
const FEW: usize = 48;

/// A polyline, with coordinates scaled to at most 1, and without repeated vertices.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    points: Vec<Point>,
    closed: bool,
}

impl Chain {
    /// Copies curve `i` of a set of polylines.
    pub fn of(set: &CurveSet, i: usize, scale: Scale) -> Chain {
        let curve = set.curve(i);
        let points = (0..curve.points as usize).map(|k| set.point(i, k).map(|x| scale.apply(x)));
        Chain::new(points.collect(), curve.closed)
    }

    /// Creates a polyline from points whose coordinates are at most 1.
    pub fn new(mut points: Vec<Point>, closed: bool) -> Chain {
        points.dedup();
        while closed && points.len() > 1 && points.first() == points.last() {
            points.pop();
        }
        Chain { points, closed }
    }

    /// Returns the number of segments.
    fn segments(&self) -> usize {
        match (self.points.len(), self.closed) {
            (0 | 1, _) => 0,
            (n, closed) => n - usize::from(!closed),
        }
    }

    fn segment(&self, i: usize) -> [Point; 2] {
        [self.points[i], self.points[(i + 1) % self.points.len()]]
    }

    /// Returns the coordinates by axis. The first vertex of a closed polyline is repeated.
    fn strip(&self) -> [Vec<f64>; 3] {
        let end = self.points.first().filter(|_| self.closed);
        per_axis(|x| self.points.iter().chain(end).map(|p| p[x]).collect())
    }

    /// Returns the Gauss integral of two different polylines. Its bound is at most `tolerance` if
    /// possible.
    pub fn integral(&self, other: &Chain, tolerance: f64) -> Estimate {
        let pairs = self.segments().saturating_mul(other.segments());
        if pairs == 0 {
            return Interval::ZERO.estimate();
        }
        if pairs > DIRECT {
            let both = [self, other].map(|chain| (&chain.points[..], chain.closed));
            return between(both, tolerance);
        }
        // Long rows are faster. The order of the curves may be swapped, because it does not change
        // the sum.
        let swap = self.segments() < other.segments();
        let (rows, columns) = if swap { (other, self) } else { (self, other) };
        let strips = [rows, columns].map(Chain::strip);
        let [rows, columns] = strips.each_ref().map(|s| s.each_ref().map(|v| &v[..]));
        let direct = gauss_sum(Formula::Arctangent, rows, columns);
        if direct.bound <= tolerance {
            return direct;
        }
        let narrow = self.enclose(other).estimate();
        match narrow.bound < direct.bound {
            true => narrow,
            false => direct,
        }
    }

    /// Returns the Gauss integral of two polylines in interval arithmetic.
    pub fn enclose(&self, other: &Chain) -> Interval {
        let mut sum = Interval::ZERO;
        for i in 0..self.segments() {
            for j in 0..other.segments() {
                sum = sum + angle_of(self.segment(i), other.segment(j));
            }
        }
        sum / (Interval::PI + Interval::PI)
    }

    /// Returns the writhe of the polyline. Its bound is at most `tolerance` if possible.
    pub fn writhe(&self, tolerance: f64) -> Estimate {
        let n = self.segments();
        if n < 3 {
            return Interval::ZERO.estimate();
        }
        if n <= FEW {
            return self.enclose_writhe().estimate();
        }
        let half = itself(&self.points, self.closed, 0.5 * tolerance);
        half.plus(half)
    }

    /// Returns the writhe of the polyline in interval arithmetic.
    pub fn enclose_writhe(&self) -> Interval {
        let n = self.segments();
        let mut sum = Interval::ZERO;
        for i in 0..n {
            // The last segment of a closed polyline is adjacent to the first one.
            let end = n - usize::from(self.closed && i == 0);
            for j in i + 2..end {
                sum = sum + angle_of(self.segment(i), self.segment(j));
            }
        }
        sum / Interval::PI
    }
}

#[cfg(test)]
#[path = "chain_tests.rs"]
mod tests;
