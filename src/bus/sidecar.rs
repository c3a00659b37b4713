//! Watcher's end of the bus: receives frames, sends verdicts.

use super::event::{Event, Frame};
use super::frames::MAX_BYTES;
use super::ipc::Ipc;
use super::message::{Counters, MessageKind};
use super::service::{Endpoint, NodeId, Role, bus, node_of};
use super::wait_mode::WaitMode;
use super::wire::{
    FLAG_ANNOUNCE, FLAG_BASELINE, FLAG_END, FLAG_UNFINISHED, FrameHeader, VerdictWire,
};
use crate::error::{Error, Result};
use crate::verdict::{PreviousFindings, Report, Verdict};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::BackpressureStrategy;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Maximum time that a sleeping watcher waits before it polls.
const TICK: Duration = Duration::from_millis(10);

/// Silence after which the watcher checks that the process of the simulator exists, and the
/// interval of these checks.
const SILENCE: Duration = Duration::from_millis(500);

/// Interval of the heartbeats.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// Maximum time that a frame waits for its baseline. The simulator sends both in one call, so only
/// a bridge, or a simulator that keeps no baseline, needs longer.
const BASELINE_LIMIT: Duration = Duration::from_secs(1);

/// Maximum number of frames received at once, so that a simulator that publishes without pause
/// cannot keep the watcher from verifying.
pub(super) const BATCH: usize = 64;

/// Number of ended sessions whose late frames are recognised.
pub(super) const ENDED_SESSIONS: usize = 16;

/// Upper bound of the sequence numbers: a frame every 100 ns for 28 years, and exact in JSON.
const MAX_SEQUENCE: u64 = 1 << 53;

/// Upper bound of the frames that a simulator can publish per microsecond. The smallest frames were
/// measured to take 0.2 us each without a reader, and 3 us with a watcher.
const MAX_FRAMES_PER_US: u64 = 8;

/// Number of frames by which a sequence number may exceed this rate: the clock is read a moment
/// after the frame is received, and a bridge delivers in bursts.
const AHEAD: u64 = 1 << 16;

/// Options of a [`Sidecar`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SidecarOptions {
    /// Larger frames are rejected before they are read.
    pub max_frame_bytes: usize,
    /// Waiting strategy of [`Sidecar::wait`].
    pub wait_mode: WaitMode,
    /// True if frames are received, but nothing is sent to the simulator: no verdict, no abort and
    /// no heartbeat. The simulator does not notice an observer.
    ///
    /// A service has at most one watcher that answers. Observers may run beside it, or without it.
    /// Watcher, observers and bridges are limited to 4 together. The simulator does not wait for
    /// observers, so they may skip frames even in lockstep.
    pub observe: bool,
    /// True if a watcher that starts late begins with the newest frame, not with the baseline that
    /// the simulator keeps.
    pub from_now: bool,
}

impl Default for SidecarOptions {
    /// Limits frames to 4 GiB, if an address is large enough, and sleeps.
    fn default() -> Self {
        SidecarOptions {
            max_frame_bytes: MAX_BYTES,
            wait_mode: WaitMode::default(),
            observe: false,
            from_now: false,
        }
    }
}

/// Progress of the watch of one session, from which a new watcher continues after a crash of the
/// first one ([`Sidecar::resume`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SidecarState {
    session: u64,
    /// The last frame that was returned.
    last: u64,
    /// Number of the baseline of the last frame that was returned.
    baseline: Option<u64>,
    counters: Counters,
}

impl SidecarState {
    /// Returns the session of the simulator.
    pub fn session(&self) -> u64 {
        self.session
    }

    /// Returns the number of frames that were not skipped, the last one included.
    fn delivered(self) -> u64 {
        (self.last + 1).saturating_sub(self.counters.skipped)
    }
}

