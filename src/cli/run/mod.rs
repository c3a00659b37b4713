//! Verification of frames and output to sinks, shared by `watch`, `replay` and `check`.
//!
//! ```text
//! settings ─▶ Run: frame ─▶ judge ─▶ publish ─┬▶ print, news, junit, metrics ─▶ summary
//!                                             └▶ sinks
//! ```

mod baseline;
mod clearance;
mod junit;
mod news;
mod print;
mod record;
mod settings;
mod sinks;
mod state;
mod summary;
mod times;
mod viewer;
mod violations;

pub use junit::JunitArgs;
pub use settings::{Baseline, Judge, MOTION_LIMIT, recorded};
pub use sinks::Sinks;
pub use state::RunState;

use self::baseline::Origin;
use self::junit::Junit;
use self::news::News;
use self::summary::{Steps, Summary, jumped};
use super::Outcome;
use super::cell_args::{CellArgs, say};
use super::files::Files;
use super::live::Live;
use super::metrics::SessionMetrics;
use super::output::{count, plural};
use linkwatch::kernels::Offload;
use linkwatch::{
    BaselineRecord, Certificate, Continuation, Counters, CurveSet, Events, FrameInfo, FrameRecord,
    FrameTimes, InvariantKind, Overflow, Received, Report, Result, RunProgress, Session,
    SessionOptions, SinkQueue, Strategy, Verdict, Work,
};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

/// Name of the frames of a run in messages.
const THE_FRAMES: &str = "the frames";

/// Scenes of at most this many segments are verified quickly, whatever their motion.
const SMALL: usize = 4096;

/// If the verification takes at least this long, the cost of passing a frame to another thread is
/// negligible.
const MOMENT: Duration = Duration::from_millis(1);

/// Time limit for all sinks together to finish at the end of the run.
const FINISH: Duration = Duration::from_secs(30);

/// Maximum wait for a blocked sink or standard output, if no simulator waits. After that, frames or
/// lines are dropped, and their number is reported.
pub const PATIENT: Overflow = Overflow::WaitForProgress(Duration::from_secs(60));

/// Maximum total delay of the verdicts for a simulator by a blocked sink or standard output, until
/// it has caught up.
pub const PATIENCE: Duration = Duration::from_millis(500);

/// Properties of a [`Run`] that follow from its command.
#[derive(Default)]
pub struct Setup {
    pub junit: JunitArgs,
    /// True if every frame is verified in full, because consecutive frames have little in common.
    pub full: bool,
    /// See [`SessionOptions::early_exit`].
    pub early_exit: bool,
    /// True if frames are model files, which have names and cannot be skipped.
    pub models: bool,
    /// True if the frames come from a running simulator.
    pub live: bool,
    /// True if frames before the first verified one do not count as missing.
    pub from_now: bool,
    /// Baseline of a recorded run, unless the user chose another one.
    pub baseline: Option<BaselineRecord>,
    /// Title of the run in the viewer.
    pub title: String,
    /// Metadata of the run for a recording: the source of its frames.
    pub metadata: BTreeMap<String, String>,
    pub json: bool,
}

/// Result of a frame, before it goes to the sinks.
pub struct Judged {
    pub report: Arc<Report>,
    pub times: FrameTimes,
    pub work: Work,
    /// Work done on the GPU.
    pub offload: Offload,
    pub curves: Option<Arc<CurveSet>>,
    /// Information of the simulator about the frame.
    pub info: FrameInfo,
    /// Model file of the frame, if it comes from one.
    pub model: Option<String>,
    /// Time from the receipt of the frame until its verdict was sent, if it is live.
    pub latency: Option<Duration>,
    /// Relation of the frame to the last one.
    pub step: Continuation,
}

impl Judged {
    /// Returns a result without the curves of the frame.
    pub fn of(report: Report, times: FrameTimes, work: Work) -> Judged {
        Judged {
            info: FrameInfo::at(report.seq, report.time),
            report: Arc::new(report),
            times,
            work,
            offload: Offload::default(),
            curves: None,
            model: None,
            latency: None,
            step: Continuation::Continues,
        }
    }
}

