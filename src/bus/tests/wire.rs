//! Layout of shared memory: frames that fit, and frames that are rejected.

use crate::bus::wire::*;
use crate::curve::{Cell, CurveLabels};

#[repr(align(64))]
struct Aligned([u8; 256]);

fn header(curves: u32, points: u64) -> FrameHeader {
    FrameHeader {
        magic: FRAME_MAGIC,
        version: LAYOUT_VERSION,
        flags: 0,
        session: 1,
        seq: 0,
        time: 0.0,
        n_points: points,
        n_curves: curves,
        basis: 0,
        coordinate_bytes: 4,
        ..FrameHeader::default()
    }
}

fn error(header: FrameHeader, payload: &[u8], max_bytes: usize) -> String {
    let view = header.view(payload, max_bytes).map(|(_, frame)| frame);
    view.unwrap_err().to_string()
}

#[test]
fn names_and_radii_are_transmitted() {
    let labels = CurveLabels::named(["a", "\u{e9}\u{e9}"]).with_radii([0.5, 0.0]);
    let (table, names_bytes) = table_of(&[-4, 4], &labels);
    assert_eq!((table.len(), names_bytes), (3 * 64, 7));
    let h = FrameHeader {
        flags: FLAG_RADII,
        names_bytes: names_bytes as u32,
        ..header(2, 8)
    };
    assert_eq!(h.labels(&table).unwrap(), labels);
    let (table, names_bytes) = table_of(&[-4, 4], &CurveLabels::default());
    assert_eq!((table.len(), names_bytes), (64, 0));
    assert!(header(2, 8).labels(&table).unwrap().is_empty());
}

#[test]
fn rejects_names_that_are_no_list_of_words() {
    let mut table = [0; 128];
    let mut fails = |names: &[u8]| {
        table[64..64 + names.len()].copy_from_slice(names);
        let h = FrameHeader {
            names_bytes: names.len() as u32,
            ..header(2, 8)
        };
        h.labels(&table).unwrap_err().to_string()
    };
    let place = "not a valid frame (names of the curves): ";
    assert_eq!(
        fails(b"a\0b"),
        format!("{place}the last name does not end with a zero byte")
    );
    assert_eq!(fails(b"a\0\xff\0"), format!("{place}not UTF-8"));
    assert_eq!(fails(b"a\0"), "names of curves: 2 promised, 1 available");
    assert!(fails(b"a\0\0").contains("name \"\""));
    assert!(fails(b"a\0a\0").contains("which is that of curve 0"));
}

#[test]
fn splits_a_frame_that_fits() {
    let bytes = Aligned([0; 256]);
    let (_, frame) = header(1, 4).view(&bytes.0[..112], 256).unwrap();
    assert_eq!((frame.counts.len(), frame.positions.len()), (1, 12));
}

#[test]
fn rejects_wrong_lengths_before_reading_the_payload() {
    let bytes = Aligned([0; 256]);
    let fails = |h: FrameHeader| error(h, &bytes.0[..112], 256);
    assert_eq!(
        fails(header(1, 5)),
        "bytes of a frame: 124 promised, 112 available"
    );
    assert_eq!(
        fails(header(17, 4)),
        "bytes of a frame: 176 promised, 112 available"
    );
    for points in [u64::MAX, u64::MAX / 12, u64::MAX / 12 + 1] {
        fails(header(1, points));
    }
    fails(header(u32::MAX, 4));
    let e = error(header(1, 4), &bytes.0[..112], 100);
    assert_eq!(
        e,
        "bytes of a frame (more than the limit): 112 promised, 100 available"
    );
    let shifted = error(header(1, 4), &bytes.0[1..113], 256);
    assert!(shifted.contains("not aligned"));
}

#[test]
fn rejects_codes_out_of_range_by_name() {
    let bytes = Aligned([0; 256]);
    let fails = |h: FrameHeader| error(h, &bytes.0[..112], 256);
    let with = |change: fn(&mut FrameHeader)| {
        let mut h = header(1, 4);
        change(&mut h);
        h
    };
    assert_eq!(
        fails(with(|h| h.basis = 4)),
        "not a valid frame (basis code): 4, expected 0 to 3"
    );
    assert_eq!(
        fails(with(|h| h.coordinate_bytes = 2)),
        "not a valid frame (bytes of a coordinate): 2, expected 4 or 8"
    );
    assert_eq!(
        fails(with(|h| h.time = f64::NAN)),
        "not a valid frame (time): NaN seconds"
    );
    for time_step in [-1.0, f64::NAN, f64::INFINITY] {
        let h = FrameHeader {
            time_step,
            ..header(1, 4)
        };
        assert!(fails(h).contains("(time step)"));
    }
    let e = with(|h| h.version = 9).check_layout().unwrap_err();
    assert_eq!(
        e.to_string(),
        "the frame has version 9; this build reads version 8"
    );
    assert!(with(|h| h.magic = 0).check_layout().is_err());
    let e = with(|h| h.session = 0).check_layout().unwrap_err();
    assert_eq!(
        e.to_string(),
        "not a valid frame (session): 0, expected a random number"
    );
}
#[test]
fn a_periodic_cell_is_transmitted() {
    let mut h = header(1, 4);
    assert_eq!(h.cell().unwrap(), None);
    for text in ["10,10,12", "0,3.5,0", "10,0,0,2,10,0,0,0,12,-5,1,0"] {
        let cell: Cell = text.parse().unwrap();
        h.set_cell(Some(&cell));
        assert_eq!(h.cell().unwrap(), Some(cell), "{text}");
    }
    h.set_cell(None);
    assert_eq!(h, header(1, 4));
}

#[test]
fn rejects_a_cell_that_is_no_lattice() {
    let bytes = Aligned([0; 256]);
    let fails = |change: fn(&mut FrameHeader)| {
        let mut h = header(1, 4);
        h.set_cell(Some(&"10,10,12".parse().unwrap()));
        change(&mut h);
        let e = error(h, &bytes.0[..112], 256);
        let e = e.strip_prefix("not a valid frame (periodic cell): ");
        e.expect("the place of the error").to_owned()
    };
    for vectors in [0, 2, 4, u32::MAX] {
        let mut h = header(1, 4);
        h.set_cell(Some(&"10,10,12".parse().unwrap()));
        h.cell_vectors = vectors;
        let e = error(h, &bytes.0[..112], 256);
        assert!(e.ends_with(&format!("{vectors} vectors, but 3 are not zero")));
    }
    assert!(fails(|h| h.cell[4] = 0.0).ends_with("3 vectors, but 2 are not zero"));
    assert!(fails(|h| h.cell[8] = f64::NAN).contains("not finite"));
    assert!(fails(|h| h.cell_origin[0] = f64::INFINITY).contains("not finite"));
    assert!(fails(|h| h.cell[0] = 1e-300).contains("1e-60 to 1e60"));
    assert!(fails(|h| h.cell[3..6].copy_from_slice(&[1.0, 0.0, 0.0])).contains("one plane"));
    let corner_alone = |h: &mut FrameHeader| {
        h.set_cell(None);
        h.cell_origin[1] = 1.0;
    };
    assert!(fails(corner_alone).contains("no vector"));
}
