//! Hostile publishers, through a raw publisher beside the client of the crate.

use super::support::raw_bus::{Header, RawSimulator};
use super::*;
use iceoryx2::prelude::*;
use linkwatch::{Error, LastLabels, Outcome};

pub struct HostilePublisher {
    simulator: RawSimulator,
    seq: u64,
}

impl HostilePublisher {
    /// Joins like a bridge, without the lock of the crate's client.
    pub fn open(service: &str) -> HostilePublisher {
        HostilePublisher {
            simulator: RawSimulator::open(service),
            seq: 0,
        }
    }

    /// Sends a frame like those of [`client`], modified by `change`.
    pub fn send(&mut self, change: impl FnOnce(&mut Header, &mut Vec<u8>)) -> u64 {
        let mut header = Header {
            magic: Header::MAGIC,
            version: Header::VERSION,
            flags: 0,
            session: 77,
            seq: self.seq,
            time: 0.5,
            n_points: 8,
            n_curves: 2,
            basis: 0,
            coordinate_bytes: 4,
            ..Header::default()
        };
        let mut payload: Vec<u8> = COUNTS.iter().flat_map(|c| c.to_le_bytes()).collect();
        payload.resize(64, 0);
        payload.extend(positions(self.seq).iter().flat_map(|x| x.to_le_bytes()));
        change(&mut header, &mut payload);
        self.simulator.send(header, &payload);
        self.seq += 1;
        self.seq - 1
    }

    pub fn honest(&mut self) -> u64 {
        self.send(|_, _| {})
    }
}

#[test]
fn an_invalid_frame_affects_only_itself() {
    type Lie = fn(&mut Header, &mut Vec<u8>);
    let lies: [(Lie, &str); 25] = [
        (
            |h, _| h.n_points = 9,
            "bytes of a frame: 172 promised, 160 available",
        ),
        (
            |h, _| h.n_points = u64::MAX,
            "bytes of a frame: 18446744073709551615 promised",
        ),
        (|h, _| h.n_points = u64::MAX / 12 + 2, "bytes of a frame"),
        (|h, _| h.n_points = 1_000_000_000, "bytes of a frame"),
        (|h, _| h.n_curves = 17, "bytes of a frame: 224 promised"),
        (|h, _| h.n_curves = u32::MAX, "bytes of a frame"),
        (|h, _| h.n_curves = 1, "number of curves was 2, is 1"),
        (|_, p| p.truncate(100), "160 promised, 100 available"),
        (|_, p| p.truncate(0), "160 promised, 0 available"),
        (|h, _| h.basis = 99, "basis code"),
        (|h, _| h.basis = 1, "basis code was 0, is 1"),
        (|h, _| h.coordinate_bytes = 3, "bytes of a coordinate"),
        (
            |h, p| {
                h.coordinate_bytes = 8;
                p.resize(64 + 192, 0);
            },
            "bytes of a coordinate was 4, is 8",
        ),
        (|h, _| h.time = f64::INFINITY, "time"),
        (
            |_, p| p[0] = p[0].wrapping_sub(1),
            "control points of a curve was 4, is 5",
        ),
        (
            |_, p| p[64 + 5 * 4..64 + 6 * 4].copy_from_slice(&f32::NAN.to_le_bytes()),
            "curve 0, point 1: coordinate z is NaN",
        ),
        (|h, _| h.names_bytes = 1, "bytes of a frame: 224 promised"),
        (|h, _| h.names_bytes = u32::MAX, "bytes of a frame"),
        (|h, _| h.flags = 16, "bytes of a frame: 224 promised"),
        (|h, _| h.time_step = f64::NAN, "time step"),
        (|h, _| h.cell_vectors = 3, "3 vectors, but 0 are not zero"),
        (|h, _| h.cell[4] = 1.0, "0 vectors, but 1 are not zero"),
        (|h, _| h.cell_origin[2] = 1.0, "no vector"),
        (
            |h, _| (h.cell_vectors, h.cell[0]) = (1, f64::NAN),
            "(periodic cell): cell NaN,0,0",
        ),
        (
            |h, _| {
                h.cell_vectors = 2;
                h.cell[..6].copy_from_slice(&[1.0, 2.0, 3.0, 2.0, 4.0, 6.0]);
            },
            "one plane or on one line",
        ),
    ];
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut publisher = HostilePublisher::open(&name);
    let mut set = None;
    publisher.honest();
    new_session(&mut sidecar);
    next_frame(&mut sidecar).ingest(&mut set).unwrap();
    for (lie, expected) in lies {
        let seq = publisher.send(lie);
        let frame = next_frame(&mut sidecar);
        assert_eq!(frame.seq(), seq);
        let e = frame.ingest(&mut set).unwrap_err().to_string();
        assert!(e.contains(expected), "{e}, expected {expected}");
        answer(&mut sidecar, &frame, &mut set);
        drop(frame);

        let seq = publisher.honest();
        let frame = next_frame(&mut sidecar);
        assert_eq!(frame.seq(), seq);
        frame.ingest(&mut set).unwrap();
        assert!(holds(set.as_ref().unwrap(), seq));
    }
    assert_eq!(sidecar.counters().rejected, 25);
    assert_eq!(sidecar.counters().skipped, 0);
}

