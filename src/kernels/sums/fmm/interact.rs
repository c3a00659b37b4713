//! Interaction of accepted node pairs, in batches.
//!
//! # Formula
//!
//! With the centres `R` apart along z, and displacements `a` and `b` from them,
//! `g = 1 / |R + a - b|` is
//!
//! ```text
//! sum over n, m, k of c(n, m, k) R_n^k(a) conj R_m^k(b),
//! c = (-1)^(n + k) (n + m)! / R^(n + m + 1)
//! ```
//!
//! and the contribution of the node pair, times 4 pi, is minus the integral of `db . H(b)`, with
//! `H(b)` the integral of `grad_a g cross da`. `H` is harmonic and has no divergence. So it is
//! `grad f + curl (b h)` with two harmonic functions, which `b . H` and `b . curl H` determine (the
//! Lamb-Helmholtz decomposition; Gumerov & Duraiswami 2013, *Efficient FMM accelerated vortex
//! methods in three dimensions via the Lamb-Helmholtz decomposition*). The same holds for
//! `R cross grad R_n^k`, with degree `n` of `f = -i k R / n R_n^k` and degree `n - 1` of
//! `h = -R / n R_(n-1)^k`. With the moments `P`, `T` of [`super::harmonics`] the contribution is
//!
//! ```text
//! - sum of c [P_n conj T_m / (m + 1) + T_n conj P_m / (n + 1) - i k R / (n m) P_n conj P_m]
//! ```
//!
//! over degrees from 1 on and all k: two scalars for each node, instead of the usual three
//! components of a vector potential. Nodes are rotated until R lies along z ([`super::rotate`]);
//! the cost of the sum is then of the order of `p^3`, not `p^4`. There is neither a local expansion
//! nor a downward pass, because the result is a single number.

use super::harmonics::{Lanes, MOST, at, count};
use super::rotate::{SWAP, turn};
use crate::curve::Point;

/// Number of node pairs that are evaluated together.
pub(super) const BATCH: usize = 8;

/// A node of a pair: its moments, `P` and then `T`, up to `degrees`, in units of its `size`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side<'a> {
    pub moments: &'a [f64],
    pub degrees: usize,
    pub size: f64,
}

/// Buffers of a batch.
#[derive(Clone, Debug)]
pub(super) struct Buffers {
    /// `P` and `T` of both nodes.
    sides: [[Vec<Lanes<BATCH>>; 2]; 2],
    other: Vec<Lanes<BATCH>>,
}

impl Buffers {
    pub fn new(order: usize) -> Buffers {
        let zeros = vec![[0.0; BATCH]; count(order)];
        Buffers {
            sides: std::array::from_fn(|_| [zeros.clone(), zeros.clone()]),
            other: zeros,
        }
    }
}

/// Factorials of 0 to twice the maximum order.
pub(super) const FACTORIALS: [f64; 2 * MOST + 1] = {
    let mut f = [1.0; 2 * MOST + 1];
    let mut n = 1;
    while n < f.len() {
        f[n] = f[n - 1] * n as f64;
        n += 1;
    }
    f
};

/// Returns the contributions of a batch of node pairs, times 4 pi, up to an order: one in each
/// lane. Displacements are from the second centre to the first.
#[inline(always)]
pub(super) fn interact(
    order: usize,
    pairs: &[([Side; 2], Point)],
    buffers: &mut Buffers,
) -> Lanes<BATCH> {
    // Unused lanes have zero moments and an arbitrary distance.
    let mut phi = [[1.0; BATCH], [0.0; BATCH]];
    let mut theta = [[1.0; BATCH], [0.0; BATCH]];
    let mut scale = [[0.0; BATCH]; 2];
    let size = count(order);
    for (l, (sides, r)) in pairs.iter().enumerate().take(BATCH) {
        let flat = (r[0] * r[0] + r[1] * r[1]).sqrt();
        let distance = (flat * flat + r[2] * r[2]).sqrt();
        // If the squares underflow, `flat` is negligible compared to the distance.
        if flat > 1e-140 {
            phi[0][l] = r[0] / flat;
            phi[1][l] = -r[1] / flat;
            theta[0][l] = r[2] / distance;
            theta[1][l] = flat / distance;
        } else {
            theta[0][l] = if r[2] < 0.0 { -1.0 } else { 1.0 };
        }
        for (x, side) in sides.iter().enumerate() {
            scale[x][l] = side.size / distance;
            for kind in 0..2 {
                let moments = &side.moments[kind * count(side.degrees)..][..size];
                for (to, from) in buffers.sides[x][kind].iter_mut().zip(moments) {
                    to[l] = *from;
                }
            }
        }
    }
    for l in pairs.len()..BATCH {
        for x in 0..2 {
            for kind in 0..2 {
                buffers.sides[x][kind].iter_mut().for_each(|to| to[l] = 0.0);
            }
        }
    }
    let swap = &*SWAP;
    for x in 0..2 {
        for kind in 0..2 {
            let moments = &mut buffers.sides[x][kind];
            turn(order, &phi[0], &phi[1], moments);
            swap.apply(order, moments, &mut buffers.other);
            turn(order, &theta[0], &theta[1], &mut buffers.other);
            swap.apply(order, &buffers.other, moments);
            // Powers of size divided by distance, and the factor 1 / (n + 1) of T.
            let mut power = if kind == 0 { [1.0; BATCH] } else { scale[x] };
            for n in 1..=order {
                for l in 0..BATCH {
                    power[l] *= scale[x][l];
                }
                let f = if kind == 0 { 1.0 } else { 1.0 / (n + 1) as f64 };
                for i in at(n, 0)..at(n + 1, 0) {
                    for l in 0..BATCH {
                        moments[i][l] *= power[l] * f;
                    }
                }
            }
        }
    }
    contract(order, buffers)
}

/// Computes the sum in the rotated frame.
#[inline(always)]
fn contract(order: usize, buffers: &Buffers) -> Lanes<BATCH> {
    let [[pa, ta], [pb, tb]] = &buffers.sides;
    let mut total = [0.0; BATCH];
    for k in 0..=order {
        let mut sum = [0.0; BATCH];
        for n in k.max(1)..=order {
            // Sums over m of T_m, P_m and P_m / m, each complex.
            let mut y = [[0.0; BATCH]; 6];
            for m in k.max(1)..=order {
                let (f, g) = (FACTORIALS[n + m], FACTORIALS[n + m] / m as f64);
                let j = at(m, k);
                for part in 0..2 {
                    for l in 0..BATCH {
                        y[part][l] += f * tb[j + part][l];
                        y[2 + part][l] += f * pb[j + part][l];
                        y[4 + part][l] += g * pb[j + part][l];
                    }
                }
            }
            let i = at(n, k);
            let sign = if (n + k) % 2 == 0 { -1.0 } else { 1.0 };
            let h = k as f64 / n as f64;
            for l in 0..BATCH {
                let (pr, pi) = (pa[i][l], pa[i + 1][l]);
                let (tr, ti) = (ta[i][l], ta[i + 1][l]);
                let pt = pr * y[0][l] + pi * y[1][l];
                let tp = tr * y[2][l] + ti * y[3][l];
                // The real part of -i z is the imaginary part of z, here P_n conj P_m.
                let pp = h * (pi * y[4][l] - pr * y[5][l]);
                sum[l] += sign * (pt + tp + pp);
            }
        }
        let weight = if k == 0 { 1.0 } else { 2.0 };
        for l in 0..BATCH {
            total[l] += weight * sum[l];
        }
    }
    total
}
