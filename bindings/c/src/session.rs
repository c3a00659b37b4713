//! Verification in process.

use crate::curves::{cell, given_cell, labels, lw_frame, raw};
use crate::error::{LW_ERROR, LW_OK, free, give, given, guard, list, lw_status, string, words};
use crate::verdict::lw_verdict;
use linkwatch::{
    AbortOn, Cell, Certificate, Certifier, Clearance, ClearanceOptions, Closing, ClosingNote,
    CurveLabels, CurveSource, Events, FrameInfo, RawFrame, Session, SessionOptions, Strategy,
    Verdict, VerifiedFrame,
};
use std::ffi::{CString, c_char};
use std::path::Path;
use std::ptr;
use std::sync::Arc;

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
    /// Translation of the second curve, in lattice vectors.
    pub image: [i32; 3],
    /// Linking number, not 0.
    pub lambda: i64,
}

impl From<Certificate> for lw_certificate {
    fn from(certificate: Certificate) -> lw_certificate {
        let links = certificate.links().iter();
        let links = links.map(|l| lw_link {
            i: l.i,
            j: l.j,
            lambda: l.lambda,
        });
        let images = certificate.images().into_iter().flatten();
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
/// `cell` is null, or has the lattice vectors of a periodic cell, `x y z` one after the other; a
/// vector of zeros stands for a direction without repetition. All images of the curves are verified
/// then. A curve that runs through the cell is open, and ends at an image of its start; it has
/// linking numbers with closed curves.
///
/// # Safety
///
/// `frame` and its arrays are valid. `cell` is null, or has nine numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_certify(
    frame: *const lw_frame,
    cell: *const f64,
) -> *mut lw_certificate {
    give(|| {
        // SAFETY: as promised by the caller.
        let (frame, cell) = unsafe { (raw(frame, "frame")?, given_cell(cell)?) };
        let Some(cell) = cell else {
            let set = Closing::default().curves(frame, CurveSource::default());
            let set = set.map_err(words)?;
            let mut certifier = Certifier::new(&SessionOptions::default()).map_err(words)?;
            return Ok(certifier.certify(&set).0.clone().into());
        };
        let mut session = Session::new(SessionOptions::default()).map_err(words)?;
        let report = session.feed(FrameInfo::default().in_cell(cell), frame);
        let report = report.map_err(words)?;
        match (report.rejected, session.baseline()) {
            (None, Some(certificate)) => Ok(certificate.clone().into()),
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
        Ok(list(&this.links, count))
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
        Ok(list(&this.images, count))
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
        Ok(this.certificate.undefined().len())
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

/// Options of lw_session_new. All zero are the defaults.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct lw_session_options {
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
    /// Radius of all strands, to measure how close they come: see lw_session_clearance. 0: not
    /// measured, unless there are `radii`.
    pub thickness: f64,
    /// Radius of each of `curves` curves, which are copied; lw_session_describe replaces them.
    /// Null: `thickness` is that of all.
    pub radii: *const f32,
    /// Number of `radii`.
    pub curves: usize,
    /// Distance of centre lines, as a share of the sum of the radii, below which `lw_clearance.low`
    /// is set. 0: the default, 0.5.
    pub min_clearance: f64,
    /// Relation of coordinates to the periodic cell. 0, the default: curves are whole, and followed
    /// if they jump by a lattice vector. 1: wrapped into the cell, to be unwrapped. -1: unwrapped,
    /// and taken as they are.
    pub wrapped: i32,
    /// Not 0: keep curves open that end where they start. 0: they are closed, without the repeated
    /// point.
    pub keep_open: u32,
}

/// Verifies the frames of one simulation in process. Not thread-safe: use it in one thread at a
/// time.
pub struct lw_session {
    session: Session,
    /// Number, cell, labels and so on of the next frame.
    next: FrameInfo,
    /// True if each curve has its own radius.
    has_radii: bool,
    /// Decisions about closed and open curves that were not read yet.
    notes: Vec<ClosingNote>,
    /// Result of lw_session_notes.
    text: CString,
    clearance: Option<Clearance>,
    unmeasured: Option<String>,
    /// True during a call. If it is true before a call, an earlier call panicked: the baseline may
    /// be lost then, and later verdicts would be wrong.
    busy: bool,
}

impl lw_session {
    /// Describes the curves of the next frames.
    fn describe(&mut self, labels: CurveLabels) -> Result<(), String> {
        let positive = !labels.radii.is_empty() && labels.radii.iter().all(|&r| r > 0.0);
        match self.has_radii {
            true if !positive => {
                return Err("clearance needs a positive radius of each curve".into());
            }
            false if !labels.radii.is_empty() => {
                return Err("radii have no effect unless the options have radii".into());
            }
            _ => {}
        }
        let curves = labels.names.len().max(labels.radii.len());
        labels.check(curves).map_err(words)?;
        self.next.labels = Arc::new(labels);
        self.next.layout += 1;
        Ok(())
    }

    fn step(&mut self, frame: RawFrame<'_>, time: f64) -> Result<VerifiedFrame, String> {
        if std::mem::replace(&mut self.busy, true) {
            return Err("an earlier call of this session failed; create a new one".into());
        }
        let info = FrameInfo {
            time,
            ..self.next.clone()
        };
        self.next.seq += 1;
        let received = self.session.receive(info, |copy| copy(frame));
        let verified = self.session.verify(received);
        self.busy = false;
        self.clearance = None;
        let mut verified = verified.map_err(words)?;
        self.notes.append(&mut verified.notes);
        self.clearance = verified.report.clearance;
        self.unmeasured = verified.unmeasured.take();
        Ok(verified)
    }

    /// Returns the clearance of the last frame, if it is measured.
    pub(crate) fn clearance(&self) -> Result<Option<Clearance>, String> {
        match &self.unmeasured {
            Some(why) => Err(why.clone()),
            None => Ok(self.clearance),
        }
    }
}

/// Creates a session. `options` may be null. Returns null after an error.
///
/// # Safety
///
/// `options` is null, or it and its pointers are valid or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_session_new(options: *const lw_session_options) -> *mut lw_session {
    give(|| {
        let mut chosen = SessionOptions {
            events: Events::All,
            strategy: Strategy::Incremental,
            ..SessionOptions::default()
        };
        let mut radii = CurveLabels::default();
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
            chosen.keep_open = options.keep_open != 0;
            if options.motion_limit != 0.0 {
                chosen.motion_limit = Some(options.motion_limit);
            }
            if !options.radii.is_null() {
                // SAFETY: as promised by the caller.
                radii = unsafe { labels(ptr::null(), options.radii, options.curves) }?;
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
        let has_radii = chosen
            .clearance
            .is_some_and(|options| options.radius.is_none());
        let mut made = lw_session {
            session: Session::new(chosen).map_err(words)?,
            next: FrameInfo::default(),
            has_radii,
            notes: Vec::new(),
            text: CString::default(),
            clearance: None,
            unmeasured: None,
            busy: false,
        };
        made.describe(radii)?;
        Ok(made)
    })
}

/// Describes the curves of the frames from the next one on, if they have names or radii; either may
/// be null.
///
/// If the curves have names, this can be called again between two frames: curves may be added,
/// removed, reordered, or get another number of points. Linking numbers of curves are compared by
/// their names, and those of new curves are expected to stay as they are in their first frame. A
/// name belongs to one curve for the whole session. Radii are needed if the options have some. In a
/// periodic cell, the curves must stay the same, but may be described again.
///
/// # Safety
///
/// `session` comes from lw_session_new. `names` is null, or points to `curves` strings that end
/// with a zero byte. `radii` is null, or points to `curves` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_session_describe(
    session: *mut lw_session,
    names: *const *const c_char,
    radii: *const f32,
    curves: usize,
) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let (this, labels) = unsafe { (given(session, "session")?, labels(names, radii, curves)?) };
        this.describe(labels).map(|()| LW_OK)
    })
}

