//! Commands on files with a periodic cell.

use crate::support::command::{Run, linkwatch, text};
use linkwatch::formats::{Format, FrameWriter, ModelFrame};
use linkwatch::{Basis, CurveSet, Positions};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

pub type Point = [f64; 3];

/// Returns a closed polygon with `parts` points on each side.
pub fn polygon<const N: usize>(corners: [Point; N], parts: usize) -> Vec<Point> {
    let side = |k: usize| {
        let [p, q] = [k, (k + 1) % N].map(|k| corners[k]);
        (0..parts).map(move |n| {
            let share = n as f64 / parts as f64;
            [0, 1, 2].map(|x| p[x] + (q[x] - p[x]) * share)
        })
    };
    (0..N).flat_map(side).collect()
}

/// Writes frames of two closed curves, in a cell or not. Frame `k` has the number `k` and the time
/// `0.5 k`.
pub fn write(folder: &Path, name: &str, cell: Option<&str>, frames: &[[Vec<Point>; 2]]) -> PathBuf {
    let path = folder.join(name);
    let mut writer = FrameWriter::create(&path, Format::of(&path).unwrap()).unwrap();
    for (k, curves) in frames.iter().enumerate() {
        let counts = curves.each_ref().map(|curve| -(curve.len() as i32));
        let xyz = curves.concat().concat();
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap();
        let mut frame = ModelFrame::new(k as u64, Ok(set));
        frame.info.time = 0.5 * k as f64;
        frame.info.cell = cell.map(|cell| cell.parse().unwrap());
        writer.frame(&frame).unwrap();
    }
    writer.finish().unwrap();
    path
}

/// Writes a ring that is longer than the cell and one that moves along it. From frame 2 on, the
/// second ring is linked with an image of the first one instead of the ring itself; from frame 5
/// on, with none.
fn two_images(folder: &Path) -> PathBuf {
    let long = [
        [-1.5, -1.0, 0.0],
        [3.5, -1.0, 0.0],
        [3.5, 1.0, 0.0],
        [-1.5, 1.0, 0.0],
    ];
    let frame = |shift: f64| {
        let [near, far] = [2.9 + shift, 3.9 + shift];
        let ring = [[near, -1.0], [far, -1.0], [far, 1.0], [near, 1.0]];
        [polygon(long, 6), polygon(ring.map(|[x, z]| [x, 0.0, z]), 6)]
    };
    let shifts = [0.0, 0.0, -0.6, -0.6, -0.6, -1.7, -1.7];
    write(folder, "two.npz", Some("4,10,10"), &shifts.map(frame))
}

