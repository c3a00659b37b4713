//! Where the curves of a quiet frame are, known without reading it.

use super::affine::Affine;
use crate::curve::Point;

/// Where the curves of a quiet frame are: each control point is at most a distance away from its
/// place in the reference frame, moved by an affine map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Whereabouts<'a> {
    /// Bounds of the control points of each curve in the reference frame.
    pub(super) bounds: &'a [[Point; 2]],
    pub(super) affine: Affine,
    pub(super) distance: f64,
}

impl Whereabouts<'_> {
    /// Returns bounds of the control points of each curve in the coordinates `row . x`, up to
    /// rounding.
    ///
    /// # Derivation
    ///
    /// With the map `q -> M q + t`, a coordinate of a point is `(row M) . q + row . t`, plus at most
    /// the length of the row times the distance. A linear function of the points of a box has the
    /// range of its value at the center, plus and minus the sum of the magnitudes of its components
    /// times half the sides.
    pub fn bounds_along(&self, rows: [Point; 3]) -> impl Iterator<Item = [Point; 2]> {
        let Affine { m, t, .. } = &self.affine;
        let axis = |row: Point| {
            let row = nalgebra::Vector3::from(row);
            let through = m.transpose() * row;
            let by = row.dot(t);
            (through, by, row.norm() * self.distance)
        };
        let axes = rows.map(axis);
        self.bounds.iter().map(move |[lo, hi]| {
            let mut out = [[0.0; 3]; 2];
            for (x, (row, by, distance)) in axes.iter().enumerate() {
                let (mut center, mut half) = (*by, *distance);
                for k in 0..3 {
                    center += row[k] * (0.5 * lo[k] + 0.5 * hi[k]);
                    half += row[k].abs() * (0.5 * hi[k] - 0.5 * lo[k]);
                }
                (out[0][x], out[1][x]) = (center - half, center + half);
            }
            out
        })
    }
}
