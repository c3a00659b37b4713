//! Linking numbers, and how one differs from the expected one.

use super::Place;

/// A non-zero entry of the linking matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
pub struct Link {
    /// First curve, from 0; less than `j`.
    pub i: u32,
    /// Second curve.
    pub j: u32,
    /// Their linking number, never 0.
    pub lambda: i64,
}

/// How a linking number differs from the expected one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ChangeKind {
    /// The curves were linked and are not any more.
    Lost,
    /// The curves were not linked and now are.
    Gained,
    /// The curves are linked as they were, by another number.
    Changed,
}

impl ChangeKind {
    /// One word.
    pub fn word(self) -> &'static str {
        match self {
            ChangeKind::Lost => "lost",
            ChangeKind::Gained => "gained",
            ChangeKind::Changed => "changed",
        }
    }
}

/// A linking number that is not the expected one.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Change {
    /// First curve, from 0; less than `j`.
    pub i: u32,
    /// Second curve.
    pub j: u32,
    /// Linking number in the baseline.
    pub expected: i64,
    /// Linking number found.
    pub found: i64,
    /// Where the curves are closest now: right after a pull-through, its place.
    pub place: Option<Place>,
}

impl Change {
    /// Lost, gained or changed.
    pub fn kind(&self) -> ChangeKind {
        match (self.expected, self.found) {
            (_, 0) => ChangeKind::Lost,
            (0, _) => ChangeKind::Gained,
            _ => ChangeKind::Changed,
        }
    }
}
