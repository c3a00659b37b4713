//! `linkwatch check` over several models: the frames of one motion.

use crate::support::command::{Run, linkwatch, text};
use linkwatch::{Basis, CurveSet, Positions, formats};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Polygons of a ring around `center` in the plane of two axes.
fn ring(center: [f64; 3], axes: [usize; 2], unit: f64) -> impl Iterator<Item = f64> {
    const POINTS: u32 = 20;
    (0..POINTS).flat_map(move |k| {
        let (sin, cos) = (f64::from(k) / f64::from(POINTS) * std::f64::consts::TAU).sin_cos();
        let mut p = center;
        p[axes[0]] += cos;
        p[axes[1]] += sin;
        p.map(|x| x * unit)
    })
}

/// Two rings of radius 1, in multiples of a unit. They are linked if `height` is below 1.
fn rings(height: f64, unit: f64) -> Vec<f64> {
    let first = ring([0.0; 3], [0, 1], unit);
    first
        .chain(ring([0.93, 0.1, height], [0, 2], unit))
        .collect()
}

/// Writes 11 frames of a ring that is pulled out of another one in frame 8.
pub fn motion(folder: &Path, unit: f64, closed: bool) -> Vec<String> {
    let frame = |k: u32| {
        let height = if k < 8 { 0.1 * f64::from(k) } else { 1.7 };
        let counts = [20, 20].map(|n| if closed { -n } else { n });
        let xyz: Vec<f32> = rings(height, unit).iter().map(|&x| x as f32).collect();
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap();
        let path = folder.join(format!("F{k}.bcc"));
        formats::write_bcc(&path, &set).unwrap();
        path.to_str().unwrap().to_owned()
    };
    (1..=11).map(frame).collect()
}

/// Runs `check` in a folder, so that names are short.
pub fn check(models: &[String], options: &[&str]) -> Run {
    let models: Vec<&str> = models.iter().map(String::as_str).collect();
    linkwatch(&[&["check"], &models[..], options].concat())
}

fn summary(run: &Run) -> serde_json::Value {
    let last = run.stdout.lines().last().unwrap();
    let line: serde_json::Value = serde_json::from_str(last).unwrap();
    line["summary"].clone()
}

