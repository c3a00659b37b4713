//! Verdicts in words: the sentences that the command, the log and the viewer print.

use super::{Defect, DefectKind, Place, Report, Verdict};
use crate::certificate::{Change, ChangeKind};
use crate::incremental::PullThrough;
use std::fmt;

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.word())
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.point;
        let [s, t] = self.segments;
        write!(
            f,
            "near ({x:.4}, {y:.4}, {z:.4}), segments {s} and {t}, {:.3e} apart",
            self.distance
        )
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = match self.kind() {
            ChangeKind::Lost => "came apart",
            ChangeKind::Gained => "became linked",
            ChangeKind::Changed => "changed their link",
        };
        write!(
            f,
            "curves {} and {} {what}: linking number {} expected, {} found",
            self.i, self.j, self.expected, self.found
        )?;
        match &self.place {
            Some(place) => write!(f, ", {place}"),
            None => Ok(()),
        }
    }
}

impl fmt::Display for Defect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.j {
            Some(j) if j == self.i => write!(
                f,
                "parts of curve {j} {}, {}",
                self.kind.words(),
                self.place
            ),
            Some(j) => write!(
                f,
                "curves {} and {j} {}, {}",
                self.i,
                self.kind.words(),
                self.place
            ),
            None => {
                let [x, y, z] = self.place.point;
                write!(
                    f,
                    "curve {} {}, at ({x:.4}, {y:.4}, {z:.4})",
                    self.i,
                    self.kind.words()
                )
            }
        }
    }
}

impl Report {
    /// Changes of one kind.
    pub fn count(&self, kind: ChangeKind) -> usize {
        self.changes.iter().filter(|c| c.kind() == kind).count()
    }

    /// Whether any curves touch.
    pub fn has_contact(&self) -> bool {
        self.defects.iter().any(|d| d.kind == DefectKind::Contact)
    }

    /// One line: frame, verdict, and how many of what.
    pub fn headline(&self) -> String {
        let mut parts = Vec::new();
        for kind in [ChangeKind::Lost, ChangeKind::Gained, ChangeKind::Changed] {
            match self.count(kind) {
                0 => {}
                1 => parts.push(format!("1 link {}", kind.word())),
                n => parts.push(format!("{n} links {}", kind.word())),
            }
        }
        match self.events.len() {
            0 => {}
            1 => parts.push("1 pull-through".into()),
            n => parts.push(format!("{n} pull-throughs")),
        }
        let untold = self.defects.iter().filter(|d| d.kind.is_of_step()).count();
        match self.defects.len() - untold {
            0 => {}
            1 => parts.push("1 pair or curve without a number".into()),
            n => parts.push(format!("{n} pairs or curves without a number")),
        }
        match untold {
            0 => {}
            1 => parts.push("1 step of a pair or curve undecided".into()),
            n => parts.push(format!("{n} steps of pairs or curves undecided")),
        }
        match self.unresolved.len() {
            0 => {}
            1 => parts.push("1 unresolved pull-through".into()),
            n => parts.push(format!("{n} unresolved pull-throughs")),
        }
        parts.extend(self.rejected.clone());
        let detail = if parts.is_empty() {
            String::new()
        } else {
            format!(" ({})", parts.join(", "))
        };
        format!("frame {}: {}{detail}", self.seq, self.verdict)
    }

    /// Returns a sentence for every finding of the frame: changes, events, defects, unresolved
    /// pull-throughs.
    pub fn findings(&self) -> impl Iterator<Item = String> + '_ {
        let changes = self.changes.iter().map(Change::to_string);
        let events = self.events.iter().map(PullThrough::to_string);
        let defects = self.defects.iter().map(|d| self.defect(d));
        changes
            .chain(events)
            .chain(defects)
            .chain(self.unresolved_findings())
    }

    /// Returns the sentence for a defect.
    pub fn defect(&self, defect: &Defect) -> String {
        if defect.kind != DefectKind::NoBaseline {
            return defect.to_string();
        }
        match defect.j {
            Some(j) => {
                let adopted = self.adopted.iter().find(|l| (l.i, l.j) == (defect.i, j));
                let lambda = adopted.map_or(0, |l| l.lambda);
                format!("{defect}; {lambda} is expected from here on")
            }
            None => format!("{defect}; the numbers of this frame are expected from here on"),
        }
    }

    /// Returns a sentence for each unresolved pull-through.
    pub fn unresolved_findings(&self) -> impl Iterator<Item = String> + '_ {
        let unresolved = self.unresolved.iter();
        unresolved.map(|p| {
            let lengths = p.lengths;
            format!("unresolved: {p}, which moved {lengths:.1} segment lengths in the step")
        })
    }
}
