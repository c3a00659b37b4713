//! Files as ASE and OVITO write them, and bad ones.

use super::*;
use crate::curve::CurveSet;
use crate::formats::tests::{curves, frames_of};

fn options(counts: Option<&[i32]>, wrapped: bool) -> ReadOptions {
    ReadOptions {
        counts: counts.map(<[i32]>::to_vec),
        wrapped: wrapped.then_some(true),
        ..ReadOptions::default()
    }
}

fn frames_with(text: &str, options: &ReadOptions) -> Result<Vec<ModelFrame>> {
    frames_of(read(text.as_bytes().into(), options)?)
}

fn frames(text: &str) -> Result<Vec<ModelFrame>> {
    frames_with(text, &options(None, false))
}

fn set(text: &str) -> CurveSet {
    frames(text).unwrap().remove(0).curves.unwrap()
}

/// Returns the x of the points of all curves.
fn xs(set: &CurveSet) -> Vec<(bool, Vec<f64>)> {
    let x =
        |(closed, points): (bool, Vec<[f64; 3]>)| (closed, points.iter().map(|p| p[0]).collect());
    curves(set).into_iter().map(x).collect()
}

/// Returns a frame of atoms `(molecule, x)` with a key.
fn frame(key: &str, atoms: &[(i64, f64)]) -> String {
    let mut text = format!(
        "{}\nProperties=species:S:1:pos:R:3:molecule:I:1 {key}\n",
        atoms.len()
    );
    for (molecule, x) in atoms {
        text += &format!("C {x} 0.5 1e-3 {molecule}\n");
    }
    text
}

const RINGS: [(i64, f64); 6] = [(7, 0.0), (7, 1.0), (2, 2.0), (7, 3.0), (2, 4.0), (2, 5.0)];

#[test]
fn atoms_of_a_molecule_are_a_closed_curve_in_the_order_of_the_file() {
    let set = set(&frame("", &RINGS));
    assert_eq!(
        xs(&set),
        [(true, vec![0.0, 1.0, 3.0]), (true, vec![2.0, 4.0, 5.0])]
    );
    assert_eq!(set.point(1, 0), [2.0, 0.5, 1e-3]);
}

#[test]
fn atoms_with_ids_have_the_order_of_the_ids() {
    // As OVITO writes a dump of LAMMPS whose atoms are not sorted.
    let text = "4\nLattice=\"9.0 0.0 0.0 0.0 9.0 0.0 0.0 0.0 9.0\" Origin=\"0.0 0.0 -1.0\" \
                Properties=id:I:1:species:S:1:pos:R:3:molecule:I:1 Timestep=500\n\
                4 1 4.0 1 0 2\n2 1 2.0 0 0 1\n1 1 1.0 0 0 2\n3 1 3.0 0 0 1\n";
    let frame = frames(text).unwrap().remove(0);
    assert_eq!(frame.info.seq, 500);
    assert_eq!(
        frame.info.cell.unwrap().to_string(),
        "9,0,0,0,9,0,0,0,9,0,0,-1"
    );
    let found = xs(frame.curves.as_ref().unwrap());
    assert_eq!(found, [(true, vec![1.0, 4.0]), (true, vec![2.0, 3.0])]);
    let twice = text.replace("3 1 3.0", "2 1 3.0");
    let error = frames(&twice)
        .unwrap()
        .remove(0)
        .curves
        .unwrap_err()
        .to_string();
    assert!(error.contains("the id 2 is there twice"), "{error}");
}

#[test]
fn a_column_says_which_curves_are_open() {
    let text = "4\nproperties=pos:R:3:forces:R:3:mol:I:1:closed:L:1\n0 0 0 1 1 1 1 F\n\
                1 0 0 1 1 1 1 F\n2 0 0 1 1 1 2 T\n3 0 0 1 1 1 2 True\n";
    assert_eq!(
        xs(&set(text)),
        [(false, vec![0.0, 1.0]), (true, vec![2.0, 3.0])]
    );
    let both = text.replacen("1 1 1 1 F\n", "1 1 1 1 T\n", 1);
    let error = frames(&both)
        .unwrap()
        .remove(0)
        .curves
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("curve 1 is closed by some atoms, but not by others"),
        "{error}"
    );
}

