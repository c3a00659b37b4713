//! Resampling: curves with fewer control points, by arc length.
//!
//! Lengths are measured along chords, so that places at equal distances are equal up to the
//! difference of a chord and its arc.

use super::from_points;
use crate::input::usage;
use linkwatch::{Basis, CurveSet, Point, Result};

/// Number of chords of a spline segment.
const CHORDS: usize = 16;

/// Place on a curve: a segment, and the parameter in it.
pub type At = (usize, f64);

/// A curve by its arc length.
pub struct Along<'a> {
    set: &'a CurveSet,
    curve: usize,
    /// Number of chords of a segment.
    chords: usize,
    /// Length up to each chord; the last one is that of the whole curve.
    lengths: Vec<f64>,
}

impl<'a> Along<'a> {
    pub fn of(set: &'a CurveSet, curve: usize) -> Result<Along<'a>> {
        let chords = if set.basis().is_polyline() { 1 } else { CHORDS };
        let mut lengths = vec![0.0];
        let (mut sum, mut last) = (0.0, set.knot(curve, 0));
        for s in 0..set.curve(curve).segments as usize {
            for k in 1..=chords {
                let p = point(set, curve, (s, k as f64 / chords as f64));
                sum += distance(p, last);
                lengths.push(sum);
                last = p;
            }
        }
        match sum.is_finite() {
            true => Ok(Along {
                set,
                curve,
                chords,
                lengths,
            }),
            false => Err(usage(format!(
                "the length of curve {curve} is not finite: its coordinates are too large to \
                 resample it"
            ))),
        }
    }

    pub fn segments(&self) -> usize {
        self.set.curve(self.curve).segments as usize
    }

    /// Returns the length up to the start of segment `s`.
    pub fn start(&self, s: usize) -> f64 {
        self.lengths[s * self.chords]
    }

    pub fn length(&self) -> f64 {
        self.lengths[self.lengths.len() - 1]
    }

    /// Returns the place at a length.
    pub fn at(&self, length: f64) -> At {
        let last = self.lengths.len() - 2;
        let after = self.lengths.partition_point(|l| *l <= length);
        let chord = after.saturating_sub(1).min(last);
        let (from, to) = (self.lengths[chord], self.lengths[chord + 1]);
        let share = match to > from {
            true => ((length - from) / (to - from)).clamp(0.0, 1.0),
            false => 0.0,
        };
        let t = ((chord % self.chords) as f64 + share) / self.chords as f64;
        (chord / self.chords, t)
    }
}

/// Returns a point of a curve.
pub fn point(set: &CurveSet, i: usize, (s, t): At) -> Point {
    match t {
        0.0 => set.knot(i, s),
        1.0 => set.knot(i, s + 1),
        _ if set.basis().is_polyline() => mix(set.knot(i, s), set.knot(i, s + 1), t),
        _ => set.eval(i, s, t),
    }
}

/// Returns the control points of a part of a cubic segment: those of the cubic through four of its
/// points.
pub fn bezier(set: &CurveSet, i: usize, s: usize, [t0, t1]: [f64; 2]) -> [Point; 4] {
    let at = |share: f64| point(set, i, (s, t0 + (t1 - t0) * share));
    let (a, b) = (point(set, i, (s, t0)), point(set, i, (s, t1)));
    let (p, q) = (at(1.0 / 3.0), at(2.0 / 3.0));
    let inner = |near: Point, p: Point, q: Point, far: Point| {
        let x = |x: usize| (18.0 * p[x] - 5.0 * near[x] - 9.0 * q[x] + 2.0 * far[x]) / 6.0;
        [0, 1, 2].map(x)
    };
    [a, inner(a, p, q, b), inner(b, q, p, a), b]
}

pub fn distance(a: Point, b: Point) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1]).hypot(a[2] - b[2])
}

/// Returns `(1 - t) a + t b`.
pub fn mix(a: Point, b: Point, t: f64) -> Point {
    [0, 1, 2].map(|x| (1.0 - t) * a[x] + t * b[x])
}

/// Returns the curves with a share of their control points each, at equal distances along the curve
/// and in the same basis.
///
/// Knots of the new curves lie on the old ones: Catmull-Rom curves take them as control points, the
/// control points of B-splines are solved for (the interpolating spline). A share of 1 keeps the
/// numbers of points, but not the points: it is a reparameterization.
///
/// Errors: those of [`check`]; the length of a curve is not finite.
pub fn resample(set: &CurveSet, share: f64) -> Result<CurveSet> {
    check(set, share)?;
    let mut counts = Vec::with_capacity(set.len());
    let mut points = Vec::new();
    for i in 0..set.len() {
        let line = Along::of(set, i)?;
        let n = segments_left(set, i, share);
        let each = line.length() / n as f64;
        let knots = (0..n).map(|k| point(set, i, line.at(each * k as f64)));
        let knots: Vec<Point> = knots.collect();
        match set.basis() {
            Basis::BSpline => points.extend(bspline(&knots)),
            _ => points.extend(knots),
        }
        counts.push(-(n as i32));
    }
    from_points(set, &counts, points.into_iter())
}

