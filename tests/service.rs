//! `linkwatch watch` as a service: as process 1 of a container, that is, of a separate pid
//! namespace. Such a process has no default signal actions, and its pid is not valid outside.
//!
//! If namespaces are not permitted, the tests are shown as ignored, never as passed. The recipes of
//! `examples/service` are checked as far as that works without systemd and Docker.

mod support;

use libtest_mimic::{Arguments, Failed};
use linkwatch::{
    Basis, Client, ClientOptions, Departure, Outcome, Positions, Precision, Result, Verdict,
};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use support::command::{command, linkwatch, text};
use support::polygons::squares;
use support::time::{PATIENCE, until};
use support::trial::trial;
use tempfile::TempDir;

/// Environment variable with the service of a simulator that runs in a separate process.
const SERVICE: &str = "LINKWATCH_TEST_SERVICE";

/// Time without frames after which a watcher checks several times that the simulator exists.
const SILENCE: Duration = Duration::from_secs(3);

/// Returns a command that runs another one as process 1, without or with the permissions of root.
fn unshare(as_user: bool) -> Command {
    let mut command = Command::new("unshare");
    if as_user {
        command.args(["--user", "--map-root-user"]);
    }
    command.args(["--pid", "--fork", "--kill-child", "--mount-proc"]);
    command.stdin(Stdio::null());
    command
}

/// Returns the permissions with which namespaces can be created, if they can.
fn permitted() -> Option<bool> {
    [true, false].into_iter().find(|&as_user| {
        let tried = unshare(as_user).arg("true").stderr(Stdio::null()).status();
        tried.is_ok_and(|status| status.success())
    })
}

/// A process 1, which is killed when the test ends.
struct Process1 {
    unshare: Child,
    /// Process id in the namespace of the test.
    pid: String,
    stdout: PathBuf,
    stderr: PathBuf,
}

impl Process1 {
    /// Starts a command as process 1 of a new namespace.
    fn start(folder: &Path, name: &str, what: &Command) -> Process1 {
        let [stdout, stderr] = ["out", "err"].map(|e| folder.join(format!("{name}.{e}")));
        let file = |path: &Path| std::fs::File::create(path).unwrap();
        let as_user = permitted().expect("namespaces are permitted");
        let unshare = unshare(as_user)
            .arg(what.get_program())
            .args(what.get_args())
            .envs(what.get_envs().filter_map(|(k, v)| Some((k, v?))))
            .stdout(file(&stdout))
            .stderr(file(&stderr))
            .spawn()
            .unwrap();
        let program = Path::new(what.get_program()).file_name().unwrap();
        let pid = until("process 1", || {
            let pid = children(&unshare.id().to_string()).into_iter().next()?;
            let line = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).ok()?;
            let started = Path::new(line.split('\0').next()?).file_name() == Some(program);
            started.then_some(pid)
        });
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
        let ids = status.lines().find_map(|line| line.strip_prefix("NSpid:"));
        let innermost = ids.and_then(|ids| ids.split_whitespace().last());
        assert_eq!(innermost, Some("1"), "{status}");
        Process1 {
            unshare,
            pid,
            stdout,
            stderr,
        }
    }

    /// Starts `linkwatch watch`, and waits until it has opened its service.
    fn watch(folder: &Path, service: &str, args: &[&str]) -> Process1 {
        let mut watch = command();
        watch.args(["watch", "--service", service]).args(args);
        let watch = Process1::start(folder, "watch", &watch);
        watch.log_with("waiting for a simulator");
        watch
    }

    /// Starts a simulator, which publishes frames with a pause until it is killed.
    fn simulator(folder: &Path, service: &str) -> Process1 {
        let mut simulator = Command::new(std::env::current_exe().unwrap());
        simulator.env(SERVICE, service);
        Process1::start(folder, "simulator", &simulator)
    }

    fn signal(&self, name: &str) {
        let kill = Command::new("kill").args(["-s", name, &self.pid]).status();
        assert!(kill.unwrap().success());
    }

    /// Waits for the end. Returns the exit code, stdout and stderr.
    fn end(mut self) -> (Option<i32>, String, String) {
        let status = until("the end of process 1", || self.unshare.try_wait().unwrap());
        let [stdout, stderr] =
            [&self.stdout, &self.stderr].map(|path| std::fs::read_to_string(path).unwrap());
        (status.code(), stdout, stderr)
    }

    /// Waits until stderr contains these words. Returns it.
    fn log_with(&self, words: &str) -> String {
        until(format_args!("the words '{words}'"), || {
            let log = std::fs::read_to_string(&self.stderr).unwrap();
            log.contains(words).then_some(log)
        })
    }
}

