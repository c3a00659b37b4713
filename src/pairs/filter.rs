//! Subset of the pairs of curves that an engine verifies, for virtual loops and for images.

use crate::curve::{Image, Translated};
use crate::pairs::Pair;
use std::sync::Arc;

/// Pairs of a set in which some curves stand for something else.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum PairFilter {
    /// The curves of a frame, then virtual loops of its open curves.
    Loops(Arc<LoopPairs>),
    /// The same, but only pairs of curves of the frame.
    WithoutLoops(Arc<LoopPairs>),
    /// For each curve the curve of a frame, and its translation. Each pair of a curve and an image
    /// of another one, or of itself, is verified once ([`has_image`]).
    Images(Translated),
}

/// Pairs of curves of a frame and of the loops that follow them: all pairs of two curves, pairs of
/// a loop and a closed curve, and pairs of two loops without a common curve.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct LoopPairs {
    /// True for each curve of the frame that is closed.
    pub closed: Vec<bool>,
    /// The two curves of each loop.
    pub loops: Vec<[u32; 2]>,
}

impl LoopPairs {
    /// Returns true if this is the number of a curve of the frame.
    pub fn is_own(&self, i: u32) -> bool {
        (i as usize) < self.closed.len()
    }

    /// Returns the curves of a loop; `None` for a curve of the frame.
    pub fn loop_of(&self, i: u32) -> Option<[u32; 2]> {
        let k = (i as usize).checked_sub(self.closed.len())?;
        self.loops.get(k).copied()
    }

    fn contains(&self, i: u32, j: u32) -> bool {
        match (self.loop_of(i), self.loop_of(j)) {
            (None, None) => true,
            (Some(_), None) => self.closed[j as usize],
            (None, Some(_)) => self.closed[i as usize],
            (Some(a), Some(b)) => !a.iter().any(|curve| b.contains(curve)),
        }
    }
}

/// Returns true if a set of translated curves has this pair: none of them is translated; or one is,
/// and comes after the other one, or is the same curve translated forwards.
fn has_image((i, m): (u32, Image), (j, n): (u32, Image)) -> bool {
    let home = Image::default();
    match (m == home, n == home) {
        (true, false) => i < j || i == j && n > home,
        (false, true) => j < i || j == i && m > home,
        (true, true) => true,
        (false, false) => false,
    }
}

impl PairFilter {
    /// Returns true if this pair is verified; with `i == j`, this curve.
    pub fn contains(&self, i: u32, j: u32) -> bool {
        match self {
            PairFilter::Loops(pairs) => pairs.contains(i, j),
            PairFilter::WithoutLoops(pairs) => pairs.is_own(i) && pairs.is_own(j),
            PairFilter::Images(curves) => has_image(curves[i as usize], curves[j as usize]),
        }
    }

    /// Keeps the pairs that are verified.
    pub fn retain(&self, pairs: &mut Vec<Pair>) {
        pairs.retain(|&(i, j)| self.contains(i, j));
    }
}
