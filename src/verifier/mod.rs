//! Verifier: takes frames, returns reports. The only module that knows all stages.
//!
//! It uses no file and no socket, and its clock only measures. Live frames, recordings, model files
//! and tests use it alike.

mod bisect;
mod braided;
mod full;
mod intactness;
mod ladder;
mod options;
mod periodic;
mod routing;
mod steps;
#[cfg(test)]
mod tests;
mod yarns;

pub use bisect::bisect;
pub use intactness::Intactness;
pub use ladder::Ladder;
pub use options::{Strategy, VerifierOptions};

use self::braided::Braided;
use self::full::{FullRun, sizes};
use self::periodic::Periodic;
use self::routing::Routing;
use self::steps::{LinkingNumbers, Steps};
use crate::cancel::{Cancel, PairLimit};
use crate::certificate::{Certificate, Comparison};
use crate::curve::{CurveChange, CurveSet, Image, Positions};
use crate::error::{Error, Result};
use crate::incremental::{Events, Monitor, Outcome, Route, Work};
use crate::ingest::{RawFrame, ingest};
use crate::kernels::{DeviceInfo, GpuUse, Method, Offload, segment_pairs};
use crate::pairs::{Pair, PairFilter, closest_approach};
use crate::pool;
use crate::thickness::ClearanceMonitor;
use crate::verdict::{AbortOn, Clearance, Defect, DefectKind, PullThrough, Report, Stats, Verdict};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Progress of a long run, and a way to cancel it. Shared with other threads, which may show it.
#[derive(Debug, Default)]
pub struct Progress {
    done: AtomicU64,
    total: AtomicU64,
    cancel: Cancel,
    limit: PairLimit,
}

impl Progress {
    /// Returns the number of pairs computed so far, and of all pairs, of the current frame.
    pub fn pairs(&self) -> (u64, u64) {
        (
            self.done.load(Ordering::Relaxed),
            self.total.load(Ordering::Relaxed),
        )
    }

    /// Ends the current step as soon as possible, usually within a tenth of a second. The step
    /// fails with [`Error::Cancelled`], and so does every later step of the verifier. Certificates
    /// ([`Verifier::certify`]) are computed to their end.
    ///
    /// Sums and GPU work are not interrupted; the step ends after them.
    pub fn cancel(&self) {
        self.cancel.set();
    }

    /// Returns true if [`Progress::cancel`] was called.
    pub fn is_cancelled(&self) -> bool {
        self.cancel.is_set()
    }

    /// Returns an error if the results of this frame are incomplete.
    fn check(&self) -> Result<()> {
        if self.is_cancelled() {
            return Err(Error::Cancelled);
        }
        match self.limit.is_exceeded() {
            true => Err(Error::TooManyPairs {
                limit: self.limit.most() as u64,
            }),
            false => Ok(()),
        }
    }
}

/// Time that each stage of the last frame took. Not part of a [`Report`], because reports do not
/// depend on the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Timings {
    /// Time of the boxes of all segments, and of the trees over them.
    pub boxes: Duration,
    /// Time of the search for potential links.
    pub pairs: Duration,
    /// Time of the discretization and the linking numbers of all potential links.
    pub links: Duration,
    /// Time of the search for pull-throughs.
    pub events: Duration,
    /// Time of the clearance.
    pub clearance: Duration,
    /// Total time, comparison included.
    pub total: Duration,
}

impl Timings {
    /// Adds the times of another verifier of the same frame.
    fn add(&mut self, inner: &Timings) {
        self.boxes += inner.boxes;
        self.pairs += inner.pairs;
        self.links += inner.links;
        self.events += inner.events;
    }
}

/// Verifies successive frames against a baseline. Its buffers are reused for every frame.
///
/// The result does not depend on the number of threads of the rayon pool in which it is called.
#[derive(Debug)]
pub struct Verifier {
    abort_on: AbortOn,
    max_pairs: usize,
    /// [`VerifierOptions::wrapped`].
    wrapped: Option<bool>,
    baseline: Option<Certificate>,
    strategy: Strategy,
    full: FullRun,
    monitor: Monitor,
    steps: Steps,
    routing: Routing,
    work: Work,
    /// Frame at the start of the next step.
    previous: Option<u64>,
    /// Frame at the start of the step to the current frame.
    step_from: Option<u64>,
    /// True if the baseline changed since it was last taken.
    baseline_changed: bool,
    /// Reason why the step to the next frame is unknown, if it is.
    unknown_step: Option<String>,
    /// Pairs of curves that are verified; `None`: all.
    filter: Option<PairFilter>,
    /// Options with braids, until the first frame.
    with_braids: Option<Box<VerifierOptions>>,
    /// Loops of the braids, from the first frame on.
    braided: Option<Braided>,
    /// Options, until the first frame, which may have a cell.
    fresh: Option<Box<VerifierOptions>>,
    /// Verifies the periodic images of the curves, if there is a cell.
    periodic: Option<Box<Periodic>>,
    /// Expected linking numbers, those of loops or of images included, if there are any.
    joined: Option<Certificate>,
    /// Measures the clearance; `None` if nobody asked for it, or it failed.
    clearance: Option<ClearanceMonitor>,
    /// Reason why the clearance is not measured, although somebody asked for it.
    unmeasured: Option<String>,
    /// Extent of the first frame.
    extent: Option<f64>,
    /// Change of the curves from the last verified frame to the next one.
    change: Option<CurveChange>,
    /// Curves that appeared in the current frame, sorted. Their linking numbers are not in the
    /// baseline yet.
    appeared: Vec<u32>,
    /// Baseline before the current frame, if that replaced it.
    replaced: Option<Option<Certificate>>,
}

