//! Calls of Python: arguments, panics, and the state of an object that any thread may use.

use crate::exception;
use linkwatch::{Error, Progress};
use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::{PyRuntimeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::process;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, mpsc};
use std::time::Duration;

/// Time that a call waits before it handles Ctrl-C.
pub const SLICE: Duration = Duration::from_millis(50);

/// Time for a waiting thread to take its turn.
const TURN: Duration = Duration::from_millis(1);

/// Runs a call of Python. A panic becomes a `RuntimeError`, which programs can handle.
pub fn guarded<R>(run: impl FnOnce() -> PyResult<R>) -> PyResult<R> {
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|_| {
        let what = "internal error of linkwatch, described on stderr: please report it";
        Err(PyRuntimeError::new_err(what))
    })
}

/// Runs a function without the interpreter lock, on another thread unless it is quick. Ctrl-C
/// cancels the progress, and is returned beside the result. Without a progress, it ends the call at
/// once, and the function runs on to its end, unused.
pub fn watched<R: Send + 'static>(
    py: Python<'_>,
    is_quick: bool,
    progress: Option<&Progress>,
    run: impl FnOnce() -> R + Send + 'static,
) -> PyResult<(R, PyResult<()>)> {
    if is_quick {
        // Python handles Ctrl-C after the call.
        return Ok((py.detach(run), Ok(())));
    }
    let (send, receive) = mpsc::channel();
    std::thread::spawn(move || send.send(catch_unwind(AssertUnwindSafe(run))));
    let receive = Mutex::new(receive);
    let next = || receive.lock().expect("used here only").recv_timeout(SLICE);
    let mut signals = Ok(());
    loop {
        match py.detach(next) {
            Ok(Ok(found)) => return Ok((found, signals)),
            Ok(Err(panic)) => resume_unwind(panic),
            Err(_) => match (py.check_signals(), progress) {
                (Ok(()), _) => {}
                (Err(interrupt), None) => return Err(interrupt),
                (interrupt, Some(progress)) => {
                    progress.cancel();
                    signals = interrupt;
                }
            },
        }
    }
}

/// Returns the value of an argument, or an error that names it and what was expected.
pub fn argument<'py, T: FromPyObjectOwned<'py>>(
    name: &str,
    value: &Bound<'py, PyAny>,
    expected: &str,
) -> PyResult<T> {
    value.extract().map_err(|_| {
        let kind = value.get_type();
        PyTypeError::new_err(format!(
            "{name} is {value:?} ({kind:?}), expected {expected}"
        ))
    })
}

/// State that the threads of one process use in turns. A forked child gets errors, because another
/// thread of its parent may have held the lock, and forgets the state instead of dropping it.
pub struct Shared<T> {
    /// Is `None` only while it is dropped.
    state: Mutex<Option<T>>,
    process: u32,
    /// Number of threads that wait for their turn.
    waiters: AtomicUsize,
}

impl<T> Shared<T> {
    pub fn new(state: T) -> Self {
        Shared {
            state: Mutex::new(Some(state)),
            process: process::id(),
            waiters: AtomicUsize::new(0),
        }
    }

    /// Runs a function on the state. Fails after a panic, because later results might be wrong.
    pub fn with<R>(&self, py: Python<'_>, run: impl FnOnce(&mut T) -> PyResult<R>) -> PyResult<R> {
        if self.process != process::id() {
            let parent = self.process;
            return Err(exception(Error::Forked { parent }));
        }
        guarded(|| {
            self.waiters.fetch_add(1, Ordering::Relaxed);
            let state = self.state.lock_py_attached(py);
            self.waiters.fetch_sub(1, Ordering::Relaxed);
            let failed = "an earlier call of this object failed; create a new one";
            let mut state = state.map_err(|_| PyRuntimeError::new_err(failed))?;
            run(state.as_mut().expect("present until it is dropped"))
        })
    }

    /// Lets other threads take their turn. Call this between two calls of [`Shared::with`] that
    /// take long.
    pub fn take_turns(&self, py: Python<'_>) {
        if self.waiters.load(Ordering::Relaxed) > 0 {
            py.detach(|| std::thread::sleep(TURN));
        }
    }
}

impl<T> Drop for Shared<T> {
    fn drop(&mut self) {
        if self.process != process::id() {
            std::mem::forget(self.state.get_mut().map(Option::take));
        }
    }
}
