//! Messages from the watcher to the simulator, as Rust types and as text.

use super::wire::{
    FINDING_CHANGE, FINDING_DEFECT, FINDING_EVENT, FINDING_NONE, LAYOUT_VERSION, NO_CURVE,
    NO_FRAME, VERDICT_MAGIC, VerdictWire, check_version,
};
use crate::error::{Error, Result};
use crate::verdict::{
    self, Change, ChangeKind, Clearance, Defect, DefectKind, Place, PullThrough, Report, Verdict,
    words_of_count, words_of_roll_back,
};
use bytemuck::Zeroable;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// Reason for a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
#[non_exhaustive]
pub enum MessageKind {
    /// The watcher is present. Sent when it meets a simulator, and about once a second while it is
    /// idle.
    Hello = 0,
    /// The watcher verified a frame.
    Verdict = 1,
    /// The watcher has finished this session: the session ended, or the watcher is leaving.
    Goodbye = 2,
}

/// Frames of the session so far. At its end, published = verified + skipped + rejected; rejected
/// frames with impossible sequence numbers are counted in addition.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Frames that were checked, with any verdict.
    pub verified: u64,
    /// Frames that were not checked, because a newer one replaced them or no watcher was present.
    pub skipped: u64,
    /// Frames that broke their contract.
    pub rejected: u64,
}

/// First finding of a frame: the change of the pair that was pulled through first, another change,
/// a pull-through, or a defect.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Finding {
    /// A linking number that differs from the expected one.
    Change(Change),
    /// One curve was pulled through another, or through itself.
    Event(PullThrough),
    /// A pair or a curve without a linking number, or with an undecided step.
    Defect(Defect),
}

impl Finding {
    /// Returns the finding of a report, if a message can have it.
    fn of(finding: verdict::Finding<'_>) -> Option<Finding> {
        match finding {
            verdict::Finding::Change(change) => Some(Finding::Change(*change)),
            verdict::Finding::PullThrough(event) => Some(Finding::Event(*event)),
            verdict::Finding::Defect(defect) => Some(Finding::Defect(*defect)),
            verdict::Finding::Invariant(_) | verdict::Finding::Unresolved(_) => None,
        }
    }

    fn sentence(&self, extent: f64, names: &[String]) -> String {
        match self {
            Finding::Change(change) => change.sentence_named(extent, names),
            Finding::Event(event) => event.sentence_named(extent, names),
            Finding::Defect(defect) => defect.sentence_named(extent, names),
        }
    }
}

/// Returns the first finding of a report that is `new`, and true; the first of all if there is
/// none. The change of the pair that was pulled through first comes before others, as in the report
/// of a run.
fn first_new(report: &Report, new: &[bool]) -> Option<(Finding, bool)> {
    let all = report.all_findings().zip(new);
    let all = all.filter_map(|(finding, new)| Some((Finding::of(finding)?, *new)));
    let all: Vec<(Finding, bool)> = all.collect();
    let new = || all.iter().filter(|(_, is_new)| *is_new);
    let pulled = report.events.first().map(|e| (e.i, e.j, e.image));
    let explains = |(finding, _): &&(Finding, bool)| match finding {
        Finding::Change(c) => Some((c.i, c.j, c.image)) == pulled,
        _ => false,
    };
    let first = new().find(explains).or_else(|| new().next());
    first.or(all.first()).copied()
}

/// Message from the watcher. Its `Display` form is a sentence.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct VerdictMessage {
    /// Reason for the message.
    pub kind: MessageKind,
    /// Session of the message; 0 if the watcher has no session.
    pub session: u64,
    /// Frame of the message. For a hello or goodbye with `abort`: the last frame that asked to
    /// stop.
    pub seq: u64,
    /// Simulation time of the frame, in seconds.
    pub time: f64,
    /// Verdict on the frame.
    pub verdict: Verdict,
    /// True if the simulator is asked to stop or to roll back.
    pub abort: bool,
    /// Number of links lost.
    pub lost: u32,
    /// Number of links gained.
    pub gained: u32,
    /// Number of links whose linking number changed otherwise.
    pub changed: u32,
    /// Number of pull-throughs since the last verified frame.
    pub events: u32,
    /// Number of curves that appeared since the last verified frame.
    pub appeared: u32,
    /// Number of curves that are gone since the last verified frame.
    pub gone: u32,
    /// Number of pairs or curves without a linking number, or with an undecided step.
    pub defects: u32,
    /// Number of pull-throughs that cannot be resolved, because the frames are too far apart
    /// ([`Report::unresolved`]).
    pub unresolved: u32,
    /// Number of all findings of the frame.
    pub findings: u32,
    /// The first finding that the last verified frame did not have, or the first of all findings if
    /// none is new. It is the reason for `abort`, if that is set.
    pub first: Option<Finding>,
    /// Extent of the scene ([`Stats::extent`](crate::Stats::extent)).
    pub extent: f64,
    /// Reason if the frame was rejected or pairs were not verified, the knot or triple that changed
    /// ([`Report::invariants`]), which curves appeared and are gone, or which strands came too
    /// close ([`Report::clearance`]). Of a goodbye without `abort`: why the watcher cannot verify
    /// the session.
    pub reason: Option<String>,
    /// Number of violations in this session that the simulator rolled back
    /// ([`Client::resume`](crate::Client::resume)), so that a later frame is intact.
    pub recovered: u32,
    /// Counters of the session up to this message.
    pub counters: Counters,
    /// Duration of the check.
    pub check: Duration,
    /// Last frame that is known to be intact ([`Report::last_intact`]).
    pub last_intact: Option<u64>,
    /// Safe fraction of the step from there ([`Report::safe_fraction`]).
    pub safe_fraction: Option<f64>,
    /// Names of the curves, if the simulator gave them; otherwise empty.
    pub names: Arc<[String]>,
}

