//! Certificates, as Python objects.

use crate::call::argument;
use crate::exception;
use crate::result::{json, packed, result, unpacked};
use numpy::{Element, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde_json::json;
use std::ffi::CString;
use std::path::PathBuf;

/// Description of a valid argument `path`, for messages.
const PATH: &str = "a path: str, bytes or os.PathLike";

/// Curves, translation of the second one, and linking number.
type ImageLink = (u32, u32, (i32, i32, i32), i64);

/// All linking numbers of a frame.
#[pyclass(frozen, eq, module = "linkwatch", from_py_object)]
#[derive(Clone)]
pub struct Certificate {
    pub numbers: linkwatch::Certificate,
    /// Open curves, sorted. Unknown, and empty, if the certificate was read from a file.
    open: Vec<u32>,
}

impl PartialEq for Certificate {
    fn eq(&self, other: &Certificate) -> bool {
        self.numbers == other.numbers
    }
}

impl Certificate {
    /// Creates a certificate of curves of which some are open.
    pub fn new(numbers: linkwatch::Certificate, open: Vec<u32>) -> Certificate {
        Certificate { numbers, open }
    }

    /// Returns an error if a pair has no linking number.
    fn check_defined(&self) -> PyResult<()> {
        let first = match (self.numbers.undefined().first(), self.open.first()) {
            (Some(defect), _) => defect.sentence_named(0.0, &[]),
            (None, Some(curve)) => format!("curve {curve} is open"),
            (None, None) => return Ok(()),
        };
        Err(PyValueError::new_err(format!(
            "{}: some pairs have no linking number ({first}). Pass a value for them: \
             matrix(undefined=numpy.nan)",
            self.__repr__()
        )))
    }

    /// Returns the symmetric matrix with these entries, and with 0 for all other pairs. If a pair
    /// has several entries, the last one counts.
    fn symmetric<'py, T: Element + Copy>(
        &self,
        py: Python<'py>,
        entries: impl Iterator<Item = (u32, u32, T)>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let n = self.numbers.curves();
        // Raises MemoryError if the matrix is too large.
        let zeros = py.import("numpy")?.getattr("zeros")?;
        let matrix = zeros.call1(((n, n), T::get_dtype(py)))?;
        let matrix = matrix.cast_into::<PyArray2<T>>()?;
        let mut write = matrix.try_readwrite()?;
        let mut cells = write.as_array_mut();
        for (i, j, value) in entries {
            let (i, j) = (i as usize, j as usize);
            (cells[[i, j]], cells[[j, i]]) = (value, value);
        }
        drop(write);
        Ok(matrix.into_any())
    }
}

#[pymethods]
impl Certificate {
    /// Reads a certificate from a file.
    #[staticmethod]
    fn read(path: &Bound<'_, PyAny>) -> PyResult<Certificate> {
        let path: PathBuf = argument("path", path, PATH)?;
        let read = linkwatch::Certificate::read(&path);
        let read = read.map_err(exception)?;
        Ok(Certificate::new(read, Vec::new()))
    }

    /// Writes the certificate to a file.
    fn write(&self, path: &Bound<'_, PyAny>) -> PyResult<()> {
        let path: PathBuf = argument("path", path, PATH)?;
        self.numbers.write(&path).map_err(exception)
    }

    /// Number of curves.
    #[getter]
    fn curves(&self) -> usize {
        self.numbers.curves()
    }

    /// Open curves, which have no linking numbers, sorted. A certificate that was read from a file
    /// does not know them.
    #[getter]
    fn open(&self) -> Vec<u32> {
        self.open.clone()
    }

