//! Boxes of curves in fractional coordinates, in which images are translated by integers.
//!
//! The fractional coordinates of a point are its multiples of the lattice vectors. They change
//! neither if the cell is sheared nor if it grows, as long as the curves follow. A direction
//! without repetition has a length as its coordinate.
//!
//! # Derivation of the padding
//!
//! A coordinate is `b . x` with computed `b`. Coordinates of another frame of reference than the
//! exact one would do as well: only the translations must be right. `b . a` is 1 or 0 up to `e =
//! 1e-8`: [`Cell::check`] refuses cells whose vectors are nearly dependent, with a determinant of
//! less than `1e-6` of the product of their lengths, so that a rounding error of `2^-50` of that
//! product is less than `1e-9` of the determinant. An image by `n` is then off by less than `e |n|`
//! from the integers. Boxes are padded by `1e-7` of all integers that the search may use, and of
//! the coordinates.

use crate::curve::{Basis, Box3, Cell, CurveSet, Point, above, below};
use crate::error::{Error, Result};
use crate::incremental::{PointMap, QuietBounds};
use crate::pool;
use rayon::prelude::*;

/// Padding of the boxes, relative to the largest coordinate, and at least to 1.
const PAD: f64 = 1e-7;

/// Box of a curve in fractional coordinates: minimum and maximum.
pub(super) type Bounds = [Point; 2];

/// Maker of boxes of the curves of a frame, open or closed.
pub(crate) struct Boxer<'a> {
    set: &'a CurveSet,
    inverse: [Point; 3],
    /// Share of its size by which a curve may leave the box of its control points.
    spline: f64,
}

impl<'a> Boxer<'a> {
    /// Errors: [`Error::Usage`] if the vectors of the cell do not span a lattice.
    pub fn new(set: &'a CurveSet, cell: &Cell) -> Result<Boxer<'a>> {
        let inverse = cell.inverse().ok_or_else(|| {
            Error::Usage(format!(
                "cell {cell}: the vectors lie in one plane or on one line"
            ))
        })?;
        let spline = match set.basis() {
            // Segments are a sixth of the difference of two control points away from one.
            Basis::CatmullRom => 0.2,
            _ => 0.0,
        };
        Ok(Boxer {
            set,
            inverse,
            spline,
        })
    }

    /// Returns the box of a curve, from the bounds of its control points.
    fn padded(&self, [lo, hi]: Bounds) -> Bounds {
        let pad = [0, 1, 2].map(|x| {
            let size = lo[x].abs().max(hi[x].abs()).max(1.0);
            self.spline * (hi[x] - lo[x]) + PAD * size
        });
        [
            [0, 1, 2].map(|x| lo[x] - pad[x]),
            [0, 1, 2].map(|x| hi[x] + pad[x]),
        ]
    }

    /// Returns the boxes of all curves, from their points.
    pub fn boxes(&self) -> impl IndexedParallelIterator<Item = Bounds> {
        let of = |i: usize| self.padded(self.set.bounds_along(i, &self.inverse));
        (0..self.set.len()).into_par_iter().with_min_len(64).map(of)
    }

    /// Returns the map to fractional coordinates of a quiet frame.
    pub fn map(&self, at: &QuietBounds<'_>) -> PointMap {
        at.map(self.inverse)
    }

    /// Returns boxes of all curves of a quiet frame, without its points.
    pub fn quiet_boxes(
        &self,
        at: &QuietBounds<'_>,
        map: &PointMap,
    ) -> impl Iterator<Item = Bounds> {
        at.bounds(map).map(|b| self.padded(b))
    }
}

/// Boxes of all curves of a frame.
#[derive(Clone, Debug)]
pub(crate) struct FractionalBoxes {
    /// Minimum and maximum of each curve.
    pub bounds: Vec<Bounds>,
}

impl FractionalBoxes {
    /// Returns the boxes of the curves, open or closed. Each contains the curve.
    pub fn new(boxer: &Boxer<'_>) -> FractionalBoxes {
        let segments = boxer.set.segments();
        let bounds = pool::run(segments, || boxer.boxes().collect());
        FractionalBoxes { bounds }
    }

    /// Returns boxes that contain the curves at all times of the step from another frame, in which
    /// a path may [bend](bend) by a share of its length.
    pub fn swept_from(&self, before: &FractionalBoxes, bend: f64) -> FractionalBoxes {
        let both = before.bounds.iter().zip(&self.bounds);
        let swept = both.map(|(a, b)| {
            let lo = [0, 1, 2].map(|x| a[0][x].min(b[0][x]));
            let hi = [0, 1, 2].map(|x| a[1][x].max(b[1][x]));
            let size = largest_side(&[lo, hi]);
            [lo.map(|x| x - bend * size), hi.map(|x| x + bend * size)]
        });
        FractionalBoxes {
            bounds: swept.collect(),
        }
    }

    /// Returns the mean size of the curves along a direction.
    pub fn mean_size(&self, x: usize) -> f64 {
        let total: f64 = self.bounds.iter().map(|b| b[1][x] - b[0][x]).sum();
        total / self.bounds.len().max(1) as f64
    }

