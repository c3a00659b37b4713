//! Splines as polylines of a fixed number of chords per segment.

use crate::curve::{Basis, CurveSet, Positions, count_of, point_at};
use crate::error::Result;

/// Replaces each segment of the splines by `per_segment` chords of equal length in parameter, in
/// double precision. Polylines are copied.
///
/// The counts of the result depend on those of `set` alone, so that the frames of a motion keep
/// their layout. Unlike [`super::homotopic_polylines`] this proves nothing: compare the linking
/// numbers.
///
/// # Errors
///
/// [`Error::Count`](crate::Error::Count) if the result has more points than `u32` can count.
pub fn chords(set: &CurveSet, per_segment: usize) -> Result<CurveSet> {
    let steps = match set.basis() {
        Basis::Polyline => 1,
        _ => per_segment.max(1),
    };
    let mut counts = Vec::with_capacity(set.len());
    let mut xyz = Vec::with_capacity(3 * (steps * set.segments() + set.len()));
    for (i, curve) in set.curves().iter().enumerate() {
        let segments = curve.segments as usize;
        for s in 0..segments {
            let hull = set.segment(i, s);
            let inner = (1..steps).map(|k| point_at(&hull, k as f64 / steps as f64));
            xyz.extend(std::iter::once(hull[0]).chain(inner).flatten());
        }
        if !curve.closed {
            xyz.extend(set.knot(i, segments));
        }
        let points = steps * segments + usize::from(!curve.closed);
        counts.push(count_of(points, curve.closed)?);
    }
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chords_keep_the_knots_and_the_ends_of_all_curves() {
        let xyz: Vec<f64> = (0..36).map(|k| f64::from(k * k % 17)).collect();
        let counts = [-6, 6];
        let spline = CurveSet::from_counts(Basis::CatmullRom, &counts, Positions::F64(&xyz));
        let spline = spline.unwrap();
        for steps in [1, 2, 5] {
            let set = chords(&spline, steps).unwrap();
            let open = spline.curve(1).segments as usize;
            let expected = [-(6 * steps as i32), (open * steps) as i32 + 1];
            assert!(set.counts().eq(expected));
            for (i, curve) in spline.curves().iter().enumerate() {
                for s in 0..curve.segments as usize {
                    assert_eq!(set.point(i, s * steps), spline.knot(i, s));
                }
            }
            assert_eq!(set.point(1, open * steps), spline.knot(1, open));
        }
    }

    #[test]
    fn polylines_stay_as_they_are() {
        let xyz = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&xyz)).unwrap();
        let same = chords(&set, 7).unwrap();
        assert!(same.counts().eq([-3]));
        assert_eq!(same.point(0, 2), [0.0, 1.0, 0.0]);
    }
}
