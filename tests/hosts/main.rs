//! Simulator and watch on two hosts: two network namespaces with shared memory of their own, joined
//! by the zenoh tunnel of iceoryx2 (`docs/guide/hosts.md`).
//!
//! The tests are shown as ignored, never as passed, if namespaces are not permitted or the tunnel
//! is not found: `iox2-tunnel-zenoh` in PATH, or the program that `LINKWATCH_TUNNEL` names.
//!
//! `cargo test --release --test hosts -- --ignored latency --nocapture` measures the time from a
//! frame to its verdict on two hosts and on one.

#[path = "../support/mod.rs"]
mod support;

use libtest_mimic::{Arguments, Failed, Trial};
use linkwatch::{
    Basis, Client, ClientOptions, Outcome, Positions, Precision, Verdict, VerdictMessage,
};
use serde_json::Value;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use support::polygons::squares;
use support::time::{LONG, PATIENCE};
use support::trial::trial;
use tempfile::TempDir;

/// Runs this program as a simulator.
const ROLE: &str = "LINKWATCH_TEST_SIMULATOR";

/// Namespaces in which the script is root, and whose processes end with it.
const NAMESPACES: [&str; 8] = [
    "--user",
    "--map-root-user",
    "--net",
    "--mount",
    "--pid",
    "--fork",
    "--kill-child",
    "--mount-proc",
];

fn main() {
    if let Ok(role) = std::env::var(ROLE) {
        return match role.as_str() {
            "too-large" => too_large(),
            "pulled" => pulled(),
            "until-silent" => until_silent(),
            "small" => latency("120 bytes", 5, 300),
            "large" => latency("1 MB", 43_690, 100),
            role => panic!("no simulator {role}"),
        };
    }
    let tunnel = tunnel();
    let permitted = Command::new("unshare")
        .args(NAMESPACES)
        .arg("true")
        .output();
    let permitted = permitted.is_ok_and(|output| output.status.success());
    let present = permitted && tunnel.is_some();
    if !present {
        let what = if permitted {
            "the tunnel"
        } else {
            "the permission for namespaces"
        };
        eprintln!("tests between hosts are ignored: {what} is missing");
    }
    let with = |run: fn(&str) -> Result<(), Failed>| {
        let tunnel = tunnel.clone().unwrap_or_default();
        move || run(&tunnel)
    };
    let mut trials = vec![
        trial(
            "a_pull_through_stops_a_simulator_on_another_host",
            present,
            with(abort),
        ),
        trial(
            "no_frame_is_intact_once_the_link_is_down",
            present,
            with(cut),
        ),
    ];
    trials.push(trial(
        "a_frame_that_does_not_fit_into_shared_memory_is_an_error",
        permitted,
        small_memory,
    ));
    let measure = with(measure);
    trials.push(Trial::test("latency", measure).with_ignored_flag(true));
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

/// Returns the tunnel, if there is one.
fn tunnel() -> Option<String> {
    let program = std::env::var("LINKWATCH_TUNNEL").unwrap_or("iox2-tunnel-zenoh".into());
    let version = Command::new(&program).arg("--version").output();
    version.is_ok_and(|v| v.status.success()).then_some(program)
}

/// What a run printed.
struct Run {
    sim: String,
    watch: Vec<Value>,
    log: String,
}

/// Runs a simulator of this program on `one` host or `two`. The link goes down after some seconds
/// if `cut` gives them.
fn run(tunnel: &str, hosts: &str, simulator: &str, cut: &[&str]) -> Result<Run, Failed> {
    let folder = TempDir::new()?;
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/hosts/two_hosts.sh");
    let program = std::env::current_exe()?;
    let output = Command::new("unshare")
        .args(NAMESPACES)
        .arg("sh")
        .arg(script)
        .args([folder.path().to_str().expect("UTF-8"), hosts])
        .arg(program.to_str().expect("UTF-8"))
        .args(cut)
        .env("LINKWATCH", env!("CARGO_BIN_EXE_linkwatch"))
        .env("TUNNEL", tunnel)
        .env(ROLE, simulator)
        .output()?;
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap_or_default();
    let (sim, log) = (read("sim.out"), read("watch.err"));
    if !output.status.success() {
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        return Err(format!("{errors}\nsimulator: {sim}\nwatch: {log}").into());
    }
    let lines = read("watch.out");
    let lines = lines.lines().map(serde_json::from_str);
    Ok(Run {
        sim,
        watch: lines.collect::<Result<_, _>>()?,
        log,
    })
}

fn abort(tunnel: &str) -> Result<(), Failed> {
    let run = run(tunnel, "two", "pulled", &[])?;
    let summary = &run.watch.last().ok_or("no summary")?["summary"];
    assert_eq!(summary["verdict"], "changed", "{}", run.log);
    assert_eq!(summary["first_violation"]["frame"], 20, "{summary}");
    assert!(run.sim.contains("stopped at frame 20"), "{}", run.sim);
    Ok(())
}

fn cut(tunnel: &str) -> Result<(), Failed> {
    let run = run(tunnel, "two", "until-silent", &["3"])?;
    let [intact, after] = ["intact ", "later "].map(|word| {
        let rest = run.sim.split(word).nth(1).expect("a count");
        rest.split_whitespace()
            .next()
            .and_then(|n| n.parse::<u64>().ok())
    });
    assert!(intact > Some(20), "{}", run.sim);
    assert_eq!(after, Some(0), "{}", run.sim);
    let reports = run.watch.iter().filter(|line| line.get("report").is_some());
    let verified = reports.count() as u64;
    // The verdict on the last frame may be lost as well.
    assert!(Some(verified) >= intact, "{}", run.log);
    Ok(())
}

fn measure(tunnel: &str) -> Result<(), Failed> {
    for size in ["small", "large"] {
        for hosts in ["one", "two", "one", "two"] {
            let run = run(tunnel, hosts, size, &[])?;
            println!("{hosts}: {}", run.sim.trim());
        }
    }
    Ok(())
}

/// Publishes frames into a `/dev/shm` of 64 MB, as containers have it.
fn small_memory() -> Result<(), Failed> {
    let script = "mount -t tmpfs -o size=64m tmpfs /dev/shm; mkdir -p /tmp/iceoryx2
        mount -t tmpfs tmpfs /tmp/iceoryx2; exec \"$0\"";
    let output = Command::new("unshare")
        .args(NAMESPACES)
        .args(["sh", "-c", script])
        .arg(std::env::current_exe()?)
        .env(ROLE, "too-large")
        .output()?;
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "{}: {printed}{errors}",
        output.status
    );
    let words = "the shared memory /dev/shm is too small: 96.0 MB are needed";
    assert!(
        printed.contains(words) && printed.contains("--shm-size=960m"),
        "{printed}"
    );
    Ok(())
}