/// Result of comparing a frame with the baseline.
struct Compared {
    linking: LinkingNumbers,
    stats: Stats,
    /// Outcome of the step from the previous frame, if it was searched.
    step: Option<Outcome>,
}

/// Pull-throughs since the previous frame.
#[derive(Default)]
struct Motion {
    events: Vec<PullThrough>,
    unresolved: Vec<PullThrough>,
    /// See [`Report::safe_fraction`].
    safe_fraction: Option<f64>,
}

impl Default for Verifier {
    /// Creates a verifier with the default options.
    fn default() -> Self {
        Verifier::with_gpu(VerifierOptions::default(), GpuUse::default())
    }
}

impl Verifier {
    /// Creates a verifier and opens its device.
    ///
    /// Errors: [`Error::Usage`] if an option has an invalid value, or excludes another one;
    /// [`Error::Device`] if no adapter matches, or it cannot be used.
    pub fn new(options: VerifierOptions) -> Result<Self> {
        pool::check_process()?;
        options.check()?;
        let gpu = GpuUse::open(&options.device)?;
        Ok(Verifier::with_gpu(options, gpu))
    }

    /// Creates a verifier whose kernels run on an adapter that is open already.
    pub(crate) fn with_gpu(options: VerifierOptions, gpu: GpuUse) -> Self {
        let full = FullRun::new((options.kernel, options.accuracy), gpu);
        let with_braids = options.braids.is_some();
        let with_braids = with_braids.then(|| Box::new(options.clone()));
        let periodic = options
            .cell
            .map(|cell| Box::new(Periodic::new(cell, &options)));
        let fresh = periodic.is_none().then(|| Box::new(options.clone()));
        let limit = options
            .motion_limit
            .unwrap_or(VerifierOptions::MOTION_LIMIT);
        let ends = (full.progress.cancel.clone(), full.progress.limit.clone());
        let incremental = options.strategy.is_incremental();
        // The baseline of a periodic scene is divided once the names of its images are known.
        let baseline = options.baseline.filter(|_| periodic.is_none());
        let steps = Steps::new(options.events, incremental, limit, ends);
        Verifier {
            abort_on: options.abort_on,
            max_pairs: options.max_pairs,
            wrapped: options.wrapped,
            baseline,
            strategy: options.strategy,
            full,
            monitor: Monitor::new(steps.coverage(), None),
            steps,
            routing: Routing::default(),
            work: Work::default(),
            previous: None,
            step_from: None,
            baseline_changed: true,
            unknown_step: None,
            filter: None,
            with_braids,
            braided: None,
            fresh,
            periodic,
            joined: None,
            clearance: options.clearance.map(ClearanceMonitor::new),
            unmeasured: None,
            extent: None,
            change: None,
            appeared: Vec::new(),
            replaced: None,
        }
    }

    fn set_filter(&mut self, filter: Option<PairFilter>) {
        self.full.set_filter(filter.clone());
        self.steps.set_filter(filter.clone());
        self.monitor = Monitor::new(self.steps.coverage(), filter.clone());
        self.filter = filter;
    }

    /// Sets the radius of each curve, in the units of the simulation, if clearance is measured with
    /// the radii of the curves ([`ClearanceOptions`](crate::ClearanceOptions)).
    ///
    /// Errors: [`Error::Usage`] if a radius is not a positive length. Clearance is not measured
    /// from then on.
    pub fn set_radii(&mut self, radii: &[f32]) -> Result<()> {
        let Some(clearance) = &mut self.clearance else {
            return Ok(());
        };
        clearance.set_radii(radii).inspect_err(|e| {
            self.unmeasured = Some(e.to_string());
            self.clearance = None;
        })
    }

    /// Returns the reason why clearance is not measured, although the options ask for it.
    pub fn unmeasured_clearance(&self) -> Option<&str> {
        self.unmeasured.as_deref()
    }

    /// Returns which linking numbers of the last full run were decided by sums, and which by
    /// counting.
    pub fn ladder(&self) -> Ladder {
        self.full.ladder
    }

    /// Returns the number of segment pairs in the last potential links: the work of sums without
    /// trees. `set` must be the set of those links, or its polylines.
    pub fn segment_pairs(&self, set: &CurveSet) -> u64 {
        segment_pairs(set, self.full.pairs())
    }

    /// Returns the GPU in use. With [`Device::Auto`](crate::kernels::Device::Auto), `None` until it
    /// was chosen.
    pub fn device(&self) -> Option<DeviceInfo> {
        self.full.gpu.info()
    }

    /// Returns the work that the GPU did in the last frame.
    pub fn offload(&self) -> Offload {
        self.full.gpu.offload()
    }

    /// Returns the work of the last frame.
    pub fn work(&self) -> Work {
        self.work
    }

