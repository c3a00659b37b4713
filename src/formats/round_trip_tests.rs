//! Every format that can hold a set gives it back: curves, order, start, direction, and values.

use super::format::EXTENSIONS;
use super::tests::curves;
use super::*;
use crate::curve::{Basis, Cell, CurveLabels, Positions, Precision};
use proptest::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Formats that are written.
fn written() -> impl Iterator<Item = (&'static str, Format)> {
    let path = |extension: &str| PathBuf::from(format!("a.{extension}"));
    EXTENSIONS
        .into_iter()
        .filter(move |(extension, _)| Format::to_write(&path(extension)).is_ok())
}

/// Writes frames to a file of this extension, and reads them.
fn again(extension: &str, frames: &[ModelFrame], options: &ReadOptions) -> Result<Vec<ModelFrame>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("a.{extension}"));
    let mut writer = FrameWriter::create(&path, Format::of(&path)?)?;
    for frame in frames {
        writer.frame(frame)?;
    }
    writer.finish()?;
    Frames::open(&path, options)?.collect()
}

fn set(basis: Basis, counts: &[i32], xyz: &[f64], precision: Precision) -> CurveSet {
    let points: usize = counts.iter().map(|c| c.unsigned_abs() as usize).sum();
    let values = xyz.iter().copied().cycle().take(3 * points);
    match precision {
        Precision::F32 => {
            let values: Vec<f32> = values.map(|x| x as f32).collect();
            CurveSet::from_counts(basis, counts, Positions::F32(&values)).unwrap()
        }
        Precision::F64 => {
            let values: Vec<f64> = values.collect();
            CurveSet::from_counts(basis, counts, Positions::F64(&values)).unwrap()
        }
    }
}

fn with_counts(set: &CurveSet, extension: &str) -> ReadOptions {
    let has_none = ["npy", "npz"].contains(&extension);
    ReadOptions {
        counts: has_none.then(|| set.counts().collect()),
        ..ReadOptions::default()
    }
}

/// Asserts that two lists have the same frames.
fn assert_same(extension: &str, found: &[ModelFrame], expected: &[ModelFrame]) {
    assert_eq!(found.len(), expected.len(), "{extension}");
    for (found, expected) in found.iter().zip(expected) {
        let (a, b) = (
            found.curves.as_ref().unwrap(),
            expected.curves.as_ref().unwrap(),
        );
        assert_eq!(curves(a), curves(b), "{extension}");
        assert_eq!(a.basis(), b.basis(), "{extension}");
        assert_eq!(found.info.seq, expected.info.seq, "{extension}");
    }
}

proptest! {
    #[test]
    fn polylines_round_trip_in_every_format(
        sizes in prop::collection::vec((3..9i32, any::<bool>()), 1..5),
        bits in prop::collection::vec(any::<u64>(), 1..60),
        single in any::<bool>(),
    ) {
        let sign = |&(n, closed): &(i32, bool)| if closed { -n } else { n };
        let counts: Vec<i32> = sizes.iter().map(sign).collect();
        let finite = bits.iter().map(|&b| f64::from_bits(b)).filter(|x| x.abs() < 1e300);
        let precision = if single { Precision::F32 } else { Precision::F64 };
        let small = finite.map(|x| if single { x % 1e30 } else { x });
        let xyz: Vec<f64> = small.chain([1.5]).collect();
        let set = set(Basis::Polyline, &counts, &xyz, precision);
        let frames = [ModelFrame::new(0, Ok(set.clone()))];
        for (extension, _) in written() {
            if extension == "bcc" && !single {
                continue;
            }
            let options = with_counts(&set, extension);
            assert_same(extension, &again(extension, &frames, &options).unwrap(), &frames);
        }
    }

    #[test]
    fn splines_names_radii_and_times_round_trip_in_an_archive(
        basis in prop::sample::select(&Basis::ALL[..]),
        single in any::<bool>(),
        xyz in prop::collection::vec(-1e9..1e9f64, 1..60),
        names in prop::collection::hash_set("[a-zü]{1,9}", 3),
        radii in prop::collection::vec(0.0..9.0f32, 3),
        seqs in prop::collection::btree_set(any::<u64>(), 1..4),
        time in -1e3..1e3f64,
    ) {
        let precision = if single { Precision::F32 } else { Precision::F64 };
        let labels = Arc::new(CurveLabels::named(names).with_radii(radii));
        let frames: Vec<ModelFrame> = (seqs.into_iter().enumerate())
            .map(|(k, seq)| {
                let set = set(basis, &[-6, 7, -9], &xyz[k % xyz.len()..], precision);
                let mut frame = ModelFrame::new(seq, Ok(set));
                (frame.info.time, frame.info.labels) = (time + k as f64, labels.clone());
                frame
            })
            .collect();
        let found = again("npz", &frames, &ReadOptions::default()).unwrap();
        assert_same("npz", &found, &frames);
        for (found, expected) in found.iter().zip(&frames) {
            prop_assert_eq!(found.info.time, expected.info.time);
            prop_assert_eq!(&*found.info.labels, &*labels);
            prop_assert_eq!(found.curves.as_ref().unwrap().precision(), precision);
        }
    }
}

