//! Directions from which a place is drawn.
//!
//! The first direction is near the normal of both strands at the place, so that they cross at a
//! wide angle, and tilted: from the normal itself, two linked rings are lines, which show no
//! linking. The second one is the same view after a quarter turn about the vertical.

use super::panel::HALF;
use super::strands::{Part, Strand};
use crate::curve::vector::{add, add_scaled, cross, dot, mix, norm, sub};
use crate::curve::{Point, bounds};

/// Share of both directions in that of the first view, beside the normal of both.
const TILT: f64 = 0.8;

/// Half of the width of a picture, in half widths of what fills it.
const MARGIN: f64 = 1.12;

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
        View {
            across,
            up,
            towards: cross(across, up),
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
    #[cfg_attr(not(feature = "cli"), allow(dead_code, reason = "for the report"))]
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
    let [t, u] = [Part::First, Part::Second].map(|part| tangent(strands, part));
    let normal = match cross(t, u) {
        n if norm(n) > 0.1 => unit(n),
        _ => unit(cross(t, least_axis(t))),
    };
    // Not along the normal itself, from which one would see the edges of two linked rings.
    let towards = unit(add_scaled(normal, TILT, add(t, u)));
    let towards = if norm(towards) > 0.5 {
        towards
    } else {
        [0.0, 0.0, 1.0]
    };
    // Both have the same axis up, as near to z as possible.
    let z = if towards[2].abs() < 0.99 {
        [0.0, 0.0, 1.0]
    } else {
        [0.0, 1.0, 0.0]
    };
    let up = unit(add_scaled(z, -dot(z, towards), towards));
    [towards, cross(up, towards)].map(|towards| View {
        across: cross(up, towards),
        up,
        towards,
        middle: [0.0; 2],
        scale: 1.0,
    })
}

/// Returns the direction of a strand at the point closest to the place, of length 1, or 0.
fn tangent(strands: &[Strand], part: Part) -> Point {
    let own = strands.iter().filter(|s| s.part == part);
    let edges = own.flat_map(|s| s.points.array_windows::<2>());
    let edges = edges.filter(|[a, b]| a != b);
    let distance = |[a, b]: &[Point; 2]| norm(mix(*a, *b, 0.5)) - 0.5 * norm(sub(*b, *a));
    let closest = edges.min_by(|a, b| distance(a).total_cmp(&distance(b)));
    closest.map_or([0.0; 3], |[a, b]| unit(sub(*b, *a)))
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
    use std::f64::consts::TAU;

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
