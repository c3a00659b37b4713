//! Files of all formats.

use super::format::EXTENSIONS;
use super::frames::Source;
use super::*;
use crate::curve::Precision;
use proptest::prelude::*;
use std::io::Cursor;
use std::path::PathBuf;

/// Returns all curves of a set: true if closed, and the points.
pub(super) fn curves(set: &CurveSet) -> Vec<(bool, Vec<Point>)> {
    let points = |i| (0..set.curve(i).points as usize).map(move |k| set.point(i, k));
    (0..set.len())
        .map(|i| (set.curve(i).closed, points(i).collect()))
        .collect()
}

/// Asserts that the message of an error contains `expected`.
pub(super) fn assert_error_contains(result: Result<CurveSet>, expected: &str) {
    let message = result.unwrap_err().to_string();
    assert!(message.contains(expected), "{message:?} lacks {expected:?}");
}

impl<'a> From<&'a [u8]> for Input<'a> {
    fn from(bytes: &'a [u8]) -> Self {
        let (len, name) = (bytes.len() as u64, "memory".into());
        let bytes = Box::new(bytes);
        Input { bytes, len, name }
    }
}

/// Reads the frames of a file in memory.
pub(super) fn frames_of(mut source: Source<'_>) -> Result<Vec<ModelFrame>> {
    std::iter::from_fn(|| source.next_frame().transpose()).collect()
}

/// Reads the arrays of an `.npz` file in memory.
pub(super) fn read_npz<'a>(bytes: &'a [u8], options: &ReadOptions) -> Result<Source<'a>> {
    numpy::read_npz(Cursor::new(bytes), bytes.len() as u64, options)
}

/// Reads the frames of a file in memory, up to the first one that is invalid.
fn parse(format: Format, bytes: &[u8]) -> Result<Vec<CurveSet>> {
    let input = Input::from(bytes);
    let counts = Some(vec![-3, 2]);
    let npy = ReadOptions {
        counts,
        ..ReadOptions::default()
    };
    let npz = ReadOptions::default();
    let text = ReadOptions {
        closed: Some(true),
        ..ReadOptions::default()
    };
    let mut frames = match format {
        Format::Bcc => return Ok(vec![bcc::read(bytes, input.len)?]),
        Format::Obj => obj::read(input)?,
        Format::Vect => return Ok(vec![vect::read(input)?]),
        Format::LammpsData => lammps::read_data(input, &npz)?,
        Format::LammpsDump => lammps::read_dump(bytes, &[[4, 2], [2, 9], [9, 4]], false)?,
        Format::Npy => numpy::read_npy(input, &npy)?,
        Format::Npz => read_npz(bytes, &npz)?,
        Format::Xyz => xyz::read(input, &npz)?,
        Format::Points => points::read(input, &text)?,
        Format::Mcap | Format::External => unreachable!("their tests are elsewhere"),
    };
    let mut curves = Vec::new();
    while let Some(frame) = frames.next_frame()? {
        curves.push(frame.curves?);
    }
    Ok(curves)
}

