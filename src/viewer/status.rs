//! Status of a run as text, and the findings that last over several frames.

use super::passed::Passed;
use crate::verdict::{Finding, Lasting, Report, Verdict, label_of_curve};
use crate::words::plural;
use std::collections::BTreeMap;

/// Findings that last, each with the frame since which it has persisted.
pub(super) type Findings = BTreeMap<Lasting, u64>;

/// Returns the status as markdown: the verdict, its first frame, the pairs, and the pull-throughs
/// in this frame and so far. `names` are those of the curves, or empty.
pub(super) fn status(
    report: &Report,
    names: &[String],
    since: u64,
    seen: &Findings,
    passed: &Passed,
    shown: usize,
) -> String {
    // If the linking numbers are as expected, the status concerns this frame only.
    let lasts = !(report.changes.is_empty() && report.invariants.is_empty());
    let only_events = !report.events.is_empty() && !lasts;
    let title = match report.verdict {
        Verdict::Intact => "Intact",
        Verdict::Changed if only_events => "PULLED THROUGH",
        Verdict::Changed => "TOPOLOGY CHANGED",
        Verdict::Contact => "Contact",
        Verdict::Undecided => "Undecided",
        Verdict::Stale => "Not verified in time",
        Verdict::Rejected => "Frame rejected",
    };
    let when = match report.verdict {
        Verdict::Changed if only_events => format!("in frame {}", report.seq),
        _ => format!("since frame {since}"),
    };
    let s = &report.stats;
    let detail = report.rejected.clone().unwrap_or_else(|| {
        match s.potential_links {
            // Not counted if the frame was compared with a reference frame.
            0 => format!("{} curves", s.curves),
            pairs => format!("{} curves, {pairs} pairs that could be linked", s.curves),
        }
    });
    let mut text = format!("# {title}\n## {when}\n\n{detail}\n");
    for why in &report.missing {
        text.push_str(&format!("\nNot verified: {why}\n"));
    }
    if only_events && report.defects.is_empty() {
        text.push_str("\nEvery linking number is the expected one.\n");
    }
    let rows = report.all_findings().zip(report.lasting());
    let rows = rows.filter_map(|(finding, key)| Some((row(finding, names)?, key?)));
    let frame = |key| seen.get(&key).copied().unwrap_or(since);
    let mut rows: Vec<_> = rows.map(|(row, key)| (frame(key), row)).collect();
    rows.sort_by_key(|(frame, _)| *frame);
    if !rows.is_empty() {
        text.push_str("\n| curves | finding | since |\n|---|---|---|\n");
    }
    let lasting = rows.len();
    for (frame, (curves, words)) in rows.into_iter().take(shown) {
        text.push_str(&format!("| **{curves}** | {words} | {frame} |\n"));
    }
    let more = |count: usize| {
        let more = count.saturating_sub(shown);
        (more > 0).then(|| format!("\nand {more} more\n"))
    };
    text.extend(more(lasting));
    if !report.events.is_empty() {
        text.push_str("\n| pulled in this frame | sign | moment |\n|---|---|---|\n");
    }
    for e in report.events.iter().take(shown) {
        let (label, sign, moment) = (e.label(names), e.sign, e.fraction);
        text.push_str(&format!("| **{label}** | {sign:+} | {moment:.3} |\n"));
    }
    text.extend(more(report.events.len()));
    if let n @ 1.. = report.unresolved.len() {
        let unresolved = plural(n, "unresolved pull-through");
        text.push_str(&format!("\n{unresolved}: the frames are too far apart.\n"));
    }
    text.extend(passed.words().map(|words| format!("\n{words}\n")));
    text
}

