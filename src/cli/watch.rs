//! `linkwatch watch`: a live simulation in, verdicts back to it.

use super::Outcome;
use super::number::seconds;
use super::output::plural;
use super::session::{Judge, Session, Sinks, Tally};
use linkwatch::{Counters, Event, Events, Result, Sidecar, SidecarOptions, Verifier};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time between two looks at the signals.
const TICK: Duration = Duration::from_millis(200);

/// Watch a live simulation: verify its frames and tell it to stop when its topology breaks
///
/// Ends when the simulator does, on Ctrl-C or on SIGTERM.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the service that the simulator publishes on
    #[arg(long, value_name = "NAME", default_value = "linkwatch")]
    service: String,
    /// Give up when no simulator has come after this time [default: wait for ever]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    wait: Option<Duration>,
    #[command(flatten)]
    judge: Judge,
    #[command(flatten)]
    sinks: Sinks,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let stop = stop_on_signals()?;
    let mut sidecar = Sidecar::open(&args.service, &SidecarOptions::default())?;
    let metadata = BTreeMap::from([("service".to_owned(), args.service.clone())]);
    let mut session = Session::new(
        &args.judge,
        &args.sinks,
        None,
        (Events::Off, Verifier::MOTION_LIMIT),
        &args.service,
        metadata,
        json,
    )?;
    session.live().note(format_args!(
        "waiting for a simulator on service '{}'",
        args.service
    ));
    let ended = watch(args, &mut sidecar, &mut session, &stop);
    let counters = match &ended {
        Ok(counters) => *counters,
        Err(_) => sidecar.counters(),
    };
    // The simulator learns at once that nobody watches any more, not after the sinks have finished.
    drop(sidecar);
    // Whatever happened, what was verified so far is kept and summed up.
    let outcome = session.finish(tally(counters))?;
    ended.map(|_| outcome)
}

/// Watches one session to its end; returns what became of its frames.
fn watch(
    args: &Args,
    sidecar: &mut Sidecar,
    session: &mut Session,
    stop: &AtomicBool,
) -> Result<Counters> {
    let start = Instant::now();
    let mut met = false;
    loop {
        if stop.load(Ordering::Relaxed) {
            session.live().note("stopped by a signal");
            return Ok(sidecar.counters());
        }
        match sidecar.wait(TICK)? {
            Event::NewSession { .. } if !met => {
                met = true;
                session.live().note("a simulator is here");
            }
            Event::NewSession { .. } => {
                // The one before was lost; its run ends with it, and so does its baseline.
                session
                    .live()
                    .note("another simulator took over; start linkwatch again for it");
                session.data_lost();
                return Ok(sidecar.counters());
            }
            Event::Frame(frame) => {
                let (seq, time, cuts) = (frame.seq(), frame.time(), frame.cuts());
                let ingested = session.ingest(|set| frame.ingest(set));
                // The simulator may have its memory back.
                drop(frame);
                let judged = session.judge(seq, time, cuts, ingested)?;
                let sent = sidecar.send_verdict(&judged.report, judged.check);
                session.publish(judged, tally(sidecar.counters()))?;
                sent?;
            }
            Event::Unreadable(why) => {
                tracing::warn!("something that is no frame was rejected: {why}");
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
                    "the simulator died without a word; frames that it published last may be lost"
                );
                session.data_lost();
                return Ok(counters);
            }
            Event::Idle => {
                if !met && args.wait.is_some_and(|wait| start.elapsed() > wait) {
                    tracing::warn!("no simulator came");
                    return Ok(Counters::default());
                }
            }
        }
    }
}

fn tally(c: Counters) -> Tally {
    Tally {
        verified: c.verified,
        skipped: c.skipped,
        rejected: c.rejected,
    }
}

/// A flag that the first SIGINT or SIGTERM sets. The second one ends the process at once.
fn stop_on_signals() -> Result<Arc<AtomicBool>> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&stop))?;
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}
