//! `linkwatch check` of a model and its certificate.

use super::chain;
use crate::support::command::{command, linkwatch, text};
use linkwatch::{Basis, CurveSet, Positions, formats};
use serde_json::Value;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use tempfile::TempDir;

#[test]
fn check_accepts_the_output_of_certify() {
    let folder = TempDir::new().unwrap();
    let whole = chain(folder.path(), "whole.bcc", 0.5);
    let certificate = folder.path().join("whole.txt");
    let run = linkwatch(&["certify", text(&whole), "-o", text(&certificate)]);
    assert_eq!((run.code, run.stdout.as_str()), (0, ""));
    assert!(
        run.stderr.contains("3 curves of 12 segments"),
        "{}",
        run.stderr
    );
    let run = linkwatch(&["certify", text(&whole)]);
    assert_eq!(run.code, 0);
    assert_eq!(run.stdout, std::fs::read_to_string(&certificate).unwrap());
    assert!(
        run.stdout.starts_with("3 # lines: 2\n0,1,"),
        "{}",
        run.stdout
    );
    let run = linkwatch(&["check", text(&whole), "--baseline", text(&certificate)]);
    assert_eq!(run.code, 0);
    assert!(
        run.stdout.ends_with("whole.bcc: intact\n"),
        "{}",
        run.stdout
    );
}

