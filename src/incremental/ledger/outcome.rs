//! Result of a step of the ledger, and its work counters.

use super::cancellation::far_and_cancelling;
use super::contact::{Contacts, Touching};
use crate::certificate::Comparison;
use crate::pairs::Pair;
use crate::verdict::{Defect, Link, PullThrough};
use std::collections::BTreeMap;

/// Result of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Outcome {
    /// All passages in chronological order. Passages at the same time are sorted by pair and
    /// segments.
    pub events: Vec<PullThrough>,
    /// Passages that cancel within their pair and moved further than the limit, in the same order.
    pub unresolved: Vec<PullThrough>,
    /// Undecided pairs, sorted by pair. Either the curves are too close in one of the frames, so
    /// that polylines cannot represent the splines; or the pair has too many candidates; or a curve
    /// touches itself in a way that cannot be distinguished from a passage. For a curve and itself,
    /// the second curve equals the first one.
    pub undecided: Vec<Defect>,
    /// Nonzero sums of the signs of two closed curves, sorted by pair. Contacts in a frame are not
    /// included.
    pub sums: Vec<Link>,
    /// Pairs of curves that touch in the last frame, at least one of them open, and curves that
    /// touch themselves. The certificate reports two closed curves that touch.
    pub touching: Vec<Touching>,
    /// Pairs of splines, at least one of them open, whose segments are not proven apart at all
    /// times.
    pub near: Vec<Pair>,
    /// The contacts in the last frame, which the next step continues.
    pub contacts: Contacts,
    /// Work counters.
    pub counts: Counts,
}

impl Outcome {
    /// Adds all passages of a pair. Those that cancel and moved further than the limit are
    /// unresolved.
    pub(super) fn add_passages(&mut self, of_pair: &[PullThrough], limit: f64) {
        let far = far_and_cancelling(of_pair, limit);
        for (k, passage) in of_pair.iter().enumerate() {
            match far.contains(&k) {
                true => self.unresolved.push(*passage),
                false => self.events.push(*passage),
            }
        }
    }

    /// Returns the outcome with other indices: curve `i` becomes `curves[i]`, and `curves` is
    /// ascending. Discards the contacts in the last frame and the pairs of near splines.
    pub fn with_curves(mut self, curves: &[u32]) -> Outcome {
        let index = |i: &mut u32| *i = curves[*i as usize];
        for e in self.events.iter_mut().chain(&mut self.unresolved) {
            index(&mut e.i);
            index(&mut e.j);
        }
        let touching = self.touching.iter_mut().map(|t| &mut t.defect);
        for d in self.undecided.iter_mut().chain(touching) {
            index(&mut d.i);
            d.j.iter_mut().for_each(index);
        }
        for l in &mut self.sums {
            index(&mut l.i);
            index(&mut l.j);
        }
        self.contacts = Contacts::default();
        self.near.clear();
        self
    }

    /// Keeps the findings about some pairs; with `i == j`, about a curve and itself.
    pub fn retain(&mut self, keep: impl Fn(Pair) -> bool) {
        for events in [&mut self.events, &mut self.unresolved] {
            events.retain(|e| keep((e.i, e.j)));
        }
        let of = |d: &Defect| (d.i, d.j.unwrap_or(d.i));
        self.undecided.retain(|d| keep(of(d)));
        self.sums.retain(|l| keep((l.i, l.j)));
        self.touching.retain(|t| keep(of(&t.defect)));
        self.near.retain(|&pair| keep(pair));
        self.contacts.retain(keep);
    }

    /// Returns the pairs whose linking numbers the step may have changed, or that may have none in
    /// the last frame: those with a sum, undecided, or in contact. Not sorted; includes pairs of a
    /// curve and itself and of open curves. All other pairs that had a linking number have the same
    /// one.
    pub fn unsettled_pairs(&self) -> impl Iterator<Item = Pair> {
        let sums = self.sums.iter().map(|link| (link.i, link.j));
        let undecided = self.undecided.iter().filter_map(|d| Some((d.i, d.j?)));
        sums.chain(undecided).chain(self.contacts.pairs())
    }

    /// Returns the pairs with a passage, and those that are undecided. Not sorted.
    pub(super) fn passed_or_undecided(&self) -> impl Iterator<Item = Pair> {
        let passages = self.events.iter().chain(&self.unresolved);
        let undecided = self.undecided.iter().map(|d| (d.i, d.j.unwrap_or(d.i)));
        passages.map(|e| (e.i, e.j)).chain(undecided)
    }

    /// Returns all pairs that may have met in the step: those with a passage, undecided, in
    /// contact, or with an open spline that is near. Not sorted.
    pub fn met_pairs(&self) -> impl Iterator<Item = Pair> {
        let others = self.near.iter().copied().chain(self.contacts.pairs());
        self.passed_or_undecided().chain(others)
    }

    /// Returns the pairs of closed curves for which the change of the linking number differs from
    /// the sum of their passages. Any such pair shows an error of linkwatch. Pairs without a
    /// linking number in a frame, and undecided pairs, are skipped.
    ///
    /// Both frames are given by their comparisons with one baseline.
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

/// Work counters of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    /// Number of pairs of curves with overlapping swept boxes, and of curves tested with
    /// themselves.
    pub pairs: u64,
    /// Number of pairs of segments with overlapping swept boxes.
    pub candidates: u64,
    /// Number of tested pairs of pieces.
    pub tests: u64,
    /// Number of tests that exact arithmetic decided.
    pub exact: u64,
}

impl Counts {
    pub fn add(&mut self, o: &Counts) {
        self.pairs += o.pairs;
        self.candidates += o.candidates;
        self.tests += o.tests;
        self.exact += o.exact;
    }
}
