//! Ledger of pull-throughs: the passages of curves through each other from one frame to the next,
//! with time, place and sign.
//!
//! Between two frames of the same curves every control point moves on a straight line at constant
//! speed. A linking number shows that a curve was pulled through another one. The ledger shows
//! where and at what time of the step, and also finds what no linking number shows: two passages
//! that cancel, self-crossings of a curve, and passages of open curves.
//!
//! # Candidates
//!
//! A point of a segment, spline or edge, is a combination of its control points with constant,
//! nonnegative weights that add up to 1, so it moves on a straight line too. The box around the
//! boxes of the segment in both frames is convex and contains the point at both ends of the step,
//! hence at all times in between. Trees of such *swept* boxes ([`swept`]), a sweep over their
//! roots, and a descent in space give the pairs of segments that may meet. Pairs of spline segments
//! remain candidates only if no plane separates their control points in both frames, on the same
//! side ([`MovingSeparation`]).
//!
//! # Pieces
//!
//! Passages are those of polylines ([`crate::exact`]). The edge of a polyline is a single piece. A
//! spline segment is replaced by straight pieces between points at fixed parameters, so the
//! vertices move on straight lines too: four pieces per segment, for an accurate place, further
//! pieces at every split of the discretization of the pair in either frame, and short ones where
//! two pieces may meet between the frames ([`MovingSeparation::refine`]): there the polylines
//! deviate from the splines by a millionth of what a chord of a segment does. They are
//! longer where segments run along one another, or have more pieces that may meet than can be
//! tested. With the splits of a frame, the polylines are link homotopic to the splines in it
//! ([`crate::discretize`]). Additional splits do no harm, because the hull of a part is within the
//! hull of the whole. A segment has the same pieces with all segments of the other curve. So for
//! two closed curves that have linking numbers in both frames
//!
//! ```text
//! sum of the signs of all passages = linking number after - linking number before
//! ```
//!
//! which [`Outcome::check`] verifies. The individual passages in between, and their times, are
//! those of the polylines.
//!
//! # A curve and itself
//!
//! Pieces that share an end in both frames are joined there. Their four ends lie in one plane at
//! all times, so they pass through each other only by folding, and they are skipped. Adjacent
//! spline segments along which the curve is monotonic at all times, in the direction of some axis,
//! are skipped as well, because the curve cannot return to an earlier point. All other pairs count,
//! however near along the curve, because every shorter loop that meets itself does pass through
//! itself. There is no linking number to preserve, and no translation that could break ties, so
//! ties are reported.
//!
//! A yarn that runs through a periodic cell and one of its later periods ([`Parts`]) are parts of
//! one curve as well. They are two curves of the set, but segments are joined where one continues
//! the other, and ties are reported. A contact at the joint of two periods belongs to several pairs
//! of parts, so it is a tie, too.
//!
//! # Ties between pairs of pieces
//!
//! If a curve touches the joint of two pieces of another curve and turns back, one piece may count
//! +1 and the other one -1. Two opposite signs of one pair of curves at the same time and at the
//! same place of both curves, within the proven accuracy of times, cancel: nothing passed through.
//! Two real passages that cancel are at different times or places.

mod cancellation;
mod candidates;
mod contact;
mod outcome;
mod pair;
mod passages;
mod pieces;
mod safe_fraction;
mod swept;
#[cfg(test)]
pub(super) mod tests;

pub(crate) use self::contact::{Contacts, Touching};
pub(crate) use self::outcome::Outcome;
use self::pair::{Part, Step, Workspace};
pub(super) use self::swept::Observer;
use self::swept::SweptTrees;
use super::covered::{Coverage, Covered};
use crate::cancel::{Cancel, PairLimit};
use crate::curve::CurveSet;
use crate::pairs::{LinkSearch, Pair, PairFilter, curves_of, distinct};
use crate::pool;
use crate::verdict::{Defect, PullThrough};
use rayon::prelude::*;

#[cfg(doc)]
use crate::{curve::Parts, discretize::MovingSeparation};

/// Default limit of the motion in a step, in segment lengths, up to which pull-throughs that cancel
/// are events.
///
/// Measured on melts of bead-spring chains that cannot cross, with frames every 100 to 5,000 steps
/// (`examples/bead_spring.py`): the smallest motion of a spurious pull-through was 1.65 lengths. If
/// strands keep a distance of about a segment length, a strand must move that far to get from one
/// side of another strand to the opposite side.
pub(crate) const MOTION_LIMIT: f64 = 1.5;

/// Number of pairs by which prefetching is ahead.
const AHEAD: usize = 4;

/// Finds passages, step by step. Its buffers are reused from step to step.
///
/// The outcome does not depend on the number of threads of the rayon pool that it is called in.
#[derive(Debug)]
pub(crate) struct Ledger {
    /// Motion in segment lengths up to which pull-throughs that cancel count as real.
    pub motion_limit: f64,
    /// Pairs of segments that are searched in all steps.
    pub coverage: Coverage,
    trees: SweptTrees,
    search: LinkSearch,
    pairs: Vec<Pair>,
    parts: Vec<Part>,
    cancel: Cancel,
}

impl Default for Ledger {
    fn default() -> Self {
        Ledger::new(MOTION_LIMIT, Coverage::default())
    }
}

impl Ledger {
    /// Returns a ledger with a motion limit in segment lengths, and the coverage of all steps.
    pub fn new(motion_limit: f64, coverage: Coverage) -> Self {
        Ledger {
            motion_limit,
            coverage,
            trees: SweptTrees::default(),
            search: LinkSearch::default(),
            pairs: Vec::new(),
            parts: Vec::new(),
            cancel: Cancel::default(),
        }
    }