#[derive(Debug, Default)]
struct Session {
    id: u64,
    /// Process of the simulator as iceoryx2 identifies it; `None` if it ended before it could be
    /// identified.
    node: Option<NodeId>,
    /// The last frame with a plausible sequence number, checked or not.
    last_seen: Option<Seen>,
    /// The frame after `last_seen`, if its sequence number was implausible.
    stray: Option<Seen>,
    /// Number of frames with a plausible sequence number that were delivered.
    delivered: u64,
    /// The last one of them.
    last_returned: Option<u64>,
    counters: Counters,
    /// Last message that asked to stop. Heartbeats repeat it, because it must not be lost.
    abort: Option<VerdictWire>,
    /// Findings of the last verified frame.
    known: PreviousFindings,
    /// Number of violations that were rolled back.
    recovered: u32,
    /// Number of the baseline of the last frame that was returned.
    baseline: Option<u64>,
    /// When the newest frame began to wait for its baseline.
    waits: Option<Instant>,
    /// True if this watcher received something that was sent before the second frame.
    was_there: bool,
    /// True if the next frame follows a baseline that was published before this watcher came.
    is_late: bool,
}

/// A sequence number and the time at which it was received.
#[derive(Clone, Copy, Debug)]
struct Seen {
    seq: u64,
    /// `None` for a baseline, which the simulator may have kept for a while.
    at: Option<Instant>,
}

impl Seen {
    /// Returns the first sequence number that can follow, and an upper bound of those that the
    /// simulator can have reached by now.
    fn next(self) -> (u64, u64) {
        let most = self.at.map_or(MAX_SEQUENCE, |at| {
            let micros = u64::try_from(at.elapsed().as_micros()).unwrap_or(u64::MAX);
            let ahead = micros.saturating_mul(MAX_FRAMES_PER_US);
            ahead.saturating_add(AHEAD).saturating_add(self.seq)
        });
        (self.seq + 1, most.min(MAX_SEQUENCE))
    }

    fn precedes(self, seq: u64) -> bool {
        let (first, last) = self.next();
        (first..last).contains(&seq)
    }
}

impl Session {
    /// Records the sequence number of a frame. Returns an error text if it is implausible.
    ///
    /// A sequence number is implausible if it does not exceed the last one, or exceeds it by more
    /// frames than a simulator can publish. A single such number is rejected. If the next number
    /// continues it, the two are consistent: the second one is accepted, and the number before them
    /// counts as the error.
    fn number(&mut self, seq: u64, is_baseline: bool) -> Result<(), String> {
        let at = (!is_baseline).then(Instant::now);
        let seen = Seen { seq, at };
        let follows = |last: Seen| last.precedes(seq);
        if seq < MAX_SEQUENCE
            && (self.last_seen.is_none_or(follows) || self.stray.is_some_and(follows))
        {
            self.last_seen = Some(seen);
            self.stray = None;
            return Ok(());
        }
        self.stray = (seq < MAX_SEQUENCE).then_some(seen);
        Err(match self.last_seen {
            Some(last) => format!("{seq} after {}", last.seq),
            None => format!("{seq}, expected less than {MAX_SEQUENCE}"),
        })
    }

    /// Returns the number of published frames, given the number that the end of the session claims,
    /// and an error if that number is impossible.
    fn published(&self, claimed: u64) -> (u64, Option<Error>) {
        let (seen, most) = self.last_seen.map_or((0, MAX_SEQUENCE), Seen::next);
        let why = (!(seen..=most).contains(&claimed)).then(|| {
            let what = format_args!("{claimed} frames published, {seen} expected");
            Error::format("end of a session", "sequence number", what)
        });
        (if claimed > most { seen } else { claimed }, why)
    }

    /// Counts the frames that were published before `next` and not delivered as skipped.
    fn skip_to(&mut self, next: u64) {
        self.counters.skipped = next.saturating_sub(self.delivered);
    }
}

