//! Splines as polylines of a fixed number of chords per segment.

use super::global::polylines;
use crate::curve::CurveSet;
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
    let steps = match set.basis().is_polyline() {
        true => 1,
        false => per_segment,
    };
    let inner = |s: u32| (1..steps).map(move |k| (s, k as f64 / steps as f64));
    let curves = set.curves().iter();
    let splits = curves.map(|c| (0..c.segments).flat_map(inner).collect());
    polylines(set, &splits.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};

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
