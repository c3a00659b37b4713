//! Far field: the expansions of accepted node pairs, in batches.
//!
//! Let `R = c1 - c2`, let `c`, `D`, `Q` be the moments of a node, `w` the vector of the
//! antisymmetric part of `D`, and `W = eps Q` likewise. The terms of degree 0 to 2 of the expansion
//! in [`super::bound`] are
//!
//! ```text
//! R . (c1 x c2) / R^3
//! - (c2 . w1 + c1 . w2) / R^3 - 3 R . ((D1 R) x c2 - c1 x (D2 R)) / R^5
//! + 3 (c2 . (W1 R) - c1 . (W2 R)) / R^5 - 3/2 R . (trace Q1 x c2 + c1 x trace Q2) / R^5
//! + 15/2 R . ((Q1 R R) x c2 + c1 x (Q2 R R)) / R^7
//! + 3 (R . sum over k of D1_k x D2_k - w1 . (D2 R) + w2 . (D1 R)) / R^5
//! - 15 R . ((D1 R) x (D2 R)) / R^7
//! ```
//!
//! with `D_k` the columns of `D`. This is a factored form of equations 28 to 30 in the supplement
//! of Qu & James 2021.

use super::Order;
use super::bound::Reach;
use super::moments::{COUNT, Moments, d, q};
use crate::curve::vector::{add, cross, dot};

/// Number of node pairs that are evaluated together.
pub(super) const BATCH: usize = 8;

type Lanes = [f64; BATCH];
type Vector = [f64; 3];

/// Contractions of the moments of a node with `R`, as the expansion needs them.
struct Contracted {
    c: Vector,
    /// Columns of the dipole.
    columns: [Vector; 3],
    w: Vector,
    dr: Vector,
    wr: Vector,
    trace: Vector,
    qrr: Vector,
}

impl Contracted {
    #[inline(always)]
    fn new(m: &[f64; COUNT], r: Vector, order: Order) -> Contracted {
        let row = |i: usize| [m[d(i, 0)], m[d(i, 1)], m[d(i, 2)]];
        let rows = [row(0), row(1), row(2)];
        let column = |j: usize| [m[d(0, j)], m[d(1, j)], m[d(2, j)]];
        let mut out = Contracted {
            c: [m[0], m[1], m[2]],
            columns: [column(0), column(1), column(2)],
            w: antisymmetric(rows),
            dr: [dot(rows[0], r), dot(rows[1], r), dot(rows[2], r)],
            wr: [0.0; 3],
            trace: [0.0; 3],
            qrr: [0.0; 3],
        };
        if order == Order::Quadrupole {
            let mut qr = [[0.0; 3]; 3];
            for i in 0..3 {
                let product = |jk: usize| m[q(i, jk)];
                let (xx, yy, zz) = (product(0), product(1), product(2));
                let (xy, xz, yz) = (product(3), product(4), product(5));
                qr[i] = [
                    xx * r[0] + xy * r[1] + xz * r[2],
                    xy * r[0] + yy * r[1] + yz * r[2],
                    xz * r[0] + yz * r[1] + zz * r[2],
                ];
                out.qrr[i] = dot(qr[i], r);
                out.trace[i] = xx + yy + zz;
            }
            out.wr = antisymmetric(qr);
        }
        out
    }
}

/// Returns the integral of `dr x p`, from that of `dr_i p_j`.
#[inline(always)]
fn antisymmetric(m: [Vector; 3]) -> Vector {
    [m[1][2] - m[2][1], m[2][0] - m[0][2], m[0][1] - m[1][0]]
}

/// Returns the expansion of one node pair, times 4 pi.
#[inline(always)]
fn expand(m1: &[f64; COUNT], m2: &[f64; COUNT], r: Vector, order: Order) -> f64 {
    let (a, b) = (Contracted::new(m1, r, order), Contracted::new(m2, r, order));
    let i2 = 1.0 / dot(r, r);
    let i3 = i2 * i2.sqrt();
    let monopole = dot(r, cross(a.c, b.c)) - dot(b.c, a.w) - dot(a.c, b.w);
    let reverse = |v: Vector| [-v[0], -v[1], -v[2]];
    let dipole = add(cross(a.dr, b.c), reverse(cross(a.c, b.dr)));
    let mut fifth = -3.0 * dot(r, dipole);
    let mut seventh = 0.0;
    if order == Order::Quadrupole {
        let traces = add(cross(a.trace, b.c), cross(a.c, b.trace));
        let column = |k: usize| cross(a.columns[k], b.columns[k]);
        let columns = add(column(0), add(column(1), column(2)));
        fifth += 3.0
            * (dot(b.c, a.wr) - dot(a.c, b.wr) + dot(r, columns) - dot(a.w, b.dr) + dot(b.w, a.dr))
            - 1.5 * dot(r, traces);
        let twice = add(cross(a.qrr, b.c), cross(a.c, b.qrr));
        seventh = 7.5 * dot(r, twice) - 15.0 * dot(r, cross(a.dr, b.dr));
    }
    i3 * (monopole + i2 * (fifth + i2 * seventh))
}

/// Returns the sum of the expansions of a batch of node pairs, times 4 pi.
#[inline(always)]
pub(super) fn expand_batch(
    order: Order,
    pairs: &[(u32, u32)],
    [reach1, reach2]: [&[Reach]; 2],
    [moments1, moments2]: [&[Moments]; 2],
) -> f64 {
    let mut m1 = [[0.0; BATCH]; COUNT];
    let mut m2 = [[0.0; BATCH]; COUNT];
    // Unused lanes have zero moments and an arbitrary distance.
    let mut r = [[1.0; BATCH]; 3];
    for (l, &(t, u)) in pairs.iter().enumerate().take(BATCH) {
        let (t, u) = (t as usize, u as usize);
        for x in 0..3 {
            r[x][l] = reach1[t].centre[x] - reach2[u].centre[x];
        }
        let (p, q) = (&moments1[t].0, &moments2[u].0);
        for k in 0..COUNT {
            m1[k][l] = p[k];
            m2[k][l] = q[k];
        }
    }
    let mut values: Lanes = [0.0; BATCH];
    for (l, value) in values.iter_mut().enumerate() {
        let p = std::array::from_fn(|k| m1[k][l]);
        let q = std::array::from_fn(|k| m2[k][l]);
        *value = expand(&p, &q, [r[0][l], r[1][l], r[2][l]], order);
    }
    values.iter().sum()
}

/// Returns the published estimate of the error of a node pair, times 4 pi and a constant (equation
/// 14): the magnitude of those terms of the next degree that are products of the stored moments.
pub(super) fn next_order(square: f64, [a, b]: [&Reach; 2], [m, n]: [&Moments; 2]) -> f64 {
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let norms = |m: &Moments| {
        let q = (0..3).map(|i| {
            // Mixed products count twice.
            let row = &m.0[q(i, 0)..=q(i, 5)];
            norm(row).hypot(norm(&row[3..]))
        });
        let q: Vec<f64> = q.collect();
        (norm(&m.0[..3]), norm(&m.0[3..12]), norm(&q))
    };
    let ((c1, d1, q1), (c2, d2, q2)) = (norms(m), norms(n));
    let sum = a.radius * c2 * q1 + b.radius * c1 * q2 + 3.0 * (d1 * q2 + q1 * d2);
    sum / (square * square * square.sqrt())
}
