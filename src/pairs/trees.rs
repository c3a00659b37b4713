//! Trees of boxes (BVH), one per curve.
//!
//! A curve is spatially coherent, so its tree is implicit: node `g` of level `k` covers the
//! segments `g 8^(k+1) .. (g+1) 8^(k+1)`. Its children are the nodes (at level 0: the segments)
//! `8 g .. 8 g + 8` of the level below. Nothing is built or sorted; only boxes are refitted. The
//! boxes of polyline edges are not stored: eight of them are computed from the coordinates each
//! time a leaf is visited, which costs no more than loading them. The boxes of spline segments are
//! stored.

use super::layout::{Layout, Leaves, Node, SMALL};
use super::refit::{refit_curve, refit_range};
use crate::curve::{Box3, BoxGroup, Curve, CurveSet};
use crate::simd::{LANES, prefetch};

/// Maximum number of groups of a curve that are prefetched.
const UPPER: u32 = 4;

/// Trees of all curves of a frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Trees {
    layouts: Vec<Layout>,
    groups: Vec<BoxGroup>,
    roots: Vec<Box3>,
}

impl Trees {
    /// Refits all boxes to those of the leaves. Allocates only if the sizes of the curves have
    /// changed.
    pub fn refit<S: Leaves>(&mut self, leaves: S) {
        if !self.fit(leaves) {
            let curves = leaves.curves();
            self.layouts.clear();
            let mut at = 0;
            for c in curves {
                let layout = Layout::new(c.segments, leaves.stored(c.segments), at);
                at += layout.groups;
                self.layouts.push(layout);
            }
            self.groups.clear();
            self.groups.resize(at as usize, BoxGroup::EMPTY);
            self.roots.clear();
            self.roots.resize(curves.len(), Box3::EMPTY);
        }
        refit_range(leaves, 0, &self.layouts, &mut self.groups, &mut self.roots);
    }

    /// Returns true if the stored groups belong to curves of the same sizes.
    fn fit<S: Leaves>(&self, leaves: S) -> bool {
        let curves = leaves.curves();
        let fits = |(l, c): (&Layout, &Curve)| {
            l.segments == c.segments && l.leaves == leaves.stored(c.segments)
        };
        self.layouts.len() == curves.len() && self.layouts.iter().zip(curves).all(fits)
    }

    /// Refits the boxes of some curves, sorted. The boxes of other curves are unchanged, and may be
    /// those of an earlier frame.
    pub fn refit_some<S: Leaves>(&mut self, leaves: S, curves: &[u32]) {
        if !self.fit(leaves) || 4 * curves.len() > leaves.curves().len() {
            return self.refit(leaves);
        }
        let Trees {
            layouts,
            groups,
            roots,
        } = self;
        for &i in curves {
            let i = i as usize;
            let layout = &layouts[i];
            let first = layout.start as usize;
            let groups = &mut groups[first..first + layout.groups as usize];
            roots[i] = match leaves.has_tree(i) {
                true => refit_curve(leaves, i, layout, groups),
                false => Box3::EMPTY,
            };
        }
    }

    /// Returns the root boxes of all curves. Curves without a tree have empty boxes and so no
    /// potential links.
    pub fn roots(&self) -> &[Box3] {
        &self.roots
    }

    /// Returns the tree of curve `i`, which must have one. Leaves that are not stored are computed
    /// from `set`.
    pub fn of<'a>(&'a self, set: &'a CurveSet, i: usize) -> CurveTree<'a> {
        CurveTree {
            set,
            curve: i,
            layout: &self.layouts[i],
            groups: &self.groups,
            bounds: self.roots[i],
        }
    }

    /// Prefetches the upper boxes of curve `i`: all boxes if it has few segments.
    #[inline(always)]
    pub fn prefetch(&self, i: usize) {
        let layout = &self.layouts[i];
        let end = (layout.start + layout.groups) as usize;
        let count = layout.groups.min(UPPER) as usize;
        self.groups[end - count..end].iter().for_each(prefetch);
    }

    /// Returns the number of bytes of the stored boxes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.groups[..]) + size_of_val(&self.roots[..])
    }
}

/// Tree of one curve.
#[derive(Clone, Copy)]
pub(crate) struct CurveTree<'a> {
    set: &'a CurveSet,
    curve: usize,
    layout: &'a Layout,
    groups: &'a [BoxGroup],
    /// Bounding box of the curve.
    pub bounds: Box3,
}

/// A tree of boxes, as far as a descent needs it.
pub(crate) trait BoxTree: Copy {
    /// Returns the box of a node.
    fn node_box(&self, node: Node) -> Box3;
    /// Returns the boxes of the children of a node. `buffer` is for boxes that are not stored.
    fn children<'b>(&'b self, node: Node, buffer: &'b mut BoxGroup) -> &'b BoxGroup;
}

