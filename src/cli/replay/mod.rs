//! `linkwatch replay`: verifies a recording again, and compares the verdicts with those in it.

mod comparison;

use self::comparison::{Comparison, alike, left_out_by};
use super::output::plural;
use super::range::Range;
use super::run::{Judge, Judged, JunitArgs, PATIENT, Run, Setup, Sinks};
use super::source::{Source, warn_of_cut};
use super::{Outcome, braid_args, signals, stream};
use crate::record::{CUT_OFF, MissingFrames};
use linkwatch::{
    BaselineRecord, Braids, Error, Events, Received, RecordedItem, RecordedVerdict, Report, Result,
    Retention, Verdict,
};
use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;

/// Verify a recording again, frame by frame, and compare with the recorded verdicts
///
/// Without options, the settings and the baseline are those of the recording, and the verdicts must
/// be the same. The last line reports how many are. `linkwatch check` verifies other files.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A recording, as written by `linkwatch watch --record`
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    range: Range,
    #[command(flatten)]
    judge: Judge,
    #[command(flatten)]
    junit: JunitArgs,
    #[command(flatten)]
    sinks: Sinks,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let range = args.range;
    range.check()?;
    let mut source = Source::open(&args.file)?;
    let name = args.file.display().to_string();
    let (baseline, mut before) = read_start(&mut source)?;
    let mut missing = MissingFrames::of_no_frames();
    let begin = baseline.as_ref().and_then(|baseline| baseline.frame);
    let mut left_out = false;
    let windows = source.reader.metadata().contains_key(Retention::WINDOW);
    if range.from.is_some()
        && let Some(skipped) = source.go_to_start(&range)?
    {
        // These are read again if they are in the range.
        before.clear();
        (left_out, missing.answered) = (skipped > 0, None);
    }
    // Available after the first item was read.
    let recorded_metadata = source.reader.metadata().clone();
    let judge = args.judge.or_recorded(&recorded_metadata)?;
    if judge.braid_args.braids()? == Some(Braids::Auto) && (windows || left_out) {
        let what = "the first frame of the run is not replayed";
        return Err(braid_args::other_first_frame(what));
    }
    let mut files = judge.files(args.sinks.overwrite);
    files.reads([&args.file]);
    stream::detach(PATIENT)?;
    let setup = Setup {
        junit: args.junit.clone(),
        baseline,
        title: format!("replay of {name}"),
        metadata: BTreeMap::from([("replay_of".to_owned(), name.clone())]),
        json,
        ..Setup::default()
    };
    let off = Events::Off.word();
    let mut replay = Replay {
        args,
        run: Run::new(&judge, &args.sinks, files, setup)?,
        comparison: Comparison {
            // Other settings give other verdicts, intentionally.
            differing: args.judge.differing(&recorded_metadata)?,
            left_out_by: left_out_by(&recorded_metadata),
            ..Comparison::default()
        },
        waiting: VecDeque::new(),
        last: None,
        missing,
        dropped: 0,
        begin,
        motion: recorded_metadata.get("events").is_some_and(|e| e != off),
        every: recorded_metadata.contains_key(Retention::EVERY),
        left_out,
        restarted: !left_out,
        thinned: false,
        unfounded: false,
        ended: false,
    };
    tracing::info!("replaying {name}");
    signals::cancel_on_signals(replay.run.session.progress())?;
    let mut read = Ok(());
    let all = || -> Result<()> {
        for item in before {
            replay.take(item)?;
        }
        while !replay.ended {
            match source.next() {
                Ok(Some(item)) => replay.take(item)?,
                Ok(None) => break,
                // The frames before the error still get their verdicts.
                Err(e) => {
                    read = Err(e);
                    break;
                }
            }
        }
        replay.finish_waiting()
    };
    match all() {
        Err(Error::Cancelled) => {
            tracing::info!("stopped by a signal");
            replay.run.data_lost();
        }
        all => all?,
    }
    read?;
    let (mut run, comparison) = (replay.run, replay.comparison);
    if warn_of_cut(&source) {
        run.data_lost();
        if source.reader.metadata().contains_key(CUT_OFF) {
            run.cut_off("the run that was replayed has no end");
        }
    }
    if replay.dropped > 0 {
        tracing::warn!(
            "{name}: {} missing: verified, but not recorded, because the disk of the recorder was \
             too slow",
            plural(replay.dropped, "frame"),
        );
        run.cut_off("frames are missing in the recording that was replayed");
    }
    if comparison.unlike > 0 {
        let verdicts = plural(comparison.unlike, "verdict");
        tracing::error!("{verdicts} different from the recorded ones");
        run.data_lost();
    }
    if run.tally.verified + run.tally.rejected > 0 {
        let words = comparison.words();
        run.sum.comparison = Some((words, serde_json::json!(comparison)));
    }
    Ok(run.finish())
}

