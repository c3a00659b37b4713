use super::*;
use crate::curve::{Basis, Point};

fn note(kind: ClosingKind, count: usize, first: usize, factor: f64) -> ClosingNote {
    ClosingNote {
        kind,
        count,
        first,
        factor,
    }
}

fn counts_of(set: &CurveSet) -> Vec<i32> {
    set.counts().collect()
}

fn ring(n: usize, radius: f64) -> Vec<Point> {
    let angle = |k: usize| std::f64::consts::TAU * k as f64 / n as f64;
    let point = |k: usize| [radius * angle(k).cos(), radius * angle(k).sin(), 0.5];
    (0..n).map(point).collect()
}

fn close(
    closing: &mut Closing,
    counts: &[i32],
    xyz: &[Point],
    source: CurveSource,
) -> Result<Vec<i32>> {
    let frame = RawFrame {
        basis: Basis::Polyline,
        counts,
        positions: Positions::F64(xyz.as_flattened()),
    };
    closing.curves(frame, source).map(|set| counts_of(&set))
}

#[test]
fn a_repeated_point_closes_a_curve_up_to_rounding() {
    for n in [3, 40, 1000] {
        let mut points = ring(n, 3.0);
        points.push(points[0]);
        for shift in [0.0, 5e-15, 1e-6] {
            points[n] = [3.0, shift, 0.5 - shift];
            let mut closing = Closing::default();
            let source = CurveSource::default();
            let count = [points.len() as i32];
            assert_eq!(
                close(&mut closing, &count, &points, source).unwrap(),
                [-(n as i32)]
            );
            assert_eq!(closing.joined(), 1);
            assert_eq!(closing.take_notes(), [note(ClosingKind::Joined, 1, 0, 0.0)]);
            assert!(closing.take_notes().is_empty());
        }
        let segment = 6.0 * (std::f64::consts::PI / n as f64).sin();
        points[n] = [3.0, 2e-3 * segment, 0.5];
        let mut closing = Closing::default();
        let found = close(
            &mut closing,
            &[n as i32 + 1],
            &points,
            CurveSource::default(),
        );
        assert_eq!(found.unwrap(), [n as i32 + 1]);
    }
}

/// Regression test: the thickness of such a ring was the distance of the two points.
#[test]
fn a_closed_curve_loses_a_last_point_that_repeats_the_first_one() {
    let n = 40;
    let segment = 6.0 * (std::f64::consts::PI / n as f64).sin();
    for (shift, expected) in [(0.0, 40), (5e-15, 40), (1e-7, 40), (1e-4 * segment, 41)] {
        let mut points = ring(n, 3.0);
        points.push([3.0, shift, 0.5 - shift]);
        for closed_by_default in [false, true] {
            let source = CurveSource {
                closed_by_default,
                ..CurveSource::default()
            };
            let mut closing = Closing::default();
            for _ in 0..2 {
                let found = close(&mut closing, &[-41], &points, source);
                assert_eq!(found.unwrap(), [-expected], "{shift}");
            }
            assert_eq!(closing.joined(), usize::from(expected == 40));
            let mut keep_open = Closing::new(true);
            let found = close(&mut keep_open, &[-41], &points, source);
            assert_eq!(found.unwrap(), [-41]);
            // The first frame decides.
            points[n] = [3.1, 0.0, 0.5];
            let moved = close(&mut closing, &[-41], &points, source);
            assert_eq!(moved.is_err(), expected == 40);
            points[n] = [3.0, shift, 0.5 - shift];
        }
    }
}

/// The end is computed, and the scene is far from the origin.
#[test]
fn single_precision_rounding_does_not_keep_a_ring_open() {
    for (n, center) in [(2000, 0.0), (100, 300.0), (400, 1000.0)] {
        let angle = |k: i32| std::f32::consts::TAU * k as f32 / n as f32;
        let point = |k: i32| [center + angle(k).cos(), angle(k).sin() - center, 0.0];
        let points: Vec<[f32; 3]> = (0..=n).map(point).collect();
        let frame = RawFrame {
            basis: Basis::Polyline,
            counts: &[n + 1],
            positions: Positions::F32(points.as_flattened()),
        };
        let set = Closing::default()
            .curves(frame, CurveSource::default())
            .unwrap();
        assert_eq!(counts_of(&set), [-n]);
    }
}

