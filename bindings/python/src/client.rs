//! The live client, as a Python object.

use crate::call::{SLICE, Shared, guarded, watched};
use crate::exception;
use crate::frame::{basis, cell};
use crate::result::{json, result};
use linkwatch::{
    Basis, ClientOptions, CurveLabels, Finding, FrameMemory, MessageKind, Outcome, Precision,
    VerdictMessage,
};
use numpy::ndarray::ArrayView2;
use numpy::{Element, PyArray2};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Simulator's end of the bus.
#[pyclass(frozen, module = "linkwatch")]
pub struct Client(Shared<State>);

struct State {
    /// None once the session has ended.
    client: Option<linkwatch::Client>,
    basis: Basis,
    precision: Precision,
    points: usize,
    frame: Option<Begun>,
    /// Keeps the shared memory of all frames of these curves mapped, also after the session if a
    /// view is left. None after the session, and if that failed: then no frame can be begun.
    mapping: Option<Arc<Mutex<FrameMemory>>>,
    /// Number of the last published frame.
    last: Option<u64>,
    /// Reason why the last wait returned no verdict, if it returned none.
    no_verdict: Option<String>,
    /// The last message of the watcher, or the last abort if there was none.
    goodbye: Option<VerdictMessage>,
}

/// A frame that is being written.
struct Begun {
    memory: FrameMemory,
    view: Py<PyAny>,
}

/// Base object of the views of frames. The last reference to a view may be dropped by any thread.
#[pyclass(frozen, module = "linkwatch")]
struct Mapping {
    _memory: Arc<Mutex<FrameMemory>>,
}

/// Message of the watcher.
#[pyclass(frozen, module = "linkwatch")]
pub struct Message(VerdictMessage);

#[pymethods]
impl Message {
    /// verdict, hello or goodbye.
    #[getter]
    fn kind(&self) -> &'static str {
        match self.0.kind {
            MessageKind::Verdict => "verdict",
            MessageKind::Goodbye => "goodbye",
            _ => "hello",
        }
    }

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
        self.0.kind == MessageKind::Verdict && self.0.verdict == linkwatch::Verdict::Intact
    }

    /// True if the simulator is asked to stop or to roll back.
    #[getter]
    fn abort(&self) -> bool {
        self.0.abort
    }

    /// The first finding that the last verified frame did not have: a Change, a PullThrough or a
    /// Defect; None if there is none.
    #[getter]
    fn first(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        let (extent, names) = (self.0.extent, &self.0.names);
        let (class, json, words) = match &self.0.first {
            Some(Finding::Change(c)) => ("Change", json(c), c.sentence_named(extent, names)),
            Some(Finding::Event(p)) => ("PullThrough", json(p), p.sentence_named(extent, names)),
            Some(Finding::Defect(d)) => ("Defect", json(d), d.sentence_named(extent, names)),
            _ => return Ok(None),
        };
        result(py, class, (json, vec![words]), names).map(Some)
    }

    /// Last frame that is known to be intact; None if there is none.
    #[getter]
    fn last_intact(&self) -> Option<u64> {
        self.0.last_intact
    }

    /// Largest proven fraction of the step from the last intact frame without a pull-through; None
    /// if it is unknown.
    #[getter]
    fn safe_fraction(&self) -> Option<f64> {
        self.0.safe_fraction
    }

    /// Number of curves that appeared since the last verified frame.
    #[getter]
    fn appeared(&self) -> u32 {
        self.0.appeared
    }

    /// Number of curves that are gone since the last verified frame.
    #[getter]
    fn gone(&self) -> u32 {
        self.0.gone
    }

    /// Number of all findings of the frame.
    #[getter]
    fn findings(&self) -> u32 {
        self.0.findings
    }

    /// Number of violations in the session that were rolled back, so that a later frame is intact.
    #[getter]
    fn recovered(&self) -> u32 {
        self.0.recovered
    }

    /// Reason why the frame was rejected.
    #[getter]
    fn rejected(&self) -> Option<&str> {
        let rejected = self.0.verdict == linkwatch::Verdict::Rejected;
        self.0.reason.as_deref().filter(|_| rejected)
    }

    fn __str__(&self) -> String {
        self.0.to_string()
    }

    fn __repr__(&self) -> String {
        format!("<Message: {}>", self.0)
    }
}