/// Watcher's end of the bus.
#[derive(Debug)]
pub struct Sidecar {
    subscriber: Subscriber<Ipc, [u8], FrameHeader>,
    /// `None` for an observer.
    publisher: Option<Publisher<Ipc, VerdictWire, ()>>,
    options: SidecarOptions,
    session: Option<Session>,
    /// Ended sessions, newest last. A late frame of one of them does not start a new session.
    ended: VecDeque<u64>,
    newest: Option<Frame>,
    /// Baseline that was received. It precedes `newest`.
    baseline: Option<Frame>,
    /// Frames that were received, but must wait until the session before them has ended.
    held: VecDeque<Frame>,
    /// Session that another watcher watched, until a frame arrives that it had not received.
    resumed: Option<SidecarState>,
    /// Events to return. Their counters are set then.
    pending: VecDeque<Event>,
    /// Time at which the simulator last sent anything, or at which its process was last checked.
    alive: Instant,
    /// Time at which this watcher last sent anything.
    last_message: Instant,
    endpoint: Endpoint,
}

impl Sidecar {
    /// Opens the service, or creates it if no simulator has done so yet.
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if another living watcher uses the same name, because a simulator has
    /// only one, or if the service has its maximum number of watchers, observers and bridges.
    pub fn open(service: &str, options: &SidecarOptions) -> Result<Sidecar> {
        let role = match options.observe {
            true => Role::Observer,
            false => Role::Watcher,
        };
        let endpoint = Endpoint::open(service, role, options.wait_mode)?;
        let publisher = (!options.observe).then(|| {
            let builder = endpoint.verdicts.publisher_builder();
            let builder = builder.backpressure_strategy(BackpressureStrategy::DiscardData);
            builder.create().map_err(bus("publisher of verdicts"))
        });
        let mut sidecar = Sidecar {
            subscriber: endpoint.subscribe_to_frames(service)?,
            publisher: publisher.transpose()?,
            options: *options,
            session: None,
            ended: VecDeque::new(),
            newest: None,
            baseline: None,
            held: VecDeque::new(),
            resumed: None,
            pending: VecDeque::new(),
            alive: Instant::now(),
            last_message: Instant::now(),
            endpoint,
        };
        sidecar.heartbeat()?;
        Ok(sidecar)
    }

    /// Returns the counters of this session so far.
    pub fn counters(&self) -> Counters {
        let session = self.session.as_ref();
        session.map(|s| s.counters).unwrap_or_default()
    }

    /// Returns the state of the session, or `None` before its first frame was received.
    pub fn state(&self) -> Option<SidecarState> {
        let session = self.session.as_ref()?;
        let last = session.last_returned;
        Some(SidecarState {
            session: session.id,
            last: last.or(self.resumed.map(|state| state.last))?,
            baseline: session.baseline,
            counters: session.counters,
        })
    }

    /// Continues the session of a watcher that crashed, if its simulator still runs: the counters
    /// continue, and frames that the crashed watcher returned are not returned again. The verdict
    /// on the last one of them may still be sent. Call this before the first
    /// [`wait`](Sidecar::wait).
    pub fn resume(&mut self, state: SidecarState) {
        self.resumed = Some(state);
    }

    /// Returns the next event, waiting at most for `timeout`. Sends heartbeats meanwhile.
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if the connection fails.
    pub fn wait(&mut self, timeout: Duration) -> Result<Event> {
        let start = Instant::now();
        loop {
            if self.last_message.elapsed() >= HEARTBEAT {
                self.heartbeat()?;
            }
            // Delivers the last message to a simulator that has just connected. Retried at the next
            // tick.
            if let Some(publisher) = &self.publisher {
                let _ = publisher.update_connections();
            }
            if self.pending.is_empty() {
                self.drain()?;
            }
            let waiting = self.pending.pop_front();
            if let Some(event) = waiting.or_else(|| self.next_frame().map(Event::Frame)) {
                return Ok(self.deliver(event));
            }
            if self.simulator_is_gone() {
                // The simulator may have published between the last poll and the check of its
                // process.
                self.drain()?;
                self.lose_simulator();
                continue;
            }
            let left = timeout.saturating_sub(start.elapsed());
            if left.is_zero() || !self.endpoint.wait(left.min(TICK)) {
                return Ok(Event::Idle);
            }
        }
    }

