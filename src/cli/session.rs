//! Frames to verdicts to sinks: what `watch` and `replay` share.

use super::Outcome;
use super::kernel::KernelArgs;
use super::live::Live;
use super::look_for::LookFor;
use super::output::{self, count, millis, plural};
#[cfg(any(feature = "mcap", feature = "rerun"))]
use linkwatch::Overflow;
use linkwatch::kernels::Offload;
use linkwatch::{
    AbortOn, BaselineRecord, Certificate, Change, CurveSet, Error, Events, FrameRecord, Progress,
    PullThrough, Report, Result, Route, SinkQueue, Verdict, Verifier, Work,
};
#[cfg(feature = "rerun")]
use linkwatch::{ViewerSink, ViewerTarget};
use std::collections::{BTreeMap, BTreeSet};
#[cfg(feature = "mcap")]
use std::path::Path;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

/// Sentences printed about one frame; the rest is counted.
const SENTENCES: usize = 8;

/// Segments of a frame that no motion makes long to verify.
#[cfg(feature = "bus")]
const SMALL: usize = 4096;

/// Time beside which handing a frame to another thread does not count.
#[cfg(feature = "bus")]
const MOMENT: Duration = Duration::from_millis(1);

/// Frames that may wait for a sink.
#[cfg(any(feature = "mcap", feature = "rerun"))]
const WAITING: usize = 8;

/// Time that the sinks have to finish when the run is over.
const FINISH: Duration = Duration::from_secs(30);

/// What frames are compared with, what is looked for, and what to do about it.
#[derive(Clone, Debug, clap::Args)]
pub struct Judge {
    /// What frames are compared with: `first-frame`, or a certificate file
    #[arg(long, value_name = "first-frame|CERT")]
    pub baseline: Option<Baseline>,
    /// What asks the simulator to stop: any, lost, gained, contact, event or never [default: any]
    #[arg(long, value_name = "WHAT")]
    pub abort_on: Option<AbortOn>,
    #[command(flatten)]
    pub look_for: LookFor,
    #[command(flatten)]
    pub kernel: KernelArgs,
    /// Compute every frame in full as well, and compare: slow, for those who want to be sure
    #[arg(long)]
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
pub struct Sinks {
    /// Record every verified frame and verdict to an MCAP file
    #[cfg(feature = "mcap")]
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
    /// Open the viewer (an installed `rerun`) and show every frame
    #[cfg(feature = "rerun")]
    #[arg(long, group = "shown")]
    view: bool,
    /// Log to a file for the viewer
    #[cfg(feature = "rerun")]
    #[arg(long, value_name = "FILE.rrd", group = "shown")]
    rrd: Option<PathBuf>,
    /// Log to a viewer that is running
    #[cfg(feature = "rerun")]
    #[arg(long, value_name = "URL", group = "shown")]
    connect: Option<String>,
}

impl Sinks {
    /// Fails where a sink would overwrite the file that is being read.
    #[cfg(feature = "mcap")]
    pub fn refuse_to_overwrite(&self, input: &Path) -> Result<()> {
        let same = |path: &PathBuf| {
            let real = |p: &Path| p.canonicalize().ok();
            real(path).is_some() && real(path) == real(input)
        };
        if self.record.as_ref().is_some_and(same) {
            return Err(Error::Usage(format!(
                "--record {} would overwrite the recording that is replayed",
                input.display()
            )));
        }
        Ok(())
    }

    /// Opens what was asked for. `title` names the run in the viewer.
    fn open(&self, title: &str, metadata: &BTreeMap<String, String>) -> Result<Vec<SinkQueue>> {
        let queues = [self.open_recording(metadata)?, self.open_viewer(title)?];
        Ok(queues.into_iter().flatten().collect())
    }

    #[cfg(feature = "mcap")]
    fn open_recording(&self, metadata: &BTreeMap<String, String>) -> Result<Option<SinkQueue>> {
        let Some(path) = &self.record else {
            return Ok(None);
        };
        let sink = Box::new(linkwatch::RecordingSink::create(path, metadata)?);
        SinkQueue::spawn(sink, WAITING, Overflow::Wait).map(Some)
    }

