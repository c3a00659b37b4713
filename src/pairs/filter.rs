//! Pairs of curves that a verifier considers, if not all: those of virtual loops or of images.

use crate::curve::{Box3, CurveSet, Image, Translated};
use crate::pairs::{Leaves, Pair};
use std::sync::Arc;

/// Number of boxes around the curves with a loop. More boxes follow a bent shape more closely.
const REGIONS: usize = 16;

/// Fraction of the size of such a box by which it is grown, so that few frames need other curves
/// than the previous one.
const MARGIN: f32 = 0.02;

/// Number of curves, relative to those that are needed, above which others are discarded.
const SUPERFLUOUS: usize = 2;

/// Pairs of a set in which some curves stand for something else.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum PairFilter {
    /// The curve that follows in the virtual loop of each curve, `u32::MAX` without a loop: only
    /// pairs with a loop are verified, except loops that have a common curve.
    Loops(Arc<[u32]>),
    /// For each curve the curve of a frame, and its translation. Each pair of a curve and an image
    /// of another one, or of itself, is verified once ([`has_image`]).
    Images(Translated),
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
    /// Returns true if a curve stands for a virtual loop.
    pub fn has_loop(&self, i: u32) -> bool {
        let PairFilter::Loops(next) = self else {
            return false;
        };
        next.get(i as usize).is_some_and(|&j| j != u32::MAX)
    }

    /// Returns true if this pair is verified; with `i == j`, this curve.
    pub fn contains(&self, i: u32, j: u32) -> bool {
        match self {
            PairFilter::Loops(next) => {
                let [after_i, after_j] = [i, j].map(|i| next[i as usize]);
                let with_loop = after_i != u32::MAX || after_j != u32::MAX;
                with_loop && after_i != j && after_j != i
            }
            PairFilter::Images(curves) => has_image(curves[i as usize], curves[j as usize]),
        }
    }

    /// Keeps the pairs that are verified.
    pub fn retain(&self, pairs: &mut Vec<Pair>) {
        pairs.retain(|&(i, j)| self.contains(i, j));
    }
}

/// Curves that a filter needs in a frame. Loops need the curves with a loop, and those whose boxes
/// come near to them. Images need all curves.
#[derive(Clone, Debug, Default)]
pub(crate) struct Nearby {
    needed: Vec<bool>,
}

impl Nearby {
    /// Finds the curves that a filter needs in frames of the same curves: in each of them, and in
    /// the steps between them. Returns true if the curves differ from those of the last call.
    pub fn update(&mut self, filter: &PairFilter, frames: &[&CurveSet]) -> bool {
        if matches!(filter, PairFilter::Images(_)) {
            let all = vec![true; frames[0].len()];
            return std::mem::replace(&mut self.needed, all).len() != self.needed.len();
        }
        let mut boxes = frames[0].coarse_boxes();
        for frame in &frames[1..] {
            for (b, other) in boxes.iter_mut().zip(frame.coarse_boxes()) {
                *b = b.union(&other);
            }
        }
        let own: Vec<usize> = (0..boxes.len())
            .filter(|&i| filter.contains(i as u32, i as u32))
            .collect();
        let regions: Vec<Box3> = own
            .chunks(own.len().div_ceil(REGIONS).max(1))
            .map(|curves| {
                let bounds = curves.iter().map(|&i| boxes[i]);
                bounds.fold(Box3::EMPTY, |a, b| a.union(&b))
            })
            .collect();
        let near = |regions: &[Box3]| -> Vec<bool> {
            let near = |b: &Box3| regions.iter().any(|region| region.overlaps(b));
            boxes.iter().map(near).collect()
        };
        let count = |needed: &[bool]| needed.iter().filter(|needed| **needed).count();
        let needed = near(&regions);
        let known = self.needed.len() == needed.len()
            && needed
                .iter()
                .zip(&self.needed)
                .all(|(now, known)| known >= now);
        if known && count(&self.needed) <= SUPERFLUOUS * count(&needed) {
            return false;
        }
        let grown = |b: &Box3| b.dilated(MARGIN * b.largest_side());
        let now = near(&regions.iter().map(grown).collect::<Vec<Box3>>());
        std::mem::replace(&mut self.needed, now) != self.needed
    }

    /// Returns the leaves of the needed curves.
    pub fn leaves<S: Leaves>(&self, leaves: S) -> NearbyLeaves<'_, S> {
        NearbyLeaves {
            leaves,
            needed: &self.needed,
        }
    }
}

/// Boxes of the curves that a filter needs. The others have no tree.
#[derive(Clone, Copy)]
pub(crate) struct NearbyLeaves<'a, S> {
    leaves: S,
    needed: &'a [bool],
}

impl<S: Leaves> Leaves for NearbyLeaves<'_, S> {
    fn curves(&self) -> &[crate::curve::Curve] {
        self.leaves.curves()
    }

    fn has_tree(&self, i: usize) -> bool {
        self.needed[i] && self.leaves.has_tree(i)
    }

    fn stored(&self, segments: u32) -> bool {
        self.leaves.stored(segments)
    }

    #[inline(always)]
    fn boxes(&self, i: usize, g: usize) -> crate::curve::BoxGroup {
        self.leaves.boxes(i, g)
    }
}
