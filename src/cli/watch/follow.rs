//! Follows one service: verifies its simulators, one after another.

use super::checker::{Checker, Work};
use super::closer::Closer;
use super::{Args, PATIENCE, result};
use crate::cli::files::Files;
use crate::cli::label::Label;
use crate::cli::metrics::ServiceMetrics;
use crate::cli::output::{percent, plural};
use crate::cli::session::{FrameCounts, Judge, Run, Session, SharedLeader, Sinks, locked};
use crate::cli::signals::TICK;
use crate::cli::{Outcome, services};
use linkwatch::{Counters, Error, Event, LastLabels, LiveTimes, Overflow, Result, Sidecar};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time without a simulator after which the live services are listed, once.
const HINT: Duration = Duration::from_secs(5);

/// Settings and state of a watch of one service.
pub struct Follower<'a> {
    pub args: &'a Args,
    pub json: bool,
    /// Set by a signal, which ends the watch.
    pub stop: &'a AtomicBool,
    pub service: &'a str,
    pub judge: &'a Judge,
    /// Sinks of the first session.
    pub sinks: Sinks,
    /// Inputs of the command, and the outputs of all first sessions.
    pub files: Files,
    /// Label of the service, without a session.
    pub label: Label,
    pub metrics: ServiceMetrics,
    /// Number of simulators that connected.
    pub sessions: u64,
    /// Number in the file names of the last session.
    pub file_number: u64,
    /// Last warning about an unreadable message.
    pub unreadable: String,
    /// True if messages were lost that belong to no session so far.
    pub lost: bool,
    /// First error of a session that did not end the watch.
    pub failed: Option<Error>,
    /// The leader of several shards, if this watch is shard 1.
    pub shards: Option<SharedLeader>,
}

/// Reason why the watch of a session ended.
enum End {
    /// The simulator ended, died or was replaced.
    Simulator(Counters),
    /// A signal arrived.
    Signal(Counters),
}