#[test]
fn only_the_points_that_are_repeated_are_removed() {
    let (open, mut joined) = (ring(5, 1.0), ring(6, 2.0));
    joined.push(joined[0]);
    let all = [&open[..], &joined, &open, &joined].concat();
    let frame = RawFrame {
        basis: Basis::Polyline,
        counts: &[5, 7, -5, 7],
        positions: Positions::F64(all.as_flattened()),
    };
    let set = Closing::default()
        .curves(frame, CurveSource::default())
        .unwrap();
    assert_eq!(counts_of(&set), [5, -6, -5, -6]);
    let expected = [&open[..], &joined[..6], &open, &joined[..6]].concat();
    let found: Vec<Point> = (0..4)
        .flat_map(|i| (0..set.curve(i).points as usize).map(move |k| (i, k)))
        .map(|(i, k)| set.point(i, k))
        .collect();
    assert_eq!(found, expected);
    // The same for curves that were read already.
    let read = CurveSet::from_counts(frame.basis, frame.counts, frame.positions).unwrap();
    let closed = Closing::default()
        .of_set(&read, CurveSource::default())
        .unwrap();
    assert_eq!(counts_of(&closed.unwrap()), [5, -6, -5, -6]);
}

#[test]
fn a_spline_is_closed_if_its_shape_stays_the_same() {
    let points = ring(9, 2.0);
    for basis in Basis::ALL {
        let whole: Vec<Point> = match basis {
            Basis::Polyline | Basis::Bezier => [&points[..], &points[..1]].concat(),
            _ => [&points[8..], &points, &points[..2]].concat(),
        };
        let closed =
            CurveSet::from_counts(basis, &[-9], Positions::F64(points.as_flattened())).unwrap();
        let frame = RawFrame {
            basis,
            counts: &[whole.len() as i32],
            positions: Positions::F64(whole.as_flattened()),
        };
        let open = CurveSet::from_counts(basis, frame.counts, frame.positions).unwrap();
        let mut closing = Closing::default();
        let found = closing.curves(frame, CurveSource::default()).unwrap();
        assert_eq!(counts_of(&found), [-9], "{basis:?}");
        for s in 0..closed.curve(0).segments as usize {
            assert_eq!(found.segment(0, s), closed.segment(0, s), "{basis:?}");
            assert_eq!(found.segment(0, s), open.segment(0, s), "{basis:?}");
        }
    }
}

#[test]
fn a_spline_that_would_change_its_shape_stays_open_and_is_named() {
    let points = ring(9, 2.0);
    // The control polygon alone is closed, or the curve has a corner where its ends meet.
    let control = [&points[..], &points[..1]].concat();
    let corner = [&points[..1], &points, &points[..1], &points[..1]].concat();
    for basis in [Basis::CatmullRom, Basis::BSpline] {
        for open in [&control, &corner] {
            let counts = [open.len() as i32];
            let frame = RawFrame {
                basis,
                counts: &counts,
                positions: Positions::F64(open.as_flattened()),
            };
            let mut closing = Closing::default();
            let found = closing.curves(frame, CurveSource::default()).unwrap();
            assert_eq!(counts_of(&found), counts);
            let notes = closing.take_notes();
            assert_eq!(notes, [note(ClosingKind::Corner, 1, 0, 0.0)], "{basis:?}");
            assert!(notes[0].left_out().is_some());
        }
    }
}

#[test]
fn a_closed_curve_that_is_cut_later_is_an_error() {
    let mut closed = ring(20, 1.0);
    closed.push(closed[0]);
    let mut cut = closed.clone();
    cut[20][2] += 0.25;
    let source = CurveSource::default();
    let mut closing = Closing::default();
    assert_eq!(close(&mut closing, &[21], &closed, source).unwrap(), [-20]);
    closing.end_frame(true);
    let e = close(&mut closing, &[21], &cut, source).unwrap_err();
    assert!(
        e.to_string()
            .contains("curve 0 is closed in the first frame"),
        "{e}"
    );
    assert!(e.to_string().contains("2.5000e-1 apart now"), "{e}");
    closing.end_frame(false);
    assert_eq!(close(&mut closing, &[21], &closed, source).unwrap(), [-20]);
    // A point that is dropped is checked.
    cut[20][1] = f64::NAN;
    let e = close(&mut closing, &[21], &cut, source).unwrap_err();
    assert_eq!(e.to_string(), "curve 0, point 20: coordinate y is NaN");
    // A curve that the source closes in the first frame.
    let mut closing = Closing::default();
    assert_eq!(
        close(&mut closing, &[-20], &closed[..20], source).unwrap(),
        [-20]
    );
    assert_eq!(close(&mut closing, &[21], &closed, source).unwrap(), [-20]);
    cut[20][1] = 0.0;
    close(&mut closing, &[21], &cut, source).unwrap_err();
}

