//! Engine: verifies one scene against one baseline. The only module that knows all stages.
//!
//! It uses no file and no socket. It uses the clock only to measure times.
//!
//! # A frame is a transaction
//!
//! The state after the last verified frame is one value, [`Known`]. A frame works on a copy, which
//! replaces it once nothing can reject the frame any more. A rejected frame leaves no trace. All
//! other state is buffers and caches, on which no report depends.

mod certifier;
mod compare;
mod expand;
mod findings;
mod full;
mod higher;
mod intactness;
mod known;
mod ladder;
mod options;
mod plan;
mod progress;
mod routing;
mod state;
mod steps;
#[cfg(test)]
mod tests;

pub use certifier::Certifier;
pub use ladder::Ladder;
pub use options::{SessionOptions, Strategy};
pub use plan::Plan;
#[cfg(feature = "cli")]
pub(crate) use plan::{DevicePlan, ImagePlan, Prediction};
pub use progress::{Progress, Timings};
pub(crate) use state::EngineState;

use self::full::{FullRun, with_sizes};
use self::known::Known;
use self::routing::Routing;
use self::steps::Steps;
use crate::certificate::Certificate;
use crate::curve::{Cell, CurveChange, CurveSet};
use crate::discretize::Braids;
use crate::error::{Error, Result};
use crate::incremental::{Events, Monitor, Work};
use crate::ingest::{RawFrame, ingest, same_layout};
use crate::kernels::{GpuUse, Method, Offload};
use crate::pairs::PairFilter;
use crate::pool;
use crate::scene::CellScene;
use crate::verdict::{Defect, Report, Stats, Verdict};
use std::sync::Arc;
use std::time::Instant;

/// Verifies successive frames of one scene against a baseline.
#[derive(Debug)]
pub(crate) struct Engine {
    /// Options, without the baseline.
    options: SessionOptions,
    known: Known,
    full: FullRun,
    monitor: Monitor,
    steps: Steps,
    routing: Routing,
    work: Work,
    /// True if the given baseline numbers images as the frames do.
    names_images: bool,
}

/// A frame to verify.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Next<'a> {
    pub seq: u64,
    pub time: f64,
    pub curves: &'a Arc<CurveSet>,
    /// Periodic cell. All frames of an engine have one, or none has.
    pub cell: Option<Cell>,
    /// Change of the curves since the last verified frame.
    pub change: Option<&'a CurveChange>,
    /// True if the frame does not continue the last verified one, so that no step leads to it.
    pub cut: bool,
}

#[cfg(test)]
impl<'a> Next<'a> {
    /// Returns a frame that continues the last one, without a cell.
    pub fn new(seq: u64, time: f64, curves: &'a Arc<CurveSet>) -> Next<'a> {
        Next {
            seq,
            time,
            curves,
            cell: None,
            change: None,
            cut: false,
        }
    }
}

impl Engine {
    /// Creates an engine and opens its device.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if an option has an invalid value, or excludes another one;
    /// [`Error::Device`] if no adapter matches, or it cannot be used; [`Error::Forked`].
    pub fn new(options: SessionOptions) -> Result<Self> {
        pool::check_process()?;
        options.check()?;
        let gpu = GpuUse::open(&options.device, options.calibration.as_ref())?;
        Ok(Engine::with_gpu(options, gpu))
    }

    /// Creates an engine whose kernels run on an adapter that is open already.
    pub fn with_gpu(mut options: SessionOptions, gpu: GpuUse) -> Self {
        let (method, gpu) = match options.cell {
            // Kernels that sum cannot use coordinates that are exact sums, so crossings are
            // counted.
            Some(_) => (Method::Crossings, GpuUse::default()),
            None => (options.kernel, gpu),
        };
        let full = FullRun::new(method, options.accuracy, gpu);
        let limit = options.motion_limit.unwrap_or(SessionOptions::MOTION_LIMIT);
        let incremental = options.strategy.is_incremental();
        let mut steps = Steps::new(options.events, incremental, limit);
        steps.end_with(&full.progress);
        let given = options.baseline.take();
        let higher = given.as_ref().map(|given| given.higher.clone());
        Engine {
            known: Known {
                higher: Arc::new(higher.unwrap_or_default()),
                given: given.map(Arc::new),
                cell: options.cell.map(|_| CellScene::default()),
                ..Known::default()
            },
            options,
            full,
            monitor: Monitor::new(steps.coverage(), None),
            steps,
            routing: Routing::default(),
            work: Work::default(),
            names_images: false,
        }
    }

    /// Verifies only the pairs of a filter from now on, or all.
    fn set_filter(&mut self, filter: Option<PairFilter>) {
        self.full.search.filter = filter.clone();
        self.steps.set_filter(filter.clone());
        self.monitor = Monitor::new(self.steps.coverage(), filter);
    }

    /// Returns the work that the GPU did in the last frame.
    pub fn offload(&self) -> Offload {
        self.full.gpu.offload()
    }

