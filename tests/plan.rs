//! Tests of `linkwatch plan` as a process, and of scenes in place of models.

mod support;

use support::command::{Run, linkwatch};
use tempfile::TempDir;

#[test]
fn prints_a_line_per_stage() {
    let Run {
        code,
        stdout,
        stderr,
    } = linkwatch(&["plan", "ribbon:segments=2000", "--threads", "1"]);
    assert_eq!((code, stderr.as_str()), (0, ""));
    let lines: Vec<&str> = stdout.lines().collect();
    let starts = [
        "ribbon:segments=2000",
        "  boxes: ",
        "  potential links: no search",
        "  direction: the best of six for 1 link",
        "  discretization: none (polylines)",
        "  kernel: crossings (exact), one thread, 1 of 1 thread busy",
        "  total: ",
    ];
    assert_eq!(lines.len(), starts.len(), "{stdout}");
    for (line, start) in lines.iter().zip(starts) {
        assert!(line.starts_with(start), "{line}");
    }
    let Run { code, stdout, .. } = linkwatch(&["plan", "ribbon:segments=2000", "--repeat", "1"]);
    assert_eq!(code, 0);
    assert!(stdout.contains("\n  measured: boxes "), "{stdout}");
}

#[test]
fn a_scene_and_its_model_file_have_the_same_plan() {
    let folder = TempDir::new().unwrap();
    let scene = "knit:rows=3,stitches=16,segments=576";
    let model = folder.path().join("a.bcc");
    let model = model.to_str().unwrap();
    assert_eq!(linkwatch(&["generate", scene, "-o", model]).code, 0);
    let Run { code, stdout, .. } = linkwatch(&["plan", "--json", "--threads", "2", model, scene]);
    assert_eq!(code, 0);
    let plans: Vec<serde_json::Value> = stdout
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(plans.len(), 2);
    assert_eq!(
        (&plans[0]["model"], &plans[1]["model"]),
        (&model.into(), &scene.into())
    );
    assert_eq!(plans[0]["plan"], plans[1]["plan"]);
    let plan = &plans[0]["plan"];
    assert_eq!(plan["threads"], 2);
    assert_eq!(plan["discretization"]["choice"], "pair-by-pair");
    assert_eq!(plan["boxes"]["stored_leaves"], 3);
    assert_eq!(plan["potential_links"]["links"], 2);
    assert_eq!(plan["potential_links"]["search"], "sweep");
    assert_eq!(plan["kernel"]["choice"], "crossings");
    assert!(plan["predicted"]["one_thread_ms"].as_f64().unwrap() > 0.0);
    assert!(plans[0]["measured"].is_null());
}

#[test]
fn scenes_are_certified_like_models() {
    let Run {
        code,
        stdout,
        stderr,
    } = linkwatch(&["certify", "ribbon:segments=2000,lambda=-12"]);
    assert_eq!(
        (code, stdout.as_str()),
        (0, "2 # lines: 1\n0,1,-12\n"),
        "{stderr}"
    );
    let Run { code, stdout, .. } = linkwatch(&["certify", "ribbon:segments=2000", "--repeat", "1"]);
    assert_eq!(code, 0);
    assert!(
        stdout.starts_with("ribbon:segments=2000, median of 1"),
        "{stdout}"
    );
}

/// Five frames of two rings, which are linked in the first three.
const MOTION: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/others/scene.mcap");

#[test]
fn names_the_frame_that_is_used_of_a_file_with_several() {
    let says = "scene.mcap: the file has several frames; only the first one is used, frame 0";
    let study = ["--diameter", "0.1", "--frames", "1", "--motions", "still"];
    for args in [
        vec!["plan", MOTION],
        [&["study", "frames", MOTION], &study[..]].concat(),
        vec!["study", "kernels", MOTION, "--repeat", "1", "--limit", "1"],
    ] {
        let run = linkwatch(&args);
        assert_eq!(run.code, 0, "{run:?}");
        assert_eq!(run.stderr.matches(says).count(), 1, "{run:?}");
    }
    let one = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/models/numpy/one-frame.npy"
    );
    let run = linkwatch(&["plan", one, "--counts=-8,-8,-8"]);
    assert_eq!((run.code, run.stderr.as_str()), (0, ""));
}

#[test]
fn repeat_certifies_the_frame_that_was_requested() {
    for (frame, links) in [("0", 1), ("4", 0)] {
        let run = linkwatch(&[
            "certify", MOTION, "--frame", frame, "--repeat", "1", "--json",
        ]);
        let found: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
        assert_eq!((run.code, &found["links"]), (0, &links.into()), "{run:?}");
    }
    let run = linkwatch(&["certify", MOTION, "--frame", "5", "--repeat", "1"]);
    assert_eq!(run.code, 2, "{run:?}");
    assert!(run.stderr.contains("scene.mcap: no frame 5"), "{run:?}");
}

