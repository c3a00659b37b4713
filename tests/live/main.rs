//! Tests of `linkwatch watch` as a process, with simulators in this process or in processes that
//! are killed.

mod baseline;
mod cells;
mod clearance;
mod closing;
mod curves;
mod diff;
mod exposition;
mod faults;
mod keep;
mod metrics;
mod play;
mod recordings;
mod roles;
mod services;
mod sessions;
mod soak;
mod state;
mod streams;
#[path = "../support/mod.rs"]
mod support;
mod verdicts;
mod written;

use linkwatch::{Basis, Client, ClientOptions, Outcome, Positions, Precision, Verdict};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;
use support::command::{command, linkwatch};
use support::polygons::squares;
use support::time::{LONG, PATIENCE, until, without_time_out};
use tempfile::TempDir;

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
        Watch::start_with(folder, name, service, args, command(), [None, None])
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

    /// Returns the lines with a summary.
    fn summaries(&self) -> Vec<&Value> {
        let is_summary = |l: &&Value| l.get("summary").is_some();
        self.lines.iter().filter(is_summary).collect()
    }

    /// Asserts that a replay reported no verdict that differs from the recorded one.
    #[track_caller]
    fn assert_recorded_verdicts(&self) {
        assert!(!self.stderr.contains("different from"), "{}", self.stderr);
    }
}

/// Runs `linkwatch replay --json`.
fn replay(recording: &Path) -> Ended {
    replay_with(recording, &[])
}

fn replay_with(recording: &Path, args: &[&str]) -> Ended {
    run_with("replay", recording, args)
}

/// Runs a command on a recording.
fn run_with(name: &str, recording: &Path, args: &[&str]) -> Ended {
    let run = command()
        .args([name, "--json"])
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
    until("the end of the process", || process.try_wait().unwrap())
}

/// Starts a process with a simulator, which runs until it is killed.
fn simulator_to_be_killed(service: &str) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--ignored", "--exact", "sessions::simulator_to_be_killed"])
        .env("LINKWATCH_TEST_SERVICE", service)
        .stdout(Stdio::null())
        .spawn()
        .unwrap()
}

/// Waits until a watch has printed as many lines.
fn lines_of(watch: &Watch, lines: usize) {
    until(format_args!("{lines} lines"), || {
        let printed = std::fs::read_to_string(&watch.stdout).unwrap();
        (printed.lines().count() >= lines).then_some(())
    });
}

fn client(service: &str) -> Client {
    let mut client = Client::open(service, &ClientOptions::lockstep()).unwrap();
    client
        .describe(Basis::Polyline, Precision::F32, &[-4, -4])
        .unwrap();
    client
}

/// Returns two open strands in several positions. One moves around the end of the other without
/// contact. The straight path from the first position to the last one passes through the other
/// strand.
fn around_an_end() -> [Vec<f32>; 4] {
    [[-1.0, 0.0], [-1.0, 2.0], [1.0, 2.0], [1.0, 0.0]].map(|[x, z]| {
        let ends = [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [x, -1.0, z], [x, 1.0, z]];
        ends.concat()
    })
}

/// Publishes a frame and waits for its verdict.
fn step(client: &mut Client, frame: u64, shift: f32) -> Verdict {
    verdict_on(client, frame as f64 * 0.1, &squares(shift))
}

/// Publishes positions and waits for the verdict on them.
fn verdict_on(client: &mut Client, time: f64, positions: &[f32]) -> Verdict {
    let seq = client.publish(time, Positions::F32(positions)).unwrap();
    match client.wait(seq, PATIENCE).unwrap() {
        Outcome::Verdict(m) => m.verdict,
        other => panic!("frame {seq}: {other:?}"),
    }
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

/// Folder of the recordings in the project, with the reports that a replay must give.
fn recordings() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings")
}

/// Runs the command without `--json`. Returns its exit code and its output.
fn printed(args: &[&str]) -> (Option<i32>, String) {
    let run = linkwatch(args);
    (Some(run.code), run.stdout + &run.stderr)
}

/// Returns the stderr of a watch, once it contains all of these words.
fn stderr_with(watch: &Watch, words: &[&str]) -> String {
    until(format_args!("the words {words:?}"), || {
        let stderr = std::fs::read_to_string(&watch.stderr).unwrap();
        let all = words.iter().all(|word| stderr.contains(word));
        all.then_some(stderr)
    })
}
