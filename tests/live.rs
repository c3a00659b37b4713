//! Tests of `linkwatch watch` as a process, with simulators in this process or in processes that
//! are killed.

use iceoryx2::prelude::ZeroCopySend;
use linkwatch::{
    Basis, Client, ClientOptions, Departure, FrameRecord, Outcome, Positions, Precision,
    RecordedItem, RecordingReader, RecordingSink, Report, Sink, Verdict,
};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};
use tempfile::TempDir;

const PATIENCE: Duration = Duration::from_secs(30);

/// Returns the name of a service that no other test uses.
fn service(test: &str) -> String {
    format!("live-{test}-{}", std::process::id())
}

/// A running `linkwatch watch`, which is ended when the test ends.
struct Watch {
    process: Child,
    stdout: PathBuf,
    stderr: PathBuf,
}

impl Watch {
    fn start(folder: &Path, name: &str, service: &str, args: &[&str]) -> Watch {
        let streams = [None, None];
        let command = Command::new(env!("CARGO_BIN_EXE_linkwatch"));
        Watch::start_with(folder, name, service, args, command, streams)
    }

    /// Starts a watch with another command, or with other streams than files.
    fn start_with(
        folder: &Path,
        name: &str,
        service: &str,
        args: &[&str],
        mut command: Command,
        streams: [Option<Stdio>; 2],
    ) -> Watch {
        let [stdout, stderr] = ["out", "err"].map(|e| folder.join(format!("{name}.{e}")));
        let [out, err] = streams;
        let file = |path: &Path| std::fs::File::create(path).unwrap().into();
        let process = command
            .args(["watch", "--json", "--service", service])
            .args(args)
            .stdout(out.unwrap_or_else(|| file(&stdout)))
            .stderr(err.unwrap_or_else(|| file(&stderr)))
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
            // A stream that is not a file records no lines.
            lines: json_lines(&std::fs::read_to_string(&self.stdout).unwrap_or_default()),
            stderr: std::fs::read_to_string(&self.stderr).unwrap_or_default(),
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
    replay_with(recording, &[])
}

fn replay_with(recording: &Path, args: &[&str]) -> Ended {
    let run = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
        .args(["replay", "--json"])
        .arg(recording)
        .args(args)
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

/// Two linked squares, the second one displaced by `shift`: apart from 2 on.
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
        other => panic!("frame {seq}: {other:?}"),
    }
}

#[test]
fn a_pull_through_is_found_aborted_recorded_and_replayed_identically() {
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
    let first = &live.summary()["first_violation"];
    let keys = ["frame", "verdict", "curves"].map(|key| first[key].to_string());
    assert_eq!(keys, ["10", "\"contact\"", "[0,1]"], "{first}");
    let finding = first["finding"].as_str().unwrap();
    assert!(finding.starts_with("curves 0 and 1 touch"), "{first}");
    assert!(std::fs::metadata(&rrd).unwrap().len() > 1000);

    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports(), live.reports());
    assert!(
        !replayed.stderr.contains("different from"),
        "{}",
        replayed.stderr
    );
    keep("squares", &recording, &live);
}

/// Copies a recording into the project, if that is requested.
fn keep(name: &str, recording: &Path, live: &Ended) {
    if std::env::var_os("LINKWATCH_WRITE_RECORDINGS").is_some() {
        let to = recordings().join(name);
        std::fs::copy(recording, to.with_extension("mcap")).unwrap();
        let lines = live.reports().into_iter().map(|r| format!("{r}\n"));
        std::fs::write(to.with_extension("jsonl"), lines.collect::<String>()).unwrap();
    }
}

/// One square passes through the other between two frames, which no linking number detects.
#[test]
fn reports_pull_throughs_that_cancel_if_requested() {
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
    // The curve moves four edge lengths in one step, beyond the default limit.
    let policy = ["--abort-on", "event", "--paranoid", "--motion-limit", "5"];
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
    let first = &live.summary()["first_violation"];
    let finding = first["finding"].as_str().unwrap();
    assert!(finding.starts_with("curves 0 and 1 passed"), "{first}");
    assert_eq!(first["frame"], 3);
    // The work of each frame is reported, and no frame disagreed.
    for line in live.lines.iter().filter_map(|l| l.get("work")) {
        assert_eq!(line["disagreed"], false);
        assert!(["full", "quiet", "partial"].contains(&line["route"].as_str().unwrap()));
    }
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports(), live.reports());
    assert!(
        !replayed.stderr.contains("different from"),
        "{}",
        replayed.stderr
    );
    keep("flight", &recording, &live);
}

