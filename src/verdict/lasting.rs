//! Findings that last over several frames.

use super::finding::Finding;
use super::{DefectKind, Report, Verdict};
use crate::curve::Image;
use std::collections::BTreeSet;

/// Identity of a finding that may last over several frames: a changed linking number or invariant,
/// or a defect.
///
/// Pairs of a curve and different images of another curve are different pairs.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Lasting {
    /// First curve.
    pub i: u32,
    /// Second curve; `None` if the finding concerns a single curve.
    pub j: Option<u32>,
    /// Translation of the second curve, in lattice vectors.
    pub image: Image,
    /// Linking number that was found; `None` for a defect, and for invariants of curves.
    pub found: Option<i64>,
    /// Kind of the defect; `None` for a change.
    pub kind: Option<DefectKind>,
    /// All curves of an invariant, and its numbers as text.
    pub invariant: Option<(Vec<u32>, String)>,
}

impl Report {
    /// Returns the identity of each finding, in the order of [`Report::findings`]. Pull-throughs
    /// have none: they do not last, each one is new.
    pub fn lasting(&self) -> impl Iterator<Item = Option<Lasting>> + '_ {
        self.all_findings().map(|finding| {
            let (i, j, image) = finding.pair();
            let mut lasting = Lasting {
                i,
                j,
                image,
                ..Lasting::default()
            };
            match finding {
                Finding::Change(c) => lasting.found = Some(c.found),
                Finding::Defect(d) => lasting.kind = Some(d.kind),
                Finding::Invariant(c) => {
                    lasting.invariant = Some((c.curves.clone(), c.found.clone()));
                }
                Finding::PullThrough(_) | Finding::Unresolved(_) => return None,
            }
            Some(lasting)
        })
    }
}

/// Verdict and findings of the previous frame, to tell what is new in the next one.
#[derive(Debug, Default)]
pub(crate) struct PreviousFindings {
    verdict: Option<Verdict>,
    findings: BTreeSet<Lasting>,
    /// Number of the layout of the last frame with curves.
    layout: u32,
}

/// Verdict of the previous frame, and the findings of a frame that the previous one did not have.
pub(crate) struct Novelty {
    /// Verdict of the previous frame.
    pub before: Option<Verdict>,
    /// True for each finding, in the order of [`Report::findings`], that the previous frame did not
    /// have. Pull-throughs are always new.
    pub new: Vec<bool>,
}

impl PreviousFindings {
    /// Forgets the findings: the next frame is compared with another baseline.
    pub fn forget(&mut self) {
        self.findings.clear();
    }

    /// Begins a frame with curves, which has this number of the layout. Forgets the findings if the
    /// simulator described its curves again, because they have other indices then.
    pub fn begin_frame(&mut self, layout: u32) {
        if std::mem::replace(&mut self.layout, layout) != layout {
            self.forget();
        }
    }

    /// Returns what is new in a frame, and records it. Rejected frames have no curves: the findings
    /// of the frame before may still be there.
    pub fn update(&mut self, report: &Report) -> Novelty {
        let lasting: Vec<Option<Lasting>> = report.lasting().collect();
        let is_known = |l: &Lasting| self.findings.contains(l);
        let is_new = |l: &Option<Lasting>| !l.as_ref().is_some_and(is_known);
        let new = lasting.iter().map(is_new).collect();
        if report.verdict != Verdict::Rejected {
            self.findings = lasting.into_iter().flatten().collect();
        }
        let before = self.verdict.replace(report.verdict);
        Novelty { before, new }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verdict::{Change, Defect, InvariantChange, Place, Verdict};

    /// Regression test: a change to yet another knot was not a new finding.
    #[test]
    fn other_invariants_are_findings_of_their_own() {
        let of = |curves: &[u32], found: &str| {
            let mut report = Report::new(0, 0.0, Verdict::Changed);
            report.invariants = vec![InvariantChange {
                curves: curves.to_vec(),
                expected: "mu 0".into(),
                found: found.into(),
            }];
            report.lasting().next().flatten()
        };
        let first = of(&[0, 1, 2], "mu 1");
        assert_eq!(first, of(&[0, 1, 2], "mu 1"));
        assert!(first != of(&[0, 1, 2], "mu 2") && first != of(&[0, 1, 3], "mu 1"));
    }

    #[test]
    fn images_of_one_pair_are_findings_of_their_own() {
        let mut report = Report::new(0, 0.0, Verdict::Changed);
        let place = Place {
            segments: [0, 0],
            point: [0.0; 3],
            distance: 0.0,
        };
        for image in [[0, 0, 0], [1, 0, 0]] {
            report.changes.push(Change {
                i: 0,
                j: 1,
                image,
                expected: 1,
                found: 0,
                place: None,
            });
            report.defects.push(Defect {
                i: 0,
                j: Some(1),
                image,
                kind: DefectKind::Contact,
                place,
            });
        }
        let all: std::collections::BTreeSet<Lasting> = report.lasting().flatten().collect();
        assert_eq!(all.len(), 4);
    }
}