#[test]
fn a_sequence_is_compared_with_its_first_frame_and_summarised() {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    let run = check(&models, &["--events=off"]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    let lines: Vec<&str> = run.stdout.lines().collect();
    for line in &lines[..7] {
        assert!(line.ends_with(".bcc: intact"), "{line}");
    }
    assert!(lines[7].ends_with("F8.bcc: changed"), "{}", lines[7]);
    assert!(
        lines[8].starts_with("  curves 0 and 1 came apart"),
        "{}",
        lines[8]
    );
    // The broken link is printed once.
    assert_eq!(run.stdout.matches("  curves 0 and 1").count(), 1);
    assert_eq!(
        run.stdout
            .matches("  1 finding as in the previous model")
            .count(),
        3
    );
    assert!(
        run.stdout
            .contains("\nchanged: 11 frames verified, 0 rejected; a check took")
    );
    assert!(run.stdout.contains("\nfirst violation: ") && run.stdout.contains("F8.bcc: curves "));
    assert!(!run.stdout.contains("partial") && !run.stderr.contains("partial"));
    let run = check(&models, &["-v"]);
    assert!(run.stderr.contains("DEBUG frames: "), "{}", run.stderr);
    let same = check(&models, &["--baseline", "first-frame"]);
    assert_eq!(same.code, 1);
    let first = &summary(&check(&models, &["--json"]))["first_violation"];
    assert_eq!(first["frame"], 7);
    assert_eq!(first["verdict"], "changed");
    assert_eq!(first["curves"], serde_json::json!([0, 1]));
    assert!(
        first["name"].as_str().unwrap().ends_with("F8.bcc"),
        "{first}"
    );
    assert_eq!(first["point"].as_array().unwrap().len(), 3);
}

#[test]
fn an_intact_sequence_has_a_summary_and_a_single_model_has_none() {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    let run = check(&models[..7], &["--events"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(
        run.stdout
            .contains("\nintact: 7 frames verified, 0 rejected"),
        "{}",
        run.stdout
    );
    let cert = folder.path().join("cert.txt");
    linkwatch(&["certify", &models[0], "-o", text(&cert)]);
    let run = check(&models[..1], &["--baseline", text(&cert)]);
    assert_eq!(
        (run.code, run.stdout.lines().count()),
        (0, 1),
        "{}",
        run.stdout
    );
    // A model compared with itself proves nothing.
    let run = check(&models[..1], &[]);
    assert_eq!((run.code, run.stdout.as_str()), (2, ""));
    assert!(
        run.stderr.contains("nothing to compare it with"),
        "{}",
        run.stderr
    );
}

/// Regression test: in the order `F1 F10 F11 F2`, false pull-throughs were reported.
#[test]
fn numbered_models_are_verified_in_numerical_order() {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    let mut shell = models.clone();
    shell.sort();
    assert_ne!(shell, models);
    let names = |run: &Run| -> Vec<String> {
        let lines = run.stdout.lines().filter(|l| !l.starts_with(' '));
        let names = lines.filter_map(|l| l.split_once(".bcc: ").map(|l| l.0));
        names
            .filter(|n| !n.contains(' '))
            .map(|n| format!("{n}.bcc"))
            .collect()
    };
    let run = check(&shell, &["--events"]);
    assert_eq!(names(&run), models, "{}", run.stdout);
    assert!(
        run.stderr.contains("sorted by the numbers in their names"),
        "{}",
        run.stderr
    );
    assert!(run.stderr.contains("--keep-order"), "{}", run.stderr);
    let run = check(&shell, &["--events", "--keep-order"]);
    assert_eq!(names(&run), shell, "{}", run.stdout);
    assert!(!run.stderr.contains("sorted"), "{}", run.stderr);
}

/// Live frames, recordings and models follow the same rule.
#[test]
fn a_model_with_invalid_content_is_a_rejected_frame() {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    let bytes = std::fs::read(&models[1]).unwrap();
    // The first coordinate follows the header of 64 bytes and the count of the first curve.
    let mut nan = bytes.clone();
    nan[68..72].copy_from_slice(&f32::NAN.to_le_bytes());
    for (content, says) in [
        (nan, "curve 0, point 0: coordinate x is NaN"),
        (bytes[..bytes.len() - 4].to_vec(), "not a valid BCC"),
        (b"something else".to_vec(), "not a valid BCC"),
    ] {
        std::fs::write(&models[1], content).unwrap();
        let run = check(&models[..3], &["--events"]);
        assert_eq!(run.code, 3, "{}", run.stderr);
        assert!(
            run.stdout.contains(&format!("F2.bcc: rejected\n  {says}")),
            "{}",
            run.stdout
        );
        assert!(run.stdout.contains("F3.bcc: intact"), "{}", run.stdout);
        assert!(
            run.stdout.contains("2 frames verified, 1 rejected"),
            "{}",
            run.stdout
        );
    }
    // A frame with other curves than before is rejected as well.
    let xyz: Vec<f32> = rings(0.0, 1.0)[..60].iter().map(|&x| x as f32).collect();
    let set = CurveSet::from_counts(Basis::Polyline, &[-20], Positions::F32(&xyz)).unwrap();
    formats::write_bcc(Path::new(&models[1]), &set).unwrap();
    let run = check(&models[..3], &[]);
    assert_eq!(run.code, 3, "{}", run.stderr);
    let says =
        "F2.bcc: rejected\n  the curves changed between frames: number of curves was 2, is 1";
    assert!(run.stdout.contains(says), "{}", run.stdout);
    // A missing file is bad input; the others still get their verdicts.
    std::fs::remove_file(&models[1]).unwrap();
    let run = check(&models[..3], &[]);
    assert_eq!(run.code, 2, "{}", run.stderr);
    assert!(run.stdout.contains("F3.bcc: intact"), "{}", run.stdout);
    assert!(
        run.stdout.contains("undecided or incomplete: 2 frames"),
        "{}",
        run.stdout
    );
}

#[test]
fn places_have_six_significant_digits_in_any_unit() {
    let folder = TempDir::new().unwrap();
    for (unit, factor) in [(1.0, ""), (1e-9, " x 10^-9"), (1e12, " x 10^12")] {
        let models = motion(folder.path(), unit, true);
        let run = check(&models, &["--events"]);
        assert_eq!(run.code, 1, "{}", run.stderr);
        let place = run.stdout.split_once("is 0, near ").unwrap().1;
        let place = place.lines().next().unwrap();
        let expected = format!("(0.95642, 0.10418, 0.35000){factor}, segments 0 and 14, ");
        assert!(place.starts_with(&expected), "{place}");
        assert!(place.contains(&format!("{factor} apart")), "{place}");
        assert!(
            !run.stdout.contains("-0.0000") && !run.stdout.contains("e-"),
            "{}",
            run.stdout
        );
    }
}

#[test]
fn open_curves_are_verified_for_pull_throughs_and_reported_without() {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, false);
    let run = check(&models, &[]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    assert!(
        run.stdout
            .contains("curves 0 and 1 passed through one another"),
        "{}",
        run.stdout
    );
    assert!(
        run.stdout
            .contains("2 open curves verified for pull-throughs"),
        "{}",
        run.stdout
    );
    for says in ["skipped", "not verified"] {
        let text = [&run.stdout[..], &run.stderr].concat();
        assert!(!text.contains(says), "{text}");
    }
    let run = check(&models, &["--events=off"]);
    assert_eq!(
        (run.code, run.stdout.lines().count()),
        (2, 0),
        "{}",
        run.stdout
    );
    assert!(
        run.stderr
            .contains("open ones are verified by a search for pull-throughs")
    );
    assert_eq!(
        run.stderr.matches("nothing to verify").count(),
        1,
        "{}",
        run.stderr
    );
}

/// Regression test: the summary claimed that the open curve was verified for pull-throughs.
#[test]
fn an_open_curve_of_a_single_frame_is_not_verified() {
    let folder = TempDir::new().unwrap();
    let write = |name: &str, count: i32| {
        let xyz: Vec<f32> = rings(9.0, 1.0).iter().map(|&x| x as f32).collect();
        let positions = Positions::F32(&xyz);
        let set = CurveSet::from_counts(Basis::Polyline, &[-20, count], positions).unwrap();
        let path = folder.path().join(name);
        formats::write_bcc(&path, &set).unwrap();
        text(&path).to_owned()
    };
    let [closed, open] = [write("closed.bcc", -20), write("open.bcc", 20)];
    let run = check(&[closed, open.clone()], &[]);
    assert!(!run.stderr.contains("not verified"), "{}", run.stderr);
    let certificate = folder.path().join("closed.txt");
    let closed = folder.path().join("closed.bcc");
    linkwatch(&["certify", text(&closed), "-o", text(&certificate)]);
    let options = ["--events=between", "--baseline", text(&certificate)];
    let run = check(std::slice::from_ref(&open), &options);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let says = "1 open curve not verified: open curves are searched";
    assert!(run.stderr.contains(says), "{}", run.stderr);
}

/// Two squares that touch in the first frame only.
#[test]
fn a_baseline_takes_the_number_of_an_undefined_pair_once() {
    let folder = TempDir::new().unwrap();
    let frame = |name: &str, at: f32| super::chain(folder.path(), name, at);
    let [touching, apart] = [frame("touching.bcc", 2.0), frame("apart.bcc", 5.0)];
    let cert = folder.path().join("cert.txt");
    let run = linkwatch(&["certify", text(&touching), "-o", text(&cert)]);
    assert_eq!(run.code, 3, "{}", run.stderr);
    let written = std::fs::read_to_string(&cert).unwrap();
    assert!(written.contains("\n0,1,undefined\n"), "{written}");
    let check = |models: &[&Path]| {
        let models = models.iter().map(|m| text(m));
        let args: Vec<&str> = [
            "check",
            "--events=off",
            "--keep-order",
            "--baseline",
            text(&cert),
        ]
        .into_iter()
        .chain(models)
        .collect();
        linkwatch(&args)
    };
    // A pair that stays undefined is not a change, but proves nothing.
    let run = check(&[&touching, &touching]);
    assert_eq!(run.code, 3, "{}", run.stdout);
    assert_eq!(
        run.stdout.matches("  curves 0 and 1 touch").count(),
        1,
        "{}",
        run.stdout
    );
    assert!(!run.stdout.contains("changed"), "{}", run.stdout);
    let again = folder.path().join("again.bcc");
    std::fs::copy(&apart, &again).unwrap();
    let run = check(&[&touching, &apart, &again]);
    assert_eq!(run.code, 3, "{}", run.stdout);
    let says = "curves 0 and 1 had no linking number to compare with until now, near (2.50000, ";
    assert_eq!(run.stdout.matches(says).count(), 1, "{}", run.stdout);
    assert!(
        run.stdout.contains("0 is expected from here on"),
        "{}",
        run.stdout
    );
    assert!(run.stdout.contains("again.bcc: intact"), "{}", run.stdout);
}

/// Regression test: the message was `error: edge: edge: unknown kind of file`.
#[test]
fn a_file_that_is_no_model_is_named_once() {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    let notes = folder.path().join("notes.txt");
    std::fs::write(&notes, "x").unwrap();
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    for other in [&empty, &notes] {
        let other = text(other).to_owned();
        let run = check(&[models[0].clone(), other.clone()], &[]);
        assert_eq!(run.code, 2);
        let error = run.stderr.lines().last().unwrap();
        assert!(error.starts_with(&format!("error: {other}: ")), "{error}");
        let named = error
            .split(' ')
            .filter(|w| *w == format!("{other}:"))
            .count();
        assert_eq!(named, 1, "{error}");
    }
}

#[test]
fn the_error_of_a_model_as_a_certificate_says_so() {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    let run = check(&models[..1], &["--baseline", &models[1]]);
    assert_eq!(run.code, 2);
    let says = format!("`linkwatch certify {} -o CERT` writes one", models[1]);
    assert!(run.stderr.contains(&says), "{}", run.stderr);
    assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
}

/// A curve with wrapped coordinates may look intact, although it is not verified correctly.
#[test]
fn warns_once_of_a_segment_longer_than_half_the_scene() {
    let folder = TempDir::new().unwrap();
    let frame = |k: u32, wrapped: bool| {
        let xyz = rings(0.1 * f64::from(k), 1.0);
        // A box of 3 from -1.5 to 1.5.
        let wrap = |x: f64| match wrapped {
            true => (x + 1.5).rem_euclid(3.0) - 1.5,
            false => x,
        };
        let xyz: Vec<f32> = xyz.iter().map(|&x| wrap(x) as f32).collect();
        let set = CurveSet::from_counts(Basis::Polyline, &[-20; 2], Positions::F32(&xyz)).unwrap();
        let path = folder.path().join(format!("F{k}.bcc"));
        formats::write_bcc(&path, &set).unwrap();
        path.to_str().unwrap().to_owned()
    };
    for wrapped in [true, false] {
        let models = [0, 1, 2].map(|k| frame(k, wrapped));
        let checked = check(&models, &["--events"]);
        let certified = linkwatch(&["certify", &models[0]]);
        for run in [checked, certified] {
            let warnings = run.stderr.matches("give --cell and --wrapped").count();
            assert_eq!(warnings, usize::from(wrapped), "{}", run.stderr);
        }
    }
}

/// Frames from files are recorded and shown like live ones.
#[test]
#[cfg(feature = "rerun")]
fn a_recorded_sequence_gives_the_same_verdicts_again() {
    let folder = TempDir::new().unwrap();
    let models = motion(folder.path(), 1.0, true);
    let [recording, rrd] = ["run.mcap", "run.rrd"].map(|name| folder.path().join(name));
    let sinks = [
        "--record",
        text(&recording),
        "--show",
        text(&rrd),
        "--json",
        "--events",
    ];
    let run = check(&models, &sinks);
    assert_eq!(run.code, 1, "{}", run.stderr);
    assert!(std::fs::metadata(&rrd).unwrap().len() > 1000);
    let replayed = linkwatch(&["replay", text(&recording), "--json"]);
    assert_eq!(replayed.code, 1, "{}", replayed.stderr);
    let reports = |run: &Run| -> Vec<serde_json::Value> {
        let lines = run.stdout.lines().map(|l| serde_json::from_str(l).unwrap());
        lines
            .map(|l: serde_json::Value| l["report"].clone())
            .collect()
    };
    assert_eq!(reports(&run), reports(&replayed));
    let run = check(&models, &["--record", text(&recording)]);
    assert_eq!(run.code, 2, "the recording exists");
}

/// Returns a folder of two equal models, within one that is deleted.
fn folder_of_two_models() -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    let models = folder.path().join("models");
    std::fs::create_dir(&models).unwrap();
    crate::chain(&models, "f0.bcc", 0.5);
    crate::chain(&models, "f1.bcc", 0.5);
    (folder, models)
}

/// Regression test: the compressed frames were skipped, and the others were intact.
#[test]
fn a_folder_with_compressed_models_is_refused() {
    let (_folder, models) = folder_of_two_models();
    let check = || linkwatch(&["check", text(&models)]);
    assert_eq!(check().code, 0);
    std::fs::write(models.join("notes.txt.gz"), "").unwrap();
    std::fs::write(models.join("f1.bcc.gz"), "").unwrap();
    assert_eq!(check().code, 0);
    std::fs::write(models.join("f2.bcc.gz"), "").unwrap();
    let refused = check();
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(
        refused
            .stderr
            .contains("f2.bcc.gz is compressed: decompress it"),
        "{}",
        refused.stderr
    );
}

/// Regression test: these frames were skipped, and the others were intact.
#[test]
fn a_folder_with_files_that_only_the_package_reads_is_refused() {
    let (_folder, models) = folder_of_two_models();
    std::fs::write(models.join("f2.vtp"), "").unwrap();
    let refused = linkwatch(&["check", text(&models)]);
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    let says = "f2.vtp is read by the Python package alone: give a pattern, or the files";
    assert!(refused.stderr.contains(says), "{}", refused.stderr);
}

/// Regression test: the frame that was recorded as changed was intact in the replay.
#[test]
fn a_replay_that_cannot_repeat_a_violation_is_not_intact() {
    let folder = TempDir::new().unwrap();
    let files = motion(folder.path(), 1.0, false);
    let recording = folder.path().join("run.mcap");
    let mut args = vec!["check", "--record", text(&recording)];
    args.extend(files.iter().map(String::as_str));
    assert_eq!(linkwatch(&args).code, 1);
    let replayed = linkwatch(&["replay", text(&recording), "--from", "7"]);
    assert_eq!(replayed.code, 3, "{}", replayed.stdout);
    let says = "worse in the recording";
    assert!(replayed.stdout.contains(says), "{}", replayed.stdout);
}
