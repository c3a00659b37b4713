//! The watcher that answers, and joins the results of the other shards with its own.

use super::super::frames::random;
use super::super::ipc::Ipc;
use super::super::room;
use super::super::service::{Lock, bus, lock, open_events, open_node, service_name};
use super::super::wire::{
    FLAG_END, FLAG_RADII, FRAME_MAGIC, FrameHeader, LAYOUT_VERSION, table_of,
};
use super::{FLAG_NOTE, Note, SILENCE, ShardSetup, State, TICK, Topic};
use super::{decode, encode, open_topic, shard_name};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::ingest::FrameInfo;
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

/// Time after the goodbye of a member in which this process may be told to stop as well.
const STOPPING: Duration = Duration::from_millis(500);

/// Bytes of the first messages; larger frames get more memory.
const INITIAL_BYTES: usize = 1 << 16;

/// Leader's end of the services of several shards: passes frames to the members, and collects
/// their results.
///
/// Shards are numbered from 1 here, as on the command line; the leader is shard 1.
pub struct ShardLeader {
    service: String,
    shards: u32,
    session: u64,
    /// Members with shards 2, 3, ...
    seats: Vec<Seat>,
    tasks: Publisher<Ipc, [u8], FrameHeader>,
    states: Subscriber<Ipc, [u8], FrameHeader>,
    listener: Listener<Ipc>,
    notifier: Notifier<Ipc>,
    /// Payload of the last frame.
    payload: Vec<u8>,
    /// Number of curves of the last frame.
    curves: usize,
    /// When a member last said goodbye.
    left: Option<Instant>,
    /// Last message that was not understood.
    unreadable: String,
    _topics: [Topic; 2],
    _lock: Lock,
    _node: Node<Ipc>,
}

/// Place of a member.
#[derive(Debug)]
struct Seat {
    shard: u32,
    member: Option<Member>,
    /// Why there is no member.
    why: String,
    /// Process that cannot begin in this session.
    refused: Option<u64>,
}

#[derive(Debug)]
struct Member {
    id: u64,
    /// When its last message arrived.
    heard: Instant,
    /// When it was told to begin in this session.
    begun: Option<Instant>,
    /// True if it must return a result of the current frame.
    asked: bool,
    result: Option<(u64, Result<Part, String>)>,
}

impl fmt::Debug for ShardLeader {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ShardLeader")
            .field("seats", &self.seats)
            .finish_non_exhaustive()
    }
}

impl ShardLeader {
    /// Opens the services of a number of shards.
    ///
    /// Errors: [`Error::Usage`] if the number is not 2 to [`Partition::MAX_SHARDS`];
    /// [`Error::Bus`] if the service has another leader.
    pub fn open(service: &str, shards: usize) -> Result<ShardLeader> {
        if !(2..=Partition::MAX_SHARDS).contains(&shards) {
            let most = Partition::MAX_SHARDS;
            return Err(Error::Usage(format!(
                "{shards} shards, expected 2 to {most}"
            )));
        }
        let node = open_node("linkwatch leader of shards")?;
        let name = service_name(service, "shards/leader")?;
        let lock = lock(&node, &name, |who| {
            format!(
                "service \"{service}\" already has a shard 1 ({who}): start the others as \
                 `--shard 2/{shards}` and so on"
            )
        })?;
        let tasks = open_topic(&node, service, "shards/tasks")?;
        let states = open_topic(&node, service, "shards/states")?;
        let publisher = tasks
            .publisher_builder()
            .initial_max_slice_len(INITIAL_BYTES)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(bus("publisher of frames for the shards"))?;
        let listener = open_events(&node, &service_name(service, "shards/states")?)?;
        let notifier = open_events(&node, &service_name(service, "shards/tasks")?)?;
        let shards = shards as u32;
        let seat = |shard| Seat {
            shard,
            member: None,
            refused: None,
            why: format!(
                "{} is not there: start `linkwatch watch --service {service} --shard \
                 {shard}/{shards}`",
                shard_name(shard, shards)
            ),
        };
        Ok(ShardLeader {
            service: service.to_owned(),
            shards,
            session: random(),
            seats: (2..=shards).map(seat).collect(),
            tasks: publisher,
            states: states
                .subscriber_builder()
                .create()
                .map_err(bus("subscriber of the states of shards"))?,
            listener: listener
                .listener_builder()
                .create()
                .map_err(bus("listener"))?,
            notifier: notifier
                .notifier_builder()
                .create()
                .map_err(bus("notifier"))?,
            payload: Vec::new(),
            curves: 0,
            left: None,
            unreadable: String::new(),
            _topics: [tasks, states],
            _lock: lock,
            _node: node,
        })
    }

