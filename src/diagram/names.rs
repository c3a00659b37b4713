//! Names of the knots with at most 5 crossings.

/// Symbol, `v2`, size of `v3`, and determinant of the knots with at most 5 crossings.
const KNOTS: [(&str, i64, i64, &str); 5] = [
    ("unknot", 0, 0, "1"),
    ("3_1", 1, 1, "3"),
    ("4_1", -1, 0, "5"),
    ("5_1", 3, 5, "5"),
    ("5_2", 2, 3, "7"),
];

/// Name of a knot in the table of Rolfsen.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
#[non_exhaustive]
pub struct KnotName {
    /// `unknot`, `3_1`, `4_1`, `5_1` or `5_2`.
    pub symbol: &'static str,
    /// Handedness of a knot that differs from its mirror image: the sign of `v3`.
    pub right_handed: Option<bool>,
    /// True if the diagram has at most 5 crossings. Then the name is proven: the invariants tell
    /// these knots apart, and all others need more crossings. Otherwise the invariants are
    /// consistent with the name, but other knots have the same ones.
    pub proven: bool,
}

impl KnotName {
    pub(super) fn new(
        v2: i64,
        v3: Option<i64>,
        determinant: Option<&str>,
        crossings: usize,
    ) -> Option<KnotName> {
        let (v3, determinant) = (v3?, determinant?);
        let numbers = (v2, v3.abs(), determinant);
        let mut knots = KNOTS.iter();
        let found = knots.find(|knot| (knot.1, knot.2, knot.3) == numbers);
        found.map(|knot| KnotName {
            symbol: knot.0,
            right_handed: (v3 != 0).then_some(v3 > 0),
            proven: crossings <= 5,
        })
    }
}

impl std::fmt::Display for KnotName {
    /// Writes the name with its certainty: `right-handed 3_1`, or `consistent with 4_1`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let certainty = if self.proven { "" } else { "consistent with " };
        let hand = match self.right_handed {
            Some(true) => "right-handed ",
            Some(false) => "left-handed ",
            None => "",
        };
        write!(f, "{certainty}{hand}{}", self.symbol)
    }
}
