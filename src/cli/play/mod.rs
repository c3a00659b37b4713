//! `linkwatch play`: publishes the frames of a recording onto the bus, as a simulator does.

mod pace;

use self::pace::{Clock, speed};
use super::cell_args::CellArg;
use super::live::Live;
use super::number::seconds;
use super::output::{self, count, plural};
use super::range::Range;
use super::run::PATIENT;
use super::signals::{TICK, stop_on_signals};
use super::source::{Source, warn_of_cut};
use super::{Outcome, stream};
use linkwatch::{
    Client, ClientOptions, CurveLabels, MessageKind, Outcome as Waited, RecordedFrame,
    RecordedItem, Result, Verdict, VerdictMessage,
};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time for which a watcher may be silent in lockstep. It sends a heartbeat about once a second.
const SILENCE: Duration = Duration::from_secs(30);

/// Interval at which verdicts are read while the next frame is not due.
const POLL: Duration = Duration::from_millis(20);

/// Interval at which the wait for a watcher is interrupted. The client gives its hint after a
/// second.
const LOOK: Duration = Duration::from_secs(1);

/// Publish the frames of a recording as their simulator did, for a test of a watcher or a viewer
///
/// Frames keep their times and numbers; converted ones are numbered from 0. Nothing is verified
/// here. To compare the verdicts, record the watch, and run `linkwatch diff`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A recording, as written by `linkwatch watch --record` or by `linkwatch convert`
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    range: Range,
    /// Name of the service to publish on
    #[arg(long, value_name = "NAME", default_value = "linkwatch")]
    service: String,
    /// Pace of the frames: a factor of the recorded pace, or `max` for as fast as they can be read
    #[arg(long, value_name = "FACTOR|max", default_value = "1", value_parser = speed)]
    speed: f64,
    /// Wait for the verdict on each frame, so that none is skipped
    #[arg(long)]
    lockstep: bool,
    /// Stop when the watcher asks for it [default: report it and go on, as the recorded run did]
    #[arg(long)]
    stop_on_abort: bool,
    /// Give up if no watcher connects within this time [default: wait without limit]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    wait: Option<Duration>,
    #[command(flatten)]
    cell: CellArg,
}

/// Reason for the end of the run.
enum End {
    AllPublished,
    Signal,
    Abort,
    /// The watcher left or does not answer.
    NoWatcher(String),
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    args.range.check()?;
    let mut source = Source::open(&args.file)?;
    let service = args.service.as_str();
    let stop = stop_on_signals()?;
    stream::detach(PATIENT)?;
    let options = ClientOptions {
        lockstep: args.lockstep,
        ..ClientOptions::default()
    };
    let name = args.file.display();
    if args.range.from.is_some() {
        source.go_to_start(&args.range)?;
    }
    let mut publisher = Publisher {
        args,
        json,
        stop: &stop,
        is_converted: is_converted(&args.file)?,
        client: Client::open(service, &options)?,
        source,
        live: Live::default(),
        previous: None,
        after_gap: false,
        answer: None,
        worst: Outcome::Fine,
        counts: Counts::default(),
    };
    let Some(first) = publisher.next()? else {
        return Err(usage!("{name}: no frame to publish"));
    };
    // Described before the wait, so that shared memory is created for frames of this size.
    publisher.describe(&first)?;
    publisher.previous = Some(first.clone());
    publisher.after_gap = false;
    tracing::info!("waiting for a watcher on service '{service}'");
    if !publisher.wait_for_watcher()? {
        match publisher.is_stopped() {
            true => tracing::info!("stopped by a signal"),
            false => tracing::warn!("no watcher connected within the limit of --wait"),
        }
        return Ok(Outcome::Undecided);
    }
    tracing::info!("publishing {name} on service '{service}'");
    let start = Instant::now();
    let end = publisher.publish_all(first)?;
    publisher.finish(end, start)
}