impl fmt::Display for VerdictMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.kind {
            MessageKind::Hello => write!(f, "linkwatch is watching")?,
            MessageKind::Goodbye => write!(f, "linkwatch is done with this session")?,
            MessageKind::Verdict => {}
        }
        if self.kind != MessageKind::Verdict {
            let c = &self.counters;
            let (verified, skipped, rejected) = (c.verified, c.skipped, c.rejected);
            write!(
                f,
                ": {verified} frames verified, {skipped} skipped, {rejected} rejected"
            )?;
            match self.recovered {
                0 => {}
                1 => write!(f, "; recovered: 1 violation was rolled back")?,
                n => write!(f, "; recovered: {n} violations were rolled back")?,
            }
            match (self.abort, &self.reason) {
                (true, _) => write!(f, "; ")?,
                (false, Some(why)) => return write!(f, "; {why}"),
                (false, None) => return Ok(()),
            }
        }
        write!(f, "frame {}: {}", self.seq, self.verdict)?;
        let counts = [
            (self.lost, "link* lost"),
            (self.gained, "link* gained"),
            (self.changed, "link* changed"),
            (self.events, "pull-through*"),
            (self.defects, "pair* or curve* undecided"),
            (self.unresolved, "unresolved pull-through*"),
        ];
        for (n, what) in counts.into_iter().filter(|c| c.0 > 0) {
            write!(f, ", {}", words_of_count(n as usize, what))?;
        }
        if let Some(finding) = &self.first {
            write!(f, ": {}", finding.sentence(self.extent, &self.names))?;
        }
        if let Some(reason) = &self.reason {
            write!(f, ": {reason}")?;
        }
        if self.abort {
            write!(f, ". Stop or roll back")?;
            if let Some(words) = words_of_roll_back(self.last_intact, self.safe_fraction) {
                write!(f, ": {words}")?;
            }
        }
        Ok(())
    }
}

impl VerdictWire {
    /// Creates a message that concerns no frame.
    pub fn new(kind: MessageKind, session: u64, counters: Counters) -> Self {
        VerdictWire {
            magic: VERDICT_MAGIC,
            version: LAYOUT_VERSION,
            kind: kind as u32,
            session,
            verdict: Verdict::Intact as u32,
            finding: FINDING_NONE,
            j: NO_CURVE,
            verified: counters.verified,
            skipped: counters.skipped,
            rejected: counters.rejected,
            last_intact: NO_FRAME,
            safe_fraction: f64::NAN,
            ..VerdictWire::zeroed()
        }
    }

    /// Creates a message that concerns no frame, with as much of this reason as fits.
    pub fn with_reason(mut self, reason: &str) -> Self {
        let n = reason.floor_char_boundary(self.reason.len());
        self.reason[..n].copy_from_slice(&reason.as_bytes()[..n]);
        self.reason_len = n as u32;
        self
    }