    /// Returns the baseline, or `None` before the first frame.
    pub fn baseline(&self) -> Option<&Certificate> {
        self.joined.as_ref().or(self.baseline.as_ref())
    }

    /// Returns the baseline, if it changed since the last call. Call this after a frame that was
    /// not rejected.
    pub fn take_changed_baseline(&mut self) -> Option<&Certificate> {
        let changed = std::mem::take(&mut self.baseline_changed);
        self.baseline().filter(|_| changed)
    }

    /// Returns what is known about the last intact frame.
    pub fn intactness(&self) -> Intactness {
        *self.steps.intactness()
    }

    /// Continues in the place of another verifier of the same frames, which has ended. Its
    /// baseline is given as [`VerifierOptions::baseline`]. Call this before the first frame.
    ///
    /// If pull-throughs are searched for, it is unknown what happened in the step to the next
    /// frame. That frame is therefore not intact, and [`Report::missing`] gives the reason `why`,
    /// unless [it does not continue](Verifier::cut) the previous one.
    ///
    /// ```
    /// use linkwatch::scenes::Scene;
    /// use linkwatch::{Events, Verdict, Verifier, VerifierOptions};
    ///
    /// let set = "chainmail:rows=2,columns=2".parse::<Scene>()?.build()?.curves;
    /// let mut options = VerifierOptions { events: Events::Between, ..Default::default() };
    /// let mut first = Verifier::new(options.clone())?;
    /// first.step(0, 0.0, &set)?;
    ///
    /// options.baseline = first.baseline().cloned();
    /// let mut second = Verifier::new(options)?;
    /// second.resume(first.intactness(), "the first verifier was killed".into());
    /// let report = second.step(7, 0.7, &set)?;
    /// assert_eq!((report.verdict, report.last_intact), (Verdict::Undecided, Some(0)));
    /// # Ok::<(), linkwatch::Error>(())
    /// ```
    pub fn resume(&mut self, intactness: Intactness, why: String) {
        self.steps.resume(intactness);
        self.unknown_step = (self.steps.events() != Events::Off).then_some(why);
    }

    /// Returns a view of the progress of the current frame.
    pub fn progress(&self) -> Arc<Progress> {
        Arc::clone(&self.full.progress)
    }

    /// Returns the times of the last frame.
    pub fn timings(&self) -> Timings {
        self.full.timings
    }

    /// Computes all linking numbers of a frame.
    ///
    /// # Panics
    /// In a process that was forked from one that used the library ([`Error::Forked`]), because the
    /// call would never return.
    pub fn certify(&mut self, set: &CurveSet) -> (&Certificate, Stats) {
        pool::check_process().unwrap_or_else(|forked| panic!("{forked}"));
        let start = Instant::now();
        self.full.heed_cancel(false);
        self.full.progress.limit.begin(usize::MAX);
        let stats = pool::run(set.segments(), || self.full.certify(set));
        self.full.timings.total = start.elapsed();
        (&self.full.certificate, stats)
    }

    /// Computes the linking numbers of a frame of polylines that do not change if every vertex
    /// moves within a cube of half-width `noise` around its position (Arai 2013, remark 4). Pairs
    /// that may touch within the noise have no linking number; their defect names two segments.
    ///
    /// Errors: [`Error::Usage`] for splines, if `noise` is not a length, or if the verifier has a
    /// kernel other than [`Method::Auto`].
    pub fn certify_noisy(&mut self, set: &CurveSet, noise: f64) -> Result<(&Certificate, Stats)> {
        let method = self.full.method();
        if method != Method::Auto {
            let what = format!("noise excludes the kernel {method}: it has a kernel of its own");
            return Err(Error::Usage(what));
        }
        if !set.basis().is_polyline() {
            let what = "noise applies to the vertices of polylines; these curves are splines";
            return Err(Error::Usage(what.into()));
        }
        if !(noise >= 0.0 && noise.is_finite()) {
            let what = format!("noise of {noise}, expected a length of at least 0");
            return Err(Error::Usage(what));
        }
        let start = Instant::now();
        self.full.heed_cancel(false);
        self.full.progress.limit.begin(usize::MAX);
        let stats = self.full.certify_noisy(set, noise);
        self.full.timings.total = start.elapsed();
        Ok((&self.full.certificate, stats))
    }

    /// Waits until background work has ended, so that the next frame profits from it. For
    /// measurements.
    pub fn settle(&mut self) {
        self.monitor.wait_for_reference();
        if let Some(inner) = self
            .periodic
            .as_mut()
            .and_then(|images| images.inner_verifier())
        {
            inner.settle();
        }
    }