/// Returns a small valid file of each format.
fn samples() -> Vec<(Format, Vec<u8>)> {
    let mut bcc = b"BCC\x44C0\x03\x01".to_vec();
    bcc.extend(2u64.to_le_bytes());
    bcc.extend(7u64.to_le_bytes());
    bcc.extend([0; 40]);
    for (count, n) in [(-3i32, 3), (4, 4)] {
        bcc.extend(count.to_le_bytes());
        (0..3 * n).for_each(|k| bcc.extend((k as f32 * 0.37).to_le_bytes()));
    }
    let obj = "# comment\nv 0 0 0\nv 1 0.5 0\nv 1e1 1 0\nv 0 1 -2 1\n\
               l 1 2 \\\n 3 1\nl 3 4\nl -1/2 1\n";
    let vect = "VECT # comment\n2 5 1\n-3 2\n1 0\n0 0 0\n1 0.5 0\n1e1 1 0\n0 1 -2\n3 3 3\n\
                1 0 0 1\n";
    let data = "Title\n\n5 atoms # all\n4 bonds\n2 atom types\n\n0 9 xlo xhi\n0 9 ylo yhi\n\
                0 9 zlo zhi\n1 0 0 xy xz yz\n\nMasses\n\n1 1\n2 1\n\nAtoms # bond\n\n\
                3 1 1 0 0 8 0 0 -1\n1 1 1 1 0.5 0 0 0 0\n2 1 2 1e0 1 0 0 0 0\n\
                7 2 1 0 1 -2 0 0 0\n5 2 1 3 3 0 0 0 0\n\nBonds\n\n1 1 1 2\n2 1 2 3\n\
                3 1 3 1\n4 1 5 7\n";
    let dump = "ITEM: UNITS\nlj\nITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n3\n\
                ITEM: BOX BOUNDS pp pp ff\n0 9\n0 9\n0 9\nITEM: ATOMS id x y z ix iy iz\n\
                2 0 0 8 0 0 0\n9 1 0.5 0 0 0 0\n4 8 0 0 -1 0 0\nITEM: TIMESTEP\n7\n\
                ITEM: NUMBER OF ATOMS\n4\nITEM: BOX BOUNDS xy xz yz pp pp pp\n0 9 1\n\
                0 9 0\n0 9 0\nITEM: ATOMS type xs ys zs id\n1 0 0 0 4\n1 .1 0 .1 9\n\
                1 0 .1 .1 2\n1 0 0 0 6\n";
    let xyz = "3\nLattice=\"9 0 0 1 9 0 0 0 9\" Origin='0 0 1' pbc=\"T T F\" Time=0.5 \
               Properties=species:S:1:pos:R:3:id:I:1:molecule:I:1:closed:L:1 Timestep=4\n\
               C 0 0 0 3 2 F\nC 1 0.5 0 1 7 T\nH 1e0 1 0 2 2 F\n\n4\n\
               properties=mol:I:1:pos:R:3 key timestep=7\n-1 0 0 1\n2 0 0 1\n-1 1 0 1\n\
               -1 1 1 1\n";
    let mut samples: Vec<(Format, Vec<u8>)> = vec![
        (Format::Bcc, bcc),
        (Format::Obj, obj.into()),
        (Format::Vect, vect.into()),
        (Format::LammpsData, data.into()),
        (Format::LammpsDump, dump.into()),
        (
            Format::Npy,
            include_bytes!("../../tests/models/numpy/small.npy").into(),
        ),
        (
            Format::Npz,
            include_bytes!("../../tests/models/numpy/small.npz").into(),
        ),
        (
            Format::Npz,
            include_bytes!("../../tests/models/numpy/small-compressed.npz").into(),
        ),
    ];
    samples.insert(4, (Format::Xyz, xyz.into()));
    let points = "x, y, z\n0, 0, 0\n1, .5, 0\n1e1, 1, 0\n\nComponent 2:\n0 1 -2\n3 4 5\n";
    samples.insert(4, (Format::Points, points.into()));
    let counted = "# frames\n3\n0 0 0\n1 .5 0\n1e1 1 0\n3\n0 1 -2\n3 4 5\n7 7 7\n";
    samples.insert(4, (Format::Points, counted.into()));
    samples
}

/// Formats whose files cannot end early.
const BINARY: [Format; 3] = [Format::Bcc, Format::Npy, Format::Npz];

#[test]
fn the_error_of_a_folder_shows_how_to_name_its_models() {
    let folder = tempfile::tempdir().unwrap();
    let error = |path: &Path| read(path).unwrap_err().to_string();
    let path = folder.path();
    let empty = format!(
        "{}: not a regular file but a folder; it holds no models",
        path.display()
    );
    assert!(error(path).starts_with(&empty), "{}", error(path));
    for name in ["b.bcc", "notes.txt"] {
        std::fs::write(path.join(name), "").unwrap();
    }
    let advice = format!("for the models in it, give {}/*.bcc", path.display());
    assert!(error(path).ends_with(&advice), "{}", error(path));
    // A folder may have the name of a model.
    let inner = path.join("frames.bcc");
    std::fs::create_dir(&inner).unwrap();
    assert!(error(&inner).contains("a folder"), "{}", error(&inner));
}

