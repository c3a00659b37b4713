//! The extension module of the Python package `linkwatch`. The package brings the curves of a frame
//! into one array first; see `python/linkwatch/__init__.py`.

mod call;
mod certificate;
mod client;
mod files;
mod frame;
mod reader;
mod result;
mod session;
mod strands;

use pyo3::prelude::*;
use std::ffi::OsString;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

#[pymodule]
fn _linkwatch(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<certificate::Certificate>()?;
    module.add_class::<session::Session>()?;
    module.add_class::<client::Client>()?;
    module.add_class::<client::Message>()?;
    module.add_class::<files::FileReader>()?;
    module.add_function(wrap_pyfunction!(session::certify, module)?)?;
    module.add_function(wrap_pyfunction!(frame::decided_counts, module)?)?;
    module.add_function(wrap_pyfunction!(frame::long_segment, module)?)?;
    module.add_function(wrap_pyfunction!(frame::ends_meet, module)?)?;
    module.add_function(wrap_pyfunction!(strands::thickness, module)?)?;
    module.add_function(wrap_pyfunction!(strands::struts, module)?)?;
    module.add_function(wrap_pyfunction!(strands::ribbon, module)?)?;
    module.add_function(wrap_pyfunction!(strands::gauss, module)?)?;
    module.add_function(wrap_pyfunction!(strands::diagram, module)?)?;
    module.add_function(wrap_pyfunction!(command, module)?)?;
    module.add_function(wrap_pyfunction!(sorted_by_number, module)?)?;
    module.add_function(wrap_pyfunction!(reduced_cell, module)?)?;
    Ok(())
}

/// Runs the command `linkwatch`, once in a process. The first argument is the name of the program.
/// The reader is a `linkwatch._command.Reader`. Returns the exit code.
#[pyfunction]
fn command(py: Python<'_>, args: Vec<OsString>, reader: Py<PyAny>) -> u8 {
    let reader = Some(Box::new(reader::PackageReader(reader)) as _);
    let run = AssertUnwindSafe(|| linkwatch::run_command(args, reader));
    // The code of a panic in a binary. The code 1 of an exception means a changed topology.
    py.detach(|| catch_unwind(run).unwrap_or(101))
}

/// Returns paths sorted by the numbers in them.
#[pyfunction]
fn sorted_by_number(mut paths: Vec<PathBuf>) -> Vec<OsString> {
    linkwatch::sort_by_number(&mut paths);
    paths.into_iter().map(OsString::from).collect()
}

/// Returns the cell with the shortest lattice vectors of the same lattice.
#[pyfunction]
fn reduced_cell(numbers: [f64; 12]) -> [[f64; 3]; 4] {
    frame::rows(frame::cell(numbers).reduced())
}

/// Returns the exception of an error: `OSError` if a file cannot be read or written (a subclass
/// that says why, such as `FileNotFoundError`), `ConnectionError` for the bus, `RuntimeError` in a
/// forked process, else `ValueError`.
fn exception(error: linkwatch::Error) -> PyErr {
    use linkwatch::Error;
    use pyo3::exceptions::{PyConnectionError, PyOSError, PyRuntimeError, PyValueError};
    let words = error.to_string();
    match error {
        Error::File { path, source } => match source.raw_os_error() {
            Some(code) => {
                let mut reason = source.to_string();
                reason.truncate(reason.find(" (os error").unwrap_or(reason.len()));
                PyOSError::new_err((code, reason, path))
            }
            None => PyOSError::new_err(words),
        },
        Error::Io(_) => PyOSError::new_err(words),
        Error::Bus(_) => PyConnectionError::new_err(words),
        Error::NothingClosed { curves, yarns: 0 } => PyValueError::new_err(format!(
            "nothing to verify: none of {curves} curves is closed (closed=True, or a count below \
             0, closes a curve); a Session with events=\"between\" searches for pull-throughs of \
             open curves"
        )),
        Error::Forked { .. } => PyRuntimeError::new_err(words),
        _ => PyValueError::new_err(words),
    }
}

/// Returns the text of an error of a function without the option `wrapped`.
fn without_unwrapping(error: &linkwatch::Error) -> String {
    let words = error.to_string();
    match words.split_once(": pass the option `wrapped`") {
        Some((torn, _)) => format!(
            "{torn}: unwrap coordinates that are wrapped (`check` and `Session` do with \
             wrapped=True, and take them as they are with wrapped=False)"
        ),
        None => words,
    }
}
