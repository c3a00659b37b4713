//! Tests of the queue with sinks that are slow, fail or block.

use super::*;
use crate::error::Error;
use crate::ingest::FrameInfo;
use crate::verdict::Report;
use std::sync::mpsc::{Receiver, Sender, channel};

/// A sink that takes a frame for every permit, and reports its calls.
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
    fn begin(&mut self, _: &BaselineRecord) -> Result<()> {
        Ok(())
    }
    fn frame(&mut self, record: &FrameRecord) -> Result<()> {
        // The receiver is dropped when a test ends, and the sink then stops waiting.
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
        info: FrameInfo::default(),
        report: Arc::new(Report::new(seq, 0.0, verdict)),
        progress: Default::default(),
    })
}

const LONG: Duration = Duration::from_secs(60);

const WAIT: Overflow = Overflow::Wait(LONG);

fn spawn(sink: Box<Probe>, capacity: usize, overflow: Overflow) -> SinkQueue {
    SinkQueue::spawn("probe", capacity, overflow, move || Ok(sink)).unwrap()
}

/// Waits until the sink holds the first frame, so that the queue is empty.
fn hold(queue: &SinkQueue, verdict: Verdict) {
    queue.frame(frame(1, verdict));
    while queue.shared.lock().frames > 0 {
        std::thread::yield_now();
    }
}

/// Returns how long the next frame may wait.
fn patience(queue: &SinkQueue) -> Duration {
    queue.shared.lock().patience
}