#[test]
fn images_of_one_pair_are_findings_of_their_own() {
    let folder = TempDir::new().unwrap();
    let (model, recording) = (two_images(folder.path()), folder.path().join("two.mcap"));
    let run = linkwatch(&[
        "check",
        text(&model),
        "--events=off",
        "--record",
        text(&recording),
    ]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    let gained = "curve 0 and the image -1,0,0 of curve 1 became linked: linking number was 0";
    assert_eq!(run.stdout.matches(gained).count(), 1, "{}", run.stdout);
    let lost = "curves 0 and 1 came apart: linking number was -1, is 0";
    assert_eq!(run.stdout.matches(lost).count(), 1, "{}", run.stdout);
    let report = linkwatch(&["report", text(&recording), "--text"]);
    let rows = [
        "frame 2 at 1 s: curve 0 and the image -1,0,0 of curve 1 became linked: linking number \
         was 0, is 1",
        "frame 2 at 1 s: curves 0 and 1 came apart: linking number was -1, is 0",
    ];
    for (row, frames) in rows.into_iter().zip(["3 frames, to 4", "5 frames, to 6"]) {
        let line = report.stdout.lines().find(|line| line.contains(row));
        let line = line.unwrap_or_else(|| panic!("{row}: {}", report.stdout));
        assert!(line.ends_with(frames), "{line}");
    }
    let report = linkwatch(&["report", text(&recording), "--json"]);
    let report: serde_json::Value = serde_json::from_str(&report.stdout).unwrap();
    let pairs = report["pairs"].as_array().unwrap().iter();
    // The first ring touches its own image from the start.
    let images = pairs.filter(|pair| !pair["link"].is_null());
    let images: Vec<_> = images.map(|pair| pair["image"].to_string()).collect();
    assert_eq!(images, ["[-1,0,0]", "[0,0,0]"]);
}

/// Regression test: the report of the recording said that the run was intact.
#[test]
fn several_curves_through_the_cell_are_incomplete_without_a_search_for_pull_throughs() {
    let folder = TempDir::new().unwrap();
    let ring = "v 4 4 4\nv 5 4 4\nv 5 5 4\nl 1 2 3 1\n";
    let yarns = "v 0 1 1\nv 4 1 1\nv 7 1 1\nv 10 1 1\nv 0 8 1\nv 4 8 1\nv 7 8 1\nv 10 8 1\n";
    let check = |lines: &str, name: &str| {
        let models = ["0.obj", "1.obj"].map(|model| folder.path().join(model));
        for model in &models {
            std::fs::write(model, [ring, yarns, lines].concat()).unwrap();
        }
        let [first, second] = models.each_ref().map(|model| text(model));
        let recording = folder.path().join(name);
        let options = [
            "--cell=10,10,10",
            "--events=off",
            "--record",
            text(&recording),
        ];
        let check = linkwatch(&[&["check", first, second], &options[..]].concat());
        (check, linkwatch(&["report", "--text", text(&recording)]))
    };
    let (run, report) = check("l 4 5 6 7\nl 8 9 10 11\n", "two.mcap");
    assert_eq!((run.code, report.code), (3, 3), "{}", run.stdout);
    let says = "2 open curves were not verified";
    assert!(report.stdout.contains(says), "{}", report.stdout);
    // A single one has a linking number with the ring.
    let (run, report) = check("l 4 5 6 7\n", "one.mcap");
    assert_eq!((run.code, report.code), (0, 0), "{}", run.stdout);
}

/// Writes two rings that are linked across the boundary of the cell. In frame 2 they are not.
fn across(folder: &Path, name: &str) -> PathBuf {
    let frame = |shift: f64| {
        let ring = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let other = [[8.0, -1.0], [10.0, -1.0], [10.0, 1.0], [8.0, 1.0]];
        let other = other.map(|[x, z]| [x + shift, 0.0, z]);
        [
            polygon(ring.map(|[x, y]| [x, y, 0.0]), 1),
            polygon(other, 1),
        ]
    };
    write(folder, name, Some("10,10,10"), &[0.0, 0.1, -5.0].map(frame))
}

/// Returns the lines of a run.
fn lines(run: &Run) -> Vec<&str> {
    run.stdout.lines().collect()
}

#[test]
fn every_command_reads_the_cells_of_a_recording() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (model, recording) = (across(folder.path(), "in.npz"), at("run.mcap"));
    assert_eq!(
        linkwatch(&["check", text(&model), "--record", text(&recording)]).code,
        1
    );
    let both = |command: &[&str]| {
        [&model, &recording].map(|path| {
            let run = linkwatch(&[command, &[text(path)]].concat());
            (run.code, run.stdout.replace(text(path), "FILE"))
        })
    };
    for command in [
        &["certify", "--frame", "0"][..],
        &["thickness", "--frame", "2"],
        &["certify", "--explain", "--frame", "0"],
        &["writhe"],
    ] {
        let [of_model, of_recording] = both(command);
        let of = |(code, out): (i32, String)| {
            // Without times.
            let out: Vec<String> = out
                .lines()
                .map(|l| l.split(" (").next().unwrap().into())
                .collect();
            (code, out)
        };
        assert_eq!(of(of_model), of(of_recording), "{command:?}");
    }
    let [of_model, of_recording] = both(&["check"]);
    assert_eq!((of_model.0, of_recording.0), (1, 1));
    let lost = "curve 0 and the image -1,0,0 of curve 1 came apart";
    assert!(of_model.1.contains(lost) && of_recording.1.contains(lost));
    for name in ["out.npz", "again.mcap"] {
        let out = at(name);
        assert_eq!(
            linkwatch(&["convert", text(&recording), text(&out)]).code,
            0
        );
        let run = linkwatch(&["check", text(&out)]);
        assert!(
            run.code == 1 && run.stdout.contains(lost),
            "{name}: {}",
            run.stdout
        );
    }
}

