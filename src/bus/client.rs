//! Client that a simulator links: sends frames, receives verdicts.

use super::loan::FrameLoan;
use super::message::{MessageKind, VerdictMessage};
use super::service::{Endpoint, Ipc, NodeId, Role, bus};
use super::services::services;
use super::wire::{
    FLAG_ANNOUNCE, FLAG_END, FLAG_LOCKSTEP, FLAG_UNFINISHED, FRAME_MAGIC, FrameHeader,
    LAYOUT_VERSION, VerdictWire, payload_bytes, table_bytes,
};
use crate::curve::{Basis, Positions, Precision};
use crate::error::{Error, Result};
use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy};
use std::fmt;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::time::{Duration, Instant};

/// Number of frames that are allocated from the start. This suffices for two subscribers that hold
/// as many frames as they may, out of at most four. More subscribers grow the buffer, which is
/// slow. Only memory that was written to is resident.
const FRAMES_SET_ASIDE: usize = 16;

/// Maximum time that a waiting client sleeps before it polls.
const TICK: Duration = Duration::from_millis(10);

/// Silence after which a waiting client checks that the process of the watcher exists, and the
/// interval of these checks. Each check takes a few dozen system calls.
const LIVENESS: Duration = Duration::from_millis(250);

/// Duration of a wait for a watcher after which other services are listed as a hint.
const HINT: Duration = Duration::from_secs(1);

/// Options of a [`Client`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ClientOptions {
    /// True if the simulator calls [`Client::wait`] after every frame. The watcher is informed.
    pub lockstep: bool,
}

impl ClientOptions {
    /// Returns options for a simulator that waits for the verdict on every frame.
    pub fn lockstep() -> Self {
        ClientOptions { lockstep: true }
    }
}

/// Result of waiting for a verdict.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// The frame was verified.
    Verdict(Box<VerdictMessage>),
    /// No verdict in time, or the watcher skipped the frame. The frame is not known to be intact.
    Stale,
    /// No verdict, and none will come: the watcher left. The frame is not known to be intact.
    ///
    /// Returned at once, for this frame and each later one, until another watcher comes.
    NoWatcher(Departure),
}

/// Reason why the watcher left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Departure {
    /// The watcher said goodbye: it was asked to end, or another simulator took over.
    Goodbye,
    /// The process of the watcher ended without a goodbye: it crashed or was killed.
    Crashed,
}

impl fmt::Display for Departure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Departure::Goodbye => "the watcher said goodbye",
            Departure::Crashed => "the watcher died without a goodbye",
        })
    }
}

/// State of the watcher, as known to the client.
#[derive(Clone, Copy, Debug)]
enum Watcher {
    /// No watcher has sent a message.
    Unknown,
    Here {
        port: UniquePublisherId,
        node: NodeId,
        heard: Instant,
        /// True if the watcher sent a message about this session, not only about its existence.
        met: bool,
    },
    Left {
        port: UniquePublisherId,
        how: Departure,
    },
}

/// Simulator's end of the bus.
///
/// Only the calls that take a time limit wait for the watcher: [`wait`](Client::wait),
/// [`wait_for_watcher`](Client::wait_for_watcher) and [`finish_within`](Client::finish_within). A
/// watcher that is slow, stopped, killed or absent costs the simulator nothing.
///
/// A client is one session: one layout of curves, and frames numbered from 0. If it is dropped
/// without [`finish`](Client::finish), by an error or a panic, the watcher is informed that the
/// session ended early.
///
/// Programs in other languages use [the wire format](crate::wire_format).
///
/// ```no_run
/// use linkwatch::{Basis, Client, ClientOptions, Precision};
///
/// # fn main() -> linkwatch::Result<()> {
/// let mut client = Client::open("linkwatch", &ClientOptions::default())?;
/// client.describe(Basis::Polyline, Precision::F32, &[-100, -100])?; // two closed loops
/// for step in 0..1000 {
///     let mut frame = client.loan(f64::from(step) * 0.01)?;
///     for point in frame.positions_f32()?.chunks_exact_mut(3) {
///         point.copy_from_slice(&[0.0, 0.0, 0.0]); // from the simulation
///     }
///     frame.publish()?;
///     while let Some(verdict) = client.poll()? {
///         println!("{verdict}");
///     }
///     if client.aborted().is_some() {
///         break;
///     }
/// }
/// client.finish()?;
/// # Ok(())
/// # }
/// ```
pub struct Client {
    publisher: Option<Publisher<Ipc, [u8], FrameHeader>>,
    subscriber: Subscriber<Ipc, VerdictWire, ()>,
    session: u64,
    lockstep: bool,
    layout: Option<Layout>,
    next_seq: u64,
    /// Number of cuts so far. Frames with different numbers do not belong to one motion.
    cuts: u32,
    watcher: Watcher,
    /// When the process of the watcher was last checked.
    checked: Instant,
    last: Option<VerdictMessage>,
    aborted: Option<VerdictMessage>,
    /// Aborts for frames before this one are already handled.
    aborts_from: u64,
    goodbye: Option<VerdictMessage>,
    finished: bool,
    /// True if the hint about services with a watcher was logged.
    hinted: bool,
    service: String,
    endpoint: Endpoint,
}