/// A curve is pulled through; the simulator goes back to an earlier frame and continues from there.
#[test]
fn a_rollback_of_a_pull_through_is_aborted_once() {
    let folder = TempDir::new().unwrap();
    // The simulator reports the rollback with `resume`, or does not: then the way back is a
    // pull-through.
    for (name, resumes) in [("resumed", true), ("not resumed", false)] {
        let service = service(name);
        let recording = folder.path().join(format!("{name}.mcap"));
        let record = [
            "--events",
            "--motion-limit",
            "5",
            "--paranoid",
            "--record",
            recording.to_str().unwrap(),
        ];
        let watch = Watch::start(folder.path(), name, &service, &record);
        let mut sim = client(&service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        let mut aborts = Vec::new();
        let shifts = [3.0, 3.0, 3.001, -5.0, 3.0, 3.001, 3.002, 2.9, 2.8];
        for (frame, shift) in shifts.into_iter().enumerate() {
            let verdict = step(&mut sim, frame as u64, shift);
            if verdict == Verdict::Changed {
                aborts.push(frame);
                assert!(sim.aborted().is_some());
                if resumes {
                    sim.resume();
                }
            }
        }
        sim.finish().unwrap();
        let expected = if resumes { vec![3] } else { vec![3, 4] };
        assert_eq!(aborts, expected);
        let live = watch.end();
        let replayed = replay(&recording);
        assert_eq!(replayed.reports(), live.reports());
        assert!(
            !replayed.stderr.contains("different from"),
            "{}",
            replayed.stderr
        );
    }
}

/// The frame after the rollback is skipped, or it is rejected: the next verified frame does not
/// continue the one before the rollback.
#[test]
fn a_rollback_in_a_frame_that_was_not_verified_is_detected() {
    let folder = TempDir::new().unwrap();
    for (name, cut) in [("skipped", true), ("uncut", false)] {
        let service = service(name);
        let recording = folder.path().join(format!("{name}.mcap"));
        let events = ["--events", "--motion-limit", "5"];
        let record = [&events[..], &["--record", recording.to_str().unwrap()]].concat();
        let watch = Watch::start(folder.path(), name, &service, &record);
        let mut sim = client(&service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        assert_eq!(step(&mut sim, 0, 3.0), Verdict::Intact);
        assert_eq!(step(&mut sim, 1, 3.001), Verdict::Intact);
        let publish = |sim: &mut Client, shift: f32| {
            sim.publish(0.5, Positions::F32(&squares(shift))).unwrap()
        };
        // The watcher is stopped, and takes the newest frame when it continues.
        watch.signal("STOP");
        std::thread::sleep(Duration::from_millis(50));
        if cut {
            sim.cut();
        }
        let skipped: Vec<u64> = [-5.0, -5.0, -5.0].map(|x| publish(&mut sim, x)).into();
        let seq = publish(&mut sim, -5.0);
        watch.signal("CONT");
        let Outcome::Verdict(first) = sim.wait(seq, PATIENCE).unwrap() else {
            panic!("no verdict on frame {seq}");
        };
        let last = skipped.last().copied().unwrap();
        assert_eq!(sim.wait(last, PATIENCE).unwrap(), Outcome::Stale);
        assert_eq!(first.events, if cut { 0 } else { 4 });
        // The frame after the cut is rejected: the one after that does not continue the frame
        // before the cut.
        if cut {
            sim.cut();
        }
        assert_eq!(step(&mut sim, seq + 1, f32::NAN), Verdict::Rejected);
        let seq = publish(&mut sim, 3.0);
        let Outcome::Verdict(second) = sim.wait(seq, PATIENCE).unwrap() else {
            panic!("no verdict on frame {seq}");
        };
        assert_eq!(second.events, if cut { 0 } else { 4 });
        sim.finish().unwrap();
        let live = watch.end();
        assert!(live.summary()["skipped"].as_u64().unwrap() >= 2);
        let replayed = replay(&recording);
        assert_eq!(replayed.reports(), live.reports());
        assert!(
            !replayed.stderr.contains("different from"),
            "{}",
            replayed.stderr
        );
    }
}

#[test]
fn a_simulation_that_became_nan_is_asked_to_stop() {
    let folder = TempDir::new().unwrap();
    for (policy, stops) in [("any", true), ("rejected", true), ("lost", false)] {
        let service = service(&format!("nan-{policy}"));
        let recording = folder.path().join(format!("{policy}.mcap"));
        let args = [
            "--abort-on",
            policy,
            "--record",
            recording.to_str().unwrap(),
        ];
        let watch = Watch::start(folder.path(), policy, &service, &args);
        let mut sim = client(&service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
        assert_eq!(step(&mut sim, 1, f32::NAN), Verdict::Rejected);
        let abort = sim.aborted().map(|m| m.to_string());
        let words = "frame 1: rejected: curve 1, point 0: coordinate x is NaN. Stop or roll back";
        assert_eq!(abort, stops.then(|| words.into()));
        // The simulator goes back to the previous frame.
        sim.resume();
        assert_eq!(step(&mut sim, 2, 0.0), Verdict::Intact);
        assert!(sim.aborted().is_none());
        sim.finish().unwrap();
        let live = watch.end();
        assert_eq!(live.code, Some(3), "{}", live.stderr);
        assert_eq!(live.reports()[1]["abort"], stops);
        let replayed = replay(&recording);
        assert_eq!(replayed.code, Some(3), "{}", replayed.stderr);
        assert_eq!(replayed.reports(), live.reports());
        assert!(
            !replayed.stderr.contains("different from"),
            "{}",
            replayed.stderr
        );
        // Another policy gives another abort flag, also for a frame of which only the verdict is
        // recorded.
        let other = ["--abort-on", if stops { "never" } else { "any" }];
        let other = replay_with(&recording, &other);
        assert_eq!(other.reports()[1]["abort"], !stops);
    }
}

/// Folder of the recordings in the project, with the reports that a replay must give.
fn recordings() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings")
}

/// Recordings of earlier versions stay readable, and their verdicts do not change. The test above
/// writes them again if `LINKWATCH_WRITE_RECORDINGS` is set.
#[test]
fn recordings_of_earlier_versions_give_the_same_verdicts() {
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
            // Recordings of earlier versions lack these fields.
            for list in ["events", "unresolved", "adopted"] {
                if report[list].is_null() {
                    report[list] = serde_json::json!([]);
                }
            }
            for event in report["events"].as_array_mut().unwrap() {
                event["lengths"].take();
            }
            report
        };
        assert_eq!(
            replayed.reports().into_iter().map(said).collect::<Vec<_>>(),
            expected.iter().map(said).collect::<Vec<_>>(),
            "{recording:?}"
        );
        assert!(
            !replayed.stderr.contains("different from"),
            "{}",
            replayed.stderr
        );
    }
}

