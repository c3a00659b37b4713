//! Frames to verdicts to sinks: what `watch` and `replay` share.

use super::Outcome;
#[cfg(any(feature = "mcap", feature = "rerun"))]
use super::files::{Content, claim};
use super::files::{Files, Overwrite};
use super::kernel::KernelArgs;
use super::live::Live;
use super::look_for::LookFor;
use super::output::{self, count, millis, percent, plural};
use linkwatch::kernels::Offload;
use linkwatch::{
    AbortOn, BaselineRecord, Certificate, Change, CurveSet, Defect, DefectKind, Error, Events,
    FrameRecord, Overflow, Progress, PullThrough, Report, Result, Route, SinkQueue, Verdict,
    Verifier, Work,
};
#[cfg(feature = "rerun")]
use linkwatch::{ViewerSink, ViewerTarget};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

/// The motion limit in the metadata of a recording.
pub const MOTION_LIMIT: &str = "motion_limit";

/// Sentences printed about one frame; the rest is counted.
const SENTENCES: usize = 8;

/// Number of segments up to which any frame is verified quickly, whatever its motion.
#[cfg(feature = "bus")]
const SMALL: usize = 4096;

/// Verification time from which the cost of handing a frame to another thread is negligible.
#[cfg(feature = "bus")]
const MOMENT: Duration = Duration::from_millis(1);

/// Frames that may wait for a sink.
#[cfg(any(feature = "mcap", feature = "rerun"))]
const WAITING: usize = 8;

/// Number of points of the frames that may wait for a file in addition: about 50 MB.
#[cfg(any(feature = "mcap", feature = "rerun"))]
const WAITING_POINTS: usize = 1_000_000;

/// Time limit for all sinks together to finish at the end of the run.
const FINISH: Duration = Duration::from_secs(30);

/// Time limit for a viewer to open before the run begins. After that it opens in the background.
#[cfg(feature = "rerun")]
const OPEN: Duration = Duration::from_secs(10);

/// What frames are compared with, what is looked for, and what to do about it.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = super::COMPARE)]
pub struct Judge {
    /// What frames are compared with: `first-frame`, or a certificate file [default: first-frame;
    /// replay: as recorded]
    #[arg(long, value_name = "first-frame|CERT")]
    pub baseline: Option<Baseline>,
    /// Findings that ask the simulator to stop: any, lost, gained, contact, event, rejected or
    /// never [default: any; replay: as recorded]
    #[arg(long, value_name = "WHAT")]
    pub abort_on: Option<AbortOn>,
    #[command(flatten)]
    pub look_for: LookFor,
    /// Set by the command, so that its help lists kernels last.
    #[arg(skip)]
    pub kernel: KernelArgs,
    /// Verify every frame in full as well, and compare: slow, a test of linkwatch itself
    #[arg(long, hide_short_help = true)]
    pub paranoid: bool,
}

/// Where expected linking numbers come from.
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

/// Where verified frames go.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = super::WRITE)]
pub struct Sinks {
    /// Record every verified frame and verdict to an MCAP file
    #[cfg(feature = "mcap")]
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
    /// Show every frame in the viewer (opens an installed `rerun`)
    #[cfg(feature = "rerun")]
    #[arg(long, group = "shown")]
    view: bool,
    /// Write every frame to a file for the viewer (`rerun FILE.rrd` opens it)
    #[cfg(feature = "rerun")]
    #[arg(long, value_name = "FILE.rrd", group = "shown")]
    rrd: Option<PathBuf>,
    /// Show every frame in a viewer that is running
    #[cfg(feature = "rerun")]
    #[arg(long, value_name = "URL", group = "shown")]
    connect: Option<String>,
    #[command(flatten)]
    overwrite: Overwrite,
}