/// Returns true if the first frame of a recording has no verdict: no run counted its frames.
fn is_converted(file: &Path) -> Result<bool> {
    let mut source = Source::open(file)?;
    let mut frames = 0;
    while let Ok(Some(item)) = source.next()
        && frames < 2
    {
        match item {
            RecordedItem::Verdict(_) => return Ok(false),
            RecordedItem::Frame(_) => frames += 1,
            RecordedItem::Baseline(_) => {}
        }
    }
    Ok(true)
}

/// A simulator that publishes recorded frames.
struct Publisher<'a> {
    args: &'a Args,
    json: bool,
    /// Set by a signal.
    stop: &'a AtomicBool,
    /// True if frames are numbered from 0. Their own numbers, steps of a dump for example, may be
    /// so far apart that a watcher takes them for errors.
    is_converted: bool,
    client: Client,
    source: Source,
    live: Live,
    /// The last frame, whose curves the watcher knows.
    previous: Option<RecordedFrame>,
    /// True if verified frames between that one and the next one are not in the recording.
    after_gap: bool,
    /// The last verdict of the watcher.
    answer: Option<VerdictMessage>,
    worst: Outcome,
    counts: Counts,
}

/// Counts of the summary.
#[derive(Default, serde::Serialize)]
struct Counts {
    published: u64,
    /// Frames without valid curves.
    left_out: u64,
    /// Frames with a recorded verdict, but without curves.
    rejected: u64,
    /// Numbers between published frames, which the watcher counts as skipped frames.
    numbers_between: u64,
    /// Steps over verified frames that are not in the recording. The watcher does not search them.
    gaps: u64,
    /// Verdicts that asked to stop.
    aborts: u64,
}