/// Writes the recording of the flight again, with other reports. A frame whose report is dropped
/// leaves a gap.
fn rewrite_flight(to: &Path, mut keep: impl FnMut(&mut Report) -> bool) {
    let mut reader = RecordingReader::open(&recordings().join("flight.mcap")).unwrap();
    let (mut sink, mut curves, mut set) = (None, None, None);
    while let Some(item) = reader.next_item().unwrap() {
        let create = || RecordingSink::create(to, reader.metadata()).unwrap();
        let sink = sink.get_or_insert_with(|| Box::new(create()));
        match item {
            RecordedItem::Baseline(baseline) => sink.begin(&baseline).unwrap(),
            RecordedItem::Frame(frame) => {
                frame.ingest(&mut set).unwrap();
                curves = set.clone().map(Arc::new);
            }
            RecordedItem::Verdict(mut verdict) => {
                if !keep(&mut verdict.report) {
                    continue;
                }
                let progress = verdict.progress;
                let record = FrameRecord {
                    curves: curves.take(),
                    cuts: 0,
                    report: Arc::new(verdict.report),
                    verified: progress.verified,
                    skipped: progress.skipped,
                    rejected: progress.rejected,
                    check: progress.check,
                    work: progress.work,
                    received: SystemTime::now(),
                };
                sink.frame(&record).unwrap();
            }
        }
    }
    sink.unwrap().finish().unwrap();
}

/// A recorder with a slow disk drops frames. The motion to the frame after such a gap differs from
/// that of the live run.
#[test]
fn counts_frames_that_were_not_recorded_without_an_error() {
    let folder = TempDir::new().unwrap();
    let gappy = folder.path().join("gappy.mcap");
    rewrite_flight(&gappy, |report| report.seq != 2);
    let replayed = replay(&gappy);
    assert_eq!(replayed.code, Some(1), "{}", replayed.stderr);
    assert_eq!(replayed.reports().len(), 4);
    assert!(
        replayed.stderr.contains("1 frame missing"),
        "{}",
        replayed.stderr
    );
    let compared = &replayed.summary()["recorded_verdicts"];
    assert_eq!(
        (&compared["equal"], &compared["after_missing"]),
        (&3.into(), &1.into())
    );
    assert!(
        !replayed.stderr.contains("different from"),
        "{}",
        replayed.stderr
    );
}

#[test]
fn a_baseline_file_may_hold_undefined_pairs() {
    let folder = TempDir::new().unwrap();
    let service = service("undefined");
    let baseline = folder.path().join("touching.txt");
    std::fs::write(&baseline, "2 # lines: 1\n0,1,undefined\n").unwrap();
    let args = ["--baseline", baseline.to_str().unwrap()];
    let watch = Watch::start(folder.path(), "undefined", &service, &args);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    // The squares touch, as in the baseline, then come apart and have a linking number from then
    // on.
    for (frame, (shift, verdict)) in [
        (1.0, Verdict::Contact),
        (3.0, Verdict::Undecided),
        (3.0, Verdict::Intact),
    ]
    .into_iter()
    .enumerate()
    {
        assert_eq!(step(&mut sim, frame as u64, shift), verdict, "{frame}");
        assert!(sim.aborted().is_none(), "{frame}");
    }
    sim.finish().unwrap();
    let live = watch.end();
    assert_eq!(live.code, Some(3), "{}", live.stderr);
    assert_eq!(live.reports()[1]["defects"][0]["kind"], "no-baseline");
}

