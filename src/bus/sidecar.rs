//! What `linkwatch watch` uses: frames in, verdicts out.

use super::event::{Event, Frame};
use super::message::{Counters, MessageKind};
use super::service::{Endpoint, Ipc, NodeId, Role, bus};
use super::wire::{FLAG_ANNOUNCE, FLAG_END, FLAG_UNFINISHED, FrameHeader, VerdictWire};
use crate::error::{Error, Result};
use crate::verdict::{Report, Verdict};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{BackpressureStrategy, CallbackProgression, PortFactory};
use std::collections::VecDeque;
use std::fmt;
use std::time::{Duration, Instant};

/// How long the watcher sleeps at most before it looks for itself.
const TICK: Duration = Duration::from_millis(10);

/// Silence after which the simulator is looked for, and the time between two looks.
const SILENCE: Duration = Duration::from_millis(500);

/// Time between two heartbeats.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// Frames taken in one go, so that a simulator that publishes without end cannot keep the watcher from
/// checking.
const BATCH: usize = 64;

/// Sessions whose stragglers are recognised.
const RETIRED: usize = 16;

/// Upper bound of the sequence numbers: a frame every 100 ns for 28 years, and exact in JSON.
const MOST_FRAMES: u64 = 1 << 53;

/// Upper bound of the frames that a simulator can publish per microsecond. The smallest frames were
/// measured to take 0.2 us each without a reader, and 3 us with a watcher.
const FASTEST: u64 = 8;

/// Number of frames by which a sequence number may exceed this rate: the clock is read a moment
/// after the frame is received, and a bridge delivers in bursts.
const AHEAD: u64 = 1 << 16;

/// How the watcher uses the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SidecarOptions {
    /// Larger frames are rejected before they are read.
    pub max_frame_bytes: usize,
}

impl Default for SidecarOptions {
    /// Frames of up to 4 GiB (where an address is large enough).
    fn default() -> Self {
        SidecarOptions {
            max_frame_bytes: u32::MAX as usize,
        }
    }
}

struct Session {
    id: u64,
    /// The simulator's process as iceoryx2 knows it; `None` where it was gone before it could be seen.
    node: Option<NodeId>,
    /// The last frame with a plausible sequence number, checked or not.
    last_seen: Option<Seen>,
    /// The frame after `last_seen`, if its sequence number was implausible.
    stray: Option<Seen>,
    /// Number of frames with a plausible sequence number that were delivered.
    delivered: u64,
    counters: Counters,
    /// The last message that asked to stop; repeated in heartbeats, since it must not be lost.
    abort: Option<VerdictWire>,
    heard: Instant,
}

/// A sequence number and the time at which it was received.
#[derive(Clone, Copy)]
struct Seen {
    seq: u64,
    at: Instant,
}

impl Seen {
    /// Returns the first sequence number that can follow, and an upper bound of those that the
    /// simulator can have reached by now.
    fn next(self) -> (u64, u64) {
        let micros = u64::try_from(self.at.elapsed().as_micros()).unwrap_or(u64::MAX);
        let most = micros.saturating_mul(FASTEST).saturating_add(AHEAD);
        (self.seq + 1, self.seq.saturating_add(most).min(MOST_FRAMES))
    }

    fn precedes(self, seq: u64) -> bool {
        let (first, last) = self.next();
        (first..last).contains(&seq)
    }
}

impl Session {
    /// Records the sequence number of a frame. Returns an error text if it is implausible.
    ///
    /// A number is implausible if it does not exceed the last one, or exceeds it by more frames
    /// than a simulator can publish. A single such number is rejected as an error. If the next one
    /// follows it, both are consistent, so the second one is accepted, and the number before them
    /// is taken as the error.
    fn number(&mut self, seq: u64) -> Result<(), String> {
        let seen = Seen {
            seq,
            at: Instant::now(),
        };
        let follows = |last: Seen| last.precedes(seq);
        if seq < MOST_FRAMES
            && (self.last_seen.is_none_or(follows) || self.stray.is_some_and(follows))
        {
            self.last_seen = Some(seen);
            self.stray = None;
            return Ok(());
        }
        self.stray = (seq < MOST_FRAMES).then_some(seen);
        Err(match self.last_seen {
            Some(last) => format!("{seq} after {}", last.seq),
            None => format!("{seq}, expected less than {MOST_FRAMES}"),
        })
    }

