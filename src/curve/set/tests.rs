//! Sets of curves as a whole.

use super::*;
use crate::error::Error;

fn square() -> Vec<f32> {
    vec![0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]
}

#[test]
fn update_equals_a_fresh_set() {
    let a: Vec<f64> = (0..60).map(|k| f64::from(k).sin()).collect();
    let b: Vec<f64> = (0..60).map(|k| f64::from(k).cos()).collect();
    let counts = [-7, 6, -7];
    let mut set = CurveSet::from_counts(Basis::BSpline, &counts, Positions::F64(&a)).unwrap();
    set.update(Positions::F64(&b)).unwrap();
    let fresh = CurveSet::from_counts(Basis::BSpline, &counts, Positions::F64(&b)).unwrap();
    for (i, c) in fresh.curves().iter().enumerate() {
        for s in 0..=c.segments as usize {
            assert_eq!(set.knot(i, s), fresh.knot(i, s));
        }
    }
    assert_eq!(set.max_abs(), fresh.max_abs());
    assert_eq!(set.counts().collect::<Vec<_>>(), counts);
    let mut bytes = Vec::new();
    set.write_positions(&mut bytes);
    let back: Vec<f64> = bytes
        .chunks_exact(8)
        .map(|c| f64::from_le_bytes(c.try_into().unwrap()))
        .collect();
    assert_eq!(back, b);
}

/// Copies all positions, for [`CurveSet::update_by`].
fn copy(positions: Positions<'_>) -> impl FnOnce(&mut Received, f64) -> Result<(), Bad> {
    move |to, _| {
        to.copy_from(positions);
        Ok(())
    }
}

#[test]
fn a_received_frame_equals_a_fresh_set() {
    let frame = |k: i32| -> Vec<f64> { (0..57).map(|x| f64::from(x * k).sin()).collect() };
    for basis in Basis::ALL {
        let counts = [-9, 4, -6];
        let first = frame(1);
        let mut set = CurveSet::from_counts(basis, &counts, Positions::F64(&first)).unwrap();
        for k in 2..12 {
            let xyz = frame(k);
            let positions = Positions::F64(&xyz);
            let before = set.contents();
            match k % 3 {
                0 => set.update(positions).unwrap(),
                _ => set.update_by(positions, copy(positions)).unwrap(),
            }
            assert_ne!(set.contents(), before);
            // Without coordinate arrays in the set, the copy has none either.
            let copy = set.clone();
            let fresh = CurveSet::from_counts(basis, &counts, positions).unwrap();
            for set in [&set, &copy] {
                assert_eq!(set.max_abs(), fresh.max_abs());
                for (i, c) in fresh.curves().iter().enumerate() {
                    for s in 0..c.segments as usize {
                        assert_eq!(set.segment(i, s), fresh.segment(i, s), "{basis:?} {k}");
                    }
                }
                let mut bytes = [Vec::new(), Vec::new()];
                set.write_positions(&mut bytes[0]);
                fresh.write_positions(&mut bytes[1]);
                assert_eq!(bytes[0], bytes[1]);
            }
            assert_eq!(copy.contents(), set.contents());
        }
    }
}

#[test]
fn errors_name_the_value_that_is_not_finite() {
    let mut xyz = square();
    xyz[7] = f32::NAN;
    let e = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F32(&xyz)).unwrap_err();
    assert_eq!(e.to_string(), "curve 0, point 2: coordinate y is NaN");
    xyz[7] = f32::INFINITY;
    let e = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F32(&xyz)).unwrap_err();
    assert_eq!(e.to_string(), "curve 0, point 2: coordinate y is inf");
}

#[test]
fn rejects_counts_that_do_not_match_the_positions() {
    for counts in [&[-5][..], &[-3], &[], &[i32::MIN, i32::MIN]] {
        let e = CurveSet::from_counts(Basis::Polyline, counts, Positions::F32(&square()));
        assert!(matches!(e, Err(Error::Count { .. })), "{counts:?}");
    }
    for (basis, counts) in [
        (Basis::BSpline, &[-2, -2][..]),
        (Basis::Bezier, &[-4]),
        (Basis::Polyline, &[-4, 0]),
    ] {
        let e = CurveSet::from_counts(basis, counts, Positions::F32(&square()));
        assert!(
            matches!(e, Err(Error::CurveTooShort { .. })),
            "{basis:?} {counts:?}"
        );
    }
}

#[test]
fn repeated_points_do_not_count_as_distinct() {
    let p = |v: &[[f32; 3]]| {
        let flat: Vec<f32> = v.iter().flatten().copied().collect();
        CurveSet::from_counts(Basis::Polyline, &[-(v.len() as i32)], Positions::F32(&flat)).unwrap()
    };
    let (a, b, c) = ([0.; 3], [1., 0., 0.], [0., 1., 0.]);
    assert!(!p(&[a]).has_three_distinct_points(0));
    assert!(!p(&[a, b, a, b]).has_three_distinct_points(0));
    assert!(p(&[a, a, b, b, c]).has_three_distinct_points(0));
    assert_eq!(p(&[a, a, b, b, c, a]).repeated_vertices(0), 3);
}
