//! Pairs of segments, and curves, that a reference frame or a ledger covers.

use crate::curve::{BoxGroup, Curve, CurveSet};
use crate::pairs::Leaves;

/// Pairs of segments that are covered in addition to those of two different closed curves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Coverage {
    /// True if pairs of segments of the same curve are covered, for its self-crossings.
    pub self_crossings: bool,
    /// True if open curves are covered.
    pub open_curves: bool,
}

/// Boxes of the covered curves.
#[derive(Clone, Copy)]
pub(crate) struct Covered<'a> {
    pub set: &'a CurveSet,
    pub coverage: Coverage,
}

impl<'a> Covered<'a> {
    pub fn new(set: &'a CurveSet, coverage: Coverage) -> Covered<'a> {
        Covered { set, coverage }
    }

    /// Returns the covered curves.
    pub fn indices(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.set.len()).filter(|&i| self.has_tree(i))
    }
}

impl Leaves for Covered<'_> {
    fn curves(&self) -> &[Curve] {
        self.set.curves()
    }

    fn has_tree(&self, i: usize) -> bool {
        self.coverage.open_curves || self.set.curve(i).closed
    }

    fn stored(&self) -> bool {
        Leaves::stored(&self.set)
    }

    #[inline(always)]
    fn boxes(&self, i: usize, g: usize) -> BoxGroup {
        self.set.leaf_boxes(i, g)
    }
}
