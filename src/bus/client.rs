//! Client that a simulator links: sends frames, receives verdicts.

use super::frames::{Connection, FrameMemory, Frames};
use super::message::{MessageKind, VerdictMessage};
use super::service::{Endpoint, Role, bus};
use super::services::{ServiceInfo, services};
use super::wait_mode::WaitMode;
use super::watcher::{Departure, Watcher};
use super::wire::{FLAG_ANNOUNCE, FLAG_END, FLAG_UNFINISHED};
use crate::curve::{Basis, Cell, CurveLabels, Positions, Precision};
use crate::error::{Error, Result};
use crate::fork::Owned;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Maximum time that a sleeping client waits before it polls.
const TICK: Duration = Duration::from_millis(10);

/// Duration of a wait for a watcher after which other services are listed as a hint.
const HINT: Duration = Duration::from_secs(1);

/// Options of a [`Client`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ClientOptions {
    /// True if the simulator calls [`Client::wait`] after every frame. The watcher is informed.
    pub lockstep: bool,
    /// Waiting strategy of the calls that block until the watcher answers.
    pub wait_mode: WaitMode,
}

impl ClientOptions {
    /// Returns options for a simulator that waits for the verdict on every frame.
    pub fn lockstep() -> Self {
        ClientOptions {
            lockstep: true,
            ..ClientOptions::default()
        }
    }
}

/// Result of waiting for a verdict.
#[derive(Clone, Debug, PartialEq)]
#[must_use]
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

/// Shared memory of a frame that is being written ([`Client::loan`]). Nothing is sent if it is
/// dropped without [`publish`](FrameLoan::publish).
#[derive(Debug)]
pub struct FrameLoan<'a> {
    memory: FrameMemory,
    client: &'a mut Client,
}

impl FrameLoan<'_> {
    /// Returns the memory of the positions; see [`FrameMemory::positions_f32`].
    ///
    /// # Errors
    ///
    /// The errors of [`FrameMemory::positions_f32`].
    pub fn positions_f32(&mut self) -> Result<&mut [f32]> {
        self.memory.positions_f32()
    }

    /// Returns the memory of the positions in double precision; see
    /// [`FrameMemory::positions_f32`].
    ///
    /// # Errors
    ///
    /// The errors of [`FrameMemory::positions_f64`].
    pub fn positions_f64(&mut self) -> Result<&mut [f64]> {
        self.memory.positions_f64()
    }

    /// Publishes the frame. Returns its sequence number.
    ///
    /// # Errors
    ///
    /// The errors of [`Client::send`].
    pub fn publish(self) -> Result<u64> {
        self.client.send(self.memory)
    }
}

/// Simulator's end of the bus.
///
/// Only the calls that take a time limit wait for the watcher: [`wait`](Client::wait),
/// [`wait_for_watcher`](Client::wait_for_watcher) and [`finish_within`](Client::finish_within). A
/// watcher that is slow, stopped, killed or absent costs the simulator nothing.
///
/// A client is one session: its frames are numbered from 0, unless
/// [`number_next`](Client::number_next) says otherwise. If it is dropped
/// without [`finish`](Client::finish), by an error or a panic, the watcher is informed that the
/// session ended early.
///
/// A client belongs to the process that opened it. In a child that was forked from it, calls fail
/// with [`Error::Forked`], and dropping the client does nothing.
///
/// Programs in other languages use [attaching a simulator](crate::attaching).
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
#[derive(Debug)]
pub struct Client {
    pub(super) frames: Frames,
    watcher: Watcher,
    last: Option<VerdictMessage>,
    aborted: Option<VerdictMessage>,
    /// Aborts for frames before this one are already handled.
    aborts_from: u64,
    goodbye: Option<VerdictMessage>,
    finished: bool,
    /// True if the hint about services with a watcher was logged.
    hinted: bool,
    service: String,
    pub(super) connection: Owned<Connection>,
}