#[test]
fn no_panic_on_files_truncated_anywhere() {
    for (format, bytes) in samples() {
        let frames = parse(format, &bytes).unwrap();
        assert!(!frames.is_empty());
        for n in 0..bytes.len() {
            let result = parse(format, &bytes[..n]);
            // Text may still be valid: a last digit or newline may be missing.
            assert!(
                !BINARY.contains(&format) || result.is_err(),
                "{format:?}: {n} bytes"
            );
            if let Ok(sets) = result {
                assert!(sets.len() <= frames.len());
                assert!(sets.iter().all(|set| set.points() <= 8));
            }
        }
    }
}

#[test]
fn no_panic_on_one_wrong_byte_anywhere() {
    for (format, bytes) in samples() {
        for at in 0..bytes.len() {
            for value in 0..=255 {
                let mut bytes = bytes.clone();
                bytes[at] = value;
                for set in parse(format, &bytes).into_iter().flatten() {
                    assert!(set.points() <= 8, "{format:?}: byte {at} = {value}");
                    assert!(set.max_abs().is_finite());
                }
            }
        }
    }
}

proptest! {
    #[test]
    fn no_panic_on_garbage(
        k in 0..11usize,
        keep in 0..800usize,
        tail in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        let (format, mut bytes) = samples().swap_remove(k);
        bytes.truncate(keep);
        bytes.extend(tail);
        for set in parse(format, &bytes).into_iter().flatten() {
            prop_assert!(set.points() <= bytes.len());
        }
    }

    #[test]
    fn no_panic_on_garbage_of_likely_characters(
        k in 1..8usize,
        keep in 0..500usize,
        tail in "[-0-9lv./# \n\\\\eEItemsT:+]{0,200}",
    ) {
        let (format, mut bytes) = samples().swap_remove(k);
        bytes.truncate(keep);
        bytes.extend(tail.into_bytes());
        for set in parse(format, &bytes).into_iter().flatten() {
            prop_assert!(set.points() <= bytes.len());
        }
    }
}

#[test]
fn the_extension_selects_the_format_and_errors_name_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let names = ["a.BCC", "b.Obj", "c.vect", "d.lmp"];
    let npz = samples().pop().map(|sample| (sample, "e.npz"));
    for ((_, bytes), name) in samples().into_iter().zip(names).chain(npz) {
        let path = dir.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(read(&path).unwrap().len(), 2);
        std::fs::write(&path, &bytes[..7]).unwrap();
        let e = read(&path).unwrap_err();
        assert!(matches!(e, Error::InFile { .. }));
        let start = format!("{}: not a valid ", path.display());
        assert!(e.to_string().starts_with(&start), "{e}");
    }
    for name in [
        "a", "a.txt", ".bcc", "bcc", "a.bcc.gz", "data.", "xdata.a", "dump",
    ] {
        let e = read(&dir.path().join(name)).unwrap_err();
        assert!(matches!(e, Error::UnknownModel { .. }), "{e}");
    }
    let missing = dir.path().join("missing.obj");
    let e = read(&missing).unwrap_err();
    assert!(matches!(&e, Error::File { path, .. } if *path == missing));
    let folder = dir.path().join("folder.vect");
    std::fs::create_dir(&folder).unwrap();
    assert_error_contains(read(&folder), "folder.vect: not a regular file");
}

#[test]
fn names_of_lammps_files_may_be_those_of_other_files() {
    let folder = tempfile::tempdir().unwrap();
    let points = "1 0 0\n2 0 0\n0 1 0\n";
    for (name, text, expected) in [
        ("data.csv", points, Format::Points),
        (
            "data.txt",
            "x,y,z\n1,0,0\n2,0,zero\n3,0,0\n",
            Format::Points,
        ),
        ("dump.dat", points, Format::Points),
        ("data.melt", "", Format::LammpsData),
        ("dump.lammps", "ITEM: TIMESTEP\n0\n", Format::LammpsDump),
        ("melt.dump", "\n12 atoms\n", Format::LammpsData),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        assert_eq!(Format::of(&path).unwrap(), expected, "{name}");
    }
}

#[test]
fn text_in_utf_16_is_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let text = "1 0 0\n2 0 0\n".encode_utf16().flat_map(u16::to_le_bytes);
    let bytes: Vec<u8> = [0xFF, 0xFE].into_iter().chain(text).collect();
    for name in ["a.txt", "a", "a.obj", "data.csv", "a.xyz"] {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        assert_error_contains(read(&path), "the file is in UTF-16: save it as UTF-8");
    }
}

