//! Difference of two reports on the same frame, from two runs.

use crate::verdict::{Finding, words_of_pair};
use linkwatch::{Image, Link, Report, Verdict};
use serde::Serialize;
use std::collections::BTreeMap;

/// Difference of two reports on the same frame.
///
/// Findings are the same if they concern the same curves with the same numbers: places and moments
/// are not compared, because they differ whenever the curves do.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReportDifference {
    /// Verdicts of both reports.
    pub verdicts: [Verdict; 2],
    /// Texts of the findings that only the first report has, and of those that only the second one
    /// has.
    pub only: [Vec<String>; 2],
}

/// Identity of a finding: its kind, its curves, its numbers (of a linking number or a pull-through,
/// or the code of a defect), and the text of an invariant.
type Key = (u8, u32, Option<u32>, Image, [i64; 2], String);

/// Returns the difference of two reports on the same frame; `None` if the verdicts and findings are
/// equal. `names` are those of the curves of both, or empty.
///
/// Not compared: times, places, work counters, clearance, the abort flag (it depends on the
/// policy), and the state to roll back to.
pub fn difference(reports: [&Report; 2], names: &[String]) -> Option<ReportDifference> {
    let [mut first, mut second] = reports.map(|report| by_identity(report, names));
    for (key, found) in &mut first {
        if let Some(others) = second.get_mut(key) {
            let common = found.len().min(others.len());
            found.drain(..common);
            others.drain(..common);
        }
    }
    let verdicts = reports.map(|report| report.verdict);
    let only = [first, second].map(|all| all.into_values().flatten().collect::<Vec<_>>());
    let equal = verdicts[0] == verdicts[1] && only.iter().all(Vec::is_empty);
    (!equal).then_some(ReportDifference { verdicts, only })
}

/// Returns all findings as text, by their identity.
fn by_identity(report: &Report, names: &[String]) -> BTreeMap<Key, Vec<String>> {
    let mut all = BTreeMap::<Key, Vec<String>>::new();
    for (finding, sentence) in report.all_findings().zip(report.findings_named(names)) {
        let mut words = String::new();
        let (kind, numbers) = match finding {
            Finding::Change(c) => (0, [c.expected, c.found]),
            Finding::PullThrough(e) => (1, [e.sign.into(), 0]),
            Finding::Defect(d) => (2, [i64::from(d.kind as u32), 0]),
            Finding::Unresolved(e) => (3, [e.sign.into(), 0]),
            Finding::Invariant(_) => {
                words.clone_from(&sentence);
                (4, [0, 0])
            }
        };
        let (i, j, image) = finding.pair();
        let key = (kind, i, j, image, numbers, words);
        all.entry(key).or_default().push(sentence);
    }
    for &Link { i, j, lambda } in &report.adopted {
        let pair = words_of_pair((i, j), Image::default(), names);
        let key = (5, i, Some(j), Image::default(), [lambda, 0], String::new());
        let sentence = format!("{pair} have the linking number {lambda} from here on");
        all.entry(key).or_default().push(sentence);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use linkwatch::{Change, InvariantChange, PullThrough};

    fn report(changes: &[(u32, u32, i64)], signs: &[i32]) -> Report {
        let mut report = Report::new(5, 0.5, Verdict::Changed);
        report.changes = changes
            .iter()
            .map(|&(i, j, found)| Change {
                i,
                j,
                image: Default::default(),
                expected: 1,
                found,
                place: None,
            })
            .collect();
        report.events = signs
            .iter()
            .map(|&sign| PullThrough {
                i: 3,
                j: 4,
                image: Default::default(),
                segments: [0, 1],
                fraction: 0.5,
                sign,
                point: [0.0; 3],
                lengths: 0.1,
            })
            .collect();
        report
    }

    #[test]
    fn equal_findings_in_another_order_and_at_other_places_are_no_difference() {
        let first = report(&[(0, 1, 0), (2, 3, 2)], &[1, -1]);
        let mut second = report(&[(2, 3, 2), (0, 1, 0)], &[-1, 1]);
        second.events[0].fraction = 0.25;
        second.events[0].segments = [7, 7];
        second.stats.tests = 99;
        assert_eq!(difference([&first, &second], &[]), None);
    }

    #[test]
    fn names_the_findings_that_only_one_report_has() {
        let first = report(&[(0, 1, 0), (2, 3, 2)], &[1, 1]);
        let second = report(&[(0, 1, 2), (2, 3, 2)], &[1]);
        let found = difference([&first, &second], &[]).unwrap();
        let [only_first, only_second] = &found.only;
        assert_eq!(
            only_second[..],
            ["curves 0 and 1 changed their link: linking number was 1, is 2"]
        );
        assert_eq!(
            only_first[0],
            "curves 0 and 1 came apart: linking number was 1, is 0"
        );
        assert!(only_first[1].starts_with("curves 3 and 4 passed through one another"));
        assert_eq!(only_first.len(), 2);
    }

    /// Regression test: reports with such invariants compared as equal.
    #[test]
    fn invariants_of_other_curves_or_with_other_numbers_are_a_difference() {
        let of = |curves: &[u32], found: &str| {
            let mut report = Report::new(5, 0.5, Verdict::Changed);
            report.invariants = vec![InvariantChange {
                curves: curves.to_vec(),
                expected: "mu 0".into(),
                found: found.into(),
            }];
            report
        };
        let first = of(&[0, 1, 2], "mu 1");
        assert_eq!(difference([&first, &first], &[]), None);
        for other in [of(&[0, 1, 3], "mu 1"), of(&[0, 1, 2], "mu -1")] {
            let found = difference([&first, &other], &[]).unwrap();
            assert_eq!(found.only.map(|only| only.len()), [1, 1]);
        }
    }

    #[test]
    fn another_verdict_is_a_difference_without_findings() {
        let first = Report::new(1, 0.0, Verdict::Intact);
        let second = Report::new(1, 0.0, Verdict::Rejected);
        let found = difference([&first, &second], &[]).unwrap();
        assert_eq!(found.verdicts, [Verdict::Intact, Verdict::Rejected]);
        assert_eq!(found.only, [vec![], vec![]] as [Vec<String>; 2]);
    }
}
