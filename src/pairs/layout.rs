//! Nodes of the trees of boxes, their leaves, and the positions of the stored boxes.

use crate::curve::CurveSet;
use crate::simd::LANES;

/// Number of levels of the deepest tree: `8^11 > 2^32` segments.
pub(super) const LEVELS: usize = 11;

/// Maximum number of segments of a small curve: its leaves are the lanes of one group.
pub(crate) const SMALL: u32 = (LANES * LANES) as u32;

/// A node: its level (0: its children are segments) and its index in that level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Node {
    pub level: u8,
    pub index: u32,
}

impl Node {
    #[inline]
    pub fn new(level: u8, index: u32) -> Node {
        Node { level, index }
    }

    /// Returns the child in lane `k`. A node of level 0 has no children.
    #[inline]
    pub fn child(self, k: u32) -> Node {
        Node::new(self.level - 1, self.lane(k))
    }

    /// Returns the index of the item in lane `k`: of a child node in the level below, or of a
    /// segment if the node is a leaf.
    #[inline]
    pub fn lane(self, k: u32) -> u32 {
        self.index * LANES as u32 + k
    }
}

/// The curves of a set that have trees: closed curves, and open ones if `open` is set.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Leaves<'a> {
    pub set: &'a CurveSet,
    pub open: bool,
}

impl<'a> From<&'a CurveSet> for Leaves<'a> {
    fn from(set: &'a CurveSet) -> Leaves<'a> {
        Leaves { set, open: false }
    }
}

impl Leaves<'_> {
    /// Returns true if curve `i` has a tree. If not, its root is empty.
    pub fn has_tree(&self, i: usize) -> bool {
        self.open || self.set.curve(i).closed
    }

    /// Returns true if the boxes of single segments are stored: for splines, because their boxes
    /// cost more to compute than to load. If not, [`CurveTree::children`] computes them from the
    /// set of curves.
    pub fn stored(&self) -> bool {
        !self.set.basis().is_polyline()
    }
}

/// Positions of the groups of one curve.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Layout {
    /// First group of each stored level.
    pub first: [u32; LEVELS],
    pub levels: u8,
    /// First group of the curve.
    pub start: u32,
    /// Number of groups of all stored levels.
    pub groups: u32,
    pub segments: u32,
    /// True if level 0, the boxes of single segments, is stored.
    pub leaves: bool,
    /// False if the curve has no tree: it has no groups, and its boxes are the shared empty ones.
    pub tree: bool,
}

/// Number of empty groups at the start that all curves without a tree share: as many as a small
/// curve has leaves.
pub(super) const SHARED: u32 = SMALL / LANES as u32;

impl Layout {
    /// Returns the layout of a curve without a tree.
    pub fn without_tree(segments: u32) -> Layout {
        Layout {
            levels: 1,
            segments,
            leaves: true,
            ..Layout::default()
        }
    }

    pub fn new(segments: u32, leaves: bool, mut at: u32) -> Layout {
        let start = at;
        let mut first = [0; LEVELS];
        let mut levels = 1;
        let mut nodes = segments.div_ceil(LANES as u32);
        if leaves {
            first[0] = at;
            at += nodes;
        }
        while nodes > 1 {
            nodes = nodes.div_ceil(LANES as u32);
            first[levels] = at;
            at += nodes;
            levels += 1;
        }
        Layout {
            first,
            levels: levels as u8,
            start,
            groups: at - start,
            segments,
            leaves,
            tree: true,
        }
    }
}
