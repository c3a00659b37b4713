//! New findings of a frame: a finding that lasts over several frames is printed once.

use linkwatch::{Lasting, Point, PullThrough, Report, Verdict};
use std::collections::BTreeSet;

/// Curves and place of a finding.
type Located = (Vec<u32>, Option<Point>);

/// Returns the curves and places of all findings, in the order of [`Report::findings`].
fn located(report: &Report) -> impl Iterator<Item = Located> + '_ {
    let changes = report.changes.iter();
    let changes = changes.map(|c| (vec![c.i, c.j], c.place.map(|place| place.point)));
    let passage = |p: &PullThrough| (vec![p.i, p.j], Some(p.point));
    let events = report.events.iter().map(passage);
    let unresolved = report.unresolved.iter().map(passage);
    let defects = report.defects.iter().map(|d| {
        let curves = std::iter::once(d.i).chain(d.j);
        (curves.collect(), Some(d.place.point))
    });
    changes.chain(events).chain(defects).chain(unresolved)
}

/// First frame whose verdict is not intact, with its first finding.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Violation {
    /// Sequence number of the frame.
    frame: u64,
    /// Simulation time of the frame, in seconds.
    time: f64,
    /// The frame in words: its number and time, or its model file.
    pub name: String,
    verdict: Verdict,
    /// Curves of the finding; the same curve twice if it was pulled through itself.
    curves: Vec<u32>,
    /// Place of the finding, in the units of the simulation.
    point: Option<Point>,
    /// The finding in words.
    finding: Option<String>,
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.name)?;
        match &self.finding {
            Some(finding) => write!(f, ": {finding}"),
            None => Ok(()),
        }
    }
}

/// Findings of a frame that the previous frame did not have.
pub struct New {
    /// Sentences about the new findings.
    pub sentences: Vec<String>,
    /// Number of findings that the previous frame had as well.
    pub known: usize,
    /// True if the frame deserves a message: it has a new finding, or another verdict than the
    /// previous one.
    pub notable: bool,
}

/// Findings printed so far.
#[derive(Default)]
pub struct News {
    /// Changes and defects of the last frame.
    known: BTreeSet<Lasting>,
    last_verdict: Option<Verdict>,
    pub first_violation: Option<Violation>,
}

impl News {
    /// Forgets the findings of the last frame, because the next one has other curves.
    pub fn forget(&mut self) {
        self.known.clear();
    }

    /// Returns the news of a report, and records it. `names` are those of the curves, or empty.
    /// `model` is the file of the frame, if it has one.
    pub fn of(&mut self, report: &Report, names: &[String], model: Option<&str>) -> New {
        let mut new = New {
            sentences: Vec::new(),
            known: 0,
            notable: !(report.appeared.is_empty() && report.gone.is_empty())
                || self.last_verdict.unwrap_or(Verdict::Intact) != report.verdict,
        };
        let mut first: Option<Located> = None;
        let mut lasting = BTreeSet::new();
        let findings = located(report).zip(report.lasting());
        for ((finding, last), sentence) in findings.zip(report.findings_named(names)) {
            lasting.extend(last);
            if last.is_some_and(|l| self.known.contains(&l)) {
                new.known += 1;
                continue;
            }
            new.sentences.push(sentence);
            first.get_or_insert(finding);
        }
        new.notable |= !new.sentences.is_empty();
        if report.verdict != Verdict::Intact && self.first_violation.is_none() {
            let (curves, point) = first.unwrap_or_default();
            let others = report.rejected.iter().chain(&report.missing);
            self.first_violation = Some(Violation {
                frame: report.seq,
                time: report.time,
                name: model.map_or_else(|| report.frame(), str::to_owned),
                verdict: report.verdict,
                curves,
                point,
                finding: new.sentences.iter().chain(others).next().cloned(),
            });
        }
        self.last_verdict = Some(report.verdict);
        // The findings of a rejected frame are unknown. Others that ended are printed again if they
        // return.
        if report.verdict != Verdict::Rejected {
            self.known = lasting;
        }
        new
    }
}
