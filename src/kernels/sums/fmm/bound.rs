//! Proven bound of the remainder of the interaction of a node pair.
//!
//! # Bound of a term
//!
//! In the frame of [`super::interact`] the terms of degrees `n` and `m` are diagonal in `k`. With
//! the norms of [`super::norms`], `N = n + m`, and
//!
//! ```text
//! (N)! / root((n - k)! (n + k)! (m - k)! (m + k)!) = root(C(N, n + k) C(N, n - k)) <= C(N, n),
//! ```
//!
//! the inequality of Cauchy and Schwarz bounds the terms, times 4 pi, by
//!
//! ```text
//! C(N, n) / R^(N + 1)
//!     [|P_n| |T_m| / (m + 1) + |T_n| |P_m| / (n + 1) + R K(n, m) / (n m) |P_n| |P_m|]
//! ```
//!
//! where `K` is the largest `k root(C(N, n + k) C(N, n - k)) / C(N, n)`. The ratio of binomials is
//! the product over `i` from 1 to `k` of `(m - i + 1)(n - i + 1) / ((n + i)(m + i))`, which
//! increases with `n`. Without the factors of `n` it is a bound `K(m)` for all `n`, and likewise
//! `K(n)`; and `K <= min(n, m)`.
//!
//! # Bound of the remainder
//!
//! The remainder consists of the terms with a degree above the order `p`:
//!
//! 1. `n > p >= m`: from degree `n` to the next, the bound by lengths grows by `(N + 1) / n r / R`
//!    at most, with `r` the radius of the node, because the norm of `P_n` grows by `(n + 1) / n r`,
//!    and that of `T_n / (n + 1)` by less. So the sum over all `n` is that of degree `p + 1`,
//!    divided by `1 - (1 + (m + 1) / (p + 1)) r / R`.
//! 2. `m > p >= n`: as 1, with `n` and `m` exchanged.
//! 3. Both above `p`: with `|P_n| <= n L r^(n - 1)`, `|T_n| / (n + 1) <= L r^n / root 2`, and the
//!    binomial series of `q^N = (r1 + r2)^N / R^N`, all terms with `n + m = N` are at most
//!    `4 N q^(N - 2) L1 L2 / R^2`. The sum of that from `N = M = 2 p + 2` on is
//!    `4 q^(M - 2) (M - (M - 1) q) / (1 - q)^2`.
//!
//! The last formula with `M = 2` also bounds the sum of the magnitudes of all terms, to which the
//! rounding of their sum is relative.

use super::harmonics::MOST;
use super::tree::Ball;
use crate::curve::Point;
use crate::curve::pow2;
use crate::curve::vector::per_axis;
use crate::kernels::sums::barnes_hut::{Bounds, NEAREST, OUTWARD};
use std::f64::consts::PI;

/// Rounding error of a term of degree `n`, divided by `(n + 2)^2` and by the maximum of the term.
/// It covers the moments of both nodes and their interaction.
///
/// # Proof
///
/// Every displacement is a difference of two stored numbers and so has a relative error of
/// `u = 2^-53`. Harmonics of degree `n` are computed in `2 n` steps of a few operations, means over
/// segments in as many; an error in one of them grows at most as the degree. A shift, on each of at
/// most 32 levels, sums `(n + 1)^2` products. An interaction adds four rotations by `2 n` terms a
/// row and a sum over `p` degrees. In total, degree `n` is off by less than `2^7 (n + 2)^2 u` times
/// its maximum. The remaining factor is for both nodes, their product, and the following
/// operations.
///
/// That maximum is over the ball of the node in which the rounding happened, which may be a
/// descendant. Shifts are exact maps of the errors made before them, and they compose. So, seen
/// from the centre of the node itself, the error of a descendant is as that of moments in the ball
/// of the descendant, whose points are at most [`Ball::spread`] away. So the bound of all terms of
/// degree `N`, `4 N q^(N - 2) L1 L2 / R^2`, holds for the errors with the spreads in place of the
/// radii.
pub(super) const ROUNDING: f64 = pow2(-44);

/// Maximum of `(r1 + r2) / R` for which the series is used.
pub(super) const WIDEST: f64 = 0.8;

/// Maximum of `(1 + (m + 1) / (p + 1)) r / R`, which is at most `2 r / R`.
const STEEPEST: f64 = 0.9;

/// Returns the binomials `C(p + 1 + m, m)` for the order `p`.
fn binomials(order: usize) -> [f64; MOST + 1] {
    let mut c = [1.0; MOST + 1];
    for m in 1..=MOST {
        c[m] = c[m - 1] * (order + 1 + m) as f64 / m as f64;
    }
    c
}

