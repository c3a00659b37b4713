//! Swept boxes: they contain every segment at all times between two frames.
//!
//! # A moving observer
//!
//! If both curves of a pair are seen by an observer who moves at a constant velocity, they pass
//! through each other at the same times, and their points still move on straight lines. So the
//! velocity is chosen for each pair such that the boxes around the boxes of both frames are small:
//! as the mean of the velocities of the two curves. In a sheet that falls and crumples, neighbours
//! move together, and nearly all candidates are ruled out.

use crate::curve::vector::per_axis;
use crate::curve::{Box3, BoxGroup, CurveSet, larger, pow2, smaller};
use crate::pairs::{BoxTree, CurveTree, Leaves, Node, Pair, Trees};
use crate::simd::LANES;

/// Trees of the boxes of both frames of a step.
#[derive(Debug, Default)]
pub(super) struct SweptTrees {
    trees: [Trees; 2],
    /// The frame whose boxes the second tree has for all curves ([`CurveSet::contents`]).
    boxed: Option<u64>,
    roots: Vec<Box3>,
    /// Bound of the rounding errors of boxes seen by a moving observer.
    slack: f32,
}

/// Tree of the swept boxes of a curve, seen by a moving observer.
#[derive(Clone, Copy)]
pub(super) struct SweptTree<'a> {
    frames: [CurveTree<'a>; 2],
    observer: Observer,
}

/// A moving observer.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::incremental) struct Observer {
    /// Motion during the step.
    motion: [f32; 3],
    /// Bound of the rounding errors of boxes. 0 if the observer is at rest.
    slack: f32,
}

impl Observer {
    /// Returns an observer who moves like the average of some boxes, which are given at the start
    /// and at the end of the step.
    ///
    /// # Derivation of the error bound
    ///
    /// Bounds are at most `5/3 M`, with `M` the largest coordinate, and the motion is at most twice
    /// that. Their difference has a rounding error of at most `2^-24 * 5 M`, and the subtraction of
    /// the slack adds `2^-24 * 6 M`. The slack is `2^-24 * 16 M`. A motion that is small compared
    /// with it is not worth the errors.
    fn following(boxes: impl Iterator<Item = [Box3; 2]>, slack: f32) -> Observer {
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for [before, after] in boxes {
            let center = |b: &Box3, x: usize| 0.5 * f64::from(b.lo[x]) + 0.5 * f64::from(b.hi[x]);
            sum = per_axis(|x| sum[x] + (center(&after, x) - center(&before, x)));
            count += 1.0;
        }
        let motion = sum.map(|sum| (sum / count) as f32);
        match motion.iter().any(|x| x.abs() > 16.0 * slack) {
            true => Observer { motion, slack },
            false => Observer::default(),
        }
    }

    /// Returns an observer who moves with two leaves, each given by its boxes in both frames.
    pub fn of_leaves(frames: [&CurveSet; 2], leaves: &[[BoxGroup; 2]; 2]) -> Observer {
        let bounds = |leaf: &[BoxGroup; 2]| leaf.each_ref().map(BoxGroup::bounds);
        Observer::following(leaves.iter().map(bounds), slack(frames))
    }

    /// Returns the boxes that contain eight segments at all times, from their boxes in both frames.
    #[inline(always)]
    pub fn swept_leaf(&self, [before, after]: &[BoxGroup; 2]) -> BoxGroup {
        let mut swept = BoxGroup::EMPTY;
        self.swept_group([before, after], &mut swept);
        swept
    }

    /// Returns the box that contains a segment at all times, from its boxes in both frames.
    #[inline(always)]
    fn swept(&self, [before, after]: [&Box3; 2]) -> Box3 {
        let Observer { motion, slack } = self;
        let mut out = Box3::EMPTY;
        for (x, motion) in motion.iter().enumerate() {
            let (lo, hi) = (after.lo[x] - motion, after.hi[x] - motion);
            out.lo[x] = smaller(before.lo[x], lo) - slack;
            out.hi[x] = larger(before.hi[x], hi) + slack;
        }
        out
    }