/// Regression test: a contact in the first frame hid every later one, and asked the simulator to
/// stop in each frame.
#[test]
fn contact_in_the_first_frame_hides_no_later_finding() {
    let folder = TempDir::new().unwrap();
    let service = service("touching");
    let output = folder.path().join("watch.txt");
    let mut process = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
        .args(["watch", "--service", &service])
        .stdout(std::fs::File::create(&output).unwrap())
        .stderr(Stdio::null())
        .stdin(Stdio::null())
        .spawn()
        .unwrap();
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    let counts = [-4; 4];
    sim.describe(Basis::Polyline, Precision::F32, &counts)
        .unwrap();
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    // Two pairs of squares, far from each other; they touch at a shift of 1.
    for (first, second, verdict, abort) in [
        (1.0, 0.0, Verdict::Contact, false),
        (1.0, 0.0, Verdict::Contact, false),
        (1.0, 1.0, Verdict::Contact, true),
        (1.0, 1.0, Verdict::Contact, true),
        (0.5, 0.0, Verdict::Undecided, false),
        (0.5, 0.0, Verdict::Intact, false),
        (1.0, 0.0, Verdict::Contact, true),
    ] {
        let far = squares(second).into_iter().map(|x| x + 100.0);
        let positions: Vec<f32> = squares(first).into_iter().chain(far).collect();
        let seq = sim.publish(0.0, Positions::F32(&positions)).unwrap();
        let Outcome::Verdict(message) = sim.wait(seq, PATIENCE).unwrap() else {
            panic!("no verdict on frame {seq}");
        };
        assert_eq!(
            (message.verdict, message.abort),
            (verdict, abort),
            "frame {seq}"
        );
        sim.resume();
    }
    sim.finish_within(PATIENCE).unwrap();
    assert_eq!(wait(&mut process).code(), Some(3));
    let said = std::fs::read_to_string(&output).unwrap();
    let lines = |words: &str| said.lines().filter(|l| l.contains(words)).count();
    // Each is printed once when it begins: in frames 0 and 6, in frame 2, and the linking number in
    // frame 4.
    assert_eq!(lines("  curves 0 and 1 touch"), 2, "{said}");
    assert_eq!(lines("  curves 2 and 3 touch"), 1, "{said}");
    assert_eq!(lines("is expected from here on"), 1, "{said}");
}

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
    let start = Instant::now();
    while !recording.exists() {
        assert!(start.elapsed() < PATIENCE, "no recording");
        std::thread::sleep(Duration::from_millis(5));
    }
    first.signal("KILL");
    drop(first);
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(3), "{}", replayed.stderr);
    assert!(replayed.stderr.contains("truncated"), "{}", replayed.stderr);
    // A killed watcher costs the simulator nothing.
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
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    assert_eq!(watch.end().code, Some(0));
}

/// Not a test: the simulator that the next test kills. It runs only if a service is given.
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
    assert!(
        !replayed.stderr.contains("truncated"),
        "{}",
        replayed.stderr
    );
}

/// The watcher says goodbye on the signal, so that a simulator in lockstep does not wait for it.
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
            let start = Instant::now();
            let outcome = sim.wait(seq, PATIENCE).unwrap();
            assert_eq!(outcome, Outcome::NoWatcher(how));
            assert!(start.elapsed() < Duration::from_secs(4), "{signal}");
        }
    }
}

#[test]
fn rejects_invalid_times() {
    for time in ["nan", "inf", "-1", "1e300", "soon"] {
        let run = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
            .args(["watch", "--service", &service("times")])
            .arg(format!("--wait={time}"))
            .output()
            .unwrap();
        assert_eq!(run.status.code(), Some(2), "{time}");
        let words = String::from_utf8(run.stderr).unwrap();
        assert!(words.contains(time), "{words}");
        assert!(words.contains("a finite number of at least 0"), "{words}");
    }
}

/// Returns curves that pass through one another everywhere, which take minutes to verify.
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

/// Regression test: the signal had no effect until the check had ended, here minutes later.
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
    // The watcher sent heartbeats meanwhile.
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
fn rejects_hostile_recordings_in_one_line() {
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

/// A policy that is not the default is part of the recording, so that a replay without options
/// gives the same verdicts.
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
    assert!(
        !replayed.stderr.contains("different from"),
        "{}",
        replayed.stderr
    );
    assert_eq!(replayed.summary()["rejected"], 2);
}

