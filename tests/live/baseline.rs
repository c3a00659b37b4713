//! The baseline of a watch: a late first frame is never used without a warning, and the simulator
//! may accept another baseline.

use super::support::raw_bus::{Header, RawSimulator};
use super::*;
use linkwatch::Departure;

/// Frames of the simulator below, and the first one in which the squares have come apart.
const FRAMES: u64 = 1000;
const BREAK: u64 = 300;

/// Runs a simulator whose steps take no time, and which never waits. It stops if it is asked to.
fn run_without_waiting(service: &str, before_the_end: impl FnOnce()) {
    let mut sim = Client::open(service, &ClientOptions::default()).unwrap();
    sim.describe(Basis::Polyline, Precision::F32, &[-4, -4])
        .unwrap();
    for frame in 0..FRAMES {
        let shift = if frame < BREAK { 0.0 } else { 2.5 };
        let mut loan = sim.loan(frame as f64).unwrap();
        let positions = loan.positions_f32().unwrap();
        positions.copy_from_slice(&squares(shift));
        loan.publish().unwrap();
        while sim.poll().unwrap().is_some() {}
        if sim.aborted().is_some() {
            break;
        }
    }
    before_the_end();
    let last = sim.finish_within(PATIENCE).unwrap().expect("a goodbye");
    assert!(last.abort, "{last}");
}

/// Regression test: the first verified frame came after the topology broke, and the run was intact.
#[test]
fn the_baseline_is_the_first_frame_whenever_the_watch_starts() {
    let folder = TempDir::new().unwrap();
    for round in 0..3 {
        for start in ["before", "with", "after"] {
            let service = service(&format!("baseline {start} {round}"));
            let begin = || Watch::start(folder.path(), start, &service, &[]);
            let mut watch = None;
            if start != "after" {
                let watch = watch.insert(begin());
                if start == "before" {
                    stderr_with(watch, &["waiting for a simulator"]);
                }
            }
            run_without_waiting(&service, || {
                watch.get_or_insert_with(begin);
            });
            let ended = watch.unwrap().end();
            assert_eq!(ended.code, Some(1), "{start}: {}", ended.stderr);
            assert_eq!(ended.reports()[0]["seq"], 0, "{start}");
            let baseline = &ended.summary()["baseline"];
            let expected = serde_json::json!({
                "frame": 0, "origin": "first frame", "links": 1, "unverified": 0
            });
            assert_eq!(*baseline, expected, "{start}");
        }
    }
}

/// Regression test: a pull-through was found on the straight path from the first frame to the
/// newest one.
#[test]
fn a_watch_that_starts_late_knows_no_motion_before_it() {
    let folder = TempDir::new().unwrap();
    for late in [false, true] {
        let service = service(&format!("motion {late}"));
        let recording = folder.path().join(format!("{late}.mcap"));
        let record = ["--record", recording.to_str().unwrap()];
        let begin = || Watch::start(folder.path(), "watch", &service, &record);
        let early = (!late).then(begin);
        let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
        sim.describe(Basis::Polyline, Precision::F32, &[2, 2])
            .unwrap();
        let frames = around_an_end();
        for (time, positions) in (0..3).map(f64::from).zip(&frames) {
            match late {
                true => drop(sim.publish(time, Positions::F32(positions)).unwrap()),
                false => assert_eq!(verdict_on(&mut sim, time, positions), Verdict::Intact),
            }
        }
        let watch = early.unwrap_or_else(|| {
            sim.publish(3.0, Positions::F32(&frames[3])).unwrap();
            let watch = begin();
            assert!(matches!(
                sim.wait(3, PATIENCE).unwrap(),
                Outcome::Verdict(_)
            ));
            watch
        });
        // A small step, which is searched again.
        assert_eq!(verdict_on(&mut sim, 4.0, &frames[3]), Verdict::Intact);
        sim.finish().unwrap();
        let ended = watch.end();
        assert_eq!(
            ended.code,
            Some(if late { 3 } else { 0 }),
            "{}",
            ended.stderr
        );
        assert_eq!(ended.summary()["gaps"], u64::from(late));
        assert_eq!(ended.stderr.matches("watching 2 curves").count(), 1);
        // The replay gives the same result.
        let replayed = replay(&recording);
        assert_eq!(replayed.code, ended.code, "{}", replayed.stderr);
        assert_eq!(replayed.summary()["gaps"], u64::from(late));
        let verdicts: Vec<_> = ended
            .reports()
            .iter()
            .map(|r| r["verdict"].clone())
            .collect();
        assert_eq!(verdicts, vec!["intact"; if late { 3 } else { 4 }]);
    }
}

