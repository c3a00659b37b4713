//! Records all verdicts, and the curves of every N-th frame and around violations.
//!
//! A frame is held back until the next one arrives, because its curves are kept if that one is not
//! intact. A kill therefore loses the verdict on the last intact frame.

use super::files::Files;
use super::{Keep, Start, is_intact};
use crate::error::Result;
use crate::sinks::FrameRecord;
use std::num::NonZeroU64;

pub(super) struct Every {
    every: NonZeroU64,
    /// Number of frames with curves so far.
    seen: u64,
    /// Frames whose curves were recorded.
    recorded: u64,
    /// An intact frame whose curves are recorded only if the next one is not intact.
    held: Option<(FrameRecord, Start)>,
}

impl Every {
    pub fn new(every: NonZeroU64) -> Every {
        Every {
            every,
            seen: 0,
            recorded: 0,
            held: None,
        }
    }

    /// Writes the held frame, if there is one; without its curves unless `curves` is true.
    fn write_held(&mut self, files: &mut Files, curves: bool) -> Result<()> {
        let Some((mut record, start)) = self.held.take() else {
            return Ok(());
        };
        record.curves.take_if(|_| !curves);
        self.recorded += u64::from(record.curves.is_some());
        files.write(&record, &start)
    }
}

impl Keep for Every {
    fn frame(&mut self, files: &mut Files, record: &FrameRecord, start: Start) -> Result<()> {
        let is_intact = is_intact(record);
        self.write_held(files, !is_intact)?;
        let due = self.seen.is_multiple_of(self.every.get());
        self.seen += u64::from(record.curves.is_some());
        let kept = due || start.new || !is_intact;
        self.held = Some((record.clone(), start));
        match kept {
            true => self.write_held(files, true),
            false => Ok(()),
        }
    }

    fn end(&mut self, files: &mut Files) -> Result<()> {
        self.write_held(files, false)
    }

    fn note(&self, files: &Files) -> Option<String> {
        let frames = files.frames + u64::from(self.held.is_some());
        let (recorded, every) = (self.recorded, self.every);
        let curves = format!("curves of {recorded} of {frames} frames (every {every})");
        Some(format!("recording: {curves}, verdicts of all"))
    }
}