#[test]
fn invalid_names_of_curves_affect_only_their_frame() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut publisher = HostilePublisher::open(&name);
    let mut last = LastLabels::default();
    let names: [(&[u8], &str); 5] = [
        (b"a\0b\0", ""),
        (b"a\0b", "does not end with a zero byte"),
        (b"a\0\xff\0", "not UTF-8"),
        (b"a\0a\0", "which is that of curve 0"),
        (b"a\0b\0c\0", "names of curves: 2 promised, 3 available"),
    ];
    for (k, (names, expected)) in names.into_iter().enumerate() {
        publisher.send(|h, p| {
            h.names_bytes = names.len() as u32;
            h.layout = 7;
            let mut padded = names.to_vec();
            padded.resize(64, 0);
            p.splice(64..64, padded);
        });
        if k == 0 {
            new_session(&mut sidecar);
        }
        let frame = next_frame(&mut sidecar);
        let info = frame.info(&mut last);
        match expected {
            "" => {
                let info = info.unwrap();
                assert_eq!(
                    (info.layout, &info.labels.names[..]),
                    (7, &["a".into(), "b".into()][..])
                );
            }
            expected => {
                let e = info.unwrap_err().to_string();
                assert!(e.contains(expected), "{e}, expected {expected}");
            }
        }
        answer(&mut sidecar, &frame, &mut None);
    }
}

#[test]
fn the_first_frame_may_be_invalid() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut publisher = HostilePublisher::open(&name);
    let mut set = None;
    // Counts whose sum differs from the number of points, and a NaN.
    publisher.send(|_, p| p[0] = p[0].wrapping_sub(1));
    new_session(&mut sidecar);
    assert!(next_frame(&mut sidecar).ingest(&mut set).is_err());
    publisher.send(|_, p| p[64..68].copy_from_slice(&f32::NAN.to_le_bytes()));
    assert!(next_frame(&mut sidecar).ingest(&mut set).is_err());
    assert!(set.is_none());
    let seq = publisher.honest();
    next_frame(&mut sidecar).ingest(&mut set).unwrap();
    assert!(holds(&set.unwrap(), seq));
}

#[test]
fn an_unreadable_message_has_no_number() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut publisher = HostilePublisher::open(&name);
    let unreadable = |sidecar: &mut Sidecar| match next(sidecar) {
        Event::Unreadable(e) => e,
        other => panic!("{other:?}"),
    };
    publisher.send(|h, _| h.magic = 0);
    let e = unreadable(&mut sidecar).to_string();
    assert!(e.contains("magic number"), "{e}");
    publisher.send(|h, _| h.version += 1);
    let e = unreadable(&mut sidecar);
    assert!(matches!(e, Error::Version { found: 9, .. }), "{e}");
    // An older client, whose findings have no images.
    publisher.send(|h, _| h.version = 6);
    assert_eq!(
        unreadable(&mut sidecar).to_string(),
        "the frame has version 6; this build reads version 8"
    );
    let seq = publisher.honest();
    new_session(&mut sidecar);
    assert_eq!(next_frame(&mut sidecar).seq(), seq);
}

