//! Tests of clients and watchers that wait for each other.

use super::*;
use linkwatch::{Departure, MessageKind, Outcome, WaitMode};
use std::time::Instant;

#[test]
fn each_frame_gets_its_verdict_in_every_wait_mode() {
    for simulator in WaitMode::ALL {
        for watcher in WaitMode::ALL {
            each_frame_gets_its_verdict(simulator, watcher);
        }
    }
}

fn each_frame_gets_its_verdict(simulator: WaitMode, watcher: WaitMode) {
    let name = service();
    let mut options = SidecarOptions::default();
    options.wait_mode = watcher;
    let mut sidecar = Sidecar::open(&name, &options).unwrap();
    let mut options = ClientOptions::lockstep();
    options.wait_mode = simulator;
    let mut client = Client::open(&name, &options).unwrap();
    client
        .describe(Basis::Polyline, Precision::F32, &COUNTS)
        .unwrap();
    let watcher = std::thread::spawn(move || watch_to_the_end(&mut sidecar, Duration::ZERO));
    for seq in 0..200 {
        publish(&mut client, seq);
        match client.wait(seq, PATIENCE).unwrap() {
            Outcome::Verdict(m) => {
                assert_eq!((m.kind, m.seq), (MessageKind::Verdict, seq));
                assert_eq!(m.verdict, Verdict::Intact);
                assert_eq!(m.counters.verified, seq + 1);
            }
            other => panic!("frame {seq}: {other:?}"),
        }
    }
    client.finish().unwrap();
    let (published, counters, _) = watcher.join().unwrap();
    assert_eq!((published, counters.skipped), (200, 0));
}

/// A side that spins does not read its event notifications.
#[test]
fn a_spinning_client_keeps_its_deadlines_and_its_events() {
    let name = service();
    let mut options = ClientOptions::lockstep();
    options.wait_mode = WaitMode::Spin;
    let mut client = Client::open(&name, &options).unwrap();
    client
        .describe(Basis::Polyline, Precision::F32, &COUNTS)
        .unwrap();
    let deadline = Duration::from_millis(100);
    let start = Instant::now();
    publish(&mut client, 0);
    assert_eq!(client.wait(0, deadline).unwrap(), Outcome::Stale);
    assert!(start.elapsed() >= deadline);
    let mut sidecar = sidecar(&name);
    let watcher = std::thread::spawn(move || watch_to_the_end(&mut sidecar, Duration::ZERO));
    assert!(client.wait_for_watcher(PATIENCE).unwrap());
    // More verdicts than notifications fit into the buffer of a socket.
    for seq in 1..2000 {
        publish(&mut client, seq);
        let outcome = client.wait(seq, PATIENCE).unwrap();
        assert!(matches!(outcome, Outcome::Verdict(_)), "{seq}: {outcome:?}");
    }
    client.finish().unwrap();
    let (published, counters, clean) = watcher.join().unwrap();
    assert_eq!((published, counters.skipped, clean), (2000, 0, true));
}

#[test]
fn silence_is_stale_at_the_deadline() {
    let name = service();
    let mut client = client(&name);
    let stale_after = |client: &mut Client, seq, deadline| {
        let start = Instant::now();
        let outcome = without_time_out(format_args!("a wait of {deadline:?}"), || {
            client.wait(seq, deadline)
        });
        assert_eq!(outcome.unwrap(), Outcome::Stale);
        assert!(start.elapsed() >= deadline);
    };
    publish(&mut client, 0);
    stale_after(&mut client, 0, Duration::from_millis(100));
    // Also with a watcher that does not answer.
    let sidecar = sidecar(&name);
    publish(&mut client, 1);
    stale_after(&mut client, 1, Duration::from_millis(100));
    stale_after(&mut client, 1, Duration::ZERO);
    // iceoryx2 treats a limit below a microsecond as no limit.
    for nanos in (0..5000).step_by(50) {
        stale_after(&mut client, 1, Duration::from_nanos(nanos));
    }
    drop(sidecar);
}

