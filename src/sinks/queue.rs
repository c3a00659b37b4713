//! A sink on a thread of its own, behind a bounded queue.
//!
//! The caller hands over a frame by cloning an `Arc`. What happens when the sink is slower than the frames is the
//! caller's choice ([`Overflow`]); what happens when it fails is not: it stays failed, says so once, and costs
//! nothing from then on. The sink lives and dies on its own thread: dropping a stream to a viewer that has
//! stopped reading can block for good, so a thread that does not finish in time is left behind, never joined.

use super::{BaselineRecord, FrameRecord, Sink};
use crate::error::Result;
use crate::verdict::Verdict;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time between flushes while all frames are intact: what a crash may cost at most.
const FLUSH_EVERY: Duration = Duration::from_secs(1);

/// What happens to a frame when the queue is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overflow {
    /// The caller waits: nothing is lost. For recordings.
    Wait,
    /// The oldest waiting frame is given up, and counted; frames at which the verdict turns are kept longest.
    /// For viewers.
    DropOldest,
}

/// What became of a sink.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SinkSummary {
    /// Which sink.
    pub name: &'static str,
    /// Frames that it took.
    pub written: u64,
    /// Frames that it never saw: given up for newer ones, or come after it had failed.
    pub dropped: u64,
    /// Why it failed, if it did.
    pub failed: Option<String>,
}

enum Event {
    Begin(Arc<BaselineRecord>),
    /// A frame, and whether its verdict is another than that of the frame before.
    Frame(Arc<FrameRecord>, bool),
}

#[derive(Default)]
struct State {
    events: VecDeque<Event>,
    frames: usize,
    /// Frames that the sink has taken and not yet written: none or one.
    in_flight: u64,
    last_verdict: Option<Verdict>,
    written: u64,
    dropped: u64,
    failed: Option<String>,
    closing: bool,
    done: bool,
}

struct Shared {
    name: &'static str,
    state: Mutex<State>,
    /// The queue has an event, or is closing.
    filled: Condvar,
    /// The queue has room, or its thread has ended.
    drained: Condvar,
}

impl Shared {
    /// The state is plain data that is valid at every step, so a panic elsewhere does not spoil it.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Marks the sink as failed: what waits for it is lost, and nobody waits any more.
    fn fail(&self, why: String) {
        let mut state = self.lock();
        if state.failed.is_some() {
            return;
        }
        tracing::error!(
            sink = self.name,
            "{} failed and stays off: {why}",
            self.name
        );
        state.dropped += state.frames as u64 + state.in_flight;
        state.events.clear();
        (state.frames, state.in_flight) = (0, 0);
        state.failed = Some(why);
        drop(state);
        self.drained.notify_all();
    }
}

/// A [`Sink`] at work on its own thread.
pub struct SinkQueue {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    capacity: usize,
    overflow: Overflow,
}

impl SinkQueue {
    /// Starts a thread for the sink. At most `capacity` frames (at least one) wait for it.
    pub fn spawn(sink: Box<dyn Sink>, capacity: usize, overflow: Overflow) -> Result<SinkQueue> {
        let shared = Arc::new(Shared {
            name: sink.name(),
            state: Mutex::default(),
            filled: Condvar::new(),
            drained: Condvar::new(),
        });
        let worker = Worker {
            shared: Arc::clone(&shared),
        };
        let thread = std::thread::Builder::new()
            .name(format!("linkwatch-{}", sink.name()))
            .spawn(move || worker.run(sink))?;
        Ok(SinkQueue {
            shared,
            thread: Some(thread),
            capacity: capacity.max(1),
            overflow,
        })
    }