/// Sends an invalid frame with the number `seq` between valid ones, and expects that it is rejected
/// with this text.
fn expect_rejection(
    publisher: &mut HostilePublisher,
    sidecar: &mut Sidecar,
    seq: u64,
    words: &str,
) {
    publisher.send(|h, _| h.seq = seq);
    // The frame does not count as a valid one.
    publisher.seq -= 1;
    let frame = next_frame(sidecar);
    assert_eq!(frame.seq(), seq);
    let e = frame.ingest(&mut None).unwrap_err().to_string();
    assert_eq!(e, format!("not a valid frame (sequence number): {words}"));
    answer(sidecar, &frame, &mut None);
}

fn publish_valid_frame(publisher: &mut HostilePublisher, sidecar: &mut Sidecar) {
    let seq = publisher.honest();
    assert_eq!(answer_next(sidecar), seq);
}

#[test]
fn a_hostile_sequence_number_is_rejected_and_valid_frames_continue() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut publisher = HostilePublisher::open(&name);
    publisher.honest();
    new_session(&mut sidecar);
    answer_next(&mut sidecar);
    for (rejected, (seq, words)) in [
        (u64::MAX, "18446744073709551615 after 0"),
        (u64::MAX - 1, "18446744073709551614 after 1"),
        (1 << 63, "9223372036854775808 after 2"),
        (1 << 53, "9007199254740992 after 3"),
        (1 << 52, "4503599627370496 after 4"),
        // Sequence numbers must increase.
        (5, "5 after 5"),
        (0, "0 after 6"),
        (3, "3 after 7"),
    ]
    .into_iter()
    .enumerate()
    {
        expect_rejection(&mut publisher, &mut sidecar, seq, words);
        publish_valid_frame(&mut publisher, &mut sidecar);
        let counters = sidecar.counters();
        assert_eq!(counters.rejected, rejected as u64 + 1);
        assert_eq!(counters.verified, rejected as u64 + 2);
        assert_eq!(counters.skipped, 0);
    }
}

#[test]
fn a_first_frame_with_a_hostile_number_is_rejected_too() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut publisher = HostilePublisher::open(&name);
    publisher.send(|h, _| h.seq = u64::MAX);
    new_session(&mut sidecar);
    let e = next_frame(&mut sidecar).ingest(&mut None).unwrap_err();
    let words = "18446744073709551615, expected less than 9007199254740992";
    assert!(e.to_string().contains(words), "{e}");
    publish_valid_frame(&mut publisher, &mut sidecar);
    assert_eq!(sidecar.counters().skipped, 1);
}

/// A plausible sequence number is accepted until the next two frames contradict it.
#[test]
fn a_jump_ahead_that_returns_costs_one_frame() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut publisher = HostilePublisher::open(&name);
    publisher.honest();
    new_session(&mut sidecar);
    answer_next(&mut sidecar);
    publisher.send(|h, _| h.seq = 50_000);
    publisher.seq -= 1;
    answer_next(&mut sidecar);
    assert_eq!(sidecar.counters().skipped, 49_999);
    expect_rejection(&mut publisher, &mut sidecar, 1, "1 after 50000");
    publisher.seq = 2;
    for _ in 0..5 {
        publish_valid_frame(&mut publisher, &mut sidecar);
    }
    publisher.send(|h, _| h.flags = 2);
    let Event::End {
        published,
        counters,
        ..
    } = next(&mut sidecar)
    else {
        panic!("not the end");
    };
    let Counters {
        verified,
        skipped,
        rejected,
    } = counters;
    assert_eq!((published, verified, skipped, rejected), (7, 7, 0, 1));
}

#[test]
fn a_wrong_end_is_reported_and_not_counted() {
    for (claimed, published, skipped) in [
        (u64::MAX, 3, 0),
        (1 << 53, 3, 0),
        (0, 3, 0),
        (2, 3, 0),
        (3, 3, 0),
        (9, 9, 6),
    ] {
        let name = service();
        let mut sidecar = sidecar(&name);
        let mut publisher = HostilePublisher::open(&name);
        publisher.honest();
        new_session(&mut sidecar);
        answer_next(&mut sidecar);
        for _ in 0..2 {
            publish_valid_frame(&mut publisher, &mut sidecar);
        }
        publisher.send(|h, _| (h.flags, h.seq) = (2, claimed));
        if ![3, 9].contains(&claimed) {
            let Event::Unreadable(e) = next(&mut sidecar) else {
                panic!("{claimed}: not reported");
            };
            let words = format!("{claimed} frames published, 3 expected");
            assert!(e.to_string().ends_with(&words), "{e}");
        }
        match next(&mut sidecar) {
            Event::End {
                published: p,
                counters,
                ..
            } => assert_eq!((p, counters.skipped), (published, skipped), "{claimed}"),
            other => panic!("{other:?}"),
        }
    }
}

