//! Watchers and simulators that start, end and are killed.

use super::support::random::Random;
use super::*;
use linkwatch::Departure;

#[test]
fn a_watcher_that_starts_late_or_again_takes_over() {
    let folder = TempDir::new().unwrap();
    let service = service("late");
    let mut sim = client(&service);
    // Nobody watches, and the simulator does not wait.
    for frame in 0..5 {
        sim.publish(frame as f64, Positions::F32(&squares(0.0)))
            .unwrap();
    }
    let recording = folder.path().join("first.mcap");
    let record = ["--record", recording.to_str().unwrap()];
    let first = Watch::start(folder.path(), "first", &service, &record);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 5, 0.1), Verdict::Intact);
    // The verdict is sent first; the file of the recording is created after it.
    until("the recording", || recording.exists().then_some(()));
    first.signal("KILL");
    drop(first);
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(3), "{}", replayed.stderr);
    assert!(replayed.stderr.contains("truncated"), "{}", replayed.stderr);
    // A killed watcher costs the simulator nothing.
    without_time_out("publishing", || {
        for frame in 6..9 {
            sim.publish(frame as f64, Positions::F32(&squares(0.2)))
                .unwrap();
        }
    });
    let second = Watch::start(folder.path(), "second", &service, &[]);
    assert_eq!(step(&mut sim, 9, 0.3), Verdict::Intact);
    assert_eq!(step(&mut sim, 10, 2.5), Verdict::Changed);
    let published = sim.finish().unwrap();
    let ended = second.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let count = |what: &str| ended.summary()[what].as_u64().unwrap();
    assert_eq!(
        count("verified") + count("skipped") + count("rejected"),
        published
    );
    assert_eq!(published, 11);
}

#[test]
fn a_second_watcher_is_rejected_with_advice() {
    let folder = TempDir::new().unwrap();
    let service = service("two");
    let watch = Watch::start(folder.path(), "first", &service, &[]);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let ended = Watch::start(folder.path(), "second", &service, &[]).end();
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
    assert!(ended.stderr.starts_with("error: "), "{}", ended.stderr);
    assert!(ended.stderr.contains(&service), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("pass the option `--observe`"),
        "{}",
        ended.stderr
    );
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    assert_eq!(watch.end().code, Some(0));
}

/// The simulator that the next test kills. It runs only if a service is given.
#[test]
#[ignore = "not a test, but a process of the next test"]
fn simulator_to_be_killed() {
    let Ok(service) = std::env::var("LINKWATCH_TEST_SERVICE") else {
        return;
    };
    let mut sim = client(&service);
    sim.wait_for_watcher(PATIENCE).unwrap();
    for frame in 0..10_000 {
        sim.publish(frame as f64, Positions::F32(&squares(0.0)))
            .unwrap();
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn a_killed_simulator_ends_the_watch_with_a_message_and_does_not_affect_the_next_run() {
    let folder = TempDir::new().unwrap();
    let service = service("killed");
    let recording = folder.path().join("run.mcap");
    let watch = Watch::start(
        folder.path(),
        "watch",
        &service,
        &["--record", recording.to_str().unwrap()],
    );
    let mut sim = super::simulator_to_be_killed(&service);
    lines_of(&watch, 20);
    sim.kill().unwrap();
    sim.wait().unwrap();
    let ended = watch.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("the simulator died"),
        "{}",
        ended.stderr
    );
    assert!(ended.summary()["verified"].as_u64().unwrap() >= 20);
    // A replay reports that the recording is incomplete.
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(3), "{}", replayed.stderr);
    for words in [&["check"][..], &["report", "--text"]] {
        let run = linkwatch(&[words, &[recording.to_str().unwrap()]].concat());
        assert_eq!(run.code, 3, "{run:?}");
        let said = run.stdout.clone() + &run.stderr;
        assert!(said.contains("the simulator died"), "{run:?}");
    }

    let watch = Watch::start(folder.path(), "next", &service, &[]);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    assert_eq!(watch.end().code, Some(0));
}

/// Runs a watch over five intact frames, and ends it by a signal.
fn end_by_signal(signal: &str, folder: &TempDir, service: &str, args: &[&str]) -> Ended {
    let watch = Watch::start(folder.path(), "watch", service, args);
    let mut sim = client(service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for frame in 0..5 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    watch.signal(signal);
    let ended = watch.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    ended
}

/// Returns true if this process was started by `nohup`.
fn ignores_hangups() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    u64::from_str_radix(ignored.unwrap().trim(), 16).unwrap() & 1 == 1
}

#[test]
fn a_signal_ends_the_watch_properly() {
    let folder = TempDir::new().unwrap();
    for signal in ["TERM", "HUP"] {
        if signal == "HUP" && ignores_hangups() {
            eprintln!("SIGHUP was not tested: this process ignores it, and so does the watch");
            continue;
        }
        let recording = folder.path().join(format!("{signal}.mcap"));
        let record = ["--record", recording.to_str().unwrap()];
        let ended = end_by_signal(signal, &folder, &service(signal), &record);
        assert_eq!(ended.summary()["verified"], 5);
        let replayed = replay(&recording);
        assert_eq!(replayed.code, Some(0), "{}", replayed.stderr);
        let said = replayed.stderr;
        assert!(!said.contains("truncated"), "{said}");
    }
}