impl BoxTree for CurveTree<'_> {
    #[inline(always)]
    fn node_box(&self, node: Node) -> Box3 {
        CurveTree::node_box(self, node)
    }

    #[inline(always)]
    fn children<'b>(&'b self, node: Node, buffer: &'b mut BoxGroup) -> &'b BoxGroup {
        CurveTree::children(self, node, buffer)
    }
}

impl<'a> CurveTree<'a> {
    /// Returns the root node.
    pub fn root(&self) -> Node {
        Node {
            level: self.layout.levels - 1,
            index: 0,
        }
    }

    /// Returns true if the curve has so few segments that testing its coarse boxes does not pay.
    #[inline(always)]
    pub fn is_small(&self) -> bool {
        self.layout.segments <= SMALL
    }

    /// Returns the number of leaves if the curve is small.
    #[inline(always)]
    pub fn few_leaves(&self) -> Option<u32> {
        let leaves = self.layout.segments.div_ceil(LANES as u32);
        self.is_small().then_some(leaves)
    }

    /// Returns true if the boxes of single segments are stored.
    pub fn stores_leaves(&self) -> bool {
        self.layout.leaves
    }

    /// Returns the boxes of the children of a node. `leaf` is a buffer for boxes that are not
    /// stored.
    #[inline(always)]
    pub fn children<'b>(&self, node: Node, leaf: &'b mut BoxGroup) -> &'b BoxGroup
    where
        'a: 'b,
    {
        if node.level == 0 && !self.layout.leaves {
            *leaf = self.set.leaf_boxes(self.curve, node.index as usize);
            leaf
        } else {
            &self.groups[(self.layout.first[node.level as usize] + node.index) as usize]
        }
    }

    /// Returns the box of a node.
    #[inline(always)]
    pub fn node_box(&self, node: Node) -> Box3 {
        if node.level + 1 == self.layout.levels {
            return self.bounds;
        }
        let lanes = LANES as u32;
        let parent = self.layout.first[node.level as usize + 1] + node.index / lanes;
        self.groups[parent as usize].lane((node.index % lanes) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};
    use crate::pairs::layout::stores_leaves;

    /// The box of every node is the bounding box of its segments, for all sizes around powers of
    /// eight.
    #[test]
    fn nodes_bound_their_segments_exactly() {
        for basis in [Basis::Polyline, Basis::CatmullRom, Basis::BSpline] {
            for n in [3, 4, 7, 8, 9, 63, 64, 65, 511, 512, 513, 4097, 70_001] {
                let xyz: Vec<f32> = (0..6 * n).map(|k| ((k * 7919) % 1013) as f32).collect();
                let positions = Positions::F32(&xyz);
                let set = CurveSet::from_counts(basis, &[-n, -n], positions).unwrap();
                let mut trees = Trees::default();
                trees.refit(&set);
                for i in 0..2 {
                    let tree = trees.of(&set, i);
                    check(tree, n as u32, tree.root());
                }
                // Polylines: one eighth of a box per segment, one eighth of that in the next level,
                // and so on.
                let boxes = if stores_leaves(basis, n as u32) {
                    5 * n / 2
                } else {
                    n / 3
                } as usize;
                assert!(trees.bytes() <= 1000 + 24 * boxes, "{basis:?} {n}");
            }
        }
    }

    fn check(tree: CurveTree<'_>, n: u32, node: Node) {
        let mut leaf = BoxGroup::EMPTY;
        let group = *tree.children(node, &mut leaf);
        assert_eq!(group.bounds(), tree.node_box(node));
        for k in 0..LANES as u32 {
            let span = (LANES as u32).pow(u32::from(node.level));
            let empty = (node.index * LANES as u32 + k) * span >= n;
            assert_eq!(empty, group.lane(k as usize) == Box3::EMPTY);
            if node.level > 0 && !empty {
                assert_eq!(group.lane(k as usize), tree.node_box(node.child(k)));
                check(tree, n, node.child(k));
            }
        }
    }

    #[test]
    fn a_refit_equals_a_fresh_build() {
        let a: Vec<f64> = (0..300).map(|k| f64::from(k).sin()).collect();
        let b: Vec<f64> = (0..300).map(|k| f64::from(k).cos()).collect();
        let counts = [-40, 20, -40];
        let mut set =
            CurveSet::from_counts(Basis::CatmullRom, &counts, Positions::F64(&a)).unwrap();
        let mut trees = Trees::default();
        trees.refit(&set);
        set.update(Positions::F64(&b)).unwrap();
        trees.refit(&set);
        let mut fresh = Trees::default();
        fresh.refit(&set);
        assert_eq!(trees.roots(), fresh.roots());
        assert_eq!(
            trees.roots()[1],
            Box3::EMPTY,
            "open curves have no potential links"
        );
    }
}
