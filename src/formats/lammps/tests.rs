//! Files that LAMMPS wrote (`tests/models/lammps/generate.py`), and bonds and boxes made by hand.

use super::*;
use crate::Certifier;
use crate::LeftOut;
use crate::curve::CurveSet;
use crate::curve::vector::per_axis;
use crate::formats::tests::{assert_error_contains, curves, frames_of};
use crate::formats::{Format, Frames, ModelFrame, read};
use proptest::prelude::*;

/// Linking numbers of the rings: the middle one is linked with both others. A separate computation
/// of the Gauss integrals in Python gives the same numbers.
const CERTIFICATE: &str = "3 # lines: 2\n0,1,-1\n1,2,1\n";

fn file(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/models/lammps");
    folder.join(name)
}

fn certificate(set: &CurveSet) -> String {
    let mut certifier = Certifier::default();
    certifier.certify(set).0.to_string()
}

/// Returns the frames of a file of the folder.
fn frames(name: &str, bonds: Option<&str>) -> Vec<Result<ModelFrame>> {
    let options = ReadOptions {
        bonds: bonds.map(file),
        ..ReadOptions::default()
    };
    Frames::open(&file(name), &options).unwrap().collect()
}

#[test]
fn all_files_that_lammps_writes_have_the_same_certificate() {
    for name in ["rings.data", "triclinic.data"] {
        let set = read(&file(name)).unwrap();
        assert_eq!(set.counts().collect::<Vec<_>>(), [-14; 3]);
        assert_eq!(certificate(&set), CERTIFICATE, "{name}");
    }
    for (name, bonds) in [
        ("flags.dump", "rings.data"),
        ("unwrapped.dump", "rings.data"),
        ("scaled.dump", "rings.data"),
        ("scaled-unwrapped.lammpstrj", "rings.data"),
        ("triclinic.dump", "triclinic.data"),
        ("triclinic-scaled.dump", "triclinic.data"),
        ("triclinic-unwrapped.dump", "triclinic.data"),
    ] {
        let frames = frames(name, Some(bonds));
        for (frame, seq) in frames.iter().zip([0, 250, 500]) {
            let frame = frame.as_ref().unwrap();
            assert_eq!(frame.info.seq, seq);
            let set = frame.curves.as_ref().unwrap();
            assert_eq!(certificate(set), CERTIFICATE, "{name}");
        }
        assert_eq!(frames.len(), 3, "{name}");
    }
}

#[test]
fn all_dumps_of_a_run_have_the_same_points() {
    let points = |name, bonds| -> Vec<[f64; 3]> {
        let frames = frames(name, Some(bonds)).into_iter();
        let sets = frames.map(|frame| frame.unwrap().curves.unwrap());
        sets.flat_map(|set| curves(&set).into_iter().flat_map(|(_, points)| points))
            .collect()
    };
    let near = |a: &[[f64; 3]], b: &[[f64; 3]]| {
        assert_eq!(a.len(), b.len());
        // Six digits of coordinates up to 12.
        (a.as_flattened().iter())
            .zip(b.as_flattened())
            .all(|(x, y)| (x - y).abs() < 1e-3)
    };
    let expected = points("unwrapped.dump", "rings.data");
    for name in ["flags.dump", "scaled.dump", "scaled-unwrapped.lammpstrj"] {
        assert!(near(&points(name, "rings.data"), &expected), "{name}");
    }
    let expected = points("triclinic-unwrapped.dump", "triclinic.data");
    for name in ["triclinic.dump", "triclinic-scaled.dump"] {
        assert!(near(&points(name, "triclinic.data"), &expected), "{name}");
    }
    for (data, dump) in [
        ("rings.data", "unwrapped.dump"),
        ("triclinic.data", "triclinic.dump"),
    ] {
        let last = frames(dump, Some(data))
            .pop()
            .unwrap()
            .unwrap()
            .curves
            .unwrap();
        let (a, b) = (curves(&read(&file(data)).unwrap()), curves(&last));
        for ((_, a), (_, b)) in a.iter().zip(&b) {
            assert!(near(a, b), "{data}");
        }
    }
}

#[test]
fn a_dump_has_the_time_that_lammps_wrote() {
    let times = frames("flags.dump", Some("rings.data")).into_iter();
    let times: Vec<f64> = times.map(|frame| frame.unwrap().info.time).collect();
    assert_eq!(times, [0.0, 1.0, 2.0]);
}

#[test]
fn wrapped_rings_are_refused_with_advice() {
    let frames = frames("wrapped.dump", Some("rings.data"));
    assert_eq!(frames.len(), 3);
    for frame in frames {
        let error = frame.unwrap().curves.unwrap_err().to_string();
        assert!(error.contains("more than half"), "{error}");
        assert!(error.contains("custom .. id xu yu zu"), "{error}");
        assert!(error.contains("ix iy iz"), "{error}");
        assert!(error.contains("pass the option `wrapped`"), "{error}");
    }
}

