//! The list of live services: only those of linkwatch and of living processes, without side
//! effects.

use super::death::Process;
use super::*;
use iceoryx2::prelude::*;
use linkwatch::{ServiceInfo, services};
use std::sync::Arc;

fn find(name: &str) -> Option<ServiceInfo> {
    let all = services().expect("services");
    assert!(all.is_sorted_by(|a, b| a.service < b.service));
    all.into_iter().find(|s| s.service == name)
}

/// Returns the process ids of the simulator and of the watcher.
fn roles(name: &str) -> Option<[Option<u32>; 2]> {
    find(name).map(|s| [s.simulator, s.watcher].map(|a| a.map(|a| a.process)))
}

#[test]
fn a_service_is_listed_with_its_simulator_and_its_watcher() {
    let name = service();
    let own = Some(std::process::id());
    assert_eq!(roles(&name), None);
    let watcher = sidecar(&name);
    assert_eq!(roles(&name), Some([None, own]));
    let simulator = client(&name);
    assert_eq!(roles(&name), Some([own, own]));
    let found = find(&name).unwrap();
    assert!(found.compatible && found.others.is_empty(), "{found:?}");
    let words = found.to_string();
    let expected = format!("{name}: simulator (process {}, bus-", std::process::id());
    assert!(words.starts_with(&expected), "{words}");
    drop(watcher);
    assert_eq!(roles(&name), Some([own, None]));
    assert!(find(&name).unwrap().to_string().ends_with(", no watcher"));
    drop(simulator);
    assert_eq!(roles(&name), None);
}

/// Regression test: a restarted watch waited for this simulator.
#[test]
fn a_simulator_that_has_ended_is_not_listed_while_its_memory_is_used() {
    let name = service();
    let mut simulator = client(&name);
    publish(&mut simulator, 0);
    let memory = simulator.begin(0.0).unwrap();
    simulator.finish().unwrap();
    assert_eq!(roles(&name), None);
    let watcher = sidecar(&name);
    assert_eq!(roles(&name), Some([None, Some(std::process::id())]));
    assert!(find(&name).unwrap().others.is_empty());
    drop((watcher, memory));
}

#[test]
fn a_rejected_simulator_does_not_replace_the_first_in_the_list() {
    let name = service();
    let simulator = Process::start("silent simulator", &name, None);
    let first = until("a process in the list", || {
        roles(&name).filter(|r| r[0].is_some())
    });
    let refused = std::thread::spawn({
        let name = name.clone();
        move || Client::open(&name, &ClientOptions::default()).is_err()
    });
    while !refused.is_finished() {
        assert_eq!(roles(&name), Some(first));
    }
    assert!(refused.join().unwrap());
    simulator.kill();
}

#[test]
fn a_killed_process_is_not_listed() {
    let name = service();
    let simulator = Process::start("silent simulator", &name, None);
    until("a process in the list", || {
        roles(&name).filter(|r| r[0].is_some())
    });
    simulator.kill();
    // Its files still exist, because no process has opened the service since.
    assert_eq!(roles(&name), None);

    let watcher = Process::start("watcher", &name, None);
    until("a process in the list", || {
        roles(&name).filter(|r| r[1].is_some())
    });
    let simulator = client(&name);
    watcher.kill();
    assert_eq!(roles(&name), Some([Some(std::process::id()), None]));
    drop(simulator);
}