    /// Returns the number of published frames, given the number that the end of the session claims,
    /// and an error if that number is impossible.
    fn published(&self, claimed: u64) -> (u64, Option<Error>) {
        let (seen, most) = self.last_seen.map_or((0, MOST_FRAMES), Seen::next);
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

enum Pending {
    NewSession,
    Frame(Frame),
    Unreadable(Error),
    End { published: u64, clean: bool },
    Lost,
}

/// The watcher's end of the bus.
pub struct Sidecar {
    subscriber: Subscriber<Ipc, [u8], FrameHeader>,
    publisher: Publisher<Ipc, VerdictWire, ()>,
    max_frame_bytes: usize,
    session: Option<Session>,
    /// Sessions that are over, newest last. A frame of theirs that turns up late is no new session.
    retired: VecDeque<u64>,
    newest: Option<Frame>,
    /// Taken from the bus, but not yet its turn: the one before has to end first.
    held: Option<Frame>,
    pending: VecDeque<Pending>,
    last_word: Instant,
    looked: Instant,
    endpoint: Endpoint,
}

impl fmt::Debug for Sidecar {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sidecar")
            .field("session", &self.session.as_ref().map(|s| s.id))
            .finish_non_exhaustive()
    }
}

impl Sidecar {
    /// Opens the service; creates it where no simulator has yet.
    ///
    /// Fails where another living watcher is on the same name: a simulator has one to answer it.
    pub fn open(service: &str, options: &SidecarOptions) -> Result<Sidecar> {
        let endpoint = Endpoint::open(service, Role::Watcher)?;
        let publisher = endpoint.verdicts.publisher_builder();
        let publisher = publisher
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(bus("publisher of verdicts"))?;
        let subscriber = endpoint.frames.subscriber_builder().create();
        let mut sidecar = Sidecar {
            subscriber: subscriber.map_err(bus("subscriber of frames"))?,
            publisher,
            max_frame_bytes: options.max_frame_bytes,
            session: None,
            retired: VecDeque::new(),
            newest: None,
            held: None,
            pending: VecDeque::new(),
            last_word: Instant::now(),
            looked: Instant::now(),
            endpoint,
        };
        sidecar.heartbeat()?;
        Ok(sidecar)
    }

    /// What became of the frames of this session so far.
    pub fn counters(&self) -> Counters {
        self.session
            .as_ref()
            .map_or(Counters::default(), |s| s.counters)
    }

    /// The next event, waiting for it at most for `timeout`. Sends heartbeats meanwhile.
    pub fn wait(&mut self, timeout: Duration) -> Result<Event> {
        let start = Instant::now();
        loop {
            if self.last_word.elapsed() >= HEARTBEAT {
                self.heartbeat()?;
            }
            // Gives the last word to a simulator that has just come. Tried again with the next tick.
            let _ = self.publisher.update_connections();
            if self.pending.is_empty() {
                self.drain()?;
            }
            if let Some(pending) = self.pending.pop_front() {
                return Ok(self.deliver(pending));
            }
            if let Some(frame) = self.newest.take() {
                return Ok(self.deliver(Pending::Frame(frame)));
            }
            if self.simulator_is_gone() {
                // It may have published between the look at the bus and the look at its process.
                self.drain()?;
                self.flush();
                self.pending.push_back(Pending::Lost);
                continue;
            }
            let left = timeout.saturating_sub(start.elapsed());
            if left.is_zero() || !self.endpoint.sleep(left.min(TICK)) {
                return Ok(Event::Idle);
            }
        }
    }

    /// Takes what lies on the bus, until something has to be told or there is no more.
    fn drain(&mut self) -> Result<()> {
        for _ in 0..BATCH {
            if !self.pending.is_empty() {
                break;
            }
            let frame = match self.held.take() {
                Some(frame) => frame,
                None => match self.subscriber.receive().map_err(bus("receive"))? {
                    None => break,
                    Some(sample) => Frame {
                        header: *sample.user_header(),
                        sample,
                        max_bytes: self.max_frame_bytes,
                        fault: None,
                    },
                },
            };
            self.take(frame);
        }
        Ok(())
    }

    fn take(&mut self, mut frame: Frame) {
        let header = frame.header;
        if let Err(e) = header.check_layout() {
            self.pending.push_back(Pending::Unreadable(e));
            return;
        }
        match &self.session {
            Some(session) if session.id == header.session => {}
            // Left over from a simulator that is gone, or a second one on another host: the last one that
            // came is the one that is watched.
            _ if self.retired.contains(&header.session) => return,
            Some(_) => {
                self.flush();
                self.pending.push_back(Pending::Lost);
                self.held = Some(frame);
                return;
            }
            None => {
                self.session = Some(Session {
                    id: header.session,
                    node: self.node_of(&frame),
                    last_seen: None,
                    stray: None,
                    delivered: 0,
                    counters: Counters::default(),
                    abort: None,
                    heard: Instant::now(),
                });
                self.pending.push_back(Pending::NewSession);
            }
        }
        let session = self.session.as_mut().expect("set or compared above");
        session.heard = Instant::now();
        if header.flags & FLAG_END != 0 {
            let (published, why) = session.published(header.seq);
            self.flush();
            self.pending.extend(why.map(Pending::Unreadable));
            self.pending.push_back(Pending::End {
                published,
                clean: header.flags & FLAG_UNFINISHED == 0,
            });
        } else if header.flags & FLAG_ANNOUNCE != 0 {
            // Repeated until it is answered: the first answer may have been lost. A failure shows in the
            // next heartbeat.
            let _ = self.heartbeat();
        } else if let Err(why) = session.number(header.seq) {
            frame.fault = Some(why);
            self.flush();
            self.pending.push_back(Pending::Frame(frame));
        } else {
            self.newest = Some(frame);
        }
    }

