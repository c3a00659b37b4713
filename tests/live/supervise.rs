//! `--supervise`: workers that are killed, and replaced.

use super::support::random::Random;
use super::*;
use linkwatch::CurveLabels;

/// A supervised watch, with a folder for its state that no other process uses.
struct Supervised {
    watch: Watch,
    folder: TempDir,
    service: String,
}

impl Supervised {
    fn start(test: &str, args: &[&str]) -> Supervised {
        let folder = TempDir::new().unwrap();
        std::fs::create_dir(folder.path().join("state")).unwrap();
        let service = service(test);
        let mut command = command();
        command.env("TMPDIR", folder.path().join("state"));
        let recording = folder.path().join("run.mcap");
        let own = ["--supervise", "--record", recording.to_str().unwrap()];
        let args: Vec<&str> = own.into_iter().chain(args.iter().copied()).collect();
        let none = [None, None];
        Supervised {
            watch: Watch::start_with(folder.path(), "watch", &service, &args, command, none),
            folder,
            service,
        }
    }

    /// Returns the process id of the worker.
    fn worker(&self) -> u32 {
        until("a worker", || child_of(self.watch.process.id()))
    }

    /// Kills the worker. Returns its process id.
    fn kill_worker(&self) -> u32 {
        let worker = self.worker();
        send("KILL", worker);
        worker
    }

    fn next_worker(&self, sim: &mut Client, old: u32) {
        next_worker(&self.watch, sim, old);
    }

    /// Waits until a recording has frames: at most a second after the first one.
    fn wait_for_file(&self, name: &str) {
        until(name, || {
            let file = std::fs::metadata(self.folder.path().join(name)).ok()?;
            (file.len() > 0).then_some(())
        });
    }

    fn recording(&self, name: &str) -> Ended {
        replay(&self.folder.path().join(name))
    }

    fn end(self) -> (Ended, TempDir) {
        let ended = self.watch.end();
        let left: Vec<_> = std::fs::read_dir(self.folder.path().join("state"))
            .unwrap()
            .collect();
        assert!(left.is_empty(), "{left:?}");
        (ended, self.folder)
    }
}

/// Waits for the worker that comes after another one, until it watches the simulator.
fn next_worker(watch: &Watch, sim: &mut Client, old: u32) {
    until("another worker", || {
        child_of(watch.process.id()).filter(|&worker| worker != old)
    });
    // A simulator that goes on meanwhile knows the new watcher by its messages.
    until("the new watcher", || {
        sim.poll().unwrap();
        let here = sim.wait_for_watcher(Duration::from_millis(50)).unwrap();
        (here && sim.silent_for().is_some()).then_some(())
    });
}

/// Returns a child of a process, if it has one.
pub fn child_of(parent: u32) -> Option<u32> {
    let processes = std::fs::read_dir("/proc").unwrap().flatten();
    let ids = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    let parent_of = |id: &u32| -> Option<(char, u32)> {
        // The name of the program, in brackets, may contain anything.
        let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
        let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
        Some((fields.next()?.chars().next()?, fields.next()?.parse().ok()?))
    };
    ids.into_iter()
        .find(|id| parent_of(id).is_some_and(|(state, of)| of == parent && state != 'Z'))
}

pub fn send(signal: &str, process: u32) {
    let id = process.to_string();
    let sent = Command::new("kill").args(["-s", signal, &id]).status();
    assert!(sent.unwrap().success(), "{signal} to {id}");
}

/// Describes two squares with names, and other curves that take minutes to verify, if they are
/// wanted.
fn describe(sim: &mut Client, tangle: Option<(usize, usize)>) {
    let mut counts = vec![-4, -4];
    let mut names = vec!["a".to_owned(), "b".to_owned()];
    if let Some((curves, segments)) = tangle {
        counts.extend(std::iter::repeat_n(-(segments as i32), curves));
        names.extend((0..curves).map(|k| format!("other {k}")));
    }
    let labels = CurveLabels::named(names);
    sim.describe_labelled(Basis::Polyline, Precision::F32, &counts, labels)
        .unwrap();
}

fn verdict_of(sim: &mut Client, seq: u64) -> Outcome {
    without_time_out("a verdict", || sim.wait(seq, LONG)).unwrap()
}

