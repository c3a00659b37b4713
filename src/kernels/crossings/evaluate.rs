//! Evaluation of candidates: eight at a time in floating point. Candidates that this does not
//! decide are evaluated one at a time, exactly.

use super::gather::Task;
use crate::curve::{Knots, Point, ReadKnots, bounds};
use crate::discretize::{Sieve, Splits, pieces_between};
use crate::exact::{
    Batch, BatchOutcome, Crossing, Edges, Predicates, crossing, crossing_of_sums, segments_touch,
    sums_touch,
};
use crate::simd::dispatch_wide;
use crate::verdict::Stats;
use std::ops::ControlFlow;

/// Minimum number of candidates of a task.
const GRAIN: usize = 1 << 14;

/// Maximum number of candidates for which single tests are faster than a batch.
const SINGLE_TESTS: usize = 2;

/// Sum of the signed crossings of one pair of curves in one direction, or of a part of the pair.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SignedCount {
    /// Sum of the signs.
    pub sum: i64,
    /// First pair of segments that touch, in their order along the curves.
    pub contact: Option<[u32; 2]>,
    /// Number of node pairs visited by the descent.
    pub nodes: u64,
    /// Work counters.
    pub stats: Stats,
}

impl SignedCount {
    /// Adds another part of the same pair.
    pub fn merge(&mut self, other: &SignedCount) {
        self.sum += other.sum;
        self.nodes += other.nodes;
        self.stats.add(&other.stats);
        if let Some(segments) = other.contact {
            self.found_contact(segments);
        }
    }

    fn found_contact(&mut self, segments: [u32; 2]) {
        // The minimum in the order of the curves does not depend on the order of the visits.
        self.contact = Some(self.contact.map_or(segments, |c| c.min(segments)));
    }

    /// Adds candidates of whole segments, in parallel tasks.
    pub fn add_shared(&mut self, task: &Task<'_>, tests: &[(u32, u32)]) {
        if tests.len() > GRAIN {
            let (left, right) = tests.split_at(tests.len() / 2);
            let mut other = SignedCount::default();
            rayon::join(
                || self.add_shared(task, left),
                || other.add_shared(task, right),
            );
            return self.merge(&other);
        }
        if task.input.cancelled() {
            return;
        }
        dispatch_wide!(Self::add(self, task, tests));
    }

    /// Adds candidates of whole segments.
    #[inline(always)]
    pub fn add(&mut self, task: &Task<'_>, tests: &[(u32, u32)]) {
        let [upper, lower] = task.curves.map(|i| task.input.set.knots(i, task.axis));
        match (upper, lower) {
            (Knots::F32(p), Knots::F32(q)) => self.add_knots(task, p, q, tests),
            (Knots::F64(p), Knots::F64(q)) => self.add_knots(task, p, q, tests),
            (Knots::ComputedF32(p), Knots::ComputedF32(q)) => self.add_knots(task, p, q, tests),
            (Knots::ComputedF64(p), Knots::ComputedF64(q)) => self.add_knots(task, p, q, tests),
            _ => unreachable!("the curves of a set have one basis and one precision"),
        }
    }

    #[inline(always)]
    fn add_knots<K: ReadKnots>(
        &mut self,
        task: &Task<'_>,
        upper: K,
        lower: K,
        tests: &[(u32, u32)],
    ) {
        self.stats.tests += tests.len() as u64;
        let rounding = task.rounding;
        let mut batch = None;
        for chunk in tests.chunks(8) {
            if chunk.len() <= SINGLE_TESTS && rounding == 0.0 {
                for &(s, t) in chunk {
                    self.add_segments(task, [&upper, &lower], s, t);
                }
                break;
            }
            let batch = match &mut batch {
                Some(batch) if chunk.len() == 8 => batch,
                other => other.insert(Batch::<K::Number>::apart()),
            };
            for (lane, &(s, t)) in chunk.iter().enumerate() {
                for x in 0..3 {
                    let ([p0, p1], [q0, q1]) = (upper.edge(s, x), lower.edge(t, x));
                    batch.ends[0][x][lane] = p0;
                    batch.ends[1][x][lane] = p1;
                    batch.ends[2][x][lane] = q0;
                    batch.ends[3][x][lane] = q1;
                }
            }
            let out = match rounding == 0.0 {
                true => batch.evaluate(),
                false => evaluate_rounded(batch, rounding),
            };
            self.sum += i64::from(out.sum);
            self.stats.crossings += u64::from(out.crossings);
            if out.undecided != 0 {
                for (lane, &(s, t)) in chunk.iter().enumerate() {
                    match out.undecided >> lane & 1 {
                        0 => {}
                        _ if rounding > 0.0 => self.add_sums(task, [s, t]),
                        _ => self.add_segments(task, [&upper, &lower], s, t),
                    }
                }
            }
        }
    }

