//! Verification of frames and output to sinks, shared by `watch`, `replay` and `check`.

mod baseline;
mod clearance;
mod junit;
#[cfg(feature = "mcap")]
mod keep;
mod news;
#[cfg(feature = "bus")]
mod resume;
mod sinks;
mod summary;
mod times;
#[cfg(feature = "rerun")]
mod viewer;
#[cfg(not(feature = "rerun"))]
#[path = "no_viewer.rs"]
mod viewer;
mod violations;

pub use junit::JunitArgs;
#[cfg(feature = "bus")]
pub use resume::Expected;
pub use sinks::Sinks;
pub use summary::FrameCounts;
pub use violations::Step;

use self::baseline::BaselineFrame;
use self::clearance::ClearanceLog;
use self::junit::Junit;
use self::news::{New, News};
use self::summary::Unresolved;
use self::times::{RunTimes, to_json};
use self::violations::Violations;
use super::Outcome;
use super::braid_args::{self, BraidArgs};
use super::cell_args::{CellArgs, Cells, KEEP_OPEN};
use super::clearance_args::{self, ClearanceArgs};
use super::event_args::EventArgs;
use super::files::{Files, Overwrite};
use super::kernel::KernelArgs;
use super::label::Label;
use super::live::Live;
use super::metrics::SessionMetrics;
use super::output::{self, count, millis, plural, plural_of};
use super::sequence::Frame;
use linkwatch::kernels::Offload;
use linkwatch::model::LeftOut;
use linkwatch::{
    AbortOn, BaselineRecord, Braids, Certificate, ClearanceOptions, CurveSet, Error, Events,
    FrameInfo, FrameRecord, FrameTimes, Overflow, Progress, Report, Result, Route, SinkQueue,
    SinkSummary, Strategy, Timings, Verdict, Verifier, VerifierOptions, Work,
};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

/// The motion limit in the metadata of a recording.
pub const MOTION_LIMIT: &str = "motion_limit";

/// Maximum number of sentences printed about one frame of a stream; the rest is counted.
const SENTENCES: usize = 8;

/// Name of the frames of a run in messages.
const THE_FRAMES: &str = "the frames";

/// Number of segments up to which every frame is verified quickly, regardless of its motion.
#[cfg(feature = "bus")]
const SMALL: usize = 4096;

/// Verification time from which the cost of passing a frame to another thread is negligible.
#[cfg(feature = "bus")]
const MOMENT: Duration = Duration::from_millis(1);

/// Time limit for all sinks together to finish at the end of the run.
const FINISH: Duration = Duration::from_secs(30);

/// Baseline, events and policy of a run.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = super::COMPARE)]
pub struct Judge {
    /// Expected linking numbers: `first-frame`, or a certificate file [default: first-frame;
    /// replay: as recorded]
    #[arg(long, visible_alias = "against", value_name = "first-frame|CERT")]
    pub baseline: Option<Baseline>,
    /// Findings that ask the simulator to stop: any, lost, gained, contact, event, rejected,
    /// clearance (any, or strands that come too close, with --thickness) or never [default: any;
    /// replay: as recorded]
    #[arg(long, value_name = "WHAT")]
    pub abort_on: Option<AbortOn>,
    #[command(flatten)]
    pub event_args: EventArgs,
    #[command(flatten)]
    pub clearance_args: ClearanceArgs,
    #[command(flatten)]
    pub braid_args: BraidArgs,
    #[command(flatten)]
    pub cell_args: CellArgs,
    /// Reject frames in which the boxes of more pairs of curves overlap: the memory for them, up to
    /// 200 bytes each, may not be there [default: 33554432]
    #[arg(long, value_name = "N", hide_short_help = true)]
    pub max_pairs: Option<usize>,
    /// Set by the command, so that its help lists kernels last.
    #[arg(skip)]
    pub kernel: KernelArgs,
    /// Also verify every frame in full, and compare: slow, a test of linkwatch itself
    #[arg(long, hide_short_help = true)]
    pub paranoid: bool,
}

impl Judge {
    /// Returns the files of a command with these settings, for its other inputs and its outputs.
    pub fn files(&self, overwrite: Overwrite) -> Files {
        let mut files = Files::new(overwrite);
        if let Some(Baseline::File(path)) = &self.baseline {
            files.reads(path);
        }
        if let Some(path) = self.braid_args.file() {
            files.reads(path);
        }
        files
    }

    /// Returns the strategy of a stream of frames.
    #[cfg(any(feature = "bus", feature = "mcap"))]
    pub fn strategy(&self) -> Strategy {
        match self.paranoid {
            true => Strategy::Paranoid,
            false => Strategy::Incremental,
        }
    }
}

/// Source of the expected linking numbers.
#[derive(Clone, Debug)]
pub enum Baseline {
    FirstFrame,
    File(PathBuf),
}

