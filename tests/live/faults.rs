//! Processes that are killed or stopped, clocks that jump, and curves that appear all at once.

use super::support::random::Random;
use super::*;
use linkwatch::CurveLabels;
use std::io::Write;

/// Returns true if the squares are apart in a frame.
fn is_apart(seq: u64) -> bool {
    Random::new(seq).one_in(3)
}

/// The simulator of these tests, in a separate process. It asserts that each verdict is correct,
/// and appends a byte to a file for each verdict. It runs only if a service is given.
#[test]
#[ignore = "not a test, but a process of the next tests"]
fn simulator() {
    let Ok(service) = std::env::var("LINKWATCH_TEST_SERVICE") else {
        return;
    };
    let progress = std::env::var("LINKWATCH_TEST_PROGRESS").unwrap();
    let progress = std::fs::File::options().append(true).open(progress);
    let mut progress = progress.unwrap();
    let mut sim = client(&service);
    for frame in 0.. {
        let apart = is_apart(frame);
        let positions = squares(if apart { 2.5 } else { 0.0 });
        let seq = sim.publish(frame as f64, Positions::F32(&positions));
        let seq = seq.unwrap();
        match sim.wait(seq, LONG).unwrap() {
            Outcome::Verdict(message) => {
                let expected = if apart {
                    Verdict::Changed
                } else {
                    Verdict::Intact
                };
                assert_eq!(message.verdict, expected, "frame {seq}");
                progress.write_all(b".").unwrap();
            }
            Outcome::Stale => panic!("frame {seq}: no answer"),
            Outcome::NoWatcher(_) => std::thread::sleep(Duration::from_millis(1)),
        }
    }
}

/// Watches and simulators of one service.
struct Pair {
    folder: TempDir,
    service: String,
    /// Environment of all processes.
    variables: Vec<(String, String)>,
    /// Number of watches so far.
    watches: usize,
}

