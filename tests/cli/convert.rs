//! `linkwatch convert`, and models in folders, patterns and files with several frames.

use crate::support::command::{linkwatch, text};
use linkwatch::formats::{Format, FrameWriter, ModelFrame};
use linkwatch::{Basis, CurveSet, FrameInfo, Positions, formats};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Writes frames of two squares; the second one leaves the first one in frame 3.
fn squares(folder: &Path, frames: u32) -> Vec<PathBuf> {
    (0..frames)
        .map(|k| {
            let x = if k < 3 { 0.5 + 0.1 * k as f32 } else { 5.0 };
            let first = [[-1., -1., 0.], [1., -1., 0.], [1., 1., 0.], [-1., 1., 0.]];
            let second = [
                [x, 0., -1.],
                [x + 2., 0., -1.],
                [x + 2., 0., 1.],
                [x, 0., 1.],
            ];
            let xyz: Vec<f32> = [first, second].as_flattened().as_flattened().to_vec();
            let set = CurveSet::from_counts(Basis::Polyline, &[-4, -4], Positions::F32(&xyz));
            let path = folder.join(format!("f{k}.bcc"));
            formats::write_bcc(&path, &set.unwrap()).unwrap();
            path
        })
        .collect()
}

#[test]
fn a_folder_and_a_pattern_are_the_models_in_it_by_number() {
    let folder = TempDir::new().unwrap();
    squares(folder.path(), 12);
    std::fs::write(folder.path().join("notes.txt"), "").unwrap();
    let pattern = folder.path().join("f*.bcc");
    for argument in [folder.path(), &pattern] {
        let run = linkwatch(&["check", text(argument)]);
        assert_eq!(run.code, 1, "{}", run.stderr);
        let summary = run.stdout.split("first violation: ").nth(1).unwrap();
        assert!(
            summary.contains("f3.bcc: curves 0 and 1 "),
            "{}",
            run.stdout
        );
        assert!(run.stdout.contains("12 frames verified"), "{}", run.stdout);
    }
    let run = linkwatch(&["check", text(&folder.path().join("g*.bcc"))]);
    assert_eq!(run.code, 2);
    assert!(
        run.stderr.contains("no file has such a name"),
        "{}",
        run.stderr
    );
    let empty = TempDir::new().unwrap();
    let run = linkwatch(&["check", text(empty.path())]);
    assert_eq!(run.code, 2);
    assert!(
        run.stderr.contains("the folder holds no models"),
        "{}",
        run.stderr
    );
    std::fs::write(folder.path().join("a.obj"), "").unwrap();
    let run = linkwatch(&["check", text(folder.path())]);
    assert_eq!(run.code, 2);
    assert!(
        run.stderr.contains("models of several formats"),
        "{}",
        run.stderr
    );
}

#[test]
fn certifies_each_model_of_a_folder() {
    let folder = TempDir::new().unwrap();
    squares(folder.path(), 4);
    let run = linkwatch(&["certify", text(folder.path())]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let (models, links): (Vec<&str>, Vec<&str>) =
        run.stdout.lines().partition(|line| !line.starts_with(' '));
    let linked: Vec<bool> = models.iter().map(|l| l.contains("1 link ")).collect();
    assert_eq!(linked, [true, true, true, false], "{}", run.stdout);
    assert_eq!(links.len(), 3, "{}", run.stdout);
    assert!(
        links
            .iter()
            .all(|l| l.starts_with("  curves 0 and 1: linking number "))
    );
}

/// A folder of models in two formats, one of which is damaged: the others are certified and drawn.
#[test]
fn draws_each_model_of_a_folder_and_names_a_damaged_one() {
    let folder = TempDir::new().unwrap();
    squares(folder.path(), 2);
    std::fs::write(folder.path().join("a.obj"), "v 0 0\nl 1 7\n").unwrap();
    let pictures = folder.path().join("pictures");
    let args = ["certify", text(folder.path()), "--svg", text(&pictures)];
    let run = linkwatch(&args);
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("a.obj"), "{}", run.stderr);
    assert_eq!(run.stdout.matches("1 link ").count(), 2, "{}", run.stdout);
    let drawn = std::fs::read_dir(&pictures).unwrap().count();
    assert_eq!(drawn, 2);
    let again = linkwatch(&args);
    assert!(again.stderr.contains("--force"), "{}", again.stderr);
}

