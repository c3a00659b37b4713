//! Session: the protocol of the frames of one simulation. Whoever has frames feeds them to a
//! session, and to nothing below it.
//!
//! A session knows what the frames have in common: names of curves that come and go, the periodic
//! cell, wrapped coordinates, cuts, accepted baselines, radii. A frame is verified completely, or
//! rejected without a trace: inserting rejected frames anywhere changes no other report.

mod begin;
mod closings;
mod coordinates;
mod frame;
mod state;
mod strands;

pub use frame::{Continuation, Given, Received, VerifiedFrame};
pub use state::SessionState;

use self::begin::{Begin, PartBaseline, check_cell};
use self::closings::Closings;
use self::coordinates::Coordinates;
use self::strands::Strands;
use crate::certificate::Certificate;
use crate::curve::{Cell, CurveChange, CurveSet, Precision};
use crate::discretize::Braids;
use crate::engine::{Engine, Next as NextFrame, Progress, SessionOptions, Timings};
use crate::error::{Error, Result};
use crate::incremental::Events;
use crate::ingest::{Closing, ClosingNote, CurveSource, FrameInfo, FramePool, RawFrame};
use crate::pool;
use crate::verdict::{LeftOut, Report};
use std::collections::BTreeSet;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Verifies the frames of one simulation against a baseline. Its buffers are reused for every
/// frame.
///
/// The reports depend neither on the number of threads of the rayon pool in which it is called, nor
/// on rejected frames.
///
/// ```
/// use linkwatch::{
///     Basis, CurveLabels, FrameInfo, Positions, RawFrame, Session, SessionOptions, Verdict,
/// };
///
/// let mut session = Session::new(SessionOptions::default())?;
/// let square = |x: f64| [x, 0., 0., x + 1., 0., 0., x + 1., 1., 0., x, 1., 0.];
/// let one = RawFrame {
///     basis: Basis::Polyline,
///     counts: &[-4],
///     positions: Positions::F64(&square(0.0)),
/// };
/// let info = FrameInfo::at(0, 0.0).with_labels(0, CurveLabels::named(["a"]));
/// assert_eq!(session.feed(info, one)?.verdict, Verdict::Intact);
///
/// // Another curve appears. The number of the layout tells that the curves changed.
/// let two = RawFrame {
///     counts: &[-4, -4],
///     positions: Positions::F64(&[square(5.0), square(0.0)].concat()),
///     ..one
/// };
/// let info = FrameInfo::at(1, 0.1).with_labels(1, CurveLabels::named(["b", "a"]));
/// let report = session.feed(info, two)?;
/// assert_eq!((report.verdict, report.appeared), (Verdict::Intact, vec!["b".to_owned()]));
/// # Ok::<(), linkwatch::Error>(())
/// ```
#[derive(Debug)]
pub struct Session {
    options: SessionOptions,
    engine: Engine,
    closings: Closings,
    coordinates: Coordinates,
    /// Pool of the curves of the last frames, and the layout of those frames.
    pool: (u32, FramePool),
    /// Information of the simulator about the last verified frame, with the cell in which findings
    /// name images.
    last: Option<FrameInfo>,
    next: Next,
    strands: Strands,
    /// Hashes of the names of curves that disappeared since the first or the last accepted frame.
    /// Names are not kept, because a simulation may replace curves for hours. If two names have the
    /// same hash, a frame becomes undecided.
    gone: BTreeSet<u64>,
}

fn hash(name: &String) -> u64 {
    let mut hasher = DefaultHasher::new();
    name.hash(&mut hasher);
    hasher.finish()
}

/// How the next frame follows the last one, if the caller decided it.
#[derive(Debug, Default)]
enum Next {
    /// Not decided by the caller: the [`FrameInfo`] of the frame decides.
    #[default]
    ByInfo,
    /// The next frame does not continue the last one.
    Cut,
    /// The next frame begins a part of the run, with a baseline.
    Part(PartBaseline),
    /// The next frame is the first of another run.
    Run,
}

impl Session {
    /// Creates a session, and opens its device.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if an option has an invalid value, or excludes another one;
    /// [`Error::Device`] if no adapter matches, or it cannot be used; [`Error::Forked`].
    pub fn new(options: SessionOptions) -> Result<Session> {
        Ok(Session {
            engine: Engine::new(options.clone())?,
            closings: Closings::default(),
            coordinates: Coordinates::default(),
            pool: Default::default(),
            last: None,
            next: Next::ByInfo,
            strands: Strands::default(),
            gone: BTreeSet::new(),
            options,
        })
    }

