//! Common refinement of two curves that differ in their numbers of points, so that the motion from
//! one to the other is defined.
//!
//! The point at a share of all segments of one curve moves straight to the point at the same share
//! of the other one. The ends of all segments of both curves cut each of them into the same number
//! of pieces. Splines are cut in Bezier form, in which the straight motion of the control points is
//! the straight motion of all points of the curve. The pieces are the curve itself, apart from
//! rounding errors in double precision. The linking numbers of a step do not depend on them.

use crate::curve::vector::mix;
use crate::curve::{Basis, CurveSet, Point, Positions, sub_segment};
use crate::error::{Error, Result};

/// A set of curves that are cut into pieces.
pub(super) struct Refined {
    /// The pieces: polylines, or Bezier curves.
    pub set: CurveSet,
    /// For each curve, the segment of each piece.
    segments: Vec<Vec<u32>>,
}

impl Refined {
    /// Returns the segment to which a piece of curve `i` belongs.
    pub fn segment(&self, i: u32, piece: u32) -> u32 {
        let pieces = &self.segments[i as usize];
        pieces.get(piece as usize).copied().unwrap_or(piece)
    }
}

/// Returns two sets of the same curves, cut into the same pieces.
pub(super) fn refine(a: &CurveSet, b: &CurveSet) -> Result<[Refined; 2]> {
    let cuts: Vec<Vec<[u64; 2]>> = (0..a.len())
        .map(|i| cuts(a.curve(i).segments, b.curve(i).segments))
        .collect();
    Ok([cut(a, b, &cuts)?, cut(b, a, &cuts)?])
}

/// Returns the starts and the end of all pieces, as shares of `n m`, sorted. Every piece lies in
/// one segment of either curve.
fn cuts(n: u32, m: u32) -> Vec<[u64; 2]> {
    let (n, m) = (u64::from(n), u64::from(m));
    let mut cuts: Vec<u64> = (0..=n)
        .map(|k| k * m)
        .chain((0..=m).map(|k| k * n))
        .collect();
    cuts.sort_unstable();
    cuts.dedup();
    cuts.windows(2).map(|e| [e[0], e[1]]).collect()
}

/// Cuts the curves of `set`.
fn cut(set: &CurveSet, other: &CurveSet, cuts: &[Vec<[u64; 2]>]) -> Result<Refined> {
    let straight = set.basis().is_polyline();
    let stride = if straight { 1 } else { 3 };
    let mut points: Vec<Point> = Vec::new();
    let (mut counts, mut segments) = (Vec::new(), Vec::new());
    for (i, pieces) in cuts.iter().enumerate() {
        let curve = set.curve(i);
        // Length of a segment in the units of the cuts.
        let each = u64::from(other.curve(i).segments);
        let mut of_curve = Vec::with_capacity(pieces.len());
        for [from, to] in pieces {
            let s = (from / each) as usize;
            let [t0, t1] = [from, to].map(|x| (x - s as u64 * each) as f64 / each as f64);
            of_curve.push(s as u32);
            match straight {
                true => points.push(mix(set.knot(i, s), set.knot(i, s + 1), t0)),
                false => {
                    let piece = match (t0, t1) {
                        (0.0, 1.0) => set.segment(i, s),
                        _ => sub_segment(&set.segment(i, s), t0, t1),
                    };
                    points.extend(&piece[..3]);
                }
            }
        }
        if !curve.closed {
            points.push(set.knot(i, curve.segments as usize));
        }
        let count = stride * pieces.len() + usize::from(!curve.closed);
        let count = i32::try_from(count).map_err(|_| Error::Count {
            what: "points of the pieces of a curve",
            promised: count as u64,
            available: i32::MAX as u64,
        })?;
        counts.push(if curve.closed { -count } else { count });
        segments.push(of_curve);
    }
    let basis = if straight {
        Basis::Polyline
    } else {
        Basis::Bezier
    };
    let set = CurveSet::from_counts(basis, &counts, Positions::F64(points.as_flattened()))?;
    Ok(Refined { set, segments })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::vector::{hypot, sub};
    use crate::random::Random;

    fn curve(basis: Basis, count: i32, seed: u64) -> CurveSet {
        let mut random = Random::new(seed);
        let xyz: Vec<f64> = (0..3 * count.unsigned_abs())
            .map(|_| random.unit())
            .collect();
        CurveSet::from_counts(basis, &[count], Positions::F64(&xyz)).unwrap()
    }

    /// Two curves whose numbers of points have a common divisor, or none, or are equal.
    #[test]
    fn pieces_are_the_curves_and_pair_equal_shares() {
        let pairs = [(-12, -9), (-12, -12), (-15, -21), (7, 13), (10, 4)];
        for basis in Basis::ALL {
            for (n, m) in pairs {
                let (a, b) = (curve(basis, n, 1), curve(basis, m, 2));
                let refined = refine(&a, &b).unwrap();
                let [p, q] = refined.each_ref().map(|r| r.set.curve(0).segments);
                assert_eq!(p, q, "{basis:?}");
                for (set, refined) in [&a, &b].into_iter().zip(&refined) {
                    let segments = set.curve(0).segments as usize;
                    for piece in 0..p {
                        let s = refined.segment(0, piece) as usize;
                        // The piece starts at its place in the segment, known by counting.
                        let start = refined.set.knot(0, piece as usize);
                        let fine = (0..=1000).map(|k| set.eval(0, s, f64::from(k) / 1000.0));
                        let off = fine.map(|p| hypot(sub(p, start))).fold(f64::MAX, f64::min);
                        assert!(off < 5e-3, "{basis:?}, piece {piece} of {segments}: {off}");
                    }
                }
            }
        }
    }
}
