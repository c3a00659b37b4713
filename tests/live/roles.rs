//! Watches of several simulators, and several watches of one simulator.

use super::*;

/// Runs a simulator over these shifts of its second square. Returns its verdicts.
fn simulate(service: &str, shifts: &[f32]) -> Vec<Verdict> {
    let mut sim = client(service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let frames = shifts.iter().enumerate();
    let verdicts = frames.map(|(frame, &shift)| step(&mut sim, frame as u64, shift));
    let verdicts = verdicts.collect();
    sim.finish_within(PATIENCE).unwrap().expect("a goodbye");
    verdicts
}

/// Waits until a file exists.
fn created(path: &Path) {
    until(path.display(), || path.exists().then_some(()));
}

#[test]
fn keeps_watching_after_a_killed_a_changed_and_an_intact_session() {
    let folder = TempDir::new().unwrap();
    let service = service("keep");
    let files = ["run.mcap", "run-2.mcap", "run-3.mcap"].map(|name| folder.path().join(name));
    let record = ["--keep-watching", "--record", files[0].to_str().unwrap()];
    let watch = Watch::start(folder.path(), "watch", &service, &record);

    let mut killed = simulator_to_be_killed(&service);
    lines_of(&watch, 20);
    killed.kill().unwrap();
    killed.wait().unwrap();
    // The next simulator starts before the watch notices.
    let changed = simulate(&service, &[0.0, 0.1, 2.5]);
    assert_eq!(
        changed,
        [Verdict::Intact, Verdict::Intact, Verdict::Changed]
    );
    // Its first frame is the new baseline, although its curves are apart.
    let intact = simulate(&service, &[2.5, 2.6]);
    assert_eq!(intact, [Verdict::Intact, Verdict::Intact]);
    stderr_with(&watch, &["the simulator ended after 2 frames"]);

    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains("session 3"), "{}", ended.stderr);
    let found: Vec<_> = ended
        .summaries()
        .iter()
        .map(|l| {
            let summary = &l["summary"];
            let verdict = summary["verdict"].as_str().unwrap();
            (
                l["session"].as_u64().unwrap(),
                verdict,
                summary["verified"].as_u64().unwrap(),
            )
        })
        .collect();
    assert_eq!(found[1..], [(2, "changed", 3), (3, "intact", 2)]);
    let (number, verdict, verified) = found[0];
    assert_eq!((number, verdict), (1, "undecided or incomplete"));
    assert!(verified >= 20, "{verified}");
    let of = |session: u64| {
        let lines = ended.lines.iter().filter(|l| l["session"] == session);
        lines.filter_map(|l| l.get("report")).collect::<Vec<_>>()
    };
    // The first simulator was killed.
    for ((file, session), code) in files.iter().zip(1..).zip([3, 1, 0]) {
        let replayed = replay(file);
        assert_eq!(replayed.code, Some(code), "{}", replayed.stderr);
        assert_eq!(replayed.reports(), of(session), "{file:?}");
        replayed.assert_recorded_verdicts();
    }
}

#[test]
fn recordings_of_later_sessions_overwrite_no_file() {
    let folder = TempDir::new().unwrap();
    let service = service("kept");
    let file = |name: &str| folder.path().join(name);
    std::fs::write(file("run-2.mcap"), "mine").unwrap();
    let run = file("run.mcap");
    let record = ["--keep-watching", "--record", run.to_str().unwrap()];
    let watch = Watch::start(folder.path(), "watch", &service, &record);
    for session in ["run.mcap", "run-3.mcap", "run-4.mcap"] {
        assert_eq!(simulate(&service, &[0.0]), [Verdict::Intact]);
        created(&file(session));
    }
    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("the output of session 2 goes to"),
        "{}",
        ended.stderr
    );
    assert_eq!(std::fs::read(file("run-2.mcap")).unwrap(), b"mine");
    assert!(!file("run-5.mcap").exists());
    assert_eq!(replay(&file("run-4.mcap")).code, Some(0));

    // The first file exists now.
    let refused = Watch::start(folder.path(), "refused", &service, &record).end();
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
}

/// The linking numbers of a certificate apply to each session. Curves that do not match the
/// certificate end only their own session.
#[test]
fn a_certificate_applies_to_every_session() {
    let folder = TempDir::new().unwrap();
    let service = service("certified");
    let certificate = folder.path().join("linked.txt");
    std::fs::write(&certificate, "2\n0,1,-1\n").unwrap();
    let args = [
        "--keep-watching",
        "--baseline",
        certificate.to_str().unwrap(),
    ];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let sign = simulate(&service, &[0.0])[0];
    let apart = simulate(&service, &[2.5])[0];
    assert_eq!(apart, Verdict::Changed);

    let mut other = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    other
        .describe(Basis::Polyline, Precision::F32, &[-4])
        .unwrap();
    assert!(other.wait_for_watcher(PATIENCE).unwrap());
    let seq = other
        .publish(0.0, Positions::F32(&squares(0.0)[..12]))
        .unwrap();
    let outcome = without_time_out("the wait", || other.wait(seq, LONG));
    assert!(matches!(outcome.unwrap(), Outcome::NoWatcher(_)));
    stderr_with(&watch, &["session 3 is not verified any further"]);
    drop(other);

    assert_eq!(simulate(&service, &[0.0])[0], sign);
    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert_eq!(ended.summaries().len(), 4);
}

