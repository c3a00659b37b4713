//! Reports and certificates, as Python objects.

use crate::exception;
use crate::findings::{Change, Defect, PullThrough};
use crate::strands::Clearance;
use numpy::PyArray2;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Curves, translation of the second one, and linking number.
type ImageLink = (u32, u32, (i32, i32, i32), Option<i64>);

/// The verdict on a frame.
#[pyclass(frozen, eq, module = "linkwatch")]
#[derive(Clone, PartialEq)]
pub struct Report(pub linkwatch::Report);

#[pymethods]
impl Report {
    /// Number of the frame, from 0.
    #[getter]
    fn seq(&self) -> u64 {
        self.0.seq
    }

    /// Simulation time of the frame, in seconds.
    #[getter]
    fn time(&self) -> f64 {
        self.0.time
    }

    /// intact, changed, contact, undecided or rejected.
    #[getter]
    fn verdict(&self) -> &'static str {
        self.0.verdict.word()
    }

    /// True if every linking number was proven to be the expected one.
    #[getter]
    fn intact(&self) -> bool {
        self.0.verdict == linkwatch::Verdict::Intact
    }

    /// True if the policy asks the simulator to stop.
    #[getter]
    fn abort(&self) -> bool {
        self.0.abort
    }

    /// Linking numbers that differ from the expected ones, sorted by pair.
    #[getter]
    fn changes(&self) -> Vec<Change> {
        let extent = self.0.stats.extent;
        let changes = self.0.changes.iter();
        changes.map(|c| Change::new(c, extent)).collect()
    }

    /// Pull-throughs since the last frame, in chronological order.
    #[getter]
    fn pull_throughs(&self) -> Vec<PullThrough> {
        self.of(&self.0.events)
    }

    /// Pull-throughs that cannot be resolved, because the frames are too far apart.
    #[getter]
    fn unresolved(&self) -> Vec<PullThrough> {
        self.of(&self.0.unresolved)
    }

    /// Pairs and curves that could not be decided or compared, sorted by pair.
    #[getter]
    fn defects(&self) -> Vec<Defect> {
        let extent = self.0.stats.extent;
        let defects = self.0.defects.iter();
        defects.map(|d| Defect::new(d, extent)).collect()
    }

    /// Last frame that is known to be intact; None if there is none.
    #[getter]
    fn last_intact(&self) -> Option<u64> {
        self.0.last_intact
    }

    /// Largest proven share of the step from the last intact frame without a pull-through; None if
    /// it is unknown.
    #[getter]
    fn safe_fraction(&self) -> Option<f64> {
        self.0.safe_fraction
    }

    /// Clearance of the strands; None if it is not measured.
    #[getter]
    fn clearance(&self) -> Option<Clearance> {
        self.0.clearance.map(Clearance)
    }

    /// Reason why the frame was rejected.
    #[getter]
    fn rejected(&self) -> Option<&str> {
        self.0.rejected.as_deref()
    }

    /// A sentence for every finding.
    #[getter]
    fn findings(&self) -> Vec<String> {
        self.0.findings().collect()
    }

    fn __str__(&self) -> String {
        let lines = [self.0.headline()].into_iter().chain(self.0.findings());
        lines.collect::<Vec<_>>().join("\n  ")
    }

    fn __repr__(&self) -> String {
        format!("<Report: {}>", self.0.headline())
    }
}

impl Report {
    fn of(&self, events: &[linkwatch::PullThrough]) -> Vec<PullThrough> {
        let extent = self.0.stats.extent;
        events.iter().map(|e| PullThrough::new(e, extent)).collect()
    }
}

/// All linking numbers of a frame.
#[pyclass(frozen, eq, module = "linkwatch", from_py_object)]
#[derive(Clone, PartialEq)]
pub struct Certificate(pub linkwatch::Certificate);

#[pymethods]
impl Certificate {
    /// Reads a certificate from a file.
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Certificate> {
        let read = linkwatch::Certificate::read(&path);
        read.map(Certificate).map_err(exception)
    }

    /// Writes the certificate to a file.
    fn write(&self, path: PathBuf) -> PyResult<()> {
        self.0.write(&path).map_err(exception)
    }

    /// Number of curves.
    #[getter]
    fn curves(&self) -> usize {
        self.0.curves
    }

    /// Linking numbers that are not 0, as tuples (i, j, lambda) with i < j, sorted.
    #[getter]
    fn links(&self) -> Vec<(u32, u32, i64)> {
        let links = self.0.links.iter();
        links.map(|l| (l.i, l.j, l.lambda)).collect()
    }

    /// Linking numbers with periodic images of other curves and of the curve itself, as tuples
    /// (i, j, image, lambda), sorted. lambda is None if the pair has no linking number. None
    /// if the scene is not periodic.
    #[getter]
    fn images(&self) -> Option<Vec<ImageLink>> {
        let images = self.0.images.as_deref()?.iter();
        Some(
            images
                .map(|l| (l.i, l.j, l.image.into(), l.lambda))
                .collect(),
        )
    }

    /// Pairs and curves without a linking number.
    #[getter]
    fn undefined(&self) -> Vec<Defect> {
        let undefined = self.0.undefined.iter();
        undefined.map(|d| Defect::new(d, 0.0)).collect()
    }

    /// The symmetric matrix of all linking numbers, as an array of the shape (curves, curves);
    /// without those of periodic images.
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let n = self.0.curves;
        let mut rows = vec![vec![0; n]; n];
        for l in &self.0.links {
            let (i, j) = (l.i as usize, l.j as usize);
            (rows[i][j], rows[j][i]) = (l.lambda, l.lambda);
        }
        Ok(PyArray2::from_vec2(py, &rows)?)
    }

    /// Linking numbers that differ from those of a baseline.
    ///
    /// Raises ValueError if the numbers of curves differ.
    fn compare(&self, baseline: &Certificate) -> PyResult<Vec<Change>> {
        let compared = self.0.compare(&baseline.0).map_err(exception)?;
        let changes = compared.changes.iter();
        Ok(changes.map(|c| Change::new(c, 0.0)).collect())
    }

    fn __str__(&self) -> String {
        self.0.to_string()
    }

    fn __repr__(&self) -> String {
        let (curves, links) = (self.0.curves, self.0.links.len());
        let images = self.0.images.as_ref();
        let images = images.map_or_else(String::new, |all| {
            format!(", {} pairs with periodic images", all.len())
        });
        format!("<Certificate: {curves} curves, {links} links{images}>")
    }
}
