//! Files that NumPy wrote (`tests/models/numpy/generate.py`), and files with errors made by hand.

use super::array::Array;
use super::write::{directory_entry, local_header};
use super::*;
use crate::Certifier;
use crate::curve::{CurveSet, Precision};
use crate::formats::frames::FrameSource;
use crate::formats::tests::{curves, read_npz};
use crate::formats::{Frames, ModelFrame};
use std::io::Write;
use std::path::{Path, PathBuf};

fn file(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/models/numpy");
    folder.join(name)
}

fn options(counts: Option<&[i32]>) -> ReadOptions {
    ReadOptions {
        counts: counts.map(<[i32]>::to_vec),
        ..ReadOptions::default()
    }
}

/// Reads the frames of a file of the folder.
fn frames(name: &str, counts: Option<&[i32]>) -> Result<Vec<ModelFrame>> {
    Frames::open(&file(name), &options(counts))?.collect()
}

fn certificate(set: &CurveSet) -> String {
    let mut certifier = Certifier::default();
    certifier.certify(set).0.to_string()
}

/// In the second frame the first ring has left the second one.
const CERTIFICATES: [&str; 2] = ["3 # lines: 1\n0,1,-1\n", "3 # lines: 0\n"];
const COUNTS: &[i32] = &[-8, -8, -8];

#[test]
fn all_files_that_numpy_writes_have_the_same_certificates() {
    for (name, counts, precision) in [
        ("rings.npy", None, Precision::F64),
        ("rings.npy", Some(COUNTS), Precision::F64),
        ("rings-f4.npy", None, Precision::F32),
        ("points.npy", Some(COUNTS), Precision::F64),
        ("points-big-endian.npy", Some(COUNTS), Precision::F64),
        ("one-frame.npy", Some(COUNTS), Precision::F64),
        ("stored.npz", None, Precision::F64),
        ("compressed.npz", None, Precision::F32),
    ] {
        let frames = frames(name, counts).unwrap();
        let expected = if name == "one-frame.npy" { 1 } else { 2 };
        assert_eq!(frames.len(), expected, "{name}");
        for (frame, certified) in frames.iter().zip(CERTIFICATES) {
            let set = frame.curves.as_ref().unwrap();
            assert_eq!(set.precision(), precision, "{name}");
            assert!(set.counts().eq([-8; 3]), "{name}");
            assert_eq!(certificate(set), certified, "{name}");
        }
    }
}

#[test]
fn an_archive_has_basis_times_numbers_names_and_radii() {
    let frames = frames("compressed.npz", None).unwrap();
    assert_eq!(
        frames.iter().map(|f| f.info.seq).collect::<Vec<_>>(),
        [10, 20]
    );
    assert_eq!(
        frames.iter().map(|f| f.info.time).collect::<Vec<_>>(),
        [0.0, 0.25]
    );
    for frame in frames {
        assert_eq!(frame.curves.unwrap().basis(), Basis::BSpline);
        let expected = CurveLabels::named(["a", "b", "ring ü"]).with_radii([0.1, 0.1, 0.2]);
        assert_eq!(*frame.info.labels, expected);
    }
}

#[test]
fn counts_of_the_option_replace_those_of_the_file() {
    let open = frames("stored.npz", Some(&[8, -16])).unwrap();
    let set = open[0].curves.as_ref().unwrap();
    assert_eq!(set.counts().collect::<Vec<_>>(), [8, -16]);
    let open = frames("rings.npy", Some(&[8, 8, 8])).unwrap();
    assert!(
        open[0]
            .curves
            .as_ref()
            .unwrap()
            .curves()
            .iter()
            .all(|c| !c.closed)
    );
}

