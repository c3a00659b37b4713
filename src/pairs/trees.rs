//! Trees of boxes (BVH), one per curve.
//!
//! A curve is spatially coherent, so its tree is implicit: node `g` of level `k` covers the
//! segments `g 8^(k+1) .. (g+1) 8^(k+1)`. Its children are the nodes (at level 0: the segments)
//! `8 g .. 8 g + 8` of the level below. Nothing is built or sorted; only boxes are refitted. The
//! boxes of polyline edges are not stored: eight of them are computed from the coordinates each
//! time a leaf is visited, which costs no more than loading them. The boxes of spline segments are
//! stored.

use super::layout::{Layout, Leaves, Node, SHARED, SMALL};
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
    /// Number of empty groups at the start, for curves without a tree.
    shared: u32,
}

impl Trees {
    /// Refits all boxes to those of the leaves. Allocates only if the sizes of the curves have
    /// changed, or other curves have trees. Curves without a tree take no memory for boxes.
    pub fn refit<'a>(&mut self, leaves: impl Into<Leaves<'a>>) {
        let leaves = leaves.into();
        let has_tree = |(i, l): (usize, &Layout)| l.tree == leaves.has_tree(i);
        if !self.fit(leaves) || !self.layouts.iter().enumerate().all(has_tree) {
            self.lay_out(leaves);
        }
        self.refit_all(leaves);
    }

    /// Computes the positions of all groups.
    fn lay_out(&mut self, leaves: Leaves<'_>) {
        let curves = leaves.set.curves();
        let all = (0..curves.len()).all(|i| leaves.has_tree(i));
        self.shared = if all { 0 } else { SHARED };
        self.layouts.clear();
        self.layouts.reserve_exact(curves.len());
        let mut at = self.shared;
        for (i, c) in curves.iter().enumerate() {
            let layout = match leaves.has_tree(i) {
                true => Layout::new(c.segments, leaves.stored(), at),
                false => Layout::without_tree(c.segments),
            };
            at += layout.groups;
            self.layouts.push(layout);
        }
        // A new list, because a longer one would keep its memory.
        self.groups = vec![BoxGroup::EMPTY; at as usize];
        self.roots.clear();
        self.roots.resize(curves.len(), Box3::EMPTY);
    }

    /// Refits the boxes of all curves with groups.
    fn refit_all(&mut self, leaves: Leaves<'_>) {
        let groups = &mut self.groups[self.shared as usize..];
        refit_range(leaves, 0, &self.layouts, groups, &mut self.roots);
    }

    /// Returns true if the stored groups belong to curves of the same sizes.
    fn fit(&self, leaves: Leaves<'_>) -> bool {
        let curves = leaves.set.curves();
        let fits = |(l, c): (&Layout, &Curve)| {
            l.segments == c.segments && (!l.tree || l.leaves == leaves.stored())
        };
        self.layouts.len() == curves.len() && self.layouts.iter().zip(curves).all(fits)
    }

    /// Refits the boxes of some curves, sorted. The boxes of other curves are unchanged, and may be
    /// those of an earlier frame.
    pub fn refit_some<'a>(&mut self, leaves: impl Into<Leaves<'a>>, curves: &[u32]) {
        let leaves = leaves.into();
        let lacks = |&i: &u32| leaves.has_tree(i as usize) && !self.layouts[i as usize].tree;
        if !self.fit(leaves) || curves.iter().any(lacks) {
            return self.refit(leaves);
        }
        if 4 * curves.len() > leaves.set.len() {
            return self.refit_all(leaves);
        }
        for &i in curves {
            let i = i as usize;
            let layout = &self.layouts[i];
            let first = layout.start as usize;
            let groups = &mut self.groups[first..first + layout.groups as usize];
            self.roots[i] = refit_curve(leaves, i, layout, groups);
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
        if node.level + 1 == self.layout.levels {
            return self.bounds;
        }
        let lanes = LANES as u32;
        let parent = self.layout.first[node.level as usize + 1] + node.index / lanes;
        self.groups[parent as usize].lane((node.index % lanes) as usize)
    }

    #[inline(always)]
    fn children<'b>(&'b self, node: Node, buffer: &'b mut BoxGroup) -> &'b BoxGroup {
        if node.level == 0 && !self.layout.leaves {
            *buffer = self.set.leaf_boxes(self.curve, node.index as usize);
            buffer
        } else {
            &self.groups[(self.layout.first[node.level as usize] + node.index) as usize]
        }
    }
}

impl CurveTree<'_> {
    /// Returns the root node.
    pub fn root(&self) -> Node {
        Node::new(self.layout.levels - 1, 0)
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};

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
                let boxes = if basis.is_polyline() {
                    n / 3
                } else {
                    5 * n / 2
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
    fn curves_without_a_tree_take_no_boxes_and_are_empty() {
        let counts: Vec<i32> = (0..400).map(|i| [-15, 64, -15, 201][i % 4]).collect();
        let points: i32 = counts.iter().map(|c| c.abs()).sum();
        let xyz: Vec<f32> = (0..3 * points).map(|k| (k as f32).sin()).collect();
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F32(&xyz)).unwrap();
        let [all, some] = [true, false].map(|open| Leaves { set: &set, open });
        let mut trees = Trees::default();
        trees.refit(all);
        let whole = trees.bytes();
        trees.refit(some);
        assert!(2 * trees.bytes() < whole, "{} of {whole}", trees.bytes());
        for i in 0..set.len() {
            let tree = trees.of(&set, i);
            if i % 2 == 0 {
                check(tree, set.curve(i).segments, tree.root());
                continue;
            }
            assert_eq!(tree.bounds, Box3::EMPTY);
            for leaf in 0..tree.few_leaves().unwrap_or(1) {
                let mut buffer = BoxGroup::EMPTY;
                let group = *tree.children(Node::new(0, leaf), &mut buffer);
                assert_eq!(group.bounds(), Box3::EMPTY, "{i}");
            }
        }
        // A curve that is needed, but has no tree yet, gets one.
        trees.refit_some(all, &[1]);
        assert_eq!(trees.bytes(), whole);
        check(trees.of(&set, 1), 63, trees.of(&set, 1).root());
        // Curves that have trees keep them, if a call requests trees of other curves.
        trees.refit(some);
        let few = trees.bytes();
        let even: Vec<u32> = (0..400).step_by(2).collect();
        trees.refit_some(all, &even);
        assert_eq!(trees.bytes(), few);
        assert_ne!(trees.roots()[0], Box3::EMPTY);
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