    /// Copies a frame that will be verified into `set`: the first frame creates the set, and every
    /// later one of the same curves updates it. The frame may be in memory that another process
    /// writes: the copy is checked, and all results are those of the copy.
    ///
    /// If the frame is verified incrementally, the same pass compares it with the reference frame,
    /// so that [`Verifier::step_shared`] need not read a quiet frame again. Several frames may be
    /// received before they are verified.
    ///
    /// Errors: the frame breaks its contract, as told by [`Verifier::reject`]: a number that is not
    /// finite ([`Error::NotFinite`]) or too large, too few points of a curve
    /// ([`Error::CurveTooShort`]) or of all ([`Error::Count`]), or curves other than those of `set`
    /// ([`Error::LayoutChanged`]). The next valid frame makes an existing set valid again.
    ///
    /// ```
    /// use linkwatch::{Basis, Positions, RawFrame, Verdict, Verifier};
    /// use std::sync::Arc;
    ///
    /// let square = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    /// let (mut verifier, mut set) = (Verifier::default(), None);
    /// let frame = RawFrame {
    ///     basis: Basis::Polyline,
    ///     counts: &[-4],
    ///     positions: Positions::F64(&square),
    /// };
    /// verifier.receive(frame, &mut set)?;
    /// let set = Arc::new(set.expect("the first frame creates the set"));
    /// assert_eq!(verifier.step_shared(0, 0.0, &set)?.verdict, Verdict::Intact);
    /// # Ok::<(), linkwatch::Error>(())
    /// ```
    pub fn receive(&mut self, frame: RawFrame<'_>, set: &mut Option<CurveSet>) -> Result<()> {
        pool::check_process()?;
        ingest(frame, set, |set, positions| self.update(set, positions))
    }

    /// Replaces the positions of a set by those of the next frame, for [`Verifier::receive`].
    fn update(&mut self, set: &mut CurveSet, positions: Positions<'_>) -> Result<()> {
        match self.strategy.is_incremental() {
            true => self.monitor.receive(set, positions),
            false => set.update(positions),
        }
    }

    /// Verifies one frame. Without a baseline, the first frame becomes the baseline.
    ///
    /// If pull-throughs are reported, or the frame is verified incrementally, the positions are
    /// copied, to compare them with the next frame; [`Verifier::step_shared`] needs no copy.
    ///
    /// Errors: [`Error::CertificateMismatch`] if the baseline has another number of curves;
    /// [`Error::NothingClosed`] if no curve is closed and pull-throughs are off, since nothing
    /// would be verified; [`Error::LayoutChanged`] if pull-throughs are reported and the curves
    /// differ from those of the previous frame; [`Error::TooManyPairs`] if more pairs of curves
    /// come close than [`VerifierOptions::max_pairs`]; [`Error::Cancelled`] after
    /// [`Progress::cancel`].
    pub fn step(&mut self, seq: u64, time: f64, set: &CurveSet) -> Result<Report> {
        if self.periodic.is_some() || self.wrapped.is_some() {
            return self.step_shared(seq, time, &Arc::new(set.clone()));
        }
        let verified = self.verify(seq, time, set);
        self.full.gpu.end_frame(set);
        let (report, linking) = verified?;
        self.steps.remember_copy(set, linking);
        Ok(report)
    }

    /// Same as [`Verifier::step`], for a frame that the caller shares until the next one is
    /// verified.
    pub fn step_shared(&mut self, seq: u64, time: f64, set: &Arc<CurveSet>) -> Result<Report> {
        let placed = self.place(set)?;
        let set = placed.as_ref().unwrap_or(set);
        if let Some(periodic) = &mut self.periodic {
            periodic.receive(set);
        }
        let verified = self.verify(seq, time, set);
        self.full.gpu.end_frame(set);
        let (report, linking) = verified?;
        if let Some(periodic) = &mut self.periodic {
            periodic.commit();
        }
        self.steps.remember(Arc::clone(set), linking);
        Ok(report)
    }

    /// Marks the next frame as not continuing the previous one, so that the verifier does not
    /// search for pull-throughs between the two. Call this after a rollback, a restart or a cut of
    /// the simulation.
    ///
    /// Linking numbers are still compared with the baseline. Frames from the next one on count as
    /// known to be intact again ([`Report::last_intact`]).
    pub fn cut(&mut self) {
        self.previous = None;
        self.unknown_step = None;
        self.steps.forget();
        if let Some(braided) = &mut self.braided {
            braided.inner.cut();
        }
        if let Some(periodic) = &mut self.periodic {
            periodic.cut();
        }
        if let Some(clearance) = &mut self.clearance {
            clearance.forget();
        }
    }

    /// Begins again with another baseline. The next frame does not continue the previous ones, and
    /// may have other curves, as after a part of a recording that was left out.
    pub fn restart(&mut self, baseline: Certificate) {
        self.cut();
        self.steps.restart();
        match (&mut self.periodic, &mut self.braided) {
            (Some(periodic), _) => {
                // Divided in the next frame.
                periodic.restart(baseline);
                (self.baseline, self.joined) = (None, None);
            }
            (None, Some(braided)) => {
                braided.restart(&baseline);
                self.baseline = Some(braided.without_loops(&baseline));
                self.joined = Some(baseline);
            }
            (None, None) => {
                if let Some(options) = &mut self.with_braids {
                    options.baseline = Some(baseline.clone());
                }
                self.baseline = Some(baseline);
            }
        }
        self.baseline_changed = true;
        self.change = None;
        self.appeared.clear();
        self.set_filter(self.filter.clone());
    }