/// One run over frames: a session, and the outputs of its reports.
pub struct Run {
    /// Receives frames, which [`Run::judge`] verifies.
    pub session: Session,
    options: SessionOptions,
    cell_args: CellArgs,
    /// Properties of the command. The baseline was moved out of them.
    setup: Setup,
    /// Status line and results of the run, with the label of its session.
    pub live: Live,
    queues: Vec<SinkQueue>,
    metrics: Option<SessionMetrics>,
    junit: Option<Junit>,
    sinks: Sinks,
    /// Origin of the baseline. `None` until a frame was verified with the baseline.
    origin: Option<Origin>,
    /// True if the baseline changed since it was passed to the sinks.
    baseline_changed: bool,
    /// True if the sinks have a baseline.
    begun: bool,
    /// Layout of the last frame whose baseline the sinks have.
    sent_layout: u32,
    /// True until the first frame of a run was verified.
    is_new_run: bool,
    /// Number of open curves of this run that are already in the summary.
    open_curves: u64,
    /// Counts of the steps of this run.
    steps: Steps,
    /// True if another process verified the previous frame.
    resumed: bool,
    /// Number of rejected frames after the last verified one.
    rejected_since_verified: u64,
    /// Start of the run, by the system clock, which may be adjusted during the run, and by a
    /// monotonic clock.
    start: (SystemTime, Instant),
    /// Time that the last frame took to verify.
    last_check: Option<Duration>,
    /// Numbers of frames so far. The bus counts those of a simulator.
    pub tally: Counters,
    /// Numbers of frames that another process verified before this one, and wrote to its outputs.
    before: Counters,
    news: News,
    pub sum: Summary,
    /// True if frames are missing.
    incomplete: bool,
    /// Reason why the end of the run is missing.
    cut: Option<&'static str>,
}

impl Run {
    /// Prepares a run. `files` are the inputs and outputs of the command so far.
    pub fn new(judge: &Judge, sinks: &Sinks, mut files: Files, mut setup: Setup) -> Result<Run> {
        sinks.check_files(&mut files)?;
        let junit = setup.junit.open(&mut files, &setup.title)?;
        let is_recorded = setup.baseline.is_some() && judge.baseline.is_none();
        let baseline = judge.baseline(setup.baseline.take())?;
        let mut options = judge.options(&mut setup.metadata)?;
        if !setup.full {
            options.strategy = Strategy::Incremental;
        }
        options.early_exit = setup.early_exit;
        let incomplete = baseline.as_ref().is_some_and(|b| b.unverified > 0);
        let (certificate, origin) = baseline.map(Origin::of).unzip();
        options.baseline = certificate;
        let mut sum = Summary {
            unsearched_runs: u64::from(options.events == Events::Off),
            ..Summary::default()
        };
        sum.unresolved.limit = options.motion_limit.unwrap_or(SessionOptions::MOTION_LIMIT);
        let queues = sinks.open(&setup, options.clearance);
        let mut session = Session::new(options.clone())?;
        if let Some(certificate) = options.baseline.clone().filter(|_| is_recorded) {
            session.begin_recorded_part(certificate);
        }
        Ok(Run {
            session,
            queues: queues?,
            options,
            cell_args: judge.cell_args,
            setup,
            live: Live::default(),
            metrics: None,
            junit,
            sinks: sinks.clone(),
            origin,
            baseline_changed: false,
            begun: false,
            sent_layout: 0,
            is_new_run: true,
            open_curves: 0,
            steps: Steps::default(),
            resumed: false,
            rejected_since_verified: 0,
            start: (SystemTime::now(), Instant::now()),
            last_check: None,
            tally: Counters::default(),
            before: Counters::default(),
            news: News::default(),
            sum,
            incomplete,
            cut: None,
        })
    }

    /// Reports all figures of this run to these metrics, too.
    pub fn measured(mut self, metrics: &super::metrics::ServiceMetrics) -> Run {
        self.metrics = Some(metrics.session(self.options.events != Events::Off));
        self
    }

    /// Returns true if verifying the frame is likely to take less time than passing it to another
    /// thread: the frame is small, and the previous one was verified quickly.
    pub fn is_quick(&self, frame: &Received) -> bool {
        let quick = self.last_check.is_some_and(|check| check < MOMENT);
        frame.segments() <= SMALL && quick
    }

    /// Returns the outcome so far.
    pub fn outcome(&self) -> Outcome {
        Outcome::undecided_if(self.incomplete).max(self.sum.violations.outcome())
    }

    /// If this frame ends a violation for which the simulator was asked to stop, returns the number
    /// of violations that were rolled back. Call this before [`Run::publish`].
    pub fn recovered_by(&self, judged: &Judged) -> Option<u32> {
        let Judged { report, step, .. } = judged;
        let mut violations = self.sum.violations.clone();
        let ends = violations.add(report, *step);
        ends.then_some(violations.recovered)
    }