impl Publisher<'_> {
    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Waits until a watcher has seen the client. Returns false if none came, or a signal did.
    fn wait_for_watcher(&mut self) -> Result<bool> {
        let start = Instant::now();
        loop {
            let limit = self.args.wait;
            let left = limit.map_or(LOOK, |limit| limit.saturating_sub(start.elapsed()));
            if self.client.wait_for_watcher(left.min(LOOK))? {
                return Ok(true);
            }
            if self.is_stopped() || left.is_zero() {
                return Ok(false);
            }
        }
    }

    /// Returns the next frame of the range with valid curves.
    fn next(&mut self) -> Result<Option<RecordedFrame>> {
        let range = self.args.range;
        while let Some(item) = self.source.next()? {
            match item {
                RecordedItem::Frame(frame) if range.is_before(frame.seq, frame.time) => break,
                RecordedItem::Frame(mut frame) if range.contains(frame.seq, frame.time) => {
                    let Err(e) = frame.check() else {
                        if self.is_converted {
                            frame.seq = self.counts.published;
                        }
                        return Ok(Some(frame));
                    };
                    tracing::warn!("frame {} is not published: {e}", frame.seq);
                    self.counts.left_out += 1;
                }
                RecordedItem::Verdict(recorded) => {
                    let report = &recorded.report;
                    let is_rejected = report.verdict == Verdict::Rejected;
                    let counts = is_rejected && range.contains(report.seq, report.time);
                    self.counts.rejected += u64::from(counts);
                    let last = self.previous.as_ref().map(|frame| frame.seq);
                    self.after_gap |= !is_rejected && last < Some(report.seq);
                }
                // A later baseline marks frames that are not in the recording.
                RecordedItem::Baseline(_) => self.after_gap = true,
                RecordedItem::Frame(_) => {}
            }
        }
        Ok(None)
    }

    /// Describes the curves, if they changed.
    fn describe(&mut self, frame: &RecordedFrame) -> Result<()> {
        let same = |p: &RecordedFrame| {
            (p.basis, p.precision) == (frame.basis, frame.precision)
                && p.counts == frame.counts
                && p.info.labels == frame.info.labels
        };
        if self.previous.as_ref().is_some_and(same) {
            return Ok(());
        }
        let labels = CurveLabels::clone(&frame.info.labels);
        let (basis, precision, client) = (frame.basis, frame.precision, &mut self.client);
        let described = client.describe_labelled(basis, precision, &frame.counts, labels);
        described.map_err(|e| usage!("frame {}: {e}", frame.seq))
    }

    /// Publishes the frames at their pace.
    fn publish_all(&mut self, first: RecordedFrame) -> Result<End> {
        let mut clock = Clock::new(self.args.speed);
        let mut next = Some(first);
        while let Some(frame) = next {
            let due = clock.due(frame.received_ns as f64 * 1e-9);
            loop {
                self.read_verdicts()?;
                if let Some(end) = self.end() {
                    return Ok(end);
                }
                let left = due.saturating_duration_since(Instant::now());
                if left.is_zero() {
                    break;
                }
                std::thread::sleep(left.min(POLL));
            }
            let seq = self.publish(frame)?;
            if self.args.lockstep
                && let Some(end) = self.wait(seq)?
            {
                return Ok(end);
            }
            next = self.next()?;
        }
        self.wait_for_last()?;
        Ok(self.end().unwrap_or(End::AllPublished))
    }

    /// Publishes a frame. Returns its number.
    fn publish(&mut self, frame: RecordedFrame) -> Result<u64> {
        self.describe(&frame)?;
        let info = &frame.info;
        let seq = frame.seq;
        if let Some(RecordedFrame { info: before, .. }) = &self.previous {
            self.counts.numbers_between += seq.saturating_sub(before.seq).saturating_sub(1);
            if before.baseline != info.baseline {
                self.client.accept();
            } else if before.cuts != info.cuts || self.after_gap {
                self.client.cut();
            }
            self.counts.gaps += u64::from(self.after_gap);
        }
        self.after_gap = false;
        self.client.set_time_step(info.time_step)?;
        self.client.set_cell(self.args.cell.cell(info.cell))?;
        self.client.number_next(seq)?;
        let client = &mut self.client;
        frame.read(|raw| client.publish(frame.time, raw.positions).map(drop))?;
        self.previous = Some(frame);
        self.counts.published += 1;
        let so_far = plural(self.counts.published, "frame");
        let status = format_args!("frame {seq}: published; {so_far} so far");
        self.live.status(status);
        Ok(seq)
    }

    fn read_verdicts(&mut self) -> Result<()> {
        while let Some(message) = self.client.poll()? {
            self.answered(message);
        }
        Ok(())
    }

    /// Prints a verdict of the watcher, if it differs from the last one.
    fn answered(&mut self, message: VerdictMessage) {
        if message.kind != MessageKind::Verdict {
            return;
        }
        self.worst = self.worst.max(Outcome::of(message.verdict));
        if message.abort && self.counts.aborts == 0 {
            let seq = message.seq;
            tracing::warn!("frame {seq}: the watcher asks the simulator to stop");
        }
        self.counts.aborts += u64::from(message.abort);
        let findings = |m: &VerdictMessage| {
            json!({
                "verdict": m.verdict,
                "lost": m.lost,
                "gained": m.gained,
                "changed": m.changed,
                "pull_throughs": m.events,
                "unresolved": m.unresolved,
                "defects": m.defects,
            })
        };
        let found = findings(&message);
        let last = self.answer.as_ref();
        let is_first_intact = last.is_none() && message.verdict == Verdict::Intact;
        if self.json {
            output::json(&json!({
                "frame": message.seq,
                "time": message.time,
                "watcher": found,
                "abort": message.abort,
            }));
        } else if !is_first_intact && last.is_none_or(|last| findings(last) != found) {
            output::line(&message);
        }
        self.answer = Some(message);
    }

    /// Waits for the verdict on the last frame, which the watcher does not skip.
    fn wait_for_last(&mut self) -> Result<()> {
        self.read_verdicts()?;
        let last = self.previous.as_ref().map(|frame| frame.seq);
        while self.answer.as_ref().map(|answer| answer.seq) < last
            && self
                .client
                .silent_for()
                .is_some_and(|silent| silent < SILENCE)
            && !self.is_stopped()
        {
            std::thread::sleep(POLL);
            self.read_verdicts()?;
        }
        Ok(())
    }

    /// Returns the reason to stop, if there is one.
    fn end(&mut self) -> Option<End> {
        if self.is_stopped() {
            return Some(End::Signal);
        }
        let aborted = self.client.aborted().is_some();
        (aborted && self.args.stop_on_abort).then_some(End::Abort)
    }

    /// Waits for the verdict on a frame. Returns a reason to stop, if there is one.
    fn wait(&mut self, seq: u64) -> Result<Option<End>> {
        let start = Instant::now();
        loop {
            let asked = Instant::now();
            match self.client.wait(seq, TICK)? {
                Waited::Verdict(message) => {
                    self.answered(*message);
                    return Ok(None);
                }
                Waited::NoWatcher(why) => return Ok(Some(End::NoWatcher(why.to_string()))),
                // The watcher skipped the frame.
                Waited::Stale if asked.elapsed() < TICK => return Ok(None),
                Waited::Stale if self.is_stopped() => return Ok(Some(End::Signal)),
                Waited::Stale => {
                    let silent = self.client.silent_for().unwrap_or(start.elapsed());
                    if silent > SILENCE {
                        let silent = silent.as_secs();
                        let why = format!("the watcher has been silent for {silent} s");
                        return Ok(Some(End::NoWatcher(why)));
                    }
                }
            }
        }
    }

    /// Ends the session, and prints the summary.
    fn finish(mut self, end: End, start: Instant) -> Result<Outcome> {
        self.live.clear();
        let seconds = start.elapsed().as_secs_f64();
        let cut = warn_of_cut(&self.source);
        let all = matches!(end, End::AllPublished);
        let missing = self.source.lacks_curves || self.counts.left_out + self.counts.gaps > 0;
        let complete = all && !cut && !missing;
        let wait = match &end {
            End::AllPublished | End::Abort => SILENCE,
            End::Signal | End::NoWatcher(_) => LOOK,
        };
        match end {
            End::AllPublished => {}
            End::Signal => tracing::info!("stopped by a signal"),
            End::Abort => tracing::info!("stopped, because the watcher asked for it"),
            End::NoWatcher(why) => tracing::error!("{why}; no further frame is published"),
        }
        self.read_verdicts()?;
        let goodbye: Option<VerdictMessage> = self.client.finish_within(wait)?;
        if goodbye.is_none() {
            tracing::warn!("the watcher did not confirm the end of the session");
        }
        let complete = complete && goodbye.is_some();
        let counters = goodbye.map(|message| message.counters);
        let service = &self.args.service;
        if self.json {
            let run = json!({ "service": service, "seconds": seconds, "watcher": counters });
            let summary = output::joined(&run, json!(self.counts));
            output::json(&json!({ "summary": summary }));
        } else {
            let frames = plural(self.counts.published, "frame");
            let mut line = format!("published {frames} on service '{service}' in {seconds:.1} s");
            if let Some(c) = counters {
                let [verified, skipped, rejected] = [c.verified, c.skipped, c.rejected].map(count);
                line += &format!(
                    "; the watcher verified {verified}, skipped {skipped}, rejected {rejected}"
                );
            }
            output::line(line);
            let counts = &self.counts;
            let rejected = "not published, without recorded curves";
            let skipped = "not recorded, which the watcher counts as skipped";
            let unsearched = "not searched for pull-throughs by the watcher";
            for (n, noun, what) in [
                (counts.left_out, "invalid frame", "not published"),
                (counts.rejected, "frame", rejected),
                (counts.numbers_between, "frame", skipped),
                (counts.gaps, "gap", unsearched),
            ] {
                if n > 0 {
                    out!("{what}: {}", plural(n, noun));
                }
            }
        }
        Ok(self.worst.max(Outcome::undecided_if(!complete)))
    }
}
