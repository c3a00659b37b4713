//! Frames arrive unchanged, and every frame is counted.

use super::hostile::HostilePublisher;
use super::support::raw_bus::Header;
use super::*;
use linkwatch::{Change, CurveLabels, Departure, Finding, LastLabels, Outcome, Positions};

#[test]
fn positions_arrive_bit_for_bit() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let single: Vec<f32> = [0, 1, 0x8000_0000, 0x7f7f_ffff, 0x0080_0000, 0x3f80_0001]
        .repeat(4)
        .into_iter()
        .map(f32::from_bits)
        .collect();
    let double: Vec<f64> = [0, 1, 1 << 63, 0x7fef_ffff_ffff_ffff, 1 << 52, 0x3ff0 << 48]
        .repeat(4)
        .into_iter()
        .map(f64::from_bits)
        .collect();
    let bytes = |set: &Option<CurveSet>| {
        let mut out = Vec::new();
        set.as_ref().unwrap().write_positions(&mut out);
        out
    };
    for precision in [Precision::F32, Precision::F64] {
        let mut client = Client::open(&name, &ClientOptions::lockstep()).unwrap();
        client
            .describe(Basis::Polyline, precision, &[-4, 4])
            .unwrap();
        let expected: Vec<u8> = match precision {
            Precision::F32 => single.iter().flat_map(|x| x.to_le_bytes()).collect(),
            Precision::F64 => double.iter().flat_map(|x| x.to_le_bytes()).collect(),
        };
        let mut set = None;
        for seq in 0..3 {
            let sent = match precision {
                Precision::F32 => client.publish(0.25, Positions::F32(&single)),
                Precision::F64 => client.publish(0.25, Positions::F64(&double)),
            };
            assert_eq!(sent.unwrap(), seq);
            if seq == 0 {
                new_session(&mut sidecar);
            }
            let frame = next_frame(&mut sidecar);
            assert_eq!((frame.seq(), frame.time()), (seq, 0.25));
            assert!(frame.lockstep());
            frame.ingest(&mut set).unwrap();
            assert_eq!(bytes(&set), expected);
        }
        let counts: Vec<i32> = set.as_ref().unwrap().counts().collect();
        assert_eq!(counts, [-4, 4]);
        drop(client);
        assert!(matches!(next(&mut sidecar), Event::End { .. }));
    }
}

#[test]
fn every_published_frame_is_verified_or_skipped() {
    let name = service();
    for (work_us, pause_us) in [(0, 0), (300, 0), (0, 300), (500, 100)] {
        let mut sidecar = sidecar(&name);
        let mut client = client(&name);
        let simulator = std::thread::spawn(move || {
            for seq in 0..500 {
                publish(&mut client, seq);
                std::thread::sleep(Duration::from_micros(pause_us));
            }
            client.finish_within(PATIENCE).unwrap().expect("a goodbye")
        });
        let (published, counters, clean) =
            watch_to_the_end(&mut sidecar, Duration::from_micros(work_us));
        assert!(clean);
        assert_eq!(published, 500);
        assert_eq!(counters.verified + counters.skipped, 500, "{counters:?}");
        assert_eq!(simulator.join().unwrap().counters, counters);
    }
}

#[test]
fn the_last_frame_is_always_verified() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    let simulator = std::thread::spawn(move || {
        assert!(client.wait_for_watcher(PATIENCE).unwrap());
        for seq in 0..50 {
            publish(&mut client, seq);
        }
        // Ended before the watcher has polled.
        assert_eq!(client.finish().unwrap(), 50);
    });
    new_session(&mut sidecar);
    simulator.join().unwrap();
    for seq in [0, 49] {
        assert_eq!(answer_next(&mut sidecar), seq);
    }
    let Event::End {
        published,
        counters,
        ..
    } = next(&mut sidecar)
    else {
        panic!("not the end");
    };
    assert_eq!(
        (published, counters.verified, counters.skipped),
        (50, 2, 48)
    );
}

/// Starts a watcher after a client has published frames, and connects both.
fn late_sidecar(name: &str, client: &mut Client) -> Sidecar {
    let sidecar = sidecar(name);
    assert!(!client.wait_for_watcher(Duration::from_millis(50)).unwrap());
    sidecar
}

#[test]
fn a_late_watcher_gets_the_first_frame_and_the_newest_one() {
    let name = service();
    let mut client = client(&name);
    for seq in 0..3 {
        publish(&mut client, seq);
    }
    let mut sidecar = late_sidecar(&name, &mut client);
    let watcher = std::thread::spawn(move || {
        new_session(&mut sidecar);
        let mut set = None;
        for (seq, skipped) in [(0, 0), (2, 1)] {
            let frame = next_frame(&mut sidecar);
            answer(&mut sidecar, &frame, &mut set);
            assert!(holds(set.as_ref().unwrap(), seq));
            assert_eq!((frame.seq(), sidecar.counters().skipped), (seq, skipped));
        }
        // Lives until the simulator has received its message.
        sidecar
    });
    assert!(client.wait_for_watcher(PATIENCE).unwrap());
    drop(watcher.join().unwrap());
}

