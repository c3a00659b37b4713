//! `--state FILE`: the state of a watch, from which the next process continues.
//!
//! There are two files. FILE has a note of fixed size, which is written before and after each
//! frame. FILE.session has the session: it is replaced before the verdict on a frame that changed
//! the baseline, after a signal, and else at most once a second, in a thread of its own. Both are
//! removed when the watch ends by itself.

use crate::cli::Outcome;
use crate::cli::run::RunState;
use linkwatch::{Error, Report, Result, SidecarState};
use serde::{Deserialize, Serialize};
use std::fs::{File, TryLockError};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// First bytes of a note. They change with its format.
const MAGIC: &[u8; 8] = b"LWSTATE5";

/// Number of bytes of a note in its file. The rest is zero.
const NOTE_BYTES: usize = 256;

/// Least time between two states of a session with the same baseline.
const INTERVAL: Duration = Duration::from_secs(1);

/// Reason why the first frame after a crash is undecided if pull-throughs are searched for.
const CRASHED: &str =
    "the watch crashed and was started again, so pull-throughs before this frame are unknown";

/// Reason why the first frame after a restart by a signal is undecided if pull-throughs are
/// searched for.
const STOPPED: &str =
    "the watch was stopped and started again, so pull-throughs before this frame are unknown";

/// Note of a watch.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Note {
    /// Fingerprint of the settings on which verdicts depend.
    settings: u64,
    /// The simulator that is watched, once it has sent a frame.
    simulator: Option<SidecarState>,
    /// Number and time of the frame that is being verified.
    in_hand: Option<(u64, f64)>,
    /// Number of the last verified frame.
    verified: Option<u64>,
    /// Number of cuts before the last frame that was begun.
    cuts: u32,
    /// Last frame that is known to be intact.
    last_intact: Option<u64>,
    /// Worst outcome so far, including the earlier processes.
    pub outcome: Outcome,
    /// True if a signal stopped the watch.
    stopped: bool,
    /// Number of processes before this one that were stopped or crashed.
    pub restarts: u64,
    /// Number of simulators so far, and the number in the names of the last files; 0 if there are
    /// none.
    pub sessions: u64,
    pub file_number: u64,
}

/// A session that an earlier process watched.
pub struct Earlier {
    /// `None` if no frame was verified.
    pub run: Option<RunState>,
    /// Frame that was being verified.
    pub in_hand: Option<(u64, f64)>,
}

/// State of the watch of one service. Without `--state` nothing is written.
#[derive(Default)]
pub struct State {
    files: Option<Files>,
    pub note: Note,
    /// Note of the earlier process, until its session was continued.
    earlier: Option<Note>,
}

struct Files {
    path: PathBuf,
    note: File,
    session: PathBuf,
    written: Instant,
    /// `None` until a state is written from time to time.
    writer: Option<Writer>,
}

impl State {
    /// Opens the files of a service, and reads what an earlier process left there. `settings` are
    /// those on which verdicts depend.
    ///
    /// # Errors
    ///
    /// The file is something else, is of a watch with other settings, or cannot be read or
    /// written.
    pub fn open(path: Option<&Path>, settings: &str) -> Result<State> {
        let Some(path) = path else {
            return Ok(State::default());
        };
        let mut options = File::options();
        let options = options.read(true).write(true).create(true).truncate(false);
        let mut file = options.open(path).map_err(|e| unusable(path, e))?;
        file.try_lock().map_err(|e| match e {
            TryLockError::WouldBlock => unusable(path, "another `linkwatch watch` has locked it"),
            TryLockError::Error(e) => unusable(path, e),
        })?;
        let earlier = read_note(path, &mut file)?;
        let mut fingerprint = DefaultHasher::new();
        settings.hash(&mut fingerprint);
        let settings = fingerprint.finish();
        let differs = |note: &Note| note.settings != settings;
        if earlier.as_ref().is_some_and(differs) {
            let why = "it is of a watch with other settings (--baseline, --events, ..) or of \
                       another version of linkwatch: give the same ones, or remove it to start \
                       with a new baseline";
            return Err(unusable(path, why));
        }
        let files = Some(Files {
            path: path.to_owned(),
            note: file,
            session: path.with_added_extension("session"),
            written: Instant::now(),
            writer: None,
        });
        let mut note = earlier.clone().unwrap_or_default();
        note.settings = settings;
        note.stopped = false;
        note.restarts += u64::from(earlier.is_some());
        // Frames may have been published while no watch was running.
        let missed = Outcome::undecided_if(note.simulator.is_some());
        note.outcome = note.outcome.max(missed);
        let mut state = State {
            files,
            note,
            earlier,
        };
        state.write()?;
        Ok(state)
    }

