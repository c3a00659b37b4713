//! A watcher that verifies one of the other shards for the leader.

use super::super::event::Frame;
use super::super::frames::random;
use super::super::ipc::Ipc;
use super::super::service::{NodeId, bus, is_gone, node_of, open_events, open_node, service_name};
use super::super::wire::{FLAG_END, FRAME_MAGIC, FrameHeader, LAYOUT_VERSION};
use super::{FLAG_NOTE, HEARTBEAT, MAX_BYTES, Note, SILENCE, ShardSetup, State, TICK, Topic};
use super::{decode, encode, open_topic};
use crate::error::{Error, Result};
use crate::pairs::Partition;
use crate::verifier::Part;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy, Node};
use std::fmt;
use std::time::{Duration, Instant};

/// Message of the leader.
#[derive(Debug)]
pub enum ShardEvent {
    /// The following frames are to be verified with a new verifier.
    Begin(ShardSetup),
    /// A frame. Answer it with [`ShardMember::answer`].
    Frame(Frame),
    /// The session ended; another one may begin.
    End,
    /// The process of the leader ended without a goodbye.
    LeaderLost,
    /// The leader does not need this member, for this reason.
    Refused(String),
    /// Nothing happened within the time limit, or a signal arrived.
    Idle,
}

/// Member's end of the services of several shards.
pub struct ShardMember {
    state: State,
    states: Publisher<Ipc, [u8], FrameHeader>,
    tasks: Subscriber<Ipc, [u8], FrameHeader>,
    listener: Listener<Ipc>,
    notifier: Notifier<Ipc>,
    /// Process of the leader, and when its last message arrived or it was last looked for.
    leader: Option<(NodeId, Instant)>,
    /// When the state was last sent.
    sent: Instant,
    /// Message that was read ahead.
    pending: Option<ShardEvent>,
    /// Last message that was not understood.
    unreadable: String,
    topics: [Topic; 2],
    _node: Node<Ipc>,
}

impl fmt::Debug for ShardMember {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ShardMember")
            .field("state", &self.state)
            .finish_non_exhaustive()
    }
}

impl ShardMember {
    /// Opens the services as one of the shards, from 1; the leader is shard 1.
    ///
    /// Errors: [`Error::Usage`] if `shards` is not 2 to [`Partition::MAX_SHARDS`] or `shard` not 2
    /// to `shards`; [`Error::Bus`] if there are too many members.
    pub fn open(service: &str, shard: usize, shards: usize) -> Result<ShardMember> {
        if !(2..=Partition::MAX_SHARDS).contains(&shards) || !(2..=shards).contains(&shard) {
            let what = format!("shard {shard} of {shards} is no member");
            return Err(Error::Usage(what));
        }
        let node = open_node("linkwatch shard")?;
        let tasks = open_topic(&node, service, "shards/tasks")?;
        let states = open_topic(&node, service, "shards/states")?;
        let publisher = states
            .publisher_builder()
            .initial_max_slice_len(4096)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(bus("publisher of the state of a shard"))?;
        let listener = open_events(&node, &service_name(service, "shards/tasks")?)?;
        let notifier = open_events(&node, &service_name(service, "shards/states")?)?;
        let mut member = ShardMember {
            state: State {
                member: random(),
                shard: shard as u32,
                shards: shards as u32,
                session: 0,
                result: None,
                leaving: None,
            },
            states: publisher,
            tasks: tasks
                .subscriber_builder()
                .create()
                .map_err(bus("subscriber of the frames for shards"))?,
            listener: listener
                .listener_builder()
                .create()
                .map_err(bus("listener"))?,
            notifier: notifier
                .notifier_builder()
                .create()
                .map_err(bus("notifier"))?,
            leader: None,
            sent: Instant::now(),
            pending: None,
            unreadable: String::new(),
            topics: [tasks, states],
            _node: node,
        };
        member.send()?;
        Ok(member)
    }

    /// Returns the next message of the leader, waiting at most for `timeout`. Sends the state
    /// meanwhile.
    pub fn wait(&mut self, timeout: Duration) -> Result<ShardEvent> {
        let start = Instant::now();
        loop {
            self.heartbeat()?;
            if self.is_superseded()?
                && let Some(event) = self.pending.take()
            {
                return Ok(event);
            }
            if self.leader_is_gone() {
                self.forget_session();
                return Ok(ShardEvent::LeaderLost);
            }
            let left = timeout.saturating_sub(start.elapsed());
            // The socket below rounds less than a microsecond to zero, which means no time limit.
            let time = left.min(TICK).max(Duration::from_millis(1));
            if left.is_zero() || self.listener.timed_wait_all(|_| {}, time).is_err() {
                return Ok(ShardEvent::Idle);
            }
        }
    }