#[test]
fn the_first_known_column_of_integers_groups_the_atoms() {
    for (columns, values, closed) in [
        ("chain:I:1:resid:I:1", ["1 5", "1 6", "1 6"], [1, 2]),
        ("resid:I:1:chain:S:1", ["3 A", "4 A", "3 B"], [2, 1]),
        ("mol:I:1:molecule:I:1", ["1 3", "1 4", "1 4"], [1, 2]),
        ("mol:R:1:mol-id:I:1", ["1.5 0", "1.5 0", "1.5 -1"], [2, 1]),
    ] {
        let [a, b, c] = values;
        let text = format!("3\nProperties=pos:R:3:{columns}\n0 0 0 {a}\n1 0 0 {b}\n2 0 0 {c}\n");
        let counts = set(&text).counts().map(|c| -c).collect::<Vec<_>>();
        assert_eq!(counts, closed, "{columns}");
    }
}

#[test]
fn counts_divide_the_atoms_of_files_without_a_column() {
    let plain = "5\nany \"text, = of\nC 0 0 0\nC 1 0 0 ignored\nC 2 0 0\nC 3 0 0\nC 4 0 0\n";
    let read = |counts: &[i32]| frames_with(plain, &options(Some(counts), false));
    let found = read(&[-3, 2]).unwrap().remove(0).curves.unwrap();
    assert_eq!(
        xs(&found),
        [(true, vec![0.0, 1.0, 2.0]), (false, vec![3.0, 4.0])]
    );
    let error = read(&[-3, 3])
        .unwrap()
        .remove(0)
        .curves
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("5 atoms do not fit 2 curves with 6 points"),
        "{error}"
    );
    let error = frames(plain).unwrap_err().to_string();
    assert!(
        error.contains("line 2): nothing says which atoms belong to one curve"),
        "{error}"
    );
    assert!(
        error.contains("molecule:I:1") && error.contains("option `counts`"),
        "{error}"
    );
}

#[test]
fn the_cell_repeats_along_the_directions_of_pbc() {
    let cell = |keys: &str| {
        let atoms: [(i64, f64); 3] = [(1, 0.0), (1, 1.0), (1, 2.0)];
        let found = frames(&frame(keys, &atoms)).map(|mut frames| frames.remove(0).info.cell);
        found.map(|cell| cell.map(|cell| cell.to_string()))
    };
    let lattice = "Lattice=\"9 0 0 -2.5 8 0 0 1 7\"";
    for (keys, expected) in [
        ("", None),
        ("pbc=\"F F F\"", None),
        (lattice, Some("9,0,0,-2.5,8,0,0,1,7")),
        ("lattice='9, 0, 0, 0, 8, 0, 0, 0, 7'", Some("9,8,7")),
        ("Lattice={9 0 0 0 8 0 0 0 0}", Some("9,8,0")),
        (
            "pbc=[T, T, F] Lattice=[[9, 0, 0], [0, 8, 0], [0, 0, 7]]",
            Some("9,8,0"),
        ),
        (
            &format!("{lattice} pbc=\"T T T\""),
            Some("9,0,0,-2.5,8,0,0,1,7"),
        ),
        (
            &format!("pbc=\"T T F\" {lattice}"),
            Some("9,0,0,-2.5,8,0,0,0,0"),
        ),
        (&format!("pbc = '1 0 0' {lattice}"), Some("9,0,0")),
        (&format!("pbc=\"F F F\" {lattice}"), None),
        (
            &format!("{lattice} pbc='T F F' Origin='0 1 2'"),
            Some("9,0,0,0,0,0,0,0,0,0,1,2"),
        ),
    ] {
        assert_eq!(cell(keys).unwrap().as_deref(), expected, "{keys}");
    }
    for (keys, says) in [
        ("pbc=\"T F F\"", "periodic by `pbc`, but has no Lattice"),
        (
            "Lattice='9 0 0 0 9 0 0 0 0' pbc='T T T'",
            "along vector 3 of its Lattice",
        ),
        (
            "Lattice='9 0 0 0 9 0 0 0'",
            "'Lattice': 8 numbers, expected 9",
        ),
        (
            "Lattice='9 0 0 0 9 0 0 0 9 1'",
            "'Lattice': more than 9 numbers",
        ),
        (
            "Lattice=[[9, 0, 0], [0, 9, 0], [0, 0, 9]",
            "the array does not end",
        ),
        (
            "Lattice='9 0 0 0 9 0 0 0 x'",
            "'Lattice': 'x', expected a number",
        ),
        ("Lattice='9 0 0 9 0 0 0 0 9'", "lie in one plane"),
        ("Lattice='9 0 0 0 9 0 0 0 9", "the text does not end"),
        ("Lattice", "the key 'Lattice' has no value"),
        (
            &format!("{lattice} {lattice}"),
            "the key 'Lattice' is there twice",
        ),
        (
            &format!("{lattice} pbc='T T'"),
            "'pbc': 2 of T and F, expected 3",
        ),
        (
            &format!("{lattice} pbc='T T x'"),
            "'pbc': 'x', expected T or F",
        ),
        ("Origin='nan 0 0'", "'Origin': 'nan' is not a finite number"),
    ] {
        let error = cell(keys).unwrap_err().to_string();
        assert!(
            error.contains("line 2)") && error.contains(says),
            "{keys}: {error}"
        );
    }
}