    /// Verifies a frame: [`Session::receive`] and [`Session::verify`].
    ///
    /// # Errors
    ///
    /// The errors of [`Session::verify`].
    pub fn feed<'a>(&mut self, info: FrameInfo, frame: impl Into<Given<'a>>) -> Result<Report> {
        let received = match frame.into() {
            Given::Raw(raw) => self.receive(info, |copy| copy(raw)),
            Given::Curves(curves) => Received::new(info, Ok(curves)),
        };
        Ok(self.verify(received)?.report)
    }

    /// Copies a frame, which `read` passes to its argument. The frame may be in memory that another
    /// process writes: the copy is checked, and all results are those of the copy. The same pass
    /// compares the frame with an earlier one, so that a quiet frame need not be read again.
    /// Several frames may be received before they are verified.
    ///
    /// A frame that breaks its contract is rejected by [`Session::verify`].
    pub fn receive(
        &mut self,
        info: FrameInfo,
        read: impl FnOnce(&mut dyn FnMut(RawFrame<'_>) -> Result<()>) -> Result<()>,
    ) -> Received {
        let start = Instant::now();
        let source = self.source(&info);
        // If the cell of the frame has another lattice basis, the frame is compared again later.
        let last = self.last.as_ref().and_then(|last| last.cell);
        let cell = self.cell(&info);
        let cell = cell.map(|cell| last.map_or(cell, |last| cell.in_basis_of(&last)));
        if self.pool.0 != info.layout {
            self.pool = (info.layout, FramePool::default());
        }
        // Only a verified frame decides which curves are closed, because this frame or an earlier
        // one may be rejected.
        let (engine, mut closing) = (&mut self.engine, self.closings.known(info.layout));
        let is_closed = closing.is_some();
        let curves = self.pool.1.receive(|set| {
            read(&mut |frame| {
                let frame = match &mut closing {
                    Some(closing) => closing.close(frame, source)?,
                    None => frame,
                };
                engine.receive(frame, cell.as_ref(), set)
            })
        });
        Received {
            is_closed,
            took: start.elapsed(),
            ..Received::new(info, curves)
        }
    }

    /// Verifies a frame. A frame that breaks its contract has a report that says so
    /// ([`Verdict::Rejected`](crate::Verdict::Rejected)).
    ///
    /// # Errors
    ///
    /// [`Error::CertificateMismatch`] if the given baseline has another number of curves;
    /// [`Error::OpenInFrame`] if a curve is closed there, but open in the frame;
    /// [`Error::NothingClosed`] if no curve is closed and pull-throughs are off, since nothing
    /// would be verified; [`Error::Braid`] if the first frame breaks a condition of the braids. All
    /// frames of the same curves would fail in the same way. [`Error::Cancelled`] after
    /// [`Progress::cancel`]; [`Error::Forked`].
    pub fn verify(&mut self, frame: Received) -> Result<VerifiedFrame> {
        pool::check_process()?;
        let start = Instant::now();
        let (mut info, is_closed) = (frame.info, frame.is_closed);
        let (seq, time) = (info.seq, info.time);
        let mut continuation = Continuation::Continues;
        let outcome = frame.curves.and_then(|set| {
            let closed = match is_closed {
                true => self.check_layout(&info, &set).map(|()| set),
                false => self.close(set, &info),
            };
            self.try_to_verify(&mut info, closed?, &mut continuation)
        });
        let notes = self.closings.end_frame(info.layout, outcome.is_ok());
        let (mut report, curves) = match outcome {
            Ok((report, curves)) => (report, Some(curves)),
            Err(why) => {
                // The next verified frame is cut or accepted in place of this one.
                continuation = Continuation::Continues;
                let why = self.reason_to_reject(why)?;
                (self.engine.reject(seq, time, &why), None)
            }
        };
        let left_out = notes.iter().filter_map(ClosingNote::left_out);
        LeftOut::merge(&mut info.left_out, &Vec::from_iter(left_out));
        report.left_out = info.left_out.clone();
        let mut verified = VerifiedFrame {
            report,
            info,
            curves,
            continuation,
            notes,
            joined: self.closings.joined(),
            jumps: self.coordinates.jumps(),
            unmeasured: self.strands.unmeasured.clone(),
            ingest: frame.took,
            verification: Duration::ZERO,
            timings: Timings::default(),
            work: Default::default(),
            offload: Default::default(),
        };
        if verified.curves.is_some() {
            verified.timings = self.engine.timings();
            verified.timings.clearance = self.strands.took;
            verified.work = self.engine.work();
            verified.offload = self.engine.offload();
        }
        verified.verification = start.elapsed();
        Ok(verified)
    }

    /// Marks the next frame as not continuing the last one, so that no pull-throughs are searched
    /// for between the two. Call this after a gap in the frames; a simulator that rolls back tells
    /// so with the frame ([`FrameInfo::cuts`]).
    pub fn cut(&mut self) {
        if matches!(self.next, Next::ByInfo) {
            self.next = Next::Cut;
        }
    }

    /// Begins another part of the same run, of which frames before it were left out: the next frame
    /// is compared with this baseline, and may have other curves than the last one.
    pub fn begin_part(&mut self, baseline: Certificate) {
        self.begin_part_with(baseline, false);
    }

    /// Same as [`Session::begin_part`], for a recorded baseline, which numbers images as the frames
    /// do.
    #[cfg(feature = "cli")]
    pub(crate) fn begin_recorded_part(&mut self, baseline: Certificate) {
        self.begin_part_with(baseline, true);
    }

    fn begin_part_with(&mut self, certificate: Certificate, names_images: bool) {
        self.closings = Closings::default();
        self.next = Next::Part(PartBaseline {
            certificate,
            names_images,
        });
    }

    /// Begins another run, with the same options: the next frame is its first one.
    pub fn begin_run(&mut self) {
        self.closings = Closings::default();
        self.next = Next::Run;
    }

    /// Begins another run, with another selection of pull-throughs.
    #[cfg(feature = "cli")]
    pub(crate) fn begin_run_with(&mut self, events: Events) {
        self.options.events = events;
        self.begin_run();
    }

    /// Returns the expected linking numbers, or `None` before the first frame.
    pub fn baseline(&self) -> Option<&Certificate> {
        self.engine.baseline().map(|baseline| &**baseline)
    }

    /// Returns the baseline of another session: the expected linking numbers and invariants. `None`
    /// before the first frame.
    pub fn complete_baseline(&self) -> Option<Certificate> {
        self.engine.complete_baseline()
    }

    /// Returns the braids with everything that was found in the first frame, so that other sessions
    /// can close them in the same way. `None` before that frame, or without braids.
    pub fn braids(&self) -> Option<Braids> {
        self.engine.braids()
    }

    /// Shares the progress of another session, and its cancellation.
    #[cfg(feature = "cli")]
    pub(crate) fn share_progress(&mut self, progress: Arc<Progress>) {
        self.engine.share_progress(progress);
    }

    /// Returns the report on a frame that is rejected without being verified, and does not ask the
    /// simulator to stop.
    #[cfg(feature = "cli")]
    pub(crate) fn give_up(&self, seq: u64, time: f64, why: &str) -> Report {
        let mut report = self.engine.reject(seq, time, &Error::Usage(why.into()));
        report.abort = false;
        report
    }

    /// Returns a view of the progress of the current frame.
    pub fn progress(&self) -> Arc<Progress> {
        self.engine.progress()
    }

    /// Announces the frame that comes after the next one. If crossings are counted on a GPU, its
    /// vertices are uploaded while the next frame is verified. This is only a hint: the results are
    /// the same without it, or if another frame follows.
    pub fn announce(&mut self, next: &Received) {
        if let Ok(set) = &next.curves {
            self.engine.announce(set);
        }
    }

    /// Waits until background work has ended, so that the next frame profits from it. For
    /// measurements.
    pub fn settle(&mut self) {
        self.engine.settle();
    }

    /// Returns what a frame says about how its curves are closed.
    fn source(&self, info: &FrameInfo) -> CurveSource {
        let wrapped = self.options.wrapped == Some(true);
        CurveSource {
            cell: self.cell(info).or(info.cell.filter(|_| wrapped)),
            wrapped,
            closed_by_default: info.closed_by_default,
        }
    }

    /// Returns the cell with which a frame is verified.
    fn cell(&self, info: &FrameInfo) -> Option<Cell> {
        let cell = self.options.cell.or(info.cell);
        cell.filter(|_| !self.options.ignore_cell)
    }

    /// Returns the information about the last verified frame, if the next one follows it.
    fn last(&self) -> Option<&FrameInfo> {
        let follows = !matches!(self.next, Next::Part(_) | Next::Run);
        self.last.as_ref().filter(|_| follows)
    }

    /// Returns true if the engine can verify its first frame without being created again.
    fn fits_the_first_frame(&self, info: &FrameInfo) -> bool {
        self.last.is_none() && self.options.cell.is_some() == info.cell.is_some()
    }

    fn close(&mut self, set: Arc<CurveSet>, info: &FrameInfo) -> Result<Arc<CurveSet>> {
        let source = self.source(info);
        if self.closings.known(info.layout).is_none() {
            let stay_open = self.curves_that_stay_open(info, &set);
            self.closings.new = Closing::new(self.options.keep_open).with_open(stay_open);
        }
        let closing = self.closings.of(info.layout);
        Ok(closing.of_set(&set, source)?.map_or(set, Arc::new))
    }

    /// Returns true for each curve of a frame if a curve with the same name and number of points is
    /// open in the last verified frame.
    fn curves_that_stay_open(&self, info: &FrameInfo, set: &CurveSet) -> Vec<bool> {
        let Some((last, (before, _))) = self.last().zip(self.coordinates.last.as_ref()) else {
            return Vec::new();
        };
        let change = CurveChange::by_name(&last.labels, &info.labels);
        let origins = change.map_or_else(|_| Vec::new(), |change| change.origins);
        let is_open = |(origin, count): (Option<u32>, i32)| {
            origin.is_some_and(|k| {
                let curve = before.curve(k as usize);
                !curve.closed && curve.points == count.unsigned_abs()
            })
        };
        origins.into_iter().zip(set.counts()).map(is_open).collect()
    }

    /// Returns an error if the curves of a received frame differ from those of the last verified
    /// frame with the same layout number.
    fn check_layout(&self, info: &FrameInfo, set: &CurveSet) -> Result<()> {
        let is_same = self.last().is_some_and(|last| last.layout == info.layout);
        let Some((before, cell)) = self.coordinates.last.as_ref().filter(|_| is_same) else {
            return Ok(());
        };
        let [of_last, now] = [before, set].map(|set| set.precision());
        let is_widened = cell.is_some() || self.options.wrapped == Some(true);
        match is_widened && (of_last, now) == (Precision::F64, Precision::F32) {
            // Curves that are moved to other images have double precision.
            true => before.check_layout(set.basis(), of_last, set.counts()),
            false => before.check_same_layout(set),
        }
    }

    /// Returns an error if a curve of the first frame is open, but closed in the given baseline.
    fn check_closed(&self, set: &CurveSet) -> Result<()> {
        let baseline = self.options.baseline.as_ref();
        let baseline = baseline.filter(|baseline| baseline.curves == set.len());
        // With braids, open curves have linking numbers, those of their loops.
        let baseline = baseline.filter(|_| self.options.braids.is_none());
        let is_open = |i: u32| !set.curve(i as usize).closed;
        let curve = baseline.and_then(|baseline| baseline.closed_curve_that(is_open));
        curve.map_or(Ok(()), |curve| Err(Error::OpenInFrame { curve }))
    }

    /// Verifies valid curves. Returns the report, and the curves that outputs show.
    fn try_to_verify(
        &mut self,
        info: &mut FrameInfo,
        given: Arc<CurveSet>,
        continuation: &mut Continuation,
    ) -> Result<(Report, Arc<CurveSet>)> {
        if given.is_empty() {
            return Err(Error::Usage("the frame holds no curves".into()));
        }
        let of_frame = info.cell;
        info.cell = self.cell(info);
        let last = self.last();
        let accepted = last.is_some_and(|last| last.baseline != info.baseline);
        let cut = last.is_some_and(|last| last.cuts != info.cuts);
        *continuation = match (accepted, cut) {
            (true, _) => Continuation::Accepted,
            (false, true) => Continuation::Cut,
            (false, false) => Continuation::Continues,
        };
        if last.is_none() && !matches!(self.next, Next::Part(_)) {
            self.check_closed(&given)?;
        }
        let begin = match (&self.next, last) {
            (Next::Part(baseline), _) => Some(Begin::Part(baseline)),
            (Next::ByInfo | Next::Cut, None) if self.fits_the_first_frame(info) => None,
            (_, None) => Some(Begin::First),
            (_, Some(_)) => accepted.then_some(Begin::Accepted),
        };
        let last = last.filter(|_| !accepted);
        if last.is_none_or(|last| !Arc::ptr_eq(&last.labels, &info.labels)) {
            info.labels.check(given.len())?;
        }
        let change = last.map(|last| info.change_since(last)).transpose()?;
        info.cell = check_cell(info.cell, last.map(|last| last.cell))?;
        // A new layout may describe the same curves again. In a cell, all frames have the same
        // curves.
        let before = self.coordinates.last.as_ref().map(|(before, _)| before);
        let have_same_size =
            || before.is_some_and(|before| before.check_same_layout(&given).is_ok());
        let same = |change: &CurveChange| {
            change.is_identity() && (info.cell.is_some() || have_same_size())
        };
        let mut change = change.flatten();
        if let (Some(change), Some(before)) = (&mut change, before) {
            let all = self.options.events == Events::All;
            change.note_kinds(before, &given, &info.labels.names, all);
            let same_kinds = change.opened.is_empty() && change.closed.is_empty();
            if info.cell.is_some() && !same_kinds {
                before.check_same_layout(&given)?;
            }
        }
        let mut change = change.filter(|change| !same(change));
        // A frame that begins a run or a part is verified beside the state of the frames before it,
        // which remains if the frame is rejected.
        let begun = begin.map(|begin| begin.engine(self, info)).transpose()?;
        let mut begun = begun.map(|engine| (engine, self.coordinates.restarted()));
        let (engine, coordinates) = match &mut begun {
            Some((engine, coordinates)) => (engine, coordinates),
            None => (&mut self.engine, &mut self.coordinates),
        };
        let cuts = cut || matches!(self.next, Next::Cut);
        let set = coordinates.place(&given, info, of_frame, self.options.wrapped, cuts)?;
        if let Some(change) = &mut change {
            let returned = change.appeared.iter();
            let returned = returned.filter(|name| self.gone.contains(&hash(name)));
            change.returned = returned.cloned().collect();
        }
        let mut report = engine.verify(NextFrame {
            seq: info.seq,
            time: info.time,
            curves: &set,
            cell: info.cell,
            change: change.as_ref(),
            cut: cuts,
        })?;
        // From here on, the frame cannot be rejected, so state is replaced.
        if let Some(begun) = begun {
            (self.engine, self.coordinates) = begun;
            self.strands = Strands::default();
            if !matches!(self.next, Next::Part(_)) {
                self.gone.clear();
            }
        } else if cuts {
            self.strands.cut();
        }
        if let Some(change) = change {
            self.gone.extend(change.gone.iter().map(hash));
        }
        self.coordinates.commit(&set, info.cell);
        info.translated = self.coordinates.translated();
        self.next = Next::ByInfo;
        report.clearance = self.strands.measure(&self.options, info, &set);
        report.abort = self.engine.aborts(&report);
        self.last = Some(info.clone());
        // Curves that jumped are recorded as given, and their translations separately.
        let unwrapped = self.options.wrapped == Some(true);
        Ok((report, if unwrapped { set } else { given }))
    }

    /// Returns an error as the reason to reject a frame.
    ///
    /// # Errors
    ///
    /// `why` itself, if it concerns the process, or all frames of the same curves.
    fn reason_to_reject(&self, why: Error) -> Result<Error> {
        match why {
            Error::Cancelled | Error::Forked { .. } | Error::Device { .. } => Err(why),
            Error::CertificateMismatch { certificate, model } if self.last().is_some() => {
                Ok(Error::LayoutChanged {
                    what: "number of curves",
                    before: certificate as u64,
                    now: model as u64,
                })
            }
            Error::CertificateMismatch { .. }
            | Error::OpenInFrame { .. }
            | Error::NothingClosed { .. }
            | Error::Braid(_)
                if self.last().is_none() =>
            {
                Err(why)
            }
            why => Ok(why),
        }
    }
}
