//! Frames of a session, which the simulator writes into shared memory.

use super::client::Client;
use super::ipc::Ipc;
use super::room;
use super::service::{Endpoint, bus};
use super::wire::{
    FLAG_ANNOUNCE, FLAG_BASELINE, FLAG_LOCKSTEP, FLAG_RADII, FRAME_MAGIC, FrameHeader,
    LAYOUT_VERSION, VerdictWire, table_of,
};
use crate::curve::{Basis, Cell, CurveLabels, Precision};
use crate::error::{Error, Result};
use crate::fork::Owned;
use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy};
use iceoryx2::sample_mut::SampleMut;
use std::collections::VecDeque;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::sync::Arc;

/// Maximum number of frames that are lent at once: one that is written, one for a signal, and some
/// that keep the memory mapped for readers of earlier frames, one for each layout of curves.
pub(super) const LOANS: usize = 8;

/// Maximum number of bytes of a frame.
pub(super) const MAX_BYTES: usize = u32::MAX as usize;

/// Connection of the client with the watcher.
#[derive(Debug)]
pub(super) struct Connection {
    pub subscriber: Subscriber<Ipc, VerdictWire, ()>,
    pub endpoint: Endpoint,
}

impl Connection {
    /// Connects to watchers that started since the last call. Call this before sending anything
    /// that a watcher may answer: messages that it sends earlier are lost, including its goodbye.
    fn connect(&self) -> Result<()> {
        let connected = self.subscriber.update_connections();
        connected.map_err(bus("connect to a watcher"))
    }
}

type FramePublisher = Publisher<Ipc, [u8], FrameHeader>;

/// Publishers of a session. Each watcher keeps a separate buffer for each of them.
#[derive(Debug)]
pub(super) struct Publishers {
    frames: FramePublisher,
    /// Publishes baselines only. Newer frames do not replace the last one in the buffer of a
    /// watcher, and a watcher that starts later receives it, too.
    baselines: FramePublisher,
}

impl Publishers {
    /// Connects to watchers that started since the last call. A failed connection is retried by the
    /// next call.
    fn connect(&self) {
        // In this order, so that a watcher that has a newer frame gets the baseline as well.
        let _ = self.frames.update_connections();
        let _ = self.baselines.update_connections();
    }
}

/// Frames of a session: their layout and their numbers.
#[derive(Debug, Default)]
pub(super) struct Frames {
    /// `None` before something was sent or declared.
    pub publishers: Option<Owned<Publishers>>,
    pub session: u64,
    lockstep: bool,
    layout: Option<Layout>,
    /// Number of layouts that were declared.
    layouts: u32,
    /// The names of the curves, with the number of the first frame that has them. Names that were
    /// replaced before the last frame with a verdict are forgotten.
    names: VecDeque<(u64, Arc<[String]>)>,
    /// Time step of the simulator in seconds; 0 if it is unknown.
    pub time_step: f64,
    /// Periodic cell of the next frames, if the scene is periodic.
    pub cell: Option<Cell>,
    /// Number of the next frame.
    pub next: u64,
    /// Number of the frame that is the baseline; `None` if the next one is.
    pub baseline: Option<u64>,
    /// Number of cuts so far. Frames with different numbers do not belong to one motion.
    pub cuts: u32,
}

/// Description of the curves, which all frames have in common until the next description.
#[derive(Debug)]
struct Layout {
    basis: Basis,
    precision: Precision,
    points: usize,
    curves: usize,
    /// The counts, names and radii in their form in the payload, padding included.
    table: Vec<u8>,
    names_bytes: u32,
    labels: CurveLabels,
}

impl Frames {
    /// Starts a session. `lockstep` informs the watcher that the simulator waits for each verdict.
    pub fn new(lockstep: bool) -> Frames {
        Frames {
            session: random(),
            lockstep,
            ..Frames::default()
        }
    }

    /// Connects to watchers that started since the last frame.
    pub fn connect(&self) {
        if let Some(publishers) = &self.publishers {
            publishers.connect();
        }
    }

    /// Forgets the names of the curves of frames before this one.
    pub fn forget_names_before(&mut self, seq: u64) {
        while self.names.get(1).is_some_and(|(first, _)| *first <= seq) {
            self.names.pop_front();
        }
    }

