//! Tests of `linkwatch report` as a process: its files, its streams and its exit codes.

#[path = "support/mod.rs"]
mod support;

use linkwatch::formats::{Format, FrameWriter, ModelFrame};
use linkwatch::{Basis, CurveSet, FrameInfo, Positions};
use serde_json::Value;
use std::path::{Path, PathBuf};
use support::command::{command, linkwatch, text};

/// Returns a recording of the project.
fn recording(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings");
    folder.join(name).with_extension("mcap")
}

#[test]
fn the_page_is_named_after_the_recording_and_overwrites_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let run = |force: &[&str]| {
        let mut command = command();
        command.current_dir(folder.path()).arg("report");
        command.arg(recording("squares")).args(force);
        command.output().unwrap()
    };
    let first = run(&[]);
    assert_eq!(first.status.code(), Some(1));
    let sentence = String::from_utf8(first.stdout).unwrap();
    assert!(sentence.starts_with("The topology changed in frame 11"));
    let page = folder.path().join("squares.html");
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.starts_with("<!DOCTYPE html>") && html.ends_with("</html>\n"));
    std::fs::write(&page, "mine").unwrap();
    let refused = run(&[]);
    assert_eq!(refused.status.code(), Some(2));
    let why = String::from_utf8(refused.stderr).unwrap();
    assert!(why.contains("the file exists; --force"), "{why}");
    assert_eq!(std::fs::read_to_string(&page).unwrap(), "mine");
    assert_eq!(run(&["--force"]).status.code(), Some(1));
    assert_eq!(std::fs::read_to_string(&page).unwrap(), html);
}

#[test]
fn text_and_json_go_to_stdout_and_write_no_page() {
    let folder = tempfile::tempdir().unwrap();
    for (name, code, word) in [("flight", 1, "changed"), ("chainmail", 0, "intact")] {
        for option in ["--text", "--json"] {
            let mut command = command();
            command.current_dir(folder.path()).args(["report", option]);
            let run = command.arg(recording(name)).output().unwrap();
            assert_eq!(run.status.code(), Some(code), "{name}");
            let stdout = String::from_utf8(run.stdout).unwrap();
            if option == "--json" {
                let json: Value = serde_json::from_str(&stdout).unwrap();
                assert_eq!(json["conclusion"], word);
                assert_eq!(stdout.lines().count(), 1);
            } else {
                assert!(stdout.contains("\nrun\n"), "{stdout}");
            }
        }
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    let path = recording("flight");
    assert_eq!(
        linkwatch(&["report", text(&path), "--text", "--json"]).code,
        2
    );
}

#[test]
fn a_recording_that_was_cut_off_is_reported_with_exit_code_3() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.mcap");
    let whole = std::fs::read(recording("chainmail")).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let run = linkwatch(&["report", text(&path), "--text"]);
    assert_eq!(run.code, 3, "{}", run.stderr);
    assert!(run.stdout.starts_with("Not complete: "), "{}", run.stdout);
    assert!(run.stdout.contains("truncated at byte"), "{}", run.stdout);
}

#[test]
fn bad_input_is_an_error_with_the_name_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let bad = folder.path().join("bad.mcap");
    std::fs::write(&bad, "this is no recording").unwrap();
    let page = folder.path().join("bad.html");
    let missing = folder.path().join("missing.mcap");
    for path in [&bad, &missing, &folder.path().to_owned()] {
        let run = linkwatch(&["report", text(path), "-o", text(&page)]);
        assert_eq!(run.code, 2, "{run:?}");
        assert!(run.stderr.contains(text(path)), "{run:?}");
    }
    assert!(!page.exists());
    // A picture of the violation, but no page, because `-o` is not given.
    let pictures = folder.path().join("pictures");
    let run = linkwatch(&[
        "report",
        text(&recording("squares")),
        "--svg",
        text(&pictures),
    ]);
    assert_eq!(run.code, 1, "{run:?}");
    let picture = std::fs::read_to_string(pictures.join("violation-1.svg")).unwrap();
    for caption in [
        "before: frame 10",
        "at the violation: frame 11",
        "after: frame 12",
    ] {
        assert!(picture.contains(caption), "{caption}: {picture}");
    }
    assert!(!pictures.join("violation-2.svg").exists());
    let run = linkwatch(&[
        "report",
        text(&recording("squares")),
        "--svg",
        text(&pictures),
    ]);
    assert_eq!(run.code, 2, "{run:?}");
    // The page never replaces the recording.
    let path = recording("squares");
    let run = linkwatch(&["report", text(&path), "-o", text(&path), "--force"]);
    assert_eq!(run.code, 2);
    let words = folder.path().join("words.txt");
    let run = linkwatch(&["report", text(&path), "-o", text(&words)]);
    assert_eq!((run.code, words.exists()), (2, false), "{run:?}");
    assert!(run.stderr.contains("name it .html"), "{run:?}");
}

/// Regression test: a run without any searched step was intact, as its open curves were not
/// counted.
#[test]
fn open_curves_without_a_searched_step_make_a_report_incomplete() {
    let folder = tempfile::tempdir().unwrap();
    let [archive, recording] = ["a.npz", "a.mcap"].map(|name| folder.path().join(name));
    for (cuts, code) in [([0, 1, 2], 3), ([0, 1, 1], 0), ([0, 0, 0], 0)] {
        let mut writer = FrameWriter::create(&archive, Format::Npz).unwrap();
        for (seq, cuts) in (0..).zip(cuts) {
            let mut info = FrameInfo::at(seq, seq as f64);
            info.cuts = cuts;
            // A square, and a line through it.
            let xyz = [
                [-1.0, -1.0, 0.0],
                [1.0, -1.0, 0.0],
                [1.0, 1.0, 0.0],
                [-1.0, 1.0, 0.0],
                [0.1, 0.0, -1.0],
                [0.1, 0.01 * seq as f64, 1.0],
            ];
            let positions = Positions::F64(xyz.as_flattened());
            let curves = CurveSet::from_counts(Basis::Polyline, &[-4, 2], positions);
            writer.frame(&ModelFrame::of(info, curves)).unwrap();
        }
        writer.finish().unwrap();
        let check = [
            "check",
            text(&archive),
            "--force",
            "--record",
            text(&recording),
        ];
        assert_eq!(linkwatch(&check).code, code, "{cuts:?}");
        assert_eq!(
            linkwatch(&["replay", text(&recording)]).code,
            code,
            "{cuts:?}"
        );
        let run = linkwatch(&["report", text(&recording), "--text"]);
        assert_eq!(run.code, code, "{cuts:?}: {run:?}");
        let says = run.stdout.contains("1 open curve was not verified");
        assert_eq!(says, code == 3, "{run:?}");
    }
}
