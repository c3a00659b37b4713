//! `linkwatch play`: publishes recorded frames onto the bus, as a simulator does.

mod answers;
mod frames;
mod pace;

use self::answers::Answers;
use self::frames::{Described, Frames, Ready, Values};
use self::pace::{Clock, Speed};
use super::Outcome;
use super::cell_args::CellArg;
use super::live::Live;
use super::number::seconds;
use super::output::{self, count, plural};
use super::range::Range;
use super::signals::{TICK, stop_on_signals};
use super::source::{PATIENCE, Source, warn_of_cut};
use linkwatch::{
    Client, ClientOptions, CurveLabels, Error, Outcome as Waited, Overflow, Positions, Result,
    VerdictMessage,
};
use std::path::PathBuf;
use std::sync::Arc;
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
/// Frames keep their times, and those of a run with verdicts their numbers. Model files are
/// published as well. Nothing is verified here.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A recording, as written by `linkwatch watch --record`, or a model file
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    range: Range,
    /// Name of the service to publish on
    #[arg(long, value_name = "NAME", default_value = "linkwatch")]
    service: String,
    /// Pace of the frames: a factor of the recorded pace, or `max` for as fast as they can be read.
    /// Frames of models are paced by their simulation time
    #[arg(long, value_name = "FACTOR|max", default_value = "1")]
    speed: Speed,
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
    let source = Source::open(&args.file, false)?;
    let service = args.service.as_str();
    let stop = stop_on_signals()?;
    output::detach(Overflow::WaitForProgress(PATIENCE))?;
    let mut options = ClientOptions::default();
    options.lockstep = args.lockstep;
    let name = source.path().display().to_string();
    let mut frames = Frames::new(args, source)?;
    let mut publisher = Publisher {
        client: Client::open(service, &options)?,
        described: None,
        cell: args.cell,
        last_cuts: None,
        numbered: frames.has_verdicts,
        answers: Answers::new(json),
        live: Live::new(),
        published: 0,
        last: None,
        left_out: 0,
        gaps: 0,
    };
    let Some(first) = publisher.next(&mut frames)? else {
        return Err(Error::Usage(format!("{name}: no frame to publish")));
    };
    // Described before the wait, so that shared memory is created for frames of this size.
    publisher.describe(&first)?;
    tracing::info!("waiting for a watcher on service '{service}'");
    if !wait_for_watcher(&mut publisher.client, args.wait, &stop)? {
        let stopped = stop.load(Ordering::Relaxed);
        match stopped {
            true => tracing::info!("stopped by a signal"),
            false => tracing::warn!("no watcher connected within the limit of --wait"),
        }
        return Ok(Outcome::Undecided);
    }
    tracing::info!("publishing {name} on service '{service}'");
    let start = Instant::now();
    let end = publisher.publish_all(args, first, &mut frames, &stop)?;
    publisher.finish((end, start), (service, &frames.source))
}

/// Waits until a watcher has seen the client. Returns false if none came, or a signal did.
fn wait_for_watcher(
    client: &mut Client,
    limit: Option<Duration>,
    stop: &AtomicBool,
) -> Result<bool> {
    let start = Instant::now();
    loop {
        let left = limit.map_or(LOOK, |limit| limit.saturating_sub(start.elapsed()));
        if client.wait_for_watcher(left.min(LOOK))? {
            return Ok(true);
        }
        if stop.load(Ordering::Relaxed) || left.is_zero() {
            return Ok(false);
        }
    }
}

/// A simulator that publishes recorded frames.
struct Publisher {
    client: Client,
    described: Option<Described>,
    cell: CellArg,
    /// Number of cuts before the last published frame, and its baseline, as recorded.
    last_cuts: Option<(u32, u64)>,
    /// True if frames keep their numbers.
    numbered: bool,
    answers: Answers,
    live: Live,
    published: u64,
    /// Number of the last published frame.
    last: Option<u64>,
    /// Frames without valid curves.
    left_out: u64,
    /// Numbers between published frames, which the watcher counts as skipped frames.
    gaps: u64,
}

