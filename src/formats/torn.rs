//! Frames whose periodic cell tears a curve.

use super::frames::{ModelFrame, ReadOptions};
use crate::curve::Cell;
use crate::error::Error;
use crate::periodic::find_torn;

impl ModelFrame {
    /// Adds the cell of the frame. Curves that it tears make the frame invalid, unless the caller
    /// unwraps them.
    pub(super) fn in_cell(
        mut self,
        cell: Option<Cell>,
        options: &ReadOptions,
        format: &'static str,
    ) -> ModelFrame {
        let found = match (&cell, &self.curves) {
            (Some(cell), Ok(set)) if !options.wrapped => find_torn(set, cell, 0..set.len()),
            _ => Ok(None),
        };
        match found {
            Ok(None) => {}
            Ok(Some(torn)) => self.curves = Err(Error::unsupported(format, torn)),
            Err(e) => self.curves = Err(e),
        }
        ModelFrame { cell, ..self }
    }
}
