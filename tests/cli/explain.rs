//! `linkwatch certify --explain`, and scenes in place of models.

use crate::support::command::{Run, linkwatch};
use serde_json::Value;
use tempfile::TempDir;

/// Returns the plan of a frame as JSON.
fn plan(args: &[&str]) -> Value {
    let run = linkwatch(&[&["certify", "--explain", "--json"], args].concat());
    assert_eq!(run.code, 0, "{}", run.stderr);
    let line: Value = serde_json::from_str(&run.stdout).unwrap();
    line["plan"].clone()
}

#[test]
fn prints_the_decisions_and_the_predicted_cost() {
    let Run {
        code,
        stdout,
        stderr,
    } = linkwatch(&[
        "certify",
        "--explain",
        "ribbon:segments=2000",
        "--threads",
        "1",
    ]);
    assert_eq!((code, stderr.as_str()), (0, ""));
    let lines: Vec<&str> = stdout.lines().collect();
    let starts = [
        "ribbon:segments=2000",
        "  potential links: 1 of 1 pair of 2 curves with 2,000 segments",
        "  discretization: none (polylines)",
        "  direction: the best of six directions for 1 link",
        "  kernel: crossings (exact) on the CPU, 1 of 1 thread busy; ",
        "  predicted: ",
    ];
    assert_eq!(lines.len(), starts.len(), "{stdout}");
    for (line, start) in lines.iter().zip(starts) {
        assert!(line.starts_with(start), "{line}");
    }
}

#[test]
fn names_skipped_and_discarded_pairs() {
    let folder = TempDir::new().unwrap();
    let model = folder.path().join("a.obj");
    // Two rings, a closed curve of one point inside the boxes of both, and an open curve.
    let text = "v 0 0 0\nv 4 0 0\nv 4 4 4\nv 0 4 0\nv 0 0 0\nv 4 0 0\nv 4 4 4\nv 0 4 0\nv 1 1 1\n\
                v 1 1 1\nv 1 1 1\nv 9 0 0\nv 9 1 0\nl 1 2 3 4 1\nl 5 6 7 8 5\n\
                l 9 10 11 9\nl 12 13\n";
    std::fs::write(&model, text).unwrap();
    let run = linkwatch(&["certify", "--explain", model.to_str().unwrap()]);
    let says = "1 of 1 pair of 4 curves with 12 segments, 1 open curve skipped, 1 degenerate curve \
                skipped";
    assert!(run.stdout.contains(says), "{run:?}");
    let run = linkwatch(&["certify", "--explain", "rubber_bands:bands=1"]);
    assert!(run.stdout.contains("direction: none"), "{run:?}");
}

#[test]
fn a_scene_and_its_model_file_have_the_same_plan() {
    let folder = TempDir::new().unwrap();
    let scene = "knit:rows=3,stitches=16,segments=576";
    let model = folder.path().join("a.bcc");
    let model = model.to_str().unwrap();
    assert_eq!(linkwatch(&["generate", scene, "-o", model]).code, 0);
    let [of_model, of_scene] = [model, scene].map(|input| plan(&["--threads", "2", input]));
    assert_eq!(of_model, of_scene);
    assert_eq!(of_scene["threads"], 2);
    assert_eq!(of_scene["splines"], true);
    assert_eq!(of_scene["potential_links"], 2);
    assert_eq!(of_scene["kernel"], "crossings");
    assert!(of_scene["total"]["one_thread_ms"].as_f64().unwrap() > 0.0);
}

#[test]
fn scenes_are_certified_like_models() {
    let Run {
        code,
        stdout,
        stderr,
    } = linkwatch(&["certify", "ribbon:segments=2000,lambda=-12"]);
    let expected = (0, "2 # lines: 1\n0,1,-12\n");
    assert_eq!((code, stdout.as_str()), expected, "{stderr}");
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
        for args in [
            &["certify", argument][..],
            &["certify", "--explain", argument],
        ] {
            let Run {
                code,
                stdout,
                stderr,
            } = linkwatch(args);
            assert_eq!((code, stdout.as_str()), (2, ""), "{argument}");
            assert_eq!(stderr.lines().count(), 1, "{stderr}");
            assert!(says.iter().all(|s| stderr.contains(s)), "{stderr}");
        }
    }
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
        let run: Run = crate::support::command::command()
            .args(["certify", "--explain", "chainmail", "--threads", "1"])
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
    let run = linkwatch(&["certify", "--explain", scene, "--cell", "4,0,0"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stdout.contains("  periodic images: "), "{}", run.stdout);
    let [alone, with] = [plan(&[scene]), plan(&[scene, "--cell", "4,0,0"])];
    let images = &with["images"];
    assert!(alone["images"].is_null());
    assert!(images["potential_links"].as_u64() > Some(0), "{images}");
    let ms = |prediction: &Value| prediction["one_thread_ms"].as_f64().unwrap();
    let sum = ms(&with["total"]);
    let error = sum - ms(&alone["total"]) - ms(&images["predicted"]);
    assert!(error.abs() < 1e-9 * sum, "{with} {alone}");
    let args = [
        "certify",
        "--explain",
        scene,
        "--cell",
        "4,0,0",
        "--device",
        "gpu",
    ];
    let run = linkwatch(&args);
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("--cell=none"), "{}", run.stderr);
}