    /// Verifies one frame.
    ///
    /// # Errors
    ///
    /// The errors of [`Session::verify`].
    pub fn judge(&mut self, frame: Received) -> Result<Judged> {
        let verified = self.session.verify(frame)?;
        let seq = verified.report.seq;
        say(&THE_FRAMES, &verified.notes);
        if verified.continuation == Continuation::Cut {
            tracing::info!(
                "frame {seq} does not continue the previous one: the simulator rolled back or \
                 jumped"
            );
        }
        if self.sum.jumps == 0 && verified.jumps > 0 {
            tracing::info!(
                "frame {seq}: {}; they are followed (--wrapped=false takes them as they are)",
                jumped(verified.jumps)
            );
        }
        (self.sum.joined, self.sum.jumps) = (verified.joined, verified.jumps);
        // Keeps an earlier reason: clearance may be measured after the curves changed, but earlier
        // frames lack it.
        self.sum.unmeasured = self.sum.unmeasured.take().or(verified.unmeasured);
        if verified.curves.is_some() {
            if verified.continuation == Continuation::Accepted {
                self.origin = None;
                self.baseline_changed = true;
                self.news.known.forget();
            }
            self.news.known.begin_frame(verified.info.layout);
        }
        let times = FrameTimes {
            ingest: verified.ingest,
            verification: verified.verification,
            stages: verified.timings,
            live: None,
        };
        self.last_check = Some(times.check());
        if verified.work.disagreed {
            tracing::error!(
                "frame {seq}: the incremental verification was wrong, which is a bug of linkwatch; \
                 this frame and all later ones are verified in full"
            );
            self.data_lost();
        }
        Ok(Judged {
            offload: verified.offload,
            curves: verified.curves,
            info: verified.info,
            step: verified.continuation,
            ..Judged::of(verified.report, times, verified.work)
        })
    }

    /// Passes a frame to the sinks, and prints its new findings.
    pub fn publish(&mut self, judged: Judged) {
        match judged.report.verdict {
            // The bus counts the frames of a simulator.
            _ if self.setup.live => {}
            Verdict::Rejected => self.tally.rejected += 1,
            _ => self.tally.verified += 1,
        }
        let recovered = self.sum.violations.add(&judged.report, judged.step);
        if let Some(junit) = self.junit.as_mut().filter(|_| recovered) {
            junit.end_violation();
        }
        if judged.report.verdict == Verdict::Rejected {
            self.rejected_since_verified += 1;
        } else {
            let has_step = self.begun || std::mem::take(&mut self.resumed);
            self.steps.count(has_step, judged.step);
            self.begin_baseline(&judged);
            self.rejected_since_verified = 0;
            let stats = judged.report.stats;
            if std::mem::take(&mut self.is_new_run) {
                self.warn_of_scene(&judged);
                self.open_curves = 0;
            }
            let more = stats.open_curves.saturating_sub(self.open_curves);
            *self.sum.open_curves.get_or_insert(0) += more;
            self.open_curves += more;
            self.sum.has_pairs |= stats.curves != 1 || judged.info.cell.is_some();
            self.sum.only_open = stats.curves > 0 && stats.open_curves == stats.curves;
            self.sum.times.add(&judged.times);
            self.sum.routes[judged.work.route as usize] += 1;
        }
        self.pass_baseline(&judged);
        if let Some(metrics) = &self.metrics {
            metrics.add(&judged.report, judged.latency);
        }
        self.print(&judged);
        if recovered && !self.setup.json {
            let (frame, words) = (judged.report.frame(), violations::words(judged.step));
            self.live.line(format_args!("{frame}: {words}"));
        }
        let own = self.tally.since(self.before);
        let record = Arc::new(FrameRecord {
            curves: judged.curves,
            info: judged.info,
            report: judged.report,
            progress: RunProgress {
                verified: own.verified,
                skipped: own.skipped,
                rejected: own.rejected,
                recovered: self.sum.violations.recovered,
                accepted: self.sum.violations.accepted,
                times: judged.times,
                work: judged.work,
                ..RunProgress::default()
            }
            .received(self.start.0 + self.start.1.elapsed()),
        });
        for queue in &self.queues {
            queue.frame(Arc::clone(&record));
        }
        if let Some(metrics) = &mut self.metrics {
            metrics.count(own, self.queues.iter().map(SinkQueue::summary));
        }
    }

    /// Records that the run is incomplete.
    pub fn data_lost(&mut self) {
        self.incomplete = true;
    }