/// Regression test: if a watcher came while the simulator sent the end, it verified the last frame
/// as its first one. It was not informed of the baseline, which the simulator sent right after.
#[test]
fn the_baseline_may_arrive_after_the_end() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut frames = HostilePublisher::open(&name);
    frames.send(|header, _| header.seq = 3);
    frames.send(|header, payload| {
        (header.seq, header.flags) = (4, Header::END);
        payload.clear();
    });
    let watcher = std::thread::spawn(move || {
        new_session(&mut sidecar);
        for seq in [0, 3] {
            let frame = next_frame(&mut sidecar);
            answer(&mut sidecar, &frame, &mut None);
            assert_eq!(frame.seq(), seq);
        }
        assert!(matches!(next(&mut sidecar), Event::End { .. }));
    });
    std::thread::sleep(Duration::from_millis(100));
    let mut baselines = HostilePublisher::open(&name);
    baselines.send(|header, _| header.flags = Header::BASELINE);
    watcher.join().unwrap();
}

#[test]
fn a_watcher_from_now_on_gets_the_newest_frame() {
    let name = service();
    let mut client = client(&name);
    for seq in 0..3 {
        publish(&mut client, seq);
    }
    let mut options = SidecarOptions::default();
    options.from_now = true;
    let mut sidecar = Sidecar::open(&name, &options).unwrap();
    assert!(!client.wait_for_watcher(Duration::from_millis(50)).unwrap());
    new_session(&mut sidecar);
    assert_eq!(answer_next(&mut sidecar), 2);
    publish(&mut client, 3);
    assert_eq!(answer_next(&mut sidecar), 3);
    client.accept();
    publish(&mut client, 4);
    publish(&mut client, 5);
    // An accepted frame is never skipped.
    assert_eq!([4, 5], [(); 2].map(|()| answer_next(&mut sidecar)));
}

#[test]
fn an_accepted_frame_is_the_baseline_of_a_late_watcher() {
    let name = service();
    let mut client = client(&name);
    for seq in 0..6 {
        if seq == 3 {
            client.accept();
        }
        publish(&mut client, seq);
    }
    let mut sidecar = late_sidecar(&name, &mut client);
    new_session(&mut sidecar);
    let frame = next_frame(&mut sidecar);
    let info = frame.info(&mut LastLabels::default()).unwrap();
    assert_eq!((frame.seq(), info.baseline), (3, 3));
    answer(&mut sidecar, &frame, &mut None);
    assert_eq!(answer_next(&mut sidecar), 5);
}

/// Regression test: a frame that waited behind the baseline counted as answered, and never got a
/// verdict.
#[test]
fn the_next_watcher_gets_a_frame_that_waited_behind_the_baseline() {
    let name = service();
    let mut client = client(&name);
    for seq in 0..3 {
        publish(&mut client, seq);
    }
    let mut first = late_sidecar(&name, &mut client);
    new_session(&mut first);
    assert_eq!(answer_next(&mut first), 0);
    let state = first.state().unwrap();
    drop(first);
    let mut second = late_sidecar(&name, &mut client);
    second.resume(state);
    new_session(&mut second);
    assert_eq!(answer_next(&mut second), 2);
    assert_eq!(second.counters().skipped, 1);
}

/// The watcher is stopped at first, so that it reads all messages at once.
#[test]
fn the_end_of_a_session_does_not_overtake_its_baseline() {
    for _ in 0..20 {
        let name = service();
        let mut client = client(&name);
        (0..100).for_each(|seq| publish(&mut client, seq));
        let mut sidecar = sidecar(&name);
        let simulator = std::thread::spawn(move || client.finish_within(PATIENCE).unwrap());
        let (published, counters, _) = watch_to_the_end(&mut sidecar, Duration::ZERO);
        assert_eq!((published, counters.verified), (100, 2));
        assert!(simulator.join().unwrap().is_some());
    }
}

#[test]
fn a_watcher_may_restart() {
    let name = service();
    let mut client = client(&name);
    let mut sessions = Vec::new();
    for round in 0..3 {
        let mut sidecar = sidecar(&name);
        publish(&mut client, round);
        sessions.push(new_session(&mut sidecar));
        // Each watcher begins with the first frame.
        let frames = if round == 0 { vec![0] } else { vec![0, round] };
        for seq in frames {
            assert_eq!(answer_next(&mut sidecar), seq);
            assert_eq!(client.poll().unwrap().expect("a verdict").seq, seq);
        }
        assert!(client.silent_for().is_some());
        drop(sidecar);
        assert!(client.poll().unwrap().is_none());
        assert!(client.silent_for().is_none(), "it said goodbye");
    }
    assert!(sessions.windows(2).all(|w| w[0] == w[1]), "{sessions:?}");
}

