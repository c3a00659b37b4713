//! `linkwatch sweep`: tables, plots, JSON, exit codes and bad ranges.

use crate::support::command::{linkwatch, text};
use serde_json::Value;
use tempfile::TempDir;

const KNIT: &str = "knit:rows=3,stitches=16,segments=1152";

/// All pull-throughs of this knit cancel, because it is symmetric: its rows stay unlinked in every
/// step, and only the motion from step to step shows that they break.
#[test]
fn a_sweep_that_breaks_a_knit_names_the_step_and_its_curves() {
    let folder = TempDir::new().unwrap();
    let plot = folder.path().join("plot.svg");
    let args = [
        "sweep",
        KNIT,
        "--resample",
        "1.0..0.1",
        "--plot",
        text(&plot),
    ];
    let run = linkwatch(&args);
    assert_eq!(run.code, 1, "{}", run.stderr);
    assert!(run.stdout.contains("intact down to "), "{}", run.stdout);
    assert!(
        run.stdout.contains("3 curves broken: 0, 1, 2"),
        "{}",
        run.stdout
    );
    assert!(
        run.stdout.contains("passed through one another"),
        "{}",
        run.stdout
    );
    assert!(!run.stdout.contains("became linked"), "{}", run.stdout);
    let rows = run
        .stdout
        .lines()
        .filter(|line| line.contains("% of the points "));
    assert!(rows.count() >= 19, "{}", run.stdout);
    let svg = std::fs::read_to_string(&plot).unwrap();
    assert!(svg.contains("broken at ") && svg.contains("</svg>"));
    let again = linkwatch(&args);
    assert_eq!(again.code, 2);
    assert!(again.stderr.contains("--force"), "{}", again.stderr);
}

#[test]
fn a_sweep_without_findings_is_intact() {
    let run = linkwatch(&[
        "--json",
        "sweep",
        KNIT,
        "--quantize",
        "16..12",
        "--step",
        "2",
    ]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let lines: Vec<Value> = run
        .stdout
        .lines()
        .map(|l| serde_json::from_str(l).unwrap())
        .collect();
    let bits: Vec<u64> = lines.iter().filter_map(|l| l["bits"].as_u64()).collect();
    assert_eq!(bits, [16, 14, 12]);
    assert!(lines[..3].iter().all(|l| l["verdict"] == "intact"));
    assert_eq!(lines[3]["conclusion"], "intact down to 12 bits");
    assert_eq!(lines[3]["first_not_intact"], Value::Null);
}

/// Coordinates on a coarse grid make curves touch, which is no proof of a change.
#[test]
fn a_sweep_that_only_touches_is_undecided() {
    let run = linkwatch(&["sweep", "chainmail:rows=2,columns=2", "--quantize", "8..2"]);
    assert_eq!(run.code, 3, "{}", run.stdout);
    assert!(run.stdout.contains("undecided at "), "{}", run.stdout);
    assert!(run.stdout.contains(" touch, near "), "{}", run.stdout);
}

#[test]
fn bad_ranges_are_refused_with_a_reason() {
    for (more, words) in [
        (&["--quantize", "8..24"][..], "fine to coarse"),
        (&["--quantize", "60..8"], "1 to 52"),
        (&["--resample", "0.5..1.0"], "fine to coarse"),
        (&["--resample", "1.0..0"], "above 0"),
        (&["--resample", "1.0..0.5", "--step", "0"], "above 0"),
        (
            &["--resample", "1.0..0.5", "--step", "1e-9"],
            "1000 or fewer",
        ),
        (&["--quantize", "8..4", "--step", "0.5"], "whole number"),
        (&["--resample", "0.001"], "leaves 0 of"),
        (
            &["--resample", "1", "--quantize", "8"],
            "cannot be used with",
        ),
        (&[], "--quantize"),
    ] {
        let run = linkwatch(&[&["sweep", KNIT], more].concat());
        assert_eq!(run.code, 2, "{more:?}: {}", run.stdout);
        assert!(run.stderr.contains(words), "{more:?}: {}", run.stderr);
    }
}

/// A ring that is linked with the image of another one, and a yarn that runs through the cell.
#[test]
fn a_sweep_in_a_cell_verifies_the_images() {
    let folder = TempDir::new().unwrap();
    let write = |name: &str, yarn: &str| {
        let rings = "v 0 0 0\nv 3 0 0\nv 3 3 0\nv 0 3 0\nv 9.5 1 -1\nv 12 1 -1\nv 12 1 1\n\
                     v 9.5 1 1\nl 1 2 3 4 1\nl 5 6 7 8 5\n";
        let path = folder.path().join(name);
        std::fs::write(&path, format!("{rings}{yarn}")).unwrap();
        path
    };
    let model = write("rings.obj", "");
    let args = ["sweep", text(&model), "--quantize", "16..2"];
    let links = |args: &[&str]| -> (i32, String) {
        let run = linkwatch(args);
        (run.code, format!("{}{}", run.stdout, run.stderr))
    };
    let (_, alone) = links(&args);
    assert!(alone.contains("0 links"), "{alone}");
    let (code, found) = links(&[&args[..], &["--cell", "10,10,10"]].concat());
    assert!(found.contains("1 link"), "{found}");
    assert!(
        code == 1 && found.contains("image -1,0,0"),
        "{code}: {found}"
    );
    let yarn = write("yarn.obj", "v 0 0 5\nv 5 1 5\nv 10 0 5\nl 9 10 11\n");
    let args = ["sweep", text(&yarn), "--cell", "10,10,10"];
    let (code, why) = links(&[&args[..], &["--quantize", "16..8"]].concat());
    assert!(code == 2 && why.contains("curve 2 runs through"), "{why}");
    let (code, found) = links(&[&args[..], &["--resample", "1.0..0.9"]].concat());
    assert_eq!(code, 0, "{found}");
}
