//! Scaled vertices of closed polylines, the input of sums.

use super::block::Strip;
use crate::curve::vector::per_axis;
use crate::curve::{CurveSet, Point, pow2};
use crate::kernels::sums::of_polylines;

/// Vertices of all closed polylines of a set in double precision. The first vertex of each curve is
/// repeated at its end. All coordinates are scaled by one power of two, so that they lie between -1
/// and 1: products of six lengths neither overflow nor underflow, unless curves nearly touch.
///
/// The scaling is exact except for coordinates that are below `2^-1022` afterwards, which are off
/// by `2^-1075`.
#[derive(Debug)]
pub(crate) struct Vertices {
    /// Vertices of each curve, as an array for each axis. `None` if the curve has no linking
    /// numbers: an open curve, or a spline.
    strips: Vec<Option<[Vec<f64>; 3]>>,
    pub scale: Scale,
}

/// A power of two, as a product of two powers that are in the range of normal numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale([f64; 2]);

impl Scale {
    /// Returns a scale that maps numbers up to `largest` below 1.
    pub fn new(largest: f64) -> Scale {
        let exponent = (largest.to_bits() >> 52) as i32 - 1023;
        // Subnormal numbers share one exponent, and so one scale.
        let down = exponent + 1;
        Scale([pow2(-(down / 2)), pow2(-(down - down / 2))])
    }

    /// Returns the scaled number, which is exact unless it is below `2^-1022`.
    pub fn apply(self, x: f64) -> f64 {
        x * self.0[0] * self.0[1]
    }
}

impl Vertices {
    /// Copies the vertices of all closed polylines.
    pub fn new(set: &CurveSet) -> Vertices {
        let strip = |points: &[Point]| {
            let closed = points.iter().chain(points.first());
            per_axis(|x| closed.clone().map(|p| p[x]).collect())
        };
        Vertices {
            strips: of_polylines(set, |_| true, strip),
            scale: Scale::new(set.max_abs()),
        }
    }

    /// Returns the vertices of curve `i` if it is a closed polyline.
    pub fn of(&self, i: usize) -> Option<Strip<'_>> {
        let strip = self.strips.get(i)?.as_ref()?;
        Some(strip.each_ref().map(|v| &v[..]))
    }
}