#[test]
fn drops_and_counts_the_oldest_frames_but_keeps_changes_of_the_verdict() {
    let (sink, handle) = probe(None);
    let queue = spawn(sink, 3, Overflow::DropOldest);
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
fn a_recording_waits_and_loses_no_frame() {
    let (sink, handle) = probe(None);
    let queue = spawn(sink, 2, WAIT);
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
fn a_failed_sink_stays_closed_and_delays_no_caller() {
    let (sink, handle) = probe(Some(3));
    drop(handle.permits);
    let queue = spawn(sink, 1, WAIT);
    for seq in 1..=50 {
        queue.frame(frame(seq, Verdict::Intact));
    }
    let summary = queue.finish(LONG);
    // Two frames were taken, but not flushed.
    assert_eq!((summary.written, summary.dropped), (0, 50));
    assert_eq!(summary.failed.as_deref(), Some("probe: disk full"));
}

#[test]
fn a_blocked_sink_is_abandoned() {
    let (sink, handle) = probe(None);
    let queue = spawn(sink, 4, Overflow::DropOldest);
    hold(&queue, Verdict::Intact);
    queue.frame(frame(2, Verdict::Intact));
    let summary = queue.finish(Duration::from_millis(20));
    assert_eq!((summary.written, summary.dropped), (0, 2));
    assert!(summary.failed.unwrap().contains("did not finish"));
    drop(handle.permits);
}

#[test]
fn a_changed_frame_is_flushed_at_once() {
    let (sink, handle) = probe(None);
    drop(handle.permits);
    let queue = spawn(sink, 4, WAIT);
    queue.frame(frame(1, Verdict::Changed));
    assert!(handle.flushes.recv_timeout(LONG).is_ok());
    // An intact one is flushed within about a second, without a later frame.
    queue.frame(frame(2, Verdict::Intact));
    assert!(handle.flushes.recv_timeout(LONG).is_ok());
    queue.finish(LONG);
}

/// Regression test: the caller waited as long as the sink accepted no frame.
#[test]
fn a_frozen_sink_delays_the_caller_once_and_for_a_limited_time() {
    let (sink, handle) = probe(None);
    let limit = Duration::from_millis(100);
    let queue = spawn(sink, 4, Overflow::Wait(limit));
    hold(&queue, Verdict::Intact);
    let start = Instant::now();
    for seq in 2..=200 {
        queue.frame(frame(seq, Verdict::Intact));
    }
    assert!(start.elapsed() >= limit);
    assert_eq!(patience(&queue), Duration::ZERO, "no later frame waits");
    // When the disk works again, the newest frames arrive, and the time limit is restored.
    let dropped = queue.summary().dropped;
    assert_eq!(dropped, 195);
    (0..6).for_each(|_| handle.permits.send(()).unwrap());
    let seen: Vec<u64> = (0..5)
        .map(|_| handle.seen.recv_timeout(LONG).unwrap().0)
        .collect();
    assert_eq!(seen[1..], [197, 198, 199, 200]);
    while patience(&queue) < limit {
        std::thread::yield_now();
    }
    drop(handle.permits);
    let summary = queue.finish(LONG);
    assert_eq!((summary.written, summary.dropped), (5, 195));
}

/// Frames without curves.
#[test]
fn small_frames_wait_beyond_the_capacity() {
    let (sink, handle) = probe(None);
    let queue = spawn(sink, 2, Overflow::Wait(Duration::ZERO)).with_points(10 * FRAME_POINTS);
    hold(&queue, Verdict::Intact);
    (2..=13).for_each(|seq| queue.frame(frame(seq, Verdict::Intact)));
    assert_eq!(queue.summary().dropped, 2);
    drop(handle.permits);
    assert_eq!(queue.finish(LONG).written, 11);
}

#[test]
fn a_replay_waits_for_a_slow_sink_but_not_for_a_frozen_one() {
    let limit = Duration::from_millis(200);
    let (sink, handle) = probe(None);
    let queue = spawn(sink, 1, Overflow::WaitForProgress(limit));
    let slow = std::thread::spawn(move || {
        // Each frame takes half of the limit; all together they take much longer.
        for _ in 0..12 {
            std::thread::sleep(limit / 2);
            handle.permits.send(()).unwrap();
        }
        handle
    });
    (1..=12).for_each(|seq| queue.frame(frame(seq, Verdict::Intact)));
    let handle = slow.join().unwrap();
    while queue.summary().written < 12 {
        std::thread::yield_now();
    }
    assert_eq!(queue.summary().dropped, 0);
    (13..=100).for_each(|seq| queue.frame(frame(seq, Verdict::Intact)));
    assert_eq!(patience(&queue), Duration::ZERO, "no later frame waits");
    assert!(queue.summary().dropped > 80);
    drop(handle.permits);
    queue.finish(LONG);
}

/// Regression test: a viewer that opens slowly, or shows frames slowly, missed most frames of a
/// replay.
#[test]
fn a_replay_waits_for_a_viewer_to_open_and_to_take_its_last_frames() {
    let limit = Duration::from_secs(2);
    let (sink, handle) = probe(None);
    let queue = SinkQueue::spawn("probe", 3, Overflow::WaitForProgress(limit), move || {
        std::thread::sleep(limit / 4);
        Ok(sink)
    })
    .unwrap();
    let slow = std::thread::spawn(move || {
        (1..=26).for_each(|_| handle.permits.send(()).unwrap());
        // Each of the last frames takes a part of the limit; together they take longer.
        for _ in 27..=30 {
            std::thread::sleep(limit * 2 / 5);
            handle.permits.send(()).unwrap();
        }
    });
    (1..=30).for_each(|seq| queue.frame(frame(seq, Verdict::Intact)));
    // The limit of the caller is that of all sinks of a live run.
    let summary = queue.finish(Duration::ZERO);
    let SinkSummary {
        written, dropped, ..
    } = summary;
    assert_eq!((written, dropped, summary.failed), (30, 0, None));
    slow.join().unwrap();
}

#[test]
fn a_sink_is_opened_on_its_own_thread_at_the_first_event() {
    let (sink, handle) = probe(None);
    drop(handle.permits);
    let (opened, open) = channel::<()>();
    let queue = SinkQueue::spawn("probe", 4, Overflow::Wait(LONG), move || {
        open.recv().unwrap();
        Ok(sink)
    })
    .unwrap();
    // Opening blocks, but the caller does not wait, neither before the first event nor after it.
    let start = Instant::now();
    (1..=3).for_each(|seq| queue.frame(frame(seq, Verdict::Intact)));
    assert!(start.elapsed() < LONG / 2);
    opened.send(()).unwrap();
    assert_eq!(queue.finish(LONG).written, 3);

    let queue = SinkQueue::spawn("probe", 4, Overflow::Wait(LONG), || {
        panic!("opened without an event")
    })
    .unwrap();
    let summary = queue.finish(LONG);
    assert_eq!((summary.written, summary.failed), (0, None));
}

#[test]
fn an_error_of_opening_goes_to_the_waiting_caller_or_into_the_summary() {
    let fails = || {
        let what = "no viewer".into();
        Err(Error::Sink {
            sink: "probe",
            what,
        })
    };
    let queue = SinkQueue::spawn("probe", 4, Overflow::DropOldest, fails).unwrap();
    let e = queue.open(LONG).unwrap_err().to_string();
    assert_eq!(e, "probe: no viewer");
    let queue = SinkQueue::spawn("probe", 4, Overflow::DropOldest, fails).unwrap();
    queue.frame(frame(1, Verdict::Intact));
    let summary = queue.finish(LONG);
    assert_eq!((summary.written, summary.dropped), (0, 1));
    assert_eq!(summary.failed.as_deref(), Some("probe: no viewer"));
    // A slow viewer continues to open in the background.
    let (sink, handle) = probe(None);
    drop(handle.permits);
    let (opened, open) = channel::<()>();
    let queue = SinkQueue::spawn("probe", 4, Overflow::DropOldest, move || {
        open.recv().unwrap();
        Ok(sink)
    })
    .unwrap();
    queue.open(Duration::from_millis(10)).unwrap();
    queue.frame(frame(1, Verdict::Intact));
    opened.send(()).unwrap();
    assert_eq!(queue.finish(LONG).written, 1);
}

/// Behaviour of a disk at one frame.
#[derive(Clone, Copy, Debug)]
enum Disk {
    Quick,
    Slow,
    Frozen,
    /// Frozen until the caller has passed all frames.
    Dead,
    Full,
}

/// A recording on a disk whose behaviour changes at every frame.
struct Recording {
    disk: Vec<Disk>,
    /// Disconnected once the caller has passed all frames.
    alive: Receiver<()>,
    seen: Sender<String>,
}

impl Recording {
    fn take(&mut self, what: String) -> Result<()> {
        match self.disk.pop().unwrap_or(Disk::Quick) {
            Disk::Quick => {}
            Disk::Slow => std::thread::sleep(Duration::from_millis(2)),
            Disk::Frozen => std::thread::sleep(Duration::from_millis(60)),
            Disk::Dead => _ = self.alive.recv_timeout(LONG),
            Disk::Full => return Err(std::io::Error::from(std::io::ErrorKind::StorageFull).into()),
        }
        self.seen.send(what).ok();
        Ok(())
    }
}

impl Sink for Recording {
    fn begin(&mut self, baseline: &BaselineRecord) -> Result<()> {
        self.take(baseline.origin.clone())
    }
    fn frame(&mut self, record: &FrameRecord) -> Result<()> {
        self.take(record.report.seq.to_string())
    }
    fn flush(&mut self) -> Result<()> {
        Ok(())
    }
    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}

/// Full, slow and frozen disks. The caller never waits longer than its limit, every frame is
/// written or counted, the order is kept, and the baseline comes first.
#[test]
fn no_disk_delays_the_caller_or_loses_an_uncounted_frame() {
    use proptest::prelude::*;
    let disk = prop_oneof![
        8 => Just(Disk::Quick),
        4 => Just(Disk::Slow),
        1 => Just(Disk::Frozen),
        1 => Just(Disk::Dead),
        1 => Just(Disk::Full),
    ];
    let case = (
        proptest::collection::vec(disk, 0..40),
        1_usize..6,
        0_u64..8,
        any::<bool>(),
    );
    proptest!(ProptestConfig::with_cases(48), |((disk, capacity, patience, opened) in case)| {
        let patience = Duration::from_millis(patience);
        let (saw, seen) = channel();
        let (dead, alive) = channel();
        let full = disk.iter().any(|d| matches!(d, Disk::Full));
        let frames = 40;
        let queue = SinkQueue::spawn("recording", capacity, Overflow::Wait(patience), move || {
            Ok(Box::new(Recording { disk, alive, seen: saw }))
        })
        .unwrap();
        if opened {
            queue.open(LONG).unwrap();
        }
        queue.begin(Arc::new(BaselineRecord {
            certificate: Arc::default(),
            origin: "baseline".into(),
            frame: Some(0),
            unverified: 0,
        }));
        let start = Instant::now();
        for seq in 1..=frames {
            let verdict = [Verdict::Intact, Verdict::Changed][(seq / 7 % 2) as usize];
            queue.frame(frame(seq, verdict));
        }
        // The disk is dead until now, but the caller did not wait for it.
        prop_assert!(start.elapsed() < LONG / 2);
        drop(dead);
        let summary = queue.finish(LONG);
        let seen: Vec<String> = seen.iter().collect();
        prop_assert_eq!(summary.written + summary.dropped, frames);
        prop_assert!(summary.failed.is_none() || full);
        let numbers: Vec<u64> = seen.iter().skip(1).map(|s| s.parse().unwrap()).collect();
        prop_assert!(numbers.is_sorted());
        prop_assert!(numbers.len() as u64 == summary.written || full);
        if let Some(first) = seen.first() {
            prop_assert_eq!(first, "baseline");
        }
        if summary.failed.is_none() {
            prop_assert_eq!(numbers.last(), Some(&frames));
        }
    });
}

/// A sink with deferred work: each frame creates three pieces of it.
struct Patient {
    left: usize,
    calls: Sender<&'static str>,
    go: Receiver<()>,
}

impl Sink for Patient {
    fn begin(&mut self, _: &BaselineRecord) -> Result<()> {
        self.calls.send("begin").ok();
        Ok(())
    }
    fn expect(&mut self, _: &BaselineRecord) -> Result<()> {
        self.calls.send("expect").ok();
        Ok(())
    }
    fn frame(&mut self, _: &FrameRecord) -> Result<()> {
        self.go.recv().ok();
        self.left += 3;
        self.calls.send("frame").ok();
        Ok(())
    }
    fn work(&mut self) -> Result<bool> {
        self.left -= 1;
        self.calls.send("work").ok();
        Ok(self.left > 0)
    }
    fn flush(&mut self) -> Result<()> {
        Ok(())
    }
    fn note(&self) -> Option<String> {
        Some(format!("{} left", self.left))
    }
    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}

#[test]
fn work_that_can_wait_is_done_while_no_frame_waits() {
    let (calls, called) = channel();
    let (permits, go) = channel();
    let sink = Patient { left: 0, calls, go };
    let queue = SinkQueue::spawn("patient", 4, WAIT, move || Ok(Box::new(sink))).unwrap();
    let baseline = Arc::new(BaselineRecord {
        certificate: Arc::default(),
        origin: "baseline".into(),
        frame: Some(0),
        unverified: 0,
    });
    queue.begin(Arc::clone(&baseline));
    queue.frame(frame(1, Verdict::Intact));
    queue.expect(baseline);
    queue.frame(frame(2, Verdict::Intact));
    (0..2).for_each(|_| permits.send(()).unwrap());
    let next = |n: usize| -> Vec<&str> {
        let next = (0..n).map(|_| called.recv_timeout(LONG).unwrap());
        next.collect()
    };
    // Both frames waited before the first one was taken.
    let work = vec!["work"; 6];
    assert_eq!(next(4), ["begin", "frame", "expect", "frame"]);
    assert_eq!(next(6), work);
    let summary = queue.finish(LONG);
    assert_eq!(
        (summary.written, summary.note.as_deref()),
        (2, Some("0 left"))
    );
}