    /// Announces that the next frame has other curves than the last one that was verified. A change
    /// stays announced until a frame is verified, or another one, or `None`, replaces it.
    ///
    /// Linking numbers of curves that continue are compared with the baseline, and pull-throughs
    /// among those that continue with the same number of points are searched for, if the verifier
    /// searches for any. The linking numbers of curves that appear become part of the baseline in
    /// the next frame; [`Report::appeared`] and [`Report::gone`] list the curves by name.
    ///
    /// ```
    /// use linkwatch::{Basis, CurveChange, CurveLabels, CurveSet, Positions, Verdict, Verifier};
    ///
    /// let square = |x: f64| [x, 0., 0., x + 1., 0., 0., x + 1., 1., 0., x, 1., 0.];
    /// let mut verifier = Verifier::default();
    /// let one = CurveSet::from_counts(Basis::Polyline, &[-4], Positions::F64(&square(0.)))?;
    /// assert_eq!(verifier.step(0, 0.0, &one)?.verdict, Verdict::Intact);
    ///
    /// let both = [square(5.0), square(0.0)].concat();
    /// let two = CurveSet::from_counts(Basis::Polyline, &[-4, -4], Positions::F64(&both))?;
    /// let names = [CurveLabels::named(["a"]), CurveLabels::named(["b", "a"])];
    /// verifier.change_curves(CurveChange::by_name(&names[0], &names[1])?);
    /// let report = verifier.step(1, 0.1, &two)?;
    /// assert_eq!((report.verdict, report.appeared), (Verdict::Intact, vec!["b".to_owned()]));
    /// # Ok::<(), linkwatch::Error>(())
    /// ```
    pub fn change_curves(&mut self, change: impl Into<Option<CurveChange>>) {
        self.change = change.into();
    }

    /// Applies the change of the curves before this frame.
    ///
    /// Errors: [`Error::CertificateMismatch`] if the baseline has another number of curves than the
    /// change; [`Error::Count`] if this frame has.
    fn apply_change(&mut self, set: &CurveSet) -> Result<()> {
        let Some(change) = self.change.clone() else {
            return Ok(());
        };
        if self.with_braids.is_some() || self.braided.is_some() {
            let what = "curves appeared or are gone, but braids need the same curves in all frames";
            return Err(Error::Braid(what.into()));
        }
        if self.periodic.is_some() {
            let what = "curves appeared or are gone, but a periodic scene needs the same curves in \
                        all frames";
            return Err(Error::Usage(what.into()));
        }
        let origins = change.origins();
        if origins.len() != set.len() {
            return Err(Error::Count {
                what: "curves of a frame after a change",
                promised: origins.len() as u64,
                available: set.len() as u64,
            });
        }
        self.keep_baseline();
        if let Some(baseline) = &mut self.baseline {
            if baseline.curves != change.before() {
                return Err(Error::CertificateMismatch {
                    certificate: baseline.curves,
                    model: change.before(),
                });
            }
            *baseline = baseline.with_curves(origins);
            self.baseline_changed = true;
            let appeared = (0_u32..)
                .zip(origins)
                .filter(|(_, origin)| origin.is_none());
            self.appeared = appeared.map(|(i, _)| i).collect();
        }
        self.set_filter(self.filter.clone());
        self.steps.change_curves(origins, set);
        Ok(())
    }

    /// Announces the frame that comes after the next one. If crossings are counted on a GPU, its
    /// vertices are uploaded while the next frame is verified. This is only a hint: the results are
    /// the same without it, or if another frame follows.
    pub fn announce(&mut self, next: &Arc<CurveSet>) {
        self.full.gpu.announce(next);
    }

    /// Returns the report on a frame, and its linking numbers. A frame that is rejected leaves the
    /// state as it was.
    fn verify(&mut self, seq: u64, time: f64, set: &CurveSet) -> Result<(Report, LinkingNumbers)> {
        pool::check_process()?;
        let (touching, changed) = (self.steps.touching(), self.baseline_changed);
        let verified = self.try_to_verify(seq, time, set);
        let replaced = self.replaced.take();
        if verified.is_ok() {
            (self.fresh, self.with_braids, self.change) = (None, None, None);
            return verified;
        }
        if let Some(baseline) = replaced {
            self.baseline = baseline;
            if let Some(baseline) = &self.baseline {
                self.monitor.set_baseline(baseline);
            }
        }
        if self.with_braids.is_some() {
            self.braided = None;
        }
        self.appeared.clear();
        self.baseline_changed = changed;
        self.steps.roll_back(touching);
        verified
    }

    /// Keeps the baseline before it is replaced.
    fn keep_baseline(&mut self) {
        if self.replaced.is_none() {
            self.replaced = Some(self.baseline.clone());
        }
    }

