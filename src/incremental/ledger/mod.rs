//! The ledger of crossings: which curves passed through one another from one frame to the next, where, when, and
//! with what sign.
//!
//! Between two frames of the same curves every control point moves on a straight line at constant speed. A linking
//! number says that something was pulled through; the ledger says where and at what time of the step, and sees what no
//! linking number can: two passages that cancel, a curve that passes through itself, and open curves.
//!
//! **Candidates.** A point of a segment, spline or edge, is a combination of its control points with weights that are
//! not negative, add up to 1, and do not change; so it moves on a straight line too. The box around the segment's boxes
//! in both frames is convex and contains it at both ends of the step, and hence at all times between. Trees of such
//! *swept* boxes, a sweep over their roots, and a descent in space give the pairs of segments that may meet at all.
//! Pairs of splines go on only if no plane separates their control points in both frames, on the same side
//! ([`MovingSeparation`]).
//!
//! **Pieces.** Passages are those of polylines ([`crate::exact`]). Edges are their own. A spline's are straight
//! between points at fixed parameters, so their vertices move on straight lines too: four pieces a segment, for the
//! sake of the place, and wherever the discretization of the pair splits it in either frame. With the splits of a
//! frame the polylines are link homotopic to the splines in that frame ([`crate::discretize`]), and more
//! splits do no harm, since the hull of a part is within the hull of the whole. Each segment has the same pieces with
//! all segments of the other curve. So for two closed curves that have linking numbers in both frames
//!
//! ```text
//! sum of the signs of all passages = linking number after - linking number before
//! ```
//!
//! which [`Outcome::check`] tells. Which passages there are in between, and when, is that of the polylines.
//!
//! **A curve with itself.** Pieces that share an end in both frames are joined there: their four ends lie in one plane
//! at all times, and they pass through nothing but by folding up. They are left out. So are neighbouring spline segments
//! along which the curve runs one way at all times, in the direction of some axis: it cannot come back to where it was.
//! Everything else counts, however near along the curve, since any shorter stretch that meets itself does pass through
//! itself. There is no number to be preserved, and no translation that would break ties: those are reported.
//!
//! **Ties between pairs of pieces.** Where a curve touches the joint of two pieces of another and goes back, one piece
//! may count +1 and the other -1. Two opposite signs of one pair of curves at the same time and the same place of both
//! curves, as far as times are proven, cancel: nothing passed through. Two real passages that cancel are at
//! different times or at different places.

mod contact;
mod net;
mod pair;
#[cfg(test)]
pub(super) mod planted;
#[cfg(test)]
mod tests;
mod unresolved;

pub(crate) use self::contact::Contacts;
use self::contact::{Contact, Touching};
use self::pair::{Part, Step, Workspace};
use super::Cover;
use crate::cancel::Cancel;
use crate::certificate::{Comparison, Link};
use crate::curve::{BoxGroup, Curve, CurveSet};
use crate::pairs::{Leaves, LinkSearch, Pair, Trees, curves_of};
use crate::verdict::{Defect, PullThrough};
use rayon::prelude::*;
use std::collections::BTreeMap;

#[cfg(doc)]
use crate::discretize::MovingSeparation;

/// Default limit of the motion in a step, in segment lengths, up to which pull-throughs that cancel
/// are events.
///
/// Measured on melts of bead-spring chains that cannot cross, with frames every 100 to 5,000 steps
/// (`examples/bead_spring.py`): the smallest motion of a spurious pull-through was 1.65 lengths. If
/// strands keep a distance of about a segment length, a strand must move that far to get from one
/// side of another strand to the opposite side.
pub(crate) const MOTION_LIMIT: f64 = 1.5;

/// What happened in a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Outcome {
    /// All passages, in the order in which they came; those at one time by pair and segments.
    pub events: Vec<PullThrough>,
    /// Passages that cancel within their pair and moved further than the limit, in the same order.
    pub unresolved: Vec<PullThrough>,
    /// Pairs of which nothing is said: too close in one of the frames for their polylines to stand for them, or with
    /// too many candidates. And places at which a curve touches itself in a way that cannot be told from a passage.
    /// The second curve equals the first for a curve and itself. Sorted by pair.
    pub undecided: Vec<Defect>,
    /// Nonzero sums of the signs of two closed curves, sorted by pair. Contacts in a frame are not
    /// included.
    pub sums: Vec<Link>,
    /// Pairs of curves that touch in the last frame, at least one of them open, and curves that
    /// touch themselves. The certificate reports two closed curves that touch.
    pub touching: Vec<Touching>,
    /// The contacts in the last frame, which the next step continues.
    pub contacts: Contacts,
    /// What it took.
    pub counts: Counts,
}