#[test]
fn a_cell_that_a_format_cannot_hold_is_named_once() {
    let folder = TempDir::new().unwrap();
    let model = across(folder.path(), "in.npz");
    let run = linkwatch(&[
        "convert",
        text(&model),
        text(&folder.path().join("out.obj")),
    ]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let lost = "frame 0: the output cannot hold its periodic cell, which is lost";
    assert_eq!(run.stderr.matches(lost).count(), 1, "{}", run.stderr);
    let lost = "\n  lost: the periodic cell of 3 frames\n";
    assert!(run.stdout.contains(lost), "{}", run.stdout);
}

#[test]
fn recordings_of_other_cells_differ() {
    let folder = TempDir::new().unwrap();
    let model = across(folder.path(), "in.npz");
    let [a, b] = ["10,10,10", "20,20,20"].map(|cell| {
        let path = folder.path().join(format!("{}.mcap", &cell[..2]));
        linkwatch(&["convert", text(&model), text(&path), "--cell", cell]);
        path
    });
    let run = linkwatch(&["diff", text(&a), text(&b)]);
    let diverge = "curves: the runs diverge at frame 0; 0 of 3 frames are bitwise equal";
    assert!(run.stdout.contains(diverge), "{}", run.stdout);
}

#[test]
fn a_cell_is_given_to_every_command_that_reads_files() {
    let folder = TempDir::new().unwrap();
    let model = across(folder.path(), "in.npz");
    // Without the cell nothing is linked.
    let run = linkwatch(&["certify", text(&model), "--frame", "0", "--cell", "none"]);
    assert_eq!(lines(&run), ["2 # lines: 0"]);
    let out = folder.path().join("out.npz");
    let run = linkwatch(&["convert", text(&model), text(&out), "--cell", "none"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(linkwatch(&["check", text(&out)]).code, 0);
    let run = linkwatch(&["check", text(&out), "--cell", "10,10,10"]);
    assert_eq!(run.code, 1);
}

/// A ring of a wrapped dump, torn at the boundary of its cell.
const TORN: &str = "3\nLattice=\"10 0 0 0 10 0 0 0 10\" Properties=species:S:1:pos:R:3:mol:I:1\n\
                    C 9.5 5 5 1\nC 0.5 5 5 1\nC 0.0 5.5 5 1\n";

#[test]
fn the_advice_on_wrapped_coordinates_leads_to_a_result() {
    let folder = TempDir::new().unwrap();
    let model = folder.path().join("torn.xyz");
    std::fs::write(&model, format!("{TORN}{TORN}")).unwrap();
    let out = folder.path().join("out.npz");
    for (command, more) in [
        ("writhe", &[][..]),
        ("thickness", &[]),
        ("certify", &[]),
        ("certify", &["--open", "--cell", "none"]),
        ("certify", &["--explain"]),
        ("check", &[]),
        ("convert", &[text(&out)]),
    ] {
        let run = linkwatch(&[&[command, text(&model)], more].concat());
        let said = [run.stdout, run.stderr].concat();
        assert!(
            run.code != 0 && said.contains("--wrapped"),
            "{command}: {said}"
        );
        assert!(!said.contains("nothing to compare"), "{command}: {said}");
        let run = linkwatch(&[&[command, text(&model)], more, &["--wrapped"]].concat());
        assert_eq!(
            run.code, 0,
            "{command} {more:?}: {}{}",
            run.stdout, run.stderr
        );
    }
}

/// Regression test: the thickness of a torn ring was 0.
#[test]
fn wrapped_coordinates_are_refused_also_if_the_cell_is_an_option() {
    let folder = TempDir::new().unwrap();
    let ring = |c: [f64; 2]| {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let side = polygon(corners.map(|[x, y]| [c[0] + x, c[1] + y, 2.0]), 4);
        side.iter().map(|p| p.map(|x| x.rem_euclid(4.0))).collect()
    };
    let path = write(
        folder.path(),
        "torn.npz",
        None,
        &[[ring([0.25, 2.0]), ring([2.0, 2.0])]],
    );
    for command in ["thickness", "writhe", "certify"] {
        let run = linkwatch(&[command, text(&path), "--cell", "4,4,4"]);
        assert_eq!(run.code, 2, "{command}: {}", run.stdout);
        assert!(
            run.stderr.contains("pass the option `--wrapped`"),
            "{}",
            run.stderr
        );
    }
}

/// Regression test: curves that jumped were recorded in double precision, and a replay rejected the
/// frames after that.
#[test]
fn a_recording_of_curves_that_jump_has_the_frames_as_they_were_given() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("jump.npz");
    let mut writer = FrameWriter::create(&path, Format::Npz).unwrap();
    for k in 0..6 {
        let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let x = if k < 4 { 6.0 } else { 8.5 } - if k < 2 { 0.0 } else { 10.0 };
        let rings = [
            polygon(square.map(|[a, b]| [5.0 + a, 5.0 + b, 5.0]), 4),
            polygon(square.map(|[a, b]| [x + a, 5.1, 5.0 + b]), 4),
        ];
        let xyz: Vec<f32> = rings
            .concat()
            .as_flattened()
            .iter()
            .map(|&x| x as f32)
            .collect();
        let positions = Positions::F32(&xyz);
        let set = CurveSet::from_counts(Basis::Polyline, &[-16, -16], positions).unwrap();
        let mut frame = ModelFrame::new(k, Ok(set));
        frame.info.cell = Some("10,10,10".parse().unwrap());
        writer.frame(&frame).unwrap();
    }
    writer.finish().unwrap();
    let recording = folder.path().join("jump.mcap");
    let run = linkwatch(&[
        "check",
        text(&path),
        "--events",
        "--record",
        text(&recording),
    ]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    let replayed = linkwatch(&["replay", text(&recording)]);
    assert_eq!(replayed.code, 1, "{}", replayed.stderr);
    assert!(
        replayed.stdout.contains("6 equal to the recorded ones"),
        "{}",
        replayed.stdout
    );
    // Regression test: a replay that began after the jump took an image of the curve, which is
    // linked with the other one, for the curve itself, and was intact.
    for from in ["4", "5"] {
        let later = linkwatch(&["replay", text(&recording), "--from", from]);
        assert_eq!(later.code, 1, "{}", later.stderr);
        assert!(!later.stdout.contains("different"), "{}", later.stdout);
    }
    let again = folder.path().join("again.npz");
    let converted = linkwatch(&["convert", text(&recording), text(&again)]);
    assert_eq!(converted.code, 0, "{}", converted.stderr);
}