    fn try_to_verify(
        &mut self,
        seq: u64,
        time: f64,
        set: &CurveSet,
    ) -> Result<(Report, LinkingNumbers)> {
        self.apply_change(set)?;
        if let Some(b) = self.baseline.as_ref().filter(|b| b.curves != set.len()) {
            return Err(Error::CertificateMismatch {
                certificate: b.curves,
                model: set.len(),
            });
        }
        self.divide_baseline(set)?;
        if let Some(options) = &self.with_braids {
            let braided = Braided::new(set, options, self)?;
            self.keep_baseline();
            self.baseline = self.baseline.take().map(|b| braided.without_loops(&b));
            self.braided = Some(braided);
        }
        let closed = set.open_curves() < set.len() || self.braided.is_some();
        if !closed && self.steps.events() == Events::Off {
            let yarns = self.periodic.as_deref();
            return Err(Error::NothingClosed {
                curves: set.len(),
                yarns: yarns.map_or(0, |periodic| periodic.count_yarns(set)),
            });
        }
        self.steps.begin(set)?;
        self.full.progress.limit.begin(self.max_pairs);
        let start = Instant::now();
        self.full.heed_cancel(true);
        self.work = Work::default();
        // A partial run does not start all stages.
        self.full.timings = Timings::default();
        // Needed here, because a partial run does not start the frame.
        self.full.gpu.start_frame();
        let not_taken = std::mem::take(&mut self.baseline_changed);
        let compared = self.compare(set);
        if self.baseline_changed
            && let Some(periodic) = &mut self.periodic
        {
            periodic.outdate();
        }
        self.baseline_changed |= not_taken;
        let Compared {
            mut linking,
            stats,
            step,
        } = compared?;
        let comparison = &mut linking.comparison;
        self.add_places(set, comparison);
        let mut defects = comparison.defects.clone();
        let Motion {
            events,
            unresolved,
            safe_fraction,
        } = self.search_events(set, step, comparison, &mut defects);
        // A report must not depend on work that was skipped.
        self.full.progress.check()?;
        let extent = self.extent.unwrap_or_else(|| set.extent());
        let change = self.change.as_ref();
        let appeared = change.map_or_else(Vec::new, |change| change.appeared().to_vec());
        let gone = change.map_or_else(Vec::new, |change| change.gone().to_vec());
        let mut missing: Vec<String> = self.unknown_step.iter().cloned().collect();
        let unknown = !missing.is_empty();
        let loops = self.verify_loops((seq, time), set, &mut missing)?;
        // A curve may have passed a virtual connection.
        let unknown = unknown || self.braided.is_some() && loops.is_none();
        let images = self.verify_images((seq, time), &mut missing)?;
        // From here on, the frame is not rejected.
        if let Some(clearance) = self.clearance.as_mut().filter(|_| self.change.is_some()) {
            clearance.forget();
        }
        self.extent = Some(extent);
        self.unknown_step = None;
        // A step across a change of the images may be unknown.
        let unknown = unknown || images.as_ref().is_some_and(|images| images.unknown);
        let mut report = Report {
            changes: comparison.changes.clone(),
            events,
            unresolved,
            defects,
            adopted: comparison.adopted.clone(),
            safe_fraction,
            appeared,
            gone,
            missing,
            stats: Stats { extent, ..stats },
            clearance: self.measure_clearance(seq, set),
            ..Report::new(seq, time, Verdict::Intact)
        };
        if let Some(loops) = loops {
            self.add_loops(&mut report, loops);
        }
        if let Some(images) = images {
            self.add_images(&mut report, images);
            let yarns = self.joined.as_ref().map_or(0, |b| b.periods.len());
            report.stats.open_curves -= yarns as u64;
        }
        if let Some(braided) = &self.braided {
            report.stats.open_curves = braided.open_curves(set);
        }
        report.verdict = report.verdict_of_findings();
        self.steps.conclude(&mut report, unknown);
        // Curves that have touched since the baseline do not ask the simulator to stop.
        let baseline = self.baseline();
        let expected = |d: &Defect| {
            if d.image != Image::default() {
                let periodic = self.periodic.as_ref();
                return periodic.is_some_and(|periodic| periodic.expects(d));
            }
            baseline.is_some_and(|b| b.lacks(d.i, d.j)) || self.steps.touch_from_the_start(d.i, d.j)
        };
        report.abort = self.abort_on.aborts(&report, expected);
        self.full.timings.total = start.elapsed();
        self.step_from = self.previous.replace(seq);
        Ok((report, linking))
    }

    /// Measures the clearance of a frame. If that fails, no later frame is measured.
    fn measure_clearance(&mut self, seq: u64, set: &CurveSet) -> Option<Clearance> {
        let cell = self.cell();
        let monitor = self.clearance.as_mut()?;
        let start = Instant::now();
        let measured = monitor.measure(set, cell.as_ref(), seq);
        self.full.timings.clearance = start.elapsed();
        match measured {
            Ok(clearance) => Some(clearance),
            Err(e) => {
                tracing::warn!("clearance is not measured from frame {seq} on: {e}");
                self.unmeasured = Some(e.to_string());
                self.clearance = None;
                None
            }
        }
    }

    /// Compares a frame with the baseline, by the strategy of the verifier.
    fn compare(&mut self, set: &CurveSet) -> Result<Compared> {
        let mut compared = self.compare_with_baseline(set)?;
        if self.strategy.is_incremental() {
            // The work depends on earlier frames, so only the sizes are counted.
            compared.stats = sizes(set);
            self.offer_reference(set, &compared.linking);
        }
        Ok(compared)
    }

