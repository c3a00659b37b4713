//! Thickness, struts, clearance and ribbons, as Python objects.

use crate::call::guarded;
use crate::exception;
use crate::frame::{Points, basis, cell};
use linkwatch::{
    Axis, Cell, Closing, CurveSet, CurveSource, Error, PairingReason, RawFrame, RibbonOptions,
};
use pyo3::prelude::*;

type Point = [f64; 3];

/// Two points of curves whose distance is a local minimum.
#[pyclass(frozen, eq, module = "linkwatch")]
#[derive(Clone, PartialEq)]
pub struct Strut(linkwatch::Strut, bool);

#[pymethods]
impl Strut {
    /// Curve of each end, from 0.
    #[getter]
    fn curves(&self) -> (u32, u32) {
        let [a, b] = self.0.ends;
        (a.curve, b.curve)
    }

    /// Segment of each end, from 0.
    #[getter]
    fn segments(&self) -> (u32, u32) {
        let [a, b] = self.0.ends;
        (a.segment, b.segment)
    }

    /// Place of each end on its segment, from 0 to 1.
    #[getter]
    fn t(&self) -> (f64, f64) {
        let [a, b] = self.0.ends;
        (a.t, b.t)
    }

    /// Translation of the second curve, in vectors of the periodic cell; zeros without a cell.
    #[getter]
    fn image(&self) -> (i32, i32, i32) {
        self.0.image.into()
    }

    /// Both ends: that of the second curve is translated by its image.
    #[getter]
    fn points(&self) -> (Point, Point) {
        let [a, b] = self.0.ends;
        (a.point, b.point)
    }

    /// Distance of the ends.
    #[getter]
    fn length(&self) -> f64 {
        self.0.length
    }

    /// Upper bound of the error of the length: 0 for polylines.
    #[getter]
    fn error(&self) -> f64 {
        self.0.error
    }

    /// Derivatives of the length with respect to the start and the end of the first segment, and of
    /// the second one. None for splines, and if the length is 0.
    #[getter]
    fn gradient(&self) -> Option<[[Point; 2]; 2]> {
        self.0.gradient().filter(|_| self.1)
    }

    fn __str__(&self) -> String {
        self.0.to_string()
    }

    fn __repr__(&self) -> String {
        format!("<Strut: {}>", self.0)
    }
}

/// How sharply curves bend, and how close they come.
#[pyclass(frozen, eq, module = "linkwatch")]
#[derive(Clone, PartialEq)]
pub struct Thickness(linkwatch::Thickness, bool);

#[pymethods]
impl Thickness {
    /// Length of all curves.
    #[getter]
    fn length(&self) -> f64 {
        self.0.length
    }

    /// Radius of the sharpest bend; None if no curve bends.
    #[getter]
    fn min_rad(&self) -> Option<f64> {
        self.0.min_rad.map(|bend| bend.radius)
    }

    /// Shortest strut; None if there is none.
    #[getter]
    fn poca(&self) -> Option<Strut> {
        self.0.poca.map(|strut| Strut(strut, self.1))
    }

    /// Diameter of the thickest tube around all curves that neither bends too sharply nor overlaps.
    #[pyo3(signature = (stiffness = 1.0))]
    fn thickness(&self, stiffness: f64) -> f64 {
        self.0.thickness(stiffness)
    }

    /// Length divided by thickness.
    #[pyo3(signature = (stiffness = 1.0))]
    fn ropelength(&self, stiffness: f64) -> f64 {
        self.0.ropelength(stiffness)
    }

    fn __repr__(&self) -> String {
        format!("<Thickness: {}>", self.0.thickness(1.0))
    }
}

/// Clearance of a frame.
#[pyclass(frozen, eq, module = "linkwatch")]
#[derive(Clone, PartialEq)]
pub struct Clearance(pub linkwatch::Clearance);

#[pymethods]
impl Clearance {
    /// Lower bound of the clearance of all strands.
    #[getter]
    fn at_least(&self) -> f64 {
        self.0.at_least
    }

    /// Distance of the closest center lines, as a share of the sum of their radii; None if no
    /// strands are close.
    #[getter]
    fn ratio(&self) -> Option<f64> {
        self.0.closest.map(|c| c.ratio)
    }

    /// Upper bound of the error of the ratio: 0 for polylines.
    #[getter]
    fn error(&self) -> Option<f64> {
        self.0.closest.map(|c| c.error)
    }

    /// Curves of the closest strands: the same one twice for two parts of a curve.
    #[getter]
    fn curves(&self) -> Option<(u32, u32)> {
        self.0.closest.map(|c| (c.i, c.j))
    }

    /// Their segments.
    #[getter]
    fn segments(&self) -> Option<[u32; 2]> {
        self.0.closest.map(|c| c.segments)
    }

    /// Translation of the second strand, in vectors of the periodic cell; zeros without a cell.
    #[getter]
    fn image(&self) -> Option<(i32, i32, i32)> {
        self.0.closest.map(|c| c.image.into())
    }

    /// Their nearest points: that of the second strand is translated by its image.
    #[getter]
    fn points(&self) -> Option<[Point; 2]> {
        self.0.closest.map(|c| c.points)
    }

    /// True if the clearance is below the level of the warning.
    #[getter]
    fn low(&self) -> bool {
        self.0.low
    }

