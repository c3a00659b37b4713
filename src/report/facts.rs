//! Facts of a recorded run, collected item by item in bounded memory.

use super::rows::{Moment, PullThroughRow, Remark, Rows};
use super::series::Series;
use super::violations::{Shot, Violations};
use crate::curve::vector::mix;
use crate::curve::{CurveLabels, Image, Notation};
use crate::diagram::InvariantKind;
use crate::error::Result;
use crate::incremental::Events;
use crate::picture::svg::plain;
use crate::record::{
    CUT_OFF, Ending, MissingFrames, RecordedItem, RecordedVerdict, RecordingReader, Retention,
};
use crate::verdict::{DefectKind, LeftOut, Report, Spot, Stats, Verdict};
use crate::words::milliseconds;
use std::collections::BTreeMap;
use std::io::{Read, Seek};
use std::sync::Arc;

/// Maximum length of a name of a curve in a report, in characters. Valid names have at most 255
/// bytes.
const NAME: usize = 255;

/// Maximum length of a text of the recording: a value of the metadata, or a reason.
const TEXT: usize = 1000;

/// Maximum number of entries of the metadata.
const ENTRIES: usize = 60;

/// Key of the metadata of recordings of runs that measured clearance: a radius, or a word if it is
/// the one that the simulator publishes.
const THICKNESS: &str = "thickness";

/// Finding that the first sentence names.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct NamedFinding {
    #[serde(flatten)]
    pub moment: Moment,
    pub verdict: Verdict,
    /// The finding in a few words: "curves 3 and 4 came apart". `None` if the frame has none.
    pub finding: Option<String>,
    pub place: Option<String>,
    /// Number of other findings of the frame.
    #[serde(skip)]
    pub more: usize,
}

/// The baseline of the run.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct Baseline {
    pub origin: String,
    pub curves: usize,
    pub links: usize,
    /// Pairs and curves without a linking number.
    pub undefined: usize,
    /// The frame with these linking numbers; `None` if they come from a file.
    pub frame: Option<u64>,
    /// Number of frames that were published before it, but verified by nobody.
    pub unverified: u64,
    /// True if it has knots of curves.
    #[serde(skip)]
    pub knots: bool,
    /// Number of curves that run through the periodic cell, if there are several.
    #[serde(skip)]
    pub through: u64,
}

/// Numbers of frames.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub(super) struct Counts {
    /// Frames with a verdict that is not `rejected`.
    pub verified: u64,
    /// Frames that were published, but not verified.
    pub skipped: u64,
    pub rejected: u64,
    /// Frames that were verified, but are not in the recording.
    pub missing: u64,
    /// Number of verified frames that the recording skips on purpose.
    pub left_out: u64,
    /// Frames without a verdict.
    pub unanswered: u64,
    /// Verdicts without the curves of their frame, other than those on rejected frames.
    pub without_curves: u64,
    /// Frames that do not continue the previous one: the simulator rolled back or jumped.
    pub cuts: u64,
    /// Frames in which the verification in full disagreed (`Strategy::Paranoid`).
    pub disagreed: u64,
    /// Violations that the simulator rolled back, and that it accepted as a new baseline.
    pub recovered: u32,
    pub accepted: u32,
}

/// Lowest clearance.
#[derive(Clone, Debug, serde::Serialize)]
pub(super) struct Closest {
    #[serde(flatten)]
    pub moment: Moment,
    /// Distance of the centre lines, as a share of the sum of the radii.
    pub ratio: f64,
    pub sentence: String,
}

/// End of the recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) enum End {
    #[default]
    Finished,
    /// First byte of the incomplete part, and its name.
    Cut(u64, &'static str),
    /// The error in the middle of the file.
    Damaged(String),
}

/// Verdicts of frames, and the first frames that are not intact.
#[derive(Clone, Debug, Default)]
pub(super) struct Verdicts {
    /// Number of frames with each verdict, in the order of [`Verdict::ALL`].
    pub counts: [u64; 6],
    /// First frame with a changed topology.
    pub changed: Option<NamedFinding>,
    /// First frame with any other verdict than intact.
    pub unsettled: Option<NamedFinding>,
}

