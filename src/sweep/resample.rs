//! Resampling: curves with fewer control points, by arc length.

use super::along::Along;
use super::quantize::from_points;
use crate::curve::vector::add_scaled;
use crate::curve::{Basis, CurveSet, Point};
use crate::error::{Error, Result};

/// Returns the curves with a share of their control points each, at equal distances along the curve
/// and in the same basis.
///
/// Knots of the new curves lie on the old ones: Catmull-Rom curves take them as control points, the
/// control points of B-splines are solved for (the interpolating spline), and Bezier curves have
/// the tangents of the old ones in their knots, so that a corner becomes round. Open curves keep
/// their ends, and splines the directions there. A share of 1 keeps the numbers of points, but not
/// the points: it is a reparameterization.
///
/// Cost: linear in the number of points. Distances are measured along 16 chords per spline segment.
///
/// ```
/// use linkwatch::scenes::Scene;
///
/// let set = "knit:rows=2,stitches=16,segments=512".parse::<Scene>()?.build()?.curves;
/// let coarse = linkwatch::sweep::resample(&set, 0.75)?;
/// assert_eq!((set.points(), coarse.points()), (512, 384));
/// # Ok::<(), linkwatch::Error>(())
/// ```
///
/// Errors: [`Error::Usage`] if the share is not in (0, 1], if too few points of a curve are left
/// for its basis, or if its length is not finite.
pub fn resample(set: &CurveSet, share: f64) -> Result<CurveSet> {
    check(set, share)?;
    let mut counts = Vec::with_capacity(set.len());
    let mut points = Vec::new();
    for i in 0..set.len() {
        let closed = set.curve(i).closed;
        let line = Along::of(set, i)?;
        let first = points.len();
        place(&line, segments_left(set, i, share), &mut points);
        let count = (points.len() - first) as i32;
        counts.push(if closed { -count } else { count });
    }
    from_points(set, &counts, points.into_iter())
}

/// Checks that every curve keeps enough points.
pub(super) fn check(set: &CurveSet, share: f64) -> Result<()> {
    if !(share > 0.0 && share <= 1.0) {
        return Err(Error::Usage(format!(
            "resampling to a share of {share}, expected above 0 and up to 1"
        )));
    }
    for (i, curve) in set.curves().iter().enumerate() {
        let least = match (set.basis(), curve.closed) {
            // A polygon of two edges bounds no area.
            (Basis::Polyline | Basis::CatmullRom | Basis::BSpline, true) => 3,
            _ => 1,
        };
        let left = segments_left(set, i, share);
        if left < least.min(curve.segments as usize) {
            return Err(Error::Usage(format!(
                "resampling to a share of {share} leaves {left} of {} segments of curve {i}; \
                 a {} needs {least} or more",
                curve.segments,
                set.basis().describe(curve.closed)
            )));
        }
    }
    Ok(())
}

/// Returns the number of segments of curve `i` after resampling.
fn segments_left(set: &CurveSet, i: usize, share: f64) -> usize {
    (share * f64::from(set.curve(i).segments)).round() as usize
}

/// Appends the control points of a curve of `n` segments of equal length along another one.
fn place(line: &Along<'_>, n: usize, out: &mut Vec<Point>) {
    let (basis, closed) = (line.basis(), line.is_closed());
    let each = line.length() / n as f64;
    let places = (0..n + usize::from(!closed)).map(|k| match k == n {
        true => (line.segments() - 1, 1.0),
        false => line.at(each * k as f64),
    });
    let places: Vec<(usize, f64)> = places.collect();
    let knots: Vec<Point> = places.iter().map(|place| line.point(*place)).collect();
    match basis {
        Basis::Polyline => out.extend(knots),
        Basis::CatmullRom if closed => out.extend(knots),
        Basis::BSpline if closed => out.extend(closed_bspline(&knots)),
        Basis::Bezier => {
            for k in 0..n {
                let next = (k + 1) % places.len();
                let [start, end] = [places[k], places[next]].map(|place| line.tangent(place));
                out.push(knots[k]);
                out.push(add_scaled(knots[k], each / 3.0, start));
                out.push(add_scaled(knots[next], -each / 3.0, end));
            }
            out.extend((!closed).then(|| knots[n]));
        }
        Basis::CatmullRom | Basis::BSpline => {
            // The points before and after the curve give it its tangents at the ends.
            let [first, last] = [places[0], places[n]].map(|p| line.tangent(p).map(|x| x * each));
            let inner = match basis {
                Basis::BSpline => open_bspline(&knots, [first, last]),
                _ => knots,
            };
            out.push(add_scaled(inner[1], -2.0, first));
            let after = add_scaled(inner[n - 1], 2.0, last);
            out.extend(inner);
            out.push(after);
        }
    }
}

