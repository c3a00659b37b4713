//! Algorithm 3 of Qu & James 2021 as published: polylines of all curves at once.
//!
//! The algorithm makes passes over all potential links. Segments of different curves with
//! overlapping tight boxes are halved until no such boxes overlap. There are two changes:
//! candidates come from the trees of the curves instead of a new tree per pass (the box of a half
//! lies in the box of the whole, so only halves of overlapping pairs can overlap), and boxes are
//! padded by the rounding error bound.
//!
//! Cost: one box test for every pair of segments with overlapping boxes, and again for their
//! halves. The pairwise algorithm ([`super::Separation`]) adds about a hundredth of the points on
//! garments.

use super::MAX_LEVEL;
use super::halving::{Halving, Subdivided, sort_splits, vertices};
use super::hulls::{separation_margin, tight_bounds};
use crate::curve::{Basis, Bezier, CurveSet, Point, Positions, Precision, boxes_apart};
use crate::error::Result;
use crate::pairs::{LinkSearch, Pair, Trees, closest_of_segments, overlapping_segments};
use crate::verdict::{Defect, DefectKind};
use rayon::prelude::*;

/// Result of Algorithm 3 for a frame.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Polylines {
    /// The curves as polylines in double precision, link homotopic to the input.
    pub curves: CurveSet,
    /// Number of segment pairs of the input with overlapping tight boxes.
    pub overlaps: usize,
    /// Number of passes over the segments.
    pub passes: u32,
    /// Pairs of curves that stayed too close. The polylines prove nothing about these pairs.
    pub too_close: Vec<Defect>,
}

/// Discretizes all curves of a frame (open curves into their chords).
///
/// # Errors
///
/// The result has more points than `u32` can count, which requires an input of nearly that size.
pub fn homotopic_polylines(set: &CurveSet) -> Result<Polylines> {
    let mut trees = Trees::default();
    trees.refit(set);
    let mut search = LinkSearch::default();
    let pairs = &*search.find(trees.roots());
    let margin = separation_margin(set.max_abs(), set.pad());
    let mut overlaps = 0;
    let mut passes = 1;
    let mut too_close = Vec::new();
    let mut splits: Vec<Vec<(u32, f64)>> = vec![Vec::new(); set.len()];
    if !set.basis().is_polyline() {
        let refine = |halving: &mut _, &pair: &Pair| refine(set, &trees, pair, margin, halving);
        let refined = pairs.par_iter().map_init(Halving::default, refine);
        let refined: Vec<Refined> = refined.collect();
        for (&(i, j), refined) in pairs.iter().zip(&refined) {
            overlaps += refined.overlaps;
            passes = passes.max(refined.passes);
            for (curve, added) in [i, j].into_iter().zip(&refined.splits) {
                splits[curve as usize].extend(added);
            }
            if let Some(segments) = refined.too_close {
                let place = closest_of_segments(set, [i, j].map(|c| c as usize), segments);
                too_close.push(Defect::of_pair((i, j), DefectKind::TooClose, place));
            }
        }
    }
    splits.par_iter_mut().for_each(sort_splits);
    Ok(Polylines {
        curves: polylines(set, &splits)?,
        overlaps,
        passes,
        too_close,
    })
}

/// Refinement of one pair of curves.
struct Refined {
    /// Number of segment pairs with overlapping tight boxes.
    overlaps: usize,
    passes: u32,
    /// Splits of both curves. Empty if the pair stays too close.
    splits: [Vec<(u32, f64)>; 2],
    too_close: Option<[u32; 2]>,
}

fn refine(
    set: &CurveSet,
    trees: &Trees,
    (i, j): Pair,
    margin: f64,
    halving: &mut Halving,
) -> Refined {
    let curves = [i as usize, j as usize];
    let apart = |a: &[Point; 2], b: &[Point; 2]| boxes_apart([a, b], 2.0 * margin);
    let mut meeting = overlapping_segments(set, trees, curves[0], curves[1]);
    let whole = |i: usize, s: u32| tight_bounds(&set.segment(i, s as usize));
    meeting.retain(|&(s, t)| !apart(&whole(curves[0], s), &whole(curves[1], t)));
    let volume = |[piece]: &[Bezier; 1], _| tight_bounds(piece);
    let subdivided = Subdivided {
        frames: [set],
        curves,
        most_rounds: MAX_LEVEL,
        most_overlaps: None,
    };
    let outcome = halving.halve(subdivided, &meeting, volume, apart);
    // Splits of a pair that stays too close prove nothing, and there may be millions of them.
    let splits = match outcome {
        Ok(()) => halving.splits.each_ref().map(|s| s.at.clone()),
        Err(_) => Default::default(),
    };
    Refined {
        overlaps: meeting.len(),
        passes: 1 + halving.rounds,
        splits,
        too_close: outcome.err(),
    }
}

/// Returns the polylines through all knots and splits.
pub(super) fn polylines(set: &CurveSet, splits: &[Vec<(u32, f64)>]) -> Result<CurveSet> {
    let added: usize = splits.iter().map(Vec::len).sum();
    let points = set.segments() + added + set.len();
    let mut builder = CurveSet::builder(Basis::Polyline, Precision::F64, points);
    let mut xyz: Vec<f64> = Vec::new();
    for (i, c) in set.curves().iter().enumerate() {
        xyz.clear();
        vertices(set, i, &splits[i], |_, p| xyz.extend(p));
        if !c.closed {
            xyz.extend(set.knot(i, c.segments as usize));
        }
        builder.start_curve(xyz.len() / 3, c.closed)?;
        builder.push(Positions::F64(&xyz))?;
    }
    builder.finish()
}
