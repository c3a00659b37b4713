//! The readers of the package, which the command uses for formats that it does not know.

use crate::frame::{Points, cell, raw};
use linkwatch::formats::{ExternalFrames, ExternalReader, ModelFrame, ReadOptions};
use linkwatch::{Cell, CurveLabels, CurveSet, Error, FrameInfo, LeftOut, Result};
use pyo3::exceptions::{PyImportError, PyOSError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A `linkwatch._command.Reader`.
pub struct PackageReader(pub Py<PyAny>);

/// A frame of the package: an `io.Frame`, its file if it is the only one in that, the elements that
/// are not read (number, kind, place of the first one), and what is new about the file.
type Read<'py> = (
    Bound<'py, PyAny>,
    Option<PathBuf>,
    Vec<(u64, String, String)>,
    Vec<String>,
);

impl ExternalReader for PackageReader {
    fn reads(&self, file: &Path) -> bool {
        let reads = |py: Python<'_>| self.0.call_method1(py, "reads", (file,))?.extract(py);
        Python::attach(reads).unwrap_or(false)
    }

    fn groups(&self, files: &[PathBuf], format: Option<&str>) -> Result<Vec<usize>> {
        let arguments = (files, format);
        Python::attach(|py| {
            let sizes = self.0.call_method1(py, "groups", arguments);
            let sizes = sizes.and_then(|sizes| sizes.extract(py));
            sizes.map_err(|e| failed(py, &e, &files[0]))
        })
    }

    fn unpacked(&self, file: &Path) -> Result<PathBuf> {
        Python::attach(|py| {
            let path = self.0.call_method1(py, "unpacked", (file,));
            let path = path.and_then(|path| path.extract(py));
            path.map_err(|e| failed(py, &e, file))
        })
    }

    fn open(&self, files: &[PathBuf], options: &ReadOptions) -> Result<ExternalFrames> {
        let path = files.last().cloned().unwrap_or_default();
        let opened = Python::attach(|py| {
            let given = PyDict::new(py);
            given.set_item("closed", options.closed)?;
            given.set_item("keep_open", options.keep_open)?;
            given.set_item("unwrap", options.wrapped)?;
            given.set_item("cell", options.cell.flatten().map(numbers))?;
            given.set_item("select", options.select.as_deref())?;
            given.set_item("format", options.format.as_deref())?;
            given.set_item("keep_order", options.keep_order)?;
            let arguments = (files, options.one_motion, given);
            self.0.call_method1(py, "frames", arguments)
        });
        let frames = opened.map_err(|e| Python::attach(|py| failed(py, &e, &path)))?;
        let labels = Arc::default();
        let frames = PackageFrames {
            path,
            frames,
            labels,
        };
        Ok(Box::new(frames))
    }
}

/// Returns a cell as the package takes it: three vectors and the corner.
fn numbers(cell: Cell) -> Vec<f64> {
    let [a, b, c] = cell.vectors;
    [a, b, c, cell.origin].concat()
}

/// Returns the error of an exception of a reader.
fn failed(py: Python<'_>, e: &PyErr, path: &Path) -> Error {
    let words = e.value(py).to_string();
    let is_known = e.is_instance_of::<PyImportError>(py)
        || e.is_instance_of::<PyOSError>(py)
        || e.is_instance_of::<PyValueError>(py);
    let words = if is_known {
        let name = format!("{}: ", path.display());
        words.strip_prefix(&name).unwrap_or(&words).to_owned()
    } else {
        e.display(py);
        let kind = e.get_type(py).name();
        let kind = kind.map_or_else(|_| "exception".into(), |name| name.to_string());
        let words = words.split_whitespace().collect::<Vec<_>>().join(" ");
        format!("{kind}: {words}: please report this, with the lines above")
    };
    // The frames after it are lost, so it is not only one invalid frame.
    let (path, source) = (path.into(), std::io::Error::other(words));
    Error::File { path, source }
}

/// Frames of files that are read together.
struct PackageFrames {
    path: PathBuf,
    /// Iterator over [`Read`].
    frames: Py<PyAny>,
    /// Names and radii of the last frame.
    labels: Arc<CurveLabels>,
}

impl Iterator for PackageFrames {
    type Item = Result<ModelFrame>;

    fn next(&mut self) -> Option<Result<ModelFrame>> {
        Python::attach(|py| {
            let read = self
                .frames
                .bind(py)
                .clone()
                .cast_into::<pyo3::types::PyIterator>();
            let next = read.expect("a generator").next()?;
            let read = next.and_then(|read| self.frame(&read.extract()?));
            Some(read.map_err(|e| failed(py, &e, &self.path)))
        })
    }
}

impl PackageFrames {
    fn frame(&mut self, (frame, file, left_out, notes): &Read<'_>) -> PyResult<ModelFrame> {
        let (seq, time) = (
            frame.getattr("seq")?.extract()?,
            frame.getattr("time")?.extract()?,
        );
        let mut info = FrameInfo::at(seq, time);
        info.cuts = frame.getattr("cuts")?.extract()?;
        info.closed_by_default = frame.getattr("closed_by_default")?.extract()?;
        let of_frame = frame.getattr("cell")?;
        if !of_frame.is_none() {
            let rows: [[f64; 3]; 4] = of_frame.call_method0("tolist")?.extract()?;
            info.cell = Some(cell(
                rows.as_flattened().try_into().expect("twelve numbers"),
            ));
        }
        let names: Vec<String> = frame.getattr("names")?.extract()?;
        let labels =
            CurveLabels::named(names).with_radii(frame.getattr("radii")?.extract::<Vec<f32>>()?);
        if *self.labels != labels {
            self.labels = Arc::new(labels);
        }
        info.labels = Arc::clone(&self.labels);
        info.left_out = left_out
            .iter()
            .map(|(count, kind, first)| LeftOut {
                count: *count,
                kind: [kind.clone().into(), kind.clone().into()],
                first: first.clone(),
            })
            .collect();
        let curves = match frame.getattr("rejected")?.extract::<Option<String>>()? {
            Some(why) => Err(Error::Usage(why)),
            None => {
                let points: Points<'_> = frame.getattr("positions")?.extract()?;
                let counts: Vec<i32> = frame.getattr("counts")?.extract()?;
                let basis: String = frame.getattr("basis")?.extract()?;
                let frame = raw(&points, &counts, &basis)?;
                CurveSet::from_counts(frame.basis, frame.counts, frame.positions)
            }
        };
        let mut frame = ModelFrame::of(info, curves);
        (frame.file, frame.notes) = (file.clone(), notes.clone());
        Ok(frame)
    }
}
