//! Layout of shared memory: two plain structs, and the bytes of a frame.
//!
//! iceoryx2 compares the name, size and alignment of a type, but not its fields. Therefore both
//! structs start with a magic number and a layout version, and have no implicit padding.
//!
//! Payload of a frame: `n_curves` counts (`i32`, negative if the curve is closed, as in BCC files),
//! zeros up to a multiple of 64 bytes, then `3 * n_points` coordinates. All numbers have the byte
//! order of the machine.
//!
//! `docs/wire.md` describes this layout for other languages; change both together.

use crate::curve::Precision;
#[cfg(feature = "bus")]
use crate::curve::{Basis, Positions};
use crate::error::{Error, Result};
#[cfg(feature = "bus")]
use crate::ingest::RawFrame;
use iceoryx2::prelude::ZeroCopySend;
use std::mem::size_of;

/// Version of the layout. Increment it with every change of either struct or of the payload.
pub(super) const LAYOUT_VERSION: u32 = 5;

/// Alignment of the payload and of the positions in it: a cache line, and the widest vector load.
pub(super) const ALIGNMENT: usize = 64;

/// "LWFRAME" at the start of a frame header. A machine of the other byte order reads it reversed,
/// and rejects it.
pub(super) const FRAME_MAGIC: u64 = u64::from_le_bytes(*b"LWFRAME\0");

/// "LWVERDI" at the start of a verdict.
pub(super) const VERDICT_MAGIC: u64 = u64::from_le_bytes(*b"LWVERDI\0");

/// The simulator waits for the verdict on this frame.
pub(super) const FLAG_LOCKSTEP: u32 = 1;
/// Not a frame: the session has ended, and `seq` is the number of published frames.
pub(super) const FLAG_END: u32 = 2;
/// Not a frame: the simulator asks which watcher is present.
pub(super) const FLAG_ANNOUNCE: u32 = 4;
/// With `FLAG_END`: the simulator ended without finishing (an error or a panic).
pub(super) const FLAG_UNFINISHED: u32 = 8;

/// Header of every frame. Each frame describes itself, so a watcher that joins late needs no
/// earlier one.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[type_name("linkwatch.FrameHeader")]
pub(super) struct FrameHeader {
    pub magic: u64,
    pub version: u32,
    pub flags: u32,
    /// Random number drawn when a client opens, never 0.
    pub session: u64,
    /// Number of the frame in its session, from 0.
    pub seq: u64,
    /// Simulation time in seconds.
    pub time: f64,
    pub n_points: u64,
    pub n_curves: u32,
    /// Code of the basis.
    pub basis: u32,
    /// 4 or 8.
    pub coordinate_bytes: u32,
    /// Number of cuts in the session before this frame, wrapping. If it differs from that of the
    /// last verified frame, this frame does not continue that one. It is a count, not a flag,
    /// because the frame after a cut may be skipped.
    pub cuts: u32,
}

/// [`VerdictWire::finding`]: the message has no finding.
pub(super) const FINDING_NONE: u32 = 0;
/// A change of a linking number.
pub(super) const FINDING_CHANGE: u32 = 1;
/// A pair or a curve without a number.
pub(super) const FINDING_DEFECT: u32 = 2;

/// A pull-through: `found` is its sign, `distance` the fraction of the step.
pub(super) const FINDING_EVENT: u32 = 3;

/// Stands for "no second curve" in [`VerdictWire::j`].
pub(super) const NO_CURVE: u32 = u32::MAX;

/// Stands for "no frame" in [`VerdictWire::last_intact`].
pub(super) const NO_FRAME: u64 = u64::MAX;