    /// The name of the sink.
    pub fn name(&self) -> &'static str {
        self.shared.name
    }

    /// Hands over the baseline. It takes no room of a frame and is never dropped.
    pub fn begin(&self, baseline: Arc<BaselineRecord>) {
        let mut state = self.shared.lock();
        if state.failed.is_none() {
            state.events.push_back(Event::Begin(baseline));
            self.shared.filled.notify_one();
        }
    }

    /// Hands over a frame. Waits for room under [`Overflow::Wait`] only, and never for a sink that has failed.
    pub fn frame(&self, record: Arc<FrameRecord>) {
        let mut state = self.shared.lock();
        while self.overflow == Overflow::Wait
            && state.frames >= self.capacity
            && state.failed.is_none()
        {
            let wait = self.shared.drained.wait(state);
            state = wait.unwrap_or_else(PoisonError::into_inner);
        }
        if state.failed.is_some() {
            state.dropped += 1;
            return;
        }
        if state.frames >= self.capacity {
            make_room(&mut state);
            if state.dropped == 1 {
                tracing::warn!(
                    sink = self.shared.name,
                    "{} is slower than the frames: it skips some",
                    self.shared.name
                );
            }
        }
        let turn = state.last_verdict != Some(record.report.verdict);
        state.last_verdict = Some(record.report.verdict);
        state.events.push_back(Event::Frame(record, turn));
        state.frames += 1;
        self.shared.filled.notify_one();
    }

    /// What became of the sink up to now.
    pub fn summary(&self) -> SinkSummary {
        let state = self.shared.lock();
        SinkSummary {
            name: self.shared.name,
            written: state.written,
            dropped: state.dropped,
            failed: state.failed.clone(),
        }
    }

    /// Lets the sink take what waits, closes it, and says what became of it. After `limit` its thread is left
    /// to itself: the process may exit, and what the sink still held is lost and reported.
    pub fn finish(mut self, limit: Duration) -> SinkSummary {
        let deadline = Instant::now() + limit;
        let mut state = self.shared.lock();
        state.closing = true;
        self.shared.filled.notify_one();
        while !state.done && state.failed.is_none() {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            let wait = self.shared.drained.wait_timeout(state, left);
            state = wait.unwrap_or_else(PoisonError::into_inner).0;
        }
        let late = !state.done && state.failed.is_none();
        let done = state.done;
        drop(state);
        if late {
            self.shared.fail(format!(
                "did not finish within {:.1} s",
                limit.as_secs_f64()
            ));
        }
        if let Some(thread) = self.thread.take().filter(|_| done) {
            // The thread has said that it is done; a panic of it is in the summary.
            thread.join().ok();
        }
        self.summary()
    }
}

impl Drop for SinkQueue {
    /// The thread goes on with what waits, closes the sink and ends, unobserved.
    fn drop(&mut self) {
        self.shared.lock().closing = true;
        self.shared.filled.notify_one();
    }
}

/// Gives up the oldest frame that is no turn of the verdict; where all are, the oldest.
fn make_room(state: &mut State) {
    let find = |turns: bool| {
        state
            .events
            .iter()
            .position(|e| matches!(e, Event::Frame(_, turn) if turns || !turn))
    };
    if let Some(at) = find(false).or_else(|| find(true)) {
        state.events.remove(at);
        state.frames -= 1;
        state.dropped += 1;
    }
}

/// The thread's side.
struct Worker {
    shared: Arc<Shared>,
}

impl Worker {
    fn run(self, mut sink: Box<dyn Sink>) {
        match self.feed(sink.as_mut()) {
            Ok(true) => {
                if let Err(e) = sink.finish() {
                    self.shared.fail(e.to_string());
                }
            }
            // Failed from outside (too late): the sink is dropped here, on its own thread.
            Ok(false) => {}
            Err(e) => self.shared.fail(e.to_string()),
        }
    }

    /// Feeds the sink until the queue closes (true) or somebody gave it up (false).
    fn feed(&self, sink: &mut dyn Sink) -> Result<bool> {
        let mut flushed = Instant::now();
        let mut dirty = false;
        loop {
            let mut state = self.shared.lock();
            let event = loop {
                if state.failed.is_some() {
                    return Ok(false);
                }
                if let Some(event) = state.events.pop_front() {
                    break Some(event);
                }
                if state.closing {
                    return Ok(true);
                }
                if !dirty {
                    let wait = self.shared.filled.wait(state);
                    state = wait.unwrap_or_else(PoisonError::into_inner);
                    continue;
                }
                let left = FLUSH_EVERY.saturating_sub(flushed.elapsed());
                if left.is_zero() {
                    break None;
                }
                let wait = self.shared.filled.wait_timeout(state, left);
                state = wait.unwrap_or_else(PoisonError::into_inner).0;
            };
            if let Some(Event::Frame(..)) = event {
                state.frames -= 1;
                state.in_flight = 1;
                self.shared.drained.notify_all();
            }
            drop(state);
            let mut urgent = event.is_none();
            match event {
                Some(Event::Begin(baseline)) => sink.begin(&baseline)?,
                Some(Event::Frame(record, _)) => {
                    sink.frame(&record)?;
                    let mut state = self.shared.lock();
                    state.written += std::mem::take(&mut state.in_flight);
                    urgent = record.report.verdict != Verdict::Intact;
                }
                None => {}
            }
            dirty = true;
            if urgent || flushed.elapsed() >= FLUSH_EVERY {
                sink.flush()?;
                flushed = Instant::now();
                dirty = false;
            }
        }
    }
}

impl Drop for Worker {
    /// Runs on every way out of the thread, a panic of the sink included.
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.shared.fail("panicked".into());
        }
        self.shared.lock().done = true;
        self.shared.drained.notify_all();
    }
}

#[cfg(test)]
mod tests;
