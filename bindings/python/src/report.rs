//! Reports and certificates, as Python objects.

use crate::call::argument;
use crate::exception;
use crate::findings::{Change, Defect, PullThrough};
use crate::strands::Clearance;
use linkwatch::CurveLabels;
use numpy::{Element, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// What is expected of the argument `path`.
const PATH: &str = "a path: str, bytes or os.PathLike";

/// Curves, translation of the second one, and linking number.
type ImageLink = (u32, u32, (i32, i32, i32), i64);

/// The verdict on a frame.
#[pyclass(frozen, eq, module = "linkwatch")]
#[derive(Clone, PartialEq)]
pub struct Report {
    report: linkwatch::Report,
    /// Names of the curves, if they have any.
    labels: Arc<CurveLabels>,
}

#[pymethods]
impl Report {
    /// Number of the frame, from 0.
    #[getter]
    fn seq(&self) -> u64 {
        self.report.seq
    }

    /// Simulation time of the frame, in seconds.
    #[getter]
    fn time(&self) -> f64 {
        self.report.time
    }

    /// intact, changed, contact, undecided or rejected.
    #[getter]
    fn verdict(&self) -> &'static str {
        self.report.verdict.word()
    }

    /// True if every linking number was proven to be the expected one.
    #[getter]
    fn intact(&self) -> bool {
        self.report.verdict == linkwatch::Verdict::Intact
    }

    /// True if the policy asks the simulator to stop.
    #[getter]
    fn abort(&self) -> bool {
        self.report.abort
    }

    /// Linking numbers that differ from the expected ones, sorted by pair.
    #[getter]
    fn changes(&self) -> Vec<Change> {
        let (extent, names) = self.scene();
        let changes = self.report.changes.iter();
        changes.map(|c| Change::new(c, extent, names)).collect()
    }

    /// Pull-throughs since the last frame, in chronological order.
    #[getter]
    fn pull_throughs(&self) -> Vec<PullThrough> {
        self.of(&self.report.events)
    }

    /// Pull-throughs that cannot be resolved, because the frames are too far apart.
    #[getter]
    fn unresolved(&self) -> Vec<PullThrough> {
        self.of(&self.report.unresolved)
    }

    /// Pairs and curves that could not be decided or compared, sorted by pair.
    #[getter]
    fn defects(&self) -> Vec<Defect> {
        let (extent, names) = self.scene();
        let defects = self.report.defects.iter();
        defects.map(|d| Defect::new(d, extent, names)).collect()
    }

    /// Names of the curves that appeared since the last verified frame.
    #[getter]
    fn appeared(&self) -> Vec<String> {
        self.report.appeared.clone()
    }

    /// Names of the curves that are gone since the last verified frame.
    #[getter]
    fn gone(&self) -> Vec<String> {
        self.report.gone.clone()
    }

    /// Last frame that is known to be intact; None if there is none.
    #[getter]
    fn last_intact(&self) -> Option<u64> {
        self.report.last_intact
    }

    /// Largest proven share of the step from the last intact frame without a pull-through; None if
    /// it is unknown.
    #[getter]
    fn safe_fraction(&self) -> Option<f64> {
        self.report.safe_fraction
    }

    /// Clearance of the strands; None if it is not measured.
    #[getter]
    fn clearance(&self) -> Option<Clearance> {
        self.report.clearance.map(Clearance)
    }

    /// Reason why the frame was rejected.
    #[getter]
    fn rejected(&self) -> Option<&str> {
        self.report.rejected.as_deref()
    }

    /// A sentence for every finding.
    #[getter]
    fn findings(&self) -> Vec<String> {
        self.report.findings_named(&self.labels.names).collect()
    }

    /// True if the frame is intact.
    fn __bool__(&self) -> bool {
        self.intact()
    }

    fn __str__(&self) -> String {
        let mut lines = self.findings();
        lines.insert(0, self.report.headline());
        lines.join("\n  ")
    }

    fn __repr__(&self) -> String {
        format!("<Report: {}>", self.report.headline())
    }
}

impl Report {
    /// Converts a report on curves with these labels.
    pub fn new(report: linkwatch::Report, labels: Arc<CurveLabels>) -> Report {
        Report { report, labels }
    }

    fn of(&self, events: &[linkwatch::PullThrough]) -> Vec<PullThrough> {
        let (extent, names) = self.scene();
        let events = events.iter();
        events.map(|e| PullThrough::new(e, extent, names)).collect()
    }

