//! Trees of boxes (BVH), one per curve.
//!
//! A curve is spatially coherent, so its tree is implicit: node `g` of level `k` covers the
//! segments `g 8^(k+1) .. (g+1) 8^(k+1)`. Its children are the nodes (at level 0: the segments)
//! `8 g .. 8 g + 8` of the level below. Nothing is built or sorted; only boxes are refitted. The
//! boxes of polyline edges are not stored: eight of them are computed from the coordinates each
//! time a leaf is visited, which costs no more than loading them. The boxes of spline segments are
//! stored.

use crate::curve::{Basis, Box3, BoxGroup, Curve, CurveSet};
use crate::simd::{LANES, Lanes, dispatch};

/// Number of levels of the deepest tree: `8^11 > 2^32` segments.
const LEVELS: usize = 11;

/// Maximum number of segments of a small curve: its leaves are the lanes of one group.
pub(crate) const SMALL: u32 = (LANES * LANES) as u32;

/// Maximum number of segments that a single task refits.
const GRAIN: usize = 1 << 15;

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
        Node {
            level: self.level - 1,
            index: self.lane(k),
        }
    }

    /// Returns the index of the item in lane `k`: of a child node in the level below, or of a
    /// segment if the node is a leaf.
    #[inline]
    pub fn lane(self, k: u32) -> u32 {
        self.index * LANES as u32 + k
    }
}

/// Source of the segment boxes to which trees are refitted.
pub(crate) trait Leaves: Copy + Send + Sync {
    /// Returns the curves. Only their sizes are used.
    fn curves(&self) -> &[Curve];
    /// Returns true if curve `i` has a tree. If not, its root is empty.
    fn has_tree(&self, i: usize) -> bool;
    /// Returns true if the segment boxes of a curve with this number of segments are stored. If
    /// not, [`CurveTree::children`] computes them from the set of curves.
    fn stored(&self, segments: u32) -> bool;
    /// Returns the boxes of the segments `8 g .. 8 g + 8` of curve `i`. Lanes past the last segment
    /// are empty.
    fn boxes(&self, i: usize, g: usize) -> BoxGroup;
}

/// Boxes of the closed curves of a frame.
impl Leaves for &CurveSet {
    fn curves(&self) -> &[Curve] {
        CurveSet::curves(self)
    }

    fn has_tree(&self, i: usize) -> bool {
        self.curve(i).closed
    }

    fn stored(&self, segments: u32) -> bool {
        stores_leaves(self.basis(), segments)
    }

    #[inline(always)]
    fn boxes(&self, i: usize, g: usize) -> BoxGroup {
        self.leaf_boxes(i, g)
    }
}

/// Positions of the groups of one curve.
#[derive(Clone, Copy, Debug)]
struct Layout {
    /// First group of each stored level.
    first: [u32; LEVELS],
    levels: u8,
    /// First group of the curve.
    start: u32,
    /// Number of groups of all stored levels.
    groups: u32,
    segments: u32,
    /// True if level 0, the boxes of single segments, is stored.
    leaves: bool,
}

/// Trees of all curves of a frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Trees {
    layouts: Vec<Layout>,
    groups: Vec<BoxGroup>,
    roots: Vec<Box3>,
}

impl Trees {
    /// Returns true if the boxes of this many segments are refitted by several threads. The
    /// segments may belong to several curves or to a single one.
    pub fn shares_out(segments: usize) -> bool {
        segments > GRAIN
    }

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

/// Returns true if the boxes of single segments are stored: for splines, because their boxes cost
/// more to compute than to load, and for small curves, because they are visited by many pairs
/// relative to their size.
fn stores_leaves(basis: Basis, segments: u32) -> bool {
    !basis.is_polyline() || segments <= SMALL
}

impl CurveTree<'_> {
    /// Calls `segment` with every segment such that `enter` accepts its box and the boxes of all
    /// nodes above it.
    pub fn visit(&self, mut enter: impl FnMut(&Box3) -> bool, mut segment: impl FnMut(u32)) {
        let mut leaf = BoxGroup::EMPTY;
        let mut stack = vec![self.root()];
        while let Some(node) = stack.pop() {
            let group = *self.children(node, &mut leaf);
            for k in 0..LANES {
                let lane = group.lane(k);
                if lane != Box3::EMPTY && enter(&lane) {
                    match node.level {
                        0 => segment(node.lane(k as u32)),
                        _ => stack.push(node.child(k as u32)),
                    }
                }
            }
        }
    }
}

impl Layout {
    fn new(segments: u32, leaves: bool, mut at: u32) -> Layout {
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
        }
    }
}

/// Refits the trees of the curves from `first` on. Splits the range into tasks while it is large
/// enough.
fn refit_range<S: Leaves>(
    source: S,
    first: usize,
    layouts: &[Layout],
    groups: &mut [BoxGroup],
    roots: &mut [Box3],
) {
    let work: usize = layouts.iter().map(|l| l.segments as usize).sum();
    if layouts.len() > 1 && Trees::shares_out(work) {
        let mid = layouts.len() / 2;
        let (left, right) = layouts.split_at(mid);
        let split = left.iter().map(|l| l.groups as usize).sum();
        let (left_groups, right_groups) = groups.split_at_mut(split);
        let (left_roots, right_roots) = roots.split_at_mut(mid);
        rayon::join(
            || refit_range(source, first, left, left_groups, left_roots),
            || refit_range(source, first + mid, right, right_groups, right_roots),
        );
        return;
    }
    let mut at = 0;
    for (k, layout) in layouts.iter().enumerate() {
        let stored = &mut groups[at..at + layout.groups as usize];
        at += stored.len();
        roots[k] = if source.has_tree(first + k) {
            refit_curve(source, first + k, layout, stored)
        } else {
            Box3::EMPTY
        };
    }
}

