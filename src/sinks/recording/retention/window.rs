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
use super::packed::{Packed, Packer};
use super::{InForce, NAME, Start};
use crate::error::Result;
use crate::sinks::{BaselineRecord, FrameRecord, Sink};
use crate::verdict::{Lasting, Report, Verdict};
use std::collections::{BTreeSet, VecDeque};
use std::time::{Duration, Instant};

/// Memory of a frame without positions, and of a finding, in bytes.
pub(super) const RECORD_BYTES: u64 = 1024;
const FINDING_BYTES: u64 = 160;

/// A frame that waits in memory.
struct Waiting {
    /// The frame without its curves.
    record: FrameRecord,
    curves: Option<Packed>,
    start: Start,
    at: Duration,
}

impl Waiting {
    fn bytes(&self) -> u64 {
        let report = &self.record.report;
        let findings = report.changes.len()
            + report.events.len()
            + report.defects.len()
            + report.unresolved.len()
            + report.adopted.len();
        let positions = self.curves.as_ref().map_or(0, Packed::bytes);
        positions + RECORD_BYTES + FINDING_BYTES * findings as u64
    }

    fn discard(self, packer: &mut Packer) {
        if let Some(curves) = self.curves {
            packer.discard(curves);
        }
    }
}

pub(super) struct Window {
    files: Files,
    state: InForce,
    span: Duration,
    memory: u64,
    clock: Instant,
    waiting: VecDeque<Waiting>,
    /// Memory of the waiting frames.
    bytes: u64,
    /// Number of frames at the front that are to be written.
    due: usize,
    packer: Packer,
    known: Known,
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
    pub fn new(files: Files, span: Duration, memory: u64) -> Window {
        Window {
            files,
            state: InForce::default(),
            span,
            memory,
            clock: Instant::now(),
            waiting: VecDeque::new(),
            bytes: 0,
            due: 0,
            packer: Packer::default(),
            known: Known::default(),
            until: None,
            dropped: None,
            seen: 0,
            windows: 0,
            short: 0,
        }
    }

    /// Takes a frame that arrived at a time.
    pub(super) fn take(&mut self, record: &FrameRecord, now: Duration) -> Result<()> {
        self.seen += 1;
        self.expire(now);
        let start = self.state.pass(record);
        let violation = self.known.is_new(&record.report);
        let open = self.until.is_some_and(|until| now <= until);
        if violation {
            self.begin_window(record, now, open);
        } else if !open {
            self.until = None;
        }
        if self.until.is_some() && self.waiting.is_empty() {
            return self.files.write(record, &start);
        }
        let mut waiting = Waiting {
            record: record.clone(),
            curves: None,
            start,
            at: now,
        };
        if let Some(set) = waiting.record.curves.take() {
            waiting.curves = Some(self.packer.pack(&set));
        }
        self.bytes += waiting.bytes();
        self.waiting.push_back(waiting);
        if self.until.is_some() {
            self.due = self.waiting.len();
        }
        self.make_room()
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
                 no more (--record-window-memory)",
                record.report.seq,
                (now - first).as_secs_f64(),
                self.span.as_secs_f64(),
                self.memory,
            );
        }
        // Those before this window are being written already.
        self.due = self.waiting.len();
    }

    /// Drops frames that are too old. The last one stays: it is the one before the next violation.
    fn expire(&mut self, now: Duration) {
        let is_old = |w: &Waiting| w.at + self.span < now;
        while self.waiting.len() > self.due + 1 && is_old(&self.waiting[self.due]) {
            if let Some(old) = self.waiting.remove(self.due) {
                self.bytes -= old.bytes();
                old.discard(&mut self.packer);
            }
        }
    }

    /// Writes or drops frames that the memory does not hold, except for the last one.
    fn make_room(&mut self) -> Result<()> {
        while self.bytes > self.memory && self.due > 0 {
            self.write_one()?;
        }
        while self.bytes > self.memory && self.waiting.len() > 1 {
            if let Some(oldest) = self.waiting.pop_front() {
                self.bytes -= oldest.bytes();
                self.dropped = Some(oldest.at);
                oldest.discard(&mut self.packer);
            }
        }
        Ok(())
    }

    /// Writes the oldest frame, which is due.
    fn write_one(&mut self) -> Result<()> {
        let Some(oldest) = self.waiting.pop_front() else {
            return Ok(());
        };
        self.due -= 1;
        self.bytes -= oldest.bytes();
        let Waiting {
            record,
            curves,
            start,
            ..
        } = oldest;
        let files = &mut self.files;
        match curves {
            Some(curves) => {
                let write = |record: &FrameRecord| files.write(record, &start);
                self.packer.with_curves(record, curves, write)
            }
            None => files.write(&record, &start),
        }
    }

    #[cfg(test)]
    pub(super) fn memory(&self) -> (u64, usize) {
        (self.bytes, self.waiting.len())
    }
}

impl Sink for Window {
    fn name(&self) -> &'static str {
        NAME
    }

    fn begin(&mut self, baseline: &BaselineRecord) -> Result<()> {
        self.state.begin(baseline);
        // The frames that wait have nothing to do with the next ones.
        while self.due > 0 {
            self.write_one()?;
        }
        self.waiting.clear();
        (self.bytes, self.until) = (0, None);
        self.files.begin_again();
        Ok(())
    }

    fn expect(&mut self, baseline: &BaselineRecord) -> Result<()> {
        self.state.expect(baseline);
        Ok(())
    }

    fn frame(&mut self, record: &FrameRecord) -> Result<()> {
        self.take(record, self.clock.elapsed())
    }

    fn work(&mut self) -> Result<bool> {
        if self.due == 0 {
            return Ok(false);
        }
        self.write_one()?;
        if self.due == 0 {
            self.files.flush()?;
        }
        Ok(self.due > 0)
    }

    fn flush(&mut self) -> Result<()> {
        self.files.flush()
    }

    fn note(&self) -> Option<String> {
        let (seen, seconds) = (self.seen, self.span.as_secs_f64());
        if self.windows == 0 {
            return Some(format!(
                "recording: no violation in {seen} frames, so no file was written (--record-window \
                 {seconds})"
            ));
        }
        let windows = match self.windows {
            1 => "1 violation".to_owned(),
            n => format!("{n} violations"),
        };
        let frames = self.files.frames() + self.due as u64;
        let mut words = format!(
            "recording: {frames} of {seen} frames, around {windows} (--record-window {seconds})"
        );
        if self.short > 0 {
            words += &format!(
                "; {} shorter before the violation: --record-window-memory is too small",
                self.short
            );
        }
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
        while self.due > 0 {
            self.write_one()?;
        }
        self.files.finish()
    }
}

/// Findings of the previous frame.
#[derive(Default)]
struct Known {
    verdict: Option<Verdict>,
    findings: BTreeSet<Lasting>,
}

impl Known {
    /// Returns true if a frame is not intact, and has another verdict than the previous frame or a
    /// finding that the previous one did not have.
    fn is_new(&mut self, report: &Report) -> bool {
        let findings: BTreeSet<Lasting> = report.lasting().flatten().collect();
        let verdict = self.verdict.replace(report.verdict);
        let new = verdict != Some(report.verdict)
            || !findings.is_subset(&self.findings)
            || !report.events.is_empty()
            || !report.unresolved.is_empty();
        // Frames without curves have no findings: those of the frame before may still be there.
        if report.verdict != Verdict::Rejected {
            self.findings = findings;
        }
        new && report.verdict != Verdict::Intact
    }
}
