//! Rigorous linking numbers of curves whose positions are uncertain.
//!
//! [`enclose`] is Arai's method (Arai 2013, algorithms 1 and 3, remark 4): his sum in interval
//! arithmetic, for vertices anywhere within cubes. [`noise`] decides the same question for far
//! larger cubes, and faster.
//!
//! Cost: quadratic, some hundred times that of [`super::direct`].
//!
//! Every other kernel is faster. This one is a referee: it relies neither on error bounds proven by
//! hand nor on functions of a library, only on the rounding of single operations.

pub(crate) mod noise;
mod number;
#[cfg(test)]
mod tests;

pub(crate) use number::Interval;

use super::direct::Vertices;
use crate::curve::vector::{cross, dot, sub};
use crate::curve::{CurveSet, Point};
use crate::pairs::Pair;
use rayon::prelude::*;

pub(crate) type Vector = [Interval; 3];

/// Returns an interval of all linking numbers that two closed polylines can have if each vertex is
/// anywhere in a cube of half-width `noise` around its position. Returns [`Interval::ENTIRE`] if
/// one of the curves is open or a spline.
pub(crate) fn enclose(set: &CurveSet, (i, j): Pair, noise: f64) -> Interval {
    let vertices = Vertices::new(set);
    let both = [i, j].map(|i| vertices.of(i as usize));
    let [Some(first), Some(second)] = both else {
        return Interval::ENTIRE;
    };
    if noise.is_nan() || noise < 0.0 || i == j {
        return Interval::ENTIRE;
    }
    let radius = match noise {
        0.0 => 0.0,
        _ => vertices.scale.apply(noise).next_up(),
    };
    let cubes = |axes: [&[f64]; 3]| -> Vec<Vector> {
        let point = |k: usize| axes.map(|v| cube(v[k], radius));
        (0..axes[0].len()).map(point).collect()
    };
    let (first, second) = (cubes(first), cubes(second));
    let row = |k: &[Vector]| {
        let angles = first.windows(2).map(|l| angle([k[0], k[1]], [l[0], l[1]]));
        angles.fold(Interval::ZERO, |sum, angle| sum + angle)
    };
    let rows: Vec<Interval> = second.par_windows(2).map(row).collect();
    let sum = rows.into_iter().fold(Interval::ZERO, |sum, row| sum + row);
    sum / (Interval::PI + Interval::PI)
}

/// Returns the interval of a scaled coordinate with an uncertainty of `radius`. Subnormal
/// coordinates may have been rounded by the scaling.
pub(crate) fn cube(x: f64, radius: f64) -> Interval {
    match x.abs() >= f64::MIN_POSITIVE {
        true => Interval::around(x, radius),
        false => Interval::around(x, radius + f64::MIN_POSITIVE),
    }
}

/// Returns half the solid angle of a pair of segments, given by their scaled end points.
pub(super) fn angle_of(k: [Point; 2], l: [Point; 2]) -> Interval {
    let vector = |p: Point| p.map(|x| cube(x, 0.0));
    angle(k.map(vector), l.map(vector))
}

/// Returns half the solid angle of a pair of segments. It is below half a turn.
fn angle(k: [Vector; 2], l: [Vector; 2]) -> Interval {
    let [a, b, c, d] = [
        sub(l[0], k[0]),
        sub(l[0], k[1]),
        sub(l[1], k[1]),
        sub(l[1], k[0]),
    ];
    match (half_solid_angle(a, b, c), half_solid_angle(c, d, a)) {
        (Some(one), Some(other)) => (one + other).within(Interval::HALF_TURN),
        _ => Interval::HALF_TURN,
    }
}

/// Returns half the solid angle of the triangle of three directions, or `None` if it may be half a
/// turn in either direction.
fn half_solid_angle(a: Vector, b: Vector, c: Vector) -> Option<Interval> {
    let [na, nb, nc] = [a, b, c].map(length);
    let volume = dot(a, cross(b, c));
    let real = na * nb * nc + dot(a, b) * nc + dot(b, c) * na + dot(c, a) * nb;
    Interval::argument(real, volume)
}

pub(crate) fn length(a: Vector) -> Interval {
    (a[0].square() + a[1].square() + a[2].square()).root()
}
