//! When the simulator is asked to stop.

use super::Verdict;
use crate::certificate::{Change, ChangeKind};
use std::fmt;
use std::str::FromStr;

/// Which findings send the abort signal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum AbortOn {
    /// A linking number changed in any way, or curves touch.
    #[default]
    Any,
    /// A link was lost, or changed to another number.
    Lost,
    /// A link was gained, or changed to another number.
    Gained,
    /// Curves touch.
    Contact,
    /// Nothing: watch and record only.
    Never,
}

impl AbortOn {
    /// Every policy.
    pub const ALL: [AbortOn; 5] = [
        AbortOn::Any,
        AbortOn::Lost,
        AbortOn::Gained,
        AbortOn::Contact,
        AbortOn::Never,
    ];

    /// Whether these findings ask the simulator to stop.
    pub fn aborts(self, verdict: Verdict, changes: &[Change], contact: bool) -> bool {
        let unlike = |kind| changes.iter().any(|c| c.kind() != kind);
        match self {
            AbortOn::Any => verdict == Verdict::Changed || contact,
            AbortOn::Lost => unlike(ChangeKind::Gained),
            AbortOn::Gained => unlike(ChangeKind::Lost),
            AbortOn::Contact => contact,
            AbortOn::Never => false,
        }
    }

    /// The word on the command line.
    pub fn word(self) -> &'static str {
        match self {
            AbortOn::Any => "any",
            AbortOn::Lost => "lost",
            AbortOn::Gained => "gained",
            AbortOn::Contact => "contact",
            AbortOn::Never => "never",
        }
    }
}

impl fmt::Display for AbortOn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl FromStr for AbortOn {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|a| a.word() == s)
            .ok_or_else(|| "expected any, lost, gained, contact or never".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn change(expected: i64, found: i64) -> Change {
        Change {
            i: 0,
            j: 1,
            expected,
            found,
            place: None,
        }
    }

    #[test]
    fn each_policy_stops_at_its_finding_only() {
        let lost = [change(1, 0)];
        let gained = [change(0, 1)];
        let other = [change(1, 2)];
        let stops = |changes: &[Change], contact| {
            let verdict = if changes.is_empty() {
                Verdict::Contact
            } else {
                Verdict::Changed
            };
            AbortOn::ALL.map(|a| a.aborts(verdict, changes, contact))
        };
        assert_eq!(stops(&lost, false), [true, true, false, false, false]);
        assert_eq!(stops(&gained, false), [true, false, true, false, false]);
        assert_eq!(stops(&other, false), [true, true, true, false, false]);
        assert_eq!(stops(&[], true), [true, false, false, true, false]);
        assert_eq!(
            AbortOn::ALL.map(|a| a.aborts(Verdict::Undecided, &[], false)),
            [false; 5]
        );
    }

    #[test]
    fn words_round_trip() {
        for a in AbortOn::ALL {
            assert_eq!(a.word().parse::<AbortOn>(), Ok(a));
        }
        assert!("often".parse::<AbortOn>().is_err());
    }
}
