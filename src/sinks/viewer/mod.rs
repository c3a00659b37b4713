//! Shows frames in the rerun viewer: a running one, one that is started here, or a file for later.
//!
//! The picture answers three questions at a glance: is the topology whole, which curves broke, since when.
//! Intact curves are thin and muted; curves of a change are thick and red, those without a verdict orange, each
//! group an entity of its own; marks say which pair and what its number was and is. Widths are in points of the screen,
//! so that a scene of any size looks the same.
//!
//! One strip a curve: a strip a segment was measured to cost seven times as much.
//!
//! Only this module knows the crate `rerun`.

mod layout;
mod target;

pub use target::ViewerTarget;

use crate::certificate::ChangeKind;
use crate::curve::{CurveSet, Point};
use crate::error::{Error, Result};
use crate::sinks::{BaselineRecord, FrameRecord, Sink};
use crate::verdict::{Report, Verdict};
use rerun::components::InterpolationMode;
use rerun::{
    Color, LineStrips3D, Points3D, Radius, RecordingStream, Scalars, SeriesLines, TextDocument,
    TextLog, TextLogLevel,
};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// Paths of the entities.
mod entity {
    pub const INTACT: &str = "curves/intact";
    pub const BROKEN: &str = "curves/broken";
    pub const UNDECIDED: &str = "curves/undecided";
    pub const PLACES: &str = "curves/places";
    pub const LOG: &str = "log";
    pub const STATUS: &str = "status";
    pub const LOST: &str = "links/lost";
    pub const GAINED: &str = "links/gained";
    pub const CHANGED: &str = "links/changed";
    pub const CHECK: &str = "cost/check";
    pub const SKIPPED: &str = "skipped/frames";
}

/// Name under which viewers group runs and remember layouts.
const APPLICATION: &str = "linkwatch";

const QUIET: u32 = 0x6f809cff;
const RED: u32 = 0xff3b30ff;
const ORANGE: u32 = 0xff9f0aff;
/// Marks are paler than the curves that they lie on, and labels, which have their colour, can be read.
const PALE_RED: u32 = 0xffe3dfff;
const PALE_ORANGE: u32 = 0xfff0d2ff;
const VIOLET: u32 = 0xbf5af2ff;
const GREEN: u32 = 0x30d158ff;

/// Findings that get a mark, a table row and a log line each; more would hide one another.
const SHOWN: usize = 20;

/// Marks closer than this, in radii of the scene, share a label.
const NEAR: f64 = 0.12;

/// From this many curves on, intact ones are drawn thinner: they would merge into a surface.
const MANY: usize = 2000;

/// Frames between log lines while nothing changes.
const QUIET_FRAMES: u64 = 200;

/// Splines are drawn with up to this many points a segment, and about this many points in all.
const POINTS_PER_SEGMENT: usize = 6;
const POINTS: usize = 400_000;

/// How long the viewer may take to accept what was sent, at the end.
const FLUSH_LIMIT: Duration = Duration::from_secs(10);

/// Logs to rerun. Put it behind a [`crate::SinkQueue`] that drops the oldest: a viewer that stops reading blocks it.
pub struct ViewerSink {
    rec: RecordingStream,
    /// Told with the first frame: before it there is no time to tell it at.
    greeting: Option<String>,
    /// What the log said last, to say only what is new.
    told: Option<Told>,
    is_file: bool,
    /// The newest curves.
    last: Option<Arc<CurveSet>>,
}

/// Findings, and the frame since which each has been there without a break.
type Findings = BTreeMap<(u32, Option<u32>, i64), u64>;

/// State of the log: a frame that differs in it is worth a line.
struct Told {
    verdict: Verdict,
    /// First frame of this verdict.
    since: u64,
    findings: Findings,
    /// Frame of the last line.
    at: u64,
}

