//! Verifier: takes frames, returns reports. The only module that knows all stages.
//!
//! It uses no file and no socket, and its clock only measures. Live frames, recordings, model files
//! and tests use it alike.

mod full;
mod ladder;
mod options;
mod steps;
#[cfg(test)]
mod tests;

pub use ladder::Ladder;
pub use options::{Strategy, VerifierOptions};

use self::full::{FullRun, sizes};
use self::steps::Steps;
use crate::cancel::Cancel;
use crate::certificate::{Certificate, Comparison};
use crate::curve::CurveSet;
use crate::error::{Error, Result};
use crate::incremental::{Events, Finding, Monitor, Outcome, Route, Work};
use crate::kernels::{DeviceInfo, GpuUse, Method, Offload, segment_pairs};
use crate::pairs::{Pair, closest_approach};
use crate::verdict::{AbortOn, Defect, DefectKind, PullThrough, Report, Stats, Verdict};
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

    fn check(&self) -> Result<()> {
        match self.is_cancelled() {
            true => Err(Error::Cancelled),
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
    /// Total time, comparison included.
    pub total: Duration,
}

/// Verifies successive frames against a baseline. Its buffers are reused for every frame.
///
/// The result does not depend on the number of threads of the rayon pool in which it is called.
#[derive(Debug)]
pub struct Verifier {
    abort_on: AbortOn,
    baseline: Option<Certificate>,
    strategy: Strategy,
    full: FullRun,
    monitor: Monitor,
    steps: Steps,
    work: Work,
    /// Extent of the first frame.
    extent: Option<f64>,
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
        options.check()?;
        let gpu = GpuUse::open(&options.device)?;
        Ok(Verifier::with_gpu(options, gpu))
    }

    /// Creates a verifier whose kernels run on an adapter that is open already.
    pub(crate) fn with_gpu(options: VerifierOptions, gpu: GpuUse) -> Self {
        let full = FullRun::new((options.kernel, options.accuracy), gpu);
        let limit = options
            .motion_limit
            .unwrap_or(VerifierOptions::MOTION_LIMIT);
        let steps = Steps::new(options.events, limit, full.progress.cancel.clone());
        Verifier {
            abort_on: options.abort_on,
            baseline: options.baseline,
            strategy: options.strategy,
            full,
            monitor: Monitor::new(steps.coverage()),
            steps,
            work: Work::default(),
            extent: None,
        }
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
        self.baseline.as_ref()
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
    pub fn certify(&mut self, set: &CurveSet) -> (&Certificate, Stats) {
        let start = Instant::now();
        self.full.heed_cancel(false);
        let stats = self.full.certify(set);
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
        let stats = self.full.certify_noisy(set, noise);
        self.full.timings.total = start.elapsed();
        Ok((&self.full.certificate, stats))
    }

    /// Waits until background work has ended, so that the next frame profits from it. For
    /// measurements.
    pub fn settle(&mut self) {
        self.monitor.wait_for_reference();
    }

    /// Verifies one frame. Without a baseline, the first frame becomes the baseline.
    ///
    /// If pull-throughs are reported, the positions are copied, to compare them with the next
    /// frame; [`Verifier::step_shared`] needs no copy.
    ///
    /// Errors: [`Error::CertificateMismatch`] if the baseline has another number of curves;
    /// [`Error::NothingClosed`] if no curve is closed and pull-throughs are off, since nothing
    /// would be verified; [`Error::LayoutChanged`] if pull-throughs are reported and the curves
    /// differ from those of the previous frame; [`Error::Cancelled`] after [`Progress::cancel`].
    pub fn step(&mut self, seq: u64, time: f64, set: &CurveSet) -> Result<Report> {
        let verified = self.verify(seq, time, set);
        self.full.gpu.end_frame(set);
        let (report, comparison) = verified?;
        self.steps.remember_copy(set, comparison);
        Ok(report)
    }

    /// Same as [`Verifier::step`], for a frame that the caller shares until the next one is
    /// verified.
    pub fn step_shared(&mut self, seq: u64, time: f64, set: &Arc<CurveSet>) -> Result<Report> {
        let verified = self.verify(seq, time, set);
        self.full.gpu.end_frame(set);
        let (report, comparison) = verified?;
        self.steps.remember(Arc::clone(set), comparison);
        Ok(report)
    }

    /// Marks the next frame as not continuing the previous one, so that the verifier does not
    /// search for pull-throughs between the two. Call this after a rollback, a restart or a cut of
    /// the simulation.
    ///
    /// Linking numbers are still compared with the baseline.
    pub fn cut(&mut self) {
        self.steps.forget();
    }

    /// Announces the frame that comes after the next one. If crossings are counted on a GPU, its
    /// vertices are uploaded while the next frame is verified. This is only a hint: the results are
    /// the same without it, or if another frame follows.
    pub fn announce(&mut self, next: &Arc<CurveSet>) {
        self.full.gpu.announce(next);
    }

    /// Returns the report on a frame, and the comparison of its linking numbers with the baseline.
    fn verify(&mut self, seq: u64, time: f64, set: &CurveSet) -> Result<(Report, Comparison)> {
        if let Some(b) = self.baseline.as_ref().filter(|b| b.curves != set.len()) {
            return Err(Error::CertificateMismatch {
                certificate: b.curves,
                model: set.len(),
            });
        }
        let closed = set.open_curves() < set.len();
        if !closed && self.steps.events() == Events::Off {
            return Err(Error::NothingClosed { curves: set.len() });
        }
        self.steps.check_layout(set)?;
        let start = Instant::now();
        self.full.heed_cancel(true);
        self.work = Work::default();
        // Needed here, because a partial run does not start the frame.
        self.full.gpu.start_frame();
        let (mut comparison, stats) = self.compare(set)?;
        self.add_places(set, &mut comparison);
        let mut defects = comparison.defects.clone();
        let (events, unresolved) = self.search_events(set, &comparison, &mut defects);
        // A report must not depend on work that was skipped after a cancellation.
        self.full.progress.check()?;
        let contact = defects.iter().any(|d| d.kind == DefectKind::Contact);
        let verdict = if !(comparison.changes.is_empty() && events.is_empty()) {
            Verdict::Changed
        } else if contact {
            Verdict::Contact
        } else if !(defects.is_empty() && unresolved.is_empty()) {
            Verdict::Undecided
        } else {
            Verdict::Intact
        };
        let extent = *self.extent.get_or_insert_with(|| set.extent());
        let mut report = Report {
            changes: comparison.changes.clone(),
            events,
            unresolved,
            defects,
            adopted: comparison.adopted.clone(),
            stats: Stats { extent, ..stats },
            ..Report::new(seq, time, verdict)
        };
        // Curves that have touched since the baseline do not ask the simulator to stop.
        let baseline = self.baseline.as_ref();
        let expected = |d: &Defect| {
            baseline.is_some_and(|b| b.lacks(d.i, d.j)) || self.steps.touch_from_the_start(d.i, d.j)
        };
        report.abort = self.abort_on.aborts(&report, expected);
        self.full.timings.total = start.elapsed();
        Ok((report, comparison))
    }

    /// Compares a frame with the baseline, by the strategy of the verifier.
    fn compare(&mut self, set: &CurveSet) -> Result<(Comparison, Stats)> {
        let Some(baseline) = self.baseline.take() else {
            let stats = self.certify_fully(set)?;
            let baseline = self.full.certificate.clone();
            let comparison = baseline.compare(&baseline);
            self.baseline = Some(baseline);
            self.offer_reference(set);
            return Ok((comparison?, self.counted(set, stats)));
        };
        let compared = match self.strategy {
            Strategy::Full => self.compare_fully(set, &baseline),
            Strategy::EarlyExit => self.full.compare_until_change(set, &baseline),
            Strategy::Incremental | Strategy::Paranoid => {
                self.compare_incrementally(set, &baseline)
            }
        };
        let baseline = self.baseline.insert(baseline);
        let (comparison, stats) = compared?;
        // With early exit, unchecked pairs have no linking number yet.
        if stats.unchecked == 0 && baseline.adopt(&comparison) {
            self.monitor.set_baseline(baseline);
        }
        Ok((comparison, self.counted(set, stats)))
    }

    /// Returns the counts of a report. Work is counted only if it depends on the frame alone.
    fn counted(&self, set: &CurveSet, stats: Stats) -> Stats {
        match self.strategy.is_incremental() {
            true => sizes(set),
            false => stats,
        }
    }

    fn compare_fully(
        &mut self,
        set: &CurveSet,
        baseline: &Certificate,
    ) -> Result<(Comparison, Stats)> {
        let stats = self.certify_fully(set)?;
        Ok((self.full.certificate.compare(baseline)?, stats))
    }

    /// Computes a frame in full, and records the number of pairs decided by sums.
    fn certify_fully(&mut self, set: &CurveSet) -> Result<Stats> {
        let stats = self.full.certify(set);
        self.full.progress.check()?;
        self.work.recomputed = stats.potential_links;
        self.work.summed = self.full.ladder.summed;
        Ok(stats)
    }

    /// Compares a frame with the baseline. Computes only linking numbers that the reference frame
    /// does not prove.
    fn compare_incrementally(
        &mut self,
        set: &CurveSet,
        baseline: &Certificate,
    ) -> Result<(Comparison, Stats)> {
        let before = self.steps.before();
        let finding = self.monitor.compare(before, set, baseline, &mut self.work);
        let (Finding::UnchangedExcept(pairs), Some((known, comparison))) =
            (finding, self.monitor.reference_result())
        else {
            let compared = self.compare_fully(set, baseline)?;
            self.offer_reference(set);
            return Ok(compared);
        };
        let comparison = match &pairs[..] {
            [] => comparison.clone(),
            pairs => {
                let anew = self.full.certify_pairs(set, pairs);
                self.full.progress.check()?;
                let fresh = anew.compare(&baseline.of_pairs(pairs))?;
                let comparison = comparison.patched(pairs, fresh);
                if self.monitor.wants_reference(&self.work) {
                    let certificate = known.patched(pairs, &anew);
                    let links = self.full.potential_links();
                    self.monitor.make_reference(set.clone(), certificate, links);
                }
                comparison
            }
        };
        if self.strategy == Strategy::Paranoid {
            let stats = self.full.certify(set);
            self.full.progress.check()?;
            let full = self.full.certificate.compare(baseline)?;
            if full != comparison {
                self.disagree();
            }
            return Ok((full, stats));
        }
        Ok((comparison, Stats::default()))
    }

    /// Records an error of the incremental verification, and switches it off.
    fn disagree(&mut self) {
        self.work.disagreed = true;
        self.strategy = Strategy::Full;
    }

    /// Makes the last certified frame the reference frame, if that may pay.
    fn offer_reference(&mut self, set: &CurveSet) {
        if self.strategy.is_incremental() && self.monitor.wants_reference(&self.work) {
            let links = self.full.potential_links();
            let certificate = self.full.certificate.clone();
            self.monitor.make_reference(set.clone(), certificate, links);
        }
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
        // After a partial run, trees that the frame did not need may be those of an earlier frame.
        if self.work.route != Route::Full {
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

    /// Returns the pull-throughs since the previous frame, if they are searched for, and the
    /// unresolved ones. Adds undecided pairs of the step to the defects.
    fn search_events(
        &mut self,
        set: &CurveSet,
        comparison: &Comparison,
        defects: &mut Vec<Defect>,
    ) -> (Vec<PullThrough>, Vec<PullThrough>) {
        if self.steps.events() == Events::Off {
            return Default::default();
        }
        let pairs = match (self.strategy.is_incremental(), self.steps.before()) {
            (true, Some(before)) => self.monitor.pairs_to_search(before, set),
            _ => None,
        };
        let (mut outcome, searched) = self.steps.outcome(set, pairs.as_deref());
        if self.strategy == Strategy::Paranoid && pairs.is_some() {
            let (full, _) = self.steps.outcome(set, None);
            let findings = |o: Outcome| (o.events, o.unresolved, o.undecided, o.touching);
            if findings(full.clone()) != findings(outcome) {
                self.disagree();
            }
            outcome = full;
        }
        self.work.searched = searched;
        let full = &mut self.full;
        let place = |(i, j): Pair| {
            full.refit(set, &[(i, j)]);
            closest_approach(set, full.trees(), i as usize, j as usize)
        };
        self.steps.add_defects(&outcome, comparison, place, defects);
        (outcome.events, outcome.unresolved)
    }

    /// Returns the report on a frame that broke its contract.
    pub fn reject(&self, seq: u64, time: f64, why: &Error) -> Report {
        let mut report = Report {
            rejected: Some(why.to_string()),
            ..Report::new(seq, time, Verdict::Rejected)
        };
        report.abort = self.abort_on.aborts(&report, |_| false);
        report
    }
}
