//! Thickness, struts, ribbons, Gauss integrals and diagrams, as Python objects.

use crate::call::{guarded, watched};
use crate::exception;
use crate::frame::{Points, cell, raw};
use crate::result::result;
use linkwatch::kernels::Estimate;
use linkwatch::{
    Axis, Cell, Closing, CurveSet, CurveSource, Error, GaussIntegrals, Ribbon, RibbonOptions,
    Strut, Thickness,
};
use pyo3::prelude::*;
use serde_json::{Value, json};

/// Points, counts, basis and cell of a frame.
type Frame<'py> = (Points<'py>, Vec<i32>, String, Option<[f64; 12]>);

/// Values and bounds.
type Estimates = (Vec<f64>, Vec<f64>);

/// Runs a measurement of the curves of a frame, without the interpreter lock.
fn measure<T: Send + 'static>(
    py: Python<'_>,
    (points, counts, basis_name, numbers): &Frame<'_>,
    run: impl FnOnce(&CurveSet, Option<&Cell>) -> Result<T, Error> + Send + 'static,
) -> PyResult<T> {
    let frame = raw(points, counts, basis_name)?;
    let cell = numbers.map(cell);
    guarded(|| {
        let set = Closing::default().curves(frame, CurveSource::default());
        let set = set.map_err(exception)?;
        let (measured, _) = watched(py, false, None, move || run(&set, cell.as_ref()))?;
        measured.map_err(exception)
    })
}

fn strut(strut: &Strut, is_polyline: bool) -> Value {
    let mut json = json!(strut);
    json["gradient"] = json!(strut.gradient().filter(|_| is_polyline));
    json
}

/// Measures bends and the shortest strut.
#[pyfunction]
pub fn thickness(py: Python<'_>, frame: Frame<'_>) -> PyResult<Py<PyAny>> {
    let found = measure(py, &frame, Thickness::of)?;
    let (bend, poca) = (found.min_rad, found.poca);
    let json = json!({
        "length": found.length,
        "min_rad": bend.map(|m| m.radius),
        "min_rad_error": bend.map(|m| m.error),
        "min_rad_at": bend,
        "poca": poca.map(|strut| strut.length),
        "poca_error": poca.map(|strut| strut.error),
        "poca_at": poca.map(|found| strut(&found, frame.2 == "polyline")),
        "thickness": found.thickness(1.0),
        "ropelength": found.ropelength(1.0),
        "stiffness": 1.0,
    });
    let words = vec![found.thickness(1.0).to_string()];
    let poca = poca.map(|strut| strut.to_string());
    let words = words.into_iter().chain(poca).collect();
    result(py, "Thickness", (json.to_string(), words), &[])
}

/// Finds all struts up to a length.
#[pyfunction]
pub fn struts(py: Python<'_>, frame: Frame<'_>, longest: f64) -> PyResult<Py<PyAny>> {
    let found = measure(py, &frame, move |set, cell| {
        linkwatch::struts(set, cell, longest)
    })?;
    let is_polyline = frame.2 == "polyline";
    let all: Value = found
        .iter()
        .map(|found| strut(found, is_polyline))
        .collect();
    let words = found.iter().map(ToString::to_string).collect();
    result(py, "Strut", (all.to_string(), words), &[])
}

/// Computes linking number, twist and writhe of the ribbon between two curves.
#[pyfunction]
pub fn ribbon(
    py: Python<'_>,
    frame: Frame<'_>,
    strands: [usize; 2],
    pairing: &str,
    axis_first: bool,
    tolerance: f64,
) -> PyResult<Py<PyAny>> {
    let mut options = RibbonOptions::default();
    if pairing != "auto" {
        options.pairing = Some(pairing.parse().map_err(exception)?);
    }
    if axis_first {
        options.axis = Axis::First;
    }
    options.tolerance = tolerance;
    let found = measure(py, &frame, move |set, _| Ribbon::of(set, strands, options))?;
    let (twist, writhe, pairing) = (found.twist, found.writhe, found.pairing.to_string());
    let linking = found.linking.map_or("undefined".into(), |n| n.to_string());
    let words = format!("Lk {linking}, Tw {twist}, Wr {writhe}, {pairing}");
    let rivals = found.rivals.iter();
    let rivals: Vec<_> = rivals
        .map(|(p, twist)| (p.to_string(), twist.value))
        .collect();
    let json = json!({
        "strands": strands,
        "axis": options.axis,
        "pairing": pairing,
        "pairing_by": found.reason,
        "linking": found.linking,
        "twist": twist,
        "writhe": writhe,
        "residual": found.residual(),
        "passages": found.passages(),
        "ms": found.times.map(|t| t.as_secs_f64() * 1e3),
        "rivals": rivals,
    });
    result(py, "Ribbon", (json.to_string(), vec![words]), &[])
}

/// Computes Gauss integrals: the writhe of each curve, or the linking integral of each of these
/// pairs, or of all if they are none, and the bounds of their errors.
#[pyfunction]
pub fn gauss(
    py: Python<'_>,
    frame: Frame<'_>,
    pairs: Option<Vec<(usize, usize)>>,
    tolerance: f64,
) -> PyResult<Estimates> {
    let found = measure(py, &frame, move |set, _| {
        let integrals = GaussIntegrals::new(set)?;
        let of_pair = |&(i, j): &(usize, usize)| integrals.linking(i, j, tolerance);
        Ok(match &pairs {
            None => (0..set.len())
                .map(|i| integrals.writhe(i, tolerance))
                .collect(),
            Some(pairs) if pairs.is_empty() => (0..set.len())
                .flat_map(|i| integrals.row(i, tolerance))
                .collect(),
            Some(pairs) => pairs.iter().map(of_pair).collect(),
        })
    })?;
    let found: Vec<Estimate> = found;
    Ok(found.iter().map(|one| (one.value, one.bound)).unzip())
}

/// Computes the reduced diagrams of closed curves, and of connected groups if they are requested.
/// Returns them, and sentences about curves that have none.
#[pyfunction]
pub fn diagram(
    py: Python<'_>,
    frame: Frame<'_>,
    groups: bool,
) -> PyResult<(Py<PyAny>, Vec<String>)> {
    let found = measure(py, &frame, move |set, _| {
        let (mut json, mut words, mut undecided) = (Vec::new(), Vec::new(), Vec::new());
        for (_, diagram) in linkwatch::diagrams(set, groups) {
            match diagram {
                Ok(diagram) => {
                    let (one, text) = diagram.to_json_and_words();
                    json.push(one);
                    words.push(text);
                }
                Err(defect) => undecided.push(defect.sentence_named(set.extent(), &[])),
            }
        }
        Ok((Value::from(json).to_string(), words, undecided))
    })?;
    let (json, words, undecided) = found;
    Ok((result(py, "Diagram", (json, words), &[])?, undecided))
}