/// Checks that every curve is closed, of a basis whose knots are its points, and keeps enough of
/// them: a polygon of two edges bounds no area.
pub fn check(set: &CurveSet, share: f64) -> Result<()> {
    for (i, curve) in set.curves().iter().enumerate() {
        if !curve.closed || set.basis() == Basis::Bezier {
            return Err(usage(format!(
                "curve {i}: only closed polylines, Catmull-Rom curves and B-splines are resampled"
            )));
        }
        let left = segments_left(set, i, share);
        if left < 3 {
            return Err(usage(format!(
                "resampling to a share of {share} leaves {left} of {} segments of curve {i}, \
                 which needs 3 or more",
                curve.segments,
            )));
        }
    }
    Ok(())
}

/// Returns the number of segments of curve `i` after resampling.
fn segments_left(set: &CurveSet, i: usize, share: f64) -> usize {
    (share * f64::from(set.curve(i).segments)).round() as usize
}

/// Returns the control points of the closed uniform cubic B-spline through these knots.
///
/// The system of `(a + 4 b + c) / 6 = knot` is solved by Gauss-Seidel iteration: each round reduces
/// the error at least by half, because the diagonal is twice the sum of the others. 60 rounds leave
/// less than the rounding errors. It needs no case for short loops.
fn bspline(knots: &[Point]) -> Vec<Point> {
    let n = knots.len();
    let mut points = knots.to_vec();
    for _ in 0..60 {
        for k in 0..n {
            let (a, c) = (points[(k + n - 1) % n], points[(k + 1) % n]);
            points[k] = [0, 1, 2].map(|x| (6.0 * knots[k][x] - a[x] - c[x]) / 4.0);
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use linkwatch::Positions;
    use std::f64::consts::TAU;

    /// Returns a closed circle whose points are crowded on one side.
    fn circle(basis: Basis, n: i32) -> CurveSet {
        let point = |k: i32| {
            let t = TAU * f64::from(k) / f64::from(n);
            let t = t + 0.5 * t.sin();
            [t.cos(), t.sin(), 0.0]
        };
        let xyz: Vec<f64> = (0..n).flat_map(point).collect();
        CurveSet::from_counts(basis, &[-n], Positions::F64(&xyz)).unwrap()
    }

    #[test]
    fn knots_lie_on_the_old_curve_at_equal_distances() {
        for basis in [Basis::Polyline, Basis::CatmullRom, Basis::BSpline] {
            let coarse = resample(&circle(basis, 240), 0.5).unwrap();
            let segments = coarse.curve(0).segments as usize;
            assert_eq!(segments, 120);
            let knots: Vec<Point> = (0..=segments).map(|s| coarse.knot(0, s)).collect();
            let steps: Vec<f64> = knots.windows(2).map(|e| distance(e[1], e[0])).collect();
            let mean = steps.iter().sum::<f64>() / steps.len() as f64;
            for (s, step) in steps.iter().enumerate() {
                assert!((step / mean - 1.0).abs() < 1e-2, "{basis:?}: {step}");
                // The curve between the knots is a circle, too.
                for p in [knots[s], coarse.eval(0, s, 0.5)] {
                    let r = distance(p, [0.0; 3]);
                    assert!((r - 1.0).abs() < 2e-3, "{basis:?}: {r}");
                }
            }
        }
    }

    #[test]
    fn refuses_shares_that_leave_too_few_points_and_curves_of_infinite_length() {
        let set = circle(Basis::CatmullRom, 12);
        let e = resample(&set, 0.2).unwrap_err().to_string();
        assert!(e.contains("2 of 12 segments of curve 0"), "{e}");
        assert_eq!(resample(&set, 0.25).unwrap().points(), 3);
        let xyz = [-1e308, 0., 0., 1e308, 0., 0., 0., 1e308, 0.];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&xyz)).unwrap();
        let e = resample(&set, 1.0).unwrap_err().to_string();
        assert!(e.contains("curve 0") && e.contains("not finite"), "{e}");
        let one = CurveSet::from_counts(Basis::CatmullRom, &[-6], Positions::F64(&[1.5; 18]));
        let coarse = resample(&one.unwrap(), 0.5).unwrap();
        assert!((0..3).all(|k| coarse.point(0, k) == [1.5; 3]));
    }
}