    /// Returns the names of the curves of a frame; empty if they have none, or are forgotten.
    pub fn names(&self, seq: u64) -> Arc<[String]> {
        let mut latest_first = self.names.iter().rev();
        let found = latest_first.find(|(first, _)| *first <= seq);
        found.map_or_else(Arc::default, |(_, names)| Arc::clone(names))
    }

    /// Returns the publishers, creating them if necessary. The memory of each initially fits as
    /// many frames of `bytes` bytes as all subscribers can hold, so it only grows for larger
    /// frames. Only memory that was written to is resident.
    fn publishers(&mut self, connection: &Connection, bytes: usize) -> Result<&Owned<Publishers>> {
        if self.publishers.is_none() {
            let create = |loans| {
                let builder = connection.endpoint.frames.publisher_builder();
                builder
                    .initial_max_slice_len(bytes.max(1))
                    .allocation_strategy(AllocationStrategy::PowerOfTwo)
                    .max_loaned_samples(loans)
                    .backpressure_strategy(BackpressureStrategy::DiscardData)
                    .create()
                    .map_err(bus("publisher of frames"))
            };
            self.publishers = Some(Owned::new(Publishers {
                frames: create(LOANS)?,
                baselines: create(1)?,
            }));
        }
        Ok(self.publishers.as_ref().expect("created above"))
    }

    fn header(&self, flags: u32) -> FrameHeader {
        let lockstep = if self.lockstep { FLAG_LOCKSTEP } else { 0 };
        FrameHeader {
            magic: FRAME_MAGIC,
            version: LAYOUT_VERSION,
            flags: flags | lockstep,
            session: self.session,
            seq: self.next,
            baseline: self.baseline.unwrap_or(self.next),
            coordinate_bytes: 4,
            cuts: self.cuts,
            layout: self.layouts,
            time_step: self.time_step,
            ..FrameHeader::default()
        }
    }

    /// Sends a header without curves.
    pub fn signal(&mut self, connection: &Owned<Connection>, flags: u32) -> Result<()> {
        connection.check()?;
        connection.connect()?;
        let header = self.header(flags);
        let publishers = self.publishers(connection, 1)?;
        let send = |publisher: &FramePublisher, flag| {
            let mut sample = publisher.loan_slice(0).map_err(bus("loan"))?;
            *sample.user_header_mut() = header;
            sample.user_header_mut().flags |= flag;
            sample.send().map_err(bus("send"))
        };
        if flags & FLAG_ANNOUNCE != 0 {
            send(&publishers.baselines, FLAG_BASELINE)?;
        }
        // First, because a watcher reads nothing after the end of the session.
        let _ = publishers.baselines.update_connections();
        send(&publishers.frames, 0)?;
        publishers.connect();
        connection.endpoint.notify();
        Ok(())
    }
}

