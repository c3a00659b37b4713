//! A session whose pairs are verified by several processes.

use super::{Judged, Run, Session};
use crate::cli::kernel::KernelArgs;
use linkwatch::{
    Certificate, CurveSet, Error, FrameInfo, Joiner, Part, Partition, Report, Result, ShardLeader,
    ShardSetup, Verifier, VerifierOptions,
};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Time for which the first frame of a session waits for members that are missing.
const FIRST_FRAME: Duration = Duration::from_secs(10);

/// The leader of several shards, which all sessions of a service share.
pub type SharedLeader = Arc<Mutex<ShardLeader>>;

/// Locks the leader. A check that panicked has ended the watch.
pub fn locked(leader: &SharedLeader) -> MutexGuard<'_, ShardLeader> {
    leader.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The shards of one session.
pub struct Shards {
    leader: SharedLeader,
    joiner: Joiner,
    /// Options of all shards, with the baseline that the user gave.
    options: VerifierOptions,
    /// True after the first frame.
    started: bool,
}

impl Session {
    /// Verifies a part of the pairs, and joins the results of the members that verify the others.
    pub fn shared_with(mut self, leader: &SharedLeader) -> Session {
        self.shards = Some(Shards {
            joiner: Joiner::new(locked(leader).shards(), self.options.events),
            leader: Arc::clone(leader),
            options: self.options.clone(),
            started: false,
        });
        self
    }

    /// Prepares the session of a member, from 0: it verifies its share of the pairs, and leaves
    /// the rest to the leader.
    pub fn of_member(
        run: Run<'_>,
        kernel: &KernelArgs,
        (setup, shard): (ShardSetup, usize),
    ) -> Result<Session> {
        let mut session = Session::new(run)?;
        session.verifier = setup.verifier(kernel.options()?, shard)?;
        Ok(session)
    }

    /// Returns the result of a member for the leader, or why it has none.
    pub fn part(&mut self, judged: Judged) -> std::result::Result<Part, String> {
        let report = Arc::unwrap_or_clone(judged.report);
        match report.rejected {
            Some(why) => Err(why),
            None => Ok(self.verifier.part(report)),
        }
    }
}

impl Shards {
    /// Verifies a frame together with the members.
    pub fn step(
        &mut self,
        verifier: &mut Verifier,
        (seq, time): (u64, f64),
        info: &FrameInfo,
        set: &Arc<CurveSet>,
    ) -> Result<Report> {
        let mut leader = locked(&self.leader);
        let first = !self.started;
        if first && verifier.share().is_none() {
            leader.wait(FIRST_FRAME)?;
            let partition = Partition::new(set, leader.shards())?;
            verifier.verify_share(partition.share(0))?;
        }
        let partition = verifier.share().map(|share| share.partition().clone());
        let partition = partition.expect("the verifier has a share");
        let (options, joiner) = (&self.options, &self.joiner);
        let begun = leader.begin(|shard| {
            let baseline = match first {
                true => options.baseline.clone(),
                false => Some(joiner.baseline(shard as usize - 1).cloned().ok_or_else(|| {
                    format!(
                        "shard {shard} cannot begin before the next session: the expected linking \
                         numbers of its pairs are unknown, because it was missing in the first \
                         frame or while the curves changed"
                    )
                })?),
            };
            let options = VerifierOptions {
                baseline,
                ..options.clone()
            };
            Ok(ShardSetup::new(&options, &partition))
        });
        let published = begun.and_then(|()| leader.publish(seq, time, info, set));
        let report = verifier.step_shared(seq, time, set)?;
        let progress = verifier.progress();
        let others = published.and_then(|()| leader.collect(seq, || progress.is_cancelled()));
        if progress.is_cancelled() {
            return Err(Error::Cancelled);
        }
        let others = others.unwrap_or_else(|e| {
            let missing = (2..=leader.shards()).map(|k| Err(format!("shard {k}: {e}")));
            missing.collect()
        });
        self.started = true;
        let own = Ok(verifier.part(report));
        let parts = std::iter::once(own).chain(others).collect();
        Ok(self.joiner.join(seq, time, parts))
    }

    /// Marks the next frame as not continuing the previous one.
    pub fn cut(&mut self) {
        self.joiner.cut();
    }

    /// Announces that the next frame has other curves.
    pub fn change_curves(&mut self) {
        self.joiner.change_curves();
    }

    /// Returns the last frame that is known to be intact.
    pub fn last_intact(&self) -> Option<u64> {
        self.joiner.last_intact()
    }

    /// Returns the expected linking numbers of all pairs, once all shards have told theirs.
    pub fn baseline(&self) -> Option<Certificate> {
        self.joiner.whole_baseline()
    }
}
