//! What a worker notes about its frames, so that the next worker can go on after a crash.

use crate::cli::Outcome;
use crate::cli::session::Expected;
use linkwatch::{Error, Intactness, Result, SessionState};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

/// Number of bytes of a note in its file. The rest is zero.
const NOTE_BYTES: usize = 256;

/// Note of a worker, written before and after each frame.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Note {
    /// The session that is watched, once it has a frame.
    state: Option<SessionState>,
    /// Sequence number and time of the frame that is being verified.
    in_hand: Option<(u64, f64)>,
    /// Number of cuts before the last frame.
    cuts: u32,
    intactness: Intactness,
    /// Worst outcome so far.
    outcome: Outcome,
    /// Number of frames that were answered.
    answered: u64,
    /// Number of workers that crashed.
    crashes: u64,
    /// Number of sessions that have begun, and the number in the names of the last files.
    sessions: u64,
    file_number: u64,
}

/// State of a session at the crash of the worker that watched it.
#[derive(Clone, Debug)]
pub struct Earlier {
    /// `None` if no frame was verified.
    pub expected: Option<Expected>,
    pub in_hand: Option<(u64, f64)>,
    pub cuts: u32,
    pub intactness: Intactness,
}

/// Journal of a worker about one service. Without a supervisor nothing is written.
pub struct Journal {
    files: Option<Files>,
    note: Note,
    /// Note of the worker that crashed, until its session was continued.
    earlier: Option<Note>,
}

struct Files {
    folder: PathBuf,
    note: File,
}

impl Files {
    /// Returns the file of the expected linking numbers of a session.
    fn expected(&self, session: u64) -> PathBuf {
        self.folder.join(format!("{session}.expected"))
    }
}

impl Journal {
    /// Opens the journal of a service, given by its index, and reads what an earlier worker noted.
    pub fn open(folder: Option<&Path>, service: usize) -> Result<Journal> {
        let Some(folder) = folder else {
            return Ok(Journal {
                files: None,
                note: Note::default(),
                earlier: None,
            });
        };
        let path = note_path(folder, service);
        let earlier = read_note(&path)?;
        let mut options = File::options();
        let note = options.write(true).create(true).truncate(false).open(&path);
        Ok(Journal {
            files: Some(Files {
                folder: folder.to_owned(),
                note: note.map_err(|source| Error::File { path, source })?,
            }),
            note: match earlier.clone() {
                Some(note) => Note {
                    crashes: note.crashes + 1,
                    ..note
                },
                None => Note::default(),
            },
            earlier,
        })
    }

    /// Returns the worst outcome of the earlier workers.
    pub fn outcome(&self) -> Outcome {
        match &self.earlier {
            // Frames may have been published while there was no worker.
            Some(note) if note.state.is_some() => note.outcome.max(Outcome::Undecided),
            Some(note) => note.outcome,
            None => Outcome::Fine,
        }
    }

    /// Returns true if there was an earlier worker.
    pub fn is_restart(&self) -> bool {
        self.earlier.is_some()
    }

    /// Returns the number of workers that crashed before this one.
    pub fn crashes(&self) -> u64 {
        self.note.crashes
    }

    /// Returns the number of sessions that began before this worker.
    pub fn sessions(&self) -> u64 {
        self.note.sessions
    }

    /// Returns the number in the names of the last files of the earlier workers; 0 if there was no
    /// worker.
    pub fn file_number(&self) -> u64 {
        self.note.file_number
    }

    /// Returns the session that an earlier worker watched when it crashed.
    pub fn interrupted(&self) -> Option<SessionState> {
        self.earlier.as_ref()?.state
    }

    /// Begins a session. Returns the state of the earlier worker if it watched the same one.
    ///
    /// Errors: its expected linking numbers cannot be read.
    pub fn begin_session(&mut self, session: u64, number: u64) -> Result<Option<Earlier>> {
        self.note.sessions = number;
        let earlier = self.earlier.take();
        let same = |note: &Note| note.state.is_some_and(|state| state.session() == session);
        if let Some(note) = earlier.filter(same) {
            let path = self.files.as_ref().map(|files| files.expected(session));
            return Ok(Some(Earlier {
                expected: path.map(|path| read(&path)).transpose()?.flatten(),
                in_hand: note.in_hand,
                cuts: note.cuts,
                intactness: note.intactness,
            }));
        }
        self.end_session(Outcome::Fine)?;
        self.note.intactness = Intactness::default();
        self.write()?;
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
        state: Option<SessionState>,
        (seq, time): (u64, f64),
        cuts: u32,
    ) -> Result<()> {
        self.note.state = state.or(self.note.state);
        self.note.in_hand = Some((seq, time));
        self.note.cuts = cuts;
        self.write()
    }

    /// Notes that the frame was verified or rejected, and answered.
    pub fn end_frame(
        &mut self,
        state: Option<SessionState>,
        intactness: Intactness,
        outcome: Outcome,
    ) -> Result<()> {
        self.note.answered += 1;
        self.give_up_frame(state, intactness, outcome)
    }

    /// Notes that the frame was answered without being verified.
    pub fn give_up_frame(
        &mut self,
        state: Option<SessionState>,
        intactness: Intactness,
        outcome: Outcome,
    ) -> Result<()> {
        self.note.state = state.or(self.note.state);
        self.note.in_hand = None;
        self.note.intactness = intactness;
        self.note.outcome = self.note.outcome.max(outcome);
        self.write()
    }

    /// Notes that the session has ended.
    pub fn end_session(&mut self, outcome: Outcome) -> Result<()> {
        let state = self.note.state.take();
        self.note.in_hand = None;
        self.note.outcome = self.note.outcome.max(outcome);
        self.write()?;
        if let (Some(files), Some(state)) = (&self.files, state) {
            // Absent if no frame was verified.
            let _ = std::fs::remove_file(files.expected(state.session()));
        }
        Ok(())
    }

