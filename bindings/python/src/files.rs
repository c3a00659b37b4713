//! Files that the command reads itself, as frames for Python.

use crate::call::Shared;
use crate::frame::rows;
use linkwatch::formats::ReadOptions;
use linkwatch::{CurveLabels, CurveSet, LeftOut, Positions};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Numbers of points, basis, names and radii of the curves of a frame.
type Described = (Vec<i32>, String, Vec<String>, Vec<f32>);

/// A frame, as `linkwatch.io` takes it.
#[pyclass(frozen, get_all, module = "linkwatch")]
pub struct Row {
    /// Name of the file, with the number of the frame if it may hold several.
    name: String,
    seq: u64,
    time: f64,
    cuts: u32,
    cell: Option<[[f64; 3]; 4]>,
    /// Points of the curves, unless the frame is invalid.
    points: Option<Py<PyAny>>,
    /// Description of the curves, unless it is that of the frame before.
    described: Option<Described>,
    /// Reason why the frame is invalid.
    rejected: Option<String>,
}

/// `closed`, `wrapped`, `keep_open` and `keep_order`.
type Flags = (Option<bool>, Option<bool>, bool, bool);

/// Reads files as `linkwatch convert` does.
#[pyclass(frozen, module = "linkwatch")]
pub struct FileReader(Shared<State>);

struct State {
    reader: linkwatch::FileReader,
    /// Description of the last valid frame.
    counts: Vec<i32>,
    basis: String,
    labels: Option<Arc<CurveLabels>>,
}

#[pymethods]
impl FileReader {
    /// The cell is one in the form of the option `--cell`, or `none`.
    #[new]
    fn new(
        py: Python<'_>,
        files: Vec<PathBuf>,
        flags: Flags,
        cell: Option<&str>,
        counts: Option<Vec<i32>>,
        topic: Option<String>,
        bonds: Option<PathBuf>,
    ) -> PyResult<FileReader> {
        let mut options = ReadOptions::default();
        (
            options.closed,
            options.wrapped,
            options.keep_open,
            options.keep_order,
        ) = flags;
        options.cell = match cell {
            None => None,
            Some("none") => Some(None),
            Some(text) => Some(Some(text.parse().map_err(exception)?)),
        };
        (options.counts, options.topic, options.bonds) = (counts, topic, bonds);
        let open = || linkwatch::FileReader::open(&files, options);
        Ok(FileReader(Shared::new(State {
            reader: py.detach(open).map_err(exception)?,
            counts: Vec::new(),
            basis: String::new(),
            labels: None,
        })))
    }

    /// Reads the next frame. `None` after the last one.
    fn next(&self, py: Python<'_>) -> PyResult<Option<Row>> {
        self.0.with(py, |state| {
            let Some(frame) = py.detach(|| state.reader.next()) else {
                return Ok(None);
            };
            let frame = frame.map_err(exception)?;
            let info = frame.info;
            let (mut points, mut described, mut rejected) = (None, None, None);
            match frame.curves {
                Ok(set) => {
                    points = Some(array(py, &set)?);
                    described = state.described(&set, info.labels);
                }
                Err(e) => rejected = Some(of_package(&e.to_string())),
            }
            Ok(Some(Row {
                name: frame.name,
                seq: info.seq,
                time: info.time,
                cuts: info.cuts,
                cell: info.cell.map(rows),
                points,
                described,
                rejected,
            }))
        })
    }

    /// Returns the messages since the last call.
    fn messages(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.0.with(py, |state| {
            let messages = state.reader.take_messages();
            Ok(messages.map(|words| of_package(&words)).collect())
        })
    }

    /// Returns the elements that were not read so far: their kind, and a sentence.
    fn left_out(&self, py: Python<'_>) -> PyResult<Vec<(String, String)>> {
        let words = |found: &LeftOut| (found.kind[1].to_string(), found.to_string());
        let all = |state: &mut State| Ok(state.reader.left_out.iter().map(words).collect());
        self.0.with(py, all)
    }

    /// Returns the number of the file among those of a recorded run; and at the end, whether frames
    /// after the last one are missing, and whether the run continues in another file.
    fn ending(&self, py: Python<'_>) -> PyResult<(Option<u32>, bool, bool)> {
        self.0.with(py, |State { reader, .. }| {
            Ok((reader.part(), reader.ends_in_gap(), reader.is_unfinished()))
        })
    }
}

impl State {
    /// Returns the description of curves, unless it is the last one.
    fn described(&mut self, set: &CurveSet, labels: Arc<CurveLabels>) -> Option<Described> {
        let basis = set.basis().to_string();
        let is_known = self.labels.as_ref() == Some(&labels)
            && self.basis == basis
            && set.counts().eq(self.counts.iter().copied());
        if is_known {
            return None;
        }
        self.counts = set.counts().collect();
        self.basis.clone_from(&basis);
        let (names, radii) = (labels.names.clone(), labels.radii.clone());
        self.labels = Some(labels);
        Some((self.counts.clone(), basis, names, radii))
    }
}

/// Returns the points of all curves, of the shape `(n, 3)`.
fn array(py: Python<'_>, set: &CurveSet) -> PyResult<Py<PyAny>> {
    let shape = [set.points(), 3];
    Ok(match set.positions() {
        Positions::F32(v) => PyArray1::from_slice(py, v)
            .reshape(shape)?
            .into_any()
            .unbind(),
        Positions::F64(v) => PyArray1::from_slice(py, v)
            .reshape(shape)?
            .into_any()
            .unbind(),
    })
}

/// Returns the exception of a file that cannot be read.
fn exception(e: linkwatch::Error) -> PyErr {
    PyValueError::new_err(of_package(&e.to_string()))
}

/// Returns a message with the options of the package in place of those of the command.
fn of_package(words: &str) -> String {
    words
        .replace("option `--", "option `")
        .replace("`wrapped", "`unwrap")
        .replace("--wrapped", "`unwrap`")
        .replace("=false`", "=False`")
        .replace("`--cell ", "`cell=")
        .replace("give --one-motion", "pass the option `one_motion`")
}
