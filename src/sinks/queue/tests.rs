//! The queue with sinks that are slow, fail or hang.

use super::*;
use crate::error::Error;
use crate::verdict::Report;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::SystemTime;

/// Takes a frame for every permit; reports what it saw.
struct Probe {
    permits: Receiver<()>,
    seen: Sender<(u64, bool)>,
    fail_at: Option<u64>,
    flushes: Sender<()>,
}

struct Handle {
    permits: Sender<()>,
    seen: Receiver<(u64, bool)>,
    flushes: Receiver<()>,
}

fn probe(fail_at: Option<u64>) -> (Box<Probe>, Handle) {
    let (permits, taken) = channel();
    let (saw, seen) = channel();
    let (flushed, flushes) = channel();
    let sink = Probe {
        permits: taken,
        seen: saw,
        fail_at,
        flushes: flushed,
    };
    let handle = Handle {
        permits,
        seen,
        flushes,
    };
    (Box::new(sink), handle)
}

impl Sink for Probe {
    fn name(&self) -> &'static str {
        "probe"
    }
    fn begin(&mut self, _: &BaselineRecord) -> Result<()> {
        Ok(())
    }
    fn frame(&mut self, record: &FrameRecord) -> Result<()> {
        // The receiver is gone when a test is over; then nothing is to be waited for.
        self.permits.recv().ok();
        let seq = record.report.seq;
        if self.fail_at == Some(seq) {
            return Err(Error::Sink {
                sink: "probe",
                what: "disk full".into(),
            });
        }
        self.seen.send((seq, false)).ok();
        Ok(())
    }
    fn flush(&mut self) -> Result<()> {
        self.flushes.send(()).ok();
        Ok(())
    }
    fn finish(self: Box<Self>) -> Result<()> {
        self.seen.send((0, true)).ok();
        Ok(())
    }
}

fn frame(seq: u64, verdict: Verdict) -> Arc<FrameRecord> {
    Arc::new(FrameRecord {
        curves: None,
        cuts: 0,
        report: Arc::new(Report {
            seq,
            time: 0.0,
            verdict,
            abort: false,
            changes: Vec::new(),
            events: Vec::new(),
            unresolved: Vec::new(),
            defects: Vec::new(),
            adopted: Vec::new(),
            rejected: None,
            stats: Default::default(),
        }),
        verified: 0,
        skipped: 0,
        rejected: 0,
        check: Duration::ZERO,
        work: Default::default(),
        received: SystemTime::UNIX_EPOCH,
    })
}

const LONG: Duration = Duration::from_secs(60);

/// Waits until the sink holds the first frame, so that the queue behind it is empty.
fn hold(queue: &SinkQueue, verdict: Verdict) {
    queue.frame(frame(1, verdict));
    while queue.shared.lock().frames > 0 {
        std::thread::yield_now();
    }
}

#[test]
fn the_oldest_frames_give_way_and_are_counted_but_turns_stay() {
    let (sink, handle) = probe(None);
    let queue = SinkQueue::spawn(sink, 3, Overflow::DropOldest).unwrap();
    hold(&queue, Verdict::Intact);
    for seq in 2..=9 {
        let verdict = if seq < 4 {
            Verdict::Intact
        } else {
            Verdict::Changed
        };
        queue.frame(frame(seq, verdict));
    }
    drop(handle.permits);
    let summary = queue.finish(LONG);
    assert_eq!((summary.written, summary.dropped), (4, 5));
    assert_eq!(summary.failed, None);
    let seen: Vec<_> = handle.seen.iter().collect();
    assert_eq!(
        seen,
        [(1, false), (4, false), (8, false), (9, false), (0, true)]
    );
}

#[test]
fn a_recording_waits_and_loses_nothing() {
    let (sink, handle) = probe(None);
    let queue = SinkQueue::spawn(sink, 2, Overflow::Wait).unwrap();
    for _ in 0..100 {
        handle.permits.send(()).unwrap();
    }
    for seq in 1..=100 {
        queue.frame(frame(seq, Verdict::Intact));
    }
    let summary = queue.finish(LONG);
    assert_eq!((summary.written, summary.dropped), (100, 0));
    let seen: Vec<_> = handle.seen.iter().map(|s| s.0).take(100).collect();
    assert_eq!(seen, (1..=100).collect::<Vec<_>>());
}

#[test]
fn a_failed_sink_stays_failed_and_holds_nobody_up() {
    let (sink, handle) = probe(Some(3));
    drop(handle.permits);
    let queue = SinkQueue::spawn(sink, 1, Overflow::Wait).unwrap();
    for seq in 1..=50 {
        queue.frame(frame(seq, Verdict::Intact));
    }
    let summary = queue.finish(LONG);
    assert_eq!((summary.written, summary.dropped), (2, 48));
    assert_eq!(summary.failed.as_deref(), Some("probe: disk full"));
}

#[test]
fn a_sink_that_hangs_is_left_behind() {
    let (sink, handle) = probe(None);
    let queue = SinkQueue::spawn(sink, 4, Overflow::DropOldest).unwrap();
    hold(&queue, Verdict::Intact);
    queue.frame(frame(2, Verdict::Intact));
    let summary = queue.finish(Duration::from_millis(20));
    assert_eq!((summary.written, summary.dropped), (0, 2));
    assert!(summary.failed.unwrap().contains("did not finish"));
    drop(handle.permits);
}

#[test]
fn a_broken_frame_is_flushed_at_once() {
    let (sink, handle) = probe(None);
    drop(handle.permits);
    let queue = SinkQueue::spawn(sink, 4, Overflow::Wait).unwrap();
    queue.frame(frame(1, Verdict::Changed));
    assert!(handle.flushes.recv_timeout(LONG).is_ok());
    // And an intact one within about a second, with no frame after it.
    queue.frame(frame(2, Verdict::Intact));
    assert!(handle.flushes.recv_timeout(LONG).is_ok());
    queue.finish(LONG);
}
