//! Spline bases, and cubic segments in Bezier form.

use super::Point;
use super::vector::per_axis;
use crate::error::{Error, Result};
use std::ops::{Add, Div, Mul, Sub};

vocabulary! {
    /// Rule that turns control points into a curve. All curves of a [`crate::CurveSet`] have the
    /// same basis.
    pub enum Basis {
        /// Straight segments between the points (`PL`): chains of beads, molecules, straight rods.
        Polyline = "polyline",
        /// Uniform Catmull-Rom: passes through its control points (`C0`).
        CatmullRom = "catmull-rom",
        /// Uniform cubic B-spline: approximates its control points (`BS`).
        BSpline = "b-spline",
        /// Cubic Bezier pieces that share their ends: three points a segment (`BZ`).
        Bezier = "bezier",
    }
}

impl Basis {
    /// Returns the wire code: the index in [`Basis::ALL`].
    #[cfg(any(feature = "client", feature = "verify"))]
    pub(crate) fn code(self) -> u32 {
        self as u32
    }

    /// Returns the number of segments of a curve of `points` control points, or `None` if the basis
    /// does not allow that number of points.
    ///
    /// A closed curve of a uniform basis has one segment per control point. An open curve has one
    /// segment per window of its basis: two points for polylines, four for cubic bases.
    pub fn segments(self, points: usize, closed: bool) -> Option<usize> {
        match (self, closed) {
            (Basis::Polyline, true) => (points >= 1).then_some(points),
            (Basis::Polyline, false) => points.checked_sub(1).filter(|&n| n > 0),
            (Basis::CatmullRom | Basis::BSpline, true) => (points >= 3).then_some(points),
            (Basis::CatmullRom | Basis::BSpline, false) => points.checked_sub(3).filter(|&n| n > 0),
            (Basis::Bezier, true) => (points > 0 && points.is_multiple_of(3)).then_some(points / 3),
            (Basis::Bezier, false) => (points >= 4 && points % 3 == 1).then_some(points / 3),
        }
    }

    /// Same as [`Basis::segments`], for this curve.
    ///
    /// # Errors
    ///
    /// [`Error::CurveTooShort`].
    pub(crate) fn segments_of(self, curve: usize, points: usize, closed: bool) -> Result<usize> {
        let segments = self.segments(points, closed);
        segments.ok_or_else(|| Error::CurveTooShort {
            curve,
            points,
            kind: self.describe(closed),
            needed: self.needs(closed),
        })
    }

    /// Returns the number of control points from the start of one segment to the start of the next
    /// one.
    pub(crate) fn stride(self) -> usize {
        if self == Basis::Bezier { 3 } else { 1 }
    }

    /// Returns the number of control points of one segment.
    pub(crate) fn window(self) -> usize {
        if self == Basis::Polyline { 2 } else { 4 }
    }

    /// Returns the number of wrapped control points that are stored before the first one of a
    /// closed curve. With them, segment `s` starts at (Catmull-Rom) or beside (B-spline) control
    /// point `s`.
    pub(crate) fn lead(self, closed: bool) -> usize {
        usize::from(closed && matches!(self, Basis::CatmullRom | Basis::BSpline))
    }

    /// Returns the share of the size of a box of control points by which a curve may leave the box,
    /// on each side.
    #[cfg(feature = "verify")]
    pub(crate) fn overshoot(self) -> f64 {
        match self {
            // Weights of control points from -1/6 to 7/6.
            Basis::CatmullRom => 1.0 / 6.0,
            Basis::Polyline | Basis::Bezier | Basis::BSpline => 0.0,
        }
    }

    /// Returns true if segments are straight, so that a curve is its own polyline.
    pub fn is_polyline(self) -> bool {
        self == Basis::Polyline
    }

    /// Returns the words for this kind of curve in messages.
    pub(crate) fn describe(self, closed: bool) -> &'static str {
        let words = match self {
            Basis::Polyline => ["open polyline", "closed polyline"],
            Basis::CatmullRom => ["open Catmull-Rom", "closed Catmull-Rom"],
            Basis::BSpline => ["open B-spline", "closed B-spline"],
            Basis::Bezier => ["open Bezier", "closed Bezier"],
        };
        words[usize::from(closed)]
    }

    /// Returns, in words, the condition that [`Basis::segments`] puts on the number of points.
    fn needs(self, closed: bool) -> &'static str {
        match (self, closed) {
            (Basis::Polyline, true) => "at least one",
            (Basis::Polyline, false) => "at least two",
            (Basis::CatmullRom | Basis::BSpline, true) => "at least three",
            (Basis::CatmullRom | Basis::BSpline, false) => "at least four",
            (Basis::Bezier, true) => "a positive multiple of three",
            (Basis::Bezier, false) => "one more than a positive multiple of three",
        }
    }

    /// Returns the Bezier control points, on one axis, of the segment with control points `q` (for
    /// polylines: its ends, twice).
    ///
    /// # Rounding error: every result is within `4 M u` of the exact one
    ///
    /// Let `M` be the largest magnitude in `q`, and `u` half a unit in the last place of 1.
    ///
    /// - B-spline, ends: a sum of at most `5 M` and one of at most `6 M` are rounded by `11 M u`
    ///   together. Multiplied by one sixth, that is `11/6 M u`. The rounded constant and the
    ///   product add `M u` each.
    /// - B-spline, inner points: the same with one sum of at most `3 M`.
    /// - Catmull-Rom: one sixth of a difference of at most `2 M`, rounded three times, and a sum of
    ///   at most `4/3 M`.
    #[inline(always)]
    pub(crate) fn hull<T: Real>(self, [q0, q1, q2, q3]: [T; 4]) -> [T; 4] {
        match self {
            Basis::Polyline => {
                let third = (q1 - q0) * T::inverse(3);
                [q0, q0 + third, q1 - third, q1]
            }
            Basis::CatmullRom => [
                q1,
                q1 + (q2 - q0) * T::inverse(6),
                q2 - (q3 - q1) * T::inverse(6),
                q2,
            ],
            Basis::BSpline => [
                bspline_knot(q0, q1, q2),
                (T::from(2u8) * q1 + q2) * T::inverse(3),
                (q1 + T::from(2u8) * q2) * T::inverse(3),
                bspline_knot(q1, q2, q3),
            ],
            Basis::Bezier => [q0, q1, q2, q3],
        }
    }
}

