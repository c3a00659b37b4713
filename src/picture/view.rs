//! Directions from which a place is drawn.
//!
//! The first direction is the one of many in which both strands are open and cross at a wide angle:
//! the product of the area that the crossing tangents span, and of the smaller width of the two
//! strands, both as seen. A ring that is seen from the side would be a line, which shows no
//! linking. The second direction is the best one orthogonal to the first: the same view after a
//! quarter turn about the vertical.

use super::panel::HALF;
use super::strands::{Part, Strand};
use crate::curve::vector::{cross, dot, mix, norm, per_axis, sub};
use crate::curve::{Point, bounds};
use std::f64::consts::{PI, TAU};

/// Number of first and of second directions that are compared.
const FIRST: usize = 400;
const SECOND: usize = 48;

/// Half of the width of a picture, in half widths of what fills it.
const MARGIN: f64 = 1.12;

/// Share of the best area or width that counts even if it is not visible, so that parallel strands
/// and flat ones can be compared.
const LEAST: f64 = 0.12;

/// Axes of a picture: to the right, up, and towards the viewer. Orthonormal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct View {
    pub across: Point,
    pub up: Point,
    pub towards: Point,
    /// Middle of the picture along the first two axes, in units of the window.
    pub middle: [f64; 2],
    /// Pictures with a scale of 1 have the width of their window.
    pub scale: f64,
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
        View::of(across, up, cross(across, up))
    }

    /// Returns the view with these axes and the place in its middle.
    fn of(across: Point, up: Point, towards: Point) -> View {
        View {
            across,
            up,
            towards,
            middle: [0.0; 2],
            scale: 1.0,
        }
    }

    /// Returns the view whose picture has these points, with a margin.
    pub fn fitted<'a>(self, points: impl Iterator<Item = &'a Point>) -> View {
        let seen = points.map(|p| [dot(self.across, *p), dot(self.up, *p), 0.0]);
        let [low, high] = bounds(seen);
        let half = 0.5 * (high[0] - low[0]).max(high[1] - low[1]);
        if !(half > 0.0 && half.is_finite()) {
            return self;
        }
        View {
            middle: [0, 1].map(|x| 0.5 * (low[x] + high[x])),
            scale: 1.0 / (half * MARGIN),
            ..self
        }
    }

    /// Returns the view of the place from nearer, in which this length is a third of the picture.
    pub fn closer(self, length: f64) -> View {
        View {
            middle: [0.0; 2],
            scale: 0.67 / length,
            ..self
        }
    }

    /// Returns a length of the window in pixels.
    pub fn length(&self, length: f64) -> f64 {
        HALF * self.scale * length
    }

    /// Returns points of a window in pixels to the right and down, and their depth.
    pub fn pixels(&self, points: &[Point]) -> Vec<Point> {
        let pixel = |p: &Point| {
            let [x, y, z] = [self.across, self.up, self.towards].map(|axis| dot(axis, *p));
            let [x, y] = [x - self.middle[0], y - self.middle[1]];
            [HALF + self.length(x), HALF - self.length(y), self.length(z)]
        };
        points.iter().map(pixel).collect()
    }
}

/// Returns both views of the strands of a finding.
pub(super) fn views(strands: &[Strand]) -> [View; 2] {
    let shapes = [Part::First, Part::Second].map(|part| Shape::of(strands, part));
    let score = |d: Point| {
        let normal = cross(shapes[0].tangent, shapes[1].tangent);
        let crossing = dot(normal, d).abs();
        let widths = shapes.iter().filter_map(|shape| shape.width(d));
        let width = widths.fold(1.0, f64::min);
        (crossing + LEAST) * (width + LEAST)
    };
    let best = |directions: &mut dyn Iterator<Item = Point>| {
        let scored = directions.map(|d| (score(d), d));
        let best = scored.max_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or([0.0, 0.0, 1.0], |(_, d)| d)
    };
    // From above: the opposite direction shows the same.
    let towards = best(&mut (0..FIRST).map(half_sphere));
    let aside = unit(cross(towards, least_axis(towards)));
    let other = cross(towards, aside);
    let turned = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / SECOND as f64).sin_cos();
        per_axis(|x| cos * aside[x] + sin * other[x])
    };
    let second = best(&mut (0..SECOND).map(turned));
    // Both have the same axis up, the one that points up in space.
    let up = cross(towards, second);
    let upright = up[2] > 0.0 || up[2] == 0.0 && up[1] >= 0.0;
    let sign = if upright { 1.0 } else { -1.0 };
    let [second, up] = [second, up].map(|axis| axis.map(|x| sign * x));
    [towards, second].map(|towards| View::of(cross(up, towards), up, towards))
}

/// Returns one of [`FIRST`] directions that cover the upper half of a sphere evenly.
fn half_sphere(k: usize) -> Point {
    let golden = PI * (3.0 - 5f64.sqrt());
    let z = (k as f64 + 0.5) / FIRST as f64;
    let (sin, cos) = (golden * k as f64).sin_cos();
    let radius = (1.0 - z * z).sqrt();
    [radius * cos, radius * sin, z]
}

/// Direction and extent of a strand near the place.
struct Shape {
    /// Direction at the point closest to the place, of length 1, or 0.
    tangent: Point,
    /// Second moments of its points; `None` without points.
    moments: Option<[Point; 3]>,
}

impl Shape {
    fn of(strands: &[Strand], part: Part) -> Shape {
        let mut tangent = [0.0; 3];
        let mut closest = f64::INFINITY;
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        let own = || strands.iter().filter(|s| s.part == part);
        for edge in own().flat_map(|s| s.points.windows(2)) {
            let along = sub(edge[1], edge[0]);
            let middle = mix(edge[0], edge[1], 0.5);
            let length = norm(along);
            let distance = norm(middle) - 0.5 * length;
            if length > 0.0 && distance < closest {
                (closest, tangent) = (distance, along.map(|x| x / length));
            }
            // Edges count by their length, so that the sampling does not matter.
            (0..3).for_each(|x| sum[x] += length * middle[x]);
            count += length;
        }
        let mean = sum.map(|x| x / count);
        let mut moments = [[0.0; 3]; 3];
        for edge in own().flat_map(|s| s.points.windows(2)) {
            let length = norm(sub(edge[1], edge[0])) / count;
            for p in edge {
                let d = sub(*p, mean);
                for (row, x) in moments.iter_mut().zip(d) {
                    (0..3).for_each(|k| row[k] += 0.5 * length * x * d[k]);
                }
            }
        }
        let moments = (count != 0.0).then_some(moments);
        Shape { tangent, moments }
    }

    /// Returns the width of the strand, as seen from a direction, as a share of its length. `None`
    /// without points.
    fn width(&self, d: Point) -> Option<f64> {
        let m = self.moments.as_ref()?;
        let a = unit(cross(d, least_axis(d)));
        let b = cross(d, a);
        let entry = |p: Point, q: Point| dot(p, m.map(|row| dot(row, q)));
        let (aa, ab, bb) = (entry(a, a), entry(a, b), entry(b, b));
        let (mean, half) = (0.5 * (aa + bb), (0.5 * (aa - bb)).hypot(ab));
        let largest = (0..3).map(|k| m[k][k]).sum::<f64>();
        Some(((mean - half).max(0.0) / largest.max(f64::MIN_POSITIVE)).sqrt())
    }
}

/// Returns the axis that is farthest from a direction.
fn least_axis(d: Point) -> Point {
    let axis = (0..3).min_by(|&k, &l| d[k].abs().total_cmp(&d[l].abs()));
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
            per_axis(|x| centre[x] + cos * a[x] + sin * b[x])
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