#[pymethods]
impl Client {
    #[new]
    fn new(
        service: &str,
        curves: Curves,
        basis_name: &str,
        single: bool,
        lockstep: bool,
        wait_mode: &str,
    ) -> PyResult<Client> {
        let mut options = ClientOptions::default();
        options.lockstep = lockstep;
        let mode = wait_mode.parse();
        options.wait_mode = mode.map_err(|e| PyValueError::new_err(format!("wait_mode: {e}")))?;
        let basis = basis(basis_name)?;
        let precision = if single {
            Precision::F32
        } else {
            Precision::F64
        };
        guarded(|| {
            let mut client = linkwatch::Client::open(service, &options).map_err(exception)?;
            let points = declare(&mut client, basis, precision, curves)?;
            let mapping = keep_mapped(&client)?;
            Ok(Client(Shared::new(State {
                client: Some(client),
                basis,
                precision,
                points,
                frame: None,
                mapping: Some(mapping),
                last: None,
                no_verdict: None,
                goodbye: None,
            })))
        })
    }

    /// Declares other curves from the next frame on: counts, names and radii.
    fn describe(&self, py: Python<'_>, curves: Curves) -> PyResult<()> {
        self.0.with(py, |state| {
            state.discard(py)?;
            let (basis, precision) = (state.basis, state.precision);
            let points = declare(state.open()?, basis, precision, curves)?;
            // Without it, no frame of these curves can be begun.
            state.mapping = None;
            state.points = points;
            state.mapping = Some(keep_mapped(state.open()?)?);
            Ok(())
        })
    }

    /// Sets the time step of the simulator in seconds.
    fn set_time_step(&self, py: Python<'_>, seconds: f64) -> PyResult<()> {
        self.open(py, |client| client.set_time_step(seconds))
    }

    /// Sets the periodic cell of later frames: three vectors and the corner.
    fn set_cell(&self, py: Python<'_>, numbers: [f64; 12]) -> PyResult<()> {
        self.open(py, |client| client.set_cell(Some(cell(numbers))))
    }

    /// Returns a view of the shared memory of the next frame.
    fn begin(&self, py: Python<'_>, time: f64) -> PyResult<Py<PyAny>> {
        self.0.with(py, |state| {
            state.open()?;
            state.discard(py)?;
            if state.mapping.is_none() {
                let what = "the last description of the curves failed: describe them again";
                return Err(PyRuntimeError::new_err(what));
            }
            let mut memory = state.open()?.begin(time).map_err(exception)?;
            let view = match state.precision {
                Precision::F32 => state.view(py, memory.positions_f32().map_err(exception)?),
                Precision::F64 => state.view(py, memory.positions_f64().map_err(exception)?),
            }?;
            state.frame = Some(Begun {
                memory,
                view: view.clone_ref(py),
            });
            Ok(view)
        })
    }

    /// Publishes the frame that was begun. Its view can be read afterwards, but not written.
    fn publish(&self, py: Python<'_>) -> PyResult<u64> {
        self.0.with(py, |state| {
            state.open()?;
            let begun = state.frame.take();
            let Begun { memory, view } = begun.ok_or_else(|| {
                PyRuntimeError::new_err("no frame was begun: call begin(time) and write the points")
            })?;
            // Readers hold the memory from now on.
            view.call_method1(py, "setflags", (false,))?;
            let seq = state.open()?.send(memory).map_err(exception)?;
            state.last = Some(seq);
            Ok(seq)
        })
    }

    /// Returns the next verdict; None if there is none.
    fn poll(&self, py: Python<'_>) -> PyResult<Option<Message>> {
        let message = self.open(py, linkwatch::Client::poll)?;
        Ok(message.map(Message))
    }