/// Regression test: ends at an infinite distance counted as equal, because the tolerance was
/// infinite as well.
#[test]
fn ends_do_not_meet_if_their_distance_overflows() {
    for far in [1e308, f64::INFINITY] {
        let points = [
            [far, 0., 0.],
            [0., far, 0.],
            [-far, 0., 0.],
            [0., -far, 0.],
            [-far, far, 0.],
        ];
        let positions = Positions::F64(points.as_flattened());
        assert_eq!(Closing::ends_meet(&[5], positions), [false], "{far}");
    }
}

#[test]
fn an_open_curve_stays_open_if_its_ends_meet_later() {
    let mut closed = ring(20, 1.0);
    closed.push(closed[0]);
    let mut open = closed.clone();
    open[20][2] += 0.25;
    let source = CurveSource::default();
    let mut closing = Closing::default();
    for points in [&open, &closed] {
        assert_eq!(close(&mut closing, &[21], points, source).unwrap(), [21]);
        closing.end_frame(true);
    }
    closing.forget();
    assert_eq!(close(&mut closing, &[21], &closed, source).unwrap(), [-20]);
}

#[test]
fn a_first_frame_that_is_rejected_decides_nothing() {
    let mut closed = ring(20, 1.0);
    closed.push(closed[0]);
    let mut bad = closed.clone();
    bad[20][0] = f64::NAN;
    let source = CurveSource::default();
    let mut closing = Closing::default();
    close(&mut closing, &[21], &bad, source).unwrap_err();
    closing.end_frame(false);
    assert_eq!(close(&mut closing, &[21], &closed, source).unwrap(), [-20]);
}

#[test]
fn two_distinct_points_are_no_ring_and_the_option_keeps_curves_open() {
    let there_and_back = [[0.0; 3], [1.0; 3], [0.0; 3], [1.0; 3], [0.0; 3]];
    let mut closed = ring(20, 1.0);
    closed.push(closed[0]);
    let source = CurveSource::default();
    let mut closing = Closing::default();
    assert_eq!(
        close(&mut closing, &[5], &there_and_back, source).unwrap(),
        [5]
    );
    let mut closing = Closing::new(true);
    assert_eq!(close(&mut closing, &[21], &closed, source).unwrap(), [21]);
    assert!(closing.take_notes().is_empty());
}

#[test]
fn a_yarn_through_the_cell_does_not_end_where_it_starts() {
    let cell: Cell = "10,10,10".parse().unwrap();
    let yarn: Vec<Point> = (0..=5).map(|k| [2.0 * f64::from(k), 0.0, 0.0]).collect();
    let mut source = CurveSource {
        cell: Some(cell),
        ..CurveSource::default()
    };
    let mut closing = Closing::default();
    assert_eq!(close(&mut closing, &[6], &yarn, source).unwrap(), [6]);
    // Wrapped, its last point is its first one. Unwrapped, it is a yarn again.
    let mut wrapped = yarn.clone();
    wrapped[5][0] = 0.0;
    source.wrapped = true;
    let frame = RawFrame {
        basis: Basis::Polyline,
        counts: &[6],
        positions: Positions::F64(wrapped.as_flattened()),
    };
    let set = Closing::default().curves(frame, source).unwrap();
    let set = crate::Unwrap::default().unwrap(&set, &cell).unwrap();
    assert_eq!(crate::period(&set, 0, &cell), Some([1, 0, 0]));
}

#[test]
fn a_curve_that_only_the_format_closes_stays_open_if_that_takes_a_long_segment() {
    let chain: Vec<Point> = (0..10).map(|k| [f64::from(k), 0.0, 0.0]).collect();
    let both = [&chain[..], &ring(10, 1.0)].concat();
    let mut source = CurveSource {
        closed_by_default: true,
        ..CurveSource::default()
    };
    let mut closing = Closing::default();
    assert_eq!(
        close(&mut closing, &[-10, -10], &both, source).unwrap(),
        [10, -10]
    );
    let (count, first, factor) = (1, 0, 9.0);
    assert_eq!(
        closing.take_notes(),
        [note(ClosingKind::Opened, count, first, factor)]
    );
    // The first frame decides that the curve is closed.
    let swapped = [&ring(10, 1.0)[..], &ring(10, 1.0)].concat();
    assert_eq!(
        close(&mut closing, &[-10, -10], &swapped, source).unwrap(),
        [10, -10]
    );
    // The source marks the curve as closed, so it stays closed.
    source.closed_by_default = false;
    let mut closing = Closing::default();
    assert_eq!(
        close(&mut closing, &[-10, -10], &both, source).unwrap(),
        [-10, -10]
    );
    assert_eq!(
        closing.take_notes(),
        [note(ClosingKind::Long, count, first, factor)]
    );
}

