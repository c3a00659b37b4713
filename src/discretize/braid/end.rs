//! One rigid end: the shape of its volume and connections, and its position in each frame.

use super::End as Given;
use super::pose::{Pose, fit, fit_line, mean, principal_axes};
use super::routes::{self, smallest_distance};
use super::volume::Piece;
use crate::curve::{Notation, Point};
use nalgebra::{Matrix3, Vector2, Vector3};

/// Largest motion of an end point relative to the others, and largest distance of end points from a
/// line that counts as straight, both relative to the smallest distance of two stubs.
const TOLERANCE: f64 = 0.05;
const STRAIGHT: f64 = 0.1;

/// Half the width of the tube of a stub, and the margin around the layers, in the same unit.
const MARGIN: f64 = 0.25;

/// Distance of two layers, and of the first one from the outermost end point, in the same unit.
const LAYER: f64 = 0.5;
const STUB: f64 = 1.0;

/// Smallest distance of two stubs, relative to the smallest distance of their end points.
const LEAST: f64 = 0.25;

/// Smallest distance of two stubs, relative to the largest coordinate of the frame.
const RESOLUTION: f64 = 1e-9;

/// Shape of an end in its local coordinates: the third axis points outward.
#[derive(Clone, Debug)]
pub struct End {
    /// End points, of mean 0.
    local: Vec<Vector3<f64>>,
    /// True if the points lie on a line, the first axis.
    line: bool,
    /// Largest distance of a point from its place.
    pub tolerance: f64,
    /// Box around all layers.
    pub body: Piece,
    /// Tube around the stub of each curve.
    pub tubes: Vec<Piece>,
    /// Vertices of the connection from each curve to the next one, without the end points.
    connections: Vec<Vec<Vector3<f64>>>,
    /// Description from which the same end is made again.
    pub given: Given,
}

impl End {
    /// Makes the ends that fit some points, best first. `other` is the middle of the other end.
    ///
    /// # Errors
    ///
    /// A reason why there is none, without the name of the end.
    pub fn candidates(
        given: &Given,
        other: Vector3<f64>,
        largest: f64,
    ) -> Result<Vec<End>, String> {
        let points: Vec<Vector3<f64>> = given.points.iter().map(|p| (*p).into()).collect();
        let center = mean(&points);
        let principal = principal_axes(&points);
        let [first, _, normal] = principal.axes;
        let along: Vec<f64> = points.iter().map(|p| (p - center).dot(&first)).collect();
        let flat: Vec<Vector2<f64>> = along.iter().map(|x| Vector2::new(*x, 0.0)).collect();
        let off = |(p, x): (&Vector3<f64>, &f64)| (p - center - first * *x).norm();
        let width = points.iter().zip(&along).map(off).fold(0.0, f64::max);
        let gap = smallest_distance(&flat);
        if width <= STRAIGHT * gap {
            if given.outward.is_some() {
                let what = "its end points lie on a line, so its volume always lies away from the \
                            other end: omit outward";
                return Err(what.into());
            }
            let local = along.iter().map(|x| Vector3::new(*x, 0.0, 0.0)).collect();
            let end = End::with_routes(local, true, [gap; 2], largest, given.clone());
            return Ok(vec![end?]);
        }
        let away = center - other;
        let upright = normal * normal.dot(&away).signum();
        let directions = match given.outward {
            Some(outward) => vec![outward.into()],
            None => vec![upright, away, upright + away.normalize(), -upright],
        };
        let spacing = smallest_distance(&points);
        let mut ends = Vec::new();
        let mut why = "the direction outward has no length".to_owned();
        for direction in directions {
            let z = direction.try_normalize(0.0);
            let Some(z) = z.filter(|z| z.iter().all(|x| x.is_finite())) else {
                continue;
            };
            let across = |axis: Vector3<f64>| (axis - z * z.dot(&axis)).try_normalize(1e-3);
            let Some(x) = across(first).or_else(|| across(principal.axes[1])) else {
                continue;
            };
            let rotation = Matrix3::from_columns(&[x, z.cross(&x), z]);
            let local = points.iter().map(|p| rotation.tr_mul(&(p - center)));
            let local: Vec<Vector3<f64>> = local.collect();
            let flat: Vec<Vector2<f64>> = local.iter().map(|p| p.xy()).collect();
            let gap = smallest_distance(&flat);
            if gap < LEAST * spacing {
                why = format!(
                    "seen along {:?}, its end points are {gap:.3e} apart at the closest, less than \
                     a quarter of their distance {spacing:.3e}",
                    <[f64; 3]>::from(z)
                );
                continue;
            }
            let sizes = [gap, gap.min(principal.deviations[1])];
            let mut given = given.clone();
            given.outward = Some(z.into());
            match End::with_routes(local, false, sizes, largest, given) {
                Ok(end) => ends.push(end),
                Err(e) => why = e,
            }
        }
        if ends.is_empty() { Err(why) } else { Ok(ends) }
    }