    /// Queues the newest frame, since something follows that must not overtake it.
    fn flush(&mut self) {
        self.pending.extend(self.newest.take().map(Pending::Frame));
    }

    fn node_of(&self, frame: &Frame) -> Option<NodeId> {
        let origin = frame.sample.origin();
        let mut node = None;
        self.endpoint
            .frames
            .dynamic_config()
            .list_publishers(|publisher| {
                if publisher.publisher_id == origin {
                    node = Some(publisher.node_id);
                    return CallbackProgression::Stop;
                }
                CallbackProgression::Continue
            });
        node
    }

    fn simulator_is_gone(&mut self) -> bool {
        let Some(session) = &self.session else {
            return false;
        };
        if session.heard.elapsed() < SILENCE || self.looked.elapsed() < SILENCE {
            return false;
        }
        self.looked = Instant::now();
        session.node.is_none_or(|id| self.endpoint.node_is_gone(id))
    }

    /// Does the bookkeeping of an event as it is handed out.
    fn deliver(&mut self, pending: Pending) -> Event {
        let Some(session) = &mut self.session else {
            return match pending {
                Pending::Unreadable(e) => Event::Unreadable(e),
                _ => Event::Idle,
            };
        };
        let id = session.id;
        match pending {
            Pending::Unreadable(e) => Event::Unreadable(e),
            Pending::NewSession => {
                // Best effort, as the goodbye: what happened has to be told here in any case.
                let _ = self.heartbeat();
                Event::NewSession { session: id }
            }
            Pending::Frame(frame) => {
                if frame.fault.is_none() {
                    session.delivered += 1;
                    session.skip_to(frame.seq() + 1);
                }
                Event::Frame(frame)
            }
            Pending::End { published, clean } => {
                let published = published.max(session.delivered);
                session.skip_to(published);
                let counters = session.counters;
                self.retire();
                Event::End {
                    session: id,
                    published,
                    counters,
                    clean,
                }
            }
            Pending::Lost => {
                let counters = session.counters;
                self.retire();
                Event::SimulatorLost {
                    session: id,
                    counters,
                }
            }
        }
    }

    /// Says goodbye to the session.
    fn retire(&mut self) {
        let _ = self.say(MessageKind::Goodbye);
        if let Some(session) = self.session.take() {
            self.retired.push_back(session.id);
            if self.retired.len() > RETIRED {
                self.retired.pop_front();
            }
        }
    }

    /// Answers a frame of this session. Every frame that [`wait`](Sidecar::wait) gave is to be answered, a
    /// broken one with [`Verdict::Rejected`]; `check` is the time that it took.
    pub fn send_verdict(&mut self, report: &Report, check: Duration) -> Result<()> {
        let Some(session) = &mut self.session else {
            return Err(Error::Bus(format!(
                "the session of frame {} is over",
                report.seq
            )));
        };
        if report.verdict == Verdict::Rejected {
            session.counters.rejected += 1;
        } else {
            session.counters.verified += 1;
        }
        let wire = VerdictWire::from_report(report, session.id, session.counters, check);
        // The simulator must accept the repeated message, so it cannot be an abort for a frame with
        // an impossible number.
        let newest = session.last_seen.map_or(0, |last| last.seq);
        let newer = |kept: VerdictWire| kept.seq <= report.seq || kept.seq > newest;
        if report.abort && report.seq <= newest && session.abort.is_none_or(newer) {
            session.abort = Some(wire);
        }
        self.send(wire)
    }

    /// Counts the last frame that [`wait`](Sidecar::wait) returned as skipped: it gets no verdict.
    pub fn skip(&mut self) {
        if let Some(session) = &mut self.session {
            session.counters.skipped += 1;
        }
    }

    /// Says that the watcher is there, and repeats the last abort of the session. [`wait`](Sidecar::wait)
    /// does so about once a second; to be called from checks that take long.
    pub fn heartbeat(&mut self) -> Result<()> {
        self.say(MessageKind::Hello)
    }

    fn say(&mut self, kind: MessageKind) -> Result<()> {
        let wire = match &self.session {
            None => VerdictWire::new(kind, 0, Counters::default()),
            Some(session) => {
                let plain = VerdictWire::new(kind, session.id, session.counters);
                session.abort.map_or(plain, |abort| VerdictWire {
                    kind: plain.kind,
                    verified: plain.verified,
                    skipped: plain.skipped,
                    rejected: plain.rejected,
                    ..abort
                })
            }
        };
        self.send(wire)
    }

    fn send(&mut self, wire: VerdictWire) -> Result<()> {
        self.last_word = Instant::now();
        self.publisher
            .send_copy(wire)
            .map_err(bus("send a verdict"))?;
        self.endpoint.notify();
        Ok(())
    }
}

impl Drop for Sidecar {
    fn drop(&mut self) {
        // Best effort: a simulator that misses it sees silence.
        let _ = self.say(MessageKind::Goodbye);
    }
}
