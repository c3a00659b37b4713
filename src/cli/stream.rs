//! Standard output and standard error. Either may be full, closed, or a pipe without a reader.
//!
//! A failed write is not an error of the command: the work continues, and lost lines are counted. A
//! write may also block without limit. Therefore `watch` and `replay` detach both streams: from
//! then on, text waits in a bounded queue for a thread that writes it, with the same [`Overflow`]
//! policy as a sink.

use linkwatch::Overflow;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, LazyLock, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Maximum number of bytes of text that wait for the thread, so that a slow pager loses nothing for
/// a while.
const WAITING_BYTES: usize = 16 << 20;

/// Interval at which a write to a non-blocking pipe is retried.
const AGAIN: Duration = Duration::from_millis(10);

/// Erases the status line. The cursor is at its end.
const ERASE: &str = "\r\x1b[2K";

/// Reason reported for text that is discarded because no program reads the stream.
const UNREAD: &str = "no program reads it";

/// Destination of a text.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Target {
    Out,
    Err,
}

/// Results that were lost, and the reason.
#[derive(Clone, Default)]
pub struct Lost {
    pub lines: u64,
    pub why: String,
}

struct Text {
    target: Target,
    bytes: Vec<u8>,
}

impl Text {
    /// Returns the number of its lines, if they are results.
    fn lines(&self) -> u64 {
        match self.target {
            Target::Out => self.bytes.iter().filter(|&&b| b == b'\n').count() as u64,
            Target::Err => 0,
        }
    }
}

/// A stream, and the thread that writes it after it was detached.
#[derive(Default)]
pub struct Stream {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Text>,
    bytes: usize,
    /// Lines of results that the thread is writing, if it is.
    writing: Option<u64>,
    /// `None` until the stream is detached.
    overflow: Option<Overflow>,
    patience: Duration,
    lost: Lost,
    /// Status line of the terminal, and the one that it shows.
    status: String,
    shown: String,
}

/// Standard output and standard error. If both are terminals, they are the same one, so all text
/// goes through standard error, which keeps it in order.
static OUT: LazyLock<Stream> = LazyLock::new(Stream::default);
static ERR: LazyLock<Stream> = LazyLock::new(Stream::default);

/// Returns true if stderr is a terminal.
pub fn is_terminal() -> bool {
    static IS: LazyLock<bool> = LazyLock::new(|| io::stderr().is_terminal());
    *IS
}

fn stream_of(target: Target) -> &'static Stream {
    static SAME: LazyLock<bool> = LazyLock::new(|| is_terminal() && io::stdout().is_terminal());
    match target {
        Target::Out if !*SAME => &OUT,
        _ => &ERR,
    }
}

/// Writes a text of complete lines, or passes it to the writer thread.
pub fn put(target: Target, bytes: Vec<u8>) {
    let (stream, text) = (stream_of(target), Text { target, bytes });
    let mut state = stream.lock();
    let Some(overflow) = state.overflow else {
        let status = state.status.clone();
        let outcome = show(&text, &status, &mut state.shown);
        return state.note(text.lines(), outcome);
    };
    let start = Instant::now();
    let full = |s: &State| s.bytes >= WAITING_BYTES;
    // Log messages never block.
    let patience = match target {
        Target::Out => state.patience,
        Target::Err => Duration::ZERO,
    };
    state = stream.wait_while(state, patience, full);
    let full = full(&state);
    if target == Target::Out {
        state.patience = match overflow {
            _ if full => Duration::ZERO,
            Overflow::Wait(_) => state.patience.saturating_sub(start.elapsed()),
            _ => state.patience,
        };
    }
    if full {
        return state.lose(text.lines(), UNREAD.to_owned());
    }
    state.push(text);
    stream.changed.notify_all();
}

/// Replaces the status line if stderr is a terminal.
pub fn status(text: String) {
    let mut state = ERR.lock();
    if !is_terminal() {
        return;
    }
    state.status = text;
    let (target, bytes) = (Target::Err, Vec::new());
    let text = Text { target, bytes };
    if state.overflow.is_none() {
        let shown = state.status.clone();
        show(&text, &shown, &mut state.shown).ok();
    } else if state.waiting.is_empty() {
        // If the terminal is slow, it shows the newest status with the next text.
        state.push(text);
        ERR.changed.notify_all();
    }
}

/// Starts a writer thread for each stream.
pub fn detach(overflow: Overflow) -> io::Result<()> {
    for stream in [&*OUT, &*ERR] {
        let mut state = stream.lock();
        if state.overflow.replace(overflow).is_none() {
            state.patience = overflow.max_wait();
            let thread = std::thread::Builder::new().name("linkwatch-output".into());
            thread.spawn(|| stream.work())?;
        }
    }
    Ok(())
}