/// Returns the point of a uniform cubic B-spline beside its control point `b`, on one axis.
#[inline(always)]
pub(crate) fn bspline_knot<T: Real>(a: T, b: T, c: T) -> T {
    (a + T::from(4u8) * b + c) * T::inverse(6)
}

/// A cubic segment, given by its four Bezier control points.
pub(crate) type Bezier = [Point; 4];

/// A floating-point type of coordinates, in which bounds are computed.
pub(crate) trait Real:
    Copy
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + From<u8>
    + From<f32>
    + Into<f64>
    + Default
{
    /// Returns `1 / n`, rounded.
    #[inline(always)]
    fn inverse(n: u8) -> Self {
        Self::from(1u8) / Self::from(n)
    }

    /// Returns the bit pattern of the largest magnitude.
    fn largest(values: &[Self]) -> u64;
    /// Returns the number with this bit pattern.
    fn from_magnitude(bits: u64) -> f64;
    /// Returns the bit pattern of the largest finite magnitude that is not above `limit`.
    fn bits_within(limit: f64) -> u64;
}

impl Real for f32 {
    #[inline(always)]
    fn largest(values: &[Self]) -> u64 {
        let largest = values.iter().fold(0, |m, v| (v.to_bits() << 1 >> 1).max(m));
        u64::from(largest)
    }

    fn from_magnitude(bits: u64) -> f64 {
        f32::from_bits(bits as u32).into()
    }

    fn bits_within(limit: f64) -> u64 {
        // The limits are powers of two, or beyond single precision.
        u64::from((limit.min(f32::MAX.into()) as f32).to_bits())
    }
}

impl Real for f64 {
    #[inline(always)]
    fn largest(values: &[Self]) -> u64 {
        values.iter().fold(0, |m, v| (v.to_bits() << 1 >> 1).max(m))
    }

    fn from_magnitude(bits: u64) -> f64 {
        f64::from_bits(bits)
    }

    fn bits_within(limit: f64) -> u64 {
        limit.min(f64::MAX).to_bits()
    }
}

/// Returns the bounds of eight consecutive segments of a uniform cubic basis on one axis, given
/// their eleven control points: the minimum and the maximum of [`Basis::hull`].
#[inline(always)]
pub(crate) fn uniform_bounds<T: Real>(basis: Basis, q: &[T; 11]) -> [[T; 8]; 2] {
    // The branch on the basis stays outside of the loop.
    if basis == Basis::BSpline {
        bounds_of(Basis::BSpline, q)
    } else {
        bounds_of(Basis::CatmullRom, q)
    }
}

#[inline(always)]
fn bounds_of<T: Real>(basis: Basis, q: &[T; 11]) -> [[T; 8]; 2] {
    let [mut lo, mut hi] = [[T::default(); 8]; 2];
    for k in 0..8 {
        let [a, b, c, d] = basis.hull([q[k], q[k + 1], q[k + 2], q[k + 3]]);
        let smaller = |a: T, b: T| if a < b { a } else { b };
        let larger = |a: T, b: T| if a > b { a } else { b };
        lo[k] = smaller(smaller(a, b), smaller(c, d));
        hi[k] = larger(larger(a, b), larger(c, d));
    }
    [lo, hi]
}

/// Evaluates the polar form (blossom) of a cubic. With the ends of a sub-segment as arguments, its
/// values are the control points of that sub-segment.
///
/// # Rounding error: at most `15 M u`
///
/// `M` bounds the coordinates of `b`, and `u = 2^-53`. There are three rounds of `p + (q - p) t`,
/// each with an error of at most `5 M u` (a difference of at most `2 M`, a product, a sum). Each
/// round is a convex combination, so it does not amplify the errors of the round before.
#[inline(always)]
fn blossom(b: &Bezier, r: f64, s: f64, t: f64) -> Point {
    let mix = |p: f64, q: f64, t: f64| p + (q - p) * t;
    per_axis(|x| {
        let mixed = |k: usize| mix(b[k][x], b[k + 1][x], r);
        let (p, q, w) = (mixed(0), mixed(1), mixed(2));
        mix(mix(p, q, s), mix(q, w, s), t)
    })
}

/// Returns the point of a cubic segment at parameter `t` in `[0, 1]`.
#[inline]
pub(crate) fn point_at(b: &Bezier, t: f64) -> Point {
    blossom(b, t, t, t)
}

/// Returns the Bezier form of the part of `b` between the parameters `t0` and `t1`.
#[inline]
pub(crate) fn sub_segment(b: &Bezier, t0: f64, t1: f64) -> Bezier {
    [
        blossom(b, t0, t0, t0),
        blossom(b, t0, t0, t1),
        blossom(b, t0, t1, t1),
        blossom(b, t1, t1, t1),
    ]
}
