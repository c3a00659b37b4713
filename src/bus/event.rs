//! What the watcher learns from the bus: frames, and the coming and going of simulators.

use super::message::Counters;
use super::service::Ipc;
use super::wire::{FLAG_LOCKSTEP, FrameHeader};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::ingest::ingest;
use iceoryx2::sample::Sample;
use std::fmt;

/// What happened on the bus.
#[derive(Debug)]
pub enum Event {
    /// A simulator came. Its first frame follows, perhaps with other curves than before.
    NewSession {
        /// Its session.
        session: u64,
    },
    /// The newest frame. Older ones that were not taken in time are counted as skipped.
    Frame(Frame),
    /// Something that is no frame, or of another version. It has no sequence number to answer to.
    Unreadable(Error),
    /// The session is over, and all its frames are accounted for.
    End {
        /// Its session.
        session: u64,
        /// Frames that the simulator published; equals the sum of the counters. Frames that were
        /// rejected because of their sequence numbers are counted in addition.
        published: u64,
        /// What became of them.
        counters: Counters,
        /// False where the simulator left without finishing: an error or a panic.
        clean: bool,
    },
    /// The simulator died without a word, or another one took its place. Frames that it published last may
    /// be lost and are not in the counters.
    SimulatorLost {
        /// Its session.
        session: u64,
        /// What became of the frames that are known.
        counters: Counters,
    },
    /// Nothing happened for the time given, or a signal came.
    Idle,
}

/// A frame in shared memory. It blocks one of four places until it is dropped.
pub struct Frame {
    pub(super) sample: Sample<Ipc, [u8], FrameHeader>,
    /// Copied once: in shared memory it could change under its reader.
    pub(super) header: FrameHeader,
    pub(super) max_bytes: usize,
    /// Error of the sequence number, if it is impossible.
    pub(super) fault: Option<String>,
}

impl fmt::Debug for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Frame")
            .field("header", &self.header)
            .finish_non_exhaustive()
    }
}

impl Frame {
    /// Returns the sequence number, which starts at 0 in each session. [`Frame::ingest`] rejects an
    /// impossible one.
    pub fn seq(&self) -> u64 {
        self.header.seq
    }

    /// Simulation time in seconds, as the header has it.
    pub fn time(&self) -> f64 {
        self.header.time
    }

    /// Session of the simulator.
    pub fn session(&self) -> u64 {
        self.header.session
    }

    /// Returns the number of cuts that the simulator made in its session before this frame
    /// ([`Client::cut`](crate::Client::cut)).
    ///
    /// If it differs from the number of the last verified frame, this frame does not continue that
    /// one: call [`Verifier::cut`](crate::Verifier::cut) before verifying this one.
    pub fn cuts(&self) -> u32 {
        self.header.cuts
    }

    /// Whether the simulator waits for the verdict.
    pub fn lockstep(&self) -> bool {
        self.header.flags & FLAG_LOCKSTEP != 0
    }

    /// Checks the frame and moves its positions from shared memory into `set`: built from the first frame,
    /// updated by every later one. Every value is read once.
    ///
    /// A frame that breaks its contract is an error, to be answered with [`Verdict::Rejected`](crate::Verdict::Rejected); the next
    /// good frame makes an existing set whole again.
    pub fn ingest(&self, set: &mut Option<CurveSet>) -> Result<()> {
        if let Some(fault) = &self.fault {
            return Err(Error::format("frame", "sequence number", fault));
        }
        let frame = self.header.view(self.sample.payload(), self.max_bytes)?;
        ingest(frame, set)
    }
}
