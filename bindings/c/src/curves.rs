//! Curves of a frame, as the caller describes them.

use crate::error::string;
use linkwatch::{Basis, Cell, CurveLabels, Positions, Precision, RawFrame};
use std::ffi::{c_char, c_void};
use std::{ptr, slice};

/// Polyline through its points.
pub const LW_POLYLINE: u32 = 0;
/// Uniform Catmull-Rom spline.
pub const LW_CATMULL_ROM: u32 = 1;
/// Uniform cubic B-spline.
pub const LW_B_SPLINE: u32 = 2;
/// Cubic Bezier segments that share their ends.
pub const LW_BEZIER: u32 = 3;

/// Positions are `float`.
pub const LW_FLOAT: u32 = 4;
/// Positions are `double`.
pub const LW_DOUBLE: u32 = 8;

/// The curves of a frame, in memory of the caller.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lw_frame {
    /// LW_POLYLINE, LW_CATMULL_ROM, LW_B_SPLINE or LW_BEZIER.
    pub basis: u32,
    /// LW_FLOAT or LW_DOUBLE: the bytes of a coordinate.
    pub precision: u32,
    /// Number of curves.
    pub curves: usize,
    /// Number of control points of each curve, negative if the curve is closed.
    pub counts: *const i32,
    /// Coordinates of all control points, `x y z x y z ..` curve after curve, aligned for their
    /// type.
    pub positions: *const c_void,
}

/// Returns the periodic cell of the caller; `None` if `vectors` is null.
///
/// # Safety
///
/// `vectors` is null, or points to nine numbers; `corner` is null, or points to three.
pub(crate) unsafe fn cell(vectors: *const f64, corner: *const f64) -> Result<Option<Cell>, String> {
    if vectors.is_null() {
        return Ok(None);
    }
    // SAFETY: as promised by the caller.
    let (points, _) = unsafe { values(vectors, 9, "vectors") }?.as_chunks::<3>();
    let origin = match corner.is_null() {
        true => [0.0; 3],
        // SAFETY: as promised by the caller.
        false => unsafe { values(corner, 3, "corner") }?.as_chunks::<3>().0[0],
    };
    Ok(Some(Cell {
        origin,
        vectors: [points[0], points[1], points[2]],
    }))
}

/// Returns the periodic cell of the caller, whose corner does not matter.
///
/// # Safety
///
/// `vectors` is null, or points to nine numbers.
pub(crate) unsafe fn given_cell(vectors: *const f64) -> Result<Option<Cell>, String> {
    // SAFETY: as promised by the caller.
    unsafe { cell(vectors, ptr::null()) }
}

/// Returns the names and the radii of the caller; either pointer may be null.
///
/// # Safety
///
/// `names` is null, or points to `curves` strings that end with a zero byte. `radii` is null, or
/// points to `curves` numbers.
pub(crate) unsafe fn labels(
    names: *const *const c_char,
    radii: *const f32,
    curves: usize,
) -> Result<CurveLabels, String> {
    let mut labels = CurveLabels::default();
    if !names.is_null() {
        // SAFETY: as promised by the caller.
        for &name in unsafe { values(names, curves, "names") }? {
            // SAFETY: as promised by the caller.
            let name = unsafe { string(name, "the name of a curve") }?;
            labels.names.push(name.to_owned());
        }
    }
    if !radii.is_null() {
        // SAFETY: as promised by the caller.
        labels.radii = unsafe { values(radii, curves, "radii") }?.to_vec();
    }
    Ok(labels)
}

/// Returns the basis of a code.
pub(crate) fn basis(code: u32) -> Result<Basis, String> {
    let found = Basis::ALL.get(code as usize).copied();
    found.ok_or_else(|| format!("basis {code}: expected LW_POLYLINE to LW_BEZIER, 0 to 3"))
}

/// Returns the precision of a code.
pub(crate) fn precision(code: u32) -> Result<Precision, String> {
    match code {
        LW_FLOAT => Ok(Precision::F32),
        LW_DOUBLE => Ok(Precision::F64),
        _ => Err(format!(
            "precision {code}: expected LW_FLOAT, 4, or LW_DOUBLE, 8"
        )),
    }
}

/// Returns `count` values of the caller.
///
/// # Safety
///
/// The pointer is null, or points to this many values that do not change during the call.
pub(crate) unsafe fn values<'a, T>(
    pointer: *const T,
    count: usize,
    what: &str,
) -> Result<&'a [T], String> {
    if count == 0 {
        return Ok(&[]);
    }
    if pointer.is_null() {
        return Err(format!("{what} is null"));
    }
    if !pointer.is_aligned() {
        return Err(format!(
            "{what} is not aligned to {} bytes",
            align_of::<T>()
        ));
    }
    if count > isize::MAX as usize / size_of::<T>() {
        return Err(format!("{count} {what} do not fit into memory"));
    }
    // SAFETY: as promised by the caller, not null, aligned, and not larger than an object can be.
    Ok(unsafe { slice::from_raw_parts(pointer, count) })
}

/// Returns the frame of the caller.
///
/// # Safety
///
/// The pointer is null, or the frame and its arrays are valid and do not change during the call.
pub(crate) unsafe fn raw<'a>(frame: *const lw_frame, what: &str) -> Result<RawFrame<'a>, String> {
    // SAFETY: as promised by the caller.
    let frame = unsafe { frame.as_ref() }.ok_or_else(|| format!("{what} is null"))?;
    // SAFETY: as promised by the caller.
    let counts = unsafe { values(frame.counts, frame.curves, "counts") }?;
    let points: usize = counts.iter().map(|c| c.unsigned_abs() as usize).sum();
    let coordinates = 3 * points;
    // SAFETY: as promised by the caller, there are three coordinates for each counted point.
    let positions = unsafe {
        match precision(frame.precision)? {
            Precision::F32 => {
                Positions::F32(values(frame.positions.cast(), coordinates, "positions")?)
            }
            Precision::F64 => {
                Positions::F64(values(frame.positions.cast(), coordinates, "positions")?)
            }
        }
    };
    Ok(RawFrame {
        basis: basis(frame.basis)?,
        counts,
        positions,
    })
}
