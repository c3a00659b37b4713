//! `--supervise`: a process that starts the watch as a worker, and starts it again if it crashes.
//!
//! The worker is the same command. It finds the folder of its [`Journal`]s in an environment
//! variable, and takes the end of its standard input as a request to end: the supervisor closes it
//! on a signal, and the system does if the supervisor is killed.

mod journal;

pub use journal::{Earlier, Journal};

use crate::cli::Outcome;
use crate::cli::signals::stop_on_signals;
use linkwatch::{Error, Result};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Environment variable of a worker: the folder of its journals.
const FOLDER: &str = "LINKWATCH_WORKER_FOLDER";

/// Number of crashes in a row, without a frame that was verified in between, after which the
/// supervisor gives up.
const CRASHES: u32 = 5;

/// Interval at which the supervisor looks at its worker.
const LOOK: Duration = Duration::from_millis(20);

/// Exit codes with which a watch ends by itself, 130 after a second signal included. After a panic
/// it is another one, and after a signal there is none.
const ENDS: [i32; 5] = [0, 1, 2, 3, 130];

/// This process, if a supervisor started it.
pub struct Worker {
    folder: PathBuf,
    /// True if the supervisor was killed, so that this process removes the folder.
    alone: Arc<AtomicBool>,
}

impl Worker {
    /// Returns the folder of the journals, if this process is a worker.
    pub fn folder() -> Option<PathBuf> {
        std::env::var_os(FOLDER).map(PathBuf::from)
    }

    /// Sets `stop` once the supervisor asks this worker to end, or is killed.
    pub fn start(folder: PathBuf, stop: &Arc<AtomicBool>) -> Result<Worker> {
        let alone = Arc::new(AtomicBool::new(false));
        let (stop, no_supervisor) = (Arc::clone(stop), Arc::clone(&alone));
        let listen = move || {
            let mut stdin = std::io::stdin();
            if stdin.read(&mut [0]).is_ok_and(|bytes| bytes > 0) {
                stop.store(true, Ordering::Relaxed);
                // The supervisor ends before its worker if it is killed, or after a second signal.
                let _ = stdin.read(&mut [0]);
                std::process::exit(130);
            }
            no_supervisor.store(true, Ordering::Relaxed);
            stop.store(true, Ordering::Relaxed);
        };
        let thread = std::thread::Builder::new().name("linkwatch-worker".into());
        thread.spawn(listen)?;
        Ok(Worker { folder, alone })
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        if self.alone.load(Ordering::Relaxed) {
            tracing::warn!("the supervisor was killed, so the watch ended");
            remove(&self.folder);
        }
    }
}

/// Runs the command of this process as a worker for as long as it crashes. Returns the outcome of
/// the last worker, which knows those of the others. `services` is their number.
pub fn supervise(services: usize) -> Result<Outcome> {
    let stop = stop_on_signals()?;
    let folder = Folder::create()?;
    let (mut crashes, mut before) = (0, 0);
    loop {
        let status = run_worker(&folder.0, &stop)?;
        let code = status.code().filter(|code| ENDS.contains(code));
        match code {
            Some(0) => return Ok(Outcome::Fine),
            Some(1) => return Ok(Outcome::Changed),
            Some(3) => return Ok(Outcome::Undecided),
            // The worker has printed why.
            Some(code) => {
                let what = format!("the worker ended with exit code {code}, for the reason above");
                return Err(Error::Worker(what));
            }
            None => {}
        }
        let (worst, answered) = journal::results(&folder.0, services);
        crashes = if answered > before { 1 } else { crashes + 1 };
        before = answered;
        if stop.load(Ordering::Relaxed) {
            tracing::error!("the worker crashed while it ended ({status})");
            return Ok(worst.max(Outcome::Undecided));
        }
        if crashes == CRASHES {
            let why = format!(
                "the worker crashed {CRASHES} times in a row without verifying a frame, the last \
                 time with {status}; frames are no longer verified. If it was killed, look in the \
                 log of the system for a lack of memory; else report the crash"
            );
            return match worst {
                Outcome::Changed => {
                    tracing::error!("{why}");
                    Ok(worst)
                }
                _ => Err(Error::Worker(why)),
            };
        }
        tracing::error!("the worker crashed ({status}) and is started again");
    }
}

/// Starts a worker, and waits until it ends.
fn run_worker(folder: &Path, stop: &AtomicBool) -> Result<ExitStatus> {
    let mut worker = Command::new(program()?)
        .args(std::env::args_os().skip(1))
        .env(FOLDER, folder)
        .stdin(Stdio::piped())
        .spawn()?;
    let mut asked = false;
    loop {
        if let Some(status) = worker.try_wait()? {
            return Ok(status);
        }
        if stop.load(Ordering::Relaxed) && !std::mem::replace(&mut asked, true) {
            ask_to_end(&mut worker);
        }
        std::thread::sleep(LOOK);
    }
}

/// Returns the program of this process, also if its file was replaced or deleted meanwhile.
fn program() -> Result<PathBuf> {
    match cfg!(target_os = "linux") {
        true => Ok("/proc/self/exe".into()),
        false => Ok(std::env::current_exe()?),
    }
}

/// Asks a worker to end. Its input stays open: the end of the input would end it at once.
fn ask_to_end(worker: &mut Child) {
    if let Some(input) = &mut worker.stdin {
        // If the worker has ended meanwhile, nobody reads this.
        let _ = input.write_all(b"\n");
    }
}

/// A folder of this process, which no other user can read. It is removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn create() -> Result<Folder> {
        let mut builder = std::fs::DirBuilder::new();
        #[cfg(unix)]
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
        let id = std::process::id();
        for attempt in 0.. {
            let path = std::env::temp_dir().join(format!("linkwatch-{id}-{attempt}"));
            match builder.create(&path) {
                Ok(()) => return Ok(Folder(path)),
                // Of an earlier process with the same id that was killed.
                Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists && attempt < 100 => {}
                Err(source) => return Err(Error::File { path, source }),
            }
        }
        unreachable!("the last attempt returns")
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        remove(&self.0);
    }
}

fn remove(folder: &Path) {
    if let Err(e) = std::fs::remove_dir_all(folder) {
        tracing::warn!("{}: {e}", folder.display());
    }
}
