//! Events that the watcher receives from the bus: frames, and simulators that start and end.

use super::ipc::Ipc;
use super::message::Counters;
use super::wire::{FLAG_LOCKSTEP, FLAG_RADII, FrameHeader};
use crate::curve::{Basis, CurveLabels, CurveSet, Positions, Precision};
use crate::error::{Error, Result};
use crate::ingest::{FrameInfo, RawFrame, ingest};
use bytemuck::try_cast_slice;
use iceoryx2::sample::Sample;
use std::sync::Arc;

/// Event on the bus.
#[expect(
    clippy::large_enum_variant,
    reason = "a box would be an allocation per frame"
)]
#[derive(Debug)]
pub enum Event {
    /// A simulator connected. Its first frame follows, possibly with other curves than before.
    NewSession {
        /// Session of the simulator.
        session: u64,
    },
    /// The newest frame. Older frames that were not read in time are counted as skipped.
    Frame(Frame),
    /// A message that is not a frame, or is of another version. It has no sequence number, so it
    /// cannot be answered.
    Unreadable(Error),
    /// The session has ended, and all its frames are counted.
    End {
        /// Session of the simulator.
        session: u64,
        /// Number of frames that the simulator published; equals the sum of the counters. Frames
        /// that were rejected because of their sequence numbers are counted in addition.
        published: u64,
        /// Counters of the session.
        counters: Counters,
        /// False if the simulator left without finishing, by an error or a panic.
        clean: bool,
    },
    /// The simulator died without ending the session, or another one took its place. The last
    /// frames that it published may be lost; the counters do not include those.
    SimulatorLost {
        /// Session of the simulator.
        session: u64,
        /// Counters of the known frames.
        counters: Counters,
    },
    /// Nothing happened within the time limit, or a signal arrived.
    Idle,
}

/// Frame in shared memory. It occupies one of four slots until it is dropped.
#[derive(Debug)]
pub struct Frame {
    pub(super) sample: Sample<Ipc, [u8], FrameHeader>,
    /// Copy of the header, because the one in shared memory could change while it is read.
    pub(super) header: FrameHeader,
    pub(super) max_bytes: usize,
    /// Error text if the sequence number is impossible.
    pub(super) fault: Option<String>,
    /// True if the watcher came after the frames between this one and its baseline, which is the
    /// last frame that was returned.
    pub(super) after_gap: bool,
}

impl Frame {
    /// Returns the sequence number, which starts at 0 in each session. [`Frame::ingest`] rejects an
    /// impossible one.
    pub fn seq(&self) -> u64 {
        self.header.seq
    }

    /// Returns the simulation time in seconds, from the header.
    pub fn time(&self) -> f64 {
        self.header.time
    }

    /// Returns the session of the simulator.
    pub fn session(&self) -> u64 {
        self.header.session
    }

    /// Returns the number of cuts that the simulator made in its session before this frame
    /// ([`Client::cut`](crate::Client::cut)).
    ///
    /// If it differs from the number of the last verified frame, this frame does not continue that
    /// one ([`FrameInfo::cuts`]).
    pub fn cuts(&self) -> u32 {
        self.header.cuts
    }

    /// Returns true if the watcher came when the frames before this one had been published already.
    /// It got the baseline, and does not know the motion from there to this frame.
    pub fn after_gap(&self) -> bool {
        self.after_gap
    }

    /// Returns true if the simulator waits for the verdict.
    pub fn lockstep(&self) -> bool {
        self.header.flags & FLAG_LOCKSTEP != 0
    }

    /// Checks what the simulator tells about the frame, and returns it. `last` has the names and
    /// radii of the last frame, which are returned again if they are the same.
    ///
    /// # Errors
    ///
    /// The frame breaks its contract, as in [`Frame::ingest`].
    pub fn info(&self, last: &mut LastLabels) -> Result<FrameInfo> {
        let (table, _) = self.view()?;
        // Zeros after a part may also belong to the part, so equal bytes alone are not enough.
        let header = &self.header;
        let radii = header.flags & FLAG_RADII;
        let sizes = [header.n_curves, header.names_bytes, radii];
        if sizes != last.sizes || table != last.table {
            // Decoded from a copy, because the bytes in shared memory could change meanwhile.
            let table = table.to_vec();
            last.labels = Arc::new(header.labels(&table)?);
            (last.sizes, last.table) = (sizes, table);
        }
        Ok(FrameInfo {
            cuts: header.cuts,
            baseline: header.baseline,
            layout: header.layout,
            time_step: header.time_step,
            cell: header.cell()?,
            labels: Arc::clone(&last.labels),
            ..FrameInfo::at(header.seq, header.time)
        })
    }

