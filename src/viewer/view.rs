//! View of a scene: the direction and the distance of the eye, and the enlargement of small scenes.

use crate::curve::vector::{dot, hypot, per_axis, sub};
use crate::curve::{CurveSet, Point};
use re_sdk_types::blueprint::archetypes::EyeControls3D;

/// Distance of the eye from the centre of the scene, in radii of the scene.
const EYE_DISTANCE: f64 = 2.0;

/// Distance of the eye from a violation, in sizes of the feature there (see
/// [`super::local::feature`]). A ring fills a third of the height.
const EYE_DISTANCE_NEAR: f64 = 5.0;

/// Mean length of a segment from which on curves are drawn at their size, and number of segments of
/// that mean.
const SMALL: f64 = 0.05;
const SAMPLED: usize = 100_000;

/// Maximum number of digits by which curves are enlarged: single precision has 38.
const MOST_DIGITS: f64 = 36.0;

/// Directions of view, by the axis along which the scene is thinnest: cloth is seen from the front,
/// a little from the side, with z upwards.
const LOOK_FROM: [Point; 3] = [[1.0, -0.3, 0.4], [-0.3, -1.0, 0.4], [-0.25, -0.65, 1.0]];

/// View of a scene: the bounding box of all control points, and the direction.
pub(super) struct View {
    center: Point,
    /// Half the diagonal.
    pub radius: f64,
    /// Unit vector from the scene to the eye.
    from: Point,
}

impl View {
    /// Returns `None` if the scene has no extent.
    pub fn of(set: &CurveSet) -> Option<View> {
        let [lo, hi] = set.corners();
        let size = sub(hi, lo);
        let radius = 0.5 * hypot(size);
        let thinnest = (0..3).min_by(|&a, &b| size[a].total_cmp(&size[b]))?;
        (radius > 0.0 && radius.is_finite()).then(|| View {
            center: per_axis(|x| 0.5 * (lo[x] + hi[x])),
            radius,
            from: unit(LOOK_FROM[thinnest]),
        })
    }

    /// Returns the unit vector that points to the right on the screen.
    pub fn right(&self) -> Point {
        let [x, y, _] = self.from;
        unit([-y, x, 0.0])
    }

    /// Returns the unit vector that points down on the screen.
    pub fn down(&self) -> Point {
        let [x, y, z] = self.from;
        unit([z * x, z * y, z * z - 1.0])
    }

    /// Returns how far to the right and down of a place another point is seen, in these units (see
    /// [`View::unit`]) at the distance of the place. `None` if the point is not in front of an eye
    /// that looks at the place.
    pub fn on_screen(&self, point: Point, place: Point, unit: f64) -> Option<[f64; 2]> {
        let offset = sub(point, place);
        let nearer = dot(offset, self.from) / (EYE_DISTANCE_NEAR * unit);
        let enlarged = 1.0 / (unit * (1.0 - nearer));
        let axes = [self.right(), self.down()];
        (nearer < 0.9).then(|| axes.map(|axis| enlarged * dot(offset, axis)))
    }

    /// Returns the size that a feature at a place counts as: not more than the whole scene needs.
    pub fn unit(&self, size: f64) -> f64 {
        size.min(EYE_DISTANCE * self.radius / EYE_DISTANCE_NEAR)
    }

    /// Returns an eye that sees all curves, or those around a place if one is given. Viewers draw
    /// curves enlarged by `scale`.
    pub fn eye(&self, place: Option<(Point, f64)>, scale: f64) -> EyeControls3D {
        let far = EYE_DISTANCE * self.radius;
        let (target, away) = match place {
            Some((point, size)) if size > 0.0 => (point, EYE_DISTANCE_NEAR * self.unit(size)),
            Some((point, _)) => (point, far),
            None => (self.center, far),
        };
        let position = per_axis(|x| (scale * (target[x] + away * self.from[x])) as f32);
        EyeControls3D::new()
            .with_position(position)
            .with_look_target(target.map(|x| (scale * x) as f32))
            .with_eye_up([0.0, 0.0, 1.0])
    }
}

