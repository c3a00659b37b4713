//! Runs a sink on a thread, behind a bounded queue.
//!
//! The caller passes a frame by cloning an `Arc`. It chooses the policy if the sink is slower than
//! the frames ([`Overflow`]). A sink that fails is closed for good, reports the failure once, and
//! costs nothing from then on. The sink is opened, used and dropped on its own thread: a frozen
//! disk can block the creation of a file as well as a write, and dropping a stream to a viewer that
//! has stopped reading can block without limit. Therefore a thread that does not finish in time is
//! abandoned, not joined.

use super::{BaselineRecord, FrameRecord, Sink};
use crate::error::{Error, Result};
use crate::verdict::Verdict;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval of flushes while all frames are intact: the most that a crash can lose.
const FLUSH_EVERY: Duration = Duration::from_secs(1);

/// Time after which a warning is logged while the caller waits for the sink.
const SILENCE: Duration = Duration::from_secs(2);

/// Policy if the queue is full.
///
/// If the queue is still full after waiting, the oldest waiting frame is dropped and counted.
/// Frames at which the verdict changes are kept longest. The baseline is never dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overflow {
    /// The caller waits for capacity, at most for this time in total until the sink has caught up.
    /// For a recording of a live simulation: a short delay of the disk loses no frame, and a frozen
    /// disk delays the watch only once.
    Wait(Duration),
    /// The caller waits for capacity while the sink takes at least one frame within this time. For
    /// a replay, on which no simulator waits: a slow disk or viewer loses no frame.
    WaitForProgress(Duration),
    /// The caller never waits. For viewers of a live simulation.
    DropOldest,
}

impl Overflow {
    /// Returns the longest time that the caller waits while the sink takes no frame.
    pub fn max_wait(self) -> Duration {
        match self {
            Overflow::Wait(limit) | Overflow::WaitForProgress(limit) => limit,
            Overflow::DropOldest => Duration::ZERO,
        }
    }
}

/// Result of a sink.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct SinkSummary {
    /// Name of the sink.
    pub name: &'static str,
    /// Frames that the sink took. If it failed, only those that were flushed by then.
    pub written: u64,
    /// Number of frames that the sink missed: dropped for newer ones, not flushed when it failed,
    /// or passed to it after the failure.
    pub dropped: u64,
    /// Reason of the failure, if it failed.
    pub failed: Option<String>,
    /// Note of the sink about its result when it ends ([`Sink::note`]).
    pub note: Option<String>,
}

enum Event {
    Begin(Arc<BaselineRecord>),
    Expect(Arc<BaselineRecord>),
    CutOff(&'static str),
    /// A frame, and true if its verdict differs from that of the previous frame.
    Frame(Arc<FrameRecord>, bool),
}

#[derive(Default)]
struct State {
    events: VecDeque<Event>,
    frames: usize,
    /// Number of points and findings of the waiting frames.
    points: usize,
    /// Number of frames that the sink is writing: 0 or 1.
    in_flight: u64,
    /// Remaining time that the caller may wait for capacity.
    patience: Duration,
    opening: Opening,
    last_verdict: Option<Verdict>,
    summary: SinkSummary,
    /// Number of frames written at the last flush.
    flushed: u64,
    closing: bool,
    done: bool,
}

/// State of a sink that may not be open yet.
#[derive(Default)]
enum Opening {
    /// The sink is opened at the first event.
    #[default]
    AtFirstEvent,
    /// A caller waits until the sink is open.
    Now,
    /// Result of opening the sink; an error is returned to the waiting caller.
    Done(Result<()>),
}

impl State {
    fn has_failed(&self) -> bool {
        self.summary.failed.is_some()
    }
}

struct Shared {
    overflow: Overflow,
    name: &'static str,
    state: Mutex<State>,
    /// The queue has an event, or is closing.
    filled: Condvar,
    /// The queue has capacity, the sink is open, or its thread has ended.
    drained: Condvar,
}

impl Shared {
    /// Locks the state. The state is plain data that is valid at every step, so a panic elsewhere
    /// does not invalidate it.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits while a condition holds, at most for `limit`.
    fn wait_while<'a>(
        &'a self,
        state: MutexGuard<'a, State>,
        limit: Duration,
        holds: impl Fn(&State) -> bool,
    ) -> MutexGuard<'a, State> {
        let holds = |state: &mut State| holds(state);
        let wait = self.drained.wait_timeout_while(state, limit, holds);
        wait.unwrap_or_else(PoisonError::into_inner).0
    }

    /// Like [`Shared::wait_while`], but logs a warning if the wait is long. `word` is the predicate
    /// of the warning.
    fn wait_with_warning<'a>(
        &'a self,
        mut state: MutexGuard<'a, State>,
        limit: Duration,
        holds: impl Fn(&State) -> bool,
        word: &str,
    ) -> MutexGuard<'a, State> {
        let (silent, more) = (limit.min(SILENCE), limit.saturating_sub(SILENCE));
        state = self.wait_while(state, silent, &holds);
        if holds(&state) && !more.is_zero() {
            let name = self.name;
            tracing::warn!("{name} {word} for {SILENCE:?}; waiting at most {more:.0?} more");
            state = self.wait_while(state, more, &holds);
        }
        state
    }

    /// Marks the sink as failed, unless it is. Waiting frames are lost, and no caller waits any
    /// more. The error of opening is passed to the caller that waits for it, or else logged.
    fn fail(&self, why: String, of_opening: Option<Error>) {
        let mut state = self.lock();
        if state.has_failed() {
            return;
        }
        match (&state.opening, of_opening) {
            (Opening::Now, Some(error)) => state.opening = Opening::Done(Err(error)),
            _ => {
                let name = self.name;
                tracing::error!("{name} failed and is closed for the rest of the run: {why}");
            }
        }
        let unflushed = state.summary.written - state.flushed;
        state.summary.dropped += state.frames as u64 + state.in_flight + unflushed;
        state.summary.written = state.flushed;
        state.summary.failed = Some(why);
        state.events.clear();
        (state.frames, state.points, state.in_flight) = (0, 0, 0);
        drop(state);
        self.drained.notify_all();
    }
}