/// A viewer that accepts a connection and reads nothing keeps its session open for 30 s.
#[test]
fn a_viewer_that_hangs_does_not_delay_the_next_session() {
    let folder = TempDir::new().unwrap();
    let service = service("hangs");
    let viewer = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = viewer.local_addr().unwrap().to_string();
    let args = ["--keep-watching", "--show", &address];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    for _ in 0..3 {
        assert_eq!(simulate(&service, &[0.0]), [Verdict::Intact]);
    }
    let (text, last) = until("the third session", || {
        let text = std::fs::read_to_string(&watch.stdout).unwrap();
        text.find("\"session\":3").map(|at| (text, at))
    });
    let closed = text.find("\"summary\"");
    assert!(closed.is_none_or(|closed| last < closed), "{text}");
    drop(viewer);
}

#[test]
fn a_signal_ends_a_watch_between_sessions() {
    let folder = TempDir::new().unwrap();
    let service = service("between");
    // The limit applies to the first simulator only.
    let args = ["--keep-watching", "--wait", "20"];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    assert_eq!(simulate(&service, &[0.0]), [Verdict::Intact]);
    stderr_with(&watch, &["waiting for the next simulator"]);
    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(ended.summaries().len(), 1);
}

/// Publishes a frame, waits for its verdict, and waits until the observers have verified it as
/// well.
fn observed_step(sim: &mut Client, observers: &[&Watch], frame: u64, shift: f32) -> Verdict {
    let verdict = step(sim, frame, shift);
    observers.iter().for_each(|o| printed_frame(o, frame));
    verdict
}

/// Waits until a watch has printed the report on a frame.
fn printed_frame(watch: &Watch, frame: u64) {
    until(format_args!("the report on frame {frame}"), || {
        let lines = std::fs::read_to_string(&watch.stdout).unwrap();
        lines.contains(&format!("\"seq\":{frame},")).then_some(())
    });
}

#[test]
fn observers_verify_and_record_beside_the_watch_that_answers() {
    let folder = TempDir::new().unwrap();
    let service = service("observed");
    let recording = folder.path().join("observed.mcap");
    let watch = Watch::start(folder.path(), "watch", &service, &[]);
    let record = ["--observe", "--record", recording.to_str().unwrap()];
    let first = Watch::start(folder.path(), "first", &service, &record);
    let second = Watch::start(folder.path(), "second", &service, &["--observe"]);
    for observer in [&first, &second] {
        stderr_with(observer, &["nothing is sent to it"]);
    }
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let listed = printed(&["services"]).1;
    let line = listed.lines().find(|l| l.starts_with(&service)).unwrap();
    assert_eq!(line.matches("observer (process ").count(), 2, "{line}");
    assert!(line.contains(", watcher (process "), "{line}");
    for (frame, shift) in [0.0, 0.1, 2.5].into_iter().enumerate() {
        let verdict = observed_step(&mut sim, &[&first, &second], frame as u64, shift);
        assert_eq!(verdict == Verdict::Changed, frame == 2);
    }
    assert!(sim.aborted().is_some());
    sim.finish_within(PATIENCE).unwrap().expect("a goodbye");
    let answered = watch.end();
    assert_eq!(answered.code, Some(1), "{}", answered.stderr);
    for observer in [first, second] {
        let ended = observer.end();
        assert_eq!(ended.code, Some(1), "{}", ended.stderr);
        assert_eq!(ended.summary()["verified"], 3);
        for (own, other) in ended.reports().iter().zip(answered.reports()) {
            assert_eq!(own["verdict"], other["verdict"]);
            assert_eq!(own["changes"], other["changes"]);
            assert_eq!(own["abort"], false, "an observer asks for nothing");
        }
    }
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    replayed.assert_recorded_verdicts();
}

#[test]
fn an_observer_alone_verifies_and_is_not_noticed() {
    let folder = TempDir::new().unwrap();
    let service = service("alone observer");
    let observer = Watch::start(folder.path(), "observer", &service, &["--observe"]);
    stderr_with(&observer, &["nothing is sent to it"]);
    let mut sim = client(&service);
    for (frame, shift) in [0.0, 2.5].into_iter().enumerate() {
        let positions = squares(shift);
        let seq = sim.publish(0.0, Positions::F32(&positions)).unwrap();
        printed_frame(&observer, frame as u64);
        let outcome = sim.wait(seq, Duration::from_millis(100)).unwrap();
        assert_eq!(outcome, Outcome::Stale);
    }
    assert!(!sim.wait_for_watcher(Duration::from_millis(1100)).unwrap());
    assert_eq!(sim.silent_for(), None);
    assert!(sim.aborted().is_none());
    sim.finish().unwrap();
    let ended = observer.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert_eq!(ended.summary()["verified"], 2);
    assert_eq!(ended.summary()["skipped"], 0);
}

