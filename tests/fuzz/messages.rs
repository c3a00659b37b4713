//! Messages of a hostile watcher to the client of the crate.

use super::support::random::Random;
use super::support::raw_bus::{Header, Message, RawWatcher};
use super::{service, units};
use linkwatch::{Basis, Client, ClientOptions, Positions, Precision};

/// Numbers that no valid message contains.
const HUGE: [u64; 5] = [u64::MAX, 1 << 63, u32::MAX as u64, 256, 193];

fn valid(session: u64, seq: u64) -> Message {
    Message {
        magic: Message::MAGIC,
        version: Header::VERSION,
        // A verdict.
        kind: 1,
        session,
        seq,
        time: 0.0,
        verdict: 0,
        abort: 0,
        lost: 0,
        gained: 0,
        changed: 0,
        defects: 0,
        events: 0,
        finding: 0,
        i: 0,
        j: 0,
        defect_kind: 0,
        segments: [0; 2],
        has_place: 0,
        reason_len: 0,
        unresolved: 0,
        appeared: 0,
        gone: 0,
        findings: 0,
        recovered: 0,
        expected: 0,
        found: 0,
        point: [0.0; 3],
        distance: 0.0,
        lengths: 0.0,
        extent: 1.0,
        verified: 1,
        skipped: 0,
        rejected: 0,
        check_ns: 1,
        last_intact: seq,
        safe_fraction: 1.0,
        image: [0; 3],
        reason: [0; 180],
    }
}

/// Returns the session of a client, which is visible only in its debug output.
fn session(client: &Client) -> u64 {
    let text = format!("{client:?}");
    let (_, rest) = text.split_once("session: ").expect("a session");
    let digits = rest.split(|c: char| !c.is_ascii_digit()).next();
    digits.and_then(|d| d.parse().ok()).expect("a number")
}

/// Changes some fields at random.
fn change(m: &mut Message, r: &mut Random) {
    let code = |r: &mut Random| r.pick(&[0, 1, 2, 3, 4, 5, 6, 7, 9, 193, 1 << 20, u32::MAX]);
    for _ in 0..1 + r.below(4) {
        match r.below(16) {
            0 => m.magic ^= 1 << r.below(64),
            1 => m.version = code(r),
            2 => m.kind = code(r),
            3 => m.session = if r.one_in(2) { 0 } else { r.next() },
            4 => m.seq = r.pick(&HUGE),
            5 => m.verdict = code(r),
            6 => m.abort = code(r),
            7 => m.finding = code(r),
            8 => m.defect_kind = code(r),
            9 => m.reason_len = code(r),
            10 => m.reason = std::array::from_fn(|_| r.next() as u8),
            11 => m.time = r.pick(&[f64::NAN, f64::INFINITY, -1.0]),
            12 => m.safe_fraction = r.pick(&[f64::NAN, -1.0, 2.0, f64::INFINITY]),
            13 => m.last_intact = r.pick(&HUGE),
            14 => (m.i, m.j) = (code(r), code(r)),
            _ => (m.has_place, m.distance) = (code(r), f64::NAN),
        }
    }
}

#[test]
fn messages_of_a_watcher() {
    let name = service();
    let mut client = Client::open(&name, &ClientOptions::default()).expect("a client");
    client
        .describe(Basis::Polyline, Precision::F32, &[-3])
        .expect("a triangle");
    let triangle = [0., 0., 0., 1., 0., 0., 0., 1., 0.];
    let watcher = RawWatcher::open(&name);
    let (mut read, mut refused, mut ignored) = (0, 0, 0);
    units("messages::messages_of_a_watcher", 20_000, |random| {
        let seq = client
            .publish(0.0, Positions::F32(&triangle))
            .expect("sent");
        let session = session(&client);
        let mut message = valid(session, seq);
        change(&mut message, random);
        watcher.send(message);
        match client.poll() {
            Ok(Some(message)) => {
                read += 1;
                // Any message can be printed, whatever its bytes are.
                let _ = format!("{message} {message:?}");
            }
            Ok(None) => ignored += 1,
            Err(why) => {
                assert!(!why.to_string().is_empty());
                refused += 1;
            }
        }
        client.resume();
        // The next good message is read.
        watcher.send(valid(session, seq));
        let message = loop {
            match client.poll() {
                Ok(Some(message)) if message.seq == seq => break message,
                Ok(Some(_)) | Err(_) => {}
                Ok(None) => panic!("the valid message is lost"),
            }
        };
        assert_eq!(message.verdict, linkwatch::Verdict::Intact);
    });
    println!("messages: {read} read, {refused} refused, {ignored} ignored");
}
