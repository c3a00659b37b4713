//! Topology-safe stepping: a frame is kept only if the watcher proved that it is intact.
//!
//! If it did not, the simulator returns to the last intact frame and repeats the step with time
//! steps of half the length. Where the state itself leaves no way out, because a strand is already
//! pressed too far into another one, it returns to an earlier frame, and so on.

use crate::DEADLINE;
use linkwatch::{Client, Error, Outcome, Result, Verdict, VerdictMessage};
use std::fmt;

/// Intact states that are kept to return to.
const HISTORY: usize = 16;

/// Halvings of the time step before an earlier frame is tried.
const HALVINGS: usize = 4;

/// Intact frames after which the time step is doubled again.
const CALM: usize = 4;

/// A simulator that can return to an earlier state: to a clone of it.
pub trait Scene: Clone {
    /// Advances the scene by one frame, in this number of equal time steps.
    fn advance(&mut self, steps: usize);

    /// Writes x, y, z of all points, curve after curve.
    fn write_positions(&self, out: &mut [f32]);
}

/// The work of [`step_safely`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Steps from one frame to the next that were taken back: failed ones, and intact ones before
    /// an earlier frame.
    pub retried_frames: usize,
    /// Time steps of frames that were kept.
    pub kept: usize,
    /// Time steps of frames that were taken back.
    pub discarded: usize,
    /// Most time steps of a frame.
    pub most: usize,
}

impl fmt::Display for Work {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = self.kept + self.discarded;
        write!(
            f,
            "frames taken back: {}; time steps discarded: {} of {all} ({:.1} %); most time steps \
             per frame: {}",
            self.retried_frames,
            self.discarded,
            100.0 * self.discarded as f64 / all.max(1) as f64,
            self.most,
        )
    }
}

/// Publishes a frame and waits for the verdict on it.
///
/// Errors: no verdict in time, or no watcher.
pub fn publish(client: &mut Client, scene: &impl Scene, time: f64) -> Result<VerdictMessage> {
    let mut loan = client.loan(time)?;
    scene.write_positions(loan.positions_f32()?);
    let seq = loan.publish()?;
    let why = match client.wait(seq, DEADLINE)? {
        Outcome::Verdict(message) => return Ok(*message),
        Outcome::Stale => format!("no verdict within {DEADLINE:?}"),
        Outcome::NoWatcher(how) => how.to_string(),
    };
    Err(Error::Usage(format!("frame {seq} is not verified: {why}")))
}

/// Simulates `frames` frames of `dt` seconds, the first one included, in `steps` time steps each,
/// or in more if that is needed to keep them intact.
///
/// Errors: a state that was intact is not proven to be intact any more; no watcher; or no state in
/// reach from which smaller time steps help.
pub fn step_safely<S: Scene>(
    client: &mut Client,
    scene: S,
    (frames, dt, steps): (usize, f32, usize),
) -> Result<Work> {
    let fewest = steps;
    let (mut steps, mut halvings, mut calm) = (fewest, 0, 0);
    let mut work = Work::default();
    require_intact(publish(client, &scene, 0.0)?.verdict, 0)?;
    let mut frame = 0;
    // Intact states, and the time steps that led to them.
    let mut saved = vec![(scene, 0)];
    while frame + 1 < frames {
        let mut next = saved[saved.len() - 1].0.clone();
        next.advance(steps);
        work.most = work.most.max(steps);
        let verdict = publish(client, &next, (frame + 1) as f64 * f64::from(dt))?.verdict;
        if verdict == Verdict::Intact {
            (frame, calm, halvings) = (frame + 1, calm + 1, 0);
            work.kept += steps;
            saved.push((next, steps));
            saved.drain(..saved.len().saturating_sub(HISTORY));
            if calm >= CALM && steps > fewest {
                (steps, calm) = ((steps / 2).max(fewest), 0);
            }
            continue;
        }
        work.retried_frames += 1;
        work.discarded += steps;
        println!(
            "simulator: frame {} is {verdict} with {steps} time steps per frame",
            frame + 1
        );
        if halvings < HALVINGS {
            (steps, halvings) = (2 * steps, halvings + 1);
        } else {
            // The state before it leads nowhere.
            let taken = match saved.pop() {
                Some((_, taken)) if !saved.is_empty() => taken,
                _ => return Err(stuck(frame)),
            };
            (work.kept, work.discarded) = (work.kept - taken, work.discarded + taken);
            (frame, work.retried_frames) = (frame - 1, work.retried_frames + 1);
        }
        calm = 0;
        // The jump back is no motion of the curves. The state is verified as the first frame after
        // it, so that the next step is verified from there.
        client.resume();
        let state = &saved[saved.len() - 1].0;
        require_intact(
            publish(client, state, frame as f64 * f64::from(dt))?.verdict,
            frame,
        )?;
    }
    Ok(work)
}

fn require_intact(verdict: Verdict, frame: usize) -> Result<()> {
    match verdict {
        Verdict::Intact => Ok(()),
        _ => {
            let what =
                format!("frame {frame} is {verdict}, so that there is no state to return to");
            Err(Error::Usage(what))
        }
    }
}

fn stuck(frame: usize) -> Error {
    Error::Usage(format!(
        "stuck after frame {frame}: no state of the last {HISTORY} frames can go on; use more time \
         steps from the start"
    ))
}