/// Verifies the next frame, at `time` seconds of simulation. All frames have the same curves,
/// unless lw_session_describe is called between them. A frame that is invalid, for example with
/// NaN, is LW_REJECTED, and later verdicts do not depend on it.
///
/// # Safety
///
/// `session` comes from lw_session_new. `frame` and its arrays are valid. `verdict` is valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_session_step(
    session: *mut lw_session,
    frame: *const lw_frame,
    time: f64,
    verdict: *mut lw_verdict,
) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let (this, to) = unsafe { (given(session, "session")?, given(verdict, "verdict")?) };
        *to = lw_verdict::NONE;
        // SAFETY: as promised by the caller.
        let frame = unsafe { raw(frame, "frame") }?;
        let verified = this.step(frame, time)?;
        *to = lw_verdict::of(&verified.report, &verified.info.labels.names);
        Ok(LW_OK)
    })
}

/// Returns what the frames decided about closed and open curves, a sentence a line, or null if
/// there is nothing to tell. Curves that end where they start are closed, without the repeated
/// point. A curve that is closed by a segment of more than twice the length of its other ones may
/// be an open chain. Call this after lw_session_step; later calls return null. The text is valid
/// until the next call, and until the session is freed.
///
/// # Safety
///
/// `session` comes from lw_session_new.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_session_notes(session: *mut lw_session) -> *const c_char {
    guard(ptr::null(), || {
        // SAFETY: as promised by the caller.
        let this = unsafe { given(session, "session") }?;
        let notes = std::mem::take(&mut this.notes);
        if notes.is_empty() {
            return Ok(ptr::null());
        }
        let lines: Vec<String> = notes.iter().map(ToString::to_string).collect();
        this.text = CString::new(lines.join("\n")).unwrap_or_default();
        Ok(this.text.as_ptr())
    })
}