    /// Checks the frame and copies its positions from shared memory into `set`, which the first
    /// frame creates and every later one updates. Every value is read once.
    ///
    /// [`Frame::read`] with [`Session::receive`](crate::Session::receive) does the same, and
    /// saves time if the frame is then verified.
    ///
    /// # Errors
    ///
    /// The frame breaks its contract. Answer it with
    /// [`Verdict::Rejected`](crate::Verdict::Rejected). The next valid frame makes an existing set
    /// valid again.
    pub fn ingest(&self, set: &mut Option<CurveSet>) -> Result<()> {
        self.read(|frame| ingest(frame, set, CurveSet::update))
    }

    /// Calls `receive` with the frame in shared memory, unless its header breaks the contract.
    /// # Errors
    ///
    /// The errors of [`Frame::ingest`].
    pub fn read(&self, receive: impl FnOnce(RawFrame<'_>) -> Result<()>) -> Result<()> {
        let (_, frame) = self.view()?;
        receive(frame)
    }

    /// Returns the parts of the payload ([`FrameHeader::view`]).
    fn view(&self) -> Result<(&[u8], RawFrame<'_>)> {
        match &self.fault {
            Some(fault) => Err(Error::format("frame", "sequence number", fault)),
            None => self.header.view(self.sample.payload(), self.max_bytes),
        }
    }
}

impl FrameHeader {
    /// Returns the bytes of the payload before the positions, which are the same in all frames of a
    /// layout, and the frame; an error if the payload is not as this header says. `self` must be a
    /// copy, because the header in shared memory may change at any time.
    pub fn view<'a>(
        &self,
        payload: &'a [u8],
        max_bytes: usize,
    ) -> Result<(&'a [u8], RawFrame<'a>)> {
        let field = |place, what: String| Err(Error::format("frame", place, what));
        if payload.len() > max_bytes {
            let what = "bytes of a frame (more than the limit)";
            return Err(Error::count(what, payload.len(), max_bytes));
        }
        if !self.time.is_finite() {
            return field("time", format!("{} seconds", self.time));
        }
        if !(self.time_step >= 0.0 && self.time_step.is_finite()) {
            return field("time step", format!("{} seconds", self.time_step));
        }
        self.cell()?;
        let Some(&basis) = Basis::ALL.get(self.basis as usize) else {
            let last = Basis::ALL.len() - 1;
            return field(
                "basis code",
                format!("{}, expected 0 to {last}", self.basis),
            );
        };
        let precision = match self.coordinate_bytes {
            4 => Precision::F32,
            8 => Precision::F64,
            n => return field("bytes of a coordinate", format!("{n}, expected 4 or 8")),
        };
        let curves = self.n_curves as usize;
        let bytes = self.payload_bytes(precision);
        if bytes != payload.len() as u64 {
            return Err(Error::count("bytes of a frame", bytes, payload.len()));
        }
        let table: u64 = self.table().iter().sum();
        let (table, positions) = payload.split_at(table as usize);
        let Ok(counts) = try_cast_slice(&table[..curves * size_of::<i32>()]) else {
            return field("payload", "not aligned".into());
        };
        let positions = match precision {
            Precision::F32 => try_cast_slice(positions).map(Positions::F32),
            Precision::F64 => try_cast_slice(positions).map(Positions::F64),
        };
        let Ok(positions) = positions else {
            return field("positions", "not aligned".into());
        };
        let frame = RawFrame {
            basis,
            counts,
            positions,
        };
        Ok((table, frame))
    }
}

/// Names and radii of the curves of the last frame; see [`Frame::info`].
#[derive(Clone, Debug, Default)]
pub struct LastLabels {
    /// Number of curves, bytes of the names, and the flag of the radii.
    sizes: [u32; 3],
    /// The parts of the payload before the positions.
    table: Vec<u8>,
    labels: Arc<CurveLabels>,
}