impl Publisher {
    /// Describes the curves, if they changed.
    fn describe(&mut self, ready: &Ready) -> Result<()> {
        if self.described.as_ref() == Some(&ready.described) {
            return Ok(());
        }
        let Described {
            basis,
            precision,
            counts,
            labels,
        } = &ready.described;
        let described =
            (self.client).describe_labelled(*basis, *precision, counts, CurveLabels::clone(labels));
        described.map_err(|e| Error::Usage(format!("frame {}: {e}", ready.seq)))?;
        self.described = Some(Described {
            counts: counts.clone(),
            labels: Arc::clone(labels),
            ..ready.described
        });
        Ok(())
    }

    /// Publishes the frames at their pace.
    fn publish_all(
        &mut self,
        args: &Args,
        first: Ready,
        frames: &mut Frames,
        stop: &AtomicBool,
    ) -> Result<End> {
        let mut clock = Clock::new(args.speed);
        let mut next = Some(first);
        while let Some(ready) = next {
            let due = clock.due(ready.recorded());
            loop {
                self.read_verdicts()?;
                if let Some(end) = self.end(args, stop) {
                    return Ok(end);
                }
                let left = due.saturating_duration_since(Instant::now());
                if left.is_zero() {
                    break;
                }
                std::thread::sleep(left.min(POLL));
            }
            let seq = self.publish(&ready)?;
            if args.lockstep
                && let Some(end) = self.wait(seq, stop)?
            {
                return Ok(end);
            }
            next = self.next(frames)?;
        }
        self.wait_for_last(stop)?;
        Ok(self.end(args, stop).unwrap_or(End::AllPublished))
    }

    /// Returns the next frame with curves.
    fn next(&mut self, frames: &mut Frames) -> Result<Option<Ready>> {
        while let Some(frame) = frames.next(&mut self.answers)? {
            frame.check_one_run()?;
            let seq = frame.seq;
            match Ready::new(frame) {
                Ok(ready) => return Ok(Some(ready)),
                Err(e) => {
                    tracing::warn!("frame {seq} is not published: {e}");
                    self.left_out += 1;
                }
            }
        }
        Ok(None)
    }

    /// Publishes a frame. Returns its number.
    fn publish(&mut self, ready: &Ready) -> Result<u64> {
        self.describe(ready)?;
        let now = (ready.info.cuts, ready.info.baseline);
        if let Some((cuts, baseline)) = self.last_cuts.replace(now) {
            if baseline != now.1 {
                self.client.accept();
            } else if cuts != now.0 {
                self.client.cut();
            }
        }
        self.client.set_time_step(ready.info.time_step)?;
        self.client.set_cell(self.cell.cell(ready.info.cell))?;
        if self.numbered {
            self.client.number_next(ready.seq)?;
            self.gaps += self.last.map_or(0, |last| ready.seq - last - 1);
        }
        let positions = match &ready.positions {
            Values::F32(values) => Positions::F32(values),
            Values::F64(values) => Positions::F64(values),
        };
        let seq = self.client.publish(ready.time, positions)?;
        self.last = Some(seq);
        self.published += 1;
        self.live.status(format_args!(
            "frame {seq}: published; {} so far",
            plural(self.published, "frame")
        ));
        Ok(seq)
    }

    fn read_verdicts(&mut self) -> Result<()> {
        while let Some(message) = self.client.poll()? {
            self.answers.add(&message);
        }
        Ok(())
    }

    /// Waits for the verdict on the last frame, which the watcher does not skip.
    fn wait_for_last(&mut self, stop: &AtomicBool) -> Result<()> {
        self.read_verdicts()?;
        while self.answers.last() < self.last
            && self
                .client
                .silent_for()
                .is_some_and(|silent| silent < SILENCE)
            && !stop.load(Ordering::Relaxed)
        {
            std::thread::sleep(POLL);
            self.read_verdicts()?;
        }
        Ok(())
    }