impl FromStr for Baseline {
    type Err = std::convert::Infallible;
    fn from_str(s: &str) -> std::result::Result<Self, Self::Err> {
        Ok(match s {
            "first-frame" => Baseline::FirstFrame,
            path => Baseline::File(path.into()),
        })
    }
}

/// Curves of a frame, or the reason why it is rejected.
pub struct Ingested {
    curves: Result<Arc<CurveSet>>,
    info: FrameInfo,
    /// Elements of a file that may be curves of the frame, and were not read.
    left_out: Vec<LeftOut>,
    /// True if it is decided already which curves are closed.
    is_closed: bool,
    took: Duration,
}

impl From<Frame> for Ingested {
    /// Wraps a frame that was read already.
    fn from(frame: Frame) -> Ingested {
        Ingested {
            curves: frame.curves.map(Arc::new),
            info: frame.info,
            left_out: frame.left_out,
            is_closed: false,
            took: Duration::ZERO,
        }
    }
}

#[cfg(feature = "mcap")]
impl Ingested {
    /// Returns the frame of a file of which these elements were not read.
    pub fn without(mut self, left_out: Vec<LeftOut>) -> Ingested {
        self.left_out.extend(left_out);
        self
    }
}

/// Result of a frame, before it goes to the sinks.
pub struct Judged {
    pub report: Arc<Report>,
    pub times: FrameTimes,
    pub work: Work,
    /// Work done on the GPU.
    pub offload: Offload,
    pub curves: Option<Arc<CurveSet>>,
    /// What the simulator told about the frame.
    pub info: FrameInfo,
    /// Model file of the frame, if it comes from one.
    pub model: Option<String>,
    /// Elements of its file that were not read.
    pub left_out: Vec<LeftOut>,
    /// Time from the receipt of the frame until its verdict was sent, if it is live.
    pub latency: Option<Duration>,
    /// Part of the time of the verification in which the clearance was measured, if it was.
    pub clearance: Option<Duration>,
    /// How the frame follows the last one.
    pub step: Step,
}

/// Inputs of a [`Session`]: baseline, settings and outputs.
pub struct Run<'a> {
    pub judge: &'a Judge,
    pub sinks: &'a Sinks,
    /// `None` if the command has no such option.
    pub junit: Option<&'a JunitArgs>,
    /// Inputs and outputs of the command so far.
    pub files: Files,
    pub strategy: Strategy,
    /// True if frames are model files, which have names and cannot be skipped.
    pub models: bool,
    /// True if frames are those of a simulator that runs.
    pub live: bool,
    /// True if frames before the first one that is verified do not count as missing.
    pub from_now: bool,
    /// Baseline that applies if the user gives none.
    pub baseline: Option<BaselineRecord>,
    /// Events and motion limit of a recording. They apply if the user gives none.
    pub recorded_events: Option<(Events, f64)>,
    /// Clearance of a recording. It applies if the user gives none.
    pub recorded_clearance: Option<ClearanceOptions>,
    /// Braids of a recording. They apply if the user gives none.
    pub recorded_braids: Option<Braids>,
    /// Names the run in the viewer.
    pub title: &'a str,
    /// Metadata of the run, for a recording.
    pub metadata: BTreeMap<String, String>,
    /// Policy if a sink is slower than the frames.
    pub overflow: Overflow,
    pub json: bool,
}

/// One run over frames.
pub struct Session {
    verifier: Verifier,
    options: VerifierOptions,
    cells: Cells,
    is_live: bool,
    from_now: bool,
    /// What the simulator told about the last verified frame, if there is one.
    last: Option<FrameInfo>,
    /// Origin of the baseline; `None` if it is the first frame.
    origin: Option<String>,
    /// `None` until a frame was verified with the baseline.
    baseline_frame: Option<BaselineFrame>,
    /// True if the sinks have an earlier baseline.
    baseline_changed: bool,
    /// Events to report.
    events: Events,
    queues: Vec<SinkQueue>,
    begun: bool,
    /// Layout of the last frame whose baseline the sinks have.
    sent_layout: u32,
    /// Frames that sinks may still hold. The next frame reuses one that is free.
    #[cfg(any(feature = "bus", feature = "mcap"))]
    pool: linkwatch::FramePool,
    /// Layout of these frames.
    #[cfg(any(feature = "bus", feature = "mcap"))]
    layout: u32,
    json: bool,
    label: Label,
    live: Live,
    /// Outcome of the run without its findings.
    outcome: Outcome,
    violations: Violations,
    news: News,
    unresolved: Unresolved,
    /// What is measured of the clearance, and its figures.
    clearance: Option<(ClearanceOptions, ClearanceLog)>,
    tally: FrameCounts,
    /// Frames that another process verified before this one. Its outputs have them.
    before: FrameCounts,
    times: RunTimes,
    /// Time that the last frame took to verify.
    #[cfg(feature = "bus")]
    last_check: Option<Duration>,
    metrics: SessionMetrics,
    /// Frames on the full, the quiet and the partial route.
    routes: [u64; 3],
    /// Number of open curves of the frames of all runs, once a frame was verified.
    open_curves: Option<u64>,
    /// True until the first frame of a run was verified.
    is_new_run: bool,
    /// Number of runs so far.
    runs: u64,
    /// Elements of the files that were not read, over all frames.
    left_out: Vec<LeftOut>,
    /// True if frames are model files.
    models: bool,
    /// Layout of the frame whose radii the verifier has.
    radii_of: Option<u32>,
    /// Comparison with the recorded verdicts, in words and as JSON, if this is a replay.
    comparison: Option<(String, serde_json::Value)>,
    junit: Option<Junit>,
    overwrite: Overwrite,
    /// True if frames are missing.
    incomplete: bool,
}