#[test]
fn check_writes_verdicts_as_junit_xml() {
    let folder = TempDir::new().unwrap();
    let whole = chain(folder.path(), "whole.bcc", 0.5);
    let broken = chain(folder.path(), "broken.bcc", -5.0);
    let (file, missing) = (folder.path().join("v.xml"), folder.path().join("none.bcc"));
    let check = ["check", "--keep-order", text(&whole), text(&broken)];
    let report = ["--events", "--junit", text(&file)];
    let run = linkwatch(&[&check[..], &report].concat());
    assert_eq!(run.code, 1);
    let xml = std::fs::read_to_string(&file).unwrap();
    assert!(
        xml.contains(r#"tests="3" failures="1" errors="0""#),
        "{xml}"
    );
    let failure = r#"<failure type="changed" message="frame 1: changed (1 link lost"#;
    assert!(xml.contains(failure), "{xml}");
    assert!(
        xml.contains("curves 0 and 1 passed through one another"),
        "{xml}"
    );

    let run = linkwatch(&[&check[..], &[text(&missing), "--force"], &report].concat());
    assert_ne!(run.code, 1);
    let xml = std::fs::read_to_string(&file).unwrap();
    assert!(
        xml.contains(r#"tests="3" failures="1" errors="1""#),
        "{xml}"
    );
    assert!(xml.contains(r#"<error type="incomplete""#), "{xml}");
}

#[test]
fn check_names_the_pair_and_exits_with_1() {
    let folder = TempDir::new().unwrap();
    let whole = chain(folder.path(), "whole.bcc", 0.5);
    let broken = chain(folder.path(), "broken.bcc", -5.0);
    let certificate = folder.path().join("c.txt");
    linkwatch(&["certify", text(&whole), "-o", text(&certificate)]);
    let models = ["check", text(&whole), text(&broken)];
    let run = linkwatch(&[&models[..], &["--baseline", text(&certificate)]].concat());
    assert_eq!(run.code, 1);
    assert!(
        run.stdout.contains("curves 0 and 1 came apart"),
        "{}",
        run.stdout
    );
    assert!(run.stdout.contains("near ("), "{}", run.stdout);
    let run = linkwatch(&[
        "check",
        "--json",
        text(&broken),
        "--baseline",
        text(&certificate),
    ]);
    let json: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(run.code, 1);
    assert_eq!(json["report"]["verdict"], "changed");
    assert_eq!(json["report"]["changes"][0]["found"], 0);
}

#[test]
fn contact_is_reported_with_its_place_and_hides_no_other_pair() {
    let folder = TempDir::new().unwrap();
    let touching = chain(folder.path(), "touching.bcc", 2.0);
    let certificate = folder.path().join("c.txt");
    let run = linkwatch(&["certify", text(&touching)]);
    assert_eq!(run.code, 3);
    assert!(
        run.stderr.contains("curves 0 and 1 touch"),
        "{}",
        run.stderr
    );
    assert!(run.stderr.contains("segments"), "{}", run.stderr);
    assert!(
        run.stdout.contains("1,2,"),
        "the other pair: {}",
        run.stdout
    );
    assert!(
        run.stdout.contains("0,1,undefined"),
        "no linking number for the pair in contact: {}",
        run.stdout
    );
    let run = linkwatch(&["certify", text(&touching), "-o", text(&certificate)]);
    assert_eq!(run.code, 3);
    let written = std::fs::read_to_string(&certificate).unwrap();
    assert!(written.contains("\n0,1,undefined\n"), "{written}");
}

/// A model with only open curves has nothing that can be intact.
#[test]
fn a_model_of_open_curves_is_not_intact() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("open.obj");
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 1 1 0\nl 1 2 3\n").unwrap();
    let certificate = folder.path().join("c.txt");
    std::fs::write(&certificate, "1\n").unwrap();
    let run = linkwatch(&["check", text(&path), "--baseline", text(&certificate)]);
    assert_eq!((run.code, run.stdout.as_str()), (2, ""));
    assert!(run.stderr.contains("nothing to verify"), "{}", run.stderr);
    // A single frame also has no motion that could be searched.
    let run = linkwatch(&[
        "check",
        text(&path),
        "--baseline",
        text(&certificate),
        "--events",
    ]);
    assert_eq!(run.code, 3, "{}", run.stderr);
    assert!(run.stderr.contains("there was one frame"), "{}", run.stderr);
}

/// Regression test: the exit code was 0, although the summary said that a curve was not verified.
#[test]
fn frames_with_open_curves_are_incomplete_without_a_search_for_pull_throughs() {
    let folder = TempDir::new().unwrap();
    let square = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nl 1 2 3 4 1\n";
    let line = "v 5 0 0\nv 6 0 0\nv 7 1 0\nl 5 6 7\n";
    let models = ["0.obj", "1.obj"].map(|name| folder.path().join(name));
    let models = models.each_ref().map(|path| {
        std::fs::write(path, [square, line].concat()).unwrap();
        text(path)
    });
    let check = |more: &[&str]| linkwatch(&[&["check"], &models[..], more].concat());
    assert_eq!(check(&[]).code, 0);
    let run = check(&["--events=off"]);
    assert_eq!(run.code, 3, "{}", run.stderr);
    let says = "not verified: 1 open curve, ";
    assert!(run.stdout.contains(says), "{}", run.stdout);
}

/// Regression test: a path that is not UTF-8 caused a panic.
#[cfg(unix)]
#[test]
fn json_has_paths_that_are_not_utf8() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let folder = TempDir::new().unwrap();
    let [model, output] = [&b"m\xff.bcc"[..], b"o\xff.npz"].map(OsStr::from_bytes);
    for args in [
        &["generate", "chainmail:rows=1,columns=2", "-o"].map(OsStr::new)[..],
        &["certify", "--explain"].map(OsStr::new),
        &["convert"].map(OsStr::new),
    ] {
        let mut run = command();
        run.current_dir(&folder).arg("--json").args(args).arg(model);
        if args[0] == "convert" {
            run.arg(output);
        }
        let out = run.output().unwrap();
        assert_eq!(out.status.code(), Some(0), "{out:?}");
        serde_json::from_slice::<serde_json::Value>(&out.stdout).unwrap();
    }
}

/// A frame that cannot be read does not prevent the verdicts on the others.
#[test]
fn check_continues_after_a_model_that_cannot_be_read() {
    let folder = TempDir::new().unwrap();
    let broken = chain(folder.path(), "broken.bcc", -5.0);
    let [none, certificate] = ["none.bcc", "c.txt"].map(|n| folder.path().join(n));
    std::fs::write(&certificate, "3\n0,1,1\n").unwrap();
    let run = linkwatch(&[
        "check",
        text(&none),
        text(&broken),
        "--baseline",
        text(&certificate),
    ]);
    assert_eq!(run.code, 2);
    let change = "curves 0 and 1 came apart: linking number was 1, is 0";
    assert!(run.stdout.contains(change), "{}", run.stdout);
}

/// One change among thousands of pairs, and an intact model, with and without `--early-exit`.
#[test]
fn early_exit_finds_the_change_and_counts_unchecked_pairs() {
    let folder = TempDir::new().unwrap();
    let [model, cert] = ["m.bcc", "c.txt"].map(|name| folder.path().join(name));
    let (model, cert) = (text(&model), text(&cert));
    let scene = "chainmail:rows=30,columns=30";
    let run = linkwatch(&["-q", "generate", scene, "-o", model, "--certificate", cert]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let check = |threads: &str, more: &[&str]| {
        let common = [
            "--json",
            "--threads",
            threads,
            "check",
            model,
            "--baseline",
            cert,
        ];
        let run = linkwatch(&[&common[..], more].concat());
        let out: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
        let unchecked = out["report"]["stats"]["unchecked"].as_u64().unwrap();
        (run.code, unchecked, out["report"].clone())
    };
    // A model is intact only if all pairs are checked.
    let (code, unchecked, _) = check("2", &["--early-exit"]);
    assert_eq!((code, unchecked), (0, 0));
    let expected = std::fs::read_to_string(cert).unwrap();
    let changed = expected.replacen("\n0,1,-1\n", "\n0,1,1\n", 1);
    assert_ne!(expected, changed);
    std::fs::write(cert, changed).unwrap();
    let (code, unchecked, full) = check("1", &[]);
    assert_eq!((code, unchecked), (1, 0));
    let (code, unchecked, early) = check("1", &["--early-exit"]);
    assert_eq!(code, 1);
    assert!(unchecked > 1000, "{unchecked}");
    assert_eq!(early["changes"], full["changes"]);
    // The result does not depend on the number of threads.
    assert_eq!(check("2", &["--early-exit"]).2, early);
}

/// A square that leaves the one that it is linked with, passes through it, or folds through itself.
#[test]
fn check_reports_pull_throughs_between_models() {
    let folder = TempDir::new().unwrap();
    let frames = [-5.0, 0.5, 5.0].map(|at| chain(folder.path(), &format!("{at}.bcc"), at));
    let [left, linked, right] = frames.each_ref().map(|path| text(path));
    let cert = folder.path().join("c.txt");
    linkwatch(&["certify", left, "-o", text(&cert)]);
    let check = |models: &[&str], more: &[&str]| {
        let run = linkwatch(&[&["check", "--baseline", text(&cert)], models, more].concat());
        (run.code, run.stdout)
    };
    // Each model on its own is intact.
    assert_eq!(check(&[left, right], &["--events=off"]).0, 0);
    // The frames are too far apart to decide whether four pull-throughs that cancel took place.
    let (code, out) = check(&[left, right], &[]);
    assert_eq!(code, 3, "{out}");
    assert_eq!(out.matches("\n  unresolved: ").count(), 4, "{out}");
    let (code, out) = check(&[left, right], &["--events", "--motion-limit", "10"]);
    assert_eq!(code, 1, "{out}");
    let passed = out
        .matches("curves 0 and 1 passed through one another at 0.")
        .count();
    // The summary repeats the first one.
    assert_eq!(passed, 5, "{out}");
    assert!(out.contains("5.bcc: changed\n"), "{out}");
    // A change, and the pull-through that caused it.
    let (code, out) = check(&[left, linked], &["--events=all"]);
    assert_eq!(code, 1);
    assert!(out.contains("curves 0 and 1 became linked"), "{out}");
    assert!(out.contains("passed through one another"), "{out}");

    // Two ends of a curve swap places, one above the other.
    let fold = |name: &str, y: f32| {
        let xyz = [
            [0., 0., 0.],
            [2., 0., 0.],
            [2., 2., 1.],
            [1., y, 1.],
            [1., y, -1.],
            [0., 2., -1.],
        ];
        let xyz = xyz.concat();
        let set = CurveSet::from_counts(Basis::Polyline, &[-6], Positions::F32(&xyz)).unwrap();
        let path = folder.path().join(name);
        formats::write_bcc(&path, &set).unwrap();
        path
    };
    let [before, after] = [fold("before.bcc", 0.5), fold("after.bcc", -0.5)];
    linkwatch(&["certify", text(&before), "--force", "-o", text(&cert)]);
    let models = [text(&before), text(&after)];
    assert_eq!(check(&models, &["--events"]).0, 3);
    let (code, out) = check(&models, &["--events=all"]);
    assert_eq!(code, 1, "{out}");
    let reported = "curve 0 passed through itself at 0.500 of the step";
    assert!(out.contains(reported), "{out}");
    // There is no motion between different curves; early exit knows only some linking numbers.
    let run = linkwatch(&[
        "check",
        left,
        text(&before),
        "--baseline",
        text(&cert),
        "--events",
    ]);
    assert_eq!(run.code, 2);
    let run = linkwatch(&[
        "check",
        left,
        "--baseline",
        text(&cert),
        "--events",
        "--early-exit",
    ]);
    assert_eq!(run.code, 2);
}

/// Regression test: a file truncated at a line end was read as a certificate with fewer links.
#[test]
fn check_rejects_a_truncated_certificate() {
    let folder = TempDir::new().unwrap();
    let model = chain(folder.path(), "m.bcc", 0.5);
    let certificate = folder.path().join("c.txt");
    linkwatch(&["certify", text(&model), "-o", text(&certificate)]);
    let whole = std::fs::read_to_string(&certificate).unwrap();
    let last = whole.trim_end().rfind('\n').unwrap();
    std::fs::write(&certificate, &whole[..=last]).unwrap();
    let run = linkwatch(&["check", text(&model), "--baseline", text(&certificate)]);
    assert_eq!(run.code, 2, "{}", run.stdout);
    assert!(run.stderr.contains("the file was cut"), "{}", run.stderr);
}

/// Two models of one topology, without the motion between them: two linked rings, upside down.
#[test]
fn models_that_are_far_apart_are_compared_by_linking_numbers_alone() {
    let folder = TempDir::new().unwrap();
    let model = |name: &str, side: f64| {
        let ring = |k: u32| f64::from(k) * std::f64::consts::TAU / 40.0;
        let first = (0..40).map(|k| [ring(k).cos(), side * ring(k).sin(), 0.0]);
        let second = (0..40).map(|k| [1.0 + ring(k).cos(), 0.0, side * ring(k).sin()]);
        let points: String = (first.chain(second))
            .map(|[x, y, z]| format!("v {x} {y} {z}\n"))
            .collect();
        let closed = |from: u32| {
            let points: Vec<_> = (from..from + 40).map(|k| k.to_string()).collect();
            format!("l {} {from}\n", points.join(" "))
        };
        let path = folder.path().join(name);
        std::fs::write(&path, points + &closed(1) + &closed(41)).unwrap();
        path
    };
    let [first, second] = [("a.obj", 1.0), ("b.obj", -1.0)].map(|(n, side)| model(n, side));
    let run = linkwatch(&["check", text(&first), text(&second)]);
    assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
    assert!(run.stderr.contains("are far apart"), "{}", run.stderr);
    let run = linkwatch(&["check", text(&first), text(&first)]);
    assert!(!run.stderr.contains("are far apart"), "{}", run.stderr);
    let run = linkwatch(&["check", "--events=between", text(&first), text(&second)]);
    assert_eq!(run.code, 3, "{}{}", run.stdout, run.stderr);
    assert!(run.stdout.contains("unresolved: "), "{}", run.stdout);
}

#[test]
fn check_verifies_each_file_in_a_process_of_its_own() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name);
    let [whole, broken, wrong] = ["whole.npz", "broken.npz", "wrong.npz"].map(path);
    let generate = |file: &Path, frames: &str| {
        let args = ["generate", "chainmail:rows=2,columns=2", "--frames", frames];
        assert_eq!(
            linkwatch(&[&args[..], &["-o", text(file)]].concat()).code,
            0
        );
    };
    generate(&whole, "3,diameter=0.2");
    generate(&broken, "4,pull=2,diameter=0.2");
    std::fs::write(&wrong, "no archive").unwrap();
    let out = path("runs.jsonl");
    let lines = || -> Vec<(String, Value)> {
        let lines = std::fs::read_to_string(&out).unwrap();
        let lines = lines.lines().flat_map(serde_json::from_str::<Value>);
        let name = |line: &Value| {
            let file = Path::new(line["file"].as_str().unwrap()).file_name();
            file.unwrap().to_str().unwrap().to_owned()
        };
        let mut lines: Vec<_> = lines.map(|line| (name(&line), line)).collect();
        lines.sort_by(|a, b| a.0.cmp(&b.0));
        lines
    };
    let each = ["check", "--each", "-o", text(&out), "--jobs", "2"];
    let run = linkwatch(&[&each[..], &[&whole, &broken, &wrong].map(|file| text(file))].concat());
    assert_eq!((run.code, run.stdout.as_str()), (1, ""), "{}", run.stderr);
    let found = lines();
    let code = |k: usize| found[k].1["code"].as_i64();
    assert_eq!(found.len(), 3);
    assert_eq!([0, 1, 2].map(code), [Some(1), Some(0), Some(2)]);
    assert_eq!(found[0].1["verdict"], "changed");
    assert_eq!(found[1].1["summary"]["verified"], 3);
    assert!(
        found[2].1["error"]
            .as_str()
            .unwrap()
            .starts_with("not a valid")
    );

    // Without --resume nothing is overwritten.
    let again = linkwatch(&[&each[..], &[text(&whole)]].concat());
    assert!(
        again.code == 2 && again.stderr.contains("--resume"),
        "{}",
        again.stderr
    );
    assert_eq!(lines().len(), 3);

    // The failed run is verified again, and a truncated line is ignored. The exit code is that of
    // all runs together.
    std::fs::remove_file(&wrong).unwrap();
    generate(&wrong, "3,diameter=0.2");
    let mut file = OpenOptions::new().append(true).open(&out).unwrap();
    file.write_all(b"{\"file\": \"who").unwrap();
    let files = [&whole, &broken, &wrong].map(|file| text(file));
    let run = linkwatch(&[&each[..], &["--resume"], &files].concat());
    assert_eq!(run.code, 1, "{}", run.stderr);
    assert!(
        run.stderr.contains("2 intact, 1 changed, 0 undecided"),
        "{}",
        run.stderr
    );
    assert!(run.stderr.contains("1 verified now"), "{}", run.stderr);
    let found = lines();
    let last = &found.last().unwrap().1;
    assert_eq!((found.len(), &last["code"]), (4, &Value::from(0)), "{last}");

    // Files that changed are verified again. So are all files if the options changed.
    std::fs::copy(&broken, &whole).unwrap();
    let run = linkwatch(&[&each[..], &["--resume"], &files].concat());
    assert!(run.stderr.contains("1 intact, 2 changed") && run.stderr.contains("1 verified now"));
    let run = linkwatch(&[&each[..], &["--resume", "--events=off"], &files].concat());
    assert!(run.stderr.contains("3 verified now"), "{}", run.stderr);

    // Regression test: all runs are also repeated if the content of the certificate changed.
    let certificate = path("certificate.txt");
    let resumed = |model: &Path| {
        let certify = ["certify", text(model), "--force", "-o", text(&certificate)];
        assert_eq!(linkwatch(&certify).code, 0);
        let resume = ["--resume", "--baseline", text(&certificate)];
        linkwatch(&[&each[..], &resume, &files].concat()).stderr
    };
    let first = path("first.bcc");
    let generated = ["generate", "chainmail:rows=2,columns=2", "-o", text(&first)];
    assert_eq!(linkwatch(&generated).code, 0);
    let said = resumed(&first);
    assert!(said.contains("3 verified now"), "{said}");
    let said = resumed(&first);
    assert!(said.contains("3 verified now"), "{said}");
    let resume = ["--resume", "--baseline", text(&certificate)];
    let run = linkwatch(&[&each[..], &resume, &files].concat());
    assert!(run.stderr.contains("0 verified now"), "{}", run.stderr);
}

/// Regression test: a killed process got the verdict of its last line.
#[cfg(target_os = "linux")]
#[test]
fn a_run_that_is_killed_has_no_verdict() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("whole.npz");
    let scene = [
        "generate",
        "chainmail:rows=20,columns=20",
        "--frames",
        "400,diameter=0.2",
    ];
    assert_eq!(
        linkwatch(&[&scene[..], &["-o", text(&file)]].concat()).code,
        0
    );
    let mut each = command();
    let each = each.args(["check", "--each", text(&file), "--jobs", "1"]);
    let each = each
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let tasks = format!("/proc/{}/task", each.id());
    let child = loop {
        let tasks = std::fs::read_dir(&tasks).unwrap().flatten();
        let children = tasks.flat_map(|task| std::fs::read_to_string(task.path().join("children")));
        let children: String = children.collect();
        match children.split_whitespace().next() {
            Some(child) => break child.to_owned(),
            None => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    let killed = Command::new("kill").args(["-KILL", &child]).status();
    assert!(killed.unwrap().success());
    let ended = each.wait_with_output().unwrap();
    let line: Value = serde_json::from_slice(&ended.stdout).unwrap();
    assert_eq!(ended.status.code(), Some(2));
    let expected = "a signal ended the process";
    assert_eq!(
        (&line["verdict"], &line["error"]),
        (&Value::Null, &Value::from(expected))
    );
}

/// Regression test: a single curve, for which nothing is verified, was intact.
#[test]
fn one_curve_alone_is_not_intact() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("one.txt");
    let square = "4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
    std::fs::write(&file, square.repeat(2)).unwrap();
    let run = linkwatch(&["check", text(&file), "--closed"]);
    assert_eq!(run.code, 3, "{}", run.stdout);
    assert!(run.stderr.contains("one curve alone"), "{}", run.stderr);
    let recording = folder.path().join("one.mcap");
    for (option, code) in [
        ("--events=between", 3),
        ("--events=all", 0),
        ("--invariants=self", 0),
        ("--invariants=triple", 3),
    ] {
        let record = ["--force", "--record", text(&recording)];
        let check = ["check", text(&file), "--closed", option];
        let run = linkwatch(&[&check[..], &record].concat());
        assert_eq!(run.code, code, "{option}: {}", run.stdout);
        // The report said that it is intact.
        let run = linkwatch(&["report", "--text", text(&recording)]);
        assert_eq!(run.code, code, "{option}: {}", run.stdout);
    }
}

/// Regression test: files after a file of an unknown format were not verified.
#[test]
fn files_after_those_of_an_unknown_kind_are_verified() {
    let folder = TempDir::new().unwrap();
    let [topology, trajectory] = ["a.psf", "a.xtc"].map(|name| folder.path().join(name));
    for file in [&topology, &trajectory] {
        std::fs::write(file, "no model").unwrap();
    }
    let whole = chain(folder.path(), "whole.bcc", 0.5);
    let broken = chain(folder.path(), "broken.bcc", -5.0);
    let files = [&topology, &trajectory, &whole, &broken].map(|file| text(file));
    let run = linkwatch(&[&["check", "--keep-order"][..], &files].concat());
    assert_eq!(run.code, 2);
    let together = format!("linkwatch convert {} {} OUT", files[0], files[1]);
    assert!(run.stderr.contains(&together), "{}", run.stderr);
    assert!(run.stdout.contains("came apart"), "{}", run.stdout);
}

/// Writes a frame of extended XYZ in a cubic cell of 10: molecules with their numbers.
fn xyz(step: usize, molecules: &[(i64, Vec<[f64; 3]>)]) -> String {
    let atoms: usize = molecules.iter().map(|(_, points)| points.len()).sum();
    let mut text = format!(
        "{atoms}\nLattice=\"10 0 0 0 10 0 0 0 10\" Timestep={step} \
         Properties=species:S:1:pos:R:3:molecule:I:1:closed:L:1\n"
    );
    for (number, points) in molecules {
        for [x, y, z] in points {
            text += &format!("C {x:.9} {y:.9} {z:.9} {number} T\n");
        }
    }
    text
}

/// Points of a circle of radius 1 in the plane of two axes.
fn circle(at: [f64; 3], [u, v]: [usize; 2]) -> Vec<[f64; 3]> {
    let angle = |k: u32| std::f64::consts::TAU * f64::from(k) / 24.0;
    let point = |k| {
        let mut p = at;
        p[u] += angle(k).cos();
        p[v] += angle(k).sin();
        p
    };
    (0..24).map(point).collect()
}

/// Regression test: the jump counted as a large motion, and the run was not searched for
/// pull-throughs.
#[test]
fn frames_are_not_far_apart_if_a_curve_jumps_by_a_lattice_vector() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("jump.xyz");
    // The second ring leaves the first one and comes back: two pull-throughs.
    let frame = |k: usize| {
        let away = 0.1 * k.min(29 - k) as f64;
        let first = circle([5.0 - if k > 0 { 10.0 } else { 0.0 }, 5.0, 5.0], [0, 1]);
        xyz(
            k,
            &[(1, first), (2, circle([6.01 + away, 5.0, 5.0], [0, 2]))],
        )
    };
    std::fs::write(&file, (0..30).map(frame).collect::<String>()).unwrap();
    let run = linkwatch(&["check", text(&file)]);
    assert!(!run.stderr.contains("are far apart"), "{}", run.stderr);
    let passed = run.stdout.matches("passed through one another").count();
    assert!(run.code == 1 && passed >= 2, "{}{}", run.stdout, run.stderr);
}