/// Regression test: later processes waited forever, even on other services.
#[test]
#[cfg(target_os = "linux")]
fn a_process_killed_while_it_creates_a_service_stops_no_other() {
    let name = service();
    let simulator = Process::start("silent simulator", &name, None);
    until("a process in the list", || {
        roles(&name).filter(|r| r[0].is_some())
    });
    let node = NodeBuilder::new().create::<ipc::Service>().unwrap();
    let frames = ServiceName::new(&format!("{name}/frames")).unwrap();
    let events = until("the events of frames", || {
        node.service_builder(&frames).event().open().ok()
    });
    let hash = events.service_hash().as_str().to_owned();
    drop(events);
    simulator.kill();
    let end = format!("{hash}.dynamic");
    let files = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let is_its = |path: &std::path::PathBuf| path.to_string_lossy().ends_with(&end);
    let memory = files.map(|file| file.path()).find(is_its).unwrap();
    // The memory has size 0 between its creation and its first resize.
    std::fs::File::create(&memory).unwrap();
    let other = service();
    let done = std::thread::spawn(move || {
        assert_eq!(roles(&name), None);
        drop(client(&name));
        drop(client(&other));
    });
    until("the end of the thread", || done.is_finished().then_some(()));
    done.join().unwrap();
}

#[test]
fn a_stopped_process_is_listed() {
    let name = service();
    let simulator = Process::start("silent simulator", &name, None);
    let found = until("a process in the list", || {
        roles(&name).filter(|r| r[0].is_some())
    });
    simulator.stop();
    assert_eq!(roles(&name), Some(found));
    simulator.kill();
}

/// Services with the names and the messaging patterns of linkwatch, but with other types.
#[test]
fn services_of_other_programs_are_ignored() {
    let name = service();
    let node = NodeBuilder::new().create::<ipc::Service>().unwrap();
    let part = |part: &str| ServiceName::new(&format!("{name}/{part}")).unwrap();
    let (frames, lock) = (part("frames"), part("simulator"));
    let frames = node.service_builder(&frames).publish_subscribe::<[u8]>();
    let frames = frames.user_header::<u64>().create().unwrap();
    let lock = node.service_builder(&lock).request_response::<u64, u64>();
    let lock = lock.create().unwrap();
    assert_eq!(find(&name), None);
    drop((frames, lock));
}

/// A header of another version of linkwatch.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, ZeroCopySend)]
#[type_name("linkwatch.FrameHeader")]
struct LaterHeader([u64; 9]);

#[test]
fn a_service_of_another_version_is_reported_with_its_process() {
    let name = service();
    let node = NodeBuilder::new().create::<ipc::Service>().unwrap();
    let frames = ServiceName::new(&format!("{name}/frames")).unwrap();
    let frames = node.service_builder(&frames).publish_subscribe::<[u8]>();
    let frames = frames.user_header::<LaterHeader>().create().unwrap();
    let found = find(&name).expect("a service of linkwatch");
    assert!(!found.compatible);
    assert_eq!(found.others.len(), 1);
    let words = found.to_string();
    assert!(words.contains("another version of linkwatch"), "{words}");
    let e = Client::open(&name, &ClientOptions::default()).unwrap_err();
    let words = e.to_string();
    let process = format!("(process {}, ", std::process::id());
    assert!(words.contains(&process), "{words}");
    drop(frames);
}

#[test]
fn the_list_does_not_disturb_a_session() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    let listed = Arc::new(AtomicU32::new(0));
    let lists = listed.clone();
    let simulator = std::thread::spawn(move || {
        assert!(client.wait_for_watcher(PATIENCE).unwrap());
        let mut seq = 0;
        until("300 frames and 3 lists", || {
            for _ in 0..100 {
                publish(&mut client, seq);
                let outcome = client.wait(seq, PATIENCE).unwrap();
                assert!(matches!(outcome, linkwatch::Outcome::Verdict(_)));
                seq += 1;
            }
            (seq >= 300 && lists.load(Ordering::Relaxed) >= 3).then_some(())
        });
        client.finish().unwrap()
    });
    let watcher = std::thread::spawn(move || watch_to_the_end(&mut sidecar, Duration::ZERO));
    while !watcher.is_finished() {
        listed.fetch_add(u32::from(find(&name).is_some()), Ordering::Relaxed);
    }
    let (published, counters, clean) = watcher.join().unwrap();
    assert!(clean);
    assert_eq!(published, simulator.join().unwrap());
    assert_eq!(counters.verified, published);
}