struct Layout {
    basis: Basis,
    precision: Precision,
    points: usize,
    curves: usize,
    /// The counts in their form in the payload, padding included.
    table: Vec<u8>,
}

impl fmt::Debug for Client {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Client")
            .field("session", &self.session)
            .field("next_seq", &self.next_seq)
            .finish_non_exhaustive()
    }
}

impl Client {
    /// Opens the service, or creates it if the watcher has not done so yet.
    ///
    /// Errors: [`Error::Bus`] if another living simulator publishes on the same name.
    pub fn open(service: &str, options: &ClientOptions) -> Result<Client> {
        let endpoint = Endpoint::open(service, Role::Simulator)?;
        let subscriber = endpoint.verdicts.subscriber_builder().create();
        Ok(Client {
            publisher: None,
            subscriber: subscriber.map_err(bus("subscriber of verdicts"))?,
            session: random(),
            lockstep: options.lockstep,
            layout: None,
            next_seq: 0,
            cuts: 0,
            watcher: Watcher::Unknown,
            checked: Instant::now(),
            last: None,
            aborted: None,
            aborts_from: 0,
            goodbye: None,
            finished: false,
            hinted: false,
            service: service.to_owned(),
            endpoint,
        })
    }

    /// Declares the curves of every frame: the number of control points of each curve, negative if
    /// the curve is closed, as in a BCC file. Call this before the first frame.
    pub fn describe(&mut self, basis: Basis, precision: Precision, counts: &[i32]) -> Result<()> {
        if self.next_seq > 0 {
            return Err(Error::Bus(
                "the curves of a session cannot change after its first frame: finish this client \
                 and open another one"
                    .into(),
            ));
        }
        let mut points = 0;
        for (curve, &count) in counts.iter().enumerate() {
            let n = count.unsigned_abs() as usize;
            let closed = count < 0;
            if basis.segments(n, closed).is_none() {
                return Err(Error::CurveTooShort {
                    curve,
                    points: n,
                    kind: basis.describe(closed),
                    needed: basis.needs(closed),
                });
            }
            points += n;
        }
        let bytes = payload_bytes(counts.len(), points, precision);
        let (Some(bytes), Some(table_len)) = (bytes, table_bytes(counts.len())) else {
            return Err(Error::Bus(format!(
                "{points} points do not fit into memory"
            )));
        };
        let mut table: Vec<u8> = counts.iter().flat_map(|c| c.to_ne_bytes()).collect();
        table.resize(table_len, 0);
        self.layout = Some(Layout {
            basis,
            precision,
            points,
            curves: counts.len(),
            table,
        });
        self.publisher(bytes)?;
        Ok(())
    }

    /// Returns the publisher, creating it if necessary. Its memory initially fits frames of `bytes`
    /// bytes, and grows.
    fn publisher(&mut self, bytes: usize) -> Result<&Publisher<Ipc, [u8], FrameHeader>> {
        if self.publisher.is_none() {
            let builder = self.endpoint.frames.publisher_builder();
            let publisher = builder
                .initial_max_slice_len(bytes.max(1))
                .allocation_strategy(AllocationStrategy::PowerOfTwo)
                .max_loaned_samples(2)
                .override_sample_preallocation(|worst| worst.min(FRAMES_SET_ASIDE))
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .create();
            self.publisher = Some(publisher.map_err(bus("publisher of frames"))?);
        }
        Ok(self.publisher.as_ref().expect("created above"))
    }

    fn header(&self, flags: u32) -> FrameHeader {
        let lockstep = if self.lockstep { FLAG_LOCKSTEP } else { 0 };
        FrameHeader {
            magic: FRAME_MAGIC,
            version: LAYOUT_VERSION,
            flags: flags | lockstep,
            session: self.session,
            seq: self.next_seq,
            time: 0.0,
            n_points: 0,
            n_curves: 0,
            basis: 0,
            coordinate_bytes: 4,
            cuts: self.cuts,
        }
    }