    /// Returns true if a supervisor may start another worker.
    pub fn is_kept(&self) -> bool {
        self.files.is_some()
    }

    /// Keeps the expected linking numbers of a session.
    pub fn keep(&mut self, session: u64, expected: &Expected) -> Result<()> {
        let Some(files) = &self.files else {
            return Ok(());
        };
        let path = &files.expected(session);
        // Under another name first, so that a crash leaves the old or the new ones.
        let part = path.with_extension("part");
        let written = std::fs::write(&part, bytes(expected));
        let written = written.and_then(|()| std::fs::rename(&part, path));
        written.map_err(|e| unreadable(path, e))
    }

    fn write(&mut self) -> Result<()> {
        let Some(Files { note, .. }) = &mut self.files else {
            return Ok(());
        };
        let mut padded = bytes(&self.note);
        assert!(padded.len() <= NOTE_BYTES, "a note has a bounded size");
        padded.resize(NOTE_BYTES, 0);
        note.rewind()?;
        // One call of the system, which a kill does not divide.
        note.write_all(&padded)?;
        Ok(())
    }
}

/// Returns the worst outcome that workers have noted for any of the services, and the number of
/// frames that they have answered.
pub fn results(folder: &Path, services: usize) -> (Outcome, u64) {
    let note = |k| read_note(&note_path(folder, k)).ok().flatten();
    let notes: Vec<Note> = (0..services).filter_map(note).collect();
    let worst = notes.iter().map(|note| note.outcome).max();
    let answered = notes.iter().map(|note| note.answered).sum();
    (worst.unwrap_or(Outcome::Fine), answered)
}

fn note_path(folder: &Path, service: usize) -> PathBuf {
    folder.join(format!("{service}.note"))
}

/// Reads a note, if the file has one.
fn read_note(path: &Path) -> Result<Option<Note>> {
    let empty = std::fs::metadata(path).map_or(true, |m| m.len() == 0);
    if empty { Ok(None) } else { read(path) }
}

fn bytes(value: &impl Serialize) -> Vec<u8> {
    postcard::to_stdvec(value).expect("plain data that fits into memory")
}

/// Reads a value; `None` if there is no file.
fn read<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    let mut content = Vec::new();
    match File::open(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(unreadable(path, e)),
        Ok(mut file) => file
            .read_to_end(&mut content)
            .map_err(|e| unreadable(path, e))?,
    };
    let value = postcard::take_from_bytes(&content);
    value
        .map(|(value, _)| Some(value))
        .map_err(|e| unreadable(path, e))
}

fn unreadable(path: &Path, why: impl std::fmt::Display) -> Error {
    Error::Worker(format!(
        "the state of the watch is lost, so that the session cannot be continued: {}: {why}",
        path.display()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use linkwatch::{Certificate, CurveLabels};

    fn expected() -> Expected {
        Expected {
            baseline: Certificate {
                curves: 2,
                ..Certificate::default()
            },
            origin: None,
            layout: 1,
            labels: CurveLabels::named(["a", "b"]).with_radii([0.5; 2]),
            baseline_frame: 0,
        }
    }

    fn state(session: u64) -> SessionState {
        let json = serde_json::json!({
            "session": session, "last": 7,
            "counters": { "verified": 8, "skipped": 0, "rejected": 0 },
        });
        serde_json::from_value(json).unwrap()
    }

    #[test]
    fn the_next_worker_finds_the_session_and_the_frame_in_hand() {
        let folder = tempfile::tempdir().unwrap();
        let open = || Journal::open(Some(folder.path()), 0).unwrap();
        let mut first = open();
        assert_eq!((first.outcome(), first.file_number()), (Outcome::Fine, 0));
        first.begin_files(1).unwrap();
        assert!(first.begin_session(5, 1).unwrap().is_none());
        first.keep(5, &expected()).unwrap();
        first
            .begin_frame(Some(state(5)), (7, 0.7), u32::MAX)
            .unwrap();

        let mut second = open();
        assert_eq!(second.outcome(), Outcome::Undecided);
        assert_eq!((second.sessions(), second.file_number()), (1, 1));
        assert_eq!(second.interrupted(), Some(state(5)));
        let earlier = second.begin_session(5, 1).unwrap().unwrap();
        assert_eq!(earlier.in_hand, Some((7, 0.7)));
        assert_eq!(earlier.cuts, u32::MAX);
        assert_eq!(earlier.expected, Some(expected()));
        second.begin_files(2).unwrap();

        // Another simulator has a baseline of its own.
        assert!(open().begin_session(6, 2).unwrap().is_none());
        assert!(!folder.path().join("5.expected").exists());
        let mut third = open();
        assert_eq!((third.sessions(), third.crashes()), (2, 3));
        third.end_session(Outcome::Changed).unwrap();
        assert_eq!(open().outcome(), Outcome::Changed);
        assert_eq!(results(folder.path(), 2), (Outcome::Changed, 0));
    }

    #[test]
    fn damaged_expected_numbers_are_an_error_and_not_a_new_baseline() {
        let folder = tempfile::tempdir().unwrap();
        let open = || Journal::open(Some(folder.path()), 0).unwrap();
        let mut first = open();
        first.begin_session(5, 1).unwrap();
        first.keep(5, &expected()).unwrap();
        first.begin_frame(Some(state(5)), (7, 0.7), 0).unwrap();
        let path = folder.path().join("5.expected");
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 1]).unwrap();
        let e = open().begin_session(5, 1).unwrap_err().to_string();
        assert!(e.contains("cannot be continued"), "{e}");
    }
}
