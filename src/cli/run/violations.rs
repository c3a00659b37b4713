//! Violations of a run, and how they ended. A violation that the simulator rolled back before it
//! continued does not affect the result of the run, unless a part of its frames was not verified.

use crate::cli::Outcome;
use linkwatch::{Continuation, Report, Verdict};

/// Returns how a violation ended, if a frame with this continuation ends it.
pub fn words(step: Continuation) -> &'static str {
    match step {
        Continuation::Accepted => "accepted: the simulator goes on with the changed topology",
        _ => "recovered: the simulator rolled back, and this frame is intact",
    }
}

/// A violation: the frames from the first one with a change, or with another finding that asks the
/// simulator to stop, until an intact frame after a cut.
#[derive(Clone)]
struct Violation {
    worst: Outcome,
    /// Number of violations. More than one if the simulator rolled back to a frame that was not
    /// intact either.
    count: u32,
    /// True if the simulator cut the motion after the last frame with a finding.
    cut: bool,
    /// True if a part of a frame was not verified. For example, a curve returned: nobody knows what
    /// became of it, and later frames are compared with its numbers, even after a rollback.
    lacks_parts: bool,
}

/// Outcome of a run so far.
#[derive(Clone, Default)]
pub struct Violations {
    current: Option<Violation>,
    /// Worst outcome of the frames that belong to no violation, and undecided if a part of a frame
    /// of a violation that ended was not verified.
    others: Outcome,
    /// Number of violations that were rolled back, and number that the simulator accepted.
    pub recovered: u32,
    pub accepted: u32,
}

impl Violations {
    /// Adds a frame. Returns true if it ends the current violation.
    pub fn add(&mut self, report: &Report, step: Continuation) -> bool {
        let intact = report.verdict == Verdict::Intact && report.last_intact == Some(report.seq);
        let ended = self.current.take_if(|violation| {
            let is_cut = violation.cut || step == Continuation::Cut;
            step == Continuation::Accepted || is_cut && intact && !report.abort
        });
        // A low clearance alone is no violation.
        if let Some(violation) = ended.as_ref().filter(|v| v.worst > Outcome::Fine) {
            match step {
                Continuation::Accepted => self.accepted += violation.count,
                _ => self.recovered += violation.count,
            }
            let outcome = Outcome::undecided_if(violation.lacks_parts);
            self.others = self.others.max(outcome);
        }
        let outcome = Outcome::of(report.verdict);
        let found = report.abort || outcome == Outcome::Changed;
        match &mut self.current {
            Some(violation) if found => {
                violation.worst = violation.worst.max(outcome);
                violation.count += u32::from(violation.cut || step != Continuation::Continues);
                violation.cut = false;
            }
            Some(violation) => {
                violation.cut |= step != Continuation::Continues;
                // A frame after a cut belongs to the new motion, which was not rolled back, so it
                // counts.
                match violation.cut || violation.worst == Outcome::Fine {
                    true => self.others = self.others.max(outcome),
                    false => violation.worst = violation.worst.max(outcome),
                }
            }
            None if found => {
                self.current = Some(Violation {
                    worst: outcome,
                    count: 1,
                    cut: false,
                    lacks_parts: false,
                });
            }
            None => self.others = self.others.max(outcome),
        }
        if let Some(violation) = &mut self.current {
            violation.lacks_parts |= !report.missing.is_empty();
        }
        ended.is_some()
    }

    /// Begins another run. A violation of the previous run can then no longer end.
    pub fn begin_run(&mut self) {
        self.others = self.outcome();
        self.current = None;
    }

    /// Returns the worst outcome. Ignores violations that were rolled back or accepted, because
    /// they do not fail the run.
    pub fn outcome(&self) -> Outcome {
        let current = self.current.as_ref();
        self.others.max(current.map_or(Outcome::Fine, |v| v.worst))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the violations of a run whose frames have these verdicts and continuations.
    fn run(frames: &[(Verdict, Continuation)]) -> Violations {
        let mut violations = Violations::default();
        let mut broken = false;
        for (seq, &(verdict, step)) in (0..).zip(frames) {
            let mut report = Report::new(seq, 0.0, verdict);
            report.abort = matches!(verdict, Verdict::Changed | Verdict::Rejected);
            broken = broken && step == Continuation::Continues || verdict == Verdict::Changed;
            let intact = verdict == Verdict::Intact && !broken;
            report.last_intact = intact.then_some(seq);
            violations.add(&report, step);
        }
        violations
    }

    #[test]
    fn a_violation_is_recovered_by_an_intact_frame_after_a_cut() {
        use Continuation::{Accepted, Continues, Cut};
        use Verdict::{Changed, Contact, Intact, Rejected, Undecided};
        let intact = (Intact, Continues);
        let changed = (Changed, Continues);
        let cases: [(&[_], _, [u32; 2]); 11] = [
            (&[intact, changed, (Intact, Cut)], Outcome::Fine, [1, 0]),
            (&[changed, changed, (Intact, Cut)], Outcome::Fine, [1, 0]),
            // Not rolled back, so it counts.
            (&[intact, changed, intact], Outcome::Changed, [0, 0]),
            // Rolled back to a changed state, and then to an intact one.
            (&[changed, (Changed, Cut)], Outcome::Changed, [0, 0]),
            (
                &[changed, (Changed, Cut), (Intact, Cut)],
                Outcome::Fine,
                [2, 0],
            ),
            // Before the cut, an undecided frame belongs to the violation; after it, it does not.
            (
                &[changed, (Undecided, Continues), (Intact, Cut)],
                Outcome::Fine,
                [1, 0],
            ),
            (
                &[changed, (Undecided, Cut), intact],
                Outcome::Undecided,
                [1, 0],
            ),
            (
                &[(Rejected, Continues), (Intact, Cut)],
                Outcome::Fine,
                [1, 0],
            ),
            // An undecided frame does not ask the simulator to stop, so it was not rolled back for
            // that.
            (
                &[(Undecided, Continues), (Intact, Cut)],
                Outcome::Undecided,
                [0, 0],
            ),
            (&[changed, (Intact, Accepted)], Outcome::Fine, [0, 1]),
            (
                &[changed, (Contact, Accepted), (Undecided, Continues)],
                Outcome::Undecided,
                [0, 1],
            ),
        ];
        for (frames, outcome, counts) in cases {
            let violations = run(frames);
            assert_eq!(violations.outcome(), outcome, "{frames:?}");
            let found = [violations.recovered, violations.accepted];
            assert_eq!(found, counts, "{frames:?}");
        }
    }

    /// Regression test: a link was lost while its curve was gone, and the run had recovered.
    #[test]
    fn a_frame_that_was_not_fully_verified_counts_after_a_rollback() {
        let cases = [(true, Outcome::Undecided), (false, Outcome::Fine)];
        for (returns, outcome) in cases {
            let mut violations = Violations::default();
            let mut report = Report::new(0, 0.0, Verdict::Changed);
            report.abort = true;
            violations.add(&report, Continuation::Continues);
            let mut report = Report::new(1, 0.0, Verdict::Undecided);
            report
                .missing
                .extend(returns.then(|| "what became of curve b".into()));
            violations.add(&report, Continuation::Continues);
            let mut report = Report::new(2, 0.0, Verdict::Intact);
            report.last_intact = Some(2);
            assert!(violations.add(&report, Continuation::Cut));
            assert_eq!(violations.outcome(), outcome);
            assert_eq!(violations.recovered, 1);
        }
    }
}