    fn compare_with_baseline(&mut self, set: &CurveSet) -> Result<Compared> {
        if !self.appeared.is_empty() {
            let stats = self.certify_fully(set)?;
            self.keep_baseline();
            let certificate = &self.full.certificate;
            let baseline = self
                .baseline
                .as_mut()
                .expect("curves appear beside a baseline");
            baseline.adopt_curves(&std::mem::take(&mut self.appeared), certificate);
            let comparison = certificate.compare(baseline)?;
            baseline.adopt(&comparison);
            self.baseline_changed = true;
            return Ok(self.of_full_run(comparison, stats));
        }
        let Some(baseline) = self.baseline.take() else {
            self.keep_baseline();
            let stats = self.certify_fully(set)?;
            let baseline = self.full.certificate.clone();
            let comparison = baseline.compare(&baseline);
            self.baseline = Some(baseline);
            self.baseline_changed = true;
            return Ok(self.of_full_run(comparison?, stats));
        };
        let compared = match self.strategy {
            Strategy::Full => self.compare_fully(set, &baseline),
            Strategy::EarlyExit => {
                let compared = self.full.compare_until_change(set, &baseline);
                compared.map(|(comparison, stats)| self.of_full_run(comparison, stats))
            }
            Strategy::Incremental | Strategy::Paranoid => {
                self.compare_incrementally(set, &baseline)
            }
        };
        self.baseline = Some(baseline);
        let compared = compared?;
        // Pairs that are missing must not become part of the baseline.
        self.full.progress.check()?;
        // With early exit, unchecked pairs have no linking number yet.
        if compared.stats.unchecked == 0 && compared.linking.comparison.has_fresh() {
            self.keep_baseline();
            let baseline = self.baseline.as_mut().expect("inserted above");
            baseline.adopt(&compared.linking.comparison);
            self.monitor.set_baseline(baseline);
            self.baseline_changed = true;
        }
        Ok(compared)
    }

    /// Makes a frame the reference frame, if that may pay.
    fn offer_reference(&mut self, set: &CurveSet, linking: &LinkingNumbers) {
        if let Some(certificate) = &linking.certificate
            && self.monitor.wants_reference()
        {
            let certificate = Arc::clone(certificate);
            self.monitor.make_reference(set.clone(), certificate);
        }
    }

    /// Returns the result of a full run.
    fn of_full_run(&self, comparison: Comparison, stats: Stats) -> Compared {
        let keeps = self.strategy.is_incremental();
        let certificate = keeps.then(|| Arc::new(self.full.certificate.clone()));
        Compared {
            linking: LinkingNumbers {
                comparison,
                certificate,
            },
            stats,
            step: None,
        }
    }

    fn compare_fully(&mut self, set: &CurveSet, baseline: &Certificate) -> Result<Compared> {
        let stats = self.certify_fully(set)?;
        let comparison = self.full.certificate.compare(baseline)?;
        Ok(self.of_full_run(comparison, stats))
    }

    /// Computes a frame in full, and records the number of pairs decided by sums.
    fn certify_fully(&mut self, set: &CurveSet) -> Result<Stats> {
        let start = Instant::now();
        let stats = pool::run(set.segments(), || self.full.certify(set));
        self.full.progress.check()?;
        self.routing.took_full_run(start.elapsed());
        self.work.recomputed = stats.potential_links;
        self.work.summed = self.full.ladder.summed;
        Ok(stats)
    }

    /// Compares a frame with the baseline. Computes only linking numbers that neither the reference
    /// frame nor the step from the previous frame proves.
    fn compare_incrementally(
        &mut self,
        set: &CurveSet,
        baseline: &Certificate,
    ) -> Result<Compared> {
        let before = self.steps.before();
        let quiet = self.monitor.is_quiet(before, set, baseline, &mut self.work);
        let compared = match self.monitor.reference_result().filter(|_| quiet) {
            Some((certificate, comparison)) => Compared {
                linking: LinkingNumbers {
                    comparison: comparison.clone(),
                    certificate: Some(Arc::clone(certificate)),
                },
                stats: Stats::default(),
                step: None,
            },
            None => match self.compare_by_step(set, baseline)? {
                Some(compared) => compared,
                None => return self.compare_fully(set, baseline),
            },
        };
        if self.strategy == Strategy::Paranoid {
            let stats = self.full.certify(set);
            self.full.progress.check()?;
            let full = self.full.certificate.compare(baseline)?;
            if full != compared.linking.comparison {
                self.disagree();
            }
            let step = compared.step;
            let full = self.of_full_run(full, stats);
            return Ok(Compared { step, ..full });
        }
        Ok(compared)
    }

    /// Compares a frame with the baseline, by a search of the step from the previous frame: the
    /// linking number of a pair without a passage or a contact has not changed. Returns `None` if
    /// the previous frame does not help, or if a full run costs less.
    fn compare_by_step(
        &mut self,
        set: &CurveSet,
        baseline: &Certificate,
    ) -> Result<Option<Compared>> {
        let start = Instant::now();
        let Some(certificate) = self.steps.known(set) else {
            return Ok(None);
        };
        let pairs = self.pairs_to_search(set);
        let all = pairs.is_none();
        if all && self.steps.events() == Events::Off && !self.routing.search_pays() {
            return Ok(None);
        }
        let step = self.search_step(set, pairs);
        self.full.progress.check()?;
        let closed = |i: u32| set.curve(i as usize).closed;
        let unsettled = step.unsettled_pairs();
        let unsettled = unsettled.filter(|&(i, j)| i != j && closed(i) && closed(j));
        // Nothing is known about pairs that had no linking number.
        let undefined = &certificate.undefined;
        let unknown = undefined.iter().filter_map(|d| Some((d.i, d.j?)));
        let mut pairs: Vec<Pair> = unsettled.chain(unknown).collect();
        pairs.sort_unstable();
        pairs.dedup();
        self.work.route = Route::Partial;
        self.work.recomputed = pairs.len() as u64;
        let certificate = if pairs.is_empty() {
            certificate
        } else {
            let recomputed = self.full.certify_pairs(set, &pairs);
            self.full.progress.check()?;
            Arc::new(certificate.with_replaced(&pairs, &recomputed))
        };
        let linking = LinkingNumbers {
            comparison: certificate.compare(baseline)?,
            certificate: Some(certificate),
        };
        if all {
            self.routing.took_search(start.elapsed());
        }
        Ok(Some(Compared {
            linking,
            stats: Stats::default(),
            step: Some(step),
        }))
    }