impl Drop for Process1 {
    fn drop(&mut self) {
        // Kills process 1 and with it its namespace.
        let _ = self.unshare.kill();
        let _ = self.unshare.wait();
    }
}

/// Returns the children of all threads of a process, ended ones that were not reaped included.
fn children(pid: &str) -> Vec<String> {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).into_iter();
    let of = threads.flatten().filter_map(|thread| {
        let children = thread.ok()?.path().join("children");
        std::fs::read_to_string(children).ok()
    });
    let of = of.flat_map(|list| {
        let pids = list.split_whitespace().map(str::to_owned);
        pids.collect::<Vec<_>>()
    });
    of.collect()
}

fn service(test: &str) -> String {
    format!("service-{test}-{}", std::process::id())
}

fn client(service: &str) -> Result<Client> {
    let mut client = Client::open(service, &ClientOptions::lockstep())?;
    client.describe(Basis::Polyline, Precision::F32, &[-4, -4])?;
    Ok(client)
}

/// Publishes a frame and waits for its verdict.
fn step(client: &mut Client, frame: u64) -> Result<Outcome> {
    let seq = client.publish(frame as f64, Positions::F32(&squares(0.0)))?;
    client.wait(seq, PATIENCE)
}

#[track_caller]
fn assert_intact(outcome: Outcome) {
    let intact = matches!(&outcome, Outcome::Verdict(v) if v.verdict == Verdict::Intact);
    assert!(intact, "{outcome:?}");
}

/// The simulator that [`Process1::simulator`] starts: three frames, a pause, and more frames.
fn simulate(service: &str) -> Result<()> {
    let mut sim = client(service)?;
    sim.wait_for_watcher(PATIENCE)?;
    for frame in 0..10_000 {
        if frame == 3 {
            std::thread::sleep(SILENCE);
        }
        assert_intact(step(&mut sim, frame)?);
        std::thread::sleep(Duration::from_millis(2));
    }
    Ok(())
}

fn as_process_1_a_watch_starts_no_process_and_ends_on_sigterm() -> std::result::Result<(), Failed> {
    let folder = TempDir::new()?;
    let service = service("end");
    let recording = folder.path().join("run.mcap");
    let args = [
        "--keep-watching",
        "--metrics",
        "0",
        "--record",
        text(&recording),
    ];
    let watch = Process1::watch(folder.path(), &service, &args);
    let mut sim = client(&service)?;
    assert!(sim.wait_for_watcher(PATIENCE)?);
    for frame in 0..5 {
        assert_intact(step(&mut sim, frame)?);
    }
    // So it has nothing to reap, not even a process that has ended.
    assert_eq!(children(&watch.pid), [""; 0]);
    watch.signal("TERM");
    let (code, stdout, stderr) = watch.end();
    assert_eq!(code, Some(0), "{stderr}");
    assert!(stdout.contains("intact: 5 frames verified"), "{stdout}");
    assert!(stderr.contains("stopped by a signal"), "{stderr}");
    let replayed = linkwatch(&["replay", text(&recording)]);
    assert_eq!(replayed.code, 0, "{}", replayed.stderr);
    // The goodbye arrived.
    let outcome = step(&mut sim, 5)?;
    assert_eq!(outcome, Outcome::NoWatcher(Departure::Goodbye));
    Ok(())
}

fn as_process_1_a_watch_without_a_simulator_ends_on_sigint() -> std::result::Result<(), Failed> {
    let folder = TempDir::new()?;
    let watch = Process1::watch(folder.path(), &service("alone"), &[]);
    watch.signal("INT");
    let (code, _, stderr) = watch.end();
    assert_eq!(code, Some(3), "{stderr}");
    Ok(())
}

/// Each one is process 1 of its own namespace, as in two containers that share `/dev/shm` and
/// `/tmp/iceoryx2`.
fn simulator_and_watch_of_two_containers_see_one_another() -> std::result::Result<(), Failed> {
    let folder = TempDir::new()?;
    let service = service("apart");
    let watch = Process1::watch(folder.path(), &service, &["--json"]);
    let simulator = Process1::simulator(folder.path(), &service);
    // The watch has checked meanwhile that the silent simulator lives.
    until("a frame after the pause", || {
        let lines = std::fs::read_to_string(&watch.stdout).unwrap();
        lines.contains("\"seq\":10,").then_some(())
    });
    let log = watch.log_with("a simulator connected");
    assert!(!log.contains("the simulator died"), "{log}");
    simulator.signal("KILL");
    let (code, _, stderr) = watch.end();
    assert_eq!(code, Some(3), "{stderr}");
    assert!(
        stderr.contains("the simulator died without ending the session"),
        "{stderr}"
    );
    Ok(())
}