/// Waits until a stream is written, as long as it makes progress within `limit`. Text that is still
/// waiting after that is lost.
pub fn finish(target: Target, limit: Duration) -> Option<Lost> {
    let stream = stream_of(target);
    let mut state = stream.lock();
    loop {
        let before = state.waiting.len();
        let same = |s: &State| s.is_busy() && s.waiting.len() == before;
        state = stream.wait_while(state, limit, same);
        if !state.is_busy() || state.waiting.len() == before {
            break;
        }
    }
    if state.is_busy() {
        let waiting: u64 = state.waiting.iter().map(Text::lines).sum();
        let lines = state.writing.unwrap_or(0) + waiting;
        state.waiting.clear();
        state.lose(lines, UNREAD.to_owned());
    }
    Some(state.lost.clone()).filter(|lost| lost.lines > 0)
}

impl Stream {
    /// Locks the state. The state is plain data that is valid at every step, so a panic elsewhere
    /// does not invalidate it.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits while a condition holds, at most for `limit`.
    fn wait_while<'a>(
        &'a self,
        state: MutexGuard<'a, State>,
        limit: Duration,
        holds: impl Fn(&State) -> bool,
    ) -> MutexGuard<'a, State> {
        let wait = self.changed.wait_timeout_while(state, limit, |s| holds(s));
        wait.unwrap_or_else(PoisonError::into_inner).0
    }

    /// Writes texts as they arrive, for the lifetime of the process.
    fn work(&self) {
        let mut shown = String::new();
        loop {
            let idle = |s: &State| s.waiting.is_empty();
            let mut state = self.wait_while(self.lock(), Duration::MAX, idle);
            let Some(text) = state.waiting.pop_front() else {
                continue;
            };
            state.bytes -= text.bytes.len();
            state.writing = Some(text.lines());
            let status = state.status.clone();
            drop(state);
            let outcome = show(&text, &status, &mut shown);
            let mut state = self.lock();
            state.writing = None;
            state.note(text.lines(), outcome);
            let overflow = state.overflow.unwrap_or(Overflow::DropOldest);
            if state.waiting.is_empty() || !matches!(overflow, Overflow::Wait(_)) {
                state.patience = overflow.max_wait();
            }
            drop(state);
            self.changed.notify_all();
        }
    }
}

impl State {
    fn push(&mut self, text: Text) {
        self.bytes += text.bytes.len();
        self.waiting.push_back(text);
    }

    fn is_busy(&self) -> bool {
        self.writing.is_some() || !self.waiting.is_empty()
    }

    fn note(&mut self, lines: u64, outcome: io::Result<()>) {
        // A reader that closed the pipe (`linkwatch .. | head`) does not need the rest.
        if let Err(e) = outcome
            && e.kind() != ErrorKind::BrokenPipe
        {
            self.lose(lines, e.to_string());
        }
    }

    fn lose(&mut self, lines: u64, why: String) {
        if lines > 0 {
            self.lost.lines += lines;
            self.lost.why = why;
        }
    }
}

/// Writes a text and then redraws the status line.
fn show(text: &Text, status: &str, shown: &mut String) -> io::Result<()> {
    if shown == status && (shown.is_empty() || text.bytes.is_empty()) {
        return write(text.target, &text.bytes);
    }
    write(Target::Err, ERASE.as_bytes()).ok();
    let outcome = write(text.target, &text.bytes);
    // Turns line wrap off, because a wrapped status line could not be erased.
    let line = format!("\x1b[?7l{status}\x1b[?7h");
    write(Target::Err, line.as_bytes()).ok();
    status.clone_into(shown);
    outcome
}

/// Writes all bytes, retrying if the stream would block.
fn write(target: Target, mut bytes: &[u8]) -> io::Result<()> {
    static FILES: [LazyLock<io::Result<File>>; 2] = [
        LazyLock::new(|| file(&io::stdout())),
        LazyLock::new(|| file(&io::stderr())),
    ];
    // True if an error left an incomplete line, so that the next text starts on a new line.
    static TORN: [AtomicBool; 2] = [AtomicBool::new(false), AtomicBool::new(false)];
    let torn = &TORN[target as usize];
    let mut file = match &*FILES[target as usize] {
        Ok(file) => file,
        Err(e) => return Err(e.kind().into()),
    };
    if torn.load(Ordering::Relaxed) {
        file.write_all(b"\n")?;
        torn.store(false, Ordering::Relaxed);
    }
    let length = bytes.len();
    while !bytes.is_empty() {
        match file.write(bytes) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(n) => bytes = &bytes[n..],
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) if e.kind() == ErrorKind::WouldBlock => std::thread::sleep(AGAIN),
            Err(e) => {
                torn.store(bytes.len() < length, Ordering::Relaxed);
                return Err(e);
            }
        }
    }
    Ok(())
}

/// Opens the stream itself, without the buffer and the lock of the standard library, because a
/// thread that holds that lock may block without limit.
#[cfg(unix)]
fn file(stream: &impl std::os::fd::AsFd) -> io::Result<File> {
    stream.as_fd().try_clone_to_owned().map(File::from)
}

#[cfg(windows)]
fn file(stream: &impl std::os::windows::io::AsHandle) -> io::Result<File> {
    stream.as_handle().try_clone_to_owned().map(File::from)
}
