//! Frames as the Python package passes them: one array of points, and the number of points of each
//! curve.

use crate::call::guarded;
use crate::{exception, without_unwrapping};
use linkwatch::{Basis, Cell, Closing, ClosingNote, CurveSource, Error, Positions, RawFrame};
use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Points in an array of the shape `(n, 3)`, in single or double precision.
pub enum Points<'py> {
    Single(PyReadonlyArray2<'py, f32>),
    Double(PyReadonlyArray2<'py, f64>),
}

impl<'a, 'py> FromPyObject<'a, 'py> for Points<'py> {
    type Error = PyErr;

    fn extract(points: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        // A failed `extract` would write a message, which takes longer than two small curves.
        match points.cast::<PyArray2<f32>>() {
            Ok(array) => Ok(Points::Single(array.try_readonly()?)),
            Err(_) => points.extract().map(Points::Double),
        }
    }
}

impl Points<'_> {
    /// Returns the coordinates, without a copy.
    pub fn positions(&self) -> PyResult<Positions<'_>> {
        let shape = match self {
            Points::Single(array) => array.shape(),
            Points::Double(array) => array.shape(),
        };
        let [_, 3] = shape else {
            let words = format!("points have the shape {shape:?}, expected (n, 3)");
            return Err(PyValueError::new_err(words));
        };
        Ok(match self {
            Points::Single(array) => Positions::F32(array.as_slice()?),
            Points::Double(array) => Positions::F64(array.as_slice()?),
        })
    }
}

/// Returns the periodic cell of these numbers: three vectors and the corner.
pub fn cell(numbers: [f64; 12]) -> Cell {
    let (points, _) = numbers.as_chunks::<3>();
    Cell {
        origin: points[3],
        vectors: [points[0], points[1], points[2]],
    }
}

/// Returns the three vectors of a periodic cell, and its corner.
pub fn rows(cell: Cell) -> [[f64; 3]; 4] {
    let [a, b, c] = cell.vectors;
    [a, b, c, cell.origin]
}

/// Returns the basis of this name.
pub fn basis(name: &str) -> PyResult<Basis> {
    let unknown = |e: Error| PyValueError::new_err(format!("basis {name:?}: {e}"));
    name.parse().map_err(unknown)
}

/// Returns what else is known of the curves of a frame: the numbers of its cell, and if curves are
/// closed only by default.
pub fn source(cell_numbers: Option<[f64; 12]>, closed_by_default: bool) -> CurveSource {
    CurveSource {
        cell: cell_numbers.map(cell),
        closed_by_default,
        ..CurveSource::default()
    }
}

/// Returns decisions about closed and open curves as sentences.
pub fn sentences(notes: &[ClosingNote]) -> Vec<String> {
    notes.iter().map(ToString::to_string).collect()
}

/// Returns a frame of the curves with these points.
pub fn raw<'a>(
    points: &'a Points<'_>,
    counts: &'a [i32],
    basis_name: &str,
) -> PyResult<RawFrame<'a>> {
    Ok(RawFrame {
        basis: basis(basis_name)?,
        counts,
        positions: points.positions()?,
    })
}

/// Returns the counts of curves, below 0 if they are closed, notes about them, and a warning if the
/// boundary of the cell may tear one of them.
#[pyfunction]
pub fn decided_counts(
    points: Points<'_>,
    counts: Vec<i32>,
    basis_name: &str,
    cell_numbers: Option<[f64; 12]>,
    closed_by_default: bool,
) -> PyResult<(Vec<i32>, Vec<String>, Option<String>)> {
    let frame = raw(&points, &counts, basis_name)?;
    let source = source(cell_numbers, closed_by_default);
    guarded(|| {
        let mut closing = Closing::default();
        let set = closing.curves(frame, source).map_err(exception)?;
        let cell = source.cell.filter(|cell| cell.check().is_ok());
        let torn = cell.and_then(|cell| set.check_whole(&cell).err());
        let decided = set.curves().iter().zip(&counts);
        let decided = decided.map(|(curve, n)| if curve.closed { -n.abs() } else { n.abs() });
        let notes = sentences(&closing.take_notes());
        let torn = torn.map(|e| without_unwrapping(&e));
        Ok((decided.collect(), notes, torn))
    })
}

/// Returns a warning if a segment spans more than half of the scene, as in coordinates that are
/// wrapped into a cell that nobody gave. An invalid frame has none.
#[pyfunction]
pub fn long_segment(
    points: Points<'_>,
    counts: Vec<i32>,
    basis_name: &str,
) -> PyResult<Option<String>> {
    let frame = raw(&points, &counts, basis_name)?;
    guarded(|| {
        let set = Closing::default().curves(frame, CurveSource::default());
        let long = set.ok().and_then(|set| set.long_segment());
        Ok(long.map(|long| {
            format!(
                "{long}: if the box is periodic and the coordinates are wrapped into it, links \
                 across its boundary are not detected: give the cell, with wrapped=True"
            )
        }))
    })
}

/// Returns for each polyline if it ends where it starts.
#[pyfunction]
pub fn ends_meet(points: Points<'_>, counts: Vec<i32>) -> PyResult<Vec<bool>> {
    let positions = points.positions()?;
    guarded(|| Ok(Closing::ends_meet(&counts, positions)))
}
