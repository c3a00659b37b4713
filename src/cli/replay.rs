//! `linkwatch replay`: verifies a recording again.

use super::kernel::KernelArgs;
use super::output::{self, count, plural};
use super::session::{
    FrameCounts, Ingested, Judge, Judged, JunitArgs, MOTION_LIMIT, Run, Session, Sinks,
};
use super::{Outcome, clearance_args};
use linkwatch::{
    AbortOn, BaselineRecord, Ending, Error, Events, FrameInfo, Overflow, RecordedItem,
    RecordedVerdict, RecordingReader, Report, Result, Retention, Verdict,
};
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Maximum wait for a blocked sink or standard output. After that, frames or lines are dropped and
/// counted.
const PATIENCE: Duration = Duration::from_secs(60);

/// Verify a recording again, frame by frame, and compare with the recorded verdicts
///
/// Without options, the settings and the baseline are those of the recording, and the verdicts must
/// be the same. The last line reports how many are.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A recording, as written by `linkwatch watch --record`
    #[arg(value_name = "FILE.mcap")]
    recording: PathBuf,
    /// Verify only the frames from this sequence number on
    #[arg(long, value_name = "SEQ")]
    from: Option<u64>,
    /// Verify only the frames up to this sequence number
    #[arg(long, value_name = "SEQ")]
    to: Option<u64>,
    #[command(flatten)]
    judge: Judge,
    #[command(flatten)]
    junit: JunitArgs,
    #[command(flatten)]
    sinks: Sinks,
    #[command(flatten)]
    kernel: KernelArgs,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let range = args.from.unwrap_or(0)..=args.to.unwrap_or(u64::MAX);
    if range.is_empty() {
        let what = format!("--from {} is after --to {}", range.start(), range.end());
        return Err(Error::Usage(what));
    }
    let in_recording = |e: Error| e.in_file(&args.recording);
    let mut reader = RecordingReader::open(&args.recording).map_err(in_recording)?;
    let title = format!("replay of {}", args.recording.display());
    let metadata = BTreeMap::from([("replay_of".to_owned(), args.recording.display().to_string())]);
    // The baseline comes before the first frame that was compared with it; rejected frames may come
    // earlier.
    let mut baseline = None;
    let mut before = Vec::new();
    while let Some(item) = reader.next_item().map_err(in_recording)? {
        if let RecordedItem::Baseline(b) = item {
            baseline = Some((Arc::unwrap_or_clone(b.certificate), b.origin));
            break;
        }
        let frame = matches!(item, RecordedItem::Frame(_));
        before.push(item);
        if frame {
            break;
        }
    }
    // Available after the first item was read.
    let policy = reader.metadata().get("abort_on");
    let recorded: Option<AbortOn> = policy.and_then(|a| a.parse().ok());
    let recorded_events = reader.metadata().get("events");
    let recorded_events: Events = recorded_events
        .and_then(|e| e.parse().ok())
        .unwrap_or_default();
    // Earlier versions had no limit.
    let limit = reader.metadata().get(MOTION_LIMIT);
    let limit: f64 = limit.and_then(|l| l.parse().ok()).unwrap_or(f64::INFINITY);
    let recorded_with = RecordedWith::read(reader.metadata());
    let recorded_clearance = clearance_args::read(reader.metadata());
    let clearance = args.judge.clearance_args.options(recorded_clearance)?;
    let judge = Judge {
        abort_on: args.judge.abort_on.or(recorded),
        kernel: args.kernel.clone(),
        ..args.judge.clone()
    };
    let mut files = judge.files(args.sinks.overwrite);
    files.reads(&args.recording);
    let overflow = Overflow::WaitForProgress(PATIENCE);
    output::detach(overflow)?;
    // Other settings give other verdicts, intentionally.
    let settings = [
        (
            "--abort-on",
            judge.abort_on.unwrap_or_default() != recorded.unwrap_or_default(),
        ),
        ("--baseline", judge.baseline.is_some()),
        (
            "--events or --self",
            judge.event_args.events(AbortOn::Never) > recorded_events,
        ),
        (
            "--motion-limit",
            judge.event_args.motion_limit.is_some_and(|l| l != limit),
        ),
        (
            "--thickness or --min-clearance",
            judge.abort_on == Some(AbortOn::Clearance) && clearance != recorded_clearance,
        ),
    ];
    let differing = settings.iter().filter(|(_, differs)| *differs);
    let mut replay = Replay {
        session: Session::new(Run {
            judge: &judge,
            sinks: &args.sinks,
            junit: Some(&args.junit),
            files,
            strategy: judge.strategy(),
            models: false,
            baseline,
            recorded_events: Some((recorded_events, limit)),
            recorded_clearance,
            title: &title,
            metadata,
            overflow,
            json,
        })?,
        comparison: Comparison {
            differing: differing.map(|(option, _)| *option).collect(),
            recorded_with,
            ..Comparison::default()
        },
        keeps_baseline: judge.baseline.is_some(),
        policy: args.judge.abort_on,
        tally: FrameCounts::default(),
        waiting: VecDeque::new(),
        last: None,
        answered: 0,
        missing: 0,
        motion: recorded_events != Events::Off,
        range,
        left_out: false,
        restarted: true,
        unfounded: false,
        ended: false,
    };
    replay
        .session
        .live()
        .note(format_args!("replaying {}", args.recording.display()));
    super::signals::cancel_on_signals(replay.session.progress())?;
    let mut read = None;
    let all = || -> Result<()> {
        for item in before {
            replay.take(item)?;
        }
        while !replay.ended {
            match reader.next_item().map_err(in_recording) {
                Ok(Some(item)) => replay.take(item)?,
                Ok(None) => break,
                // The frames before the error still get their verdicts.
                Err(e) => {
                    read = Some(e);
                    break;
                }
            }
        }
        replay.finish_waiting()
    };
    match all() {
        Err(Error::Cancelled) => {
            replay.session.live().note("stopped by a signal");
            replay.session.data_lost();
        }
        all => all?,
    }
    read.map_or(Ok(()), Err)?;
    let Replay {
        mut session,
        tally,
        comparison,
        missing,
        ..
    } = replay;
    if let Some(Ending::Cut { at, what }) = reader.ending() {
        tracing::warn!(
            "{}: the recording is truncated at byte {}, in {what}: the recorder was stopped, or \
             its disk was full; the complete frames were replayed",
            args.recording.display(),
            count(*at),
        );
        session.data_lost();
    }
    if missing > 0 {
        tracing::warn!(
            "{}: {} missing: verified, but not recorded, because the disk of the recorder was \
             too slow",
            args.recording.display(),
            plural(missing, "frame"),
        );
        session.data_lost();
    }
    if comparison.unlike > 0 {
        let verdicts = plural(comparison.unlike, "verdict");
        tracing::error!("{verdicts} different from the recorded ones");
        session.data_lost();
    }
    session.compared(comparison.words(), serde_json::json!(comparison));
    Ok(session.finish(tally))
}

