//! New findings of a frame: a finding that lasts over several frames is printed once.

use crate::verdict::PreviousFindings;
use linkwatch::{Point, Report, Verdict};

/// First frame whose verdict is not intact, with its first finding.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Violation {
    /// Sequence number of the frame.
    frame: u64,
    /// Simulation time of the frame, in seconds.
    time: f64,
    /// Text that names the frame: its number and time, or its model file.
    pub name: String,
    verdict: Verdict,
    /// Curves of the finding. A self-crossing has the same curve twice.
    curves: Vec<u32>,
    /// Place of the finding, in the units of the simulation.
    point: Option<Point>,
    /// Text about the finding.
    pub finding: Option<String>,
}

/// Findings of a frame that the previous frame did not have.
pub struct New {
    /// Sentences about the new findings.
    pub sentences: Vec<String>,
    /// Number of findings that the previous frame had as well.
    pub known: usize,
    /// True if the frame is to be printed: it has a new finding, or a verdict that differs from the
    /// previous one.
    pub notable: bool,
}

/// Findings printed so far.
#[derive(Default)]
pub struct News {
    /// Findings of the last frame.
    pub known: PreviousFindings,
    pub first_violation: Option<Violation>,
}

impl News {
    /// Returns the new findings of a report, and records all. `names` has the names of the curves,
    /// or is empty. `model` is the file of the frame, if it has one.
    pub fn of(&mut self, report: &Report, names: &[String], model: Option<&str>) -> New {
        let novelty = self.known.update(report);
        let sentences = report.findings_named(names).zip(&novelty.new);
        let sentences = sentences.filter_map(|(sentence, new)| new.then_some(sentence));
        let new = New {
            sentences: sentences.collect(),
            known: novelty.new.iter().filter(|new| !**new).count(),
            notable: !(report.appeared.is_empty() && report.gone.is_empty())
                || novelty.before.unwrap_or(Verdict::Intact) != report.verdict
                || novelty.new.contains(&true),
        };
        if report.verdict != Verdict::Intact && self.first_violation.is_none() {
            // The finding that the viewer and the report also show first.
            let first = report.passages_first().next();
            let curves = first.map(|finding| finding.pair());
            let curves = curves.map(|(i, j, _)| std::iter::once(i).chain(j).collect());
            let sentence = first.map(|finding| report.sentence_of(finding, names));
            let mut others = report.rejected.iter().chain(&report.missing);
            self.first_violation = Some(Violation {
                frame: report.seq,
                time: report.time,
                name: model.map_or_else(|| report.frame(), str::to_owned),
                verdict: report.verdict,
                curves: curves.unwrap_or_default(),
                point: first.and_then(|finding| Some(finding.spot()?.point)),
                finding: sentence.or_else(|| others.next().cloned()),
            });
        }
        new
    }
}
