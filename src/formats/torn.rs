//! Periodic cells of frames, and curves that they tear.

use super::frames::{ModelFrame, ReadOptions};
use crate::curve::Cell;
use crate::error::{Error, Result};
use crate::periodic::find_torn;

impl ModelFrame {
    /// Curves that the cell of the frame tears make it invalid, unless the caller unwraps them.
    pub(super) fn check_torn(mut self, options: &ReadOptions, format: &'static str) -> ModelFrame {
        let cell = self.info.cell.filter(|_| options.wrapped.is_none());
        self.curves = self.curves.and_then(|set| {
            let torn = cell.map_or(Ok(None), |cell| find_torn(&set, &cell, 0..set.len()))?;
            torn.map_or(Ok(set), |torn| Err(Error::unsupported(format, torn)))
        });
        self
    }
}

/// Returns the cell along the directions that are periodic. `None` if there are none.
///
/// # Errors
///
/// [`Error::Usage`] if a vector is zero, as `empty` says, or the vectors are no lattice.
pub(super) fn cell_along(
    mut cell: Cell,
    periodic: [bool; 3],
    empty: impl Fn(usize) -> String,
) -> Result<Option<Cell>> {
    if !periodic.contains(&true) {
        return Ok(None);
    }
    for (k, vector) in cell.vectors.iter_mut().enumerate() {
        if !periodic[k] {
            *vector = [0.0; 3];
        } else if *vector == [0.0; 3] {
            return Err(Error::Usage(empty(k)));
        }
    }
    cell.check()?;
    Ok(Some(cell))
}
