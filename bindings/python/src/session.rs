//! Verification in process, as Python objects.

use crate::call::{Shared, guarded};
use crate::exception;
use crate::frame::{Points, basis, cell};
use crate::report::{Certificate, Report};
use linkwatch::{
    Basis, Cell, Certifier, ClearanceOptions, Closing, ClosingNote, CurveLabels, CurveSet,
    CurveSource, Error, FrameInfo, RawFrame, SessionOptions, Strategy, period,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Arc;

/// Radius of all strands, or `None` if each curve has its own, and the level of the warning.
type Strands = (Option<f64>, f64);

/// `incremental`, `keep_open`, and `wrapped`.
type Flags = (bool, bool, Option<bool>);

/// Verifies the frames of one simulation.
#[pyclass(frozen, module = "linkwatch")]
pub struct Session {
    basis: Basis,
    state: Shared<State>,
}

struct State {
    session: linkwatch::Session,
    /// Number, cell, labels and so on of the next frame.
    next: FrameInfo,
    /// True if each curve has its own radius.
    has_radii: bool,
    /// Open curves, and the layout of the verified frame that has them.
    open: Option<(u32, Vec<u32>)>,
    /// Results of the last frame.
    notes: Vec<ClosingNote>,
    jumps: u64,
    unmeasured: Option<String>,
}

#[pymethods]
impl Session {
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
    ) -> PyResult<Session> {
        let (incremental, keep_open, wrapped) = flags;
        let options = SessionOptions {
            baseline: baseline.map(|b| b.numbers),
            events: events.parse().map_err(option("events"))?,
            abort_on: abort_on.parse().map_err(option("abort_on"))?,
            motion_limit,
            wrapped,
            keep_open,
            clearance: strands.map(|(radius, low)| {
                let mut options = ClearanceOptions::new(radius);
                options.low = low;
                options
            }),
            strategy: match incremental {
                true => Strategy::Incremental,
                false => Strategy::Full,
            },
            ..SessionOptions::default()
        };
        let session = guarded(|| linkwatch::Session::new(options).map_err(exception))?;
        Ok(Session {
            basis: basis(basis_name)?,
            state: Shared::new(State {
                session,
                next: FrameInfo::default(),
                has_radii: strands.is_some_and(|(radius, _)| radius.is_none()),
                open: None,
                notes: Vec::new(),
                jumps: 0,
                unmeasured: None,
            }),
        })
    }

    /// Describes the curves of the next frames: names, radii, and true if nothing says which curves
    /// are closed.
    fn describe(
        &self,
        py: Python<'_>,
        names: Vec<String>,
        radii: Vec<f32>,
        closed_by_default: bool,
    ) -> PyResult<()> {
        self.run(py, |state| {
            let positive = !radii.is_empty() && radii.iter().all(|&r| r > 0.0);
            let refuse = |what: &str| Err(Error::Usage(what.into()));
            match state.has_radii {
                true if !positive => {
                    return refuse("clearance needs a positive radius of each curve");
                }
                false if !radii.is_empty() => {
                    return refuse("radii have no effect unless thickness has one for each curve");
                }
                _ => {}
            }
            let curves = names.len().max(radii.len());
            let labels = CurveLabels::named(names).with_radii(radii);
            labels.check(curves)?;
            state.next.labels = Arc::new(labels);
            state.next.layout += 1;
            state.next.closed_by_default = closed_by_default;
            Ok(())
        })
    }

    /// Sets the periodic cell of the next frames: three vectors and the corner.
    fn set_cell(&self, py: Python<'_>, numbers: [f64; 12]) -> PyResult<()> {
        self.run(py, |state| {
            let cell = cell(numbers);
            cell.check()?;
            state.next.cell = Some(cell);
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
        self.run(py, |state| state.step(frame, time))
    }

    fn cut(&self, py: Python<'_>) -> PyResult<()> {
        self.run(py, |state| {
            state.next.cuts = state.next.cuts.wrapping_add(1);
            Ok(())
        })
    }

    fn accept(&self, py: Python<'_>) -> PyResult<()> {
        self.run(py, |state| {
            state.next.baseline = state.next.seq;
            Ok(())
        })
    }

    fn jumps(&self, py: Python<'_>) -> PyResult<u64> {
        self.run(py, |state| Ok(state.jumps))
    }

    fn unmeasured_clearance(&self, py: Python<'_>) -> PyResult<Option<String>> {
        self.run(py, |state| Ok(state.unmeasured.clone()))
    }

    /// Returns what the last frame decided about closed and open curves.
    fn notes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.run(py, |state| {
            Ok(state.notes.iter().map(ToString::to_string).collect())
        })
    }

    /// Returns the open curves of the last verified frame.
    fn open(&self, py: Python<'_>) -> PyResult<Vec<u32>> {
        self.run(py, |state| Ok(state.open()))
    }

    fn baseline(&self, py: Python<'_>) -> PyResult<Option<Certificate>> {
        self.run(py, |state| {
            let baseline = state.session.baseline().cloned();
            Ok(baseline.map(|numbers| Certificate::new(numbers, state.open())))
        })
    }
}

impl Session {
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
    fn step(&mut self, frame: RawFrame<'_>, time: f64) -> Result<Report, Error> {
        let info = FrameInfo {
            time,
            ..self.next.clone()
        };
        self.next.seq += 1;
        let received = self.session.receive(info, |copy| copy(frame));
        let verified = self.session.verify(received)?;
        let info = verified.info;
        if let Some(set) = &verified.curves
            && self.open.as_ref().is_none_or(|of| of.0 != info.layout)
        {
            self.open = Some((info.layout, open_curves(set, info.cell.as_ref())));
        }
        (self.notes, self.jumps) = (verified.notes, verified.jumps);
        self.unmeasured = verified.unmeasured;
        Ok(Report::new(verified.report, info.labels))
    }

    fn open(&self) -> Vec<u32> {
        self.open
            .as_ref()
            .map(|of| of.1.clone())
            .unwrap_or_default()
    }
}

/// Computes all linking numbers of a frame, without the interpreter lock. Also returns decisions
/// about closed and open curves.
#[pyfunction]
pub fn certify(
    py: Python<'_>,
    points: Points<'_>,
    counts: Vec<i32>,
    basis_name: &str,
    closed_by_default: bool,
    cell_numbers: Option<[f64; 12]>,
) -> PyResult<(Certificate, Vec<String>)> {
    let frame = RawFrame {
        basis: basis(basis_name)?,
        counts: &counts,
        positions: points.positions()?,
    };
    let source = CurveSource {
        cell: cell_numbers.map(cell),
        closed_by_default,
        ..CurveSource::default()
    };
    guarded(|| py.detach(|| certificate(frame, source)).map_err(exception))
}

fn certificate(
    frame: RawFrame<'_>,
    source: CurveSource,
) -> Result<(Certificate, Vec<String>), Error> {
    let cell = source.cell;
    if let Some(cell) = &cell {
        cell.check()?;
    }
    let mut closing = Closing::default();
    let set = closing.curves(frame, source)?;
    let open = open_curves(&set, cell.as_ref());
    if open.len() == set.len() {
        let (curves, yarns) = (set.len(), 0);
        return Err(Error::NothingClosed { curves, yarns });
    }
    let options = SessionOptions::default();
    let numbers = match cell {
        None => Certifier::new(&options)?.certify(&set).0.clone(),
        Some(cell) => {
            let mut session = linkwatch::Session::new(options)?;
            let report = session.feed(FrameInfo::default().in_cell(cell), set)?;
            match (report.rejected, session.baseline()) {
                (None, Some(baseline)) => baseline.clone(),
                (why, _) => {
                    let why = why.unwrap_or_else(|| "no linking numbers".into());
                    return Err(Error::Usage(why));
                }
            }
        }
    };
    let notes = closing
        .take_notes()
        .iter()
        .map(ToString::to_string)
        .collect();
    Ok((Certificate::new(numbers, open), notes))
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