/// Regression test: each of these lost part of the recording, or left the wrong content under its
/// name.
#[test]
fn a_replay_overwrites_neither_its_input_nor_an_existing_file() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    let recording = recordings().join("squares.mcap");
    let before = std::fs::read(&recording).unwrap();
    std::fs::write(at("run.mcap"), &before).unwrap();
    std::fs::hard_link(at("run.mcap"), at("hard.rrd")).unwrap();
    std::fs::hard_link(at("run.mcap"), at("hard.mcap")).unwrap();
    std::fs::write(at("other.mcap"), "mine").unwrap();
    let refused = |args: &[&str], says: &str| {
        let run = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
            .current_dir(folder.path())
            .args(["replay", "run.mcap"])
            .args(args)
            .output()
            .unwrap();
        let stderr = String::from_utf8(run.stderr).unwrap();
        assert_eq!(run.status.code(), Some(2), "{args:?}: {stderr}");
        assert!(stderr.contains(says), "{args:?}: {stderr}");
        assert!(std::fs::read(at("run.mcap")).unwrap() == before, "{args:?}");
        assert_eq!(std::fs::read(at("other.mcap")).unwrap(), b"mine");
    };
    for force in [&[][..], &["--force"]] {
        let with = |args: &[&'static str]| [args, force].concat();
        refused(
            &with(&["--record", "run.mcap"]),
            "same file as the input run.mcap",
        );
        refused(
            &with(&["--record", "./hard.mcap"]),
            "same file as the input run.mcap",
        );
        refused(
            &with(&["--rrd", "hard.rrd"]),
            "same file as the input run.mcap",
        );
        refused(&with(&["--rrd", "run.mcap"]), "--record writes a recording");
        refused(
            &with(&["--record", "new.rrd"]),
            "--rrd writes a file for the viewer",
        );
        refused(
            &with(&["--record", "new.mcap", "--rrd", "new.mcap"]),
            "--record writes",
        );
        refused(&with(&["--record", "."]), "an .mcap file");
    }
    refused(
        &["--record", "other.mcap"],
        "the file exists; --force overwrites it",
    );
    assert!(!at("new.rrd").exists() && !at("new.mcap").exists());
}

/// Opening a pipe blocks until its other end is opened.
#[test]
#[cfg(unix)]
fn rejects_a_pipe_as_a_recording() {
    let folder = TempDir::new().unwrap();
    let pipe = folder.path().join("pipe.mcap");
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let other = folder.path().join("pipe.rrd");
    assert!(
        Command::new("mkfifo")
            .arg(&other)
            .status()
            .unwrap()
            .success()
    );
    for (option, path) in [("--record", &pipe), ("--rrd", &other)] {
        let args = [option, path.to_str().unwrap(), "--force", "--wait", "0.1"];
        let ended = Watch::start(folder.path(), "watch", &service("pipe"), &args).end();
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(
            ended.stderr.contains("not a regular file"),
            "{}",
            ended.stderr
        );
    }
    let replayed = replay(&pipe);
    assert_eq!(replayed.code, Some(2), "{}", replayed.stderr);
    assert!(
        replayed.stderr.contains("regular file"),
        "{}",
        replayed.stderr
    );
}

#[test]
fn a_recording_is_created_at_the_first_frame_and_overwrites_none() {
    let folder = TempDir::new().unwrap();
    let service = service("first-frame");
    let recording = folder.path().join("run.mcap");
    let record = ["--record", recording.to_str().unwrap()];
    let nobody = [&record[..], &["--wait", "0.2"]].concat();
    let ended = Watch::start(folder.path(), "nobody", &service, &nobody).end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert!(!recording.exists(), "a recording of nothing");

    std::fs::write(&recording, "mine").unwrap();
    let ended = Watch::start(folder.path(), "refused", &service, &nobody).end();
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("--force overwrites it"),
        "{}",
        ended.stderr
    );
    let forced = [&nobody[..], &["--force"]].concat();
    let ended = Watch::start(folder.path(), "forced", &service, &forced).end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert_eq!(std::fs::read(&recording).unwrap(), b"mine", "no frame came");

    let forced = [&record[..], &["--force"]].concat();
    let watch = Watch::start(folder.path(), "recorded", &service, &forced);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    assert_eq!(watch.end().code, Some(0));
    assert_eq!(replay(&recording).code, Some(0));

    // A file that another process creates meanwhile is not overwritten either.
    std::fs::remove_file(&recording).unwrap();
    let watch = Watch::start(folder.path(), "late", &service, &record);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    std::fs::write(&recording, "mine").unwrap();
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    let ended = watch.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("recording failed"),
        "{}",
        ended.stderr
    );
    assert_eq!(std::fs::read(&recording).unwrap(), b"mine");
}

/// An output stream that accepts no data.
#[cfg(target_os = "linux")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Broken {
    /// `/dev/full`: every write fails, as on a full disk.
    Full,
    /// The reader closed the pipe.
    Closed,
    /// A full pipe without a reader: every write blocks.
    Blocked,
}