#[test]
fn a_skipped_frame_is_stale_at_once() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    (0..3).for_each(|seq| publish(&mut client, seq));
    new_session(&mut sidecar);
    assert_eq!([0, 2], [(); 2].map(|()| answer_next(&mut sidecar)));
    assert_eq!(client.wait(1, PATIENCE).unwrap(), Outcome::Stale);
    assert!(matches!(
        client.wait(2, PATIENCE).unwrap(),
        Outcome::Verdict(m) if m.seq == 2
    ));
}

#[test]
fn a_watcher_that_starts_while_the_simulator_waits_answers() {
    let name = service();
    let mut client = client(&name);
    publish(&mut client, 0);
    let watcher = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(100));
        watch_to_the_end(&mut sidecar(&name), Duration::ZERO)
    });
    let outcome = client.wait(0, PATIENCE).unwrap();
    assert!(matches!(outcome, Outcome::Verdict(m) if m.seq == 0));
    client.finish().unwrap();
    assert_eq!(watcher.join().unwrap().1.verified, 1);
}

#[test]
fn an_abort_is_remembered_until_the_simulator_resumes() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    let mut verdict = |client: &mut Client, seq, verdict| {
        publish(client, seq);
        loop {
            match next(&mut sidecar) {
                Event::NewSession { .. } => {}
                Event::Frame(frame) => {
                    let report = report(&frame, verdict);
                    sidecar.send_verdict(&report, Duration::ZERO).unwrap();
                    // The hello repeats the abort.
                    sidecar.heartbeat().unwrap();
                    break;
                }
                other => panic!("{other:?}"),
            }
        }
        while client.poll().unwrap().is_some() {}
        client.aborted().map(|m| m.seq)
    };
    assert_eq!(verdict(&mut client, 0, Verdict::Intact), None);
    assert_eq!(verdict(&mut client, 1, Verdict::Changed), Some(1));
    assert_eq!(verdict(&mut client, 2, Verdict::Changed), Some(1));
    client.resume();
    assert_eq!(verdict(&mut client, 3, Verdict::Intact), None);
    assert_eq!(verdict(&mut client, 4, Verdict::Changed), Some(4));
    let words = client.aborted().unwrap().to_string();
    assert_eq!(words, "frame 4: changed. Stop or roll back");
}

#[test]
fn an_abort_survives_a_full_buffer() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    for seq in 0..300 {
        publish(&mut client, seq);
        if seq == 0 {
            new_session(&mut sidecar);
        }
        let frame = next_frame(&mut sidecar);
        let verdict = if seq == 5 {
            Verdict::Changed
        } else {
            Verdict::Intact
        };
        let report = report(&frame, verdict);
        sidecar.send_verdict(&report, Duration::ZERO).unwrap();
    }
    sidecar.heartbeat().unwrap();
    let mut read = 0;
    while client.poll().unwrap().is_some() {
        read += 1;
    }
    assert!(read < 300, "the buffer is not that large");
    assert_eq!(client.aborted().expect("repeated").seq, 5);
}

#[test]
fn a_watcher_that_never_reads_does_not_block_the_simulator() {
    let name = service();
    let sidecar = sidecar(&name);
    let mut client = client(&name);
    without_time_out("publishing", || {
        for seq in 0..5000 {
            publish(&mut client, seq);
            assert!(client.poll().unwrap().is_none());
        }
    });
    assert_eq!(client.finish().unwrap(), 5000);
    drop(sidecar);
}

#[test]
fn the_handshake_has_a_deadline() {
    let name = service();
    let mut client = client(&name);
    let timeout = Duration::from_millis(100);
    let start = Instant::now();
    let met = without_time_out("the handshake", || client.wait_for_watcher(timeout));
    assert!(!met.unwrap() && start.elapsed() >= timeout);
}

/// Publishes frame `seq` and waits for its outcome, which must arrive long before the deadline.
pub fn step(client: &mut Client, seq: u64) -> Outcome {
    publish(client, seq);
    let outcome = without_time_out(format_args!("frame {seq}"), || client.wait(seq, LONG));
    outcome.unwrap()
}