/// A [`Sink`] that runs on its own thread.
pub struct SinkQueue {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    capacity: usize,
    points: usize,
}

impl SinkQueue {
    /// Starts a thread for a sink. `open` opens the sink on that thread at the first event. At most
    /// `capacity` frames (at least one) wait for it.
    ///
    /// # Errors
    ///
    /// The thread cannot be started.
    pub fn spawn(
        name: &'static str,
        capacity: usize,
        overflow: Overflow,
        open: impl FnOnce() -> Result<Box<dyn Sink>> + Send + 'static,
    ) -> Result<SinkQueue> {
        let shared = Arc::new(Shared {
            overflow,
            name,
            state: Mutex::default(),
            filled: Condvar::new(),
            drained: Condvar::new(),
        });
        let mut state = shared.lock();
        state.patience = overflow.max_wait();
        state.summary.name = name;
        drop(state);
        let worker = Worker {
            shared: Arc::clone(&shared),
        };
        let thread = std::thread::Builder::new().name(format!("linkwatch-{name}"));
        Ok(SinkQueue {
            thread: Some(thread.spawn(move || worker.run(open))?),
            shared,
            capacity: capacity.max(1),
            points: 0,
        })
    }

    /// Lets more frames than the capacity wait, as long as all waiting frames together have fewer
    /// than `points` points. Thus a disk that stalls for a second loses no small frames.
    pub fn with_points(mut self, points: usize) -> SinkQueue {
        self.points = points;
        self
    }

    fn is_full(&self, state: &State) -> bool {
        state.frames >= self.capacity && state.points >= self.points
    }

    /// Opens the sink now, before any event, and waits for that at most `limit`. After that, the
    /// sink continues to open in the background.
    ///
    /// # Errors
    ///
    /// The error of opening the sink.
    pub fn open(&self, limit: Duration) -> Result<()> {
        let mut state = self.shared.lock();
        if let Opening::AtFirstEvent = state.opening {
            state.opening = Opening::Now;
            self.shared.filled.notify_one();
        }
        let opening = |s: &State| matches!(s.opening, Opening::Now) && !s.has_failed();
        state = self.shared.wait_while(state, limit, opening);
        match &mut state.opening {
            Opening::Done(outcome) => std::mem::replace(outcome, Ok(())),
            // From now on the thread reports an error itself.
            other => {
                *other = Opening::AtFirstEvent;
                Ok(())
            }
        }
    }

    /// Returns true if every frame should arrive: a dropped frame makes the sink incomplete.
    pub fn requires_all_frames(&self) -> bool {
        self.shared.overflow != Overflow::DropOldest
    }