/// Reads the baseline, which comes before the first frame that was compared with it. Returns also
/// the items before it: rejected frames may come earlier. If there is no baseline, the last one is
/// the first frame.
fn read_start(source: &mut Source) -> Result<(Option<BaselineRecord>, Vec<RecordedItem>)> {
    let mut before = Vec::new();
    while let Some(item) = source.next()? {
        if let RecordedItem::Baseline(baseline) = item {
            return Ok((Some(baseline), before));
        }
        let is_frame = matches!(item, RecordedItem::Frame(_));
        before.push(item);
        if is_frame {
            break;
        }
    }
    Ok((None, before))
}

/// A frame to judge, or a recorded verdict.
enum Waiting {
    Frame(Box<Received>),
    Verdict(Box<RecordedVerdict>),
}

/// Maximum number of items that wait for the next frame. Verdicts on rejected frames come without a
/// frame.
const MOST_WAITING: usize = 64;

/// Replay in progress.
struct Replay<'a> {
    args: &'a Args,
    run: Run,
    /// Items that wait for the next frame. A frame waits because the next one is announced before
    /// it is judged, and so do the verdicts between them.
    waiting: VecDeque<Waiting>,
    comparison: Comparison,
    /// Report on the previous frame.
    last: Option<Arc<Report>>,
    missing: MissingFrames,
    /// Number of frames that the recorder dropped.
    dropped: u64,
    /// Frame of the first baseline.
    begin: Option<u64>,
    /// True if the recorded verdicts depend on the previous frame.
    motion: bool,
    /// True if the recorder kept the curves of some frames only.
    every: bool,
    /// True if the frames just before the next one were skipped.
    left_out: bool,
    /// True if the next frame is the first one after a gap that the recorder left on purpose. It is
    /// verified without the frames before that.
    restarted: bool,
    /// True if there are verdicts on frames just before the next one, but not their curves.
    thinned: bool,
    /// True if the last frame after a gap had defects, which earlier frames may explain.
    unfounded: bool,
    /// True if all later frames are skipped.
    ended: bool,
}

