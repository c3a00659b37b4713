//! Verification in process.

use crate::curves::{cell, given_cell, lw_frame, raw, values};
use crate::error::{LW_ERROR, LW_OK, free, give, given, guard, lw_status, string, words};
use crate::verdict::lw_verdict;
use linkwatch::{
    AbortOn, Certificate, Clearance, ClearanceOptions, Closing, CurveSource, Error, Events,
    FramePool, RawFrame, Strategy, Verdict, Verifier, VerifierOptions,
};
use std::ffi::{CString, c_char};
use std::path::Path;
use std::ptr;

/// All linking numbers of a frame.
pub struct lw_certificate {
    certificate: Certificate,
    links: Vec<lw_link>,
    images: Vec<lw_image_link>,
}

/// A pair of curves that are linked.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct lw_link {
    /// First curve, from 0.
    pub i: u32,
    /// Second curve, greater than `i`.
    pub j: u32,
    /// Linking number, not 0.
    pub lambda: i64,
}

/// A curve that is linked with a periodic image, of another curve or of itself.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct lw_image_link {
    /// First curve, from 0.
    pub i: u32,
    /// Second curve, at least `i`.
    pub j: u32,
    /// Translation of the second curve, in vectors of the periodic cell.
    pub image: [i32; 3],
    /// Linking number, not 0.
    pub lambda: i64,
}

impl From<Certificate> for lw_certificate {
    fn from(certificate: Certificate) -> lw_certificate {
        let links = certificate.links.iter();
        let links = links.map(|l| lw_link {
            i: l.i,
            j: l.j,
            lambda: l.lambda,
        });
        let images = certificate.images.iter().flatten();
        let images = images.map(|l| lw_image_link {
            i: l.i,
            j: l.j,
            image: l.image,
            lambda: l.lambda,
        });
        lw_certificate {
            links: links.collect(),
            images: images.collect(),
            certificate,
        }
    }
}

/// Computes the linking numbers of all pairs of closed curves, exactly. Free the result with
/// lw_certificate_free. Returns null after an error.
///
/// # Safety
///
/// `frame` and its arrays are valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_certify(frame: *const lw_frame) -> *mut lw_certificate {
    give(|| {
        // SAFETY: as promised by the caller.
        let frame = unsafe { raw(frame, "frame") }?;
        let set = Closing::default().curves(frame, CurveSource::default());
        let set = set.map_err(words)?;
        let mut verifier = Verifier::new(VerifierOptions::default()).map_err(words)?;
        Ok(verifier.certify(&set).0.clone().into())
    })
}

/// Same as lw_certify for a periodic scene, with all images of the curves. `vectors` are those of
/// the cell, `x y z` one after the other; a vector of zeros stands for a direction without
/// repetition. A curve that runs through the cell is open, and ends at an image of its start; it
/// has linking numbers with closed curves.
///
/// # Safety
///
/// `frame` and its arrays are valid. `vectors` has nine numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_certify_in_cell(
    frame: *const lw_frame,
    vectors: *const f64,
) -> *mut lw_certificate {
    give(|| {
        // SAFETY: as promised by the caller.
        let (frame, cell) = unsafe { (raw(frame, "frame")?, given_cell(vectors)?) };
        let options = VerifierOptions {
            cell: Some(cell),
            events: Events::Off,
            ..VerifierOptions::default()
        };
        let mut verifier = lw_verifier::new(options, false)?;
        let report = verifier.step(frame, 0.0)?;
        let certificate = verifier.verifier.baseline().cloned();
        match (report.rejected, certificate) {
            (None, Some(certificate)) => Ok(certificate.into()),
            (why, _) => Err(why.unwrap_or_else(|| "no linking numbers".into())),
        }
    })
}

/// Reads a certificate from a file. Returns null after an error.
///
/// # Safety
///
/// `path` is a string that ends with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_certificate_read(path: *const c_char) -> *mut lw_certificate {
    give(|| {
        // SAFETY: as promised by the caller.
        let path = unsafe { string(path, "the path") }?;
        let read = Certificate::read(Path::new(path));
        read.map(Into::into).map_err(words)
    })
}