#[test]
fn a_watch_says_what_it_watches() {
    let folder = TempDir::new().unwrap();
    let service = service("scene");
    let watch = Watch::start(folder.path(), "watch", &service, &[]);
    let mut sim = client(&service);
    for frame in 0..3 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    sim.finish().unwrap();
    let ended = watch.end();
    let line = "watching 2 curves (2 closed): polylines in single precision, without names, no \
                radii, no periodic cell; the baseline is frame 0, with 1 link";
    assert_eq!(ended.stderr.matches(line).count(), 1, "{}", ended.stderr);
}

#[test]
fn a_watch_from_now_on_says_that_it_started_late() {
    let folder = TempDir::new().unwrap();
    let service = service("from now");
    let mut sim = client(&service);
    for _ in 0..5 {
        sim.publish(0.0, Positions::F32(&squares(0.0))).unwrap();
    }
    let watch = Watch::start(folder.path(), "watch", &service, &["--from-now"]);
    stderr_with(&watch, &["waiting for a simulator"]);
    assert_eq!(step(&mut sim, 5, 2.5), Verdict::Intact);
    assert_eq!(step(&mut sim, 6, 0.0), Verdict::Changed);
    sim.finish().unwrap();
    let ended = watch.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert_eq!(ended.summary()["baseline"]["frame"], 5);
    let late = "the watch started late: the baseline is frame 5, and 5 frames before it were not \
                verified";
    assert!(ended.stderr.contains(late), "{}", ended.stderr);
}

/// A simulator that is written from the documentation may not keep its baseline.
#[test]
fn a_late_baseline_is_incomplete_also_in_the_recording() {
    let folder = TempDir::new().unwrap();
    let service = service("late");
    let recording = folder.path().join("run.mcap");
    let args = ["--record", recording.to_str().unwrap()];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    stderr_with(&watch, &["waiting for a simulator"]);
    let sim = RawSimulator::open(&service);
    let mut header = Header {
        magic: Header::MAGIC,
        version: Header::VERSION,
        session: 77,
        seq: 7,
        baseline: 4,
        n_points: 8,
        n_curves: 2,
        coordinate_bytes: 4,
        ..Header::default()
    };
    let mut payload: Vec<u8> = [-4_i32, -4].iter().flat_map(|n| n.to_le_bytes()).collect();
    payload.resize(64, 0);
    payload.extend(squares(0.0).iter().flat_map(|x| x.to_le_bytes()));
    sim.send(header, &payload);
    lines_of(&watch, 1);
    (header.seq, header.flags) = (8, Header::END);
    sim.send(header, &[]);
    let ended = watch.end();
    let replayed = replay(&recording);
    for run in [&ended, &replayed] {
        assert_eq!(run.code, Some(3), "{}", run.stderr);
        let baseline = &run.summary()["baseline"];
        let found = [&baseline["frame"], &baseline["unverified"]];
        assert_eq!(found, [7, 7], "{baseline}");
    }
    let late = "the baseline is frame 7, and 7 frames before it were not verified (--from-now";
    assert!(ended.stderr.contains(late), "{}", ended.stderr);
    let (code, text) = printed(&["report", "--text", recording.to_str().unwrap()]);
    assert_eq!(code, Some(3), "{text}");
    let words = "7 frames were published before the baseline, and not verified";
    assert!(text.contains(words), "{text}");
}

#[test]
fn an_accepted_state_is_the_new_baseline() {
    let folder = TempDir::new().unwrap();
    let service = service("accept");
    let recording = folder.path().join("run.mcap");
    let args = ["--record", recording.to_str().unwrap(), "--events"];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = client(&service);
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    assert_eq!(step(&mut sim, 1, 2.5), Verdict::Changed);
    assert!(sim.aborted().is_some());
    sim.accept();
    assert!(sim.aborted().is_none());
    for frame in 2..4 {
        assert_eq!(step(&mut sim, frame, 2.5), Verdict::Intact);
    }
    let last = sim.finish_within(PATIENCE).unwrap().expect("a goodbye");
    assert!(!last.abort, "{last}");
    let live = watch.end();
    let line = "the baseline is frame 2, accepted by the simulator, with 0 links";
    assert!(live.stderr.contains(line), "{}", live.stderr);
    let replayed = replay(&recording);
    assert_eq!(replayed.reports(), live.reports());
    replayed.assert_recorded_verdicts();
    for run in [&live, &replayed] {
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let summary = run.summary();
        let counts = [&summary["recovered"], &summary["accepted"]];
        assert_eq!(
            (&summary["verdict"], counts),
            (&"accepted".into(), [&0.into(), &1.into()])
        );
        assert_eq!(summary["baseline"]["frame"], 2);
    }
    let (code, text) = printed(&["report", "--text", recording.to_str().unwrap()]);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.starts_with("Accepted: "), "{text}");
}