    /// Returns the reason to stop, if there is one.
    fn end(&mut self, args: &Args, stop: &AtomicBool) -> Option<End> {
        if stop.load(Ordering::Relaxed) {
            return Some(End::Signal);
        }
        let aborted = self.client.aborted().is_some();
        (aborted && args.stop_on_abort).then_some(End::Abort)
    }

    /// Waits for the verdict on a frame. Returns a reason to stop, if there is one.
    fn wait(&mut self, seq: u64, stop: &AtomicBool) -> Result<Option<End>> {
        let start = Instant::now();
        loop {
            let asked = Instant::now();
            match self.client.wait(seq, TICK)? {
                Waited::Verdict(message) => {
                    self.answers.add(&message);
                    return Ok(None);
                }
                Waited::NoWatcher(why) => {
                    return Ok(Some(End::NoWatcher(why.to_string())));
                }
                // The watcher skipped the frame.
                Waited::Stale if asked.elapsed() < TICK => return Ok(None),
                Waited::Stale if stop.load(Ordering::Relaxed) => return Ok(Some(End::Signal)),
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
    fn finish(
        mut self,
        (end, start): (End, Instant),
        (service, source): (&str, &Source),
    ) -> Result<Outcome> {
        self.live.clear();
        let took = start.elapsed();
        let cut = warn_of_cut(source.path(), source.ending());
        let mut complete = !cut && !source.lacks_curves() && self.left_out == 0;
        let mut wait = SILENCE;
        match &end {
            End::AllPublished => {}
            End::Signal => {
                tracing::info!("stopped by a signal");
                (complete, wait) = (false, LOOK);
            }
            End::Abort => {
                tracing::info!("stopped, because the watcher asked for it");
                complete = false;
            }
            End::NoWatcher(why) => {
                tracing::error!("{why}; no further frame is published");
                (complete, wait) = (false, LOOK);
            }
        }
        self.read_verdicts()?;
        let goodbye: Option<VerdictMessage> = self.client.finish_within(wait)?;
        if goodbye.is_none() {
            tracing::warn!("the watcher did not confirm the end of the session");
            complete = false;
        }
        let counters = goodbye.map(|message| message.counters);
        let compared = self.answers.compared();
        if self.answers.as_json() {
            output::json(&serde_json::json!({
                "summary": {
                    "service": service,
                    "published": self.published,
                    "left_out": self.left_out,
                    "rejected": self.answers.rejected,
                    "numbers_between": self.gaps,
                    "seconds": took.as_secs_f64(),
                    "watcher": counters,
                    "aborts": self.answers.aborts,
                    "recorded_verdicts": compared,
                }
            }));
        } else {
            let frames = plural(self.published, "frame");
            let mut line = format!("published {frames} on service '{service}'");
            line += &format!(" in {:.1} s", took.as_secs_f64());
            if let Some(c) = counters {
                line += &format!(
                    "; the watcher verified {}, skipped {}, rejected {}",
                    count(c.verified),
                    count(c.skipped),
                    count(c.rejected)
                );
            }
            if self.left_out > 0 {
                line += &format!(
                    "\nnot published: {}",
                    plural(self.left_out, "invalid frame")
                );
            }
            if self.answers.rejected > 0 {
                line += &format!(
                    "\nnot published: {} without recorded curves",
                    plural(self.answers.rejected, "frame")
                );
            }
            if self.gaps > 0 {
                line += &format!(
                    "\nnot recorded between the published frames: {}, which the watcher counts as \
                     skipped",
                    plural(self.gaps, "frame")
                );
            }
            line += &format!("\n{}", self.answers.words(self.numbered));
            output::line(line);
        }
        Ok(self.answers.outcome(complete))
    }
}
