//! Bounds of the curves of a quiet frame, computed without reading its points.

use super::affine::Affine;
use super::reference::Reference;
use crate::curve::Point;
use nalgebra::{Matrix3, Vector3};

/// Bounds of the curves of a quiet frame: each control point is at most a distance away from its
/// place in the reference frame, moved by an affine map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct QuietBounds<'a> {
    pub(super) reference: &'a Reference,
    pub(super) affine: Affine,
}

/// Map from a reference frame to coordinates of a quiet frame: `q -> N q + s`, and the largest
/// distance of a point from its image along each axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PointMap {
    n: Matrix3<f64>,
    s: Vector3<f64>,
    distance: Vector3<f64>,
    reference: u64,
}

impl QuietBounds<'_> {
    /// Returns the map to the coordinates `row . x`.
    ///
    /// With the affine map `q -> M q + t`, a coordinate of a point is `(row M) . q + row . t`, plus
    /// at most the length of the row times the distance.
    pub fn map(&self, rows: [Point; 3]) -> PointMap {
        let rows = Matrix3::from_rows(&rows.map(|row| Vector3::from(row).transpose()));
        let QuietBounds { reference, affine } = self;
        // The condition of a frame is `|p - (M q + t)| <= sigma a`.
        let distance = affine.sigma * reference.largest_allowance * (1.0 + 1e-6);
        PointMap {
            n: rows * affine.m,
            s: rows * affine.t,
            distance: Vector3::from_fn(|x, _| rows.row(x).norm() * distance),
            reference: reference.frame,
        }
    }

    /// Returns bounds of the control points of each curve in the coordinates of the map, up to
    /// rounding.
    ///
    /// A linear function of the points of a box has the range of its value at the centre, plus and
    /// minus the sum of the magnitudes of its components times half the sides.
    pub fn bounds(&self, map: &PointMap) -> impl Iterator<Item = [Point; 2]> {
        let (PointMap { n, s, distance, .. }, sizes) = (*map, map.n.abs());
        self.reference.bounds.iter().map(move |[lo, hi]| {
            let [lo, hi] = [lo, hi].map(|p| Vector3::from(*p) * 0.5);
            let (center, half) = (n * (lo + hi) + s, sizes * (hi - lo) + distance);
            [(center - half).into(), (center + half).into()]
        })
    }

    /// Returns an upper bound of the difference of the bounds of any curve from those by an earlier
    /// map, along each direction, up to rounding. `None` if that was a map from another reference
    /// frame.
    ///
    /// The difference of the images of a point is linear in the point, so that it is largest at a
    /// corner of the box around all curves.
    pub fn difference(&self, map: &PointMap, earlier: &PointMap) -> Option<Point> {
        if map.reference != earlier.reference {
            return None;
        }
        let (n, s) = (map.n - earlier.n, map.s - earlier.s);
        let [lo, hi] = self.reference.around.map(|p| Vector3::from(p) * 0.5);
        let largest = (n * (lo + hi) + s).abs() + n.abs() * (hi - lo);
        Some((largest + (map.distance - earlier.distance).abs()).into())
    }
}
