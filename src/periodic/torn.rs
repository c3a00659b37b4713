//! Curves that are torn at the boundary of a periodic cell.
//!
//! Simulations move points that leave the cell to its other side. A curve that crosses the boundary
//! is then torn: two consecutive points are about a cell apart. No simulation has a segment of half
//! a cell, because an image of the other end would be closer, so such a curve is refused.
//!
//! Cost: three products per segment and periodic direction.

use crate::curve::vector::{dot, sub};
use crate::curve::{Cell, CurveSet};
use crate::error::{Error, Result};

/// A segment that is not proven to be at most half as long as the cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Torn {
    pub curve: usize,
    /// Points of the curve at both ends of the segment.
    pub ends: [usize; 2],
    /// Index of the lattice vector.
    pub direction: usize,
    /// Length along this vector, in units of the vector.
    pub share: f64,
}

/// Returns the first segment of these curves that is torn.
///
/// # Errors
///
/// [`Error::Usage`] if the cell is invalid.
pub(crate) fn find_torn(
    set: &CurveSet,
    cell: &Cell,
    curves: impl IntoIterator<Item = usize>,
) -> Result<Option<Torn>> {
    cell.check()?;
    let (inverse, periodic) = (cell.inverse_or_error()?, cell.periodic());
    for curve in curves {
        for ends in set.curve(curve).pairs_of_points() {
            let [p, q] = ends.map(|k| set.point(curve, k));
            let shares = inverse.map(|b| dot(sub(q, p), b).abs());
            for direction in (0..3).filter(|&k| periodic[k]) {
                let share = shares[direction];
                // False if the share is not a number.
                let whole = share <= 0.5;
                if !whole {
                    return Ok(Some(Torn {
                        curve,
                        ends,
                        direction,
                        share,
                    }));
                }
            }
        }
    }
    Ok(None)
}

/// Same as [`CurveSet::check_whole`], for these curves.
pub(crate) fn check_whole(
    set: &CurveSet,
    cell: &Cell,
    curves: impl IntoIterator<Item = usize>,
) -> Result<()> {
    match find_torn(set, cell, curves)? {
        Some(torn) => Err(Error::Usage(torn.to_string())),
        None => Ok(()),
    }
}

impl CurveSet {
    /// Checks that no curve is torn at the boundary of a periodic cell, as wrapped coordinates are.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if a segment is longer than half of the cell along a lattice vector,
    /// or these vectors are linearly dependent.
    pub fn check_whole(&self, cell: &Cell) -> Result<()> {
        check_whole(self, cell, 0..self.len())
    }
}

impl std::fmt::Display for Torn {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (curve, [p, q], share) = (self.curve, self.ends, self.share);
        let vector = ["first", "second", "third"][self.direction];
        write!(
            f,
            "curve {curve} is {share:.3} of the {vector} lattice vector long from \
             point {p} to {q}, more than half: pass the option `wrapped` if coordinates are \
             wrapped, else the option `wrapped=false`"
        )
    }
}
