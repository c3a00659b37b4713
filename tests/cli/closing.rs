//! Curves that end where they start, and curves that are closed by a long segment.

use crate::support::command::{Run, linkwatch, text};
use crate::support::polygons::squares;
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Writes two squares, linked at a shift of 0, that repeat their first points with an error.
fn rings(folder: &Path, name: &str, shift: f32, error: f64) -> PathBuf {
    let points = squares(shift);
    let (corners, _) = points.as_chunks::<3>();
    let mut obj = String::new();
    for ring in corners.as_chunks::<4>().0 {
        for [x, y, z] in ring {
            writeln!(obj, "v {x} {y} {z}").unwrap();
        }
        let [x, y, z] = ring[0];
        writeln!(obj, "v {x} {y} {}\nl -5 -4 -3 -2 -1", f64::from(z) + error).unwrap();
    }
    let path = folder.join(name);
    std::fs::write(&path, obj).unwrap();
    path
}

/// Asserts that both rings are certified as linked.
fn assert_linked(run: &Run) {
    assert_eq!(run.code, 0, "{run:?}");
    assert!(run.stdout.starts_with("2 # lines: 1\n0,1,"), "{run:?}");
}

#[test]
fn rings_that_repeat_their_first_point_are_linked_in_every_format() {
    let folder = TempDir::new().unwrap();
    let obj = rings(folder.path(), "rings.obj", 0.0, 0.0);
    let run = linkwatch(&["certify", text(&obj)]);
    assert_linked(&run);
    let says = "2 curves end where they start and are closed, without the repeated point (the \
                first one: curve 0); --keep-open";
    assert_eq!(run.stderr.matches(says).count(), 1, "{}", run.stderr);
    assert!(!run.stderr.contains("skipped"), "{}", run.stderr);
    for name in ["a.bcc", "a.vect", "a.npz", "a.mcap"] {
        let file = folder.path().join(name);
        let run = linkwatch(&["convert", "--keep-open", text(&obj), text(&file)]);
        assert_eq!(run.code, 0, "{run:?}");
        let run = linkwatch(&["certify", text(&file)]);
        assert_linked(&run);
        assert!(
            run.stderr.contains("2 curves end where they start"),
            "{name}: {run:?}"
        );
    }
    let closed = folder.path().join("closed.vect");
    assert_eq!(linkwatch(&["convert", text(&obj), text(&closed)]).code, 0);
    let written = std::fs::read_to_string(&closed).unwrap();
    assert!(written.contains("\n-4\n-4\n"), "{written}");
}

#[test]
fn ends_that_differ_by_rounding_meet_and_others_do_not() {
    let folder = TempDir::new().unwrap();
    let coil = rings(folder.path(), "coil.obj", 0.0, 5e-15);
    assert_linked(&linkwatch(&["certify", text(&coil)]));
    let run = linkwatch(&["certify", "--json", text(&coil)]);
    let json: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(
        (&json["joined_curves"], &json["left_out"]),
        (&2.into(), &Value::Array(vec![]))
    );
    let apart = rings(folder.path(), "apart.obj", 0.0, 0.05);
    for args in [
        &["certify", text(&apart)][..],
        &["certify", "--keep-open", text(&coil)],
    ] {
        let run = linkwatch(args);
        assert_eq!(run.code, 2, "{run:?}");
        assert!(
            run.stderr.contains("none of 2 curves is closed"),
            "{}",
            run.stderr
        );
    }
}

#[test]
fn a_ring_that_is_cut_later_is_rejected_and_named() {
    let folder = TempDir::new().unwrap();
    let file = |name, shift, error| rings(folder.path(), name, shift, error);
    let frames = [
        file("f0.obj", 0.0, 0.0),
        file("f1.obj", 0.0, 0.25),
        file("f2.obj", 5.0, 0.0),
    ];
    let run = linkwatch(&["check", text(&frames[0]), text(&frames[1])]);
    assert_eq!(run.code, 3, "{run:?}");
    let why = "curve 0 is closed in the first frame, but its ends are 2.5000e-1 apart now";
    assert!(run.stdout.contains(why), "{}", run.stdout);
    let run = linkwatch(&["check", "--json", text(&frames[0]), text(&frames[2])]);
    assert_eq!(run.code, 1, "{run:?}");
    let summary: Value = serde_json::from_str(run.stdout.lines().last().unwrap()).unwrap();
    assert_eq!(summary["summary"]["joined_curves"], 2);
}