    /// Returns the number of shards, with that of the leader.
    pub fn shards(&self) -> usize {
        self.shards as usize
    }

    /// Receives messages for at most `timeout`, or until all members are there. Returns the
    /// numbers of the shards that are missing.
    pub fn wait(&mut self, timeout: Duration) -> Result<Vec<u32>> {
        let start = Instant::now();
        loop {
            self.receive()?;
            let missing = self.seats.iter().filter(|s| s.member.is_none());
            let missing: Vec<u32> = missing.map(|s| s.shard).collect();
            if missing.is_empty() || start.elapsed() >= timeout || !self.sleep() {
                return Ok(missing);
            }
        }
    }

    /// Tells members that have not begun in this session to begin. `setup` returns what a shard
    /// must know, or why it cannot begin.
    pub fn begin(
        &mut self,
        mut setup: impl FnMut(u32) -> std::result::Result<ShardSetup, String>,
    ) -> Result<()> {
        self.receive()?;
        for k in 0..self.seats.len() {
            let shard = self.seats[k].shard;
            let Some(member) = self.seats[k].member.as_mut() else {
                continue;
            };
            if member.begun.is_some() {
                continue;
            }
            let id = member.id;
            match setup(shard) {
                Ok(setup) => {
                    member.begun = Some(Instant::now());
                    member.result = None;
                    self.tell(id, &Note::Begin(setup))?;
                }
                Err(why) => {
                    self.seats[k].refused = Some(id);
                    self.seats[k].lose(why.clone());
                    self.tell(id, &Note::Refuse(why))?;
                }
            }
        }
        Ok(())
    }

    /// Passes a frame to all members that have begun.
    ///
    /// Errors: [`Error::Bus`] if it does not fit into shared memory.
    pub fn publish(&mut self, seq: u64, time: f64, info: &FrameInfo, set: &CurveSet) -> Result<()> {
        self.curves = set.len();
        let counts: Vec<i32> = set.counts().collect();
        let too_large = || Error::Bus(format!("{} points do not fit into memory", set.points()));
        let (table, names_bytes) = table_of(&counts, &info.labels).ok_or_else(too_large)?;
        self.payload = table;
        set.write_positions(&mut self.payload);
        let radii = match info.labels.radii.is_empty() {
            true => 0,
            false => FLAG_RADII,
        };
        let mut header = FrameHeader {
            seq,
            time,
            names_bytes,
            n_points: set.points() as u64,
            n_curves: set.len() as u32,
            basis: set.basis().code(),
            coordinate_bytes: set.precision().bytes() as u32,
            cuts: info.cuts,
            layout: info.layout,
            time_step: info.time_step,
            ..self.header(radii)
        };
        header.set_cell(info.cell.as_ref());
        let payload = std::mem::take(&mut self.payload);
        let sent = self.send(header, &payload);
        self.payload = payload;
        for member in self.seats.iter_mut().filter_map(|s| s.member.as_mut()) {
            member.asked = member.begun.is_some();
        }
        sent
    }

    /// Waits for the results of a frame. Returns one of each member, or the reason why it is
    /// missing. Ends early if `stop` returns true.
    pub fn collect(
        &mut self,
        seq: u64,
        stop: impl Fn() -> bool,
    ) -> Result<Vec<std::result::Result<Part, String>>> {
        loop {
            self.receive()?;
            let waits = |seat: &Seat| seat.member.as_ref().is_some_and(|m| m.owes(seq));
            // Ctrl-C reaches all processes of a terminal: this one may be about to stop, too.
            let stops = self.left.is_some_and(|left| left.elapsed() < STOPPING);
            if !stops && !self.seats.iter().any(waits) || stop() {
                break;
            }
            self.sleep();
        }
        let (shards, curves) = (self.shards, self.curves);
        let result = |seat: &mut Seat| {
            let name = shard_name(seat.shard, shards);
            let Some(member) = &mut seat.member else {
                return Err(seat.why.clone());
            };
            member.asked = false;
            match member.result.take_if(|(frame, _)| *frame == seq) {
                Some((_, Ok(part))) if part.seq() != seq => {
                    Err(format!("{name} returned the result of another frame"))
                }
                Some((_, Ok(part))) => match part.check(curves) {
                    Ok(()) => Ok(part),
                    Err(why) => Err(format!("{name}: {why}")),
                },
                Some((_, Err(why))) => Err(format!("{name}: {why}")),
                None => Err(format!("{name} came after the frame")),
            }
        };
        Ok(self.seats.iter_mut().map(result).collect())
    }

    /// Ends the session of the members. The next frame starts another one.
    pub fn end_session(&mut self) -> Result<()> {
        let header = self.header(FLAG_END);
        self.session = random();
        for seat in &mut self.seats {
            seat.refused = None;
            if let Some(member) = &mut seat.member {
                (member.begun, member.asked) = (None, false);
            }
        }
        self.send(header, &[])
    }