impl Follower<'_> {
    /// Prepares the first session. `inputs` are the inputs of the command.
    pub fn first(&self, inputs: Files) -> Result<Box<Session>> {
        self.session(1, &self.sinks, inputs)
    }

    /// Prepares a session.
    fn session(&self, number: u64, sinks: &Sinks, files: Files) -> Result<Box<Session>> {
        let title = match number {
            1 => self.service.to_owned(),
            n => format!("{}, session {n}", self.service),
        };
        let session = Session::new(Run {
            judge: self.judge,
            sinks,
            junit: None,
            files,
            strategy: self.judge.strategy(),
            models: false,
            baseline: None,
            recorded_events: None,
            title: &title,
            metadata: BTreeMap::from([("service".to_owned(), self.service.to_owned())]),
            overflow: Overflow::Wait(PATIENCE),
            json: self.json,
        })?;
        let label = Label {
            session: self.args.keep_watching.then_some(number),
            ..self.label.clone()
        };
        let session = session.labelled(label).measured(&self.metrics);
        Ok(Box::new(match &self.shards {
            Some(leader) => session.shared_with(leader),
            None => session,
        }))
    }

    /// Prepares a session after the first one. Its files get a number that is free.
    fn next(&mut self) -> Result<Box<Session>> {
        let wanted = self.sessions.max(self.file_number + 1);
        let (sinks, number) = self.sinks.numbered(wanted, &self.files);
        self.file_number = number;
        for path in sinks.paths() {
            let n = self.sessions;
            tracing::info!("the output of session {n} goes to {}", path.display());
        }
        self.session(self.sessions, &sinks, self.files.clone())
    }

    /// Follows the service until its simulator ends, or with --keep-watching until a signal.
    pub fn follow(mut self, mut sidecar: Sidecar, first: Box<Session>) -> Result<Outcome> {
        let checker = Checker::start()?;
        let mut closer = Closer::new();
        let mut first = Some(first);
        loop {
            let met = self.wait_for_simulator(&mut sidecar);
            if !matches!(met, Ok(true)) {
                drop(sidecar);
                if let Some(session) = first {
                    closer.add(session.finish(FrameCounts::default()));
                }
                if self.lost {
                    closer.add(Outcome::Undecided);
                }
                let worst = closer.finish();
                return met.and_then(|_| result(worst, self.failed));
            }
            let session = match first.take() {
                Some(session) => Ok(session),
                None => self.next(),
            };
            let mut session = match session {
                Ok(session) => session,
                Err(e) => {
                    sidecar.leave();
                    self.metrics.disconnected();
                    self.fail(e);
                    continue;
                }
            };
            if std::mem::take(&mut self.lost) {
                session.data_lost();
            }
            let (mut session, ended) = self.verify(session, &mut sidecar, &checker);
            self.metrics.disconnected();
            if let Some(leader) = &self.shards
                && let Err(e) = locked(leader).end_session()
            {
                tracing::warn!("the other shards do not know that the session ended: {e}");
            }
            let counters = match &ended {
                Ok(End::Simulator(counters) | End::Signal(counters)) => *counters,
                Err(_) => sidecar.counters(),
            };
            let tally = tally(counters);
            self.check_skipped(&mut session, tally);
            let fatal = matches!(&ended, Ok(End::Signal(_)) | Err(Error::Bus(_)));
            if fatal || !self.args.keep_watching {
                // Sends the goodbye, so that a simulator does not wait for the sinks to finish.
                drop(sidecar);
                // In any case, the frames verified so far are kept and summarised.
                closer.add(session.finish(tally));
                let worst = closer.finish();
                return ended.and_then(|_| result(worst, self.failed));
            }
            if let Err(e) = ended {
                sidecar.leave();
                session.data_lost();
                self.fail(e);
            }
            session.live().clear();
            closer.close(session, tally)?;
            tracing::info!(
                "waiting for the next simulator on service '{}'",
                self.service
            );
        }
    }

    /// Records an error that ends a session, but not the watch.
    fn fail(&mut self, e: Error) {
        tracing::error!("session {} is not verified any further: {e}", self.sessions);
        self.failed.get_or_insert(e);
    }

    /// Applies --max-skipped to a session that has ended.
    fn check_skipped(&self, session: &mut Session, tally: FrameCounts) {
        let share = tally.skipped_share();
        if let Some(most) = self.args.max_skipped.filter(|&most| share > most) {
            tracing::error!(
                "{} of the frames were skipped, more than the {} of --max-skipped",
                percent(share),
                percent(most),
            );
            session.data_lost();
        }
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Waits for a simulator. Returns false if none came, because of a signal or --wait.
    fn wait_for_simulator(&mut self, sidecar: &mut Sidecar) -> Result<bool> {
        let start = Instant::now();
        let first = self.sessions == 0;
        let mut hinted = !first;
        loop {
            if self.is_stopped() {
                tracing::info!("stopped by a signal");
                return Ok(false);
            }
            match sidecar.wait(TICK)? {
                Event::NewSession { .. } => {
                    self.metrics.connected();
                    self.sessions += 1;
                    match (self.args.keep_watching, self.sessions) {
                        (true, n) => tracing::info!("a simulator connected: session {n}"),
                        (false, _) => tracing::info!("a simulator connected"),
                    }
                    return Ok(true);
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
                services::hint(self.service, &format!("{waited} s"));
            }
            if given_up.is_some() {
                tracing::warn!("no simulator connected within the limit of --wait");
                return Ok(false);
            }
        }
    }

    /// Verifies the frames of a simulator until it ends.
    fn verify(
        &mut self,
        mut session: Box<Session>,
        sidecar: &mut Sidecar,
        checker: &Checker,
    ) -> (Box<Session>, Result<End>) {
        // Receipt of the last frame, and the time at which this thread had finished it.
        let mut last: Option<[Instant; 2]> = None;
        let mut labels = LastLabels::default();
        loop {
            if self.is_stopped() {
                tracing::info!("stopped by a signal");
                return (session, Ok(End::Signal(sidecar.counters())));
            }
            let event = match sidecar.wait(TICK) {
                Ok(event) => event,
                Err(e) => return (session, Err(e)),
            };
            match event {
                Event::Frame(frame) => {
                    let received = Instant::now();
                    let (seq, time) = (frame.seq(), frame.time());
                    let info = frame.info(&mut labels);
                    let ingested = session.ingest(info, |receive| frame.read(receive));
                    // Returns the memory to the simulator.
                    drop(frame);
                    let quick = session.is_quick(&ingested);
                    let work = Work {
                        session,
                        seq,
                        time,
                        frame: ingested,
                    };
                    let judged;
                    (session, judged) = match quick {
                        true => work.judge(),
                        false => checker.judge(work, || sidecar.heartbeat(), self.stop),
                    };
                    let mut judged = match judged {
                        Ok(judged) => judged,
                        Err(Error::Cancelled) => {
                            sidecar.skip();
                            tracing::info!(
                                "stopped by a signal; the check of frame {seq} was cancelled"
                            );
                            return (session, Ok(End::Signal(sidecar.counters())));
                        }
                        Err(e) => return (session, Err(e)),
                    };
                    let sending = Instant::now();
                    let sent = sidecar.send_verdict(&judged.report, judged.times.check());
                    judged.latency = Some(received.elapsed());
                    judged.times.live = last.map(|[previous, finished]| LiveTimes {
                        interval: received - previous,
                        wait: received - finished,
                        send: sending.elapsed(),
                    });
                    session.publish(judged, tally(sidecar.counters()));
                    if let Err(e) = sent {
                        return (session, Err(e));
                    }
                    last = Some([received, Instant::now()]);
                }
                Event::Unreadable(why) => {
                    self.reject(why);
                    session.data_lost();
                }
                Event::End {
                    counters,
                    clean,
                    published,
                    ..
                } => {
                    if !clean {
                        tracing::info!(
                            "the simulator left without finishing (an error or a panic)"
                        );
                        session.data_lost();
                    }
                    let frames = plural(published, "frame");
                    tracing::info!("the simulator ended after {frames}");
                    return (session, Ok(End::Simulator(counters)));
                }
                Event::SimulatorLost { counters, .. } => {
                    tracing::warn!(
                        "the simulator died without ending the session; its last frames may be lost"
                    );
                    session.data_lost();
                    return (session, Ok(End::Simulator(counters)));
                }
                // A session begins only after the end of the previous one.
                Event::NewSession { .. } | Event::Idle => {}
            }
        }
    }

    /// Warns of an unreadable message, once for the same reason: a simulator that sends one usually
    /// sends it with each frame.
    fn reject(&mut self, why: Error) {
        let advice = match why {
            Error::Version { .. } => {
                "; the simulator was built with another version of linkwatch: use one version on \
                 both sides"
            }
            _ => "",
        };
        let why = format!("a message that is not a frame was rejected: {why}{advice}");
        if why != self.unreadable {
            tracing::warn!("{why}");
            self.unreadable = why;
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
