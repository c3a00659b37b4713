//! Curves that a live simulation adds, removes and names.

use super::*;
use linkwatch::{CurveLabels, VerdictMessage};

/// Returns two squares through one another, the second one shifted, and further squares apart from
/// them and from one another.
fn with_more_squares(shift: f32, more: usize) -> Vec<f32> {
    let mut points = squares(shift).to_vec();
    for k in 0..more {
        let far = 20.0 + 5.0 * k as f32;
        points.extend([
            far,
            0.0,
            0.0,
            far + 1.0,
            0.0,
            0.0,
            far + 1.0,
            1.0,
            0.0,
            far,
            1.0,
            0.0,
        ]);
    }
    points
}

/// Describes one square for each name.
fn describe(sim: &mut Client, names: &[&str]) {
    let labels = CurveLabels::named(names.iter().copied()).with_radii(names.iter().map(|_| 0.05));
    let counts = vec![-4; names.len()];
    sim.describe_labelled(Basis::Polyline, Precision::F32, &counts, labels)
        .unwrap();
}

fn verdict(sim: &mut Client, points: &[f32]) -> VerdictMessage {
    let seq = sim.publish(0.0, Positions::F32(points)).unwrap();
    match sim.wait(seq, PATIENCE).unwrap() {
        Outcome::Verdict(message) => *message,
        other => panic!("frame {seq}: {other:?}"),
    }
}

#[test]
fn curves_that_come_and_go_are_compared_by_name_recorded_and_replayed() {
    let folder = TempDir::new().unwrap();
    let service = service("curves");
    let [recording, rrd] = ["run.mcap", "run.rrd"].map(|name| folder.path().join(name));
    let args = [
        "--events",
        "--record",
        recording.to_str().unwrap(),
        "--show",
        rrd.to_str().unwrap(),
    ];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    sim.set_time_step(1e-3).unwrap();
    describe(&mut sim, &["left", "right"]);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(
        verdict(&mut sim, &with_more_squares(0.1, 0)).verdict,
        Verdict::Intact
    );

    describe(&mut sim, &["left", "right", "new"]);
    let m = verdict(&mut sim, &with_more_squares(0.2, 1));
    assert_eq!(
        (m.verdict, m.appeared, m.gone),
        (Verdict::Intact, 1, 0),
        "{m}"
    );
    assert!(
        m.to_string().ends_with("intact: curves appeared: new"),
        "{m}"
    );
    assert_eq!(verdict(&mut sim, &with_more_squares(0.1, 1)).appeared, 0);

    // Another order: the squares that are linked are the second and the third curve now. The same
    // step pulls them apart.
    describe(&mut sim, &["new", "left", "right"]);
    let points = with_more_squares(3.0, 1);
    let points = [&points[24..], &points[..24]].concat();
    let m = verdict(&mut sim, &points);
    assert_eq!(
        (m.verdict, m.lost, m.events),
        (Verdict::Changed, 1, 1),
        "{m}"
    );
    assert_eq!((m.appeared, m.gone), (0, 0), "{m}");
    assert!(
        m.to_string()
            .contains("curves 1 (left) and 2 (right) came apart"),
        "{m}"
    );

    describe(&mut sim, &["right"]);
    let m = verdict(&mut sim, &points[24..]);
    assert_eq!(
        (m.verdict, m.appeared, m.gone),
        (Verdict::Intact, 0, 2),
        "{m}"
    );
    assert!(m.to_string().contains("curves gone: new, left"), "{m}");

    let e = sim
        .describe(Basis::Polyline, Precision::F32, &[-4])
        .unwrap_err();
    assert!(
        e.to_string().contains("curves without names cannot change"),
        "{e}"
    );
    sim.finish_within(PATIENCE).unwrap().expect("goodbye");
    let live = watch.end();
    assert_eq!(live.code, Some(1), "{}", live.stderr);
    assert!(std::fs::metadata(&rrd).unwrap().len() > 1000);
    let finding = live.summary()["first_violation"]["finding"]
        .as_str()
        .unwrap();
    assert!(finding.contains("1 (left)"), "{finding}");

    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports(), live.reports());
    replayed.assert_recorded_verdicts();
}

#[test]
fn curves_without_names_cannot_change() {
    let folder = TempDir::new().unwrap();
    let service = service("unnamed");
    let watch = Watch::start(folder.path(), "watch", &service, &[]);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    let labels = CurveLabels::default().with_radii([0.1, 0.1]);
    sim.describe_labelled(Basis::Polyline, Precision::F32, &[-4, -4], labels)
        .unwrap();
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(
        verdict(&mut sim, &with_more_squares(0.1, 0)).verdict,
        Verdict::Intact
    );
    let labels = CurveLabels::named(["a", "b"]);
    let e = sim.describe_labelled(Basis::Polyline, Precision::F32, &[-4, -4], labels);
    let e = e.unwrap_err().to_string();
    assert!(e.contains("name them from the first frame on"), "{e}");
    sim.finish_within(PATIENCE).unwrap().expect("goodbye");
    assert_eq!(watch.end().code, Some(0));
}