impl Replay<'_> {
    fn take(&mut self, item: RecordedItem) -> Result<()> {
        let range = self.args.range;
        match item {
            // A later baseline marks frames that are not in the recording.
            RecordedItem::Baseline(baseline) => {
                self.finish_waiting()?;
                let is_chosen = self.args.judge.baseline.is_some();
                self.begin_again((!is_chosen).then_some(baseline));
            }
            RecordedItem::Frame(frame) if !range.contains(frame.seq, frame.time) => {
                self.left_out |= range.is_after(frame.seq, frame.time);
                self.restarted = false;
                self.ended |= range.is_before(frame.seq, frame.time);
            }
            RecordedItem::Frame(frame) => {
                let info = frame.info.clone();
                let session = &mut self.run.session;
                let frame = session.receive(info, |receive| frame.read(receive));
                session.announce(&frame);
                self.finish_waiting()?;
                let frame = Box::new(frame);
                self.waiting.push_back(Waiting::Frame(frame));
            }
            RecordedItem::Verdict(recorded) => {
                let RecordedVerdict { report, progress } = &*recorded;
                if !range.contains(report.seq, report.time) {
                    let _ = self.missing.before(progress);
                    self.comparison.left_out = self.missing.left_out;
                    return Ok(());
                }
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
                Waiting::Frame(frame) => {
                    let judged = self.run.judge(*frame)?;
                    self.last = Some(Arc::clone(&judged.report));
                    self.run.publish(judged);
                }
                Waiting::Verdict(recorded) => self.compare(*recorded),
            }
        }
        Ok(())
    }

    /// Restarts the comparison after frames that the recorder skipped on purpose.
    fn begin_again(&mut self, baseline: Option<BaselineRecord>) {
        self.run.begin_again(baseline);
        (self.left_out, self.restarted) = (true, true);
    }

    /// Notes a frame that cannot be compared, and whose recorded verdict is worse.
    fn note_worse(&mut self, found: &Report, recorded: &Report) {
        if Outcome::of(recorded.verdict) > Outcome::of(found.verdict) {
            self.comparison.worse += 1;
            self.run.data_lost();
        }
    }

    /// Compares a recorded verdict with the one of this replay.
    fn compare(&mut self, recorded: RecordedVerdict) {
        let (mut report, progress) = (recorded.report, recorded.progress);
        self.run.tally.skipped = progress.skipped;
        self.comparison.recorded += 1;
        let gap = self.missing.before(&progress);
        self.dropped += gap.dropped;
        self.comparison.left_out = self.missing.left_out;
        let last = self.last.take().filter(|r| r.seq == report.seq);
        // Frames before this one are not here, so the motion to it differs from the recorded one.
        // The watch of a restarted process has the last frame of the one before in its state.
        let is_first = self.comparison.recorded - self.comparison.rejected == 1;
        let continues = is_first && self.begin.is_some_and(|baseline| baseline < report.seq);
        let skipped = last.is_some() && std::mem::take(&mut self.left_out);
        let after_gap = skipped || gap.frames > 0 || continues;
        let restarted = last.is_some() && std::mem::take(&mut self.restarted);
        let thinned = last.is_some() && std::mem::take(&mut self.thinned);
        if restarted && self.run.tally.verified > 1 {
            // The recorded run searched the steps over skipped frames, with its own options. If no
            // frame was skipped, its watch started late, and did not search the step to this frame.
            let is_late = gap.frames == 0 && !thinned;
            let is_gap = is_late || !self.comparison.differing.is_empty();
            self.run.sum.gaps += u64::from(is_gap);
        }
        let moved = after_gap && self.motion;
        let has_defects = |r: &Report| !r.defects.is_empty();
        // Curves may touch since a frame that is not here, up to this frame.
        let unfounded = !moved && self.unfounded;
        if moved {
            self.unfounded = last.as_deref().is_some_and(has_defects);
        } else if last.is_some() {
            self.unfounded &= has_defects(&report);
        }
        let moved = moved || unfounded;
        match last {
            Some(_) if !self.comparison.differing.is_empty() => {}
            Some(found) if !report.missing.is_empty() => {
                self.comparison.incomplete += 1;
                // The first frame of a recording was compared with one that is not in it.
                if !is_first || skipped {
                    self.note_worse(&found, &report);
                }
            }
            Some(found) if (restarted || !moved) && alike(&found, &report, after_gap) => {
                self.comparison.equal += 1;
            }
            Some(found) if moved => {
                self.comparison.after_missing += 1;
                self.note_worse(&found, &report);
            }
            Some(found) => {
                tracing::error!("live:   {}", report.headline());
                tracing::error!("replay: {}", found.headline());
                self.comparison.unlike += 1;
            }
            None if report.verdict == Verdict::Rejected => {
                // A rejected frame has no recorded curves; only its verdict is recorded. Its abort
                // flag is kept, too, unless another policy is given: in older recordings, `any` did
                // not include rejected frames.
                if let Some(policy) = self.args.judge.abort_on {
                    report.abort = policy.aborts(&report, |_| false);
                }
                self.comparison.rejected += 1;
                let judged = Judged::of(report, progress.times, progress.work);
                self.run.publish(judged);
            }
            None if self.every && report.verdict == Verdict::Intact => {
                self.comparison.thinned += 1;
                self.thinned = true;
                self.begin_again(None);
            }
            None => {
                let seq = report.seq;
                tracing::error!("frame {seq}: the recording lacks the frame of a verdict");
                self.comparison.unlike += 1;
            }
        }
    }
}
