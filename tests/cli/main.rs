//! Tests of the command as a process: its output, its streams and its exit codes.

mod sequences;

use linkwatch::{Basis, CurveSet, Positions, model};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

struct Run {
    code: i32,
    stdout: String,
    stderr: String,
}

fn linkwatch(args: &[&str]) -> Run {
    let Output {
        status,
        stdout,
        stderr,
    } = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
        .args(args)
        .output()
        .unwrap();
    Run {
        code: status.code().unwrap(),
        stdout: String::from_utf8(stdout).unwrap(),
        stderr: String::from_utf8(stderr).unwrap(),
    }
}

/// A square in the plane of `axes` around `center`.
fn square(center: [f32; 3], axes: [usize; 2]) -> Vec<f32> {
    [[-1., -1.], [1., -1.], [1., 1.], [-1., 1.]]
        .iter()
        .flat_map(|corner| {
            let mut p = center;
            p[axes[0]] += corner[0];
            p[axes[1]] += corner[1];
            p
        })
        .collect()
}

/// Three squares. The first two are linked if `at` is 1, touch if it is 2, and are apart if it is
/// 5. The third one is linked with the second.
fn chain(folder: &Path, name: &str, at: f32) -> PathBuf {
    let xyz: Vec<f32> = [
        square([at - 1.0, 0., 0.], [0, 1]),
        square([1., 0., 0.], [0, 2]),
        square([2., 0., 0.5], [0, 1]),
    ]
    .concat();
    let set = CurveSet::from_counts(Basis::Polyline, &[-4, -4, -4], Positions::F32(&xyz)).unwrap();
    let path = folder.join(name);
    model::write_bcc(&path, &set).unwrap();
    path
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

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
    let run = linkwatch(&["check", text(&whole), "--against", text(&certificate)]);
    assert_eq!(run.code, 0);
    assert!(
        run.stdout.ends_with("whole.bcc: intact\n"),
        "{}",
        run.stdout
    );
}