/// What a step took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    /// Pairs of curves with overlapping swept boxes, and curves looked at for themselves.
    pub pairs: u64,
    /// Pairs of segments with overlapping swept boxes.
    pub candidates: u64,
    /// Those of them that no axis separates.
    pub near: u64,
    /// Pairs of pieces tested.
    pub tests: u64,
    /// Those of them that were decided by exact arithmetic.
    pub exact: u64,
}

impl Counts {
    fn add(&mut self, o: &Counts) {
        self.pairs += o.pairs;
        self.candidates += o.candidates;
        self.near += o.near;
        self.tests += o.tests;
        self.exact += o.exact;
    }
}

impl Outcome {
    /// Pairs of closed curves whose linking number changed by another number than the sum of their passages: none,
    /// unless something is wrong. Pairs without a linking number in a frame, and undecided ones, are left out.
    ///
    /// Both frames are given by how they compare with one baseline.
    pub fn check(&self, before: &Comparison, after: &Comparison) -> Vec<Pair> {
        let mut rest: BTreeMap<Pair, i64> = BTreeMap::new();
        for link in &self.sums {
            *rest.entry((link.i, link.j)).or_default() += link.lambda;
        }
        for (comparison, sign) in [(before, 1), (after, -1)] {
            for c in &comparison.changes {
                *rest.entry((c.i, c.j)).or_default() += sign * (c.found - c.expected);
            }
        }
        rest.retain(|_, rest| *rest != 0);
        let lists = [&before.defects, &after.defects, &self.undecided];
        for defect in lists.into_iter().flatten() {
            match defect.j {
                Some(j) => drop(rest.remove(&(defect.i, j))),
                None => rest.retain(|&(i, j), _| i != defect.i && j != defect.i),
            }
        }
        rest.into_keys().collect()
    }
}

/// Finds passages, step after step. Its buffers serve every step.
///
/// The outcome does not depend on the number of threads of the rayon pool that it is called in.
#[derive(Debug)]
pub(crate) struct Ledger {
    /// See [`Verifier::set_motion_limit`](crate::Verifier::set_motion_limit).
    pub motion_limit: f64,
    trees: Trees,
    search: LinkSearch,
    pairs: Vec<Pair>,
    parts: Vec<Part>,
    cancel: Cancel,
}

impl Default for Ledger {
    fn default() -> Self {
        Ledger {
            motion_limit: MOTION_LIMIT,
            trees: Trees::default(),
            search: LinkSearch::default(),
            pairs: Vec::new(),
            parts: Vec::new(),
            cancel: Cancel::default(),
        }
    }
}

impl Ledger {
    /// Creates a ledger whose steps end early once they are cancelled. Their result is meaningless
    /// then.
    pub fn new(cancel: Cancel) -> Self {
        Ledger {
            cancel,
            ..Ledger::default()
        }
    }

    /// All passages between two frames.
    ///
    /// `contacts` are those of the first frame, as the previous step found them. If `pairs`
    /// (sorted) is given, only these pairs of curves and those in contact are searched (`(i, i)`: a
    /// curve and itself); the caller knows that no other pair has a passage.
    ///
    /// # Panics
    /// If the frames are not of the same curves.
    pub fn step(
        &mut self,
        [before, after]: [&CurveSet; 2],
        contacts: &Contacts,
        cover: Cover,
        pairs: Option<&[Pair]>,
    ) -> Outcome {
        let pairs = pairs.map(|pairs| {
            let mut all = [pairs, &contacts.pairs()].concat();
            all.sort_unstable();
            all.dedup();
            all
        });
        if pairs.as_ref().is_some_and(Vec::is_empty) {
            return Outcome::default();
        }
        let (mut outcome, found) = self.search([before, after], cover, pairs.as_deref());
        let settled = contacts.settle(&found, [before, after]);
        outcome.events.extend(settled.events);
        sort(&mut outcome.events);
        sort(&mut outcome.unresolved);
        outcome.undecided.extend(settled.undecided);
        outcome.undecided.sort_by_key(|d| (d.i, d.j));
        outcome.touching = settled.touching;
        outcome.contacts = settled.contacts;
        outcome
    }