#[test]
fn curves_that_the_boundary_tears_are_refused_unless_the_caller_unwraps_them() {
    let text = |x: f64| {
        frame(
            "Lattice='9 0 0 0 9 0 0 0 9' pbc='T F F'",
            &[(1, 0.0), (1, x), (1, 4.0)],
        )
    };
    assert!(frames(&text(4.5)).unwrap()[0].curves.is_ok());
    let error = frames(&text(8.0))
        .unwrap()
        .remove(0)
        .curves
        .unwrap_err()
        .to_string();
    let says = "curve 0 is 0.889 of the first lattice vector long from point 0 to 1";
    assert!(
        error.contains(says) && error.contains("option `wrapped`"),
        "{error}"
    );
    let frame = frames_with(&text(8.0), &options(None, true))
        .unwrap()
        .remove(0);
    assert_eq!(frame.curves.unwrap().point(0, 1)[0], 8.0);
    // Each frame has its own cell, and an axis that is not periodic does not tear curves.
    let free = text(8.0).replace("pbc='T F F'", "pbc='F T F'");
    let two = frames(&format!("{}\n{free}\n", text(1.0))).unwrap();
    assert!(two.iter().all(|frame| frame.curves.is_ok()));
    let cells = two.iter().map(|frame| frame.info.cell.unwrap().to_string());
    assert_eq!(cells.collect::<Vec<_>>(), ["9,0,0", "0,9,0"]);
}