#[test]
fn refuses_arrays_that_do_not_say_which_points_form_a_curve() {
    for (name, counts, expected) in [
        (
            "points.npy",
            None,
            "shape 2 x 24 x 3 do not say which points belong to one curve",
        ),
        ("points.npy", None, "option `counts`"),
        ("one-frame.npy", None, "shape 24 x 3 do not say"),
        (
            "points.npy",
            Some(&[-8, -8][..]),
            "2 x 24 x 3 does not fit 2 curves with 16 points",
        ),
        (
            "rings.npy",
            Some(&[-12, -12]),
            "2 x 3 x 8 x 3 does not fit 2 curves with 24 points",
        ),
        (
            "fortran.npy",
            Some(COUNTS),
            "Fortran order; store `np.ascontiguousarray(positions)`",
        ),
        (
            "objects.npy",
            Some(COUNTS),
            "pickled Python objects (type |O)",
        ),
        (
            "integers.npy",
            None,
            "positions of type <i4; convert them with `.astype(np.float64)`",
        ),
    ] {
        let error = frames(name, counts).unwrap_err().to_string();
        assert!(error.contains(expected), "{error:?} lacks {expected:?}");
        assert!(error.contains(name), "{error}");
    }
}

/// Returns an array of version 1 with this header.
fn array(header: &str, values: &[u8]) -> Vec<u8> {
    let len = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &len[..], header.as_bytes(), values].concat()
}

/// Reads the header and the first frame of an array.
fn first(bytes: &[u8], counts: Option<&[i32]>) -> Result<ModelFrame> {
    let mut source = read_npy(bytes.into(), &options(counts))?;
    Ok(source.next_frame()?.expect("a frame"))
}

#[test]
fn errors_of_headers_say_what_is_wrong() {
    let good = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 2, 3), }";
    let values = [0; 24];
    first(&array(good, &values), None).unwrap();
    // Other spellings of the same.
    let other = "{\"shape\":(1L,1L,2L,3L),'fortran_order':False , \"descr\" : \"<f4\"}\n";
    first(&array(other, &values), None).unwrap();
    for (from, to, expected) in [
        ("{", "", "expected the keys descr, fortran_order and shape"),
        (
            "'<f4'",
            "[('x', '<f4')]",
            "array positions: a structured array",
        ),
        (
            "'<f4'",
            "'<f2'",
            "1 x 1 x 2 x 3 values of type <f2 do not take the 24 bytes",
        ),
        ("'<f4'", "'<c8'", "array positions: type '<c8'"),
        ("'<f4'", "'f4'", "type 'f4'"),
        ("'<f4'", "<f4", "expected value at line 1 column 10"),
        ("False", "0", "expected a boolean"),
        ("False", "True", "Fortran order"),
        ("'shape'", "'size'", "unknown field `size`"),
        ("'shape'", "'descr'", "duplicate field `descr`"),
        (
            "'fortran_order': False,",
            "",
            "missing field `fortran_order`",
        ),
        ("(1, 1, 2, 3)", "(1, 1, -2, 3)", "integer `-2`"),
        ("(1, 1, 2, 3)", "(1, 1, 2", "expected `,` or `]`"),
        (
            "(1, 1, 2, 3)",
            "(1, 1, 3, 3)",
            "1 x 1 x 3 x 3 values of type <f4 do not take the 24",
        ),
        (
            "(1, 1, 2, 3)",
            "(18446744073709551615, 18446744073709551615, 9, 3)",
            "do not take",
        ),
        ("(1, 1, 2, 3)", "(99999999999999999999, 1)", "expected u64"),
        (
            "(1, 1, 2, 3)",
            "(6,)",
            "positions of shape 6; supported are",
        ),
        ("(1, 1, 2, 3)", "(2, 3)", "shape 2 x 3 do not say"),
        ("(1, 1, 2, 3)", "(3, 2)", "shape 3 x 2; supported are"),
        (
            "(1, 1, 2, 3)",
            "()",
            "1 (no dimensions) values of type <f4 do not take",
        ),
    ] {
        let header = good.replacen(from, to, 1);
        let error = first(&array(&header, &values), None)
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{error:?} lacks {expected:?}");
    }
    // Sizes without values must not count as frames or curves.
    for shape in [
        "(9999999999, 0, 8, 3)",
        "(0, 4000000000, 1, 3)",
        "(1, 4294967296, 0, 3)",
    ] {
        let header = good.replace("(1, 1, 2, 3)", shape);
        let error = first(&array(&header, &[]), None).unwrap_err().to_string();
        assert!(error.contains("array positions"), "{error}");
    }
    let mut newer = array(good, &values);
    newer[6] = 4;
    let error = first(&newer, None).unwrap_err().to_string();
    assert!(error.contains("version 4, expected 1, 2 or 3"), "{error}");
    newer[6] = 2;
    let error = first(&newer, None).unwrap_err().to_string();
    assert!(error.contains("expected at most 10000"), "{error}");
}