/// A message from the watcher.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[type_name("linkwatch.Verdict")]
pub(super) struct VerdictWire {
    pub magic: u64,
    pub version: u32,
    /// Code of the kind of message.
    pub kind: u32,
    /// Session of the message; 0 if there is none.
    pub session: u64,
    pub seq: u64,
    pub time: f64,
    pub verdict: u32,
    pub abort: u32,
    pub lost: u32,
    pub gained: u32,
    pub changed: u32,
    pub defects: u32,
    pub events: u32,
    pub finding: u32,
    pub i: u32,
    pub j: u32,
    pub defect_kind: u32,
    pub segments: [u32; 2],
    pub has_place: u32,
    /// Bytes used of `reason`.
    pub reason_len: u32,
    pub unresolved: u32,
    pub expected: i64,
    pub found: i64,
    pub point: [f64; 3],
    pub distance: f64,
    /// Relative motion of a pull-through, in segment lengths.
    pub lengths: f64,
    /// Extent of the scene.
    pub extent: f64,
    pub verified: u64,
    pub skipped: u64,
    pub rejected: u64,
    pub check_ns: u64,
    /// All bits set if there is none.
    pub last_intact: u64,
    /// NaN if it is unknown.
    pub safe_fraction: f64,
    /// Why a frame was rejected: UTF-8, cut at a character.
    pub reason: [u8; 192],
}

// The sizes are the sums of the fields, so there is no implicit padding.
const _: () = assert!(size_of::<FrameHeader>() == 64);
const _: () = assert!(size_of::<VerdictWire>() == 408);

/// Returns the number of bytes of the counts of `curves` curves, padding included.
pub(super) fn table_bytes(curves: usize) -> Option<usize> {
    curves
        .checked_mul(size_of::<i32>())?
        .checked_next_multiple_of(ALIGNMENT)
}

/// Returns the number of bytes of a whole payload.
pub(super) fn payload_bytes(curves: usize, points: usize, precision: Precision) -> Option<usize> {
    let positions = points.checked_mul(3 * precision.bytes())?;
    table_bytes(curves)?.checked_add(positions)
}

impl FrameHeader {
    /// Fails unless the magic number and the layout version are those of this build. Until this
    /// check, no other field has a meaning.
    pub fn check_layout(&self) -> Result<()> {
        if self.magic != FRAME_MAGIC {
            return Err(Error::format(
                "frame",
                "magic number",
                format_args!("{:#018x}, expected {FRAME_MAGIC:#018x}", self.magic),
            ));
        }
        if self.version != LAYOUT_VERSION {
            return Err(Error::Version {
                what: "the frame",
                found: self.version.into(),
                known: LAYOUT_VERSION.into(),
            });
        }
        Ok(())
    }

    /// Returns the parts of the payload that this header describes, or an error if they do not fit.
    /// `self` must be a copy, because the header in shared memory may change at any time.
    #[cfg(feature = "bus")]
    pub fn view<'a>(&self, payload: &'a [u8], max_bytes: usize) -> Result<RawFrame<'a>> {
        let field = |place, what: std::fmt::Arguments<'_>| Err(Error::format("frame", place, what));
        if payload.len() > max_bytes {
            return Err(Error::Count {
                what: "bytes of a frame (more than the limit)",
                promised: payload.len() as u64,
                available: max_bytes as u64,
            });
        }
        if !self.time.is_finite() {
            return field("time", format_args!("{} seconds", self.time));
        }
        let Some(&basis) = Basis::ALL.get(self.basis as usize) else {
            let last = Basis::ALL.len() - 1;
            return field(
                "basis code",
                format_args!("{}, expected 0 to {last}", self.basis),
            );
        };
        let precision = match self.coordinate_bytes {
            4 => Precision::F32,
            8 => Precision::F64,
            n => {
                return field(
                    "bytes of a coordinate",
                    format_args!("{n}, expected 4 or 8"),
                );
            }
        };
        let curves = self.n_curves as usize;
        let promised = usize::try_from(self.n_points)
            .ok()
            .and_then(|points| payload_bytes(curves, points, precision));
        let (Some(bytes), Some(table)) = (promised, table_bytes(curves)) else {
            return field(
                "points",
                format_args!("{} do not fit into memory", self.n_points),
            );
        };
        if bytes != payload.len() {
            return Err(Error::Count {
                what: "bytes of a frame",
                promised: bytes as u64,
                available: payload.len() as u64,
            });
        }
        let (table, positions) = payload.split_at(table);
        let Some(counts) = cast(&table[..curves * size_of::<i32>()]) else {
            return field("payload", format_args!("not aligned"));
        };
        let positions = match precision {
            Precision::F32 => cast(positions).map(Positions::F32),
            Precision::F64 => cast(positions).map(Positions::F64),
        };
        let Some(positions) = positions else {
            return field("positions", format_args!("not aligned"));
        };
        Ok(RawFrame {
            basis,
            counts,
            positions,
        })
    }
}

