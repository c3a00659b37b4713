//! Several watches that share one scene: the leader waits for the others, and a member verifies its
//! share of the pairs for the leader.

use super::checker::{Checker, Work};
use super::{Args, PATIENCE};
use crate::cli::Outcome;
use crate::cli::output::{millis, plural};
use crate::cli::session::{Judge, Run, Session, SharedLeader};
use crate::cli::signals::TICK;
use linkwatch::{
    Error, Frame, LastLabels, Overflow, Partition, Result, ShardEvent, ShardLeader, ShardMember,
    ShardSetup,
};
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// One of several shards of a scene: `K/N`.
#[derive(Clone, Copy, Debug)]
pub struct Shard {
    /// From 1.
    pub number: usize,
    pub of: usize,
}

impl FromStr for Shard {
    type Err = String;
    fn from_str(s: &str) -> std::result::Result<Self, String> {
        let most = Partition::MAX_SHARDS;
        let parts = s
            .split_once('/')
            .and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((number, of)) if (2..=most).contains(&of) && (1..=of).contains(&number) => {
                Ok(Shard { number, of })
            }
            _ => Err(format!(
                "expected K/N, such as 1/3: shard K, from 1, of N shards, 2 to {most}"
            )),
        }
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "shard {} of {}", self.number, self.of)
    }
}

/// Opens the services of the leader, and waits for all members.
///
/// Returns `None` if a signal arrived or the time limit passed.
pub fn lead(
    service: &str,
    shards: usize,
    (stop, limit): (&AtomicBool, Option<Duration>),
) -> Result<Option<SharedLeader>> {
    let mut leader = ShardLeader::open(service, shards)?;
    let start = Instant::now();
    let mut told = Vec::new();
    loop {
        let missing = leader.wait(TICK)?;
        if missing.is_empty() {
            tracing::info!("all {shards} shards of service '{service}' are there");
            return Ok(Some(Arc::new(Mutex::new(leader))));
        }
        if missing != told {
            let list: Vec<String> = missing.iter().map(u32::to_string).collect();
            let list = list.join(", ");
            tracing::info!(
                "waiting for shard {list} of {shards}: start each with `linkwatch watch --service \
                 {service} --shard K/{shards}`"
            );
            told = missing;
        }
        if stop.load(Ordering::Relaxed) {
            tracing::info!("stopped by a signal");
            return Ok(None);
        }
        if limit.is_some_and(|limit| start.elapsed() > limit) {
            tracing::warn!("not all shards were there within the limit of --wait");
            return Ok(None);
        }
    }
}

/// A watch that verifies one of the shards after the first.
pub struct Follower<'a> {
    pub args: &'a Args,
    pub judge: &'a Judge,
    pub service: &'a str,
    pub shard: Shard,
    pub stop: &'a AtomicBool,
}