    /// Passes the baseline to the sink ([`Sink::begin`]). It uses no capacity and is never dropped.
    pub fn begin(&self, baseline: Arc<BaselineRecord>) {
        self.push(Event::Begin(baseline));
    }

    /// Passes a changed baseline to the sink ([`Sink::expect`]), like [`SinkQueue::begin`].
    pub fn expect(&self, baseline: Arc<BaselineRecord>) {
        self.push(Event::Expect(baseline));
    }

    /// Passes the reason to the sink ([`Sink::cut_off`]), like [`SinkQueue::begin`].
    pub fn cut_off(&self, why: &'static str) {
        self.push(Event::CutOff(why));
    }

    fn push(&self, event: Event) {
        let mut state = self.shared.lock();
        if !state.has_failed() {
            state.events.push_back(event);
            self.shared.filled.notify_one();
        }
    }

    /// Passes a frame to the sink. May wait for capacity, by the [`Overflow`] policy, but never for
    /// a sink that has failed.
    pub fn frame(&self, record: Arc<FrameRecord>) {
        let mut state = self.wait_for_capacity(self.shared.lock());
        if state.has_failed() {
            state.summary.dropped += 1;
            return;
        }
        if self.is_full(&state) {
            drop_oldest(&mut state);
            if state.summary.dropped == 1 {
                let name = self.shared.name;
                tracing::warn!("{name} is slower than the frames and misses some of them");
            }
        }
        let turn = state.last_verdict != Some(record.report.verdict);
        state.last_verdict = Some(record.report.verdict);
        state.frames += 1;
        state.points += points(&record);
        state.events.push_back(Event::Frame(record, turn));
        self.shared.filled.notify_one();
    }

    /// Waits until there is capacity, the sink has failed, or the time limit of the caller is over.
    fn wait_for_capacity<'a>(&'a self, mut state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        let full = |s: &State| self.is_full(s) && !s.has_failed();
        let start = Instant::now();
        let patience = state.patience;
        let shared = &self.shared;
        state = shared.wait_with_warning(state, patience, full, "has taken no frame");
        if full(&state) {
            state.patience = Duration::ZERO;
        } else if let Overflow::Wait(_) = shared.overflow {
            state.patience = state.patience.saturating_sub(start.elapsed());
        }
        state
    }

    /// Returns the result of the sink so far.
    pub fn summary(&self) -> SinkSummary {
        self.shared.lock().summary.clone()
    }

    /// Closes the sink after it has written the waiting frames, and returns its result. After
    /// `limit` its thread is abandoned: the process may exit, and unwritten frames are lost and
    /// reported. [`Overflow::WaitForProgress`] has a limit of its own, for each frame.
    pub fn finish(mut self, limit: Duration) -> SinkSummary {
        let (limit, each) = match self.shared.overflow {
            Overflow::WaitForProgress(limit) => (limit, true),
            Overflow::Wait(_) | Overflow::DropOldest => (limit, false),
        };
        let mut state = self.shared.lock();
        state.closing = true;
        self.shared.filled.notify_one();
        let working = |s: &State| !s.done && !s.has_failed();
        loop {
            let waiting = state.frames;
            state = self.shared.wait_with_warning(
                state,
                limit,
                |s| working(s) && (!each || s.frames == waiting),
                "has not finished",
            );
            if !working(&state) || state.frames == waiting {
                break;
            }
        }
        let (late, done) = (working(&state), state.done);
        drop(state);
        if late {
            let why = format!("did not finish within {:.1} s", limit.as_secs_f64());
            self.shared.fail(why, None);
        }
        if let Some(thread) = self.thread.take().filter(|_| done) {
            // The thread has reported its end; the summary includes a panic.
            thread.join().ok();
        }
        self.summary()
    }
}

impl Drop for SinkQueue {
    /// The thread writes the waiting frames, closes the sink and ends, unobserved.
    fn drop(&mut self) {
        self.shared.lock().closing = true;
        self.shared.filled.notify_one();
    }
}

/// Memory of a frame without points, in points.
const FRAME_POINTS: usize = 100;

/// Returns the memory of a frame, in points; a finding counts as one point.
fn points(record: &FrameRecord) -> usize {
    let report = &record.report;
    let points = record.curves.as_ref().map_or(0, |set| set.points());
    points + report.changes.len() + report.defects.len() + report.events.len() + FRAME_POINTS
}