/// Comparison of the verdicts of a replay with the recorded ones.
#[derive(Default, Serialize)]
struct Comparison {
    /// Options that differ from those of the recording; if there are any, nothing is compared.
    differing: Vec<&'static str>,
    equal: u64,
    unlike: u64,
    /// Rejected frames. Their curves are not recorded, so their verdicts cannot be repeated.
    rejected: u64,
    /// Frames of which a shard did not verify its share of the pairs.
    incomplete: u64,
    /// Frames after missing ones: the motion to them differs from the recorded one.
    after_missing: u64,
    /// Frames of which the recorder kept only the verdict, on purpose.
    thinned: u64,
    /// Frames that the recorder left out on purpose, or put into another file.
    left_out: u64,
    #[serde(skip)]
    recorded_with: RecordedWith,
}

/// Options with which frames were left out of a recording on purpose.
#[derive(Default)]
struct RecordedWith {
    /// True if frames without curves are thinned ones.
    every: bool,
    words: String,
}

impl RecordedWith {
    fn read(metadata: &BTreeMap<String, String>) -> RecordedWith {
        let option = |key, option: &str| metadata.get(key).map(|value| format!("{option} {value}"));
        let every = option(Retention::EVERY, "--record-every");
        RecordedWith {
            every: every.is_some(),
            words: match every.or(option(Retention::WINDOW, "--record-window")) {
                Some(option) => format!("recorded with {option}"),
                None => "they are in other files of this recording".into(),
            },
        }
    }
}