#[test]
fn an_output_is_not_overwritten_and_is_no_input() {
    let folder = TempDir::new().unwrap();
    let models = squares(folder.path(), 2);
    let run = linkwatch(&["convert", text(&models[0]), text(&models[1])]);
    assert_eq!(run.code, 2);
    assert!(
        run.stderr.contains("--force overwrites it"),
        "{}",
        run.stderr
    );
    let run = linkwatch(&["convert", text(&models[0]), text(&models[0]), "--force"]);
    assert_eq!(run.code, 2);
    assert!(
        run.stderr.contains("the same file as the input"),
        "{}",
        run.stderr
    );
    let run = linkwatch(&["convert", text(&models[0]), text(&models[1]), "--force"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
}

/// Files of an earlier conversion were taken for later frames of this one, in silence.
#[test]
fn files_of_an_earlier_conversion_are_named() {
    let folder = TempDir::new().unwrap();
    let models = squares(folder.path(), 3);
    let at = |name: &str| folder.path().join(name);
    let is_named = |name: &str, models: &[PathBuf], out: &str| {
        let models: Vec<&str> = models.iter().map(|model| text(model)).collect();
        let out = at(out);
        let run = linkwatch(&[&["convert", "--force"], &models[..], &[text(&out)]].concat());
        assert_eq!(run.code, 0, "{run:?}");
        run.stderr
            .contains(&format!("{name}: not of this conversion"))
    };
    assert!(!is_named("out-00002.obj", &models, "out.obj"));
    assert!(!is_named("out-00002.obj", &models, "out.obj"));
    assert!(is_named("out-00002.obj", &models[..2], "out.obj"));
    std::fs::write(at("out-2.npz"), "").unwrap();
    assert!(is_named("out-2.npz", &models, "out.npz"));
}

#[test]
fn a_recording_keeps_the_frames_of_models() {
    let folder = TempDir::new().unwrap();
    let models = squares(folder.path(), 5);
    let recording = folder.path().join("run.mcap");
    let arguments: Vec<&str> = models.iter().map(|m| text(m)).collect();
    let run = linkwatch(&[&["convert"], &arguments[..], &[text(&recording)]].concat());
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(
        run.stdout.ends_with("run.mcap: 5 frames, 40 points\n"),
        "{}",
        run.stdout
    );
    let check = linkwatch(&["check", text(&recording)]);
    assert_eq!(check.code, 1, "{}", check.stderr);
    assert!(
        check.stdout.contains("run.mcap, frame 3: curves "),
        "{}",
        check.stdout
    );
    let certificate = |options: &[&str]| {
        let run = linkwatch(&[&["certify", text(&recording)], options].concat());
        (run.code, run.stdout)
    };
    let linked = (0, "2 # lines: 1\n0,1,-1\n".into());
    assert_eq!(certificate(&["--frame", "0"]), linked);
    assert_eq!(certificate(&["--frame", "4"]), (0, "2 # lines: 0\n".into()));
    let run = linkwatch(&["certify", text(&recording), "--frame", "5"]);
    assert_eq!(run.code, 2);
    assert!(
        run.stderr.contains("run.mcap: no frame 5"),
        "{}",
        run.stderr
    );
    // Back to files of one frame.
    let again = folder.path().join("again.bcc");
    let run = linkwatch(&["convert", text(&recording), text(&again)]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    for (k, model) in models.iter().enumerate() {
        let written = std::fs::read(folder.path().join(format!("again-{k:05}.bcc"))).unwrap();
        assert_eq!(written, std::fs::read(model).unwrap());
    }
    let one = folder.path().join("one.bcc");
    let run = linkwatch(&["convert", text(&recording), text(&one), "--frame", "2"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(
        std::fs::read(one).unwrap(),
        std::fs::read(&models[2]).unwrap()
    );
}
#[test]
fn a_single_frame_of_a_file_with_frames_has_nothing_to_compare_with() {
    let folder = TempDir::new().unwrap();
    let models = squares(folder.path(), 1);
    let recording = folder.path().join("run.mcap");
    linkwatch(&["convert", text(&models[0]), text(&recording)]);
    let run = linkwatch(&["check", text(&recording)]);
    assert_eq!(run.code, 2, "{}", run.stdout);
    assert!(
        run.stderr.contains("nothing to compare it with"),
        "{}",
        run.stderr
    );
}
#[test]
fn invalid_frames_are_left_out_and_make_the_conversion_incomplete() {
    let folder = TempDir::new().unwrap();
    let models = squares(folder.path(), 3);
    let mut bytes = std::fs::read(&models[1]).unwrap();
    let nan = f32::NAN.to_le_bytes();
    let at = bytes.len() - nan.len();
    bytes[at..].copy_from_slice(&nan);
    std::fs::write(&models[1], bytes).unwrap();
    for output in ["run.mcap", "run.npz"] {
        let outputs = TempDir::new().unwrap();
        let output = outputs.path().join(output);
        let run = linkwatch(&["convert", text(folder.path()), text(&output)]);
        assert_eq!(run.code, 3, "{}", run.stderr);
        assert!(run.stdout.contains("2 frames"), "{}", run.stdout);
        assert!(
            run.stdout.contains("left out: 1 invalid frame"),
            "{}",
            run.stdout
        );
        assert!(run.stderr.contains("f1.bcc: left out: "), "{}", run.stderr);
        // Regression test: the loss was not recorded, and later checks of the output were intact.
        let run = linkwatch(&["check", text(&output)]);
        assert_eq!(run.code, 3, "{}{}", run.stdout, run.stderr);
        assert!(run.stdout.contains("1 invalid frame ("), "{}", run.stdout);
    }
}

/// Regression test: the copy was treated like the record of a run with `--events=off`.
#[test]
fn a_converted_recording_is_searched_for_pull_throughs() {
    let folder = TempDir::new().unwrap();
    squares(folder.path(), 3);
    let outputs = TempDir::new().unwrap();
    let recording = outputs.path().join("run.mcap");
    let run = linkwatch(&["convert", text(folder.path()), text(&recording)]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let run = linkwatch(&["replay", text(&recording), "--json"]);
    let last = run.stdout.lines().last().unwrap();
    let last: serde_json::Value = serde_json::from_str(last).unwrap();
    assert_eq!(last["summary"]["open_curves_verified"], true, "{last}");
}

#[test]
fn a_recording_that_was_cut_off_is_incomplete_for_every_command() {
    let cut = concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/cut_off.mcap");
    let says = "the recording was cut off at byte 210,728, in a record; all complete frames before \
                that were read";
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("out.npz");
    let check = linkwatch(&["check", cut]);
    assert_eq!(check.code, 3, "{}", check.stderr);
    assert!(
        check.stdout.contains("20 frames verified, 1 rejected"),
        "{}",
        check.stdout
    );
    assert!(check.stdout.contains(says), "{}", check.stdout);
    let convert = linkwatch(&["convert", cut, text(&out)]);
    assert_eq!(convert.code, 3, "{}", convert.stderr);
    assert!(
        convert.stdout.contains("out.npz: 20 frames"),
        "{}",
        convert.stdout
    );
    assert!(convert.stderr.contains(says), "{}", convert.stderr);
    let writhe = linkwatch(&["measure", "writhe", cut]);
    assert_eq!(writhe.code, 3, "{}", writhe.stderr);
    assert!(writhe.stderr.contains(says), "{}", writhe.stderr);
    // The last frame is the last one that is left.
    let writhe = linkwatch(&["measure", "writhe", cut, "--frame", "last"]);
    assert_eq!(writhe.code, 0, "{}", writhe.stderr);
    assert!(writhe.stderr.contains(says), "{}", writhe.stderr);
    assert_eq!(linkwatch(&["certify", cut, "--frame", "19"]).code, 0);
}

/// Returns the names of all files in a folder.
fn files_in(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().flatten();
    let mut names: Vec<String> = entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn a_conversion_that_fails_leaves_no_file_and_names_the_output() {
    let folder = TempDir::new().unwrap();
    let frames = squares(folder.path(), 2);
    let ring = folder.path().join("ring.vect");
    std::fs::write(&ring, "VECT\n1 3 0\n-3\n0\n0.1 0 0 1 0 0 0 1 0\n").unwrap();
    let before = files_in(folder.path());
    for (inputs, out, why) in [
        // The curves of the second frame differ from those of the first one.
        ([&frames[0], &ring], "out.npy", "curve"),
        // 0.1 cannot be represented in single precision.
        (
            [&ring, &frames[0]],
            "out.bcc",
            "single precision would round",
        ),
    ] {
        let out = folder.path().join(out);
        let [a, b] = inputs.map(|path| text(path));
        let run = linkwatch(&["convert", "--keep-order", a, b, text(&out)]);
        assert_eq!(run.code, 2, "{run:?}");
        assert!(run.stderr.contains(why), "{run:?}");
        assert!(!run.stderr.contains(".part"), "{run:?}");
        assert!(run.stderr.contains("/out"), "{run:?}");
        assert_eq!(files_in(folder.path()), before, "{run:?}");
    }
    // An existing file is kept.
    let out = folder.path().join("out.npy");
    std::fs::write(&out, "mine").unwrap();
    let [a, b] = [&frames[0], &ring].map(|path| text(path));
    let run = linkwatch(&["convert", "--force", "--keep-order", a, b, text(&out)]);
    assert_eq!(run.code, 2, "{run:?}");
    assert_eq!(std::fs::read(&out).unwrap(), b"mine");
}

/// Curves without names that change were an error, and Python could not read their files.
#[test]
fn an_archive_of_curves_that_change_is_continued_by_another_one() {
    let folder = TempDir::new().unwrap();
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nl 1 2 3 4 1\n";
    let [a, b] = ["1.obj", "2.obj"].map(|name| folder.path().join(name));
    std::fs::write(&a, square).unwrap();
    std::fs::write(
        &b,
        format!("{square}v 9 9 9\nv 8 9 9\nv 9 8 9\nl 5 6 7 5\n"),
    )
    .unwrap();
    let files = ["out.npz", "out-2.npz"].map(|name| folder.path().join(name));
    let run = linkwatch(&["convert", text(&a), text(&b), text(&files[0])]);
    assert_eq!(run.code, 0, "{run:?}");
    let [one, two] = files.each_ref().map(|file| text(file));
    assert!(
        run.stdout
            .contains(&format!("check {one} {two} --one-motion"))
    );
    let curves = |file| linkwatch(&["certify", file]).stdout;
    assert_eq!([one, two].map(curves), ["1 # lines: 0\n", "2 # lines: 0\n"]);
}

/// Regression test: an option between the files was an error of the command.
#[test]
fn options_may_stand_between_the_files_of_a_conversion() {
    let folder = TempDir::new().unwrap();
    let frames = squares(folder.path(), 2);
    let out = folder.path().join("out.npz");
    let [a, b] = [&frames[0], &frames[1]].map(|path| text(path));
    let run = linkwatch(&["convert", a, "--force", b, "--frame", "1", text(&out)]);
    assert_eq!(run.code, 0, "{run:?}");
    assert!(run.stdout.contains(": 1 frame,"), "{run:?}");
    let run = linkwatch(&["convert", text(&out)]);
    assert_eq!(run.code, 2, "{run:?}");
    assert!(run.stderr.contains("OUT, is missing"), "{run:?}");
}

#[test]
fn a_format_that_is_only_read_is_refused_with_those_that_are_written() {
    let folder = TempDir::new().unwrap();
    let models = squares(folder.path(), 1);
    for name in [
        "a.xyz", "a.data", "a.dump", "dump.a", "a.usda", "a.usdc", "a.stl", "a.txt",
    ] {
        let out = folder.path().join(name);
        let run = linkwatch(&["convert", text(&models[0]), text(&out)]);
        assert_eq!(run.code, 2, "{run:?}");
        let says = format!("{name}: unsupported output: written are .bcc, .npz and .mcap, ");
        assert!(run.stderr.contains(&says), "{run:?}");
        assert!(run.stderr.contains("Python"), "{run:?}");
        assert!(!out.exists());
    }
}

#[test]
fn an_invalid_frame_is_left_out_of_numbered_files_and_of_one_file() {
    let folder = TempDir::new().unwrap();
    let frames = squares(folder.path(), 3);
    std::fs::write(&frames[1], "no model").unwrap();
    let all = text(folder.path()).to_owned() + "/f*.bcc";
    for (out, files) in [
        ("out.obj", &["out-00000.obj", "out-00002.obj"][..]),
        ("out.npz", &["out.npz"]),
    ] {
        let to = TempDir::new().unwrap();
        let out = to.path().join(out);
        let run = linkwatch(&["convert", &all, text(&out)]);
        assert_eq!(run.code, 3, "{run:?}");
        assert!(run.stdout.contains(": 2 frames"), "{run:?}");
        assert!(run.stderr.contains("f1.bcc: left out"), "{run:?}");
        assert_eq!(files_in(to.path()), files);
    }
    let to = TempDir::new().unwrap();
    for out in ["out.obj", "out.npz", "out.npy"] {
        let out = to.path().join(out);
        let run = linkwatch(&["convert", text(&frames[1]), text(&out)]);
        assert_eq!(run.code, 2, "{run:?}");
        assert!(
            run.stderr.contains("the input has no valid frame"),
            "{run:?}"
        );
        assert!(files_in(to.path()).is_empty());
    }
}

/// A conversion must not make an incomplete file look complete.
#[test]
fn a_converted_archive_says_what_was_not_read() {
    let folder = TempDir::new().unwrap();
    let [obj, npz, again] = ["a.obj", "a.npz", "b.npz"].map(|name| folder.path().join(name));
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nl 1 2 3 4 1\n";
    let unknown = "cstype cardinal\ndeg 3\ncurv 0 1 1 2 3 4\nparm u 0 1\nend\n";
    std::fs::write(&obj, format!("{square}{unknown}")).unwrap();
    for [from, to] in [[&obj, &npz], [&npz, &again]] {
        let run = linkwatch(&["convert", text(from), text(to)]);
        assert_eq!(run.code, 3, "{}", run.stderr);
        let run = linkwatch(&["certify", text(to)]);
        assert_eq!(run.code, 3, "{}", run.stderr);
        assert!(run.stderr.contains("cardinal"), "{}", run.stderr);
    }
}

/// A recording must not make an incomplete file look complete.
#[test]
fn a_recording_says_what_its_files_left_out() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name);
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nl 1 2 3 4 1\n";
    let unknown = "cstype cardinal\ndeg 3\ncurv 0 1 1 2 3 4\nparm u 0 1\nend\n";
    let files = ["f0.obj", "f1.obj", "f2.obj"].map(path);
    for (file, content) in files.iter().zip(["", "", unknown]) {
        std::fs::write(file, format!("{square}{content}")).unwrap();
    }
    let [all, some, converted, again] = ["a.mcap", "some.mcap", "c.mcap", "again.mcap"].map(path);
    let every = format!("{},every=2", text(&some));
    let files = files.each_ref().map(|file| text(file));
    for (record, to) in [("--record", text(&all)), ("--record", &every)] {
        let run = linkwatch(&[&["check", record, to], &files[..]].concat());
        assert_eq!(run.code, 3, "{}", run.stderr);
    }
    let run = linkwatch(&[&["convert"], &files[..], &[text(&converted)]].concat());
    assert_eq!(run.code, 3, "{}", run.stderr);
    let last = ["replay", text(&all), "--record", text(&again)];
    for args in [
        &last[..],
        &["replay", text(&again)],
        &["check", text(&all)],
        &["check", text(&converted)],
        &["certify", text(&all), "--frame", "2"],
        &["report", text(&all), "-o", text(&path("a.html"))],
        &["report", text(&some), "-o", text(&path("b.html"))],
        &["report", text(&again), "-o", text(&path("c.html"))],
    ] {
        let run = linkwatch(args);
        let all = format!("{}{}", run.stdout, run.stderr);
        assert_eq!(run.code, 3, "{args:?}: {all}");
        assert!(all.contains("cardinal"), "{args:?}: {all}");
    }
}

/// Regression test: the reader left the curve open, and its link was lost.
#[test]
fn an_array_needs_counts_if_a_long_segment_closes_a_curve() {
    let folder = TempDir::new().unwrap();
    let [given, array] = ["a.txt", "a.npy"].map(|name| folder.path().join(name));
    let mut lines = String::new();
    for k in 0..12 {
        let t = 1.3 * std::f64::consts::PI * f64::from(k) / 11.0;
        lines += &format!("{:.9} {:.9} 0\n", t.cos(), t.sin());
    }
    for k in 0..12 {
        let t = std::f64::consts::TAU * f64::from(k) / 12.0;
        lines += &format!("{:.9} 0.27 {:.9}\n", 0.9 + 0.9 * t.cos(), 0.9 * t.sin());
    }
    std::fs::write(&given, lines).unwrap();
    let counts = "--counts=-12,-12";
    let expected = linkwatch(&["certify", counts, text(&given)]).stdout;
    assert!(expected.contains("lines: 1"), "{expected}");
    let run = linkwatch(&["convert", counts, text(&given), text(&array)]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let run = linkwatch(&["certify", text(&array)]);
    assert!(
        run.code == 2 && run.stderr.contains("--counts"),
        "{}",
        run.stderr
    );
    assert_eq!(
        linkwatch(&["certify", counts, text(&array)]).stdout,
        expected
    );
}

/// Regression test: the steps over the cuts of a recording became pull-throughs in its copy.
#[test]
fn cuts_that_a_format_cannot_hold_are_counted() {
    let folder = TempDir::new().unwrap();
    let [input, copy] = ["cut.npz", "copy.npz"].map(|name| folder.path().join(name));
    let mut writer = FrameWriter::create(&input, Format::Npz).unwrap();
    for (k, path) in squares(folder.path(), 4).iter().enumerate() {
        let mut info = FrameInfo::at(k as u64, k as f64);
        info.cuts = [0, 1, 1, 2][k];
        let curves = formats::read(path);
        writer.frame(&ModelFrame::of(info, curves)).unwrap();
    }
    writer.finish().unwrap();
    for (name, lost) in [("copy.npz", 0), ("a.mcap", 0), ("a.npy", 2), ("a.obj", 2)] {
        let output = folder.path().join(name);
        // The copy has the cuts, too.
        let from = if lost > 0 { &copy } else { &input };
        let run = linkwatch(&["--json", "convert", text(from), text(&output)]);
        assert_eq!(run.code, 0, "{}", run.stderr);
        let said: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
        assert_eq!(said["lost_cuts"], lost, "{name}");
        assert_eq!(run.stderr.contains("the motion is cut before"), lost > 0);
    }
}