    /// Returns the work of the last frame.
    pub fn work(&self) -> Work {
        self.work
    }

    /// Returns the times of the last frame.
    pub fn timings(&self) -> Timings {
        self.full.timings
    }

    /// Returns all expected linking numbers, or `None` before the first frame.
    pub fn baseline(&self) -> Option<&Arc<Certificate>> {
        self.known.joined()
    }

    /// Returns all expected linking numbers with the expected invariants, for a record.
    pub fn complete_baseline(&self) -> Option<Certificate> {
        let baseline = Certificate::clone(self.known.joined()?);
        let higher = self.known.higher.to_vec();
        Some(Certificate { higher, ..baseline })
    }

    /// Returns a view of the progress of the current frame.
    pub fn progress(&self) -> Arc<Progress> {
        Arc::clone(&self.full.progress)
    }

    /// Shares the progress of another engine, and its cancellation.
    pub fn share_progress(&mut self, progress: Arc<Progress>) {
        self.steps.end_with(&progress);
        self.full.share_progress(progress);
    }

    /// Continues with the last intact frame of another engine. `names_images` is true if the given
    /// baseline numbers images as the frames do.
    pub fn continue_after(&mut self, other: &Engine, names_images: bool) {
        self.known.intactness = other.known.intactness;
        self.known.intactness.cut();
        self.names_images = names_images;
    }

    /// Waits until background work has ended, so that a measurement of the next frame does not
    /// depend on the speed of that work.
    pub fn settle(&mut self) {
        self.monitor.wait_for_reference();
    }

    /// Copies a frame that will be verified into `set`: the first frame creates the set, and every
    /// later one of the same curves updates it. If frames are verified incrementally, the same pass
    /// compares it with the reference frame.
    ///
    /// # Errors
    ///
    /// The frame breaks its contract: a number that is not finite ([`Error::NotFinite`]) or
    /// too large, or too few points of a curve ([`Error::CurveTooShort`]) or of all
    /// ([`Error::Count`]).
    pub fn receive(
        &mut self,
        frame: RawFrame<'_>,
        cell: Option<&Cell>,
        set: &mut Option<CurveSet>,
    ) -> Result<()> {
        // If the layout differs, discards the set. [`Engine::verify`] decides if other curves are
        // valid.
        set.take_if(|set| same_layout(&frame, set).is_err());
        let incremental = self.options.strategy.is_incremental();
        ingest(frame, set, |set, positions| match incremental {
            true => self.monitor.receive(set, positions, cell),
            false => set.update(positions),
        })
    }

    /// Announces the frame that comes after the next one. If crossings are counted on a GPU, its
    /// vertices are uploaded while the next frame is verified. This is only a hint: the results are
    /// the same without it, or if another frame follows.
    pub fn announce(&mut self, next: &Arc<CurveSet>) {
        // With braids, the engine verifies a set with additional loops, not this one.
        if self.options.braids.is_none() {
            self.full.gpu.announce(next);
        }
    }

    /// Verifies one frame. Without a baseline, the first frame becomes the baseline.
    ///
    /// # Errors
    ///
    /// The frame is rejected. [`Error::CertificateMismatch`] if the baseline has another
    /// number of curves; [`Error::NothingClosed`] if no curve is closed and pull-throughs are off,
    /// since nothing would be verified; [`Error::LayoutChanged`] if pull-throughs are reported and
    /// the curves differ from those of the previous frame; [`Error::TooManyPairs`] if more pairs of
    /// curves come close than [`SessionOptions::max_pairs`]; [`Error::Cancelled`] after
    /// [`Progress::cancel`]; and others.
    pub fn verify(&mut self, next: Next<'_>) -> Result<Report> {
        let mut known = self.known.clone();
        let mut verified = self.try_to_verify(&mut known, next);
        let findings = |report: &Report| report.changes.len() + report.defects.len();
        if next.cut
            && let Ok(report) = &verified
            && findings(report) > 0
            && let Some(mut aligned) = self.known.before_alignment()
        {
            // Without the motion, the images by which the frame gives its curves are not known.
            self.names_images = false;
            let again = self.try_to_verify(&mut aligned, next);
            match again {
                Ok(again) if findings(&again) < findings(report) => {
                    (known, verified) = (aligned, Ok(again));
                }
                _ => self.set_filter(known.filter()),
            }
        }
        self.full.gpu.end_frame();
        if verified.is_ok() {
            self.known = known;
            return verified;
        }
        let filter = self.known.filter();
        if self.full.search.filter != filter {
            self.set_filter(filter);
        }
        if let Some(baseline) = &self.known.baseline {
            self.monitor.set_baseline(baseline);
        }
        verified
    }