    /// Waits for the verdict on a frame, by default the last published one. Returns None after
    /// `seconds`.
    #[pyo3(signature = (seconds, seq = None))]
    fn wait(&self, py: Python<'_>, seconds: f64, seq: Option<u64>) -> PyResult<Option<Message>> {
        let last = self.0.with(py, |state| Ok(state.last))?;
        let seq = match (seq, last) {
            (Some(seq), Some(last)) if seq > last => {
                let what = format!("frame {seq} was not published, only those up to {last}");
                return Err(PyValueError::new_err(what));
            }
            (_, None) => return Err(PyRuntimeError::new_err("no frame was published")),
            (seq, Some(last)) => seq.unwrap_or(last),
        };
        let found = self.waiting(py, seconds, |client, slice| {
            let asked = Instant::now();
            Ok(match client.wait(seq, slice)? {
                Outcome::Verdict(message) => Some(Ok(*message)),
                Outcome::NoWatcher(how) => Some(Err(how.to_string())),
                Outcome::Stale if asked.elapsed() < slice => Some(Err(
                    "the watcher skipped it, or answered a later frame before".into(),
                )),
                Outcome::Stale => None,
            })
        })?;
        let (message, why) = match found {
            Some(Ok(message)) => (Some(Message(message)), None),
            Some(Err(why)) => (None, Some(format!("no verdict on frame {seq}: {why}"))),
            None => {
                let what = format!("no verdict on frame {seq} within {seconds} seconds");
                (None, Some(what))
            }
        };
        self.0.with(py, |state| {
            state.no_verdict = why;
            Ok(message)
        })
    }

    #[getter]
    fn no_verdict(&self, py: Python<'_>) -> PyResult<Option<String>> {
        self.0.with(py, |state| Ok(state.no_verdict.clone()))
    }

    /// Waits until a watcher has seen this session. Returns False if none came in time.
    fn wait_for_watcher(&self, py: Python<'_>, seconds: f64) -> PyResult<bool> {
        let came = self.waiting(py, seconds, |client, slice| {
            Ok(client.wait_for_watcher(slice)?.then_some(()))
        });
        Ok(came?.is_some())
    }

    /// Returns the first message that asks the simulator to stop. After the session: the last
    /// message of the watcher, if it asks the simulator to stop.
    fn aborted(&self, py: Python<'_>) -> PyResult<Option<Message>> {
        self.0.with(py, |state| {
            let Some(client) = &mut state.client else {
                let last = state.goodbye.clone();
                return Ok(last.filter(|message| message.abort).map(Message));
            };
            while client.poll().map_err(exception)?.is_some() {}
            Ok(client.aborted().cloned().map(Message))
        })
    }

    fn resume(&self, py: Python<'_>) -> PyResult<()> {
        self.open(py, |client| {
            client.resume();
            Ok(())
        })
    }

    fn accept(&self, py: Python<'_>) -> PyResult<()> {
        self.open(py, |client| {
            client.accept();
            Ok(())
        })
    }

    fn cut(&self, py: Python<'_>) -> PyResult<()> {
        self.open(py, |client| {
            client.cut();
            Ok(())
        })
    }

    /// Returns the seconds since the last message of the watcher; None if there is no watcher.
    fn silent_for(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        self.open(py, |client| {
            Ok(client.silent_for().map(|t| t.as_secs_f64()))
        })
    }

    /// Ends the session, and waits for the last message of the watcher.
    fn finish(&self, py: Python<'_>, seconds: f64) -> PyResult<Option<Message>> {
        let limit = duration(seconds)?;
        self.0.with(py, |state| {
            state.open()?;
            state.discard(py)?;
            // Memory of a frame keeps this process attached to the service.
            state.mapping = None;
            let mut client = state.client.take();
            if let Some(client) = &mut client {
                while client.poll().map_err(exception)?.is_some() {}
            }
            state.goodbye = client.as_ref().and_then(|client| client.aborted().cloned());
            let left = client.as_ref().and_then(|client| client.departure());
            let left = left.map(ToString::to_string);
            let finish = move || client.map(|client| client.finish_within(limit)).transpose();
            let last = watched(py, false, None, finish)?
                .0
                .map_err(exception)?
                .flatten();
            match &last {
                Some(_) => state.goodbye.clone_from(&last),
                None => state.no_verdict = left,
            }
            Ok(last.map(Message))
        })
    }

    #[getter]
    fn is_open(&self, py: Python<'_>) -> PyResult<bool> {
        self.0.with(py, |state| Ok(state.client.is_some()))
    }

    /// Ends the session early. Does nothing if it has ended.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.0.with(py, |state| {
            state.discard(py)?;
            state.mapping = None;
            if let Some(client) = state.client.take() {
                state.goodbye = client.aborted().cloned();
            }
            Ok(())
        })
    }
}

impl Client {
    /// Calls a function of the client, which must be open.
    fn open<R>(
        &self,
        py: Python<'_>,
        call: impl FnOnce(&mut linkwatch::Client) -> linkwatch::Result<R>,
    ) -> PyResult<R> {
        self.0
            .with(py, |state| call(state.open()?).map_err(exception))
    }

