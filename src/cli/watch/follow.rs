//! Follows one service: verifies its simulators, one after another.

use super::Args;
use super::checker::judge;
use super::closer::Closer;
use super::state::State;
use crate::cli::files::Files;
use crate::cli::metrics::ServiceMetrics;
use crate::cli::output::{percent, plural};
use crate::cli::run::{Judge, Run, Setup, Sinks};
use crate::cli::signals::TICK;
use crate::cli::{Outcome, services};
use linkwatch::{
    Error, Event, FrameInfo, LastLabels, LiveTimes, Received, Report, Result, Sidecar, Verdict,
};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time without a simulator after which the live services are listed, once.
const HINT: Duration = Duration::from_secs(5);

/// Interval at which a watch looks whether the simulator of a session that it is to continue is
/// still there.
const GONE: Duration = Duration::from_secs(1);

/// Settings and state of a watch.
pub struct Follower<'a> {
    pub args: &'a Args,
    pub json: bool,
    /// Set by a signal, which ends the watch.
    pub stop: &'a AtomicBool,
    pub judge: &'a Judge,
    /// Inputs of the command, and the outputs of all first sessions.
    pub files: Files,
    pub metrics: ServiceMetrics,
    /// State for the next process (`--state`).
    pub state: State,
    /// Number of simulators that connected.
    pub sessions: u64,
    /// Last warning about an unreadable message.
    pub unreadable: String,
    /// True if messages were lost that belong to no session so far.
    pub lost: bool,
    /// First error of a session that did not end the watch.
    pub failed: Option<Error>,
}

/// Reason why the watch of a session ended.
enum End {
    /// The simulator ended, died or was replaced.
    Simulator,
    /// A signal arrived.
    Signal,
}

