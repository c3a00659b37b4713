//! Halving segments of two curves until the volumes of their pieces are apart.

use super::{MAX_FRONT, MAX_LEVEL};
use crate::curve::{Bezier, CurveSet, Point, point_at, sub_segment};

/// Parameters at which segments of one curve are split, as the pair needs it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Splits {
    /// Segment and parameter, sorted.
    pub at: Vec<(u32, f64)>,
}

impl Splits {
    /// Whether no segment is split.
    pub fn is_empty(&self) -> bool {
        self.at.is_empty()
    }

    /// Number of points added.
    pub fn len(&self) -> usize {
        self.at.len()
    }

    /// Forgets all splits.
    pub fn clear(&mut self) {
        self.at.clear();
    }

    fn sort(&mut self) {
        self.at
            .sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        self.at.dedup();
    }

    fn of(&self, segment: u32) -> &[(u32, f64)] {
        let start = self.at.partition_point(|s| s.0 < segment);
        let end = start + self.at[start..].partition_point(|s| s.0 == segment);
        &self.at[start..end]
    }

    /// Whether a segment is split.
    pub fn splits(&self, segment: u32) -> bool {
        !self.of(segment).is_empty()
    }

    /// The vertices that stand for segment `s` of curve `i`, ends included.
    pub fn polyline(&self, set: &CurveSet, i: usize, s: u32, out: &mut Vec<Point>) {
        out.clear();
        out.push(set.knot(i, s as usize));
        let splits = self.of(s);
        if !splits.is_empty() {
            let b = set.segment(i, s as usize);
            out.extend(splits.iter().map(|&(_, t)| point_at(&b, t)));
        }
        out.push(set.knot(i, s as usize + 1));
    }
}

/// What halving came to.
pub(super) struct Halving {
    /// Segment pairs whose volumes met at the start.
    pub overlaps: usize,
    /// Rounds, the first look included.
    pub passes: u32,
    /// Two segments that stayed too close, where some did. The splits prove nothing then.
    pub too_close: Option<[u32; 2]>,
}

/// Two pieces whose volumes meet: segment and index of the piece at the current level, for both curves.
#[derive(Clone, Copy)]
struct Overlap {
    segments: [u32; 2],
    pieces: [u64; 2],
}

/// Splits segments of two curves until the volumes of no two pieces meet.
///
/// `overlaps` lists the segment pairs to look at; `volume` gives a convex set that contains a piece, and
/// `apart` tells whether two of them are apart beyond rounding.
pub(super) fn halve<V>(
    set: &CurveSet,
    curves: [usize; 2],
    overlaps: &[(u32, u32)],
    splits: &mut [Splits; 2],
    volume: impl Fn(Bezier) -> V,
    apart: impl Fn(&V, &V) -> bool,
) -> Halving {
    splits.iter_mut().for_each(Splits::clear);
    let whole = |side: usize, s: u32| set.segment(curves[side], s as usize);
    let mut front: Vec<Overlap> = overlaps
        .iter()
        .filter(|&&(s, t)| !apart(&volume(whole(0, s)), &volume(whole(1, t))))
        .map(|&(s, t)| Overlap {
            segments: [s, t],
            pieces: [0, 0],
        })
        .collect();
    let mut out = Halving {
        overlaps: front.len(),
        passes: 1,
        too_close: None,
    };
    for level in 0.. {
        let Some(first) = front.first() else { break };
        if level == MAX_LEVEL || front.len() > MAX_FRONT {
            out.too_close = Some(first.segments);
            break;
        }
        out.passes += 1;
        // Length of a half in the parameter of the whole segment: a power of two, so products are exact.
        let half = 0.5f64.powi(level as i32 + 1);
        let mut next = Vec::new();
        for o in &front {
            let halves = [0, 1].map(|side| {
                let (s, piece) = (o.segments[side], o.pieces[side]);
                splits[side].at.push((s, (2 * piece + 1) as f64 * half));
                let b = whole(side, s);
                [2 * piece, 2 * piece + 1].map(|k| {
                    let part = sub_segment(&b, k as f64 * half, (k + 1) as f64 * half);
                    (k, volume(part))
                })
            });
            for (k, a) in &halves[0] {
                for (l, b) in &halves[1] {
                    if !apart(a, b) {
                        next.push(Overlap {
                            segments: o.segments,
                            pieces: [*k, *l],
                        });
                    }
                }
            }
        }
        // A piece that overlaps several others was split once for each.
        splits.iter_mut().for_each(Splits::sort);
        front = next;
    }
    out
}