/// The simulator ignores a verdict on a frame that another program published.
#[test]
fn answers_to_frames_of_other_programs_do_not_reach_the_simulator() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let mut client = client(&name);
    let mut publisher = HostilePublisher::open(&name);
    publish(&mut client, 0);
    let session = new_session(&mut sidecar);
    answer_next(&mut sidecar);
    for seq in [40_000, u64::MAX] {
        publisher.send(|h, _| (h.session, h.seq) = (session, seq));
        let report = report(&next_frame(&mut sidecar), Verdict::Changed);
        sidecar.send_verdict(&report, Duration::ZERO).unwrap();
        sidecar.heartbeat().unwrap();
    }
    let outcome = client.wait(0, PATIENCE).unwrap();
    assert!(matches!(outcome, Outcome::Verdict(m) if m.seq == 0));
    assert!(client.poll().unwrap().is_none());
    assert!(client.aborted().is_none());
    assert!(client.silent_for().is_some());
    // Such verdicts also do not hide an abort of a frame of the simulator.
    publish(&mut client, 1);
    let abort = report(&next_frame(&mut sidecar), Verdict::Changed);
    sidecar.send_verdict(&abort, Duration::ZERO).unwrap();
    for seq in [0, 1, 1 << 40, u64::MAX] {
        publisher.send(|h, _| (h.session, h.seq) = (session, seq));
        let report = report(&next_frame(&mut sidecar), Verdict::Changed);
        sidecar.send_verdict(&report, Duration::ZERO).unwrap();
    }
    // More messages than the simulator keeps, so that only the repeated abort remains.
    (0..100).for_each(|_| sidecar.heartbeat().unwrap());
    while client.poll().unwrap().is_some() {}
    assert_eq!(client.aborted().expect("repeated").seq, 1);
}

#[test]
fn frames_above_the_limit_are_not_read() {
    let name = service();
    let mut options = SidecarOptions::default();
    options.max_frame_bytes = 128;
    let mut sidecar = Sidecar::open(&name, &options).unwrap();
    let mut client = client(&name);
    publish(&mut client, 0);
    new_session(&mut sidecar);
    let e = next_frame(&mut sidecar).ingest(&mut None).unwrap_err();
    assert_eq!(
        e.to_string(),
        "bytes of a frame (more than the limit): 160 promised, 128 available"
    );
}

#[test]
fn late_frames_of_an_old_session_start_no_new_session() {
    let name = service();
    let mut sidecar = sidecar(&name);
    let (mut old, mut new) = (HostilePublisher::open(&name), client(&name));
    old.honest();
    assert_eq!(new_session(&mut sidecar), 77);
    next_frame(&mut sidecar);
    publish(&mut new, 0);
    let Event::SimulatorLost { session: 77, .. } = next(&mut sidecar) else {
        panic!("the first simulator was not given up");
    };
    let session = new_session(&mut sidecar);
    next_frame(&mut sidecar);
    old.honest();
    publish(&mut new, 1);
    let frame = next_frame(&mut sidecar);
    assert_eq!((frame.session(), frame.seq()), (session, 1));
}

#[test]
fn another_program_with_the_same_name_is_reported() {
    let name = service();
    let node = NodeBuilder::new().create::<ipc::Service>().unwrap();
    let frames = ServiceName::new(&format!("{name}/frames")).unwrap();
    let other = node
        .service_builder(&frames)
        .publish_subscribe::<u64>()
        .create()
        .unwrap();
    let e = Client::open(&name, &ClientOptions::default()).unwrap_err();
    let words = e.to_string();
    assert!(words.contains("another program uses the name"), "{words}");
    drop(other);
}
