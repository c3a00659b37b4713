//! Algorithm 3 of Qu & James 2021 as published: polylines for all curves at once.
//!
//! Passes over all potential links: segments of different curves whose tight boxes overlap are halved, until
//! none do. Changed here: candidates come from the trees over each curve instead of a new tree a pass (a
//! half's box lies in the box of the whole, so only pairs of halves of overlapping pairs can overlap), and
//! boxes are padded by the rounding bound.
//!
//! Cost: one box test for every pair of segments whose boxes overlap, and again for their halves. The pair-wise
//! way ([`super::Separation`]) adds about a hundredth of the points on garments.

use super::MAX_LEVEL;
use super::halving::Halving;
use super::hulls::{boxes_apart, separation_margin, tight_bounds};
use crate::curve::{Basis, Bounds, CurveSet, Positions, Precision};
use crate::error::Result;
use crate::pairs::{LinkSearch, Pair, Trees, closest_of_segments, overlapping_segments};
use crate::verdict::{Defect, DefectKind};
use rayon::prelude::*;

/// What Algorithm 3 made of a frame.
#[derive(Clone, Debug)]
pub struct Polylines {
    /// The curves as polylines in double precision, link homotopic to the input.
    pub curves: CurveSet,
    /// Segment pairs of the input whose tight boxes overlap.
    pub overlaps: usize,
    /// Passes over the segments.
    pub passes: u32,
    /// Pairs of curves that stayed too close; the polylines prove nothing about them.
    pub too_close: Vec<Defect>,
}

/// Discretizes all curves of a frame (open ones into their chords).
///
/// Errors: none of its own; the result has more points than `u32` can count only where the input nearly has.
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
        let refined: Vec<Refined> = pairs
            .par_iter()
            .map_init(Halving::default, |halving, &pair| {
                refine(set, &trees, pair, margin, halving)
            })
            .collect();
        for (&(i, j), refined) in pairs.iter().zip(&refined) {
            overlaps += refined.overlaps;
            passes = passes.max(refined.passes);
            for (curve, own) in [i, j].into_iter().zip(&refined.splits) {
                splits[curve as usize].extend(own);
            }
            if let Some(segments) = refined.too_close {
                too_close.push(Defect {
                    i,
                    j: Some(j),
                    kind: DefectKind::TooClose,
                    place: closest_of_segments(set, [i, j].map(|c| c as usize), segments),
                });
            }
        }
    }
    splits.par_iter_mut().for_each(|s| {
        s.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        s.dedup();
    });
    Ok(Polylines {
        curves: polylines(set, &splits)?,
        overlaps,
        passes,
        too_close,
    })
}

/// What one pair asks for.
struct Refined {
    /// Segment pairs whose tight boxes overlap.
    overlaps: usize,
    passes: u32,
    /// Splits of both curves; none where the pair stays too close.
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
    let apart = |a: &Bounds, b: &Bounds| boxes_apart(a, b, margin);
    let mut meeting = overlapping_segments(set, trees, curves[0], curves[1]);
    let whole = |i: usize, s: u32| tight_bounds(&set.segment(i, s as usize));
    meeting.retain(|&(s, t)| !apart(&whole(curves[0], s), &whole(curves[1], t)));
    let outcome = halving.halve(set, curves, &meeting, tight_bounds, apart);
    // Splits of a pair that stays too close would prove nothing, and there may be millions.
    let splits = match outcome {
        Ok(_) => halving.splits.each_ref().map(|s| s.at.clone()),
        Err(_) => Default::default(),
    };
    Refined {
        overlaps: meeting.len(),
        passes: 1 + outcome.unwrap_or(MAX_LEVEL),
        splits,
        too_close: outcome.err(),
    }
}

/// The curves as polylines through all knots and splits.
fn polylines(set: &CurveSet, splits: &[Vec<(u32, f64)>]) -> Result<CurveSet> {
    let added: usize = splits.iter().map(Vec::len).sum();
    let mut builder = CurveSet::builder(
        Basis::Polyline,
        Precision::F64,
        set.segments() + added + 8 * set.len(),
    );
    let mut xyz: Vec<f64> = Vec::new();
    for (i, c) in set.curves().iter().enumerate() {
        xyz.clear();
        let mut rest = splits[i].iter().peekable();
        for s in 0..c.segments {
            xyz.extend(set.knot(i, s as usize));
            while let Some(&(_, t)) = rest.next_if(|&&(at, _)| at == s) {
                xyz.extend(set.eval(i, s as usize, t));
            }
        }
        if !c.closed {
            xyz.extend(set.knot(i, c.segments as usize));
        }
        builder.start_curve(xyz.len() / 3, c.closed)?;
        builder.push(Positions::F64(&xyz))?;
    }
    builder.finish()
}