#[test]
fn wrapped_rings_are_given_as_they_are_to_a_caller_that_unwraps_them() {
    let options = ReadOptions {
        bonds: Some(file("rings.data")),
        wrapped: Some(true),
        ..ReadOptions::default()
    };
    let read = |name| -> Vec<ModelFrame> {
        let frames = Frames::open(&file(name), &options).unwrap();
        frames.map(|frame| frame.unwrap()).collect()
    };
    let (wrapped, whole) = (read("wrapped.dump"), read("unwrapped.dump"));
    for (wrapped, whole) in wrapped.iter().zip(&whole) {
        assert_eq!(wrapped.info.cell, whole.info.cell);
        let cell = wrapped.info.cell.unwrap();
        assert_eq!(cell.to_string(), "12,12,12");
        let [a, b] = [wrapped, whole].map(|frame| frame.curves.as_ref().unwrap());
        let mut moved = 0;
        for (i, k) in (0..3).flat_map(|i| (0..14).map(move |k| (i, k))) {
            for x in 0..3 {
                let boxes = (b.point(i, k)[x] - a.point(i, k)[x]) / 12.0;
                assert!((boxes - boxes.round()).abs() < 1e-4);
                // LAMMPS wraps atoms only when it builds its neighbour lists.
                assert!((-0.5..=12.5).contains(&a.point(i, k)[x]));
                moved += usize::from(boxes.round() != 0.0);
            }
        }
        assert!(moved > 10);
    }
}

#[test]
fn frames_have_the_cell_of_their_box() {
    let cell = |name, bonds| {
        let frame = frames(name, Some(bonds)).remove(0).unwrap();
        frame.info.cell.unwrap()
    };
    let tilted = cell("triclinic.dump", "triclinic.data");
    let expected = [[12.0, 0.0, 0.0], [2.5, 12.0, 0.0], [-1.5, 3.0, 12.0]];
    let numbers = tilted.vectors.as_flattened().iter();
    for (found, expected) in numbers.zip(expected.as_flattened()) {
        assert!((found - expected).abs() < 1e-12, "{tilted}");
    }
    let options = ReadOptions::default();
    let data = Frames::open(&file("triclinic.data"), &options)
        .unwrap()
        .next();
    assert_eq!(data.unwrap().unwrap().info.cell.unwrap().vectors, expected);
    // Only along periodic directions, and with the corner of the box.
    let bounds = "BOUNDS pp pp ff\n0 9\n0 9\n0 9";
    for (kind, expected) in [
        (bounds, Some("9,9,0")),
        ("BOUNDS ff pp fs\n0 9\n0 9\n0 9", Some("0,9,0")),
        ("BOUNDS ff ss mm\n0 9\n0 9\n0 9", None),
        ("BOUNDS\n0 9\n0 9\n0 9", Some("9,9,9")),
        (
            "BOUNDS pp pp ff\n-1 9\n0 9\n2 9",
            Some("10,0,0,0,9,0,0,0,0,-1,0,2"),
        ),
        (
            "BOUNDS xy xz yz pp pp ff\n0 10 1\n0 9 0\n0 9 0",
            Some("9,0,0,1,9,0,0,0,0"),
        ),
        (
            "BOUNDS xy xz yz pp pp pp\n-2 9 -2\n0 9 0\n0 9 0",
            Some("9,0,0,-2,9,0,0,0,9"),
        ),
    ] {
        let text = DUMP
            .replacen(bounds, kind, 1)
            .replacen("2 2 0 9", "2 2 0 1", 1);
        let frame = dump(&text).unwrap().remove(0);
        assert_eq!(
            frame.info.cell.map(|cell| cell.to_string()).as_deref(),
            expected
        );
        assert!(frame.curves.is_ok());
    }
}

#[test]
fn a_data_file_is_periodic_unless_its_title_says_otherwise() {
    let text = bonded(3, &[[1, 2], [2, 3], [3, 1]]);
    let cell = |title: &str| {
        let text = format!("{title}{}", &text[text.find('\n').unwrap()..]);
        data_frame(&text, false)
            .unwrap()
            .info
            .cell
            .map(|cell| cell.to_string())
    };
    let all = cell("title").unwrap();
    let edges: Vec<&str> = all.split(',').collect();
    assert_eq!(edges.len(), 3, "{all}");
    assert_eq!(cell("t, boundary p p p").unwrap(), all);
    let slab = format!("{},{},0", edges[0], edges[1]);
    assert_eq!(cell("t, boundary p p f").unwrap(), slab);
    assert_eq!(cell("boundary f s m"), None);
    for title in [
        "boundary p p f, units lj",
        "slab (boundary p p f)",
        "boundary: p p f",
    ] {
        assert_eq!(cell(title).unwrap(), slab, "{title}");
    }
    // Regression test: such boundaries were not read as periodic.
    for title in [
        "melt, periodic boundary conditions in LJ units",
        "boundary set by hand",
        "boundary",
    ] {
        assert_eq!(cell(title).unwrap(), all, "{title}");
    }
}