impl Comparison {
    fn words(&self) -> String {
        if !self.differing.is_empty() {
            return format!(
                "verdicts: not compared with the recorded ones: recorded with another {}",
                self.differing.join(", ")
            );
        }
        let uncompared = self.rejected + self.incomplete + self.after_missing + self.thinned;
        if self.equal + self.unlike + uncompared == 0 {
            return "verdicts: the recording has none to compare with".into();
        }
        let unlike = match self.unlike {
            0 => String::new(),
            n => format!(", {} different", count(n)),
        };
        let uncompared = [
            (
                self.rejected,
                "not compared: the curves of rejected frames are not recorded",
            ),
            (
                self.incomplete,
                "not compared: a shard did not verify its pairs",
            ),
            (
                self.after_missing,
                "not compared: the frames before them are not in the recording",
            ),
            (
                self.thinned,
                "not compared: their curves were left out on purpose",
            ),
            (self.left_out, "frames were left out on purpose"),
        ];
        let uncompared = uncompared.iter().filter(|(n, _)| *n > 0);
        let uncompared = uncompared.map(|(n, why)| format!("; {} {why}", count(*n)));
        let why = match self.thinned + self.left_out {
            0 => String::new(),
            _ => format!(" ({})", self.recorded_with.words),
        };
        format!(
            "verdicts: {} equal to the recorded ones{unlike}{}{why}",
            count(self.equal),
            uncompared.collect::<String>()
        )
    }
}

/// A frame to judge, or a recorded verdict.
enum Waiting {
    Frame {
        seq: u64,
        time: f64,
        frame: Ingested,
    },
    Verdict(Box<RecordedVerdict>),
}

/// Maximum number of items that wait for the next frame. Verdicts on rejected frames come without a
/// frame.
const MOST_WAITING: usize = 64;

/// Replay in progress.
struct Replay {
    session: Session,
    /// Items that wait for the next frame. A frame waits because the next one is announced before
    /// it is judged, and so do the verdicts between them.
    waiting: VecDeque<Waiting>,
    comparison: Comparison,
    /// Policy of this replay, if it overrides that of the recording.
    policy: Option<AbortOn>,
    tally: FrameCounts,
    /// Report on the previous frame.
    last: Option<Arc<Report>>,
    /// Number of frames that had a verdict when the last recorded one was written.
    answered: u64,
    /// Frames that the recorder dropped.
    missing: u64,
    /// True if the recorded verdicts depend on the previous frame.
    motion: bool,
    /// Frames to verify.
    range: RangeInclusive<u64>,
    /// True if frames just before the next one were left out.
    left_out: bool,
    /// True if the next frame is the first one after a gap that the recorder left on purpose. It is
    /// verified without the frames before that.
    restarted: bool,
    /// True if the last frame after a gap had defects, which earlier frames may explain.
    unfounded: bool,
    /// True if the user chose the expected linking numbers.
    keeps_baseline: bool,
    /// True if all later frames are left out.
    ended: bool,
}

impl Replay {
    fn take(&mut self, item: RecordedItem) -> Result<()> {
        match item {
            // Not the first one: frames were left out.
            RecordedItem::Baseline(baseline) => {
                self.finish_waiting()?;
                let baseline = Some(baseline).filter(|_| !self.keeps_baseline);
                self.begin_again(baseline);
            }
            RecordedItem::Frame(recorded) if !self.range.contains(&recorded.seq) => {
                self.left_out |= recorded.seq < *self.range.start();
                self.restarted = false;
                self.ended |= recorded.seq > *self.range.end();
            }
            RecordedItem::Verdict(recorded) if !self.range.contains(&recorded.report.seq) => {
                let progress = &recorded.progress;
                self.answered = progress.verified + progress.rejected;
                self.comparison.left_out = progress.left_out;
            }
            RecordedItem::Frame(recorded) => {
                let info = Ok(recorded.info.clone());
                let frame = self.session.ingest(info, |receive| recorded.read(receive));
                self.session.announce(&frame);
                self.finish_waiting()?;
                self.waiting.push_back(Waiting::Frame {
                    seq: recorded.seq,
                    time: recorded.time,
                    frame,
                });
            }
            RecordedItem::Verdict(recorded) => {
                self.waiting.push_back(Waiting::Verdict(recorded));
                if self.waiting.len() > MOST_WAITING {
                    self.finish_waiting()?;
                }
            }
        }
        Ok(())
    }

    /// Judges the waiting frames, and compares the waiting verdicts.
    fn finish_waiting(&mut self) -> Result<()> {
        while let Some(next) = self.waiting.pop_front() {
            match next {
                Waiting::Frame { seq, time, frame } => {
                    let judged = self.session.judge(seq, time, frame)?;
                    self.count(judged.report.verdict);
                    self.last = Some(Arc::clone(&judged.report));
                    self.session.publish(judged, self.tally);
                }
                Waiting::Verdict(recorded) => self.compare(*recorded)?,
            }
        }
        Ok(())
    }