    /// Receives messages until an event other than [`Event::NewSession`] is pending, no message is
    /// left, or [`BATCH`] messages were received.
    fn drain(&mut self) -> Result<()> {
        for _ in 0..BATCH {
            // The messages after the first one map the memory of their publishers.
            if !matches!(self.pending.back(), None | Some(Event::NewSession { .. })) {
                break;
            }
            let received = match self.held.pop_front() {
                Some(frame) => Some(frame),
                None => self.receive()?,
            };
            match received {
                Some(frame) => self.take(frame),
                None => break,
            }
        }
        Ok(())
    }

    fn receive(&self) -> Result<Option<Frame>> {
        let sample = self.subscriber.receive().map_err(bus("receive"))?;
        Ok(sample.map(|sample| Frame {
            header: *sample.user_header(),
            sample,
            max_bytes: self.options.max_frame_bytes,
            fault: None,
            after_gap: false,
        }))
    }

    /// Receives the baseline of a session. Holds back other messages, which may arrive before it.
    fn receive_baseline(&mut self, session: u64) {
        for _ in 0..BATCH {
            // A failure shows in the next call.
            let Ok(Some(frame)) = self.receive() else {
                return;
            };
            let FrameHeader { flags, .. } = frame.header;
            match frame.header.session == session && flags & FLAG_BASELINE != 0 {
                true => self.take(frame),
                false => self.held.push_back(frame),
            }
        }
    }

    /// Returns the next frame to verify: the baseline, or else the newest one. `None` if that must
    /// wait for its baseline.
    fn next_frame(&mut self) -> Option<Frame> {
        if let Some(frame) = self.take_baseline() {
            return Some(frame);
        }
        if self.awaits_baseline() {
            let session = self.session.as_mut()?;
            let since = session.waits.get_or_insert_with(Instant::now);
            if since.elapsed() < BASELINE_LIMIT {
                return None;
            }
        }
        self.newest.take()
    }

    /// Returns true if the baseline of the newest frame was not received.
    fn awaits_baseline(&self) -> bool {
        let (Some(session), Some(newest)) = (&self.session, &self.newest) else {
            return false;
        };
        let received = self.baseline.as_ref().map(Frame::seq);
        let here = [received, session.baseline, Some(newest.seq())];
        let begins_here = self.options.from_now && session.baseline.is_none();
        !begins_here && !here.contains(&Some(newest.header.baseline))
    }

    /// Returns the baseline that was received, unless the watcher is to begin with a newer frame.
    fn take_baseline(&mut self) -> Option<Frame> {
        let begins = self.session.as_ref().is_some_and(|s| s.baseline.is_none());
        let skip = self.options.from_now && begins && self.newest.is_some();
        self.baseline.take().filter(|_| !skip)
    }