impl ViewerSink {
    /// Opens the viewer or the file, and lays out its views. `title` names the run.
    pub fn open(target: &ViewerTarget, title: &str) -> Result<ViewerSink> {
        let rec = target.open(title)?;
        // Time is that of the simulation; when a line was logged tells a reader nothing.
        rec.set_log_tick_enabled(false);
        rec.set_log_time_enabled(false);
        let sink = ViewerSink {
            rec,
            greeting: None,
            told: None,
            is_file: matches!(target, ViewerTarget::File(_)),
            last: None,
        };
        layout::send(&sink.rec, None).map_err(failed)?;
        let series = [
            (entity::LOST, RED, "links lost"),
            (entity::GAINED, VIOLET, "links gained"),
            (entity::CHANGED, ORANGE, "links changed"),
            (entity::CHECK, GREEN, "check, ms a frame"),
            (entity::SKIPPED, ORANGE, "frames skipped so far"),
        ];
        for (path, color, name) in series {
            // Counts jump; times are measured here and there.
            let mode = match path {
                entity::CHECK => InterpolationMode::Linear,
                _ => InterpolationMode::StepAfter,
            };
            let style = SeriesLines::new()
                .with_colors([color])
                .with_names([name])
                .with_widths([2.5])
                .with_interpolation_mode(mode);
            sink.rec.log_static(path, &style).map_err(failed)?;
        }
        Ok(sink)
    }

    fn log(&self, path: &str, what: &impl rerun::AsComponents) -> Result<()> {
        self.rec.log(path, what).map_err(failed)
    }

    /// All curves, each in the group that it belongs to. Empty groups are logged too: they wipe the marks of
    /// the frame before.
    fn curves(&self, set: &CurveSet, report: &Report) -> Result<()> {
        let mut groups: Vec<u8> = vec![0; set.len()];
        let mut mark = |i: u32, group| {
            if let Some(g) = groups.get_mut(i as usize) {
                *g = group;
            }
        };
        for d in &report.defects {
            mark(d.i, 1);
            d.j.into_iter().for_each(|j| mark(j, 1));
        }
        for c in &report.changes {
            mark(c.i, 2);
            mark(c.j, 2);
        }
        let detail = (POINTS / set.segments().max(1)).clamp(1, POINTS_PER_SEGMENT);
        let quiet = if set.len() < MANY { 0.8 } else { 0.35 };
        for (group, path, color, width) in [
            (0, entity::INTACT, QUIET, quiet),
            (1, entity::UNDECIDED, ORANGE, 2.5),
            (2, entity::BROKEN, RED, 3.5),
        ] {
            let members = (0..set.len()).filter(|&i| groups[i] == group);
            let strips = members.map(|i| set.display_polyline(i, detail));
            let strips = LineStrips3D::new(strips)
                .with_colors([color])
                .with_radii([Radius::new_ui_points(width)]);
            self.log(path, &strips)?;
        }
        Ok(())
    }

    /// A mark with a label at the place of each finding, broken pairs first. Findings close together share one:
    /// their labels would cover one another.
    fn places(&self, set: &CurveSet, report: &Report) -> Result<()> {
        let changes = report.changes.iter().filter_map(|c| {
            let text = format!("{} & {}: {} → {}", c.i, c.j, c.expected, c.found);
            Some((c.place?, text, PALE_RED))
        });
        let defects = report.defects.iter().map(|d| {
            let text = match d.j {
                Some(j) => format!("{} & {j} {}", d.i, d.kind.words()),
                None => format!("{} {}", d.i, d.kind.words()),
            };
            (d.place, text, PALE_ORANGE)
        });
        let marks: Vec<_> = changes.chain(defects).take(SHOWN).collect();
        let near = match marks.len() {
            0 | 1 => 0.0,
            _ => layout::extent(set).map_or(0.0, |(.., radius)| NEAR * radius),
        };
        let mut places: Vec<(Point, Vec<String>, u32)> = Vec::new();
        for (place, text, color) in marks {
            let close = |p: &Point| {
                let dist_sq: f64 = (0..3).map(|x| (p[x] - place.point[x]).powi(2)).sum();
                dist_sq < near * near
            };
            match places.iter_mut().find(|(p, ..)| close(p)) {
                Some((_, texts, _)) => texts.push(text),
                None => places.push((place.point, vec![text], color)),
            }
        }
        let points = Points3D::new(places.iter().map(|(p, ..)| p.map(|x| x as f32)))
            .with_labels(places.iter().map(|(_, texts, _)| texts.join("\n")))
            .with_colors(places.iter().map(|(.., color)| *color))
            .with_radii([Radius::new_ui_points(5.0)])
            .with_show_labels(true);
        self.log(entity::PLACES, &points)
    }

