//! Curves of a frame in as little memory as their positions need.
//!
//! A [`CurveSet`] is larger: it also has its coordinates by axis, with padding, and it would keep a
//! frame of the engine's pool busy.

use super::super::reader::RecordedFrame;
use crate::curve::{Basis, CurveSet, Precision};
use crate::error::Result;
use crate::sinks::FrameRecord;
use prost::bytes::Bytes;
use std::sync::Arc;

/// Curves of a frame: the bits that were verified.
pub(super) struct Packed {
    basis: Basis,
    precision: Precision,
    /// Shared by frames of the same curves.
    counts: Arc<Vec<i32>>,
    positions: Vec<u8>,
}

impl Packed {
    /// Memory of the positions, in bytes.
    pub fn bytes(&self) -> u64 {
        self.positions.capacity() as u64
    }
}

/// Packs curves and unpacks them, and reuses buffers for that.
#[derive(Default)]
pub(super) struct Packer {
    counts: Arc<Vec<i32>>,
    /// Positions of a discarded frame.
    spare: Vec<u8>,
    /// The last unpacked curves.
    unpacked: Option<(Arc<Vec<i32>>, Precision, CurveSet)>,
}

impl Packer {
    pub fn pack(&mut self, set: &CurveSet) -> Packed {
        if !set.counts().eq(self.counts.iter().copied()) {
            self.counts = Arc::new(set.counts().collect());
        }
        let mut positions = std::mem::take(&mut self.spare);
        positions.clear();
        positions.reserve_exact(3 * set.points() * set.precision().bytes());
        set.write_positions(&mut positions);
        Packed {
            basis: set.basis(),
            precision: set.precision(),
            counts: Arc::clone(&self.counts),
            positions,
        }
    }

    /// Keeps the buffer of a frame for the next one.
    pub fn discard(&mut self, packed: Packed) {
        self.spare = packed.positions;
    }

    /// Calls `use_it` with a record and its curves.
    pub fn with_curves<T>(
        &mut self,
        record: FrameRecord,
        packed: Packed,
        use_it: impl FnOnce(&FrameRecord) -> Result<T>,
    ) -> Result<T> {
        let frame = RecordedFrame {
            seq: record.report.seq,
            time: record.report.time,
            basis: packed.basis,
            precision: packed.precision,
            counts: packed.counts.to_vec(),
            info: record.info.clone(),
            // The time is in the record.
            received_ns: 0,
            positions: Bytes::from(packed.positions),
        };
        let (counts, precision) = (packed.counts, packed.precision);
        let same = |(c, p, _): &(Arc<Vec<i32>>, Precision, CurveSet)| {
            Arc::ptr_eq(c, &counts) && *p == precision
        };
        let mut set = self.unpacked.take().filter(same).map(|(_, _, set)| set);
        frame.ingest(&mut set)?;
        self.spare = frame.into_positions();
        let mut record = record;
        record.curves = set.map(Arc::new);
        let used = use_it(&record)?;
        let set = record.curves.and_then(Arc::into_inner);
        self.unpacked = set.map(|set| (counts, precision, set));
        Ok(used)
    }
}