impl Verdicts {
    fn add(&mut self, verdict: Verdict, found: impl Fn() -> NamedFinding) {
        self.counts[verdict as usize] += 1;
        if verdict == Verdict::Changed {
            self.changed.get_or_insert_with(&found);
        }
        if verdict != Verdict::Intact {
            self.unsettled.get_or_insert_with(&found);
        }
    }
}

/// Facts of a run.
#[derive(Debug, Default)]
pub(super) struct Facts {
    /// Elements that may be curves and were not read.
    pub left_out: Vec<LeftOut>,
    pub metadata: BTreeMap<String, String>,
    pub baseline: Option<Baseline>,
    pub counts: Counts,
    pub verdicts: Verdicts,
    /// The same, without the frames of violations that were rolled back or accepted.
    pub lasting: Verdicts,
    /// First and last frame.
    pub span: Option<[Moment; 2]>,
    /// Time at which they arrived, in nanoseconds since 1970.
    pub received_ns: [u64; 2],
    /// Counters of the last verified frame, which have the size of the scene.
    pub stats: Stats,
    /// Largest number of open curves of a frame.
    pub open_curves: u64,
    /// Number of curves without linking numbers in runs without any searched step.
    pub unfollowed: u64,
    /// True if a frame had several curves, or a periodic cell.
    pub has_pairs: bool,
    pub violations: Violations,
    pub pull_throughs: Rows<PullThroughRow>,
    /// Number of unresolved pull-throughs.
    pub unresolved: u64,
    /// Rejected and incomplete frames, with the reason.
    pub remarks: Rows<Remark>,
    pub closest: Option<Closest>,
    /// Lowest clearance below the limit in a frame whose curves are recorded, and its place.
    pub low: Option<(f64, Shot)>,
    /// Number of frames whose clearance was measured, and of those in which it was low.
    pub clearances: [u64; 2],
    pub series: Series,
    pub end: End,
    /// Number of messages of other programs.
    pub foreign: u64,
}

impl Facts {
    /// Reads all verdicts of a recording.
    ///
    /// # Errors
    ///
    /// The file is damaged before its first verdict. Later damage is a fact.
    pub fn collect<R: Read + Seek>(reader: &mut RecordingReader<R>) -> Result<Facts> {
        let mut collector = Collector {
            missing: MissingFrames::of_no_frames(),
            ..Collector::default()
        };
        let damage = loop {
            match reader.next_item() {
                Ok(Some(item)) => collector.add(item),
                Ok(None) => break None,
                Err(e) if collector.facts.verdicts.counts == [0; 6] => return Err(e),
                Err(e) => break Some(plain(&e.to_string(), TEXT)),
            }
        };
        collector.end_run();
        let mut facts = collector.facts;
        facts.counts.unanswered += u64::from(collector.frame.is_some());
        facts.foreign = reader.skipped();
        let entries = reader.metadata().iter().take(ENTRIES);
        let entries = entries.map(|(key, value)| (plain(key, TEXT), plain(value, TEXT)));
        facts.metadata = entries.collect();
        facts.end = match (damage, reader.ending()) {
            (Some(why), _) => End::Damaged(why),
            (None, Some(&Ending::Cut { at, what })) => End::Cut(at, what),
            (None, _) => End::Finished,
        };
        Ok(facts)
    }

    /// Returns the number of frames with a verdict.
    pub fn of(&self, verdict: Verdict) -> u64 {
        self.verdicts.counts[verdict as usize]
    }

    /// Returns the pull-throughs that were searched for.
    pub fn events(&self) -> Events {
        let events = self.metadata.get("events");
        events.and_then(|e| e.parse().ok()).unwrap_or_default()
    }

    /// Returns the number of frames whose curves or verdict were lost, not skipped on purpose.
    pub fn recorded_in_part(&self) -> u64 {
        match self.metadata.contains_key(Retention::EVERY) {
            true => self.counts.unanswered,
            false => self.counts.unanswered + self.counts.without_curves,
        }
    }

    /// Returns the radius for which clearance was measured, if all strands have the same radius.
    pub fn radius(&self) -> Option<f64> {
        self.metadata.get(THICKNESS)?.parse().ok()
    }