#[test]
fn the_next_worker_expects_what_the_first_one_did() {
    let watch = Supervised::start("expects", &[]);
    let mut sim = client(&watch.service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for frame in 0..5 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    // Results are printed, and files are created, after the verdict was sent.
    lines_of(&watch.watch, 5);
    watch.wait_for_file("run.mcap");
    let old = watch.kill_worker();
    watch.next_worker(&mut sim, old);
    // A watch that began here would take the curves that came apart as its first frame.
    assert_eq!(step(&mut sim, 5, 2.5), Verdict::Changed);
    assert_eq!(step(&mut sim, 6, 0.0), Verdict::Intact);
    lines_of(&watch.watch, 7);
    watch.wait_for_file("run-2.mcap");
    let old = watch.kill_worker();
    watch.next_worker(&mut sim, old);
    assert_eq!(step(&mut sim, 7, 0.1), Verdict::Intact);
    assert_eq!(sim.finish().unwrap(), 8);
    until("the end", || {
        let stderr = std::fs::read_to_string(&watch.watch.stderr).unwrap();
        stderr.contains("the simulator ended").then_some(())
    });
    let second = watch.recording("run-2.mcap");
    assert_eq!(second.code, Some(1), "{}", second.stderr);
    second.assert_recorded_verdicts();
    // The intact frame after the change may not have been written yet.
    assert!(!second.reports().is_empty());
    let third = watch.recording("run-3.mcap");
    assert_eq!(third.code, Some(0), "{}", third.stderr);
    let (ended, _folder) = watch.end();
    // The change was found by a worker that was killed.
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let counts = ["verified", "skipped", "rejected"].map(|n| ended.summary()[n].clone());
    assert_eq!(counts, [8, 0, 0], "{}", ended.stderr);
    let crashes = "the worker crashed (signal: 9 (SIGKILL)) and is started again";
    assert_eq!(ended.stderr.matches(crashes).count(), 2, "{}", ended.stderr);
    let last: Vec<_> = ended
        .reports()
        .iter()
        .map(|r| r["last_intact"].clone())
        .collect();
    // After the change no frame is known to be intact, although a worker that did not see it
    // verified the last one.
    assert_eq!(last[4..], [4, 4, 4, 4], "{}", ended.stderr);
}

/// A killed worker leaves complete files. The next one does not touch them, and its own files have
/// the baseline of the first one, so that each replays without the others.
#[test]
fn workers_write_several_files_each_that_replay_by_themselves() {
    let watch = Supervised::start("parts", &["--record-max", "1MB", "--abort-on", "never"]);
    let mut sim = Client::open(&watch.service, &ClientOptions::lockstep()).unwrap();
    keep::describe_many(&mut sim);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    // Squares of 192 kB a frame: five frames fill a file. They come apart in the second worker.
    const EACH: u64 = 12;
    const APART: u64 = 15;
    let publish = |sim: &mut Client, frames: std::ops::Range<u64>| {
        for frame in frames {
            let positions = keep::many_squares(frame, frame >= APART);
            let seq = sim.publish(0.0, Positions::F32(&positions)).unwrap();
            let Outcome::Verdict(message) = verdict_of(sim, seq) else {
                panic!("no verdict on frame {frame}");
            };
            assert_eq!(message.verdict == Verdict::Changed, frame >= APART);
        }
    };
    publish(&mut sim, 0..EACH);
    // The second file was begun, so that the first one is complete.
    watch.wait_for_file("run-part2.mcap");
    let old = watch.kill_worker();
    let path = |name: &str| watch.folder.path().join(name);
    let first = std::fs::read(path("run.mcap")).unwrap();
    watch.next_worker(&mut sim, old);
    publish(&mut sim, EACH..2 * EACH);
    sim.finish().unwrap();
    let (ended, folder) = watch.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert_eq!(ended.summary()["verified"], 2 * EACH);

    let path = |name: &str| folder.path().join(name);
    assert!(std::fs::read(path("run.mcap")).unwrap() == first);
    let names = [
        "run",
        "run-part2",
        "run-part3",
        "run-2",
        "run-2-part2",
        "run-2-part3",
    ];
    let mut frames = Vec::new();
    for name in names {
        let path = path(name).with_extension("mcap");
        // The last file of the first worker may have been killed before it was begun.
        if !path.exists() && name == "run-part3" {
            continue;
        }
        assert!(
            std::fs::metadata(&path).unwrap().len() <= 1_000_000,
            "{name}"
        );
        let found = keep::frames_of(&path);
        let changed = found.iter().any(|frame| *frame >= APART);
        keep::replay_all(&path, i32::from(changed));
        frames.extend(found);
    }
    // At the end of what the first worker wrote, at most the frames of a second are lost.
    let lost: Vec<u64> = (0..2 * EACH).filter(|f| !frames.contains(f)).collect();
    assert!(frames.is_sorted(), "{frames:?}");
    assert!(lost.iter().all(|f| (5..EACH).contains(f)), "{frames:?}");
}

/// Counters of a worker are its own; the number of restarts goes on. The next worker finds the port
/// and its program, although the file of the program is another one by then.
#[test]
#[cfg(target_os = "linux")]
fn the_next_worker_serves_metrics_at_the_same_address() {
    let folder = TempDir::new().unwrap();
    let program = folder.path().join("linkwatch");
    std::fs::copy(env!("CARGO_BIN_EXE_linkwatch"), &program).unwrap();
    let service = service("port");
    // A port that was free a moment ago.
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    drop(listener);
    let args = ["--supervise", "--metrics", &address];
    let (command, none) = (Command::new(&program), [None, None]);
    let watch = Watch::start_with(folder.path(), "watch", &service, &args, command, none);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for (restarts, frame) in [(0, 0), (1, 2), (2, 4)] {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
        assert_eq!(step(&mut sim, frame + 1, 0.0), Verdict::Intact);
        lines_of(&watch, frame as usize + 2);
        let page = metrics::scrape(&address);
        let figure = |name: &str| metrics::figure(&page, name, &service);
        assert_eq!(figure("linkwatch_frames_verified_total"), 2.0);
        assert_eq!(
            figure("linkwatch_worker_restarts_total"),
            f64::from(restarts)
        );
        std::fs::remove_file(&program).ok();
        if restarts < 2 {
            let old = until("a worker", || child_of(watch.process.id()));
            send("KILL", old);
            next_worker(&watch, &mut sim, old);
        }
    }
    sim.finish().unwrap();
    let ended = watch.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert_eq!(ended.summary()["verified"], 6);
}

/// A frame that crashes every worker is given up after the first one.
#[test]
fn the_frame_in_hand_is_rejected_and_not_verified_again() {
    let watch = Supervised::start("in-hand", &["--abort-on", "any"]);
    let mut sim = Client::open(&watch.service, &ClientOptions::lockstep()).unwrap();
    describe(&mut sim, None);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    let size @ (curves, segments) = (400, 1000);
    describe(&mut sim, Some(size));
    let tangle = [squares(0.0), sessions::tangle(curves, segments)].concat();
    let seq = sim.publish(0.1, Positions::F32(&tangle)).unwrap();
    assert_eq!(
        sim.wait(seq, Duration::from_secs(1)).unwrap(),
        Outcome::Stale
    );
    let old = watch.kill_worker();
    let told = until("the verdict", || match verdict_of(&mut sim, seq) {
        Outcome::Verdict(message) => Some(message),
        // Until the next worker is there.
        _ => {
            sim.wait_for_watcher(Duration::from_millis(50)).unwrap();
            None
        }
    });
    assert_eq!(told.verdict, Verdict::Rejected);
    assert!(!told.abort, "{told:?}");
    assert!(
        told.to_string().contains("crashed while it verified"),
        "{told}"
    );
    watch.next_worker(&mut sim, old);
    describe(&mut sim, None);
    assert_eq!(step(&mut sim, 2, 0.1), Verdict::Intact);
    assert_eq!(step(&mut sim, 3, 2.5), Verdict::Changed);
    assert_eq!(sim.finish().unwrap(), 4);
    let (ended, _folder) = watch.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let counts = ["verified", "skipped", "rejected"].map(|n| ended.summary()[n].clone());
    assert_eq!(counts, [3, 0, 1], "{}", ended.stderr);
}

#[test]
fn pull_throughs_before_a_restart_are_unknown() {
    let watch = Supervised::start("unknown", &["--events"]);
    let mut sim = client(&watch.service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for frame in 0..3 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    lines_of(&watch.watch, 3);
    let old = watch.kill_worker();
    watch.next_worker(&mut sim, old);
    assert_eq!(step(&mut sim, 3, 0.1), Verdict::Undecided);
    assert_eq!(step(&mut sim, 4, 0.1), Verdict::Intact);
    sim.cut();
    assert_eq!(step(&mut sim, 5, 0.1), Verdict::Intact);
    sim.finish().unwrap();
    let (ended, _folder) = watch.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let reports = ended.reports();
    let missing = reports[3]["missing"][0].as_str().unwrap();
    assert!(
        missing.contains("pull-throughs before this frame are unknown"),
        "{missing}"
    );
    let last: Vec<_> = reports.iter().map(|r| r["last_intact"].clone()).collect();
    assert_eq!(last, [0, 1, 2, 2, 2, 5], "{}", ended.stderr);
}

#[test]
fn the_supervisor_gives_up_if_no_worker_verifies_a_frame() {
    let watch = Supervised::start("loop", &[]);
    let mut old = 0;
    for _ in 0..5 {
        old = until("a worker", || {
            child_of(watch.watch.process.id()).filter(|&worker| worker != old)
        });
        send("KILL", old);
    }
    let (ended, _folder) = watch.end();
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
    let last = ended.stderr.lines().last().unwrap();
    assert!(
        last.starts_with("error: the worker crashed 5 times in a row"),
        "{last}"
    );
    assert!(last.contains("report the crash"), "{last}");
}

#[test]
fn the_error_of_a_worker_is_the_one_of_the_command() {
    let folder = TempDir::new().unwrap();
    let args = ["--supervise", "--baseline", "missing.cert"];
    let ended = Watch::start(folder.path(), "watch", &service("error"), &args).end();
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
    assert!(
        ended.stderr.starts_with("error: missing.cert"),
        "{}",
        ended.stderr
    );
    assert!(!ended.stderr.contains("crashed"), "{}", ended.stderr);
}

#[test]
fn a_signal_to_the_supervisor_ends_the_worker_properly() {
    for signal in ["TERM", "INT"] {
        let watch = Supervised::start(&format!("sig{signal}"), &[]);
        let mut sim = client(&watch.service);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
        watch.watch.signal(signal);
        let (ended, folder) = watch.end();
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        assert_eq!(ended.summary()["verified"], 1);
        let replayed = replay(&folder.path().join("run.mcap"));
        assert_eq!(replayed.code, Some(0), "{}", replayed.stderr);
        assert!(
            !replayed.stderr.contains("truncated"),
            "{}",
            replayed.stderr
        );
    }
}

#[test]
fn a_killed_supervisor_leaves_no_worker_and_no_files() {
    let mut watch = Supervised::start("orphan", &[]);
    let mut sim = client(&watch.service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    let worker = watch.worker();
    watch.watch.signal("KILL");
    wait(&mut watch.watch.process);
    until("the end of the worker", || {
        (!Path::new(&format!("/proc/{worker}")).exists()).then_some(())
    });
    let replayed = watch.recording("run.mcap");
    assert_eq!(replayed.code, Some(0), "{}", replayed.stderr);
    assert!(
        !replayed.stderr.contains("truncated"),
        "{}",
        replayed.stderr
    );
    let (ended, _folder) = watch.end();
    assert!(
        ended.stderr.contains("the supervisor was killed"),
        "{}",
        ended.stderr
    );
}

#[test]
fn a_simulator_that_ended_without_a_worker_ends_the_watch() {
    let watch = Supervised::start("ended", &[]);
    let mut sim = client(&watch.service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    let worker = watch.worker();
    watch.watch.signal("STOP");
    send("KILL", worker);
    let seq = sim.publish(0.1, Positions::F32(&squares(2.5))).unwrap();
    assert!(matches!(verdict_of(&mut sim, seq), Outcome::NoWatcher(_)));
    sim.finish().unwrap();
    watch.watch.signal("CONT");
    let (ended, _folder) = watch.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let words = "its last frames were not verified";
    assert!(ended.stderr.contains(words), "{}", ended.stderr);
}

#[test]
fn sessions_before_and_after_a_crash_have_files_of_their_own() {
    let watch = Supervised::start("files", &["--keep-watching"]);
    let mut frames = 0;
    for round in 0..3 {
        let mut sim = client(&watch.service);
        until("the watcher", || {
            sim.wait_for_watcher(Duration::from_millis(50))
                .unwrap()
                .then_some(())
        });
        assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
        lines_of(&watch.watch, frames + round + 1);
        if round == 1 {
            watch.wait_for_file("run-2.mcap");
            let old = watch.kill_worker();
            watch.next_worker(&mut sim, old);
        }
        // The second simulator keeps its baseline; the third one has its own.
        let shift = if round == 2 { 0.1 } else { 2.5 };
        let expected = if round == 2 {
            Verdict::Intact
        } else {
            Verdict::Changed
        };
        assert_eq!(step(&mut sim, 1, shift), expected);
        sim.finish().unwrap();
        frames += 2;
        lines_of(&watch.watch, frames + round + 1);
    }
    watch.watch.signal("TERM");
    let (ended, folder) = watch.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let sessions: Vec<_> = ended.lines.iter().map(|l| l["session"].clone()).collect();
    assert_eq!(sessions, [1, 1, 1, 2, 2, 2, 3, 3, 3], "{}", ended.stderr);
    for (name, frames) in [("run", 2), ("run-2", 1), ("run-3", 1), ("run-4", 2)] {
        let replayed = replay(&folder.path().join(format!("{name}.mcap")));
        assert_eq!(
            replayed.reports().len(),
            frames,
            "{name}: {}",
            replayed.stderr
        );
    }
}

/// Kills workers at random moments, with or without a search for pull-throughs. Every verdict is
/// that of a watch that was not killed, or says that the frame is not known to be intact.
fn killed_workers(test: &str, events: bool, kills: usize, seed: u64) {
    let mut random = Random::new(seed);
    let args: &[&str] = if events { &["--events"] } else { &[] };
    let watch = Supervised::start(test, args);
    let mut sim = client(&watch.service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    let (mut frame, mut verified, mut unknown) = (1, 1, 0);
    let mut was_apart = false;
    for _ in 0..kills {
        let worker = watch.worker();
        let moment = Duration::from_micros(random.below(20_000) as u64);
        let killer = std::thread::spawn(move || {
            std::thread::sleep(moment);
            send("KILL", worker);
        });
        // Until a worker has verified a frame after the kill, so that workers make progress.
        let mut after = 0;
        while after < 2 {
            let apart = random.one_in(3);
            let shift = if apart { 2.5 } else { 0.0 };
            let positions = squares(shift);
            let seq = sim
                .publish(frame as f64, Positions::F32(&positions))
                .unwrap();
            assert_eq!(seq, frame);
            frame += 1;
            let gone = killer.is_finished() && child_of(watch.watch.process.id()) != Some(worker);
            match sim.wait(seq, PATIENCE).unwrap() {
                Outcome::Verdict(m) if m.verdict == Verdict::Rejected => unknown += 1,
                Outcome::Verdict(m) => {
                    // Coming together is a pull-through as well, unless the step is unknown.
                    let expected = match (apart, events && was_apart) {
                        (true, _) => vec![Verdict::Changed],
                        (false, true) => vec![Verdict::Changed, Verdict::Undecided],
                        (false, false) if events => vec![Verdict::Intact, Verdict::Undecided],
                        (false, false) => vec![Verdict::Intact],
                    };
                    let found = (m.verdict, m.to_string());
                    assert!(
                        expected.contains(&found.0),
                        "frame {seq}, seed {seed}: {found:?}"
                    );
                    verified += 1;
                    after += usize::from(gone);
                }
                Outcome::Stale => panic!("frame {seq}, seed {seed}: no answer"),
                Outcome::NoWatcher(_) => {
                    unknown += 1;
                    std::thread::sleep(Duration::from_millis(2));
                }
            }
            was_apart = apart;
        }
        killer.join().unwrap();
    }
    assert_eq!(sim.finish().unwrap(), frame);
    let (ended, _folder) = watch.end();
    println!("{test}: {kills} kills, {frame} frames, {verified} verified, {unknown} not known");
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let count = |what: &str| ended.summary()[what].as_u64().unwrap();
    let all = count("verified") + count("skipped") + count("rejected");
    assert_eq!(all, frame, "{}", ended.summary());
    // A frame in hand may have been answered a moment before the kill.
    let answered = count("verified") + kills as u64;
    assert!(answered >= verified, "{}", ended.summary());
}

#[test]
fn workers_that_are_killed_at_random_moments() {
    killed_workers("random", false, 10, 1);
    killed_workers("random-events", true, 10, 2);
}

#[test]
#[ignore = "1,000 kills: some minutes"]
fn a_thousand_workers_that_are_killed_at_random_moments() {
    for seed in 0..10 {
        killed_workers(&format!("many{seed}"), seed % 2 == 1, 100, seed);
    }
}
