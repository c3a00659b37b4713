//! Near field: the exact sum over all segment pairs of two leaves, up to rounding.
//!
//! # Formula
//!
//! The differences of the points of two segments form a parallelogram. Let `a`, `b`, `c`, `e` be
//! the vectors to its corners, in order: they connect the ends of one segment to those of the
//! other. The parallelogram is seen under the solid angle `2 (t1 + t2)`, where `t1` and `t2` are
//! the arguments of `d + i p` for its two halves:
//!
//! ```text
//! d1 = |a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b|,    d2 likewise of a, e, c,    p = a . (dl x dk)
//! ```
//!
//! (Arai 2013; van Oosterom and Strackee). The product of both complex numbers has the argument
//! `t1 + t2`, which is at most half a turn. So one product for each pair, accumulated with a count
//! of its turns, replaces the arctangents (Bertolazzi et al. 2019).
//!
//! # Error bound
//!
//! Rounding changes `d` by less than `2^-46 |a||b||c|` and `p` by less than
//! `2^-46 |a| (|a| + |b|) (|b| + |c|)`. So `d + i p` stays in a disc. If the ratio of its radius
//! and `|d| + |p|` is below a fourth, the argument changes by less than 3 times that ratio.
//! Otherwise, or if the disc meets the negative axis, a full turn is uncertain: the segments nearly
//! touch.

use super::bound::OUTWARD;
use super::trees::{LEAF, Tree};
use crate::curve::pow2;
use crate::curve::vector::{cross, dot, sub};
use std::ops::Range;

/// A number in each lane.
type Lanes = [f64; LEAF];

/// Sum of angles, with a lane for each segment of a leaf.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernels) struct Angles {
    /// Complex number whose argument is the sum, up to full turns.
    x: Lanes,
    y: Lanes,
    turns: Lanes,
    /// Error bound, in radians.
    error: Lanes,
    /// Number of leaf pairs added.
    count: u64,
}

/// Rounding error of `d` and of `p` for factors of 1: 128 units of `2^-53`. A length is the result
/// of five operations (with an error of at most 4 units), `d` of a dozen operations, with four
/// terms of at most 1 each.
const ROUNDED: f64 = pow2(-46);

/// Rounding error of a product of two complex numbers and of the following operations, as an angle.
const PRODUCT: f64 = pow2(-48);

/// Upper bound of a full turn.
const FULL_TURN: f64 = 7.0;

/// Factor on an error that makes it negligible but keeps it positive.
const NEGLIGIBLE: f64 = pow2(-20);

/// Products below this are undecided, because underflow is not negligible.
const MIN_PRODUCT: f64 = pow2(-800);

impl Angles {
    pub const ZERO: Angles = Angles {
        x: [1.0; LEAF],
        y: [0.0; LEAF],
        turns: [0.0; LEAF],
        error: [0.0; LEAF],
        count: 0,
    };

    /// Adds the angles of all segment pairs of two leaves, given by their indices in their curves.
    #[inline(always)]
    pub(super) fn add(&mut self, [first, second]: [&Tree; 2], [i, j]: [usize; 2]) {
        let (i, j) = (i * LEAF, j * LEAF);
        // Ends of the segments of the second curve: one window, and the same shifted by one.
        let ends = [j, j + 1].map(|at| second.vertices.each_ref().map(|v| lanes(v, at)));
        let corner = |k: usize| first.vertices.each_ref().map(|v| v[i + k]);
        let mut above = Row::new(corner(0), &ends);
        for k in 1..=LEAF {
            let below = Row::new(corner(k), &ends);
            let (p, q) = (corner(k - 1), corner(k));
            let side = sub(q, p);
            self.add_row(side, &ends, [&above, &below], [false; LEAF]);
            above = below;
        }
        self.count += 1;
    }

    /// Adds the angles of all pairs of a segment of range `i` of the first curve and one of range
    /// `j` of the second one. The limits of `j` are multiples of [`LEAF`], as is the length of `i`.
    /// The segments are given by their start and end points. `skipped(k, at)` returns which of the
    /// pairs of segment `k` and the [`LEAF`] segments from `at` on are skipped.
    #[inline(always)]
    pub fn add_segments(
        &mut self,
        [first, second]: [&[[Vec<f64>; 3]; 2]; 2],
        [i, j]: [Range<usize>; 2],
        skipped: impl Fn(usize, usize) -> [bool; LEAF],
    ) {
        let corner = |end: usize, k: usize| first[end].each_ref().map(|v| v[k]);
        for at in j.step_by(LEAF) {
            let ends = second.each_ref();
            let ends = ends.map(|end| end.each_ref().map(|v| lanes(v, at)));
            let mut before: Option<([f64; 3], Row)> = None;
            for k in i.clone() {
                let (p, q) = (corner(0, k), corner(1, k));
                // Neighbouring segments share an end point.
                let above = match before {
                    Some((end, row)) if end == p => row,
                    _ => Row::new(p, &ends),
                };
                let below = Row::new(q, &ends);
                let side = sub(q, p);
                self.add_row(side, &ends, [&above, &below], skipped(k, at));
                before = Some((q, below));
            }
            self.count += (i.len() / LEAF) as u64;
        }
    }

