//! `linkwatch measure writhe` and `linkwatch certify --open`.

use crate::support::command::{linkwatch, text};
use linkwatch::formats::{Format, FrameWriter, ModelFrame};
use linkwatch::{Basis, CurveSet, Positions};
use std::path::{Path, PathBuf};

fn write(folder: &Path, name: &str, content: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, content).unwrap();
    path
}

fn json(args: &[&str], code: u8) -> Vec<serde_json::Value> {
    let run = linkwatch(&[args, &["--json"]].concat());
    assert_eq!(run.code, i32::from(code), "{args:?}: {}", run.stderr);
    let lines = run.stdout.lines().map(serde_json::from_str);
    lines.collect::<Result<_, _>>().unwrap()
}

/// Segments of length 2 that cross at a right angle at a distance of 1, and one that touches the
/// first.
const LINES: &str = "v -1 0 0\nv 1 0 0\nv 0 -1 1\nv 0 1 1\nv 0 0 0\nv 0 5 0\nl 1 2\nl 3 4\n";

#[test]
fn integrals_of_open_curves_are_printed_with_their_bounds() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "lines.obj", LINES);
    let found = json(&["certify", "--open", text(&model)], 0);
    assert_eq!(
        (found.len(), &found[0]["i"], &found[0]["j"]),
        (1, &0.into(), &1.into())
    );
    // The solid angle of one face of a cube, divided by 4 pi.
    let [value, bound] = ["integral", "bound"].map(|key| found[0][key].as_f64().unwrap());
    assert!(
        (value.abs() - 1.0 / 6.0).abs() <= bound && bound < 1e-12,
        "{value} {bound}"
    );

    let skipped = json(&["certify", "--open", "--at-least", "0.2", text(&model)], 0);
    assert!(skipped.is_empty());
    let touching = write(folder.path(), "touching.obj", &format!("{LINES}l 5 6\n"));
    let run = linkwatch(&["certify", "--open", text(&touching)]);
    assert_eq!((run.code, run.stdout.lines().count()), (3, 3));
    assert!(
        run.stderr.contains("curves 0 and 2: undecided"),
        "{}",
        run.stderr
    );
}

#[test]
fn ribbons_have_linking_number_twist_and_writhe() {
    let scene = "ribbon:segments=400,lambda=3";
    let found = json(&["measure", "writhe", scene, "--ribbon", "0,1"], 0);
    assert_eq!(
        (&found[0]["linking"], &found[0]["passages"]),
        (&3.into(), &0.into())
    );
    let [residual, bound] =
        ["value", "bound"].map(|key| found[0]["residual"][key].as_f64().unwrap());
    assert!(residual.abs() <= bound && bound <= 1e-3);
    let pairs = json(
        &[
            "measure",
            "writhe",
            scene,
            "--ribbon",
            "pairs",
            "--axis-first",
        ],
        0,
    );
    assert_eq!((pairs.len(), &pairs[0]["axis"]), (1, &"first".into()));
    let each = json(&["measure", "writhe", scene], 0);
    assert_eq!((each.len(), &each[1]["curve"]), (2, &1.into()));
}

/// Writes a circle of DNA of 105 base pairs and 10 turns, its second strand reversed and shifted.
fn dna(folder: &Path, shift: usize) -> PathBuf {
    use std::f64::consts::{PI, TAU};
    let n = 105;
    let vertex = |strand: usize, k: usize| {
        let angle = TAU * k as f64 / n as f64;
        let (z, out) = (10.0 * angle + PI * strand as f64).sin_cos();
        let radius = 0.34 * n as f64 / TAU + out;
        [radius * angle.cos(), radius * angle.sin(), z]
    };
    let second = (0..n).map(|k| vertex(1, (2 * n - 1 - k + shift) % n));
    let points = (0..n).map(|k| vertex(0, k)).chain(second);
    let vertices = points.map(|[x, y, z]| format!("v {x} {y} {z}\n"));
    let line = |from: usize| {
        let ids = (from + 1..=from + n).map(|k| k.to_string());
        format!("l {} {}\n", ids.collect::<Vec<_>>().join(" "), from + 1)
    };
    let text: String = vertices.chain([line(0), line(n)]).collect();
    write(folder, &format!("dna{shift}.obj"), &text)
}

