//! Passages in floating point with proven bounds: the result is certain, or undecided.
//!
//! Let `p = b - a` and `q = d - c` be the vectors along the edges, and `r = c - a` the vector
//! between them, all linear in time. The volume of the four ends is `r . (p x q)`, a cubic. The
//! sides of the ends relative to the other edge, seen against an axis, are components of `r x q`,
//! of `p x r`, and of those minus or plus `p x q`: quadratics.
//!
//! In Bernstein form, the sign of a polynomial is certain over an interval if all its coefficients
//! have that sign. If its coefficients change sign once, it has one root there, which is simple
//! (Descartes). Subdivision of the interval (de Casteljau) moves the coefficients towards the
//! polynomial.
//!
//! # Derivation of the error bounds
//!
//! Let `u = 2^-53`, and `P, Q, R` the largest coordinates of `p, q, r` in both frames, as computed.
//! Differences have a relative error of `u`, and products of two of them `3 u`. It follows:
//!
//! - Components of a cross product are at most `2 P Q`, with an error of `8 u P Q`. The middle
//!   Bernstein coefficient, half the sum of two, has an error of `10 u P Q`.
//! - `r . n` of such components has an error of `46 u P Q R` (three products with errors of
//!   `8 + 2 + 2`, and two sums with `4` and `6`); with the middle coefficient `52 u P Q R`. A third
//!   of the sum of two of the latter and one of the former has an error of `(104 + 46 + 18) / 3`,
//!   plus `12` for the rounded third: `68 u P Q R`. Every volume is at most `6 P Q R`.
//! - The sides of `a` and `b` are at most `2 (P + R) Q`, with an error of `12 u (P + R) Q`. For
//!   those of `c` and `d`, `P` and `Q` are swapped.
//!
//! A round of de Casteljau at a ratio that is a float adds `3 u` of the largest coefficient (the
//! complement of the ratio, a product, a sum): `54 u P Q R` for the three rounds of a volume,
//! `12 u (P + R) Q` for the two rounds of a side. The constants below have a margin for the terms
//! in `u^2` and for underflow, which is below `u^2` of the products because of the limits on
//! `P, Q, R`.

use super::{Edges, Moment, Passage, along};
use crate::curve::vector::{cross, dot, per_axis, sub};
use crate::curve::{Point, pow2};

/// Half a unit in the last place of 1: the largest relative error of one operation.
const U: f64 = f64::EPSILON / 2.0;

/// Error bound of the coefficients of a volume in units of `u P Q R`: at the start, and added by
/// every level or evaluation.
const VOLUME_BOUND: [f64; 2] = [70.0, 56.0];

/// Error bound of the coefficients of a side, in units of `u (P + R) Q` and `u (Q + R) P`.
const SIDE_BOUND: [f64; 2] = [14.0, 14.0];

/// Smallest and largest `P, Q, R` for which the bounds hold.
const RANGE: [f64; 2] = [pow2(-200), pow2(200)];

/// Maximum number of levels of subdivision before exact arithmetic is used.
const LEVELS: u32 = 12;

/// Ratio at which an interval is cut. Not the middle, because passages are often there.
const CUT: f64 = 15.0 / 32.0;

/// Largest width of an interval, as a fraction of the step, in which a time may remain uncertain.
const WIDEST: f64 = 1e-9;

/// Returns true if one edge stays on one side of the other along a coordinate axis during the step.
///
/// If all ends of one edge are left of all ends of the other in both frames, they are at all times
/// between, because every difference of coordinates is linear in time. Coordinates may be rounded
/// by at most `rounding`.
#[inline]
pub(super) fn apart(before: &Edges, after: &Edges, rounding: f64) -> bool {
    // Three times, because the sums below are rounded.
    let gap = 3.0 * rounding;
    let less = |a: f64, b: f64| if a < b { a } else { b };
    let more = |a: f64, b: f64| if a > b { a } else { b };
    (0..3).any(|x| {
        let side = |edges: &Edges| {
            let [[a, b], [c, d]] = edges.map(|edge| edge.map(|p| p[x]));
            (more(a, b) + gap < less(c, d), less(a, b) > more(c, d) + gap)
        };
        let (s, t) = (side(before), side(after));
        (s.0 & t.0) | (s.1 & t.1)
    })
}

/// Passages of a pair of edges in chronological order. There are at most three.
pub(super) type Found = [Option<Passage>; 3];

