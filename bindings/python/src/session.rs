//! Verification in process, as Python objects.

use crate::call::{Shared, guarded, watched};
use crate::certificate::Certificate;
use crate::frame::{Points, basis, cell, raw, sentences, source};
use crate::result::{packed, report, unpacked};
use crate::{exception, without_unwrapping};
use linkwatch::{
    Basis, Cell, ClearanceOptions, Closing, ClosingNote, CurveLabels, CurveSet, Error, FrameInfo,
    RawFrame, SessionOptions, SessionState, Strategy, VerifiedFrame, period,
};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde_json::json;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Radius of all strands, or `None` if each curve has its own, and the level of the warning.
type Strands = (Option<f64>, f64);

/// `incremental`, `keep_open`, and `wrapped`.
type Flags = (bool, bool, Option<bool>);

/// Number, cell, and reason to reject it, of a frame of a file.
type OfFile = (u64, Option<[f64; 12]>, Option<String>);

const CLOSED: &str = "the session is closed; create a new one";

/// Number of segments from which on a frame may take so long that Ctrl-C is heeded, unless a frame
/// of that many took less than this time. Another thread costs up to a millisecond.
const LARGE: usize = 4096;
const LONG: Duration = Duration::from_millis(100);

/// Verifies the frames of one simulation.
#[pyclass(frozen, module = "linkwatch")]
pub struct Session {
    basis: Basis,
    state: Shared<State>,
}

struct State {
    /// `None` once it was closed.
    session: Option<Box<linkwatch::Session>>,
    options: SessionOptions,
    /// Time of the frame that took longest, and most segments of a frame.
    longest: Duration,
    most: usize,
    /// Number, cell, labels and so on of the next frame.
    next: FrameInfo,
    /// True if each curve has its own radius.
    has_radii: bool,
    /// Open curves, and the layout of the verified frame that has them.
    open: Vec<u32>,
    layout: Option<u32>,
    /// Largest number of open curves of a verified frame, without those that run through the cell.
    most_open: u64,
    /// Results of the last frame.
    notes: Vec<ClosingNote>,
    jumps: u64,
    unmeasured: Option<String>,
}