/// Publishes frames that fit, and prints the error of those that do not.
fn too_large() {
    for (service, points) in [("small", 1_000), ("large", 8_000_000), ("small", 1_000)] {
        let mut client = Client::open(service, &ClientOptions::default()).expect("a client");
        client
            .describe(Basis::Polyline, Precision::F32, &[-points])
            .expect("curves");
        let positions = vec![0.0; 3 * points as usize];
        for _ in 0..3 {
            match client.publish(0.0, Positions::F32(&positions)) {
                Ok(_) => assert_eq!(service, "small"),
                Err(e) => println!("{service}: {e}"),
            }
        }
    }
}

fn client(options: &ClientOptions, counts: &[i32]) -> Client {
    let mut client = Client::open("linkwatch", options).expect("a client");
    client
        .describe(Basis::Polyline, Precision::F32, counts)
        .expect("curves");
    assert!(
        client.wait_for_watcher(PATIENCE).expect("the bus"),
        "no watcher came"
    );
    client
}

fn verdict(client: &mut Client, positions: &[f32]) -> VerdictMessage {
    let seq = client
        .publish(0.0, Positions::F32(positions))
        .expect("sent");
    match client.wait(seq, PATIENCE).expect("the bus") {
        Outcome::Verdict(message) => *message,
        other => panic!("frame {seq}: {other:?}"),
    }
}

/// Pulls a square out of another one.
fn pulled() {
    let mut client = client(&ClientOptions::lockstep(), &[-4, -4]);
    for frame in 0.. {
        let shift = if frame < 20 { frame as f32 * 0.01 } else { 3.0 };
        let message = verdict(&mut client, &squares(shift));
        assert_eq!(
            message.verdict == Verdict::Intact,
            frame < 20,
            "frame {frame}"
        );
        if client.aborted().is_some() {
            println!("stopped at frame {frame}");
            break;
        }
    }
    client
        .finish_within(LONG)
        .expect("the bus")
        .expect("the goodbye");
}

/// Publishes frames until one gets no verdict, and then three more.
fn until_silent() {
    let mut client = client(&ClientOptions::lockstep(), &[-4, -4]);
    let mut step = |frame: u64| {
        let positions = squares((frame % 50) as f32 * 0.01);
        let seq = client
            .publish(0.0, Positions::F32(&positions))
            .expect("sent");
        let outcome = client.wait(seq, Duration::from_secs(3)).expect("the bus");
        matches!(outcome, Outcome::Verdict(message) if message.verdict == Verdict::Intact)
    };
    let intact = (0..).take_while(|&frame| step(frame)).count();
    let later = (0..3).filter(|&frame| step(frame)).count();
    println!("intact {intact} frames, later {later} frames");
}

/// Prints the time from a frame of two rings of some points to its verdict.
fn latency(name: &str, points: i32, frames: usize) {
    let mut client = client(&ClientOptions::lockstep(), &[-points, -points]);
    let ring = |z: f32| {
        (0..points).flat_map(move |k| {
            let (sin, cos) = (std::f32::consts::TAU * k as f32 / points as f32).sin_cos();
            [cos, sin, z]
        })
    };
    let mut times = Vec::new();
    for frame in 0..frames {
        let positions: Vec<f32> = ring(0.0).chain(ring(1.0 + 1e-6 * frame as f32)).collect();
        let start = Instant::now();
        let message = verdict(&mut client, &positions);
        times.push(start.elapsed().as_secs_f64() * 1e3);
        assert_eq!(message.verdict, Verdict::Intact);
    }
    times.sort_by(f64::total_cmp);
    let [median, p99] = [0.5, 0.99].map(|q| times[(q * frames as f64) as usize]);
    println!("{name}: median {median:.3} ms, 99th percentile {p99:.3} ms");
    client.finish_within(LONG).expect("the bus");
}