/// Returns the curves of a finding that lasts, and the finding as text.
fn row(finding: Finding<'_>, names: &[String]) -> Option<(String, String)> {
    let words = match finding {
        Finding::Change(c) => format!("was {}, is {}", c.expected, c.found),
        Finding::Invariant(c) => format!("was {}, is {}", c.expected, c.found),
        Finding::Defect(d) => d.kind.words().to_owned(),
        Finding::PullThrough(_) | Finding::Unresolved(_) => return None,
    };
    let curves = match finding {
        Finding::Invariant(c) => {
            let curves = c.curves.iter().map(|&i| label_of_curve(i, names));
            curves.collect::<Vec<_>>().join(", ")
        }
        other => other.label_of_curves(names),
    };
    Some((curves, words))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verdict::{Change, Defect, DefectKind, InvariantChange, Place, PullThrough};

    fn report(changes: u32) -> Report {
        let change = |k| Change {
            i: k,
            j: k + 100,
            image: Default::default(),
            expected: 1,
            found: 0,
            place: None,
        };
        Report {
            abort: true,
            changes: (0..changes).map(change).collect(),
            ..Report::new(9, 0.0, Verdict::Changed)
        }
    }

    #[test]
    fn the_status_names_the_broken_pairs_and_the_first_frame() {
        let report = report(5);
        let seen = report.lasting().flatten().zip(3..).collect();
        let text = status(&report, &[], 2, &seen, &Passed::default(), 4);
        assert!(
            text.starts_with("# TOPOLOGY CHANGED\n## since frame 2\n"),
            "{text}"
        );
        assert!(text.contains("| **1 & 101** | was 1, is 0 | 4 |"), "{text}");
        assert!(text.ends_with("\nand 1 more\n"), "{text}");
    }

    #[test]
    fn findings_with_different_images_have_rows_and_keys_of_their_own() {
        let mut report = report(2);
        for (change, n) in report.changes.iter_mut().zip([-1, 2]) {
            (change.i, change.j, change.image) = (4, 7, [n, 0, 0]);
        }
        report.events = vec![PullThrough {
            image: [-1, 0, 0],
            ..event(4, 7)
        }];
        let known: Vec<Lasting> = report.lasting().flatten().collect();
        assert_ne!(known[0], known[1]);
        let seen = report.lasting().flatten().zip(3..).collect();
        let text = status(&report, &[], 2, &seen, &Passed::default(), 4);
        for row in [
            "| **curve 4 and the image -1,0,0 of curve 7** | was 1, is 0 | 3 |",
            "| **curve 4 and the image 2,0,0 of curve 7** | was 1, is 0 | 4 |",
            "| **4 through the image -1,0,0 of 7** | -1 | 0.250 |",
        ] {
            assert!(text.contains(row), "{row}: {text}");
        }
    }

    #[test]
    fn the_table_has_the_names_of_curves() {
        let mut report = report(1);
        (report.changes[0].i, report.changes[0].j) = (0, 1);
        report.events = vec![event(0, 1)];
        let names = ["left".to_owned(), "sleeve/a/long/name/of/a/yarn".to_owned()];
        let text = status(&report, &names, 2, &Findings::new(), &Passed::default(), 4);
        for row in [
            "| **left & \u{2026}/long/name/of/a/yarn** |",
            "| **left through \u{2026}/long/name/of/a/yarn** |",
        ] {
            assert!(text.contains(row), "{row}: {text}");
        }
    }

    /// Regression test: the row of a knot was missing, and each defect had the frame of the knot.
    #[test]
    fn knots_have_rows_and_frames_of_their_own() {
        let mut report = report(1);
        report.invariants = vec![InvariantChange {
            curves: vec![7],
            expected: "v2 0".into(),
            found: "v2 1".into(),
        }];
        let place = Place {
            segments: [0, 0],
            point: [0.0; 3],
            distance: 0.0,
        };
        report.defects = vec![Defect {
            i: 4,
            j: None,
            image: Default::default(),
            kind: DefectKind::ALL[0],
            place,
        }];
        let seen = report.lasting().flatten().zip(3..).collect();
        let text = status(&report, &[], 2, &seen, &Passed::default(), 9);
        assert!(text.contains("| **7** | was v2 0, is v2 1 | 4 |"), "{text}");
        let words = DefectKind::ALL[0].words();
        assert!(text.contains(&format!("| **4** | {words} | 5 |")), "{text}");
    }

    #[test]
    fn the_table_is_sorted_by_the_frame_of_the_break() {
        let report = report(3);
        let seen = report.lasting().flatten().zip([30, 10, 20]).collect();
        let text = status(&report, &[], 2, &seen, &Passed::default(), 2);
        let rows: Vec<&str> = text.lines().filter(|l| l.starts_with("| **")).collect();
        assert_eq!(
            rows,
            [
                "| **1 & 101** | was 1, is 0 | 10 |",
                "| **2 & 102** | was 1, is 0 | 20 |"
            ]
        );
        let header = "| curves | finding | since |";
        assert!(text.contains(header), "{text}");
    }

    fn event(i: u32, j: u32) -> PullThrough {
        PullThrough {
            i,
            j,
            image: Default::default(),
            segments: [3, 4],
            fraction: 0.25,
            sign: -1,
            point: [0.0; 3],
            lengths: 0.5,
        }
    }

    #[test]
    fn every_finding_has_its_key() {
        let mut report = report(2);
        report.events = vec![event(0, 1), event(7, 7)];
        report.unresolved = vec![event(0, 2)];
        let place = Place {
            segments: [0, 0],
            point: [0.0; 3],
            distance: 0.0,
        };
        report.defects.push(Defect {
            i: 5,
            j: None,
            image: Default::default(),
            kind: DefectKind::Degenerate,
            place,
        });
        assert_eq!(report.lasting().count(), report.findings().count());
        for (key, sentence) in report.lasting().zip(report.findings()) {
            assert_eq!(key.is_none(), sentence.contains("through"), "{sentence}");
            if let Some(Lasting { i, .. }) = key {
                assert!(sentence.contains(&format!(" {i} ")), "{sentence}");
            }
        }
    }

    #[test]
    fn the_status_of_an_event_alone_reports_the_expected_numbers() {
        let mut report = report(0);
        report.events = vec![event(18, 19), event(7, 7)];
        let mut passed = Passed::default();
        passed.add(&report, None);
        let text = status(&report, &[], 2, &Findings::new(), &passed, 4);
        assert!(
            text.starts_with("# PULLED THROUGH\n## in frame 9\n"),
            "{text}"
        );
        assert!(
            text.contains("\nEvery linking number is the expected one.\n"),
            "{text}"
        );
        assert!(
            text.contains("| **18 through 19** | -1 | 0.250 |"),
            "{text}"
        );
        assert!(text.contains("| **7 through itself** |"), "{text}");
        let so_far = "\n2 pull-throughs so far, the last in frame 9\n";
        assert!(text.ends_with(so_far), "{text}");
        // In later frames the status is intact.
        (report.verdict, report.events) = (Verdict::Intact, Vec::new());
        let text = status(&report, &[], 10, &Findings::new(), &passed, 4);
        assert!(text.starts_with("# Intact\n"), "{text}");
        assert!(text.ends_with(so_far), "{text}");
    }
}
