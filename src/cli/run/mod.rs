//! Verification of frames and output to sinks, shared by `watch`, `replay` and `check`.

mod baseline;
mod clearance;
mod junit;
mod news;
#[cfg(feature = "mcap")]
mod record;
mod sinks;
#[cfg(feature = "bus")]
mod state;
mod summary;
mod times;
#[cfg(feature = "rerun")]
mod viewer;
#[cfg(not(feature = "rerun"))]
#[path = "no_viewer.rs"]
mod viewer;
mod violations;

pub use junit::JunitArgs;
pub use sinks::Sinks;
#[cfg(feature = "bus")]
pub use state::RunState;
pub use summary::FrameCounts;

use self::baseline::BaselineFrame;
use self::clearance::ClearanceLog;
use self::junit::Junit;
use self::news::{New, News};
use self::summary::Unresolved;
use self::times::{RunTimes, to_json};
use self::violations::Violations;
use super::Outcome;
use super::braid_args::{self, BraidArgs};
use super::cell_args::{CellArgs, KEEP_OPEN, say};
use super::clearance_args::{self, ClearanceArgs};
use super::event_args::EventArgs;
use super::files::{Files, Overwrite};
use super::label::Label;
use super::live::Live;
use super::metrics::SessionMetrics;
use super::output::{self, count, millis, plural, plural_of};
use super::sequence::Frame;
use linkwatch::kernels::Offload;
use linkwatch::model::LeftOut;
use linkwatch::{
    AbortOn, BaselineRecord, Braids, Certificate, ClearanceOptions, Continuation, CurveSet, Error,
    Events, FrameInfo, FrameRecord, FrameTimes, Overflow, Progress, Received, Report, Result,
    Route, RunProgress, Session, SessionOptions, SinkQueue, SinkSummary, Strategy, Verdict, Work,
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
    /// Expected linking numbers: of the first frame, or a file
    ///
    /// `first-frame`, or a certificate as `linkwatch certify -o` writes it [default: first-frame;
    /// replay: as recorded]
    #[arg(long, value_name = "first-frame|CERT")]
    pub baseline: Option<Baseline>,
    /// Findings that ask the simulator to stop: any, .., never
    ///
    /// any, lost, gained, contact, event, rejected, clearance (any, or strands that come too close,
    /// with --radius) or never [default: any; replay: as recorded]
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
    /// Reject frames in which the boxes of more pairs of curves overlap
    ///
    /// The memory for them, up to 200 bytes each, may not be there [default: 33554432]
    #[arg(long, value_name = "N", hide_short_help = true)]
    pub max_pairs: Option<usize>,
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

/// A frame to judge.
pub struct Ingested {
    received: Received,
    /// Elements of a file that may be curves of the frame, and were not read.
    left_out: Vec<LeftOut>,
}

impl From<Received> for Ingested {
    fn from(received: Received) -> Ingested {
        Ingested {
            received,
            left_out: Vec::new(),
        }
    }
}

#[cfg(feature = "bus")]
impl Ingested {
    /// Returns a frame that is rejected for this reason.
    pub fn invalid(info: FrameInfo, why: Error) -> Ingested {
        Received::new(info, Err(why)).into()
    }
}

impl From<Frame> for Ingested {
    /// Wraps a frame that was read already.
    fn from(frame: Frame) -> Ingested {
        Ingested {
            received: Received::new(frame.info, frame.curves.map(Arc::new)),
            left_out: frame.left_out,
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
    pub step: Continuation,
}

/// Inputs of a [`Run`]: baseline, settings and outputs.
pub struct Setup<'a> {
    pub judge: &'a Judge,
    pub sinks: &'a Sinks,
    /// `None` if the command has no such option.
    pub junit: Option<&'a JunitArgs>,
    /// Inputs and outputs of the command so far.
    pub files: Files,
    pub strategy: Strategy,
    /// See [`SessionOptions::early_exit`].
    pub early_exit: bool,
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

/// One run over frames: a session, and the outputs of its reports.
pub struct Run {
    session: Session,
    #[cfg(feature = "bus")]
    options: SessionOptions,
    cell_args: CellArgs,
    /// Numbers of curves that end where they start, and of jumps by a lattice vector.
    joined: usize,
    jumps: u64,
    /// Reason why clearance is not measured, although the user asked for it.
    unmeasured: Option<String>,
    is_live: bool,
    from_now: bool,
    /// Layout of the last verified frame, if there is one.
    last_layout: Option<u32>,
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
    /// Comparison with the recorded verdicts, in words and as JSON, if this is a replay.
    comparison: Option<(String, serde_json::Value)>,
    junit: Option<Junit>,
    overwrite: Overwrite,
    /// True if frames are missing.
    incomplete: bool,
}

impl Run {
    /// Prepares a run.
    pub fn new(setup: Setup<'_>) -> Result<Run> {
        let Setup {
            judge,
            sinks,
            mut files,
            mut metadata,
            ..
        } = setup;
        sinks.check_files(&mut files)?;
        let junit = setup.junit.map(|args| args.open(&mut files, setup.title));
        let junit = junit.transpose()?.flatten();
        let baseline = match &judge.baseline {
            Some(Baseline::File(path)) => Some(BaselineRecord {
                certificate: Arc::new(Certificate::read(path)?),
                origin: path.display().to_string(),
                frame: None,
                unverified: 0,
            }),
            Some(Baseline::FirstFrame) => None,
            None => setup.baseline,
        };
        let baseline_frame = baseline.as_ref().map(BaselineFrame::from);
        let abort_on = judge.abort_on.unwrap_or_default();
        metadata.insert("abort_on".into(), abort_on.to_string());
        let (default_events, default_limit) = setup
            .recorded_events
            .unwrap_or((Events::Off, SessionOptions::MOTION_LIMIT));
        let events = judge.event_args.events(abort_on, default_events);
        metadata.insert("events".into(), events.to_string());
        let given_limit = judge.event_args.motion_limit;
        let limit = given_limit.unwrap_or(default_limit);
        metadata.insert(MOTION_LIMIT.into(), limit.to_string());
        if judge.cell_args.keep_open() {
            metadata.insert(KEEP_OPEN.into(), "true".into());
        }
        let clearance = judge.clearance_args.options(setup.recorded_clearance)?;
        if let Some(clearance) = &clearance {
            clearance_args::write(clearance, &mut metadata);
        } else if abort_on == AbortOn::Clearance {
            return Err(Error::Usage("--abort-on clearance needs --radius".into()));
        }
        let braids = judge.braid_args.braids(setup.recorded_braids)?;
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
        let options = SessionOptions {
            abort_on,
            baseline: certificate,
            strategy: setup.strategy,
            early_exit: setup.early_exit,
            events,
            clearance,
            braids,
            cell: judge.cell_args.given(),
            ignore_cell: judge.cell_args.ignores_cells(),
            wrapped: judge.cell_args.wrapped(),
            keep_open: judge.cell_args.keep_open(),
            max_pairs: judge.max_pairs.unwrap_or(SessionOptions::MAX_PAIRS),
            motion_limit: match (events, setup.recorded_events) {
                // The limit of a replay may differ from the recorded one without any effect.
                (Events::Off, Some(_)) => None,
                (Events::Off, None) => given_limit,
                _ => Some(limit),
            },
            ..SessionOptions::default()
        };
        Ok(Run {
            #[cfg(feature = "bus")]
            options: options.clone(),
            session: Session::new(options)?,
            cell_args: judge.cell_args,
            joined: 0,
            jumps: 0,
            unmeasured: None,
            is_live: setup.live,
            from_now: setup.from_now,
            last_layout: None,
            origin,
            baseline_frame,
            baseline_changed: false,
            events,
            queues: sinks.open(setup.title, &metadata, (clearance, setup.overflow))?,
            begun: false,
            sent_layout: 0,
            json: setup.json,
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
            models: setup.models,
            comparison: None,
            junit,
            overwrite: sinks.overwrite,
            incomplete: unverified,
        })
    }

    /// Marks all results of this run with a label.
    #[cfg(feature = "bus")]
    pub fn labelled(mut self, label: Label) -> Run {
        self.live = self.live.labelled(label.clone());
        self.label = label;
        self
    }

    /// Adds all figures of this run to these metrics.
    #[cfg(feature = "bus")]
    pub fn measured(mut self, metrics: &super::metrics::ServiceMetrics) -> Run {
        self.metrics = metrics.session(self.events != Events::Off);
        self
    }

    /// Returns the progress of the current frame.
    pub fn progress(&self) -> Arc<Progress> {
        self.session.progress()
    }

    /// Returns true if verifying the frame likely takes so little time that passing it to another
    /// thread does not pay: the frame is small, and the previous one was quick.
    #[cfg(feature = "bus")]
    pub fn is_quick(&self, frame: &Ingested) -> bool {
        let quick = self.last_check.is_some_and(|check| check < MOMENT);
        frame.received.segments() <= SMALL && quick
    }

    /// Returns the outcome so far.
    pub fn outcome(&self) -> Outcome {
        self.outcome.max(self.violations.outcome())
    }

    /// Returns the number of violations that were rolled back, if this frame ends the one for which
    /// the simulator was asked to stop. Call this before [`Run::publish`].
    #[cfg(feature = "bus")]
    pub fn recovered_by(&self, judged: &Judged) -> Option<u32> {
        let Judged { report, step, .. } = judged;
        let ends = self.violations.end_with(report, *step);
        ends.then(|| self.violations.recovered_after(*step))
    }

    /// Returns the output shown while the run lasts.
    #[cfg(any(feature = "bus", feature = "mcap"))]
    pub fn live(&self) -> &Live {
        &self.live
    }

    /// Copies a frame, which `read` passes to its argument. A frame that breaks its contract is
    /// rejected by [`Run::judge`]. `info` is what the simulator told about it.
    #[cfg(any(feature = "bus", feature = "mcap"))]
    pub fn ingest(
        &mut self,
        info: FrameInfo,
        read: impl FnOnce(&mut dyn FnMut(linkwatch::RawFrame<'_>) -> Result<()>) -> Result<()>,
    ) -> Ingested {
        self.session.receive(info, read).into()
    }

    /// Announces the frame that will be judged after the next one.
    #[cfg(feature = "mcap")]
    pub fn announce(&mut self, frame: &Ingested) {
        self.session.announce(&frame.received);
    }

    /// Verifies one frame.
    ///
    /// Errors: those of [`Session::verify`].
    pub fn judge(&mut self, frame: Ingested) -> Result<Judged> {
        let Ingested {
            received,
            mut left_out,
        } = frame;
        let verified = self.session.verify(received)?;
        let seq = verified.report.seq;
        left_out.extend(say(&THE_FRAMES, &verified.notes));
        if verified.continuation == Continuation::Cut {
            self.live.note(format_args!(
                "frame {seq} does not continue the previous one: the simulator rolled back or \
                 jumped"
            ));
        }
        if self.jumps == 0 && verified.jumps > 0 {
            self.live.note(format_args!(
                "frame {seq}: {}; they are followed (--wrapped=false takes them as they are)",
                jumped(verified.jumps)
            ));
        }
        (self.joined, self.jumps) = (verified.joined, verified.jumps);
        // Frames before a change of the curves may lack a clearance that later ones have.
        self.unmeasured = self.unmeasured.take().or(verified.unmeasured);
        if verified.curves.is_some() {
            self.take_note(&verified.info, verified.continuation);
        }
        let times = FrameTimes {
            ingest: verified.ingest,
            verification: verified.verification,
            stages: verified.timings,
            live: None,
        };
        #[cfg(feature = "bus")]
        {
            self.last_check = Some(times.check());
        }
        if verified.work.disagreed {
            tracing::error!(
                "frame {seq}: the incremental verification was wrong, which is a bug of linkwatch; \
                 this frame and all later ones are verified in full"
            );
            self.data_lost();
        }
        let measured = verified.curves.is_some() && self.clearance.is_some();
        Ok(Judged {
            report: Arc::new(verified.report),
            times,
            work: verified.work,
            offload: verified.offload,
            curves: verified.curves,
            info: verified.info,
            model: None,
            left_out,
            latency: None,
            clearance: measured.then_some(verified.timings.clearance),
            step: verified.continuation,
        })
    }

    /// Takes note of a frame that was verified.
    fn take_note(&mut self, info: &FrameInfo, continuation: Continuation) {
        if continuation == Continuation::Accepted {
            self.origin = Some(format!("frame {}, accepted by the simulator", info.seq));
            self.baseline_frame = None;
            self.baseline_changed = true;
            self.news.forget();
        }
        let other = |last: u32| last != info.layout;
        if self.last_layout.replace(info.layout).is_some_and(other) {
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
            let (frame, words) = (judged.report.frame(), violations::words(judged.step));
            self.label.line(format_args!("{frame}: {words}"));
        }
        let own = tally.since(self.before);
        let record = Arc::new(FrameRecord {
            curves: judged.curves,
            info: judged.info,
            report: judged.report,
            progress: RunProgress {
                verified: own.verified,
                skipped: own.skipped,
                rejected: own.rejected,
                recovered: self.violations.recovered,
                accepted: self.violations.accepted,
                times: judged.times,
                work: judged.work,
                ..RunProgress::default()
            }
            .received(SystemTime::now()),
        });
        self.queues
            .iter()
            .for_each(|q| q.frame(Arc::clone(&record)));
        let outputs = self.queues.iter().map(SinkQueue::summary);
        self.metrics.count(own, outputs);
    }

    /// Returns the number of curves that run through the cell, once a frame was verified.
    fn yarns(&self) -> usize {
        self.session.baseline().map_or(0, |b| b.periods.len())
    }

    /// Warns of properties of the curves, after the first frame.
    fn warn_of_scene(&self, judged: &Judged) {
        let name = judged.model.as_deref().unwrap_or(THE_FRAMES);
        output::warn_of_open_curves(name, &judged.report.stats, Some(self.events));
        output::tell_of_yarns(name, self.yarns(), Some(self.events));
        if let Some(curves) = &judged.curves {
            self.cell_args
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
        if tally.verified == 0 || self.unmeasured.is_some() {
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
                    "joined_curves": self.joined,
                    "open_curves_verified": checked,
                    "left_out": self.left_out,
                    "curves_through_the_cell": self.yarns(),
                    "jumps": self.jumps,
                    "sinks": sinks,
                    "recorded_verdicts": self.comparison.as_ref().map(|(_, json)| json),
                    "unresolved": self.unresolved,
                    "clearance": self.clearance.as_ref().and_then(|(_, log)| log.to_json()),
                    "unmeasured_clearance": self.unmeasured,
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
        if let Some(why) = &self.unmeasured {
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
        if self.jumps > 0 {
            line += &format!("\n{}, and were followed", jumped(self.jumps));
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