impl Sinks {
    /// Checks the output files, which must differ from the inputs.
    fn check_files(&self, inputs: &[&PathBuf]) -> Result<()> {
        let mut files = Files::new(self.overwrite);
        inputs.iter().for_each(|path| files.reads(path));
        #[cfg(feature = "mcap")]
        if let Some(path) = &self.record {
            files.writes("--record", path, Content::Recording)?;
        }
        #[cfg(feature = "rerun")]
        if let Some(path) = &self.rrd {
            files.writes("--rrd", path, Content::Viewer)?;
        }
        Ok(())
    }

    /// Prepares verifier and sinks. Files are created at the first frame. `title` names the run in
    /// the viewer.
    fn open(
        &self,
        title: &str,
        metadata: &BTreeMap<String, String>,
        overflow: Overflow,
    ) -> Result<Vec<SinkQueue>> {
        let queues = [
            self.open_recording(metadata, overflow)?,
            self.open_viewer(title, overflow)?,
        ];
        Ok(queues.into_iter().flatten().collect())
    }

    #[cfg(feature = "mcap")]
    fn open_recording(
        &self,
        metadata: &BTreeMap<String, String>,
        overflow: Overflow,
    ) -> Result<Option<SinkQueue>> {
        let Some(path) = self.record.clone() else {
            return Ok(None);
        };
        let (metadata, overwrite) = (metadata.clone(), self.overwrite);
        let queue = SinkQueue::spawn("recording", WAITING, overflow, move || {
            claim(&path, overwrite)?;
            Ok(Box::new(linkwatch::RecordingSink::create(
                &path, &metadata,
            )?))
        })?;
        Ok(Some(queue.with_points(WAITING_POINTS)))
    }

    #[cfg(not(feature = "mcap"))]
    fn open_recording(
        &self,
        _: &BTreeMap<String, String>,
        _: Overflow,
    ) -> Result<Option<SinkQueue>> {
        Ok(None)
    }

    #[cfg(feature = "rerun")]
    fn open_viewer(&self, title: &str, overflow: Overflow) -> Result<Option<SinkQueue>> {
        let (title, overwrite) = (title.to_owned(), self.overwrite);
        if let Some(path) = self.rrd.clone() {
            let queue = SinkQueue::spawn("viewer", WAITING, overflow, move || {
                claim(&path, overwrite)?;
                Ok(Box::new(ViewerSink::open(
                    &ViewerTarget::File(path),
                    &title,
                )?))
            });
            return Ok(Some(queue?.with_points(WAITING_POINTS)));
        }
        let target = match &self.connect {
            Some(url) => ViewerTarget::Connect(url.clone()),
            None if self.view => ViewerTarget::Spawn,
            None => return Ok(None),
        };
        // A file must be complete, or it misleads; a live viewer may miss a frame.
        let queue = SinkQueue::spawn("viewer", WAITING, Overflow::DropOldest, move || {
            Ok(Box::new(ViewerSink::open(&target, &title)?))
        })?;
        // If the viewer cannot be reached, the command fails at once, not at its first frame.
        queue.open(OPEN)?;
        Ok(Some(queue))
    }

    #[cfg(not(feature = "rerun"))]
    fn open_viewer(&self, _: &str, _: Overflow) -> Result<Option<SinkQueue>> {
        Ok(None)
    }
}

/// A frame as curves, or why it is none.
pub struct Ingested {
    curves: Result<Arc<CurveSet>>,
    took: Duration,
}

/// What was found out about a frame, before it goes to the sinks.
pub struct Judged {
    pub report: Arc<Report>,
    pub check: Duration,
    pub work: Work,
    /// What a graphics processor was given.
    pub offload: Offload,
    pub curves: Option<Arc<CurveSet>>,
    /// Number of cuts that the simulator made before this frame.
    pub cuts: u32,
}

/// Frames verified, skipped and rejected so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    pub verified: u64,
    pub skipped: u64,
    pub rejected: u64,
}

