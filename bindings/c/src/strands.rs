//! Thickness, struts, clearance and ribbons.

use crate::curves::{given_cell, lw_frame, raw};
use crate::error::{
    LW_ERROR, LW_NOTHING, LW_OK, describe, free, give, given, guard, list, lw_status, string, words,
};
use crate::session::lw_session;
use linkwatch::{Axis, Closing, CurveSet, CurveSource, Ribbon, RibbonOptions, Thickness, struts};
use std::ffi::c_char;
use std::ptr;

/// Length of all curves, their sharpest bend and their shortest strut.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct lw_thickness_values {
    /// Length of all curves.
    pub length: f64,
    /// Radius of the sharpest bend; infinite if no curve bends.
    pub min_rad: f64,
    /// Length of the shortest strut; infinite if there is none.
    pub poca: f64,
    /// Diameter of the thickest tube around all curves that neither bends too sharply nor overlaps.
    pub thickness: f64,
    /// Length divided by thickness.
    pub ropelength: f64,
}

/// Two points of curves whose distance is a local minimum.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct lw_strut {
    /// Curve of each end, from 0.
    pub curves: [u32; 2],
    /// Segment of each end, from 0.
    pub segments: [u32; 2],
    /// Place of each end on its segment, from 0 to 1.
    pub t: [f64; 2],
    /// Both ends: that of the second curve is translated by `image`.
    pub points: [[f64; 3]; 2],
    /// Distance of the ends.
    pub length: f64,
    /// Upper bound of the error of the length: 0 for polylines.
    pub error: f64,
    /// Derivatives of the length with respect to the start and the end of the first segment, and of
    /// the second one. NaN for splines, and if the length is 0.
    pub gradient: [[[f64; 3]; 2]; 2],
    /// Translation of the second curve, in lattice vectors; zeros without a cell.
    pub image: [i32; 3],
}

/// Struts of a frame.
pub struct lw_struts {
    struts: Vec<lw_strut>,
}

/// Clearance of a frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct lw_clearance {
    /// Lower bound of the clearance of all strands.
    pub at_least: f64,
    /// Distance of the closest centre lines, as a share of the sum of their radii. Infinite if no
    /// strands are close; the members about them are 0 then.
    pub ratio: f64,
    /// Upper bound of the error of the ratio: 0 for polylines.
    pub error: f64,
    /// Curves of the closest strands: the same one twice for two parts of a curve.
    pub curves: [u32; 2],
    /// Their segments.
    pub segments: [u32; 2],
    /// Their nearest points: that of the second strand is translated by `image`.
    pub points: [[f64; 3]; 2],
    /// True if the clearance is below the level of the warning.
    pub low: bool,
    /// Frames until the surfaces touch, or, if they do, until the centre lines meet. NaN if the
    /// clearance does not shrink.
    pub frames_left: f64,
    /// Translation of the second strand, in lattice vectors; zeros without a cell.
    pub image: [i32; 3],
}

/// Returns the curves of a frame.
///
/// # Safety
///
/// `frame` and its arrays are valid, or `frame` is null.
unsafe fn curves(frame: *const lw_frame) -> Result<CurveSet, String> {
    // SAFETY: as promised by the caller.
    let frame = unsafe { raw(frame, "frame") }?;
    let set = Closing::default().curves(frame, CurveSource::default());
    set.map_err(words)
}

/// Measures how sharply curves bend and how close they come. `stiffness` divides the radius of the
/// sharpest bend; it is 1 in Ashton and Cantarella 2005. For `cell` see lw_certify.
///
/// # Safety
///
/// `frame` and its arrays are valid. `cell` is null, or has nine numbers. `values` is valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_thickness(
    frame: *const lw_frame,
    cell: *const f64,
    stiffness: f64,
    values: *mut lw_thickness_values,
) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let (to, set) = unsafe { (given(values, "values")?, curves(frame)?) };
        // SAFETY: as promised by the caller.
        let cell = unsafe { given_cell(cell) }?;
        if !(stiffness > 0.0 && stiffness.is_finite()) {
            return Err(format!(
                "a stiffness of {stiffness}, expected a number above 0"
            ));
        }
        let found = Thickness::of(&set, cell.as_ref()).map_err(words)?;
        *to = lw_thickness_values {
            length: found.length,
            min_rad: found.min_rad.map_or(f64::INFINITY, |bend| bend.radius),
            poca: found.poca.map_or(f64::INFINITY, |strut| strut.length),
            thickness: found.thickness(stiffness),
            ropelength: found.ropelength(stiffness),
        };
        Ok(LW_OK)
    })
}

/// Finds all struts up to a length, the shortest first; in a cell, each one once. Free the result
/// with lw_struts_free. For `cell` see lw_certify. Returns null after an error.
///
/// # Safety
///
/// `frame` and its arrays are valid. `cell` is null, or has nine numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_struts_up_to(
    frame: *const lw_frame,
    cell: *const f64,
    longest: f64,
) -> *mut lw_struts {
    give(|| {
        // SAFETY: as promised by the caller.
        let (set, cell) = unsafe { (curves(frame)?, given_cell(cell)?) };
        let exact = set.basis().is_polyline();
        let found = struts(&set, cell.as_ref(), longest).map_err(words)?;
        let converted = found.iter().map(|strut| {
            let [a, b] = strut.ends;
            let gradient = strut.gradient().filter(|_| exact);
            lw_strut {
                curves: [a.curve, b.curve],
                segments: [a.segment, b.segment],
                t: [a.t, b.t],
                points: [a.point, b.point],
                length: strut.length,
                error: strut.error,
                gradient: gradient.unwrap_or([[[f64::NAN; 3]; 2]; 2]),
                image: strut.image,
            }
        });
        Ok(lw_struts {
            struts: converted.collect(),
        })
    })
}

