//! Processes that are killed, stopped and restarted. This test program runs itself as a child.

use super::lockstep::step;
use super::*;
use linkwatch::{Departure, Outcome};
use std::fs;
use std::path::Path;
use std::process::{Child, Command};
use std::time::Instant;

const ROLE: &str = "LINKWATCH_TEST_ROLE";
const SERVICE: &str = "LINKWATCH_TEST_SERVICE";

/// Entry point of child processes.
#[test]
#[ignore = "not a test, but the processes of others"]
fn child() {
    let (Ok(role), Ok(name)) = (std::env::var(ROLE), std::env::var(SERVICE)) else {
        return;
    };
    match role.as_str() {
        "simulator" => {
            let mut client = client(&name);
            for seq in 0.. {
                publish(&mut client, seq);
                std::thread::sleep(Duration::from_millis(5));
            }
        }
        "silent simulator" => {
            let mut client = client(&name);
            publish(&mut client, 0);
            std::thread::sleep(PATIENCE);
        }
        "watcher" => {
            let mut sidecar = sidecar(&name);
            let mut set = None;
            loop {
                if let Event::Frame(frame) = next(&mut sidecar) {
                    answer(&mut sidecar, &frame, &mut set);
                }
            }
        }
        "slow watcher" => {
            let mut sidecar = sidecar(&name);
            let mut set = None;
            loop {
                if let Event::Frame(frame) = next(&mut sidecar) {
                    std::thread::sleep(Duration::from_millis(1500));
                    answer(&mut sidecar, &frame, &mut set);
                }
            }
        }
        "both, once" => {
            let mut sidecar = sidecar(&name);
            let mut client = client(&name);
            publish(&mut client, 0);
            new_session(&mut sidecar);
            for seq in 1..10 {
                publish(&mut client, seq);
            }
            client.finish().unwrap();
            watch_to_the_end(&mut sidecar, Duration::ZERO);
        }
        other => panic!("no role {other}"),
    }
}

/// A child that is killed when its test ends.
pub struct Process(Child);

impl Process {
    pub fn start(role: &str, service: &str, folder: Option<&Path>) -> Process {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--ignored", "--exact", "death::child"]);
        command.env(ROLE, role).env(SERVICE, service);
        command.stdout(std::process::Stdio::null());
        if let Some(folder) = folder {
            command.current_dir(folder);
        }
        Process(command.spawn().unwrap())
    }

    /// Sends SIGKILL, and waits until the process has ended.
    pub fn kill(mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }

    fn finish(mut self) {
        assert!(self.0.wait().unwrap().success());
    }

    pub fn signal(&self, signal: &str) {
        let pid = self.0.id().to_string();
        let sent = Command::new("kill").args([signal, &pid]).status();
        assert!(sent.unwrap().success());
    }

