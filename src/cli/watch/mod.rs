//! `linkwatch watch`: verifies a live simulation and sends verdicts back.

mod checker;
mod closer;
mod follow;
mod state;

use self::follow::Follower;
use self::state::State;
use super::metrics::{ServiceMetrics, address, serve};
use super::number::{seconds, share};
use super::run::{Judge, PATIENCE, Sinks};
use super::signals::stop_on_signals;
use super::{Outcome, stream};
use linkwatch::{AbortOn, Overflow, Result, Sidecar, SidecarOptions};
use std::path::PathBuf;
use std::time::Duration;

/// Watch a live simulation: verify its frames and ask it to stop if its topology breaks
///
/// Ends when the simulator does, on Ctrl-C, SIGTERM or SIGHUP. The exit code is that of the worst
/// session.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Service of the simulator
    ///
    /// `linkwatch services` lists the live ones. Each needs a watch of its own
    #[arg(long, help_heading = super::WATCH, value_name = "NAME", default_value = "linkwatch")]
    service: String,
    /// Give up if no simulator connects within this time
    #[arg(long, help_heading = super::WATCH, value_name = "SECONDS", value_parser = seconds)]
    wait: Option<Duration>,
    /// Wait for the next simulator when one ends
    ///
    /// Until Ctrl-C, SIGTERM or SIGHUP. Each simulator is a session of its own: with its own
    /// baseline, summary, and numbered output files (`run.mcap`, `run-2.mcap`, ..). --wait limits
    /// the wait for the first simulator only
    #[arg(long, help_heading = super::WATCH)]
    keep_watching: bool,
    /// Continue a watch that was killed, from this file
    ///
    /// The state of the watch is written to it and to FILE.session: after a crash or a signal, the
    /// next watch with the same option expects what this one did. A frame that was being verified
    /// is not verified again: the simulator gets the answer that its verdict is unknown. The output
    /// files are numbered then (`run-2.mcap`, ..). The files are removed when the simulation ends
    #[arg(long, help_heading = super::WATCH, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Send nothing to the simulator
    ///
    /// For further watches beside the one that answers. Frames may be skipped, because no simulator
    /// waits for an observer
    #[arg(long, help_heading = super::WATCH, conflicts_with = "abort_on")]
    observe: bool,
    /// Begin with the newest frame, not with the first one
    ///
    /// The watch is not incomplete for the frames before it. Otherwise it begins with the baseline
    /// that the simulator keeps; exit code 3 if that is not there
    #[arg(long, help_heading = super::WATCH)]
    from_now: bool,
    /// Exit code 3 if a larger share of the frames was skipped
    ///
    /// 0 to 1, or a percentage (`5%`). Frames are skipped if they arrive faster than they can be
    /// verified [default: no limit]
    #[arg(long, help_heading = super::WATCH, value_name = "SHARE", value_parser = share)]
    max_skipped: Option<f64>,
    #[command(flatten)]
    judge: Judge,
    #[command(flatten)]
    sinks: Sinks,
    /// Serve figures for Prometheus at http://ADDRESS/metrics
    ///
    /// Counters and latencies. A port alone is on the loopback interface (127.0.0.1); port 0 is a
    /// free one, which the log names. Without a password: at any other address (HOST:PORT) whoever
    /// reaches it can read them
    #[arg(long, help_heading = super::WRITE, value_name = "[HOST:]PORT", value_parser = address)]
    metrics: Option<String>,
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    let stop = stop_on_signals()?;
    stream::detach(Overflow::Wait(PATIENCE))?;
    let mut judge = args.judge.clone();
    if args.observe {
        // Reports and recordings must not claim an abort that is never sent.
        judge.abort_on = Some(AbortOn::Never);
    }
    let metrics = ServiceMetrics::new(&args.service);
    let address = args.metrics.as_ref();
    let server = address.map(|address| serve(address, &metrics));
    let _server = server.transpose()?;
    let inputs = judge.files(args.sinks.overwrite);
    let mut files = inputs.clone();
    let mut state = State::open(args.state.as_deref(), &format!("{judge:?}"))?;
    metrics.restarted(state.note.restarts);
    let (sinks, number) = match state.note.file_number {
        0 => (args.sinks.clone(), 1),
        n => args.sinks.numbered(n + 1, &files),
    };
    sinks.check_files(&mut files)?;
    state.begin_files(number)?;
    let follower = Follower {
        sessions: state.note.sessions,
        state,
        args,
        json,
        stop: &stop,
        judge: &judge,
        files,
        metrics,
        unreadable: String::new(),
        lost: false,
        failed: None,
    };
    // Opened before simulators see the watcher, because a viewer may take a while to open.
    let first = follower.first(&sinks, inputs)?;
    let options = SidecarOptions {
        observe: args.observe,
        from_now: args.from_now,
        ..SidecarOptions::default()
    };
    let mut sidecar = Sidecar::open(&args.service, &options)?;
    if let Some(state) = follower.state.interrupted() {
        sidecar.resume(state);
    }
    let (service, observe) = (&args.service, args.observe);
    let observes = match observe {
        true => "; nothing is sent to it",
        false => "",
    };
    tracing::info!("waiting for a simulator on service '{service}'{observes}");
    follower.follow(sidecar, first)
}