/// Sets the periodic cell of the frames from the next one on: three vectors, `x y z` one after the
/// other, and a corner, which may be null. A vector of zeros stands for a direction without
/// repetition. If `vectors` is null, as at first, space is open. All frames of a session repeat
/// along the same vectors, or along none; others are LW_REJECTED.
///
/// # Safety
///
/// `session` comes from lw_session_new. `vectors` is null, or points to nine numbers; `corner` is
/// null, or points to three.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_session_set_cell(
    session: *mut lw_session,
    vectors: *const f64,
    corner: *const f64,
) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let (this, cell) = unsafe { (given(session, "session")?, cell(vectors, corner)?) };
        cell.as_ref().map_or(Ok(()), Cell::check).map_err(words)?;
        this.next.cell = cell;
        Ok(LW_OK)
    })
}

/// Marks the next frame as not continuing the previous one: after a roll back or a jump.
///
/// # Safety
///
/// `session` comes from lw_session_new.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_session_cut(session: *mut lw_session) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let next = unsafe { &mut given(session, "session")?.next };
        next.cuts = next.cuts.wrapping_add(1);
        Ok(LW_OK)
    })
}

/// Accepts the present state as the new baseline: the linking numbers of the next frame that is not
/// rejected are expected from then on, whatever they are. Pull-throughs are not searched for in the
/// step to it. Before the first frame, this does nothing: a given baseline remains.
///
/// # Safety
///
/// `session` comes from lw_session_new.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_session_accept(session: *mut lw_session) -> lw_status {
    guard(LW_ERROR, || {
        // SAFETY: as promised by the caller.
        let next = unsafe { &mut given(session, "session")?.next };
        next.baseline = next.seq;
        Ok(LW_OK)
    })
}

/// Frees a session. Does nothing if the pointer is null.
///
/// # Safety
///
/// `session` is null, or comes from lw_session_new and is not used afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_session_free(session: *mut lw_session) {
    // SAFETY: as promised by the caller.
    unsafe { free(session) }
}

/// Returns the largest proven fraction of the step between two frames during which nothing is
/// pulled through: 1 if the whole step is safe, 0 if nothing is proven, and a negative number after
/// an error. Points move on straight lines at constant speed.
///
/// # Safety
///
/// Both frames and their arrays are valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lw_safe_fraction(before: *const lw_frame, after: *const lw_frame) -> f64 {
    guard(-1.0, || {
        // SAFETY: as promised by the caller.
        let frames = unsafe { [raw(before, "before")?, raw(after, "after")?] };
        let options = SessionOptions {
            events: Events::All,
            ..SessionOptions::default()
        };
        let mut session = Session::new(options).map_err(words)?;
        let mut fraction = None;
        for (seq, frame) in (0..).zip(frames) {
            let report = session.feed(FrameInfo::at(seq, 0.0), frame);
            let report = report.map_err(words)?;
            if report.verdict == Verdict::Rejected {
                return Err(report.rejected.unwrap_or_default());
            }
            fraction = report.safe_fraction;
        }
        Ok(fraction.unwrap_or(0.0))
    })
}