/// Number types for which every bit pattern is valid.
pub(super) trait Plain: Copy {}
impl Plain for i32 {}
impl Plain for f32 {}
impl Plain for f64 {}

/// Returns bytes as numbers, or `None` if they are unaligned or not a whole number of them.
pub(super) fn cast<T: Plain>(bytes: &[u8]) -> Option<&[T]> {
    #[expect(unsafe_code, reason = "numbers in shared memory")]
    // SAFETY: every bit pattern is a `T`; `align_to` keeps to the aligned middle.
    let (head, body, tail) = unsafe { bytes.align_to() };
    (head.is_empty() && tail.is_empty()).then_some(body)
}

/// Returns bytes as numbers to write.
pub(super) fn cast_mut<T: Plain>(bytes: &mut [u8]) -> Option<&mut [T]> {
    #[expect(unsafe_code, reason = "numbers in shared memory")]
    // SAFETY: every bit pattern is a `T`, and every `T` is initialised bytes without padding.
    let (head, body, tail) = unsafe { bytes.align_to_mut() };
    (head.is_empty() && tail.is_empty()).then_some(body)
}

#[cfg(all(test, feature = "bus"))]
mod tests {
    use super::*;

    #[repr(align(64))]
    struct Aligned([u8; 256]);

    fn header(curves: u32, points: u64) -> FrameHeader {
        FrameHeader {
            magic: FRAME_MAGIC,
            version: LAYOUT_VERSION,
            flags: 0,
            session: 1,
            seq: 0,
            time: 0.0,
            n_points: points,
            n_curves: curves,
            basis: 0,
            coordinate_bytes: 4,
            cuts: 0,
        }
    }

    #[test]
    fn splits_a_frame_that_fits() {
        let bytes = Aligned([0; 256]);
        let frame = header(1, 4).view(&bytes.0[..112], 256).unwrap();
        assert_eq!((frame.counts.len(), frame.positions.len()), (1, 12));
    }

    #[test]
    fn rejects_wrong_lengths_before_reading_the_payload() {
        let bytes = Aligned([0; 256]);
        let fails = |h: FrameHeader| h.view(&bytes.0[..112], 256).unwrap_err().to_string();
        assert_eq!(
            fails(header(1, 5)),
            "bytes of a frame: 124 promised, 112 available"
        );
        assert_eq!(
            fails(header(17, 4)),
            "bytes of a frame: 176 promised, 112 available"
        );
        for points in [u64::MAX, u64::MAX / 12, u64::MAX / 12 + 1] {
            fails(header(1, points));
        }
        fails(header(u32::MAX, 4));
        let e = header(1, 4).view(&bytes.0[..112], 100).unwrap_err();
        assert_eq!(
            e.to_string(),
            "bytes of a frame (more than the limit): 112 promised, 100 available"
        );
        let shifted = header(1, 4).view(&bytes.0[1..113], 256);
        assert!(shifted.unwrap_err().to_string().contains("not aligned"));
    }

    #[test]
    fn rejects_codes_out_of_range_by_name() {
        let bytes = Aligned([0; 256]);
        let fails = |h: FrameHeader| h.view(&bytes.0[..112], 256).unwrap_err().to_string();
        let with = |change: fn(&mut FrameHeader)| {
            let mut h = header(1, 4);
            change(&mut h);
            h
        };
        assert_eq!(
            fails(with(|h| h.basis = 4)),
            "not a valid frame (basis code): 4, expected 0 to 3"
        );
        assert_eq!(
            fails(with(|h| h.coordinate_bytes = 2)),
            "not a valid frame (bytes of a coordinate): 2, expected 4 or 8"
        );
        assert_eq!(
            fails(with(|h| h.time = f64::NAN)),
            "not a valid frame (time): NaN seconds"
        );
        let e = with(|h| h.version = 9).check_layout().unwrap_err();
        assert_eq!(
            e.to_string(),
            "the frame has version 9; this build reads version 5"
        );
        assert!(with(|h| h.magic = 0).check_layout().is_err());
    }
}