/// Regression test: curves were identified by the order in which the molecules appear in the file.
#[test]
fn molecules_are_the_same_curves_in_any_order_of_a_file() {
    let folder = TempDir::new().unwrap();
    let rings = |x: f64| {
        let second = (2, circle([4.0 + x, 5.0, 5.0], [0, 2]));
        [
            (1, circle([3.0, 5.0, 5.0], [0, 1])),
            second,
            (7, circle([7.0, 5.0, 5.0], [0, 1])),
        ]
    };
    let [a, b, c] = rings(0.0);
    let same = [
        xyz(0, &rings(0.0)),
        xyz(1, &[c.clone(), a.clone(), b.clone()]),
    ];
    // Molecule 2 leaves 1 and joins 7.
    let [a2, b2, c2] = rings(2.0);
    let moved = [xyz(0, &rings(0.0)), xyz(1, &[c2, b2, a2])];
    // In the second file, another molecule takes the place of molecule 7.
    let other = [xyz(0, &rings(0.0)), xyz(1, &[a, b, (8, c.1)])];
    for (name, frames, code) in [("same", same, 0), ("moved", moved, 1), ("other", other, 3)] {
        let file = folder.path().join(format!("{name}.xyz"));
        std::fs::write(&file, frames.concat()).unwrap();
        let run = linkwatch(&["check", "--events=off", text(&file)]);
        assert_eq!(run.code, code, "{name}: {}{}", run.stdout, run.stderr);
        // The same as text, without a cell.
        let files = [0, 1].map(|k| folder.path().join(format!("{name}{k}.csv")));
        for (file, frame) in files.iter().zip(&frames) {
            let rows = frame.lines().skip(2).map(|line| {
                let words: Vec<&str> = line.split(' ').collect();
                format!("{},{},{},{}\n", words[4], words[1], words[2], words[3])
            });
            std::fs::write(file, format!("curve,x,y,z\n{}", rows.collect::<String>())).unwrap();
        }
        let [first, second] = files.each_ref().map(|file| text(file));
        let run = linkwatch(&["check", "--closed", "--events=off", first, second]);
        let code = if name == "other" { 0 } else { code };
        assert_eq!(run.code, code, "{name}: {}{}", run.stdout, run.stderr);
        assert_eq!(
            run.stdout.contains("appeared: 8; gone: 7"),
            name == "other",
            "{}",
            run.stdout
        );
    }
}