#[cfg(target_os = "linux")]
impl Broken {
    /// Returns the stream, and the pipe end that keeps it in this state.
    fn open(self) -> (Stdio, Option<std::io::PipeReader>) {
        if self == Broken::Full {
            let full = std::fs::File::options().write(true).open("/dev/full");
            return (full.unwrap().into(), None);
        }
        let (reader, mut writer) = std::io::pipe().unwrap();
        if self == Broken::Closed {
            return (writer.into(), None);
        }
        // Fills the pipe.
        std::io::Write::write_all(&mut writer, &[b'\n'; 1 << 16]).unwrap();
        (writer.into(), Some(reader))
    }
}

/// Regression test: the watcher aborted (a log on a full disk), ended (standard output), or waited
/// without limit (a pipe).
#[test]
#[cfg(target_os = "linux")]
fn no_broken_stream_stops_the_verdicts_or_the_recording() {
    use Broken::{Blocked, Closed, Full};
    let folder = TempDir::new().unwrap();
    for (k, (out, err, code)) in [
        (None, Some(Full), 0),
        (None, Some(Closed), 0),
        (None, Some(Blocked), 0),
        (Some(Full), None, 3),
        (Some(Closed), None, 0),
        (Some(Blocked), None, 3),
        (Some(Full), Some(Full), 3),
        (Some(Blocked), Some(Blocked), 3),
    ]
    .into_iter()
    .enumerate()
    {
        let case = format!("stdout {out:?}, stderr {err:?}");
        let service = service(&format!("broken-{k}"));
        let recording = folder.path().join(format!("{k}.mcap"));
        let args = ["--record", recording.to_str().unwrap()];
        let [(out_stream, _held_out), (err_stream, _held_err)] = [out, err].map(|broken| {
            broken.map_or((None, None), |broken| {
                let (stream, held) = broken.open();
                (Some(stream), held)
            })
        });
        let command = Command::new(env!("CARGO_BIN_EXE_linkwatch"));
        let streams = [out_stream, err_stream];
        let name = k.to_string();
        let watch = Watch::start_with(folder.path(), &name, &service, &args, command, streams);
        let mut sim = client(&service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap(), "{case}");
        for frame in 0..30 {
            assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact, "{case}");
        }
        sim.finish().unwrap();
        let ended = watch.end();
        let last = ended.lines.last();
        assert_eq!(ended.code, Some(code), "{case}: {last:?} {}", ended.stderr);
        if out.is_none() {
            assert_eq!(ended.reports().len(), 30, "{case}");
        }
        if code == 3 && err.is_none() {
            let reported = ended.stderr.matches("error: standard output: ").count();
            assert_eq!(reported, 1, "{case}: {}", ended.stderr);
            assert!(ended.stderr.contains("31 lines lost"), "{}", ended.stderr);
        }
        let replayed = replay(&recording);
        assert_eq!(replayed.code, Some(0), "{case}: {}", replayed.stderr);
        assert_eq!(replayed.reports().len(), 30, "{case}");
    }
}

/// A limit on the file size simulates a full disk, because it needs no privileges. It leaves space
/// for the shared memory of the watcher, and for a few hundred frames.
#[test]
#[cfg(unix)]
fn a_full_disk_ends_only_the_recording() {
    let folder = TempDir::new().unwrap();
    let service = service("full-disk");
    let recording = folder.path().join("run.mcap");
    let args = ["--record", recording.to_str().unwrap()];
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -f 400; exec \"$0\" \"$@\""]);
    command.arg(env!("CARGO_BIN_EXE_linkwatch"));
    let streams = [Some(Stdio::null()), None];
    let watch = Watch::start_with(folder.path(), "watch", &service, &args, command, streams);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for frame in 0..2000 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    let last = sim.finish_within(PATIENCE).unwrap().expect("goodbye");
    assert_eq!(last.counters.verified, 2000);
    let ended = watch.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let reported = ended.stderr.contains("recording is incomplete: ");
    assert!(
        reported && ended.stderr.contains("run.mcap: "),
        "{}",
        ended.stderr
    );
    // The written frames are present, and the message does not claim that a process was killed.
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(3), "{}", replayed.stderr);
    assert!(
        replayed.stderr.contains("truncated at byte"),
        "{}",
        replayed.stderr
    );
    assert!(!replayed.stderr.contains("killed"), "{}", replayed.stderr);
    assert!(
        replayed.reports().len() > 50,
        "{}",
        replayed.reports().len()
    );
    assert!(
        !replayed.stderr.contains("different from"),
        "{}",
        replayed.stderr
    );
}

