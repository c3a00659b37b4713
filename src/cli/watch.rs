//! `linkwatch watch`: verifies a live simulation and sends verdicts back.

use super::kernel::KernelArgs;
use super::number::{seconds, share};
use super::output::{self, count, percent, plural};
use super::session::{FrameCounts, Ingested, Judge, Judged, Run, Session, Sinks};
use super::signals::{TICK, stop_on_signals};
use super::{Outcome, services};
use linkwatch::{
    Counters, Error, Event, LastLabels, LiveTimes, Overflow, Result, Sidecar, SidecarOptions,
    WaitMode,
};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Interval of the heartbeats during a long check.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// Time without a simulator after which the live services are listed, once.
const HINT: Duration = Duration::from_secs(5);

/// Maximum total time that a sink or standard output may delay verdicts until it has caught up.
/// After that, frames or lines are dropped and counted.
const PATIENCE: Duration = Duration::from_millis(500);

/// Watch a live simulation: verify its frames and ask it to stop if its topology breaks
///
/// Ends when the simulator does, on Ctrl-C or on SIGTERM.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the service that the simulator publishes on (`linkwatch services` lists the live
    /// ones)
    #[arg(long, help_heading = super::WATCH, value_name = "NAME", default_value = "linkwatch")]
    service: String,
    /// Give up if no simulator connects within this time [default: wait without limit]
    #[arg(long, help_heading = super::WATCH, value_name = "SECONDS", value_parser = seconds)]
    wait: Option<Duration>,
    /// Return exit code 3 if a larger share of the frames was skipped because they arrived faster
    /// than they could be verified: 0 to 1, or a percentage (`5%`) [default: no limit]
    #[arg(long, help_heading = super::WATCH, value_name = "SHARE", value_parser = share)]
    max_skipped: Option<f64>,
    /// How to wait for frames: sleep (some 10 microseconds until a frame is seen), or spin (about
    /// one, but keeps a core busy)
    #[arg(
        long,
        help_heading = super::WATCH,
        value_name = "sleep|spin",
        default_value_t = WaitMode::Sleep
    )]
    wait_mode: WaitMode,
    #[command(flatten)]
    judge: Judge,
    #[command(flatten)]
    sinks: Sinks,
    #[command(flatten)]
    kernel: KernelArgs,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let stop = stop_on_signals()?;
    let metadata = BTreeMap::from([("service".to_owned(), args.service.clone())]);
    output::detach(Overflow::Wait(PATIENCE))?;
    let judge = Judge {
        kernel: args.kernel.clone(),
        ..args.judge.clone()
    };
    // Opened before simulators see the watcher, because a viewer may take a while to open.
    let mut session = Session::new(Run {
        judge: &judge,
        sinks: &args.sinks,
        junit: None,
        files: judge.files(args.sinks.overwrite),
        strategy: judge.strategy(),
        models: false,
        baseline: None,
        recorded_events: None,
        title: &args.service,
        metadata,
        overflow: Overflow::Wait(PATIENCE),
        json,
    })?;
    let mut options = SidecarOptions::default();
    options.wait_mode = args.wait_mode;
    let mut sidecar = Sidecar::open(&args.service, &options)?;
    session.live().note(format_args!(
        "waiting for a simulator on service '{}'",
        args.service
    ));
    let ended = std::thread::scope(|scope| {
        let (to, frames) = mpsc::channel::<Work<'_>>();
        let (verdicts, from) = mpsc::channel();
        let judge = move || {
            for (session, seq, time, frame) in frames {
                let judged = session.judge(seq, time, frame);
                // The receiver has ended if the watch has failed.
                let _ = verdicts.send((session, judged));
            }
        };
        std::thread::Builder::new()
            .name("linkwatch-check".into())
            .spawn_scoped(scope, judge)?;
        watch(
            args,
            &mut sidecar,
            &mut session,
            &Checker { to, from },
            &stop,
        )
    });
    let counters = match &ended {
        Ok(counters) => *counters,
        Err(_) => sidecar.counters(),
    };
    // Sends the goodbye, so that a simulator does not wait for the sinks to finish.
    drop(sidecar);
    let tally = tally(counters);
    let share = tally.skipped_share();
    if let Some(most) = args.max_skipped.filter(|&most| share > most) {
        tracing::error!(
            "{} of the frames were skipped, more than the {} of --max-skipped",
            percent(share),
            percent(most),
        );
        session.data_lost();
    }
    // In any case, the frames verified so far are kept and summarised.
    let outcome = session.finish(tally);
    ended.map(|_| outcome)
}

/// A frame to judge, and the session that judges it.
type Work<'s> = (&'s mut Session, u64, f64, Ingested);

/// Judges frames in a thread, while this thread checks the signals and sends heartbeats.
struct Checker<'s> {
    to: mpsc::Sender<Work<'s>>,
    from: mpsc::Receiver<(&'s mut Session, Result<Judged>)>,
}