impl Pair {
    fn new(test: &str) -> Pair {
        let folder = TempDir::new().unwrap();
        std::fs::write(folder.path().join("progress"), "").unwrap();
        // The squares may be apart in the first frame of a watch, so all watches get this baseline.
        std::fs::write(folder.path().join("linked.txt"), "2\n0,1,-1\n").unwrap();
        Pair {
            folder,
            service: service(test),
            variables: Vec::new(),
            watches: 0,
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn watch(&mut self) -> Watch {
        self.watches += 1;
        let name = format!("watch-{}", self.watches);
        let [baseline, recording] = ["linked.txt", &format!("{name}.mcap")].map(|n| self.path(n));
        let args = [
            "--keep-watching",
            "--events=off",
            "--abort-on=never",
            "--baseline",
            baseline.to_str().unwrap(),
            "--record",
            recording.to_str().unwrap(),
        ];
        let mut command = command();
        command.envs(self.variables.iter().cloned());
        let none = [None, None];
        Watch::start_with(
            self.folder.path(),
            &name,
            &self.service,
            &args,
            command,
            none,
        )
    }

    fn simulator(&self) -> Simulator {
        let process = Command::new(std::env::current_exe().unwrap())
            .args(["--ignored", "--exact", "faults::simulator"])
            .env("LINKWATCH_TEST_SERVICE", &self.service)
            .env("LINKWATCH_TEST_PROGRESS", self.path("progress"))
            .envs(self.variables.iter().cloned())
            .stdout(Stdio::null())
            .spawn();
        Simulator(process.unwrap())
    }

    /// Returns the number of verdicts that simulators received.
    fn verdicts(&self) -> u64 {
        std::fs::metadata(self.path("progress")).unwrap().len()
    }

    /// Waits for a number of further verdicts.
    fn advance(&self, sim: &mut Simulator, verdicts: u64) {
        let before = self.verdicts();
        until(format_args!("{verdicts} verdicts"), || {
            let running = sim.0.try_wait().unwrap().is_none();
            assert!(running, "the simulator failed");
            (self.verdicts() >= before + verdicts).then_some(())
        });
    }

    /// Asserts that every recording can be replayed, with the recorded verdicts. Returns the number
    /// of frames in all of them, and in the printed results.
    fn check_outputs(&self) -> [usize; 2] {
        let (mut recorded, mut printed) = (0, 0);
        for entry in std::fs::read_dir(self.folder.path()).unwrap().flatten() {
            let path = entry.path();
            match path.extension().and_then(|e| e.to_str()) {
                Some("mcap") => {
                    let replayed = replay(&path);
                    assert_ne!(replayed.code, Some(2), "{}", replayed.stderr);
                    replayed.assert_recorded_verdicts();
                    recorded += replayed.reports().len();
                }
                Some("out") => {
                    let text = std::fs::read_to_string(path).unwrap();
                    printed += text.matches("{\"ms\"").count();
                }
                _ => {}
            }
        }
        [recorded, printed]
    }
}

/// A simulator process, which is killed when the test ends.
struct Simulator(Child);

impl Simulator {
    fn kill(mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }

    fn signal(&self, name: &str) {
        send(name, self.0.id());
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Kills watch and simulator at random moments, and starts them again in any order.
fn kills(test: &str, kills: usize, seed: u64) {
    let mut random = Random::new(seed);
    let mut pair = Pair::new(test);
    let (mut watch, mut sim) = (Some(pair.watch()), Some(pair.simulator()));
    let mut killed = [0, 0];
    while killed.iter().sum::<usize>() < kills {
        pair.advance(sim.as_mut().unwrap(), 2);
        std::thread::sleep(Duration::from_micros(random.below(20_000) as u64));
        let victims = random.below(4);
        // If both are killed, either one comes first.
        let order = if random.one_in(2) { [0, 1] } else { [1, 0] };
        for victim in order
            .into_iter()
            .filter(|v| victims == 3 || victims % 2 == *v)
        {
            killed[victim] += 1;
            match victim {
                0 => watch.take().unwrap().signal("KILL"),
                _ => sim.take().unwrap().kill(),
            }
            std::thread::sleep(Duration::from_micros(random.below(2000) as u64));
        }
        let order = if random.one_in(2) { [0, 1] } else { [1, 0] };
        for start in order {
            match start {
                0 if watch.is_none() => watch = Some(pair.watch()),
                1 if sim.is_none() => sim = Some(pair.simulator()),
                _ => {}
            }
            std::thread::sleep(Duration::from_micros(random.below(2000) as u64));
        }
    }
    pair.advance(sim.as_mut().unwrap(), 2);
    sim.take().unwrap().kill();
    let watch = watch.take().unwrap();
    let died = "the simulator died without ending the session; its last frames may be lost";
    stderr_with(&watch, &[died, "waiting for the next simulator"]);
    watch.signal("TERM");
    let ended = watch.end();
    assert!(matches!(ended.code, Some(1 | 3)), "{}", ended.stderr);
    let [recorded, printed] = pair.check_outputs();
    let [watches, simulators] = killed;
    println!(
        "{watches} watches and {simulators} simulators killed: {} verdicts, {printed} printed, \
         {recorded} recorded",
        pair.verdicts()
    );
    // A kill loses frames of less than a second, and those that still wait for the disk.
    assert!(
        recorded + 50 * watches >= printed,
        "{recorded} of {printed}"
    );
    let names = linkwatch::services().unwrap().into_iter();
    let left: Vec<_> = names.filter(|s| s.service == pair.service).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn watches_and_simulators_that_are_killed_at_random_moments() {
    kills("kills", 20, 1);
}

#[test]
#[ignore = "1,000 kills: some minutes"]
fn a_thousand_watches_and_simulators_that_are_killed_at_random_moments() {
    for seed in 0..10 {
        kills(&format!("kills-{seed}"), 100, seed);
    }
}

/// A kill loses at most the last second of a recording.
#[test]
fn frames_that_were_verified_a_second_before_a_kill_are_in_the_recording() {
    let folder = TempDir::new().unwrap();
    let service = service("flushed");
    let recording = folder.path().join("run.mcap");
    let args = ["--record", recording.to_str().unwrap()];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    for frame in 0..50 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    // One second, and the time of a write to a busy disk.
    std::thread::sleep(Duration::from_secs(3));
    for frame in 50..60 {
        assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
    }
    watch.signal("KILL");
    drop(watch);
    let replayed = replay(&recording);
    assert_eq!(replayed.code, Some(3), "{}", replayed.stderr);
    let words = "the recorder was stopped, or its disk was full; the complete frames were replayed";
    assert!(replayed.stderr.contains(words), "{}", replayed.stderr);
    assert!(
        replayed.reports().len() >= 50,
        "{}",
        replayed.reports().len()
    );
    replayed.assert_recorded_verdicts();
}

/// A process that is stopped for seconds does not count as dead. Every published frame is verified
/// or counted as skipped.
#[test]
fn stopped_processes_continue() {
    const STOP: Duration = Duration::from_secs(2);
    let mut pair = Pair::new("stopped");
    let (watch, mut sim) = (pair.watch(), pair.simulator());
    pair.advance(&mut sim, 10);
    watch.signal("STOP");
    std::thread::sleep(STOP);
    let before = pair.verdicts();
    std::thread::sleep(STOP / 4);
    assert!(
        pair.verdicts() <= before + 1,
        "a stopped watch answers nothing"
    );
    watch.signal("CONT");
    pair.advance(&mut sim, 10);
    sim.signal("STOP");
    std::thread::sleep(STOP);
    sim.signal("CONT");
    pair.advance(&mut sim, 10);
    for name in ["STOP", "CONT"] {
        watch.signal(name);
        sim.signal(name);
        std::thread::sleep(STOP / 2);
    }
    pair.advance(&mut sim, 10);
    let stderr = std::fs::read_to_string(&watch.stderr).unwrap();
    assert!(!stderr.contains("died"), "{stderr}");
    assert_eq!(
        stderr.matches("a simulator connected").count(),
        1,
        "{stderr}"
    );
    drop(sim);
    stderr_with(&watch, &["the simulator died"]);
    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(
        ended.summaries()[0]["summary"]["skipped"],
        0,
        "{}",
        ended.stderr
    );
    pair.check_outputs();
}

/// A stopped watch does not delay a simulator that does not wait, and the simulator can see its
/// silence.
#[test]
fn a_stopped_watch_holds_up_no_simulator() {
    let folder = TempDir::new().unwrap();
    let service = service("silent");
    let watch = Watch::start(folder.path(), "watch", &service, &[]);
    let mut sim = client(&service);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    assert_eq!(step(&mut sim, 0, 0.0), Verdict::Intact);
    watch.signal("STOP");
    let mut seq = 0;
    without_time_out("publishing", || {
        for _ in 0..1000 {
            seq = sim.publish(0.1, Positions::F32(&squares(0.0))).unwrap();
        }
    });
    let short = Duration::from_millis(1500);
    assert_eq!(sim.wait(seq, short).unwrap(), Outcome::Stale);
    assert!(sim.silent_for().unwrap() >= short / 2);
    watch.signal("CONT");
    let outcome = sim.wait(seq, PATIENCE).unwrap();
    assert!(matches!(outcome, Outcome::Verdict(m) if m.verdict == Verdict::Intact));
    assert_eq!(sim.finish().unwrap(), 1001);
    let ended = watch.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let count = |what: &str| ended.summary()[what].as_u64().unwrap();
    assert_eq!(count("verified") + count("skipped"), 1001);
    assert!(count("skipped") >= 900, "{}", ended.summary());
}

/// A library that makes the wall clock of a process jump by up to a day with each call.
#[cfg(target_os = "linux")]
const JUMPING_CLOCK: &str = r#"
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static long jump(void) {
    static atomic_uint calls;
    unsigned call = atomic_fetch_add(&calls, 1);
    if (call == 0) close(open(getenv("LINKWATCH_TEST_JUMPED"), O_CREAT | O_WRONLY, 0600));
    return (long)(call * 2654435761u % 172801u) - 86400;
}
int clock_gettime(clockid_t clock, struct timespec *at) {
    long result = syscall(SYS_clock_gettime, clock, at);
    if (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE) at->tv_sec += jump();
    return (int)result;
}
int gettimeofday(struct timeval *at, void *zone) {
    struct timespec now;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &now);
    at->tv_sec = now.tv_sec;
    at->tv_usec = now.tv_nsec / 1000;
    return 0;
}
time_t time(time_t *at) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (at) *at = now.tv_sec;
    return now.tv_sec;
}
"#;

/// All decisions use monotonic clocks. The wall clock is only recorded.
#[test]
#[cfg(target_os = "linux")]
fn a_wall_clock_that_jumps_changes_nothing() {
    let mut pair = Pair::new("clock");
    let [source, library, jumped] = ["clock.c", "clock.so", "jumped"].map(|name| pair.path(name));
    std::fs::write(&source, JUMPING_CLOCK).unwrap();
    let compiled = Command::new("cc")
        .args(["-shared", "-fPIC", "-O1", "-o"])
        .args([&library, &source])
        .status();
    assert!(
        compiled.unwrap().success(),
        "a C compiler links Rust programs"
    );
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    pair.variables = vec![
        ("LD_PRELOAD".into(), text(&library)),
        ("LINKWATCH_TEST_JUMPED".into(), text(&jumped)),
    ];
    let (watch, mut sim) = (pair.watch(), pair.simulator());
    pair.advance(&mut sim, 200);
    // Longer than the intervals of heartbeats and of checks that a process exists.
    watch.signal("STOP");
    std::thread::sleep(Duration::from_millis(1500));
    watch.signal("CONT");
    pair.advance(&mut sim, 200);
    assert!(jumped.exists(), "the clock was read, and jumped");
    let stderr = std::fs::read_to_string(&watch.stderr).unwrap();
    assert!(!stderr.contains("died"), "{stderr}");
    drop(sim);
    stderr_with(&watch, &["the simulator died"]);
    watch.signal("TERM");
    let ended = watch.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    pair.variables.clear();
    let [recorded, printed] = pair.check_outputs();
    assert_eq!(recorded, printed);
    assert!(recorded >= 400, "{recorded}");
}

/// Thousands of curves appear in one frame, and are verified from that frame on.
#[test]
fn curves_that_appear_all_at_once() {
    const PAIRS: usize = 10_000;
    let folder = TempDir::new().unwrap();
    let service = service("crowd");
    let recording = folder.path().join("run.mcap");
    let args = ["--record", recording.to_str().unwrap()];
    let watch = Watch::start(folder.path(), "watch", &service, &args);
    let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
    let describe = |sim: &mut Client, pairs: usize| {
        let names = (0..2 * pairs).map(|k| format!("curve {k}"));
        let labels = CurveLabels::named(names);
        let counts = vec![-4; 2 * pairs];
        sim.describe_labelled(Basis::Polyline, Precision::F32, &counts, labels)
            .unwrap();
    };
    // Pairs of linked squares, far from one another.
    let positions = |pairs: usize, moved: usize, shift: f32| -> Vec<f32> {
        let of_pair = |k: usize| {
            let mut pair = squares(if k == moved { shift } else { 0.0 });
            let offset = [(k % 100) as f32 * 10.0, (k / 100) as f32 * 10.0, 0.0];
            pair.iter_mut()
                .zip(offset.iter().cycle())
                .for_each(|(x, o)| *x += o);
            pair
        };
        (0..pairs).flat_map(of_pair).collect()
    };
    describe(&mut sim, 1);
    assert!(sim.wait_for_watcher(PATIENCE).unwrap());
    let verdict = |sim: &mut Client, pairs, moved, shift| {
        let seq = sim.publish(0.0, Positions::F32(&positions(pairs, moved, shift)));
        match sim.wait(seq.unwrap(), PATIENCE).unwrap() {
            Outcome::Verdict(m) => (m.verdict, m.to_string()),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(verdict(&mut sim, 1, 0, 0.0).0, Verdict::Intact);
    describe(&mut sim, PAIRS);
    assert_eq!(verdict(&mut sim, PAIRS, 0, 0.0).0, Verdict::Intact);
    let (changed, words) = verdict(&mut sim, PAIRS, 7777, 2.5);
    assert_eq!(changed, Verdict::Changed);
    assert!(
        words.contains("curves 15554 (curve 15554) and 15555 (curve 15555) came apart"),
        "{words}"
    );
    // The curve that was there from the start is compared with its first frame.
    assert_eq!(verdict(&mut sim, PAIRS, 0, 2.5).0, Verdict::Changed);
    describe(&mut sim, 1);
    // The curves pass through one another on their way back.
    assert_eq!(verdict(&mut sim, 1, 0, 0.0).0, Verdict::Changed);
    sim.finish().unwrap();
    let ended = watch.end();
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let reports = ended.reports();
    let lengths = |what: &str| -> Vec<usize> {
        let length = |r: &&Value| r[what].as_array().map_or(0, Vec::len);
        reports.iter().map(length).collect()
    };
    assert_eq!(lengths("appeared"), [0, 2 * PAIRS - 2, 0, 0, 0]);
    assert_eq!(lengths("gone"), [0, 0, 0, 0, 2 * PAIRS - 2]);
    let replayed = replay(&recording);
    assert_eq!(replayed.reports(), reports);
}

/// During a check of minutes, a terminal shows the progress, the simulator receives heartbeats, and
/// a signal finishes the recording.
#[test]
#[cfg(target_os = "linux")]
fn a_check_of_minutes_shows_progress_and_ends_on_a_signal() {
    for signal in ["TERM", "INT"] {
        let folder = TempDir::new().unwrap();
        let service = service(&format!("long-{signal}"));
        let recording = folder.path().join("run.mcap");
        let terminal = folder.path().join("terminal");
        // `script` runs the watch in a terminal of its own.
        let line = format!(
            "exec '{}' watch --service {service} --json --record '{}' > '{}'",
            env!("CARGO_BIN_EXE_linkwatch"),
            recording.display(),
            folder.path().join("out").display(),
        );
        let mut script = Command::new("script")
            .args(["-q", "-e", "-f", "-c", &line])
            .arg(&terminal)
            .env("TERM", "xterm")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let mut sim = Client::open(&service, &ClientOptions::lockstep()).unwrap();
        let (curves, segments) = (400, 1000);
        let describe = |sim: &mut Client, others: usize| {
            let names = (0..2 + others).map(|k| format!("curve {k}"));
            let mut counts = vec![-4, -4];
            counts.resize(2 + others, -segments);
            sim.describe_labelled(
                Basis::Polyline,
                Precision::F32,
                &counts,
                CurveLabels::named(names),
            )
            .unwrap();
        };
        describe(&mut sim, 0);
        assert!(sim.wait_for_watcher(PATIENCE).unwrap());
        for frame in 0..3 {
            assert_eq!(step(&mut sim, frame, 0.0), Verdict::Intact);
        }
        describe(&mut sim, curves);
        let tangle = sessions::tangle(curves, segments as usize);
        let tangle = [squares(0.0), tangle].concat();
        let seq = sim.publish(0.3, Positions::F32(&tangle)).unwrap();
        let screen = || {
            let bytes = std::fs::read(&terminal).unwrap_or_default();
            String::from_utf8_lossy(&bytes).into_owned()
        };
        let shown = |seconds: u32| move |text: &str| text.contains(&format!("in {seconds} s"));
        for seconds in [2, 4] {
            until(format_args!("progress after {seconds} s"), || {
                shown(seconds)(&screen()).then_some(())
            });
        }
        assert!(screen().contains("frame 3: "), "{}", screen());
        while sim.poll().unwrap().is_some() {}
        assert!(sim.silent_for().unwrap() < Duration::from_secs(4));
        let watch = until("the watch", || child_of(script.id()));
        send(signal, watch);
        assert!(matches!(
            without_time_out("the goodbye", || sim.wait(seq, LONG)).unwrap(),
            Outcome::NoWatcher(_)
        ));
        let status = wait(&mut script);
        assert_eq!(status.code(), Some(0), "{}", screen());
        assert!(
            screen().contains("the check of frame 3 was cancelled"),
            "{}",
            screen()
        );
        let replayed = replay(&recording);
        assert_eq!(replayed.code, Some(0), "{}", replayed.stderr);
        assert_eq!(replayed.reports().len(), 3);
        assert!(
            !replayed.stderr.contains("truncated"),
            "{}",
            replayed.stderr
        );
    }
}

/// Returns a child of a process, if it has one.
fn child_of(parent: u32) -> Option<u32> {
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

fn send(signal: &str, process: u32) {
    let id = process.to_string();
    let sent = Command::new("kill").args(["-s", signal, &id]).status();
    assert!(sent.unwrap().success(), "{signal} to {id}");
}