impl Tally {
    /// Returns the share of all frames that were skipped.
    pub fn skipped_share(self) -> f64 {
        let all = self.verified + self.skipped + self.rejected;
        self.skipped as f64 / all.max(1) as f64
    }
}

/// Inputs of a [`Session`]: baseline, settings and outputs.
pub struct Run<'a> {
    pub judge: &'a Judge,
    pub sinks: &'a Sinks,
    /// Recording that is read, if the input is one.
    pub recording: Option<&'a PathBuf>,
    /// Baseline, events and motion limit that apply if the user gives none.
    pub baseline: Option<(Certificate, String)>,
    pub look_for: (Events, f64),
    /// Names the run in the viewer.
    pub title: &'a str,
    /// Metadata of the run, for a recording.
    pub metadata: BTreeMap<String, String>,
    /// Policy if stdout or a sink is slower than the frames.
    pub overflow: Overflow,
    pub json: bool,
}

/// A finding that may last over several frames: a change, identified by its curves and number, or a
/// defect, identified by its curves and kind.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Told {
    Change(u32, u32, i64),
    Defect(u32, Option<u32>, DefectKind),
}

impl From<&Change> for Told {
    fn from(c: &Change) -> Told {
        Told::Change(c.i, c.j, c.found)
    }
}

impl From<&Defect> for Told {
    fn from(d: &Defect) -> Told {
        Told::Defect(d.i, d.j, d.kind)
    }
}

/// Pull-throughs that cannot be resolved, because the frames are too far apart.
#[derive(Clone, Copy, Default)]
struct Unresolved {
    count: u64,
    frames: u64,
    /// The largest motion of the unresolved pull-throughs, in segment lengths.
    lengths: f64,
}

impl Unresolved {
    fn add(&mut self, report: &Report) {
        self.count += report.unresolved.len() as u64;
        self.frames += u64::from(!report.unresolved.is_empty());
        let lengths = report.unresolved.iter().map(|p| p.lengths);
        self.lengths = lengths.fold(self.lengths, f64::max);
    }

    /// Returns a sentence with their number, and the factor by which frames would have to be closer
    /// together to keep all of them within the limit.
    fn words(&self, limit: f64) -> String {
        let remedy = match limit {
            0.0 => "none is resolved".to_owned(),
            limit => {
                let closer = (self.lengths / limit).ceil();
                format!("frames {closer} times closer together would resolve them")
            }
        };
        format!(
            "unresolved: {} in {}, with motions of up to {:.1} segment lengths a frame; {remedy} (--motion-limit {limit})",
            plural(self.count, "pull-through"),
            plural(self.frames, "frame"),
            self.lengths,
        )
    }
}

/// One run over frames.
pub struct Session {
    /// Motion limit in segment lengths.
    motion_limit: f64,
    verifier: Verifier,
    /// Cuts before the last verified frame. A frame with another number does not continue that one.
    cuts: u32,
    /// Where the baseline comes from, in words.
    origin: String,
    queues: Vec<SinkQueue>,
    begun: bool,
    /// Frames that sinks may still hold; one that nobody holds any more takes the next frame.
    pool: Vec<Arc<CurveSet>>,
    json: bool,
    live: Live,
    outcome: Outcome,
    last_verdict: Option<Verdict>,
    /// Changes and defects of the last frame. They have been printed already.
    told: BTreeSet<Told>,
    unresolved: Unresolved,
    first_violation: Option<String>,
    tally: Tally,
    checks: Durations,
    /// Time that the last frame took to verify.
    #[cfg(feature = "bus")]
    last_check: Option<Duration>,
    /// Frames that took the full, the quiet and the partial way.
    routes: [u64; 3],
    /// Curves left out of every verdict, once a frame was verified.
    open_curves: Option<u64>,
    /// Comparison with the recorded verdicts, in words and as JSON, if this is a replay.
    comparison: Option<(String, serde_json::Value)>,
}

