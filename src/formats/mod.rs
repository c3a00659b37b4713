//! Model files: of one frame (BCC, OBJ lines, Geomview VECT, LAMMPS data), and of many (LAMMPS
//! dumps, NumPy, extended XYZ).
//!
//! | extension | holds | precision kept |
//! |---|---|---|
//! | `.bcc` | uniform Catmull-Rom, cubic B-spline, cubic Bezier, polylines | single |
//! | `.obj` | polylines, as `l` statements | double |
//! | `.vect` | polylines | double |
//! | `.data`, `.lmp`, `.lammps`, `data.*` | polylines, as the bonds of LAMMPS | double |
//! | `.dump`, `.lammpstrj`, `dump.*` | frames of the curves of a data file | double |
//! | `.npy` | frames of polylines | single or double |
//! | `.npz` | frames of all bases, with times, names and radii | single or double |
//! | `.xyz`, `.extxyz` | frames of polylines, with times and cells | double |
//! | `.mcap` | polylines: `foxglove.SceneUpdate`, ROS 2 markers | double |
//! | `.txt`, `.csv`, `.dat`, `.raw` and others | frames of polylines, as columns `x y z` | double |
//!
//! LAMMPS files, extended XYZ and plain text of any other name are recognized by their content.
//!
//! Elements of a file that may be curves and are not read are counted:
//! [`FrameInfo::left_out`](crate::FrameInfo::left_out).
//!
//! A file is not trusted: every count is compared with the length of the file before anything is
//! allocated, so that memory is linear in that length for any counts. (A compressed array may take
//! 64 MiB, or 100 times its compressed size, for a frame.) A BCC file is streamed into its
//! [`CurveSet`], with less than 200 kB of other memory. The text formats also hold their vertices,
//! bonds or counts while they are read.

mod bcc;
mod chains;
#[cfg(feature = "mcap")]
pub(crate) mod container;
mod external;
mod format;
mod frames;
mod input;
mod lammps;
mod lines;
#[cfg(feature = "mcap")]
mod mcap;
mod numpy;
mod obj;
mod points;
mod torn;
mod vect;
mod write;
mod xyz;

pub use crate::error::MODEL_FILES;
pub use bcc::write_bcc;
pub use external::{ExternalFrames, ExternalReader};
#[cfg(feature = "cli")]
pub(crate) use external::{install, name_of, reader, unpacked, without_compression};
pub use format::Format;
pub use frames::{Frames, ModelFrame, ReadOptions};
pub use write::FrameWriter;

use self::input::{Input, open, open_file, open_text};
use self::lines::{is_in, number, quote};
use crate::curve::{Basis, CurveSet, Point, Positions, Precision};
use crate::error::{Error, Result};
use std::path::Path;

/// Reads the curves of a model file: those of the first frame, if it has several. The extension (in
/// upper or lower case) determines the format.
///
/// It must be a regular file, because the length of a pipe is unknown. Every error names `path`.
///
/// ```
/// use linkwatch::{Certifier, formats, scenes::Scene};
///
/// # let file = std::env::temp_dir().join(format!("linkwatch-doc-{}.bcc", std::process::id()));
/// let ring: Scene = "ribbon:segments=2000,lambda=10".parse()?;
/// formats::write_bcc(&file, &ring.build()?.curves)?;
///
/// let curves = formats::read(&file)?;
/// let mut certifier = Certifier::default();
/// let (certificate, _) = certifier.certify(&curves);
/// assert_eq!(certificate.links()[0].lambda, 10);
/// # std::fs::remove_file(file)?;
/// # Ok::<(), linkwatch::Error>(())
/// ```
///
/// # Errors
///
/// The errors of [`Frames::open`] and of the first frame; [`Error::Format`] for a file without
/// frames.
pub fn read(path: &Path) -> Result<CurveSet> {
    let mut frames = Frames::open(path, &ReadOptions::default())?;
    match frames.next() {
        Some(frame) => frame?.curves.map_err(|e| e.in_file(path)),
        None => Err(Error::unsupported("model", "a file without frames").in_file(path)),
    }
}

/// Returns the little-endian number in some bytes, at most eight.
fn little_endian(bytes: &[u8]) -> u64 {
    bytes.iter().rfold(0, |n, &b| (n << 8) | u64::from(b))
}

/// Calls `read` with the positions in some little-endian bytes.
pub(crate) fn with_positions<T>(
    precision: Precision,
    bytes: &[u8],
    read: impl FnOnce(Positions<'_>) -> T,
) -> T {
    fn values<T, const N: usize>(bytes: &[u8], parse: fn([u8; N]) -> T) -> Vec<T> {
        bytes.as_chunks().0.iter().map(|&b| parse(b)).collect()
    }
    match precision {
        Precision::F32 => read(Positions::F32(&values(bytes, f32::from_le_bytes))),
        Precision::F64 => read(Positions::F64(&values(bytes, f64::from_le_bytes))),
    }
}

/// Returns the curves of these points.
///
/// # Errors
///
/// There are not as many as the counts promise.
fn divided(format: &'static str, kind: &str, points: &[Point], counts: &[i32]) -> Result<CurveSet> {
    let sum: u64 = counts.iter().map(|c| u64::from(c.unsigned_abs())).sum();
    if sum != points.len() as u64 {
        let (all, n) = (points.len(), counts.len());
        let what = format!("{all} {kind} do not fit {n} curves with {sum} points");
        return Err(Error::format(format, kind, what));
    }
    let positions = Positions::F64(points.as_flattened());
    CurveSet::from_counts(Basis::Polyline, counts, positions)
}

#[cfg(test)]
mod round_trip_tests;
#[cfg(test)]
mod tests;