    /// Invariants beside linking numbers: "self", "triple", both or none.
    #[getter]
    fn invariants(&self) -> Vec<&'static str> {
        self.numbers.invariants().map(|kind| kind.word()).collect()
    }

    /// Linking numbers that are not 0, as tuples (i, j, lambda) with i < j, sorted.
    #[getter]
    fn links(&self) -> Vec<(u32, u32, i64)> {
        let links = self.numbers.links().iter();
        links.map(|l| (l.i, l.j, l.lambda)).collect()
    }

    /// Linking numbers with periodic images of other curves and of the curve itself, as tuples
    /// (i, j, image, lambda), sorted; those of the image (0, 0, 0) are in `links`. None if the
    /// scene is not periodic.
    #[getter]
    fn images(&self) -> Option<Vec<ImageLink>> {
        let images = self.numbers.images()?.iter();
        Some(
            images
                .map(|l| (l.i, l.j, l.image.into(), l.lambda))
                .collect(),
        )
    }

    /// Pairs and curves without a linking number.
    #[getter]
    fn undefined(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let undefined = self.numbers.undefined();
        let words = undefined.iter().map(|d| d.sentence_named(0.0, &[]));
        result(py, "Defect", (json(&undefined), words.collect()), &[])
    }

    /// The fields of `linkwatch certify --json`, and the open curves.
    fn to_dict(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let mut json = json!(self.numbers);
        json["open"] = json!(self.open);
        result(py, "dict", (json.to_string(), Vec::new()), &[])
    }

    /// The symmetric matrix of all linking numbers, and that of the pairs without one, which are 1
    /// there, as sparse arrays of SciPy. Pairs of periodic images are in neither.
    fn sparse(slf: &Bound<'_, Self>) -> PyResult<Py<PyAny>> {
        let made = slf.py().import("linkwatch._results")?.getattr("sparse")?;
        Ok(made.call1((slf,))?.unbind())
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let Certificate { numbers, open } = slf.get();
        let bytes = PyBytes::new(slf.py(), &packed(&(numbers, open)));
        Ok((slf.get_type().getattr("_restored")?, (bytes,)))
    }

    #[staticmethod]
    fn _restored(bytes: &[u8]) -> PyResult<Certificate> {
        let (numbers, open) = unpacked(bytes)?;
        Ok(Certificate::new(numbers, open))
    }

    /// The symmetric matrix of all linking numbers, as an array of the shape (curves, curves);
    /// without those of periodic images.
    ///
    /// Raises ValueError if a pair has no linking number, unless `undefined` is given: then such
    /// pairs have this value, and the array has the type float64.
    #[pyo3(signature = (*, undefined = None))]
    fn matrix<'py>(
        &self,
        py: Python<'py>,
        undefined: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let links = self.numbers.links().iter();
        let Some(value) = undefined else {
            self.check_defined()?;
            return self.symmetric(py, links.map(|l| (l.i, l.j, l.lambda)));
        };
        let value: f64 = argument("undefined", value, "a number")?;
        let links = links.map(|l| (l.i, l.j, l.lambda as f64));
        let defects = self.numbers.undefined().iter();
        let pairs = defects.clone().filter_map(|d| Some((d.i, d.j?, value)));
        let alone = defects.filter(|d| d.j.is_none()).map(|d| d.i);
        let alone = alone.chain(self.open.iter().copied()).flat_map(|i| {
            let others = (0..self.numbers.curves() as u32).filter(move |&j| j != i);
            others.map(move |j| (i, j, value))
        });
        self.symmetric(py, links.chain(pairs).chain(alone))
    }

    /// Linking numbers that differ from those of a baseline. Pairs and curves without a linking
    /// number in one of both are not compared, which is an UnverifiedWarning.
    ///
    /// Raises ValueError if the numbers of curves differ.
    fn compare(&self, py: Python<'_>, baseline: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        let expected = "a Certificate: that of certify, or Certificate.read(path)";
        let baseline: Certificate = argument("baseline", baseline, expected)?;
        let compared = self.numbers.compare(&baseline.numbers);
        let compared = compared.map_err(exception)?;
        if let Some(first) = compared.defects.first() {
            let first = first.sentence_named(0.0, &[]);
            let what = match compared.defects.len() {
                1 => format!("not compared: {first}"),
                n => format!("{n} pairs or curves are not compared: {first}, .."),
            };
            let category = py.import("linkwatch")?.getattr("UnverifiedWarning")?;
            PyErr::warn(py, &category, &CString::new(what)?, 1)?;
        }
        let changes = &compared.changes;
        let words = changes.iter().map(|c| c.sentence_named(0.0, &[]));
        result(py, "Change", (json(changes), words.collect()), &[])
    }

    fn __str__(&self) -> String {
        self.numbers.to_string()
    }

    fn __repr__(&self) -> String {
        let numbers = &self.numbers;
        let mut text = format!(
            "{} curves, {} links",
            numbers.curves(),
            numbers.links().len()
        );
        let without = numbers.undefined().len();
        if let Some(images) = numbers.images() {
            text += &format!(", {} pairs with periodic images", images.len());
        }
        if without > 0 {
            text += &format!(", {without} undefined");
        }
        if !self.open.is_empty() {
            text += &format!(", {} open", self.open.len());
        }
        format!("<Certificate: {text}>")
    }
}
