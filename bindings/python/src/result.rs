//! Results as Python objects: their JSON and their words, which `python/linkwatch/_results.py`
//! turns into objects.

use linkwatch::{Report, Verdict};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use serde::Serialize;

/// JSON, and sentences.
pub type Described = (String, Vec<String>);

/// Returns a value as JSON.
pub fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("plain data that fits into memory")
}

/// Returns the objects of a class from their JSON, or a list of them from a list. `words` are their
/// sentences, and `names` those of the curves, if they have any.
pub fn result(
    py: Python<'_>,
    class: &str,
    (json, words): Described,
    names: &[String],
) -> PyResult<Py<PyAny>> {
    static MADE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let made = MADE.import(py, "linkwatch._results", "made")?;
    Ok(made.call1((class, json, words, names))?.unbind())
}

/// Returns a report as an object, which reads most of its fields when they are needed.
pub fn report(py: Python<'_>, report: &Report, names: &[String]) -> PyResult<Py<PyAny>> {
    static MADE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let mut text = json(report);
    text.pop();
    text += &format!(",\"left_out\":{}}}", json(&report.left_out));
    let mut words = vec![report.headline()];
    words.extend(report.findings_named(names));
    if let Some(clearance) = &report.clearance {
        let sentence = clearance.sentence_named(report.stats.extent, names);
        words.push(sentence.unwrap_or_else(|| "no strands are close".into()));
    }
    let is_plain = report.verdict == Verdict::Intact
        && words.len() == 1
        && report.clearance.is_none()
        && report.left_out.is_empty();
    let known = PyDict::new(py);
    known.set_item("seq", report.seq)?;
    // As in the JSON.
    let time = Some(report.time).filter(|time| time.is_finite());
    known.set_item("time", time.unwrap_or(f64::INFINITY))?;
    known.set_item("verdict", report.verdict.to_string())?;
    known.set_item("abort", report.abort)?;
    known.set_item("rejected", report.rejected.as_deref())?;
    known.set_item("_plain", is_plain)?;
    let made = MADE.import(py, "linkwatch._results", "made_report")?;
    Ok(made.call1((text, words, names, known))?.unbind())
}

/// Returns the bytes of a state for pickle and other processes.
pub fn packed(state: &impl Serialize) -> Vec<u8> {
    postcard::to_stdvec(state).expect("plain data that fits into memory")
}

/// Returns the state of [`packed`] bytes.
pub fn unpacked<'a, T: serde::Deserialize<'a>>(bytes: &'a [u8]) -> PyResult<T> {
    let other = |why| PyRuntimeError::new_err(format!("state of another version: {why}"));
    postcard::from_bytes(bytes).map_err(other)
}
