//! Live: `linkwatch watch` as a process, simulators in this one or in processes that are killed.

use linkwatch::{Basis, Client, ClientOptions, Outcome, Positions, Precision, Verdict};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const PATIENCE: Duration = Duration::from_secs(30);

/// A service that no other test uses.
fn service(test: &str) -> String {
    format!("live-{test}-{}", std::process::id())
}

/// A running `linkwatch watch`, ended when the test is over.
struct Watch {
    process: Child,
    stdout: PathBuf,
    stderr: PathBuf,
}

impl Watch {
    fn start(folder: &Path, name: &str, service: &str, args: &[&str]) -> Watch {
        let stdout = folder.join(format!("{name}.out"));
        let stderr = folder.join(format!("{name}.err"));
        let process = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
            .args(["watch", "--json", "--service", service])
            .args(args)
            .stdout(std::fs::File::create(&stdout).unwrap())
            .stderr(std::fs::File::create(&stderr).unwrap())
            .stdin(Stdio::null())
            .spawn()
            .unwrap();
        Watch {
            process,
            stdout,
            stderr,
        }
    }

    fn end(mut self) -> Ended {
        let status = wait(&mut self.process);
        Ended {
            code: status.code(),
            lines: json_lines(&std::fs::read_to_string(&self.stdout).unwrap()),
            stderr: std::fs::read_to_string(&self.stderr).unwrap(),
        }
    }