    /// Same as [`Observer::swept`], for eight boxes.
    #[inline(always)]
    fn swept_group(&self, [before, after]: [&BoxGroup; 2], out: &mut BoxGroup) {
        let Observer { motion, slack } = self;
        for (x, motion) in motion.iter().enumerate() {
            for k in 0..LANES {
                let lo = after.lo[x][k] - motion;
                let hi = after.hi[x][k] - motion;
                out.lo[x][k] = smaller(before.lo[x][k], lo) - slack;
                out.hi[x][k] = larger(before.hi[x][k], hi) + slack;
            }
        }
    }
}

/// Returns the slack of moving observers. It is infinite, which excludes them, if a bound could
/// overflow.
fn slack(frames: [&CurveSet; 2]) -> f32 {
    let size = frames.map(CurveSet::max_abs);
    let size = size[0].max(size[1]);
    match size < pow2(100) {
        true => (size * pow2(-20)) as f32 + f32::MIN_POSITIVE,
        false => f32::INFINITY,
    }
}

impl SweptTrees {
    /// Computes the boxes of both frames: of these curves, or of all closed curves, and of open
    /// ones if `open` is set, which must be the same in all calls. The boxes of the first frame are
    /// kept from the last call if it ended in that frame.
    pub fn refit(&mut self, frames: [&CurveSet; 2], open: bool, curves: Option<&[u32]>) {
        let [before, after] = frames.map(CurveSet::contents);
        let continued = self.boxed == Some(before);
        if continued {
            self.trees.swap(0, 1);
        }
        self.boxed = curves.is_none().then_some(after);
        let both = self.trees.iter_mut().zip(frames);
        for (trees, set) in both.skip(usize::from(continued)) {
            match curves {
                Some(curves) => trees.refit_some(Leaves { set, open }, curves),
                None => trees.refit(Leaves { set, open }),
            }
        }
        self.slack = slack(frames);
    }

    /// Discards the boxes of the last call, because the next one has other leaves.
    pub fn forget(&mut self) {
        self.boxed = None;
    }

    /// Returns the swept boxes of all curves, seen by an observer who moves like their average.
    /// Curves without a tree have empty boxes.
    pub fn roots(&mut self) -> &[Box3] {
        let both = |i: usize| [0, 1].map(|f| self.trees[f].roots()[i]);
        let curves = 0..self.trees[0].roots().len();
        let some = curves.clone().map(both).filter(|b| b[0] != Box3::EMPTY);
        let observer = Observer::following(some, self.slack);
        self.roots.clear();
        let swept = |i: usize| observer.swept(both(i).each_ref());
        self.roots.extend(curves.map(swept));
        &self.roots
    }

    /// Prefetches the upper boxes of both curves of a pair.
    #[inline(always)]
    pub fn prefetch(&self, (i, j): Pair) {
        for tree in &self.trees {
            tree.prefetch(i as usize);
            tree.prefetch(j as usize);
        }
    }

    /// Returns an observer who moves with two curves, which must have trees.
    pub fn observer(&self, (i, j): Pair) -> Observer {
        let both = |i: u32| [0, 1].map(|f| self.trees[f].roots()[i as usize]);
        Observer::following([both(i), both(j)].into_iter(), self.slack)
    }

    /// Returns the tree of curve `i`.
    pub fn of<'a>(
        &'a self,
        frames: [&'a CurveSet; 2],
        i: usize,
        observer: Observer,
    ) -> SweptTree<'a> {
        SweptTree {
            frames: [0, 1].map(|f| self.trees[f].of(frames[f], i)),
            observer,
        }
    }
}

impl SweptTree<'_> {
    /// Returns the root node.
    pub fn root(&self) -> Node {
        self.frames[0].root()
    }

    /// Returns the number of leaves if the curve is small.
    #[inline(always)]
    pub fn few_leaves(&self) -> Option<u32> {
        self.frames[0].few_leaves()
    }
}

impl BoxTree for SweptTree<'_> {
    #[inline(always)]
    fn node_box(&self, node: Node) -> Box3 {
        let [before, after] = self.frames.each_ref().map(|tree| tree.node_box(node));
        self.observer.swept([&before, &after])
    }

    #[inline(always)]
    fn children<'b>(&'b self, node: Node, buffer: &'b mut BoxGroup) -> &'b BoxGroup {
        let mut unused = [BoxGroup::EMPTY; 2];
        let [first, second] = &mut unused;
        let [before, after] = &self.frames;
        let both = [before.children(node, first), after.children(node, second)];
        self.observer.swept_group(both, buffer);
        buffer
    }
}
