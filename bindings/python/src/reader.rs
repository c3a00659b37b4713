//! The readers of the package, which the command uses for formats that it does not know.

use crate::frame::{Points, cell, raw};
use linkwatch::formats::{ExternalFrames, ExternalReader, ModelFrame, ReadOptions};
use linkwatch::{CurveLabels, CurveSet, Error, FrameInfo, LeftOut, Result};
use pyo3::call::PyCallArgs;
use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::{PyImportError, PyOSError, PyValueError};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::slice;
use std::sync::Arc;

/// A `linkwatch._command.Reader`.
pub struct PackageReader(pub Py<PyAny>);

/// A frame of the package: an `io.Frame`, the elements that are not read (number, kind, place of
/// the first one), and new notes about the files.
type Read<'py> = (Bound<'py, PyAny>, Vec<(u64, String, String)>, Vec<String>);

impl ExternalReader for PackageReader {
    fn reads(&self, file: &Path) -> Result<bool> {
        self.call("reads", (file,), slice::from_ref(&file.into()))
    }

    fn groups(&self, files: &[PathBuf], format: Option<&str>) -> Result<Vec<usize>> {
        self.call("groups", (files, format), files)
    }

    fn unpacked(&self, file: &Path) -> Result<PathBuf> {
        self.call("unpacked", (file,), slice::from_ref(&file.into()))
    }

    fn open(&self, files: &[PathBuf], options: &ReadOptions) -> Result<ExternalFrames> {
        // The command unwraps coordinates if it was told to.
        let unwrap = options.wrapped.map(|_| false);
        let cell = match options.cell {
            Some(Some(cell)) => Some(cell.to_string()),
            Some(None) if options.wrapped.is_none() => Some("none".into()),
            _ => None,
        };
        let given = (
            options.closed,
            options.keep_open,
            options.keep_order,
            unwrap,
            cell,
            options.select.as_deref(),
            options.format.as_deref(),
        );
        Ok(Box::new(PackageFrames {
            frames: self.call("frames", (files, options.one_motion, given), files)?,
            files: files.into(),
            labels: Arc::default(),
        }))
    }
}

impl PackageReader {
    /// Calls a method, for files of which errors name the one that is damaged.
    fn call<T: for<'py> FromPyObjectOwned<'py>>(
        &self,
        method: &str,
        arguments: impl for<'py> PyCallArgs<'py>,
        files: &[PathBuf],
    ) -> Result<T> {
        Python::attach(|py| {
            let result = self.0.bind(py).call_method1(method, arguments);
            let result = result.and_then(|result| result.extract().map_err(Into::into));
            result.map_err(|e: PyErr| failed(py, &e, files))
        })
    }
}

/// Returns the error of an exception of a reader. It names the file that the exception names, or
/// the last one.
fn failed(py: Python<'_>, e: &PyErr, files: &[PathBuf]) -> Error {
    let words = e.value(py).to_string();
    let rest = |file: &PathBuf| {
        let rest = words.strip_prefix(&file.display().to_string())?;
        rest.strip_prefix(": ").or(rest.strip_prefix(", "))
    };
    let named = files.iter().find(|file| rest(file).is_some());
    let path = named.or(files.last()).cloned().unwrap_or_default();
    let is_known = e.is_instance_of::<PyImportError>(py)
        || e.is_instance_of::<PyOSError>(py)
        || e.is_instance_of::<PyValueError>(py);
    let words = if is_known {
        of_command(rest(&path).unwrap_or(&words))
    } else {
        e.display(py);
        let kind = e.get_type(py).name();
        let kind = kind.map_or_else(|_| "exception".into(), |name| name.to_string());
        let words = words.split_whitespace().collect::<Vec<_>>().join(" ");
        format!("{kind}: {words}: please report this, with the lines above")
    };
    // The frames after it are lost, so it is not only one invalid frame.
    let source = std::io::Error::other(words);
    Error::File { path, source }
}

/// Returns a message with the options of the command in place of those of the package.
fn of_command(words: &str) -> String {
    words.replace("`unwrap=False`", "--wrapped=false")
}

/// Frames of files that are read together.
struct PackageFrames {
    files: Vec<PathBuf>,
    /// Iterator over [`Read`].
    frames: Py<PyAny>,
    /// Names and radii of the last frame.
    labels: Arc<CurveLabels>,
}

impl Iterator for PackageFrames {
    type Item = Result<ModelFrame>;

    fn next(&mut self) -> Option<Result<ModelFrame>> {
        Python::attach(|py| {
            let next = self
                .frames
                .bind(py)
                .try_iter()
                .map(|mut frames| frames.next());
            let read = next
                .transpose()?
                .and_then(|next| self.frame(next?.extract()?));
            Some(read.map_err(|e| failed(py, &e, &self.files)))
        })
    }
}

impl PackageFrames {
    fn frame(&mut self, (frame, left_out, notes): Read<'_>) -> PyResult<ModelFrame> {
        let get = |name: &str| frame.getattr(name);
        let mut info = FrameInfo::at(get("seq")?.extract()?, get("time")?.extract()?);
        info.cuts = get("cuts")?.extract()?;
        info.closed_by_default = get("closed_by_default")?.extract()?;
        let of_frame = get("cell")?;
        if !of_frame.is_none() {
            let rows: [[f64; 3]; 4] = of_frame.call_method0("tolist")?.extract()?;
            info.cell = Some(cell(rows.as_flattened().try_into().expect("12 numbers")));
        }
        let names: Vec<String> = get("names")?.extract()?;
        let radii: Vec<f32> = get("radii")?.extract()?;
        let labels = CurveLabels::named(names).with_radii(radii);
        if *self.labels != labels {
            self.labels = Arc::new(labels);
        }
        info.labels = Arc::clone(&self.labels);
        let left_out = left_out.into_iter();
        let left_out = left_out.map(|(count, kind, first)| LeftOut {
            count,
            kind: [kind.clone().into(), kind.into()],
            first,
        });
        info.left_out = left_out.collect();
        let curves = match get("rejected")?.extract::<Option<String>>()? {
            Some(why) => Err(Error::Usage(of_command(&why))),
            None => {
                let points: Points<'_> = get("positions")?.extract()?;
                let (counts, basis): (Vec<i32>, String) =
                    (get("counts")?.extract()?, get("basis")?.extract()?);
                let raw = raw(&points, &counts, &basis)?;
                CurveSet::from_counts(raw.basis, raw.counts, raw.positions)
            }
        };
        let mut frame = ModelFrame::of(info, curves);
        frame.notes = notes;
        Ok(frame)
    }
}
