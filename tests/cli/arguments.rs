//! Arguments and input that the command rejects.

use super::chain;
use crate::support::command::{linkwatch, text};
use std::path::PathBuf;
use tempfile::TempDir;

#[test]
fn bad_input_is_reported_in_one_line_and_exits_with_2() {
    let folder = TempDir::new().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let whole = chain(folder.path(), "whole.bcc", 0.5);
    let bytes = std::fs::read(&whole).unwrap();
    let nan = {
        let mut b = bytes.clone();
        b[68..72].copy_from_slice(&f32::NAN.to_le_bytes());
        b
    };
    let cases: [(PathBuf, &str); 6] = [
        (folder.path().join("none.bcc"), "none.bcc"),
        (file("cut.bcc", &bytes[..bytes.len() - 5]), "cut.bcc"),
        (file("nan.bcc", &nan), "coordinate x is NaN"),
        (file("model.stl", b""), "unknown kind of file"),
        (file("bad.vect", b"VECT 1 99999999999 0"), "bad.vect"),
        (file("mesh.obj", b"v 0 0 x\n"), "mesh.obj"),
    ];
    for (path, says) in &cases {
        let run = linkwatch(&["certify", text(path)]);
        assert_eq!(run.code, 2, "{}", run.stderr);
        assert!(run.stderr.starts_with("error: "), "{}", run.stderr);
        assert!(run.stderr.contains(says), "{}", run.stderr);
        assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
        assert_eq!(run.stdout, "");
    }
    let other = file("other.txt", b"9\n0,1,1\n");
    let run = linkwatch(&["check", text(&whole), "--baseline", text(&other)]);
    assert_eq!(run.code, 2);
    assert!(
        run.stderr.contains("9 curves, the model has 3"),
        "{}",
        run.stderr
    );
}

#[test]
fn bad_arguments_exit_with_2() {
    for args in [
        &["certify"][..],
        &["frobnicate"],
        &["check", "a.bcc"],
        &["certify", "a.bcc", "b.bcc", "-o", "c"],
    ] {
        assert_eq!(linkwatch(args).code, 2, "{args:?}");
    }
    assert_eq!(linkwatch(&["--help"]).code, 0);
    assert_eq!(linkwatch(&["--version"]).code, 0);
}

#[test]
fn what_is_written_in_another_way_says_so_in_one_line() {
    let explain = "plan is gone; instead: `linkwatch certify --explain MODEL`";
    let study = "is gone; instead: a command for developers";
    for (args, says) in [
        (&["plan", "ribbon"][..], explain),
        (&["study", "frames", "knit"], study),
        (&["sweep", "a.bcc", "--quantize", "24..8"], study),
        (&["certify", "a.bcc", "--repeat", "3"], "--repeat is gone"),
        (&["devices", "--calibrate"], "--calibrate is gone"),
        (&["check", "a.bcc", "--events", "all"], "write --events=all"),
        (
            &["check", "a.bcc", "--rrd", "a.rrd"],
            "--rrd is gone; instead: --show FILE.rrd",
        ),
        (
            &["watch", "--record-every=3"],
            "--record-every is gone; instead: --record FILE.mcap,every=N",
        ),
        (
            &["replay", "a.mcap", "--diff", "b.mcap"],
            "--diff is gone; instead: `linkwatch diff",
        ),
    ] {
        let run = linkwatch(args);
        assert_eq!((run.code, run.stdout.as_str()), (2, ""), "{args:?}");
        assert!(run.stderr.contains(says), "{args:?}: {}", run.stderr);
        assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
    }
}

#[test]
fn rejects_options_that_exclude_one_another() {
    let folder = TempDir::new().unwrap();
    let model = chain(folder.path(), "m.bcc", 0.5);
    let model = text(&model);
    let certificate = folder.path().join("c.txt");
    linkwatch(&["certify", model, "-o", text(&certificate)]);
    let check = ["check", model, "--baseline", text(&certificate)];
    let early = [&check[..], &["--early-exit"]].concat();
    let cases: [(Vec<&str>, &str); 5] = [
        (vec!["--threads", "0", "certify", model], "1..=1024"),
        (vec!["--threads", "100000", "certify", model], "1..=1024"),
        ([&early[..], &["--events"]].concat(), "--events"),
        (vec!["certify", model, "--kernel=fmm,beta=2"], "barnes-hut"),
        (vec!["certify", model, "--explain", "-o", "c"], "--explain"),
    ];
    for (args, says) in cases {
        let run = linkwatch(&args);
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        assert!(run.stderr.contains(says), "{args:?}: {}", run.stderr);
    }
    assert_eq!(linkwatch(&["--threads", "3", "certify", model]).code, 0);
}
