//! Discretization of one pair of curves, only where they come near one another.

use super::hulls::{separated, separation_margin};
use super::{MAX_FRONT, MAX_LEVEL};
use crate::curve::{CurveSet, Point, point_at, sub_segment};

/// Parameters at which segments of one curve are split, as the pair needs it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Splits {
    /// Segment and parameter, sorted.
    at: Vec<(u32, f64)>,
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

/// Two pieces whose volumes meet: segment and index of the piece at the current level, for both curves.
#[derive(Clone, Copy)]
struct Overlap {
    segments: [u32; 2],
    pieces: [u64; 2],
}

/// Splits segments of the curves `i` and `j` until no two pieces' hulls meet.
///
/// `overlaps` lists all segment pairs whose boxes meet in space; all others are apart already. Every piece of
/// a split segment takes part in the final polyline of the pair, so candidates are evaluated only after this.
/// On `Err`, the two segments that stay too close.
pub(crate) fn refine_pair(
    set: &CurveSet,
    [i, j]: [usize; 2],
    overlaps: &[(u32, u32)],
    splits: &mut [Splits; 2],
) -> Result<(), [u32; 2]> {
    splits.iter_mut().for_each(Splits::clear);
    let margin = separation_margin(set.max_abs(), set.pad());
    let mut front: Vec<Overlap> = overlaps
        .iter()
        .filter(|&&(s, t)| {
            !separated(
                &set.segment(i, s as usize),
                &set.segment(j, t as usize),
                margin,
            )
        })
        .map(|&(s, t)| Overlap {
            segments: [s, t],
            pieces: [0, 0],
        })
        .collect();
    let mut level = 0;
    while let Some(first) = front.first() {
        if level == MAX_LEVEL || front.len() > MAX_FRONT {
            return Err(first.segments);
        }
        // Length of a half in the parameter of the whole segment: a power of two, so products are exact.
        let half = 0.5f64.powi(level as i32 + 1);
        let mut next = Vec::new();
        for o in &front {
            let halves = [(i, 0), (j, 1)].map(|(curve, side)| {
                let (s, piece) = (o.segments[side], o.pieces[side]);
                splits[side].at.push((s, (2 * piece + 1) as f64 * half));
                let b = set.segment(curve, s as usize);
                [2 * piece, 2 * piece + 1]
                    .map(|k| (k, sub_segment(&b, k as f64 * half, (k + 1) as f64 * half)))
            });
            for (k, a) in &halves[0] {
                for (l, b) in &halves[1] {
                    if !separated(a, b, margin) {
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
        level += 1;
    }
    Ok(())
}
