//! Moments of pieces of a curve, up to the quadrupole (Qu & James 2021, equations 11 to 13).

use crate::curve::Point;

/// Number of components of the moments of a node.
pub(super) const COUNT: usize = 30;

/// Moments about a centre, with `p` the displacement from it: `c_i`, the integral of `dr_i`;
/// `d_ij`, that of `dr_i p_j`; `q_ijk`, that of `dr_i p_j p_k`, for `jk` = xx, yy, zz, xy, xz, yz.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Moments(pub [f64; COUNT]);

/// Indices of each of the six products.
pub(super) const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// Returns the index of `d_ij`.
#[inline(always)]
pub(super) const fn d(i: usize, j: usize) -> usize {
    3 + 3 * i + j
}

/// Returns the index of `q_ijk`, for `jk` the product with this number.
#[inline(always)]
pub(super) const fn q(i: usize, pair: usize) -> usize {
    12 + 6 * i + pair
}

impl Moments {
    pub const ZERO: Moments = Moments([0.0; COUNT]);

    /// Adds the moments of a segment with direction `c` and displacement `r` of its midpoint.
    pub fn add_segment(&mut self, c: Point, r: Point) {
        let m = &mut self.0;
        for i in 0..3 {
            m[i] += c[i];
            for (j, r) in r.iter().enumerate() {
                m[d(i, j)] += c[i] * r;
            }
            for (n, &(j, k)) in PAIRS.iter().enumerate() {
                m[q(i, n)] += c[i] * (r[j] * r[k] + c[j] * c[k] / 12.0);
            }
        }
    }

    /// Adds the moments of a child whose centre has the displacement `r`.
    pub fn add_shifted(&mut self, child: &Moments, r: Point) {
        let (m, c) = (&mut self.0, &child.0);
        for i in 0..3 {
            m[i] += c[i];
            for (j, r) in r.iter().enumerate() {
                m[d(i, j)] += c[d(i, j)] + c[i] * r;
            }
            for (n, &(j, k)) in PAIRS.iter().enumerate() {
                let mixed = c[d(i, j)] * r[k] + c[d(i, k)] * r[j];
                m[q(i, n)] += c[q(i, n)] + mixed + c[i] * r[j] * r[k];
            }
        }
    }
}