/// Regression test: the verdict was "intact" with exit code 0, for any share.
#[test]
fn the_share_of_skipped_frames_is_reported_and_can_be_limited() {
    let folder = TempDir::new().unwrap();
    for (limit, code) in [("0.5", 3), ("79%", 3), ("0.8", 0), ("100%", 0)] {
        let service = service(&format!("skipped-{code}-{}", limit.len()));
        let mut sim = client(&service);
        for frame in 0..4 {
            let squares = squares(0.0);
            sim.publish(frame.into(), Positions::F32(&squares)).unwrap();
        }
        let args = ["--max-skipped", limit];
        let watch = Watch::start(folder.path(), limit, &service, &args);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        assert_eq!(step(&mut sim, 4, 0.0), Verdict::Intact);
        sim.finish().unwrap();
        let ended = watch.end();
        let share = ended.summary()["skipped_share"].as_f64().unwrap();
        // The newest earlier frame may have been verified as well.
        if share == 0.8 {
            assert_eq!(ended.code, Some(code), "{limit}: {}", ended.stderr);
            let reported = "80.00 % of the frames were skipped, more than";
            assert_eq!(
                ended.stderr.contains(reported),
                code == 3,
                "{}",
                ended.stderr
            );
        } else {
            assert_eq!(share, 0.6);
        }
    }
    for share in ["1.5", "-1", "nan", "101%", "many"] {
        let args = [&format!("--max-skipped={share}")[..]];
        let ended = Watch::start(folder.path(), "bad", "unused", &args).end();
        assert_eq!(ended.code, Some(2), "{share}");
    }
    for wait in ["nan", "-1", "inf"] {
        let args = [&format!("--wait={wait}")[..]];
        let ended = Watch::start(folder.path(), "bad", "unused", &args).end();
        assert_eq!(ended.code, Some(2), "{wait}");
    }
}

/// Run with `cargo test --release --test live round_trips -- --ignored --nocapture`.
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

/// Runs the command without `--json`. Returns its exit code and its output.
fn printed(args: &[&str]) -> (Option<i32>, String) {
    let run = Command::new(env!("CARGO_BIN_EXE_linkwatch"))
        .args(args)
        .output();
    let run = run.unwrap();
    let all = [run.stdout, run.stderr].concat();
    (run.status.code(), String::from_utf8(all).unwrap())
}