#[test]
fn a_frame_with_a_wrong_value_is_invalid_and_the_next_one_is_read() {
    let mut values = Vec::new();
    for x in [
        0.0,
        f64::NAN,
        0.0,
        0.0,
        0.0,
        0.0,
        1.0,
        2.0,
        3.0,
        4.0,
        5.0,
        6.0,
    ] {
        values.extend(x.to_be_bytes());
    }
    let header = "{'descr': '>f8', 'fortran_order': False, 'shape': (2, 2, 3), }";
    let bytes = array(header, &values);
    let mut source = read_npy((&bytes[..]).into(), &options(Some(&[2]))).unwrap();
    let frame = source.next_frame().unwrap().unwrap();
    let error = frame.curves.unwrap_err().to_string();
    assert_eq!(error, "curve 0, point 0: coordinate y is NaN");
    let frame = source.next_frame().unwrap().unwrap();
    let expected = vec![(false, vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])];
    assert_eq!(curves(&frame.curves.unwrap()), expected);
    assert!(source.next_frame().unwrap().is_none());
}

/// Reads an archive to its end.
fn read_all(bytes: &[u8]) -> Result<usize> {
    let mut source = read_npz(bytes, &options(None))?;
    let mut frames = 0;
    while let Some(frame) = source.next_frame()? {
        frame.curves?;
        frames += 1;
    }
    Ok(frames)
}

#[test]
fn a_damaged_archive_ends_with_an_error() {
    // A byte of the positions.
    for (name, at) in [("stored.npz", 300), ("compressed.npz", 150)] {
        let mut bytes = std::fs::read(file(name)).unwrap();
        assert_eq!(read_all(&bytes).unwrap(), 2);
        bytes[at] ^= 1;
        let error = read_all(&bytes).unwrap_err().to_string();
        let place = ["frame ", "array positions"]
            .iter()
            .any(|place| error.contains(place));
        assert!(place, "{name}: {error}");
    }
    let mut bad = std::fs::read(file("stored.npz")).unwrap();
    bad[1000] ^= 1;
    let error = read_all(&bad).unwrap_err().to_string();
    assert!(
        error.contains("frame 1): the file is damaged: Invalid checksum"),
        "{error}"
    );
}

/// Returns an archive of these entries and contents. Offsets are those of the contents.
fn archive(members: &[(Vec<u8>, Vec<u8>)]) -> Vec<u8> {
    let contents: Vec<u8> = members
        .iter()
        .flat_map(|(_, content)| content.clone())
        .collect();
    let entries: Vec<Vec<u8>> = members.iter().map(|(entry, _)| entry.clone()).collect();
    let mut bytes = contents.clone();
    write::directory(&mut bytes, &entries, contents.len() as u64).unwrap();
    bytes
}

/// Returns a stored member at the start of an archive.
fn stored(name: &str, values: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let (crc, size) = (crc32fast::hash(values), values.len() as u64);
    let content = [&local_header(name, crc, size), values].concat();
    (directory_entry(name, crc, size, 0), content)
}