#[test]
fn a_frame_without_an_atom_is_invalid_and_the_next_one_is_read() {
    let frames: Vec<_> = frames("lost.dump", Some("rings.data"))
        .into_iter()
        .map(|frame| frame.unwrap())
        .collect();
    let valid: Vec<bool> = frames.iter().map(|f| f.curves.is_ok()).collect();
    assert_eq!(valid, [true, false, true]);
    let error = frames[1].curves.as_ref().unwrap_err().to_string();
    assert!(
        error.contains("1 of the 42 atoms on curves are missing, atom "),
        "{error}"
    );
}

#[test]
fn the_bonds_of_a_dump_come_from_the_option_or_the_file_beside_it() {
    let beside = frames("triclinic.dump", None);
    assert_eq!(beside.len(), 3);
    let error = read(&file("unwrapped.dump")).unwrap_err().to_string();
    assert!(
        error.contains("unwrapped.dump: unsupported LAMMPS dump: a dump has no bonds"),
        "{error}"
    );
    assert!(error.contains("option `bonds`"), "{error}");
    let folder = tempfile::tempdir().unwrap();
    let dump = folder.path().join("dump.melt");
    assert_eq!(super::beside(&dump), None);
    for (dump, data) in [
        ("melt.lammpstrj", "melt.lammps"),
        ("melt.dump", "melt.data"),
        ("dump.melt", "data.melt"),
        ("dump.0.melt", "data.0.melt"),
    ] {
        let (data, dump) = (folder.path().join(data), folder.path().join(dump));
        std::fs::write(&data, "a script\nunits lj\natom_style bond\n").unwrap();
        assert_eq!(super::beside(&dump), None);
        std::fs::write(&data, "a title\n\n3 atoms\n").unwrap();
        assert_eq!(super::beside(&dump), Some(data.clone()));
        std::fs::remove_file(data).unwrap();
    }
}

#[test]
fn a_dump_of_any_name_is_known_by_its_start() {
    let folder = tempfile::tempdir().unwrap();
    for (start, name) in [("scaled.dump", "run.txt"), ("unwrapped.dump", "run")] {
        let path = folder.path().join(name);
        std::fs::copy(file(start), &path).unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains("unsupported LAMMPS dump"), "{error}");
    }
}

#[test]
fn compressed_files_are_refused_with_the_tool_that_decompresses() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dump.melt.gz");
    std::fs::write(&path, b"\x1f\x8b\x08rest").unwrap();
    assert_error_contains(
        read(&path),
        "dump.melt.gz: unsupported LAMMPS dump: compressed",
    );
    assert_error_contains(read(&path), "`gunzip`");
}

fn data(text: &str) -> Result<CurveSet> {
    data_frame(text, false)?.curves
}

fn data_frame(text: &str, wrapped: bool) -> Result<ModelFrame> {
    let options = ReadOptions {
        wrapped: wrapped.then_some(true),
        ..ReadOptions::default()
    };
    let mut source = read_data(text.as_bytes().into(), &options)?;
    Ok(source.next_frame()?.expect("a frame"))
}

/// Returns a data file of `bonds` between the atoms 1 to `atoms` at `(id, 0, 0)`.
fn bonded(atoms: usize, bonds: &[[u64; 2]]) -> String {
    let mut text = format!(
        "title\n{atoms} atoms\n{} bonds\n1 atom types\n",
        bonds.len()
    );
    text += "0 99 xlo xhi\n0 99 ylo yhi\n0 99 zlo zhi\n\nAtoms\n\n";
    (1..=atoms).for_each(|id| text += &format!("{id} 1 1 {id} 0 0\n"));
    text += "\nBonds\n\n";
    for [a, b] in bonds {
        text += &format!("1 1 {a} {b}\n");
    }
    text
}

/// Returns the curves of a set of [`bonded`]: true if closed, and the ids of the atoms.
fn ids(set: &CurveSet) -> Vec<(bool, Vec<u64>)> {
    let id = |point: [f64; 3]| point[0] as u64;
    let curves = curves(set).into_iter();
    curves
        .map(|(closed, points)| (closed, points.into_iter().map(id).collect()))
        .collect()
}

