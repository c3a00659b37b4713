//! Images of the blocks of a periodic scene, and their motion if the cell changes.
//!
//! # Proof: images that are not listed are beyond the reach
//!
//! Two strands within a distance `R` have a lattice vector between them of less than `R` and the
//! extent `E` of the scene together, so its multiple of the lattice vector `k` is at most `|b[k]|
//! (R + E)`, with the vectors `b` of the inverse of the cell. If the vectors move by `d[k]`, that
//! lattice vector moves by at most the sum of all `|b[k]| (R + E) |d[k]|`, the *drift*.
//!
//! The list is complete up to a clearance as long as no two blocks, together with the lattice
//! vector between them, moved by more than twice the skin. Suppose that a pair is within this
//! clearance now. Let `R` be the distance of that clearance plus twice the skin. The motion of the
//! lattice vector since the last reference frame is at most the drift for `R`, so the pair was
//! within `R` in that reference frame, too. The same holds for each earlier reference frame, back
//! to the frame of the list. So if the pair was not listed, all these motions together exceed twice
//! the skin.

use crate::curve::vector::{add, dot, norm, per_axis};
use crate::curve::{Box3, Cell, Image, Point, is_home, pow2};
use crate::error::Result;
use crate::pairs::LinkSearch;
use crate::periodic::overlapping;

/// Padding of fractional coordinates, relative to the largest coordinate or to a cell, whichever is
/// larger.
const PAD: f64 = 1e-7;

/// Relative rounding error of the motion of a lattice vector.
const ROUNDING: f64 = 1e-15;

/// The lattice of a reference frame.
#[derive(Debug)]
pub(super) struct Lattice {
    cell: Cell,
    inverse: [Point; 3],
    /// Upper bound of the distance of two points of the scene.
    extent: f64,
    /// Maximum distance of strands whose images are listed, including the allowed motion.
    reach: f64,
}

/// Motion of the lattice from a reference frame to another one.
#[derive(Debug)]
pub(super) struct LatticeMotion {
    /// Motion of each vector.
    moved: Cell,
    /// For each vector, the larger of its lengths in both frames.
    lengths: [f64; 3],
    /// Lengths of the vectors of the inverse of the current cell.
    inverse: [f64; 3],
    /// Maximum distance of two points of the reference frame plus the reach.
    within: f64,
}

impl Lattice {
    /// Returns the lattice of a scene with these boxes, for strands up to a distance.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`](crate::Error::Usage) if the cell is invalid.
    pub fn new(cell: &Cell, boxes: &[Box3], reach: f64) -> Result<Lattice> {
        let inverse = cell.inverse_or_error()?;
        let all = boxes.iter().copied().reduce(|a, b| a.union(&b));
        let size = |b: Box3| {
            let (lo, hi) = (b.lo.map(f64::from), b.hi.map(f64::from));
            let largest = lo.iter().chain(&hi).fold(0.0, |m: f64, x| m.max(x.abs()));
            // Boxes are rounded to single precision.
            norm(per_axis(|x| hi[x] - lo[x])) + largest * pow2(-20)
        };
        Ok(Lattice {
            cell: *cell,
            inverse,
            extent: all.map_or(0.0, size) * (1.0 + 1e-9),
            reach,
        })
    }

    /// Returns all pairs of a box and an image of another one, or of itself, that may overlap. See
    /// [`overlapping`].
    ///
    /// # Errors
    ///
    /// The number of a box that spans too many cells.
    pub fn near<'a>(
        &self,
        boxes: &[Box3],
        search: &'a mut LinkSearch,
    ) -> Result<impl Iterator<Item = (u32, u32, Image)> + use<'a>, usize> {
        let units = self.cell.units();
        let bounds = boxes.iter().map(|b| {
            let (lo, hi) = (b.lo.map(f64::from), b.hi.map(f64::from));
            let middle = per_axis(|x| 0.5 * (lo[x] + hi[x]));
            let half = per_axis(|x| 0.5 * (hi[x] - lo[x]));
            let range = per_axis(|k| {
                let b = self.inverse[k];
                let size = dot(b.map(f64::abs), half);
                let largest = dot(b.map(f64::abs), middle.map(f64::abs));
                let half = size + PAD * (largest + size + units[k]);
                let middle = dot(b, middle);
                [middle - half, middle + half]
            });
            [range.map(|r| r[0]), range.map(|r| r[1])]
        });
        let bounds: Vec<[Point; 2]> = bounds.collect();
        overlapping(&bounds, &self.cell, |_| true, search)
    }

    /// Returns an image of a box, rounded outward, and a bound of its error.
    pub fn translated(&self, bounds: &Box3, image: Image) -> (Box3, f64) {
        if is_home(&image) {
            return (*bounds, 0.0);
        }
        let by = self.cell.translation(image);
        let moved = [bounds.lo, bounds.hi].map(|p| add(p.map(f64::from), by));
        (Box3::around(moved), norm(by) * pow2(-22))
    }

    /// Returns the motion to another cell, `None` if it is the same.
    pub fn motion_to(&self, cell: &Cell) -> Option<LatticeMotion> {
        if cell.vectors == self.cell.vectors {
            return None;
        }
        let vector = |k: usize| per_axis(|x| cell.vectors[k][x] - self.cell.vectors[k][x]);
        // Cells without an inverse are never measured. For such a cell, the motion is unbounded.
        let inverse = cell.inverse().map(|b| b.map(norm));
        Some(LatticeMotion {
            moved: Cell {
                origin: [0.0; 3],
                vectors: per_axis(vector),
            },
            lengths: per_axis(|k| norm(cell.vectors[k]).max(norm(self.cell.vectors[k]))),
            inverse: inverse.unwrap_or([f64::INFINITY; 3]),
            within: self.reach + self.extent,
        })
    }

    /// Makes a frame the reference frame. `farthest` is an upper bound of the motion of its blocks.
    pub fn rebase(&mut self, cell: &Cell, farthest: f64) {
        self.cell = *cell;
        self.inverse = cell.inverse().unwrap_or(self.inverse);
        self.extent += 2.0 * farthest;
    }
}

impl LatticeMotion {
    /// Returns an upper bound of the motion of lattice vectors between near strands. `farthest` is
    /// an upper bound of the motion of blocks.
    pub fn largest(&self, farthest: f64) -> f64 {
        let motion = per_axis(|k| norm(self.moved.vectors[k]) + ROUNDING * self.lengths[k]);
        // A vector that does not move adds nothing, even if its inverse is infinite.
        let moved = (0..3).filter(|&k| motion[k] > 0.0);
        let shares = moved.map(|k| self.inverse[k] * motion[k]);
        shares.sum::<f64>() * (self.within + 2.0 * farthest) * (1.0 + 1e-7)
    }

    /// Returns the motion of a lattice vector, and a bound of its rounding error.
    #[inline(always)]
    pub fn of(&self, image: Image) -> (Point, f64) {
        let sizes = (0..3).map(|k| f64::from(image[k]).abs() * self.lengths[k]);
        let rounding = 4.0 * ROUNDING * sizes.sum::<f64>();
        (self.moved.translation(image), rounding)
    }
}
