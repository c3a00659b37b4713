//! Crossing of two segments: does one pass over the other, seen along a coordinate axis, and with
//! which sign?
//!
//! A projection along a coordinate axis keeps the input floats, so the predicates decide on the
//! input itself. Ties are broken by one rule, which is stated here only.
//!
//! # The translation rule for ties
//!
//! Ties are decided as if the upper loop were translated by `(e, e^2)` in the projection plane
//! `(u, v)`, with `e` positive and arbitrarily small.
//!
//! 1. The two loops are compact and disjoint, so a small translation changes no linking number.
//! 2. The translations that move a vertex of one loop onto a projected edge of the other, or two
//!    projected edges onto one line, lie on finitely many lines of the plane. The parabola
//!    `(e, e^2)` meets each line in at most two points. So every sufficiently small `e` is in
//!    general position.
//! 3. A determinant `orient2d(edge, vertex)` that is 0 therefore gets the sign of its derivative
//!    along the translation. For an edge of the upper loop with direction `d` that is `sign(d_v)`,
//!    or `-sign(d_u)` if `d_v` is 0. If the vertex belongs to the upper loop, it is the opposite
//!    sign.
//! 4. An edge that projects to a point gives 0 at both ends, so it has no crossing. Two edges that
//!    share a vertex get the same sign for it, so no half-open intervals are needed.

use super::big::{self, BigPredicates};
use super::passage::Edges;
use super::predicates::{ORIENT2D_BOUND, Orientation, Predicates, UNDERFLOW, volume};
use crate::curve::SumEdges;
use std::cmp::Ordering;

/// Result for an upper and a lower segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Crossing {
    /// No crossing, or the upper segment passes below.
    None,
    /// The upper segment passes over the lower one, with this sign (1 or -1).
    Over(i32),
    /// The segments share a point.
    Contact,
}

/// Signs of the translation of the edge relative to the vertex: if the edge, or if the vertex,
/// belongs to the translated loop.
const EDGE: i32 = 1;
const VERTEX: i32 = -EDGE;

/// Returns the side of an edge on which the vertex `p` lies, seen along an axis. Ties are broken by
/// the translation, [`EDGE`] or [`VERTEX`].
#[inline]
fn side<O: Orientation>(
    [e0, e1]: [&O::Point; 2],
    p: &O::Point,
    (u, v): (usize, usize),
    translation: i32,
    predicates: &mut O,
) -> i32 {
    let s = predicates.orient2d([e0, e1, p], (u, v));
    if s != 0 {
        return s;
    }
    // The sign of the comparison, not of the difference, which could underflow.
    let along = |x: usize| O::compare(e1, e0, x) as i32;
    let tie = match along(v) {
        0 => -along(u),
        s => s,
    };
    translation * tie
}

/// Returns the crossing of the first segment, whose passages over the other one are counted, with
/// the second one, seen against the axis `w`.
///
/// The sum of the signs over all segment pairs of two disjoint loops is their linking number, with
/// the sign of the sum in Arai 2013. The crossings in which the first loop is below sum up to the
/// same number, so only those above are counted.
#[inline]
pub(crate) fn crossing([t, u]: &Edges, w: usize, predicates: &mut Predicates) -> Crossing {
    crossing_by([&t[0], &t[1]], [&u[0], &u[1]], w, predicates)
}

/// [`crossing`] of two segments whose coordinates are sums, in big integers.
#[cold]
pub(crate) fn crossing_of_sums([t, u]: SumEdges, w: usize) -> Crossing {
    let [t0, t1, u0, u1] = big::points([t[0], t[1], u[0], u[1]]);
    crossing_by([&t0, &t1], [&u0, &u1], w, &mut BigPredicates)
}

#[inline]
fn crossing_by<O: Orientation>(
    t: [&O::Point; 2],
    u: [&O::Point; 2],
    w: usize,
    predicates: &mut O,
) -> Crossing {
    let plane = ((w + 1) % 3, (w + 2) % 3);
    let before = side(t, u[0], plane, EDGE, predicates);
    let after = side(t, u[1], plane, EDGE, predicates);
    if before == after {
        return Crossing::None;
    }
    let start = side(u, t[0], plane, VERTEX, predicates);
    if start == side(u, t[1], plane, VERTEX, predicates) {
        return Crossing::None;
    }
    // `after` is the sign of the cross product of the directions. The upper segment is above if the
    // ends of the lower one lie on the other side of the plane that the upper one spans with the
    // line of sight.
    let compare = |p, order| u.iter().all(|q| O::compare(p, q, w) == order);
    let all_are = |order| t.iter().all(|p| compare(p, order));
    if all_are(Ordering::Greater) {
        return Crossing::Over(after);
    }
    if all_are(Ordering::Less) {
        return Crossing::None;
    }
    match predicates.orient3d([t[0], t[1], u[0], u[1]]) {
        0 => Crossing::Contact,
        s if s == -after => Crossing::Over(after),
        _ => Crossing::None,
    }
}