fn a_simulator_notices_that_the_watch_in_a_container_was_killed() -> std::result::Result<(), Failed>
{
    let folder = TempDir::new()?;
    let service = service("killed");
    let watch = Process1::watch(folder.path(), &service, &[]);
    let mut sim = client(&service)?;
    assert!(sim.wait_for_watcher(PATIENCE)?);
    assert_intact(step(&mut sim, 0)?);
    watch.signal("KILL");
    watch.end();
    let outcome = step(&mut sim, 1)?;
    assert_eq!(outcome, Outcome::NoWatcher(Departure::Crashed));
    Ok(())
}

/// Returns a file of `examples/service`.
fn recipe(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/service");
    std::fs::read_to_string(folder.join(name)).unwrap()
}

/// Returns the rest of the line that begins with this key.
fn value<'a>(text: &'a str, key: &str) -> &'a str {
    let found = text.lines().find_map(|line| line.strip_prefix(key));
    found.unwrap_or_else(|| panic!("no {key}"))
}

/// Runs the command line of a recipe without a simulator, at a free port and in another folder.
fn assert_starts(line: &[&str]) {
    let folder = TempDir::new().unwrap();
    let state = text(&folder.path().join("watch.state")).to_owned();
    let free = |word: &&str| match *word {
        "/var/lib/linkwatch/watch.state" => state.clone(),
        "9464" => "0".to_owned(),
        "0.0.0.0:9464" => "127.0.0.1:0".to_owned(),
        word => word.to_owned(),
    };
    let (program, args) = line.split_first().expect("a program");
    assert!(program.ends_with("linkwatch"), "{line:?}");
    assert!(line.iter().any(|word| word.ends_with("9464")), "{line:?}");
    let run = command()
        .args(args.iter().map(free))
        .args(["--wait", "0.2", "--service", &service("recipe")])
        .output()
        .unwrap();
    let log = String::from_utf8(run.stderr).unwrap();
    assert_eq!(run.status.code(), Some(3), "{log}");
    assert!(log.contains("metrics are at http://127.0.0.1:"), "{log}");
    assert!(
        log.contains("no simulator connected within the limit of --wait"),
        "{log}"
    );
}

fn the_command_lines_of_the_recipes_start_a_watch() -> std::result::Result<(), Failed> {
    let unit = recipe("linkwatch.service").replace("\\\n", "");
    let line: Vec<&str> = value(&unit, "ExecStart=").split_whitespace().collect();
    assert_starts(&line);
    let dockerfile = recipe("Dockerfile");
    let words = ["ENTRYPOINT ", "CMD "]
        .map(|key| -> Vec<String> { serde_json::from_str(value(&dockerfile, key)).unwrap() });
    let line: Vec<&str> = words.iter().flatten().map(String::as_str).collect();
    assert_starts(&line);
    Ok(())
}

fn systemd_finds_nothing_wrong_in_the_unit() -> std::result::Result<(), Failed> {
    let folder = TempDir::new()?;
    let unit = folder.path().join("linkwatch.service");
    let program = command().get_program().to_str().unwrap().to_owned();
    let text = recipe("linkwatch.service").replace("/usr/local/bin/linkwatch", &program);
    std::fs::write(&unit, text)?;
    let verified = Command::new("systemd-analyze")
        .args(["verify", "--man=no"])
        .arg(&unit)
        .output()?;
    // Unknown keys are warnings, with exit code 0.
    let said = [verified.stdout, verified.stderr].concat();
    let said = String::from_utf8(said)?;
    assert!(verified.status.success() && said.is_empty(), "{said}");
    Ok(())
}

fn main() {
    if let Ok(service) = std::env::var(SERVICE) {
        simulate(&service).expect("the simulation");
        return;
    }
    let permitted = permitted().is_some();
    if !permitted {
        eprintln!("pid namespaces are not permitted (`unshare --pid`): tests are ignored");
    }
    let systemd = Command::new("systemd-analyze").arg("--version").output();
    let systemd = systemd.is_ok_and(|run| run.status.success());
    let mut trials = Vec::new();
    macro_rules! add {
        ($($name:ident if $present:expr),* $(,)?) => {$(
            trials.push(trial(stringify!($name), $present, $name));
        )*};
    }
    add!(
        the_command_lines_of_the_recipes_start_a_watch if true,
        systemd_finds_nothing_wrong_in_the_unit if systemd,
        as_process_1_a_watch_starts_no_process_and_ends_on_sigterm if permitted,
        as_process_1_a_watch_without_a_simulator_ends_on_sigint if permitted,
        simulator_and_watch_of_two_containers_see_one_another if permitted,
        a_simulator_notices_that_the_watch_in_a_container_was_killed if permitted,
    );
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