    /// Adds the pairs of one segment and the segments of a leaf, except the skipped ones.
    #[inline(always)]
    fn add_row(
        &mut self,
        side: [f64; 3],
        ends: &[[Lanes; 3]; 2],
        [above, below]: [&Row; 2],
        skipped: [bool; LEAF],
    ) {
        for l in 0..LEAF {
            let at = |v: &[Lanes; 3]| [v[0][l], v[1][l], v[2][l]];
            let (a, b) = (at(&above.v[0]), at(&above.v[1]));
            let (e, c) = (at(&below.v[0]), at(&below.v[1]));
            let [na, nb] = [above.n[0][l], above.n[1][l]];
            let [ne, nc] = [below.n[0][l], below.n[1][l]];
            let p = dot(a, cross(side, sub(at(&ends[1]), at(&ends[0]))));
            let (ac, nac) = (dot(a, c), na * nc);
            let d1 = (nac + ac) * nb + above.dots[l] * nc + dot(b, c) * na;
            let d2 = (nac + ac) * ne + below.dots[l] * na + dot(a, e) * nc;
            // Error bounds of `p` and `d`.
            let off_p = ROUNDED * na * (na + nb) * (nb + nc);
            let off = [ROUNDED * nac * nb + off_p, ROUNDED * nac * ne + off_p];
            let size = [d1.abs() + p.abs(), d2.abs() + p.abs()];
            let clear = (size[0] > 4.0 * off[0]) & (size[1] > 4.0 * off[1]);
            let ahead = (p.abs() > off_p) | ((d1 > off[0]) & (d2 > off[1]));
            // The angle is at most half a turn, so the sum is not negative. The lower limit is
            // positive, so that the product keeps the sign of `p`.
            let sum = (d1 + d2).max(NEGLIGIBLE * (off[0] + off[1]));
            let (zx, zy) = (d1 * d2 - p * p, p * sum);
            let fits = (zx.abs() > MIN_PRODUCT) | (zy.abs() > MIN_PRODUCT);
            let ratio = (off[0] * size[1] + off[1] * size[0]) / (size[0] * size[1]);
            let certain = clear & ahead & fits & !skipped[l];
            let uncertain = if skipped[l] { 0.0 } else { FULL_TURN };
            let (x, y) = (self.x[l], self.y[l]);
            let (sx, sy) = (x * zx - y * zy, x * zy + y * zx);
            let up = (y >= 0.0) & (zy >= 0.0) & (sy < 0.0);
            let down = (y < 0.0) & (zy < 0.0) & (sy >= 0.0);
            let shrink = 1.0 / sx.abs().max(sy.abs());
            let turn = if up { 1.0 } else { 0.0 } - if down { 1.0 } else { 0.0 };
            self.x[l] = if certain { sx * shrink } else { x };
            self.y[l] = if certain { sy * shrink } else { y };
            self.turns[l] += if certain { turn } else { 0.0 };
            self.error[l] += if certain { 3.0 * ratio } else { uncertain };
        }
    }

    /// Returns the sum in turns and its error bound.
    pub fn turns(&self) -> (f64, f64) {
        use std::f64::consts::TAU;
        let mut sum = 0.0;
        let mut error = 0.0;
        for l in 0..LEAF {
            sum += self.turns[l] + self.y[l].atan2(self.x[l]) / TAU;
            error += self.error[l] / TAU;
        }
        let pairs = self.count as f64 * (LEAF * LEAF) as f64;
        (sum, (error + (pairs + 1.0) * PRODUCT) * OUTWARD)
    }
}

/// Returns the numbers from index `at` on.
#[inline(always)]
fn lanes(v: &[f64], at: usize) -> Lanes {
    v[at..at + LEAF].try_into().unwrap_or([0.0; LEAF])
}

/// Differences and distances of a vertex of the first curve and the ends of the segments of the
/// second one.
#[derive(Clone, Copy)]
struct Row {
    v: [[Lanes; 3]; 2],
    n: [Lanes; 2],
    /// Dot products of the differences to both ends of each segment.
    dots: Lanes,
}

impl Row {
    #[inline(always)]
    fn new(p: [f64; 3], ends: &[[Lanes; 3]; 2]) -> Row {
        let mut row = Row {
            v: [[[0.0; LEAF]; 3]; 2],
            n: [[0.0; LEAF]; 2],
            dots: [0.0; LEAF],
        };
        for side in 0..2 {
            for l in 0..LEAF {
                let mut square = 0.0;
                for x in 0..3 {
                    let r = p[x] - ends[side][x][l];
                    row.v[side][x][l] = r;
                    square += r * r;
                }
                row.n[side][l] = square.sqrt();
            }
        }
        for l in 0..LEAF {
            for x in 0..3 {
                row.dots[l] += row.v[0][x][l] * row.v[1][x][l];
            }
        }
        row
    }
}