    /// Returns the position of the end in a frame, from its end points on the given curves, and the
    /// middle of the other end.
    ///
    /// # Errors
    ///
    /// A reason why it has none, without the name of the end: an end point is not in its place, or
    /// the points lie on a line through the other end.
    pub fn pose(
        &self,
        points: &[Vector3<f64>],
        other: Vector3<f64>,
        curves: &[u32],
    ) -> Result<Pose, String> {
        let pose = match self.line {
            false => fit(&self.local, points),
            true => {
                let along: Vec<f64> = self.local.iter().map(|p| p.x).collect();
                fit_line(&along, points, other).ok_or(
                    "has its end points on a line that almost passes through the other end, so \
                     its volume has no side to lie on",
                )?
            }
        };
        let off = |(p, q): (&Vector3<f64>, &Vector3<f64>)| (pose.to_local(*p) - q).norm();
        let distances = points.iter().zip(&self.local).map(off).enumerate();
        let (k, distance) = distances
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or_default();
        // Points near a line have their offset from it in every frame.
        let allowed = match self.line {
            true => self.tolerance / TOLERANCE * STRAIGHT + self.tolerance,
            false => self.tolerance,
        };
        if distance <= allowed {
            return Ok(pose);
        }
        let notation = Notation::of_scene(0.0, [distance, allowed, 0.0]);
        let [distance, allowed] = [distance, allowed].map(|length| notation.length(length));
        Err(format!(
            "is not rigid: the end of curve {} is {distance} from its place among the others, more \
             than {allowed}",
            curves[k]
        ))
    }

    /// Returns the box around the layers, and the tubes.
    pub fn pieces(&self) -> impl Iterator<Item = &Piece> + Clone {
        std::iter::once(&self.body).chain(&self.tubes)
    }

    /// Returns the number of virtual vertices of the connection from curve `k` to the next one.
    pub fn connection_len(&self, k: usize) -> usize {
        self.connections[k].len()
    }

    /// Returns the virtual vertices of the connection from curve `k` of the braid to the next one.
    pub fn connection(&self, pose: Pose, k: usize) -> impl DoubleEndedIterator<Item = Point> + '_ {
        self.connections[k]
            .iter()
            .map(move |p| pose.to_world(*p).into())
    }

    /// Finds the routes and the volume of an end with these points in local coordinates. `gap` is
    /// the smallest distance of two stubs, `spread` the unit of the tolerance.
    fn with_routes(
        local: Vec<Vector3<f64>>,
        line: bool,
        [gap, spread]: [f64; 2],
        largest: f64,
        given: Given,
    ) -> Result<End, String> {
        if gap <= RESOLUTION * largest {
            return Err(format!(
                "its end points are {gap:.3e} apart at the closest, too close for coordinates of \
                 up to {largest:.3e}"
            ));
        }
        let flat: Vec<Vector2<f64>> = local.iter().map(|p| p.xy()).collect();
        let routes = routes::find(&flat).ok_or(
            "no route was found for its virtual connections: list the curves in another order, or \
             give the direction outward",
        )?;
        let top = local.iter().map(|p| p.z).fold(f64::NEG_INFINITY, f64::max);
        let (margin, floor) = (MARGIN * gap, top + STUB * gap);
        let depth = |layer: usize| floor + layer as f64 * LAYER * gap;
        let layers = routes.iter().map(|r| r.layer).max().unwrap_or(0);
        let mut body = Piece {
            lo: Vector3::new(f64::INFINITY, f64::INFINITY, floor - margin),
            hi: Vector3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, depth(layers) + margin),
        };
        for p in routes.iter().flat_map(|r| &r.path) {
            for x in 0..2 {
                body.lo[x] = body.lo[x].min(p[x] - margin);
                body.hi[x] = body.hi[x].max(p[x] + margin);
            }
        }
        let tolerance = TOLERANCE * spread;
        // A tube begins before the place of its end point, which may be a little off.
        let tube = |p: &Vector3<f64>| Piece {
            lo: Vector3::new(p.x - margin, p.y - margin, p.z - 2.0 * tolerance),
            hi: Vector3::new(p.x + margin, p.y + margin, floor),
        };
        let connections = routes.iter().map(|route| {
            let z = depth(route.layer);
            let path = route.path.iter().map(|p| Vector3::new(p.x, p.y, z));
            path.collect()
        });
        Ok(End {
            tolerance,
            body,
            tubes: local.iter().map(tube).collect(),
            connections: connections.collect(),
            local,
            line,
            given,
        })
    }
}