    /// Sets the cancellation and the pair limit, which end a search early. Its results are
    /// meaningless then.
    pub fn end_with(&mut self, cancel: Cancel, limit: PairLimit) {
        self.search.limit = limit;
        self.cancel = cancel;
    }

    /// Searches only the pairs of a filter from now on, or all pairs.
    pub fn set_filter(&mut self, filter: Option<PairFilter>) {
        self.trees.forget();
        self.search.filter = filter;
    }

    /// Returns all passages between two frames.
    ///
    /// `contacts` are those of the first frame, as found by the previous step. If `pairs` (sorted)
    /// is given, only these pairs of curves and those in contact are searched (`(i, i)`: a curve
    /// and itself), except pairs that the filter excludes. The caller must know that no other pair
    /// has a passage.
    ///
    /// # Panics
    ///
    /// If the frames are not of the same curves.
    pub fn step(
        &mut self,
        frames: [&CurveSet; 2],
        contacts: &Contacts,
        pairs: Option<&[Pair]>,
    ) -> Outcome {
        let pairs = pairs.map(|pairs| {
            let mut all = distinct([pairs, &contacts.pairs()].concat());
            if let Some(filter) = &self.search.filter {
                filter.retain(&mut all);
            }
            all
        });
        if pairs.as_ref().is_some_and(Vec::is_empty) {
            return Outcome::default();
        }
        let segments = frames[0].segments();
        let mut found = pool::run(segments, || self.search(frames, pairs.as_deref()));
        let outcome = &mut found.outcome;
        let within = outcome.events.len();
        contacts.follow(&found.contacts, frames, outcome);
        if outcome.events.len() > within {
            // The passages of contacts that ended may cancel others of their pair, so all passages
            // are classified again.
            let mut all = std::mem::take(&mut outcome.events);
            all.append(&mut outcome.unresolved);
            all.sort_by_key(|e| (e.i, e.j));
            for of_pair in all.chunk_by(|a, b| (a.i, a.j) == (b.i, b.j)) {
                outcome.add_passages(of_pair, self.motion_limit);
            }
        }
        sort_by_time(&mut outcome.events);
        sort_by_time(&mut outcome.unresolved);
        Defect::sort(&mut outcome.undecided);
        found.outcome
    }

    /// Returns the contacts of a first frame, and the pairs of curves that touch. Their earlier
    /// passages are unknown.
    pub fn first_frame(&mut self, frame: &CurveSet) -> (Contacts, Vec<Touching>) {
        let found = self.search([frame, frame], None).contacts;
        Contacts::of_first_frame(&found, frame)
    }

    /// Runs [`Ledger::step`] with `before` as the first frame.
    #[cfg(test)]
    pub fn first_step(
        &mut self,
        before: &CurveSet,
        after: &CurveSet,
        coverage: Coverage,
        pairs: Option<&[Pair]>,
    ) -> Outcome {
        // Discards the stored boxes, because they may have been built for another coverage.
        self.trees = SweptTrees::default();
        self.coverage = coverage;
        let (contacts, _) = self.first_frame(before);
        self.step([before, after], &contacts, pairs)
    }

    /// Finds passages within a step, and contacts at its ends, sorted by pair.
    fn search(&mut self, frames: [&CurveSet; 2], pairs: Option<&[Pair]>) -> Part {
        let [before, after] = frames;
        assert!(
            before.same_layout(after),
            "both frames must have the same curves"
        );
        let curves = pairs.map(|pairs| curves_of(pairs.iter().copied()));
        let open = self.coverage.open_curves;
        self.trees.refit(frames, open, curves.as_deref());
        self.pairs.clear();
        match pairs {
            Some(pairs) => self.pairs.extend_from_slice(pairs),
            None => self.find_pairs(before),
        }
        let step = Step {
            frames,
            trees: &self.trees,
            motion_limit: self.motion_limit,
            cancel: &self.cancel,
        };
        let pairs = &self.pairs[..];
        let size = pool::pairs_per_task(pairs.len(), before.segments());
        let count = pairs.len().div_ceil(size);
        // Taken out of `self`, so that a panic discards the incomplete findings of this step.
        let mut parts = std::mem::take(&mut self.parts);
        parts.resize_with(count, Part::default);
        parts
            .par_iter_mut()
            .zip(pairs.par_chunks(size))
            .for_each_init(Workspace::default, |workspace, (part, pairs)| {
                for (k, &pair) in pairs.iter().enumerate() {
                    if let Some(&next) = pairs.get(k + AHEAD) {
                        step.trees.prefetch(next);
                    }
                    step.pair(pair, workspace, part);
                }
            });
        let mut found = Part::default();
        parts.iter_mut().for_each(|part| found.append(part));
        self.parts = parts;
        found.contacts.sort_by_key(|c| (c.event.i, c.event.j));
        found
    }

    /// Finds the pairs of curves that may meet, and the pairs of a curve and itself if they are
    /// covered, sorted.
    fn find_pairs(&mut self, set: &CurveSet) {
        let pairs = self.search.find(self.trees.roots());
        self.pairs.extend_from_slice(pairs);
        if self.coverage.self_crossings {
            let covered = Covered::new(set, self.coverage, self.search.filter.as_ref());
            self.pairs.extend(covered.self_pairs());
            self.pairs.par_sort_unstable();
        }
    }
}

/// Sorts passages by time. Passages at the same time are sorted by pair and segments.
pub(crate) fn sort_by_time(events: &mut [PullThrough]) {
    let key = |e: &PullThrough| (e.i, e.j, e.segments, e.sign);
    events.sort_by(|a, b| {
        let by_time = a.fraction.total_cmp(&b.fraction);
        by_time.then_with(|| key(a).cmp(&key(b)))
    });
}