#[test]
fn the_pairing_of_dna_is_right_printed_and_an_option() {
    let folder = tempfile::tempdir().unwrap();
    for (shift, pairing, by) in [
        (0, "antiparallel", "order"),
        (1, "antiparallel:1", "distances"),
    ] {
        let model = dna(folder.path(), shift);
        let found = json(&["measure", "writhe", text(&model), "--ribbon", "0,1"], 0);
        assert_eq!(
            (&found[0]["pairing"], &found[0]["pairing_by"]),
            (&pairing.into(), &by.into())
        );
        let twist = found[0]["twist"]["value"].as_f64().unwrap();
        assert!((twist.abs() - 10.0).abs() < 1e-6, "{twist}");
        let run = linkwatch(&["measure", "writhe", text(&model), "--ribbon", "0,1"]);
        assert!(
            run.stdout
                .contains("; antiparallel, vertex k with n - 1 - k"),
            "{}",
            run.stdout
        );
    }
    let model = dna(folder.path(), 0);
    let run = |pairing| {
        let args = [
            "measure",
            "writhe",
            text(&model),
            "--ribbon",
            "0,1",
            "--pairing",
            pairing,
        ];
        linkwatch(&args)
    };
    let shifted = run("antiparallel:1");
    assert!(
        shifted.stdout.contains("n - 1 - k + 1 (given)"),
        "{}",
        shifted.stdout
    );
    assert_eq!(shifted.code, 0, "{}", shifted.stderr);
    let wrong = run("opposite");
    assert_eq!(wrong.code, 2);
    assert!(
        wrong
            .stderr
            .contains("expected auto, parallel, antiparallel"),
        "{}",
        wrong.stderr
    );
}

#[test]
fn curves_that_are_no_ribbon_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "lines.obj", LINES);
    for (args, reason) in [
        (["--ribbon", "0,1"], "curve 0 is open"),
        (["--ribbon", "0,9"], "two different curves of 0 to 1"),
        (["--ribbon", "0"], "expected two curves"),
        (["--tolerance", "0"], "expected a number above 0"),
    ] {
        let run = linkwatch(&["measure", "writhe", text(&model), args[0], args[1]]);
        assert_eq!(run.code, 2, "{args:?}");
        assert!(run.stderr.contains(reason), "{args:?}: {}", run.stderr);
    }
}

/// A frame of two rings with a periodic cell.
const PERIODIC: &str = "7\nLattice=\"9 0 0 0 9 0 0 0 9\" \
     Properties=species:S:1:pos:R:3:molecule:I:1\n\
     C 1 1 0 1\nC 2 1 0 1\nC 2 2 1 1\nC 1 2 2 1\nC 5 5 5 2\nC 6 5 5 2\nC 6 6 5 2\n";

#[test]
fn commands_that_consider_curves_alone_refuse_a_periodic_cell() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "rings.xyz", PERIODIC);
    for (args, words) in [
        (vec!["certify", "--open"], "--cell none"),
        (vec!["certify", "--noise", "0.01"], "--cell none"),
    ] {
        let run = linkwatch(&[&args[..], &[text(&model)]].concat());
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        assert!(run.stderr.contains("periodic cell"), "{}", run.stderr);
        assert!(run.stderr.contains(words), "{}", run.stderr);
    }
    let run = linkwatch(&["certify", "--open", "--cell", "none", text(&model)]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    // The writhe of closed curves does not depend on images.
    let found = json(&["measure", "writhe", text(&model)], 0);
    assert_eq!(found.len(), 2);
}

#[test]
fn the_writhe_of_a_yarn_through_the_cell_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("yarn.npz");
    for (end, code) in [(9.0, 2), (8.0, 0)] {
        let xyz = [
            [0.0, 5.0, 5.0, 3.0, 6.0, 5.0],
            [6.0, 5.0, 5.0, end, 5.0, 5.0],
        ];
        let xyz = Positions::F64(xyz.as_flattened());
        let set = CurveSet::from_counts(Basis::Polyline, &[4], xyz).unwrap();
        let mut frame = ModelFrame::new(0, Ok(set));
        frame.info.cell = Some("9,9,9".parse().unwrap());
        let mut writer = FrameWriter::create(&path, Format::of(&path).unwrap()).unwrap();
        writer.frame(&frame).unwrap();
        writer.finish().unwrap();
        let run = linkwatch(&["measure", "writhe", text(&path)]);
        assert_eq!(run.code, code, "{}", run.stderr);
        let refused = run
            .stderr
            .contains("curve 0 runs through the periodic cell");
        assert_eq!(refused, code == 2, "{}", run.stderr);
    }
}