impl Client {
    /// Opens the service, or creates it if the watcher has not done so yet.
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if another living simulator publishes on the same name.
    pub fn open(service: &str, options: &ClientOptions) -> Result<Client> {
        let endpoint = Endpoint::open(service, Role::Simulator, options.wait_mode)?;
        let subscriber = endpoint.verdicts.subscriber_builder().create();
        Ok(Client {
            frames: Frames::new(options.lockstep),
            watcher: Watcher::unknown(),
            last: None,
            aborted: None,
            aborts_from: 0,
            goodbye: None,
            finished: false,
            hinted: false,
            service: service.to_owned(),
            connection: Owned::new(Connection {
                subscriber: subscriber.map_err(bus("subscriber of verdicts"))?,
                endpoint,
            }),
        })
    }

    /// Declares the curves of every frame: the number of control points of each curve, negative if
    /// the curve is closed, as in a BCC file. Call this before the first frame.
    ///
    /// # Errors
    ///
    /// The errors of [`Client::describe_labelled`].
    pub fn describe(&mut self, basis: Basis, precision: Precision, counts: &[i32]) -> Result<()> {
        self.describe_labelled(basis, precision, counts, CurveLabels::default())
    }

    /// Sets the time step of the simulator in seconds, which later frames carry to the recording;
    /// 0 (as at first) if it is unknown.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if it is negative or not finite.
    pub fn set_time_step(&mut self, seconds: f64) -> Result<()> {
        if !(seconds >= 0.0 && seconds.is_finite()) {
            let what = format!("a time step of {seconds} s, expected at least 0");
            return Err(Error::Usage(what));
        }
        self.frames.time_step = seconds;
        Ok(())
    }

    /// Sets the periodic cell of later frames; `None`, as at first, if space is open. The cell may
    /// differ from frame to frame: set it before [`publish`](FrameLoan::publish). All frames of a
    /// session repeat along the same vectors, or along none.
    ///
    /// ```no_run
    /// # fn main() -> linkwatch::Result<()> {
    /// # let mut client = linkwatch::Client::open("linkwatch", &Default::default())?;
    /// # let (positions, shear) = ([0.0_f32; 24], 0.1);
    /// let mut cell: linkwatch::Cell = "10,10,12".parse()?;
    /// cell.vectors[1][0] = shear; // the second vector leans along x
    /// client.set_cell(Some(cell))?;
    /// client.publish(0.0, linkwatch::Positions::F32(&positions))?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    ///
    /// The errors of [`Cell::check`]; the cell stays as it was.
    pub fn set_cell(&mut self, cell: Option<Cell>) -> Result<()> {
        cell.as_ref().map_or(Ok(()), Cell::check)?;
        self.frames.cell = cell;
        Ok(())
    }

    /// Gives the next frame this number, for frames that were numbered before, as in a recording.
    /// The watcher counts the numbers that were left out as skipped frames. A gap must not exceed
    /// the number of frames that a simulator can publish meanwhile, or the watcher rejects the
    /// frame.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if a frame with this number, or a later one, was published.
    pub fn number_next(&mut self, seq: u64) -> Result<()> {
        if seq < self.frames.next {
            let next = self.frames.next;
            let what = format!("frame number {seq} after {next} frames, expected at least {next}");
            return Err(Error::Usage(what));
        }
        self.frames.next = seq;
        Ok(())
    }