    /// Calls `wait` for slices of time until it returns something or the time is over. Other
    /// threads of Python run meanwhile, also with this client, and Ctrl-C ends the wait.
    fn waiting<R: Send>(
        &self,
        py: Python<'_>,
        seconds: f64,
        wait: impl Fn(&mut linkwatch::Client, Duration) -> linkwatch::Result<Option<R>> + Sync,
    ) -> PyResult<Option<R>> {
        let (start, limit) = (Instant::now(), duration(seconds)?);
        loop {
            let left = limit.saturating_sub(start.elapsed());
            let found = self.open(py, |client| py.detach(|| wait(client, left.min(SLICE))))?;
            if found.is_some() || left <= SLICE {
                return Ok(found);
            }
            self.0.take_turns(py);
            py.check_signals()?;
        }
    }
}

impl State {
    /// Discards the frame that was begun. Its view is read-only from now on, because the memory may
    /// become that of a later frame.
    fn discard(&mut self, py: Python<'_>) -> PyResult<()> {
        if let Some(Begun { view, .. }) = self.frame.take() {
            view.call_method1(py, "setflags", (false,))?;
        }
        Ok(())
    }

    fn open(&mut self) -> PyResult<&mut linkwatch::Client> {
        let ended = || PyRuntimeError::new_err("the session has ended; open another client");
        self.client.as_mut().ok_or_else(ended)
    }

    /// Returns an array of the shape `(points, 3)` over the memory of a frame.
    fn view<T: Element>(&self, py: Python<'_>, positions: &mut [T]) -> PyResult<Py<PyAny>> {
        let mapping = self.mapping.as_ref();
        let mapping = mapping.expect("begin has checked that there is one");
        let base = Mapping {
            _memory: Arc::clone(mapping),
        };
        let base = Bound::new(py, base)?.into_any();
        #[expect(unsafe_code, reason = "an array over memory that Python does not own")]
        // SAFETY: the memory has three coordinates for each point. It stays mapped as long as the
        // base object lives, because that holds a sample of the same publisher and of the same
        // size, which lies in the same segment: a segment is replaced only by one for larger
        // frames, and the sample was lent after the curves were described. Python may write to it
        // at any time, through slices even after publishing. No Rust code of this process reads it,
        // the watcher reads every number once and checks it, and all bit patterns are numbers.
        let view = unsafe {
            let points = ArrayView2::from_shape_ptr((self.points, 3), positions.as_mut_ptr());
            PyArray2::borrow_from_array(&points, base)
        };
        Ok(view.into_any().unbind())
    }
}

/// Counts, names and radii of curves.
#[derive(FromPyObject)]
struct Curves(Vec<i32>, Vec<String>, Vec<f32>);

/// Declares the curves of the next frames. Returns their number of points.
fn declare(
    client: &mut linkwatch::Client,
    basis: Basis,
    precision: Precision,
    Curves(counts, names, radii): Curves,
) -> PyResult<usize> {
    let labels = CurveLabels::named(names).with_radii(radii);
    let declared = client.describe_labelled(basis, precision, &counts, labels);
    declared.map_err(exception)?;
    Ok(counts.iter().map(|n| n.unsigned_abs() as usize).sum())
}

/// Returns a frame that keeps the shared memory of frames of these curves mapped.
fn keep_mapped(client: &linkwatch::Client) -> PyResult<Arc<Mutex<FrameMemory>>> {
    // Memory must be left for a frame that is written, and for the end of the session.
    let lend = || -> linkwatch::Result<_> {
        let [mapping, ..] = [client.begin(0.0)?, client.begin(0.0)?, client.begin(0.0)?];
        Ok(mapping)
    };
    let mapping = lend().map_err(|e| {
        PyValueError::new_err(format!(
            "{e}; too many arrays of earlier frames, of other curves, are in use: copy or release \
             them, and describe the curves again"
        ))
    })?;
    Ok(Arc::new(Mutex::new(mapping)))
}

/// Returns a duration of seconds; without a limit if it is infinite.
fn duration(seconds: f64) -> PyResult<Duration> {
    if seconds == f64::INFINITY {
        return Ok(Duration::MAX);
    }
    Duration::try_from_secs_f64(seconds)
        .map_err(|why| PyValueError::new_err(format!("a wait of {seconds} seconds: {why}")))
}
