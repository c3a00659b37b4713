//! Twist of a ribbon between two closed polygons, in interval arithmetic.
//!
//! # Ribbon
//!
//! The axis `A` has vertices `a_i`, the edge of the ribbon vertices `b_i`, `i` modulo `n`. The
//! ribbon joins the points of both polygons with the same parameter: it is spanned by the vector
//! `u` from the axis to the edge, with `u_i = b_i - a_i` at vertex `i`, linear in between. A corner
//! of the axis is understood as an arc, as small as one likes, on which the tangent turns from the
//! direction `p` of one segment to the direction `q` of the next on the shorter great circle, while
//! `u` is constant.
//!
//! The twist is the number of turns of the part of `u` across the tangent `T`, about `T`, relative
//! to a frame that is transported in parallel (Bishop 1975; Bergou et al. 2008):
//! `Tw = 1 / (2 pi) integral of (w x dw) . T` for the unit vector `w` along `u - (u . T) T`.
//!
//! # Angles
//!
//! *On a segment* with direction `q` the part of `u` across `q` moves on a straight line of the
//! plane across `q`, from the part of `u_i` to that of `u_(i+1)`. Unless this line meets the axis,
//! it turns by less than half a turn, by the argument of
//!
//! ```text
//! (u_i x q) . (u_(i+1) x q) + i |q| q . (u_i x u_(i+1)).
//! ```
//!
//! *At a corner* with unit tangents `p`, `q`, the frame `(b x T, b, T)` with `b` along `p x q` is
//! transported in parallel, because `T` stays in a plane. In it `u` has the coordinates `x`, `c`,
//! where `c = u . b` is constant, so that it stays on one side of the line `c = 0` and turns by
//! less than half a turn, by the argument of `(x1 + i c) (x0 - i c)`. With `alpha = u . p`,
//! `beta = u . q` and `k = p . q`,
//!
//! ```text
//! x0 = (beta - k alpha) / |p x q|,   x1 = (k beta - alpha) / |p x q|,   c = u . (p x q) / |p x q|,
//! ```
//!
//! and `|u|^2 = x0^2 + c^2 + alpha^2`, `|p x q|^2 = (1 - k) (1 + k)`. So, times `1 + k > 0`, this
//! number is
//!
//! ```text
//! (1 + k) |u|^2 - alpha^2 - beta^2 - (1 - k) alpha beta + i (alpha + beta) u . (p x q),
//! ```
//!
//! which is also right for `p = q`. An angle is undecided if its number may be 0 or negative: then
//! `u` may become parallel to the tangent, or the axis folds back on itself.

use crate::curve::Point;
use crate::curve::vector::{cross, dot, sub};
use crate::kernels::sums::interval::{Interval, Vector, cube, length};
use rayon::prelude::*;

/// Number of vertices per parallel task.
const GRAIN: usize = 1 << 10;

/// Returns the twist of the ribbon between two closed polygons with the same number of vertices,
/// whose coordinates are at most 1. An undecided angle adds an interval of half a turn in both
/// directions.
pub(super) fn twist(axis: &[Point], edge: &[Point]) -> Interval {
    let n = axis.len();
    if n < 3 || edge.len() != n {
        return Interval::ENTIRE;
    }
    let at = |points: &[Point], i: usize| points[i % n].map(|x| cube(x, 0.0));
    let across = |i: usize| sub(at(edge, i), at(axis, i));
    let parts = (0..n.div_ceil(GRAIN)).into_par_iter().map(|k| {
        let vertices = k * GRAIN..n.min((k + 1) * GRAIN);
        vertices.fold(Interval::ZERO, |sum, i| {
            let [a, b, c] = [i + n - 1, i, i + 1].map(|i| at(axis, i));
            let (u, v) = (across(i), across(i + 1));
            sum + corner(sub(b, a), sub(c, b), u) + segment(sub(c, b), u, v)
        })
    });
    let parts: Vec<Interval> = parts.collect();
    let sum = parts.into_iter().fold(Interval::ZERO, |a, b| a + b);
    sum / (Interval::PI + Interval::PI)
}

/// Returns the angle about `q` from `u` to `v`, each projected onto the plane perpendicular to `q`;
/// the interval of all angles if it is undecided.
fn segment(q: Vector, u: Vector, v: Vector) -> Interval {
    let real = dot(cross(u, q), cross(v, q));
    let imaginary = length(q) * dot(q, cross(u, v));
    Interval::argument(real, imaginary).unwrap_or(Interval::HALF_TURN)
}

/// Returns the angle at a corner, from direction `p` to direction `q`, by which the part of `u`
/// perpendicular to the tangent turns; the interval of all angles if it is undecided.
fn corner(p: Vector, q: Vector, u: Vector) -> Interval {
    let one = Interval::point(1.0);
    let [p, q] = [p, q].map(|side| {
        let length = length(side);
        side.map(|x| x / length)
    });
    let k = dot(p, q);
    let (alpha, beta) = (dot(u, p), dot(u, q));
    let squares = u[0].square() + u[1].square() + u[2].square();
    let real = (one + k) * squares - alpha.square() - beta.square() - (one - k) * (alpha * beta);
    let imaginary = (alpha + beta) * dot(u, cross(p, q));
    Interval::argument(real, imaginary).unwrap_or(Interval::HALF_TURN)
}