impl Session {
    /// Prepares a run.
    pub fn new(run: Run<'_>) -> Result<Session> {
        let Run {
            judge,
            sinks,
            mut metadata,
            look_for: (default_events, default_limit),
            ..
        } = run;
        let baseline = match &judge.baseline {
            Some(Baseline::File(path)) => Some(path),
            _ => None,
        };
        let inputs: Vec<&PathBuf> = run.recording.into_iter().chain(baseline).collect();
        sinks.check_files(&inputs)?;
        output::detach(run.overflow)?;
        let given = match &judge.baseline {
            Some(Baseline::File(path)) => {
                Some((Certificate::read(path)?, path.display().to_string()))
            }
            Some(Baseline::FirstFrame) => None,
            None => run.baseline,
        };
        let abort_on = judge.abort_on.unwrap_or_default();
        metadata.insert("abort_on".into(), abort_on.to_string());
        let events = judge.look_for.events(abort_on).max(default_events);
        metadata.insert("events".into(), events.to_string());
        let limit = judge.look_for.motion_limit.unwrap_or(default_limit);
        metadata.insert(MOTION_LIMIT.into(), limit.to_string());
        let (mut verifier, origin) = match given {
            Some((certificate, origin)) => (Verifier::with_baseline(abort_on, certificate), origin),
            None => (Verifier::new(abort_on), "first frame".to_owned()),
        };
        verifier.set_incremental(true);
        judge.kernel.set(&mut verifier)?;
        verifier.set_paranoid(judge.paranoid);
        verifier.set_events(events);
        verifier.set_motion_limit(limit)?;
        Ok(Session {
            verifier,
            cuts: 0,
            origin,
            queues: sinks.open(run.title, &metadata, run.overflow)?,
            begun: false,
            pool: Vec::new(),
            json: run.json,
            live: Live::new(),
            outcome: Outcome::Fine,
            last_verdict: None,
            told: BTreeSet::new(),
            unresolved: Unresolved::default(),
            motion_limit: limit,
            first_violation: None,
            tally: Tally::default(),
            checks: Durations::default(),
            #[cfg(feature = "bus")]
            last_check: None,
            routes: [0; 3],
            open_curves: None,
            comparison: None,
        })
    }

    /// Returns the progress of the current frame.
    pub fn progress(&self) -> Arc<Progress> {
        self.verifier.progress()
    }

    /// Returns true if verifying the frame likely takes little time, so that handing it to another
    /// thread would not pay: the frame is small, and the previous one was quick.
    #[cfg(feature = "bus")]
    pub fn is_quick(&self, frame: &Ingested) -> bool {
        let segments = frame.curves.as_ref().map_or(0, |set| set.segments());
        segments <= SMALL && self.last_check.is_some_and(|check| check < MOMENT)
    }

    /// What is printed while the run lasts.
    pub fn live(&self) -> &Live {
        &self.live
    }

    /// Moves a frame into curves. One that breaks its contract is rejected when it is judged.
    pub fn ingest(&mut self, ingest: impl FnOnce(&mut Option<CurveSet>) -> Result<()>) -> Ingested {
        let start = Instant::now();
        let mut set = self.free_curves();
        let ingested = ingest(&mut set);
        let set = set.map(Arc::new);
        // What was rejected is half of this frame and half of the one before: good for its layout only.
        self.pool.extend(set.clone());
        let no_curves = || Error::Usage("the frame holds no curves".into());
        Ingested {
            curves: ingested.and_then(|()| set.ok_or_else(no_curves)),
            took: start.elapsed(),
        }
    }

    /// Says which frame will be judged after the next one.
    #[cfg(feature = "mcap")]
    pub fn announce(&mut self, frame: &Ingested) {
        if let Ok(set) = &frame.curves {
            self.verifier.announce(set);
        }
    }

