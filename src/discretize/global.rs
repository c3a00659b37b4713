//! Algorithm 3 of Qu & James 2021 as published: polylines for all curves at once.
//!
//! Passes over all potential links: segments of different curves whose tight boxes overlap are halved, until
//! none do. Changed here: candidates come from the trees over each curve instead of a new tree a pass (a
//! half's box lies in the box of the whole, so only pairs of halves of overlapping pairs can overlap), and
//! boxes are padded by the rounding bound.
//!
//! Cost: one box test for every pair of segments whose boxes overlap, and again for their halves. The pair-wise
//! way ([`super::refine_pair`]) adds about a hundredth of the points on garments.

use super::hulls::{boxes_apart, separation_margin, tight_bounds};
use super::{MAX_FRONT, MAX_LEVEL};
use crate::curve::{Basis, Bezier, Bounds, CurveSet, Positions, Precision, sub_segment};
use crate::error::Result;
use crate::pairs::{Pair, Trees, overlapping_segments, potential_links};
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

/// A piece of a segment: curve, segment, index among the `2^level` pieces.
type Piece = (u32, u32, u64);

/// Discretizes all curves of a frame (open ones into their chords).
///
/// Errors: none of its own; the result has more points than `u32` can count only where the input nearly has.
pub fn homotopic_polylines(set: &CurveSet) -> Result<Polylines> {
    let mut trees = Trees::default();
    trees.refit(set);
    let pairs = potential_links(trees.roots());
    let margin = separation_margin(set.max_abs(), set.pad());
    let mut overlaps = 0;
    let mut passes = 1;
    let mut too_close = Vec::new();
    let mut splits: Vec<Vec<(u32, f64)>> = vec![Vec::new(); set.len()];
    if !set.basis().is_polyline() {
        let refined: Vec<Refined> = pairs
            .par_iter()
            .map(|&pair| refine(set, &trees, pair, margin))
            .collect();
        for (&(i, j), r) in pairs.iter().zip(&refined) {
            overlaps += r.overlaps;
            passes = passes.max(r.passes);
            for &(curve, segment, t) in &r.splits {
                splits[curve as usize].push((segment, t));
            }
            if let Some(segments) = r.too_close {
                let (point, distance) = crate::pairs::closest_of_segments(
                    set,
                    (i as usize, segments[0]),
                    (j as usize, segments[1]),
                );
                too_close.push(Defect {
                    i,
                    j: Some(j),
                    kind: DefectKind::TooClose,
                    place: crate::verdict::Place {
                        segments,
                        point,
                        distance,
                    },
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
    overlaps: usize,
    passes: u32,
    splits: Vec<(u32, u32, f64)>,
    too_close: Option<[u32; 2]>,
}

fn refine(set: &CurveSet, trees: &Trees, (i, j): Pair, margin: f64) -> Refined {
    let curves = [i, j];
    let whole = |curve: u32, s: u32| set.segment(curve as usize, s as usize);
    let mut front: Vec<[Piece; 2]> = overlapping_segments(set, trees, i as usize, j as usize)
        .into_iter()
        .filter(|&(s, t)| meet(&whole(i, s), &whole(j, t), margin))
        .map(|(s, t)| [(i, s, 0), (j, t, 0)])
        .collect();
    let mut out = Refined {
        overlaps: front.len(),
        passes: 1,
        splits: Vec::new(),
        too_close: None,
    };
    for level in 0.. {
        let Some(first) = front.first() else { break };
        if level == MAX_LEVEL || front.len() > MAX_FRONT {
            out.too_close = Some([first[0].1, first[1].1]);
            // They would prove nothing, and there may be millions.
            out.splits.clear();
            break;
        }
        out.passes = level + 2;
        let half = 0.5f64.powi(level as i32 + 1);
        let mut next = Vec::new();
        for pieces in &front {
            let halves = [0, 1].map(|side| {
                let (_, s, k) = pieces[side];
                out.splits
                    .push((curves[side], s, (2 * k + 1) as f64 * half));
                let b = whole(curves[side], s);
                [2 * k, 2 * k + 1].map(|k| {
                    let bounds =
                        tight_bounds(&sub_segment(&b, k as f64 * half, (k + 1) as f64 * half));
                    ((curves[side], s, k), bounds)
                })
            });
            for (p, a) in &halves[0] {
                for (q, b) in &halves[1] {
                    if !boxes_apart(a, b, margin) {
                        next.push([*p, *q]);
                    }
                }
            }
        }
        front = next;
    }
    out
}

fn meet(a: &Bezier, b: &Bezier, margin: f64) -> bool {
    let (a, b): (Bounds, Bounds) = (tight_bounds(a), tight_bounds(b));
    !boxes_apart(&a, &b, margin)
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