    /// Adds a report, with its first new finding and as much of the reason as fits. `new` is true
    /// for each finding that the last verified frame did not have.
    pub fn with_report(self, report: &Report, new: &[bool], check: Duration) -> VerdictWire {
        let count = |kind| u32::try_from(report.count(kind)).unwrap_or(u32::MAX);
        let findings = report.all_findings().count();
        let mut wire = VerdictWire {
            seq: report.seq,
            time: report.time,
            verdict: report.verdict as u32,
            abort: u32::from(report.abort),
            lost: count(ChangeKind::Lost),
            gained: count(ChangeKind::Gained),
            changed: count(ChangeKind::Changed),
            events: u32::try_from(report.events.len()).unwrap_or(u32::MAX),
            defects: u32::try_from(report.defects.len()).unwrap_or(u32::MAX),
            unresolved: u32::try_from(report.unresolved.len()).unwrap_or(u32::MAX),
            appeared: u32::try_from(report.appeared.len()).unwrap_or(u32::MAX),
            gone: u32::try_from(report.gone.len()).unwrap_or(u32::MAX),
            findings: u32::try_from(findings).unwrap_or(u32::MAX),
            check_ns: u64::try_from(check.as_nanos()).unwrap_or(u64::MAX),
            extent: report.stats.extent,
            last_intact: report.last_intact.unwrap_or(NO_FRAME),
            safe_fraction: report.safe_fraction.unwrap_or(f64::NAN),
            ..self
        };
        let (first, is_new) = first_new(report, new).unzip();
        match first {
            None => {}
            Some(Finding::Change(change)) => {
                wire.finding = FINDING_CHANGE;
                (wire.i, wire.j, wire.image) = (change.i, change.j, change.image);
                (wire.expected, wire.found) = (change.expected, change.found);
                wire.set_place(change.place);
            }
            Some(Finding::Event(event)) => {
                wire.finding = FINDING_EVENT;
                (wire.i, wire.j, wire.image) = (event.i, event.j, event.image);
                wire.found = event.sign.into();
                wire.lengths = event.lengths;
                wire.set_place(Some(Place {
                    segments: event.segments,
                    point: event.point,
                    distance: event.fraction,
                }));
            }
            Some(Finding::Defect(defect)) => {
                wire.finding = FINDING_DEFECT;
                (wire.i, wire.j) = (defect.i, defect.j.unwrap_or(NO_CURVE));
                wire.image = defect.image;
                wire.defect_kind = defect.kind as u32;
                wire.set_place(Some(defect.place));
            }
        }
        let curves = report.change_of_curves();
        // A finding says more.
        let clearance = report.clearance.filter(|_| wire.finding == FINDING_NONE);
        let close = clearance.as_ref().and_then(Clearance::reason);
        let changed = report.invariants.first();
        let changed = changed.filter(|_| is_new != Some(true));
        let changed = changed.map(|change| change.sentence_named(&[]));
        let missing = report.missing.first().cloned();
        let reasons = [&report.rejected, &changed, &missing, &curves, &close];
        match reasons.into_iter().flatten().next() {
            Some(reason) => wire.with_reason(reason),
            None => wire,
        }
    }

    fn set_place(&mut self, place: Option<Place>) {
        if let Some(place) = place {
            self.has_place = 1;
            self.segments = place.segments;
            self.point = place.point;
            self.distance = place.distance;
        }
    }

    /// Decodes the message. Fails if it does not have the layout of this build.
    pub fn read(&self) -> Result<VerdictMessage> {
        let bad = |place, code: u64| Error::format("verdict message", place, code);
        if self.magic != VERDICT_MAGIC {
            return Err(bad("magic number", self.magic));
        }
        check_version("the verdict message", self.version)?;
        let kind = match self.kind {
            0 => MessageKind::Hello,
            1 => MessageKind::Verdict,
            2 => MessageKind::Goodbye,
            k => return Err(bad("kind", k.into())),
        };
        let verdict = Verdict::from_code(self.verdict)
            .ok_or_else(|| bad("verdict code", self.verdict.into()))?;
        let place = Place {
            segments: self.segments,
            point: self.point,
            distance: self.distance,
        };
        let first = match self.finding {
            FINDING_NONE => None,
            FINDING_CHANGE => Some(Finding::Change(Change {
                i: self.i,
                j: self.j,
                image: self.image,
                expected: self.expected,
                found: self.found,
                place: (self.has_place != 0).then_some(place),
            })),
            FINDING_EVENT => Some(Finding::Event(PullThrough {
                i: self.i,
                j: self.j,
                image: self.image,
                segments: self.segments,
                fraction: self.distance,
                sign: if self.found < 0 { -1 } else { 1 },
                point: self.point,
                lengths: self.lengths,
            })),
            FINDING_DEFECT => Some(Finding::Defect(Defect {
                i: self.i,
                j: (self.j != NO_CURVE).then_some(self.j),
                image: self.image,
                kind: *DefectKind::ALL
                    .get(self.defect_kind as usize)
                    .ok_or_else(|| bad("defect code", self.defect_kind.into()))?,
                place,
            })),
            code => return Err(bad("finding code", code.into())),
        };
        let reason = self.reason.get(..self.reason_len as usize);
        let reason = reason.ok_or_else(|| bad("length of the reason", self.reason_len.into()))?;
        Ok(VerdictMessage {
            kind,
            session: self.session,
            seq: self.seq,
            time: self.time,
            verdict,
            abort: self.abort != 0,
            lost: self.lost,
            gained: self.gained,
            changed: self.changed,
            events: self.events,
            defects: self.defects,
            unresolved: self.unresolved,
            appeared: self.appeared,
            gone: self.gone,
            findings: self.findings,
            recovered: self.recovered,
            first,
            extent: self.extent,
            reason: (!reason.is_empty()).then(|| String::from_utf8_lossy(reason).into_owned()),
            counters: Counters {
                verified: self.verified,
                skipped: self.skipped,
                rejected: self.rejected,
            },
            check: Duration::from_nanos(self.check_ns),
            last_intact: (self.last_intact != NO_FRAME).then_some(self.last_intact),
            safe_fraction: (!self.safe_fraction.is_nan()).then_some(self.safe_fraction),
            names: Arc::default(),
        })
    }
}

#[cfg(test)]
mod tests;
