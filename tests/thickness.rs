//! `linkwatch measure thickness`, and its values against those of liboctrope for real models.
//!
//! Without the models, the test of their values is shown as ignored, never as passed.

mod support;

use libtest_mimic::{Arguments, Failed};
use serde_json::Value;
use std::path::{Path, PathBuf};
use support::command::{linkwatch, text};
use support::trial::trial;

fn measure(args: &[&str]) -> Vec<Value> {
    let run = linkwatch(&[&["measure", "thickness", "--json"], args].concat());
    assert_eq!(run.code, 0, "{args:?}: {}", run.stderr);
    let lines = run.stdout.lines().map(serde_json::from_str);
    lines.collect::<Result<_, _>>().expect("lines of JSON")
}

fn write(folder: &Path, name: &str, content: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, content).expect("a file");
    path
}

/// Two lines that cross at a distance of 0.25, and a square that is far away.
const SCENE: &str = "v 0 0 0\nv 1 0 0\nv 0.5 -1 0.25\nv 0.5 1 0.25\n\
     v 9 0 0\nv 11 0 0\nv 11 2 0\nv 9 2 0\nl 1 2\nl 3 4\nl 5 6 7 8 5\n";

fn values_and_places_are_printed() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let model = write(folder.path(), "scene.obj", SCENE);
    let lines = measure(&[text(&model), "--struts", "0.5", "--radius", "0.2"]);
    let found = &lines[0];
    assert_eq!(found["length"], 11.0);
    assert_eq!(found["poca"], 0.25);
    assert_eq!(found["thickness"], 0.25);
    assert_eq!(found["ropelength"], 44.0);
    let bend = found["min_rad"].as_f64().expect("a bend");
    assert!((bend - 1.0).abs() < 1e-15, "{bend}");
    let ends = &found["poca_at"]["ends"];
    assert_eq!([&ends[0]["curve"], &ends[1]["curve"]], [0, 1]);
    assert_eq!(ends[1]["point"], serde_json::json!([0.5, 0.0, 0.25]));
    assert_eq!(found["struts"].as_array().expect("struts").len(), 1);
    let depth = found["overlaps"][0]["depth"].as_f64().expect("an overlap");
    assert!((depth - 0.15).abs() < 1e-15, "{depth}");

    let printed = linkwatch(&["measure", "thickness", text(&model), "--radius", "0.2"]).stdout;
    for words in [
        "scene.obj: thickness 0.25, ropelength 44, length 11",
        "curve 2 bends to a radius of 1, at (",
        "curves 0 and 1 are 0.25 apart, from (0.5000, 0.0000, 0.0000) to (0.5000, 0.0000, 0.2500), \
         segments 0 and 0",
        "1 overlap of strands of radius 0.2",
        "37.50 % of the diameter: curves 0 and 1",
    ] {
        assert!(printed.contains(words), "{words}: {printed}");
    }
    Ok(())
}

/// A closed spline whose last control point equals its first one, as many programs write them.
fn doubled_control_points_are_named_and_skipped() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let points = [
        [2.0_f32, 0.0, 0.0],
        [0.0, 2.0, 0.0],
        [-2.0, 0.0, 0.0],
        [0.0, -2.0, 0.0],
    ];
    let mut bytes = b"BCC\x44C0\x03\x00".to_vec();
    bytes.extend([1_u64, 5].iter().flat_map(|n| n.to_le_bytes()));
    bytes.extend([0; 40]);
    bytes.extend((-5_i32).to_le_bytes());
    let all = points.iter().chain(&points[..1]).flatten();
    bytes.extend(all.flat_map(|x| x.to_le_bytes()));
    let model = folder.path().join("closed.bcc");
    std::fs::write(&model, bytes)?;
    let run = linkwatch(&["measure", "thickness", text(&model)]);
    let words = "1 doubled control point, first point 4 of curve 0: --skip-doubled counts it once";
    assert!(run.stderr.contains(words), "{}", run.stderr);
    let run = linkwatch(&[
        "measure",
        "thickness",
        "--json",
        "--skip-doubled",
        text(&model),
    ]);
    assert!(run.stderr.contains("counted once"), "{}", run.stderr);
    let found: Value = serde_json::from_str(&run.stdout)?;
    let thickness = found["thickness"].as_f64().expect("a number");
    // The four points bend the curve to a radius of one half.
    assert!((thickness - 1.0).abs() < 1e-3, "{found}");
    Ok(())
}

fn stiffness_divides_the_bend() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let square = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nl 1 2 3 4 1\n";
    let model = write(folder.path(), "square.obj", square);
    let lines = measure(&[text(&model), "--stiffness", "4"]);
    let thickness = lines[0]["thickness"].as_f64().expect("a number");
    assert!((thickness - 0.5).abs() < 1e-15, "{thickness}");
    let straight = write(folder.path(), "line.obj", "v 0 0 0\nv 2 0 0\nl 1 2\n");
    let lines = measure(&[text(&straight)]);
    for value in ["min_rad", "poca", "thickness"] {
        assert!(lines[0][value].is_null(), "{value}: {}", lines[0]);
    }
    assert_eq!(lines[0]["ropelength"], 0.0);
    Ok(())
}

