//! The verifier, as a Python object.

use crate::call::{Shared, guarded};
use crate::exception;
use crate::frame::{Points, basis, cell};
use crate::report::{Certificate, Report};
use linkwatch::{
    Basis, Cell, ClearanceOptions, Closing, CurveSet, CurveSource, Error, FramePool, RawFrame,
    Strategy, Verdict, VerifierOptions, period,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Radius of all strands, or `None` if each curve has its own; the level of the warning; and the
/// radii of all curves.
type Strands = (Option<f64>, f64, Vec<f32>);

/// `incremental`, `keep_open`, true if each curve is closed by default, and `wrapped`.
type Flags = (bool, bool, bool, Option<bool>);

/// Verifies successive frames against a baseline.
#[pyclass(frozen, module = "linkwatch")]
pub struct Verifier {
    basis: Basis,
    state: Shared<State>,
}

struct State {
    verifier: linkwatch::Verifier,
    closing: Closing,
    /// True if the caller does not say which curves are closed.
    closed_by_default: bool,
    /// Number of the next frame.
    seq: u64,
    /// Periodic cell of the next frames.
    cell: Option<Cell>,
    /// Open curves of the first frame; `None` before it.
    open: Option<Vec<u32>>,
    pool: FramePool,
}

#[pymethods]
impl Verifier {
    #[new]
    #[pyo3(signature = (
        *, basis_name, baseline, events, abort_on, flags, motion_limit, strands
    ))]
    fn new(
        basis_name: &str,
        baseline: Option<Certificate>,
        events: &str,
        abort_on: &str,
        flags: Flags,
        motion_limit: Option<f64>,
        strands: Option<Strands>,
    ) -> PyResult<Verifier> {
        let (incremental, keep_open, closed_by_default, wrapped) = flags;
        let options = VerifierOptions {
            baseline: baseline.map(|b| b.numbers),
            events: events.parse().map_err(option("events"))?,
            abort_on: abort_on.parse().map_err(option("abort_on"))?,
            motion_limit,
            wrapped,
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
        let (.., radii) = strands.unwrap_or_default();
        let verifier = guarded(|| {
            let mut verifier = linkwatch::Verifier::new(options).map_err(exception)?;
            verifier.set_radii(&radii).map_err(exception)?;
            Ok(verifier)
        })?;
        Ok(Verifier {
            basis: basis(basis_name)?,
            state: Shared::new(State {
                verifier,
                closing: Closing::new(keep_open),
                closed_by_default,
                seq: 0,
                cell: None,
                open: None,
                pool: FramePool::default(),
            }),
        })
    }

    /// Sets the periodic cell of the next frames: three vectors and the corner.
    fn set_cell(&self, py: Python<'_>, numbers: [f64; 12]) -> PyResult<()> {
        self.run(py, |state| {
            let cell = cell(numbers);
            state.verifier.set_cell(cell)?;
            state.cell = Some(cell);
            Ok(())
        })
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
        self.run(py, |state| state.step(frame, time)).map(Report)
    }

    /// Computes all linking numbers of a frame, the first one, without the interpreter lock.
    fn certify(
        &self,
        py: Python<'_>,
        points: Points<'_>,
        counts: Vec<i32>,
    ) -> PyResult<Certificate> {
        let positions = points.positions()?;
        self.run(py, |state| {
            let frame = RawFrame {
                basis: self.basis,
                counts: &counts,
                positions,
            };
            let source = state.source();
            let set = state.closing.curves(frame, source)?;
            let State { verifier, cell, .. } = state;
            let open = open_curves(&set, cell.as_ref());
            if open.len() == set.len() {
                let (curves, yarns) = (set.len(), 0);
                return Err(Error::NothingClosed { curves, yarns });
            }
            let numbers = match cell {
                None => verifier.certify(&set).0.clone(),
                Some(_) => {
                    let report = verifier.step(0, 0.0, &set)?;
                    let why = report.rejected;
                    let why = || Error::Usage(why.unwrap_or_else(|| "no linking numbers".into()));
                    verifier.baseline().cloned().ok_or_else(why)?
                }
            };
            Ok(Certificate::new(numbers, open))
        })
    }

    fn cut(&self, py: Python<'_>) -> PyResult<()> {
        self.run(py, |state| {
            state.verifier.cut();
            Ok(())
        })
    }

    fn jumps(&self, py: Python<'_>) -> PyResult<u64> {
        self.run(py, |state| Ok(state.verifier.jumps()))
    }

    fn unmeasured_clearance(&self, py: Python<'_>) -> PyResult<Option<String>> {
        self.run(py, |s| {
            Ok(s.verifier.unmeasured_clearance().map(str::to_owned))
        })
    }

    /// Returns what the first frame decided about closed and open curves, once.
    fn notes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.run(py, |state| {
            let notes = state.closing.take_notes();
            Ok(notes.iter().map(ToString::to_string).collect())
        })
    }

    /// Returns the open curves of the first frame.
    fn open(&self, py: Python<'_>) -> PyResult<Vec<u32>> {
        self.run(py, |state| Ok(state.open.clone().unwrap_or_default()))
    }

    fn baseline(&self, py: Python<'_>) -> PyResult<Option<Certificate>> {
        self.run(py, |state| {
            let baseline = state.verifier.baseline().cloned();
            let open = state.open.clone().unwrap_or_default();
            Ok(baseline.map(|numbers| Certificate::new(numbers, open)))
        })
    }
}

impl Verifier {
    /// Runs a function on the state, without the interpreter lock.
    fn run<R: Send>(
        &self,
        py: Python<'_>,
        run: impl FnOnce(&mut State) -> Result<R, Error> + Send,
    ) -> PyResult<R> {
        let run = |state: &mut State| py.detach(|| run(state)).map_err(exception);
        self.state.with(py, run)
    }
}

impl State {
    fn source(&self) -> CurveSource {
        CurveSource {
            cell: self.cell,
            closed_by_default: self.closed_by_default,
            ..CurveSource::default()
        }
    }

    fn step(&mut self, frame: RawFrame<'_>, time: f64) -> Result<linkwatch::Report, Error> {
        let seq = self.seq;
        self.seq += 1;
        let source = self.source();
        let State {
            verifier,
            closing,
            pool,
            cell,
            open,
            ..
        } = self;
        let received = pool.receive(|set| verifier.receive(closing.close(frame, source)?, set));
        let report = match received {
            Ok(set) => {
                open.get_or_insert_with(|| open_curves(&set, cell.as_ref()));
                verifier.step_shared(seq, time, &set)
            }
            // It concerns the process, not the frame.
            Err(forked @ Error::Forked { .. }) => Err(forked),
            Err(why) => Ok(verifier.reject(seq, time, &why)),
        };
        let verified = |report: &linkwatch::Report| report.verdict != Verdict::Rejected;
        closing.end_frame(report.as_ref().is_ok_and(verified));
        report
    }
}

/// Returns the curves of a frame that have no linking numbers, because they are open and do not run
/// through the cell.
fn open_curves(set: &CurveSet, cell: Option<&Cell>) -> Vec<u32> {
    let runs = |i: usize| cell.is_some_and(|cell| period(set, i, cell).is_some());
    let open = (0..set.len()).filter(|&i| !set.curve(i).closed && !runs(i));
    open.map(|i| i as u32).collect()
}

/// Returns the exception of an invalid value of an option.
fn option(name: &str) -> impl Fn(Error) -> PyErr {
    move |e| PyValueError::new_err(format!("{name}: {e}"))
}
