//! Clearance of a live simulation: the warning before a pull-through.

use super::*;
use linkwatch::{Cell, CurveLabels};

/// Radius of the squares. The closest edges of two of them are `1 - shift` apart.
const RADIUS: f32 = 0.1;

/// Motion of a frame.
const SPEED: f32 = 0.02;

fn shift(frame: u64) -> f32 {
    0.705 + SPEED * frame as f32
}

/// Returns the clearance of the squares in a frame.
fn expected(frame: u64) -> f64 {
    f64::from(1.0 - shift(frame)) / f64::from(2.0 * RADIUS)
}

fn thick_client(service: &str, radii: &[f32]) -> Client {
    let mut client = Client::open(service, &ClientOptions::lockstep()).unwrap();
    let labels = CurveLabels::default().with_radii(radii.iter().copied());
    client
        .describe_labelled(Basis::Polyline, Precision::F32, &[-4, -4], labels)
        .unwrap();
    assert!(client.wait_for_watcher(PATIENCE).unwrap());
    client
}

#[test]
fn a_low_clearance_stops_a_simulator_before_the_pull_through() {
    let folder = TempDir::new().unwrap();
    let service = service("clearance");
    let recording = folder.path().join("run.mcap");
    let record = recording.to_str().unwrap();
    let policy = ["--radius", "published", "--abort-on", "clearance"];
    let args = [&policy[..], &["--record", record]].concat();
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = thick_client(&service, &[RADIUS; 2]);
    let mut warned = None;
    for frame in 0..20 {
        let verdict = step(&mut sim, frame, shift(frame));
        let broken = shift(frame) > 1.0;
        assert_eq!(verdict == Verdict::Changed, broken, "frame {frame}");
        if let Some(abort) = sim.aborted() {
            warned.get_or_insert((frame, abort.to_string()));
        }
    }
    sim.finish().unwrap();
    let (first, abort) = warned.expect("an abort");
    assert!(
        expected(first) < 0.5 && expected(first - 1) >= 0.5,
        "{first}"
    );
    let words = "intact: low clearance of curves 0 and 1, 4";
    assert!(abort.contains(words), "{abort}");
    let live = watch.end();
    assert_eq!(live.code, Some(1), "{}", live.stderr);
    for (frame, report) in live.reports().into_iter().enumerate() {
        let frame = frame as u64;
        if shift(frame) > 1.0 {
            break;
        }
        let closest = &report["clearance"]["closest"];
        let ratio = closest["ratio"].as_f64().unwrap();
        assert!(
            (ratio - expected(frame)).abs() < 1e-5,
            "frame {frame}: {closest}"
        );
        assert_eq!(report["abort"], frame >= first, "frame {frame}");
        if frame >= first {
            let left = report["clearance"]["frames_left"].as_f64().unwrap();
            let exact = expected(frame) * f64::from(2.0 * RADIUS) / f64::from(SPEED);
            assert!((left - exact).abs() < 0.01, "frame {frame}: {left} {exact}");
        }
    }
    let summary = &live.summary()["clearance"];
    assert_eq!(summary["first_low_frame"], first);
    assert_eq!(summary["frames_before_violation"], 5, "{summary}");

    // The settings are those of the recording.
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports(), live.reports());
    replayed.assert_recorded_verdicts();
    let (code, text) = printed(&[
        "replay",
        record,
        "--radius",
        "0.2",
        "--min-clearance",
        "25%",
    ]);
    assert_eq!(code, Some(1));
    for words in [
        "low clearance: the centre lines of curves 0 and 1 are",
        "they meet in about 5 frames at this rate",
        "below 25.00 % in",
        "frames before the first violation",
        "another --radius or --min-clearance",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
}

