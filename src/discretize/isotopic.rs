//! Discretization of closed splines into polylines of the same knot type.
//!
//! The polylines of [`homotopic_polylines`](super::homotopic_polylines) keep linking numbers only:
//! a curve may pass through itself on the way to its polyline.
//!
//! # Proof: the polylines are isotopic to the curves
//!
//! The pieces of the curves meet two conditions. The hulls of two pieces that are not neighbours
//! are apart. Two neighbours are monotonic along a common axis: their control points are in order
//! along it, with the joint between them. Move all points of a piece straight to its chord, at the
//! same height along an axis of the piece. The points stay in the hull of the piece, and at
//! different heights, so that the piece never meets itself. Pieces that are not neighbours do not
//! meet, as their hulls do not. The hulls of neighbours are on different sides of the plane through
//! their joint, and meet only there.

use super::MAX_LEVEL;
use super::hulls::{Hull, separation_margin};
use crate::curve::vector::{hypot, per_axis};
use crate::curve::{Basis, Box3, CurveSet, Point, Positions, bounds, sub_segment};
use crate::pairs::{LinkSearch, closest_of_segments};
use crate::verdict::{Defect, DefectKind};

/// Maximum number of pieces. More are needed only if curves are nearly in contact.
const MOST_PIECES: usize = 1 << 24;

/// A piece of a segment: the range of its parameter between two exact fractions.
#[derive(Clone, Copy)]
struct Piece {
    curve: u32,
    segment: u32,
    range: [f64; 2],
    hull: Hull,
}

impl Piece {
    fn new(set: &CurveSet, curve: u32, segment: u32, range: [f64; 2]) -> Piece {
        let whole = set.segment(curve as usize, segment as usize);
        let hull = Hull::of_piece(&sub_segment(&whole, range[0], range[1]));
        Piece {
            curve,
            segment,
            range,
            hull,
        }
    }

    /// Returns true if the piece cannot be split further.
    fn is_short(&self) -> bool {
        self.range[1] - self.range[0] <= 0.5f64.powi(MAX_LEVEL as i32)
    }

    fn chord(&self) -> f64 {
        let [a, b] = [0, 3].map(|k| self.hull.point(k));
        hypot(per_axis(|x| b[x] - a[x]))
    }
}

/// Replaces closed splines by polylines that are isotopic to them, all together. Returns them with
/// the segment to which each edge belongs.
///
/// # Errors
///
/// The first pair of segments that stay too close, or the segments of a cusp.
pub(crate) fn isotopic_polylines(set: &CurveSet) -> Result<(CurveSet, Vec<Vec<u32>>), Defect> {
    let margin = separation_margin(set.max_abs(), set.pad());
    let mut pieces: Vec<Piece> = Vec::new();
    for (i, curve) in (0..).zip(set.curves()) {
        pieces.extend((0..curve.segments).map(|s| Piece::new(set, i, s, [0.0, 1.0])));
    }
    loop {
        let split = match to_split(&pieces, margin) {
            Ok(split) => split,
            Err([a, b]) => {
                let [a, b] = [&pieces[a], &pieces[b]];
                let (i, j) = (a.curve, b.curve);
                let segments = [a.segment, b.segment];
                let place = closest_of_segments(set, [i as usize, j as usize], segments);
                return Err(Defect::of_pair((i, j), DefectKind::TooClose, place));
            }
        };
        if !split.contains(&true) {
            break;
        }
        let mut next = Vec::with_capacity(pieces.len());
        for (p, split) in pieces.iter().zip(split) {
            let [start, end] = p.range;
            let middle = 0.5 * (start + end);
            match split {
                false => next.push(*p),
                true => next.extend(
                    [[start, middle], [middle, end]]
                        .map(|range| Piece::new(set, p.curve, p.segment, range)),
                ),
            }
        }
        pieces = next;
    }
    let mut segments = vec![Vec::new(); set.len()];
    let mut xyz = Vec::with_capacity(3 * pieces.len());
    for p in &pieces {
        segments[p.curve as usize].push(p.segment);
        xyz.extend(p.hull.point(0));
    }
    let counts: Vec<i32> = segments.iter().map(|s| -(s.len() as i32)).collect();
    let polylines = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz));
    let polylines = polylines.expect("closed curves have three pieces at least");
    Ok((polylines, segments))
}

/// Returns for each piece if it must be split, or two pieces that cannot be split further.
fn to_split(pieces: &[Piece], margin: f64) -> Result<Vec<bool>, [usize; 2]> {
    let mut next = Vec::with_capacity(pieces.len());
    for curve in pieces.chunk_by(|a, b| a.curve == b.curve) {
        let (first, count) = (next.len(), curve.len());
        next.extend((1..=count).map(|k| first + k % count));
    }
    let boxed = |p: &Piece| {
        let points: [Point; 4] = [0, 1, 2, 3].map(|k| p.hull.point(k));
        let [lo, hi] = bounds(points);
        Box3::around([lo.map(|x| x - 2.0 * margin), hi.map(|x| x + 2.0 * margin)])
    };
    let boxes: Vec<Box3> = pieces.iter().map(boxed).collect();
    let turns = (0..pieces.len()).filter(|&k| {
        let neighbours = [pieces[k].hull, pieces[next[k]].hull];
        !Hull::are_monotonic(&[neighbours], margin)
    });
    let turns: Vec<[usize; 2]> = turns.map(|k| [k, next[k]]).collect();
    let mut search = LinkSearch::default();
    let near = search.find(&boxes).iter();
    let near = near.map(|&(a, b)| [a as usize, b as usize]);
    let near = near.filter(|&[a, b]| {
        let apart = pieces[a].hull.separated(&pieces[b].hull, margin);
        next[a] != b && next[b] != a && !apart
    });
    let mut split = vec![false; pieces.len()];
    for [a, b] in near.chain(turns) {
        let [long, short] = match pieces[a].chord() >= pieces[b].chord() {
            true => [a, b],
            false => [b, a],
        };
        if pieces[long].is_short() || pieces.len() > MOST_PIECES {
            return Err([a, b]);
        }
        split[long] = true;
        let alike = pieces[short].chord() > 0.5 * pieces[long].chord();
        split[short] |= alike && !pieces[short].is_short();
    }
    Ok(split)
}
