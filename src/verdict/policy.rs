//! Policy that decides when the simulator is asked to stop.

use super::{ChangeKind, Defect, DefectKind, Report, Verdict};

vocabulary! {
    /// Findings that send the abort signal.
    #[non_exhaustive]
    #[derive(Default)]
    pub enum AbortOn {
        /// Any change of a linking number, any contact, any pull-through, or a rejected frame.
        #[default]
        Any = "any",
        /// A link was lost, or its linking number changed.
        Lost = "lost",
        /// A link was gained, or its linking number changed.
        Gained = "gained",
        /// Curves touch.
        Contact = "contact",
        /// A curve was pulled through another one, or through itself ([`Events`](crate::Events)).
        Event = "event",
        /// A frame is invalid: NaN, an infinite coordinate, or other curves than in the previous
        /// frame.
        Rejected = "rejected",
        /// Strands are closer than the level of the warning ([`Clearance::low`]), or a finding of
        /// [`AbortOn::Any`].
        ///
        /// [`Clearance::low`]: crate::Clearance::low
        Clearance = "clearance",
        /// No finding: watch and record only.
        Never = "never",
    }
}

impl AbortOn {
    /// Returns true if the findings ask the simulator to stop. Contacts that are `expected`,
    /// because the curves touch in the baseline, do not.
    pub fn aborts(self, report: &Report, expected: impl Fn(&Defect) -> bool) -> bool {
        let is_contact = |d: &Defect| d.kind == DefectKind::Contact && !expected(d);
        let has_contact = report.defects.iter().any(is_contact);
        let unlike = |kind| report.changes.iter().any(|c| c.kind() != kind);
        let any = || matches!(report.verdict, Verdict::Changed | Verdict::Rejected) || has_contact;
        match self {
            AbortOn::Any => any(),
            AbortOn::Clearance => report.clearance.is_some_and(|c| c.low) || any(),
            AbortOn::Lost => unlike(ChangeKind::Gained),
            AbortOn::Gained => unlike(ChangeKind::Lost),
            AbortOn::Contact => has_contact,
            AbortOn::Event => !report.events.is_empty(),
            AbortOn::Rejected => report.verdict == Verdict::Rejected,
            AbortOn::Never => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verdict::{Change, Clearance, Place, PullThrough};

    fn report(verdict: Verdict) -> Report {
        Report::new(0, 0.0, verdict)
    }

    fn changed(expected: i64, found: i64) -> Report {
        let change = Change {
            i: 0,
            j: 1,
            image: Default::default(),
            expected,
            found,
            place: None,
        };
        Report {
            changes: vec![change],
            ..report(Verdict::Changed)
        }
    }

    /// Returns an intact report whose clearance is low, or not.
    fn close(low: bool) -> Report {
        let clearance = Clearance {
            at_least: 0.4,
            closest: None,
            low,
            frames_left: None,
        };
        Report {
            clearance: Some(clearance),
            ..report(Verdict::Intact)
        }
    }

    #[test]
    fn each_policy_stops_at_its_findings_only() {
        let contact = Defect {
            i: 0,
            j: Some(1),
            image: Default::default(),
            kind: DefectKind::Contact,
            place: Place {
                segments: [0, 0],
                point: [0.0; 3],
                distance: 0.0,
            },
        };
        let contact = Report {
            defects: vec![contact],
            ..report(Verdict::Contact)
        };
        let event = PullThrough {
            i: 0,
            j: 1,
            image: Default::default(),
            segments: [0, 0],
            fraction: 0.5,
            sign: 1,
            point: [0.0; 3],
            lengths: 0.5,
        };
        let event = Report {
            events: vec![event],
            ..report(Verdict::Changed)
        };
        for (report, stops) in [
            (changed(1, 0), &["any", "lost", "clearance"][..]),
            (changed(0, 1), &["any", "gained", "clearance"]),
            (changed(1, 2), &["any", "lost", "gained", "clearance"]),
            (contact, &["any", "contact", "clearance"]),
            (event, &["any", "event", "clearance"]),
            (close(true), &["clearance"]),
            (close(false), &[]),
            (report(Verdict::Rejected), &["any", "rejected", "clearance"]),
            (report(Verdict::Undecided), &[]),
            (report(Verdict::Intact), &[]),
        ] {
            let aborts = AbortOn::ALL
                .into_iter()
                .filter(|a| a.aborts(&report, |_| false));
            let words: Vec<&str> = aborts.map(AbortOn::word).collect();
            assert_eq!(words, stops, "{report:?}");
        }
    }

    #[test]
    fn words_round_trip() {
        for a in AbortOn::ALL {
            assert_eq!(a.word().parse::<AbortOn>().ok(), Some(a));
        }
        assert!("often".parse::<AbortOn>().is_err());
    }
}
