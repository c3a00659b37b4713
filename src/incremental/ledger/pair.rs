//! Search for the passages of one pair of curves, or of a curve and itself.

use super::cancellation::cancel;
use super::candidates::Gathered;
use super::contact::Contact;
use super::outcome::Outcome;
use super::passages::Findings;
use super::pieces::Cuts;
use super::swept::{Observer, SweptTree, SweptTrees};
use crate::cancel::Cancel;
use crate::curve::{CurveSet, Parts};
use crate::discretize::MovingSeparation;
use crate::pairs::{Pair, closest_of_segments};
use crate::verdict::{Defect, DefectKind, Link, PullThrough};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};

/// Maximum number of candidates of one pair of curves. Beyond it the pair counts as too close,
/// because a list of millions of passages would be useless. The limit takes about half a second.
const MAX_CANDIDATES: u64 = 1 << 24;

/// Maximum number of tested pairs of pieces of splines that need more pieces than usual, for one
/// pair of curves. Beyond it the pair is searched again in longer pieces, and counts as too close
/// if that is not enough. About half a second each time.
const MAX_PIECES: u64 = 1 << 23;

/// Maximum number of exact tests of one pair of curves: a constant, and a number per segment.
/// Beyond it the pair counts as too close, splines after a search in longer pieces. An exact test
/// of strands whose distance is near the rounding error takes about 100 us.
const MAX_EXACT: [u64; 2] = [1 << 12, 4];

/// A step from one frame to the next.
#[derive(Clone, Copy)]
pub(super) struct Step<'a> {
    pub frames: [&'a CurveSet; 2],
    pub trees: &'a SweptTrees,
    /// Motion limit in segment lengths.
    pub motion_limit: f64,
    pub cancel: &'a Cancel,
}

/// One pair of curves, or a curve and itself.
pub(super) struct Task<'a> {
    pub step: Step<'a>,
    pub curves: [usize; 2],
    /// Relation of the curves, if they are parts of one.
    pub parts: Option<Parts>,
    pub separation: MovingSeparation<'a>,
    /// Bound of the rounding of the coordinates of polylines ([`CurveSet::rounding`]).
    pub rounding: f64,
    /// Observer that moves with both curves ([`super::swept`]).
    observer: Observer,
    /// Work counters of all tasks of the pair.
    pub candidates: AtomicU64,
    pub pieces: AtomicU64,
    pub exact: AtomicU64,
}

impl<'a> Task<'a> {
    pub fn new(step: Step<'a>, (i, j): Pair) -> Self {
        let curves = [i as usize, j as usize];
        Task {
            step,
            curves,
            parts: step.frames[0].parts(curves[0], curves[1]),
            separation: MovingSeparation::new(step.frames, curves),
            // The discretization of splines covers it.
            rounding: match step.frames[0].basis().is_polyline() {
                true => step.frames[0].rounding().max(step.frames[1].rounding()),
                false => 0.0,
            },
            observer: step.trees.observer((i, j)),
            candidates: AtomicU64::new(0),
            pieces: AtomicU64::new(0),
            exact: AtomicU64::new(0),
        }
    }

    /// Returns true if this is a curve and itself.
    pub fn is_self(&self) -> bool {
        self.curves[0] == self.curves[1]
    }

    pub fn splines(&self) -> bool {
        !self.step.frames[0].basis().is_polyline()
    }

    /// Returns true if two segments are equal or consecutive in one curve.
    pub fn adjacent(&self, s: u32, t: u32) -> bool {
        self.parts.is_some_and(|parts| parts.adjacent(s, t))
    }

    /// Returns the tree of swept boxes of one of the curves.
    pub fn tree(&self, side: usize) -> SweptTree<'a> {
        let Step { frames, trees, .. } = self.step;
        trees.of(frames, self.curves[side], self.observer)
    }

    /// Returns true if the pair needs more work than the limit for one pair, or if the step was
    /// cancelled. Part of the work is then skipped, and which part depends on the order of the
    /// tasks. Whether the limit is exceeded does not.
    pub fn exceeds_limits(&self) -> bool {
        let segments = self.curves.map(|i| self.step.frames[0].curve(i).segments);
        let segments: u64 = segments.into_iter().map(u64::from).sum();
        let over = |count: &AtomicU64, most: u64| count.load(Ordering::Relaxed) > most;
        self.step.cancel.is_set()
            || over(&self.candidates, MAX_CANDIDATES)
            || over(&self.pieces, MAX_PIECES)
            || over(&self.exact, MAX_EXACT[0] + MAX_EXACT[1] * segments)
    }

    /// Counts exact tests. Breaks if the pair exceeds its limits.
    pub fn count_exact(&self, more: u64) -> ControlFlow<()> {
        if more > 0 {
            self.exact.fetch_add(more, Ordering::Relaxed);
            if self.exceeds_limits() {
                return ControlFlow::Break(());
            }
        }
        ControlFlow::Continue(())
    }
}

/// Findings of one task, or of all tasks. Contacts at both ends of the step are listed, but not yet
/// followed ([`Contacts::follow`](super::Contacts::follow)).
#[derive(Debug, Default)]
pub(super) struct Part {
    pub outcome: Outcome,
    pub contacts: Vec<Contact>,
}

impl Part {
    /// Moves the findings of another part to this one. The other part keeps its buffers.
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
    /// False if the passages of the pair are unknown. True if splines were searched in pieces so
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
        let done = match task.exceeds_limits() {
            true => Err(TooNear::at([0, 0])),
            false => task.add_near(cuts, near, found),
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
        let passages: Vec<PullThrough> = found.passages.iter().map(|f| f.event).collect();
        outcome.add_passages(&passages, self.step.motion_limit);
        let signs = found.passages.iter().map(|f| i64::from(f.event.sign));
        let lambda = signs.sum();
        if !self.is_self() && lambda != 0 && curves.iter().all(|c| c.closed) {
            outcome.sums.push(Link { i, j, lambda });
        }
    }
}