    /// Returns the simulator that an earlier process watched when it ended.
    pub fn interrupted(&self) -> Option<SidecarState> {
        self.earlier.as_ref()?.simulator
    }

    /// Begins a session. Returns the state of the earlier process if it watched the same simulator.
    ///
    /// # Errors
    ///
    /// The session cannot be read.
    pub fn begin_session(&mut self, session: u64, number: u64) -> Result<Option<Earlier>> {
        self.note.sessions = number;
        let same = |note: &Note| note.simulator.is_some_and(|s| s.session() == session);
        if let (Some(note), Some(files)) = (self.earlier.take().filter(same), &self.files) {
            let mut run: Option<RunState> = read_session(&files.session)?;
            let (cuts, last_intact, last) = (note.cuts, note.last_intact, note.verified);
            if let Some(run) = run.as_mut().filter(|run| !run.is_after(last, cuts)) {
                let why = if note.stopped { STOPPED } else { CRASHED };
                let intact = last.is_some() && last_intact == last;
                let session = std::mem::take(&mut run.session);
                run.session = session.after_unknown_frames(cuts, last_intact, intact, why.into());
            }
            let in_hand = note.in_hand;
            return Ok(Some(Earlier { run, in_hand }));
        }
        self.end_session(Outcome::Fine)?;
        Ok(None)
    }

    /// Notes the number in the names of the files that come next.
    pub fn begin_files(&mut self, number: u64) -> Result<()> {
        self.note.file_number = number;
        self.write()
    }

    /// Notes a frame that will be verified.
    pub fn begin_frame(
        &mut self,
        simulator: Option<SidecarState>,
        seq: u64,
        time: f64,
        cuts: u32,
    ) -> Result<()> {
        self.note.simulator = simulator.or(self.note.simulator);
        self.note.in_hand = Some((seq, time));
        self.note.cuts = cuts;
        self.write()
    }

    /// Notes that the check of a frame was cancelled. `before` is the note before this frame.
    pub fn cancel_frame(&mut self, before: Note, simulator: Option<SidecarState>) -> Result<()> {
        if before.verified.is_some() {
            // The next process does not answer it: it did not crash this one.
            return self.end_frame(simulator, None, Outcome::Fine);
        }
        // It may be the baseline, so the next process verifies it.
        self.note = before;
        self.write()
    }

    /// Notes that the frame was answered or skipped. `verified` is the report, unless it was
    /// rejected or skipped.
    pub fn end_frame(
        &mut self,
        simulator: Option<SidecarState>,
        verified: Option<&Report>,
        outcome: Outcome,
    ) -> Result<()> {
        let note = &mut self.note;
        note.simulator = simulator.or(note.simulator);
        note.in_hand = None;
        if let Some(report) = verified {
            (note.verified, note.last_intact) = (Some(report.seq), report.last_intact);
        }
        note.outcome = note.outcome.max(outcome);
        self.write()
    }

    /// Writes the state of the session before the verdict on a frame that changed the baseline.
    pub fn keep(&mut self, run: impl FnOnce() -> RunState) -> Result<()> {
        let Some(files) = &mut self.files else {
            return Ok(());
        };
        // An older state must not replace this one.
        if let Some(writer) = files.writer.take() {
            writer.finish();
        }
        files.written = Instant::now();
        write_session(&files.session, &run())
    }