#[test]
fn frames_are_numbered_by_their_time_step_or_counted() {
    let three = |keys: [&str; 3]| {
        let text = keys.map(|key| frame(key, &RINGS)).concat();
        frames(&text).map(|frames| {
            frames
                .iter()
                .map(|f| (f.info.seq, f.info.time))
                .collect::<Vec<_>>()
        })
    };
    let error = three(["", "a=b=c", ""]).unwrap_err().to_string();
    assert!(
        error.contains("line 10): '=c', expected a key and a value"),
        "{error}"
    );
    let found = three(["Time=0.5", "time=1e1 a=b", ""]).unwrap();
    assert_eq!(found, [(0, 0.5), (1, 10.0), (2, 0.0)]);
    let found = three(["Timestep=3", "Timestep=5", "Timestep=9"]).unwrap();
    assert_eq!(found, [(3, 0.0), (5, 0.0), (9, 0.0)]);
    for (keys, says) in [
        (
            ["Timestep=3", "Timestep=3", ""],
            "line 10): Timestep 3 after Timestep 3",
        ),
        (["Timestep=3", "", ""], "line 10): no Timestep"),
        (
            ["", "Timestep=3", ""],
            "line 10): a Timestep, which the frames before lack",
        ),
        (
            ["Timestep=-1", "", ""],
            "line 2): 'Timestep': '-1', expected the number of a frame",
        ),
        (
            ["Time=inf", "", ""],
            "line 2): 'Time': 'inf' is not a finite number",
        ),
    ] {
        let error = three(keys).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
}

/// Regression test: such cells were ignored without a message.
#[test]
fn a_cell_in_another_form_is_left_out_unless_it_is_given() {
    let ipi = "# CELL(abcABC): 9.5 10 1e1 90 90 90 Step: 0 positions{angstrom} cell{angstrom}";
    let left_out = |comment: &str, has_cell: bool| {
        let text = format!("3\n{comment}\nC 0 0 0\nC 1 0 0\nC 0 1 0\n");
        let options = ReadOptions {
            cell: has_cell.then_some(None),
            ..options(Some(&[-3]), false)
        };
        let frame = frames_with(&text, &options).unwrap().remove(0);
        frame.info.left_out
    };
    for comment in [
        ipi,
        "cell=\"9 0 0 0 9 0 0 0 9\"",
        "Box = [9, 9, 9]",
        "box 9 9 9",
        "cell: 9 9 9",
    ] {
        let found = left_out(comment, false);
        assert!(
            found[0].to_string().contains("write `Lattice`"),
            "{comment}: {found:?}"
        );
        assert_eq!(left_out(comment, true), [], "{comment}");
        let lattice = "Lattice=\"9 0 0 0 9 0 0 0 9\" Properties=species:S:1:pos:R:3";
        assert_eq!(left_out(&format!("{lattice} {comment}"), false), []);
    }
    for comment in [
        "supercell=\"2 2 2\"",
        "ncell=4",
        "unit cell(s), 2 of them",
        "cell=bcc",
        "cell 3",
    ] {
        assert_eq!(left_out(comment, false), [], "{comment}");
    }
}

#[test]
fn errors_name_the_line() {
    let good = frame("", &RINGS);
    for (from, to, says) in [
        (
            "6\n",
            "six\n",
            "line 1): 'six', expected the number of atoms",
        ),
        ("6\n", "-6\n", "line 1): '-6', expected the number of atoms"),
        (
            "6\n",
            "99999999999\n",
            "line 2): 99999999999 atoms, too many for",
        ),
        (
            "6\n",
            "7\n",
            "line 9): the file ends, expected 7 atoms, found 6",
        ),
        (
            "6\n",
            "5\n",
            "line 8): 'C 5 0.5 1e-3 2', expected the number of atoms",
        ),
        ("pos:R:3", "pos:R:2", "no columns `pos:R:3`"),
        ("pos:R:3", "pos:R", "expected `name:type:columns"),
        ("pos:R:3", "pos:R:-3", "'-3', expected a number of columns"),
        ("pos:R:3", "pos:R:3:v:R:65535", "6 atoms, too many for"),
        (
            "Properties=",
            "Properties = = ",
            "expected a key and a value",
        ),
        (
            "molecule:I",
            "molecule:R",
            "nothing says which atoms belong to one curve",
        ),
    ] {
        let text = good.replacen(from, to, 1);
        let error = frames(&text).unwrap_err().to_string();
        assert!(error.contains(says), "{to}: {error}");
    }
    let error = frames("6\n").unwrap_err().to_string();
    assert!(
        error.contains("line 2): the file ends, expected the comment"),
        "{error}"
    );
    assert!(frames("").unwrap().is_empty());
    let error = frames("BZh91").unwrap_err().to_string();
    assert!(error.contains("bunzip2"), "{error}");
}

#[test]
fn a_frame_with_a_wrong_atom_is_invalid_and_the_next_one_is_read() {
    let good = frame("", &RINGS);
    for (from, to, says) in [
        (
            "C 3 0.5",
            "C nan 0.5",
            "line 6): atom 3: 'nan' is not a finite number",
        ),
        (
            "C 3 0.5",
            "C 3",
            "line 6): atom 3: fewer columns than the 5 of Properties",
        ),
        (
            "C 3 0.5",
            "C 3 1 0.5",
            "line 6): atom 3: more columns than the 5 of Properties",
        ),
        (
            "1e-3 7\n",
            "1e-3 7.5\n",
            "'7.5', expected the number of a curve",
        ),
    ] {
        let two = frames(&format!("{}{good}", good.replacen(from, to, 1))).unwrap();
        let error = two[0].curves.as_ref().unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
        assert!(two[1].curves.is_ok());
        assert_eq!(two[1].info.seq, 1);
    }
}
