//! The command at the boundary of its process: what it prints, where, and how it exits.

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

/// Three squares: the first two linked where `at` is 1, apart where it is 5, touching where it is 2; the
/// third stands alone, linked with the second.
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
fn certify_writes_what_check_accepts() {
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
    assert!(run.stdout.starts_with("3\n0,1,"), "{}", run.stdout);
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
        "no number for the touching one: {}",
        run.stdout
    );
    let run = linkwatch(&["certify", text(&touching), "-o", text(&certificate)]);
    assert_eq!(run.code, 2);
    assert!(
        run.stderr.contains("no certificate written"),
        "{}",
        run.stderr
    );
    assert!(!certificate.exists());
}

#[test]
fn bad_input_is_told_in_one_line_and_exits_with_2() {
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
fn open_curves_and_repeated_vertices_are_told() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("open.obj");
    std::fs::write(
        &path,
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 1 1 0\nv 5 5 5\nv 6 6 6\nl 1 2 3 4 1\nl 5 6\n",
    )
    .unwrap();
    let run = linkwatch(&["certify", text(&path)]);
    assert_eq!((run.code, run.stdout.as_str()), (0, "2\n"));
    assert!(
        run.stderr.contains("1 open curve left out"),
        "{}",
        run.stderr
    );
    assert!(
        run.stderr.contains("1 repeated vertex merged"),
        "{}",
        run.stderr
    );
}

/// A model whose curves are all open has nothing to be intact.
#[test]
fn open_curves_alone_are_not_intact() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("open.obj");
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 1 1 0\nl 1 2 3\n").unwrap();
    let certificate = folder.path().join("c.txt");
    std::fs::write(&certificate, "1\n").unwrap();
    let run = linkwatch(&["check", text(&path), "--against", text(&certificate)]);
    assert_eq!((run.code, run.stdout.as_str()), (2, ""));
    assert!(run.stderr.contains("nothing to verify"), "{}", run.stderr);
}

/// A reader that goes away does not turn a change into a success.
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

/// One frame that cannot be read hides no verdict on the others.
#[test]
fn check_goes_on_after_a_model_that_cannot_be_read() {
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

/// Two loops that are no loops, and a link beside them.
#[test]
fn degenerate_loops_are_named_and_the_others_certified() {
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
    assert!(run.stdout.starts_with("3\n1,2,"), "{}", run.stdout);
}

/// One change among thousands of pairs, and an intact model, with `--early-exit` and without.
#[test]
fn early_exit_finds_the_change_and_counts_what_it_left() {
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
    // An intact model is intact only when nothing is left.
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
    // The number of threads decides nothing, nor does the kernel.
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
    assert_eq!(run.code, 2, "early exit counts");
}

/// A square that leaves the one that it is linked with, flies through it, or folds through itself.
#[test]
fn check_tells_pull_throughs_between_models() {
    let folder = TempDir::new().unwrap();
    let frames = [-5.0, 0.5, 5.0].map(|at| chain(folder.path(), &format!("{at}.bcc"), at));
    let [left, linked, right] = frames.each_ref().map(|path| text(path));
    let cert = folder.path().join("c.txt");
    linkwatch(&["certify", left, "-o", text(&cert)]);
    let check = |models: &[&str], more: &[&str]| {
        let run = linkwatch(&[&["check", "--against", text(&cert)], models, more].concat());
        (run.code, run.stdout)
    };
    // Each model by itself is as it should be.
    assert_eq!(check(&[left, right], &[]).0, 0);
    let (code, out) = check(&[left, right], &["--events"]);
    assert_eq!(code, 1, "{out}");
    let passed = out
        .matches("curves 0 and 1 passed through one another at 0.")
        .count();
    assert_eq!(passed, 4, "{out}");
    assert!(out.contains("5.bcc: changed\n"), "{out}");
    // A change, and how it came.
    let (code, out) = check(&[left, linked], &["--self"]);
    assert_eq!(code, 1);
    assert!(out.contains("curves 0 and 1 became linked"), "{out}");
    assert!(out.contains("passed through one another"), "{out}");

    // Two ends of a curve change places, one above the other.
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
    linkwatch(&["certify", text(&before), "-o", text(&cert)]);
    let models = [text(&before), text(&after)];
    assert_eq!(check(&models, &["--events"]).0, 0);
    let (code, out) = check(&models, &["--self"]);
    assert_eq!(code, 1, "{out}");
    let told = "curve 0 passed through itself at 0.500 of the step";
    assert!(out.contains(told), "{out}");
    // Between other curves there is no motion; with early exit little is known.
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

/// Every kernel comes to the same certificate, and says who decided.
#[test]
fn kernels_agree_and_say_who_decided() {
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
        ("barnes-hut", &["--beta", "2", "--dipole"]),
        ("barnes-hut", &["--beta", "2", "--target", "0.01"]),
        ("fmm", &[]),
        ("fmm", &["--order", "3"]),
        ("interval", &[]),
    ] {
        let found = certify(&[&["--kernel", kernel], more].concat());
        assert_eq!(found["certificate"], expected["certificate"], "{kernel}");
        let of = |what: &str| found["ladder"][what].as_u64().unwrap();
        assert_eq!(of("summed") + of("counted"), pairs, "{kernel}");
        // By the bound all are proven; by a coarse beta few are, and no wrong one is believed.
        if more.is_empty() {
            assert_eq!(of("counted"), 0, "{kernel}");
        }
        let error = found["ladder"]["largest_error"].as_f64().unwrap();
        assert!(error < 0.2, "{kernel} {more:?}: {error}");
    }
    let run = linkwatch(&["certify", scene, "--kernel", "guess"]);
    assert_eq!(run.code, 2);
}

/// Two linked squares whose edges are 1 apart in the maximum norm keep their number below half of that, and say from
/// there on which segments may meet.
#[test]
fn noise_is_borne_as_long_as_no_segments_can_meet() {
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
            (3, "2\n0,1,undefined\n"),
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

/// Devices are listed; one that is not there is an error that says which are; the processor is always there.
#[test]
fn devices_are_listed_and_unknown_ones_refused() {
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
