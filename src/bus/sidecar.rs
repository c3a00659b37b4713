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
    /// The frame expected next: what lies between it and the one that comes was skipped.
    next_seq: u64,
    /// The last one seen, checked or not.
    last_seen: Option<u64>,
    counters: Counters,
    /// The last message that asked to stop; repeated in heartbeats, since it must not be lost.
    abort: Option<VerdictWire>,
    heard: Instant,
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
                    },
                },
            };
            self.take(frame);
        }
        Ok(())
    }

    fn take(&mut self, frame: Frame) {
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
                    next_seq: 0,
                    last_seen: None,
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
            self.flush();
            self.pending.push_back(Pending::End {
                published: header.seq,
                clean: header.flags & FLAG_UNFINISHED == 0,
            });
        } else if header.flags & FLAG_ANNOUNCE != 0 {
            // Repeated until it is answered: the first answer may have been lost. A failure shows in the
            // next heartbeat.
            let _ = self.heartbeat();
        } else if let Some(last) = session.last_seen.filter(|&last| header.seq <= last) {
            self.pending.push_back(Pending::Unreadable(Error::format(
                "frame",
                "sequence number",
                format_args!("{} after {last}", header.seq),
            )));
        } else {
            session.last_seen = Some(header.seq);
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
                session.counters.skipped += frame.seq().saturating_sub(session.next_seq);
                session.next_seq = frame.seq().saturating_add(1);
                Event::Frame(frame)
            }
            Pending::End { published, clean } => {
                session.counters.skipped += published.saturating_sub(session.next_seq);
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
        if report.abort {
            session.abort = Some(wire);
        }
        self.send(wire)
    }

    /// Counts the frame that [`wait`](Sidecar::wait) gave last as skipped: it will have no verdict.
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