#[test]
fn frames_of_a_motion_round_trip_in_formats_with_frames() {
    let frame = |seq, time, x: f64| {
        let xyz = [x, 0.5, 1.0, -1.0, 2.0, 1e-3, x + 7.0, 0.25];
        let set = set(Basis::Polyline, &[-4, 5, -3], &xyz, Precision::F64);
        let mut frame = ModelFrame::new(seq, Ok(set));
        frame.info.time = time;
        frame
    };
    let frames = [frame(0, 0.0, 0.1), frame(1, 0.5, 0.2), frame(2, 0.75, 0.3)];
    for (extension, format) in written() {
        let options = with_counts(frames[0].curves.as_ref().unwrap(), extension);
        let path = PathBuf::from(format!("a.{extension}"));
        assert_eq!(
            Format::of(&path).unwrap().holds_frames(),
            format.holds_frames()
        );
        let result = again(extension, &frames, &options);
        if format.holds_frames() {
            let found = result.unwrap();
            assert_same(extension, &found, &frames);
            if extension != "npy" {
                let times = found.iter().map(|frame| frame.info.time);
                assert!(times.eq([0.0, 0.5, 0.75]), "{extension}");
            }
        } else {
            let expected = match extension {
                "bcc" => "single precision",
                _ => "a second frame in one file",
            };
            let error = result.unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
    // The curves of all frames are those of the first one.
    let two = [
        frames[0].curves.as_ref().unwrap().clone(),
        set(Basis::Polyline, &[-4], &[1.0], Precision::F64),
    ];
    let two = two.map(Ok);
    let mut seq = 0..;
    let frames = two.map(|curves| ModelFrame::new(seq.next().unwrap(), curves));
    for extension in ["npy", "npz"] {
        let error = again(extension, &frames, &ReadOptions::default())
            .unwrap_err()
            .to_string();
        assert!(error.contains("1 curves after a frame of 3"), "{error}");
    }
}

#[test]
fn cells_round_trip_in_the_formats_that_hold_them() {
    let xyz = [0.1, 0.5, 1.0, -1.0, 2.0, 1e-3, 1.5, 0.25];
    for text in [
        "10,11,12",
        "10.1,0,12.3",
        "0,0,7.7",
        "10,0,0,2.5,12,0,-3.25,1.5,12",
        "10,0,0,0,11,0,0,0,12,0.5,-0.25,100",
        "10,0,0,2.5,12,0,0,0,0",
    ] {
        let cell: Cell = text.parse().unwrap();
        for (extension, format) in written() {
            let set = || set(Basis::Polyline, &[-4, 4], &xyz, Precision::F32);
            let frame = |seq| {
                let mut frame = ModelFrame::new(seq, Ok(set()));
                frame.info.cell = Some(cell);
                frame
            };
            let mut frames = vec![frame(0)];
            frames.extend(format.holds_frames().then(|| frame(1)));
            let found = again(extension, &frames, &with_counts(&set(), extension)).unwrap();
            for frame in &found {
                assert!(frame.curves.is_ok(), "{extension}: {text}");
                match frame.info.cell {
                    Some(found) if format.holds_cells() => {
                        assert_eq!(found.vectors, cell.vectors, "{extension}");
                    }
                    other => assert!(other.is_none() && !format.holds_cells(), "{extension}"),
                }
            }
            if format == Format::Npz {
                assert!(found.iter().all(|frame| frame.info.cell == Some(cell)));
            }
        }
    }
}

#[test]
fn a_cell_may_change_from_frame_to_frame() {
    let frame = |seq, cell: Option<&str>| {
        let set = set(
            Basis::Polyline,
            &[-4],
            &[0.5, 1.0, 0.0, 0.25, 0.75],
            Precision::F64,
        );
        let mut frame = ModelFrame::new(seq, Ok(set));
        frame.info.cell = cell.map(|cell| cell.parse().unwrap());
        frame
    };
    let sheared = [
        frame(0, Some("10,10,10")),
        frame(1, Some("10,0,0,2,10,0,0,0,10")),
    ];
    let found = again("npz", &sheared, &ReadOptions::default()).unwrap();
    let cells = found.iter().map(|frame| frame.info.cell);
    assert!(cells.eq(sheared.iter().map(|frame| frame.info.cell)));
    let lost = [frame(0, Some("10,10,10")), frame(1, None)];
    let error = again("npz", &lost, &ReadOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("frames with a periodic cell and others without one"),
        "{error}"
    );
}

#[test]
fn formats_say_which_curves_they_cannot_hold() {
    let fails = |extension: &str, set: CurveSet| {
        let frames = [ModelFrame::new(0, Ok(set))];
        again(extension, &frames, &ReadOptions::default())
            .unwrap_err()
            .to_string()
    };
    for (extension, format) in written() {
        let spline = set(Basis::BSpline, &[-6], &[0.0, 1.0, 0.5, 2.0], Precision::F32);
        let frames = [ModelFrame::new(0, Ok(spline.clone()))];
        let result = again(extension, &frames, &ReadOptions::default());
        assert_eq!(result.is_ok(), format.holds_splines(), "{extension}");
        if let Err(error) = result {
            let expected = "splines (closed B-spline), only polylines";
            assert!(error.to_string().contains(expected), "{error}");
        }
    }
    let short = |count| set(Basis::Polyline, &[5, count], &[0.5, 1.0], Precision::F64);
    let error = fails("obj", short(-1));
    assert!(
        error.contains("curve 1, a closed curve of one point"),
        "{error}"
    );
    for (extension, count) in [
        ("obj", -2),
        ("vect", -2),
        ("vect", -1),
        ("npz", -1),
        ("npz", -2),
    ] {
        let frames = [ModelFrame::new(0, Ok(short(count)))];
        let found = again(extension, &frames, &ReadOptions::default()).unwrap();
        assert_same(extension, &found, &frames);
    }
    // Nothing is written for a motion without frames.
    for (extension, _) in written() {
        let error = again(extension, &[], &ReadOptions::default())
            .unwrap_err()
            .to_string();
        assert!(error.contains("a file without"), "{error}");
    }
}
