//! `--state`: watches that are killed or stopped, and others that continue.

use super::support::random::Random;
use super::*;
use linkwatch::{CurveLabels, VerdictMessage};

/// Options with which a passage of the squares in one step counts as a pull-through.
const EVENTS: [&str; 3] = ["--events", "--motion-limit", "5"];

/// Processes that watch the same services with the same options, one after another.
struct Restarted {
    folder: TempDir,
    service: String,
    args: Vec<String>,
    processes: usize,
    /// The process that runs.
    watch: Option<Watch>,
}

impl Restarted {
    /// Starts the first process.
    fn start(test: &str, args: &[&str]) -> Restarted {
        Restarted::recording(test, "", args)
    }

    /// Starts the first process, whose recording has these settings.
    fn recording(test: &str, settings: &str, args: &[&str]) -> Restarted {
        let mut watches = Restarted {
            folder: TempDir::new().unwrap(),
            service: service(test),
            args: Vec::new(),
            processes: 0,
            watch: None,
        };
        let [state, recording] = ["watch.state", "run.mcap"].map(|name| watches.path(name));
        let recording = format!("{}{settings}", text(&recording));
        let own = ["--state", text(&state), "--record", &recording];
        watches.args = own.iter().chain(args).map(|&arg| arg.to_owned()).collect();
        watches.next();
        watches
    }

    /// Starts the next process.
    fn next(&mut self) {
        self.processes += 1;
        let name = format!("watch-{}", self.processes);
        let args: Vec<&str> = self.args.iter().map(String::as_str).collect();
        self.watch = Some(Watch::start(
            self.folder.path(),
            &name,
            &self.service,
            &args,
        ));
    }

    fn watch(&self) -> &Watch {
        self.watch.as_ref().expect("a process that runs")
    }

    /// Ends the process with a signal.
    fn stop(&mut self, signal: &str) -> Ended {
        self.watch().signal(signal);
        self.end()
    }

    /// Waits for the end of the process.
    fn end(&mut self) -> Ended {
        self.watch.take().expect("a process that runs").end()
    }

    /// Kills the process once it has printed as many lines. A verified frame is saved in the state
    /// after its verdict was sent, and printed after that.
    fn kill_after(&mut self, lines: usize) -> Ended {
        lines_of(self.watch(), lines);
        self.stop("KILL")
    }