    /// Begins again after frames that the recorder left out on purpose.
    fn begin_again(&mut self, baseline: Option<BaselineRecord>) {
        self.session.begin_again(baseline);
        (self.left_out, self.restarted) = (true, true);
    }

    fn count(&mut self, verdict: Verdict) {
        match verdict {
            Verdict::Rejected => self.tally.rejected += 1,
            _ => self.tally.verified += 1,
        }
    }

    /// Compares a recorded verdict with the one of this replay.
    fn compare(&mut self, recorded: RecordedVerdict) -> Result<()> {
        let RecordedVerdict {
            mut report,
            progress,
        } = recorded;
        self.tally.skipped = progress.skipped;
        let answered = progress.verified + progress.rejected;
        let gap = answered.saturating_sub(self.answered + 1);
        let left_out = progress.left_out.saturating_sub(self.comparison.left_out);
        self.answered = answered;
        self.missing += gap.saturating_sub(left_out);
        self.comparison.left_out = progress.left_out.max(self.comparison.left_out);
        let last = self.last.take().filter(|r| r.seq == report.seq);
        // Frames before this one are not here, so the motion to it differs from the recorded one.
        let after_gap = last.is_some() && std::mem::take(&mut self.left_out) || gap > 0;
        let restarted = last.is_some() && std::mem::take(&mut self.restarted);
        let moved = after_gap && self.motion;
        let has_defects = |r: &Report| !r.defects.is_empty();
        if moved {
            self.unfounded = last.as_deref().is_some_and(has_defects);
        }
        // Curves may touch since a frame that is not here.
        let moved = moved || self.unfounded && has_defects(&report);
        match last {
            Some(_) if !self.comparison.differing.is_empty() => {}
            Some(_) if !report.missing.is_empty() => self.comparison.incomplete += 1,
            Some(found) if restarted && alike(&found, &report, after_gap) => {
                self.comparison.equal += 1;
            }
            Some(_) if moved => self.comparison.after_missing += 1,
            Some(found) if alike(&found, &report, after_gap) => self.comparison.equal += 1,
            Some(found) => {
                tracing::error!("live:   {}", report.headline());
                tracing::error!("replay: {}", found.headline());
                self.comparison.unlike += 1;
            }
            None if report.verdict == Verdict::Rejected => {
                // A rejected frame has no recorded curves; only its verdict is recorded. Its abort
                // flag is kept, too, unless another policy is given: in older recordings, `any` did
                // not include rejected frames.
                if let Some(policy) = self.policy {
                    report.abort = policy.aborts(&report, |_| false);
                }
                self.comparison.rejected += 1;
                self.count(report.verdict);
                let judged = Judged {
                    latency: None,
                    clearance: None,
                    report: Arc::new(report),
                    times: progress.times,
                    work: progress.work,
                    offload: Default::default(),
                    curves: None,
                    info: FrameInfo::default(),
                    model: None,
                };
                self.session.publish(judged, self.tally);
            }
            None if self.comparison.recorded_with.every => {
                self.comparison.thinned += 1;
                self.begin_again(None);
            }
            None => {
                tracing::error!(
                    "frame {}: the recording lacks the frame of a verdict",
                    report.seq
                );
                self.comparison.unlike += 1;
            }
        }
        Ok(())
    }
}

/// Returns true if a report equals a recorded one. Work counters and clearance are not compared.
/// Motions and the state to roll back to are not compared if the recording has none, as in earlier
/// versions. The last intact frame may be one that the recording lacks, and after a gap it is
/// unknown which curves are new.
fn alike(found: &Report, recorded: &Report, after_gap: bool) -> bool {
    let mut found = found.clone();
    if after_gap {
        found.appeared.clone_from(&recorded.appeared);
        found.gone.clone_from(&recorded.gone);
    }
    found.stats = recorded.stats;
    // It was measured with options of its own, and depends on the frames before.
    found.clearance = recorded.clearance;
    found.last_intact = recorded.last_intact;
    if found.safe_fraction.is_none() || recorded.safe_fraction.is_none() {
        found.safe_fraction = recorded.safe_fraction;
    }
    if recorded.events.iter().all(|e| e.lengths == 0.0) {
        found.events.iter_mut().for_each(|e| e.lengths = 0.0);
    }
    found == *recorded
}