/// Returns all passages, or `None` if floating point cannot decide. Coordinates may be rounded by
/// at most `rounding`; the result is then that of the exact ones.
///
/// # Derivation of the error bounds for rounded coordinates
///
/// The components of `p, q, r` are off by at most `d = 2 rounding`. A volume has six products of
/// three of them, each off by less than `(P + d)(Q + d)(R + d) - P Q R`, and every Bernstein
/// coefficient is a mean of such volumes. Sides are sums of at most four products of two, each off
/// by less than `d (P + Q + R + d)`; their derivatives are at most twice as far off. The bounds
/// have these errors four times.
pub(super) fn passages(before: &Edges, after: &Edges, rounding: f64) -> Option<Found> {
    let differences = |[[a, b], [c, d]]: &Edges| [sub(*b, *a), sub(*d, *c), sub(*c, *a)];
    let ([p0, q0, r0], [p1, q1, r1]) = (differences(before), differences(after));
    let size = |v: Point, w: Point| v.iter().chain(&w).fold(0.0, |m: f64, x| m.max(x.abs()));
    let (p, q, r) = (size(p0, p1), size(q0, q1), size(r0, r1));
    // Edges that are points at all times are out of range, too.
    if ![p, q, r].iter().all(|s| (RANGE[0]..=RANGE[1]).contains(s)) {
        return None;
    }
    let n = bernstein(p0, p1, q0, q1);
    let volume = [
        dot(r0, n[0]),
        (2.0 * dot(r0, n[1]) + dot(r1, n[0])) * (1.0 / 3.0),
        (dot(r0, n[2]) + 2.0 * dot(r1, n[1])) * (1.0 / 3.0),
        dot(r1, n[2]),
    ];
    let d = 2.0 * rounding;
    let of_volume = 6.0 * d * (p * q + q * r + r * p + d * (p + q + r) + d * d);
    let of_side = 4.0 * d * (p + q + r + d);
    let side = |unit: f64| unit + 4.0 * of_side / SIDE_BOUND[0];
    let bounds = Bounds {
        volume: U * p * q * r + 4.0 * of_volume / VOLUME_BOUND[0],
        sides: [side(U * (p + r) * q), side(U * (q + r) * p)],
    };
    if one_sign(&volume, VOLUME_BOUND[0] * bounds.volume) != 0 {
        return Some([None; 3]);
    }
    // The axis along which the projections of both edges are longest, approximately.
    let middle = per_axis(|x| (n[0][x] + 2.0 * n[1][x] + n[2][x]).abs());
    let w = (0..3).fold(0, |w, x| if middle[x] > middle[w] { x } else { w });
    let (a, c) = (bernstein(r0, r1, q0, q1), bernstein(p0, p1, r0, r1));
    let piece = Piece {
        from: 0.0,
        to: 1.0,
        volume,
        sides: [
            per_axis(|k| a[k][w]),
            per_axis(|k| a[k][w] - n[k][w]),
            per_axis(|k| c[k][w]),
            per_axis(|k| c[k][w] + n[k][w]),
        ],
    };
    let mut search = Search {
        before,
        after,
        bounds,
        found: [None; 3],
        count: 0,
    };
    search.piece(&piece, 0).then_some(search.found)
}

/// Units of the error bounds.
struct Bounds {
    volume: f64,
    /// Units for the ends of the first edge, and for those of the second one.
    sides: [f64; 2],
}

/// A part of the step, and the polynomials over it in Bernstein form.
#[derive(Clone, Copy)]
struct Piece {
    from: f64,
    to: f64,
    volume: [f64; 4],
    /// The sides of `a, b, c, d`.
    sides: [[f64; 3]; 4],
}

struct Search<'a> {
    before: &'a Edges,
    after: &'a Edges,
    bounds: Bounds,
    found: Found,
    count: usize,
}

impl Search<'_> {
    /// Finds the passages in a part of the step. Returns `false` if this is undecided.
    fn piece(&mut self, piece: &Piece, level: u32) -> bool {
        let depth = f64::from(level);
        let bound = (VOLUME_BOUND[0] + depth * VOLUME_BOUND[1]) * self.bounds.volume;
        if one_sign(&piece.volume, bound) != 0 {
            return true;
        }
        let side_bound = SIDE_BOUND[0] + depth * SIDE_BOUND[1];
        for (pair, unit) in [[0, 1], [2, 3]].iter().zip(self.bounds.sides) {
            let signs = pair.map(|k| one_sign(&piece.sides[k], side_bound * unit));
            if signs[0] * signs[1] == 1 {
                return true;
            }
        }
        let signs = piece.volume.map(|v| certain_sign(v, bound));
        if signs[0] * signs[3] == -1 && (signs[1] == signs[0] || signs[2] == signs[3]) {
            // One change of sign, whatever the signs of the uncertain coefficients are.
            return self.root(piece, bound, side_bound);
        }
        if level == LEVELS {
            return false;
        }
        let (left, right) = piece.cut();
        self.piece(&left, level + 1) && self.piece(&right, level + 1)
    }

    /// Decides if the single root of the volume in `piece` is a passage. Returns `false` if this is
    /// undecided.
    fn root(&mut self, piece: &Piece, bound: f64, side_bound: f64) -> bool {
        let (time, slope) = root(&piece.volume);
        let bound = bound + VOLUME_BOUND[1] * self.bounds.volume;
        // Twice as wide as the uncertainty of the values.
        let width = (2.0 * bound / slope.abs()).max(f64::EPSILON);
        let (lo, hi) = ((time - width).max(0.0), (time + width).min(1.0));
        let direction = certain_sign(piece.volume[3], bound);
        let bracketed = certain_sign(value(&piece.volume, lo), bound) == -direction
            && certain_sign(value(&piece.volume, hi), bound) == direction;
        if !bracketed {
            return false;
        }
        let narrow = (hi - lo) * (piece.to - piece.from) < WIDEST;
        // The root is between `lo` and `hi`. In between, a side changes by at most its largest
        // derivative times the width.
        let side = |k: usize| {
            let [g0, g1, g2] = piece.sides[k];
            let steep = 2.0 * (g1 - g0).abs().max((g2 - g1).abs());
            let unit = self.bounds.sides[k / 2];
            let bound = (side_bound + 2.0 * SIDE_BOUND[1]) * unit + 1.01 * steep * (hi - lo);
            let value = value(&[g0, g1, g2], time);
            (value, certain_sign(value, bound))
        };
        let [a, b, c, d] = [0, 1, 2, 3].map(side);
        match (a.1 * b.1, c.1 * d.1) {
            // The edges are apart at the root, wherever it is between `lo` and `hi`.
            (1, _) | (_, 1) => true,
            (-1, -1) if narrow => {
                let time = piece.from + (piece.to - piece.from) * time;
                let at = [a.0 / (a.0 - b.0), c.0 / (c.0 - d.0)];
                self.found[self.count] = Some(Passage {
                    time,
                    moment: Moment::Within { tie: false },
                    sign: -direction,
                    at,
                    point: along(self.before, self.after, time, at),
                });
                self.count += 1;
                true
            }
            _ => false,
        }
    }
}