#[test]
fn check_names_the_pair_and_exits_with_1() {
    let folder = TempDir::new().unwrap();
    let whole = chain(folder.path(), "whole.bcc", 0.5);
    let broken = chain(folder.path(), "broken.bcc", -5.0);
    let [certificate, pairs, curves] = ["c.txt", "p.txt", "k.txt"].map(|n| folder.path().join(n));
    linkwatch(&["certify", text(&whole), "-o", text(&certificate)]);
    let run = linkwatch(&[
        "check",
        text(&whole),
        text(&broken),
        "--against",
        text(&certificate),
        "--diff-pairs",
        text(&pairs),
        "--diff-curves",
        text(&curves),
    ]);
    assert_eq!(run.code, 1);
    assert!(
        run.stdout.contains("curves 0 and 1 came apart"),
        "{}",
        run.stdout
    );
    assert!(run.stdout.contains("near ("), "{}", run.stdout);
    let expected = std::fs::read_to_string(&certificate).unwrap();
    let lambda = expected.lines().nth(1).unwrap().rsplit(',').next().unwrap();
    assert_eq!(
        std::fs::read_to_string(&pairs).unwrap(),
        format!("0,1,{lambda},0\n")
    );
    assert_eq!(std::fs::read_to_string(&curves).unwrap(), "0\n1\n");
    let run = linkwatch(&[
        "check",
        "--json",
        text(&broken),
        "--against",
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
    let run = linkwatch(&["check", text(&whole), "--against", text(&other)]);
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
fn reports_open_curves_and_repeated_vertices() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("open.obj");
    std::fs::write(
        &path,
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 1 1 0\nv 5 5 5\nv 6 6 6\nl 1 2 3 4 1\nl 5 6\n",
    )
    .unwrap();
    let run = linkwatch(&["certify", text(&path)]);
    assert_eq!((run.code, run.stdout.as_str()), (0, "2 # lines: 0\n"));
    assert!(
        run.stderr.contains("1 open curve skipped"),
        "{}",
        run.stderr
    );
    assert!(
        run.stderr.contains("1 repeated vertex merged"),
        "{}",
        run.stderr
    );
}

/// A model of open curves only has nothing that could be intact.
#[test]
fn a_model_of_open_curves_is_not_intact() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("open.obj");
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 1 1 0\nl 1 2 3\n").unwrap();
    let certificate = folder.path().join("c.txt");
    std::fs::write(&certificate, "1\n").unwrap();
    let run = linkwatch(&["check", text(&path), "--against", text(&certificate)]);
    assert_eq!((run.code, run.stdout.as_str()), (2, ""));
    assert!(run.stderr.contains("nothing to verify"), "{}", run.stderr);
}

/// A reader that closes the pipe does not turn a change into a success.
#[test]
fn a_closed_pipe_keeps_the_exit_code() {
    let folder = TempDir::new().unwrap();
    let broken = chain(folder.path(), "broken.bcc", -5.0);
    let certificate = folder.path().join("c.txt");
    std::fs::write(&certificate, "3\n0,1,1\n").unwrap();
    let mut process = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
        .args(["check", text(&broken), "--against", text(&certificate)])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    drop(process.stdout.take());
    assert_eq!(process.wait().unwrap().code(), Some(1));
}

/// A frame that cannot be read hides no verdict on the others.
#[test]
fn check_continues_after_a_model_that_cannot_be_read() {
    let folder = TempDir::new().unwrap();
    let broken = chain(folder.path(), "broken.bcc", -5.0);
    let [none, certificate, pairs] = ["none.bcc", "c.txt", "p.txt"].map(|n| folder.path().join(n));
    std::fs::write(&certificate, "3\n0,1,1\n").unwrap();
    let run = linkwatch(&[
        "check",
        text(&none),
        text(&broken),
        "--against",
        text(&certificate),
        "--diff-pairs",
        text(&pairs),
    ]);
    assert_eq!(run.code, 2);
    assert!(run.stdout.contains("changed"), "{}", run.stdout);
    assert!(
        std::fs::read_to_string(&pairs)
            .unwrap()
            .starts_with("0,1,1,0")
    );
}

/// Two degenerate loops, and a link beside them.
#[test]
fn names_degenerate_loops_and_certifies_the_others() {
    let folder = TempDir::new().unwrap();
    let xyz: Vec<f32> = [
        vec![0.0; 12],
        square([0., 0., 0.], [0, 1]),
        square([1., 0., 0.], [0, 2]),
    ]
    .concat();
    let set = CurveSet::from_counts(Basis::Polyline, &[-4, -4, -4], Positions::F32(&xyz)).unwrap();
    let path = folder.path().join("flat.bcc");
    model::write_bcc(&path, &set).unwrap();
    let run = linkwatch(&["certify", text(&path)]);
    assert_eq!(run.code, 3);
    assert!(
        run.stderr
            .contains("curve 0 has fewer than three distinct vertices"),
        "{}",
        run.stderr
    );
    assert!(
        run.stdout.starts_with("3 # lines: 2\n1,2,"),
        "{}",
        run.stdout
    );
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
            "--against",
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
    // The result does not depend on the number of threads or the kernel.
    assert_eq!(check("2", &["--early-exit"]).2, early);
    let (code, _, summed) = check("2", &["--kernel", "barnes-hut"]);
    assert_eq!((code, &summed["changes"]), (1, &full["changes"]));
    let run = linkwatch(&[
        "check",
        model,
        "--against",
        cert,
        "--early-exit",
        "--kernel",
        "direct",
    ]);
    assert_eq!(run.code, 2, "early exit needs counting");
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
        let run = linkwatch(&[&["check", "--against", text(&cert)], models, more].concat());
        (run.code, run.stdout)
    };
    // Each model on its own is intact.
    assert_eq!(check(&[left, right], &[]).0, 0);
    // The frames are too far apart to decide whether four pull-throughs that cancel took place.
    let (code, out) = check(&[left, right], &["--events"]);
    assert_eq!(code, 3, "{out}");
    assert_eq!(out.matches("unresolved: ").count(), 4, "{out}");
    let (code, out) = check(&[left, right], &["--events", "--motion-limit", "10"]);
    assert_eq!(code, 1, "{out}");
    let passed = out
        .matches("curves 0 and 1 passed through one another at 0.")
        .count();
    assert_eq!(passed, 4, "{out}");
    assert!(out.contains("5.bcc: changed\n"), "{out}");
    // A change, and the pull-through that caused it.
    let (code, out) = check(&[left, linked], &["--self"]);
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
        model::write_bcc(&path, &set).unwrap();
        path
    };
    let [before, after] = [fold("before.bcc", 0.5), fold("after.bcc", -0.5)];
    linkwatch(&["certify", text(&before), "--force", "-o", text(&cert)]);
    let models = [text(&before), text(&after)];
    assert_eq!(check(&models, &["--events"]).0, 0);
    let (code, out) = check(&models, &["--self"]);
    assert_eq!(code, 1, "{out}");
    let reported = "curve 0 passed through itself at 0.500 of the step";
    assert!(out.contains(reported), "{out}");
    // There is no motion between different curves; early exit knows only some linking numbers.
    let run = linkwatch(&[
        "check",
        left,
        text(&before),
        "--against",
        text(&cert),
        "--events",
    ]);
    assert_eq!(run.code, 2);
    let run = linkwatch(&[
        "check",
        left,
        "--against",
        text(&cert),
        "--events",
        "--early-exit",
    ]);
    assert_eq!(run.code, 2);
}