/// Returns `K(m) / m`.
fn twists() -> [f64; MOST + 1] {
    let mut out = [0.0; MOST + 1];
    for m in 1..=MOST {
        let (mut ratio, mut most) = (1.0, 0.0f64);
        for k in 1..=m {
            ratio *= (m + 1 - k) as f64 / (m + k) as f64;
            most = most.max(k as f64 * f64::sqrt(ratio));
        }
        out[m] = most / m as f64;
    }
    out
}

/// Constants of the bound for one order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounding {
    order: usize,
    binomials: [f64; MOST + 1],
    twists: [f64; MOST + 1],
}

impl Bounding {
    pub fn new(order: usize) -> Bounding {
        Bounding {
            order,
            binomials: binomials(order),
            twists: twists(),
        }
    }

    /// Returns the difference of the centres, their distance, and the sum of the radii divided by
    /// the distance; at least 1 if no series is used.
    #[inline(always)]
    pub fn separation(a: &Ball, b: &Ball) -> (Point, f64, f64) {
        let r = per_axis(|x| a.centre[x] - b.centre[x]);
        let square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
        if square > NEAREST {
            let distance = square.sqrt();
            (r, distance, (a.radius + b.radius) / distance)
        } else {
            (r, 1.0, f64::INFINITY)
        }
    }

    /// Returns the error bounds of the interaction of a node pair with this distance and
    /// separation, or `None` if no series is used.
    #[inline(always)]
    pub fn bounds(
        &self,
        [a, b]: [&Ball; 2],
        norms: [[&[f64]; 2]; 2],
        distance: f64,
        q: f64,
    ) -> Option<Bounds> {
        let inverse = 1.0 / distance;
        let steepest = |ball: &Ball| 2.0 * ball.radius * inverse;
        // Written so that a NaN is rejected as well.
        if !(q < WIDEST && steepest(a) < STEEPEST && steepest(b) < STEEPEST) {
            return None;
        }
        let edge = |x: usize, ball: &Ball, other: &Ball| {
            self.edge(
                norms[x],
                norms[1 - x],
                [ball.size * inverse, other.size * inverse],
            ) / (1.0 - steepest(ball))
        };
        let lengths = a.length * b.length * inverse * inverse;
        let geometric = 4.0 / ((1.0 - q) * (1.0 - q));
        let least = (2 * self.order + 2) as f64;
        let corner =
            lengths * geometric * q.powi(2 * self.order as i32) * (least - (least - 1.0) * q);
        let sphere = 1.0 / (4.0 * PI);
        Some(Bounds {
            tail: (edge(0, a, b) + edge(1, b, a) + corner) * sphere * OUTWARD,
            size: lengths * geometric * (2.0 - q) * sphere,
        })
    }

    /// Returns a bound of the rounding error of the interaction of a node pair at this distance:
    /// see [`ROUNDING`].
    #[inline(always)]
    pub fn rounding(&self, [a, b]: [&Ball; 2], distance: f64) -> f64 {
        let inverse = 1.0 / distance;
        let t = (a.spread + b.spread) * inverse;
        let weight = |degree: usize| (degree * (degree + 2) * (degree + 2)) as f64;
        let degrees = (2..=2 * self.order).rev();
        let series = degrees.fold(0.0, |sum, degree| sum * t + weight(degree));
        let lengths = a.length * b.length * inverse * inverse;
        ROUNDING * OUTWARD * lengths * series / PI
    }

    /// Returns the bound of the terms of degree `p + 1` of one node and of degrees 1 to `p` of the
    /// other one.
    #[inline(always)]
    fn edge(&self, [p, t]: [&[f64]; 2], [op, ot]: [&[f64]; 2], [own, other]: [f64; 2]) -> f64 {
        let n = self.order + 1;
        let mut power = 1.0;
        let [mut with_p, mut with_t, mut with_twist] = [0.0; 3];
        for m in 1..=self.order {
            power *= other;
            let f = self.binomials[m] * power;
            with_t += f * op[m - 1];
            with_p += f * other * ot[m - 1] / (m + 1) as f64;
            with_twist += f * self.twists[m] * op[m - 1];
        }
        let scale = own.powi(n as i32);
        scale
            * (p[n - 1] * (with_p + with_twist / n as f64)
                + t[n - 1] * own * with_t / (n + 1) as f64)
    }
}