impl Piece {
    fn cut(&self) -> (Piece, Piece) {
        let between = self.from + (self.to - self.from) * CUT;
        let (mut left, mut right) = (*self, *self);
        (left.to, right.from) = (between, between);
        de_casteljau(&mut right.volume, CUT, &mut left.volume);
        for (right, left) in right.sides.iter_mut().zip(&mut left.sides) {
            de_casteljau(right, CUT, left);
        }
        (left, right)
    }
}

/// Returns the Bernstein coefficients of the cross product of two moving vectors.
#[inline(always)]
fn bernstein(p0: Point, p1: Point, q0: Point, q1: Point) -> [Point; 3] {
    let (s, t) = (cross(p0, q1), cross(p1, q0));
    [
        cross(p0, q0),
        per_axis(|x| 0.5 * (s[x] + t[x])),
        cross(p1, q1),
    ]
}

/// Returns the sign of a number with an error of at most `bound`, or 0 if it is uncertain.
#[inline(always)]
fn certain_sign(x: f64, bound: f64) -> i32 {
    i32::from(x > bound) - i32::from(x < -bound)
}

/// Returns the sign that all coefficients certainly have, or 0 if there is none.
#[inline(always)]
fn one_sign<const N: usize>(coefficients: &[f64; N], bound: f64) -> i32 {
    let all = |f: &dyn Fn(f64) -> bool| coefficients.iter().all(|&c| f(c));
    i32::from(all(&|c| c > bound)) - i32::from(all(&|c| c < -bound))
}

/// Replaces coefficients by those of the part after `ratio`, and writes those of the part before it
/// to `before`.
#[inline(always)]
fn de_casteljau<const N: usize>(c: &mut [f64; N], ratio: f64, before: &mut [f64; N]) {
    let rest = 1.0 - ratio;
    for (k, before) in before.iter_mut().enumerate() {
        *before = c[0];
        for j in 0..N - 1 - k {
            c[j] = rest * c[j] + ratio * c[j + 1];
        }
    }
}

/// Returns the value at `ratio` of the interval.
#[inline(always)]
fn value<const N: usize>(coefficients: &[f64; N], ratio: f64) -> f64 {
    let mut c = *coefficients;
    let mut before = [0.0; N];
    de_casteljau(&mut c, ratio, &mut before);
    c[0]
}

/// Returns the approximate root of a cubic in Bernstein form that changes sign once, and the slope
/// there.
fn root(&[d0, d1, d2, d3]: &[f64; 4]) -> (f64, f64) {
    let c = [
        d0,
        3.0 * (d1 - d0),
        3.0 * ((d2 - d1) - (d1 - d0)),
        (d3 - d0) - 3.0 * (d2 - d1),
    ];
    let slope = |t: f64| (3.0 * c[3] * t + 2.0 * c[2]) * t + c[1];
    let (mut lo, mut hi) = (0.0, 1.0);
    let mut t = d0 / (d0 - d3);
    // Newton's method, safeguarded by bisection.
    for _ in 0..40 {
        let f = ((c[3] * t + c[2]) * t + c[1]) * t + d0;
        if (f < 0.0) == (d0 < 0.0) {
            lo = t;
        } else {
            hi = t;
        }
        let mut next = t - f / slope(t);
        if !(lo..=hi).contains(&next) {
            next = 0.5 * (lo + hi);
        }
        let step = (next - t).abs();
        t = next;
        if step <= 2.0 * f64::EPSILON {
            break;
        }
    }
    (t, slope(t))
}
