//! Records all verdicts, and the curves of every N-th frame and around violations.
//!
//! A frame is held back until the next one arrives, because its curves are kept if that one is not
//! intact. A kill therefore loses the verdict on the last intact frame.

use super::files::Files;
use super::{InForce, NAME, Start, is_intact};
use crate::error::Result;
use crate::sinks::{BaselineRecord, FrameRecord, Sink};
use std::num::NonZeroU64;

pub(super) struct Every {
    files: Files,
    state: InForce,
    every: NonZeroU64,
    /// Number of frames with curves so far.
    seen: u64,
    /// Frames whose curves were recorded.
    recorded: u64,
    /// An intact frame whose curves are recorded only if the next one is not intact.
    held: Option<(FrameRecord, Start)>,
}

impl Every {
    pub fn new(files: Files, every: NonZeroU64) -> Every {
        Every {
            files,
            state: InForce::default(),
            every,
            seen: 0,
            recorded: 0,
            held: None,
        }
    }

    fn write(&mut self, mut record: FrameRecord, start: &Start, curves: bool) -> Result<()> {
        if !curves {
            record.curves = None;
        }
        self.recorded += u64::from(record.curves.is_some());
        self.files.write(&record, start)
    }

    fn write_held(&mut self, curves: bool) -> Result<()> {
        match self.held.take() {
            Some((record, start)) => self.write(record, &start, curves),
            None => Ok(()),
        }
    }
}

impl Sink for Every {
    fn name(&self) -> &'static str {
        NAME
    }

    fn begin(&mut self, baseline: &BaselineRecord) -> Result<()> {
        self.write_held(false)?;
        self.state.begin(baseline);
        self.files.begin_again();
        Ok(())
    }

    fn expect(&mut self, baseline: &BaselineRecord) -> Result<()> {
        self.state.expect(baseline);
        Ok(())
    }

    fn frame(&mut self, record: &FrameRecord) -> Result<()> {
        let start = self.state.pass(record);
        self.write_held(!is_intact(record))?;
        let due = self.seen.is_multiple_of(self.every.get());
        self.seen += u64::from(record.curves.is_some());
        let record = record.clone();
        if due || start.new || !is_intact(&record) {
            return self.write(record, &start, true);
        }
        self.held = Some((record, start));
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        self.files.flush()
    }

    fn note(&self) -> Option<String> {
        let frames = self.files.frames() + u64::from(self.held.is_some());
        let (recorded, every) = (self.recorded, self.every);
        let words = format!(
            "recording: curves of {recorded} of {frames} frames (--record-every {every}), verdicts \
             of all"
        );
        let files = self.files.note().into_iter();
        Some(
            [words]
                .into_iter()
                .chain(files)
                .collect::<Vec<_>>()
                .join("\n"),
        )
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.write_held(false)?;
        self.files.finish()
    }
}
