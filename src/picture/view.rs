//! Directions from which a place is drawn.
//!
//! The first direction is the one of many in which both strands are open and cross at a wide angle:
//! the product of the area that the crossing tangents span, and of the smaller area of the two
//! strands, both as seen. A ring that is seen from the side would be a line, which shows no
//! linking. The second direction is the best one orthogonal to the first: the same view after a
//! quarter turn about the vertical.

use super::panel::HALF;
use super::strands::{Part, Strand};
use crate::curve::Point;
use crate::curve::vector::{cross, dot, mix, norm, sub};
use std::f64::consts::{PI, TAU};

/// Number of first and of second directions that are compared.
const FIRST: usize = 400;
const SECOND: usize = 48;

/// Share of the best area that counts even if it is not visible, so that parallel strands and flat
/// ones can be compared.
const LEAST: f64 = 0.12;

/// Axes of a picture: to the right, up, and towards the viewer. Orthonormal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct View {
    pub across: Point,
    pub up: Point,
    pub towards: Point,
}

impl View {
    /// Returns the view along the thinnest axis of a box with these sides, with z or else y up.
    pub fn along_thinnest(sides: Point) -> View {
        let axes = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]];
        let thinnest = (0..3).min_by(|&a, &b| sides[a].total_cmp(&sides[b]));
        let (across, up) = match thinnest {
            Some(0) => (axes[0], axes[1]),
            Some(1) => (axes[2], axes[1]),
            _ => (axes[2], axes[0]),
        };
        View {
            across,
            up,
            towards: cross(across, up),
        }
    }

    /// Returns points of a window in pixels to the right and down, and their depth.
    pub fn pixels(&self, points: &[Point]) -> Vec<Point> {
        let pixel = |p: &Point| {
            let [x, y, z] = [self.across, self.up, self.towards].map(|axis| dot(axis, *p));
            [HALF + HALF * x, HALF - HALF * y, HALF * z]
        };
        points.iter().map(pixel).collect()
    }
}

/// Returns both views of the strands of a finding.
pub(super) fn views(strands: &[Strand]) -> [View; 2] {
    let [(s, a), (t, b)] = [Part::First, Part::Second].map(|part| shape(strands, part));
    let crossing = cross(s, t);
    let score = |d: Point| {
        let normals = [a, b].into_iter().filter(|n| *n != [0.0; 3]);
        let open = normals.map(|n| dot(n, d).abs()).fold(1.0, f64::min);
        (dot(crossing, d).abs() + LEAST) * (open + LEAST)
    };
    let best = |directions: &mut dyn Iterator<Item = Point>| {
        let best = directions.max_by(|d, e| score(*d).total_cmp(&score(*e)));
        best.unwrap_or([0.0, 0.0, 1.0])
    };
    // From above: the opposite direction shows the same.
    let towards = best(&mut (0..FIRST).map(half_sphere));
    let aside = unit(cross(towards, least_axis(towards)));
    let other = cross(towards, aside);
    let turned = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / SECOND as f64).sin_cos();
        [0, 1, 2].map(|x| cos * aside[x] + sin * other[x])
    };
    let second = best(&mut (0..SECOND).map(turned));
    // Both have the same axis up, the one that points up in space.
    let up = cross(towards, second);
    let upright = up[2] > 0.0 || up[2] == 0.0 && up[1] >= 0.0;
    let (second, up) = match upright {
        true => (second, up),
        false => (second.map(|x| -x), up.map(|x| -x)),
    };
    [towards, second].map(|towards| View {
        across: cross(up, towards),
        up,
        towards,
    })
}

/// Returns one of [`FIRST`] directions that cover the upper half of a sphere evenly.
fn half_sphere(k: usize) -> Point {
    let golden = PI * (3.0 - 5f64.sqrt());
    let z = (k as f64 + 0.5) / FIRST as f64;
    let (sin, cos) = (golden * k as f64).sin_cos();
    let radius = (1.0 - z * z).sqrt();
    [radius * cos, radius * sin, z]
}

/// Returns the direction of a strand at its point closest to the place, and the normal of its area.
/// Both have length 1, or are 0 if there is none.
fn shape(strands: &[Strand], part: Part) -> (Point, Point) {
    let (mut tangent, mut area, mut closest) = ([0.0; 3], [0.0; 3], f64::INFINITY);
    for strand in strands.iter().filter(|s| s.part == part) {
        for edge in strand.points.windows(2) {
            let along = sub(edge[1], edge[0]);
            let length = norm(along);
            let distance = norm(mix(edge[0], edge[1], 0.5)) - 0.5 * length;
            if length > 0.0 && distance < closest {
                (closest, tangent) = (distance, along.map(|x| x / length));
            }
            // An open strand is closed by its chord.
            let triangle = cross(sub(edge[0], strand.points[0]), along);
            (0..3).for_each(|x| area[x] += triangle[x]);
        }
    }
    (tangent, unit(area))
}

/// Returns the axis that is farthest from a direction.
fn least_axis(d: Point) -> Point {
    let axis = [0, 1, 2]
        .into_iter()
        .min_by(|&k, &l| d[k].abs().total_cmp(&d[l].abs()));
    let mut out = [0.0; 3];
    out[axis.unwrap_or(0)] = 1.0;
    out
}

fn unit(v: Point) -> Point {
    let length = norm(v).max(f64::MIN_POSITIVE);
    v.map(|x| x / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a ring in the plane of two axes, through the origin.
    fn ring(part: Part, centre: Point, a: Point, b: Point) -> Strand {
        let point = |k: usize| {
            let (sin, cos) = (TAU * k as f64 / 24.0).sin_cos();
            [0, 1, 2].map(|x| centre[x] + cos * a[x] + sin * b[x])
        };
        Strand {
            curve: part as u32,
            part,
            closed: true,
            points: (0..=24).map(point).collect(),
        }
    }

    #[test]
    fn both_rings_of_a_link_are_open_in_the_first_view() {
        let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        let strands = [
            ring(Part::First, [-1.0, 0.0, 0.0], x, y),
            ring(Part::Second, [1.0, 0.0, 0.0], x, z),
        ];
        let [first, second] = views(&strands);
        // The normals of the rings.
        for normal in [z, y] {
            let open = dot(normal, first.towards).abs();
            assert!(open > 0.4, "{first:?}");
        }
        for view in [first, second] {
            let axes = [view.across, view.up, view.towards];
            for k in 0..3 {
                for l in 0..3 {
                    let expected = if k == l { 1.0 } else { 0.0 };
                    assert!((dot(axes[k], axes[l]) - expected).abs() < 1e-12);
                }
            }
            assert!(dot(cross(view.across, view.up), view.towards) > 0.99);
        }
        assert!(dot(first.towards, second.towards).abs() < 1e-12);
        assert_eq!(first.up, second.up);
        assert!(first.up[2] >= 0.0);
    }

    #[test]
    fn strands_without_points_have_views_too() {
        for strands in [
            vec![],
            vec![Strand {
                curve: 0,
                part: Part::First,
                closed: false,
                points: vec![[0.0; 3]; 2],
            }],
        ] {
            for view in views(&strands) {
                assert!(view.towards.iter().all(|x| x.is_finite()), "{view:?}");
            }
        }
    }
}