    /// Adds a single pair of whole segments.
    ///
    /// Segments that touch are detected here. A contact at a vertex is invisible to the crossing
    /// test, which breaks ties by a translation. But touching segments are coplanar and their
    /// projections meet. So floating point proves neither that they are not coplanar nor that one
    /// of them lies on one side of the other, and they always reach this function.
    fn add_segments<K: ReadKnots>(&mut self, task: &Task<'_>, [p, q]: [&K; 2], s: u32, t: u32) {
        let edges = [edge(p, s), edge(q, t)];
        let exact = self.stats.exact;
        // The knots are in the frame of the projection, whose last axis is the axis of projection.
        self.add_edges(&edges, 2, [s, t]);
        // Exact calls of the contact test are not counted as exact crossing tests. Splines whose
        // chords share a point are too close, which the discretization reports.
        if self.stats.exact > exact
            && task.input.set.basis().is_polyline()
            && segments_touch(&edges)
        {
            self.found_contact([s, t]);
        }
    }

    /// Adds a single pair of whole segments of polylines whose coordinates are rounded sums, by the
    /// exact sums.
    #[cold]
    #[inline(never)]
    fn add_sums(&mut self, task: &Task<'_>, [s, t]: [u32; 2]) {
        let edges = task.input.set.exact_edges(task.curves, [s, t]);
        self.add_crossing(crossing_of_sums(edges, task.axis), [s, t]);
        self.stats.exact += 1;
        if sums_touch(edges) {
            self.found_contact([s, t]);
        }
    }

    /// Adds the candidates of spline segments that the discretization of the pair has split, each
    /// as the polyline that replaces it, and removes them from the list.
    pub fn add_split(
        &mut self,
        task: &Task<'_>,
        tests: &mut Vec<(u32, u32)>,
        splits: &[Splits; 2],
        [upper, lower]: &mut [Vec<Point>; 2],
    ) {
        let set = task.input.set;
        let mut last = None;
        tests.retain(|&(s, t)| {
            if task.input.cancelled() {
                return false;
            }
            if !splits[0].splits(s) && !splits[1].splits(t) {
                return true;
            }
            if last != Some(s) {
                splits[0].polyline(set, task.curves[0], s, upper);
                last = Some(s);
            }
            splits[1].polyline(set, task.curves[1], t, lower);
            let sieve = Shadows { axis: task.axis };
            let _ = pieces_between(upper, lower, &sieve, &mut |p, q| {
                let [a, b] = [p, q].map(|piece| sieve.bounds(piece));
                if !sieve.apart(&a, &b) {
                    self.stats.tests += 1;
                    self.add_edges(&[[p[0], p[1]], [q[0], q[1]]], task.axis, [s, t]);
                }
                ControlFlow::Continue(())
            });
            false
        });
        let added = splits[0].at.len() + splits[1].at.len();
        self.stats.refined += added as u64;
    }

    fn add_edges(&mut self, edges: &Edges, axis: usize, segments: [u32; 2]) {
        let mut predicates = Predicates::default();
        self.add_crossing(crossing(edges, axis, &mut predicates), segments);
        // A test counts once, however many of its determinants are close to zero.
        self.stats.exact += u64::from(predicates.exact > 0);
    }

    fn add_crossing(&mut self, crossing: Crossing, segments: [u32; 2]) {
        match crossing {
            Crossing::None => {}
            Crossing::Over(sign) => {
                self.sum += i64::from(sign);
                self.stats.crossings += 1;
            }
            Crossing::Contact => self.found_contact(segments),
        }
    }
}

/// Evaluates a batch of rounded sums. Not inlined, so that the code for other coordinates stays
/// small.
#[inline(never)]
fn evaluate_rounded<T: Copy + Into<f64> + From<u8>>(
    batch: &Batch<T>,
    rounding: f64,
) -> BatchOutcome {
    batch.evaluate_rounded::<true>(rounding)
}

/// Returns the ends of a segment, widened.
#[inline]
fn edge<K: ReadKnots>(knots: &K, s: u32) -> [Point; 2] {
    let [u, v, w] = [knots.edge(s, 0), knots.edge(s, 1), knots.edge(s, 2)];
    let end = |k: usize| [u[k].into(), v[k].into(), w[k].into()];
    [end(0), end(1)]
}

/// Sieve for runs of an upper and a lower polyline. They have no crossing if the boxes of their
/// projections do not overlap, or if the upper run is entirely below the lower one.
///
/// Ties count as overlap, because the translation that breaks them is smaller than every gap.
struct Shadows {
    axis: usize,
}

impl Sieve<Point> for Shadows {
    /// Minimum and maximum of each coordinate.
    type Bounds = [Point; 2];

    #[inline(always)]
    fn bounds(&self, vertices: &[Point]) -> [Point; 2] {
        bounds(vertices.iter().copied())
    }

    #[inline(always)]
    fn apart(&self, [lo, hi]: &[Point; 2], [other_lo, other_hi]: &[Point; 2]) -> bool {
        let (u, v, w) = ((self.axis + 1) % 3, (self.axis + 2) % 3, self.axis);
        let overlap = |x: usize| lo[x] <= other_hi[x] && other_lo[x] <= hi[x];
        !(overlap(u) && overlap(v) && hi[w] >= other_lo[w])
    }
}