impl Client {
    /// Same as [`describe`](Client::describe), for curves with names or radii.
    ///
    /// If the curves have names, this can be called again between two frames: curves may be added,
    /// removed, reordered, or get another number of points. The watcher compares the linking
    /// numbers of curves by their names, and expects those of new curves to stay as they are in
    /// their first frame. It searches for pull-throughs among the curves that keep their name and
    /// number of points.
    ///
    /// # Errors
    ///
    /// The errors of [`CurveLabels::check`]; [`Error::Usage`] without curves;
    /// [`Error::CurveTooShort`]; [`Error::Bus`] if curves without names change after the first
    /// frame.
    pub fn describe_labelled(
        &mut self,
        basis: Basis,
        precision: Precision,
        counts: &[i32],
        labels: CurveLabels,
    ) -> Result<()> {
        self.connection.check()?;
        let frames = &mut self.frames;
        labels.check(counts.len())?;
        if counts.is_empty() {
            return Err(Error::Usage("no curves: describe at least one".into()));
        }
        let unnamed = |labels: &CurveLabels| labels.names.is_empty();
        let before = frames.layout.as_ref().map(|layout| &layout.labels);
        if frames.next > 0 && (unnamed(&labels) || before.is_none_or(unnamed)) {
            let what = "curves without names cannot change after the first frame: name them from \
                        the first frame on, or finish this client and open another one";
            return Err(Error::Bus(what.into()));
        }
        let mut points = 0;
        for (curve, &count) in counts.iter().enumerate() {
            let n = count.unsigned_abs() as usize;
            basis.segments_of(curve, n, count < 0)?;
            points += n;
        }
        let (table, names_bytes) = table_of(counts, &labels);
        let positions = points.saturating_mul(3 * precision.bytes());
        let bytes = table.len().saturating_add(positions);
        if bytes > MAX_BYTES {
            return Err(Error::Bus(format!(
                "a frame of {points} points is larger than the limit of {MAX_BYTES} bytes"
            )));
        }
        frames.names.pop_back_if(|(first, _)| *first == frames.next);
        let named = frames.names.back().map(|(_, names)| &names[..]);
        if named != Some(labels.names.as_slice()) {
            let names = labels.names.as_slice().into();
            frames.names.push_back((frames.next, names));
        }
        frames.layout = Some(Layout {
            basis,
            precision,
            points,
            curves: counts.len(),
            table,
            names_bytes: names_bytes as u32,
            labels,
        });
        frames.layouts += 1;
        let is_new = frames.publishers.is_none();
        frames.publishers(&self.connection, bytes)?;
        match is_new {
            // A watcher maps the memory of a publisher with its first message, which it must read
            // while the simulator lives.
            true => frames.signal(&self.connection, FLAG_ANNOUNCE),
            false => Ok(()),
        }
    }

    /// Returns memory for the next frame, as [`loan`](Client::loan) does, but without a borrow of
    /// the client: for programs that keep both side by side, such as bindings for other languages.
    /// Pass it to [`send`](Client::send).
    ///
    /// Hold at most seven at once: with more, the client cannot inform the watcher of the end.
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if the curves were not described, or there is no memory.
    pub fn begin(&self, time: f64) -> Result<FrameMemory> {
        let frames = &self.frames;
        let Some(layout) = &frames.layout else {
            let what = "no curves are declared: call Client::describe before the first frame";
            return Err(Error::Bus(what.into()));
        };
        let (basis, precision) = (layout.basis, layout.precision);
        let has_radii = !layout.labels.radii.is_empty();
        let header = FrameHeader {
            time,
            names_bytes: layout.names_bytes,
            n_points: layout.points as u64,
            n_curves: layout.curves as u32,
            basis: basis.code(),
            coordinate_bytes: precision.bytes() as u32,
            ..frames.header(if has_radii { FLAG_RADII } else { 0 })
        };
        let table = layout.table.len();
        let bytes = table + 3 * layout.points * precision.bytes();
        let publishers = frames.publishers.as_ref().expect("`describe` created them");
        publishers.check()?;
        let mut sample = lend(&publishers.frames, bytes)?;
        *sample.user_header_mut() = header;
        let payload = sample.payload_mut();
        payload[..table].copy_from_slice(&layout.table);
        if cfg!(debug_assertions) {
            // All bits set is NaN in both precisions, so a missing coordinate is rejected.
            payload[table..].fill(0xff);
        }
        Ok(FrameMemory {
            sample: Owned::new(sample),
            _node: Owned::new(Arc::clone(&self.connection.endpoint.node)),
            table,
            precision,
            layout: frames.layouts,
        })
    }

    /// Publishes the memory of a frame. Returns its sequence number.
    ///
    /// # Errors
    ///
    /// [`Error::Bus`] if the memory belongs to another client, or if the curves were
    /// described again since.
    pub fn send(&mut self, frame: FrameMemory) -> Result<u64> {
        let FrameMemory { sample, layout, .. } = frame;
        let (frames, connection) = (&mut self.frames, &self.connection);
        let mut sample = sample.into_inner()?;
        let (publishers, baseline) = (frames.publishers.as_ref(), frames.baseline);
        let publishers = publishers.expect("`describe` created them");
        let header = sample.user_header_mut();
        if header.session != frames.session || layout != frames.layouts {
            let what = "the frame belongs to another client, or to an earlier description of the \
                        curves";
            return Err(Error::Bus(what.into()));
        }
        (header.seq, header.cuts) = (frames.next, frames.cuts);
        header.baseline = baseline.unwrap_or(frames.next);
        header.time_step = frames.time_step;
        header.set_cell(frames.cell.as_ref());
        connection.connect()?;
        if baseline.is_none() {
            sample = copy_of(&sample, &publishers.baselines)?;
            sample.user_header_mut().flags |= FLAG_BASELINE;
        }
        sample.send().map_err(bus("send"))?;
        publishers.connect();
        let seq = frames.next;
        frames.baseline.get_or_insert(seq);
        frames.next += 1;
        connection.endpoint.notify();
        Ok(seq)
    }
}

