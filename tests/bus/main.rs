//! The bus between a simulator and the watcher: in one process, across processes, and with killed
//! processes.

mod cells;
mod death;
mod hostile;
mod lockstep;
mod random;
mod services;
mod sessions;
#[path = "../support/mod.rs"]
mod support;

use linkwatch::{
    Basis, Client, ClientOptions, Counters, CurveSet, Event, Frame, Precision, Report, Sidecar,
    SidecarOptions, Verdict,
};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;
use support::time::{LONG, PATIENCE, until, without_time_out};

/// Two closed curves of four points.
const COUNTS: [i32; 2] = [-4, -4];

/// Returns the name of a service that no other test uses.
fn service() -> String {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let n = COUNT.fetch_add(1, Ordering::Relaxed);
    format!("linkwatch test {}.{n}", std::process::id())
}

fn sidecar(service: &str) -> Sidecar {
    Sidecar::open(service, &SidecarOptions::default()).expect("sidecar")
}

/// Creates a client whose frames have [`COUNTS`] in single precision.
fn client(service: &str) -> Client {
    let mut client = Client::open(service, &ClientOptions::default()).expect("client");
    client
        .describe(Basis::Polyline, Precision::F32, &COUNTS)
        .expect("describe");
    client
}

/// Returns positions that differ from frame to frame.
fn positions(seq: u64) -> Vec<f32> {
    (0..24).map(|k| seq as f32 + k as f32 / 64.0).collect()
}

fn publish(client: &mut Client, seq: u64) {
    let mut frame = client.loan(seq as f64 / 100.0).expect("loan");
    let out = frame.positions_f32().expect("single precision");
    out.copy_from_slice(&positions(seq));
    assert_eq!(frame.publish().expect("publish"), seq);
}

/// Returns the next event that is not [`Event::Idle`].
fn next(sidecar: &mut Sidecar) -> Event {
    until("an event", || {
        match sidecar.wait(Duration::from_millis(100)).expect("wait") {
            Event::Idle => None,
            event => Some(event),
        }
    })
}

fn next_frame(sidecar: &mut Sidecar) -> Frame {
    match next(sidecar) {
        Event::Frame(frame) => frame,
        other => panic!("expected a frame, got {other:?}"),
    }
}

fn new_session(sidecar: &mut Sidecar) -> u64 {
    match next(sidecar) {
        Event::NewSession { session } => session,
        other => panic!("expected a new session, got {other:?}"),
    }
}

/// Returns true if `set` has the [`positions`] of `seq`.
fn holds(set: &CurveSet, seq: u64) -> bool {
    let mut bytes = Vec::new();
    set.write_positions(&mut bytes);
    let expected: Vec<u8> = positions(seq)
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    bytes == expected
}

/// Creates a report without findings.
fn report(frame: &Frame, verdict: Verdict) -> Report {
    let mut report = Report::new(frame.seq(), frame.time(), verdict);
    report.abort = verdict == Verdict::Changed;
    report
}

/// Answers a frame like a watcher without findings.
fn answer(sidecar: &mut Sidecar, frame: &Frame, set: &mut Option<CurveSet>) {
    let rejected = frame.ingest(set).err().map(|e| e.to_string());
    let verdict = match rejected {
        None => Verdict::Intact,
        Some(_) => Verdict::Rejected,
    };
    let mut report = report(frame, verdict);
    report.rejected = rejected;
    let check = Duration::from_micros(1);
    sidecar.send_verdict(&report, check).expect("verdict");
}

/// Answers the next frame, with any sequence number.
fn answer_next(sidecar: &mut Sidecar) -> u64 {
    let frame = next_frame(sidecar);
    answer(sidecar, &frame, &mut None);
    frame.seq()
}

/// Watches until the session ends. Each check takes the time `work`.
fn watch_to_the_end(sidecar: &mut Sidecar, work: Duration) -> (u64, Counters, bool) {
    let mut set = None;
    loop {
        match next(sidecar) {
            Event::NewSession { .. } => {}
            Event::Frame(frame) => {
                std::thread::sleep(work);
                answer(sidecar, &frame, &mut set);
                assert!(holds(set.as_ref().expect("a good frame"), frame.seq()));
            }
            Event::End {
                published,
                counters,
                clean,
                ..
            } => return (published, counters, clean),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn both_ends_may_move_to_another_thread() {
    fn is_send<T: Send>() {}
    is_send::<Client>();
    is_send::<Sidecar>();
    is_send::<linkwatch::FrameLoan<'_>>();
    is_send::<Event>();
}
