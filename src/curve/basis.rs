//! Spline bases, and cubic segments in Bezier form.

use super::Point;
use std::ops::{Add, Mul, Sub};

/// How control points become a curve. One basis holds for a whole [`crate::CurveSet`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Basis {
    /// Straight segments between the points (`PL`): chains of beads, molecules, straight rods.
    Polyline,
    /// Uniform Catmull-Rom: passes through its control points (`C0`).
    CatmullRom,
    /// Uniform cubic B-spline: approximates its control points (`BS`).
    BSpline,
    /// Cubic Bezier pieces that share their ends: three points a segment (`BZ`).
    Bezier,
}

impl Basis {
    /// Every basis, in the order of its wire code.
    pub const ALL: [Basis; 4] = [
        Basis::Polyline,
        Basis::CatmullRom,
        Basis::BSpline,
        Basis::Bezier,
    ];

    /// Place in [`Basis::ALL`]: the code on the wire.
    #[cfg(any(feature = "client", feature = "mcap"))]
    pub(crate) fn code(self) -> u32 {
        self as u32
    }

    /// Segments of a curve of `points` control points, or `None` where the count does not fit the basis.
    ///
    /// A closed curve of a uniform basis has a segment for every control point. An open one has a segment
    /// for every window of its basis: two points for polylines, four for the cubic ones.
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

    /// Control points between the starts of neighbouring segments.
    pub(crate) fn stride(self) -> usize {
        if self == Basis::Bezier { 3 } else { 1 }
    }

    /// Control points of one segment.
    pub(crate) fn window(self) -> usize {
        if self == Basis::Polyline { 2 } else { 4 }
    }

    /// Wrapped control points stored before the first one of a closed curve, so that segment `s` starts
    /// at (Catmull-Rom) or beside (B-spline) control point `s`.
    pub(crate) fn lead(self, closed: bool) -> usize {
        usize::from(closed && matches!(self, Basis::CatmullRom | Basis::BSpline))
    }

    /// Whether segments are straight, so that a curve is its own polyline.
    pub fn is_polyline(self) -> bool {
        self == Basis::Polyline
    }

    /// Two words for messages.
    pub(crate) fn describe(self, closed: bool) -> &'static str {
        match (self, closed) {
            (Basis::Polyline, true) => "closed polyline",
            (Basis::Polyline, false) => "open polyline",
            (Basis::CatmullRom, true) => "closed Catmull-Rom",
            (Basis::CatmullRom, false) => "open Catmull-Rom",
            (Basis::BSpline, true) => "closed B-spline",
            (Basis::BSpline, false) => "open B-spline",
            (Basis::Bezier, true) => "closed Bezier",
            (Basis::Bezier, false) => "open Bezier",
        }
    }

    /// What [`Basis::segments`] asks of the number of points, in words.
    pub(crate) fn needs(self, closed: bool) -> &'static str {
        match (self, closed) {
            (Basis::Polyline, true) => "at least one",
            (Basis::Polyline, false) => "at least two",
            (Basis::CatmullRom | Basis::BSpline, true) => "at least three",
            (Basis::CatmullRom | Basis::BSpline, false) => "at least four",
            (Basis::Bezier, true) => "a positive multiple of three",
            (Basis::Bezier, false) => "one more than a positive multiple of three",
        }
    }

    /// Bezier control points, on one axis, of the segment with control points `q` (for polylines its ends, twice).
    ///
    /// Rounding: with `M` the largest magnitude in `q` and `u` half a unit in the last place of 1, every result is
    /// within `4 M u` of the exact one. B-spline ends: a sum of at most `5 M` and one of at most `6 M` round by
    /// `11 M u`, a sixth of which is left, and the constant and its product by `M u` each. Inner points: one sum
    /// of `3 M`, likewise. Catmull-Rom: a third of `2 M`, rounded three times, and a sum of at most `4/3 M`.
    #[inline(always)]
    pub(crate) fn hull<T: Real>(self, [q0, q1, q2, q3]: [T; 4]) -> [T; 4] {
        match self {
            Basis::Polyline => {
                let third = (q1 - q0) * T::THIRD;
                [q0, q0 + third, q1 - third, q1]
            }
            Basis::CatmullRom => [q1, q1 + (q2 - q0) * T::SIXTH, q2 - (q3 - q1) * T::SIXTH, q2],
            Basis::BSpline => [
                bspline_knot(q0, q1, q2),
                (T::TWO * q1 + q2) * T::THIRD,
                (q1 + T::TWO * q2) * T::THIRD,
                bspline_knot(q1, q2, q3),
            ],
            Basis::Bezier => [q0, q1, q2, q3],
        }
    }
}

/// The point of a uniform cubic B-spline beside its control point `b`, on one axis.
#[inline(always)]
pub(crate) fn bspline_knot<T: Real>(a: T, b: T, c: T) -> T {
    (a + T::FOUR * b + c) * T::SIXTH
}

/// A cubic segment by its four Bezier control points.
pub(crate) type Bezier = [Point; 4];

/// Smallest and largest coordinates, in double precision.
pub(crate) type Bounds = (Point, Point);

/// A floating-point type that bounds are computed in.
pub(crate) trait Real:
    Copy + PartialOrd + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Default
{
    const TWO: Self;
    const FOUR: Self;
    /// One third, rounded.
    const THIRD: Self;
    /// One sixth, rounded.
    const SIXTH: Self;
}

impl Real for f32 {
    const TWO: f32 = 2.0;
    const FOUR: f32 = 4.0;
    const THIRD: f32 = 1.0 / 3.0;
    const SIXTH: f32 = 1.0 / 6.0;
}

impl Real for f64 {
    const TWO: f64 = 2.0;
    const FOUR: f64 = 4.0;
    const THIRD: f64 = 1.0 / 3.0;
    const SIXTH: f64 = 1.0 / 6.0;
}

/// Bounds of eight consecutive segments of a uniform cubic basis on one axis, from their eleven control points:
/// the extremes of [`Basis::hull`].
#[inline(always)]
pub(crate) fn uniform_bounds<T: Real>(basis: Basis, q: &[T; 11]) -> [[T; 8]; 2] {
    // The basis is decided outside the loop.
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

/// The polar form of a cubic: control points of any sub-segment are its values at the ends.
///
/// Rounding: three rounds of `p + (q - p) t`, each within `5 M u` (difference of at most `2M`, product,
/// sum), where `M` bounds the coordinates of `b` and `u = 2^-53`; rounds do not amplify one another, since
/// each is a convex combination. Within `15 M u` in all.
fn blossom(b: &Bezier, r: f64, s: f64, t: f64) -> Point {
    let mut out = [0.0; 3];
    for (x, out) in out.iter_mut().enumerate() {
        let mix = |p: f64, q: f64, t: f64| p + (q - p) * t;
        let (p, q, w) = (
            mix(b[0][x], b[1][x], r),
            mix(b[1][x], b[2][x], r),
            mix(b[2][x], b[3][x], r),
        );
        *out = mix(mix(p, q, s), mix(q, w, s), t);
    }
    out
}

/// The point of a cubic segment at parameter `t` in `[0, 1]`.
pub(crate) fn point_at(b: &Bezier, t: f64) -> Point {
    blossom(b, t, t, t)
}

/// Bezier form of the part of `b` between the parameters `t0` and `t1`.
pub(crate) fn sub_segment(b: &Bezier, t0: f64, t1: f64) -> Bezier {
    [
        blossom(b, t0, t0, t0),
        blossom(b, t0, t0, t1),
        blossom(b, t0, t1, t1),
        blossom(b, t1, t1, t1),
    ]
}
