//! Norms of the moments of a node, from which the bound of the remainder is computed.
//!
//! The norm of `P_n` is the root of the sum over all `k` of `(n - k)! (n + k)! |P_n^k|^2`, which is
//! invariant under rotation. For a single point at `x` it is the norm of `t . grad` of the
//! harmonics, at most `n |x|^(n - 1)` for a unit tangent `t`. The norm of `T_n`, whose `x cross t`
//! is orthogonal to `x`, is at most `root(n (n + 1) / 2) |x|^n`. So the means of the powers of
//! `|x|` over the node bound the degrees that are not stored. The stored degrees are smaller than
//! these bounds if strands cancel.

use super::bound::ROUNDING;
use super::harmonics::at;
use super::interact::FACTORIALS;
use super::tree::{Ball, GRAIN, Tree, segments_of};
use crate::kernels::sums::barnes_hut::Node;
use crate::kernels::sums::join;
use crate::simd::dispatch;
use std::ops::Range;

/// Returns the factor `(n - k)! (n + k)!`, doubled for `k > 0`.
fn weight(n: usize, k: usize) -> f64 {
    FACTORIALS[n - k] * FACTORIALS[n + k] * if k == 0 { 1.0 } else { 2.0 }
}

/// Returns the number of norms of a node: of `P`, then of `T`, for degrees 1 to one above the
/// order.
pub(super) const fn width(order: usize) -> usize {
    2 * (order + 1)
}

/// Lowers the norms of a node to those of its moments.
pub(super) fn tighten(order: usize, ball: &Ball, moments: &[f64], out: &mut [f64]) {
    let (length, radius) = (ball.length / ball.size, ball.radius / ball.size);
    let (p, t) = moments.split_at(super::harmonics::count(order));
    let (out_p, out_t) = out.split_at_mut(order + 1);
    let mut power = 1.0;
    for n in 1..=order {
        let [most_p, most_t] = most(n, length * power, radius);
        // The moments have a rounding error relative to their maximum.
        out_p[n - 1] = out_p[n - 1].min((norm(p, n) + ROUNDING * most_p) * UP);
        out_t[n - 1] = out_t[n - 1].min((norm(t, n) + ROUNDING * most_t) * UP);
        power *= radius;
    }
}

/// Computes upper bounds of the norms in a subtree, from the segments of its nodes.
pub(super) fn outline(tree: &Tree, order: usize, node: Node, out: &mut [f64]) {
    let (own, below) = out.split_at_mut(width(order));
    if !node.is_leaf() {
        let [a, b] = node.children();
        let (left, right) = below.split_at_mut((b.place - a.place) as usize * width(order));
        let lower = || outline(tree, order, a, left);
        let upper = || outline(tree, order, b, right);
        join(node.leaves as usize > GRAIN, lower, upper);
    }
    let ball = &tree.balls[node.place as usize];
    let (length, radius) = (ball.length / ball.size, ball.radius / ball.size);
    let (own_p, own_t) = own.split_at_mut(order + 1);
    let mut power = 1.0;
    for n in 1..=order {
        [own_p[n - 1], own_t[n - 1]] = most(n, length * power, radius).map(|x| x * UP);
        power *= radius;
    }
    let integral = dispatch!(powers(order, tree, segments_of(node), ball)).min(length * power);
    [own_p[order], own_t[order]] = most(order + 1, integral, radius).map(|x| x * UP);
}

/// Factor that covers the rounding of a norm.
const UP: f64 = 1.0 + 1e-10;

/// Returns the norm of degree `n` of one kind of moments.
pub(super) fn norm(moments: &[f64], n: usize) -> f64 {
    let square = |k: usize| {
        let (re, im) = (moments[at(n, k)], moments[at(n, k) + 1]);
        weight(n, k) * (re * re + im * im)
    };
    (0..=n).map(square).sum::<f64>().sqrt()
}

/// Returns upper bounds of the norms of degree `n`, from the integral of `|x|^(n - 1)`.
pub(super) fn most(n: usize, integral: f64, radius: f64) -> [f64; 2] {
    let n = n as f64;
    [
        n * integral,
        (0.5 * n * (n + 1.0)).sqrt() * integral * radius,
    ]
}

/// Returns an upper bound of the integral of `|x|^order` over segments, in units of the node.
///
/// On a segment the power is convex, so it is below its chords between both ends and the middle.
#[inline(always)]
fn powers(order: usize, tree: &Tree, range: Range<usize>, ball: &Ball) -> f64 {
    const TOGETHER: usize = 8;
    let half = order / 2;
    let unit = 1.0 / ball.size;
    let [starts, ends] = &tree.ends;
    let [a, b] = [starts, ends].map(|e| e.each_ref().map(|e| &e[range.clone()]));
    let mut sums = [0.0; TOGETHER];
    for start in (0..a[0].len()).step_by(TOGETHER) {
        let [mut first, mut middle, mut last, mut side] = [[0.0; TOGETHER]; 4];
        for x in 0..3 {
            for l in 0..TOGETHER {
                let (from, to) = (a[x][start + l], b[x][start + l]);
                let p = (from - ball.centre[x]) * unit;
                let q = (to - ball.centre[x]) * unit;
                let m = 0.5 * (p + q);
                let e = (to - from) * unit;
                first[l] += p * p;
                middle[l] += m * m;
                last[l] += q * q;
                side[l] += e * e;
            }
        }
        let [mut f, mut m, mut t] = [[1.0; TOGETHER]; 3];
        for _ in 0..half {
            for l in 0..TOGETHER {
                f[l] *= first[l];
                m[l] *= middle[l];
                t[l] *= last[l];
            }
        }
        for l in 0..TOGETHER {
            sums[l] += side[l].sqrt() * (f[l] + 2.0 * m[l] + t[l]);
        }
    }
    let sum: f64 = sums.iter().sum();
    // An odd order has one more factor, at most the radius.
    let odd = match order % 2 {
        1 => ball.radius * unit,
        _ => 1.0,
    };
    0.25 * sum * odd * UP
}
