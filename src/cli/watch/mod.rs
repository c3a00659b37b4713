//! `linkwatch watch`: verifies a live simulation and sends verdicts back.

mod checker;
mod closer;
mod follow;
mod state;

use self::follow::Follower;
use self::state::State;
use super::Outcome;
use super::files::with_suffix;
use super::label::Label;
use super::metrics::{Metrics, MetricsArgs};
use super::number::{seconds, share};
use super::output;
use super::run::{Judge, Run, Sinks};
use super::signals::stop_on_signals;
use linkwatch::{AbortOn, Error, Overflow, Result, Sidecar, SidecarOptions};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use tracing::Span;

/// Maximum total time that a sink or standard output may delay verdicts until it has caught up.
/// After that, frames or lines are dropped and counted.
const PATIENCE: Duration = Duration::from_millis(500);

/// Watch a live simulation: verify its frames and ask it to stop if its topology breaks
///
/// Ends when the simulator does, on Ctrl-C or on SIGTERM. The exit code is that of the worst
/// session.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Service of the simulator; may be repeated
    ///
    /// `linkwatch services` lists the live ones. Given several times, all of them are watched, each
    /// with its own baseline and output files (`run-NAME.mcap`)
    #[arg(long, help_heading = super::WATCH, value_name = "NAME", default_value = "linkwatch")]
    service: Vec<String>,
    /// Give up if no simulator connects within this time
    #[arg(long, help_heading = super::WATCH, value_name = "SECONDS", value_parser = seconds)]
    wait: Option<Duration>,
    /// Wait for the next simulator when one ends
    ///
    /// Until Ctrl-C or SIGTERM. Each simulator is a session of its own: with its own baseline,
    /// summary, and numbered output files (`run.mcap`, `run-2.mcap`, ..). --wait limits the wait
    /// for the first simulator only
    #[arg(long, help_heading = super::WATCH)]
    keep_watching: bool,
    /// Continue a watch that was killed, from this file
    ///
    /// The state of the watch is written to it and to FILE.session: after a crash or a signal, the
    /// next watch with the same option expects what this one did. A frame that was being verified
    /// is not verified again: the simulator gets the answer that its verdict is unknown. The output
    /// files are numbered then (`run-2.mcap`, ..). The files are removed when the simulation ends.
    /// With several services each has its own (`watch-NAME.state`)
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
    #[command(flatten)]
    metrics: MetricsArgs,
}

/// A watch of one service, ready to start.
struct Watch<'a> {
    /// Labels log messages with the service, if there are several.
    span: Span,
    follower: Follower<'a>,
    first: Box<Run>,
    sidecar: Sidecar,
}

impl Watch<'_> {
    /// Follows the service to the end of the watch.
    fn run(self) -> Result<Outcome> {
        let _entered = self.span.entered();
        self.follower.follow(self.sidecar, self.first)
    }
}

/// Runs the command.
pub fn run(args: &Args, json: bool) -> Result<Outcome> {
    for (k, service) in args.service.iter().enumerate() {
        if args.service[..k].contains(service) {
            return Err(Error::Usage(format!(
                "--service '{service}' is given twice"
            )));
        }
    }
    let stop = stop_on_signals()?;
    output::detach(Overflow::Wait(PATIENCE))?;
    let mut judge = args.judge.clone();
    if args.observe {
        // Reports and recordings must not claim an abort that is never sent.
        judge.abort_on = Some(AbortOn::Never);
    }
    let metrics = args.metrics.serve(&args.service)?;
    let watches = open(args, json, &judge, &metrics, &stop)?;
    if args.service.len() == 1 {
        return watches
            .into_iter()
            .map(Watch::run)
            .collect::<Result<_>>()
            .map(worst);
    }
    std::thread::scope(|scope| {
        let mut threads = Vec::new();
        for watch in watches {
            let run = || {
                let span = watch.span.clone();
                let outcome = watch.run();
                if let Err(e) = &outcome {
                    // The other services are still watched.
                    span.in_scope(|| tracing::error!("the watch of this service ended: {e}"));
                }
                outcome
            };
            let thread = std::thread::Builder::new().name("linkwatch-watch".into());
            threads.push(thread.spawn_scoped(scope, run)?);
        }
        let mut outcomes = Vec::new();
        let mut failed = None;
        for thread in threads {
            match thread.join() {
                Ok(Ok(outcome)) => outcomes.push(outcome),
                Ok(Err(e)) => {
                    failed.get_or_insert(e);
                }
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        result(worst(outcomes), failed)
    })
}

/// Opens all services and their outputs. Fails before any of them is watched.
fn open<'a>(
    args: &'a Args,
    json: bool,
    judge: &'a Judge,
    metrics: &Metrics,
    stop: &'a AtomicBool,
) -> Result<Vec<Watch<'a>>> {
    let several = args.service.len() > 1;
    let inputs = judge.files(args.sinks.overwrite);
    let mut files = inputs.clone();
    let mut outputs = Vec::new();
    for service in &args.service {
        let path = args.state.as_deref().map(|path| match several {
            true => with_suffix(path, service),
            false => path.to_owned(),
        });
        let mut state = State::open(path.as_deref(), &format!("{judge:?}"))?;
        let sinks = match several {
            true => args.sinks.with_suffix(service),
            false => args.sinks.clone(),
        };
        let (first, number) = match state.file_number() {
            0 => (sinks.clone(), 1),
            n => sinks.numbered(n + 1, &files),
        };
        first.check_files(&mut files)?;
        state.begin_files(number)?;
        outputs.push((sinks, first, state));
    }
    let mut ready = Vec::new();
    for (service, (sinks, first, state)) in args.service.iter().zip(outputs) {
        let span = match several {
            true => tracing::error_span!("watch", service = %service),
            false => Span::none(),
        };
        let metrics = metrics.service(service);
        metrics.restarted(state.restarts());
        let follower = Follower {
            sessions: state.sessions(),
            file_number: state.file_number(),
            state,
            args,
            json,
            stop,
            service,
            judge,
            sinks,
            files: files.clone(),
            label: Label {
                service: several.then(|| service.as_str().into()),
                session: None,
            },
            metrics,
            unreadable: String::new(),
            lost: false,
            failed: None,
        };
        // Opened before simulators see the watcher, because a viewer may take a while to open.
        let first = span.in_scope(|| follower.first(&first, inputs.clone()))?;
        ready.push((span, follower, first));
    }
    let mut options = SidecarOptions::default();
    options.observe = args.observe;
    options.from_now = args.from_now;
    let open = |(span, follower, first): (Span, Follower<'a>, Box<Run>)| {
        let service = follower.service;
        let mut sidecar = Sidecar::open(service, &options)?;
        if let Some(state) = follower.state.interrupted() {
            sidecar.resume(state);
        }
        span.in_scope(|| match args.observe {
            true => tracing::info!(
                "waiting for a simulator on service '{service}'; nothing is sent to it"
            ),
            false => tracing::info!("waiting for a simulator on service '{service}'"),
        });
        Ok(Watch {
            span,
            follower,
            first,
            sidecar,
        })
    };
    ready.into_iter().map(open).collect()
}

/// Returns the worst outcome.
fn worst(outcomes: Vec<Outcome>) -> Outcome {
    outcomes.into_iter().max().unwrap_or(Outcome::Fine)
}

/// Returns the result of several sessions or services. A changed topology is worse than an error.
fn result(worst: Outcome, failed: Option<Error>) -> Result<Outcome> {
    match failed {
        Some(e) if worst < Outcome::Changed => Err(e),
        _ => Ok(worst),
    }
}
