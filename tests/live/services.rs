//! Services: wrong names, silent simulators, other versions.

use super::*;
use iceoryx2::prelude::ZeroCopySend;
use std::sync::Arc;

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
    /// All other fields: 180 bytes, in arrays that have a default value.
    rest: [u32; 31],
    more: [u32; 14],
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
