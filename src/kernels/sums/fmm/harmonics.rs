//! Solid harmonics, and the moments of segments and nodes.
//!
//! # Definitions
//!
//! With `r, theta, phi` of a displacement,
//!
//! ```text
//! R_n^k = r^n P_n^k(cos theta) e^(i k phi) / (n + k)!
//! ```
//!
//! (with the phase of Condon and Shortley), for `k >= 0`; the others follow from
//! `R_n^-k = (-1)^k conj R_n^k`. In this scaling derivatives and translations have no factors
//! (Dehnen 2014, *A fast multipole method for stellar dynamics*, section 3.2 and appendix A):
//!
//! ```text
//! d/dz R_n^k = R_(n-1)^k
//! (d/dx + i d/dy) R_n^k = R_(n-1)^(k+1),   (d/dx - i d/dy) R_n^k = -R_(n-1)^(k-1)
//! R_n^k(x + r) = sum over j, l of R_j^l(x) R_(n-j)^(k-l)(r)
//! ```
//!
//! A piece of a curve has two moments of each degree, about a centre, with `x` the displacement
//! from it:
//!
//! ```text
//! P_n^k = integral of grad R_n^k . dx            T_n^k = integral of grad R_n^k . (x cross dx)
//! ```
//!
//! They are exact for straight segments: with `I_n^k` the mean of `R_n^k` over the segment from `p`
//! to `q`, `(n + 1) I_n = R_n(q) + p . grad I_n` by Euler's theorem, and gradients are sums of
//! harmonics of the previous degree.

use crate::curve::Point;
use crate::curve::vector::per_axis;

/// Maximum order.
pub(super) const MOST: usize = 20;

/// Returns the index of the real part of degree `n` and order `k >= 0`; the imaginary part is next.
#[inline(always)]
pub(super) const fn at(n: usize, k: usize) -> usize {
    n * (n + 1) + 2 * k
}

/// Returns the number of components of one kind of moments up to this degree.
pub(super) const fn count(order: usize) -> usize {
    (order + 1) * (order + 2)
}

/// A number in each of `L` lanes.
pub(super) type Lanes<const L: usize> = [f64; L];

/// A complex number in each lane.
type Complex<const L: usize> = [Lanes<L>; 2];

#[inline(always)]
fn map<const L: usize>(f: impl Fn(usize) -> f64) -> Lanes<L> {
    std::array::from_fn(f)
}

/// Returns the component of degree `n` and order `k` from -n-1 to n+1; 0 if `|k| > n`.
#[inline(always)]
fn get<const L: usize>(a: &[Lanes<L>], n: usize, k: isize) -> Complex<L> {
    let m = k.unsigned_abs();
    if m > n {
        return [[0.0; L]; 2];
    }
    let i = at(n, m);
    let [re, im] = [a[i], a[i + 1]];
    if k >= 0 {
        return [re, im];
    }
    if m.is_multiple_of(2) {
        [re, im.map(|x| -x)]
    } else {
        [re.map(|x| -x), im]
    }
}

/// Computes the regular solid harmonics up to an order.
#[inline(always)]
pub(super) fn regular<const L: usize>(order: usize, x: &[Lanes<L>; 3], out: &mut [Lanes<L>]) {
    let square: Lanes<L> = map(|l| x[0][l] * x[0][l] + x[1][l] * x[1][l] + x[2][l] * x[2][l]);
    out[0] = [1.0; L];
    out[1] = [0.0; L];
    for k in 1..=order {
        let [re, im] = [out[at(k - 1, k - 1)], out[at(k - 1, k - 1) + 1]];
        let f = -0.5 / k as f64;
        out[at(k, k)] = map(|l| f * (x[0][l] * re[l] - x[1][l] * im[l]));
        out[at(k, k) + 1] = map(|l| f * (x[0][l] * im[l] + x[1][l] * re[l]));
    }
    for n in 1..=order {
        for k in 0..n {
            let divisor = 1.0 / ((n + k) * (n - k)) as f64;
            let f = (2 * n - 1) as f64 * divisor;
            for part in 0..2 {
                let before = out[at(n - 1, k) + part];
                let older = if k + 2 <= n {
                    out[at(n - 2, k) + part]
                } else {
                    [0.0; L]
                };
                out[at(n, k) + part] =
                    map(|l| f * x[2][l] * before[l] - divisor * square[l] * older[l]);
            }
        }
    }
}

/// Returns the coefficient of degree `n` and order `k >= 0` of `v . grad` of a function with the
/// coefficients `a`. Reads those of degree `n - 1`.
#[inline(always)]
fn along<const L: usize>(v: &[Lanes<L>; 3], a: &[Lanes<L>], n: usize, k: usize) -> Complex<L> {
    let k = k as isize;
    let [zr, zi] = get(a, n - 1, k);
    let [ur, ui] = get(a, n - 1, k + 1);
    let [wr, wi] = get(a, n - 1, k - 1);
    // v_z a_k + (v_x - i v_y) / 2 a_(k + 1) - (v_x + i v_y) / 2 a_(k - 1)
    [
        map(|l| v[2][l] * zr[l] + 0.5 * (v[0][l] * (ur[l] - wr[l]) + v[1][l] * (ui[l] + wi[l]))),
        map(|l| v[2][l] * zi[l] + 0.5 * (v[0][l] * (ui[l] - wi[l]) - v[1][l] * (ur[l] + wr[l]))),
    ]
}