    /// Frames until the surfaces touch, or, if they do, until the center lines meet; None if the
    /// clearance does not shrink.
    #[getter]
    fn frames_left(&self) -> Option<f64> {
        self.0.frames_left
    }

    fn __str__(&self) -> String {
        let sentence = self.0.sentence_named(0.0, &[]);
        sentence.unwrap_or_else(|| "no strands are close".into())
    }

    fn __repr__(&self) -> String {
        format!("<Clearance: {}>", self.__str__())
    }
}

/// Runs a measurement of the curves of a frame, without the interpreter lock.
fn measure<T: Send>(
    py: Python<'_>,
    (points, counts, numbers): (&Points<'_>, &[i32], Option<[f64; 12]>),
    basis_name: &str,
    run: impl FnOnce(&CurveSet, Option<&Cell>) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let (basis, positions) = (basis(basis_name)?, points.positions()?);
    let cell = numbers.map(cell);
    guarded(|| {
        let measured = py.detach(|| {
            let frame = RawFrame {
                basis,
                counts,
                positions,
            };
            let set = Closing::default().curves(frame, CurveSource::default())?;
            run(&set, cell.as_ref())
        });
        measured.map_err(exception)
    })
}

/// Measures bends and the shortest strut.
#[pyfunction]
pub fn thickness(
    py: Python<'_>,
    points: Points<'_>,
    counts: Vec<i32>,
    basis_name: &str,
    cell: Option<[f64; 12]>,
) -> PyResult<Thickness> {
    let frame = (&points, &counts[..], cell);
    let measured = measure(py, frame, basis_name, linkwatch::Thickness::of)?;
    Ok(Thickness(measured, basis_name == "polyline"))
}

/// Finds all struts up to a length.
#[pyfunction]
pub fn struts(
    py: Python<'_>,
    points: Points<'_>,
    counts: Vec<i32>,
    basis_name: &str,
    cell: Option<[f64; 12]>,
    longest: f64,
) -> PyResult<Vec<Strut>> {
    let frame = (&points, &counts[..], cell);
    let found = measure(py, frame, basis_name, |set, cell| {
        linkwatch::struts(set, cell, longest)
    })?;
    let exact = basis_name == "polyline";
    Ok(found.into_iter().map(|strut| Strut(strut, exact)).collect())
}

/// Linking number, twist and writhe of a closed ribbon between two curves.
#[pyclass(frozen, module = "linkwatch")]
pub struct Ribbon(linkwatch::Ribbon);

#[pymethods]
impl Ribbon {
    /// Linking number of the two curves, in the same direction; None if they touch.
    #[getter]
    fn linking(&self) -> Option<i64> {
        self.0.linking
    }

    /// Twist about the axis, in turns.
    #[getter]
    fn twist(&self) -> f64 {
        self.0.twist.value
    }

    /// Upper bound of the error of the twist.
    #[getter]
    fn twist_error(&self) -> f64 {
        self.0.twist.bound
    }

    /// Writhe of the axis.
    #[getter]
    fn writhe(&self) -> f64 {
        self.0.writhe.value
    }

    /// Upper bound of the error of the writhe.
    #[getter]
    fn writhe_error(&self) -> f64 {
        self.0.writhe.bound
    }

    /// Signed number of passages of the ribbon through itself, linking - twist - writhe: 0 for a
    /// ribbon; None if the errors admit several numbers.
    #[getter]
    fn passages(&self) -> Option<i64> {
        self.0.passages()
    }

    /// Vertices that belong together: parallel, antiparallel, or one of these with a shift.
    #[getter]
    fn pairing(&self) -> String {
        self.0.pairing.to_string()
    }

    /// Reason for the pairing: given, order (of the vertices) or distances (that are the most
    /// constant).
    #[getter]
    fn pairing_by(&self) -> &'static str {
        match self.0.reason {
            PairingReason::Given => "given",
            PairingReason::Order => "order",
            PairingReason::Distances => "distances",
        }
    }

    /// Pairings that fit nearly as well and have another twist, as tuples (pairing, twist).
    #[getter]
    fn rivals(&self) -> Vec<(String, f64)> {
        let rivals = self.0.rivals.iter();
        rivals
            .map(|(pairing, twist)| (pairing.to_string(), twist.value))
            .collect()
    }

    fn __repr__(&self) -> String {
        let linking = self.0.linking.map_or("undefined".into(), |n| n.to_string());
        let linkwatch::Ribbon {
            twist,
            writhe,
            pairing,
            ..
        } = &self.0;
        format!("<Ribbon: Lk {linking}, Tw {twist}, Wr {writhe}, {pairing}>")
    }
}

/// Computes linking number, twist and writhe of the ribbon between two curves.
#[pyfunction]
pub fn ribbon(
    py: Python<'_>,
    points: Points<'_>,
    counts: Vec<i32>,
    strands: [usize; 2],
    pairing: &str,
    axis_first: bool,
    tolerance: f64,
) -> PyResult<Ribbon> {
    let mut options = RibbonOptions::default();
    if pairing != "auto" {
        options.pairing = Some(pairing.parse().map_err(exception)?);
    }
    if axis_first {
        options.axis = Axis::First;
    }
    options.tolerance = tolerance;
    let frame = (&points, &counts[..], None);
    let found = measure(py, frame, "polyline", |set, _| {
        linkwatch::Ribbon::of(set, strands, options)
    });
    found.map(Ribbon)
}