impl Session {
    /// Prepares a run.
    pub fn new(run: Run<'_>) -> Result<Session> {
        let Run {
            judge,
            sinks,
            mut files,
            mut metadata,
            ..
        } = run;
        sinks.check_files(&mut files)?;
        let junit = run.junit.map(|args| args.open(&mut files, run.title));
        let junit = junit.transpose()?.flatten();
        let baseline = match &judge.baseline {
            Some(Baseline::File(path)) => Some(BaselineRecord {
                certificate: Arc::new(Certificate::read(path)?),
                origin: path.display().to_string(),
                frame: None,
                unverified: 0,
            }),
            Some(Baseline::FirstFrame) => None,
            None => run.baseline,
        };
        let baseline_frame = baseline.as_ref().map(BaselineFrame::from);
        let abort_on = judge.abort_on.unwrap_or_default();
        metadata.insert("abort_on".into(), abort_on.to_string());
        let (default_events, default_limit) = run
            .recorded_events
            .unwrap_or((Events::Off, VerifierOptions::MOTION_LIMIT));
        let events = judge.event_args.events(abort_on).max(default_events);
        metadata.insert("events".into(), events.to_string());
        let given_limit = judge.event_args.motion_limit;
        let limit = given_limit.unwrap_or(default_limit);
        metadata.insert(MOTION_LIMIT.into(), limit.to_string());
        if judge.cell_args.keep_open() {
            metadata.insert(KEEP_OPEN.into(), "true".into());
        }
        let clearance = judge.clearance_args.options(run.recorded_clearance)?;
        if let Some(clearance) = &clearance {
            clearance_args::write(clearance, &mut metadata);
        } else if abort_on == AbortOn::Clearance {
            return Err(Error::Usage(
                "--abort-on clearance needs --thickness".into(),
            ));
        }
        let braids = judge.braid_args.braids(run.recorded_braids)?;
        if let Some(braids) = &braids {
            braid_args::write(braids, &mut metadata);
        }
        if let (Some(Braids::Auto), Some(Baseline::File(_))) = (&braids, &judge.baseline) {
            let what = "the expected linking numbers are those of another frame";
            return Err(braid_args::other_first_frame(what));
        }
        let unverified = baseline.as_ref().is_some_and(|b| b.unverified > 0);
        let baseline = baseline.map(|b| (Arc::unwrap_or_clone(b.certificate), b.origin));
        let (certificate, origin) = baseline.unzip();
        let options = VerifierOptions {
            abort_on,
            baseline: certificate,
            strategy: run.strategy,
            events,
            clearance,
            braids,
            wrapped: judge.cell_args.of_verifier(),
            max_pairs: judge.max_pairs.unwrap_or(VerifierOptions::MAX_PAIRS),
            motion_limit: match (events, run.recorded_events) {
                // The limit of a replay may differ from the recorded one without any effect.
                (Events::Off, Some(_)) => None,
                (Events::Off, None) => given_limit,
                _ => Some(limit),
            },
            ..judge.kernel.options()?
        };
        Ok(Session {
            verifier: Verifier::new(options.clone())?,
            options,
            cells: Cells::new(judge.cell_args),
            is_live: run.live,
            from_now: run.from_now,
            last: None,
            origin,
            baseline_frame,
            baseline_changed: false,
            events,
            queues: sinks.open(run.title, &metadata, (clearance, run.overflow))?,
            begun: false,
            sent_layout: 0,
            #[cfg(any(feature = "bus", feature = "mcap"))]
            pool: linkwatch::FramePool::default(),
            #[cfg(any(feature = "bus", feature = "mcap"))]
            layout: 0,
            json: run.json,
            label: Label::default(),
            live: Live::new(),
            outcome: match unverified {
                true => Outcome::Undecided,
                false => Outcome::Fine,
            },
            violations: Violations::default(),
            news: News::default(),
            unresolved: Unresolved {
                limit,
                ..Unresolved::default()
            },
            clearance: clearance.map(|options| (options, ClearanceLog::default())),
            tally: FrameCounts::default(),
            before: FrameCounts::default(),
            times: RunTimes::default(),
            #[cfg(feature = "bus")]
            last_check: None,
            metrics: SessionMetrics::default(),
            routes: [0; 3],
            open_curves: None,
            is_new_run: true,
            runs: 1,
            left_out: Vec::new(),
            models: run.models,
            radii_of: None,
            comparison: None,
            junit,
            overwrite: sinks.overwrite,
            incomplete: unverified,
        })
    }