    /// Verifies one frame. If `cuts` differs from that of the last frame, the frame does not
    /// continue that one.
    ///
    /// Errors: [`Error::CertificateMismatch`], and [`Error::Cancelled`] if the frame was not
    /// verified.
    pub fn judge(&mut self, seq: u64, time: f64, cuts: u32, frame: Ingested) -> Result<Judged> {
        let start = Instant::now();
        let Ingested { curves, took } = frame;
        let outcome = curves.and_then(|set| {
            if std::mem::replace(&mut self.cuts, cuts) != cuts {
                self.verifier.cut();
            }
            let report = self.verifier.step_shared(seq, time, &set)?;
            Ok((report, Some(set)))
        });
        let (report, curves) = match outcome {
            Ok(verified) => verified,
            // The frame is not at fault: no frame of this simulator would fit the baseline, or the
            // run is being cancelled.
            Err(e @ (Error::CertificateMismatch { .. } | Error::Cancelled)) => return Err(e),
            Err(e) => (self.verifier.reject(seq, time, &e), None),
        };
        let check = took + start.elapsed();
        #[cfg(feature = "bus")]
        {
            self.last_check = Some(check);
        }
        let (work, offload) = match report.verdict {
            Verdict::Rejected => Default::default(),
            _ => (self.verifier.work(), self.verifier.offload()),
        };
        if work.disagreed {
            tracing::error!(
                "frame {seq}: the incremental verification was wrong, which is an error of linkwatch; \
                 the full one holds, for this frame and from here on"
            );
            self.data_lost();
        }
        Ok(Judged {
            report: Arc::new(report),
            check,
            work,
            offload,
            curves,
            cuts,
        })
    }

    /// Curves that no sink holds any more, or a copy: later frames must have the layout of the first.
    fn free_curves(&mut self) -> Option<CurveSet> {
        let free = self
            .pool
            .iter_mut()
            .position(|set| Arc::get_mut(set).is_some());
        match free {
            Some(k) => Arc::try_unwrap(self.pool.swap_remove(k)).ok(),
            None => self.pool.first().map(|set| CurveSet::clone(set)),
        }
    }

    /// Hands a frame to the sinks and tells the user what is new.
    pub fn publish(&mut self, judged: Judged, tally: Tally) {
        let Judged {
            report,
            check,
            work,
            offload,
            curves,
            cuts,
        } = judged;
        self.tally = tally;
        self.outcome = self.outcome.max(Outcome::of(report.verdict));
        if let Some(certificate) = self.verifier.baseline().filter(|_| !self.begun) {
            let record = Arc::new(BaselineRecord {
                certificate: Arc::new(certificate.clone()),
                origin: self.origin.clone(),
            });
            self.queues
                .iter()
                .for_each(|q| q.begin(Arc::clone(&record)));
            self.begun = true;
        }
        if report.verdict != Verdict::Rejected {
            if self.open_curves.is_none() {
                output::warn_of_open_curves("the frames", &report.stats);
                self.open_curves = Some(report.stats.open_curves);
            }
            self.checks.add(check);
            self.routes[work.route as usize] += 1;
        }
        self.tell(&report, check, &work, offload);
        let record = Arc::new(FrameRecord {
            curves,
            cuts,
            report,
            verified: tally.verified,
            skipped: tally.skipped,
            rejected: tally.rejected,
            check,
            work,
            received: SystemTime::now(),
        });
        self.queues
            .iter()
            .for_each(|q| q.frame(Arc::clone(&record)));
    }

