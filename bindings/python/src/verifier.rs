//! The verifier, as a Python object.

use crate::exception;
use crate::frame::{Points, basis, cell};
use crate::report::{Certificate, Report};
use linkwatch::{
    Basis, ClearanceOptions, CurveSet, Error, FramePool, RawFrame, Strategy, VerifierOptions,
};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::sync::Mutex;

/// Radius of all strands, or `None` if each curve has its own; the level of the warning; and the
/// radii of all curves.
type Strands = (Option<f64>, f64, Vec<f32>);

/// Verifies successive frames against a baseline.
#[pyclass(frozen, module = "linkwatch")]
pub struct Verifier {
    basis: Basis,
    state: Mutex<State>,
}

struct State {
    verifier: linkwatch::Verifier,
    /// Number of the next frame.
    seq: u64,
    pool: FramePool,
}

#[pymethods]
impl Verifier {
    #[new]
    #[pyo3(signature = (
        *, basis_name, baseline, events, abort_on, incremental, motion_limit, strands
    ))]
    fn new(
        basis_name: &str,
        baseline: Option<Certificate>,
        events: &str,
        abort_on: &str,
        incremental: bool,
        motion_limit: Option<f64>,
        strands: Option<Strands>,
    ) -> PyResult<Verifier> {
        let options = VerifierOptions {
            baseline: baseline.map(|b| b.0),
            events: events.parse().map_err(option("events"))?,
            abort_on: abort_on.parse().map_err(option("abort_on"))?,
            motion_limit,
            clearance: strands.as_ref().map(|(radius, low, _)| {
                let mut options = ClearanceOptions::new(*radius);
                options.low = *low;
                options
            }),
            strategy: match incremental {
                true => Strategy::Incremental,
                false => Strategy::Full,
            },
            ..VerifierOptions::default()
        };
        let mut verifier = linkwatch::Verifier::new(options).map_err(exception)?;
        let (.., radii) = strands.unwrap_or_default();
        verifier.set_radii(&radii).map_err(exception)?;
        Ok(Verifier {
            basis: basis(basis_name)?,
            state: Mutex::new(State {
                verifier,
                seq: 0,
                pool: FramePool::default(),
            }),
        })
    }

    /// Sets the periodic cell of the next frames: three vectors and the corner.
    fn set_cell(&self, py: Python<'_>, numbers: [f64; 12]) -> PyResult<()> {
        let set = py.detach(|| self.with(|state| state.verifier.set_cell(cell(numbers))));
        set?.map_err(exception)
    }

    /// Verifies a frame, without the interpreter lock.
    fn step(
        &self,
        py: Python<'_>,
        points: Points<'_>,
        counts: Vec<i32>,
        time: f64,
    ) -> PyResult<Report> {
        let frame = RawFrame {
            basis: self.basis,
            counts: &counts,
            positions: points.positions()?,
        };
        let report = py.detach(|| self.with(|state| state.step(frame, time)));
        report?.map(Report).map_err(exception)
    }

    /// Computes all linking numbers of a frame, without the interpreter lock.
    fn certify(
        &self,
        py: Python<'_>,
        points: Points<'_>,
        counts: Vec<i32>,
    ) -> PyResult<Certificate> {
        let positions = points.positions()?;
        let certificate = py.detach(|| {
            let set = CurveSet::from_counts(self.basis, &counts, positions)?;
            Ok(self.with(|state| state.verifier.certify(&set).0.clone()))
        });
        certificate.map_err(exception)?.map(Certificate)
    }

    fn cut(&self, py: Python<'_>) -> PyResult<()> {
        py.detach(|| self.with(|state| state.verifier.cut()))
    }

    fn unmeasured_clearance(&self, py: Python<'_>) -> PyResult<Option<String>> {
        py.detach(|| self.with(|s| s.verifier.unmeasured_clearance().map(str::to_owned)))
    }

    fn baseline(&self, py: Python<'_>) -> PyResult<Option<Certificate>> {
        let baseline = py.detach(|| self.with(|state| state.verifier.baseline().cloned()));
        Ok(baseline?.map(Certificate))
    }
}

impl Verifier {
    /// Fails after a panic: the baseline may be lost then, and later verdicts would be wrong.
    fn with<R>(&self, run: impl FnOnce(&mut State) -> R) -> PyResult<R> {
        let failed = "an earlier call of this verifier failed; create a new one";
        let state = self.state.lock();
        let mut state = state.map_err(|_| PyRuntimeError::new_err(failed))?;
        Ok(run(&mut state))
    }
}

impl State {
    fn step(&mut self, frame: RawFrame<'_>, time: f64) -> Result<linkwatch::Report, Error> {
        let seq = self.seq;
        self.seq += 1;
        let State { verifier, pool, .. } = self;
        match pool.receive(|set| verifier.receive(frame, set)) {
            Ok(set) => verifier.step_shared(seq, time, &set),
            Err(why) => Ok(verifier.reject(seq, time, &why)),
        }
    }
}

/// Returns the exception of an invalid value of an option.
fn option(name: &str) -> impl Fn(Error) -> PyErr {
    move |e| PyValueError::new_err(format!("{name}: {e}"))
}