#[test]
fn the_writhe_and_the_thickness_are_those_of_the_closed_curve() {
    let folder = TempDir::new().unwrap();
    let obj = rings(folder.path(), "rings.obj", 0.0, 0.0);
    let run = linkwatch(&["measure", "writhe", "--json", text(&obj)]);
    let line: Value = serde_json::from_str(run.stdout.lines().next().unwrap()).unwrap();
    assert_eq!(
        (&line["closed"], &line["segments"]),
        (&true.into(), &4.into())
    );
    let run = linkwatch(&["measure", "thickness", text(&obj)]);
    assert!(run.stdout.contains("length 16\n"), "{}", run.stdout);
}

/// A ring through the gap of a chain of twelve points.
fn chain_and_ring(closed: Option<char>) -> String {
    let column = if closed.is_some() { ":closed:L:1" } else { "" };
    let mut xyz = format!("20\nProperties=species:S:1:pos:R:3:molecule:I:1{column}\n");
    let mut atom = |at: [f64; 3], molecule: u32| {
        let [x, y, z] = at;
        write!(xyz, "C {x} {y} {z} {molecule}").unwrap();
        match closed {
            Some(flag) => writeln!(xyz, " {flag}").unwrap(),
            None => xyz.push('\n'),
        }
    };
    for k in 0..12 {
        // A bow from (0, 0, 0) to (11, 0, 0).
        let t = std::f64::consts::PI * f64::from(k) / 11.0;
        atom([f64::from(k), 4.0 * t.sin(), 0.0], 1);
    }
    for k in 0..8 {
        let t = std::f64::consts::TAU * f64::from(k) / 8.0;
        atom([5.5, t.cos(), t.sin()], 2);
    }
    xyz
}

#[test]
fn a_chain_that_only_the_format_closes_stays_open() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("chain.xyz");
    std::fs::write(&file, chain_and_ring(None)).unwrap();
    let run = linkwatch(&["certify", text(&file)]);
    assert_eq!(
        (run.code, run.stdout.as_str()),
        (0, "2 # lines: 0\n"),
        "{run:?}"
    );
    let says = "1 curve stays open (curve 0): nothing says if it is closed, and the closing \
                segment would be";
    assert!(run.stderr.contains(says), "{}", run.stderr);
    assert!(run.stderr.contains("a column closed:L:1"), "{}", run.stderr);
    assert!(
        run.stderr.contains("1 open curve skipped"),
        "{}",
        run.stderr
    );
    // It is closed if the user says so.
    let counts = "--counts=-12,-8";
    let run = linkwatch(&["certify", text(&file), counts]);
    assert!(run.stdout.starts_with("2 # lines: 1\n0,1,"), "{run:?}");
    std::fs::write(&file, chain_and_ring(Some('T'))).unwrap();
    let run = linkwatch(&["certify", text(&file)]);
    assert_eq!(run.code, 0, "{run:?}");
    assert!(run.stdout.starts_with("2 # lines: 1\n0,1,"), "{run:?}");
    let says = "1 curve is closed by a segment that is more than 2 times as long as the longest";
    assert!(run.stderr.contains(says), "{}", run.stderr);
    // A file that linkwatch writes says which curves are closed.
    let again = folder.path().join("again.npz");
    assert_eq!(linkwatch(&["convert", text(&file), text(&again)]).code, 0);
    let run = linkwatch(&["certify", text(&again)]);
    assert!(run.stdout.starts_with("2 # lines: 1\n0,1,"), "{run:?}");
}