    fn take(&mut self, mut frame: Frame) {
        let header = frame.header;
        if let Err(e) = header.check_layout() {
            self.pending.push_back(Event::Unreadable(e));
            return;
        }
        let is = |flag| header.flags & flag != 0;
        let is_baseline = is(FLAG_BASELINE);
        if is(FLAG_ANNOUNCE) && is_baseline {
            // Only maps the memory of baselines. The announcement that is answered follows it.
            return;
        }
        match &self.session {
            Some(session) if session.id == header.session => {}
            // A leftover of a simulator that ended, or a second simulator on another host. The
            // simulator that came last is the one that is watched.
            _ if self.ended.contains(&header.session) => return,
            Some(_) => {
                self.lose_simulator();
                self.held.push_back(frame);
                return;
            }
            None => {
                let id = header.session;
                self.resumed = self.resumed.filter(|state| state.session == id);
                self.session = Some(Session {
                    id,
                    node: node_of(&self.endpoint.frames, frame.sample.origin()),
                    delivered: self.resumed.map_or(0, SidecarState::delivered),
                    counters: self.resumed.map(|state| state.counters).unwrap_or_default(),
                    // The simulator may have accepted a later frame since then.
                    baseline: self.resumed.and_then(|state| state.baseline),
                    ..Session::default()
                });
                self.pending.push_back(Event::NewSession { session: id });
            }
        }
        let session = self.session.as_mut().expect("set or compared above");
        session.was_there |= header.seq == 0 && !is_baseline;
        self.alive = Instant::now();
        if is(FLAG_END) {
            // To a watcher that came just now, the simulator sends the baseline after the end.
            let since = Instant::now();
            self.receive_baseline(header.session);
            while self.awaits_baseline() && since.elapsed() < BASELINE_LIMIT {
                self.endpoint.wait(TICK);
                self.receive_baseline(header.session);
            }
            let session = self.session.as_ref().expect("as above");
            let (published, why) = session.published(header.seq);
            let end = Event::End {
                session: session.id,
                published,
                counters: session.counters,
                clean: !is(FLAG_UNFINISHED),
            };
            self.flush();
            self.pending.extend(why.map(Event::Unreadable));
            self.pending.push_back(end);
        } else if is(FLAG_ANNOUNCE) {
            // After the answer, the simulator may end at any time, and memory that is not mapped by
            // then is lost. A failure shows in the next heartbeat.
            self.receive_baseline(header.session);
            let _ = self.heartbeat();
        } else if self.resumed.is_some_and(|state| header.seq <= state.last)
            || is_baseline && session.baseline.is_some_and(|last| header.seq <= last)
        {
            // The other watcher, or this one, received this frame.
        } else if is_baseline && self.newest.as_ref().is_some_and(|n| header.seq < n.seq()) {
            // A newer frame arrived first, and waits.
            self.baseline = Some(frame);
        } else if self.baseline.as_ref().is_some_and(|b| header.seq < b.seq()) {
            // A frame that the baseline overtook is skipped.
        } else if let Err(why) = session.number(header.seq, is_baseline) {
            frame.fault = Some(why);
            self.flush();
            self.pending.push_back(Event::Frame(frame));
        } else if is_baseline {
            // An older frame is skipped.
            (self.resumed, self.newest) = (None, None);
            self.baseline = Some(frame);
        } else {
            self.resumed = None;
            self.newest = Some(frame);
        }
    }

    /// Queues the frames that wait, because the event that follows must not overtake them.
    fn flush(&mut self) {
        let frames = self.take_baseline().into_iter().chain(self.newest.take());
        self.pending.extend(frames.map(Event::Frame));
    }

    /// Queues the loss of the simulator, after the frames that wait.
    fn lose_simulator(&mut self) {
        self.flush();
        let lost = |session: &Session| Event::SimulatorLost {
            session: session.id,
            counters: session.counters,
        };
        self.pending.extend(self.session.as_ref().map(lost));
    }

    fn simulator_is_gone(&mut self) -> bool {
        let Some(session) = &self.session else {
            return false;
        };
        if self.alive.elapsed() < SILENCE {
            return false;
        }
        self.alive = Instant::now();
        session.node.is_none_or(|id| self.endpoint.node_is_gone(id))
    }

    /// Updates the state for an event that is returned.
    fn deliver(&mut self, mut event: Event) -> Event {
        let Some(session) = &mut self.session else {
            return match event {
                Event::Unreadable(_) => event,
                _ => Event::Idle,
            };
        };
        match &mut event {
            Event::NewSession { .. } => {
                // Best effort, like the goodbye: the event must be returned in any case.
                let _ = self.heartbeat();
            }
            Event::Frame(frame) if frame.fault.is_none() => {
                let follows = session.last_returned.map(|last| last + 1) == Some(frame.seq());
                let is_kept = frame.header.flags & FLAG_BASELINE != 0;
                frame.after_gap = session.is_late && !follows;
                session.is_late = is_kept && session.last_returned.is_none() && !session.was_there;
                session.delivered += 1;
                session.last_returned = Some(frame.seq());
                session.skip_to(frame.seq() + 1);
                (session.baseline, session.waits) = (Some(frame.header.baseline), None);
                session.known.begin_frame(frame.header.layout);
            }
            Event::End {
                published,
                counters,
                ..
            } => {
                *published = session.delivered.max(*published);
                session.skip_to(*published);
                *counters = session.counters;
                self.end_session();
            }
            Event::SimulatorLost { counters, .. } => {
                *counters = session.counters;
                self.end_session();
            }
            Event::Frame(_) | Event::Unreadable(_) | Event::Idle => {}
        }
        event
    }

