//! Curves of a live simulation that end where they start.

use super::*;

/// Two squares that repeat their first points.
fn repeated(shift: f32, error: f32) -> Vec<f32> {
    let points = squares(shift);
    let ring = |ring: &[f32]| {
        let end = [ring[0], ring[1], ring[2] + error];
        [ring, &end].concat()
    };
    points.chunks(12).flat_map(ring).collect()
}

#[test]
fn live_rings_that_repeat_their_first_point_are_verified_recorded_and_replayed() {
    let folder = TempDir::new().unwrap();
    let service = service("repeated");
    let recording = folder.path().join("run.mcap");
    let args = ["--record", recording.to_str().unwrap()];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    sim.describe(Basis::Polyline, Precision::F32, &[5, 5])
        .unwrap();
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let mut verdict = |shift, error| {
        let points = repeated(shift, error);
        let seq = sim.publish(0.0, Positions::F32(&points)).unwrap();
        match sim.wait(seq, PATIENCE).unwrap() {
            Outcome::Verdict(message) => message.verdict,
            other => panic!("frame {seq}: {other:?}"),
        }
    };
    assert_eq!(verdict(0.0, 0.0), Verdict::Intact);
    assert_eq!(verdict(0.1, 1e-6), Verdict::Intact);
    assert_eq!(verdict(0.1, 0.5), Verdict::Rejected);
    assert_eq!(verdict(0.1, 0.0), Verdict::Intact);
    assert_eq!(verdict(5.0, 0.0), Verdict::Changed);
    sim.finish().unwrap();
    let live = watch.end();
    assert_eq!(live.code, Some(1), "{}", live.stderr);
    assert_eq!(live.summary()["joined_curves"], 2);
    let says = "the frames: 2 curves end where they start and are closed";
    assert_eq!(live.stderr.matches(says).count(), 1, "{}", live.stderr);
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    replayed.assert_recorded_verdicts();
}