/// The simulator waits for the watch only, so a stopped observer misses frames and counts them.
#[test]
fn an_observer_counts_the_frames_that_it_skips_in_lockstep() {
    let folder = TempDir::new().unwrap();
    let service = service("skips");
    let watch = Watch::start(folder.path(), "watch", &service, &[]);
    let observer = Watch::start(folder.path(), "observer", &service, &["--observe"]);
    stderr_with(&observer, &["nothing is sent to it"]);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    observed_step(&mut sim, &[&observer], 0, 0.0);
    observer.signal("STOP");
    for frame in 1..10 {
        assert_eq!(step(&mut sim, frame, 0.1), Verdict::Intact);
    }
    observer.signal("CONT");
    printed_frame(&observer, 9);
    sim.finish_within(PATIENCE).unwrap().expect("a goodbye");
    let ended = observer.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let count = |what: &str| ended.summary()[what].as_u64().unwrap();
    assert!(count("skipped") >= 5, "{}", ended.summary());
    assert_eq!(count("verified") + count("skipped"), 10);
    assert_eq!(watch.end().summary()["verified"], 10);
}

/// Regression test: a watcher failed if another one created the service at the same time.
#[test]
fn a_watcher_and_an_observer_can_start_at_once() {
    let folder = TempDir::new().unwrap();
    for k in 0..20 {
        let service = service(&format!("at-once-{k}"));
        let roles: [&[&str]; 2] = [&[], &["--observe"]];
        let names = [format!("watch-{k}"), format!("observer-{k}")];
        let both = [0, 1].map(|r| Watch::start(folder.path(), &names[r], &service, roles[r]));
        stderr_with(&both[1], &["nothing is sent to it"]);
        let mut sim = client(&service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        observed_step(&mut sim, &[&both[1]], 0, 0.0);
        sim.finish_within(PATIENCE).unwrap().expect("a goodbye");
        for watch in both {
            let ended = watch.end();
            assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        }
    }
}

#[test]
fn an_observer_has_no_policy() {
    let run = linkwatch(&["watch", "--observe", "--abort-on", "lost"]);
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("--abort-on"), "{}", run.stderr);
}

#[test]
fn a_service_that_is_watched_is_refused() {
    let folder = TempDir::new().unwrap();
    let service = service("taken");
    let watch = Watch::start(folder.path(), "watch", &service, &[]);
    stderr_with(&watch, &["waiting for a simulator"]);
    let (code, words) = printed(&["watch", "--service", &service]);
    assert_eq!(code, Some(2), "{words}");
    assert!(
        words.contains("already watched") && words.contains("--observe"),
        "{words}"
    );
}

/// Returns the resident memory of a process, in kilobytes.
#[cfg(target_os = "linux")]
fn resident_kb(watch: &Watch) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", watch.process.id())).unwrap();
    let line = status.lines().find(|l| l.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

/// The verifier, the frames and the memory of a simulator take several megabytes here. All of it
/// must be freed after the session.
#[test]
#[cfg(target_os = "linux")]
fn memory_does_not_grow_with_the_sessions() {
    const POINTS: i32 = 10_000;
    let folder = TempDir::new().unwrap();
    let service = service("memory");
    let run = folder.path().join("run.mcap");
    let record = ["--keep-watching", "--record", run.to_str().unwrap()];
    let watch = Watch::start(folder.path(), "watch", &service, &record);
    let circle = |z: f32| {
        let point = move |k: i32| {
            let angle = k as f32 * std::f32::consts::TAU / POINTS as f32;
            [angle.cos(), angle.sin(), z]
        };
        (0..POINTS).flat_map(point)
    };
    let positions: Vec<f32> = circle(0.0).chain(circle(0.1)).collect();
    let mut resident = Vec::new();
    for session in 0..200 {
        let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
        sim.describe(Basis::Polyline, Precision::F32, &[-POINTS; 2])
            .unwrap();
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        for _ in 0..2 {
            let seq = sim.publish(0.0, Positions::F32(&positions)).unwrap();
            let outcome = sim.wait(seq, PATIENCE).unwrap();
            assert!(matches!(outcome, Outcome::Verdict(_)), "{session}");
        }
        sim.finish_within(PATIENCE).unwrap().expect("a goodbye");
        resident.push(resident_kb(&watch));
    }
    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(ended.summaries().len(), 200);
    // The least of 50 sessions, because the last session may still be closing.
    let least: Vec<u64> = resident
        .chunks(50)
        .map(|c| *c.iter().min().unwrap())
        .collect();
    println!("least resident memory of each 50 sessions: {least:?} kB");
    // On average, a session may keep at most a third of a frame. The first fifty sessions are not
    // compared, because later ones fill the pools of the process.
    let grown = least[3].saturating_sub(least[1]);
    assert!(grown < 100 * 80, "{least:?} kB");
}