    /// Marks all results of this run with a label.
    #[cfg(feature = "bus")]
    pub fn labelled(mut self, label: Label) -> Session {
        self.live = self.live.labelled(label.clone());
        self.label = label;
        self
    }

    /// Adds all figures of this run to these metrics.
    #[cfg(feature = "bus")]
    pub fn measured(mut self, metrics: &super::metrics::ServiceMetrics) -> Session {
        self.metrics = metrics.session(self.events != Events::Off);
        self
    }

    /// Returns the progress of the current frame.
    pub fn progress(&self) -> Arc<Progress> {
        self.verifier.progress()
    }

    /// Returns true if verifying the frame likely takes so little time that passing it to another
    /// thread does not pay: the frame is small, and the previous one was quick.
    #[cfg(feature = "bus")]
    pub fn is_quick(&self, frame: &Ingested) -> bool {
        let segments = frame.curves.as_ref().map_or(0, |set| set.segments());
        let quick = self.last_check.is_some_and(|check| check < MOMENT);
        segments <= SMALL && quick
    }

    /// Returns the outcome so far.
    pub fn outcome(&self) -> Outcome {
        self.outcome.max(self.violations.outcome())
    }

    /// Returns the number of violations that were rolled back, if this frame ends the one for which
    /// the simulator was asked to stop. Call this before [`Session::publish`].
    #[cfg(feature = "bus")]
    pub fn recovered_by(&self, judged: &Judged) -> Option<u32> {
        let Judged { report, step, .. } = judged;
        let ends = self.violations.end_with(report, *step);
        ends.then(|| self.violations.recovered_after(*step))
    }

    /// Returns what is known about the last intact frame.
    #[cfg(feature = "bus")]
    pub fn intactness(&self) -> linkwatch::Intactness {
        self.verifier.intactness()
    }

    /// Returns the output shown while the run lasts.
    #[cfg(any(feature = "bus", feature = "mcap"))]
    pub fn live(&self) -> &Live {
        &self.live
    }