type FrameSample = SampleMut<Ipc, [u8], FrameHeader>;

/// Returns memory of a publisher for a frame of `bytes` bytes.
fn lend(publisher: &FramePublisher, bytes: usize) -> Result<FrameSample> {
    let sample = publisher.loan_slice_uninit(bytes).map_err(bus("loan"))?;
    #[expect(unsafe_code, reason = "shared memory is lent as uninitialised")]
    // SAFETY: the memory is a shared mapping. Each of its bytes was written by the system (zeros)
    // or by an earlier frame of this publisher, all of whose bytes were initialised; the compiler
    // can assume nothing else of memory that it did not allocate. Every bit pattern is a valid
    // `u8`.
    let mut sample = unsafe { sample.assume_init() };
    room::ensure(sample.payload_mut())?;
    Ok(sample)
}

/// Returns a copy of a frame in the memory of another publisher.
fn copy_of(sample: &FrameSample, publisher: &FramePublisher) -> Result<FrameSample> {
    let mut copy = lend(publisher, sample.payload().len())?;
    *copy.user_header_mut() = *sample.user_header();
    copy.payload_mut().copy_from_slice(sample.payload());
    Ok(copy)
}

/// Shared memory of a frame that is being written ([`Client::begin`](crate::Client::begin)).
/// Nothing is sent if it is dropped.
#[derive(Debug)]
pub struct FrameMemory {
    sample: Owned<FrameSample>,
    /// Dropped after the sample: a node cannot remove its folder before its last port is gone.
    _node: Owned<Arc<Node<Ipc>>>,
    /// Bytes before the positions.
    table: usize,
    precision: Precision,
    /// Number of the layout: see [`Frames::layouts`].
    layout: u32,
}

impl FrameMemory {
    /// Returns the number of coordinates: three per point.
    pub fn coordinates(&self) -> usize {
        (self.sample.payload().len() - self.table) / self.precision.bytes()
    }

    fn bytes_of(&mut self, precision: Precision) -> Result<&mut [u8]> {
        if precision != self.precision {
            return Err(Error::LayoutChanged {
                what: "bytes of a coordinate",
                before: self.precision.bytes() as u64,
                now: precision.bytes() as u64,
            });
        }
        Ok(&mut self.sample.payload_mut()[self.table..])
    }

    /// Returns the memory of the positions, `x y z x y z ..` curve after curve, 64-byte aligned.
    ///
    /// Write all of it: it initially holds zeros or an earlier frame (NaN in debug builds).
    ///
    /// # Errors
    ///
    /// [`Error::LayoutChanged`] if the curves were described in double precision.
    pub fn positions_f32(&mut self) -> Result<&mut [f32]> {
        // The service aligns to 64 bytes.
        Ok(bytemuck::cast_slice_mut(self.bytes_of(Precision::F32)?))
    }

    /// Returns the memory of the positions in double precision; see
    /// [`positions_f32`](FrameMemory::positions_f32).
    ///
    /// # Errors
    ///
    /// [`Error::LayoutChanged`] if the curves were described in single precision.
    pub fn positions_f64(&mut self) -> Result<&mut [f64]> {
        // The service aligns to 64 bytes.
        Ok(bytemuck::cast_slice_mut(self.bytes_of(Precision::F64)?))
    }
}

/// Returns a random number, never 0, from the random seed of hash maps.
pub(super) fn random() -> u64 {
    let mut hasher = RandomState::new().build_hasher();
    hasher.write_u32(std::process::id());
    hasher.finish().max(1)
}