    /// Kills the process once it has printed as many lines, and starts the next one.
    fn restart_after(&mut self, lines: usize, sim: &mut Client) {
        self.kill_after(lines);
        self.next();
        watched(sim);
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Waits until a recording has frames: at most a second after the first one.
    fn wait_for_file(&self, name: &str) {
        until(name, || {
            let file = std::fs::metadata(self.path(name)).ok()?;
            (file.len() > 0).then_some(())
        });
    }

    /// Asserts that no file of the state is left.
    #[track_caller]
    fn assert_removed(&self) {
        let names = std::fs::read_dir(self.folder.path()).unwrap();
        let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let left: Vec<String> = names.filter(|name| name.contains(".state")).collect();
        assert_eq!(left, [""; 0]);
    }

    /// Replays a recording of all frames of a process. Returns the number of frames.
    #[track_caller]
    fn replay(&self, name: &str, code: i32) -> usize {
        let replayed = replay(&self.path(name));
        assert_eq!(replayed.code, Some(code), "{name}: {}", replayed.stderr);
        replayed.assert_recorded_verdicts();
        replayed.reports().len()
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Waits for the next watcher of a simulator.
fn watched(sim: &mut Client) {
    // A simulator that does not wait learns of the new watcher by its messages.
    until("the new watcher", || {
        sim.poll().unwrap();
        let here = sim.wait_for_watcher(Duration::from_millis(50)).unwrap();
        (here && sim.silent_for().is_some()).then_some(())
    });
}

/// Opens a simulator, and waits for its watcher.
fn simulator(service: &str) -> Client {
    let mut sim = client(service);
    watched(&mut sim);
    sim
}

/// Describes curves with names: two squares, and others.
fn describe(sim: &mut Client, others: &[usize]) {
    let mut counts = vec![-4, -4];
    counts.extend(others.iter().map(|&points| -(points as i32)));
    let names = (0..counts.len()).map(|k| format!("curve {k}"));
    let labels = CurveLabels::named(names);
    sim.describe_labelled(Basis::Polyline, Precision::F32, &counts, labels)
        .unwrap();
}

/// Publishes a frame without an answer, because nobody watches.
fn unwatched(sim: &mut Client, shift: f32) {
    let seq = sim.publish(0.0, Positions::F32(&squares(shift))).unwrap();
    let outcome = without_time_out("the end of the watch", || sim.wait(seq, LONG));
    assert!(matches!(outcome.unwrap(), Outcome::NoWatcher(_)));
}

fn counts(summary: &Value) -> [u64; 3] {
    ["verified", "skipped", "rejected"].map(|name| summary[name].as_u64().unwrap())
}

#[test]
fn the_next_process_expects_what_the_first_one_did() {
    let mut watches = Restarted::start("expects", &["--events=off"]);
    let mut sim = simulator(&watches.service);
    for frame in 0..5 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    watches.wait_for_file("run.mcap");
    watches.restart_after(5, &mut sim);
    // A watch without the state would use this frame, in which the curves are apart, as its
    // baseline.
    assert_eq!(step(&mut sim, 5, 2.5), Verdict::Changed);
    assert_eq!(step(&mut sim, 6, 0.0), Verdict::Intact);
    watches.wait_for_file("run-2.mcap");
    watches.restart_after(2, &mut sim);
    assert_eq!(step(&mut sim, 7, 0.1), Verdict::Intact);
    assert_eq!(sim.finish().unwrap(), 8);
    let ended = watches.end();
    // The change was found by a process that was killed.
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let why = "this watch found a change before it was started again";
    assert!(ended.stderr.contains(why), "{}", ended.stderr);
    assert_eq!(counts(ended.summary()), [8, 0, 0], "{}", ended.stderr);
    watches.assert_removed();
    // The frames of the last second before a kill, and the end of the file, may be missing.
    assert!(watches.replay("run.mcap", 3) > 0);
    assert!(watches.replay("run-2.mcap", 1) > 0);
    assert_eq!(watches.replay("run-3.mcap", 0), 1);
}

#[test]
fn without_a_change_the_exit_code_after_a_crash_is_3() {
    let mut watches = Restarted::start("code", &[]);
    let mut sim = simulator(&watches.service);
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    watches.restart_after(1, &mut sim);
    assert_eq!(step(&mut sim, 1, 0.0), Verdict::Intact);
    sim.finish().unwrap();
    let ended = watches.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert_eq!(counts(ended.summary()), [2, 0, 0], "{}", ended.stderr);
    watches.assert_removed();
}

/// Regression test: a warning claimed that only a single curve was verified.
#[test]
fn a_process_without_frames_knows_that_there_were_pairs() {
    let mut watches = Restarted::start("pairs", &[]);
    let mut sim = simulator(&watches.service);
    for frame in 0..3 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    watches.restart_after(3, &mut sim);
    sim.finish().unwrap();
    let ended = watches.end();
    assert_eq!(counts(ended.summary()), [3, 0, 0], "{}", ended.stderr);
    let warning = "nothing was verified: one curve alone";
    assert!(!ended.stderr.contains(warning), "{}", ended.stderr);
}

/// A killed process leaves complete files, which the next process does not modify. Its own files
/// contain the baseline of the first process, so that each file replays without the others.
#[test]
fn processes_write_several_files_each_that_replay_by_themselves() {
    /// Squares of 192 kB a frame: five frames fill a file.
    const EACH: u64 = 12;
    /// First frame in which two squares are apart.
    const APART: u64 = 15;
    let mut watches = Restarted::recording("parts", ",max=1MB", &["--abort-on", "never"]);
    let mut sim = Client::open(&watches.service, &ClientOptions::lockstep()).unwrap();
    keep::describe_many(&mut sim);
    watched(&mut sim);
    let publish = |sim: &mut Client, frames: std::ops::Range<u64>| {
        for frame in frames {
            let apart = frame >= APART;
            let verdict = verdict_on(sim, 0.0, &keep::many_squares(frame, apart));
            assert_eq!(verdict == Verdict::Changed, apart, "frame {frame}");
        }
    };
    publish(&mut sim, 0..EACH);
    // Once the second file exists, the first one is complete.
    watches.wait_for_file("run-part2.mcap");
    watches.kill_after(EACH as usize);
    let first = std::fs::read(watches.path("run.mcap")).unwrap();
    watches.next();
    watched(&mut sim);
    publish(&mut sim, EACH..2 * EACH);
    sim.finish().unwrap();
    let ended = watches.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert_eq!(ended.summary()["verified"], 2 * EACH);
    assert!(std::fs::read(watches.path("run.mcap")).unwrap() == first);
    let mut frames = Vec::new();
    for process in ["run", "run-2"] {
        for part in ["", "-part2", "-part3"] {
            let path = watches.path(&format!("{process}{part}.mcap"));
            // The first process may have been killed before it began its last file.
            if path.exists() || (process, part) != ("run", "-part3") {
                let found = keep::frames_of(&path);
                let changed = found.iter().any(|frame| *frame >= APART);
                keep::replay_all(&path, i32::from(changed));
                frames.extend(found);
            }
        }
    }
    assert!(frames.is_sorted(), "{frames:?}");
    // At the end of what the first process wrote, at most the frames of a second are lost.
    let lost: Vec<u64> = (0..2 * EACH).filter(|f| !frames.contains(f)).collect();
    assert!(lost.iter().all(|f| (5..EACH).contains(f)), "{frames:?}");
}

#[test]
fn the_frame_in_hand_is_rejected_and_not_verified_again() {
    let mut watches = Restarted::start("in-hand", &["--abort-on", "any"]);
    let mut sim = Client::open(&watches.service, &ClientOptions::lockstep()).unwrap();
    describe(&mut sim, &[]);
    watched(&mut sim);
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    let seq = publish_tangle(&mut sim);
    watches.stop("KILL");
    watches.next();
    let answer = until("the verdict", || {
        sim.wait_for_watcher(Duration::from_millis(50)).unwrap();
        verdict_of(&mut sim, seq)
    });
    assert_eq!(answer.verdict, Verdict::Rejected);
    assert!(!answer.abort, "{answer:?}");
    let words = "crashed while it verified this frame, which is not verified again";
    assert!(answer.to_string().contains(words), "{answer}");
    watched(&mut sim);
    describe(&mut sim, &[]);
    assert_eq!(step(&mut sim, 2, 0.1), Verdict::Intact);
    assert_eq!(step(&mut sim, 3, 2.5), Verdict::Changed);
    assert_eq!(sim.finish().unwrap(), 4);
    let ended = watches.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert_eq!(counts(ended.summary()), [3, 0, 1], "{}", ended.stderr);
}

/// The watch did not crash, so the frame is skipped, as in a watch that ends normally.
#[test]
fn the_frame_in_hand_is_skipped_if_a_signal_cancels_its_check() {
    let mut watches = Restarted::start("cancelled", &EVENTS);
    let mut sim = Client::open(&watches.service, &ClientOptions::lockstep()).unwrap();
    describe(&mut sim, &[]);
    watched(&mut sim);
    assert_eq!(step(&mut sim, 0, 3.0), Verdict::Intact);
    publish_tangle(&mut sim);
    let stopped = watches.stop("TERM");
    assert!(
        stopped.stderr.contains("was cancelled"),
        "{}",
        stopped.stderr
    );
    watches.next();
    watched(&mut sim);
    describe(&mut sim, &[]);
    assert_eq!(step(&mut sim, 2, -5.0), Verdict::Changed);
    sim.finish().unwrap();
    let ended = watches.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert_eq!(counts(ended.summary()), [2, 1, 0], "{}", ended.stderr);
    assert!(!ended.stderr.contains("crashed"), "{}", ended.stderr);
}

/// Regression test: the frame after it counted as the one after the cut, and was intact.
#[test]
fn the_step_from_a_cut_frame_in_hand_is_unknown() {
    for signal in ["KILL", "TERM"] {
        let mut watches = Restarted::start(&format!("cut in hand {signal}"), &EVENTS);
        let mut sim = Client::open(&watches.service, &ClientOptions::lockstep()).unwrap();
        describe(&mut sim, &[]);
        watched(&mut sim);
        assert_eq!(step(&mut sim, 0, 3.0), Verdict::Intact);
        sim.cut();
        publish_tangle(&mut sim);
        watches.stop(signal);
        watches.next();
        watched(&mut sim);
        describe(&mut sim, &[]);
        assert_eq!(step(&mut sim, 2, -5.0), Verdict::Undecided, "{signal}");
        sim.finish().unwrap();
        let ended = watches.end();
        assert_eq!(ended.code, Some(3), "{}", ended.stderr);
        let last = ended.reports().last().unwrap()["last_intact"].clone();
        assert_eq!(last, 0, "{}", ended.stderr);
    }
}

/// Regression test: the second frame became the baseline without a warning.
#[test]
fn the_next_process_verifies_the_first_frame_if_a_signal_cancels_its_check() {
    let mut watches = Restarted::start("cancelled first", &EVENTS);
    let mut sim = Client::open(&watches.service, &ClientOptions::lockstep()).unwrap();
    let seq = publish_tangle(&mut sim);
    for process in 0..2 {
        if process > 0 {
            watches.next();
            watched(&mut sim);
            let outcome = sim.wait(seq, Duration::from_secs(1)).unwrap();
            assert_eq!(outcome, Outcome::Stale);
        }
        let stopped = watches.stop("TERM");
        let words = "the check of frame 0 was cancelled";
        assert!(stopped.stderr.contains(words), "{}", stopped.stderr);
    }
}

/// Publishes squares and other curves that take minutes to verify. Returns the number of the frame
/// once it is being verified.
fn publish_tangle(sim: &mut Client) -> u64 {
    let (curves, segments) = (400, 1000);
    describe(sim, &vec![segments; curves]);
    let tangle = [squares(0.0), sessions::tangle(curves, segments)].concat();
    let seq = sim.publish(0.1, Positions::F32(&tangle)).unwrap();
    let outcome = sim.wait(seq, Duration::from_secs(1)).unwrap();
    assert_eq!(outcome, Outcome::Stale);
    seq
}

fn verdict_of(sim: &mut Client, seq: u64) -> Option<VerdictMessage> {
    match without_time_out("a verdict", || sim.wait(seq, LONG)).unwrap() {
        Outcome::Verdict(message) => Some(*message),
        _ => None,
    }
}

/// The state after the first frame is written before its verdict.
#[test]
fn the_step_from_the_saved_frame_is_searched_for_pull_throughs() {
    let mut watches = Restarted::start("searched", &EVENTS);
    let mut sim = simulator(&watches.service);
    assert_eq!(step(&mut sim, 0, 3.0), Verdict::Intact);
    watches.restart_after(1, &mut sim);
    assert_eq!(step(&mut sim, 1, -5.0), Verdict::Changed);
    assert_eq!(step(&mut sim, 2, -5.0), Verdict::Intact);
    sim.finish().unwrap();
    let ended = watches.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let reports = ended.reports();
    assert_eq!(reports[0]["events"].as_array().unwrap().len(), 4);
    assert_eq!(reports[1]["last_intact"], 0);
}

#[test]
fn pull_throughs_after_the_saved_frame_are_unknown() {
    for (signal, word) in [("KILL", "crashed and was"), ("TERM", "was stopped and")] {
        let mut watches = Restarted::start(&format!("unknown-{signal}"), &EVENTS);
        let mut sim = simulator(&watches.service);
        assert_eq!(step(&mut sim, 0, 3.0), Verdict::Intact);
        let session = watches.path("watch.state.session");
        let saved = std::fs::read(&session).unwrap();
        for frame in 1..3 {
            assert_eq!(step(&mut sim, frame, 3.0), Verdict::Intact);
        }
        lines_of(watches.watch(), 3);
        let first = watches.stop(signal);
        // On a slow machine, a later state may have been written, so the saved one is restored.
        std::fs::write(&session, saved).unwrap();
        watches.next();
        watched(&mut sim);
        assert_eq!(step(&mut sim, 3, -5.0), Verdict::Undecided);
        assert_eq!(step(&mut sim, 4, -5.0), Verdict::Intact);
        sim.cut();
        assert_eq!(step(&mut sim, 5, 3.0), Verdict::Intact);
        sim.finish().unwrap();
        let ended = watches.end();
        assert_eq!(ended.code, Some(3), "{}", ended.stderr);
        let reports = ended.reports();
        let missing = reports[0]["missing"][0].as_str().unwrap();
        let words = format!("{word} started again, so pull-throughs before this frame are unknown");
        assert!(missing.contains(&words), "{missing}");
        let last = reports.iter().map(|r| r["last_intact"].clone());
        assert_eq!(last.collect::<Vec<_>>(), [2, 2, 5], "{}", ended.stderr);
        let words = "the baseline is frame 0, with 0 links";
        assert!(ended.stderr.contains(words), "{}", ended.stderr);
        // Its recording does not have the frame before it either.
        assert_eq!(watches.replay("run-2.mcap", 0), 3);
        let code = if signal == "TERM" { Some(0) } else { None };
        assert_eq!(first.code, code, "{}", first.stderr);
    }
}

#[test]
fn a_cut_while_nobody_watches_ends_what_is_unknown() {
    for saved_last in [true, false] {
        let mut watches = Restarted::start(&format!("cut-{saved_last}"), &EVENTS);
        let mut sim = simulator(&watches.service);
        assert_eq!(step(&mut sim, 0, 3.0), Verdict::Intact);
        let session = watches.path("watch.state.session");
        let saved = std::fs::read(&session).unwrap();
        if !saved_last {
            assert_eq!(step(&mut sim, 1, 3.0), Verdict::Intact);
        }
        watches.kill_after(if saved_last { 1 } else { 2 });
        std::fs::write(&session, saved).unwrap();
        unwatched(&mut sim, 3.0);
        sim.cut();
        unwatched(&mut sim, -5.0);
        watches.next();
        watched(&mut sim);
        let frame = if saved_last { 3 } else { 4 };
        // The watch may verify the newest frame of the gap as well, which is then the cut.
        assert_eq!(step(&mut sim, frame, -5.0), Verdict::Intact);
        sim.finish().unwrap();
        let ended = watches.end();
        assert_eq!(ended.code, Some(3), "{}", ended.stderr);
        let last = ended.reports().last().unwrap()["last_intact"].clone();
        assert_eq!(last, frame, "{}", ended.stderr);
    }
}

/// Regression test: the new watch ignored that the frame was accepted, and compared with the newest
/// baseline that it had.
#[test]
fn a_frame_accepted_while_nobody_watches_is_the_baseline() {
    for from_now in [false, true] {
        let args = ["--events=off", "--from-now"];
        let args = &args[..1 + usize::from(from_now)];
        let mut watches = Restarted::start(&format!("accepted-{from_now}"), args);
        let mut sim = simulator(&watches.service);
        assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
        watches.kill_after(1);
        sim.accept();
        for shift in [2.5, 2.5, 0.0] {
            unwatched(&mut sim, shift);
        }
        watches.next();
        watched(&mut sim);
        assert_eq!(step(&mut sim, 4, 0.0), Verdict::Changed, "{from_now}");
        sim.finish().unwrap();
        let ended = watches.end();
        assert_eq!(ended.code, Some(1), "{}", ended.stderr);
        assert_eq!(ended.summary()["baseline"]["frame"], 1, "{}", ended.stderr);
    }
}

#[test]
fn curves_that_appeared_before_a_crash_are_expected_after_it() {
    let mut watches = Restarted::start("appeared", &[]);
    let mut sim = Client::open(&watches.service, &ClientOptions::lockstep()).unwrap();
    // A third square, through the first one beside the second one, or apart from it.
    let third = |y: f32| support::polygons::square([-0.5, y, 0.0], [1, 2]);
    let points = |y: f32| [squares(0.0), third(y)].concat();
    describe(&mut sim, &[]);
    watched(&mut sim);
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    describe(&mut sim, &[4]);
    assert_eq!(verdict_on(&mut sim, 0.1, &points(1.0)), Verdict::Intact);
    watches.restart_after(2, &mut sim);
    assert_eq!(verdict_on(&mut sim, 0.2, &points(1.0)), Verdict::Intact);
    assert_eq!(verdict_on(&mut sim, 0.3, &points(3.0)), Verdict::Changed);
    sim.finish().unwrap();
    let ended = watches.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let appeared = ended.reports().iter().any(|r| r["appeared"] == 1);
    assert!(!appeared, "{}", ended.stderr);
}

#[test]
fn another_simulator_gets_a_baseline_of_its_own_with_a_warning() {
    let mut watches = Restarted::start("another", &["--keep-watching"]);
    let mut sim = simulator(&watches.service);
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    watches.kill_after(1);
    sim.finish().unwrap();
    watches.next();
    let mut sim = simulator(&watches.service);
    assert_eq!(step(&mut sim, 0, 2.5), Verdict::Intact);
    sim.finish().unwrap();
    let words = "another simulator than before the watch was started again";
    stderr_with(watches.watch(), &[words, "the simulator ended after 1"]);
    let ended = watches.stop("TERM");
    // The first simulator ended while no watch was running.
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert!(
        ended.lines.iter().all(|line| line["session"] == 2),
        "{:?}",
        ended.lines
    );
    // The next process knows that as well.
    watches.next();
    stderr_with(watches.watch(), &["waiting for a simulator"]);
    let ended = watches.stop("TERM");
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
}

#[test]
fn a_simulator_that_ended_while_nobody_watched_ends_the_watch() {
    let mut watches = Restarted::start("ended", &[]);
    let mut sim = simulator(&watches.service);
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    watches.kill_after(1);
    unwatched(&mut sim, 2.5);
    sim.finish().unwrap();
    watches.next();
    let ended = watches.end();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let words = "the simulator ended before the watch could continue; its last frames were not";
    assert!(ended.stderr.contains(words), "{}", ended.stderr);
    watches.assert_removed();
}

#[test]
fn a_signal_keeps_the_files_and_the_next_process_continues() {
    for signal in ["TERM", "INT"] {
        let mut watches = Restarted::start(&format!("sig{signal}"), &[]);
        let mut sim = simulator(&watches.service);
        assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
        let stopped = watches.stop(signal);
        assert_eq!(stopped.code, Some(0), "{}", stopped.stderr);
        assert_eq!(watches.replay("run.mcap", 0), 1);
        unwatched(&mut sim, 0.0);
        watches.next();
        watched(&mut sim);
        // The newest frame of the gap is verified first, unless this frame is already newer.
        assert_eq!(step(&mut sim, 2, 2.5), Verdict::Changed);
        sim.finish().unwrap();
        let ended = watches.end();
        assert_eq!(ended.code, Some(1), "{}", ended.stderr);
        assert_eq!(counts(ended.summary()).iter().sum::<u64>(), 3);
        watches.assert_removed();
    }
}

#[test]
fn sessions_before_and_after_a_crash_have_files_of_their_own() {
    let mut watches = Restarted::start("files", &["--keep-watching"]);
    let mut lines = Vec::new();
    for round in 0..3 {
        let mut sim = simulator(&watches.service);
        assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
        if round == 1 {
            watches.wait_for_file("run-2.mcap");
            lines.extend(watches.kill_after(4).lines);
            watches.next();
            watched(&mut sim);
        }
        // The second simulator keeps its baseline; the third one has its own.
        let (shift, verdict) = match round {
            2 => (0.1, Verdict::Intact),
            _ => (2.5, Verdict::Changed),
        };
        assert_eq!(step(&mut sim, 1, shift), verdict);
        sim.finish().unwrap();
        lines_of(watches.watch(), [3, 2, 5][round]);
    }
    let ended = watches.stop("TERM");
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    lines.extend(ended.lines);
    let sessions: Vec<_> = lines.iter().map(|line| line["session"].clone()).collect();
    assert_eq!(sessions, [1, 1, 1, 2, 2, 2, 3, 3, 3], "{}", ended.stderr);
    let recordings = [
        ("run", 1, 2),
        ("run-2", 3, 1),
        ("run-3", 1, 1),
        ("run-4", 0, 2),
    ];
    for (name, code, frames) in recordings {
        assert_eq!(watches.replay(&format!("{name}.mcap"), code), frames);
    }
}

#[test]
fn a_second_watch_with_the_same_file_is_refused() {
    let mut watches = Restarted::start("second", &[]);
    let mut sim = simulator(&watches.service);
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    let state = watches.path("watch.state");
    let args = ["--state", text(&state)];
    let other = service("second-other");
    let refused = Watch::start(watches.folder.path(), "refused", &other, &args).end();
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
    let words = format!(
        "{}: another `linkwatch watch` has locked it",
        state.display()
    );
    assert!(refused.stderr.contains(&words), "{}", refused.stderr);
    // The first one is not disturbed, and neither is the next one.
    assert_eq!(step(&mut sim, 1, 0.0), Verdict::Intact);
    watches.restart_after(2, &mut sim);
    assert_eq!(step(&mut sim, 2, 2.5), Verdict::Changed);
    sim.finish().unwrap();
    assert_eq!(watches.end().code, Some(1));
}

#[test]
fn a_file_of_something_else_is_refused_and_not_overwritten() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("notes.txt");
    std::fs::write(&path, "my notes").unwrap();
    let args = ["--state", text(&path)];
    let refused = Watch::start(folder.path(), "watch", &service("notes"), &args).end();
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
    let words = "it is not the state of a watch of this version of linkwatch";
    assert!(refused.stderr.contains(words), "{}", refused.stderr);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "my notes");
}

/// Counters are those of one process. Only the number of restarts is carried over.
#[test]
fn the_metrics_count_restarts() {
    let mut watches = Restarted::start("counted", &["--metrics", "0"]);
    let mut sim = simulator(&watches.service);
    for restarts in 0..3 {
        if restarts > 0 {
            watches.restart_after(1, &mut sim);
        }
        assert_eq!(step(&mut sim, restarts, 0.0), Verdict::Intact);
        lines_of(watches.watch(), 1);
        let log = stderr_with(watches.watch(), &["/metrics\n"]);
        let (_, rest) = log.split_once("metrics are at http://").unwrap();
        let (address, _) = rest.split_once("/metrics\n").unwrap();
        let page = metrics::scrape(address);
        let figure = |name: &str| metrics::figure(&page, name, &watches.service);
        assert_eq!(figure("linkwatch_frames_verified_total"), 1.0);
        assert_eq!(figure("linkwatch_restarts_total"), restarts as f64);
    }
}

/// Kills watches at random moments, with or without a search for pull-throughs. Every verdict
/// equals that of a watch that was not killed, or says that the frame is not known to be intact.
fn killed_watches(test: &str, events: bool, kills: usize, seed: u64) {
    let mut random = Random::new(seed);
    let args: &[&str] = if events { &[] } else { &["--events=off"] };
    let mut watches = Restarted::start(test, args);
    let mut sim = simulator(&watches.service);
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    // `was_apart` is `None` if it is unknown whether the squares were apart in the last verified
    // frame.
    let (mut frame, mut verified, mut was_apart) = (1, 1, Some(false));
    for _ in 0..kills {
        let mut moment = Some(random.below(20));
        // Continues until a process has verified frames after the kill, so that each round makes
        // progress.
        let mut after = 0;
        while after < 2 {
            let apart = random.one_in(3);
            let positions = squares(if apart { 2.5 } else { 0.0 });
            let seq = sim.publish(frame as f64, Positions::F32(&positions));
            assert_eq!(seq.unwrap(), frame);
            match moment {
                // The kill may come at any stage of the frame.
                Some(0) => {
                    std::thread::sleep(Duration::from_micros(random.below(1000) as u64));
                    watches.stop("KILL");
                    watches.next();
                    moment = None;
                }
                Some(frames) => moment = Some(frames - 1),
                None => {}
            }
            match sim.wait(frame, PATIENCE).unwrap() {
                Outcome::Verdict(m) if m.verdict == Verdict::Rejected => {}
                Outcome::Verdict(m) => {
                    // A square that returns also passes through the other one, unless the step is
                    // unknown.
                    let expected: &[Verdict] = match (apart, events, was_apart) {
                        (true, _, _) => &[Verdict::Changed],
                        (false, false, _) => &[Verdict::Intact],
                        (false, true, Some(true)) => &[Verdict::Changed, Verdict::Undecided],
                        (false, true, Some(false)) => &[Verdict::Intact, Verdict::Undecided],
                        (false, true, None) => {
                            &[Verdict::Intact, Verdict::Changed, Verdict::Undecided]
                        }
                    };
                    let is_expected = expected.contains(&m.verdict);
                    assert!(is_expected, "frame {frame}, seed {seed}: {m}");
                    (verified, was_apart) = (verified + 1, Some(apart));
                    after += u32::from(moment.is_none());
                }
                Outcome::Stale => panic!("frame {frame}, seed {seed}: no answer"),
                Outcome::NoWatcher(_) => {
                    was_apart = None;
                    std::thread::sleep(Duration::from_millis(2));
                }
            }
            frame += 1;
        }
    }
    assert_eq!(sim.finish().unwrap(), frame);
    let ended = watches.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let [counted, skipped, rejected] = counts(ended.summary());
    assert_eq!(counted + skipped + rejected, frame, "{}", ended.summary());
    // A pending frame may have been answered just before the kill.
    assert!(counted + kills as u64 >= verified, "{}", ended.summary());
    watches.assert_removed();
}

#[test]
fn watches_that_are_killed_at_random_moments() {
    killed_watches("random", false, 10, 1);
    killed_watches("random-events", true, 10, 2);
}

#[test]
#[ignore = "1,000 kills: some minutes"]
fn a_thousand_watches_that_are_killed_at_random_moments() {
    for seed in 0..10 {
        killed_watches(&format!("many{seed}"), seed % 2 == 1, 100, seed);
    }
}
