//! Curves that a reference frame or a ledger covers.

use crate::curve::{BoxGroup, Curve, CurveSet};
use crate::incremental::coverage::Coverage;
use crate::pairs::Leaves;

/// Boxes of the covered curves.
#[derive(Clone, Copy)]
pub(super) struct Covered<'a> {
    pub set: &'a CurveSet,
    pub coverage: Coverage,
}

impl Covered<'_> {
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

    fn stored(&self, segments: u32) -> bool {
        Leaves::stored(&self.set, segments)
    }

    #[inline(always)]
    fn boxes(&self, i: usize, g: usize) -> BoxGroup {
        self.set.leaf_boxes(i, g)
    }
}