impl<'s> Checker<'s> {
    /// Judges a frame. A signal cancels the work.
    fn judge(
        &self,
        work: Work<'s>,
        sidecar: &mut Sidecar,
        stop: &AtomicBool,
    ) -> (&'s mut Session, Result<Judged>) {
        let (session, seq, ..) = &work;
        let (progress, live, seq) = (session.progress(), session.live().clone(), *seq);
        let start = Instant::now();
        let mut beat = start;
        let mut failed = None;
        self.to
            .send(work)
            .expect("the thread lives as long as this sender");
        loop {
            match self.from.recv_timeout(TICK) {
                Ok((session, judged)) => return (session, failed.map_or(judged, Err)),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => panic!("the check panicked"),
            }
            if stop.load(Ordering::Relaxed) {
                progress.cancel();
            }
            let (done, total) = progress.pairs();
            let work = match total {
                0 => "finding pairs that come close".to_owned(),
                _ => format!("{} of {}", count(done), plural(total, "pair")),
            };
            let seconds = start.elapsed().as_secs_f64();
            live.status(format_args!("frame {seq}: {work} in {seconds:.0} s"));
            if beat.elapsed() >= HEARTBEAT {
                beat = Instant::now();
                // If the bus fails, the verdict cannot be sent, so cancel the check.
                if let Err(e) = sidecar.heartbeat() {
                    progress.cancel();
                    failed.get_or_insert(e);
                }
            }
        }
    }
}

/// Watches one session to its end. Returns the counters of its frames.
fn watch<'s>(
    args: &Args,
    sidecar: &mut Sidecar,
    mut session: &'s mut Session,
    checker: &Checker<'s>,
    stop: &AtomicBool,
) -> Result<Counters> {
    let start = Instant::now();
    // Receipt of the last frame, and the time at which this thread had finished it.
    let mut last: Option<[Instant; 2]> = None;
    let mut labels = LastLabels::default();
    let mut met = false;
    let mut hinted = false;
    // Last warning about an unreadable message.
    let mut unreadable = String::new();
    loop {
        if stop.load(Ordering::Relaxed) {
            session.live().note("stopped by a signal");
            return Ok(sidecar.counters());
        }
        match sidecar.wait(TICK)? {
            Event::NewSession { .. } if !met => {
                met = true;
                session.live().note("a simulator connected");
            }
            Event::NewSession { .. } => {
                // The previous session was lost. The run ends with it, because its baseline does.
                session
                    .live()
                    .note("another simulator took this service over; restart linkwatch for it");
                session.data_lost();
                return Ok(sidecar.counters());
            }
            Event::Frame(frame) => {
                let received = Instant::now();
                let (seq, time) = (frame.seq(), frame.time());
                let info = frame.info(&mut labels);
                let ingested = session.ingest(info, |receive| frame.read(receive));
                // Returns the memory to the simulator.
                drop(frame);
                let judged = if session.is_quick(&ingested) {
                    session.judge(seq, time, ingested)
                } else {
                    let work = (session, seq, time, ingested);
                    let judged;
                    (session, judged) = checker.judge(work, sidecar, stop);
                    judged
                };
                let mut judged = match judged {
                    Err(Error::Cancelled) => {
                        sidecar.skip();
                        session.live().note(format_args!(
                            "stopped by a signal; the check of frame {seq} was cancelled"
                        ));
                        return Ok(sidecar.counters());
                    }
                    judged => judged?,
                };
                let sending = Instant::now();
                let sent = sidecar.send_verdict(&judged.report, judged.times.check());
                judged.times.live = last.map(|[previous, finished]| LiveTimes {
                    interval: received - previous,
                    wait: received - finished,
                    send: sending.elapsed(),
                });
                session.publish(judged, tally(sidecar.counters()));
                sent?;
                last = Some([received, Instant::now()]);
            }
            Event::Unreadable(why) => {
                let advice = match why {
                    Error::Version { .. } => {
                        "; the simulator was built with another version of linkwatch: use one \
                         version on both sides"
                    }
                    _ => "",
                };
                let why = format!("a message that is not a frame was rejected: {why}{advice}");
                // A simulator that sends one usually sends it with each frame.
                if why != unreadable {
                    tracing::warn!("{why}");
                    unreadable = why;
                }
                hinted = true;
                session.data_lost();
            }
            Event::End {
                counters,
                clean,
                published,
                ..
            } => {
                if !clean {
                    session
                        .live()
                        .note("the simulator left without finishing (an error or a panic)");
                    session.data_lost();
                }
                session.live().note(format_args!(
                    "the simulator ended after {}",
                    plural(published, "frame")
                ));
                return Ok(counters);
            }
            Event::SimulatorLost { counters, .. } => {
                tracing::warn!(
                    "the simulator died without ending the session; its last frames may be lost"
                );
                session.data_lost();
                return Ok(counters);
            }
            Event::Idle => {
                let given_up = args.wait.filter(|&wait| start.elapsed() > wait);
                if !met && !hinted && (given_up.is_some() || start.elapsed() > HINT) {
                    hinted = true;
                    let waited = given_up.unwrap_or(HINT).as_secs_f64();
                    services::hint(&args.service, &format!("{waited} s"));
                }
                if !met && given_up.is_some() {
                    tracing::warn!("no simulator connected within the limit of --wait");
                    return Ok(Counters::default());
                }
            }
        }
    }
}

fn tally(c: Counters) -> FrameCounts {
    FrameCounts {
        verified: c.verified,
        skipped: c.skipped,
        rejected: c.rejected,
    }
}
