//! Findings of a report, of all kinds alike.

use super::{Change, Defect, InvariantChange, PullThrough, Report};
use crate::curve::{Image, Point};

/// A place between two curves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spot {
    /// Both curves; the same one twice if it meets itself, or if there is only one.
    pub curves: [u32; 2],
    /// Translation of the second curve, in lattice vectors.
    pub image: Image,
    pub segments: [u32; 2],
    pub point: Point,
}

/// A finding of a report.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Finding<'a> {
    Change(&'a Change),
    Invariant(&'a InvariantChange),
    PullThrough(&'a PullThrough),
    Defect(&'a Defect),
    Unresolved(&'a PullThrough),
}

impl Report {
    /// Returns all findings, in the order of [`Report::findings`].
    pub(crate) fn all_findings(&self) -> impl Iterator<Item = Finding<'_>> {
        self.first_findings(usize::MAX)
    }

    /// Returns the findings in the order of [`Report::findings`], at most `most` of each kind.
    pub(crate) fn first_findings(&self, most: usize) -> impl Iterator<Item = Finding<'_>> {
        let changes = self.changes.iter().take(most).map(Finding::Change);
        let invariants = self.invariants.iter().take(most).map(Finding::Invariant);
        let events = self.events.iter().take(most).map(Finding::PullThrough);
        let defects = self.defects.iter().take(most).map(Finding::Defect);
        let unresolved = self.unresolved.iter().take(most).map(Finding::Unresolved);
        let changes = changes.chain(invariants);
        changes.chain(events).chain(defects).chain(unresolved)
    }

    /// Returns all findings, pull-throughs first: their places are more specific than those of the
    /// changes that they explain.
    pub(crate) fn passages_first(&self) -> impl Iterator<Item = Finding<'_>> {
        let is_passage =
            |f: &Finding| matches!(f, Finding::PullThrough(_) | Finding::Unresolved(_));
        let others = self.all_findings().filter(move |f| !is_passage(f));
        self.all_findings().filter(is_passage).chain(others)
    }
}

impl Finding<'_> {
    /// Returns the first curve, the second one if there is one, and its translation.
    pub fn pair(self) -> (u32, Option<u32>, Image) {
        match self {
            Finding::Change(c) => (c.i, Some(c.j), c.image),
            Finding::Invariant(c) => (c.curves[0], c.curves.get(1).copied(), Image::default()),
            Finding::PullThrough(e) | Finding::Unresolved(e) => (e.i, Some(e.j), e.image),
            Finding::Defect(d) => (d.i, d.j, d.image),
        }
    }

    /// Returns both curves; one curve twice if it is alone.
    pub fn curves(self) -> [u32; 2] {
        let (i, j, _) = self.pair();
        [i, j.unwrap_or(i)]
    }

    /// Returns the place, if it has one.
    pub fn spot(self) -> Option<Spot> {
        let (segments, point) = match self {
            Finding::Change(c) => c.place.map(|p| (p.segments, p.point))?,
            Finding::Invariant(_) => return None,
            Finding::Defect(d) => (d.place.segments, d.place.point),
            Finding::PullThrough(e) | Finding::Unresolved(e) => (e.segments, e.point),
        };
        Some(Spot {
            curves: self.curves(),
            image: self.pair().2,
            segments,
            point,
        })
    }

    /// Returns true if the topology changed, false if it is undecided.
    pub fn is_change(self) -> bool {
        !matches!(self, Finding::Defect(_) | Finding::Unresolved(_))
    }

    /// Returns its curves in words for a label.
    pub fn label_of_curves(self, names: &[String]) -> String {
        match self.pair() {
            (i, Some(j), image) => super::label_of_pair((i, j), image, names),
            (i, None, _) => super::label_of_curve(i, names),
        }
    }

    /// Returns a few words for a label beside the place.
    pub fn label(self, names: &[String]) -> String {
        let curves = self.label_of_curves(names);
        match self {
            Finding::Change(c) => {
                let (expected, found) = (c.expected, c.found);
                format!("{curves}: linking number was {expected}, is {found}")
            }
            Finding::Invariant(c) => format!("{curves}: was {}, is {}", c.expected, c.found),
            Finding::PullThrough(e) => format!("{}, {:+}", e.label(names), e.sign),
            Finding::Defect(d) => format!("{curves} {}", d.kind.words()),
            Finding::Unresolved(e) => format!("{}: unresolved", e.label(names)),
        }
    }
}