impl Follower<'_> {
    /// Prepares the first session. `inputs` are the inputs of the command.
    pub fn first(&self, sinks: &Sinks, inputs: Files) -> Result<Box<Run>> {
        // The session that is to continue, or a new one.
        let is_new = self.state.interrupted().is_none();
        let number = self.sessions + u64::from(is_new);
        if self.state.note.restarts > 0 {
            announce_files(number, sinks);
        }
        self.session(number, sinks, inputs)
    }

    /// Prepares a session.
    fn session(&self, number: u64, sinks: &Sinks, files: Files) -> Result<Box<Run>> {
        let title = match number {
            1 => self.args.service.clone(),
            n => format!("{}, session {n}", self.args.service),
        };
        let setup = Setup {
            live: true,
            from_now: self.args.from_now,
            title,
            metadata: BTreeMap::from([("service".to_owned(), self.args.service.clone())]),
            json: self.json,
            ..Setup::default()
        };
        let mut run = Run::new(self.judge, sinks, files, setup)?;
        run.live.session = self.label(number);
        Ok(Box::new(run.measured(&self.metrics)))
    }

    /// Returns the number with which the results of a session are labelled, if there may be several
    /// sessions.
    fn label(&self, number: u64) -> Option<u64> {
        self.args.keep_watching.then_some(number)
    }

    /// Prepares a session after the first one. Its files get a number that is free.
    fn next(&mut self) -> Result<Box<Run>> {
        let wanted = self.sessions.max(self.state.note.file_number + 1);
        let (sinks, number) = self.args.sinks.numbered(wanted, &self.files);
        self.state.begin_files(number)?;
        announce_files(self.sessions, &sinks);
        self.session(self.sessions, &sinks, self.files.clone())
    }

    /// Follows the service until its simulator ends, or with --keep-watching until a signal.
    pub fn follow(mut self, mut sidecar: Sidecar, first: Box<Run>) -> Result<Outcome> {
        let mut closer = Closer::new(self.state.note.outcome);
        let mut first = Some(first);
        loop {
            let met = self.wait_for_simulator(&mut sidecar);
            let Ok(Some(id)) = met else {
                drop(sidecar);
                closer.add(Outcome::undecided_if(self.lost));
                let is_complete = met.is_ok() && !self.is_stopped();
                return self.end(closer, first, is_complete, met);
            };
            let mut run = match first.take().map_or_else(|| self.next(), Ok) {
                Ok(run) => run,
                Err(e) => {
                    sidecar.leave(&e.to_string());
                    self.metrics.disconnected();
                    self.fail(e);
                    continue;
                }
            };
            // Not the expected number if another simulator came than before a restart.
            run.live.session = self.label(self.sessions);
            if std::mem::take(&mut self.lost) {
                run.data_lost();
            }
            self.take_up(&mut run, &mut sidecar, id)?;
            let ended = self.verify(&mut run, &mut sidecar);
            let is_complete = matches!(&ended, Ok(End::Simulator));
            self.metrics.disconnected();
            if !is_complete {
                run.tally = sidecar.counters();
            }
            if let Err(e) = &ended {
                sidecar.leave(&e.to_string());
            }
            self.check_skipped(&mut run);
            if is_complete {
                self.state.end_session(run.outcome())?;
            }
            let fatal = matches!(&ended, Ok(End::Signal) | Err(Error::Bus(_)));
            if fatal || !self.args.keep_watching {
                // Sends the goodbye, so that a simulator does not wait for the sinks to finish.
                drop(sidecar);
                // With --state, the next process continues after the last frame.
                if matches!(&ended, Ok(End::Signal))
                    && let Err(e) = self.state.keep(|| run.state())
                {
                    tracing::error!("{e}");
                }
                // In any case, the outputs are closed, and the summary is printed.
                return self.end(closer, Some(run), is_complete, ended);
            }
            if let Err(e) = ended {
                run.data_lost();
                self.fail(e);
            }
            run.live.clear();
            closer.close(run)?;
            let service = &self.args.service;
            tracing::info!("waiting for the next simulator on service '{service}'");
        }
    }

    /// Ends the watch, and closes its last session. If `is_complete` is false, after a signal or an
    /// error, the state files are kept, so that the next process can continue. `ended` is the
    /// result of the last session.
    fn end<T>(
        mut self,
        mut closer: Closer,
        last: Option<Box<Run>>,
        is_complete: bool,
        ended: Result<T>,
    ) -> Result<Outcome> {
        if let Some(run) = last {
            closer.add(run.finish());
        }
        let (earlier, worst) = (closer.earlier, closer.finish());
        if earlier == Outcome::Changed {
            tracing::warn!("this watch found a change before it was started again");
        }
        match is_complete {
            true => self.state.end(),
            false => self.state.stop(worst),
        }?;
        ended?;
        // A changed topology is worse than an error.
        match self.failed {
            Some(e) if worst < Outcome::Changed => Err(e),
            _ => Ok(worst),
        }
    }

    /// Continues a session that an earlier process watched.
    fn take_up(&mut self, run: &mut Run, sidecar: &mut Sidecar, id: u64) -> Result<()> {
        let interrupted = self.state.interrupted().is_some();
        let Some(earlier) = self.state.begin_session(id, self.sessions)? else {
            if interrupted {
                tracing::warn!(
                    "this is another simulator than before the watch was started again: it has a \
                     baseline of its own"
                );
            }
            return Ok(());
        };
        run.follow_on(sidecar.counters());
        match earlier.run {
            Some(state) => run.resume(state)?,
            None => tracing::warn!(
                "no frame was verified before the watch was started again: the next one is the \
                 first frame"
            ),
        }
        let Some((seq, time)) = earlier.in_hand else {
            return Ok(());
        };
        let why = "the watch crashed while it verified this frame, which is not verified again";
        tracing::error!("frame {seq}: {why}");
        let judged = run.give_up(seq, time, why);
        let sent = sidecar.send_verdict(&judged.report, Duration::ZERO);
        run.tally = sidecar.counters();
        run.publish(judged);
        sent?;
        let outcome = run.outcome();
        self.state.end_frame(sidecar.state(), None, outcome)
    }

    /// Records an error that ends a session, but not the watch.
    fn fail(&mut self, e: Error) {
        tracing::error!("session {} is not verified any further: {e}", self.sessions);
        self.failed.get_or_insert(e);
    }

    /// Applies --max-skipped to a session that has ended.
    fn check_skipped(&self, run: &mut Run) {
        let share = run.tally.skipped_share();
        if let Some(most) = self.args.max_skipped.filter(|&most| share > most) {
            let [share, most] = [share, most].map(percent);
            tracing::error!(
                "{share} of the frames were skipped, more than the {most} of --max-skipped"
            );
            run.data_lost();
        }
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Waits for a simulator. Returns its session, or `None` if none came, because of a signal or
    /// --wait, or because the one that an earlier process watched has ended.
    fn wait_for_simulator(&mut self, sidecar: &mut Sidecar) -> Result<Option<u64>> {
        let start = Instant::now();
        let interrupted = self.state.interrupted();
        let mut looked = start;
        let first = self.sessions == 0;
        let mut hinted = !first;
        loop {
            if self.is_stopped() {
                tracing::info!("stopped by a signal");
                return Ok(None);
            }
            match sidecar.wait(TICK)? {
                Event::NewSession { session } => {
                    self.metrics.connected();
                    if interrupted.is_some_and(|state| state.session() == session) {
                        tracing::info!("the watch of the simulator continues");
                        return Ok(Some(session));
                    }
                    self.sessions += 1;
                    match (self.args.keep_watching, self.sessions) {
                        (true, n) => tracing::info!("a simulator connected: session {n}"),
                        (false, _) => tracing::info!("a simulator connected"),
                    }
                    return Ok(Some(session));
                }
                Event::Unreadable(why) => {
                    self.reject(why);
                    self.lost = true;
                    hinted = true;
                }
                _ => {}
            }
            let limit = self.args.wait.filter(|_| first);
            let given_up = limit.filter(|&wait| start.elapsed() > wait);
            if !hinted && (given_up.is_some() || start.elapsed() > HINT) {
                hinted = true;
                let waited = given_up.unwrap_or(HINT).as_secs_f64();
                services::hint(&self.args.service, &format!("{waited} s"));
            }
            if given_up.is_some() {
                tracing::warn!("no simulator connected within the limit of --wait");
                return Ok(None);
            }
            if interrupted.is_some() && !self.args.keep_watching && looked.elapsed() > GONE {
                looked = Instant::now();
                if !services::may_have_simulator(&self.args.service)? {
                    tracing::warn!(
                        "the simulator ended before the watch could continue; its last frames were \
                         not verified"
                    );
                    return Ok(None);
                }
            }
        }
    }

    /// Verifies the frames of a simulator until it ends.
    fn verify(&mut self, run: &mut Run, sidecar: &mut Sidecar) -> Result<End> {
        // Receipt of the last frame, and the time at which this thread had finished it.
        let mut last: Option<[Instant; 2]> = None;
        let mut labels = LastLabels::default();
        loop {
            if self.is_stopped() {
                tracing::info!("stopped by a signal");
                return Ok(End::Signal);
            }
            match sidecar.wait(TICK)? {
                Event::Frame(frame) => {
                    let received = Instant::now();
                    let (seq, time) = (frame.seq(), frame.time());
                    let before = self.state.note.clone();
                    let (state, cuts) = (sidecar.state(), frame.cuts());
                    self.state.begin_frame(state, seq, time, cuts)?;
                    if frame.after_gap() && run.tally.verified > 0 {
                        run.begin_after_gap();
                    }
                    let ingested = match frame.info(&mut labels) {
                        Ok(info) => run.session.receive(info, |receive| frame.read(receive)),
                        Err(why) => Received::new(FrameInfo::at(seq, time), Err(why)),
                    };
                    // Returns the memory to the simulator.
                    drop(frame);
                    let judged = match run.is_quick(&ingested) {
                        true => run.judge(ingested),
                        false => judge(run, ingested, || sidecar.heartbeat(), self.stop),
                    };
                    let mut judged = match judged {
                        Err(Error::Cancelled) => {
                            sidecar.skip();
                            tracing::info!(
                                "stopped by a signal; the check of frame {seq} was cancelled"
                            );
                            self.state.cancel_frame(before, sidecar.state())?;
                            return Ok(End::Signal);
                        }
                        judged => judged?,
                    };
                    // Before the verdict: the next process must expect what this one answered for.
                    if run.changes_baseline(&judged) {
                        run.tally = sidecar.counters();
                        run.find_origin(&judged);
                        self.state.keep(|| run.state())?;
                    }
                    if let Some(recovered) = run.recovered_by(&judged) {
                        sidecar.withdraw_abort(recovered);
                    }
                    let sending = Instant::now();
                    let sent = sidecar.send_verdict(&judged.report, judged.times.check());
                    let noted = self.note(sidecar, &judged.report, run);
                    judged.latency = Some(received.elapsed());
                    judged.times.live = last.map(|[previous, finished]| LiveTimes {
                        interval: received - previous,
                        wait: received - finished,
                        send: sending.elapsed(),
                    });
                    run.tally = sidecar.counters();
                    run.publish(judged);
                    sent.and(noted)?;
                    last = Some([received, Instant::now()]);
                }
                Event::Unreadable(why) => {
                    self.reject(why);
                    run.data_lost();
                }
                Event::End {
                    counters,
                    clean,
                    published,
                    ..
                } => {
                    if !clean {
                        let why = "the simulator left without finishing";
                        tracing::info!("{why} (an error or a panic)");
                        run.cut_off(why);
                    }
                    let frames = plural(published, "frame");
                    tracing::info!("the simulator ended after {frames}");
                    run.tally = counters;
                    return Ok(End::Simulator);
                }
                Event::SimulatorLost { counters, .. } => {
                    tracing::warn!(
                        "the simulator died without ending the session; its last frames may be \
                         lost, and its own log may say why"
                    );
                    run.cut_off("the simulator died");
                    run.tally = counters;
                    return Ok(End::Simulator);
                }
                // A session begins only after the end of the previous one.
                Event::NewSession { .. } | Event::Idle => {}
            }
        }
    }

    /// Notes the verdict on a frame for the next process.
    fn note(&mut self, sidecar: &Sidecar, report: &Report, run: &Run) -> Result<()> {
        let verified = Some(report).filter(|report| report.verdict != Verdict::Rejected);
        let outcome = Outcome::of(report.verdict);
        self.state.end_frame(sidecar.state(), verified, outcome)?;
        self.state.keep_from_time_to_time(|| run.state())
    }

    /// Warns of an unreadable message, once for the same reason: a simulator that sends one usually
    /// sends it with each frame.
    fn reject(&mut self, why: Error) {
        let is_version = matches!(why, Error::Version { .. });
        let mut why = format!("a message that is not a frame was rejected: {why}");
        if is_version {
            why += "; the simulator was built with another version of linkwatch: use one version \
                    on both sides";
        }
        if why != self.unreadable {
            tracing::warn!("{why}");
            self.unreadable = why;
        }
    }
}

fn announce_files(session: u64, sinks: &Sinks) {
    for path in sinks.paths() {
        tracing::info!("the output of session {session} goes to {}", path.display());
    }
}