    #[cfg(not(feature = "mcap"))]
    fn open_recording(&self, _: &BTreeMap<String, String>) -> Result<Option<SinkQueue>> {
        Ok(None)
    }

    #[cfg(feature = "rerun")]
    fn open_viewer(&self, title: &str) -> Result<Option<SinkQueue>> {
        // A file is complete or it misleads; a viewer on the screen may miss a frame.
        let (target, overflow) = match (&self.rrd, &self.connect) {
            (Some(path), _) => (ViewerTarget::File(path.clone()), Overflow::Wait),
            (_, Some(url)) => (ViewerTarget::Connect(url.clone()), Overflow::DropOldest),
            _ if self.view => (ViewerTarget::Spawn, Overflow::DropOldest),
            _ => return Ok(None),
        };
        let sink = Box::new(ViewerSink::open(&target, title)?);
        SinkQueue::spawn(sink, WAITING, overflow).map(Some)
    }

    #[cfg(not(feature = "rerun"))]
    fn open_viewer(&self, _: &str) -> Result<Option<SinkQueue>> {
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
}

/// Frames verified, skipped and rejected so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    pub verified: u64,
    pub skipped: u64,
    pub rejected: u64,
}

/// One run over frames.
pub struct Session {
    verifier: Verifier,
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
    /// Changes told already.
    told: BTreeSet<(u32, u32, i64)>,
    first_violation: Option<String>,
    tally: Tally,
    checks: Durations,
    /// Of the last frame that was judged.
    #[cfg(feature = "bus")]
    last_check: Option<Duration>,
    /// Frames that took the full, the quiet and the partial way.
    routes: [u64; 3],
    /// Curves left out of every verdict, once a frame was verified.
    open_curves: Option<u64>,
}

impl Session {
    /// Prepares a run. `default_baseline` and `default_events` serve where the user names none.
    pub fn new(
        judge: &Judge,
        sinks: &Sinks,
        default_baseline: Option<(Certificate, String)>,
        default_events: Events,
        title: &str,
        mut metadata: BTreeMap<String, String>,
        json: bool,
    ) -> Result<Session> {
        let given = match &judge.baseline {
            Some(Baseline::File(path)) => {
                Some((Certificate::read(path)?, path.display().to_string()))
            }
            Some(Baseline::FirstFrame) => None,
            None => default_baseline,
        };
        let abort_on = judge.abort_on.unwrap_or_default();
        metadata.insert("abort_on".into(), abort_on.to_string());
        let events = judge.look_for.events(abort_on).max(default_events);
        metadata.insert("events".into(), events.to_string());
        let (mut verifier, origin) = match given {
            Some((certificate, origin)) => (Verifier::with_baseline(abort_on, certificate), origin),
            None => (Verifier::new(abort_on), "first frame".to_owned()),
        };
        verifier.set_incremental(true);
        judge.kernel.set(&mut verifier)?;
        verifier.set_paranoid(judge.paranoid);
        verifier.set_events(events);
        Ok(Session {
            verifier,
            origin,
            queues: sinks.open(title, &metadata)?,
            begun: false,
            pool: Vec::new(),
            json,
            live: Live::new(),
            outcome: Outcome::Fine,
            last_verdict: None,
            told: BTreeSet::new(),
            first_violation: None,
            tally: Tally::default(),
            checks: Durations::default(),
            #[cfg(feature = "bus")]
            last_check: None,
            routes: [0; 3],
            open_curves: None,
        })
    }

    /// How far the frame in work is.
    pub fn progress(&self) -> Arc<Progress> {
        self.verifier.progress()
    }

    /// Whether a frame takes no longer than it takes to hand it to another thread, many times over: it is small, and the
    /// one before it took a moment.
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