#[test]
fn rings_start_with_their_smallest_atom_and_chains_at_their_smaller_end() {
    let bonds = [
        [5, 9],
        [3, 9],
        [5, 3],
        [8, 2],
        [2, 6],
        [6, 4],
        [1, 7],
        [7, 1],
    ];
    let set = data(&bonded(9, &bonds)).unwrap();
    let expected = [
        (false, vec![1, 7]),
        (false, vec![4, 6, 2, 8]),
        (true, vec![3, 5, 9]),
    ];
    assert_eq!(ids(&set), expected);
}

#[test]
fn molecules_with_branches_are_counted_and_atoms_without_bonds_are_no_curves() {
    let branched = [[1, 2], [1, 3], [1, 4], [4, 5]];
    let bonds = [&branched[..], &[[7, 8], [8, 9], [9, 7]]].concat();
    let frame = data_frame(&bonded(12, &bonds), false).unwrap();
    assert_eq!(ids(&frame.curves.unwrap()), [(true, vec![7, 8, 9])]);
    let said = |left_out: &[LeftOut]| LeftOut::sentence(left_out);
    let expected = "not read, so not verified: 1 molecule with branches (atom 1 has 3 bonds)";
    assert_eq!(said(&frame.info.left_out), expected);
    let lines = bonded(12, &bonds[4..]).replacen("atoms\n", "atoms\n7 lines\n0 bodies\n", 1);
    let frame = data_frame(&lines, false).unwrap();
    let expected = "not read, so not verified: 7 line particles (the first one: header)";
    assert_eq!(said(&frame.info.left_out), expected);
    // The frames of a dump lack the molecules of its bonds.
    let mut source = read_dump(
        DUMP.as_bytes(),
        &[[1, 2], [2, 3], [3, 1], [4, 5], [4, 6], [4, 7]],
        false,
    )
    .unwrap();
    let frame = source.next_frame().unwrap().unwrap();
    assert_eq!(
        (frame.curves.unwrap().len(), frame.info.left_out[0].count),
        (1, 1)
    );
    let expected = "1 of 1 molecules (5 atoms) have branches, so that they are no curves: atom 1 \
                    has 3 bonds";
    assert_error_contains(data(&bonded(6, &branched)), expected);
    assert_error_contains(data(&bonded(3, &[])), "no bonds, which define the curves");
}

#[test]
fn a_curve_that_closes_only_through_the_boundary_is_refused() {
    // Three atoms, each a third of the box apart.
    let text = "t\n3 atoms\n3 bonds\n1 atom types\n0 9 xlo xhi\n0 9 ylo yhi\n0 9 zlo zhi\n\n\
                Atoms # molecular\n\n1 1 1 1 0 0 0 0 0\n2 1 1 4 0 0 0 0 0\n3 1 1 7 0 0 0 0 0\n\n\
                Bonds\n\n1 1 1 2\n2 1 2 3\n3 1 3 1\n";
    assert_error_contains(
        data(text),
        "the bond of atoms 3 and 1 is 0.667 of the periodic cell",
    );
    assert_error_contains(data(text), "in spite of image flags");
    let frame = data_frame(text, true).unwrap();
    assert_eq!(frame.curves.unwrap().point(0, 2), [7.0, 0.0, 0.0]);
    assert_eq!(frame.info.cell.unwrap().to_string(), "9,9,9");
    // Without flags it may be wrapped.
    let plain = text.replace(" 0 0 0 0 0\n", " 0 0\n");
    assert_error_contains(data(&plain), "the curve is wrapped at the boundary");
}