/// Regression test: the replay compared these frames with the baseline of the first frame, so that
/// a violation was intact.
#[test]
fn a_replay_that_begins_later_expects_the_accepted_state() {
    let windows = [("window", ",window=0.01"), ("one window", ",window=100")];
    for (name, settings) in [("all", "")].into_iter().chain(windows) {
        let folder = TempDir::new().unwrap();
        let service = service(&format!("accepted {name}"));
        let recording = folder.path().join("run.mcap");
        let record = format!("{}{settings}", recording.to_str().unwrap());
        let args = ["--record", &record, "--motion-limit=5"];
        let watch = Watch::start(folder.path(), "watch", &service, &args);
        let mut sim = client(&service);
        assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
        sim.accept();
        for frame in 1..4 {
            assert_eq!(step(&mut sim, frame, 2.5), Verdict::Intact);
        }
        std::thread::sleep(Duration::from_millis(50));
        assert_eq!(step(&mut sim, 4, 0.0), Verdict::Changed);
        sim.cut();
        assert_eq!(step(&mut sim, 5, 0.1), Verdict::Changed);
        sim.finish_within(PATIENCE).unwrap().expect("a goodbye");
        let live = watch.end();
        let verdicts = |run: &Ended| -> Vec<[Value; 2]> {
            let reports = run.reports();
            let pair = |r: &&Value| [r["seq"].clone(), r["verdict"].clone()];
            reports.iter().map(pair).collect()
        };
        for from in 0..6 {
            let replayed = replay_with(&recording, &["--from", &from.to_string()]);
            let found = verdicts(&replayed);
            let expected = verdicts(&live);
            let expected = &expected[expected.len() - found.len()..];
            assert_eq!(found, expected, "{name} from {from}: {}", replayed.stderr);
            assert_eq!(replayed.code, Some(1), "{name}: {}", replayed.stderr);
            replayed.assert_recorded_verdicts();
        }
    }
}

/// Regression test: the replay and the report of the recording said that the run was accepted.
#[test]
fn a_replay_says_that_the_accepted_frame_was_rejected() {
    let folder = TempDir::new().unwrap();
    let service = service("rejected");
    let recording = folder.path().join("run.mcap");
    let args = ["--record", recording.to_str().unwrap()];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = client(&service);
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    assert_eq!(step(&mut sim, 1, 2.5), Verdict::Changed);
    sim.accept();
    assert_eq!(step(&mut sim, 2, f32::NAN), Verdict::Rejected);
    assert_eq!(step(&mut sim, 3, 2.5), Verdict::Intact);
    sim.finish_within(PATIENCE).unwrap().expect("a goodbye");
    let live = watch.end();
    for run in [&live, &replay(&recording)] {
        assert_eq!(run.code, Some(3), "{}", run.stderr);
        let says = "the frame that the simulator accepted was not verified: the baseline is frame \
                    3, and 1 frame before it was not verified";
        assert!(run.stderr.contains(says), "{}", run.stderr);
    }
    let (code, text) = printed(&["report", "--text", recording.to_str().unwrap()]);
    assert_eq!(code, Some(3), "{text}");
    let words = "1 frame was published before the baseline, and not verified";
    assert!(text.contains(words), "{text}");
}

#[test]
fn frames_are_compared_with_the_accepted_one() {
    let folder = TempDir::new().unwrap();
    let service = service("accepted");
    let watch = Watch::start(folder.path(), "watch", &service, &[]);
    let mut sim = client(&service);
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    // Accepted before it is published: nothing was violated.
    sim.accept();
    assert_eq!(step(&mut sim, 1, 2.5), Verdict::Intact);
    assert_eq!(step(&mut sim, 2, 0.0), Verdict::Changed);
    let abort = sim.aborted().expect("an abort").to_string();
    assert!(abort.contains("curves 0 and 1 became linked"), "{abort}");
    sim.finish().unwrap();
    let ended = watch.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert_eq!(ended.summary()["accepted"], 0);
}

#[test]
fn the_simulator_learns_why_the_watch_left() {
    let folder = TempDir::new().unwrap();
    let service = service("refused");
    let watch = Watch::start(folder.path(), "watch", &service, &["--events=off"]);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    sim.describe(Basis::Polyline, Precision::F32, &[4, 4])
        .unwrap();
    let seq = sim.publish(0.0, Positions::F32(&squares(0.0))).unwrap();
    let outcome = without_time_out("the wait", || sim.wait(seq, LONG)).unwrap();
    let Outcome::NoWatcher(Departure::Refused(why)) = &outcome else {
        panic!("{outcome:?}");
    };
    assert!(why.contains("none of 2 curves is closed"), "{why}");
    assert_eq!(watch.end().code, Some(2));
}