    /// Returns the size of the scene along a direction.
    pub fn extent(&self, x: usize) -> f64 {
        let lo = self
            .bounds
            .iter()
            .map(|b| b[0][x])
            .fold(f64::INFINITY, f64::min);
        let hi = self
            .bounds
            .iter()
            .map(|b| b[1][x])
            .fold(f64::NEG_INFINITY, f64::max);
        (hi - lo).max(0.0)
    }

    /// Returns the boxes grown by a margin on all sides: of these shares of the cell, or of these
    /// lengths.
    pub fn dilated(&self, margin: Point) -> FractionalBoxes {
        let dilated = self.bounds.iter().map(|[lo, hi]| {
            [
                [0, 1, 2].map(|x| lo[x] - margin[x]),
                [0, 1, 2].map(|x| hi[x] + margin[x]),
            ]
        });
        FractionalBoxes {
            bounds: dilated.collect(),
        }
    }

    /// Returns the smallest distance of other boxes of the curves from the faces of these, as a
    /// share of the largest side of the box around: negative or NaN if one is not inside.
    ///
    /// If it is at least the [bend] of a step, in the frames at both ends, the curves stay within
    /// these boxes during the step: a path bends by at most that share of its length.
    pub fn room_for(&self, curve: usize, [lo, hi]: &Bounds) -> f64 {
        let around = &self.bounds[curve];
        let mut least = f64::INFINITY;
        for x in 0..3 {
            least = smaller_or_nan(least, lo[x] - around[0][x]);
            least = smaller_or_nan(least, around[1][x] - hi[x]);
        }
        least / largest_side(around)
    }

    /// Returns the curve with the largest box.
    pub fn widest(&self) -> usize {
        let sides = self.bounds.iter().map(largest_side).enumerate();
        let widest = sides.max_by(|a, b| a.1.total_cmp(&b.1));
        widest.map_or(0, |(curve, _)| curve)
    }

    /// Returns the smallest of the largest sides of all boxes.
    pub fn smallest(&self) -> f64 {
        self.bounds
            .iter()
            .map(largest_side)
            .fold(f64::INFINITY, f64::min)
    }
}

/// Returns the smaller number, or NaN if one of both is NaN.
pub(super) fn smaller_or_nan(a: f64, b: f64) -> f64 {
    if a <= b || a.is_nan() { a } else { b }
}

fn largest_side([lo, hi]: &Bounds) -> f64 {
    (0..3).map(|x| hi[x] - lo[x]).fold(0.0, f64::max)
}

/// Returns a bound of the deviation from a straight line, as a share of its length, of the path of
/// a vertex in fractional coordinates during a step, in which vertices move on straight lines, and
/// the vectors of the cell change at constant speed.
///
/// # Derivation
///
/// Let `A` be the cell of the first frame, `A + D` that of the second one, and `u` the coordinates
/// of a vertex. At the share `t` of the step, `(A + t D) u(t) = x(t)`. The difference of `u(t)`
/// from the straight line between both frames is `t (1 - t) (A + t D)^-1 D (u(1) - u(0))`. With `e`
/// the norm of `A^-1 D` (the largest sum of a row), it is at most `e / (4 (1 - e))` of the largest
/// component of `u(1) - u(0)`, which the box of both frames bounds.
///
/// Errors: [`Error::Usage`] if the cell changes by more than half.
pub(crate) fn bend([from, to]: [&Cell; 2]) -> Result<f64> {
    let change = change_of(from, to);
    if change.is_nan() || change > 0.5 {
        return Err(Error::Usage(format!(
            "the cell changed from {from} to {to} in one step: more than half of its size"
        )));
    }
    // Twice the bound, which covers rounding.
    Ok(0.5 * change / (1.0 - change))
}

/// Returns the norm of the change of a cell, relative to the cell: the largest sum of the
/// magnitudes of a row. NaN if there is none.
fn change_of(from: &Cell, to: &Cell) -> f64 {
    if from.vectors == to.vectors {
        return 0.0;
    }
    let (Some(a), Some(b)) = (from.basis(), to.basis()) else {
        return f64::NAN;
    };
    let Some(inverse) = from.inverse() else {
        return f64::NAN;
    };
    let row = |row: &Point| -> f64 {
        let component = |k: usize| {
            let d = [0, 1, 2].map(|x| b[k][x] - a[k][x]);
            (row[0] * d[0] + row[1] * d[1] + row[2] * d[2]).abs()
        };
        (0..3).map(component).sum()
    };
    inverse.iter().map(row).fold(0.0, f64::max)
}

/// Returns a box, translated and rounded outward. Its bounds are finite.
pub(super) fn single([lo, hi]: &[Point; 2], by: Point) -> Box3 {
    Box3 {
        lo: [0, 1, 2].map(|x| below(lo[x] + by[x])),
        hi: [0, 1, 2].map(|x| above(hi[x] + by[x])),
    }
}