/// Returns the struts, and writes their number to `count`. They are valid until they are freed.
/// Returns null if there are none.
///
/// # Safety
///
/// `struts` comes from this library. `count` is valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_struts_list(
    struts: *mut lw_struts,
    count: *mut usize,
) -> *const lw_strut {
    guard(ptr::null(), || {
        // SAFETY: as promised by the caller.
        let (this, count) = unsafe { (given(struts, "struts")?, given(count, "count")?) };
        Ok(list(&this.struts, count))
    })
}

/// Frees struts. Does nothing if the pointer is null.
///
/// # Safety
///
/// `struts` is null, or comes from this library and is not used afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_struts_free(struts: *mut lw_struts) {
    // SAFETY: as promised by the caller.
    unsafe { free(struts) }
}

/// Writes the clearance of the last frame that lw_session_step verified to `clearance`. Returns
/// LW_OK; LW_NOTHING if there is none: clearance is not measured, or the frame was rejected; or
/// LW_ERROR if it cannot be measured.
///
/// # Safety
///
/// `session` comes from lw_session_new. `clearance` is valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_session_clearance(
    session: *mut lw_session,
    clearance: *mut lw_clearance,
) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let (this, to) = unsafe { (given(session, "session")?, given(clearance, "clearance")?) };
        let Some(found) = this.clearance()? else {
            return Ok(LW_NOTHING);
        };
        *to = lw_clearance {
            at_least: found.at_least,
            ratio: f64::INFINITY,
            error: 0.0,
            curves: [0; 2],
            segments: [0; 2],
            points: [[0.0; 3]; 2],
            low: found.low,
            frames_left: found.frames_left.unwrap_or(f64::NAN),
            image: [0; 3],
        };
        if let Some(closest) = found.closest {
            to.ratio = closest.ratio;
            to.error = closest.error;
            to.curves = [closest.i, closest.j];
            to.segments = closest.segments;
            to.points = closest.points;
            to.image = closest.image;
        }
        Ok(LW_OK)
    })
}

/// Linking number, twist and writhe of a closed ribbon between two curves, such as DNA.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct lw_ribbon_values {
    /// Linking number of the two curves, in the same direction; 0 if they touch.
    pub linking: i64,
    /// Twist about the axis, in turns.
    pub twist: f64,
    /// Upper bound of the error of the twist.
    pub twist_error: f64,
    /// Writhe of the axis.
    pub writhe: f64,
    /// Upper bound of the error of the writhe.
    pub writhe_error: f64,
    /// True if the strands run in opposite directions.
    pub antiparallel: bool,
    /// Vertex `k` of the first strand belongs to vertex `k + shift` of the second one, or to
    /// `n - 1 - k + shift` if the strands are antiparallel, modulo `n` vertices.
    pub shift: usize,
    /// Number of other pairings that fit nearly as well and have another twist.
    pub rivals: usize,
    /// Twist of one of them; NaN if there is none.
    pub rival_twist: f64,
}

/// Computes linking number, twist and writhe of the ribbon between two closed polylines of a frame
/// with the same number of vertices.
///
/// `pairing` says which vertices belong together: "parallel" (k with k), "antiparallel" (k with
/// n - 1 - k), one of these with a shift ("antiparallel:1"), or "auto"; null is "auto". The axis is
/// the centre line of both curves, or the first one if `axis_first` is true. `tolerance` is the
/// error of the writhe to reach, if possible; 0 is 1e-4.
///
/// Returns LW_OK; LW_NOTHING if the curves touch, so that there is no linking number, but `values`
/// has twist and writhe; or LW_ERROR.
///
/// # Safety
///
/// `frame` and its arrays are valid. `pairing` is null, or a string that ends with a zero byte.
/// `values` is valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_ribbon(
    frame: *const lw_frame,
    first: usize,
    second: usize,
    pairing: *const c_char,
    axis_first: bool,
    tolerance: f64,
    values: *mut lw_ribbon_values,
) -> lw_status {
    guard(LW_ERROR, || {
        let mut options = RibbonOptions::default();
        if !pairing.is_null() {
            // SAFETY: as promised by the caller.
            let text = unsafe { string(pairing, "pairing") }?;
            if text != "auto" {
                options.pairing = Some(text.parse().map_err(words)?);
            }
        }
        if axis_first {
            options.axis = Axis::First;
        }
        if !(tolerance >= 0.0 && tolerance.is_finite()) {
            return Err(format!("a tolerance of {tolerance}, expected at least 0"));
        }
        if tolerance > 0.0 {
            options.tolerance = tolerance;
        }
        // SAFETY: as promised by the caller.
        let (to, set) = unsafe { (given(values, "values")?, curves(frame)?) };
        let found = Ribbon::of(&set, [first, second], options).map_err(words)?;
        *to = lw_ribbon_values {
            linking: found.linking.unwrap_or(0),
            twist: found.twist.value,
            twist_error: found.twist.bound,
            writhe: found.writhe.value,
            writhe_error: found.writhe.bound,
            antiparallel: found.pairing.antiparallel,
            shift: found.pairing.shift,
            rivals: found.rivals.len(),
            rival_twist: found
                .rivals
                .first()
                .map_or(f64::NAN, |(_, twist)| twist.value),
        };
        match found.linking {
            Some(_) => Ok(LW_OK),
            None => {
                describe("the curves touch, so they have no linking number");
                Ok(LW_NOTHING)
            }
        }
    })
}