/// All kernels give the same certificate, and report how it was decided.
#[test]
fn kernels_agree_and_report_how_pairs_were_decided() {
    let scene = "knit:rows=3,stitches=16,segments=576";
    let certify = |more: &[&str]| {
        let run = linkwatch(&[&["--json", "certify", scene], more].concat());
        assert_eq!(run.code, 0, "{}", run.stderr);
        serde_json::from_str::<serde_json::Value>(&run.stdout).unwrap()
    };
    let expected = certify(&[]);
    assert_eq!(expected["kernel"], "auto");
    assert_eq!(expected["ladder"]["summed"], 0);
    assert_eq!(
        expected["ladder"]["counted"],
        expected["stats"]["potential_links"]
    );
    let pairs = expected["stats"]["potential_links"].as_u64().unwrap();
    for (kernel, more) in [
        ("direct", &[][..]),
        ("angle-sum", &[]),
        ("barnes-hut", &[]),
        ("barnes-hut", &["--beta", "2"]),
        ("barnes-hut", &["--beta", "2", "--target", "0.01"]),
        ("fmm", &[]),
        ("fmm", &["--order", "3"]),
        ("interval", &[]),
    ] {
        let found = certify(&[&["--kernel", kernel], more].concat());
        assert_eq!(found["certificate"], expected["certificate"], "{kernel}");
        let of = |what: &str| found["ladder"][what].as_u64().unwrap();
        assert_eq!(of("summed") + of("counted"), pairs, "{kernel}");
        // By the bound, all are proven. By a coarse beta, few are proven, and no wrong one is
        // accepted.
        if more.is_empty() {
            assert_eq!(of("counted"), 0, "{kernel}");
        }
        let error = found["ladder"]["largest_error"].as_f64().unwrap();
        assert!(error < 0.2, "{kernel} {more:?}: {error}");
    }
    let run = linkwatch(&["certify", scene, "--kernel", "guess"]);
    assert_eq!(run.code, 2);
}

/// Two linked squares whose edges are 1 apart in the maximum norm keep their linking number below
/// half of that. From there on the segments that may touch are named.
#[test]
fn noise_keeps_the_number_until_segments_may_touch() {
    let folder = TempDir::new().unwrap();
    let xyz = [square([0., 0., 0.], [0, 1]), square([1., 0., 0.], [0, 2])].concat();
    let set = CurveSet::from_counts(Basis::Polyline, &[-4, -4], Positions::F32(&xyz)).unwrap();
    let model = folder.path().join("hopf.bcc");
    model::write_bcc(&model, &set).unwrap();
    let certify = |noise: &str| linkwatch(&["certify", text(&model), "--noise", noise]);
    let exact = linkwatch(&["certify", text(&model)]).stdout;
    for noise in ["0", "0.1", "0.499"] {
        let run = certify(noise);
        assert_eq!(
            (run.code, &run.stdout),
            (0, &exact),
            "{noise}: {}",
            run.stderr
        );
    }
    for noise in ["0.5", "0.7", "100"] {
        let run = certify(noise);
        assert_eq!(
            (run.code, run.stdout.as_str()),
            (3, "2 # lines: 1\n0,1,undefined\n"),
            "{noise}"
        );
        assert!(
            run.stderr.contains("curves 0 and 1 are too close"),
            "{}",
            run.stderr
        );
        assert!(run.stderr.contains("segments"), "{}", run.stderr);
    }
    assert_eq!(certify("-1").code, 2);
    let run = linkwatch(&[
        "certify",
        "knit:rows=3,stitches=16,segments=576",
        "--noise",
        "0.1",
    ]);
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("splines"), "{}", run.stderr);
}