    /// Leaves the session before its end: says goodbye to its simulator, with the reason `why`, and
    /// ignores the rest of its frames. The next simulator starts a new session.
    pub fn leave(&mut self, why: &str) {
        (self.newest, self.baseline) = (None, None);
        self.pending.clear();
        if let Some(session) = &self.session {
            let wire = VerdictWire::new(MessageKind::Goodbye, session.id, session.counters);
            // Best effort, as any goodbye.
            let _ = self.send(wire.with_reason(why));
        }
        self.forget_session();
    }

    /// Ends the session and says goodbye.
    fn end_session(&mut self) {
        let _ = self.send_message(MessageKind::Goodbye);
        self.forget_session();
    }

    fn forget_session(&mut self) {
        if let Some(session) = self.session.take() {
            self.ended.push_back(session.id);
            if self.ended.len() > ENDED_SESSIONS {
                self.ended.pop_front();
            }
        }
    }

    /// Sends the verdict on a frame of this session, and counts the frame; an observer only counts.
    /// Call this for every frame that [`wait`](Sidecar::wait) returned, for an invalid one with
    /// [`Verdict::Rejected`]. `check` is the duration of the check.
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if the message cannot be sent.
    pub fn send_verdict(&mut self, report: &Report, check: Duration) -> Result<()> {
        let Some(session) = &mut self.session else {
            let what = format!("the session of frame {} has ended", report.seq);
            return Err(Error::Bus(what));
        };
        match report.verdict {
            Verdict::Rejected => session.counters.rejected += 1,
            _ => session.counters.verified += 1,
        }
        let new = session.known.update(report).new;
        let plain = VerdictWire::new(MessageKind::Verdict, session.id, session.counters);
        let mut wire = plain.with_report(report, &new, check);
        wire.recovered = session.recovered;
        // The simulator must accept the repeated message, so it cannot be an abort for a frame with
        // an impossible number.
        let newest = session.last_seen.map_or(0, |last| last.seq);
        let newer = |kept: VerdictWire| kept.seq <= report.seq || kept.seq > newest;
        if report.abort && report.seq <= newest && session.abort.is_none_or(newer) {
            session.abort = Some(wire);
        }
        self.send(wire)
    }

    /// Withdraws the last abort, because the simulator rolled back and the frame of the next
    /// verdict is intact, or because it accepted the present state. `recovered` is the number of
    /// violations in the session that were rolled back.
    pub fn withdraw_abort(&mut self, recovered: u32) {
        if let Some(session) = &mut self.session {
            (session.abort, session.recovered) = (None, recovered);
        }
    }

    /// Counts the last frame that [`wait`](Sidecar::wait) returned as skipped: it gets no verdict.
    pub fn skip(&mut self) {
        if let Some(session) = &mut self.session {
            session.counters.skipped += 1;
        }
    }

    /// Announces the watcher, and repeats the last abort of the session. [`wait`](Sidecar::wait)
    /// does so about once a second; call this during long checks.
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if the message cannot be sent.
    pub fn heartbeat(&mut self) -> Result<()> {
        self.send_message(MessageKind::Hello)
    }

    fn send_message(&mut self, kind: MessageKind) -> Result<()> {
        let wire = match &self.session {
            None => VerdictWire::new(kind, 0, Counters::default()),
            Some(session) => {
                let plain = VerdictWire::new(kind, session.id, session.counters);
                VerdictWire {
                    kind: plain.kind,
                    verified: plain.verified,
                    skipped: plain.skipped,
                    rejected: plain.rejected,
                    recovered: session.recovered,
                    ..session.abort.unwrap_or(plain)
                }
            }
        };
        self.send(wire)
    }

    fn send(&mut self, wire: VerdictWire) -> Result<()> {
        self.last_message = Instant::now();
        if let Some(publisher) = &self.publisher {
            publisher.send_copy(wire).map_err(bus("send a verdict"))?;
            self.endpoint.notify();
        }
        Ok(())
    }
}

impl Drop for Sidecar {
    fn drop(&mut self) {
        // Best effort: without this message, a simulator sees silence.
        let _ = self.send_message(MessageKind::Goodbye);
    }
}