#[pymethods]
impl Session {
    #[new]
    #[pyo3(signature = (
        *, words, baseline, flags, motion_limit, strands, state
    ))]
    fn new(
        py: Python<'_>,
        words: [String; 4],
        baseline: Option<Certificate>,
        flags: Flags,
        motion_limit: Option<f64>,
        strands: Option<Strands>,
        state: Option<&[u8]>,
    ) -> PyResult<Session> {
        let [basis_name, events, abort_on, invariants] = words;
        let (incremental, keep_open, wrapped) = flags;
        let options = SessionOptions {
            baseline: baseline.map(|b| b.numbers),
            events: events.parse().map_err(option("events"))?,
            abort_on: abort_on.parse().map_err(option("abort_on"))?,
            motion_limit,
            invariants: invariants
                .split(',')
                .filter(|kind| !kind.is_empty())
                .map(|kind| kind.parse().map_err(option("invariants")))
                .collect::<PyResult<_>>()?,
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
        let begin = state.map_or(Ok(SessionState::default()), unpacked)?;
        let mut next = begin.info().cloned().unwrap_or_default();
        next.seq += u64::from(state.is_some());
        let of_session = options.clone();
        let begin = || linkwatch::Session::resume(of_session, begin);
        let session = guarded(|| py.detach(begin).map_err(exception))?;
        Ok(Session {
            basis: basis(&basis_name)?,
            state: Shared::new(State {
                session: Some(Box::new(session)),
                options,
                longest: Duration::ZERO,
                most: LARGE,
                next,
                has_radii: strands.is_some_and(|(radius, _)| radius.is_none()),
                open: Vec::new(),
                layout: None,
                most_open: 0,
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
                    return refuse("radii have no effect unless radius has one for each curve");
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

    /// Verifies a frame, without the interpreter lock. A frame of a file has its own number, cell
    /// and reason to be rejected.
    #[pyo3(signature = (points, counts, time, of_file = None))]
    fn step(
        &self,
        py: Python<'_>,
        points: Points<'_>,
        counts: Vec<i32>,
        time: f64,
        of_file: Option<OfFile>,
    ) -> PyResult<Py<PyAny>> {
        let frame = RawFrame {
            basis: self.basis,
            counts: &counts,
            positions: points.positions()?,
        };
        self.state.with(py, |state| {
            let verified = state.step(py, frame, time, of_file)?;
            let names = &verified.info.labels.names;
            report(py, &verified.report, names)
        })
    }

    /// Returns the state after the last verified frame, from which another process continues, and a
    /// hash of all of it that findings in later frames depend on.
    fn state(&self, py: Python<'_>) -> PyResult<(Py<PyBytes>, u64)> {
        let (bytes, hash) = self.run(py, |state| {
            let state = state.session().state();
            let mut json = json!(state);
            // Coordinates follow from the frame, and from how curves were moved, which is hashed.
            // Candidates of images are found again when curves move.
            for name in [
                "/curves/single",
                "/curves/double",
                "/engine/intactness",
                "/engine/extent",
                "/engine/cell/images",
                "/strands",
            ] {
                json.pointer_mut(&format!("/verified{name}"))
                    .map(serde_json::Value::take);
            }
            let mut hash = DefaultHasher::new();
            json.to_string().hash(&mut hash);
            Ok((packed(&state), hash.finish()))
        })?;
        Ok((PyBytes::new(py, &bytes).unbind(), hash))
    }

    /// Begins with the next frame in the middle of a motion, of which the baseline is known.
    fn begin_part(&self, py: Python<'_>) -> PyResult<()> {
        self.run(py, |state| {
            let in_cell = state.next.cell.is_some();
            let session = state.session();
            match session.complete_baseline().filter(|_| in_cell) {
                // Curves may be cells away from where they were in the first frame.
                Some(baseline) => session.begin_part(baseline),
                None => session.cut(),
            }
            Ok(())
        })
    }

    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.state.with(py, |state| {
            state.session = None;
            Ok(())
        })
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
        self.run(py, |state| Ok(sentences(&state.notes)))
    }

    /// Returns the open curves of the last verified frame.
    fn open(&self, py: Python<'_>) -> PyResult<Vec<u32>> {
        self.run(py, |state| Ok(state.open.clone()))
    }

    /// Returns the largest number of curves of a verified frame without linking numbers: those that
    /// are open, and those that run through the cell if there are several.
    fn most_open(&self, py: Python<'_>) -> PyResult<u64> {
        self.run(py, |state| {
            let through = state.session().baseline();
            let through = through.map_or(0, |numbers| numbers.periods_without_numbers());
            Ok(state.most_open + through as u64)
        })
    }

    fn baseline(&self, py: Python<'_>) -> PyResult<Option<Certificate>> {
        self.run(py, |state| {
            let baseline = state.session().complete_baseline();
            Ok(baseline.map(|numbers| Certificate::new(numbers, state.open.clone())))
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
        self.state.with(py, |state| {
            if state.session.is_none() {
                return Err(PyRuntimeError::new_err(CLOSED));
            }
            py.detach(|| run(state)).map_err(exception)
        })
    }
}

impl State {
    /// Returns the session, in a call of [`Session::run`].
    fn session(&mut self) -> &mut linkwatch::Session {
        self.session.as_deref_mut().expect("checked by the caller")
    }

    fn step(
        &mut self,
        py: Python<'_>,
        frame: RawFrame<'_>,
        time: f64,
        of_file: Option<OfFile>,
    ) -> PyResult<VerifiedFrame> {
        let mut why = None;
        if let Some((seq, numbers, rejected)) = of_file {
            (self.next.seq, self.next.cell, why) = (seq, numbers.map(cell), rejected);
        }
        let info = FrameInfo {
            time,
            ..self.next.clone()
        };
        let closed = || PyRuntimeError::new_err(CLOSED);
        let mut session = self.session.take().ok_or_else(closed)?;
        let received = py.detach(|| {
            session.receive(info, |copy| match why {
                Some(why) => Err(Error::Usage(why)),
                None => copy(frame),
            })
        });
        let segments = received.segments();
        let is_quick = segments <= self.most && self.longest < LONG;
        let start = Instant::now();
        let progress = session.progress();
        let verify = move || (session.verify(received), session);
        let ((outcome, mut session), signals) = watched(py, is_quick, Some(&progress), verify)?;
        let interrupt = signals.and_then(|()| py.check_signals());
        if interrupt.is_err() || session.progress().is_cancelled() {
            let (options, mut state) = (self.options.clone(), session.state());
            if let Ok(VerifiedFrame { report, info, .. }) = &outcome
                && report.rejected.is_none()
            {
                // The step ended, but nobody sees its report.
                let why = format!(
                    "Ctrl-C interrupted the step to frame {}, whose report is lost",
                    report.seq
                );
                let last = report.last_intact;
                let intact = last == Some(report.seq);
                state = state.after_unknown_frames(info.cuts, last, intact, why);
            }
            *session = linkwatch::Session::resume(options, state).map_err(exception)?;
        }
        self.session = Some(session);
        self.longest = self.longest.max(start.elapsed());
        self.most = self.most.max(segments);
        interrupt?;
        self.next.seq += 1;
        let verified = outcome.map_err(exception)?;
        let info = &verified.info;
        if let Some(set) = &verified.curves
            && self.layout != Some(info.layout)
        {
            self.open = open_curves(set, info.cell.as_ref());
            self.layout = Some(info.layout);
        }
        self.most_open = self.most_open.max(verified.report.stats.open_curves);
        self.notes.clone_from(&verified.notes);
        self.jumps = verified.jumps;
        self.unmeasured.clone_from(&verified.unmeasured);
        Ok(verified)
    }
}

/// Number of segments of which all linking numbers take less than a second, however they lie.
const QUICK: usize = 20_000;

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
    let frame = raw(&points, &counts, basis_name)?;
    let source = source(cell_numbers, closed_by_default);
    let cell = source.cell;
    guarded(|| {
        if let Some(cell) = &cell {
            cell.check().map_err(exception)?;
        }
        let mut closing = Closing::default();
        let set = py
            .detach(|| closing.curves(frame, source))
            .map_err(exception)?;
        let open = open_curves(&set, cell.as_ref());
        if open.len() == set.len() {
            let (curves, yarns) = (set.len(), 0);
            return Err(exception(Error::NothingClosed { curves, yarns }));
        }
        let mut session = linkwatch::Session::new(SessionOptions::default()).map_err(exception)?;
        let progress = session.progress();
        let info = FrameInfo {
            cell,
            ..FrameInfo::default()
        };
        let is_quick = set.segments() <= QUICK;
        let (found, signals) = watched(py, is_quick, Some(&progress), move || {
            let report = session.feed(info, set)?;
            match (report.rejected, session.baseline()) {
                (None, Some(baseline)) => Ok(baseline.clone()),
                (why, _) => Err(Error::Usage(
                    why.unwrap_or_else(|| "no linking numbers".into()),
                )),
            }
        })?;
        signals?;
        let numbers = found.map_err(|e| PyValueError::new_err(without_unwrapping(&e)))?;
        let notes = sentences(&closing.take_notes());
        Ok((Certificate::new(numbers, open), notes))
    })
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