    fn signal(&self, name: &str) {
        let pid = self.process.id().to_string();
        assert!(
            Command::new("kill")
                .args(["-s", name, &pid])
                .status()
                .unwrap()
                .success()
        );
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

struct Ended {
    code: Option<i32>,
    lines: Vec<Value>,
    stderr: String,
}

impl Ended {
    fn reports(&self) -> Vec<&Value> {
        self.lines.iter().filter_map(|l| l.get("report")).collect()
    }

    fn summary(&self) -> &Value {
        &self.lines.last().expect("a summary")["summary"]
    }
}

/// Runs `linkwatch replay --json`.
fn replay(recording: &Path) -> Ended {
    let run = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
        .args(["replay", "--json"])
        .arg(recording)
        .output()
        .unwrap();
    Ended {
        code: run.status.code(),
        lines: json_lines(&String::from_utf8(run.stdout).unwrap()),
        stderr: String::from_utf8(run.stderr).unwrap(),
    }
}

fn json_lines(text: &str) -> Vec<Value> {
    text.lines()
        .map(|l| serde_json::from_str(l).unwrap())
        .collect()
}

fn wait(process: &mut Child) -> ExitStatus {
    let start = Instant::now();
    loop {
        if let Some(status) = process.try_wait().unwrap() {
            return status;
        }
        assert!(start.elapsed() < PATIENCE, "the process hangs");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Two linked squares, the second one moved aside by `shift`: apart from 2 on.
fn squares(shift: f32) -> Vec<f32> {
    let corners = [[-1., -1.], [1., -1.], [1., 1.], [-1., 1.]];
    let first = corners.iter().flat_map(|[x, y]| [*x, *y, 0.0]);
    let second = corners.iter().flat_map(|[x, y]| [1.0 + shift + x, 0.0, *y]);
    first.chain(second).collect()
}

fn client(service: &str) -> Client {
    let mut client = Client::open(service, &ClientOptions::lockstep()).unwrap();
    client
        .describe(Basis::Polyline, Precision::F32, &[-4, -4])
        .unwrap();
    client
}

/// Publishes a frame and waits for its verdict.
fn step(client: &mut Client, frame: u64, shift: f32) -> Verdict {
    let seq = client
        .publish(frame as f64 * 0.1, Positions::F32(&squares(shift)))
        .unwrap();
    match client.wait(seq, PATIENCE).unwrap() {
        Outcome::Verdict(m) => m.verdict,
        Outcome::Stale => panic!("no verdict on frame {seq}"),
    }
}

#[test]
fn a_pull_through_is_found_aborted_recorded_and_replayed_alike() {
    let folder = TempDir::new().unwrap();
    let service = service("replay");
    let recording = folder.path().join("run.mcap");
    let rrd = folder.path().join("run.rrd");
    let args = [
        "--record",
        recording.to_str().unwrap(),
        "--rrd",
        rrd.to_str().unwrap(),
    ];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for frame in 0..20 {
        // Linked up to frame 9, touching at 10, apart from 11 on; one frame with a NaN.
        let shift = frame as f32 * 0.1 - f32::from(frame == 10) * 1e-9;
        let shift = if frame < 10 { shift.min(0.9) } else { shift };
        let shift = if frame == 15 { f32::NAN } else { shift };
        let want = match frame {
            0..10 => Verdict::Intact,
            10 => Verdict::Contact,
            15 => Verdict::Rejected,
            _ => Verdict::Changed,
        };
        assert_eq!(step(&mut sim, frame, shift), want, "frame {frame}");
        assert_eq!(sim.aborted().is_some(), frame >= 10, "frame {frame}");
    }
    let last = sim.finish_within(PATIENCE).unwrap().expect("goodbye");
    assert_eq!(
        (
            last.counters.verified,
            last.counters.skipped,
            last.counters.rejected
        ),
        (19, 0, 1)
    );
    let live = watch.end();
    assert_eq!(live.code, Some(1), "{}", live.stderr);
    assert_eq!(live.reports().len(), 20);
    assert!(
        live.summary()["first_violation"]
            .as_str()
            .unwrap()
            .starts_with("frame 10: curves 0 and 1 touch")
    );
    assert!(std::fs::metadata(&rrd).unwrap().len() > 1000);

    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports(), live.reports());
    assert!(!replayed.stderr.contains("unlike"), "{}", replayed.stderr);
    keep("squares", &recording, &live);
}

/// Makes a recording part of the project, where that is asked for.
fn keep(name: &str, recording: &Path, live: &Ended) {
    if std::env::var_os("LINKWATCH_WRITE_RECORDINGS").is_some() {
        let to = recordings().join(name);
        std::fs::copy(recording, to.with_extension("mcap")).unwrap();
        let lines = live.reports().into_iter().map(|r| format!("{r}\n"));
        std::fs::write(to.with_extension("jsonl"), lines.collect::<String>()).unwrap();
    }
}

/// One square flies through the other from one frame to the next: no linking number sees that.
#[test]
fn pull_throughs_that_cancel_are_told_where_they_are_asked_for() {
    let folder = TempDir::new().unwrap();
    let recording = folder.path().join("run.mcap");
    let shifts = [3.0, 3.0, 3.001, -5.0, -5.0];
    let run = |name: &str, args: &[&str]| {
        let service = service(name);
        let watch = Watch::start(folder.path(), name, &service, args);
        let mut sim = client(&service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        let verdicts = shifts
            .iter()
            .enumerate()
            .map(|(frame, &shift)| step(&mut sim, frame as u64, shift));
        let verdicts: Vec<Verdict> = verdicts.collect();
        let abort = sim.aborted().map(|m| m.to_string());
        sim.finish().unwrap();
        (verdicts, abort, watch.end())
    };
    let (verdicts, abort, live) = run("unseen", &[]);
    assert_eq!(verdicts, [Verdict::Intact; 5]);
    assert_eq!((abort, live.code), (None, Some(0)), "{}", live.stderr);

    let record = ["--record", recording.to_str().unwrap()];
    let policy = ["--abort-on", "event", "--paranoid"];
    let (verdicts, abort, live) = run("seen", &[&record[..], &policy].concat());
    let changed = |k: usize| [Verdict::Intact, Verdict::Changed][usize::from(k == 3)];
    assert_eq!(verdicts, [0, 1, 2, 3, 4].map(changed));
    let abort = abort.expect("an abort");
    assert!(
        abort.starts_with("frame 3: changed, 4 pull-throughs: curves 0 and 1 passed through"),
        "{abort}"
    );
    assert_eq!(live.code, Some(1), "{}", live.stderr);
    let events = live.reports()[3]["events"].as_array().unwrap();
    let signs: i64 = events.iter().map(|e| e["sign"].as_i64().unwrap()).sum();
    assert_eq!((events.len(), signs), (4, 0));
    let first = live.summary()["first_violation"].as_str().unwrap();
    assert!(
        first.starts_with("frame 3: curves 0 and 1 passed"),
        "{first}"
    );
    // What each frame took is said, and nothing went wrong with it.
    for line in live.lines.iter().filter_map(|l| l.get("work")) {
        assert_eq!(line["disagreed"], false);
        assert!(["full", "quiet", "partial"].contains(&line["route"].as_str().unwrap()));
    }
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports(), live.reports());
    assert!(!replayed.stderr.contains("unlike"), "{}", replayed.stderr);
    keep("flight", &recording, &live);
}

/// Recordings that are part of the project, with the reports that a replay must give.
fn recordings() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings")
}

/// Recordings of earlier versions stay readable, and their verdicts stay what they were. Written anew by the test
/// above where `LINKWATCH_WRITE_RECORDINGS` is set.
#[test]
fn kept_recordings_give_their_verdicts() {
    let kept = std::fs::read_dir(recordings())
        .unwrap()
        .map(|e| e.unwrap().path());
    let kept: Vec<PathBuf> = kept
        .filter(|p| p.extension().is_some_and(|e| e == "mcap"))
        .collect();
    assert!(!kept.is_empty());
    for recording in kept {
        let expected = std::fs::read_to_string(recording.with_extension("jsonl")).unwrap();
        let replayed = replay(&recording);
        let expected = json_lines(&expected);
        // The work that a verdict takes may change from version to version.
        let said = |report: &serde_json::Value| {
            let mut report = report.clone();
            report["stats"].take();
            // Recordings of earlier versions have none.
            if report["events"].is_null() {
                report["events"] = serde_json::json!([]);
            }
            report
        };
        assert_eq!(
            replayed.reports().into_iter().map(said).collect::<Vec<_>>(),
            expected.iter().map(said).collect::<Vec<_>>(),
            "{recording:?}"
        );
        assert!(!replayed.stderr.contains("unlike"), "{}", replayed.stderr);
    }
}

#[test]
fn a_watcher_that_comes_late_or_again_takes_over() {
    let folder = TempDir::new().unwrap();
    let service = service("late");
    let mut sim = client(&service);
    // Nobody watches, and nothing waits.
    for frame in 0..5 {
        sim.publish(frame as f64, Positions::F32(&squares(0.0)))
            .unwrap();
    }
    let recording = folder.path().join("first.mcap");
    let record = ["--record", recording.to_str().unwrap()];
    let first = Watch::start(folder.path(), "first", &service, &record);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 5, 0.1), Verdict::Intact);
    first.signal("KILL");
    drop(first);
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(3), "{}", replayed.stderr);
    assert!(replayed.stderr.contains("cut off"), "{}", replayed.stderr);
    // A killed watcher costs nothing.
    let start = Instant::now();
    for frame in 6..9 {
        sim.publish(frame as f64, Positions::F32(&squares(0.2)))
            .unwrap();
    }
    assert!(start.elapsed() < Duration::from_secs(1));
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
fn a_second_watcher_is_refused_in_words() {
    let folder = TempDir::new().unwrap();
    let service = service("two");
    let watch = Watch::start(folder.path(), "first", &service, &[]);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let ended = Watch::start(folder.path(), "second", &service, &[]).end();
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
    assert!(ended.stderr.starts_with("error: "), "{}", ended.stderr);
    assert!(ended.stderr.contains(&service), "{}", ended.stderr);
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    assert_eq!(watch.end().code, Some(0));
}

