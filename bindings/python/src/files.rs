//! Files that the command reads itself, as frames for Python.

use crate::call::Shared;
use linkwatch::formats::ReadOptions;
use linkwatch::{CurveLabels, CurveSet, LeftOut, Positions};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Numbers of points, basis, names and radii of the curves of a frame.
type Described = (Vec<i32>, String, Vec<String>, Vec<f32>);

/// Points, and a description of their curves unless it is that of the frame before.
type Curves<'py> = (Bound<'py, PyAny>, Option<Described>);

/// Name, number, time, number of cuts, cell, and curves of a frame, or why it is invalid.
type Row<'py> = (
    String,
    u64,
    f64,
    u32,
    Option<[[f64; 3]; 4]>,
    Option<Curves<'py>>,
    Option<String>,
);

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
    fn next<'py>(&self, py: Python<'py>) -> PyResult<Option<Row<'py>>> {
        self.0.with(py, |state| {
            let Some(frame) = py.detach(|| state.reader.next()) else {
                return Ok(None);
            };
            let frame = frame.map_err(exception)?;
            let info = frame.info;
            let rows = |cell: linkwatch::Cell| {
                let [a, b, c] = cell.vectors;
                [a, b, c, cell.origin]
            };
            let (curves, why) = match frame.curves {
                Ok(set) => (Some(state.curves(py, &set, info.labels)?), None),
                Err(e) => (None, Some(of_package(&e.to_string()))),
            };
            let (seq, time, cuts) = (info.seq, info.time, info.cuts);
            Ok(Some((
                frame.name,
                seq,
                time,
                cuts,
                info.cell.map(rows),
                curves,
                why,
            )))
        })
    }

    /// Returns the messages since the last call.
    fn messages(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let messages = |state: &mut State| Ok(state.reader.take_messages());
        let messages = self.0.with(py, messages)?.into_iter();
        Ok(messages.map(|words| of_package(&words)).collect())
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
            Ok((reader.part, reader.ends_in_gap(), reader.is_unfinished()))
        })
    }
}

impl State {
    fn curves<'py>(
        &mut self,
        py: Python<'py>,
        set: &CurveSet,
        labels: Arc<CurveLabels>,
    ) -> PyResult<Curves<'py>> {
        let points = match set.positions() {
            Positions::F32(v) => PyArray1::from_slice(py, v)
                .reshape([v.len() / 3, 3])?
                .into_any(),
            Positions::F64(v) => PyArray1::from_slice(py, v)
                .reshape([v.len() / 3, 3])?
                .into_any(),
        };
        let basis = set.basis().to_string();
        let is_known = self.labels.as_ref() == Some(&labels)
            && self.basis == basis
            && set.counts().eq(self.counts.iter().copied());
        if is_known {
            return Ok((points, None));
        }
        self.counts = set.counts().collect();
        self.basis.clone_from(&basis);
        let (names, radii) = (labels.names.clone(), labels.radii.clone());
        self.labels = Some(labels);
        Ok((points, Some((self.counts.clone(), basis, names, radii))))
    }
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
