//! Passages of one pair of curves, or of a curve and itself.

use super::cancellation::cancel;
use super::candidates::Gathered;
use super::contact::Contact;
use super::outcome::Outcome;
use super::passages::Findings;
use super::pieces::Cuts;
use super::task::{Step, Task};
use super::unresolved::far_and_cancelling;
use crate::pairs::{Pair, closest_of_segments};
use crate::verdict::{Defect, DefectKind, Link};

/// Findings of one task, or of all: the contacts at both ends of the step are not followed yet.
#[derive(Debug, Default)]
pub(super) struct Part {
    pub outcome: Outcome,
    pub contacts: Vec<Contact>,
}

impl Part {
    /// Takes the findings of another part, which keeps its buffers.
    pub fn append(&mut self, part: &mut Part) {
        let (all, own) = (&mut self.outcome, &mut part.outcome);
        all.events.append(&mut own.events);
        all.unresolved.append(&mut own.unresolved);
        all.undecided.append(&mut own.undecided);
        all.sums.append(&mut own.sums);
        all.near.append(&mut own.near);
        all.counts.add(&std::mem::take(&mut own.counts));
        self.contacts.append(&mut part.contacts);
    }
}

/// Two segments of a pair that is too near to decide.
pub(super) struct TooNear {
    pub segments: [u32; 2],
    /// False if the passages of the pair are unknown. Otherwise splines were searched in pieces so
    /// long that passages that cancel may be missed.
    pub searched: bool,
}

impl TooNear {
    pub fn at(segments: [u32; 2]) -> Self {
        TooNear {
            segments,
            searched: false,
        }
    }
}

/// Buffers of one task.
pub(super) type Workspace = (Gathered, Cuts);

impl Step<'_> {
    /// Adds the passages of a pair of curves.
    pub fn pair(&self, pair: Pair, (gathered, cuts): &mut Workspace, part: &mut Part) {
        let task = Task::new(*self, pair);
        task.gather(gathered);
        let Gathered { near, found, .. } = gathered;
        let open = |i: usize| !self.frames[0].curve(i).closed;
        if !near.is_empty() && task.curves.into_iter().any(open) {
            part.outcome.near.push(pair);
        }
        let done = if task.exceeds_limits() {
            Err(TooNear::at([0, 0]))
        } else {
            task.add_near(cuts, near, found)
        };
        task.conclude(done, found, part);
    }

    /// [`Step::pair`] with all pairs of segments as candidates, and the splits and limits of the
    /// regular search.
    #[cfg(test)]
    pub fn pair_by_brute_force(&self, pair: Pair, part: &mut Part) {
        let task = Task::new(*self, pair);
        let (mut gathered, mut cuts) = Workspace::default();
        task.gather(&mut gathered);
        let Gathered { near, found, .. } = &mut gathered;
        let done = task.add_near(&mut cuts, near, found);
        found.clear();
        let [n, m] = task.curves.map(|i| self.frames[0].curve(i).segments);
        let all = (0..n).flat_map(|s| (0..m).map(move |t| (s, t)));
        let all: Vec<_> = all.filter(|&(s, t)| !task.is_self() || s <= t).collect();
        if task.splines() {
            task.add_all_pieces(&cuts, &all, found);
        } else {
            let different = all.iter().filter(|&&(s, t)| !task.adjacent(s, t));
            different.for_each(|&(s, t)| task.add_edges(s, t, found));
        }
        task.conclude(done, found, part);
    }
}

impl Task<'_> {
    /// Adds the findings to `part`, or a defect if two segments are too close.
    fn conclude(&self, done: Result<(), TooNear>, found: &mut Findings, part: &mut Part) {
        let frames = self.step.frames;
        let [i, j] = self.curves.map(|i| i as u32);
        let Part { outcome, contacts } = part;
        outcome.counts.add(&found.counts);
        let undecided = |kind, segments| {
            let place = closest_of_segments(frames[1], self.curves, segments);
            Defect::of_pair((i, j), kind, place)
        };
        if let Err(TooNear { segments, searched }) = done {
            let defect = undecided(DefectKind::TooClose, segments);
            outcome.undecided.push(defect);
            if !searched {
                return;
            }
        }
        found.ties.sort_unstable();
        found.ties.dedup();
        let ties = found.ties.iter();
        let ties = ties.map(|&segments| undecided(DefectKind::Contact, segments));
        outcome.undecided.extend(ties);
        contacts.append(&mut found.contacts);
        let curves = self.curves.map(|i| frames[0].curve(i));
        cancel(&mut found.passages, curves);
        let far = far_and_cancelling(&found.passages, self.step.motion_limit);
        for (k, passage) in found.passages.iter().enumerate() {
            match far.contains(&k) {
                true => outcome.unresolved.push(passage.event),
                false => outcome.events.push(passage.event),
            }
        }
        let signs = found.passages.iter().map(|f| i64::from(f.event.sign));
        let lambda = signs.sum();
        if !self.is_self() && lambda != 0 && curves.iter().all(|c| c.closed) {
            outcome.sums.push(Link { i, j, lambda });
        }
    }
}