#[test]
fn errors_name_the_formats_that_are_written() {
    for (name, expected) in [
        (
            "a.xyz",
            "a.xyz: unsupported output: written are .bcc, .npz and .mcap, ",
        ),
        (
            "a.mcap",
            "a.mcap: unsupported output: MCAP is written by `linkwatch convert`",
        ),
        ("a", "a: unsupported output: written are"),
    ] {
        let error = Format::to_write(Path::new(name)).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{error}");
    }
    assert_eq!(Format::to_write(Path::new("A.NPZ")).unwrap(), Format::Npz);
}

#[test]
fn messages_list_the_extensions_of_all_formats() {
    let listed: Vec<&str> = MODEL_FILES.split(", ").collect();
    let known = EXTENSIONS.map(|(extension, _)| format!(".{extension}"));
    assert_eq!(listed, known);
    for (extension, format) in EXTENSIONS {
        let path = PathBuf::from(format!("frames/a.{}", extension.to_uppercase()));
        assert_eq!(Format::named(&path), Some(format));
    }
}

#[test]
fn quoted_parts_of_a_file_are_short_and_escaped() {
    assert_eq!(quote(b"a\x1b[2Jb\n"), "'a\\u{1b}[2Jb\\n'");
    assert_eq!(quote(&[b'1'; 1000]).len(), 42);
    assert_eq!(quote(b"\xff"), "'\u{fffd}'");
}

/// Reads a model that is not part of the project, if it is present on this machine.
fn published(name: &str) -> Option<CurveSet> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../shared/models")
        .join(name);
    if !path.exists() {
        eprintln!("skipped: no {name} here");
        return None;
    }
    Some(read(&path).unwrap())
}

#[test]
fn published_models_have_their_sizes() {
    use Basis::{BSpline, CatmullRom, Polyline};
    for (name, basis, loops, points) in [
        ("glove.bcc", CatmullRom, 70, 58_537),
        ("knittubeinit.bcc", BSpline, 39, 18_228),
        ("knittubebroken.bcc", BSpline, 39, 18_228),
        ("houdiniobj.obj", Polyline, 2, 9_600),
        ("2.2.1.vect", Polyline, 2, 72),
        ("3.1.vect", Polyline, 1, 47),
        ("4.1.vect", Polyline, 1, 69),
        ("4.2.1.vect", Polyline, 2, 81),
        ("5.2.1.vect", Polyline, 2, 77),
        ("6.3.2.vect", Polyline, 3, 105),
        ("9.2.40.vect", Polyline, 2, 114),
    ] {
        let Some(set) = published(name) else { continue };
        assert_eq!(
            (set.basis(), set.len(), set.points()),
            (basis, loops, points)
        );
        assert_eq!(set.segments(), points, "{name}");
        assert!(set.curves().iter().all(|c| c.closed), "{name}");
        assert_eq!(
            (0..loops).map(|i| set.repeated_vertices(i)).sum::<usize>(),
            0
        );
    }
}

#[test]
fn published_models_keep_their_points() {
    if let Some(set) = published("houdiniobj.obj") {
        let counts: Vec<i32> = set.counts().collect();
        assert_eq!(counts, [-4800, -4800]);
        assert_eq!(set.precision(), Precision::F64);
        // The first line starts with 1, 4800, 4799.
        assert_eq!(set.point(0, 0), [0.5, 0.0, 0.0]);
        assert_eq!(
            set.point(0, 4799),
            [0.499890327, 0.0104712006, -1.37067773e-05]
        );
    }
    if let Some(set) = published("2.2.1.vect") {
        assert_eq!(set.counts().collect::<Vec<_>>(), [-36, -36]);
        assert_eq!(set.point(0, 0), [-6.29882, 6.86615, -1.59307]);
        assert_eq!(set.point(1, 35), [0.979481, 3.05294, -2.69246]);
    }
    if let Some(set) = published("glove.bcc") {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("again.bcc");
        write_bcc(&path, &set).unwrap();
        assert_eq!(curves(&read(&path).unwrap()), curves(&set));
    }
}