/// Writes a certificate to a file.
///
/// # Safety
///
/// `certificate` comes from this library. `path` is a string that ends with a zero byte.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_certificate_write(
    certificate: *mut lw_certificate,
    path: *const c_char,
) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let (this, path) = unsafe {
            (
                given(certificate, "certificate")?,
                string(path, "the path")?,
            )
        };
        let written = this.certificate.write(Path::new(path));
        written.map(|()| LW_OK).map_err(words)
    })
}

/// Returns the linking numbers that are not 0, sorted by pair, and writes their number to `count`.
/// They are valid until the certificate is freed. Returns null if there are none.
///
/// # Safety
///
/// `certificate` comes from this library. `count` is valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_certificate_links(
    certificate: *mut lw_certificate,
    count: *mut usize,
) -> *const lw_link {
    guard(ptr::null(), || {
        // SAFETY: as promised by the caller.
        let (this, count) = unsafe { (given(certificate, "certificate")?, given(count, "count")?) };
        *count = this.links.len();
        Ok(match this.links.is_empty() {
            true => ptr::null(),
            false => this.links.as_ptr(),
        })
    })
}

/// Returns the linking numbers with periodic images that are not 0, sorted, and writes their number
/// to `count`. They are valid until the certificate is freed. Returns null if there are none.
///
/// # Safety
///
/// `certificate` comes from this library. `count` is valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_certificate_images(
    certificate: *mut lw_certificate,
    count: *mut usize,
) -> *const lw_image_link {
    guard(ptr::null(), || {
        // SAFETY: as promised by the caller.
        let (this, count) = unsafe { (given(certificate, "certificate")?, given(count, "count")?) };
        *count = this.images.len();
        Ok(match this.images.is_empty() {
            true => ptr::null(),
            false => this.images.as_ptr(),
        })
    })
}

/// Returns the number of pairs and curves without a linking number, because curves touch, are too
/// close, or are degenerate.
///
/// # Safety
///
/// `certificate` comes from this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_certificate_undefined(certificate: *mut lw_certificate) -> usize {
    guard(usize::MAX, || {
        // SAFETY: as promised by the caller.
        let this = unsafe { given(certificate, "certificate") }?;
        Ok(this.certificate.undefined.len())
    })
}

/// Frees a certificate. Does nothing if the pointer is null.
///
/// # Safety
///
/// `certificate` is null, or comes from this library and is not used afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_certificate_free(certificate: *mut lw_certificate) {
    // SAFETY: as promised by the caller.
    unsafe { free(certificate) }
}

/// Report all pull-throughs, including those of a curve through itself. The default.
pub const LW_EVENTS_ALL: u32 = 0;
/// Report pull-throughs between two different curves.
pub const LW_EVENTS_BETWEEN: u32 = 1;
/// Report no pull-throughs: compare linking numbers only.
pub const LW_EVENTS_OFF: u32 = 2;

/// Options of lw_verifier_new. All zero are the defaults.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lw_verifier_options {
    /// Expected linking numbers, which are copied. Null: those of the first frame.
    pub baseline: *mut lw_certificate,
    /// LW_EVENTS_ALL, LW_EVENTS_BETWEEN or LW_EVENTS_OFF.
    pub events: u32,
    /// Findings that set `lw_verdict.abort`: any, lost, gained, contact, event, rejected, clearance
    /// (any, or strands that come too close) or never. Null: any.
    pub abort_on: *const c_char,
    /// Motion between two frames, in segment lengths, up to which pull-throughs that cancel count
    /// as real. 0: the default, 1.5.
    pub motion_limit: f64,
    /// Radius of all strands, to measure how close they come: see lw_verifier_clearance. 0: not
    /// measured, unless there are `radii`.
    pub thickness: f64,
    /// Radius of each of `curves` curves, which are copied. Null: `thickness` is that of all.
    pub radii: *const f32,
    /// Number of `radii`.
    pub curves: usize,
    /// Distance of center lines, as a share of the sum of the radii, below which `lw_clearance.low`
    /// is set. 0: the default, 0.5.
    pub min_clearance: f64,
    /// How coordinates relate to the periodic cell. 0, the default: curves are whole, and followed
    /// if they jump by a lattice vector. 1: wrapped into the cell, to be unwrapped. -1: unwrapped,
    /// and taken as they are.
    pub wrapped: i32,
    /// Not 0: keep curves open that end where they start. 0: they are closed, without the repeated
    /// point.
    pub keep_open: u32,
}