    /// Sends the result of a frame, or the reason why there is none.
    pub fn answer(&mut self, seq: u64, result: std::result::Result<Part, String>) -> Result<()> {
        self.state.result = Some((seq, result));
        self.send()
    }

    /// Sends the state if it is due. [`ShardMember::wait`] does so; call this during long checks.
    pub fn heartbeat(&mut self) -> Result<()> {
        match self.sent.elapsed() >= HEARTBEAT {
            true => self.send(),
            false => Ok(()),
        }
    }

    /// Returns true if another message has arrived: the leader no longer waits for the result of
    /// the current frame.
    pub fn is_superseded(&mut self) -> Result<bool> {
        if self.pending.is_none() {
            self.pending = self.receive()?;
        }
        Ok(self.pending.is_some())
    }

    /// Tells the leader why this member leaves.
    pub fn leave(mut self, why: &str) {
        // Best effort: without this message, the leader sees silence.
        self.state.leaving = Some(why.to_owned());
        let _ = self.send();
    }

    /// Receives the next message for this member.
    fn receive(&mut self) -> Result<Option<ShardEvent>> {
        while let Some(sample) = self.tasks.receive().map_err(bus("receive"))? {
            let header = *sample.user_header();
            if let Err(why) = header.check_layout() {
                self.reject(&why);
                continue;
            }
            if self.leader.is_none() {
                let node = node_of(&self.topics[0], sample.origin());
                self.leader = node.map(|node| (node, Instant::now()));
            }
            if let Some((_, heard)) = &mut self.leader {
                *heard = Instant::now();
            }
            if header.flags & FLAG_NOTE != 0 {
                let note: Result<(u64, Note)> = decode(sample.payload());
                match note {
                    Err(why) => self.reject(&why),
                    Ok((member, _)) if member != self.state.member => {}
                    Ok((_, Note::Refuse(why))) => return Ok(Some(ShardEvent::Refused(why))),
                    Ok((_, Note::Begin(setup))) => {
                        (self.state.session, self.state.result) = (header.session, None);
                        self.send()?;
                        return Ok(Some(ShardEvent::Begin(setup)));
                    }
                }
            } else if header.session != self.state.session {
                // Those of a session that this member has not begun.
            } else if header.flags & FLAG_END != 0 {
                self.forget_session();
                return Ok(Some(ShardEvent::End));
            } else {
                return Ok(Some(ShardEvent::Frame(Frame {
                    header,
                    sample,
                    max_bytes: MAX_BYTES,
                    fault: None,
                })));
            }
        }
        Ok(None)
    }

    /// Warns of a message that was not understood, once for the same reason.
    fn reject(&mut self, why: &Error) {
        let why = why.to_string();
        if why != self.unreadable {
            tracing::warn!("a message of the leader was rejected: {why}");
            self.unreadable = why;
        }
    }

    fn forget_session(&mut self) {
        (self.state.session, self.state.result) = (0, None);
        self.leader = None;
    }

    /// Returns true if the process of the leader of this session has ended.
    fn leader_is_gone(&mut self) -> bool {
        let Some((node, heard)) = &mut self.leader else {
            return false;
        };
        if self.state.session == 0 || heard.elapsed() < SILENCE {
            return false;
        }
        *heard = Instant::now();
        is_gone(&self.topics[0], *node)
    }

    fn send(&mut self) -> Result<()> {
        let connected = self.states.update_connections();
        connected.map_err(bus("connect to the leader"))?;
        let bytes = encode(&self.state);
        let sample = self.states.loan_slice_uninit(bytes.len());
        let mut sample = sample.map_err(bus("loan"))?.write_from_slice(&bytes);
        *sample.user_header_mut() = FrameHeader {
            magic: FRAME_MAGIC,
            version: LAYOUT_VERSION,
            session: self.state.member,
            ..FrameHeader::default()
        };
        sample.send().map_err(bus("send"))?;
        self.sent = Instant::now();
        // A failure only delays the leader until its next timer tick.
        let _ = self.notifier.notify();
        Ok(())
    }
}