/// Regression test: a new finding had the same curve indices as an old one, and was not sent as
/// new.
#[test]
fn findings_of_curves_that_are_described_again_are_new() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    let describe = |client: &mut Client| {
        let labels = CurveLabels::named(["a", "b"]);
        let kind = (Basis::Polyline, Precision::F32);
        client
            .describe_labelled(kind.0, kind.1, &COUNTS, labels)
            .unwrap();
    };
    describe(&mut client);
    let mut first = |client: &mut Client, seq, pairs: &[(u32, u32)]| {
        publish(client, seq);
        if seq == 0 {
            new_session(&mut sidecar);
        }
        let mut report = report(&next_frame(&mut sidecar), Verdict::Changed);
        report.changes.extend(pairs.iter().map(|&(i, j)| Change {
            i,
            j,
            image: [0; 3],
            expected: 1,
            found: 0,
            place: None,
        }));
        sidecar.send_verdict(&report, Duration::ZERO).unwrap();
        match client.wait(seq, PATIENCE).unwrap() {
            Outcome::Verdict(message) => match message.first {
                Some(Finding::Change(change)) => (change.i, change.j),
                other => panic!("{other:?}"),
            },
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(first(&mut client, 0, &[(0, 1)]), (0, 1));
    assert_eq!(first(&mut client, 1, &[(0, 1), (1, 2)]), (1, 2));
    describe(&mut client);
    assert_eq!(first(&mut client, 2, &[(0, 1), (1, 2)]), (0, 1));
}

/// Regression test: messages had the curve names of the newest frame instead of their own.
#[test]
fn messages_name_the_curves_of_their_frame() {
    let name = service();
    let (mut sidecar, mut client) = (sidecar(&name), client(&name));
    let (mut set, order) = (None, [["a", "b"], ["b", "a"], ["c", "a"], ["a", "b"]]);
    for (seq, names) in (0..).zip(order) {
        let labels = CurveLabels::named(names);
        let (basis, precision) = (Basis::Polyline, Precision::F32);
        client
            .describe_labelled(basis, precision, &COUNTS, labels)
            .unwrap();
        if seq == 0 {
            publish(&mut client, seq);
            new_session(&mut sidecar);
            continue;
        }
        let frame = next_frame(&mut sidecar);
        answer(&mut sidecar, &frame, &mut set);
        let message = client.poll().unwrap().expect("a verdict");
        assert_eq!(message.seq, seq - 1);
        assert_eq!(message.names[..], order[seq as usize - 1]);
        publish(&mut client, seq);
    }
}

#[test]
fn a_session_that_ends_early_is_not_clean() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    publish(&mut client, 0);
    new_session(&mut sidecar);
    drop(client);
    let (published, counters, clean) = watch_to_the_end(&mut sidecar, Duration::ZERO);
    assert_eq!((published, counters.verified, clean), (1, 1, false));
}

#[test]
fn rejects_a_second_simulator_and_a_second_watcher() {
    let name = service();
    let (first, watcher) = (client(&name), sidecar(&name));
    let e = Client::open(&name, &ClientOptions::default()).unwrap_err();
    let words = e.to_string();
    let pid = std::process::id().to_string();
    assert!(words.contains(&name) && words.contains("already has a simulator"));
    assert!(
        words.contains(&pid) && words.contains("another service name"),
        "{words}"
    );
    let e = Sidecar::open(&name, &SidecarOptions::default()).unwrap_err();
    let words = e.to_string();
    assert!(words.contains(&name) && words.contains("already watched"));
    assert!(
        words.contains(&pid)
            && words.contains("option `service`")
            && words.contains("option `observe`"),
        "{words}"
    );
    drop((first, watcher));
    drop((client(&name), sidecar(&name)));
}

fn observer(service: &str) -> linkwatch::Result<Sidecar> {
    let mut options = SidecarOptions::default();
    options.observe = true;
    Sidecar::open(service, &options)
}