/// A ring that is 0.5 away from its image along x, and a yarn that runs through the cell along y.
const PERIODIC: &str = "v 0 0 0\nv 3.5 0 0\nv 3.5 0 1\nv 0 0 1\nv 1 0 5\nv 1 4 5\n\
     l 1 2 3 4 1\nl 5 6\n";

fn images_are_counted_in_a_cell() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let model = write(folder.path(), "periodic.obj", PERIODIC);
    let cell = ["--wrapped=false", "--cell", "4,4,0"];
    let found = &measure(&[&[text(&model)], &cell[..], &["--struts", "0.1"]].concat())[0];
    assert_eq!(found["thickness"], 0.5);
    assert_eq!(found["poca_at"]["image"], serde_json::json!([1, 0, 0]));
    assert!(!found["struts"].as_array().expect("struts").is_empty());
    let run = linkwatch(&[&["measure", "thickness", text(&model)], &cell[..]].concat());
    let words = "curve 0 and its image 1,0,0 are 0.5 apart, from (3.5";
    assert!(run.stdout.contains(words), "{}", run.stdout);
    // Without a cell, the images do not count.
    let found = &measure(&[text(&model)])[0];
    assert_eq!(found["poca"], 1.0);
    let e = linkwatch(&[
        "measure",
        "thickness",
        text(&model),
        "--wrapped=false",
        "--cell",
        "1e-9,0,0",
    ]);
    assert_eq!(e.code, 2);
    assert!(e.stderr.contains("too many periodic cells"), "{}", e.stderr);
    Ok(())
}

fn bad_arguments_are_refused() -> Result<(), Failed> {
    for (args, words) in [
        (vec!["measure", "thickness"], "MODEL|SCENE"),
        (vec!["measure", "thickness", "missing.obj"], "missing.obj"),
        (
            vec!["measure", "thickness", "knit", "--radius", "0"],
            "a number above 0",
        ),
        (
            vec!["measure", "thickness", "knit", "--stiffness", "nan"],
            "a number above 0",
        ),
        (
            vec!["measure", "thickness", "knit", "--radius", "published"],
            "the curves have no radii",
        ),
    ] {
        let run = linkwatch(&args);
        assert_eq!(run.code, 2, "{args:?}");
        assert!(run.stderr.contains(words), "{args:?}: {}", run.stderr);
    }
    Ok(())
}

/// Folder of the real models, if it is there.
fn models() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/models");
    folder.join("octrope.json").exists().then_some(folder)
}

fn real_models_have_the_values_of_liboctrope() -> Result<(), Failed> {
    let folder = models().ok_or("no models")?;
    let content = std::fs::read_to_string(folder.join("octrope.json"))?;
    let known: Value = serde_json::from_str(&content)?;
    let mut compared = 0;
    for curve in known["curves"].as_array().ok_or("no curves")? {
        let name = curve["name"].as_str().ok_or("no name")?;
        if !name.ends_with(".vect") {
            continue;
        }
        let lines = measure(&[text(&folder.join(name))]);
        // liboctrope gives a radius, and the quotient of length and radius.
        for (ours, theirs, factor) in [
            ("length", "length", 1.0),
            ("min_rad", "minrad", 1.0),
            ("poca", "poca", 1.0),
            ("thickness", "thickness", 2.0),
            ("ropelength", "ropelength", 0.5),
        ] {
            let wanted = factor * curve[theirs].as_f64().ok_or("no value")?;
            let found = lines[0][ours].as_f64().ok_or("no value")?;
            let error = (found / wanted - 1.0).abs();
            assert!(error < 1e-9, "{name}: {ours} {found}, expected {wanted}");
        }
        compared += 1;
    }
    assert!(compared >= 7, "{compared} models");
    Ok(())
}

fn main() {
    let args = Arguments::from_args();
    let trials = vec![
        trial(
            "values_and_places_are_printed",
            true,
            values_and_places_are_printed,
        ),
        trial(
            "doubled_control_points_are_named_and_skipped",
            true,
            doubled_control_points_are_named_and_skipped,
        ),
        trial(
            "stiffness_divides_the_bend",
            true,
            stiffness_divides_the_bend,
        ),
        trial(
            "images_are_counted_in_a_cell",
            true,
            images_are_counted_in_a_cell,
        ),
        trial("bad_arguments_are_refused", true, bad_arguments_are_refused),
        trial(
            "real_models_have_the_values_of_liboctrope",
            models().is_some(),
            real_models_have_the_values_of_liboctrope,
        ),
    ];
    libtest_mimic::run(&args, trials).exit();
}