/// Not a test of its own: the simulator that the next test kills. It runs only where it is told a service.
#[test]
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
fn a_simulator_killed_in_mid_run_ends_the_watch_with_a_message_and_stops_no_next_run() {
    let folder = TempDir::new().unwrap();
    let service = service("killed");
    let recording = folder.path().join("run.mcap");
    let watch = Watch::start(
        folder.path(),
        "watch",
        &service,
        &["--record", recording.to_str().unwrap()],
    );
    let mut sim = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "simulator_to_be_killed"])
        .env("LINKWATCH_TEST_SERVICE", &service)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while std::fs::read_to_string(&watch.stdout)
        .unwrap()
        .lines()
        .count()
        < 20
    {
        assert!(start.elapsed() < PATIENCE, "no frames arrive");
        std::thread::sleep(Duration::from_millis(10));
    }
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
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(0), "{}", replayed.stderr);

    let watch = Watch::start(folder.path(), "next", &service, &[]);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    assert_eq!(watch.end().code, Some(0));
}

#[test]
fn a_signal_ends_the_watch_properly() {
    let folder = TempDir::new().unwrap();
    let service = service("signal");
    let recording = folder.path().join("run.mcap");
    let watch = Watch::start(
        folder.path(),
        "watch",
        &service,
        &["--record", recording.to_str().unwrap()],
    );
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for frame in 0..5 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(ended.summary()["verified"], 5);
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(0), "{}", replayed.stderr);
    assert!(!replayed.stderr.contains("cut off"), "{}", replayed.stderr);
}