    /// Writes the state of the session, if the last one is old. Does not wait.
    pub fn keep_from_time_to_time(&mut self, run: impl FnOnce() -> RunState) -> Result<()> {
        let Some(files) = &mut self.files else {
            return Ok(());
        };
        if files.written.elapsed() < INTERVAL {
            return Ok(());
        }
        let writer = match &mut files.writer {
            Some(writer) => writer,
            none => none.insert(Writer::start(&files.session)?),
        };
        if writer.to.try_send(run()).is_ok() {
            files.written = Instant::now();
        }
        Ok(())
    }

    /// Notes that the session has ended.
    pub fn end_session(&mut self, outcome: Outcome) -> Result<()> {
        self.note.simulator = None;
        self.note.in_hand = None;
        (self.note.verified, self.note.last_intact) = (None, None);
        self.note.outcome = self.note.outcome.max(outcome);
        self.write()?;
        if let Some(files) = &mut self.files {
            files.remove_session();
        }
        Ok(())
    }

    /// Notes that a signal stopped the watch, so that the next process continues it.
    pub fn stop(&mut self, outcome: Outcome) -> Result<()> {
        self.note.stopped = true;
        self.note.outcome = self.note.outcome.max(outcome);
        self.write()
    }

    /// Removes the files: the watch has ended, and no process continues it.
    pub fn end(&mut self) -> Result<()> {
        let Some(mut files) = self.files.take() else {
            return Ok(());
        };
        // Still there if the simulator of an earlier process did not come again.
        files.remove_session();
        std::fs::remove_file(&files.path).map_err(|e| unusable(&files.path, e))
    }

    fn write(&mut self) -> Result<()> {
        let Some(Files { note, .. }) = &mut self.files else {
            return Ok(());
        };
        let mut padded = MAGIC.to_vec();
        padded.extend(bytes(&self.note));
        assert!(padded.len() <= NOTE_BYTES, "a note has a bounded size");
        padded.resize(NOTE_BYTES, 0);
        note.rewind()?;
        // One call of the system, which a kill does not divide.
        note.write_all(&padded)?;
        Ok(())
    }
}

impl Files {
    /// Removes the state of the session.
    fn remove_session(&mut self) {
        if let Some(writer) = self.writer.take() {
            writer.finish();
        }
        // Absent if no frame was verified.
        let _ = std::fs::remove_file(&self.session);
        // Left by a process that was killed while it wrote.
        let _ = std::fs::remove_file(part_of(&self.session));
    }
}

/// Thread that writes states of a session, one at a time.
struct Writer {
    to: SyncSender<RunState>,
    thread: JoinHandle<()>,
}

impl Writer {
    fn start(path: &Path) -> Result<Writer> {
        // A state is accepted only if the thread waits for one.
        let (to, states) = sync_channel::<RunState>(0);
        let path = path.to_owned();
        let write = move || {
            for state in states {
                if let Err(e) = write_session(&path, &state) {
                    tracing::error!("{e}");
                }
            }
        };
        let thread = std::thread::Builder::new().name("linkwatch-state".into());
        let thread = thread.spawn(write)?;
        Ok(Writer { to, thread })
    }

    /// Waits until the last state is written.
    fn finish(self) {
        drop(self.to);
        // The panic hook has reported a panic.
        let _ = self.thread.join();
    }
}

/// Writes the state of a session. A process that is killed leaves the old or the new one.
fn write_session(path: &Path, state: &RunState) -> Result<()> {
    let part = part_of(path);
    let written = std::fs::write(&part, bytes(state));
    let written = written.and_then(|()| std::fs::rename(&part, path));
    written.map_err(|e| unusable(path, e))
}

/// Returns the file to which the state of a session is written before it replaces the last one.
fn part_of(session: &Path) -> PathBuf {
    session.with_extension("part")
}

/// Reads the state of a session; `None` if there is none.
fn read_session(path: &Path) -> Result<Option<RunState>> {
    let content = match std::fs::read(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        content => content.map_err(|e| unusable(path, e))?,
    };
    let state = postcard::from_bytes(&content);
    state.map(Some).map_err(|e| unusable(path, e))
}