/// Devices are listed. The error of an unknown device lists the adapters. The CPU is always
/// available.
#[test]
fn lists_devices_and_rejects_unknown_ones() {
    let run = linkwatch(&["devices"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(!run.stdout.is_empty());
    let names: Vec<String> = linkwatch(&["--json", "devices"])
        .stdout
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap())
        .map(|device| device["name"].as_str().unwrap().to_string())
        .collect();
    let scene = "chainmail:rows=2,columns=2";
    let run = linkwatch(&["certify", scene, "--device", "no such adapter"]);
    assert_eq!(run.code, 2);
    for (index, name) in names.iter().enumerate() {
        let listed = format!("{index}: {name}");
        assert!(run.stderr.contains(&listed), "{}", run.stderr);
    }
    let certify = |device: &str| linkwatch(&["certify", scene, "--device", device]);
    let expected = certify("cpu");
    assert_eq!(expected.code, 0, "{}", expected.stderr);
    assert_eq!(certify("auto").stdout, expected.stdout);
    let on_adapter = certify("gpu");
    match names.is_empty() {
        true => assert_eq!(on_adapter.code, 2),
        false => assert_eq!(on_adapter.stdout, expected.stdout),
    }
    for index in 0..names.len() {
        assert_eq!(certify(&index.to_string()).stdout, expected.stdout);
    }
    assert_eq!(certify(&names.len().to_string()).code, 2);
}

/// Runs the command with other streams than [`linkwatch`] does.
#[cfg(target_os = "linux")]
fn with_streams(args: &[&str], stdout: Option<&str>, stderr: Option<&str>) -> Run {
    use std::process::Stdio;
    let open = |path: Option<&str>| match path {
        Some(path) => Stdio::from(std::fs::File::options().write(true).open(path).unwrap()),
        None => Stdio::piped(),
    };
    let process = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
        .args(args)
        .stdout(open(stdout))
        .stderr(open(stderr))
        .spawn()
        .unwrap();
    let Output {
        status,
        stdout,
        stderr,
    } = process.wait_with_output().unwrap();
    Run {
        // The process was killed by a signal, as by an abort.
        code: status.code().unwrap_or(-1),
        stdout: String::from_utf8(stdout).unwrap(),
        stderr: String::from_utf8(stderr).unwrap(),
    }
}

/// Regression test: a panic with exit code 101 or 134, or exit code 2 as for bad input.
#[test]
#[cfg(target_os = "linux")]
fn a_full_standard_output_loses_results_and_reports_it() {
    let folder = TempDir::new().unwrap();
    let whole = chain(folder.path(), "whole.bcc", 0.5);
    let broken = chain(folder.path(), "broken.bcc", -5.0);
    let certificate = folder.path().join("c.txt");
    linkwatch(&["certify", text(&whole), "-o", text(&certificate)]);
    let check = ["check", text(&whole), "--against", text(&certificate)];
    for args in [&["certify", text(&whole)][..], &check, &["generate"]] {
        let run = with_streams(args, Some("/dev/full"), None);
        assert_eq!(run.code, 3, "{args:?}: {}", run.stderr);
        let reported = run
            .stderr
            .matches("error: standard output: No space left")
            .count();
        assert_eq!(reported, 1, "{args:?}: {}", run.stderr);
        assert!(run.stderr.trim_end().ends_with("lost"), "{}", run.stderr);
        // A log that cannot be written is ignored.
        let run = with_streams(args, None, Some("/dev/full"));
        assert_eq!(run.code, 0, "{args:?}");
        assert_eq!(run.stdout, linkwatch(args).stdout);
    }
    // The exit code still reports the finding.
    let check = ["check", text(&broken), "--against", text(&certificate)];
    assert_eq!(with_streams(&check, Some("/dev/full"), None).code, 1);
    let none = ["certify", "no such model"];
    assert_eq!(
        with_streams(&none, Some("/dev/full"), Some("/dev/full")).code,
        2
    );
}

/// Regression test: each of these commands destroyed a file, under its own name, a hard link or a
/// symbolic link.
#[test]
fn no_output_overwrites_an_input_or_another_output() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    chain(folder.path(), "m.bcc", 0.5);
    linkwatch(&["certify", &at("m.bcc"), "-o", &at("c.txt")]);
    std::fs::hard_link(at("m.bcc"), at("hard.txt")).unwrap();
    std::fs::hard_link(at("c.txt"), at("c-hard.txt")).unwrap();
    let mut names = vec!["m.bcc", "hard.txt"];
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(at("m.bcc"), at("soft.txt")).unwrap();
        names.push("soft.txt");
    }
    let before = ["m.bcc", "c.txt"].map(|name| std::fs::read(at(name)).unwrap());
    let refused = |args: &[&str], says: &[&str]| {
        for force in [&[][..], &["--force"]] {
            let run = linkwatch(&[args, force].concat());
            assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
            let reported = says.iter().all(|&word| run.stderr.contains(word));
            assert!(reported, "{args:?}: {}", run.stderr);
            let after = ["m.bcc", "c.txt"].map(|name| std::fs::read(at(name)).unwrap());
            assert!(after == before, "{args:?} destroyed a file");
        }
    };
    let (model, certificate) = (&at("m.bcc")[..], &at("c.txt")[..]);
    for name in names {
        let output = &at(name)[..];
        let same: &[&str] = match name {
            "m.bcc" => &["a model"],
            _ => &["same file", name, "m.bcc"],
        };
        refused(&["certify", model, "-o", output], same);
        let check = ["check", model, "--against", certificate];
        refused(&[&check[..], &["--diff-pairs", output]].concat(), same);
        refused(&[&check[..], &["--diff-curves", output]].concat(), same);
        let study = ["study", "kernels", model, "--csv", output];
        refused(&study, same);
    }
    let check = ["check", model, "--against", certificate];
    let hard = &at("c-hard.txt")[..];
    refused(
        &[&check[..], &["--diff-pairs", hard]].concat(),
        &["same file", "c.txt"],
    );
    let (new, again) = (&at("new.txt")[..], &at("./new.txt")[..]);
    let both = ["--diff-pairs", new, "--diff-curves", again];
    refused(
        &[&check[..], &both].concat(),
        &["same file", "--diff-pairs"],
    );
    let scene = "chainmail:rows=2,columns=2";
    let (bcc, other) = (&at("n.bcc")[..], &at("./n.bcc")[..]);
    let both = ["generate", scene, "-o", bcc, "--certificate", other];
    refused(&both, &["a model"]);
    assert!(!Path::new(new).exists() && !Path::new(bcc).exists());
}