    /// Sends a header without curves.
    fn signal(&mut self, flags: u32) -> Result<()> {
        self.connect()?;
        let header = self.header(flags);
        let publisher = self.publisher(1)?;
        let mut sample = publisher.loan_slice(0).map_err(bus("loan"))?;
        *sample.user_header_mut() = header;
        sample.send().map_err(bus("send"))?;
        self.endpoint.notify();
        Ok(())
    }

    /// Returns memory for the next frame, at `time` seconds of simulation. Write the positions into
    /// it, then call [`publish`](FrameLoan::publish). The watcher reads the same memory; nothing is
    /// copied.
    pub fn loan(&mut self, time: f64) -> Result<FrameLoan<'_>> {
        let Some(layout) = &self.layout else {
            return Err(Error::Bus(
                "no curves are declared: call Client::describe before the first frame".into(),
            ));
        };
        let (basis, precision) = (layout.basis, layout.precision);
        let header = FrameHeader {
            time,
            n_points: layout.points as u64,
            n_curves: layout.curves as u32,
            basis: basis.code(),
            coordinate_bytes: precision.bytes() as u32,
            ..self.header(0)
        };
        let table = layout.table.len();
        let bytes = table + 3 * layout.points * precision.bytes();
        let publisher = self.publisher.as_ref().expect("`describe` created it");
        let sample = publisher.loan_slice_uninit(bytes).map_err(bus("loan"))?;
        #[expect(unsafe_code, reason = "shared memory is lent as uninitialised")]
        // SAFETY: the memory is a shared mapping. Each of its bytes was written by the system
        // (zeros) or by an earlier frame of this publisher, all of whose bytes were initialised;
        // the compiler can assume nothing else of memory that it did not allocate. Every bit
        // pattern is a valid `u8`.
        let mut sample = unsafe { sample.assume_init() };
        *sample.user_header_mut() = header;
        let payload = sample.payload_mut();
        payload[..table].copy_from_slice(&layout.table);
        if cfg!(debug_assertions) {
            // All bits set is NaN in both precisions, so a missing coordinate is rejected.
            payload[table..].fill(0xff);
        }
        Ok(FrameLoan {
            sample,
            table,
            precision,
            client: self,
        })
    }

    /// Publishes a frame from other memory, with one copy into shared memory. Returns its sequence
    /// number.
    pub fn publish(&mut self, time: f64, positions: Positions<'_>) -> Result<u64> {
        let mut frame = self.loan(time)?;
        let expected = frame.coordinates();
        if positions.len() != expected {
            return Err(Error::Count {
                what: "coordinates",
                promised: expected as u64,
                available: positions.len() as u64,
            });
        }
        match positions {
            Positions::F32(from) => frame.positions_f32()?.copy_from_slice(from),
            Positions::F64(from) => frame.positions_f64()?.copy_from_slice(from),
        }
        frame.publish()
    }

    /// Connects to watchers that started since the last call. Call this before sending anything
    /// that a watcher may answer: messages that it sends earlier are lost, including its goodbye.
    pub(super) fn connect(&self) -> Result<()> {
        let connected = self.subscriber.update_connections();
        connected.map_err(bus("connect to a watcher"))
    }

    /// Updates the state after a frame was sent. Returns its sequence number.
    pub(super) fn sent(&mut self) -> u64 {
        let seq = self.next_seq;
        self.next_seq += 1;
        self.endpoint.notify();
        seq
    }

    /// Waits until a watcher has seen this session, at most for `timeout`. Returns true if one has.
    ///
    /// Needed only if the watcher must not miss the first frames. A simulator can also run alone,
    /// and a watcher that starts later receives the newest frame.
    ///
    /// If no watcher came within a second or more, logs a warning ([`tracing`]) that names a
    /// watcher which waits on another service, because the service name may be wrong.
    /// [`services`](crate::services) lists all.
    pub fn wait_for_watcher(&mut self, timeout: Duration) -> Result<bool> {
        const REPEAT: Duration = Duration::from_millis(100);
        let start = Instant::now();
        let mut announced: Option<Instant> = None;
        loop {
            self.poll_all()?;
            if let Watcher::Here { met: true, .. } = self.watcher {
                if self.find_watcher_dead() {
                    continue;
                }
                return Ok(true);
            }
            // Repeated, because the first announcement may be lost over a bridge.
            if self.next_seq == 0 && announced.is_none_or(|t| t.elapsed() >= REPEAT) {
                self.signal(FLAG_ANNOUNCE)?;
                announced = Some(Instant::now());
            }
            if !self.sleep(start, timeout) {
                self.hint(start.elapsed());
                return Ok(false);
            }
        }
    }

    /// Logs, once, a service whose watcher waits for a simulator, if the wait was long.
    fn hint(&mut self, waited: Duration) {
        if waited < HINT || std::mem::replace(&mut self.hinted, true) {
            return;
        }
        let all = services().unwrap_or_default();
        let mut free = all
            .iter()
            .filter(|s| s.watcher.is_some() && s.simulator.is_none());
        if let Some(free) = free.next() {
            tracing::warn!(
                "no watcher came to service '{}'; one waits for a simulator on another service: \
                 {free}",
                self.service,
            );
        }
    }

    /// Returns the time since the watcher's last message about this session; `None` if it never
    /// sent one, or left.
    ///
    /// `linkwatch watch` sends a message about once a second, also during a long check, and one
    /// with each verdict. The simulator decides what a longer silence means.
    pub fn silent_for(&self) -> Option<Duration> {
        match self.watcher {
            Watcher::Here {
                heard, met: true, ..
            } => Some(heard.elapsed()),
            _ => None,
        }
    }

    /// Records the sender of a message. Returns false if the message is not about this session.
    fn record_sender(
        &mut self,
        message: &VerdictMessage,
        from: UniquePublisherId,
        node: NodeId,
    ) -> bool {
        let mine = message.session == self.session;
        // Session 0: a watcher without a session announces itself or leaves.
        if !mine && message.session != 0 {
            return false;
        }
        let goodbye = message.kind == MessageKind::Goodbye;
        let (believed, met) = match self.watcher {
            Watcher::Unknown => (mine || !goodbye, mine),
            Watcher::Here { port, met, .. } if port == from => (true, met || mine),
            // The messages of an earlier watcher arrive before those of a later one.
            Watcher::Here { .. } if goodbye => (false, false),
            Watcher::Here { node, .. } => (mine || self.endpoint.node_is_gone(node), mine),
            // A watcher that has left this session may stay for the next one.
            Watcher::Left { port, .. } => (mine || !goodbye && port != from, mine),
        };
        if believed {
            self.watcher = match goodbye {
                true => Watcher::Left {
                    port: from,
                    how: Departure::Goodbye,
                },
                false => Watcher::Here {
                    port: from,
                    node,
                    heard: Instant::now(),
                    met,
                },
            };
        }
        mine
    }

    /// Checks whether a watcher that has been silent for a while still exists. Returns true if this
    /// call found it dead; its last messages may still be unread.
    fn watcher_crashed(&mut self) -> bool {
        match self.watcher {
            Watcher::Here { heard, .. }
                if heard.elapsed().min(self.checked.elapsed()) >= LIVENESS =>
            {
                self.find_watcher_dead()
            }
            _ => false,
        }
    }

    /// Like [`Client::watcher_crashed`], but also checks a watcher that sent a message a moment
    /// ago.
    fn find_watcher_dead(&mut self) -> bool {
        let Watcher::Here { port, node, .. } = self.watcher else {
            return false;
        };
        self.checked = Instant::now();
        let crashed = self.endpoint.node_is_gone(node);
        if crashed {
            self.watcher = Watcher::Left {
                port,
                how: Departure::Crashed,
            };
        }
        crashed
    }

    /// Returns the next verdict, in the order of the frames, or `None` if there is none. Never
    /// waits.
    ///
    /// Call this about once a step: 64 verdicts are kept, then the oldest are dropped. An abort is
    /// not lost, because the watcher repeats it.
    pub fn poll(&mut self) -> Result<Option<VerdictMessage>> {
        while let Some(sample) = self.subscriber.receive().map_err(bus("receive"))? {
            let wire = *sample.payload();
            let (port, node) = (sample.header().publisher_id(), sample.header().node_id());
            drop(sample);
            let mut message = wire.read()?;
            if !self.record_sender(&message, port, node) {
                continue;
            }
            // Another program can publish frames into this session; the verdicts on them do not
            // count.
            let published = message.seq < self.next_seq;
            message.abort &= published;
            if message.abort && message.seq >= self.aborts_from && self.aborted.is_none() {
                self.aborted = Some(message.clone());
            }
            match message.kind {
                MessageKind::Verdict if published => {
                    self.last = Some(message.clone());
                    return Ok(Some(message));
                }
                MessageKind::Goodbye => self.goodbye = Some(message),
                MessageKind::Hello | MessageKind::Verdict => {}
            }
        }
        Ok(None)
    }

    /// Reads all pending verdicts.
    fn poll_all(&mut self) -> Result<()> {
        while self.poll()?.is_some() {}
        Ok(())
    }

    /// Returns the first message read by [`poll`](Client::poll) that asks the simulator to stop.
    pub fn aborted(&self) -> Option<&VerdictMessage> {
        self.aborted.as_ref()
    }

    /// Clears the abort after a rollback: verdicts on the frames published so far no longer count,
    /// and the next frame does not continue them ([`Client::cut`]).
    pub fn resume(&mut self) {
        self.aborted = None;
        self.aborts_from = self.next_seq;
        self.cut();
    }

    /// Marks the next frame as not continuing the previous one: after a restart from a checkpoint,
    /// or in another scene with the same curves. The watcher does not search for pull-throughs
    /// between the two frames; it still compares linking numbers with the baseline.
    ///
    /// Call this before [`Client::loan`]. The cut is not lost if the watcher skips the next frame.
    pub fn cut(&mut self) {
        self.cuts = self.cuts.wrapping_add(1);
    }

    /// Waits for the verdict on frame `seq`, at most for `deadline`. Verdicts on earlier frames are
    /// read meanwhile, and their aborts are kept.
    ///
    /// Returns at once if the watcher said goodbye, and within a second if its process died on this
    /// host; over a bridge, after `deadline`. If no watcher has connected yet, one may connect
    /// during the wait.
    pub fn wait(&mut self, seq: u64, deadline: Duration) -> Result<Outcome> {
        let start = Instant::now();
        loop {
            while self.last.as_ref().is_none_or(|m| m.seq < seq) {
                if self.poll()?.is_none() {
                    break;
                }
            }
            match &self.last {
                Some(m) if m.seq == seq => return Ok(Outcome::Verdict(Box::new(m.clone()))),
                // Frames are verified in order, so this one never will be.
                Some(m) if m.seq > seq => return Ok(Outcome::Stale),
                _ => {}
            }
            if let Watcher::Left { how, .. } = self.watcher {
                return Ok(Outcome::NoWatcher(how));
            }
            if self.watcher_crashed() {
                continue;
            }
            if !self.sleep(start, deadline) {
                return Ok(Outcome::Stale);
            }
        }
    }

    /// Sleeps until a verdict may have arrived. Returns false once `timeout` is over.
    fn sleep(&self, start: Instant, timeout: Duration) -> bool {
        // Connects to new watchers, so that one that started after the newest frame receives it
        // now. In lockstep it would otherwise wait for the next frame, which the simulator never
        // publishes. A failed connection is retried at the next tick.
        if let Some(publisher) = &self.publisher {
            let _ = publisher.update_connections();
        }
        let left = timeout.saturating_sub(start.elapsed());
        if left.is_zero() {
            return false;
        }
        if !self.endpoint.sleep(left.min(TICK)) {
            // A signal arrived; the owner of the process handles it.
            std::thread::sleep(Duration::from_millis(1).min(left));
        }
        true
    }

    /// Ends the session and informs the watcher of the number of frames. Does not wait. Returns
    /// that number.
    ///
    /// A watcher that has not connected since this client opened does not receive the end. It
    /// connects when the first frame is published, or a few milliseconds later. A program that may
    /// be shorter than that should use [`wait_for_watcher`](Client::wait_for_watcher) or
    /// [`finish_within`](Client::finish_within).
    pub fn finish(mut self) -> Result<u64> {
        self.end()?;
        Ok(self.next_seq)
    }

    /// Ends the session and waits, at most for `timeout`, until the watcher has verified its
    /// remaining frames and said goodbye. Its last message counts all frames and repeats the last
    /// abort.
    ///
    /// Returns `None` if the watcher sent nothing in time, left before the end, or died.
    pub fn finish_within(mut self, timeout: Duration) -> Result<Option<VerdictMessage>> {
        // A goodbye that arrived earlier means that the watcher left early.
        self.poll_all()?;
        self.goodbye = None;
        self.end()?;
        let start = Instant::now();
        loop {
            self.poll_all()?;
            let left = matches!(self.watcher, Watcher::Left { .. });
            if self.goodbye.is_some() || left {
                return Ok(self.goodbye.take());
            }
            if !self.watcher_crashed() && !self.sleep(start, timeout) {
                return Ok(None);
            }
        }
    }

    fn end(&mut self) -> Result<()> {
        self.signal(FLAG_END)?;
        self.finished = true;
        Ok(())
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        if !self.finished && self.publisher.is_some() {
            // Best effort: without this message the watcher notices the end half a second later.
            let _ = self.signal(FLAG_END | FLAG_UNFINISHED);
        }
    }
}

/// Returns a random session number, never 0, from the random seed of hash maps.
fn random() -> u64 {
    let mut hasher = RandomState::new().build_hasher();
    hasher.write_u32(std::process::id());
    hasher.finish().max(1)
}
