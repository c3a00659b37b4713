//! Tests of `linkwatch generate` as a process.

mod support;

use support::command::{Run, linkwatch, text};
use tempfile::TempDir;

/// Returns the names of the files in a folder.
fn files(folder: &TempDir) -> Vec<String> {
    let entries = std::fs::read_dir(folder.path()).unwrap();
    let names = entries.map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

#[test]
fn a_generated_model_has_its_certificate() {
    for scene in [
        "chainmail:rows=4,columns=5,crumple=1",
        "knit:rows=3,stitches=16,segments=576",
        "ribbon:segments=2000,lambda=-12",
        "rubber_bands:bands=40",
        "square_link:loops=8,segments=100",
        "torus_link:segments=2000,toroidal=-2,poloidal=3",
        "torus_zero:segments=4000,periods=4",
        "woundball:segments=2000,crossings=11",
    ] {
        let folder = TempDir::new().unwrap();
        let [model, certificate] = ["a.bcc", "a.txt"].map(|n| folder.path().join(n));
        let Run {
            code,
            stdout,
            stderr,
        } = linkwatch(&[
            "generate",
            scene,
            "-o",
            text(&model),
            "--certificate",
            text(&certificate),
        ]);
        assert_eq!((code, stdout.as_str()), (0, ""), "{stderr}");
        assert!(stderr.contains("a.bcc: wrote"), "{stderr}");
        assert_eq!(files(&folder), ["a.bcc", "a.txt"]);
        let Run {
            code,
            stdout: found,
            stderr,
        } = linkwatch(&["certify", text(&model)]);
        assert_eq!(code, 0, "{stderr}");
        assert_eq!(
            found,
            std::fs::read_to_string(&certificate).unwrap(),
            "{scene}"
        );
    }
}

#[test]
fn reports_tests_decided_by_exact_arithmetic() {
    let folder = TempDir::new().unwrap();
    let model = folder.path().join("a.bcc");
    // Rings in axis planes have vertices exactly above one another; tilted rings do not.
    for (scene, some) in [
        ("chainmail:rows=4,columns=5,tilt=0", true),
        ("chainmail:rows=4,columns=5", false),
    ] {
        linkwatch(&["generate", scene, "--force", "-o", text(&model)]);
        let Run { stdout, stderr, .. } = linkwatch(&["certify", "--json", text(&model)]);
        assert_eq!(stderr.contains("decided exactly ("), some, "{stderr}");
        let json: serde_json::Value = serde_json::from_str(&stdout).unwrap();
        let count = |name: &str| json["stats"][name].as_f64().unwrap();
        let share = count("exact") / count("tests");
        assert_eq!(json["exact_share"], share);
        assert_eq!(some, share > 0.0);
        assert!(share <= 1.0);
        let reported = format!("decided exactly ({:.2} %)", 100.0 * share);
        assert_eq!(stderr.contains(&reported), some, "{stderr}");
    }
}

#[test]
fn prints_the_result_as_json() {
    let folder = TempDir::new().unwrap();
    let model = folder.path().join("a.bcc");
    let scene = "ribbon:segments=2000";
    let Run { code, stdout, .. } = linkwatch(&["generate", "--json", scene, "-o", text(&model)]);
    let json: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(code, 0);
    assert_eq!(json["scene"], "ribbon:segments=2000,lambda=10");
    assert_eq!(json["model"], text(&model));
    assert_eq!(
        (&json["curves"], &json["segments"]),
        (&2.into(), &2000.into())
    );
    assert_eq!(
        (&json["links"], &json["certificate"]),
        (&1.into(), &().into())
    );
}

#[test]
fn lists_scenes() {
    let Run { code, stdout, .. } = linkwatch(&["generate", "--list"]);
    assert_eq!(
        (code, stdout.as_str()),
        (0, linkwatch(&["generate"]).stdout.as_str())
    );
    assert!(stdout.contains("\nribbon: double helix"), "{stdout}");
    assert!(stdout.contains("  segments=200000 "), "{stdout}");
    assert!(stdout.contains("(-1,000,000 to 1,000,000)"), "{stdout}");
    let Run { code, stdout, .. } = linkwatch(&["generate", "--list", "--json"]);
    let lines: Vec<serde_json::Value> = stdout
        .lines()
        .map(|l| serde_json::from_str(l).unwrap())
        .collect();
    assert_eq!(code, 0);
    assert_eq!(lines.len(), 8);
    assert_eq!(lines[0]["name"], "chainmail");
    assert_eq!(lines[0]["parameters"][2]["name"], "crumple");
    assert_eq!(lines[0]["parameters"][2]["max"], 1.0);
}

#[test]
fn bad_arguments_exit_with_2_and_leave_no_file() {
    let folder = TempDir::new().unwrap();
    let [model, other, nowhere] = ["a.bcc", "a.obj", "none/a.bcc"].map(|n| folder.path().join(n));
    for (args, says) in [
        (
            &["rope", "-o", text(&model)][..],
            "unknown (known: chainmail",
        ),
        (
            &["ribbon:lambda=x", "-o", text(&model)],
            "expected an integer from",
        ),
        (&["ribbon:lambda=1e6", "-o", text(&model)], "smaller lambda"),
        (&["ribbon"], "--output"),
        (&["-o", text(&model)], "SCENE"),
        (&["--certificate", "c.txt"], "SCENE"),
        (&["ribbon", "--list", "-o", text(&model)], "--list"),
        (
            &["ribbon", "-o", text(&other)],
            "a.obj: scenes are written as .bcc",
        ),
        (
            &["ribbon", "-o", text(&nowhere)],
            "none/a.bcc: its folder does not exist",
        ),
    ] {
        let Run {
            code,
            stdout,
            stderr,
        } = linkwatch(&[&["generate"], args].concat());
        assert_eq!((code, stdout.as_str()), (2, ""), "{args:?}");
        assert!(stderr.contains(says), "{stderr}");
        assert_eq!(files(&folder), [""; 0], "{args:?}");
    }
}

#[test]
fn an_existing_file_is_replaced_completely_or_not_at_all() {
    let folder = TempDir::new().unwrap();
    let model = folder.path().join("a.bcc");
    let generate = |scene: &str| linkwatch(&["generate", scene, "--force", "-o", text(&model)]);
    assert_eq!(generate("ribbon:segments=3000").code, 0);
    let before = std::fs::read(&model).unwrap();
    assert_eq!(generate("ribbon:segments=10").code, 2);
    assert_eq!(std::fs::read(&model).unwrap(), before);
    assert_eq!(generate("ribbon:segments=2000").code, 0);
    assert!(std::fs::read(&model).unwrap().len() < before.len());
    // A file cannot replace a folder.
    std::fs::remove_file(&model).unwrap();
    std::fs::create_dir(&model).unwrap();
    let Run { code, stderr, .. } = generate("ribbon:segments=2000");
    assert_eq!(code, 2);
    assert!(
        stderr.contains("a.bcc: ") && !stderr.contains(".part"),
        "{stderr}"
    );
    assert_eq!(files(&folder), ["a.bcc"]);
}

#[test]
fn a_moving_scene_is_intact_until_its_pull_through() {
    let folder = TempDir::new().unwrap();
    let [model, certificate] = ["a.npz", "a.txt"].map(|n| folder.path().join(n));
    let moving = ["--frames", "5,diameter=0.2,pull=3"];
    let output = ["-o", text(&model), "--certificate", text(&certificate)];
    let scene = ["generate", "chainmail:rows=4,columns=5"];
    let run = linkwatch(&[&scene[..], &moving, &output].concat());
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(
        run.stderr.contains("wrote 5 frames of 60 curves"),
        "{}",
        run.stderr
    );
    let against = ["--baseline", text(&certificate)];
    let run = linkwatch(&[&["check", text(&model), "--events", "-q"][..], &against].concat());
    assert_eq!(run.code, 1, "{}", run.stderr);
    let verdicts: Vec<&str> = run
        .stdout
        .lines()
        .filter(|line| !line.starts_with("first violation: "))
        .filter_map(|line| line.split_once(", frame ")?.1.split_once(": "))
        .map(|(_, verdict)| verdict)
        .collect();
    assert_eq!(
        verdicts,
        ["intact", "intact", "intact", "changed", "changed"]
    );
    assert_eq!(files(&folder), ["a.npz", "a.txt"]);
}

#[test]
fn bad_options_of_moving_scenes_exit_with_2() {
    let folder = TempDir::new().unwrap();
    let [bcc, npz] = ["a.bcc", "a.npz"].map(|n| folder.path().join(n));
    let scene = "chainmail:rows=4,columns=5";
    for (file, args, says) in [
        (&bcc, &["--frames", "2,diameter=0.2"][..], "holds one frame"),
        (&npz, &[], "scenes are written as .bcc"),
        (&npz, &["--frames", "2"], "chainmail has no diameter"),
        (
            &npz,
            &["--frames", "2,motion=fast"],
            "unknown motion 'fast'",
        ),
        (
            &npz,
            &["--frames", "2,pull=2"],
            "expected a frame from 1 to 1",
        ),
    ] {
        let run = linkwatch(&[&["generate", scene, "-o", text(file)][..], args].concat());
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        assert!(run.stderr.contains(says), "{args:?}: {}", run.stderr);
    }
    assert!(files(&folder).is_empty());
}
