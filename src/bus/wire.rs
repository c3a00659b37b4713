//! Layout of shared memory: two plain structs, and the bytes of a frame.
//!
//! iceoryx2 compares the name, size and alignment of a type, but not its fields. Therefore both
//! structs start with a magic number and a layout version, and have no implicit padding.
//!
//! Payload of a frame: `n_curves` counts (`i32`, negative if the curve is closed, as in BCC files),
//! the names of the curves (each followed by a zero byte), their radii (`f32`), and `3 * n_points`
//! coordinates. Each part but the last one is filled with zeros up to a multiple of 64 bytes. Names
//! and radii are optional. All numbers have the byte order of the machine.
//!
//! `docs/reference/bus.md` describes this layout for other languages; change both together.

use crate::curve::{Cell, CurveLabels, Precision};
use crate::error::{Error, Result};
use bytemuck::Zeroable;
use iceoryx2::prelude::ZeroCopySend;
use std::mem::size_of;

/// Version of the layout. Increment it with every change of either struct or of the payload.
pub(super) const LAYOUT_VERSION: u32 = 8;

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

/// The payload has the radii of the curves.
pub(super) const FLAG_RADII: u32 = 16;
/// This frame is a baseline. Its publisher keeps it for watchers that start later, so it must be
/// verified before newer frames.
pub(super) const FLAG_BASELINE: u32 = 32;

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
    /// Number of the frame whose linking numbers are expected: the first one of the session, or the
    /// last one that the simulator accepted as a new baseline. `seq` if it is this frame.
    pub baseline: u64,
    /// Simulation time in seconds.
    pub time: f64,
    pub n_points: u64,
    pub n_curves: u32,
    /// Code of the basis.
    pub basis: u32,
    /// 4 or 8.
    pub coordinate_bytes: u32,
    /// Number of cuts in the session before this frame, wrapping. If it differs from the number in
    /// the last verified frame, this frame does not continue that frame. It is a count, not a flag,
    /// because the frame after a cut may be skipped.
    pub cuts: u32,
    /// Number of times that the simulator described its curves before this one. The curves, their
    /// order, names and radii are the same in all frames with the same number.
    pub layout: u32,
    /// Number of bytes of the names; 0 if the curves have none.
    pub names_bytes: u32,
    /// Time step of the simulator in seconds; 0 if it is unknown.
    pub time_step: f64,
    /// Number of lattice vectors that are not zero; 0 if the scene is not periodic.
    pub cell_vectors: u32,
    /// Must be 0.
    pub reserved: u32,
    /// Corner of the periodic cell.
    pub cell_origin: [f64; 3],
    /// Lattice vectors, one after the other. Zeros stand for a vector without repetition.
    pub cell: [f64; 9],
}

/// [`VerdictWire::finding`]: the message has no finding.
pub(super) const FINDING_NONE: u32 = 0;
/// A change of a linking number.
pub(super) const FINDING_CHANGE: u32 = 1;
/// A pair or a curve without a number.
pub(super) const FINDING_DEFECT: u32 = 2;

/// A pull-through: `found` is its sign, `distance` the fraction of the step.
pub(super) const FINDING_EVENT: u32 = 3;

/// Value of [`VerdictWire::j`] that means "no second curve".
pub(super) const NO_CURVE: u32 = u32::MAX;

/// Value of [`VerdictWire::last_intact`] that means "no frame".
pub(super) const NO_FRAME: u64 = u64::MAX;

/// A message from the watcher.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend, Zeroable)]
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
    /// Number of curves that appeared, and of curves that disappeared, since the last verified
    /// frame.
    pub appeared: u32,
    pub gone: u32,
    /// Number of all findings of the frame.
    pub findings: u32,
    /// Number of violations in the session that the simulator rolled back.
    pub recovered: u32,
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
    /// Translation of the curve `j` of the finding, in lattice vectors.
    pub image: [i32; 3],
    /// Why a frame was rejected or pairs were not verified, which curves appeared and are gone, or
    /// why the watcher left: UTF-8, cut at a character.
    pub reason: [u8; 180],
}

// The sizes are the sums of the fields, so there is no implicit padding.
const _: () = assert!(size_of::<FrameHeader>() == 192);
const _: () = assert!(size_of::<VerdictWire>() == 424);

impl FrameHeader {
    /// Returns an error unless the magic number and the layout version are those of this build, and
    /// the message belongs to a session. Other fields must not be read before this check.
    pub fn check_layout(&self) -> Result<()> {
        if self.magic != FRAME_MAGIC {
            let what = format!("{:#018x}, expected {FRAME_MAGIC:#018x}", self.magic);
            return Err(Error::format("frame", "magic number", what));
        }
        check_version("the frame", self.version)?;
        // In a message of the watcher, 0 stands for no session.
        if self.session == 0 {
            let what = "0, expected a random number";
            return Err(Error::format("frame", "session", what));
        }
        Ok(())
    }