    /// Verifies one frame.
    ///
    /// Errors: [`Error::CertificateMismatch`], and [`Error::Cancelled`] of a frame of which nothing is known.
    pub fn judge(&mut self, seq: u64, time: f64, frame: Ingested) -> Result<Judged> {
        let start = Instant::now();
        let Ingested { curves, took } = frame;
        let outcome = curves.and_then(|set| {
            let report = self.verifier.step_shared(seq, time, &set)?;
            Ok((report, Some(set)))
        });
        let (report, curves) = match outcome {
            Ok(verified) => verified,
            // Not this frame's fault: no frame of this simulator would fit, or nobody waits for it any more.
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
    pub fn publish(&mut self, judged: Judged, tally: Tally) -> Result<()> {
        let Judged {
            report,
            check,
            work,
            offload,
            curves,
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
        self.tell(&report, check, &work, offload)?;
        let record = Arc::new(FrameRecord {
            curves,
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
        Ok(())
    }

    /// Says what this frame brought that was not said before.
    fn tell(
        &mut self,
        report: &Report,
        check: Duration,
        work: &Work,
        offload: Offload,
    ) -> Result<()> {
        if self.json {
            output::json(&serde_json::json!({
                "report": report,
                "ms": check.as_secs_f64() * 1e3,
                "work": work,
                "offload": offload,
                "verified": self.tally.verified,
                "skipped": self.tally.skipped,
                "rejected": self.tally.rejected,
            }))?;
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
        let key = |c: &Change| (c.i, c.j, c.found);
        let fresh = !report.events.is_empty()
            || report.changes.iter().any(|c| !self.told.contains(&key(c)));
        let turned = self.last_verdict.is_some_and(|v| v != report.verdict);
        let first_and_bad = self.last_verdict.is_none() && report.verdict != Verdict::Intact;
        self.last_verdict = Some(report.verdict);
        if !(fresh || turned || first_and_bad) {
            return Ok(());
        }
        let new_changes = report
            .changes
            .iter()
            .filter(|c| !self.told.contains(&key(c)));
        let sentences: Vec<String> = new_changes
            .map(Change::to_string)
            .chain(report.events.iter().map(PullThrough::to_string))
            .chain(report.defects.iter().map(|d| d.to_string()))
            .collect();
        self.told = report.changes.iter().map(key).collect();
        if self.first_violation.is_none() && report.verdict != Verdict::Intact {
            let detail = sentences
                .first()
                .map(|s| format!(": {s}"))
                .unwrap_or_default();
            self.first_violation = Some(format!("frame {}{detail}", report.seq));
        }
        if self.json {
            return Ok(());
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
        lines.iter().try_for_each(|line| self.live.result(line))
    }

    /// Something else happened that makes the run less than complete.
    pub fn data_lost(&mut self) {
        self.outcome = self.outcome.max(Outcome::Undecided);
    }

    /// Closes the sinks and sums up. `tally` is the last word on all frames.
    pub fn finish(mut self, tally: Tally) -> Result<Outcome> {
        self.tally = tally;
        let mut kept = Vec::new();
        for queue in std::mem::take(&mut self.queues) {
            let summary = queue.finish(FINISH);
            match &summary.failed {
                Some(why) => {
                    // The sink has logged why when it happened.
                    tracing::error!("{} is incomplete: {why}", summary.name);
                    self.outcome = self.outcome.max(Outcome::Undecided);
                }
                None if summary.dropped > 0 => {
                    kept.push(format!(
                        "{} missed {}",
                        summary.name,
                        plural(summary.dropped, "frame")
                    ));
                }
                None => {}
            }
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
                    "rejected": tally.rejected,
                    "median_ms": median.as_secs_f64() * 1e3,
                    "max_ms": slowest.as_secs_f64() * 1e3,
                    "first_violation": self.first_violation,
                    "routes": { "full": full, "quiet": quiet, "partial": partial },
                    "open_curves": self.open_curves,
                }
            }))?;
            return Ok(self.outcome);
        }
        let mut line = format!(
            "{word}: {} verified, {} skipped, {} rejected; a check took {} (median), {} at most",
            plural(tally.verified, "frame"),
            count(tally.skipped),
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
        if let Some(n @ 1..) = self.open_curves {
            line += &format!("\nnot verified: {}", plural(n, "open curve"));
        }
        for note in kept {
            line += &format!("\n{note}");
        }
        output::line(line)?;
        Ok(self.outcome)
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