/// Curves through one another everywhere, which take minutes to verify.
fn tangle(curves: usize, segments: usize) -> Vec<f32> {
    let mut x = 88172645463325252u64;
    let coordinate = || {
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        (x >> 40) as f32 / (1 << 24) as f32
    };
    std::iter::repeat_with(coordinate)
        .take(3 * curves * segments)
        .collect()
}

/// It was deaf until the check had ended: minutes later, here.
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
    assert_eq!(
        sim.wait(seq, Duration::from_secs(4)).unwrap(),
        Outcome::Stale
    );
    // The watcher was heard meanwhile.
    while sim.poll().unwrap().is_some() {}
    let silent = sim.silent_for().unwrap();
    assert!(silent < Duration::from_secs(3), "{silent:?}");
    watch.signal("TERM");
    let start = Instant::now();
    let ended = watch.end();
    assert!(
        start.elapsed() < Duration::from_secs(10),
        "{:?}",
        start.elapsed()
    );
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
fn a_watch_without_a_simulator_gives_up_when_told_to() {
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
        ended.stderr.contains("no simulator came"),
        "{}",
        ended.stderr
    );
    assert_eq!(ended.summary()["verdict"], "nothing was verified");
}

#[test]
fn hostile_recordings_are_refused_in_one_line() {
    let folder = TempDir::new().unwrap();
    for (name, bytes) in [
        ("empty.mcap", &b""[..]),
        ("text.mcap", b"hello"),
        ("magic.mcap", b"\x89MCAP0\r\n\xff\xff"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let Ended { code, stderr, .. } = replay(&path);
        assert!(matches!(code, Some(2 | 3)), "{name}: {stderr}");
        assert!(stderr.contains(name), "{stderr}");
        assert!(!stderr.contains("panicked"), "{stderr}");
    }
}

/// Another policy than the default one is part of the recording: a replay without options compares alike.
#[test]
fn a_replay_keeps_the_policy_of_the_recording() {
    let folder = TempDir::new().unwrap();
    let service = service("policy");
    let recording = folder.path().join("run.mcap");
    let args = [
        "--abort-on",
        "never",
        "--record",
        recording.to_str().unwrap(),
    ];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    // Two broken frames come before the first good one.
    for (frame, shift) in [f32::NAN, f32::NAN, 0.0, 2.5].into_iter().enumerate() {
        step(&mut sim, frame as u64, shift);
    }
    assert!(sim.aborted().is_none());
    sim.finish().unwrap();
    let live = watch.end();
    assert_eq!(live.code, Some(1), "{}", live.stderr);
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports(), live.reports());
    assert!(!replayed.stderr.contains("unlike"), "{}", replayed.stderr);
    assert_eq!(replayed.summary()["rejected"], 2);
    let over = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
        .args(["replay", "--record"])
        .args([&recording, &recording])
        .output()
        .unwrap();
    assert_eq!(over.status.code(), Some(2));
    assert_eq!(
        replay(&recording).code,
        Some(1),
        "the recording is still whole"
    );
}

/// `cargo test --release --test live round_trips -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn round_trips_of_small_and_larger_frames() {
    let folder = TempDir::new().unwrap();
    for (curves, segments) in [(2, 4), (100, 10), (100, 20), (400, 50)] {
        let service = service(&format!("trips-{curves}-{segments}"));
        let watch = Watch::start(folder.path(), "watch", &service, &[]);
        let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
        let counts = vec![-segments; curves];
        sim.describe(Basis::Polyline, Precision::F32, &counts)
            .unwrap();
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        let points = (0..curves).flat_map(|i| {
            (0..segments).flat_map(move |k| {
                let t = std::f32::consts::TAU * k as f32 / segments as f32;
                [3.0 * i as f32 + t.cos(), t.sin(), 0.1 * (2.0 * t).sin()]
            })
        });
        let points: Vec<f32> = points.collect();
        let mut trips: Vec<Duration> = (0..2000)
            .map(|frame| {
                let start = Instant::now();
                let seq = sim
                    .publish(f64::from(frame), Positions::F32(&points))
                    .unwrap();
                let outcome = sim.wait(seq, PATIENCE).unwrap();
                assert!(matches!(outcome, Outcome::Verdict(m) if m.verdict == Verdict::Intact));
                start.elapsed()
            })
            .collect();
        trips.sort();
        let [median, slow] = [trips[1000], trips[1900]];
        println!("{curves} curves of {segments} segments: {median:?}, {slow:?} for one in 20");
        sim.finish().unwrap();
        watch.end();
    }
}