#[test]
fn the_columns_of_atoms_follow_their_style() {
    let with = |heading: &str, atom: &dyn Fn(usize) -> String| {
        let mut text = "t\n3 atoms\n3 bonds\n2 atom types\n0 9 xlo xhi\n0 9 ylo yhi\n".to_owned();
        text += &format!("0 9 zlo zhi\n\n{heading}\n\n");
        (1..=3).for_each(|id| text += &format!("{id} {}\n", atom(id)));
        data(&(text + "\nBonds\n\n1 1 1 2\n2 1 2 3\n3 1 3 1\n"))
    };
    let xyz = |id: usize| format!("{id} {} 0.5", id * id % 4);
    let expected = vec![(true, vec![[1., 1., 0.5], [2., 0., 0.5], [3., 1., 0.5]])];
    for (heading, columns) in [
        ("Atoms # bond", "7 1"),
        ("Atoms # molecular", "7 1"),
        ("Atoms  # angle", "7 1"),
        ("Atoms # full", "7 1 -0.5"),
        ("Atoms # atomic", "C"),
        ("Atoms # charge", "2 0.1"),
        ("Atoms # sphere", "2 1.0 0.1"),
        ("Atoms # bpm/sphere", "7 2 1.0 0.1"),
        ("Atoms", "7 1"),
        ("Atoms", "7 2 0.5"),
        ("Atoms #", "7 2 0.5"),
    ] {
        let plain = with(heading, &|id| format!("{columns} {} # C", xyz(id))).unwrap();
        assert_eq!(curves(&plain), expected, "{heading}");
        // A box of 9, and flags that leave the box as a whole.
        let flagged = with(heading, &|id| format!("{columns} {} 1 0 -1", xyz(id))).unwrap();
        assert_eq!(flagged.point(0, 1), [11.0, 0.0, -8.5], "{heading}");
    }
    let fails = |heading, columns: &str| {
        let result = with(heading, &|id| format!("{columns} {}", xyz(id)));
        result.unwrap_err().to_string()
    };
    for (heading, columns, expected) in [
        (
            "Atoms",
            "1",
            "atoms of 5 columns, from which their style cannot be told",
        ),
        ("Atoms", "1 2 3 4", "atoms of 8 columns"),
        (
            "Atoms",
            "1 3",
            "type 3 of an atom in column 3, but there are 2 types",
        ),
        ("Atoms", "1 1.5", "'1.5', expected the type of an atom"),
        (
            "Atoms # hybrid bond",
            "1 1",
            "atoms of style 'hybrid bond', which is not read",
        ),
        (
            "Atoms # full",
            "1 1",
            "6 columns, but atoms of style full have 7, or 10 with image",
        ),
    ] {
        let error = fails(heading, columns);
        assert!(error.contains(expected), "{error}");
        assert!(error.contains("line 11)"), "{error}");
    }
}

#[test]
fn errors_of_data_files_name_the_line() {
    let good = bonded(3, &[[1, 2], [2, 3], [3, 1]]);
    data(&good).unwrap();
    for (from, to, expected) in [
        (
            "3 atoms",
            "4 atoms",
            "line 14): an empty line after 3 of 4 atoms",
        ),
        ("3 atoms", "99 atoms", "line 9): 99 atoms, too many for"),
        ("3 atoms", "18446744073709551615 atoms", "too many for"),
        ("3 atoms", "-3 atoms", "'-3', expected a number of atoms"),
        ("3 bonds", "4 bonds", "4 bonds, too many for 25 bytes"),
        ("3 bonds", "99999999 bonds", "99999999 bonds, too many for"),
        (
            "3 bonds",
            "2 bonds",
            "'1 1 3 1', expected the name of a section",
        ),
        ("0 99 ylo yhi", "", "without the bounds `ylo yhi`"),
        (
            "0 99 ylo yhi",
            "0 nan ylo yhi",
            "'nan' is not a finite number",
        ),
        (
            "0 99 ylo yhi",
            "1 0 0 avec",
            "the header ends without one of `avec`, `bvec` and `cvec`",
        ),
        (
            "2 1 1 2 0 0",
            "2 1 1 2 0 x",
            "line 12): atom 2: 'x', expected a number",
        ),
        (
            "2 1 1 2 0 0",
            "2 1 1 2 0",
            "line 12): 5 columns, but the first atom has 6",
        ),
        (
            "2 1 1 2 0 0",
            "3 1 1 2 0 0",
            "Atoms): atom 3 is there twice",
        ),
        (
            "2 1 1 2 0 0",
            "4 1 1 2 0 0",
            "1 of the 3 atoms on curves are missing, atom 2",
        ),
        (
            "1 1 2 3",
            "1 1 2 2",
            "line 18): the bond connects atom 2 to itself",
        ),
        ("1 1 2 3", "1 1 2", "too few words"),
        ("1 1 2 3", "1 1 2 -3", "'-3', expected the id of an atom"),
        (
            "Bonds",
            "Angles",
            "no section Bonds, but the header promises 3",
        ),
        (
            "Atoms",
            "Velocities",
            "no section Atoms, but the header promises 3",
        ),
        ("Bonds", "Atoms", "a second section 'Atoms'"),
    ] {
        assert_error_contains(data(&good.replacen(from, to, 1)), expected);
    }
    let wide = good
        .replace("1 1 3 1", "1 1 3          1")
        .replace("3 bonds", "4 bonds");
    assert_error_contains(data(&wide), "the file ends, expected 4 bonds, found 3");
    assert_error_contains(data(""), "line 1): the file ends, expected a data file");
    let long = format!("title\n{}", "x".repeat(1 << 17));
    assert_error_contains(data(&long), "is longer than 65536 bytes");
}

/// Returns the frames of a dump of the atoms 1, 2 and 3, a closed curve.
fn dump(text: &str) -> Result<Vec<ModelFrame>> {
    dump_frames(text, false)
}

fn dump_frames(text: &str, wrapped: bool) -> Result<Vec<ModelFrame>> {
    frames_of(read_dump(
        text.as_bytes(),
        &[[1, 2], [2, 3], [3, 1]],
        wrapped,
    )?)
}