    /// Copies a frame, which `read` passes to its argument. A frame that breaks its contract is
    /// rejected by [`Session::judge`]. `info` is what the simulator told about it.
    #[cfg(any(feature = "bus", feature = "mcap"))]
    pub fn ingest(
        &mut self,
        info: Result<FrameInfo>,
        read: impl FnOnce(&mut dyn FnMut(linkwatch::RawFrame<'_>) -> Result<()>) -> Result<()>,
    ) -> Ingested {
        let start = Instant::now();
        let Session {
            pool,
            verifier,
            cells,
            ..
        } = self;
        let (curves, info) = match info {
            Err(why) => (Err(why), FrameInfo::default()),
            Ok(info) => {
                if std::mem::replace(&mut self.layout, info.layout) != info.layout {
                    *pool = linkwatch::FramePool::default();
                }
                let curves = pool.receive(|set| {
                    read(&mut |frame| verifier.receive(cells.close(frame, &info)?, set))
                });
                (curves, info)
            }
        };
        Ingested {
            curves,
            info,
            left_out: cells.say(&THE_FRAMES),
            is_closed: true,
            took: start.elapsed(),
        }
    }

    /// Announces the frame that will be judged after the next one.
    #[cfg(feature = "mcap")]
    pub fn announce(&mut self, frame: &Ingested) {
        if let Ok(set) = &frame.curves {
            self.verifier.announce(set);
        }
    }

    /// Verifies one frame.
    ///
    /// Errors: [`Error::CertificateMismatch`], [`Error::NothingClosed`] and
    /// [`Error::Braid`], because later frames of
    /// the same curves fail in the same way; [`Error::Cancelled`] if the frame was not verified.
    pub fn judge(&mut self, seq: u64, time: f64, frame: Ingested) -> Result<Judged> {
        let start = Instant::now();
        let Ingested {
            curves,
            mut info,
            mut left_out,
            is_closed,
            took,
        } = frame;
        let curves = curves.and_then(|set| match is_closed {
            true => Ok(set),
            false => Ok(self.cells.close_set(&set, &info)?.map_or(set, Arc::new)),
        });
        left_out.extend(self.cells.say(&THE_FRAMES));
        let of_frame = info.cell;
        self.cells.apply(&mut info);
        let mut follows = Step::Continues;
        let jumps = self.verifier.jumps();
        let outcome = curves.and_then(|set| {
            // In a cell, the verifier unwraps.
            let unwrapped = match info.cell {
                Some(_) => None,
                None => self.cells.unwrap(&set, of_frame)?,
            };
            let set = unwrapped.map_or(set, Arc::new);
            follows = self.continue_with(seq, &info)?;
            match (info.cell, self.verifier.cell()) {
                (Some(cell), _) => {
                    self.verifier.set_cell(cell)?;
                    // In the basis in which findings name images.
                    info.cell = self.verifier.cell();
                }
                (None, Some(_)) => {
                    let what = "this frame has no periodic cell, but the previous ones had one";
                    return Err(Error::Usage(what.into()));
                }
                (None, None) => {}
            }
            let report = self.verifier.step_shared(seq, time, &set)?;
            self.commit(&info);
            // Curves that jumped are recorded as they were given: a replay follows them again.
            let placed = self
                .verifier
                .placed_curves()
                .filter(|_| self.cells.args.wrapped() == Some(true));
            Ok((report, Some(placed.cloned().unwrap_or(set))))
        });
        if jumps == 0 && self.verifier.jumps() > 0 {
            self.live.note(format_args!(
                "frame {seq}: {}; they are followed (--unwrapped takes them as they are)",
                jumped(self.verifier.jumps())
            ));
        }
        let stages = match &outcome {
            Ok(_) => self.verifier.timings(),
            Err(_) => Timings::default(),
        };
        let measured = outcome.is_ok() && self.clearance.is_some();
        self.cells.end_frame(outcome.is_ok());
        let (report, curves) = match outcome {
            Ok(verified) => verified,
            Err(Error::CertificateMismatch { certificate, model })
                if self.baseline_frame.is_none_or(|b| b.frame.is_some()) =>
            {
                let other_curves = Error::LayoutChanged {
                    what: "number of curves",
                    before: certificate as u64,
                    now: model as u64,
                };
                (self.verifier.reject(seq, time, &other_curves), None)
            }
            Err(
                e @ (Error::CertificateMismatch { .. }
                | Error::NothingClosed { .. }
                | Error::Braid(_)
                | Error::Cancelled),
            ) => return Err(e),
            Err(e) => (self.verifier.reject(seq, time, &e), None),
        };
        let times = FrameTimes {
            ingest: took,
            verification: start.elapsed(),
            stages,
            live: None,
        };
        #[cfg(feature = "bus")]
        {
            self.last_check = Some(times.check());
        }
        let (work, offload) = match report.verdict {
            Verdict::Rejected => Default::default(),
            _ => (self.verifier.work(), self.verifier.offload()),
        };
        if work.disagreed {
            tracing::error!(
                "frame {seq}: the incremental verification was wrong, which is a bug of linkwatch; \
                 this frame and all later ones are verified in full"
            );
            self.data_lost();
        }
        Ok(Judged {
            report: Arc::new(report),
            times,
            work,
            offload,
            curves,
            info,
            model: None,
            left_out,
            latency: None,
            clearance: measured.then_some(stages.clearance),
            step: follows,
        })
    }

    /// Compares what the simulator told about a valid frame with the last one that was verified.
    ///
    /// Errors: those of [`FrameInfo::change_since`].
    fn continue_with(&mut self, seq: u64, info: &FrameInfo) -> Result<Step> {
        let accepts = |last: &FrameInfo| last.baseline != info.baseline;
        let accepted = self.last.as_ref().is_some_and(accepts);
        if accepted {
            self.begin_with_next(seq)?;
        }
        let last = self.last.as_ref().unwrap_or(info);
        self.verifier.change_curves(info.change_since(last)?);
        let cut = last.cuts != info.cuts;
        if cut {
            self.live.note(format_args!(
                "frame {seq} does not continue the previous one: the simulator rolled back or \
                 jumped"
            ));
            self.verifier.cut();
        }
        if self.radii_of.replace(info.layout) != Some(info.layout)
            && let Err(e) = self.verifier.set_radii(&info.labels.radii)
        {
            tracing::warn!("clearance is not measured from frame {seq} on: {e}");
        }
        Ok(match (accepted, cut) {
            (true, _) => Step::Accepted,
            (false, true) => Step::Cut,
            (false, false) => Step::Continues,
        })
    }

    /// Takes note of a frame that was verified.
    fn commit(&mut self, info: &FrameInfo) {
        let other = |last: FrameInfo| last.layout != info.layout;
        if self.last.replace(info.clone()).is_some_and(other) {
            // The findings have other indices.
            self.news.forget();
        }
    }

    /// Passes a frame to the sinks, and prints its new findings.
    pub fn publish(&mut self, judged: Judged, tally: FrameCounts) {
        self.tally = tally;
        let recovered = self.violations.end_with(&judged.report, judged.step);
        self.violations.add(&judged.report, judged.step);
        if let Some(junit) = self.junit.as_mut().filter(|_| recovered) {
            junit.end_violation();
        }
        if judged.report.verdict != Verdict::Rejected {
            self.begin_baseline(&judged);
        }
        self.pass_baseline(&judged);
        if judged.report.verdict != Verdict::Rejected {
            if std::mem::take(&mut self.is_new_run) {
                self.warn_of_scene(&judged);
                *self.open_curves.get_or_insert(0) += judged.report.stats.open_curves;
            }
            self.times.add(&judged.times);
            self.routes[judged.work.route as usize] += 1;
        }
        self.metrics.add(&judged.report, judged.latency);
        self.print(&judged);
        if recovered && !self.json {
            let (frame, words) = (judged.report.frame(), judged.step.words());
            self.label.line(format_args!("{frame}: {words}"));
        }
        let own = tally.since(self.before);
        let record = Arc::new(FrameRecord {
            curves: judged.curves,
            info: judged.info,
            report: judged.report,
            verified: own.verified,
            skipped: own.skipped,
            rejected: own.rejected,
            recovered: self.violations.recovered,
            accepted: self.violations.accepted,
            times: judged.times,
            work: judged.work,
            received: SystemTime::now(),
        });
        self.queues
            .iter()
            .for_each(|q| q.frame(Arc::clone(&record)));
        let outputs = self.queues.iter().map(SinkQueue::summary);
        self.metrics.count(own, outputs);
    }

    /// Returns the number of curves that run through the cell, once a frame was verified.
    fn yarns(&self) -> usize {
        self.verifier.baseline().map_or(0, |b| b.periods.len())
    }

    /// Warns of properties of the curves, after the first frame.
    fn warn_of_scene(&self, judged: &Judged) {
        let name = judged.model.as_deref().unwrap_or(THE_FRAMES);
        output::warn_of_open_curves(name, &judged.report.stats, Some(self.events));
        output::tell_of_yarns(name, self.yarns(), Some(self.events));
        if let Some(curves) = &judged.curves {
            self.cells
                .args
                .warn_of_segments(name, curves, judged.info.cell);
        }
    }

    /// Prints the new findings of a report, and updates the status line.
    fn print(&mut self, judged: &Judged) {
        let Judged {
            report,
            times,
            work,
            offload,
            model,
            info,
            left_out,
            ..
        } = judged;
        let new_kind = LeftOut::merge(&mut self.left_out, left_out);
        if !left_out.is_empty() {
            self.data_lost();
        }
        let names = &info.labels.names;
        if self.json {
            let mut line = serde_json::json!({
                "report": **report,
                "ms": times.check().as_secs_f64() * 1e3,
                "times_ms": to_json(times, judged.clearance),
                "work": work,
                "offload": offload,
                "verified": self.tally.verified,
                "skipped": self.tally.skipped,
                "rejected": self.tally.rejected,
            });
            if let Some(model) = model {
                line["model"] = model.as_str().into();
                line["left_out"] = serde_json::json!(left_out);
            }
            self.label.json(line);
        }
        if let Some(junit) = &mut self.junit {
            junit.add(report, names, model.as_deref(), times.check());
        }
        self.unresolved.add(report);
        let news = self.news.of(report, names, model.as_deref());
        let violation = self.news.first_violation.as_ref();
        let low = match &mut self.clearance {
            Some((_, log)) => log.add(report, names, violation),
            None => None,
        };
        match model {
            _ if self.json => {}
            Some(model) => {
                print_model(model, report, &news);
                if new_kind {
                    output::line(format_args!("  {}", LeftOut::sentence(left_out)));
                }
            }
            None if news.notable => print_frame(&self.label, judged, &news),
            None => {}
        }
        if let Some(low) = low.filter(|_| !self.json) {
            match model {
                Some(_) => output::line(format_args!("  {low}")),
                None => self.label.line(low),
            }
            if report.abort && !news.notable {
                self.label.line(abort_words(judged));
            }
        }
        if model.is_none() {
            self.live.status(format_args!(
                "{}: {}, {} ({}); {} verified, {} skipped",
                report.frame(),
                report.verdict,
                millis(times.check()),
                in_words(work, *offload),
                count(self.tally.verified),
                count(self.tally.skipped),
            ));
        }
    }

    /// Records that the run is incomplete.
    pub fn data_lost(&mut self) {
        self.outcome = self.outcome.max(Outcome::Undecided);
        self.incomplete = true;
    }

    /// Adds the comparison with the recorded verdicts to the summary.
    #[cfg(feature = "mcap")]
    pub fn compared(&mut self, words: String, json: serde_json::Value) {
        self.comparison = Some((words, json));
    }

    /// Closes the sinks and prints the summary. `tally` has the final counts of all frames.
    pub fn finish(mut self, tally: FrameCounts) -> Outcome {
        self.tally = tally;
        let mut kept = Vec::new();
        let mut summaries = Vec::new();
        let start = Instant::now();
        for queue in std::mem::take(&mut self.queues) {
            let complete = queue.requires_all_frames();
            let summary = queue.finish(FINISH.saturating_sub(start.elapsed()));
            let all = plural(summary.written + summary.dropped, "frame");
            match &summary.failed {
                // The sink logged the reason when it failed. Its note tells how much it has.
                Some(_) if summary.note.is_some() => {
                    tracing::error!("{} is incomplete", summary.name);
                }
                Some(_) => tracing::error!(
                    "{} is incomplete: it has at least {} of {all}",
                    summary.name,
                    count(summary.written),
                ),
                None if summary.dropped > 0 => {
                    let missed = count(summary.dropped);
                    kept.push(format!(
                        "{} missed {missed} of {all}: it is too slow",
                        summary.name
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
        let own = tally.since(self.before);
        self.metrics.count(own, summaries.iter().cloned());
        if tally.verified == 0 || self.verifier.unmeasured_clearance().is_some() {
            self.data_lost();
        }
        if let Some(junit) = self.junit.take()
            && let Err(e) = junit.write(!self.incomplete, self.overwrite)
        {
            tracing::error!("{e}");
            self.data_lost();
        }
        self.live.clear();
        // The verdict on a single model is its summary.
        if !(self.models && tally.verified + tally.rejected <= 1) {
            self.sum_up(&summaries, kept);
        }
        self.outcome()
    }

    /// Prints the summary.
    fn sum_up(&self, sinks: &[SinkSummary], notes: Vec<String>) {
        let tally = self.tally;
        let Violations {
            recovered,
            accepted,
            ..
        } = self.violations;
        let word = match (tally.verified, self.outcome()) {
            (0, _) => "nothing was verified",
            (_, Outcome::Fine) if accepted > 0 => "accepted",
            (_, Outcome::Fine) if recovered > 0 => "recovered",
            (_, Outcome::Fine) => "intact",
            (_, Outcome::Changed) => "changed",
            (_, Outcome::Undecided) => "undecided or incomplete",
        };
        let [full, quiet, partial] = self.routes;
        let first = &self.news.first_violation;
        let checked = self.events != Events::Off;
        if self.json {
            self.label.json(serde_json::json!({
                "summary": {
                    "verdict": word,
                    "recovered": recovered,
                    "accepted": accepted,
                    "baseline": self.baseline_json(),
                    "verified": tally.verified,
                    "skipped": tally.skipped,
                    "skipped_share": tally.skipped_share(),
                    "rejected": tally.rejected,
                    "median_ms": self.times.checks.median().as_secs_f64() * 1e3,
                    "max_ms": self.times.checks.longest.as_secs_f64() * 1e3,
                    "times_ms": self.times.to_json(),
                    "first_violation": first,
                    "routes": { "full": full, "quiet": quiet, "partial": partial },
                    "runs": self.runs,
                    "open_curves": self.open_curves,
                    "joined_curves": self.cells.joined(),
                    "open_curves_verified": checked,
                    "left_out": self.left_out,
                    "curves_through_the_cell": self.yarns(),
                    "jumps": self.verifier.jumps(),
                    "sinks": sinks,
                    "recorded_verdicts": self.comparison.as_ref().map(|(_, json)| json),
                    "unresolved": self.unresolved,
                    "clearance": self.clearance.as_ref().and_then(|(_, log)| log.to_json()),
                    "unmeasured_clearance": self.verifier.unmeasured_clearance(),
                }
            }));
            return;
        }
        let mut line = format!("{word}: {}", tally.words(self.models));
        if tally.verified > 0 {
            line += &format!("; {}", self.times.checks.words());
        }
        if self.runs > 1 {
            let runs = plural(self.runs, "run");
            line += &format!(
                "\n{runs}, each compared with its own first frame (--one-motion: all files are \
                 one motion)"
            );
        }
        if quiet + partial > 0 {
            let [quiet, partial, full] = [quiet, partial, full].map(count);
            line += &format!("\nframes: {quiet} quiet, {partial} partial, {full} full");
        }
        if let Some(times) = self.times.words() {
            line += &format!("\n{times}");
        }
        if self.is_live
            && let Some(words) = self.baseline_words()
        {
            line += &format!("\n{words}");
        }
        for (n, what) in [
            (
                recovered,
                "rolled back, and the simulation went on from an intact frame",
            ),
            (accepted, "accepted by the simulator as a new baseline"),
        ] {
            if n > 0 {
                let violations = plural_of(n.into(), "violation was", "violations were");
                line += &format!("\n{violations} {what}");
            }
        }
        match first {
            // The findings of each model are printed above.
            Some(first) if self.models => line += &format!("\nfirst violation: {}", first.name),
            Some(first) => line += &format!("\nfirst violation: {first}"),
            None => {}
        }
        if let Some(words) = self
            .clearance
            .as_ref()
            .and_then(|(o, log)| log.words(o.low))
        {
            line += &format!("\n{words}");
        }
        if let Some(why) = self.verifier.unmeasured_clearance() {
            line += &format!("\nclearance was not measured in all frames: {why}");
        }
        if self.unresolved.pull_throughs > 0 {
            line += &format!("\n{}", self.unresolved.words());
        }
        if let Some(n @ 1..) = self.open_curves {
            let curves = plural(n, "open curve");
            line += &match checked {
                true => format!("\n{curves} verified for pull-throughs, without linking numbers"),
                false => format!("\nnot verified: {curves} (--events verifies pull-throughs)"),
            };
        }
        if !self.left_out.is_empty() {
            line += &format!("\n{}", LeftOut::sentence(&self.left_out));
        }
        if self.verifier.jumps() > 0 {
            line += &format!("\n{}, and were followed", jumped(self.verifier.jumps()));
        }
        if let (yarns @ 2.., false) = (self.yarns(), checked) {
            let curves = count(yarns as u64);
            line += &format!(
                "\nnot verified: pull-throughs of {curves} curves that run through the cell \
                 (--events verifies them)"
            );
        }
        if let Some((words, _)) = &self.comparison {
            line += &format!("\n{words}");
        }
        for note in notes {
            line += &format!("\n{note}");
        }
        self.label.line(line);
    }
}

/// Returns how many times curves jumped, in words.
fn jumped(count: u64) -> String {
    let times = plural(count, "time");
    format!("curves jumped by a vector of the periodic cell {times}")
}

/// Prints the verdict on a frame of a stream, and its new findings.
fn print_frame(label: &Label, judged: &Judged, news: &New) {
    let Judged { report, times, .. } = judged;
    label.line(format_args!(
        "{} (checked in {})",
        report.headline(),
        millis(times.check())
    ));
    for sentence in news.sentences.iter().take(SENTENCES) {
        label.line(format_args!("  {sentence}"));
    }
    if news.sentences.len() > SENTENCES {
        let more = news.sentences.len() - SENTENCES;
        label.line(format_args!("  and {more} more"));
    }
    if !news.sentences.is_empty()
        && let Some(words) = report.roll_back()
    {
        label.line(format_args!("  to roll back: {words}"));
    }
    if report.abort {
        label.line(abort_words(judged));
    }
}

/// Returns the line below a finding that asks the simulator to stop.
fn abort_words(judged: &Judged) -> &'static str {
    match judged.latency {
        Some(_) => "  abort sent: the simulator is asked to stop",
        None => "  abort: a watch asks the simulator to stop here",
    }
}

/// Prints the verdict on a model file, and its new findings.
fn print_model(model: &str, report: &Report, news: &New) {
    output::line(format_args!("{model}: {}", report.verdict));
    let others = report.missing.iter().chain(&report.rejected);
    for sentence in news.sentences.iter().chain(others) {
        output::line(format_args!("  {sentence}"));
    }
    if let Some(words) = report.change_of_curves() {
        output::line(format_args!("  {words}"));
    }
    if news.known > 0 {
        let known = plural(news.known as u64, "finding");
        output::line(format_args!("  {known} as in the previous model"));
    }
    if report.stats.unchecked > 0 {
        let unchecked = plural(report.stats.unchecked, "pair");
        output::line(format_args!("  {unchecked} not checked"));
    }
}

/// Describes the work of a frame in a few words.
fn in_words(work: &Work, offload: Offload) -> String {
    let age = match work.reference_age {
        Some(age) => format!(", reference {}", plural(age, "frame")),
        None => String::new(),
    };
    match work.route {
        Route::Quiet => format!("quiet{age}"),
        Route::Full => {
            let summed = match work.summed {
                0 => String::new(),
                n => format!(", {} decided by sums", count(n)),
            };
            let offloaded = match offload.tests {
                0 => String::new(),
                n => format!(", {} on the GPU", plural(n, "test")),
            };
            format!(
                "full, {}{summed}{offloaded}{age}",
                plural(work.recomputed, "pair")
            )
        }
        Route::Partial => format!(
            "partial, {} searched, {} recomputed{age}",
            plural(work.searched, "pair"),
            count(work.recomputed),
        ),
    }
}