    /// Writes the periodic cell.
    pub fn set_cell(&mut self, cell: Option<&Cell>) {
        let vectors = cell.map_or_else(Default::default, |cell| cell.vectors);
        self.cell_vectors = not_zero(&vectors);
        self.cell.copy_from_slice(vectors.as_flattened());
        self.cell_origin = cell.map_or_else(Default::default, |cell| cell.origin);
    }

    /// Returns the periodic cell, if there is one. Fails if it is not a lattice, or if the number
    /// of its vectors differs from that in the header, because the scene might then be
    /// misinterpreted.
    pub fn cell(&self) -> Result<Option<Cell>> {
        let field = |what| Error::format("frame", "periodic cell", what);
        let (vectors, _) = self.cell.as_chunks::<3>();
        let (origin, vectors) = (self.cell_origin, [vectors[0], vectors[1], vectors[2]]);
        let cell = Cell { origin, vectors };
        let found = not_zero(&cell.vectors);
        if self.cell_vectors != found {
            let what = format!("{} vectors, but {found} are not zero", self.cell_vectors);
            return Err(field(what));
        }
        if self.cell_vectors == 0 && self.cell_origin == [0.0; 3] {
            return Ok(None);
        }
        // Says "no vector" if there is a corner only.
        cell.check().map_err(|why| field(why.to_string()))?;
        Ok(Some(cell))
    }

    /// Returns the sizes of the parts before the positions: counts, names and radii, in bytes,
    /// padding included.
    pub fn table(&self) -> [u64; 3] {
        let padded = |bytes: u64| bytes.next_multiple_of(ALIGNMENT as u64);
        let counts = padded(u64::from(self.n_curves) * size_of::<i32>() as u64);
        let has_radii = self.flags & FLAG_RADII != 0;
        // A radius has as many bytes as a count.
        let radii = if has_radii { counts } else { 0 };
        [counts, padded(self.names_bytes.into()), radii]
    }

    /// Returns the number of bytes of the payload. Saturates.
    pub fn payload_bytes(&self, precision: Precision) -> u64 {
        let positions = self.n_points.saturating_mul(3 * precision.bytes() as u64);
        self.table()
            .into_iter()
            .fold(positions, u64::saturating_add)
    }

    /// Decodes the names and radii in a copy of the parts before the positions
    /// ([`FrameHeader::view`]).
    pub fn labels(&self, table: &[u8]) -> Result<CurveLabels> {
        let [counts, padded, radii] = self.table().map(|bytes| bytes as usize);
        let (curves, bytes) = (self.n_curves as usize, self.names_bytes as usize);
        let names = &table[counts..][..bytes];
        let field = |what: &str| Err(Error::format("frame", "names of the curves", what));
        let names = match names.strip_suffix(&[0]) {
            None if names.is_empty() => Vec::new(),
            None => return field("the last name does not end with a zero byte"),
            Some(names) => {
                // Counted first: thousands of empty names take 24 times their bytes.
                let found = 1 + names.iter().filter(|&&byte| byte == 0).count();
                if found != curves {
                    return Err(Error::count("names of curves", curves, found));
                }
                match std::str::from_utf8(names) {
                    Ok(names) => names.split('\0').map(str::to_owned).collect(),
                    Err(_) => return field("not UTF-8"),
                }
            }
        };
        let radii = &table[counts + padded..][..radii];
        let radii = radii.as_chunks().0.iter().take(curves);
        let radii = radii.map(|bytes| f32::from_ne_bytes(*bytes));
        let labels = CurveLabels::named(names).with_radii(radii);
        labels.check(curves)?;
        Ok(labels)
    }
}

/// Fails unless the layout version of a message is that of this build.
pub(super) fn check_version(what: &'static str, found: u32) -> Result<()> {
    if found == LAYOUT_VERSION {
        return Ok(());
    }
    Err(Error::Version {
        what,
        found: found.into(),
        known: LAYOUT_VERSION.into(),
    })
}

/// Returns the number of vectors that are not zero.
fn not_zero(vectors: &[[f64; 3]; 3]) -> u32 {
    vectors.iter().map(|v| u32::from(*v != [0.0; 3])).sum()
}

/// Returns the parts before the positions of a payload, and the number of bytes of the names.
pub(super) fn table_of(counts: &[i32], labels: &CurveLabels) -> (Vec<u8>, usize) {
    let pad = |table: &mut Vec<u8>| table.resize(table.len().next_multiple_of(ALIGNMENT), 0);
    let mut table: Vec<u8> = bytemuck::cast_slice(counts).to_vec();
    pad(&mut table);
    let start = table.len();
    for name in &labels.names {
        table.extend(name.as_bytes());
        table.push(0);
    }
    let names = table.len() - start;
    pad(&mut table);
    table.extend(bytemuck::cast_slice::<f32, u8>(&labels.radii));
    pad(&mut table);
    (table, names)
}