const DUMP: &str = "ITEM: TIMESTEP\n5\nITEM: NUMBER OF ATOMS\n3\nITEM: BOX BOUNDS pp pp ff\n0 9\n\
                    0 9\n0 9\nITEM: ATOMS id x y z\n1 1 0 0\n2 2 0 9\n3 3 1 0\n";

#[test]
fn errors_of_dumps_name_the_line() {
    assert!(dump(DUMP).unwrap()[0].curves.is_ok());
    for (from, to, expected) in [
        ("ITEM: TIMESTEP\n5\n", "", "atoms without ITEM: TIMESTEP"),
        (
            "TIMESTEP\n5",
            "TIMESTEP\n-5",
            "line 2): '-5', expected a time step",
        ),
        (
            "ITEM: NUMBER OF ATOMS\n3\n",
            "",
            "atoms without ITEM: NUMBER OF ATOMS",
        ),
        ("ATOMS\n3", "ATOMS\n4", "4 atoms, too many for 24 bytes"),
        ("ATOMS\n3", "ATOMS\n2", "'3 3 1 0', expected an ITEM"),
        ("ATOMS\n3", "ATOMS\n9999", "9999 atoms, too many for"),
        (
            "ITEM: BOX BOUNDS pp pp ff\n0 9\n0 9\n0 9\n",
            "",
            "atoms without ITEM: BOX BOUNDS",
        ),
        (
            "BOUNDS pp pp ff",
            "BOUNDS pp pp",
            "expected three kinds of boundaries",
        ),
        (
            "BOUNDS pp pp ff",
            "BOUNDS abc origin pp pp ff",
            "2 bounds of the box, expected 4",
        ),
        (
            "BOUNDS pp pp ff",
            "BOUNDS xy xz yz pp pp ff",
            "2 bounds of the box, expected 3",
        ),
        ("0 9\n", "0 x\n", "line 6): 'x', expected a number"),
        (
            "ITEM: BOX",
            "ITEM: SHAPE",
            "item 'SHAPE BOUNDS pp pp ff', which is not known",
        ),
        ("ATOMS id x y z", "ATOMS type x y z", "no column id"),
        (
            "ATOMS id x y z",
            "ATOMS id vx vy vz",
            "no columns of coordinates",
        ),
        (
            "ITEM: ATOMS",
            "ATOMS",
            "line 9): 'ATOMS id x y z', expected an ITEM",
        ),
    ] {
        let error = dump(&DUMP.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(expected), "{error:?} lacks {expected:?}");
    }
    let wide = DUMP
        .replace("3 3 1 0", "3 3.0000000 1 0")
        .replace("ATOMS\n3", "ATOMS\n4");
    let truncated = dump(&wide).unwrap_err().to_string();
    assert!(
        truncated.contains("the file ends, expected 4 atoms, found 3"),
        "{truncated}"
    );
    let again = dump(&DUMP.repeat(2)).unwrap_err().to_string();
    assert!(again.contains("time step 5 after time step 5"), "{again}");
}

#[test]
fn a_frame_with_a_wrong_atom_is_invalid_and_the_next_one_is_read() {
    for (from, to, expected) in [
        (
            "2 2 0 9",
            "2 2 0 nan",
            "line 11): atom 2: 'nan' is not a finite number",
        ),
        ("2 2 0 9", "2 2 0", "line 11): 3 columns, expected 4"),
        ("2 2 0 9", "3 2 0 9", "atom 3 is there twice"),
        (
            "2 2 0 9",
            "7 2 0 9",
            "1 of the 3 atoms on curves are missing, atom 2",
        ),
        (
            "2 2 0 9",
            "2 7 0 9",
            "atoms 1 and 2 is 0.667 of the periodic cell long in x",
        ),
        ("2 2 0 9", "2 1e400 0 9", "'1e400' is not a finite number"),
    ] {
        let text = DUMP.replacen(from, to, 1) + &DUMP.replacen("\n5\n", "\n6\n", 1);
        let frames = dump(&text).unwrap();
        let error = frames[0].curves.as_ref().unwrap_err().to_string();
        assert!(error.contains(expected), "{error:?} lacks {expected:?}");
        assert!(frames[1].curves.is_ok());
    }
}

/// Rotation by 120 degrees about (1, 1, 1), and then about x.
fn turned(p: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = [p[2], p[0], p[1]];
    [x, 0.8 * y - 0.6 * z, 0.6 * y + 0.8 * z]
}