    /// Says what this frame brought that was not said before.
    fn tell(&mut self, report: &Report, check: Duration, work: &Work, offload: Offload) {
        if self.json {
            output::json(&serde_json::json!({
                "report": report,
                "ms": check.as_secs_f64() * 1e3,
                "work": work,
                "offload": offload,
                "verified": self.tally.verified,
                "skipped": self.tally.skipped,
                "rejected": self.tally.rejected,
            }));
        }
        self.live.status(format_args!(
            "frame {}: {}, {} ({}); {} verified, {} skipped",
            report.seq,
            report.verdict,
            millis(check),
            in_words(work, offload),
            count(self.tally.verified),
            count(self.tally.skipped),
        ));
        self.unresolved.add(report);
        let changes = report.changes.iter().map(Told::from);
        let lasting: BTreeSet<Told> = changes
            .chain(report.defects.iter().map(Told::from))
            .collect();
        // Findings that ended are printed again if they return.
        let told = std::mem::replace(&mut self.told, lasting);
        let fresh = !(report.events.is_empty() && report.unresolved.is_empty())
            || self.told.difference(&told).next().is_some();
        let turned = self.last_verdict.is_some_and(|v| v != report.verdict);
        let first_and_bad = self.last_verdict.is_none() && report.verdict != Verdict::Intact;
        self.last_verdict = Some(report.verdict);
        if !(fresh || turned || first_and_bad) {
            return;
        }
        let changes = report.changes.iter().filter(|&c| !told.contains(&c.into()));
        let defects = report.defects.iter().filter(|&d| !told.contains(&d.into()));
        let sentences: Vec<String> = changes
            .map(Change::to_string)
            .chain(report.events.iter().map(PullThrough::to_string))
            .chain(defects.map(|d| report.defect(d)))
            .chain(report.unresolved_findings())
            .collect();
        if self.first_violation.is_none() && report.verdict != Verdict::Intact {
            let detail = sentences
                .first()
                .map(|s| format!(": {s}"))
                .unwrap_or_default();
            self.first_violation = Some(format!("frame {}{detail}", report.seq));
        }
        if self.json {
            return;
        }
        let mut lines = vec![format!(
            "{} (checked in {})",
            report.headline(),
            millis(check)
        )];
        lines.extend(sentences.iter().take(SENTENCES).map(|s| format!("  {s}")));
        if sentences.len() > SENTENCES {
            lines.push(format!("  and {} more", sentences.len() - SENTENCES));
        }
        if report.abort {
            lines.push("  abort sent: the simulator is asked to stop".into());
        }
        lines.iter().for_each(output::line);
    }

    /// Adds the comparison with the recorded verdicts to the summary.
    #[cfg(feature = "mcap")]
    pub fn compared(&mut self, words: String, json: serde_json::Value) {
        self.comparison = Some((words, json));
    }

    /// Something else happened that makes the run less than complete.
    pub fn data_lost(&mut self) {
        self.outcome = self.outcome.max(Outcome::Undecided);
    }