    /// Returns memory for the next frame, at `time` seconds of simulation. Write the positions into
    /// it, then call [`publish`](FrameLoan::publish). The watcher reads the same memory; nothing is
    /// copied.
    ///
    /// # Errors
    ///
    /// The errors of [`Client::begin`].
    pub fn loan(&mut self, time: f64) -> Result<FrameLoan<'_>> {
        let memory = self.begin(time)?;
        let client = self;
        Ok(FrameLoan { memory, client })
    }

    /// Publishes a frame from other memory, with one copy into shared memory. Returns its sequence
    /// number.
    ///
    /// # Errors
    ///
    /// The errors of [`Client::begin`] and [`Client::send`]; [`Error::Count`] or
    /// [`Error::LayoutChanged`] if the positions are not those of the described curves.
    pub fn publish(&mut self, time: f64, positions: Positions<'_>) -> Result<u64> {
        let mut frame = self.begin(time)?;
        let expected = frame.coordinates();
        if positions.len() != expected {
            return Err(Error::count("coordinates", expected, positions.len()));
        }
        match positions {
            Positions::F32(from) => frame.positions_f32()?.copy_from_slice(from),
            Positions::F64(from) => frame.positions_f64()?.copy_from_slice(from),
        }
        self.send(frame)
    }

    /// Waits until a watcher has seen this session, at most for `timeout`. Returns true if one has:
    /// then it receives the baseline, and every later frame unless newer ones overtake it.
    ///
    /// Needed only if no frame must be missed. A simulator can also run alone: the client keeps the
    /// baseline ([`Client::accept`]) in shared memory, and a watcher that starts later receives it
    /// before the newest frame.
    ///
    /// If no watcher came within a second or more, logs a warning ([`tracing`]) that names a
    /// watcher which waits on another service, because the service name may be wrong.
    /// [`services`](crate::services) lists all.
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if the connection fails.
    pub fn wait_for_watcher(&mut self, timeout: Duration) -> Result<bool> {
        const REPEAT: Duration = Duration::from_millis(100);
        let start = Instant::now();
        let mut announced: Option<Instant> = None;
        loop {
            self.poll_all()?;
            if self.watcher.silent_for().is_some() {
                if self.watcher.find_dead(&self.connection.endpoint) {
                    continue;
                }
                return Ok(true);
            }
            // Repeated, because the first announcement may be lost over a bridge.
            if self.frames.next == 0 && announced.is_none_or(|t| t.elapsed() >= REPEAT) {
                self.frames.signal(&self.connection, FLAG_ANNOUNCE)?;
                announced = Some(Instant::now());
            }
            if !self.pause(start, timeout) {
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
        let is_free = |s: &&ServiceInfo| s.watcher.is_some() && s.simulator.is_none();
        if let Some(free) = all.iter().find(is_free) {
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
        self.watcher.silent_for()
    }

    /// Returns the next verdict, in the order of the frames, or `None` if there is none. Never
    /// waits.
    ///
    /// Call this about once a step: 64 verdicts are kept, then the oldest are dropped. An abort is
    /// not lost, because the watcher repeats it.
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if the connection fails.
    pub fn poll(&mut self) -> Result<Option<VerdictMessage>> {
        self.connection.check()?;
        loop {
            let received = self.connection.subscriber.receive();
            let Some(sample) = received.map_err(bus("receive"))? else {
                return Ok(None);
            };
            let wire = *sample.payload();
            let (port, node) = (sample.header().publisher_id(), sample.header().node_id());
            drop(sample);
            let mut message = wire.read()?;
            // The watcher repeats an abort, also when the names of that frame are forgotten.
            message.names = match &self.aborted {
                Some(abort) if abort.seq == message.seq => Arc::clone(&abort.names),
                _ => self.frames.names(message.seq),
            };
            let (endpoint, session) = (&self.connection.endpoint, self.frames.session);
            if !(self.watcher).record_sender(endpoint, session, &message, port, node) {
                continue;
            }
            // Another program can publish frames into this session; the verdicts on them do not
            // count.
            let published = message.seq < self.frames.next;
            message.abort &= published && message.seq >= self.aborts_from;
            if message.abort && self.aborted.is_none() {
                self.aborted = Some(message.clone());
            }
            match message.kind {
                MessageKind::Verdict if published => {
                    self.frames.forget_names_before(message.seq);
                    self.last = Some(message.clone());
                    return Ok(Some(message));
                }
                MessageKind::Goodbye => self.goodbye = Some(message),
                MessageKind::Hello | MessageKind::Verdict => {}
            }
        }
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

    /// Clears the abort after a rollback: verdicts on the frames published so far no longer ask the
    /// simulator to stop, and the next frame does not continue them ([`Client::cut`]).
    ///
    /// If the next verified frame is intact, the violation is *recovered*
    /// ([`VerdictMessage::recovered`]): it does not count for the result of the watch.
    pub fn resume(&mut self) {
        self.aborted = None;
        self.aborts_from = self.frames.next;
        self.cut();
    }

    /// Accepts the present state as the new baseline: the watcher expects the linking numbers of
    /// the next frame from then on, whatever they are, and does not search for pull-throughs in the
    /// step to it. Clears the abort, as [`resume`](Client::resume) does.
    ///
    /// For a change of topology that is intended: after an abort, before the simulation goes on
    /// from the changed state; or before a change that the simulator makes itself, after which it
    /// publishes the next frame. The watch reports and records the new baseline, and a violation
    /// that was accepted is not called intact.
    pub fn accept(&mut self) {
        self.resume();
        self.frames.baseline = None;
    }

    /// Marks the next frame as not continuing the previous one: after a restart from a checkpoint,
    /// or in another scene with the same curves. The watcher does not search for pull-throughs
    /// between the two frames; it still compares linking numbers with the baseline.
    ///
    /// Call this before [`Client::loan`]. The cut is not lost if the watcher skips the next frame.
    pub fn cut(&mut self) {
        self.frames.cuts = self.frames.cuts.wrapping_add(1);
    }

    /// Waits for the verdict on frame `seq`, at most for `deadline`. Verdicts on earlier frames are
    /// read meanwhile, and their aborts are kept.
    ///
    /// Returns at once if the watcher said goodbye, and within a second if its process died on this
    /// host; over a bridge, after `deadline`. If no watcher has connected yet, one may connect
    /// during the wait.
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if the connection fails.
    pub fn wait(&mut self, seq: u64, deadline: Duration) -> Result<Outcome> {
        let start = Instant::now();
        loop {
            while self.last.as_ref().is_none_or(|m| m.seq < seq) && self.poll()?.is_some() {}
            match &self.last {
                Some(m) if m.seq == seq => return Ok(Outcome::Verdict(Box::new(m.clone()))),
                // Frames are verified in order, so this one never will be.
                Some(m) if m.seq > seq => return Ok(Outcome::Stale),
                _ => {}
            }
            if let Some(how) = self.watcher.departure() {
                return Ok(Outcome::NoWatcher(how.clone()));
            }
            let endpoint = &self.connection.endpoint;
            if !self.watcher.has_crashed(endpoint) && !self.pause(start, deadline) {
                return Ok(Outcome::Stale);
            }
        }
    }

    /// Returns the reason why the watcher left, if it did and no other one came. Only messages that
    /// [`poll`](Client::poll) or a wait has read count.
    pub fn departure(&self) -> Option<&Departure> {
        self.watcher.departure()
    }

    /// Waits until a verdict may have arrived. Returns false once `timeout` is over.
    fn pause(&self, start: Instant, timeout: Duration) -> bool {
        // Connects to new watchers, so that one that started after the newest frame receives it
        // now. In lockstep it would otherwise wait for the next frame, which the simulator never
        // publishes. A failed connection is retried at the next tick.
        self.frames.connect();
        let left = timeout.saturating_sub(start.elapsed());
        if left.is_zero() {
            return false;
        }
        if !self.connection.endpoint.wait(left.min(TICK)) {
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
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if the end cannot be sent.
    pub fn finish(mut self) -> Result<u64> {
        self.end()?;
        Ok(self.frames.next)
    }

    /// Ends the session and waits, at most for `timeout`, until the watcher has verified its
    /// remaining frames and said goodbye. Its last message counts all frames and repeats the last
    /// abort.
    ///
    /// Returns `None` if the watcher sent nothing in time, left before the end, or died.
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if the connection fails.
    pub fn finish_within(mut self, timeout: Duration) -> Result<Option<VerdictMessage>> {
        // A goodbye that arrived earlier means that the watcher left early.
        self.poll_all()?;
        self.goodbye = None;
        self.end()?;
        let start = Instant::now();
        loop {
            self.poll_all()?;
            if self.goodbye.is_some() || self.watcher.departure().is_some() {
                return Ok(self.goodbye.take());
            }
            if !self.watcher.has_crashed(&self.connection.endpoint) && !self.pause(start, timeout) {
                return Ok(None);
            }
        }
    }

    fn end(&mut self) -> Result<()> {
        self.frames.signal(&self.connection, FLAG_END)?;
        self.finished = true;
        Ok(())
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        if !self.finished && self.frames.publishers.is_some() {
            // Best effort: without this message the watcher notices the end half a second later.
            let flags = FLAG_END | FLAG_UNFINISHED;
            let _ = self.frames.signal(&self.connection, flags);
        }
    }
}