#[test]
fn a_general_box_gives_the_turned_curves() {
    let near = |a: [f64; 3], b: [f64; 3]| (0..3).all(|x| (a[x] - b[x]).abs() < 1e-9);
    let folder = tempfile::tempdir().unwrap();
    for (name, moved) in [("triclinic.dump", true), ("triclinic-scaled.dump", false)] {
        let straight = frames(name, Some("triclinic.data"));
        let text = std::fs::read_to_string(file(name)).unwrap();
        let mut given = text.lines();
        let mut general = String::new();
        let (mut atoms, mut seen) = (None, 0);
        while let Some(line) = given.next() {
            if line.starts_with("ITEM: BOX") {
                general += "ITEM: BOX BOUNDS abc origin pp pp pp\n";
                let cell = straight[seen].as_ref().unwrap().info.cell.unwrap();
                let origin = turned(cell.origin);
                seen += 1;
                for (vector, low) in cell.vectors.into_iter().zip(origin) {
                    let [a, b, c] = turned(vector);
                    general += &format!("{a:?} {b:?} {c:?} {low:?}\n");
                    given.next();
                }
                continue;
            }
            if line.starts_with("ITEM:") {
                let columns = line.split(' ').skip(2).position(|c| c == "x");
                atoms = columns.filter(|_| moved && line.starts_with("ITEM: ATOMS"));
            } else if let Some(x) = atoms {
                let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
                let point = per_axis(|k| words[x + k].parse().unwrap());
                for (word, value) in words[x..].iter_mut().zip(turned(point)) {
                    *word = format!("{value:?}");
                }
                general += &(words.join(" ") + "\n");
                continue;
            }
            general += &(line.to_owned() + "\n");
        }
        let path = folder.path().join(name);
        std::fs::write(&path, general).unwrap();
        let options = ReadOptions {
            bonds: Some(file("triclinic.data")),
            ..ReadOptions::default()
        };
        let found = Frames::open(&path, &options).unwrap();
        for (frame, straight) in found.zip(&straight) {
            let (frame, straight) = (frame.unwrap(), straight.as_ref().unwrap());
            let (set, expected) = (frame.curves.unwrap(), straight.curves.as_ref().unwrap());
            for ((_, a), (_, b)) in curves(&set).iter().zip(&curves(expected)) {
                assert!(a.iter().zip(b).all(|(a, b)| near(*a, turned(*b))), "{name}");
            }
            assert_eq!(certificate(&set), CERTIFICATE);
        }
    }
    // A data file, as OVITO writes it.
    let text = bonded(3, &[[1, 2], [2, 3], [3, 1]]);
    let general = text.replace(
        "0 99 xlo xhi\n0 99 ylo yhi\n0 99 zlo zhi\n",
        "0.0 50 0 avec\n-50 0 1 bvec\n0 0 50 cvec\n-5 -6 -7 abc origin\n",
    );
    let frame = data_frame(&general, false).unwrap();
    let expected = "0,50,0,-50,0,1,0,0,50,-5,-6,-7";
    assert_eq!(frame.info.cell.unwrap().to_string(), expected);
    assert_eq!(
        curves(&frame.curves.unwrap()),
        curves(&data(&text).unwrap())
    );
    let flat = general.replace("-50 0 1 bvec", "0 5 0 bvec");
    assert!(data_frame(&flat, false).is_err());
}

#[test]
fn molecules_of_a_dump_without_bonds_are_chains_in_the_order_of_the_ids() {
    let text = "ITEM: TIMESTEP\n5\nITEM: NUMBER OF ATOMS\n8\nITEM: BOX BOUNDS ff ff ff\n0 9\n0 9\n\
                0 9\nITEM: ATOMS mol id x y z\n7 9 9 0 0\n2 3 3 0 0\n7 1 1 0 0\n2 8 8 0 0\n\
                0 4 4 0 0\n5 6 6 0 0\n2 5 5 0 0\n0 7 7 0 0\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("melt.dump");
    let second = text.replace("\n5\nITEM", "\n6\nITEM");
    std::fs::write(&path, format!("{text}{second}")).unwrap();
    let open = |closed| {
        let options = ReadOptions {
            closed,
            ..ReadOptions::default()
        };
        let frames: Result<Vec<ModelFrame>> = Frames::open(&path, &options)?.collect();
        frames.map(|frames| {
            frames
                .into_iter()
                .map(|f| ids(&f.curves.unwrap()))
                .collect::<Vec<_>>()
        })
    };
    // Atoms with molecule 0 belong to no molecule, and a single atom is not a curve.
    for (given, closed) in [(None, false), (Some(false), false), (Some(true), true)] {
        let expected = vec![(closed, vec![1, 9]), (closed, vec![3, 5, 8])];
        assert_eq!(open(given).unwrap(), [expected.clone(), expected]);
    }
    std::fs::write(&path, text.replace("2 8 8", "2 9 8")).unwrap();
    let error = open(None).unwrap_err().to_string();
    assert!(
        error.contains("melt.dump: ") && error.contains("atom 9 is in two molecules"),
        "{error}"
    );
    let none = text.replace("\n7 1 ", "\n1 1 ").replace("\n2 ", "\n0 ");
    std::fs::write(&path, none).unwrap();
    let error = open(None).unwrap_err().to_string();
    assert!(
        error.contains("no molecule (column mol) of two or more atoms"),
        "{error}"
    );
}