#[test]
fn errors_of_archives_say_what_is_wrong() {
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 2, 3), }";
    let good = stored("positions", &array(header, &[0; 24]));
    assert_eq!(read_all(&archive(std::slice::from_ref(&good))).unwrap(), 1);
    let with = |at: usize, values: &[u8]| {
        let mut member = good.clone();
        member.0[at..at + values.len()].copy_from_slice(values);
        read_all(&archive(&[member])).unwrap_err().to_string()
    };
    let end = good.0.len();
    for (error, expected) in [
        (with(8, &[1]), "array 'positions': encrypted"),
        (with(10, &[12]), "compressed by another method than deflate"),
        (
            with(end - 24, &[1, 2]),
            "two sizes, although it is not compressed",
        ),
        (
            with(end - 8, &[9]),
            "array positions is not where its entry says",
        ),
        (
            with(end - 8, &[0xFF; 8]),
            "array positions is not where its entry says",
        ),
        (
            with(46, b"velocitie"),
            "no array `positions`; the file has: velocitie",
        ),
        (with(0, b"XX"), "entry 0 of its directory is not valid"),
        (with(28, &[0xFF]), "entry 0 of its directory is not valid"),
    ] {
        assert!(error.contains(expected), "{error:?} lacks {expected:?}");
    }
    let error = read_all(&archive(&[good.clone(), good.clone()]))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("array 'positions' is there twice"),
        "{error}"
    );
    let error = read_all(b"no archive").unwrap_err().to_string();
    assert!(error.contains("no end of a directory"), "{error}");
}

/// Returns an archive of frames of a closed curve of two points, and of another array.
fn with_array(frames: usize, name: &str, descr: &str, shape: &str, values: &[u8]) -> Vec<u8> {
    let header = |descr: &str, shape: &str| {
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}}}")
    };
    let shape_of_all = format!("({frames}, 1, 2, 3)");
    let positions = array(&header("<f4", &shape_of_all), &vec![0; 24 * frames]);
    let (entry, first) = stored("positions", &positions);
    let second = array(&header(descr, shape), values);
    let (crc, size) = (crc32fast::hash(&second), second.len() as u64);
    let local = local_header(name, crc, size);
    let at = first.len() as u64;
    let members = [
        (entry, first),
        (
            directory_entry(name, crc, size, at),
            [local, second].concat(),
        ),
    ];
    archive(&members)
}

#[test]
fn arrays_of_other_names_that_may_hold_points_are_counted() {
    let left_out = |name: &str, descr: &str, shape: &str, values: usize| {
        let bytes = with_array(2, name, descr, shape, &vec![0; values]);
        let mut source = read_npz(&bytes, &options(None));
        let frame = source.as_mut().unwrap().next_frame().unwrap().unwrap();
        assert!(frame.curves.is_ok());
        frame.info.left_out
    };
    for (name, shape) in [
        ("positions_b", "(2, 5, 3)"),
        ("a", "(10, 3)"),
        ("curve", "(2, 1, 5, 3)"),
    ] {
        let found = left_out(name, "<f8", shape, 240);
        let says = format!("1 array of an unknown name that may hold points ({name}, ");
        assert!(
            found.len() == 1 && found[0].to_string().starts_with(&says),
            "{found:?}"
        );
    }
    let found = left_out("curves", "|O", "(2,)", 0);
    assert!(
        found[0].to_string().contains("pickled Python objects"),
        "{found:?}"
    );
    for (name, descr, shape, values) in [
        ("velocities", "<f8", "(10, 3)", 240),
        ("energies", "<f8", "(30,)", 240),
        ("matrix", "<f8", "(5, 6)", 240),
        ("faces", "<i8", "(10, 3)", 240),
        ("corner", "<f8", "(1, 3)", 24),
        ("axis", "<f8", "(3,)", 24),
        ("fixed", "|b1", "(10, 3)", 30),
        ("dates", "<M8[ns]", "(10, 3)", 240),
    ] {
        assert_eq!(left_out(name, descr, shape, values), [], "{name}");
    }
    // Regression test: such cells were ignored without a message.
    for (name, descr, shape, values) in [
        ("Box", "<f8", "(3, 3)", 72),
        ("box", "<i8", "(3,)", 24),
        ("box_size", "<f4", "()", 4),
        ("lattice", "<f8", "(7, 3, 3)", 504),
        ("dimensions", "<f4", "(7, 6)", 168),
    ] {
        let found = left_out(name, descr, shape, values);
        let says = "1 array that may be a periodic cell, which is read from an array `cell`";
        assert!(found[0].to_string().starts_with(says), "{found:?}");
    }
    for (name, descr, shape, values) in [
        ("dimensions", "<i8", "()", 8),
        ("dimensions", "<i8", "(3,)", 24),
        ("cells", "<i8", "(40, 2)", 640),
        ("cells", "<i8", "(40, 3)", 960),
        ("box", "<U3", "()", 12),
        ("box", "|O", "()", 0),
    ] {
        assert_eq!(left_out(name, descr, shape, values), [], "{name} {descr}");
    }
}