    /// Records an error of the incremental verification, and switches it off.
    fn disagree(&mut self) {
        self.work.disagreed = true;
        self.strategy = Strategy::Full;
    }

    /// Adds the places of closest approach of changed pairs, and of pairs that the baseline lacks.
    fn add_places(&mut self, set: &CurveSet, comparison: &mut Comparison) {
        let Comparison {
            changes, defects, ..
        } = comparison;
        let fresh = |d: &&mut Defect| d.kind == DefectKind::NoBaseline;
        let mut fresh: Vec<&mut Defect> = defects.iter_mut().filter(fresh).collect();
        if changes.is_empty() && fresh.is_empty() {
            return;
        }
        // Trees that the frame did not need may be those of an earlier frame: after a partial run,
        // and if only some pairs are verified.
        if self.work.route != Route::Full || self.filter.is_some() {
            let changed = changes.iter().map(|c| (c.i, c.j));
            let fresh = fresh.iter().filter_map(|d| Some((d.i, d.j?)));
            self.full
                .refit(set, &changed.chain(fresh).collect::<Vec<Pair>>());
        }
        let trees = self.full.trees();
        let cancel = &self.full.progress.cancel;
        let place = |i: u32, j: u32| {
            let (i, j) = (i as usize, j as usize);
            // Open curves have no tree. They have no linking number either, so their only change is
            // a lost link.
            let exists = !cancel.is_set() && set.curve(i).closed && set.curve(j).closed;
            exists.then(|| closest_approach(set, trees, i, j))
        };
        changes
            .par_iter_mut()
            .for_each(|c| c.place = place(c.i, c.j));
        fresh.par_iter_mut().for_each(|d| match d.j {
            Some(j) => d.place = place(d.i, j).unwrap_or(d.place),
            None => d.place.point = set.point(d.i as usize, 0),
        });
    }

    /// Returns the pairs for which the reference frame does not exclude passages since the previous
    /// frame, or `None` if that may be any pairs.
    fn pairs_to_search(&mut self, set: &CurveSet) -> Option<Vec<Pair>> {
        if !self.strategy.is_incremental() {
            return None;
        }
        let before = self.steps.before()?;
        self.monitor.pairs_to_search(before, set, &mut self.work)
    }

    /// Searches the step from the previous frame: these pairs, or all.
    fn search_step(&mut self, set: &CurveSet, pairs: Option<Vec<Pair>>) -> Outcome {
        let start = Instant::now();
        let mut outcome = self.steps.outcome(set, pairs.as_deref());
        self.full.timings.events += start.elapsed();
        self.work.searched = outcome.counts.pairs;
        if self.strategy == Strategy::Paranoid && pairs.is_some() {
            let full = self.steps.outcome(set, None);
            let findings = |o: Outcome| (o.events, o.unresolved, o.undecided, o.touching);
            if findings(full.clone()) != findings(outcome) {
                self.disagree();
            }
            outcome = full;
        }
        outcome
    }

    /// Returns the pull-throughs since the previous frame, if they are reported. Adds undecided
    /// pairs of the step to the defects. `step` is the outcome of the step, if it was searched
    /// already.
    fn search_events(
        &mut self,
        set: &CurveSet,
        step: Option<Outcome>,
        comparison: &Comparison,
        defects: &mut Vec<Defect>,
    ) -> Motion {
        if self.steps.events() == Events::Off {
            return Motion::default();
        }
        let outcome = step.unwrap_or_else(|| {
            let pairs = self.pairs_to_search(set);
            self.search_step(set, pairs)
        });
        let full = &mut self.full;
        let place = |(i, j): Pair| {
            full.refit(set, &[(i, j)]);
            closest_approach(set, full.trees(), i as usize, j as usize)
        };
        self.steps.add_defects(&outcome, comparison, place, defects);
        let unaccounted = defects.iter().any(|d| d.kind == DefectKind::Unaccounted);
        let safe = match unaccounted {
            true => None,
            false => self.steps.safe_fraction(set, &outcome),
        };
        Motion {
            events: outcome.events,
            unresolved: outcome.unresolved,
            safe_fraction: safe,
        }
    }

    /// Returns the report on a frame that broke its contract.
    pub fn reject(&self, seq: u64, time: f64, why: &Error) -> Report {
        let mut report = Report {
            rejected: Some(why.to_string()),
            last_intact: self.steps.intactness().last_intact(),
            ..Report::new(seq, time, Verdict::Rejected)
        };
        report.abort = self.abort_on.aborts(&report, |_| false);
        report
    }
}