    /// Returns the number of verified frames whose clearance was to be measured, but was not.
    pub fn unmeasured(&self) -> u64 {
        match self.metadata.contains_key(THICKNESS) {
            true => self.counts.verified - self.clearances[0].min(self.counts.verified),
            false => 0,
        }
    }

    /// Returns the number of frames before the baseline that nobody verified.
    pub fn unverified(&self) -> u64 {
        self.baseline.as_ref().map_or(0, |b| b.unverified)
    }

    /// Returns true if the recording lacks something: no verdict, or data that was lost or not
    /// measured.
    pub fn is_incomplete(&self) -> bool {
        let lost = self.recorded_in_part() + self.unmeasured();
        let lost = self.counts.missing.saturating_add(lost);
        let lost = lost.saturating_add(self.unverified());
        let unsearched = self.counts.verified > 1 && self.unverified_curves() > 0;
        let cut = self.metadata.contains_key(CUT_OFF);
        let lost = lost > 0 || unsearched || cut || !self.left_out.is_empty();
        self.counts.verified == 0 || lost || self.has_one_curve() || self.end != End::Finished
    }

    /// Returns true if nothing was compared, because each frame has one curve.
    pub fn has_one_curve(&self) -> bool {
        let is_given = |baseline: &Baseline| baseline.frame.is_none();
        let baseline = self.baseline.as_ref();
        let compared = self.counts.verified > 1 || baseline.is_some_and(is_given);
        let knots = self.open_curves == 0 && baseline.is_some_and(|baseline| baseline.knots);
        let itself = self.events() == Events::All && self.counts.verified > 1;
        self.counts.verified > 0 && compared && !(self.has_pairs || knots || itself)
    }
}

/// Facts so far, and the state of the recording.
#[derive(Default)]
struct Collector {
    facts: Facts,
    /// Number of frames so far.
    frames: u64,
    /// Number of the last frame if it has no verdict yet: its sequence number, and its position
    /// among all frames of the file.
    frame: Option<(u64, u64)>,
    labels: Arc<CurveLabels>,
    /// Names of the curves, as printed.
    names: Vec<String>,
    cuts: Option<u32>,
    /// Number of the frame that the simulator accepted last.
    accepted: Option<u64>,
    /// True if the next frame does not continue the last one.
    is_cut: bool,
    run: RecordedRun,
    /// Number of rejected frames after the last verified one.
    rejected: u64,
    /// Lasting verdicts before the current violation.
    before_violation: Option<Verdicts>,
    /// Verdicts of that violation that count although it ends: on frames after a cut, and on frames
    /// of which a part was not verified.
    kept: Verdicts,
    /// True if the simulator cut the motion after the last frame of that violation with a finding.
    after_cut: bool,
    missing: MissingFrames,
}

/// Verified frames after a baseline.
#[derive(Default)]
struct RecordedRun {
    verified: u64,
    /// Number of steps that continue the motion.
    followed: u64,
    /// Largest number of open curves of a frame.
    open_curves: u64,
}

impl Collector {
    /// Ends a run: counts the curves that it did not verify, because no step was searched.
    fn end_run(&mut self) {
        let run = std::mem::take(&mut self.run);
        if run.verified > 1 && run.followed == 0 {
            let through = self.facts.baseline.as_ref().map_or(0, |b| b.through);
            self.facts.unfollowed += run.open_curves + through;
        }
    }

