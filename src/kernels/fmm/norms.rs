//! Norms of the moments of a node: what the bound of the remainder takes of them.
//!
//! The norm of `P_n` is the root of the sum over all `k` of `(n - k)! (n + k)! |P_n^k|^2`, which no rotation changes. For
//! one point at `x` it is that of `t . grad` of the harmonics, at most `n |x|^(n - 1)` for a unit tangent `t`; that of
//! `T_n`, whose `x cross t` is across `x`, is at most `root(n (n + 1) / 2) |x|^n`. So the means of the powers of `|x|` over the
//! node bound the degrees that are not stored, and strands that cancel lower those that are.

use super::bound::ROUNDING;
use super::harmonics::{MOST, at};
use super::tree::{Ball, Tree};

/// The norms of all nodes of a tree: of `P`, then of `T`, for degrees 1 to one above the order.
#[derive(Clone, Debug)]
pub(super) struct Norms {
    order: usize,
    values: Vec<f64>,
}

/// Rounding of moments by the largest that they can be: see [`ROUNDING`].
const SLACK: f64 = ROUNDING;

/// The factors `(n - k)! (n + k)!`, twice those for `k > 0`.
const WEIGHTS: [[f64; MOST + 1]; MOST + 1] = {
    let mut f = [1.0; 2 * MOST + 1];
    let mut n = 1;
    while n < f.len() {
        f[n] = f[n - 1] * n as f64;
        n += 1;
    }
    let mut w = [[0.0; MOST + 1]; MOST + 1];
    let mut n = 0;
    while n <= MOST {
        let mut k = 0;
        while k <= n {
            w[n][k] = f[n - k] * f[n + k] * if k == 0 { 1.0 } else { 2.0 };
            k += 1;
        }
        n += 1;
    }
    w
};

impl Norms {
    pub fn new(order: usize, nodes: usize) -> Norms {
        Norms {
            order,
            values: vec![0.0; nodes * Norms::width(order)],
        }
    }

    /// Numbers of a node.
    const fn width(order: usize) -> usize {
        2 * (order + 1)
    }

    /// All numbers, and how many there are of a node.
    pub fn parts(&mut self) -> (&mut [f64], usize) {
        (&mut self.values, Norms::width(self.order))
    }

    /// Norms of `P` and of `T` from degree 1 on, in units of the node.
    #[inline(always)]
    pub fn of(&self, place: usize) -> [&[f64]; 2] {
        let width = Norms::width(self.order);
        let both = &self.values[place * width..][..width];
        let (p, t) = both.split_at(self.order + 1);
        [p, t]
    }

    /// Those of a node of these segments, with these moments.
    pub fn fill(
        order: usize,
        tree: &Tree,
        range: std::ops::Range<usize>,
        ball: &Ball,
        moments: &[f64],
        out: &mut [f64],
    ) {
        let (length, radius) = (ball.length / ball.size, ball.radius / ball.size);
        let (p, t) = moments.split_at(super::harmonics::count(order));
        let (out_p, out_t) = out.split_at_mut(order + 1);
        let mut power = 1.0;
        for n in 1..=order {
            let norm = |m: &[f64]| {
                let square = |k: usize| {
                    let (re, im) = (m[at(n, k)], m[at(n, k) + 1]);
                    WEIGHTS[n][k] * (re * re + im * im)
                };
                (0..=n).map(square).sum::<f64>().sqrt()
            };
            let [most_p, most_t] = most(n, length * power, radius);
            out_p[n - 1] = (norm(p) + SLACK * most_p).min(most_p) * UP;
            out_t[n - 1] = (norm(t) + SLACK * most_t).min(most_t) * UP;
            power *= radius;
        }
        // The integral of |x|^order.
        let integral = powers(order, tree, range, ball).min(length * power);
        [out_p[order], out_t[order]] = most(order + 1, integral, radius).map(|x| x * UP);
    }
}

/// Covers the rounding of a norm.
const UP: f64 = 1.0 + 1e-10;

/// The largest norms of degree `n`, by the integral of `|x|^(n - 1)`.
fn most(n: usize, integral: f64, radius: f64) -> [f64; 2] {
    let n = n as f64;
    [
        n * integral,
        (0.5 * n * (n + 1.0)).sqrt() * integral * radius,
    ]
}

/// An upper bound of the integral of `|x|^order` over segments, in units of the node.
///
/// On a segment the power is convex, so it is below its chords between both ends and the middle.
fn powers(order: usize, tree: &Tree, range: std::ops::Range<usize>, ball: &Ball) -> f64 {
    let half = order / 2;
    let unit = 1.0 / ball.size;
    let [starts, ends] = &tree.ends;
    let [a, b] = [starts, ends].map(|e| e.each_ref().map(|e| &e[range.clone()]));
    let mut sum = 0.0;
    for k in 0..a[0].len() {
        let (mut first, mut middle, mut last, mut side) = (0.0, 0.0, 0.0, 0.0);
        for x in 0..3 {
            let p = (a[x][k] - ball.centre[x]) * unit;
            let q = (b[x][k] - ball.centre[x]) * unit;
            let m = 0.5 * (p + q);
            first += p * p;
            middle += m * m;
            last += q * q;
            let e = (b[x][k] - a[x][k]) * unit;
            side += e * e;
        }
        let [mut f, mut m, mut l] = [1.0; 3];
        for _ in 0..half {
            f *= first;
            m *= middle;
            l *= last;
        }
        sum += side.sqrt() * (f + 2.0 * m + l);
    }
    // An odd order has one more factor, at most the radius.
    let odd = if order % 2 == 1 {
        ball.radius * unit
    } else {
        1.0
    };
    0.25 * sum * odd * UP
}