#[test]
fn a_ring_across_the_boundary_of_the_cell_stays_closed() {
    let cell = Cell::orthogonal([0.0; 3], [9.0; 3]);
    let source = CurveSource {
        cell: Some(cell),
        wrapped: true,
        closed_by_default: true,
    };
    // The boundary is between the first point and the last one, and somewhere else.
    let mut wrapped = ring(10, 2.0);
    wrapped
        .iter_mut()
        .for_each(|p| p[1] = (p[1] - 0.1).rem_euclid(9.0));
    let mut closing = Closing::default();
    assert_eq!(
        close(&mut closing, &[-10], &wrapped, source).unwrap(),
        [-10]
    );
    assert!(closing.take_notes().is_empty());
}

/// The factor for the closing segment has little effect on the median of the segment lengths.
#[test]
fn a_repeated_point_is_found_whether_the_median_is_needed_or_not() {
    let mut random = crate::random::Random::new(31);
    let mut found = [0; 2];
    for _ in 0..2000 {
        let n = 4 + random.below(30);
        let scale = 10f64.powi(random.below(9) - 4);
        let mut points: Vec<Point> = (0..n)
            .map(|_| std::array::from_fn(|_| scale * (random.unit() + 2.0)))
            .collect();
        let gap = scale * 10f64.powi(-random.below(17));
        points.push([points[0][0] + gap, points[0][1], points[0][2]]);
        let at = Positions::F64(points.as_flattened());
        let layout = Layout::new(Basis::Polyline, at, 0, -(points.len() as i32));
        let space = Metric::new(None);
        let factor = layout.closing_factor(&space);
        let [quick, full] = [factor, 0.0].map(|factor| layout.repeats(&space, factor));
        assert_eq!(quick, full, "{points:?}");
        found[usize::from(full.is_some())] += 1;
    }
    assert!(found.iter().all(|&n| n > 300), "{found:?}");
}

/// With the outer factors, squares of lengths overflow or underflow.
#[test]
fn the_closing_segment_is_compared_at_all_scales() {
    let square = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [5.0, 7.0, 9.0],
    ];
    let factor = |scale: f64| {
        let points = square.map(|p| p.map(|x| scale * x));
        let at = Positions::F64(points.as_flattened());
        let layout = Layout::new(Basis::Polyline, at, 0, -4);
        layout.closing_factor(&Metric::new(None))
    };
    for exponent in [-1000, -600, -500, -10, 0, 400, 600, 1000] {
        // The square root and `hypot` are rounded differently.
        let ratio = factor(2f64.powi(exponent)) / factor(1.0);
        assert!((ratio - 1.0).abs() < 1e-15, "{exponent}: {ratio}");
    }
}

/// Regression test: a closed curve without points caused a panic.
#[test]
fn a_closed_curve_without_points_is_left_to_be_rejected() {
    let square = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];
    for basis in [Basis::Polyline, Basis::CatmullRom, Basis::BSpline] {
        let mut closing = Closing::default();
        let mut of = |count: i32| {
            let frame = RawFrame {
                basis,
                counts: &[count],
                positions: Positions::F64(&square[..3 * count.unsigned_abs() as usize]),
            };
            let closed = closing.curves(frame, CurveSource::default());
            closing.end_frame(closed.is_ok());
            closed.is_ok()
        };
        assert_eq!([-4, 0, 1, -4].map(&mut of), [true, false, false, true]);
    }
}

/// Regression test: NaN in the first of three repeated points was lost, and the frame was closed
/// without that point.
#[test]
fn a_repeated_point_that_is_not_a_number_is_an_error() {
    let corners = [
        [0., 0.],
        [1., 0.],
        [2., 0.],
        [2., 1.],
        [2., 2.],
        [1., 2.],
        [0., 2.],
        [0., 1.],
    ];
    let ring = corners.map(|[x, y]| [x, y, 0.]);
    let points = [&ring[..], &ring[..3]].concat();
    for basis in [Basis::CatmullRom, Basis::BSpline] {
        for point in [0, 1, 2, 8, 9, 10] {
            let mut closing = Closing::default();
            let mut close = |points: &[[f64; 3]]| {
                let frame = RawFrame {
                    basis,
                    counts: &[11],
                    positions: Positions::F64(points.as_flattened()),
                };
                closing.curves(frame, CurveSource::default()).map(|_| ())
            };
            close(&points).unwrap();
            let mut bad = points.clone();
            bad[point] = [f64::NAN; 3];
            let error = close(&bad).unwrap_err().to_string();
            assert!(
                error.contains(&format!("point {point}: coordinate x is NaN")),
                "{error}"
            );
        }
    }
}