    fn add(&mut self, item: RecordedItem) {
        match item {
            RecordedItem::Baseline(b) => {
                self.end_run();
                let images = b.certificate.images.as_deref().unwrap_or_default();
                self.facts.baseline = Some(Baseline {
                    origin: plain(&b.origin, TEXT),
                    curves: b.certificate.curves,
                    links: b.certificate.links.len() + images.len(),
                    undefined: b.certificate.undefined.len(),
                    frame: b.frame,
                    unverified: b.unverified,
                    knots: b
                        .certificate
                        .invariants()
                        .any(|k| k == InvariantKind::Curve),
                    through: b.certificate.periods_without_numbers() as u64,
                });
            }
            RecordedItem::Frame(frame) => {
                let before = self.frame.replace((frame.seq, self.frames));
                self.facts.counts.unanswered += u64::from(before.is_some());
                LeftOut::merge(&mut self.facts.left_out, &frame.info.left_out);
                self.frames += 1;
                self.facts.has_pairs |= frame.info.cell.is_some();
                let cuts = self.cuts.replace(frame.info.cuts);
                let is_cut = cuts.is_some_and(|cuts| cuts != frame.info.cuts);
                self.facts.counts.cuts += u64::from(is_cut);
                self.after_cut |= is_cut;
                let accepted = self.accepted.replace(frame.info.baseline);
                let is_accepted = accepted.is_some_and(|seq| seq != frame.info.baseline);
                self.is_cut |= is_cut || is_accepted;
                if let Some(baseline) = &mut self.facts.baseline
                    && is_accepted
                {
                    let before = frame.seq.saturating_sub(frame.info.baseline);
                    baseline.unverified += before.min(self.rejected);
                }
                if !Arc::ptr_eq(&self.labels, &frame.info.labels) {
                    let names = frame.info.labels.names.iter();
                    self.names = names.map(|name| plain(name, NAME)).collect();
                    self.facts.violations.rename(&self.names);
                    self.labels = frame.info.labels;
                }
            }
            RecordedItem::Verdict(recorded) => self.judge(*recorded),
        }
    }

    fn judge(&mut self, recorded: RecordedVerdict) {
        let RecordedVerdict { report, progress } = recorded;
        let facts = &mut self.facts;
        LeftOut::merge(&mut facts.left_out, &report.left_out);
        let ordinal = self.frame.take_if(|(seq, _)| *seq == report.seq);
        let ordinal = ordinal.map(|(_, ordinal)| ordinal);
        let gap = self.missing.before(&progress);
        facts.counts.left_out = self.missing.left_out;
        let missing = gap.dropped;
        let skipped = progress.skipped.saturating_sub(facts.counts.skipped);
        let moment = Moment::of(&report);
        let counts = &mut facts.counts;
        counts.missing = counts.missing.saturating_add(missing);
        counts.skipped = progress.skipped;
        counts.disagreed += u64::from(progress.work.disagreed);
        let ended = [counts.recovered, counts.accepted];
        (counts.recovered, counts.accepted) = (progress.recovered, progress.accepted);
        if ended != [counts.recovered, counts.accepted]
            && let Some(before) = self.before_violation.take()
        {
            facts.lasting = before;
            let kept = std::mem::take(&mut self.kept);
            let counts = facts.lasting.counts.iter_mut().zip(kept.counts);
            counts.for_each(|(count, kept)| *count += kept);
            facts.lasting.unsettled = facts.lasting.unsettled.take().or(kept.unsettled);
        }
        if report.abort || report.verdict == Verdict::Changed {
            if self.before_violation.is_none() {
                self.before_violation = Some(facts.lasting.clone());
                self.kept = Verdicts::default();
            }
            self.after_cut = false;
        }
        if report.verdict == Verdict::Rejected {
            counts.rejected += 1;
            self.rejected += 1;
        } else {
            counts.verified += 1;
            self.rejected = 0;
            counts.without_curves += u64::from(ordinal.is_none());
            facts.stats = report.stats;
            facts.open_curves = facts.open_curves.max(report.stats.open_curves);
            let run = &mut self.run;
            let has_step = run.verified > 0 && !std::mem::take(&mut self.is_cut);
            run.verified += 1;
            run.followed += u64::from(has_step);
            run.open_curves = run.open_curves.max(report.stats.open_curves);
            facts.has_pairs |= report.stats.curves != 1;
        }
        let received = progress.received_ns;
        match &mut facts.span {
            Some([_, last]) => (*last, facts.received_ns[1]) = (moment, received),
            None => (facts.span, facts.received_ns) = (Some([moment; 2]), [received; 2]),
        }
        let check = milliseconds(progress.times.check());
        facts.series.add(&report, check, [skipped, missing]);
        for why in report.rejected.iter().chain(&report.missing) {
            facts.remarks.push(|| Remark {
                moment,
                verdict: report.verdict,
                reason: plain(why, TEXT),
            });
        }
        self.findings(&report, ordinal);
    }