    /// Returns the contacts of a first frame, and the pairs of curves that touch. Passages there
    /// are unknown.
    pub fn first_frame(&mut self, set: &CurveSet, cover: Cover) -> (Contacts, Vec<Touching>) {
        let (_, found) = self.search([set, set], cover, None);
        Contacts::of_first_frame(&found, set)
    }

    /// [`Ledger::step`] from a first frame.
    #[cfg(test)]
    pub fn first_step(
        &mut self,
        before: &CurveSet,
        after: &CurveSet,
        cover: Cover,
        pairs: Option<&[Pair]>,
    ) -> Outcome {
        let (contacts, _) = self.first_frame(before, cover);
        self.step([before, after], &contacts, cover, pairs)
    }

    /// Finds passages within a step, and contacts at its ends, sorted by pair.
    fn search(
        &mut self,
        [before, after]: [&CurveSet; 2],
        cover: Cover,
        pairs: Option<&[Pair]>,
    ) -> (Outcome, Vec<Contact>) {
        assert!(before.same_layout(after), "two frames of the same curves");
        let frames = [before, after];
        let swept = Swept {
            frames,
            open: cover.open,
        };
        self.pairs.clear();
        match pairs {
            Some(pairs) => {
                self.trees
                    .refit_some(swept, &curves_of(pairs.iter().copied()));
                self.pairs.extend_from_slice(pairs);
            }
            None => {
                self.trees.refit(swept);
                self.find_pairs(swept, cover.own);
            }
        }
        let step = Step {
            frames,
            trees: &self.trees,
            motion_limit: self.motion_limit,
            cancel: &self.cancel,
        };
        let pairs = &self.pairs[..];
        // Parts small enough to share out, large enough to be worth it. A large pair shares itself out.
        let size = (pairs.len() / (32 * rayon::current_num_threads())).clamp(1, 256);
        let count = pairs.len().div_ceil(size);
        self.parts.resize_with(count, Part::default);
        self.parts
            .par_iter_mut()
            .zip(pairs.par_chunks(size))
            .for_each_init(Workspace::default, |workspace, (part, pairs)| {
                part.clear();
                for &pair in pairs {
                    step.pair(pair, workspace, part);
                }
            });
        let mut outcome = Outcome::default();
        let mut contacts = Vec::new();
        for part in &self.parts {
            contacts.extend_from_slice(&part.contacts);
            outcome.events.extend_from_slice(&part.events);
            outcome.unresolved.extend_from_slice(&part.unresolved);
            outcome.undecided.extend_from_slice(&part.undecided);
            outcome.sums.extend_from_slice(&part.sums);
            outcome.counts.add(&part.counts);
        }
        contacts.sort_by_key(|c: &Contact| (c.event.i, c.event.j));
        (outcome, contacts)
    }

    /// Pairs of curves that may meet, and of a curve and itself where asked for, sorted.
    fn find_pairs(&mut self, swept: Swept<'_>, own: bool) {
        self.pairs
            .extend_from_slice(self.search.find(self.trees.roots()));
        if own {
            let alone = (0..swept.curves().len()).filter(|&i| swept.has_tree(i));
            self.pairs.extend(alone.map(|i| (i as u32, i as u32)));
            self.pairs.par_sort_unstable();
        }
    }
}

/// Puts passages in the order in which they came; those at one time by pair and segments.
fn sort(events: &mut [PullThrough]) {
    let key = |e: &PullThrough| (e.i, e.j, e.segments, e.sign);
    events.sort_by(|a, b| {
        let by_time = a.fraction.total_cmp(&b.fraction);
        by_time.then_with(|| key(a).cmp(&key(b)))
    });
}

/// The boxes that contain every segment at all times between two frames.
#[derive(Clone, Copy)]
struct Swept<'a> {
    frames: [&'a CurveSet; 2],
    /// Whether open curves have trees.
    open: bool,
}

impl Leaves for Swept<'_> {
    fn curves(&self) -> &[Curve] {
        self.frames[0].curves()
    }

    fn has_tree(&self, i: usize) -> bool {
        self.open || self.curves()[i].closed
    }

    /// All of them, of either frame is none.
    fn stored(&self, _: u32) -> bool {
        true
    }

    #[inline(always)]
    fn boxes(&self, i: usize, g: usize) -> BoxGroup {
        let [before, after] = self.frames;
        before.leaf_boxes(i, g).union(&after.leaf_boxes(i, g))
    }
}