/// Returns the control points of the closed uniform cubic B-spline through these knots.
///
/// The system of `(a + 4 b + c) / 6 = knot` is solved by Gauss-Seidel iteration: each round reduces
/// the error at least by half, because the diagonal is twice the sum of the others. 60 rounds leave
/// less than the rounding errors. It needs no case for short loops.
fn closed_bspline(knots: &[Point]) -> Vec<Point> {
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

/// Returns the control points, without the first and the last one, of the open uniform cubic
/// B-spline through these knots with these derivatives at its ends. Same iteration as above; in
/// the first row `a = c - 2 first`, and in the last one `c = a + 2 last`.
fn open_bspline(knots: &[Point], [first, last]: [Point; 2]) -> Vec<Point> {
    let n = knots.len();
    let mut points = knots.to_vec();
    for _ in 0..60 {
        for k in 0..n {
            let before = (k > 0).then(|| points[k - 1]);
            let after = (k + 1 < n).then(|| points[k + 1]);
            let sum = match (before, after) {
                (None, Some(c)) => add_scaled(add_scaled(c, 1.0, c), -2.0, first),
                (Some(a), None) => add_scaled(add_scaled(a, 1.0, a), 2.0, last),
                (Some(a), Some(c)) => add_scaled(a, 1.0, c),
                (None, None) => [0.0; 3],
            };
            points[k] = [0, 1, 2].map(|x| (6.0 * knots[k][x] - sum[x]) / 4.0);
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Positions;
    use crate::curve::vector::{hypot, sub};
    use std::f64::consts::TAU;

    /// Returns a circle whose points are crowded on one side, or three quarters of it.
    fn circle(basis: Basis, n: usize, closed: bool) -> CurveSet {
        let turn = if closed { 1.0 } else { 0.75 };
        let point = |k: usize| {
            let t = TAU * turn * k as f64 / n as f64;
            let t = t + if closed { 0.5 * t.sin() } else { 0.0 };
            [t.cos(), t.sin(), 0.0]
        };
        let xyz: Vec<f64> = (0..n).flat_map(point).collect();
        let count = if closed { -(n as i32) } else { n as i32 };
        CurveSet::from_counts(basis, &[count], Positions::F64(&xyz)).unwrap()
    }

    fn knots(set: &CurveSet) -> Vec<Point> {
        (0..=set.curve(0).segments as usize)
            .map(|s| set.knot(0, s))
            .collect()
    }

    #[test]
    fn knots_lie_on_the_old_curve_at_equal_distances() {
        for basis in [Basis::Polyline, Basis::CatmullRom, Basis::BSpline] {
            for closed in [true, false] {
                let set = circle(basis, 240, closed);
                let coarse = resample(&set, 0.5).unwrap();
                assert_eq!(coarse.curve(0).segments, set.curve(0).segments.div_ceil(2));
                let knots = knots(&coarse);
                let steps: Vec<f64> = knots.windows(2).map(|e| hypot(sub(e[1], e[0]))).collect();
                let mean = steps.iter().sum::<f64>() / steps.len() as f64;
                for (p, step) in knots.iter().zip(&steps) {
                    assert!((hypot(*p) - 1.0).abs() < 1e-3, "{basis:?} {closed}: {p:?}");
                    assert!(
                        (step / mean - 1.0).abs() < 1e-2,
                        "{basis:?} {closed}: {step}"
                    );
                }
                // The curve between the knots is a circle, too.
                for s in 0..coarse.curve(0).segments as usize {
                    let r = hypot(coarse.eval(0, s, 0.5));
                    assert!((r - 1.0).abs() < 2e-3, "{basis:?} {closed}: {r}");
                }
            }
        }
    }

    #[test]
    fn open_curves_keep_their_ends() {
        for basis in Basis::ALL {
            let set = circle(basis, 61, false);
            let coarse = resample(&set, 0.4).unwrap();
            let (old, new) = (knots(&set), knots(&coarse));
            for (p, q) in [(old[0], new[0]), (old[old.len() - 1], new[new.len() - 1])] {
                assert!(hypot(sub(p, q)) < 1e-12, "{basis:?}: {p:?}, {q:?}");
            }
        }
    }

    #[test]
    fn bezier_curves_keep_their_shape() {
        // A circle of four pieces, each with handles of the usual length.
        let c = 0.552_284_75;
        let [o, i] = [0.0, 1.0];
        let xyz = [
            [i, o, o],
            [i, c, o],
            [c, i, o],
            [o, i, o],
            [-c, i, o],
            [-i, c, o],
            [-i, o, o],
            [-i, -c, o],
            [-c, -i, o],
            [o, -i, o],
            [c, -i, o],
            [i, -c, o],
        ];
        let xyz = xyz.as_flattened();
        let set = CurveSet::from_counts(Basis::Bezier, &[-12], Positions::F64(xyz)).unwrap();
        let coarse = resample(&set, 0.75).unwrap();
        assert_eq!(coarse.points(), 9);
        for s in 0..3 {
            for k in 0..8 {
                let r = hypot(coarse.eval(0, s, f64::from(k) / 8.0));
                assert!((r - 1.0).abs() < 0.06, "{r}");
            }
        }
    }

    #[test]
    fn refuses_shares_that_leave_too_few_points() {
        let set = circle(Basis::CatmullRom, 12, true);
        let e = resample(&set, 0.2).unwrap_err().to_string();
        assert!(
            e.contains("2 of 12 segments of curve 0") && e.contains("3 or more"),
            "{e}"
        );
        assert_eq!(resample(&set, 0.25).unwrap().points(), 3);
        for share in [0.0, -1.0, 1.5, f64::NAN] {
            let e = resample(&set, share).unwrap_err().to_string();
            assert!(e.contains("share") && e.contains("up to 1"), "{e}");
        }
    }

    #[test]
    fn refuses_a_curve_of_infinite_length() {
        let xyz = [-1e308, 0., 0., 1e308, 0., 0., 0., 1e308, 0.];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&xyz)).unwrap();
        let e = resample(&set, 1.0).unwrap_err().to_string();
        assert!(e.contains("curve 0") && e.contains("not finite"), "{e}");
    }

    #[test]
    fn a_curve_without_length_keeps_its_point() {
        let set = CurveSet::from_counts(Basis::CatmullRom, &[-6], Positions::F64(&[1.5; 18]));
        let coarse = resample(&set.unwrap(), 0.5).unwrap();
        assert!((0..3).all(|k| coarse.point(0, k) == [1.5; 3]));
    }
}