    /// Adds the findings of a report.
    fn findings(&mut self, report: &Report, ordinal: Option<u64>) {
        let (facts, names) = (&mut self.facts, &self.names);
        let extent = report.stats.extent;
        facts.violations.add(report, names, ordinal);
        let resolved = report.events.iter().map(|event| (event, false));
        let unresolved = report.unresolved.iter().map(|event| (event, true));
        facts.unresolved += report.unresolved.len() as u64;
        for (event, unresolved) in resolved.chain(unresolved) {
            facts.pull_throughs.push(|| PullThroughRow {
                moment: Moment::of(report),
                names: super::rows::names_of([event.i, event.j], names),
                event: *event,
                unresolved,
                sentence: {
                    let prefix = if unresolved { "unresolved: " } else { "" };
                    format!("{prefix}{}", event.with_motion(names, extent))
                },
            });
        }
        let found = || found(report, names);
        for verdicts in [&mut facts.verdicts, &mut facts.lasting] {
            verdicts.add(report.verdict, found);
        }
        if self.after_cut {
            self.kept.add(report.verdict, found);
        } else if !report.missing.is_empty() {
            self.kept.add(Verdict::Undecided, found);
        }
        let Some(clearance) = &report.clearance else {
            return;
        };
        facts.clearances[0] += 1;
        facts.clearances[1] += u64::from(clearance.low);
        let Some(closest) = &clearance.closest else {
            return;
        };
        let (ratio, moment) = (closest.ratio, Moment::of(report));
        let sentence = || closest.sentence_named(extent, names);
        if facts.closest.as_ref().is_none_or(|c| ratio < c.ratio) {
            facts.closest = Some(Closest {
                moment,
                ratio,
                sentence: sentence(),
            });
        }
        let is_lowest = facts.low.as_ref().is_none_or(|(low, _)| ratio < *low);
        if clearance.low && ordinal.is_some() && is_lowest {
            let shot = Shot {
                ordinal,
                moment,
                spot: Spot {
                    curves: [closest.i, closest.j],
                    image: closest.image,
                    segments: closest.segments,
                    point: mix(closest.points[0], closest.points[1], 0.5),
                },
                sentence: sentence(),
                passage: None,
                changed: false,
            };
            facts.low = Some((ratio, shot));
        }
    }
}

/// Returns the finding of a frame that the first sentence names: the change of the pair that was
/// pulled through first, a pull-through, or a defect.
fn found(report: &Report, names: &[String]) -> NamedFinding {
    let extent = report.stats.extent;
    let at = |point| Some(Notation::of_scene(extent, point).point(point));
    let event = report.events.first().or(report.unresolved.first());
    let pulled = |i, j, image: Image| event.is_some_and(|e| (e.i, e.j, e.image) == (i, j, image));
    let change = report.changes.iter().find(|c| pulled(c.i, c.j, c.image));
    let change = change.or(report.changes.first());
    // An undecided step says less than a contact.
    let defect = report.defects.iter().min_by_key(|d| match d.kind {
        DefectKind::Contact => 0,
        kind => 1 + u32::from(kind.is_of_step()),
    });
    let (finding, place) = match (change, event, defect) {
        (Some(c), ..) => (Some(c.words(names)), c.place.and_then(|p| at(p.point))),
        (None, Some(e), _) if !report.events.is_empty() => (Some(e.words(names)), at(e.point)),
        _ if !report.invariants.is_empty() => {
            let what = report.invariants[0].sentence_named(names);
            (Some(what), None)
        }
        (None, _, Some(d)) => (Some(d.words(names)), at(d.place.point)),
        (None, Some(e), None) => {
            let what = format!("unresolved: {}", e.words(names));
            (Some(what), at(e.point))
        }
        (None, None, None) => {
            let why = report.rejected.iter().chain(&report.missing).next();
            (why.map(|why| plain(why, TEXT)), None)
        }
    };
    NamedFinding {
        moment: Moment::of(report),
        verdict: report.verdict,
        finding,
        place,
        more: report.all_findings().count().saturating_sub(1),
    }
}
