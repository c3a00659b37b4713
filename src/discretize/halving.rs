//! Subdivision of segments of two curves until the volumes of their pieces are apart.

use super::MAX_FRONT;
use crate::curve::{Bezier, CurveSet, Point, point_at, sub_segment};

/// Parameters at which the segments of one curve are split for a pair of curves.
#[derive(Debug, Default)]
pub(crate) struct Splits {
    /// Segment and parameter, sorted.
    pub at: Vec<(u32, f64)>,
    /// One bit per segment, set if the segment is split.
    marked: Vec<u64>,
}

impl Splits {
    /// Removes all splits.
    pub fn clear(&mut self) {
        for &(segment, _) in &self.at {
            if let Some(word) = self.marked.get_mut(segment as usize / 64) {
                *word = 0;
            }
        }
        self.at.clear();
    }

    /// Sets the bits for [`Splits::splits`], for a curve with this number of segments.
    fn mark(&mut self, segments: u32) {
        let words = segments.div_ceil(64) as usize;
        if self.marked.len() < words {
            self.marked.resize(words, 0);
        }
        for &(segment, _) in &self.at {
            self.marked[segment as usize / 64] |= 1 << (segment % 64);
        }
    }

    fn of(&self, segment: u32) -> &[(u32, f64)] {
        let start = self.at.partition_point(|s| s.0 < segment);
        let end = start + self.at[start..].partition_point(|s| s.0 == segment);
        &self.at[start..end]
    }

    /// Returns true if a segment is split.
    #[inline(always)]
    pub fn splits(&self, segment: u32) -> bool {
        let word = self.marked.get(segment as usize / 64);
        word.is_some_and(|word| word >> (segment % 64) & 1 != 0)
    }

    /// Replaces `out` by the vertices of the polyline of segment `s` of curve `i`, including its
    /// ends.
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

/// Sorts splits, and removes those that are there twice.
pub(crate) fn sort_splits(splits: &mut Vec<(u32, f64)>) {
    splits.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    splits.dedup();
}

/// Visits the knots and the splits, which are sorted, of a curve in their order, except for the end
/// of its last segment: segments and points.
pub(crate) fn vertices(
    set: &CurveSet,
    curve: usize,
    splits: &[(u32, f64)],
    mut visit: impl FnMut(u32, Point),
) {
    let mut splits = splits.iter().peekable();
    for s in 0..set.curve(curve).segments {
        visit(s, set.knot(curve, s as usize));
        let mut whole = None;
        while let Some((_, t)) = splits.next_if(|split| split.0 == s) {
            let whole = whole.get_or_insert_with(|| set.segment(curve, s as usize));
            visit(s, point_at(whole, *t));
        }
    }
}

/// Two pieces with overlapping volumes: segments, and indices of the pieces at the current level,
/// for both curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Overlap {
    segments: [u32; 2],
    pieces: [u64; 2],
}

/// Maximum number of overlapping pieces of two segments, if the result need not be a proof. Two
/// segments that run along one another have more, and each halving would double their number.
pub(super) const GRAZING: usize = 64;

/// Two curves whose segments are halved, and when that ends.
pub(super) struct Subdivided<'a, const N: usize> {
    /// The curves, at one time or at several times.
    pub frames: [&'a CurveSet; N],
    /// Their indices.
    pub curves: [usize; 2],
    /// Maximum number of rounds.
    pub most_rounds: u32,
    /// Maximum number of overlapping pieces. If it is `None`, it is [`MAX_FRONT`], and the result
    /// is a proof. Otherwise, two segments with more than [`GRAZING`] overlapping pieces are not
    /// halved further.
    pub most_overlaps: Option<usize>,
}

/// Buffers and result of the subdivision.
#[derive(Debug, Default)]
pub(crate) struct Halving {
    /// Splits of both curves.
    pub splits: [Splits; 2],
    /// Number of rounds of the last subdivision.
    pub rounds: u32,
    front: Vec<Overlap>,
    next: Vec<Overlap>,
}

impl Halving {
    /// Splits segments of two curves until no two volumes of pieces meet. Returns two segments if
    /// they stay too close (the splits then prove nothing).
    ///
    /// `meeting` lists all segment pairs with overlapping volumes, sorted. `volume` returns a
    /// convex set that contains a piece, given the piece in all frames and its ends along the
    /// curve. `apart` returns true if two volumes are apart by more than rounding errors.
    pub(super) fn halve<V, const N: usize>(
        &mut self,
        subdivided: Subdivided<'_, N>,
        meeting: &[(u32, u32)],
        volume: impl Fn(&[Bezier; N], [f64; 2]) -> V,
        apart: impl Fn(&V, &V) -> bool,
    ) -> Result<(), [u32; 2]> {
        let Subdivided {
            frames,
            curves,
            most_rounds,
            most_overlaps,
        } = subdivided;
        let Halving {
            splits,
            rounds,
            front,
            next,
        } = self;
        splits.iter_mut().for_each(Splits::clear);
        front.clear();
        front.extend(meeting.iter().map(|&(s, t)| Overlap {
            segments: [s, t],
            pieces: [0, 0],
        }));
        *rounds = 0;
        while !front.is_empty() {
            if *rounds == most_rounds || front.len() > most_overlaps.unwrap_or(MAX_FRONT) {
                // The minimum does not depend on the order in which pairs were found.
                return Err(front.iter().min().map_or([0, 0], |o| o.segments));
            }
            // Length of a half in the parameter of the whole segment. It is a power of two, so
            // products are exact.
            let half = 0.5f64.powi(*rounds as i32 + 1);
            *rounds += 1;
            next.clear();
            for o in front.iter() {
                let halves = [0, 1].map(|side| {
                    let (s, piece) = (o.segments[side], o.pieces[side]);
                    splits[side].at.push((s, (2 * piece + 1) as f64 * half));
                    let whole = frames.map(|set| set.segment(curves[side], s as usize));
                    [2 * piece, 2 * piece + 1].map(|k| {
                        let ends = [k, k + 1].map(|k| k as f64 * half);
                        let parts = whole.map(|b| sub_segment(&b, ends[0], ends[1]));
                        (k, volume(&parts, ends.map(|at| f64::from(s) + at)))
                    })
                });
                for (k, a) in &halves[0] {
                    for (l, b) in &halves[1] {
                        if !apart(a, b) {
                            let (segments, pieces) = (o.segments, [*k, *l]);
                            next.push(Overlap { segments, pieces });
                        }
                    }
                }
            }
            // A piece that overlaps several others was split once for each of them.
            for splits in splits.iter_mut() {
                sort_splits(&mut splits.at);
            }
            front.clear();
            let of_segments = next.chunk_by(|a, b| a.segments == b.segments);
            let few = |o: &&[Overlap]| most_overlaps.is_none() || o.len() <= GRAZING;
            front.extend(of_segments.filter(few).flatten());
        }
        for (splits, curve) in splits.iter_mut().zip(curves) {
            splits.mark(frames[0].curve(curve).segments);
        }
        Ok(())
    }
}
