//! Records the frames around violations: a flight recorder for runs of hours.
//!
//! Frames wait in memory until they are too old, or a violation comes. Then all that wait are
//! written, in order, and so are those that arrive in the time after it. A violation in that time
//! prolongs it, so no frame is written twice. Waiting frames are written one by one while no new
//! frame waits for the sink ([`Sink::work`]): a write of a gigabyte delays no frame.
//!
//! A violation that lasts is one violation: only a finding that the previous frame did not have
//! begins a window, as otherwise one that is never repaired would fill the disk.
//!
//! Times are measured by the monotonic clock at which frames reach the sink.

use super::files::Files;
use super::{Keep, Start, bytes_of_findings};
use crate::error::Result;
use crate::sinks::FrameRecord;
use crate::verdict::{PreviousFindings, Verdict};
use crate::words::plural;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Memory of a frame without positions and findings, in bytes.
pub(super) const RECORD_BYTES: u64 = 1024;

/// A frame that waits in memory.
struct Waiting {
    /// The frame, with a copy of its curves. The set that was verified is larger: it also has its
    /// coordinates by axis, and it would keep a frame of the engine's pool busy.
    record: FrameRecord,
    start: Start,
    at: Duration,
}

impl Waiting {
    fn new(record: &FrameRecord, start: Start, at: Duration) -> Waiting {
        let mut record = record.clone();
        record.curves = record.curves.map(|set| Arc::new(set.as_ref().clone()));
        Waiting { record, start, at }
    }

    fn bytes(&self) -> u64 {
        let curves = self.record.curves.as_ref();
        let positions = curves.map_or(0, |set| 3 * set.points() * set.precision().bytes());
        positions as u64 + RECORD_BYTES + bytes_of_findings(&self.record.report)
    }
}

pub(super) struct Window {
    span: Duration,
    memory: u64,
    clock: Instant,
    waiting: VecDeque<Waiting>,
    /// Memory of the waiting frames.
    bytes: u64,
    /// Number of frames at the front that are to be written.
    due: usize,
    known: PreviousFindings,
    /// Frames are recorded until then.
    until: Option<Duration>,
    /// Arrival of the last frame that was dropped although it was young enough.
    dropped: Option<Duration>,
    seen: u64,
    windows: u64,
    /// Number of windows that are shorter than they should be.
    short: u64,
}

impl Window {
    pub fn new(span: Duration, memory: u64) -> Window {
        Window {
            span,
            memory,
            clock: Instant::now(),
            waiting: VecDeque::new(),
            bytes: 0,
            due: 0,
            known: PreviousFindings::default(),
            until: None,
            dropped: None,
            seen: 0,
            windows: 0,
            short: 0,
        }
    }

    /// Takes a frame that arrived at a time.
    pub(super) fn take(
        &mut self,
        files: &mut Files,
        record: &FrameRecord,
        start: Start,
        now: Duration,
    ) -> Result<()> {
        self.seen += 1;
        self.expire(now);
        let open = self.until.is_some_and(|until| now <= until);
        let report = &record.report;
        if record.curves.is_some() {
            self.known.begin_frame(record.info.layout);
        }
        let novelty = self.known.update(report);
        let is_new = novelty.before != Some(report.verdict) || novelty.new.contains(&true);
        if is_new && report.verdict != Verdict::Intact {
            self.begin_window(record, now, open);
        } else if !open {
            self.until = None;
        }
        if self.until.is_some() && self.waiting.is_empty() {
            return files.write(record, &start);
        }
        let waiting = Waiting::new(record, start, now);
        self.bytes += waiting.bytes();
        self.waiting.push_back(waiting);
        if self.until.is_some() {
            self.due = self.waiting.len();
        }
        self.make_room(files)
    }

    /// Begins a window at a violation, or prolongs the one that is open.
    fn begin_window(&mut self, record: &FrameRecord, now: Duration, open: bool) {
        self.until = Some(now + self.span);
        if open {
            return;
        }
        self.windows += 1;
        let is_young = |at: Duration| at + self.span > now;
        if self.dropped.is_some_and(is_young) {
            self.short += 1;
            let first = self.waiting.get(self.due).map_or(now, |w| w.at);
            tracing::warn!(
                "recording: the window before frame {} has {:.1} of {} s: {} bytes of memory hold \
                 no more",
                record.report.seq,
                (now - first).as_secs_f64(),
                self.span.as_secs_f64(),
                self.memory,
            );
        }
        // All waiting frames become due. Frames of an earlier window are already due.
        self.due = self.waiting.len();
    }

    /// Drops frames that are too old. The last one stays: it is the one before the next violation.
    fn expire(&mut self, now: Duration) {
        let is_old = |w: &Waiting| w.at + self.span < now;
        while self.waiting.len() > self.due + 1 && is_old(&self.waiting[self.due]) {
            if let Some(old) = self.waiting.remove(self.due) {
                self.bytes -= old.bytes();
            }
        }
    }

    /// Writes or drops frames that the memory does not hold, except for the last one.
    fn make_room(&mut self, files: &mut Files) -> Result<()> {
        while self.bytes > self.memory && self.due > 0 {
            self.write_one(files)?;
        }
        while self.bytes > self.memory && self.waiting.len() > 1 {
            if let Some(oldest) = self.waiting.pop_front() {
                self.bytes -= oldest.bytes();
                self.dropped = Some(oldest.at);
            }
        }
        Ok(())
    }

    /// Writes the oldest frame, which is due.
    fn write_one(&mut self, files: &mut Files) -> Result<()> {
        let Some(oldest) = self.waiting.pop_front() else {
            return Ok(());
        };
        self.due -= 1;
        self.bytes -= oldest.bytes();
        files.write(&oldest.record, &oldest.start)
    }

    #[cfg(test)]
    pub(super) fn memory(&self) -> (u64, usize) {
        (self.bytes, self.waiting.len())
    }
}

impl Keep for Window {
    fn frame(&mut self, files: &mut Files, record: &FrameRecord, start: Start) -> Result<()> {
        self.take(files, record, start, self.clock.elapsed())
    }

    fn end(&mut self, files: &mut Files) -> Result<()> {
        while self.due > 0 {
            self.write_one(files)?;
        }
        self.waiting.clear();
        (self.bytes, self.until) = (0, None);
        Ok(())
    }

    fn work(&mut self, files: &mut Files) -> Result<bool> {
        if self.due == 0 {
            return Ok(false);
        }
        self.write_one(files)?;
        if self.due == 0 {
            files.flush()?;
        }
        Ok(self.due > 0)
    }

    fn note(&self, files: &Files) -> Option<String> {
        let (seen, seconds) = (self.seen, self.span.as_secs_f64());
        if self.windows == 0 {
            return Some(format!(
                "recording: no violation in {seen} frames, so no file was written (a window of \
                 {seconds} s)"
            ));
        }
        let windows = plural(self.windows, "violation");
        let frames = files.frames + self.due as u64;
        let short = match self.short {
            0 => String::new(),
            n => format!("; {n} shorter before the violation: the memory for them is too small"),
        };
        Some(format!(
            "recording: {frames} of {seen} frames, around {windows} (a window of {seconds} \
             s){short}"
        ))
    }
}