    /// Closes the sinks and sums up. `tally` is the last word on all frames.
    pub fn finish(mut self, tally: Tally) -> Outcome {
        self.tally = tally;
        let mut kept = Vec::new();
        let mut summaries = Vec::new();
        let start = Instant::now();
        for queue in std::mem::take(&mut self.queues) {
            let complete = queue.is_to_be_complete();
            let summary = queue.finish(FINISH.saturating_sub(start.elapsed()));
            let all = plural(summary.written + summary.dropped, "frame");
            match &summary.failed {
                // The sink logged the reason when it failed.
                Some(why) => tracing::error!(
                    "{} is incomplete: at least {} of {all} are in it: {why}",
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
            if summary.failed.is_some() || complete && summary.dropped > 0 {
                self.data_lost();
            }
            summaries.push(summary);
        }
        if tally.verified == 0 {
            self.outcome = self.outcome.max(Outcome::Undecided);
        }
        let word = match (tally.verified, self.outcome) {
            (0, _) => "nothing was verified",
            (_, Outcome::Fine) => "intact",
            (_, Outcome::Changed) => "changed",
            (_, Outcome::Undecided) => "undecided or incomplete",
        };
        let (median, slowest) = (self.checks.median(), self.checks.longest);
        let [full, quiet, partial] = self.routes;
        self.live.clear();
        if self.json {
            output::json(&serde_json::json!({
                "summary": {
                    "verdict": word,
                    "verified": tally.verified,
                    "skipped": tally.skipped,
                    "skipped_share": tally.skipped_share(),
                    "rejected": tally.rejected,
                    "median_ms": median.as_secs_f64() * 1e3,
                    "max_ms": slowest.as_secs_f64() * 1e3,
                    "first_violation": self.first_violation,
                    "routes": { "full": full, "quiet": quiet, "partial": partial },
                    "open_curves": self.open_curves,
                    "sinks": summaries,
                    "recorded_verdicts": self.comparison.map(|(_, json)| json),
                    "unresolved": {
                        "pull_throughs": self.unresolved.count,
                        "frames": self.unresolved.frames,
                        "lengths": self.unresolved.lengths,
                        "limit": self.motion_limit,
                    },
                }
            }));
            return self.outcome;
        }
        let skipped = match tally.skipped {
            0 => "0 skipped".to_owned(),
            n => format!("{} skipped ({})", count(n), percent(tally.skipped_share())),
        };
        let mut line = format!(
            "{word}: {} verified, {skipped}, {} rejected; a check took {} (median), {} at most",
            plural(tally.verified, "frame"),
            count(tally.rejected),
            millis(median),
            millis(slowest),
        );
        if quiet + partial > 0 {
            line += &format!(
                "\n{} had not moved too far, {} in few places, {} computed in full",
                plural(quiet, "frame"),
                count(partial),
                count(full)
            );
        }
        if let Some(first) = &self.first_violation {
            line += &format!("\nfirst: {first}");
        }
        if self.unresolved.count > 0 {
            line += &format!("\n{}", self.unresolved.words(self.motion_limit));
        }
        if let Some(n @ 1..) = self.open_curves {
            line += &format!("\nnot verified: {}", plural(n, "open curve"));
        }
        if let Some((words, _)) = &self.comparison {
            line += &format!("\n{words}");
        }
        for note in kept {
            line += &format!("\n{note}");
        }
        output::line(line);
        self.outcome
    }
}

/// What a frame took, in a few words.
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
                n => format!(", {} on the device", plural(n, "test")),
            };
            format!(
                "full, {}{summed}{offloaded}{age}",
                plural(work.recomputed, "pair")
            )
        }
        Route::Partial => format!(
            "{} of {} blocks marked, {} recomputed{age}",
            count(work.marked),
            count(work.blocks),
            plural(work.recomputed, "pair"),
        ),
    }
}

/// Durations in buckets of 5 %: a run may last for days.
#[derive(Default)]
struct Durations {
    buckets: BTreeMap<i32, u64>,
    longest: Duration,
}

impl Durations {
    /// Ratio of neighbouring buckets.
    const RATIO: f64 = 1.05;

    fn add(&mut self, d: Duration) {
        let bucket = d.as_secs_f64().max(1e-9).ln() / Self::RATIO.ln();
        *self.buckets.entry(bucket.round() as i32).or_default() += 1;
        self.longest = self.longest.max(d);
    }

    /// The median, within a bucket.
    fn median(&self) -> Duration {
        let half = self.buckets.values().sum::<u64>() / 2;
        let mut seen = 0;
        let middle = self.buckets.iter().find(|(_, n)| {
            seen += **n;
            seen > half
        });
        middle.map_or(Duration::ZERO, |(&bucket, _)| {
            Duration::from_secs_f64(Self::RATIO.powi(bucket)).min(self.longest)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_right_within_a_bucket() {
        let mut d = Durations::default();
        assert_eq!(d.median(), Duration::ZERO);
        for ms in 1..=101 {
            d.add(Duration::from_millis(ms));
        }
        let median = d.median().as_secs_f64();
        assert!((median / 0.051 - 1.0).abs() < 0.05, "{median}");
        assert_eq!(d.longest, Duration::from_millis(101));
    }
}
