//! Boxes of curves in fractional coordinates, in which images are translated by integers.
//!
//! The fractional coordinates of a point are its multiples of the lattice vectors. They do not
//! change if the cell is sheared or grows, as long as the curves deform with it. Along an axis that
//! is not periodic, the coordinate is a length.
//!
//! # Derivation of the padding
//!
//! A coordinate is `b . x` with computed `b`. Coordinates of another frame of reference than the
//! exact one would do as well: only the translations must be right. `b . a` is 1 or 0 up to `e =
//! 1e-8`: [`Cell::check`] refuses cells whose vectors are nearly dependent, with a determinant of
//! less than `1e-6` of the product of their lengths, so that a rounding error of `2^-50` of that
//! product is less than `1e-9` of the determinant. An image by `n` is then off by less than `e |n|`
//! from the integers. Boxes are padded by `1e-5` of all integers that the search may use, and of
//! the coordinates, which also covers the gap between the end of a yarn in single precision and the
//! image of its start. Along a direction without repetition, the length of a lattice vector takes
//! the place of 1.

use crate::curve::vector::{add, dot, per_axis, sub};
use crate::curve::{Basis, Box3, Cell, CurveSet, Point, union};
use crate::error::{Error, Result};
use crate::pool;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Padding of the boxes, relative to the largest coordinate or to the size of a cell, whichever is
/// larger.
const PAD: f64 = 1e-5;

/// Number of points up to which one thread computes their boxes faster than it can pass the work to
/// the thread pool.
const FEW_POINTS: usize = 16_384;

/// Box of a curve in fractional coordinates: minimum and maximum.
pub(super) type Bounds = [Point; 2];

/// Computes the fractional boxes of the curves of a frame, open or closed.
pub(crate) struct Boxer<'a> {
    set: &'a CurveSet,
    pub(super) inverse: [Point; 3],
    /// Size of a cell in fractional coordinates ([`Cell::units`]).
    units: Point,
    /// Padding for splines, as a share of the size of the box of the control points.
    spline: f64,
}

impl<'a> Boxer<'a> {
    /// # Errors
    ///
    /// [`Error::Usage`] if the cell is invalid.
    pub fn new(set: &'a CurveSet, cell: &Cell) -> Result<Boxer<'a>> {
        Ok(Boxer {
            set,
            inverse: cell.inverse_or_error()?,
            units: cell.units(),
            spline: match set.basis() {
                // The curve is within a sixth of the difference of two control points from a
                // control point.
                Basis::CatmullRom => 0.2,
                _ => 0.0,
            },
        })
    }

    /// Returns the box of a curve, from the bounds of its control points.
    pub(super) fn padded(&self, [lo, hi]: Bounds) -> Bounds {
        let pad = per_axis(|x| {
            let size = lo[x].abs().max(hi[x].abs()).max(self.units[x]);
            self.spline * (hi[x] - lo[x]) + PAD * size
        });
        grown(&[lo, hi], pad)
    }

    /// Returns the box of a curve, from its points.
    fn bounds(&self, i: usize) -> Bounds {
        self.padded(self.set.bounds_along(i, &self.inverse))
    }

    /// Returns the boxes of all curves, from their points.
    fn boxes(&self) -> impl IndexedParallelIterator<Item = Bounds> {
        let curves = (0..self.set.len()).into_par_iter().with_min_len(64);
        curves.map(|i| self.bounds(i))
    }

    /// Returns the minimum slack over all curves along each direction. `of` returns the slack of a
    /// curve, from its index and its box.
    pub fn smallest_slack(&self, of: impl Fn(usize, &Bounds) -> Point + Send + Sync) -> Point {
        let none = [f64::INFINITY; 3];
        match self.set.points() <= FEW_POINTS {
            true => {
                let slacks = (0..self.set.len()).map(|i| of(i, &self.bounds(i)));
                slacks.fold(none, smaller_slack)
            }
            false => pool::run(self.set.segments(), || {
                let slacks = self.boxes().enumerate().map(|(i, b)| of(i, &b));
                slacks.reduce(|| none, smaller_slack)
            }),
        }
    }

    /// Returns true if `slack` is at most `other`, which was computed in another way, up to
    /// rounding.
    pub fn is_at_most(&self, slack: Point, other: Point) -> bool {
        (0..3).all(|x| slack[x] <= other[x] + 1e-9 * self.units[x])
    }
}

/// Boxes of all curves of a frame: minimum and maximum of each.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct FractionalBoxes(pub Vec<Bounds>);

impl FractionalBoxes {
    /// Returns the boxes of the curves, open or closed. Each contains the curve.
    pub fn new(boxer: &Boxer<'_>) -> FractionalBoxes {
        let segments = boxer.set.segments();
        FractionalBoxes(pool::run(segments, || boxer.boxes().collect()))
    }

    /// Returns boxes that contain the curves at all times of the step from another frame. Paths
    /// deviate from straight lines by at most `bend`.
    pub fn swept_from(&self, before: &FractionalBoxes, bend: &Bend) -> FractionalBoxes {
        let both = before.0.iter().zip(&self.0);
        let swept = both.map(|(a, b)| {
            let around = union(*a, *b);
            grown(&around, bend.of(sides(&around)))
        });
        FractionalBoxes(swept.collect())
    }

    /// Returns the mean size of the curves along a direction.
    pub fn mean_size(&self, x: usize) -> f64 {
        let total: f64 = self.0.iter().map(|b| sides(b)[x]).sum();
        total / self.0.len().max(1) as f64
    }

    /// Returns the size of the scene along a direction.
    pub fn extent(&self, x: usize) -> f64 {
        let all = self.0.iter().copied().reduce(union);
        all.map_or(0.0, |all| sides(&all)[x].max(0.0))
    }