/// Returns the stderr of a watch, once it contains all of these words.
fn stderr_with(watch: &Watch, words: &[&str]) -> String {
    let start = Instant::now();
    loop {
        let stderr = std::fs::read_to_string(&watch.stderr).unwrap();
        if words.iter().all(|word| stderr.contains(word)) {
            return stderr;
        }
        assert!(start.elapsed() < PATIENCE, "{words:?} in {stderr}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_wrong_service_name_lists_the_live_services() {
    let folder = TempDir::new().unwrap();
    let (right, wrong) = (service("right"), service("wrong"));
    let sim = client(&right);
    let watch = Watch::start(folder.path(), "watch", &wrong, &[]);
    let simulator = format!("{right}: simulator (process {}, live-", std::process::id());
    let reported = format!("no simulator connected to service '{wrong}' within 5 s");
    stderr_with(&watch, &[&reported, &simulator]);
    // Logged once.
    std::thread::sleep(Duration::from_millis(5500));
    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(
        ended.stderr.matches(&simulator).count(),
        1,
        "{}",
        ended.stderr
    );
    assert!(
        ended.stderr.contains("to watch one of them: --service"),
        "{}",
        ended.stderr
    );
    drop(sim);
}

#[test]
fn lists_live_services_without_a_killed_watcher() {
    let folder = TempDir::new().unwrap();
    let [both, killed] = ["both", "killed"].map(service);
    let mut sim = client(&both);
    let watch = Watch::start(folder.path(), "watch", &both, &[]);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let mut other = Watch::start(folder.path(), "other", &killed, &[]);
    stderr_with(&other, &["waiting for a simulator"]);
    let list = || printed(&["services"]).1;
    assert!(
        list().contains(&format!("{killed}: no simulator, watcher (process ")),
        "{}",
        list()
    );
    other.process.kill().unwrap();
    other.process.wait().unwrap();
    assert!(!list().contains(&killed), "{}", list());

    let (code, lines) = printed(&["services", "--json"]);
    assert_eq!(code, Some(0), "{lines}");
    let found = json_lines(&lines)
        .into_iter()
        .find(|s| s["service"] == both.as_str());
    let found = found.expect("the service");
    assert_eq!(found["simulator"]["process"], std::process::id());
    assert_eq!(found["watcher"]["process"], watch.process.id());
    assert_eq!(found["watcher"]["program"], "linkwatch");
    assert_eq!(found["compatible"], true);
    // The session continues.
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    assert_eq!(watch.end().code, Some(0));
}

#[test]
fn a_silent_simulator_and_a_wrong_name_have_different_hints() {
    let folder = TempDir::new().unwrap();
    let service = service("silent");
    let sim = client(&service);
    let watch = Watch::start(folder.path(), "watch", &service, &["--wait", "0.3"]);
    let ended = watch.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let reported = format!(
        "the simulator on service '{service}' (process {}",
        std::process::id()
    );
    assert!(ended.stderr.contains(&reported), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("has not sent anything yet"),
        "{}",
        ended.stderr
    );
    drop(sim);
}

/// A header as published by another version of linkwatch.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, ZeroCopySend)]
#[type_name("linkwatch.FrameHeader")]
struct Header {
    magic: u64,
    version: u32,
    rest: [u32; 13],
}

#[test]
fn a_simulator_of_another_version_is_reported_once_with_advice() {
    use iceoryx2::prelude::{Alignment, NodeBuilder, ServiceName, ipc};
    let folder = TempDir::new().unwrap();
    let service = service("version");
    let watch = Watch::start(folder.path(), "watch", &service, &[]);
    stderr_with(&watch, &["waiting for a simulator"]);
    let node = NodeBuilder::new().create::<ipc::Service>().unwrap();
    let frames = ServiceName::new(&format!("{service}/frames")).unwrap();
    let frames = node
        .service_builder(&frames)
        .publish_subscribe::<[u8]>()
        .user_header::<Header>()
        .payload_alignment(Alignment::new(64).unwrap())
        .open()
        .unwrap();
    let publisher = frames.publisher_builder().create().unwrap();
    let send = || {
        let mut sample = publisher.loan_slice(0).unwrap();
        *sample.user_header_mut() = Header {
            magic: u64::from_le_bytes(*b"LWFRAME\0"),
            version: 99,
            ..Header::default()
        };
        sample.send().unwrap();
    };
    send();
    let reported = "the frame has version 99";
    stderr_with(&watch, &[reported, "use one version on both sides"]);
    for _ in 0..10 {
        send();
        std::thread::sleep(Duration::from_millis(20));
    }
    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert_eq!(
        ended.stderr.matches(reported).count(),
        1,
        "{}",
        ended.stderr
    );
}

/// Returns the log messages of the library, as received by the subscriber of a simulator.
fn logged(work: impl FnOnce()) -> String {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log");
    let log = Arc::new(std::fs::File::create(&path).unwrap());
    let subscriber = tracing_subscriber::fmt().with_writer(log).finish();
    tracing::subscriber::with_default(subscriber, work);
    std::fs::read_to_string(&path).unwrap()
}

#[test]
fn a_client_without_a_watcher_logs_the_service_of_a_waiting_one() {
    let folder = TempDir::new().unwrap();
    let [right, wrong] = ["elsewhere", "nobody"].map(service);
    let watch = Watch::start(folder.path(), "watch", &right, &[]);
    stderr_with(&watch, &["waiting for a simulator"]);
    let mut sim = client(&wrong);
    let log = logged(|| {
        let wait = Duration::from_millis(1100);
        assert!(!sim.wait_for_watcher(wait).unwrap());
        assert!(!sim.wait_for_watcher(wait).unwrap());
    });
    let reported = format!("no watcher came to service '{wrong}'");
    assert_eq!(log.matches(&reported).count(), 1, "{log}");
    // Other tests have watchers, too; one of those that wait is named.
    assert!(log.contains("no simulator, watcher (process "), "{log}");
}

#[test]
fn a_replay_reports_if_its_verdicts_equal_the_recorded_ones() {
    let recording = recordings().join("squares.mcap");
    let path = recording.to_str().unwrap();
    let last = |args: &[&str]| {
        let (_, all) = printed(&[&["replay", path, "--quiet"], args].concat());
        let line = all.lines().find(|l| l.starts_with("verdicts: "));
        line.unwrap_or_else(|| panic!("{all}")).to_owned()
    };
    let equal =
        "verdicts: 19 equal to the recorded ones; 1 not compared: the curves of rejected frames";
    assert!(last(&[]).starts_with(equal), "{}", last(&[]));
    assert!(last(&["--kernel", "direct"]).starts_with(equal));
    for (args, option) in [
        (&["--abort-on", "lost"][..], "--abort-on"),
        (&["--baseline", "first-frame"], "--baseline"),
        (&["--events"], "--events or --self"),
        (&["--motion-limit", "2"], "--motion-limit"),
        (
            &["--self", "--abort-on", "never"],
            "--abort-on, --events or --self",
        ),
    ] {
        let expected = format!(
            "verdicts: not compared with the recorded ones: recorded with another {option}"
        );
        assert_eq!(last(args), expected);
    }
    let compared = replay(&recording).summary()["recorded_verdicts"].clone();
    let counts = ["equal", "unlike", "rejected", "after_missing"].map(|n| compared[n].clone());
    assert_eq!(counts, [19, 0, 1, 0]);
    assert_eq!(compared["differing"], serde_json::json!([]));
}

#[test]
fn counts_verdicts_that_differ_from_the_recorded_ones() {
    let folder = TempDir::new().unwrap();
    let changed = folder.path().join("changed.mcap");
    rewrite_flight(&changed, |report| {
        if report.seq == 1 {
            report.verdict = Verdict::Undecided;
        }
        true
    });
    let (code, all) = printed(&["replay", changed.to_str().unwrap()]);
    assert_eq!(code, Some(1), "{all}");
    assert!(
        all.contains("verdicts: 4 equal to the recorded ones, 1 different"),
        "{all}"
    );
}