/// Verifies successive frames against a baseline. Not thread-safe: use it in one thread at a time.
pub struct lw_verifier {
    verifier: Verifier,
    closing: Closing,
    /// Result of lw_verifier_notes.
    notes: CString,
    /// Number of the next frame.
    seq: u64,
    pool: FramePool,
    clearance: Option<Clearance>,
    /// True during a call. If it is true before a call, an earlier call panicked: the baseline may
    /// be lost then, and later verdicts would be wrong.
    busy: bool,
}

impl lw_verifier {
    fn new(options: VerifierOptions, keep_open: bool) -> Result<lw_verifier, String> {
        Ok(lw_verifier {
            verifier: Verifier::new(options).map_err(words)?,
            closing: Closing::new(keep_open),
            notes: CString::default(),
            seq: 0,
            pool: FramePool::default(),
            clearance: None,
            busy: false,
        })
    }

    fn step(&mut self, frame: RawFrame<'_>, time: f64) -> Result<linkwatch::Report, String> {
        if std::mem::replace(&mut self.busy, true) {
            return Err("an earlier call of this verifier failed; create a new one".into());
        }
        let lw_verifier {
            verifier,
            closing,
            pool,
            ..
        } = self;
        let source = CurveSource {
            cell: verifier.cell(),
            ..CurveSource::default()
        };
        let received = pool.receive(|set| verifier.receive(closing.close(frame, source)?, set));
        let report = match received {
            Ok(set) => verifier.step_shared(self.seq, time, &set).map_err(words),
            // It concerns the process, not the frame.
            Err(forked @ Error::Forked { .. }) => Err(words(forked)),
            Err(why) => Ok(verifier.reject(self.seq, time, &why)),
        };
        let verified = |report: &linkwatch::Report| report.verdict != Verdict::Rejected;
        closing.end_frame(report.as_ref().is_ok_and(verified));
        self.seq += 1;
        self.busy = false;
        self.clearance = report.as_ref().ok().and_then(|report| report.clearance);
        report
    }

    /// Returns the clearance of the last frame, if it is measured.
    pub(crate) fn clearance(&self) -> Result<Option<Clearance>, String> {
        match self.verifier.unmeasured_clearance() {
            Some(why) => Err(why.to_owned()),
            None => Ok(self.clearance),
        }
    }
}

/// Creates a verifier. `options` may be null. Returns null after an error.
///
/// # Safety
///
/// `options` is null, or it and its pointers are valid or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_verifier_new(options: *const lw_verifier_options) -> *mut lw_verifier {
    give(|| {
        let mut chosen = VerifierOptions {
            events: Events::All,
            strategy: Strategy::Incremental,
            ..VerifierOptions::default()
        };
        let (mut radii, mut keep_open): (&[f32], bool) = (&[], false);
        // SAFETY: as promised by the caller.
        if let Some(options) = unsafe { options.as_ref() } {
            // SAFETY: as promised by the caller.
            let baseline = unsafe { options.baseline.as_ref() };
            chosen.baseline = baseline.map(|b| b.certificate.clone());
            chosen.events = match options.events {
                LW_EVENTS_ALL => Events::All,
                LW_EVENTS_BETWEEN => Events::Between,
                LW_EVENTS_OFF => Events::Off,
                other => return Err(format!("events {other}: expected LW_EVENTS_ALL to _OFF")),
            };
            chosen.wrapped = match options.wrapped {
                0 => None,
                1 => Some(true),
                -1 => Some(false),
                other => return Err(format!("wrapped {other}: expected -1, 0 or 1")),
            };
            if !options.abort_on.is_null() {
                // SAFETY: as promised by the caller.
                let word = unsafe { string(options.abort_on, "abort_on") }?;
                chosen.abort_on = word
                    .parse::<AbortOn>()
                    .map_err(|e| format!("abort_on {word:?}: {e}"))?;
            }
            keep_open = options.keep_open != 0;
            if options.motion_limit != 0.0 {
                chosen.motion_limit = Some(options.motion_limit);
            }
            if !options.radii.is_null() {
                // SAFETY: as promised by the caller.
                radii = unsafe { values(options.radii, options.curves, "radii") }?;
                chosen.clearance = Some(ClearanceOptions::new(None));
            } else if options.thickness != 0.0 {
                chosen.clearance = Some(ClearanceOptions::new(Some(options.thickness)));
            }
            if options.min_clearance != 0.0
                && let Some(clearance) = &mut chosen.clearance
            {
                clearance.low = options.min_clearance;
            }
        }
        let mut made = lw_verifier::new(chosen, keep_open)?;
        made.verifier.set_radii(radii).map_err(words)?;
        Ok(made)
    })
}