#[test]
fn elements_that_the_writer_left_out_are_left_out() {
    let bytes = with_array(2, "left_out", "|S8", "(2,)", b"3 blobs\x002 meshes");
    let mut source = read_npz(&bytes, &options(None)).unwrap();
    let frame = source.next_frame().unwrap().unwrap();
    let expected = "2 kinds of elements that the archive leaves out (the first one: 3 blobs)";
    assert_eq!(frame.info.left_out[0].to_string(), expected);
}

#[test]
fn frames_have_the_cell_of_the_archive() {
    let cells = |frames: usize, shape: &str, numbers: &[f64]| {
        let values: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        let bytes = with_array(frames, "cell", "<f8", shape, &values);
        let mut source = read_npz(&bytes, &options(None))?;
        let mut found = Vec::new();
        while let Some(frame) = source.next_frame()? {
            frame.curves?;
            found.push(frame.info.cell.unwrap().to_string());
        }
        Ok::<_, Error>(found)
    };
    let vectors = [9.0, 0.0, 0.0, 2.0, 8.0, 0.0, 0.0, 0.0, 0.0];
    let corner = [&vectors[..], &[1.0, 2.0, 3.0]].concat();
    let (one, cornered) = ("9,0,0,2,8,0,0,0,0", "9,0,0,2,8,0,0,0,0,1,2,3");
    let twice = |numbers: &[f64]| [numbers, numbers].concat();
    assert_eq!(cells(2, "(3,)", &[9.0, 8.0, 0.0]).unwrap(), ["9,8,0"; 2]);
    assert_eq!(cells(3, "(3, 3)", &vectors).unwrap(), [one; 3]);
    assert_eq!(cells(4, "(4, 3)", &corner).unwrap(), [cornered; 4]);
    let edges = [9.0, 8.0, 7.0, 9.5, 8.0, 7.0];
    assert_eq!(cells(2, "(2, 3)", &edges).unwrap(), ["9,8,7", "9.5,8,7"]);
    assert_eq!(cells(2, "(2, 3, 3)", &twice(&vectors)).unwrap(), [one; 2]);
    assert_eq!(
        cells(2, "(2, 4, 3)", &twice(&corner)).unwrap(),
        [cornered; 2]
    );
    for (frames, shape, numbers, says) in [
        (
            1,
            "(2, 3)",
            &edges[..],
            "array cell): 2 values for 1 frames",
        ),
        (1, "(0, 3)", &[], "array cell): 0 values for 1 frames"),
        (
            3,
            "(3, 3)",
            &[9.0, 8.0, 7.0, 8.0, 9.0, 7.0, 7.0, 8.0, 9.0],
            "array cell): shape 3 x 3 with 3 frames: edges of each frame, or one cell",
        ),
        (
            1,
            "(6,)",
            &edges,
            "array cell): shape 6, expected 3 (edges along the axes)",
        ),
        (
            1,
            "()",
            &[9.0],
            "array cell): shape 1 (no dimensions), expected 3",
        ),
        (1, "(3, 2)", &edges, "array cell): shape 3 x 2, expected 3"),
        (
            1,
            "(1, 1, 2, 3)",
            &edges,
            "array cell): 1 x 1 x 2 x 3 values",
        ),
        (
            1,
            "(3,)",
            &[0.0; 3],
            "array cell): cell 0: cell 0,0,0: no vector",
        ),
        (
            2,
            "(2, 3)",
            &[1.0, 1.0, 1.0, f64::NAN, 1.0, 1.0],
            "array cell): value 3 is NaN",
        ),
        (1, "(3, 3)", &[1.0; 9], "one plane"),
    ] {
        let error = cells(frames, shape, numbers).unwrap_err().to_string();
        assert!(error.contains(says), "{error:?} lacks {says:?}");
    }
}