    /// Records that the end of the run is missing, and why.
    pub fn cut_off(&mut self, why: &'static str) {
        self.cut = Some(why);
        self.data_lost();
    }

    /// Ends a run: counts the curves that it did not verify, because no step was searched. Curves
    /// without linking numbers can be verified only by a search for pull-throughs.
    fn end_run(&mut self) {
        let through = self.session.baseline();
        let through = through.map_or(0, Certificate::periods_without_numbers) as u64;
        let Steps {
            verified,
            followed,
            cuts,
        } = std::mem::take(&mut self.steps);
        let sum = &mut self.sum;
        sum.through |= through > 0;
        sum.followed += followed;
        sum.cuts += cuts;
        if verified > 1 && self.options.events == Events::Off {
            sum.unsearched += self.open_curves;
            sum.unsearched_through |= through > 0;
        } else if verified > 1 && followed == 0 {
            sum.unfollowed += self.open_curves;
            sum.unsearched_through |= through > 0;
        }
    }

    /// Closes the sinks and prints the summary.
    pub fn finish(mut self) -> Outcome {
        self.end_run();
        let tally = self.tally;
        let mut kept = Vec::new();
        let mut summaries = Vec::new();
        let start = Instant::now();
        for queue in std::mem::take(&mut self.queues) {
            let complete = queue.requires_all_frames();
            if let Some(why) = self.cut {
                queue.cut_off(why);
            }
            let summary = queue.finish(FINISH.saturating_sub(start.elapsed()));
            let (name, all) = (summary.name, summary.written + summary.dropped);
            let frames = plural(all, "frame");
            match &summary.failed {
                // The sink logged the reason when it failed. Its note says which part of the output
                // exists.
                Some(_) if summary.note.is_some() => {
                    tracing::error!("{name} is incomplete");
                }
                Some(_) => {
                    let written = count(summary.written);
                    tracing::error!("{name} is incomplete: it has at least {written} of {frames}");
                }
                None if summary.dropped > 0 => {
                    let missed = count(summary.dropped);
                    kept.push(format!(
                        "{name} missed {missed} of {frames}: it is too slow"
                    ));
                }
                None => {}
            }
            kept.extend(summary.note.clone());
            if summary.failed.is_some() || complete && summary.dropped > 0 {
                self.data_lost();
            }
            summaries.push(summary);
        }
        if let Some(metrics) = &mut self.metrics {
            metrics.count(tally.since(self.before), summaries.iter().cloned());
        }
        let options = &self.options;
        let open = self.sum.open_curves.unwrap_or(0);
        let searched = self.sum.unsearched_runs == 0;
        if tally.verified == 1 && open > 0 && (searched || self.sum.only_open) {
            let what = match self.sum.only_open {
                true => "nothing was verified".to_owned(),
                false => format!("{} not verified", plural(open, "open curve")),
            };
            tracing::warn!(
                "{what}: open curves are searched for pull-throughs from one frame to the next, \
                 and there was one frame"
            );
        }
        let curve = InvariantKind::Curve;
        let compares = |baseline: &Certificate| baseline.invariants().any(|kind| kind == curve);
        let baseline = options.baseline.as_ref();
        // The knot type of an open curve is not defined.
        let knots = !self.sum.only_open
            && (options.invariants.contains(&curve) || baseline.is_some_and(compares));
        // The process that verified the earlier frames reported on their curves.
        let own = tally.since(self.before).verified;
        let unsearched = self.sum.has_unverified_curves();
        let alone = tally.verified == 1 && self.sum.only_open;
        let itself = options.events == Events::All && tally.verified > 1;
        let compared = own > 0 && (tally.verified > 1 || baseline.is_some());
        if compared && !(self.sum.has_pairs || knots || itself || alone) {
            tracing::warn!(
                "nothing was verified: one curve alone has no linking number, and pull-throughs of \
                 a curve with itself are searched for by --events=all"
            );
            self.data_lost();
        }
        if tally.verified == 0 || self.sum.unmeasured.is_some() || unsearched || alone {
            self.data_lost();
        }
        if let Some(junit) = self.junit.take()
            && let Err(e) = junit.write(!self.incomplete, self.sinks.overwrite)
        {
            tracing::error!("{e}");
            self.data_lost();
        }
        self.live.clear();
        // For a single model, the verdict is already the summary.
        if !(self.setup.models && tally.verified + tally.rejected <= 1) {
            self.sum_up(&summaries, &kept);
        }
        self.outcome()
    }
}