/// Verifies the next frame, at `time` seconds of simulation. All frames have the same curves. A
/// frame that is invalid, for example with NaN, is LW_REJECTED.
///
/// # Safety
///
/// `verifier` comes from lw_verifier_new. `frame` and its arrays are valid. `verdict` is valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_verifier_step(
    verifier: *mut lw_verifier,
    frame: *const lw_frame,
    time: f64,
    verdict: *mut lw_verdict,
) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let (this, to) = unsafe { (given(verifier, "verifier")?, given(verdict, "verdict")?) };
        *to = lw_verdict::NONE;
        // SAFETY: as promised by the caller.
        let frame = unsafe { raw(frame, "frame") }?;
        *to = (&this.step(frame, time)?).into();
        Ok(LW_OK)
    })
}

/// Returns what the first frame decided about closed and open curves, a sentence a line, or null if
/// there is nothing to tell. Curves that end where they start are closed, without the repeated
/// point. A curve that is closed by a segment of more than twice the length of its other ones may
/// be an open chain. Call this after lw_verifier_step; later calls return null. The text is valid
/// until the next call, and until the verifier is freed.
///
/// # Safety
///
/// `verifier` comes from lw_verifier_new.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_verifier_notes(verifier: *mut lw_verifier) -> *const c_char {
    guard(ptr::null(), || {
        // SAFETY: as promised by the caller.
        let this = unsafe { given(verifier, "verifier") }?;
        let notes = this.closing.take_notes();
        if notes.is_empty() {
            return Ok(ptr::null());
        }
        let lines: Vec<String> = notes.iter().map(ToString::to_string).collect();
        this.notes = CString::new(lines.join("\n")).unwrap_or_default();
        Ok(this.notes.as_ptr())
    })
}

/// Sets the periodic cell of the frames from the next one on: three vectors, `x y z` one after the
/// other, and a corner, which may be null. A vector of zeros stands for a direction without
/// repetition. The frames of a verifier have either all a cell or none, and all repeat along the
/// same vectors.
///
/// # Safety
///
/// `verifier` comes from lw_verifier_new. `vectors` points to nine numbers; `corner` is null, or
/// points to three.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_verifier_set_cell(
    verifier: *mut lw_verifier,
    vectors: *const f64,
    corner: *const f64,
) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let (this, cell) = unsafe { (given(verifier, "verifier")?, cell(vectors, corner)?) };
        let cell = cell.ok_or("vectors is null")?;
        let set = this.verifier.set_cell(cell);
        set.map(|()| LW_OK).map_err(words)
    })
}

/// Marks the next frame as not continuing the previous one: after a roll back or a jump.
///
/// # Safety
///
/// `verifier` comes from lw_verifier_new.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_verifier_cut(verifier: *mut lw_verifier) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        unsafe { given(verifier, "verifier") }?.verifier.cut();
        Ok(LW_OK)
    })
}

/// Frees a verifier. Does nothing if the pointer is null.
///
/// # Safety
///
/// `verifier` is null, or comes from lw_verifier_new and is not used afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_verifier_free(verifier: *mut lw_verifier) {
    // SAFETY: as promised by the caller.
    unsafe { free(verifier) }
}

/// Returns the largest proven share of the step between two frames during which nothing is pulled
/// through: 1 if the whole step is safe, 0 if nothing is proven, and a negative number after an
/// error. Points move on straight lines at constant speed.
///
/// # Safety
///
/// Both frames and their arrays are valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_safe_fraction(before: *const lw_frame, after: *const lw_frame) -> f64 {
    guard(-1.0, || {
        // SAFETY: as promised by the caller.
        let frames = unsafe { [raw(before, "before")?, raw(after, "after")?] };
        let mut verifier = lw_verifier::new(
            VerifierOptions {
                events: Events::All,
                ..VerifierOptions::default()
            },
            false,
        )?;
        let mut share = None;
        for frame in frames {
            let report = verifier.step(frame, 0.0)?;
            if report.verdict == Verdict::Rejected {
                return Err(report.rejected.unwrap_or_default());
            }
            share = report.safe_fraction;
        }
        Ok(share.unwrap_or(0.0))
    })
}