    /// Sends SIGSTOP, and waits until the process has stopped.
    pub fn stop(&self) {
        self.signal("-STOP");
        std::thread::sleep(Duration::from_millis(50));
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_killed_simulator_is_detected_and_another_one_works() {
    let name = service();
    let mut sidecar = sidecar(&name);
    for role in ["simulator", "silent simulator", "simulator"] {
        let simulator = Process::start(role, &name, None);
        let session = new_session(&mut sidecar);
        let mut frames = 0;
        while frames < if role == "simulator" { 5 } else { 1 } {
            let frame = next_frame(&mut sidecar);
            frame.ingest(&mut None).unwrap();
            frames += 1;
        }
        simulator.kill();
        loop {
            match next(&mut sidecar) {
                Event::Frame(_) => {}
                Event::SimulatorLost { session: lost, .. } => {
                    assert_eq!(lost, session);
                    break;
                }
                other => panic!("{other:?}"),
            }
        }
    }
    let mut client = client(&name);
    publish(&mut client, 0);
    new_session(&mut sidecar);
    client.finish().unwrap();
    let (published, counters, clean) = watch_to_the_end(&mut sidecar, Duration::ZERO);
    assert_eq!((published, counters.verified, clean), (1, 1, true));
}

#[test]
fn a_living_but_silent_simulator_is_not_lost() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let simulator = Process::start("silent simulator", &name, None);
    new_session(&mut sidecar);
    next_frame(&mut sidecar);
    let start = Instant::now();
    while start.elapsed() < Duration::from_millis(1300) {
        let event = sidecar.wait(Duration::from_millis(100)).unwrap();
        assert!(matches!(event, Event::Idle), "{event:?}");
    }
    drop(simulator);
}

#[test]
fn a_killed_watcher_never_blocks_the_simulator() {
    let name = service();
    let mut client = client(&name);
    let mut seq = 0;
    let mut publish_next = |client: &mut Client| {
        publish(client, seq);
        seq += 1;
        client.poll().unwrap()
    };
    for _ in 0..3 {
        let watcher = Process::start("watcher", &name, None);
        until("a verdict", || publish_next(&mut client));
        // A stopped watcher is worse than a dead one, because its queues fill up.
        watcher.stop();
        without_time_out("publishing to a stopped watcher", || {
            (0..500).for_each(|_| _ = publish_next(&mut client));
        });
        watcher.kill();
        without_time_out("publishing to a killed watcher", || {
            (0..500).for_each(|_| _ = publish_next(&mut client));
        });
        while client.poll().unwrap().is_some() {}
    }
}

/// Publishes frames until one is verified.
fn until_verified(client: &mut Client, seq: &mut u64) {
    until("a verdict", || {
        publish(client, *seq);
        *seq += 1;
        let outcome = client.wait(*seq - 1, PATIENCE).unwrap();
        matches!(outcome, Outcome::Verdict(_)).then_some(())
    });
}

#[test]
fn a_killed_watcher_ends_a_lockstep_wait_long_before_its_deadline() {
    let name = service();
    // The first watcher starts before the simulator, the later ones after it.
    let mut watcher = Process::start("watcher", &name, None);
    std::thread::sleep(Duration::from_millis(200));
    let mut client = client(&name);
    let mut seq = 0;
    for round in 0..4 {
        until_verified(&mut client, &mut seq);
        if round % 2 == 1 {
            // The watcher stops some time before the simulator begins to wait.
            watcher.stop();
            publish(&mut client, seq);
            seq += 1;
        }
        watcher.kill();
        for _ in 0..3 {
            let outcome = step(&mut client, seq);
            assert_eq!(outcome, Outcome::NoWatcher(Departure::Crashed));
            seq += 1;
        }
        watcher = Process::start("watcher", &name, None);
    }
    until_verified(&mut client, &mut seq);
    watcher.kill();
    assert!(!client.wait_for_watcher(Duration::from_millis(600)).unwrap());
    let goodbye = without_time_out("the end", || client.finish_within(LONG));
    assert_eq!(goodbye.unwrap(), None);
}

#[test]
fn the_end_of_a_session_does_not_wait_for_a_killed_watcher() {
    let name = service();
    let watcher = Process::start("watcher", &name, None);
    let mut client = client(&name);
    until_verified(&mut client, &mut 0);
    watcher.kill();
    let goodbye = without_time_out("the end", || client.finish_within(LONG));
    assert_eq!(goodbye.unwrap(), None);
}

#[test]
fn a_stopped_or_slow_watcher_does_not_count_as_dead() {
    let name = service();
    let mut client = client(&name);
    let slow = Process::start("slow watcher", &name, None);
    for seq in 0..2 {
        publish(&mut client, seq);
        let outcome = client.wait(seq, PATIENCE).unwrap();
        assert!(matches!(outcome, Outcome::Verdict(m) if m.seq == seq));
    }
    slow.stop();
    publish(&mut client, 2);
    let patience = Duration::from_millis(1500);
    assert_eq!(client.wait(2, patience).unwrap(), Outcome::Stale);
    slow.signal("-CONT");
    let outcome = client.wait(2, PATIENCE).unwrap();
    assert!(matches!(outcome, Outcome::Verdict(m) if m.seq == 2));
}

/// Files of a separate configuration, with its own prefix and root.
struct Files {
    folder: tempfile::TempDir,
    prefix: String,
}

impl Files {
    fn new() -> Files {
        let folder = tempfile::tempdir().unwrap();
        let prefix = format!("lwt{}_", std::process::id());
        fs::create_dir(folder.path().join("config")).unwrap();
        let root = folder.path().join("root");
        let config = format!(
            "[global]\nroot-path = '{}/'\nprefix = '{prefix}'\n",
            root.display()
        );
        fs::write(folder.path().join("config/iceoryx2.toml"), config).unwrap();
        Files { folder, prefix }
    }

    /// Returns all files, except one of 16 bytes that iceoryx2 leaves by design.
    fn list(&self) -> Vec<String> {
        fn walk(folder: &Path, out: &mut Vec<String>) {
            for entry in fs::read_dir(folder).into_iter().flatten() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    walk(&path, out);
                } else {
                    out.push(path.display().to_string());
                }
            }
        }
        let mut out = Vec::new();
        walk(&self.folder.path().join("root"), &mut out);
        walk(Path::new("/dev/shm"), &mut out);
        let root = self.folder.path().display().to_string();
        out.retain(|f| f.contains(&self.prefix) || f.starts_with(&root));
        out.retain(|f| !f.ends_with(".global_mgmt"));
        out
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        for entry in fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry
                .file_name()
                .to_string_lossy()
                .starts_with(&self.prefix)
            {
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

#[test]
fn no_files_are_left_in_shared_memory() {
    let files = Files::new();
    let name = service();
    let folder = Some(files.folder.path());
    let start = |role| Process::start(role, &name, folder);
    start("both, once").finish();
    assert_eq!(files.list(), [""; 0], "after a clean exit");

    let (watcher, simulator) = (start("watcher"), start("simulator"));
    until("20 files", || (files.list().len() >= 20).then_some(()));
    std::thread::sleep(Duration::from_millis(200));
    watcher.kill();
    simulator.kill();
    assert!(!files.list().is_empty(), "this test lists the wrong folder");
    start("both, once").finish();
    assert_eq!(files.list(), [""; 0], "after the run that followed a kill");
}