/// A batch of eight segment pairs, structure of arrays, in the coordinate frame `(u, v, w)` of a
/// direction.
///
/// It has the precision of the input. [`Batch::evaluate`] widens eight numbers at once.
pub(crate) struct Batch<T> {
    /// Coordinates of the ends, by end (upper start, upper end, lower start, lower end), axis and
    /// lane.
    pub ends: [[[T; 8]; 3]; 4],
}

/// Result of a batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct BatchOutcome {
    /// Sum of the signs of the decided lanes.
    pub sum: i32,
    /// Number of crossings in the decided lanes.
    pub crossings: u32,
    /// Lanes that floating point could not decide, one bit each.
    pub undecided: u32,
}

impl<T: Copy + Into<f64> + From<u8>> Batch<T> {
    /// Returns a batch whose segments certainly do not cross, in all lanes.
    #[inline(always)]
    pub fn apart() -> Self {
        let (o, x) = ([T::from(0); 8], [T::from(1); 8]);
        Batch {
            ends: [[o, o, o], [x, o, o], [o, x, o], [x, x, o]],
        }
    }

    /// Evaluates [`crossing`] for eight pairs at once, in floating point only. A lane is decided
    /// only if every determinant that it needs exceeds its error bound.
    #[inline(always)]
    pub fn evaluate(&self) -> BatchOutcome {
        self.evaluate_rounded::<false>(0.0)
    }

    /// Same as [`Batch::evaluate`], but allows for rounded coordinates if `ROUNDED` is true: each
    /// may be off by at most `rounding`, and a decided lane has the result of the exact
    /// coordinates. If `ROUNDED` is false, `rounding` is ignored.
    ///
    /// # Derivation of the bounds
    ///
    /// A difference of two coordinates is off by at most `d = 2 rounding`. Let all computed
    /// differences of a determinant have a magnitude of at most `L`. A product of two is then off
    /// by `2 d L + d^2`, and the determinant of the plane, with two of them, by `4 d L + 2 d^2`.
    /// The determinant in space has three products of a difference and such a determinant: `3 (L (4
    /// d L + 2 d^2) + d (2 L^2 + 4 d L + 2 d^2)) <= 18 d L^2 + 18 d^2 L + 6 d^3`. Both are at most
    /// `4 d (L + d)` and `18 d (L + d)^2`. The constants below are larger, because the bounds
    /// themselves are rounded.
    #[inline(always)]
    pub fn evaluate_rounded<const ROUNDED: bool>(&self, rounding: f64) -> BatchOutcome {
        let d = 2.0 * rounding;
        let mut wide = [[[0.0; 8]; 3]; 4];
        for (wide, end) in wide.iter_mut().zip(&self.ends) {
            for (wide, axis) in wide.iter_mut().zip(end) {
                for (wide, &x) in wide.iter_mut().zip(axis) {
                    *wide = x.into();
                }
            }
        }
        let [a, b, c, e] = &wide;
        // Signs; and undecided lanes, with all bits set.
        let (mut signs, mut undecided) = ([0i64; 8], [0i64; 8]);
        let det = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
            let l = (p[0] - r[0]) * (q[1] - r[1]);
            let s = (p[1] - r[1]) * (q[0] - r[0]);
            let mut bound = ORIENT2D_BOUND * (l.abs() + s.abs()) + UNDERFLOW;
            if ROUNDED {
                bound += 5.0 * d * (d + largest_difference(&[p, q], &r));
            }
            (l - s, bound)
        };
        for k in 0..8 {
            let (pa, pb) = ([a[0][k], a[1][k]], [b[0][k], b[1][k]]);
            let (pc, pd) = ([c[0][k], c[1][k]], [e[0][k], e[1][k]]);
            let (c_side, c_err) = det(pa, pb, pc);
            let (d_side, d_err) = det(pa, pb, pd);
            let (a_side, a_err) = det(pc, pd, pa);
            let (b_side, b_err) = det(pc, pd, pb);
            // If both ends are certainly on one side of either edge, there is no crossing, and the
            // other determinants do not matter.
            let one_side =
                |p: f64, pe: f64, q: f64, qe: f64| ((p > pe) & (q > qe)) | ((-p > pe) & (-q > qe));
            let none =
                one_side(c_side, c_err, d_side, d_err) | one_side(a_side, a_err, b_side, b_err);
            let sure = (c_side.abs() > c_err)
                & (d_side.abs() > d_err)
                & (a_side.abs() > a_err)
                & (b_side.abs() > b_err);
            let end = |p: &[[f64; 8]; 3]| [p[0][k], p[1][k], p[2][k]];
            let ends = [end(a), end(b), end(c), end(e)];
            let (height, mut bound) = volume(ends);
            if ROUNDED {
                let [p, q, r, origin] = ends;
                let reach = d + largest_difference(&[p, q, r], &origin);
                bound += 20.0 * d * reach * reach;
            }
            let sure_height = height.abs() > bound;
            let left = d_side > 0.0;
            let over = (height < 0.0) == left;
            let sign = if left { 1 } else { -1 };
            let counts = !none & sure & sure_height & over;
            signs[k] = if counts { sign } else { 0 };
            undecided[k] = if !none & !(sure & sure_height) { -1 } else { 0 };
        }
        let (mut sum, mut crossings, mut mask) = (0, 0, 0);
        for k in 0..8 {
            sum += signs[k];
            crossings += signs[k] & 1;
            mask |= undecided[k] & (1 << k);
        }
        BatchOutcome {
            sum: sum as i32,
            crossings: crossings as u32,
            undecided: mask as u32,
        }
    }
}