#[test]
fn a_curve_that_the_cell_of_an_archive_tears_is_refused_unless_it_is_unwrapped() {
    let positions = "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 1, 3, 3), }";
    let points = [[0.0_f64; 3], [8.0, 0.0, 0.0], [4.0, 1.0, 0.0]];
    let points: Vec<u8> = points
        .as_flattened()
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    for wrapped in [false, true] {
        let options = ReadOptions {
            wrapped: wrapped.then_some(true),
            ..options(None)
        };
        let bytes = array(positions, &points);
        let positions = Array::parse(&mut &bytes[..], bytes.len() as u64, "positions");
        let others = Others {
            cells: Some(Cells::One("9,0,0".parse().unwrap())),
            ..Others::default()
        };
        let mut source =
            ArrayFrames::new(&points[..], positions.unwrap(), others, &options, 999).unwrap();
        let frame = source.next_frame().unwrap().unwrap();
        assert_eq!(frame.info.cell.unwrap().to_string(), "9,0,0");
        match frame.curves {
            Ok(set) => assert!(wrapped && set.point(0, 1)[0] == 8.0),
            Err(e) => {
                let says = "curve 0 is 0.889 of the first lattice vector long";
                assert!(!wrapped && e.to_string().contains(says), "{e}");
            }
        }
    }
}

/// Regression test: `times=np.arange(n)` and `cell=[10, 10, 10]` were refused.
#[test]
fn times_radii_and_cells_may_be_integers() {
    let read = |name: &str, descr: &str, shape: &str, values: &[u8]| {
        let bytes = with_array(1, name, descr, shape, values);
        let mut source = read_npz(&bytes, &options(None))?;
        Ok::<_, Error>(source.next_frame()?.unwrap().info)
    };
    let i8 = |values: &[i64]| {
        values
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect::<Vec<_>>()
    };
    let most = 1 << 53;
    assert_eq!(
        read("times", "<i8", "(1,)", &i8(&[-most])).unwrap().time,
        -(most as f64)
    );
    assert_eq!(read("times", "|u1", "(1,)", &[0xFF]).unwrap().time, 255.0);
    assert_eq!(
        read("radii", "|i1", "(1,)", &[2]).unwrap().labels.radii,
        [2.0]
    );
    let cell = read("cell", "<i8", "(3,)", &i8(&[9, 8, 7])).unwrap().cell;
    assert_eq!(cell.unwrap().to_string(), "9,8,7");
    let error = read("times", "<i8", "(1,)", &i8(&[most + 1])).unwrap_err();
    let says = "array times): 9007199254740993 is out of range";
    assert!(error.to_string().contains(says), "{error}");
}