#[test]
fn files_of_any_name_are_recognized_by_their_content() {
    let folder = tempfile::tempdir().unwrap();
    for (name, from) in [
        ("rings.dat", "rings.data"),
        ("initial_conditions.txt", "triclinic.data"),
        ("system", "rings.data"),
    ] {
        let path = folder.path().join(name);
        std::fs::copy(file(from), &path).unwrap();
        assert_eq!(Format::of(&path).unwrap(), Format::LammpsData);
        assert_eq!(certificate(&read(&path).unwrap()), CERTIFICATE, "{name}");
    }
    for text in ["", "title\n\natoms 3\n", "title\n12 atomic\n", "12 atoms\n"] {
        let path = folder.path().join("no-model.txt");
        std::fs::write(&path, text).unwrap();
        assert!(Format::of(&path).is_err(), "{text:?}");
    }
}

#[test]
fn only_periodic_directions_tear_bonds() {
    // The bond of atoms 1 and 2 is as long as the box in z, which is not periodic.
    let free = DUMP
        .replace("pp pp ff", "ff ff ss")
        .replace("3 3 1 0", "3 9 9 0");
    assert!(dump(&free).unwrap()[0].curves.is_ok());
    let periodic = DUMP.replace("pp pp ff", "pp pp pp");
    assert!(dump(&periodic).unwrap()[0].curves.is_err());
    // Old dumps do not say which directions are periodic.
    let old = DUMP.replace(" pp pp ff", "");
    assert!(dump(&old).unwrap()[0].curves.is_err());
    // A box without a length along a periodic axis is an error.
    let flat = DUMP.replacen("0 9\n", "0 0\n", 1);
    for wrapped in [false, true] {
        let frame = dump_frames(&flat, wrapped).unwrap().remove(0);
        let error = frame.curves.unwrap_err().to_string();
        assert!(
            error.contains("periodic in x, but has no length"),
            "{error}"
        );
    }
}

proptest! {
    #[test]
    fn a_wrapped_chain_is_unwrapped_or_refused(
        tilt in [-3.0..3.0f64, -3.0..3.0, -3.0..3.0],
        steps in prop::collection::vec([-2.0..2.0f64, -2.0..2.0, -2.0..2.0], 1..12),
    ) {
        // A closed curve: there and back.
        let space = cell::SimulationBox::new([[1.0; 3], [11.0; 3]], tilt, [true; 3]);
        let cell = space.cell().unwrap();
        let mut points = vec![[5.0; 3]];
        for step in &steps {
            let p = points[points.len() - 1];
            points.push(per_axis(|x| p[x] + step[x]));
        }
        for k in (1..steps.len()).rev() {
            points.push(points[k].map(|x| x + 0.25));
        }
        let n = points.len() as u64;
        let bonds: Vec<[u64; 2]> = (1..n).map(|k| [k, k + 1]).collect();
        let curve = Curves::of_bonds(bonds, dump::FORMAT).unwrap();
        // Wraps every point into the box, from the last direction to the first one.
        let (mut with_flags, mut without) = (curve.frame(), curve.frame());
        let mut torn = false;
        let mut previous = None;
        for (id, p) in (1..).zip(&points) {
            let mut wrapped = *p;
            let mut flags = [0.0; 3];
            for x in (0..3).rev() {
                let mut edge = [0.0; 3];
                let s = (wrapped[x] - 1.0) / 10.0;
                edge[x] = s.floor();
                flags[x] = edge[x];
                let shift = space.shift(edge);
                wrapped = per_axis(|x| wrapped[x] - shift[x]);
            }
            torn |= previous.is_some_and(|f| f != flags);
            previous = Some(flags);
            let shift = space.shift(flags);
            with_flags.put(id, per_axis(|x| wrapped[x] + shift[x])).unwrap();
            without.put(id, wrapped).unwrap();
        }
        let unwrapped = with_flags.finish(cell.as_ref(), Unwrapped::ByFlags);
        // Steps of up to 2 in x can be longer than half of the tilted box in its own coordinates.
        if let Ok(set) = unwrapped {
            for (k, p) in points.iter().enumerate() {
                let q = set.point(0, k);
                prop_assert!((0..3).all(|x| (p[x] - q[x]).abs() < 1e-9));
            }
            prop_assert_eq!(without.finish(cell.as_ref(), Unwrapped::Unknown).is_err(), torn);
        }
    }
}