/// Returns the largest magnitude of the differences of points from another one, along all axes.
#[inline(always)]
fn largest_difference<const N: usize, const M: usize>(
    points: &[[f64; N]; M],
    origin: &[f64; N],
) -> f64 {
    let mut most = 0.0;
    for p in points {
        for (x, o) in p.iter().zip(origin) {
            let size = (x - o).abs();
            most = if size > most { size } else { most };
        }
    }
    most
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exact::segments_touch;
    use crate::random::Random;

    #[test]
    fn only_the_upper_segment_has_a_crossing() {
        let t = [[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]];
        let u = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
        let mut p = Predicates::default();
        assert_eq!(crossing(&[t, u], 2, &mut p), Crossing::Over(1));
        assert_eq!(crossing(&[u, t], 2, &mut p), Crossing::None);
        assert_eq!(crossing(&[[t[1], t[0]], u], 2, &mut p), Crossing::Over(-1));
        assert_eq!(p.exact, 0);
    }

    #[test]
    fn segments_that_share_inner_points_are_in_contact() {
        let t = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let u = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
        let mut p = Predicates::default();
        for w in 0..3 {
            // Along x and y, one segment projects to a point: no crossing there, contact only along
            // z.
            let want = if w == 2 {
                Crossing::Contact
            } else {
                Crossing::None
            };
            assert_eq!(crossing(&[t, u], w, &mut p), want);
        }
    }

    #[test]
    fn a_crossing_at_a_vertex_counts_once() {
        // The upper polyline bends right above the lower segment. Exactly one of its two edges has
        // the crossing.
        let bend = [[-1.0, -1.0, 1.0], [0.0, 0.0, 1.0], [1.0, -1.0, 1.0]];
        let through = [[-1.0, -1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]];
        let u = [[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        let mut p = Predicates::default();
        let mut count = |v: &[[f64; 3]; 3]| {
            v.windows(2)
                .map(|e| match crossing(&[[e[0], e[1]], u], 2, &mut p) {
                    Crossing::Over(s) => s,
                    _ => 0,
                })
                .sum::<i32>()
        };
        assert_eq!(count(&bend), 0);
        assert_eq!(count(&through).abs(), 1);
    }

    #[test]
    fn decided_lanes_agree_with_single_crossings() {
        let mut random = Random::new(7);
        let mut next = || f64::from(random.below(9) - 4);
        let (mut decided, mut open) = (0, 0);
        for _ in 0..4000 {
            let mut batch = Batch::<f64>::apart();
            for end in &mut batch.ends {
                for axis in end {
                    axis.fill_with(&mut next);
                }
            }
            for w in 0..3 {
                let out = batch.evaluate();
                let (mut sum, mut crossings) = (0, 0);
                for lane in 0..8 {
                    if out.undecided >> lane & 1 != 0 {
                        open += 1;
                        continue;
                    }
                    decided += 1;
                    // The coordinate frame of direction w.
                    let [p0, p1, q0, q1] = batch.ends.map(|end| {
                        let mut p = [0.0; 3];
                        for x in 0..3 {
                            p[(w + 1 + x) % 3] = end[x][lane];
                        }
                        p
                    });
                    let edges = [[p0, p1], [q0, q1]];
                    match crossing(&edges, w, &mut Predicates::default()) {
                        Crossing::Over(s) => (sum, crossings) = (sum + s, crossings + 1),
                        Crossing::None => {}
                        Crossing::Contact => panic!("the batch decided a contact"),
                    }
                    assert!(
                        !segments_touch(&edges),
                        "segments in contact need exact arithmetic"
                    );
                }
                assert_eq!((out.sum, out.crossings), (sum, crossings));
            }
        }
        assert!(decided > 30_000 && open > 3_000, "{decided} {open}");
    }
}
