//! Recordings, which `replay` and `play` read.

use super::input;
use super::range::Range;
use crate::record::{CONTINUED, CUT_OFF};
use crate::words::truncated;
use linkwatch::{Ending, Error, RecordedItem, RecordingReader, Result, formats};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// A recording, whose errors name the file.
pub struct Source {
    pub path: PathBuf,
    /// Its errors do not name the file.
    pub reader: RecordingReader<BufReader<File>>,
    /// True if a frame lacks elements of its file.
    pub lacks_curves: bool,
}

impl Source {
    /// Opens a recording, with a hint for an MCAP file of another program.
    pub fn open(path: &Path) -> Result<Source> {
        input::check_recording(path)?;
        Source::new(path)
    }

    /// Opens a file as a recording.
    pub fn new(path: &Path) -> Result<Source> {
        let open = |plain: &Path| RecordingReader::open(plain).map_err(|e| e.in_file(plain));
        Ok(Source {
            path: path.into(),
            reader: formats::unpacked(path, open)?,
            lacks_curves: false,
        })
    }

    /// Returns the next item, or `None` at the end.
    pub fn next(&mut self) -> Result<Option<RecordedItem>> {
        let item = self.reader.next_item();
        let item = item.map_err(|e| e.in_file(&self.path))?;
        if let Some(RecordedItem::Frame(frame)) = &item {
            self.lacks_curves |= !frame.info.left_out.is_empty();
        }
        Ok(item)
    }

    /// Goes to the first frame or verdict of a range. Returns the number of frames that were
    /// skipped; `None` if the recording has no frame.
    pub fn go_to_start(&mut self, range: &Range) -> Result<Option<usize>> {
        let in_file = |e: Error| e.in_file(&self.path);
        let outline = self.reader.outline().map_err(in_file)?;
        let Some(last) = outline.frames.len().checked_sub(1) else {
            return Ok(None);
        };
        let mut frames = outline.frames.iter();
        let found = frames.position(|f| !range.is_after(f.seq, f.time));
        let skipped = found.unwrap_or(last);
        let mut start = outline.frames[skipped].clone();
        let mut verdicts = outline.verdicts.iter();
        if found.is_none() {
            // At the end of the file. A last verdict may have no frame.
            let what = "no frame in this range; the last one of the recording is frame";
            tracing::warn!("{}: {what} {}", self.path.display(), start.seq);
        } else if let Some(verdict) = verdicts.find(|v| !range.is_after(v.seq, v.time))
            && verdict.is_before(&start)
        {
            start = verdict.with_baseline_of(&start);
        }
        self.reader.go_to(&start).map_err(in_file)?;
        Ok(Some(skipped))
    }
}

/// Warns, once it was read, of a recording that was cut off, and of one of a run without an end.
/// Also names the file in which the run continues.
/// Returns true if it is one.
pub fn warn_of_cut(source: &Source) -> bool {
    let path = source.path.display();
    if let Some(next) = source.reader.metadata().get(CONTINUED) {
        tracing::warn!("{path}: the run continues in {next}");
    }
    let why = source.reader.metadata().get(CUT_OFF);
    if let Some(why) = why {
        tracing::warn!("{path}: the run has no end: {why}");
    }
    let Some(Ending::Cut { at, what }) = source.reader.ending() else {
        return why.is_some();
    };
    let cut = truncated(*at, what);
    tracing::warn!("{path}: {cut}; the complete frames were replayed");
    true
}