/// On the signal, the watcher says goodbye, so that a simulator in lockstep stops waiting for it.
#[test]
fn a_signal_to_the_watcher_frees_a_simulator_in_lockstep() {
    let folder = TempDir::new().unwrap();
    let service = service("freed");
    let mut sim = client(&service);
    let mut frame = 0;
    for (signal, how) in [("TERM", Departure::Goodbye), ("KILL", Departure::Crashed)] {
        let watch = Watch::start(folder.path(), signal, &service, &[]);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        for _ in 0..3 {
            // The previous watcher did not see this frame, so its verdict is irrelevant.
            step(&mut sim, frame, 0.0);
            frame += 1;
        }
        watch.signal(signal);
        let ended = watch.end();
        assert_eq!(
            ended.code,
            (signal == "TERM").then_some(0),
            "{}",
            ended.stderr
        );
        for _ in 0..3 {
            let positions = squares(0.0);
            let seq = sim.publish(0.1, Positions::F32(&positions)).unwrap();
            frame += 1;
            let outcome = without_time_out(signal, || sim.wait(seq, LONG));
            assert_eq!(outcome.unwrap(), Outcome::NoWatcher(how.clone()));
        }
    }
}

#[test]
fn rejects_invalid_times() {
    for time in ["nan", "inf", "-1", "1e300", "soon"] {
        let wait = format!("--wait={time}");
        let run = linkwatch(&["watch", "--service", &service("times"), &wait]);
        assert_eq!(run.code, 2, "{time}");
        let words = run.stderr;
        assert!(words.contains(time), "{words}");
        assert!(words.contains("a finite number of at least 0"), "{words}");
    }
}

/// Returns curves that pass through one another everywhere, which take minutes to verify.
pub fn tangle(curves: usize, segments: usize) -> Vec<f32> {
    let mut random = Random::new(1);
    let coordinate = || random.between(0.0, 1.0) as f32;
    std::iter::repeat_with(coordinate)
        .take(3 * curves * segments)
        .collect()
}

/// Regression test: the signal had no effect before the check ended, minutes later.
#[test]
fn a_signal_ends_a_watch_in_the_middle_of_a_long_check() {
    const CURVES: usize = 400;
    const SEGMENTS: usize = 1000;
    let folder = TempDir::new().unwrap();
    let service = service("deaf");
    let recording = folder.path().join("run.mcap");
    let args = ["--record", recording.to_str().unwrap()];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    sim.describe(
        Basis::Polyline,
        Precision::F32,
        &[-(SEGMENTS as i32); CURVES],
    )
    .unwrap();
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let seq = sim
        .publish(0.0, Positions::F32(&tangle(CURVES, SEGMENTS)))
        .unwrap();
    let deadline = Duration::from_secs(4);
    assert_eq!(sim.wait(seq, deadline).unwrap(), Outcome::Stale);
    // The watcher sends heartbeats meanwhile.
    until("a heartbeat", || {
        while sim.poll().unwrap().is_some() {}
        let silent = sim.silent_for().unwrap();
        (silent < deadline).then_some(())
    });
    watch.signal("TERM");
    let ended = watch.end();
    assert!(
        ended.stderr.contains("the check of frame 0 was cancelled"),
        "{}",
        ended.stderr
    );
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let counts = ["verified", "skipped", "rejected"].map(|n| ended.summary()[n].clone());
    assert_eq!(counts, [0, 1, 0]);
    assert_eq!(ended.reports(), Vec::<&Value>::new());
}

#[test]
fn a_watch_without_a_simulator_ends_after_the_time_limit() {
    let folder = TempDir::new().unwrap();
    let watch = Watch::start(
        folder.path(),
        "watch",
        &service("alone"),
        &["--wait", "0.3"],
    );
    let ended = watch.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("no simulator connected"),
        "{}",
        ended.stderr
    );
    assert_eq!(ended.summary()["verdict"], "nothing was verified");
}

#[test]
fn a_watcher_reports_times_and_ends_on_a_signal() {
    let folder = TempDir::new().unwrap();
    let ended = end_by_signal("TERM", &folder, &service("times"), &[]);
    // The first frame has no interval before it.
    let times: Vec<_> = ended.lines[..5].iter().map(|l| &l["times_ms"]).collect();
    assert!(times[0].get("wait").is_none(), "{}", times[0]);
    for stage in ["wait", "ingest", "verification", "send"] {
        for times in &times[1..] {
            assert!(times[stage].as_f64().unwrap() > 0.0, "{stage}: {times}");
        }
        let summary = &ended.summary()["times_ms"]["stages"][stage];
        let [median, p99, max] = ["median", "p99", "max"].map(|q| summary[q].as_f64().unwrap());
        assert!(0.0 < median && median <= p99 && p99 <= max, "{summary}");
    }
    let share = ended.summary()["times_ms"]["share_of_interval"].as_f64();
    // The share may exceed 1 if the machine was busy during the last frame, which no interval
    // follows.
    assert!(share.unwrap() > 0.0, "{share:?}");
}