/// Drops the oldest frame at which the verdict did not change, or else the oldest frame.
fn drop_oldest(state: &mut State) {
    let find = |turns: bool| {
        let is_one = |e: &Event| matches!(e, Event::Frame(_, turn) if turns || !turn);
        state.events.iter().position(is_one)
    };
    let at = find(false).or_else(|| find(true));
    if let Some(Event::Frame(record, _)) = at.and_then(|at| state.events.remove(at)) {
        state.frames -= 1;
        state.points -= points(&record);
        state.summary.dropped += 1;
    }
}

/// The part that runs on the thread.
struct Worker {
    shared: Arc<Shared>,
}

impl Worker {
    fn run(self, open: impl FnOnce() -> Result<Box<dyn Sink>>) {
        if !self.is_wanted() {
            return;
        }
        let mut sink = match open() {
            Ok(sink) => sink,
            Err(e) => return self.shared.fail(e.to_string(), Some(e)),
        };
        self.shared.lock().opening = Opening::Done(Ok(()));
        self.shared.drained.notify_all();
        let processed = self.process_events(sink.as_mut());
        self.shared.lock().summary.note = sink.note();
        let outcome = match processed {
            Ok(true) => sink.finish(),
            // Another thread marked the sink as failed because it was late. It is dropped here, on
            // its own thread.
            Ok(false) => Ok(()),
            Err(e) => Err(e),
        };
        if let Err(e) = outcome {
            self.shared.fail(e.to_string(), None);
        }
    }

    /// Waits until the sink is to be opened (returns true), or the queue closes without an event
    /// (returns false).
    fn is_wanted(&self) -> bool {
        let wanted = |s: &State| !s.events.is_empty() || matches!(s.opening, Opening::Now);
        let idle = |s: &mut State| !(wanted(s) || s.closing || s.has_failed());
        let wait = self.shared.filled.wait_while(self.shared.lock(), idle);
        let state = wait.unwrap_or_else(PoisonError::into_inner);
        wanted(&state) && !state.has_failed()
    }

    /// Passes events to the sink until the queue closes (returns true) or the sink has failed
    /// (returns false).
    fn process_events(&self, sink: &mut dyn Sink) -> Result<bool> {
        let mut flushed = Instant::now();
        let mut dirty = false;
        // True if the sink may have work that can wait.
        let mut more = false;
        loop {
            let mut state = self.shared.lock();
            let event = loop {
                if state.has_failed() {
                    return Ok(false);
                }
                if let Some(event) = state.events.pop_front() {
                    break Some(event);
                }
                if state.closing {
                    return Ok(true);
                }
                if more {
                    drop(state);
                    more = sink.work()?;
                    state = self.shared.lock();
                    continue;
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
            if let Some(Event::Frame(record, _)) = &event {
                state.frames -= 1;
                state.points -= points(record);
                state.in_flight = 1;
                self.shared.drained.notify_all();
            }
            drop(state);
            let mut urgent = event.is_none();
            match event {
                Some(Event::Begin(baseline)) => sink.begin(&baseline)?,
                Some(Event::Expect(baseline)) => sink.expect(&baseline)?,
                Some(Event::CutOff(why)) => sink.cut_off(why)?,
                Some(Event::Frame(record, _)) => {
                    sink.frame(&record)?;
                    let mut state = self.shared.lock();
                    state.summary.written += std::mem::take(&mut state.in_flight);
                    let must_catch_up = matches!(self.shared.overflow, Overflow::Wait(_));
                    if state.frames == 0 || !must_catch_up {
                        state.patience = self.shared.overflow.max_wait();
                    }
                    urgent = record.report.verdict != Verdict::Intact;
                    more = true;
                }
                None => {}
            }
            dirty = true;
            if urgent || flushed.elapsed() >= FLUSH_EVERY {
                sink.flush()?;
                let mut state = self.shared.lock();
                state.flushed = state.summary.written;
                drop(state);
                flushed = Instant::now();
                dirty = false;
            }
        }
    }
}

impl Drop for Worker {
    /// Runs at every end of the thread, including a panic of the sink.
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.shared.fail("panicked".into(), None);
        }
        self.shared.lock().done = true;
        self.shared.drained.notify_all();
    }
}

#[cfg(test)]
mod tests;