impl Follower<'_> {
    /// Fails if an option is given that only the leader has.
    pub fn check(&self) -> Result<()> {
        let Args {
            judge,
            sinks,
            metrics,
            ..
        } = self.args;
        for (option, given) in [
            ("--baseline", judge.baseline.is_some()),
            ("--abort-on", judge.abort_on.is_some()),
            ("--events", judge.event_args.are_given()),
            ("--paranoid", judge.paranoid),
            ("--max-pairs", judge.max_pairs.is_some()),
            ("--observe", self.args.observe),
            ("--max-skipped", self.args.max_skipped.is_some()),
            ("an output option", sinks.are_used()),
            ("--metrics", metrics.is_given()),
        ] {
            if given {
                let of = self.shard.of;
                return Err(Error::Usage(format!(
                    "{option} with --shard: give it to `--shard 1/{of}` only, which joins the \
                     results and answers the simulator"
                )));
            }
        }
        Ok(())
    }

    /// Verifies frames of the leader until its session ends, or with --keep-watching until a
    /// signal.
    pub fn follow(&self) -> Result<Outcome> {
        let Shard { number, of } = self.shard;
        let mut member = ShardMember::open(self.service, number, of)?;
        let checker = Checker::start()?;
        let mut session = None;
        let mut labels = LastLabels::default();
        let mut frames = 0;
        let mut refused = String::new();
        let start = Instant::now();
        tracing::info!(
            "{}: waiting for shard 1, which watches service '{}'",
            self.shard,
            self.service
        );
        loop {
            if self.stop.load(Ordering::Relaxed) {
                tracing::info!("stopped by a signal");
                member.leave("it was stopped by a signal");
                return Ok(self.finish(frames, Outcome::Fine));
            }
            match member.wait(TICK)? {
                ShardEvent::Begin(setup) => {
                    tracing::info!("{}: a session began", self.shard);
                    match self.session(setup) {
                        Ok(begun) => session = Some(Box::new(begun)),
                        Err(e) => {
                            member.leave(&e.to_string());
                            return Err(e);
                        }
                    }
                }
                ShardEvent::Frame(frame) => {
                    if let Some(begun) = session.take() {
                        let verified =
                            self.verify(begun, frame, &mut labels, &mut member, &checker);
                        session = verified?;
                        frames += u64::from(session.is_some());
                    }
                }
                ShardEvent::End if self.args.keep_watching => session = None,
                ShardEvent::End => return Ok(self.finish(frames, Outcome::Fine)),
                ShardEvent::LeaderLost => {
                    tracing::warn!("shard 1 died; the frames that it had not answered are lost");
                    session = None;
                    if !self.args.keep_watching {
                        return Ok(self.finish(frames, Outcome::Undecided));
                    }
                }
                ShardEvent::Refused(why) => {
                    if why != refused {
                        tracing::warn!("not accepted: {why}");
                        refused = why;
                    }
                }
                ShardEvent::Idle => {}
            }
            let limit = self.args.wait.filter(|_| frames == 0 && session.is_none());
            if limit.is_some_and(|limit| start.elapsed() > limit) {
                tracing::warn!("no session began within the limit of --wait");
                member.leave("no session began within the limit of --wait");
                return Ok(Outcome::Undecided);
            }
        }
    }

    fn session(&self, setup: ShardSetup) -> Result<Session> {
        let run = Run {
            judge: self.judge,
            sinks: &self.args.sinks,
            junit: None,
            files: self.judge.files(self.args.sinks.overwrite),
            strategy: self.judge.strategy(),
            models: false,
            live: false,
            from_now: false,
            baseline: None,
            recorded_events: None,
            recorded_clearance: None,
            recorded_braids: None,
            title: self.service,
            metadata: BTreeMap::new(),
            overflow: Overflow::Wait(PATIENCE),
            json: false,
        };
        Session::of_member(run, &self.judge.kernel, (setup, self.shard.number - 1))
    }

    /// Verifies a frame, and sends the result to the leader. Returns `None` if the session is over
    /// for this member.
    fn verify(
        &self,
        mut session: Box<Session>,
        frame: Frame,
        labels: &mut LastLabels,
        member: &mut ShardMember,
        checker: &Checker,
    ) -> Result<Option<Box<Session>>> {
        let (seq, time) = (frame.seq(), frame.time());
        let info = frame.info(labels);
        let ingested = session.ingest(info, |receive| frame.read(receive));
        drop(frame);
        let quick = session.is_quick(&ingested);
        let work = Work {
            session,
            seq,
            time,
            frame: ingested,
        };
        let beat = || {
            member.heartbeat()?;
            match member.is_superseded()? {
                true => Err(Error::Cancelled),
                false => Ok(()),
            }
        };
        let (mut session, judged) = match quick {
            true => work.judge(),
            false => checker.judge(work, beat, self.stop),
        };
        let result = match judged {
            Ok(judged) => {
                let took = millis(judged.times.check());
                let status = format!("{}: frame {seq} in {took}", self.shard);
                session.live().status(status);
                session.part(judged)
            }
            // The leader does not wait for this frame, or a signal arrived.
            Err(Error::Cancelled) => return Ok(None),
            Err(e @ Error::Bus(_)) => return Err(e),
            Err(e) => Err(e.to_string()),
        };
        member.answer(seq, result)?;
        Ok(Some(session))
    }

    fn finish(&self, frames: u64, outcome: Outcome) -> Outcome {
        let frames = plural(frames, "frame");
        tracing::info!(
            "{}: its pairs were verified in {frames}; shard 1 has the results",
            self.shard
        );
        outcome
    }
}