    /// Receives what has arrived, and finds members that are silent.
    fn receive(&mut self) -> Result<()> {
        while let Some(sample) = self.states.receive().map_err(bus("receive"))? {
            let header = *sample.user_header();
            let state = header
                .check_layout()
                .and_then(|()| decode(sample.payload()));
            match state {
                Ok(state) => self.hear(state)?,
                Err(why) => {
                    let why = why.to_string();
                    if why != self.unreadable {
                        tracing::warn!("a message of a shard was rejected: {why}");
                        self.unreadable = why;
                    }
                }
            }
        }
        let shards = self.shards;
        for seat in &mut self.seats {
            let silent = |m: &Member| m.heard.elapsed() >= SILENCE;
            if seat.member.as_ref().is_some_and(silent) {
                let name = shard_name(seat.shard, shards);
                let seconds = SILENCE.as_secs();
                seat.lose(format!(
                    "{name} was silent for {seconds} s: it was killed or stopped; start it again"
                ));
            }
        }
        Ok(())
    }

    /// Takes the state of a member.
    fn hear(&mut self, state: State) -> Result<()> {
        let (shards, service) = (self.shards, &self.service);
        let name = shard_name(state.shard, state.shards);
        let seat = self.seats.iter_mut().find(|s| s.shard == state.shard);
        let Some(seat) = seat.filter(|_| state.shards == shards) else {
            let why = format!(
                "{name} is not one of the {shards} shards of service \"{service}\": start it with \
                 `--shard 2/{shards}` to `--shard {shards}/{shards}`"
            );
            return self.tell(state.member, &Note::Refuse(why));
        };
        if seat.member.as_ref().is_some_and(|m| m.id != state.member) {
            if state.leaving.is_some() {
                return Ok(());
            }
            let why = format!("{name} is taken by another process of service \"{service}\"");
            return self.tell(state.member, &Note::Refuse(why));
        }
        if let Some(why) = state.leaving {
            if seat.member.is_some() {
                self.left = Some(Instant::now());
                seat.lose(format!("{name} left: {why}"));
            }
            return Ok(());
        }
        if seat.refused == Some(state.member) {
            return Ok(());
        }
        let member = seat.member.get_or_insert_with(|| {
            tracing::info!("{name} is there");
            Member {
                id: state.member,
                heard: Instant::now(),
                begun: None,
                asked: false,
                result: None,
            }
        });
        member.heard = Instant::now();
        if state.session == self.session {
            member.result = state.result;
        } else if member.begun.is_some_and(|begun| begun.elapsed() >= SILENCE) {
            // The message to begin was lost: it is sent again before the next frame.
            (member.begun, member.asked) = (None, false);
        }
        Ok(())
    }

    /// Sends a note to one member.
    fn tell(&self, member: u64, note: &Note) -> Result<()> {
        self.send(self.header(FLAG_NOTE), &encode(&(member, note)))
    }

    fn header(&self, flags: u32) -> FrameHeader {
        FrameHeader {
            magic: FRAME_MAGIC,
            version: LAYOUT_VERSION,
            flags,
            session: self.session,
            ..FrameHeader::default()
        }
    }

    fn send(&self, header: FrameHeader, payload: &[u8]) -> Result<()> {
        let connected = self.tasks.update_connections();
        connected.map_err(bus("connect to a shard"))?;
        let sample = self.tasks.loan_slice_uninit(payload.len());
        let mut sample = sample.map_err(bus("loan"))?;
        room::ensure(sample.payload_mut())?;
        let mut sample = sample.write_from_slice(payload);
        *sample.user_header_mut() = header;
        sample.send().map_err(bus("send"))?;
        // A failure only delays the members until their next timer tick.
        let _ = self.notifier.notify();
        Ok(())
    }

    /// Sleeps until a message may have arrived. Returns false if a signal arrived.
    fn sleep(&self) -> bool {
        self.listener.timed_wait_all(|_| {}, TICK).is_ok()
    }
}

impl Drop for ShardLeader {
    fn drop(&mut self) {
        // Best effort: without this message, the members see that the process is gone.
        let header = self.header(FLAG_END);
        let _ = self.send(header, &[]);
    }
}

impl Seat {
    /// Gives up the member, with the reason.
    fn lose(&mut self, why: String) {
        if self.member.take().is_some() {
            tracing::warn!("{why}");
        }
        self.why = why;
    }
}

impl Member {
    /// Returns true if the result of a frame is expected, but has not arrived.
    fn owes(&self, seq: u64) -> bool {
        self.asked && self.result.as_ref().is_none_or(|(frame, _)| *frame != seq)
    }
}
