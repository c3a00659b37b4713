//! Surroundings of a place on a curve: their size, and the nearest point of the curve. Pictures of
//! a place choose their scale by them, because the size of a scene of thousands of rings says
//! nothing about the size of one.

use super::vector::{dot, sub};
use super::{CurveSet, Point};

/// Minimum number of segments on each side of a place that belong to its surroundings. A chain of
/// beads turns at every bead, so a sharp turn within them does not end the feature.
const LEAST: usize = 3;

/// Maximum number of segments on each side that are visited.
const MOST: usize = 2000;

/// Number of samples of a spline segment in the search for its nearest point, sufficient for
/// display.
const SAMPLES: usize = 16;

/// Returns the size of the feature of curve `i` around segment `s`: the largest distance from the
/// middle of the segment to a point of the curve, on each side up to the place where the curve has
/// turned by a right angle, ends, or has [`MOST`] segments. `None` if the segment does not exist,
/// or the size is 0 or not finite.
pub(crate) fn feature(set: &CurveSet, i: u32, s: u32) -> Option<f64> {
    let (i, s) = (i as usize, s as usize);
    let curve = set.curves().get(i)?;
    let n = curve.segments as usize;
    if s >= n {
        return None;
    }
    let middle = set.eval(i, s, 0.5);
    let along = |s: usize| sub(set.knot(i, s + 1), set.knot(i, s));
    let start = along(s);
    let mut size_sq = 0.0_f64;
    for forward in [true, false] {
        for k in 0..n.min(MOST) {
            let t = match (forward, curve.closed) {
                (true, true) => (s + k) % n,
                (false, true) => (s + n - k) % n,
                (true, false) if s + k < n => s + k,
                (false, false) if k <= s => s - k,
                _ => break,
            };
            if k >= LEAST && dot(along(t), start) <= 0.0 {
                break;
            }
            let end = sub(set.knot(i, t + usize::from(forward)), middle);
            size_sq = size_sq.max(dot(end, end));
        }
    }
    (size_sq > 0.0 && size_sq.is_finite()).then(|| size_sq.sqrt())
}

/// Returns the parameter at which segment `s` of curve `i` is nearest to a point. `None` if there
/// is no such segment.
pub(crate) fn nearest(set: &CurveSet, i: u32, s: u32, point: Point) -> Option<f64> {
    let (i, s) = (i as usize, s as usize);
    if s >= set.curves().get(i)?.segments as usize {
        return None;
    }
    if set.basis().is_polyline() {
        let (start, end) = (set.knot(i, s), set.knot(i, s + 1));
        let along = sub(end, start);
        let t = dot(sub(point, start), along) / dot(along, along);
        // All parameters of a segment without length are equivalent.
        let t = if t.is_finite() { t } else { 0.5 };
        return Some(t.clamp(0.0, 1.0));
    }
    let dist_sq = |t: f64| {
        let d = sub(set.eval(i, s, t), point);
        dot(d, d)
    };
    let samples = (0..=SAMPLES).map(|k| k as f64 / SAMPLES as f64);
    samples.min_by(|&a, &b| dist_sq(a).total_cmp(&dist_sq(b)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};

    fn ring(points: usize, radius: f64, basis: Basis) -> CurveSet {
        let point = |k: usize| {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / points as f64).sin_cos();
            [radius * cos, radius * sin, 0.0]
        };
        let xyz: Vec<f64> = (0..points).flat_map(point).collect();
        CurveSet::from_counts(basis, &[-(points as i32)], Positions::F64(&xyz)).unwrap()
    }

    #[test]
    fn the_size_of_a_ring_depends_on_its_radius_only() {
        for (points, radius) in [(24, 1.0), (1000, 1.0), (24, 1e-9), (24, 1e6)] {
            let set = ring(points, radius, Basis::Polyline);
            let size = feature(&set, 0, 7).unwrap() / radius;
            assert!((1.3..1.7).contains(&size), "{points} points: {size}");
        }
    }

    #[test]
    fn the_size_of_an_open_curve_ends_where_the_curve_does() {
        let xyz: Vec<f64> = (0..10).flat_map(|k| [f64::from(k), 0.0, 0.0]).collect();
        let set = CurveSet::from_counts(Basis::Polyline, &[10], Positions::F64(&xyz)).unwrap();
        assert_eq!(feature(&set, 0, 2), Some(6.5));
        assert_eq!(feature(&set, 0, 9), None);
        assert_eq!(feature(&set, 1, 0), None);
    }

    #[test]
    fn a_curve_without_extent_has_no_size() {
        let set = ring(3, 0.0, Basis::Polyline);
        assert_eq!(feature(&set, 0, 0), None);
        assert_eq!(nearest(&set, 0, 0, [1.0; 3]), Some(0.5));
    }

    #[test]
    fn the_nearest_point_of_a_spline_is_on_it() {
        let set = ring(12, 1.0, Basis::CatmullRom);
        let on_it = set.eval(0, 4, 0.25);
        assert_eq!(nearest(&set, 0, 4, on_it), Some(0.25));
    }
}