#[test]
fn an_existing_output_is_overwritten_only_with_force() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    let model = chain(folder.path(), "m.bcc", 0.5);
    let model = text(&model);
    linkwatch(&["certify", model, "-o", &at("c.txt")]);
    let plots = folder.path().join("plots");
    std::fs::create_dir(&plots).unwrap();
    std::fs::write(plots.join("error-beta.svg"), "mine").unwrap();
    let scene = "chainmail:rows=2,columns=2";
    let [out, bcc, against] = ["out.txt", "out.bcc", "c.txt"].map(at);
    let commands: [(&[&str], &str); 6] = [
        (&["certify", model, "-o", &out], &out),
        (
            &["check", model, "--against", &against, "--diff-pairs", &out],
            &out,
        ),
        (
            &["check", model, "--against", &against, "--diff-curves", &out],
            &out,
        ),
        (&["generate", scene, "-o", &bcc], &bcc),
        (
            &["study", "kernels", scene, "--repeat", "1", "--csv", &out],
            &out,
        ),
        (
            &[
                "study",
                "table1",
                "--only",
                "rubber",
                "--segments",
                "10",
                "--csv",
                &out,
            ],
            &out,
        ),
    ];
    for (args, file) in commands {
        std::fs::write(file, "mine").unwrap();
        let run = linkwatch(args);
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        assert!(
            run.stderr.contains("exists; --force overwrites it"),
            "{}",
            run.stderr
        );
        assert!(run.stderr.contains(file), "{}", run.stderr);
        assert_eq!(std::fs::read(file).unwrap(), b"mine");
        let run = linkwatch(&[args, &["--force"]].concat());
        assert_eq!(run.code, 0, "{args:?}: {}", run.stderr);
        assert_ne!(std::fs::read(file).unwrap(), b"mine", "{args:?}");
    }
    let run = linkwatch(&["study", "kernels", scene, "--plot", text(&plots)]);
    assert_eq!(run.code, 2, "{}", run.stderr);
    assert!(run.stderr.contains("error-beta.svg"), "{}", run.stderr);
    let names = std::fs::read_dir(folder.path()).unwrap();
    let parts = names.filter(|e| e.as_ref().unwrap().path().extension() == Some("part".as_ref()));
    assert_eq!(parts.count(), 0);
}