/// Two squares, and a cell that shrinks until an image touches the tube of the first one.
#[test]
fn a_low_clearance_in_a_cell_names_the_image() {
    let folder = TempDir::new().unwrap();
    let service = service("clearance-cell");
    let recording = folder.path().join("run.mcap");
    let args = [
        "--radius",
        "published",
        "--record",
        recording.to_str().unwrap(),
    ];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = thick_client(&service, &[RADIUS; 2]);
    let square = |x: f32| {
        [
            x,
            0.0,
            0.0,
            x + 1.0,
            0.0,
            0.0,
            x + 1.0,
            1.0,
            0.0,
            x,
            1.0,
            0.0,
        ]
    };
    let xyz = [square(0.0), square(5.0)];
    let gap = |frame: u64| 0.52 - 0.05 * frame as f64;
    for frame in 0..10 {
        let cell = Cell::orthogonal([0.0; 3], [6.0 + gap(frame), 0.0, 0.0]);
        sim.set_cell(Some(cell)).unwrap();
        let verdict = verdict_on(&mut sim, frame as f64, xyz.as_flattened());
        assert_eq!(verdict, Verdict::Intact);
    }
    sim.finish().unwrap();
    let live = watch.end();
    assert_eq!(live.code, Some(0), "{}", live.stderr);
    for (frame, report) in (0..).zip(live.reports()) {
        let ratio = gap(frame) / f64::from(2.0 * RADIUS);
        let closest = &report["clearance"]["closest"];
        let low = report["clearance"]["low"].as_bool().unwrap();
        assert_eq!(low, ratio < 0.5, "{report}");
        if low {
            assert_eq!(closest["image"], serde_json::json!([-1, 0, 0]));
            let found = closest["ratio"].as_f64().unwrap();
            assert!((found - ratio).abs() < 1e-6, "{frame}: {closest}");
        }
    }
    let replayed = replay(&recording);
    assert_eq!(replayed.reports(), live.reports());
    replayed.assert_recorded_verdicts();
    let (_, text) = printed(&["replay", recording.to_str().unwrap()]);
    let words = "low clearance: the centre lines of curve 0 and the image -1,0,0 of curve 1 are ";
    assert!(text.contains(words), "{text}");
}

#[test]
fn a_clearance_that_cannot_be_measured_makes_a_run_incomplete() {
    for (radii, why) in [
        (&[][..], "the frames have none"),
        (&[0.1, 0.0], "that of curve 1 is 0"),
    ] {
        let folder = TempDir::new().unwrap();
        let service = service(&format!("no-radii-{}", radii.len()));
        let args = ["--radius", "published"];
        let watch = Watch::start(folder.path(), "watch", &service, &args);
        let mut sim = thick_client(&service, radii);
        for frame in 0..3 {
            assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
        }
        sim.finish().unwrap();
        let live = watch.end();
        assert_eq!(live.code, Some(3), "{}", live.stderr);
        assert!(live.stderr.contains(why), "{}", live.stderr);
        let unmeasured = live.summary()["unmeasured_clearance"].as_str().unwrap();
        assert!(unmeasured.contains(why), "{unmeasured}");
    }
}

/// Regression test: once radii were published, earlier frames without clearance were forgotten.
#[test]
fn a_clearance_that_can_be_measured_later_leaves_the_run_incomplete() {
    let folder = TempDir::new().unwrap();
    let service = service("unmeasured-first");
    let policy = ["--radius", "published"];
    let watch = Watch::start(folder.path(), "watch", &service, &policy);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    let labels = CurveLabels::named(["a", "b"]);
    for (frame, labels) in (0..).zip([labels.clone(), labels.with_radii([RADIUS; 2])]) {
        sim.describe_labelled(Basis::Polyline, Precision::F32, &[-4, -4], labels)
            .unwrap();
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    sim.finish().unwrap();
    let live = watch.end();
    assert_eq!(live.code, Some(3), "{}", live.stderr);
    let reports = live.reports();
    assert!(reports[0]["clearance"].is_null(), "{}", reports[0]);
    assert!(!reports[1]["clearance"].is_null(), "{}", reports[1]);
    assert!(!live.summary()["unmeasured_clearance"].is_null());
}

#[test]
fn options_of_clearance_that_contradict_one_another_are_refused() {
    let watch = |args: &[&str]| printed(&[&["watch", "--wait", "1"], args].concat());
    for (args, why) in [
        (
            &["--min-clearance", "0.5"][..],
            "--min-clearance needs --radius",
        ),
        (
            &["--abort-on", "clearance"],
            "--abort-on clearance needs --radius",
        ),
        (
            &["--radius", "0"],
            "expected a number above 0, or `published`",
        ),
        (&["--radius", "1e99"], "expected a length of 1e-30 to 1e30"),
        (
            &["--radius", "1", "--min-clearance", "150%"],
            "from 0% to 100%",
        ),
    ] {
        let (code, text) = watch(args);
        assert_eq!(code, Some(2), "{args:?}: {text}");
        assert!(text.contains(why), "{args:?}: {text}");
    }
}
