//! Proven bound of the remainder of a truncated multipole expansion.
//!
//! # Bound of the remainder
//!
//! Two pieces of curves with centres `R` apart contribute the integral of
//! `F(R + d) . (dr1 x dr2) / 4 pi`, where `F(x) = x / |x|^3` and `d = p1 - p2` is the difference of
//! the displacements from the centres. By the Legendre series,
//!
//! ```text
//! 1 / |R + d| = sum over n of H_n(d),    H_n(d) = (-1)^n |d|^n P_n(cos t) / |R|^(n + 1),
//! ```
//!
//! where `t` is the angle between `R` and `d`, for `|d| < |R|`; and `F` is minus the gradient of
//! the series. The length of the gradient of `H_n` is `|d|^(n - 1) / |R|^(n + 1)` times the root of
//! `n^2 P_n^2 + (dP_n / dt)^2`. As `P_n(cos t)` is a trigonometric polynomial of degree `n` in `t`,
//! with absolute values of at most 1, that root is at most `n` (Bernstein and Szegő). So the part
//! of `F` of degree `m = n - 1` in `d` is at most `(m + 1) |d|^m / |R|^(m + 2)`. Let `m` be the
//! smallest truncated degree, and let `rho >= |d|` and `q = rho / |R| < 1`. Then the remainder is
//! at most
//!
//! ```text
//! L1 L2 / (4 pi |R|^2)
//!     [ (m + 1) W_m / |R|^m + W_(m + 1) / |R|^(m + 1) (m + 2 - (m + 1) q) / (1 - q)^2 ]
//! ```
//!
//! since the sum of `(k + 1) q^(k - M)` over `k >= M` is `(M + 1 - M q) / (1 - q)^2`. Here `L1` and
//! `L2` are the lengths of the pieces and `W_k` is the mean of `|t1 x t2| |d|^k` over all pairs of
//! their points, by length, with unit tangents `t`. `W_k` is far below `rho^k`, because few points
//! are as far from the centre as the farthest, and because neighbouring strands are often parallel.
//! By the inequality of Cauchy and Schwarz, with `E_k` the mean of `|d|^k` and `s^2` that of
//! `|t1 x t2|^2`,
//!
//! ```text
//! W_2 <= min(E_2, s root(E_4)),    W_3 <= root(E_4) min(root(E_2), s rho),
//! W_4 <= root(E_4) min(root(E_4), s rho^2).
//! ```
//!
//! These means follow from those of each piece, because its centre is its centroid by length, where
//! the mean of `p` is 0: `E_2 = <p1^2> + <p2^2>`, and `E_4 <= <p1^4> + <p2^4> + 6 <p1^2> <p2^2>`,
//! because the mean of `(p1 . p2)^2` is at most `<p1^2> <p2^2>`. Last, `s^2 = 1 - tr(S1 S2)` with
//! `S` the mean of `t t^T`.

use super::Order;
use crate::curve::Point;
use crate::curve::pow2;

/// Geometric data of a piece of a curve that the bound depends on.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(32))]
pub(super) struct Reach {
    /// Centre of the expansion: the centroid by length, rounded.
    pub centre: Point,
    /// Upper bound of the distance of its points from the centre.
    pub radius: f64,
    /// Total length of the segments.
    pub length: f64,
    /// Upper bound of the mean of the squared distance from the centre.
    pub second: f64,
    /// Upper bound of the mean of the fourth power of the distance.
    pub fourth: f64,
    /// Means of the products of the coordinates of the unit tangent: xx, yy, zz, xy, xz, yz.
    pub tangents: [f64; 6],
}

/// Error bounds of the contribution of a node pair.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::kernels::sums) struct Bounds {
    /// Bound of the remainder.
    pub tail: f64,
    /// Sum of the magnitudes of the terms, to which the rounding error is relative.
    pub size: f64,
}

impl Bounds {
    /// Value for a node pair that must not be expanded.
    const NONE: Bounds = Bounds {
        tail: f64::INFINITY,
        size: f64::INFINITY,
    };
}

/// Rounding error of the moments and of the evaluation of a node pair, relative to the sum of the
/// magnitudes of the terms.
///
/// Every displacement is a difference of two stored numbers and so has a relative error of
/// `u = 2^-53`. A moment is a sum of products of at most four such factors, shifted on each of at
/// most 32 levels by some 20 operations. Every intermediate value is at most 4 times the maximum of
/// the moment, `L rho^k`. So the error of a moment is below `2^12 u`. The evaluation adds some 60
/// operations on sums that are at most 4 times the product of the lengths of their factors. The
/// total is below `2^14 u`.
pub(super) const ROUNDING: f64 = pow2(-38);

/// Factor that covers the rounding of the bounds themselves, dozens of operations.
pub(in crate::kernels::sums) const OUTWARD: f64 = 1.0 + 1e-9;

/// Maximum of `rho / |R|` for which the series is used.
const WIDEST: f64 = 0.8;

/// Squared distance below which an expansion could underflow (coordinates are at most 1).
pub(in crate::kernels::sums) const NEAREST: f64 = pow2(-120);

/// Returns the error bounds of the expansion of a node pair; `square` is the squared distance of
/// the centres.
#[inline(always)]
pub(super) fn bounds(order: Order, square: f64, a: &Reach, b: &Reach) -> Bounds {
    let rho = a.radius + b.radius;
    // Written so that a NaN is rejected as well.
    let converges = square > NEAREST && rho * rho < WIDEST * WIDEST * square;
    if !converges {
        return Bounds::NONE;
    }
    let inverse = 1.0 / square.sqrt();
    let q = rho * inverse;
    let e2 = a.second + b.second;
    let root = (a.fourth + b.fourth + 6.0 * a.second * b.second).sqrt();
    let sine = parallel(&a.tangents, &b.tangents);
    let w3 = root * e2.sqrt().min(sine * rho);
    let geometric = 1.0 / ((1.0 - q) * (1.0 - q));
    let cube = inverse * inverse * inverse;
    let series = match order {
        Order::Dipole => {
            let w2 = e2.min(sine * root);
            3.0 * w2 * inverse * inverse + w3 * cube * (4.0 - 3.0 * q) * geometric
        }
        Order::Quadrupole => {
            let w4 = root * root.min(sine * rho * rho);
            4.0 * w3 * cube + w4 * cube * inverse * (5.0 - 4.0 * q) * geometric
        }
    };
    const SPHERE: f64 = 1.0 / (4.0 * std::f64::consts::PI);
    let scale = SPHERE * a.length * b.length * inverse * inverse;
    Bounds {
        tail: scale * series * OUTWARD,
        // The terms of degree 0, 1 and 2 are at most 1, 4 q and 12 q^2 times the scale.
        size: scale * (1.0 + q * (4.0 + 12.0 * q)),
    }
}

/// Returns an upper bound of the root mean square of the sine between the tangents of two pieces.
#[inline(always)]
fn parallel(s: &[f64; 6], t: &[f64; 6]) -> f64 {
    let squares = s[0] * t[0] + s[1] * t[1] + s[2] * t[2];
    let mixed = s[3] * t[3] + s[4] * t[4] + s[5] * t[5];
    // The constant exceeds the rounding error of the means.
    (1.0 - squares - 2.0 * mixed + 1e-11).clamp(0.0, 1.0).sqrt()
}