fn unit(v: Point) -> Point {
    let length = hypot(v);
    v.map(|x| x / length)
}

/// Returns the factor by which curves are enlarged: a power of ten, 1 for most scenes.
///
/// The viewer draws nothing closer to the eye than 0.01, and the eye comes no closer to its target
/// than 0.02, for scenes of any size.
pub(super) fn scale(set: &CurveSet) -> f64 {
    let lengths = set.curves().iter().enumerate().flat_map(|(i, curve)| {
        let length = move |s| hypot(sub(set.knot(i, s + 1), set.knot(i, s)));
        (0..curve.segments as usize).map(length)
    });
    let lengths: Vec<f64> = lengths.take(SAMPLED).collect();
    let mean = lengths.iter().sum::<f64>() / lengths.len().max(1) as f64;
    if mean > 0.0 && mean < SMALL {
        10.0_f64.powi((SMALL / mean).log10().ceil().min(MOST_DIGITS) as i32)
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};
    use re_sdk::Loggable;

    #[test]
    fn small_scenes_are_drawn_larger() {
        for (unit, expected) in [(1e-9, 1e8), (0.01, 10.0), (0.1, 1.0), (1e6, 1.0)] {
            let points = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(|x| x * unit);
            let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&points));
            assert_eq!(scale(&set.unwrap()), expected, "{unit}");
        }
    }

    #[test]
    fn the_eye_is_near_a_violation_or_sees_all_curves() {
        let points = [0.0, 0.0, 0.0, 200.0, 0.0, 0.0, 0.0, 200.0, 40.0];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&points)).unwrap();
        let scene = View::of(&set).unwrap();
        let (right, down) = (scene.right(), scene.down());
        let along: f64 = (0..3)
            .map(|x| right[x] * scene.from[x] + right[x] * down[x])
            .sum();
        assert!(along.abs() < 1e-12 && right[0] > 0.0, "{right:?}");
        let across: f64 = dot(down, scene.from);
        assert!(across.abs() < 1e-12 && down[2] < 0.0, "{down:?}");
        // The eye is at a distance of 10 from the origin.
        let nearer = scene.from.map(|x| 5.0 * x);
        let point = per_axis(|x| nearer[x] + right[x] + 2.0 * down[x]);
        let [x, y] = scene.on_screen(point, [0.0; 3], 2.0).unwrap();
        assert!(
            (x - 1.0).abs() < 1e-12 && (y - 2.0).abs() < 1e-12,
            "{x} {y}"
        );
        assert_eq!(
            scene.on_screen(scene.from.map(|x| 11.0 * x), [0.0; 3], 2.0),
            None
        );
        let position = |place, scale| {
            let eye = scene.eye(place, scale);
            let batch = eye.position.unwrap().array;
            let points = re_sdk_types::components::Position3D::from_arrow(&batch).unwrap();
            [points[0].x(), points[0].y(), points[0].z()].map(f64::from)
        };
        let distance = |p: Point, q: Point| (0..3).map(|x| (p[x] - q[x]).powi(2)).sum::<f64>();
        let near = distance(position(Some(([9.0; 3], 2.0)), 1.0), [9.0; 3]).sqrt();
        assert!((near - 10.0).abs() < 1e-5, "{near}");
        let far = distance(position(None, 10.0), scene.center.map(|x| 10.0 * x)).sqrt();
        assert!((far / scene.radius - 20.0).abs() < 1e-5, "{far}");
    }

    #[test]
    fn a_scene_without_extent_has_no_eye() {
        let point = [1.0_f32; 9];
        let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F32(&point)).unwrap();
        assert!(View::of(&set).is_none());
        assert_eq!(scale(&set), 1.0);
        let empty = CurveSet::from_counts(Basis::Polyline, &[], Positions::F32(&[])).unwrap();
        assert!(View::of(&empty).is_none());
        assert_eq!(scale(&empty), 1.0);
    }
}
