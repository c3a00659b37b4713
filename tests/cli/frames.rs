//! Files of several frames: one result a frame, and several runs.

use super::cells::{polygon, write};
use crate::support::command::{linkwatch, text};
use linkwatch::formats::{Format, FrameWriter, ModelFrame};
use linkwatch::{Basis, CurveSet, FrameInfo, Positions};
use serde_json::Value;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Writes one frame of two squares for each shift. They are linked at a shift of 0, and apart at 5.
fn squares(folder: &Path, name: &str, shifts: &[f64]) -> PathBuf {
    let frame = |&shift: &f64| {
        let ring = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let other = ring.map(|[x, z]| [x + 1.0 + shift, 0.0, z]);
        [
            polygon(ring.map(|[x, y]| [x, y, 0.0]), 1),
            polygon(other, 1),
        ]
    };
    let frames: Vec<_> = shifts.iter().map(frame).collect();
    write(folder, name, None, &frames)
}

fn json_lines(stdout: &str) -> Vec<Value> {
    let lines = stdout.lines();
    lines
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

#[test]
fn each_frame_is_a_line_with_its_number_and_time() {
    let folder = TempDir::new().unwrap();
    let model = squares(folder.path(), "run.npz", &[0.0, 0.1, 5.0]);
    let name = text(&model);
    let run = linkwatch(&["certify", name]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let lines: Vec<&str> = run.stdout.lines().collect();
    assert_eq!(lines.len(), 3, "{}", run.stdout);
    assert!(lines[0].starts_with(&format!("{name}, frame 0: 2 curves of 8 segments")));
    assert!(lines[1].starts_with(&format!("{name}, frame 1 at 0.5 s: ")));
    assert!(
        lines[1].ends_with(": 0,1,-1") || lines[1].ends_with(": 0,1,1"),
        "{}",
        lines[1]
    );
    assert!(lines[2].starts_with(&format!("{name}, frame 2 at 1 s: ")));
    assert!(lines[2].contains(" 0 links "), "{}", lines[2]);
    let run = linkwatch(&["measure", "thickness", name]);
    assert_eq!(
        (run.code, run.stdout.lines().count()),
        (0, 3),
        "{}",
        run.stdout
    );
    assert!(run.stdout.contains(", frame 2 at 1 s: thickness "));
    // One line per curve.
    let run = linkwatch(&["measure", "writhe", name]);
    assert_eq!(
        (run.code, run.stdout.lines().count()),
        (0, 6),
        "{}",
        run.stdout
    );
    assert!(run.stdout.contains(", frame 2 at 1 s: curve 1: writhe "));
    for (command, objects) in [("certify", 3), ("thickness", 3), ("writhe", 6)] {
        let run = linkwatch(&[command, name, "--json"]);
        let all = json_lines(&run.stdout);
        assert_eq!(all.len(), objects, "{command}");
        let last = all.last().unwrap();
        assert_eq!(
            (&last["frame"], &last["time"]),
            (&2.into(), &1.0.into()),
            "{command}"
        );
    }
    let run = linkwatch(&["measure", "writhe", name, "--ribbon", "0,1", "--json", "-q"]);
    assert_eq!(json_lines(&run.stdout).len(), 3);
}

#[test]
fn frames_are_chosen_by_number_by_range_and_from_the_end() {
    let folder = TempDir::new().unwrap();
    let model = squares(folder.path(), "run.npz", &[0.0, 0.1, 5.0, 6.0]);
    let name = text(&model);
    // A single frame is printed like the frame of a file with one frame.
    let one = linkwatch(&["certify", name, "--frame", "2"]);
    assert_eq!((one.code, one.stdout.as_str()), (0, "2 # lines: 0\n"));
    let frames = |selection: &str| {
        let run = linkwatch(&["measure", "thickness", name, "--frame", selection, "--json"]);
        let all = json_lines(&run.stdout);
        all.iter()
            .map(|line| line["frame"].as_u64().unwrap())
            .collect::<Vec<_>>()
    };
    assert_eq!(frames("1"), [1]);
    assert_eq!(frames("last"), [3]);
    assert_eq!(frames("1..2"), [1, 2]);
    assert_eq!(frames("2..99"), [2, 3]);
    assert_eq!(frames("all"), [0, 1, 2, 3]);
    let run = linkwatch(&["certify", name, "--frame", "2..99"]);
    assert!(
        run.stderr.contains("no frame 99: the last one is 3"),
        "{}",
        run.stderr
    );
    let last = linkwatch(&["certify", name, "--frame", "last"]);
    assert!(last.stderr.contains("frame 3"), "{}", last.stderr);
    let none = linkwatch(&["measure", "writhe", name, "--frame", "7"]);
    assert_eq!(none.code, 2);
    assert!(none.stderr.contains("no frame 7"), "{}", none.stderr);
}

#[test]
fn a_file_of_one_result_takes_one_frame() {
    let folder = TempDir::new().unwrap();
    let model = squares(folder.path(), "run.npz", &[0.0, 5.0]);
    let certificate = folder.path().join("c.txt");
    let pictures = folder.path().join("pictures");
    for (option, file) in [("-o", &certificate), ("--svg", &pictures)] {
        let run = linkwatch(&["certify", text(&model), option, text(file)]);
        assert_eq!(run.code, 2);
        let expected = format!("the file has several frames, and {option} takes one");
        assert!(run.stderr.contains(&expected), "{}", run.stderr);
        let run = linkwatch(&["certify", text(&model), option, text(file), "--frame", "1"]);
        assert_eq!(run.code, 0, "{}", run.stderr);
    }
    assert_eq!(
        std::fs::read_to_string(&certificate).unwrap(),
        "2 # lines: 0\n"
    );
}

#[test]
fn a_frame_that_was_rejected_when_it_was_recorded_is_no_success() {
    let folder = TempDir::new().unwrap();
    let frame = "3\nProperties=species:S:1:pos:R:3:mol:I:1\nC 0 0 0 1\nC 1 0 0 1\nC 0 1 0 1\n";
    let invalid = frame.replace("C 1 0 0 1", "C nan 0 0 1");
    let (model, recording) = (
        folder.path().join("run.xyz"),
        folder.path().join("run.mcap"),
    );
    std::fs::write(&model, [frame, frame, &invalid].concat()).unwrap();
    let run = linkwatch(&["check", text(&model), "--record", text(&recording)]);
    assert_eq!(run.code, 3, "{}{}", run.stdout, run.stderr);
    for command in ["check", "thickness", "writhe"] {
        let run = linkwatch(&[command, text(&recording)]);
        assert_eq!(run.code, 3, "{command}: {}{}", run.stdout, run.stderr);
        let said = [run.stdout, run.stderr].concat();
        assert!(
            said.contains("rejected when it was recorded"),
            "{command}: {said}"
        );
    }
}

#[test]
fn files_with_several_frames_are_runs_of_their_own() {
    let folder = TempDir::new().unwrap();
    let linked = squares(folder.path(), "a.npz", &[0.0, 0.1]);
    let apart = squares(folder.path(), "b.npz", &[5.0, 5.1]);
    let both = [text(&linked), text(&apart)];
    let run = linkwatch(&[&["check", "--events"], &both[..]].concat());
    assert_eq!(run.code, 0, "{}", run.stdout);
    assert!(
        run.stdout.contains("intact: 4 frames verified"),
        "{}",
        run.stdout
    );
    assert!(
        run.stdout
            .contains("; 2 runs, each compared with its own first frame")
    );
    let run = linkwatch(&[&["check", "--one-motion"], &both[..]].concat());
    assert_eq!(run.code, 1, "{}", run.stdout);
    assert!(!run.stdout.contains("2 runs"));
    // Each is still compared with a certificate.
    let certificate = folder.path().join("c.txt");
    linkwatch(&["certify", both[0], "--frame", "0", "-o", text(&certificate)]);
    let run = linkwatch(&[&["check", "--baseline", text(&certificate)], &both[..]].concat());
    assert_eq!(run.code, 1);
    // A file of one frame is the baseline of the file after it.
    let first = squares(folder.path(), "first.npz", &[0.0]);
    let run = linkwatch(&["check", "--keep-order", text(&first), both[1]]);
    assert_eq!(run.code, 1, "{}", run.stdout);
    // Runs may have other curves, and are recorded one after the other.
    let other = folder.path().join("other.npz");
    let ring = polygon([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 2);
    let frames = [[ring.clone(), ring.clone()], [ring.clone(), ring]]
        .map(|[a, b]| [a, b.into_iter().map(|[x, y, z]| [x + 9.0, y, z]).collect()]);
    write(folder.path(), "other.npz", None, &frames);
    let recording = folder.path().join("both.mcap");
    let run = linkwatch(&["check", both[0], text(&other), "--record", text(&recording)]);
    assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
    let run = linkwatch(&["replay", text(&recording)]);
    assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
    assert!(
        run.stdout
            .contains("verdicts: 4 equal to the recorded ones"),
        "{}",
        run.stdout
    );
    // One file would be one motion.
    let out = folder.path().join("out.npz");
    let convert = |options: &[&str]| {
        linkwatch(&[&["convert", both[0], both[1], text(&out)], options].concat())
    };
    let run = convert(&[]);
    assert_eq!(run.code, 2);
    assert!(
        run.stderr.contains("or give --one-motion"),
        "{}",
        run.stderr
    );
    assert_eq!(convert(&["--one-motion"]).code, 0);
}

/// Regression test: the step over a file that was not given was searched for pull-throughs, and the
/// missing frames were not reported.
#[test]
fn a_missing_file_of_a_recorded_run_is_a_gap() {
    let folder = TempDir::new().unwrap();
    let [frames, recording] = ["frames.npz", "run.mcap"].map(|name| folder.path().join(name));
    let scene = [
        "generate",
        "chainmail:rows=12,columns=12",
        "--frames",
        "30,diameter=0.2",
    ];
    assert_eq!(
        linkwatch(&[&scene[..], &["-o", text(&frames)]].concat()).code,
        0
    );
    let record = format!("{},max=1MB", text(&recording));
    let run = linkwatch(&["check", text(&frames), "--events", "--record", &record]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let [second, third] = [2, 3].map(|k| folder.path().join(format!("run-part{k}.mcap")));
    assert!(third.exists());
    // Without the option, too: they were runs of their own.
    for option in [&["--one-motion"][..], &[]] {
        let check = |files: &[&Path]| {
            let files: Vec<&str> = files.iter().map(|file| text(file)).collect();
            linkwatch(&[&["check"], option, &files[..]].concat())
        };
        let run = check(&[&recording, &second, &third]);
        assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
        assert!(!run.stdout.contains(" runs"), "{}", run.stdout);
        let run = check(&[&recording, &third]);
        assert_eq!(run.code, 3, "{}{}", run.stdout, run.stderr);
        assert!(
            run.stderr.contains("1 gap between files of a run"),
            "{}",
            run.stderr
        );
    }
    // Without the first file, what happened there was not said.
    for files in [&[&second, &third][..], &[&third]] {
        let files: Vec<&str> = files.iter().map(|file| text(file)).collect();
        let run = linkwatch(&[&["check"], &files[..]].concat());
        assert_eq!(run.code, 3, "{}{}", run.stdout, run.stderr);
        let missing = "1 run without its first file";
        assert!(run.stderr.contains(missing), "{}", run.stderr);
    }
    // Regression test: the last file was missing, and the run intact.
    let run = linkwatch(&["check", text(&recording), text(&second)]);
    assert_eq!(run.code, 3, "{}{}", run.stdout, run.stderr);
    let missing = "the run continues in run-part3.mcap, which was not given";
    assert!(run.stderr.contains(missing), "{}", run.stderr);
    // Nothing said that there are more files.
    let says = "the run continues in run-part2.mcap";
    let run = linkwatch(&["replay", text(&recording)]);
    assert!(run.stderr.contains(says), "{}", run.stderr);
    let run = linkwatch(&["report", "--text", text(&recording)]);
    assert!(run.stdout.contains(says), "{}", run.stdout);
}

/// Writes frames of curves, negative counts for closed ones. Each frame is a cut if `cut` is true.
fn run_of(
    folder: &Path,
    name: &str,
    (counts, cut): (&[i32], bool),
    frames: &[Vec<[f64; 3]>],
) -> PathBuf {
    let path = folder.join(name);
    let mut writer = FrameWriter::create(&path, Format::Npz).unwrap();
    for (k, points) in (0..).zip(frames) {
        let positions = Positions::F64(points.as_flattened());
        let set = CurveSet::from_counts(Basis::Polyline, counts, positions);
        let mut info = FrameInfo::at(k, k as f64);
        info.cuts = if cut { k as u32 } else { 0 };
        writer.frame(&ModelFrame::of(info, set)).unwrap();
    }
    writer.finish().unwrap();
    path
}

const SQUARE: [[f64; 3]; 4] = [[-1., -1., 0.], [1., -1., 0.], [1., 1., 0.], [-1., 1., 0.]];

/// Writes a square, and an open strand at some places: beyond 1 it is outside of the square.
fn strand(folder: &Path, name: &str, places: &[f64]) -> PathBuf {
    let frame = |&x: &f64| [&SQUARE[..], &[[x, 0.2, -1.0], [x, 0.1, 1.0]]].concat();
    let frames: Vec<_> = places.iter().map(frame).collect();
    run_of(folder, name, (&[-4, 2], false), &frames)
}

/// Regression test: the first run decided whether all runs were searched for pull-throughs.
#[test]
fn each_run_is_searched_unless_its_own_first_frames_are_far_apart() {
    let folder = TempDir::new().unwrap();
    let frame = |k: f64| {
        let moved = |[x, y, z]: [f64; 3]| [x + 90.0 * k * y, y, z + 20.0 * k * x];
        [SQUARE.map(moved), SQUARE.map(|[x, y, _]| [x, y, 300.0])].concat()
    };
    let far = run_of(
        folder.path(),
        "far.npz",
        (&[-4, -4], false),
        &[0., 1., 2.].map(frame),
    );
    let near = strand(folder.path(), "near.npz", &[0.0, 0.5, 1.5, 2.0]);
    for files in [[&far, &near], [&near, &far]] {
        let run = linkwatch(&["check", "--keep-order", text(files[0]), text(files[1])]);
        assert_eq!(run.code, 1, "{}{}", run.stdout, run.stderr);
        assert!(run.stderr.contains("are far apart"), "{}", run.stderr);
        let says = "do not show in 1 run ";
        assert!(run.stdout.contains(says), "{}", run.stdout);
    }
    // Open curves of the other run are verified.
    let intact = strand(folder.path(), "intact.npz", &[0.0, 0.1, 0.2]);
    let run = linkwatch(&["check", "--keep-order", text(&intact), text(&far)]);
    assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
    assert!(
        !run.stdout.contains("not verified: 1 open"),
        "{}",
        run.stdout
    );
}

/// Regression test: open curves counted as verified, although no step was searched.
#[test]
fn open_curves_are_not_verified_if_no_step_is_searched() {
    let folder = TempDir::new().unwrap();
    let model = strand(folder.path(), "run.npz", &[0.0, 0.1, 0.2, 0.3, 0.4, 0.5]);
    let recording = folder.path().join("run.mcap");
    let record = format!("{},every=2", text(&recording));
    let run = linkwatch(&["check", text(&model), "--record", &record]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let run = linkwatch(&["replay", text(&recording)]);
    assert_eq!(run.code, 3, "{}{}", run.stdout, run.stderr);
    let says = "because no step was searched";
    assert!(run.stdout.contains(says), "{}", run.stdout);
    // A step of another run does not count. There is also no step to the next file of a recording
    // that skips frames.
    let frame = |k: f64| [&SQUARE[..], &[[1.5 * k, 0.2, -1.0], [1.5 * k, 0.1, 1.0]]].concat();
    let frames = [0.0, 1.0, 2.0].map(frame);
    let cuts = run_of(folder.path(), "cuts.npz", (&[-4, 2], true), &frames);
    let rings = squares(folder.path(), "rings.npz", &[0.0, 0.1, 0.2]);
    for files in [&[&rings, &cuts][..], &[&cuts]] {
        let files: Vec<&str> = files.iter().map(|file| text(file)).collect();
        let run = linkwatch(&[&["check", "--keep-order"], &files[..]].concat());
        assert_eq!(run.code, 3, "{}{}", run.stdout, run.stderr);
    }
    let long = |x: f64| (0..12_000).map(move |k| [x, 0.2, f64::from(k) / 6_000.0 - 1.0]);
    let frames = (0..24).map(|k| {
        SQUARE
            .into_iter()
            .chain(long(0.01 * f64::from(k)))
            .collect()
    });
    let frames: Vec<Vec<[f64; 3]>> = frames.collect();
    let model = run_of(folder.path(), "long.npz", (&[-4, 12_000], false), &frames);
    let recording = folder.path().join("long.mcap");
    let record = format!("{},every=2,max=1MB", text(&recording));
    let run = linkwatch(&["check", text(&model), "--record", &record]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let second = folder.path().join("long-part2.mcap");
    let run = linkwatch(&["check", text(&recording), text(&second)]);
    assert_eq!(run.code, 3, "{}{}", run.stdout, run.stderr);
    assert!(!run.stdout.contains(" runs"), "{}", run.stdout);
    // An open curve has no knot either.
    let line = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 1.0, 0.0]];
    let frames = [0.0, 0.1].map(|z| line.map(|[x, y, _]| [x, y, z * x * y]).to_vec());
    let line = run_of(folder.path(), "line.npz", (&[3], false), &frames);
    let run = linkwatch(&["check", "--invariants=self", text(&line)]);
    assert_eq!(run.code, 3, "{}{}", run.stdout, run.stderr);
}

#[test]
fn a_file_that_cannot_be_read_is_the_only_error() {
    let folder = TempDir::new().unwrap();
    let unknown = folder.path().join("model.foo");
    std::fs::write(&unknown, "curves").unwrap();
    let truncated = folder.path().join("model.npz");
    std::fs::write(&truncated, "PK").unwrap();
    let invalid = folder.path().join("model.obj");
    std::fs::write(&invalid, "v 0 0 x\n").unwrap();
    let missing = folder.path().join("missing.bcc");
    for file in [&unknown, &truncated, &invalid, &missing] {
        let run = linkwatch(&["check", text(file)]);
        assert_ne!(run.code, 0);
        let said = [run.stdout, run.stderr].concat();
        assert!(!said.contains("nothing to compare"), "{said}");
        assert!(said.contains(text(file)), "{said}");
    }
}