    /// Returns the report on a frame. Replaces `known`, the state before the frame, by the state
    /// after it.
    fn try_to_verify(&mut self, known: &mut Known, next: Next<'_>) -> Result<Report> {
        let start = Instant::now();
        let (seq, time, given) = (next.seq, next.time, next.curves);
        if next.cut {
            known.cut();
        }
        let appeared = self.apply_change(known, next)?;
        known.check_number(given.len())?;
        self.begin_frame();
        let is_given = known.given.is_some();
        self.begin_baseline(known, next)?;
        let (curves, broken) = known.close_braids(given)?;
        let next = Next {
            curves: &curves,
            ..next
        };
        if curves.open_curves() == curves.len() && self.steps.events == Events::Off {
            let yarns = next.cell.map(|cell| CellScene::count_yarns(given, &cell));
            return Err(Error::NothingClosed {
                curves: curves.len(),
                yarns: yarns.unwrap_or(0),
            });
        }
        self.steps.begin(known, &curves)?;
        let mut report = Report::new(seq, time, Verdict::Intact);
        report.missing.extend(known.unknown_step.take());
        report.missing.extend(broken);
        if let Some(change) = next.change {
            report.missing.extend(change.words_of_uncompared());
            report.appeared.clone_from(&change.appeared);
            report.gone.clone_from(&change.gone);
        }
        let (frame, quiet) = self.expand(known, next, &mut report.missing)?;
        let mut compared = self.compare(known, &frame, quiet, &appeared)?;
        self.add_places(&frame, &mut compared.linking.comparison)?;
        let step = compared.step.take();
        let comparison = &compared.linking.comparison;
        self.search_events(known, &frame, step, comparison, &mut report)?;
        self.full.progress.check()?;
        let yarns = self.compare_yarns(known, &frame)?;
        self.compare_invariants(known, given, is_given, comparison, &mut report);
        // The moment at which a knot changed is known only if passages of a curve with itself are
        // searched for.
        if !report.invariants.is_empty() && self.steps.events != Events::All {
            report.safe_fraction = None;
        }
        self.full.progress.check()?;
        // From here on, the frame is not rejected.
        let unknown = !report.missing.is_empty() || self.steps.undecided;
        report.changes.clone_from(&comparison.changes);
        report.adopted.clone_from(&comparison.adopted);
        report.stats = Stats {
            extent: *known.extent.get_or_insert_with(|| given.extent()),
            ..with_sizes(compared.stats, given)
        };
        if let Some(scene) = &known.cell {
            self.work.recomputed += yarns.computed;
            let through = known.joined().map_or(0, |all| all.periods.len());
            report.stats.open_curves -= through as u64;
            scene.name(&mut report, given.len(), yarns);
        }
        if let Some(scene) = &known.braids {
            report.stats.open_curves = scene.open_curves();
            scene.name(&mut report);
        }
        report.verdict = report.verdict_of_findings();
        known.intactness.conclude(&mut report, unknown);
        self.steps.remember(known, frame, compared.linking);
        self.full.timings.total = start.elapsed();
        Ok(report)
    }

    /// Resets the counters and the limits of a frame.
    fn begin_frame(&mut self) {
        self.full.progress.limit.begin(self.options.max_pairs);
        self.full.heed_cancel(true);
        self.work = Work::default();
        // A partial run skips stages, which then must not keep the times of an earlier frame.
        self.full.timings = Timings::default();
        // A partial run does not call `FullRun::find_pairs`, which starts the frame otherwise.
        self.full.gpu.start_frame();
    }

    /// Returns true if a report is a reason to ask the simulator to stop. A contact that has
    /// existed since the baseline is not.
    pub fn aborts(&self, report: &Report) -> bool {
        let known = &self.known;
        let lacks = |baseline: Option<&Arc<Certificate>>, a: u32, b: Option<u32>| {
            let lacks = baseline.is_some_and(|baseline| baseline.has_no_number(a, b));
            lacks || known.touch_from_the_start(a, b)
        };
        let expected = |d: &Defect| match (&known.cell, d.pair()) {
            (Some(scene), Some(pair)) => {
                let found = scene.find_pair(pair);
                let lacks = found.is_some_and(|(a, b)| lacks(known.baseline.as_ref(), a, Some(b)));
                lacks || scene.lacks_yarn(pair)
            }
            _ => lacks(known.joined(), d.i, d.j),
        };
        self.options.abort_on.aborts(report, expected)
    }

    /// Returns the braids with all values that were derived from the first frame, so that other
    /// runs can close them in the same way. `None` before that frame, or without braids.
    pub fn braids(&self) -> Option<Braids> {
        Some(self.known.braids.as_ref()?.braids().0)
    }

    /// Returns the report on a frame that broke its contract.
    pub fn reject(&self, seq: u64, time: f64, why: &Error) -> Report {
        let mut report = Report {
            rejected: Some(why.to_string()),
            last_intact: self.known.intactness.last_intact,
            ..Report::new(seq, time, Verdict::Rejected)
        };
        report.abort = self.options.abort_on.aborts(&report, |_| false);
        report
    }

    /// Records that an incremental result was wrong, and switches to full runs.
    fn disagree(&mut self) {
        self.work.disagreed = true;
        self.options.strategy = Strategy::Full;
    }
}