    /// Returns the boxes grown by a margin on all sides: a share of the cell along a lattice
    /// vector, a length along other directions.
    pub fn dilated(&self, margin: Point) -> FractionalBoxes {
        FractionalBoxes(self.0.iter().map(|b| grown(b, margin)).collect())
    }

    /// Returns the slack of `curve` with the given current box: the smallest distance from the
    /// faces of its box in `self`, along each direction. Negative or NaN if the current box is not
    /// inside.
    pub fn slack_for(&self, curve: usize, [lo, hi]: &Bounds) -> Point {
        let around = &self.0[curve];
        per_axis(|x| smaller_or_nan(lo[x] - around[0][x], around[1][x] - hi[x]))
    }

    /// Returns the largest side of all boxes along each direction.
    pub fn largest_sides(&self) -> Point {
        let sides = self.0.iter().map(sides);
        sides.fold([0.0; 3], |a, b| per_axis(|x| a[x].max(b[x])))
    }

    /// Returns the curves with boxes of more than half of the cell along a lattice vector. Only
    /// these can have a segment of that length.
    pub fn wide(&self, cell: &Cell) -> Vec<usize> {
        let periodic = cell.periodic();
        let is_wide = |b: &Bounds| (0..3).any(|x| periodic[x] && sides(b)[x] > 0.5);
        let all = self.0.iter().enumerate();
        all.filter(|(_, b)| is_wide(b)).map(|(i, _)| i).collect()
    }

    /// Returns the curve with the largest box along the lattice vectors.
    pub fn widest(&self, cell: &Cell) -> usize {
        let periodic = cell.periodic();
        let side = |b: &Bounds| {
            let along = (0..3).filter(|&x| periodic[x]).map(|x| sides(b)[x]);
            along.fold(0.0, f64::max)
        };
        let sides = self.0.iter().map(side).enumerate();
        let widest = sides.max_by(|a, b| a.1.total_cmp(&b.1));
        widest.map_or(0, |(curve, _)| curve)
    }
}

/// Returns a box grown by these lengths on both sides.
fn grown([lo, hi]: &Bounds, by: Point) -> Bounds {
    [sub(*lo, by), add(*hi, by)]
}

/// Returns the sides of a box.
fn sides([lo, hi]: &Bounds) -> Point {
    sub(*hi, *lo)
}

/// Returns the smaller slack along each direction, or NaN if either is NaN.
pub(super) fn smaller_slack(a: Point, b: Point) -> Point {
    per_axis(|x| smaller_or_nan(a[x], b[x]))
}

/// Returns the smaller number, or NaN if either is NaN.
fn smaller_or_nan(a: f64, b: f64) -> f64 {
    if a <= b || a.is_nan() { a } else { b }
}

/// Bound of the deviation of vertex paths from straight lines, in fractional coordinates, during a
/// step in which vertices move on straight lines, and the lattice vectors change at constant speed.
///
/// # Derivation
///
/// Let `A` be the cell of the first frame, `A + D` that of the second one, and `u` the coordinates
/// of a vertex. At the fraction `t` of the step, `(A + t D) u(t) = x(t)`. The difference of `u(t)`
/// from the straight line between both frames is `t (1 - t) (A + t D)^-1 D (u(1) - u(0))`. With `E
/// = A^-1 D`, the product of the two matrices is `E - t E^2 + ..`, each entry of which is at most
/// that of `|E| + |E|^2 + ..`. Half of that is twice the bound, which covers rounding.
///
/// An entry is the coordinate along one direction that a unit of another direction causes. So the
/// bound does not depend on the unit of length, and an axis that is not periodic does not bend
/// others as long as its unit vector does not change.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Bend([Point; 3]);

impl Bend {
    /// Returns the bend of a step between these cells.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if the cell changes by more than half.
    pub fn between([from, to]: [&Cell; 2]) -> Result<Bend> {
        if from.vectors == to.vectors {
            return Ok(Bend::default());
        }
        let (entries, units) = (change_of(from, to), from.units());
        // Norm in units of the cell.
        let of_row = |(row, unit): (&Point, f64)| dot(*row, units) / unit;
        let mut norms = entries.iter().zip(units).map(of_row);
        // Also true if a number is NaN.
        if !norms.all(|norm| norm <= 0.5) {
            return Err(Error::Usage(format!(
                "the cell changed from {from} to {to} in one step: more than half of its size"
            )));
        }
        let mut sum = entries;
        // Each round adds the next power of the matrix; the norm of the remainder is at least
        // halved.
        for _ in 0..64 {
            let column = |k: usize| per_axis(|m| sum[m][k]);
            sum = per_axis(|r| per_axis(|k| entries[r][k] + dot(entries[r], column(k))));
        }
        Ok(Bend(sum.map(|row| row.map(|x| 0.5 * x))))
    }

    /// Returns the largest deviation along each direction in a box of these sides.
    pub fn of(&self, sides: Point) -> Point {
        self.0.map(|row| dot(row, sides))
    }
}

/// Returns the magnitudes of the entries of `A^-1 D` ([`Bend`]). NaN if the cell has no inverse.
fn change_of(from: &Cell, to: &Cell) -> [Point; 3] {
    let (Some(a), Some(b), Some(inverse)) = (from.basis(), to.basis(), from.inverse()) else {
        return [[f64::NAN; 3]; 3];
    };
    inverse.map(|row| per_axis(|k| dot(row, sub(b[k], a[k])).abs()))
}

/// Returns a box, translated and rounded outward. Its bounds are finite.
pub(super) fn single(bounds: &[Point; 2], by: Point) -> Box3 {
    Box3::around(bounds.map(|p| add(p, by)))
}