#[test]
fn observers_receive_frames_and_send_nothing() {
    let name = service();
    let mut observers = [(); 2].map(|()| observer(&name).unwrap());
    let mut client = client(&name);
    publish(&mut client, 0);
    for observer in &mut observers {
        new_session(observer);
        let frame = next_frame(observer);
        answer(observer, &frame, &mut None);
        observer.heartbeat().unwrap();
        assert_eq!(observer.counters().verified, 1);
    }
    assert!(client.poll().unwrap().is_none());
    assert!(client.silent_for().is_none());
    // Another watcher answers, so that nobody notices that these left.
    let mut watcher = sidecar(&name);
    publish(&mut client, 1);
    new_session(&mut watcher);
    assert_eq!([0, 1], [(); 2].map(|()| answer_next(&mut watcher)));
    drop(observers);
    for seq in [0, 1] {
        assert_eq!(client.poll().unwrap().expect("a verdict").seq, seq);
    }
    assert!(client.silent_for().is_some());
    client.finish().unwrap();
}

#[test]
fn rejects_more_than_four_watchers_and_observers() {
    let name = service();
    let mut observers: Vec<_> = (0..4).map(|_| observer(&name).unwrap()).collect();
    let pid = std::process::id().to_string();
    for refused in [
        observer(&name),
        Sidecar::open(&name, &SidecarOptions::default()),
    ] {
        let words = refused.unwrap_err().to_string();
        assert!(words.contains("the maximum of 4 watchers"), "{words}");
        assert!(words.contains(&name) && words.contains(&pid), "{words}");
    }
    observers.pop();
    drop(sidecar(&name));
}

/// A watcher may refuse the frames of one simulator and watch the next one.
#[test]
fn a_watcher_that_leaves_a_session_ignores_the_rest_of_it() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut first = client(&name);
    publish(&mut first, 0);
    new_session(&mut sidecar);
    publish(&mut first, 1);
    sidecar.leave("no curve is closed");
    let seen = |client: &mut Client| client.wait(1, LONG).unwrap();
    let outcome = without_time_out("the wait", || seen(&mut first));
    let why = Departure::Refused("no curve is closed".into());
    assert_eq!(outcome, Outcome::NoWatcher(why.clone()));
    assert_eq!(first.departure(), Some(&why));
    publish(&mut first, 2);
    assert!(matches!(
        sidecar.wait(Duration::from_millis(50)).unwrap(),
        Event::Idle
    ));
    drop(first);
    let mut second = client(&name);
    publish(&mut second, 0);
    new_session(&mut sidecar);
    assert_eq!(answer_next(&mut sidecar), 0);
    second.finish().unwrap();
}

#[test]
fn errors_of_misuse_give_advice() {
    let name = service();
    let mut client = Client::open(&name, &ClientOptions::default()).unwrap();
    let e = client.loan(0.0).unwrap_err().to_string();
    assert!(e.contains("Client::describe"), "{e}");
    let e = client.describe(Basis::BSpline, Precision::F32, &[-4, -2]);
    let e = e.unwrap_err().to_string();
    assert!(e.starts_with("curve 1: 2 control points"), "{e}");
    client
        .describe(Basis::Polyline, Precision::F64, &[-4])
        .unwrap();
    let mut frame = client.loan(0.0).unwrap();
    assert!(frame.positions_f32().is_err());
    assert_eq!(frame.positions_f64().unwrap().len(), 12);
    frame.positions_f64().unwrap().fill(1.0);
    frame.publish().unwrap();
    let e = client.publish(0.0, Positions::F64(&[0.0; 9])).unwrap_err();
    assert_eq!(e.to_string(), "coordinates: 12 promised, 9 available");
    let e = client.describe(Basis::Polyline, Precision::F64, &[-5]);
    assert!(e.unwrap_err().to_string().contains("cannot change"));
    assert!(Client::open("", &ClientOptions::default()).is_err());
    let long = "x".repeat(300);
    let e = Client::open(&long, &ClientOptions::default()).unwrap_err();
    assert!(e.to_string().contains("at most 255 bytes"), "{e}");
}

#[test]
fn a_dropped_loan_is_not_a_frame() {
    let name = service();
    let mut client = client(&name);
    for _ in 0..100 {
        drop(client.loan(0.0).unwrap());
    }
    publish(&mut client, 0);
}

#[test]
fn memory_grows_with_the_frames() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = Client::open(&name, &ClientOptions::default()).unwrap();
    // A signal before the size is known, then a small layout, then a large one.
    client.wait_for_watcher(Duration::ZERO).unwrap();
    client
        .describe(Basis::Polyline, Precision::F32, &[-3])
        .unwrap();
    let n = 50_000;
    client
        .describe(Basis::Polyline, Precision::F64, &[-n])
        .unwrap();
    new_session(&mut sidecar);
    let mut set = None;
    for seq in 0..20 {
        let sent = vec![seq as f64 + 0.5; 3 * n as usize];
        client.publish(0.0, Positions::F64(&sent)).unwrap();
        next_frame(&mut sidecar).ingest(&mut set).unwrap();
        assert_eq!(set.as_ref().unwrap().point(0, 49_999), [sent[0]; 3]);
    }
}