/// Text is written to its destination: a pipe, `/dev/null`, or appended to an existing file.
#[test]
#[cfg(target_os = "linux")]
fn text_may_be_written_to_devices_and_to_standard_output() {
    let folder = TempDir::new().unwrap();
    let model = chain(folder.path(), "m.bcc", 0.5);
    let expected = linkwatch(&["certify", text(&model)]).stdout;
    let run = linkwatch(&["certify", text(&model), "-o", "/dev/stdout"]);
    assert_eq!(
        (run.code, run.stdout),
        (0, expected.clone()),
        "{}",
        run.stderr
    );
    assert_eq!(
        linkwatch(&["certify", text(&model), "-o", "/dev/null"]).code,
        0
    );
    let log = folder.path().join("log.txt");
    std::fs::write(&log, "before\n").unwrap();
    let append = std::fs::File::options().append(true).open(&log).unwrap();
    let status = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
        .args(["-q", "certify", text(&model), "-o", "/dev/stdout"])
        .stdout(append)
        .status()
        .unwrap();
    assert!(status.success());
    let written = std::fs::read_to_string(&log).unwrap();
    assert_eq!(written, format!("before\n{expected}"));
}

/// The model does not exist either: the output is checked first, because certifying may take hours.
#[test]
fn an_invalid_output_is_reported_before_the_work() {
    for args in [
        &["certify", "none.bcc", "-o", "/no/such/folder/c.txt"][..],
        &[
            "check",
            "none.bcc",
            "--against",
            "c",
            "--diff-pairs",
            "/no/such/folder/c.txt",
        ],
        &[
            "study",
            "kernels",
            "none.bcc",
            "--csv",
            "/no/such/folder/c.txt",
        ],
    ] {
        let run = linkwatch(args);
        assert_eq!(run.code, 2);
        assert!(
            run.stderr.contains("/no/such/folder/c.txt"),
            "{}",
            run.stderr
        );
    }
}

#[test]
fn rejects_options_that_exclude_one_another() {
    let folder = TempDir::new().unwrap();
    let model = chain(folder.path(), "m.bcc", 0.5);
    let model = text(&model);
    let certificate = folder.path().join("c.txt");
    linkwatch(&["certify", model, "-o", text(&certificate)]);
    let check = ["check", model, "--against", text(&certificate)];
    let early = [&check[..], &["--early-exit"]].concat();
    let cases: [(Vec<&str>, &str); 11] = [
        (vec!["--threads", "0", "certify", model], "1..=1024"),
        (vec!["--threads", "100000", "certify", model], "1..=1024"),
        ([&early[..], &["--events"]].concat(), "--events"),
        ([&early[..], &["--self"]].concat(), "--self"),
        ([&early[..], &["--kernel", "direct"]].concat(), "--kernel"),
        ([&early[..], &["--device", "gpu"]].concat(), "--device"),
        (vec!["certify", model, "--beta", "2"], "--kernel barnes-hut"),
        (
            vec!["certify", model, "--kernel", "fmm", "--beta", "2"],
            "--kernel barnes-hut",
        ),
        (
            vec!["certify", model, "--kernel", "direct", "--order", "3"],
            "--kernel fmm",
        ),
        (
            vec!["certify", model, "--repeat", "1", "-o", "c"],
            "--repeat",
        ),
        (vec!["devices", "--repeat", "2"], "--measure"),
    ];
    for (args, says) in cases {
        let run = linkwatch(&args);
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        assert!(run.stderr.contains(says), "{args:?}: {}", run.stderr);
    }
    assert_eq!(linkwatch(&["--threads", "3", "certify", model]).code, 0);
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
    let run = linkwatch(&["check", text(&model), "--against", text(&certificate)]);
    assert_eq!(run.code, 2, "{}", run.stdout);
    assert!(run.stderr.contains("the file was cut"), "{}", run.stderr);
}
