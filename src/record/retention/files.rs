//! Files of a recording: another one is begun before a file exceeds its maximum size.
//!
//! A file is not ended before a frame that is not intact or has other curves, if that is possible,
//! because a replay of such a frame needs the frame before it. Therefore a file may end when an
//! eighth of its size is left.
//!
//! Numbers of later files are not those of sessions and processes (`run-2.mcap`), so that no two of
//! them use the same name.

use super::super::file::is_taken;
use super::super::writer::RecordingSink;
use super::{CONTINUES, PART, RecordingOptions, Start};
use super::{answered, bytes_of_findings, is_intact, part_of};
use crate::error::Result;
use crate::sinks::{FrameRecord, Sink};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Number of names that are tried for a file.
pub(super) const NAMES: u64 = 10_000;

/// Creates a file with metadata. Fails if the name is taken.
pub(super) type Create =
    Box<dyn FnMut(&Path, &BTreeMap<String, String>) -> Result<RecordingSink> + Send>;

/// Files of a recording, of which one is open at a time.
pub(super) struct Files {
    options: RecordingOptions,
    create: Create,
    open: Option<Open>,
    /// Number in the name of the last file.
    number: u64,
    created: u64,
    last: Option<PathBuf>,
    /// True if the next frame does not continue the previous one.
    pub again: bool,
    /// Number of frames written.
    pub frames: u64,
}

/// The file that is being written.
struct Open {
    sink: RecordingSink,
    frames: u64,
    /// True if the baseline was written.
    begun: bool,
    /// Number of frames verified or rejected when the last frame was written.
    answered: u64,
}

impl Files {
    pub fn new(options: RecordingOptions) -> Files {
        let create: Create = match options.overwrite {
            true => Box::new(RecordingSink::create),
            false => Box::new(RecordingSink::create_new),
        };
        Files::created_by(options, create)
    }

    /// Returns files that a function creates.
    pub fn created_by(options: RecordingOptions, create: Create) -> Files {
        Files {
            options,
            create,
            open: None,
            number: 0,
            created: 0,
            last: None,
            again: false,
            frames: 0,
        }
    }

    /// Creates the first file. Unlike later ones, it has the name that the user chose, or fails.
    pub fn create_first(&mut self) -> Result<()> {
        self.number = 1;
        self.create()
    }

    /// Writes a frame; before it the baseline, if the frame does not continue the last one in the
    /// file.
    pub fn write(&mut self, record: &FrameRecord, start: &Start) -> Result<()> {
        let full = self.is_full(record, start);
        let full = self.open.take_if(|_| full);
        let created = match self.open {
            Some(_) => Ok(()),
            None => self.create_next(),
        };
        if let Some(mut full) = full {
            if created.is_ok() {
                full.sink.continue_in(self.last_name())?;
            }
            // The system writes its content to the disk; waiting for that could take seconds.
            full.sink.close()?;
        }
        created?;
        let again = std::mem::take(&mut self.again);
        let open = self.open.as_mut().expect("created above");
        let left_out = start.answered.saturating_sub(open.answered);
        open.sink.leave_out(left_out);
        if let Some(baseline) = &start.baseline {
            if !open.begun || left_out > 0 || again {
                open.sink.begin(baseline)?;
                open.begun = true;
            } else if start.other_baseline {
                open.sink.expect(baseline)?;
            }
        }
        open.sink.frame(record)?;
        open.answered = answered(record);
        open.frames += 1;
        self.frames += 1;
        Ok(())
    }

    pub fn cut_off(&mut self, why: &str) -> Result<()> {
        let open = self.open.as_mut();
        open.map_or(Ok(()), |open| open.sink.cut_off(why))
    }

    pub fn flush(&mut self) -> Result<()> {
        let open = self.open.as_mut();
        open.map_or(Ok(()), |open| open.sink.flush())
    }

    /// Ends the recording, and waits for the disk.
    pub fn finish(self) -> Result<()> {
        let open = self.open;
        open.map_or(Ok(()), |open| Box::new(open.sink).finish())
    }

    /// Returns the files as text, if there are several or the file has another name.
    pub fn note(&self) -> Option<String> {
        let last = self.last.as_ref().filter(|_| self.number > 1)?.display();
        Some(match self.created {
            1 => format!("recording: the file is {last}"),
            n => format!("recording: {n} files; the last one is {last}"),
        })
    }

    /// Returns true if another file must be begun for this frame, or should be.
    fn is_full(&self, record: &FrameRecord, start: &Start) -> bool {
        let Some((open, most)) = self.open.as_ref().zip(self.options.max_bytes) else {
            return false;
        };
        let bytes = open.sink.bytes().saturating_add(bytes_of(record, start));
        let may_end = is_intact(record) && !start.new;
        let full = bytes > most || bytes > most - most / 8 && may_end;
        full && open.frames > 0
    }

    /// Returns the name of the last file.
    fn last_name(&self) -> String {
        let name = self.last.as_ref().and_then(|last| last.file_name());
        name.unwrap_or_default().to_string_lossy().into()
    }

    /// Creates a file after the first one, under the next name that is free: an existing file is no
    /// reason to lose a recording that is hours old.
    fn create_next(&mut self) -> Result<()> {
        let last = self.number.saturating_add(NAMES);
        loop {
            self.number += 1;
            match self.create() {
                Ok(()) => {
                    if let Some(path) = self.last.as_ref().filter(|_| self.number > 1) {
                        tracing::info!("the recording continues in {}", path.display());
                    }
                    return Ok(());
                }
                Err(e) if !is_taken(&e) || self.number >= last => return Err(e),
                Err(e) if self.number == 1 => {
                    tracing::warn!("{e}; the recording gets another name");
                }
                Err(_) => {}
            }
        }
    }

    /// Creates the file of the current number.
    fn create(&mut self) -> Result<()> {
        let path = part_of(&self.options.path, self.number);
        let mut metadata = self.options.metadata.clone();
        if self.number > 1 {
            metadata.insert(PART.into(), self.number.to_string());
        }
        if self.last.is_some() {
            metadata.insert(CONTINUES.into(), self.last_name());
        }
        self.open = Some(Open {
            sink: (self.create)(&path, &metadata)?,
            frames: 0,
            begun: false,
            answered: 0,
        });
        self.created += 1;
        self.last = Some(path);
        Ok(())
    }
}

/// Returns an upper bound of the size of a frame in a file.
fn bytes_of(record: &FrameRecord, start: &Start) -> u64 {
    let curves = record.curves.as_ref().map_or(0, |set| {
        let positions = set.points() as u64 * 3 * set.precision().bytes() as u64;
        // Names and radii, which a new file repeats.
        let labels = &record.info.labels;
        let names: usize = labels.names.iter().map(|name| name.len() + 4).sum();
        positions + (5 * set.len() + names + 4 * labels.radii.len()) as u64
    });
    let certificate = start.baseline.as_ref().map(|b| &b.certificate);
    let entries = certificate.map_or(0, |c| {
        let images = c.images.as_ref().map_or(0, Vec::len);
        let invariants = c
            .higher
            .iter()
            .map(|of| of.numbers.len() + of.unknown.len());
        let invariants: usize = invariants.sum();
        c.links.len() + c.undefined.len() + 2 * images + c.periods.len() + 4 * invariants
    });
    curves + bytes_of_findings(&record.report) + 24 * entries as u64 + 2048
}
