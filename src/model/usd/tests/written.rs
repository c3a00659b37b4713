//! Files that are written and read back.

use super::*;
use crate::model::{Format, FrameWriter};

/// Returns curves of a basis: closed, open, open, closed.
fn mixed(basis: Basis, shift: f32) -> CurveSet {
    let counts = [-12, 13, 7, -9];
    let xyz: Vec<f32> = (0..3 * 41)
        .map(|k| (k as f32 * 0.7).sin() * 1e3 + shift)
        .collect();
    CurveSet::from_counts(basis, &counts, Positions::F32(&xyz)).unwrap()
}

fn write(path: &Path, frames: &[ModelFrame]) {
    let mut writer = FrameWriter::create(path, Format::Usd).unwrap();
    for frame in frames {
        writer.frame(frame).unwrap();
    }
    writer.finish().unwrap();
}

fn frame(seq: u64, time: f64, labels: CurveLabels, curves: CurveSet) -> ModelFrame {
    let mut frame = ModelFrame::new(seq, Ok(curves));
    (frame.time, frame.labels) = (time, labels.into());
    frame
}

#[test]
fn written_frames_are_read_back_with_all_that_they_have() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usda");
    let names = CurveLabels::named(["sleeve/0", "with \"quotes\" \\ and [1]", "", "ä"]);
    let mut names = names;
    names.names[2] = "c".into();
    for basis in Basis::ALL {
        for labels in [CurveLabels::default(), names.clone()] {
            let radii = |k: u64| [0.1, 0.5, k as f32, 1e-30];
            let same = labels.clone().with_radii(radii(0));
            let single = [frame(0, 0.0, labels.clone(), mixed(basis, 0.0))];
            // The radii change in the fourth frame only.
            let motion = [3, 4, 7, 100, 101].map(|k| {
                let labels = match k < 100 {
                    true => same.clone(),
                    false => labels.clone().with_radii(radii(k)),
                };
                frame(k, 0.1 * k as f64 - 1.0, labels, mixed(basis, k as f32))
            });
            for written in [&single[..], &motion[..1], &motion] {
                write(&path, written);
                let read = frames(&path);
                assert_eq!(read.len(), written.len());
                for (found, expected) in read.iter().zip(written) {
                    assert_eq!((found.seq, found.time), (expected.seq, expected.time));
                    assert_eq!(found.labels, expected.labels);
                    let [found, expected] =
                        [found, expected].map(|frame| frame.curves.as_ref().unwrap());
                    assert_eq!(found.basis(), basis);
                    assert_eq!(found.precision(), Precision::F32);
                    assert_eq!(curves(found), curves(expected));
                }
            }
        }
    }
}

#[test]
fn every_single_precision_number_is_written_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usd");
    let mut xyz: Vec<f32> = vec![f32::MAX, f32::MIN_POSITIVE, -0.0, 1e-45, 1e16, 16_777_217.0];
    let bits = (0..3000_u32).map(|k| f32::from_bits(k.wrapping_mul(0x9e37_79b9)));
    xyz.extend(bits.filter(|x| x.is_finite()));
    xyz.truncate(xyz.len() / 3 * 3);
    let counts = [-(xyz.len() as i32 / 3)];
    let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap();
    write(&path, &[ModelFrame::new(0, Ok(set.clone()))]);
    let bits = |set: &CurveSet| {
        curves(set)[0]
            .1
            .concat()
            .iter()
            .map(|x| x.to_bits())
            .collect::<Vec<_>>()
    };
    assert_eq!(bits(&only(&path).0), bits(&set));
}

#[test]
fn the_writer_refuses_what_the_format_cannot_hold() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usda");
    let set = mixed(Basis::Polyline, 0.0);
    let labels = CurveLabels::default();
    let fails = |frames: &[ModelFrame]| {
        let mut writer = FrameWriter::create(&path, Format::Usd).unwrap();
        let mut results = frames.iter().map(|frame| writer.frame(frame));
        let e = results.find_map(Result::err).unwrap().to_string();
        assert!(e.contains("a.usda: "), "{e}");
        e
    };
    let first = || frame(1, 0.0, labels.clone(), set.clone());
    let doubles = CurveSet::from_counts(Basis::Polyline, &[2], Positions::F64(&[0.1; 6])).unwrap();
    let e = fails(&[ModelFrame::new(0, Ok(doubles))]);
    assert!(e.contains("single precision would round"), "{e}");
    let e = fails(&[first(), first()]);
    assert!(e.contains("frame 1 after frame 1"), "{e}");
    for (labels, curves) in [
        (CurveLabels::named(["a", "b", "c", "d"]), set.clone()),
        (CurveLabels::default().with_radii([1.0; 4]), set.clone()),
        (labels.clone(), mixed(Basis::CatmullRom, 0.0)),
    ] {
        let e = fails(&[first(), frame(2, 0.0, labels, curves)]);
        assert!(
            e.contains("frame 2 has other curves, names or radii"),
            "{e}"
        );
    }
    let e = fails(&[ModelFrame::new(u64::MAX, Ok(set.clone()))]);
    assert!(e.contains("time codes are exact up to 2^53"), "{e}");
    let mut writer = FrameWriter::create(&path, Format::Usd).unwrap();
    let e = writer
        .frame(&ModelFrame::new(0, Err(Error::Cancelled)))
        .unwrap_err();
    assert!(e.to_string().contains("cancelled"), "{e}");
    let binary = folder.path().join("a.usdc");
    let e = FrameWriter::create(&binary, Format::Usd)
        .err()
        .unwrap()
        .to_string();
    assert!(e.contains("write a text file (.usda)"), "{e}");
    assert!(!binary.exists());
}
