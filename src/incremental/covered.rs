//! Coverage: the curves and the pairs of segments that a reference frame or a ledger examines.

use crate::curve::CurveSet;
use crate::pairs::Leaves;

/// Pairs of segments that are covered in addition to those of two different closed curves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Coverage {
    /// True if pairs of segments of the same curve are covered, for its self-crossings.
    pub self_crossings: bool,
    /// True if open curves are covered.
    pub open_curves: bool,
}

/// The covered curves of a set.
#[derive(Clone, Copy)]
pub(super) struct Covered<'a> {
    pub set: &'a CurveSet,
    pub coverage: Coverage,
}

impl<'a> Covered<'a> {
    pub fn new(set: &'a CurveSet, coverage: Coverage) -> Covered<'a> {
        Covered { set, coverage }
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
}