    fn series(&self, record: &FrameRecord) -> Result<()> {
        for (path, kind) in [
            (entity::LOST, ChangeKind::Lost),
            (entity::GAINED, ChangeKind::Gained),
            (entity::CHANGED, ChangeKind::Changed),
        ] {
            let count = record.report.count(kind) as f64;
            self.log(path, &Scalars::single(count))?;
        }
        let check_ms = record.check.as_secs_f64() * 1e3;
        self.log(entity::CHECK, &Scalars::single(check_ms))?;
        self.log(entity::SKIPPED, &Scalars::single(record.skipped as f64))
    }

    /// A line for every frame that says something new, with a sentence for each new finding, and now and then
    /// one for a frame that does not; the status beside the picture is rewritten where it is not true any more.
    fn words(&mut self, record: &FrameRecord) -> Result<()> {
        let report = record.report.as_ref();
        let before = self.told.take();
        let turned = before.as_ref().is_none_or(|t| t.verdict != report.verdict);
        let since = match &before {
            Some(t) if !turned => t.since,
            _ => report.seq,
        };
        let last = before.as_ref().map_or(report.seq, |t| t.at);
        let known = before.map(|t| t.findings).unwrap_or_default();
        let findings: Findings = layout::keys(report)
            .map(|key| (key, known.get(&key).copied().unwrap_or(report.seq)))
            .collect();
        // Both have the first frame of each finding: a finding that comes back is news.
        let news = turned || findings != known;
        let due = news || report.seq.abs_diff(last) >= QUIET_FRAMES;
        if due {
            self.log(entity::LOG, &line(report.verdict, report.headline()))?;
        }
        if news {
            let sentences = layout::keys(report).zip(report.findings());
            let mut new = sentences.filter(|(key, _)| !known.contains_key(key));
            for (_, text) in new.by_ref().take(SHOWN) {
                self.log(entity::LOG, &line(report.verdict, text))?;
            }
            let more = new.count();
            if more > 0 {
                self.log(
                    entity::LOG,
                    &line(report.verdict, format!("and {more} more")),
                )?;
            }
            let status = layout::status(report, since, &findings, SHOWN);
            self.log(entity::STATUS, &TextDocument::from_markdown(status))?;
        }
        self.told = Some(Told {
            verdict: report.verdict,
            since,
            findings,
            at: if due { report.seq } else { last },
        });
        Ok(())
    }
}

impl Sink for ViewerSink {
    fn name(&self) -> &'static str {
        "viewer"
    }

    fn begin(&mut self, baseline: &BaselineRecord) -> Result<()> {
        let c = &baseline.certificate;
        self.greeting = Some(format!(
            "baseline ({}): {} curves, {} linked pairs, {} without a number",
            baseline.origin,
            c.curves,
            c.links.len(),
            c.undefined.len()
        ));
        Ok(())
    }

    fn frame(&mut self, record: &FrameRecord) -> Result<()> {
        let report = record.report.as_ref();
        let seq = i64::try_from(report.seq).unwrap_or(i64::MAX);
        self.rec.set_time_sequence(layout::FRAME, seq);
        if report.time.is_finite() {
            self.rec.set_duration_secs(layout::SIM_TIME, report.time);
        }
        if let Some(text) = self.greeting.take() {
            self.log(entity::LOG, &line(Verdict::Intact, text))?;
        }
        if let Some(set) = &record.curves {
            self.curves(set, report)?;
            self.places(set, report)?;
            self.last = Some(Arc::clone(set));
        }
        self.series(record)?;
        self.words(record)
    }

    fn flush(&mut self) -> Result<()> {
        self.rec.flush_async().map_err(failed)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        // A file opens where it ends: the eye can be set on what is there. Whoever watches a live viewer has
        // put the eye where they want it.
        if self.is_file {
            layout::send(&self.rec, self.last.as_deref()).map_err(failed)?;
        }
        self.rec.flush_with_timeout(FLUSH_LIMIT).map_err(failed)
    }
}

fn line(verdict: Verdict, text: impl Into<String>) -> TextLog {
    let level = match verdict {
        Verdict::Intact => TextLogLevel::INFO,
        Verdict::Changed => TextLogLevel::ERROR,
        _ => TextLogLevel::WARN,
    };
    let color = match verdict {
        Verdict::Intact => QUIET,
        Verdict::Changed => RED,
        _ => ORANGE,
    };
    TextLog::new(text.into())
        .with_level(level)
        .with_color(Color::from_u32(color))
}

fn failed(error: impl std::fmt::Display) -> Error {
    Error::Sink {
        sink: "viewer",
        what: error.to_string(),
    }
}