/// Reads the progress note of a watch; `None` if the file is empty.
fn read_note(path: &Path, file: &mut File) -> Result<Option<Note>> {
    let mut content = Vec::new();
    let read = file.take(NOTE_BYTES as u64).read_to_end(&mut content);
    read.map_err(|e| unusable(path, e))?;
    if content.is_empty() {
        return Ok(None);
    }
    let other = "it is not the state of a watch of this version of linkwatch";
    let note = content
        .strip_prefix(MAGIC)
        .ok_or_else(|| unusable(path, other))?;
    let note = postcard::take_from_bytes(note).map_err(|e| unusable(path, e))?;
    Ok(Some(note.0))
}

fn bytes(value: &impl Serialize) -> Vec<u8> {
    postcard::to_stdvec(value).expect("plain data that fits into memory")
}

fn unusable(path: &Path, why: impl std::fmt::Display) -> Error {
    let path = path.display();
    let what = "the state of the watch cannot be used";
    Error::State(format!("{what}: {path}: {why}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn simulator(session: u64) -> SidecarState {
        let json = serde_json::json!({
            "session": session, "last": 7,
            "counters": { "verified": 8, "skipped": 0, "rejected": 0 },
        });
        serde_json::from_value(json).unwrap()
    }

    #[test]
    fn the_next_process_finds_the_session_and_the_frame_in_hand() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("watch.state");
        let open = || State::open(Some(&path), "").unwrap();
        let mut first = open();
        assert_eq!(
            (first.note.outcome, first.note.file_number),
            (Outcome::Fine, 0)
        );
        first.begin_files(1).unwrap();
        assert!(first.begin_session(5, 1).unwrap().is_none());
        first.keep(RunState::default).unwrap();
        first
            .begin_frame(Some(simulator(5)), 7, 0.7, u32::MAX)
            .unwrap();

        drop(first);
        let mut second = open();
        assert_eq!(second.note.outcome, Outcome::Undecided);
        assert_eq!((second.note.sessions, second.note.file_number), (1, 1));
        assert_eq!(second.interrupted(), Some(simulator(5)));
        let earlier = second.begin_session(5, 1).unwrap().unwrap();
        assert_eq!(earlier.in_hand, Some((7, 0.7)));
        assert!(earlier.run.is_some());
        second.begin_files(2).unwrap();
        drop(second);

        // Another simulator has a baseline of its own.
        assert!(open().begin_session(6, 2).unwrap().is_none());
        assert!(!folder.path().join("watch.state.session").exists());
        let mut third = open();
        assert_eq!((third.note.sessions, third.note.restarts), (2, 3));
        third.end_session(Outcome::Changed).unwrap();
        let e = State::open(Some(&path), "").err().unwrap().to_string();
        assert!(e.contains("another `linkwatch watch` has locked it"), "{e}");
        drop(third);
        let e = State::open(Some(&path), "--events=off").err().unwrap();
        assert!(e.to_string().contains("other settings"), "{e}");
        let mut fourth = open();
        assert_eq!(fourth.note.outcome, Outcome::Changed);
        fourth.end().unwrap();
        assert!(!path.exists());
    }

    #[test]
    fn a_damaged_state_is_an_error_and_not_a_new_baseline() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("watch.state");
        let mut first = State::open(Some(&path), "").unwrap();
        first.begin_session(5, 1).unwrap();
        first.keep(RunState::default).unwrap();
        first.begin_frame(Some(simulator(5)), 7, 0.7, 0).unwrap();
        drop(first);
        let session = folder.path().join("watch.state.session");
        let whole = std::fs::read(&session).unwrap();
        std::fs::write(&session, &whole[..whole.len() - 1]).unwrap();
        let mut second = State::open(Some(&path), "").unwrap();
        let e = second.begin_session(5, 1).err().unwrap().to_string();
        assert!(e.contains("cannot be used"), "{e}");
    }

    #[test]
    fn a_file_of_something_else_is_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notes.txt");
        std::fs::write(&path, "my notes").unwrap();
        let e = State::open(Some(&path), "").err().unwrap().to_string();
        assert!(e.contains("not the state of a watch"), "{e}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "my notes");
    }
}