/// Adds the moments of one segment in each lane, from `p` to `p + e`, to the sums of all lanes:
/// `P`, then `T`. The buffers have as many components as one kind of moments.
#[inline(always)]
pub(super) fn add_segments<const L: usize>(
    order: usize,
    p: &[Lanes<L>; 3],
    e: &[Lanes<L>; 3],
    [end, mean]: &mut [Vec<Lanes<L>>; 2],
    out: &mut [Lanes<L>],
) {
    let q = per_axis(|x| map(|l| p[x][l] + e[x][l]));
    let turn =
        [(1, 2), (2, 0), (0, 1)].map(|(x, y)| map(|l| p[x][l] * e[y][l] - p[y][l] * e[x][l]));
    regular(order - 1, &q, end);
    mean[0] = [1.0; L];
    mean[1] = [0.0; L];
    let (out_p, out_t) = out.split_at_mut(count(order));
    for n in 1..=order {
        for k in 0..=n {
            let i = at(n, k);
            if n < order {
                let shifted = along(p, mean, n, k);
                let f = 1.0 / (n + 1) as f64;
                for part in 0..2 {
                    mean[i + part] = map(|l| f * (end[i + part][l] + shifted[part][l]));
                }
            }
            let [re, im] = along(e, mean, n, k);
            let [tr, ti] = along(&turn, mean, n, k);
            for l in 0..L {
                out_p[i][l] += re[l];
                out_p[i + 1][l] += im[l];
                out_t[i][l] += tr[l];
                out_t[i + 1][l] += ti[l];
            }
        }
    }
}

/// Adds the moments of a child at displacement `r`, in units of its own size, to those of its
/// parent. Both are `P`, then `T`; `r` and `ratio`, the unit of the child, are in units of the
/// parent.
///
/// With `x + r` in place of `x`, `T` gains the integral of `grad R . (r cross dx)`, which by the
/// decomposition of [`super::interact`] is a sum of moments about the centre of the child.
pub(super) fn add_shifted(order: usize, child: &[f64], ratio: f64, r: Point, out: &mut [f64]) {
    let size = count(order);
    // Moments of the child in the units of the parent; `T` also about the parent's centre.
    let [mut p, mut t, mut turned, mut harmonics] = [(); 4].map(|()| vec![[0.0]; size]);
    let mut power = 1.0;
    for n in 1..=order {
        power *= ratio;
        for i in at(n, 0)..at(n + 1, 0) {
            p[i] = [child[i] * power];
            t[i] = [child[size + i] * power * ratio];
        }
    }
    let v = r.map(|x| [x]);
    regular(order - 1, &v, &mut harmonics);
    for n in 1..=order {
        let f = 1.0 / n as f64;
        for k in 0..=n {
            let i = at(n, k);
            let [zr, zi] = get(&p, n, k as isize);
            let [ur, ui] = get(&p, n, k as isize + 1);
            let [wr, wi] = get(&p, n, k as isize - 1);
            let up = 0.5 * (n + k + 1) as f64;
            let down = 0.5 * (n + 1) as f64 - 0.5 * k as f64;
            let z = r[2] * k as f64;
            // r . (x cross grad) of R is i times this.
            let re = z * zr[0]
                + up * (r[0] * ur[0] + r[1] * ui[0])
                + down * (r[0] * wr[0] - r[1] * wi[0]);
            let im = z * zi[0]
                + up * (r[0] * ui[0] - r[1] * ur[0])
                + down * (r[0] * wi[0] + r[1] * wr[0]);
            let [gr, gi] = along(&v, &t, n, k);
            turned[i] = [t[i][0] + f * (gr[0] - im)];
            turned[i + 1] = [t[i + 1][0] + f * (gi[0] + re)];
        }
    }
    let (out_p, out_t) = out.split_at_mut(size);
    for n in 1..=order {
        for k in 0..=n {
            let mut sums = [0.0; 4];
            for j in 1..=n {
                let m = (n - j) as isize;
                let first = (k as isize - m).max(-(j as isize));
                let last = (k as isize + m).min(j as isize);
                for l in first..=last {
                    let [hr, hi] = get(&harmonics, n - j, k as isize - l);
                    let [pr, pi] = get(&p, j, l);
                    let [tr, ti] = get(&turned, j, l);
                    sums[0] += hr[0] * pr[0] - hi[0] * pi[0];
                    sums[1] += hr[0] * pi[0] + hi[0] * pr[0];
                    sums[2] += hr[0] * tr[0] - hi[0] * ti[0];
                    sums[3] += hr[0] * ti[0] + hi[0] * tr[0];
                }
            }
            let i = at(n, k);
            out_p[i] += sums[0];
            out_p[i + 1] += sums[1];
            out_t[i] += sums[2];
            out_t[i + 1] += sums[3];
        }
    }
}