#[test]
fn rejects_an_unknown_argument_in_one_line() {
    let folder = TempDir::new().unwrap();
    let exists = folder.path().join("ribbon");
    std::fs::write(&exists, "").unwrap();
    for (argument, says) in [
        ("none.bcc", &["none.bcc: No such file"][..]),
        (exists.to_str().unwrap(), &["unknown kind of file"]),
        (
            "rope",
            &[
                "scene rope: unknown (known: chainmail",
                "no file has this name",
            ],
        ),
        (
            "ribbon:lambda=x",
            &["expected an integer from", "no file has this name"],
        ),
    ] {
        for command in ["plan", "certify"] {
            let Run {
                code,
                stdout,
                stderr,
            } = linkwatch(&[command, argument]);
            assert_eq!((code, stdout.as_str()), (2, ""), "{argument}");
            assert_eq!(stderr.lines().count(), 1, "{stderr}");
            assert!(says.iter().all(|s| stderr.contains(s)), "{stderr}");
        }
    }
    assert_eq!(linkwatch(&["plan"]).code, 2);
}

/// The calibration of a missing adapter, or of an older version, does not affect the plan.
#[cfg(feature = "gpu")]
#[test]
fn ignores_the_calibration_of_a_missing_adapter() {
    let cache = TempDir::new().unwrap();
    let folder = cache.path().join("linkwatch");
    std::fs::create_dir(&folder).unwrap();
    let sum = serde_json::json!({ "round_trip_ms": 1e-3, "adapter_ns": 1e-3, "processor_ns": 4.5 });
    let of_now = serde_json::json!({
        "adapter": "Some Card", "backend": "Vulkan", "driver": "1", "threads": 1,
        "direct": sum, "barnes_hut": sum,
        "crossings": {
            "round_trip_ms": 1e-3, "segment_ns": 1e-3, "link_ns": 1e-3, "test_ns": 1e-3,
            "misfit": 1.0, "processor_factor": 1.0,
        },
    });
    let of_old = serde_json::json!({
        "adapter": "Some Card", "driver": "1", "threads": 1,
        "round_trip_ms": 2.0, "pair_ns": 0.5, "processor_pair_ns": 4.5,
    });
    for (kept, is_said) in [(of_now, true), (of_old, false)] {
        let kept = serde_json::json!([kept]);
        std::fs::write(folder.join("devices.json"), kept.to_string()).unwrap();
        let run: Run = support::command::command()
            .args(["plan", "chainmail", "--threads", "1"])
            .env("XDG_CACHE_HOME", cache.path())
            .output()
            .unwrap()
            .into();
        assert!(run.code == 0 && run.stdout.contains("crossings (exact)"));
        assert!(!run.stdout.contains("Some Card"), "{}", run.stdout);
        assert_eq!(run.stderr.contains("Some Card"), is_said, "{}", run.stderr);
    }
}

#[test]
fn periodic_images_are_part_of_the_plan() {
    let scene = "chainmail:rows=4,columns=4";
    let alone = linkwatch(&["plan", scene]).stdout;
    assert!(!alone.contains("periodic images"), "{alone}");
    let run = linkwatch(&["plan", scene, "--cell", "4,0,0"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stdout.contains("  periodic images: "), "{}", run.stdout);
    let json = |args: &[&str]| -> serde_json::Value {
        let run = linkwatch(&[&["plan", "--json", scene], args].concat());
        assert_eq!(run.code, 0, "{}", run.stderr);
        serde_json::from_str(&run.stdout).unwrap()
    };
    let [alone, plan] = [json(&[]), json(&["--cell", "4,0,0"])];
    let images = &plan["plan"]["images"];
    assert!(alone["plan"]["images"].is_null());
    assert!(images["links"].as_u64().unwrap() > 0, "{images}");
    for value in ["bytes", "predicted"] {
        let number = |plan: &serde_json::Value| match value {
            "bytes" => plan["bytes"].as_f64().unwrap(),
            _ => plan["predicted"]["one_thread_ms"].as_f64().unwrap(),
        };
        let [sum, own] = [number(&plan["plan"]), number(&alone["plan"])];
        let error = sum - own - number(images);
        assert!(error.abs() < 1e-9 * sum, "{value}: {sum} {own}");
    }
    let run = linkwatch(&["plan", scene, "--cell", "4,0,0", "--repeat", "1"]);
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("--cell none"), "{}", run.stderr);
}