    /// Returns the extent of the scene and the names of the curves, for sentences.
    fn scene(&self) -> (f64, &[String]) {
        (self.report.stats.extent, &self.labels.names)
    }
}

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
        let first = match (self.numbers.undefined.first(), self.open.first()) {
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

    /// Returns the symmetric matrix of the linking numbers, with 0 for all other pairs.
    fn filled<'py, T: Element + Copy>(
        &self,
        py: Python<'py>,
        convert: impl Fn(i64) -> T,
    ) -> PyResult<Bound<'py, PyArray2<T>>> {
        let n = self.numbers.curves;
        // Raises MemoryError if the matrix is too large.
        let zeros = py.import("numpy")?.getattr("zeros")?;
        let matrix = zeros.call1(((n, n), T::get_dtype(py)))?;
        let matrix = matrix.cast_into::<PyArray2<T>>()?;
        let mut write = matrix.try_readwrite()?;
        let mut cells = write.as_array_mut();
        for l in &self.numbers.links {
            let (i, j, lambda) = (l.i as usize, l.j as usize, convert(l.lambda));
            (cells[[i, j]], cells[[j, i]]) = (lambda, lambda);
        }
        drop(write);
        Ok(matrix)
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
        self.numbers.curves
    }

    /// Open curves, which have no linking numbers, sorted. A certificate that was read from a file
    /// does not know them.
    #[getter]
    fn open(&self) -> Vec<u32> {
        self.open.clone()
    }

    /// Linking numbers that are not 0, as tuples (i, j, lambda) with i < j, sorted.
    #[getter]
    fn links(&self) -> Vec<(u32, u32, i64)> {
        let links = self.numbers.links.iter();
        links.map(|l| (l.i, l.j, l.lambda)).collect()
    }

    /// Linking numbers with periodic images of other curves and of the curve itself, as tuples
    /// (i, j, image, lambda), sorted. None if the scene is not periodic.
    #[getter]
    fn images(&self) -> Option<Vec<ImageLink>> {
        let images = self.numbers.images.as_deref()?.iter();
        Some(
            images
                .map(|l| (l.i, l.j, l.image.into(), l.lambda))
                .collect(),
        )
    }

    /// Pairs and curves without a linking number.
    #[getter]
    fn undefined(&self) -> Vec<Defect> {
        let undefined = self.numbers.undefined.iter();
        undefined.map(|d| Defect::new(d, 0.0, &[])).collect()
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
        let Some(value) = undefined else {
            self.check_defined()?;
            return Ok(self.filled(py, |lambda| lambda)?.into_any());
        };
        let value: f64 = argument("undefined", value, "a number")?;
        let matrix = self.filled(py, |lambda| lambda as f64)?;
        let mut write = matrix.try_readwrite()?;
        let mut cells = write.as_array_mut();
        let mut fill = |i: u32, j: u32| {
            let (i, j) = (i as usize, j as usize);
            (cells[[i, j]], cells[[j, i]]) = (value, value);
        };
        for defect in &self.numbers.undefined {
            if let Some(j) = defect.j {
                fill(defect.i, j);
            }
        }
        let alone = self.numbers.undefined.iter().filter(|d| d.j.is_none());
        let alone = alone.map(|d| d.i).chain(self.open.iter().copied());
        for i in alone {
            let others = (0..self.numbers.curves as u32).filter(|&j| j != i);
            others.for_each(|j| fill(i, j));
        }
        drop(write);
        Ok(matrix.into_any())
    }

    /// Linking numbers that differ from those of a baseline.
    ///
    /// Raises ValueError if the numbers of curves differ.
    fn compare(&self, baseline: &Bound<'_, PyAny>) -> PyResult<Vec<Change>> {
        let expected = "a Certificate: that of certify, or Certificate.read(path)";
        let baseline: Certificate = argument("baseline", baseline, expected)?;
        let compared = self.numbers.compare(&baseline.numbers);
        let compared = compared.map_err(exception)?;
        let changes = compared.changes.iter();
        Ok(changes.map(|c| Change::new(c, 0.0, &[])).collect())
    }

    fn __str__(&self) -> String {
        self.numbers.to_string()
    }

    fn __repr__(&self) -> String {
        let linkwatch::Certificate {
            curves,
            links,
            undefined,
            images,
            ..
        } = &self.numbers;
        let mut text = format!("{curves} curves, {} links", links.len());
        let without = undefined.len();
        if let Some(images) = images {
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
