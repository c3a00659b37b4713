//! Coverage: the curves and the pairs of segments that a reference frame or a ledger examines.

use crate::curve::CurveSet;
use crate::pairs::{Leaves, Pair, PairFilter};

/// Pairs of segments that are covered in addition to those of two different closed curves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Coverage {
    /// True if pairs of segments of the same curve are covered, for its self-crossings.
    pub self_crossings: bool,
    /// True if open curves are covered.
    pub open_curves: bool,
}

/// The covered curves of a set, and the covered pairs of them.
#[derive(Clone, Copy)]
pub(super) struct Covered<'a> {
    pub set: &'a CurveSet,
    pub coverage: Coverage,
    /// Pairs of curves that are covered; `None`: all.
    pub filter: Option<&'a PairFilter>,
}

impl<'a> Covered<'a> {
    pub fn new(set: &'a CurveSet, coverage: Coverage, filter: Option<&'a PairFilter>) -> Self {
        Covered {
            set,
            coverage,
            filter,
        }
    }

    /// Returns the covered curves, for trees of their boxes.
    pub fn leaves(&self) -> Leaves<'a> {
        Leaves {
            set: self.set,
            open: self.coverage.open_curves,
        }
    }

    /// Returns the numbers of the covered curves.
    pub fn indices(&self) -> impl Iterator<Item = usize> + use<'a> {
        let leaves = self.leaves();
        (0..leaves.set.len()).filter(move |&i| leaves.has_tree(i))
    }

    /// Returns true if the filter has this pair; with `i == j`, this curve.
    pub fn has_pair(&self, i: u32, j: u32) -> bool {
        self.filter.is_none_or(|filter| filter.contains(i, j))
    }

    /// Returns the pairs of a curve and itself, in order, if self-crossings are covered.
    pub fn self_pairs(self) -> impl Iterator<Item = Pair> + use<'a> {
        let curves = self.coverage.self_crossings.then(|| self.indices());
        let pairs = curves.into_iter().flatten().map(|i| (i as u32, i as u32));
        pairs.filter(move |&(i, j)| self.has_pair(i, j))
    }
}