/// Refits the tree of one curve. Returns its root box.
fn refit_curve<S: Leaves>(source: S, i: usize, layout: &Layout, groups: &mut [BoxGroup]) -> Box3 {
    let leaves = (layout.segments as usize).div_ceil(LANES);
    let (stored, upper) = groups.split_at_mut(if layout.leaves { leaves } else { 0 });
    if leaves == 1 {
        let leaf = source.boxes(i, 0);
        stored.fill(leaf);
        return leaf.bounds();
    }
    let (mut below, mut level) = upper.split_at_mut(leaves.div_ceil(LANES));
    let strip = Strip {
        source,
        i,
        first: 0,
        leaves,
        below: &mut *below,
        stored,
    };
    strip.refit();
    while !level.is_empty() {
        let (next, rest) = level.split_at_mut(below.len().div_ceil(LANES));
        dispatch!(simd => raise(simd, below, &mut *next));
        (below, level) = (next, rest);
    }
    below[0].bounds()
}

/// Consecutive leaves of a curve, with the groups one level above.
struct Strip<'a, S> {
    source: S,
    /// The curve.
    i: usize,
    /// First leaf.
    first: usize,
    leaves: usize,
    /// Groups whose lanes are the leaves.
    below: &'a mut [BoxGroup],
    /// The leaves, if they are stored.
    stored: &'a mut [BoxGroup],
}

impl<S: Leaves> Strip<'_, S> {
    /// Refits the leaves and the level above. Splits the strip into tasks while it is large enough.
    fn refit(self) {
        if !Trees::shares_out(self.leaves * LANES) {
            return dispatch!(simd => Self::refit_part(self, simd));
        }
        let mid = self.below.len() / 2;
        let Strip {
            source,
            i,
            first,
            leaves,
            below,
            stored,
        } = self;
        let left_leaves = mid * LANES;
        let (left_below, right_below) = below.split_at_mut(mid);
        let (left_stored, right_stored) = stored.split_at_mut(left_leaves.min(stored.len()));
        let left = Strip {
            source,
            i,
            first,
            leaves: left_leaves,
            below: left_below,
            stored: left_stored,
        };
        let right = Strip {
            source,
            i,
            first: first + left_leaves,
            leaves: leaves - left_leaves,
            below: right_below,
            stored: right_stored,
        };
        rayon::join(|| left.refit(), || right.refit());
    }

    #[inline(always)]
    fn refit_part<L: Lanes>(self, simd: L) {
        let mut eight = [BoxGroup::EMPTY; LANES];
        for (k, group) in self.below.iter_mut().enumerate() {
            let at = k * LANES;
            let count = (self.leaves - at).min(LANES);
            for (g, leaf) in eight[..count].iter_mut().enumerate() {
                *leaf = self.source.boxes(self.i, self.first + at + g);
            }
            eight[count..].fill(BoxGroup::EMPTY);
            if !self.stored.is_empty() {
                self.stored[at..at + count].copy_from_slice(&eight[..count]);
            }
            *group = bounds_of_eight(simd, &eight);
        }
    }
}

/// Refits a level from the level below.
#[inline(always)]
fn raise<L: Lanes>(simd: L, below: &[BoxGroup], level: &mut [BoxGroup]) {
    for (groups, parent) in below.chunks(LANES).zip(level) {
        *parent = match groups.try_into() {
            Ok(eight) => bounds_of_eight(simd, eight),
            Err(_) => {
                let mut eight = [BoxGroup::EMPTY; LANES];
                eight[..groups.len()].copy_from_slice(groups);
                bounds_of_eight(simd, &eight)
            }
        };
    }
}

/// Returns the bounding boxes of eight groups, one per lane.
#[inline(always)]
fn bounds_of_eight<L: Lanes>(simd: L, groups: &[BoxGroup; LANES]) -> BoxGroup {
    let mut out = BoxGroup::EMPTY;
    let [a, b, c, d, e, f, g, h] = groups;
    for x in 0..3 {
        let lo = [
            simd.load(&a.lo[x]),
            simd.load(&b.lo[x]),
            simd.load(&c.lo[x]),
            simd.load(&d.lo[x]),
            simd.load(&e.lo[x]),
            simd.load(&f.lo[x]),
            simd.load(&g.lo[x]),
            simd.load(&h.lo[x]),
        ];
        simd.store_floats(simd.least(lo), &mut out.lo[x]);
        let hi = [
            simd.load(&a.hi[x]),
            simd.load(&b.hi[x]),
            simd.load(&c.hi[x]),
            simd.load(&d.hi[x]),
            simd.load(&e.hi[x]),
            simd.load(&f.hi[x]),
            simd.load(&g.hi[x]),
            simd.load(&h.hi[x]),
        ];
        simd.store_floats(simd.greatest(hi), &mut out.hi[x]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::Positions;

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