/// Starts a watcher that answers frames up to `last`, and then leaves.
fn watch(name: &str, last: u64) -> std::thread::JoinHandle<()> {
    let mut sidecar = sidecar(name);
    std::thread::spawn(move || {
        let mut set = None;
        loop {
            if let Event::Frame(frame) = next(&mut sidecar) {
                answer(&mut sidecar, &frame, &mut set);
                if frame.seq() == last {
                    break;
                }
            }
        }
    })
}

#[test]
fn a_goodbye_ends_a_lockstep_wait_at_once() {
    let name = service();
    let mut client = client(&name);
    for first in [0, 5, 10] {
        let watcher = watch(&name, first + 1);
        for seq in first..first + 2 {
            assert!(matches!(step(&mut client, seq), Outcome::Verdict(_)));
        }
        watcher.join().unwrap();
        // So does each later frame.
        for seq in first + 2..first + 5 {
            let outcome = step(&mut client, seq);
            assert_eq!(outcome, Outcome::NoWatcher(Departure::Goodbye));
        }
        assert!(client.silent_for().is_none());
    }
    // A frame that was answered before the goodbye still has its verdict.
    let watcher = watch(&name, 15);
    publish(&mut client, 15);
    watcher.join().unwrap();
    let outcome = client.wait(15, PATIENCE).unwrap();
    assert!(matches!(outcome, Outcome::Verdict(m) if m.seq == 15));
}

#[test]
fn a_goodbye_ends_a_wait_that_has_begun() {
    let name = service();
    let mut client = client(&name);
    let sidecar = sidecar(&name);
    let watcher = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(200));
        drop(sidecar);
    });
    // The watcher left before it read the bus, so it does not know the session.
    assert_eq!(step(&mut client, 0), Outcome::NoWatcher(Departure::Goodbye));
    watcher.join().unwrap();
}

/// The client read nothing while the watcher ran, but still receives its verdict and its goodbye.
#[test]
fn the_client_does_not_wait_for_a_watcher_that_came_and_left() {
    let name = service();
    let mut client = client(&name);
    let watcher = watch(&name, 0);
    publish(&mut client, 0);
    watcher.join().unwrap();
    let outcome = client.wait(0, PATIENCE).unwrap();
    assert!(matches!(outcome, Outcome::Verdict(m) if m.seq == 0));
    assert_eq!(step(&mut client, 1), Outcome::NoWatcher(Departure::Goodbye));
}

#[test]
fn no_call_waits_after_a_goodbye() {
    let name = service();
    let mut client = client(&name);
    let watcher = watch(&name, 0);
    assert!(matches!(step(&mut client, 0), Outcome::Verdict(_)));
    watcher.join().unwrap();
    // The handshake waits for the next watcher, and has its own limit.
    let timeout = Duration::from_millis(100);
    assert!(!client.wait_for_watcher(timeout).unwrap());
    let goodbye = without_time_out("the end", || client.finish_within(LONG));
    assert_eq!(goodbye.unwrap(), None);
}

#[test]
fn the_client_does_not_wait_for_a_watcher_of_another_simulator() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut first = client(&name);
    publish(&mut first, 0);
    new_session(&mut sidecar);
    answer_next(&mut sidecar);
    assert!(matches!(
        first.wait(0, PATIENCE).unwrap(),
        Outcome::Verdict(_)
    ));
    // Acts as a second simulator on another host, so the lock on this host is not checked.
    let mut second = hostile::HostilePublisher::open(&name);
    second.honest();
    assert!(matches!(next(&mut sidecar), Event::SimulatorLost { .. }));
    new_session(&mut sidecar);
    sidecar.heartbeat().unwrap();
    let goodbye = Outcome::NoWatcher(Departure::Goodbye);
    assert_eq!(step(&mut first, 1), goodbye);
    second.send(|h, _| h.flags = 2);
    while !matches!(next(&mut sidecar), Event::End { .. }) {}
    // The watcher announces that it has no session. It still ignores the first simulator.
    sidecar.heartbeat().unwrap();
    assert_eq!(step(&mut first, 2), goodbye);
}