#[test]
fn small_arrays_of_wrong_types_and_lengths_are_refused() {
    let with = |name: &str, descr: &str, shape: &str, values: &[u8]| {
        read_all(&with_array(1, name, descr, shape, values)).map_err(|e| e.to_string())
    };
    assert_eq!(with("counts", "|i1", "(1,)", &[0xFE]), Ok(1));
    assert_eq!(with("basis", "|u1", "()", &[0]), Ok(1));
    assert_eq!(with("basis", ">U8", "()", &utf32("polyline")), Ok(1));
    for (name, descr, shape, values, expected) in [
        (
            "counts",
            "<i8",
            "(1,)",
            &[0xFF; 8][..],
            "1 curves with 1 points",
        ),
        (
            "counts",
            "<u8",
            "(1,)",
            &[0xFF; 8],
            "array counts): 18446744073709551615 is out of",
        ),
        (
            "counts",
            "<f4",
            "(1,)",
            &[0; 4],
            "array counts): type <f4, expected integers",
        ),
        (
            "counts",
            "<i4",
            "(1, 1)",
            &[0; 4],
            "array counts): 1 x 1 values",
        ),
        (
            "counts",
            "|S0",
            "(99999999999,)",
            &[],
            "array counts): 99999999999 values",
        ),
        (
            "basis",
            "|u1",
            "()",
            &[4],
            "array basis): [4], expected polyline",
        ),
        (
            "basis",
            "|S4",
            "()",
            b"cube",
            "array basis): 'cube', expected polyline",
        ),
        (
            "times",
            "<f8",
            "(2,)",
            &[0; 16],
            "array times): 2 values for 1 frames",
        ),
        (
            "times",
            "<f4",
            "(1,)",
            &[0, 0, 0xC0, 0x7F],
            "array times): value 0 is NaN",
        ),
        (
            "seq",
            "|u1",
            "(2,)",
            &[7, 7],
            "array seq): frame 7 after frame 7",
        ),
        (
            "cuts",
            "|u1",
            "(2,)",
            &[0, 1],
            "array cuts): 2 values for 1 frames",
        ),
        (
            "names",
            "|S1",
            "(2,)",
            b"ab",
            "names of curves: 1 promised, 2 available",
        ),
        (
            "names",
            "<U1",
            "(1,)",
            &[0xFF; 4],
            "array names): type <U1, expected texts",
        ),
        ("radii", "<f4", "(1,)", &[0, 0, 0x80, 0xBF], "radius -1"),
    ] {
        let error = with(name, descr, shape, values).unwrap_err();
        assert!(error.contains(expected), "{error:?} lacks {expected:?}");
    }
}

fn utf32(text: &str) -> Vec<u8> {
    text.chars()
        .flat_map(|c| u32::from(c).to_be_bytes())
        .collect()
}

#[test]
fn a_compressed_frame_of_little_more_than_zeros_is_refused_before_it_is_decompressed() {
    // A header that promises a frame of 4 GB, compressed to some hundred bytes.
    let points = 357_913_941_u64;
    let shape = format!("'shape': (1, 1, {points}, 3)");
    let header = format!("{{'descr': '<f4', 'fortran_order': False, {shape}}}");
    let header = array(&header, &[]);
    let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), Default::default());
    encoder.write_all(&header).unwrap();
    let compressed = encoder.finish().unwrap();
    let size = header.len() as u64 + 12 * points;
    let mut entry = directory_entry("positions", 0, size, 0);
    entry[10] = 8;
    let at = entry.len() - 16;
    entry[at..at + 8].copy_from_slice(&(compressed.len() as u64).to_le_bytes());
    let content = [local_header("positions", 0, 0), compressed].concat();
    let error = read_all(&archive(&[(entry, content)]))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("frames of 4294967292 bytes, which is more than 64 MiB"),
        "{error}"
    );
}

#[test]
fn writes_the_bytes_that_numpy_writes() {
    let folder = tempfile::tempdir().unwrap();
    for (name, counts) in [("rings.npy", COUNTS), ("points.npy", &[8, -8, -8])] {
        let path = folder.path().join(name);
        let mut writer =
            crate::formats::FrameWriter::create(&path, crate::formats::Format::of(&path).unwrap())
                .unwrap();
        for frame in frames(name, Some(counts)).unwrap() {
            writer.frame(&frame).unwrap();
        }
        writer.finish().unwrap();
        assert_eq!(
            std::fs::read(&path).unwrap(),
            std::fs::read(file(name)).unwrap(),
            "{name}"
        );
    }
}

#[test]
fn values_of_each_byte_order_become_little_endian() {
    let little = 1.5_f64.to_le_bytes();
    for (descr, bytes) in [
        ("<f8", little),
        (">f8", 1.5_f64.to_be_bytes()),
        ("=f8", little),
    ] {
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (1,)}}");
        let (whole, mut bytes) = (array(&header, &bytes), bytes);
        let array = Array::parse(&mut &whole[..], whole.len() as u64, "x").unwrap();
        array.to_little_endian(&mut bytes);
        assert_eq!((array.size, bytes), (8, little), "{descr}");
    }
}
