//! Frame in shared memory that the simulator is writing.

use super::client::Client;
use super::service::{Ipc, bus};
use super::wire::{FrameHeader, cast_mut};
use crate::curve::Precision;
use crate::error::{Error, Result};
use iceoryx2::sample_mut::SampleMut;
use std::fmt;

/// Shared memory of a frame that is being written. Nothing is sent if it is dropped without
/// [`publish`](FrameLoan::publish).
pub struct FrameLoan<'a> {
    pub(super) sample: SampleMut<Ipc, [u8], FrameHeader>,
    /// Bytes of the counts before the positions.
    pub(super) table: usize,
    pub(super) precision: Precision,
    pub(super) client: &'a mut Client,
}

impl fmt::Debug for FrameLoan<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FrameLoan")
            .field("header", self.sample.user_header())
            .finish_non_exhaustive()
    }
}

impl FrameLoan<'_> {
    /// Returns the number of coordinates: three per point.
    pub(super) fn coordinates(&self) -> usize {
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
    /// Errors: [`Error::LayoutChanged`] if the curves were described in double precision.
    pub fn positions_f32(&mut self) -> Result<&mut [f32]> {
        Ok(cast_mut(self.bytes_of(Precision::F32)?).expect("the service aligns to 64 bytes"))
    }

    /// Returns the memory of the positions in double precision; see
    /// [`positions_f32`](FrameLoan::positions_f32).
    pub fn positions_f64(&mut self) -> Result<&mut [f64]> {
        Ok(cast_mut(self.bytes_of(Precision::F64)?).expect("the service aligns to 64 bytes"))
    }

    /// Publishes the frame. Returns its sequence number.
    pub fn publish(self) -> Result<u64> {
        self.client.connect()?;
        self.sample.send().map_err(bus("send"))?;
        Ok(self.client.sent())
    }
}
