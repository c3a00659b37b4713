//! Shows frames in the rerun viewer: in a running viewer, in one that is started here, or in a file
//! for later.
//!
//! The picture answers three questions at a glance: is the topology intact, which curves broke, and
//! since which frame. Intact curves are thin and muted, curves of a change are thick and red, and
//! those without a verdict are orange; each group is a separate entity. Marks name the pair, its
//! expected number and its current one. A pull-through is marked at its place, in its own colour; a
//! small mark stays on the curve from then on. Widths are in screen points, so that scenes of any
//! size look the same. The size of stars and the distance of labels follow from the curves around
//! them.
//!
//! The eye moves to the first violation, once; later the user controls it.
//!
//! Curves are one strip each: one strip per segment was measured to cost seven times as much.
//!
//! Only this module knows the crate `rerun`.

mod layout;
mod local;
mod passed;
mod target;

pub use target::ViewerTarget;

use crate::curve::{CurveSet, Point};
use crate::error::{Error, Result};
use crate::incremental::Route;
use crate::sinks::{BaselineRecord, FrameRecord, Sink};
use crate::verdict::{ChangeKind, Report, Verdict};
use layout::Scene;
use local::Spot;
use passed::Passed;
use rerun::components::{InterpolationMode, MarkerShape};
use rerun::external::re_sdk_types::blueprint::archetypes::EyeControls3D;
use rerun::{
    Color, LineStrips3D, Points3D, Radius, RecordingStream, Scalars, SeriesLines, SeriesPoints,
    TextDocument, TextLog, TextLogLevel, Transform3D,
};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// Paths of the entities.
mod entity {
    pub const CURVES: &str = "curves";
    pub const INTACT: &str = "curves/intact";
    pub const BROKEN: &str = "curves/broken";
    pub const UNDECIDED: &str = "curves/undecided";
    pub const PLACES: &str = "curves/places";
    pub const LABELS: &str = "curves/labels";
    pub const LEADERS: &str = "curves/labels/lines";
    pub const EVENTS: &str = "curves/pull-throughs/now";
    pub const STARS: &str = "curves/pull-throughs/stars";
    pub const PASSED: &str = "curves/pull-throughs/before";
    pub const LOG: &str = "log";
    pub const STATUS: &str = "status";
    pub const KEY: &str = "key";
    pub const LOST: &str = "links/lost";
    pub const GAINED: &str = "links/gained";
    pub const CHANGED: &str = "links/changed";
    pub const EVENT_COUNT: &str = "links/pull-throughs";
    pub const CHECK: &str = "check/time";
    /// In the order of [`crate::Route::ALL`].
    pub const ROUTES: [&str; 3] = ["check/full", "check/quiet", "check/partial"];
    pub const MARKED: &str = "marked/blocks";
    pub const RECOMPUTED: &str = "recomputed/pairs";
    pub const SKIPPED: &str = "skipped/frames";
}

/// Name under which viewers group runs and remember layouts.
const APPLICATION: &str = "linkwatch";

const QUIET: u32 = 0x6f809cff;
const RED: u32 = 0xff3b30ff;
const ORANGE: u32 = 0xff9f0aff;
/// Marks are paler than the curves below them, and labels, which have the same colour, stay
/// readable.
const PALE_RED: u32 = 0xffe3dfff;
const PALE_ORANGE: u32 = 0xfff0d2ff;
const VIOLET: u32 = 0xbf5af2ff;
const GREEN: u32 = 0x30d158ff;
const CYAN: u32 = 0x40d8ffff;
const DARK_GREEN: u32 = 0x1d6b33ff;

/// Maximum number of findings of a kind with a mark and a table row, and of findings with a log
/// line, because more would hide one another.
const SHOWN: usize = 20;

/// Marks closer than this, in radii of the scene, share a label.
const NEAR: f64 = 0.12;

/// Length of the rays of a pull-through's star, and distance of a label from its place, in sizes of
/// the feature there (see [`local::feature`]). A ray is a fifth of the radius of a ring.
const STAR: f64 = 0.14;
const DROP: f64 = 0.4;

/// Size of a feature without extent, in radii of the scene.
const DOT: f64 = 0.05;

/// Number of curves from which on intact ones are drawn thinner, because they would merge into a
/// surface.
const MANY: usize = 2000;

/// Number of frames between log lines while nothing changes.
const QUIET_FRAMES: u64 = 200;

/// Maximum number of points per segment of a spline, and approximate number of points in all.
const POINTS_PER_SEGMENT: usize = 6;
const POINTS: usize = 400_000;

/// Time limit of the viewer to accept all data at the end.
const FLUSH_LIMIT: Duration = Duration::from_secs(10);

/// Logs frames to rerun. Use it behind a [`crate::SinkQueue`] that drops the oldest frames, because
/// a viewer that stops reading blocks it.
pub struct ViewerSink {
    rec: RecordingStream,
    /// Message about the baseline. Logged with the first frame, because before it there is no time
    /// on the timelines.
    greeting: Option<String>,
    /// State of the log at the last frame, to log only what is new.
    logged: Option<Logged>,
    is_file: bool,
    /// Pull-throughs of the frames so far.
    passed: Passed,
    /// The newest curves.
    last: Option<Arc<CurveSet>>,
    /// Factor by which curves are enlarged. Known with the first curves.
    scale: Option<f64>,
    /// The newest status.
    status: String,
    first: Option<First>,
}

/// The first violation.
struct First {
    frame: i64,
    /// Eye near the place of the violation, if it has one.
    eye: Option<EyeControls3D>,
    status: String,
    /// Number of frames since then.
    later: u64,
}

/// Findings that last, each with the frame since which it has persisted.
type Findings = BTreeMap<layout::Key, u64>;

/// State of the log. A frame that differs in it gets a log line.
struct Logged {
    verdict: Verdict,
    /// First frame of this verdict.
    since: u64,
    findings: Findings,
    /// True if the status lists pull-throughs of its frame.
    events: bool,
    /// Frame of the last line.
    at: u64,
}

impl ViewerSink {
    /// Opens the viewer or the file, and lays out its views. `title` names the run.
    pub fn open(target: &ViewerTarget, title: &str) -> Result<ViewerSink> {
        Self::log_to(target.open(title)?, matches!(target, ViewerTarget::File(_)))
    }

    fn log_to(rec: RecordingStream, is_file: bool) -> Result<ViewerSink> {
        // The timelines have the simulation time; the time of logging is useless to a reader.
        rec.set_log_tick_enabled(false);
        rec.set_log_time_enabled(false);
        let sink = ViewerSink {
            rec,
            greeting: None,
            logged: None,
            is_file,
            passed: Passed::default(),
            last: None,
            scale: None,
            status: String::new(),
            first: None,
        };
        sink.layout(layout::FRAME, None)?;
        let key = TextDocument::from_markdown(layout::KEY);
        sink.rec.log_static(entity::KEY, &key).map_err(failed)?;
        let series = [
            (entity::LOST, RED, "links lost"),
            (entity::GAINED, VIOLET, "links gained"),
            (entity::CHANGED, ORANGE, "links changed"),
            (entity::CHECK, DARK_GREEN, "check, ms a frame"),
            (entity::MARKED, ORANGE, "blocks marked, %"),
            (entity::RECOMPUTED, RED, "pairs recomputed"),
            (entity::SKIPPED, ORANGE, "frames skipped so far"),
        ];
        for (path, color, name) in series {
            // Counts change in steps; times are measured at single frames.
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
        for (path, route) in entity::ROUTES.into_iter().zip(Route::ALL) {
            let color = match route {
                Route::Full => RED,
                Route::Quiet => GREEN,
                Route::Partial => ORANGE,
            };
            let style = series_points(color, route.word(), MarkerShape::Circle, 3.5);
            sink.rec.log_static(path, &style).map_err(failed)?;
        }
        Ok(sink)
    }

    fn log(&self, path: &str, what: &impl rerun::AsComponents) -> Result<()> {
        self.rec.log(path, what).map_err(failed)
    }

    /// Logs a line. In a file, the lines of later frames are also at the end of the timeline of the
    /// first violation, so that the file opens with the whole log.
    fn log_line(&self, line: &TextLog) -> Result<()> {
        match &self.first {
            Some(first) if self.is_file => {
                self.rec.set_time_sequence(layout::UNTIL, first.frame);
                let logged = self.log(entity::LOG, line);
                self.rec.disable_timeline(layout::UNTIL);
                logged
            }
            _ => self.log(entity::LOG, line),
        }
    }

    fn layout(&self, timeline: &str, eye: Option<&EyeControls3D>) -> Result<()> {
        layout::send(&self.rec, timeline, eye).map_err(failed)
    }

    /// Returns an eye that sees all of the newest curves, or those around a place if one is given.
    fn eye(&self, place: Option<(Point, f64)>) -> Option<EyeControls3D> {
        let scene = Scene::of(self.last.as_deref()?)?;
        Some(scene.eye(place, self.scale.unwrap_or(1.0)))
    }

    /// Records the first violation, and moves the eye there.
    fn note_first(&mut self, frame: i64, record: &FrameRecord) -> Result<()> {
        let report = record.report.as_ref();
        if let Some(first) = &mut self.first {
            first.later += 1;
        } else if report.verdict != Verdict::Intact {
            let set = record.curves.as_deref();
            let place = set.and_then(|set| local::first(set, report));
            let eye = place.and_then(|place| self.eye(Some(place)));
            if eye.is_some() {
                self.layout(layout::FRAME, eye.as_ref())?;
            }
            self.first = Some(First {
                frame,
                eye,
                status: self.status.clone(),
                later: 0,
            });
        }
        Ok(())
    }

    /// Makes a file open at the first violation, or at its end if there is none.
    fn open_at_first(&mut self) -> Result<()> {
        let (timeline, near) = match self.first.take() {
            Some(first) if first.later > 0 => {
                let (frames, follow) = match first.later {
                    1 => ("frame", "follows"),
                    _ => ("frames", "follow"),
                };
                let status = format!(
                    "{}
This is the first violation. {} {frames} {follow}: click on a frame of the \
                     log, or choose the timeline *{}* below.
",
                    first.status,
                    first.later,
                    layout::FRAME
                );
                self.rec.reset_time();
                self.rec.set_time_sequence(layout::UNTIL, first.frame);
                self.log(entity::STATUS, &TextDocument::from_markdown(status))?;
                (layout::UNTIL, first.eye)
            }
            Some(first) => (layout::FRAME, first.eye),
            None => (layout::FRAME, None),
        };
        let eye = near.or_else(|| self.eye(None));
        self.layout(timeline, eye.as_ref())
    }

    /// Logs all curves, each in its group. Empty groups are logged too, which clears those of the
    /// previous frame.
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
        for e in &report.unresolved {
            mark(e.i, 1);
            mark(e.j, 1);
        }
        for c in &report.changes {
            mark(c.i, 2);
            mark(c.j, 2);
        }
        for e in &report.events {
            mark(e.i, 2);
            mark(e.j, 2);
        }
        let detail = (POINTS / set.segments().max(1)).clamp(1, POINTS_PER_SEGMENT);
        let quiet = if set.len() < MANY { 0.8 } else { 0.35 };
        for (group, path, color, width) in [
            (0, entity::INTACT, QUIET, quiet),
            (1, entity::UNDECIDED, ORANGE, 2.0),
            (2, entity::BROKEN, RED, 2.5),
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

    /// Logs a dot on each curve of a finding, a star at each pull-through of this frame, and a
    /// label beside each place, broken pairs first. Findings close together share a label, because
    /// labels would cover one another.
    fn places(&self, set: &CurveSet, report: &Report) -> Result<()> {
        let changes = report.changes.iter().filter_map(|c| {
            let (numbers, place) = ((c.expected, c.found), c.place?);
            let text = format!(
                "{} & {}: linking number was {}, is {}",
                c.i, c.j, numbers.0, numbers.1
            );
            let spot = local::spot(set, [c.i, c.j], place.segments, place.point);
            Some((spot, text, PALE_RED))
        });
        let defects = report.defects.iter().map(|d| {
            let text = match d.j {
                Some(j) => format!("{} & {j} {}", d.i, d.kind.words()),
                None => format!("{} {}", d.i, d.kind.words()),
            };
            let curves = [d.i, d.j.unwrap_or(d.i)];
            let spot = local::spot(set, curves, d.place.segments, d.place.point);
            (spot, text, PALE_ORANGE)
        });
        let unresolved = report.unresolved.iter().map(|e| {
            let text = format!("{}: unresolved", passed::name(e));
            let spot = local::spot(set, [e.i, e.j], e.segments, e.point);
            (spot, text, PALE_ORANGE)
        });
        let undecided = defects.take(SHOWN).chain(unresolved.take(SHOWN));
        let marked: Vec<(Spot, String, u32)> = changes.take(SHOWN).chain(undecided).collect();
        let events = report.events.iter().take(passed::KEPT).map(|e| {
            let text = match e.i == e.j {
                true => passed::name(e),
                false => format!("{}, {:+}", passed::name(e), e.sign),
            };
            let mut spot = local::spot(set, [e.i, e.j], e.segments, e.point);
            spot.marks = vec![e.point];
            (spot, text, CYAN)
        });
        let events: Vec<(Spot, String, u32)> = events.collect();

        let dots = marked
            .iter()
            .flat_map(|(spot, _, color)| spot.marks.iter().map(|&p| (narrow(p), *color)));
        let (dots, colors): (Vec<_>, Vec<_>) = dots.unzip();
        self.log(entity::PLACES, &points(dots, 5.0).with_colors(colors))?;
        let centers = events.iter().map(|(spot, ..)| narrow(spot.marks[0]));
        self.log(entity::EVENTS, &points(centers, 6.5).with_colors([CYAN]))?;

        let scene = match marked.is_empty() && events.is_empty() {
            true => None,
            false => Scene::of(set),
        };
        let (radius, down) = scene.map_or((0.0, [0.0; 3]), |s| (s.radius, s.down()));
        let size = |spot: &Spot| match spot.size > 0.0 {
            true => spot.size.min(radius),
            false => DOT * radius,
        };
        let rays = events.iter().flat_map(|(spot, ..)| {
            let (center, reach) = (spot.marks[0], STAR * size(spot));
            [0, 1, 2].map(|x| {
                [-reach, reach].map(|reach| {
                    let mut end = center;
                    end[x] += reach;
                    narrow(end)
                })
            })
        });
        self.log(entity::STARS, &lines(rays, 2.0).with_colors([CYAN]))?;

        let near_sq = (NEAR * radius).powi(2);
        let mut labels: Vec<(&Spot, Vec<&str>, u32)> = Vec::new();
        for (spot, text, color) in marked.iter().chain(events.iter().take(SHOWN)) {
            let point = spot.marks[0];
            let close = |other: &Spot| {
                let other = other.marks[0];
                (0..3).map(|x| (other[x] - point[x]).powi(2)).sum::<f64>() < near_sq
            };
            match labels.iter_mut().find(|(other, ..)| close(other)) {
                Some((_, texts, _)) => texts.push(text),
                None => labels.push((spot, vec![text], *color)),
            }
        }
        let colors: Vec<u32> = labels.iter().map(|(.., color)| *color).collect();
        // From the mark to the label, which is below its point.
        let leaders = labels.iter().map(|(spot, ..)| {
            let (start, drop) = (spot.marks[0], DROP * size(spot));
            [start, [0, 1, 2].map(|x| start[x] + drop * down[x])].map(narrow)
        });
        let leaders: Vec<_> = leaders.collect();
        let labelled = points(leaders.iter().map(|[_, end]| *end), 0.0)
            .with_labels(labels.iter().map(|(_, texts, _)| texts.join("\n")))
            .with_colors(colors.clone())
            .with_show_labels(true);
        self.log(entity::LABELS, &labelled)?;
        self.log(entity::LEADERS, &lines(leaders, 0.6).with_colors(colors))
    }

    /// Logs a small mark on the curves for each pull-through of earlier frames.
    fn passed(&self, set: &CurveSet) -> Result<()> {
        let before = self.passed.points(set).map(narrow);
        self.log(entity::PASSED, &points(before, 5.0).with_colors([CYAN]))
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
        // A point for each frame that has some, because a line would cover that of the links.
        if !record.report.events.is_empty() {
            let events = record.report.events.len() as f64;
            self.log(entity::EVENT_COUNT, &Scalars::single(events))?;
        }
        let check_ms = record.check.as_secs_f64() * 1e3;
        self.log(entity::CHECK, &Scalars::single(check_ms))?;
        if record.report.verdict != Verdict::Rejected {
            let work = &record.work;
            let route = entity::ROUTES[work.route as usize];
            self.log(route, &Scalars::single(check_ms))?;
            // A frame that was not compared with a reference frame has no blocks to mark.
            if work.blocks > 0 {
                let marked = 100.0 * work.marked as f64 / work.blocks as f64;
                self.log(entity::MARKED, &Scalars::single(marked))?;
            }
            self.log(entity::RECOMPUTED, &Scalars::single(work.recomputed as f64))?;
        }
        self.log(entity::SKIPPED, &Scalars::single(record.skipped as f64))
    }

    /// Logs a line for every frame with news, a sentence for each new finding, and occasionally a
    /// line for a frame without news. Updates the status if it is outdated.
    fn words(&mut self, record: &FrameRecord) -> Result<()> {
        let report = record.report.as_ref();
        let before = self.logged.take();
        let turned = before.as_ref().is_none_or(|t| t.verdict != report.verdict);
        let since = match &before {
            Some(t) if !turned => t.since,
            _ => report.seq,
        };
        let last = before.as_ref().map_or(report.seq, |t| t.at);
        let had_events = before.as_ref().is_some_and(|t| t.events);
        let known = before.map(|t| t.findings).unwrap_or_default();
        let findings: Findings = layout::keys(report)
            .flatten()
            .map(|key| (key, known.get(&key).copied().unwrap_or(report.seq)))
            .collect();
        // The findings contain the first frame of each, so a finding that returns is new.
        let has_events = !report.events.is_empty();
        let news = turned || has_events || findings != known;
        let due = news || report.seq.abs_diff(last) >= QUIET_FRAMES;
        if due {
            self.log_line(&line(report.verdict, report.headline()))?;
        }
        if news {
            let sentences = layout::keys(report).zip(report.findings());
            let is_new = |key: &Option<layout::Key>| key.is_none_or(|k| !known.contains_key(&k));
            let mut new = sentences.filter(|(key, _)| is_new(key));
            for (key, text) in new.by_ref().take(SHOWN) {
                let line = line(report.verdict, text);
                // In the colour of its mark.
                let line = match key {
                    None => line.with_color(Color::from_u32(CYAN)),
                    Some(_) => line,
                };
                self.log_line(&line)?;
            }
            let more = new.count();
            if more > 0 {
                self.log_line(&line(report.verdict, format!("and {more} more")))?;
            }
        }
        if news || had_events {
            self.status = layout::status(report, since, &findings, &self.passed, SHOWN);
            let status = TextDocument::from_markdown(self.status.clone());
            self.log(entity::STATUS, &status)?;
        }
        self.logged = Some(Logged {
            verdict: report.verdict,
            since,
            findings,
            events: has_events,
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
        if self.is_file {
            match &self.first {
                None => self.rec.set_time_sequence(layout::UNTIL, seq),
                Some(_) => self.rec.disable_timeline(layout::UNTIL),
            }
        }
        if report.time.is_finite() {
            self.rec.set_duration_secs(layout::SIM_TIME, report.time);
        }
        if let Some(text) = self.greeting.take() {
            self.log_line(&line(Verdict::Intact, text))?;
        }
        if let Some(set) = &record.curves {
            if self.scale.is_none() {
                let scale = layout::scale(set);
                let larger = Transform3D::from_scale(scale as f32);
                self.rec
                    .log_static(entity::CURVES, &larger)
                    .map_err(failed)?;
                self.scale = Some(scale);
            }
            self.curves(set, report)?;
            self.places(set, report)?;
            self.passed(set)?;
            self.last = Some(Arc::clone(set));
        }
        if self.passed.words().is_none() && !report.events.is_empty() {
            // Not before the first event, because the viewer reports an error for a series without
            // data.
            let style = series_points(CYAN, "pull-throughs", MarkerShape::Diamond, 6.0);
            self.rec
                .log_static(entity::EVENT_COUNT, &style)
                .map_err(failed)?;
        }
        self.passed.add(report, record.curves.as_deref());
        self.series(record)?;
        self.words(record)?;
        self.note_first(seq, record)
    }

    fn flush(&mut self) -> Result<()> {
        self.rec.flush_async().map_err(failed)
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        if self.is_file {
            self.open_at_first()?;
        }
        self.rec.flush_with_timeout(FLUSH_LIMIT).map_err(failed)
    }
}

/// Returns the style of a series of points.
fn series_points(color: u32, name: &str, shape: MarkerShape, size: f32) -> SeriesPoints {
    SeriesPoints::new()
        .with_colors([color])
        .with_names([name])
        .with_markers([shape])
        .with_marker_sizes([size])
}

/// Returns points with a size on the screen.
fn points(points: impl IntoIterator<Item = [f32; 3]>, size: f32) -> Points3D {
    Points3D::new(points).with_radii([Radius::new_ui_points(size)])
}

/// Returns lines with a width on the screen.
fn lines(lines: impl IntoIterator<Item = [[f32; 3]; 2]>, width: f32) -> LineStrips3D {
    LineStrips3D::new(lines).with_radii([Radius::new_ui_points(width)])
}

fn narrow(p: Point) -> [f32; 3] {
    p.map(|x| x as f32)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};
    use crate::incremental::Work;
    use crate::verdict::PullThrough;
    use rerun::RecordingStreamBuilder;
    use rerun::external::re_sdk_types::blueprint::archetypes::TimePanelBlueprint;
    use rerun::log::{Chunk, LogMsg};
    use rerun::sink::MemorySinkStorage;
    use std::time::SystemTime;

    /// A triangle at height `z`; `None` for a frame without curves.
    fn record(seq: u64, z: Option<f32>, events: Vec<PullThrough>) -> FrameRecord {
        let set = |z| {
            let points = [0.0, 0.0, z, 2.0, 0.0, z, 0.0, 2.0, z];
            CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F32(&points)).unwrap()
        };
        let mut report = Report {
            seq,
            time: seq as f64,
            verdict: match (z, events.is_empty()) {
                (None, _) => Verdict::Rejected,
                (_, true) => Verdict::Intact,
                (_, false) => Verdict::Changed,
            },
            abort: false,
            changes: Vec::new(),
            events,
            unresolved: Vec::new(),
            adopted: Vec::new(),
            defects: Vec::new(),
            rejected: None,
            stats: Default::default(),
        };
        report.abort = report.verdict == Verdict::Changed;
        FrameRecord {
            curves: z.map(set).map(Arc::new),
            cuts: 0,
            report: Arc::new(report),
            verified: seq,
            skipped: 0,
            rejected: 0,
            check: Duration::from_millis(1),
            work: Work::default(),
            received: SystemTime::UNIX_EPOCH,
        }
    }

    fn event(point: Point) -> PullThrough {
        PullThrough {
            i: 0,
            j: 0,
            segments: [1, 2],
            fraction: 0.5,
            sign: -1,
            point,
            lengths: 0.5,
        }
    }

    /// Returns the chunks logged for an entity.
    fn chunks(messages: &[LogMsg], path: &str) -> impl Iterator<Item = Chunk> {
        let chunks = messages.iter().filter_map(|message| match message {
            LogMsg::ArrowMsg(_, message) => Chunk::from_arrow_msg(message).ok(),
            _ => None,
        });
        chunks.filter(move |c| *c.entity_path() == path.into())
    }

    /// Points of an entity with their labels, a row for each time that they were logged.
    type Points = Vec<(Vec<[f32; 3]>, Vec<String>)>;

    fn points(messages: &[LogMsg], path: &str) -> Points {
        let mut rows = Vec::new();
        for chunk in chunks(messages, path) {
            let positions = Points3D::descriptor_positions().component;
            let labels = Points3D::descriptor_labels().component;
            let mut labels = chunk.iter_slices::<String>(labels);
            for row in chunk.iter_slices::<[f32; 3]>(positions) {
                let words = labels.next().unwrap_or_default();
                rows.push((row.to_vec(), words.iter().map(|w| w.to_string()).collect()));
            }
        }
        rows
    }

    fn logged(frames: &[FrameRecord]) -> Vec<LogMsg> {
        let (rec, storage): (_, MemorySinkStorage) =
            RecordingStreamBuilder::new(APPLICATION).memory().unwrap();
        let mut sink = ViewerSink::log_to(rec, false).unwrap();
        for frame in frames {
            sink.frame(frame).unwrap();
        }
        storage.take()
    }

    #[test]
    fn a_pull_through_keeps_a_mark_that_moves_with_the_curve() {
        let messages = logged(&[
            record(1, Some(0.0), Vec::new()),
            record(
                2,
                Some(1.0),
                vec![event([1.0, 1.25, 1.0]), event([1.0, 1.25, 1.0])],
            ),
            record(3, None, Vec::new()),
            record(4, Some(7.0), Vec::new()),
        ]);
        let marked = |path| {
            points(&messages, path)
                .into_iter()
                .map(|(p, _)| p)
                .collect()
        };
        let now: Vec<Vec<_>> = marked(entity::EVENTS);
        assert_eq!(now, [vec![], vec![[1.0, 1.25, 1.0]; 2], vec![]]);
        let before: Vec<Vec<_>> = marked(entity::PASSED);
        assert_eq!(before, [vec![], vec![], vec![[0.875, 1.125, 7.0]; 2]]);
        // One label for both, in their frame only.
        let places = points(&messages, entity::LABELS);
        let labels: Vec<_> = places.into_iter().map(|(_, words)| words).collect();
        let both = "0 through itself\n0 through itself".to_owned();
        assert_eq!(labels, [vec![], vec![both], vec![]]);
        let broken: Vec<_> = strips(&messages, entity::BROKEN);
        assert_eq!(broken, [0, 1, 0]);
    }

    /// Returns the messages of a file.
    fn written(frames: &[FrameRecord]) -> Vec<LogMsg> {
        let (rec, storage): (_, MemorySinkStorage) =
            RecordingStreamBuilder::new(APPLICATION).memory().unwrap();
        let mut sink = ViewerSink::log_to(rec, true).unwrap();
        for frame in frames {
            sink.frame(frame).unwrap();
        }
        Box::new(sink).finish().unwrap();
        storage.take()
    }

    /// Returns the timelines of the layouts, in the order in which they were sent, and the number
    /// of eyes.
    fn layouts(messages: &[LogMsg]) -> (Vec<String>, usize) {
        let chunks = messages.iter().filter_map(|message| match message {
            LogMsg::ArrowMsg(_, message) => Chunk::from_arrow_msg(message).ok(),
            _ => None,
        });
        let is_eye = |c: &Chunk| c.entity_path().to_string().ends_with("EyeControls3D");
        let eyes = chunks.filter(is_eye).count();
        let timeline = TimePanelBlueprint::descriptor_timeline().component;
        let mut timelines = Vec::new();
        for chunk in self::chunks(messages, "time_panel") {
            let rows = chunk.iter_slices::<String>(timeline);
            timelines.extend(rows.flatten().map(|name| name.to_string()));
        }
        (timelines, eyes)
    }

    fn broken(seq: u64) -> FrameRecord {
        record(seq, Some(0.0), vec![event([1.0, 1.0, 0.0])])
    }

    fn intact(seq: u64) -> FrameRecord {
        record(seq, Some(0.0), Vec::new())
    }

    #[test]
    fn a_file_opens_at_the_first_violation_and_has_the_whole_log() {
        let messages = written(&[intact(1), broken(2), intact(3), broken(4)]);
        let (timelines, eyes) = layouts(&messages);
        assert_eq!(timelines, ["frame", "frame", "until_violation"]);
        assert_eq!(eyes, 2, "at the violation, and at the end");
        let until = layout::UNTIL.into();
        let ends = messages.iter().filter_map(|message| match message {
            LogMsg::ArrowMsg(_, message) => Chunk::from_arrow_msg(message).ok(),
            _ => None,
        });
        let ends = ends.filter_map(|c| Some(c.timelines().get(&until)?.time_range().max()));
        assert_eq!(ends.max().map(|t| t.as_i64()), Some(2));
        let is_until = |c: &Chunk| c.timelines().contains_key(&until);
        let lines = chunks(&messages, entity::LOG).filter(is_until);
        let lines: usize = lines.map(|c| c.num_rows()).sum();
        assert_eq!(lines, texts(&messages, entity::LOG).len());
        // Chunks of different timelines may come in any order; the note is on one timeline only.
        let mut noted = chunks(&messages, entity::STATUS).filter(|c| c.timelines().len() == 1);
        let text = TextDocument::descriptor_text().component;
        let note = noted.next().unwrap();
        assert!(is_until(&note) && noted.next().is_none());
        let words: Vec<_> = note.iter_slices::<String>(text).flatten().collect();
        let follow = "This is the first violation. 2 frames follow: click";
        assert!(words[0].contains(follow), "{words:?}");
    }

    #[test]
    fn a_file_opens_at_its_end_if_nothing_follows_the_violation() {
        for frames in [[intact(1), broken(2)], [intact(1), intact(2)]] {
            let (timelines, eyes) = layouts(&written(&frames));
            assert_eq!(timelines.last().map(String::as_str), Some("frame"));
            assert!(eyes > 0);
        }
    }

    #[test]
    fn the_eye_of_a_live_viewer_is_moved_once() {
        let messages = logged(&[intact(1), broken(2), broken(3), intact(4), broken(5)]);
        let (timelines, eyes) = layouts(&messages);
        assert_eq!(timelines, ["frame", "frame"]);
        assert_eq!(eyes, 1);
    }

    /// Returns the number of curves of an entity, for each time that it was logged.
    fn strips(messages: &[LogMsg], path: &str) -> Vec<usize> {
        let component = LineStrips3D::descriptor_strips().component;
        let mut counts = Vec::new();
        for chunk in chunks(messages, path) {
            let rows = chunk.iter_component::<rerun::components::LineStrip3D>(component);
            rows.for_each(|row| counts.push(row.as_slice().len()));
        }
        counts
    }

    #[test]
    fn every_pull_through_is_logged() {
        let frame = |seq| record(seq, Some(0.0), vec![event([0.0; 3])]);
        let messages = logged(&[frame(1), frame(2), frame(3)]);
        let texts = texts(&messages, entity::LOG);
        let logged = texts.iter().filter(|t| t.contains("passed through itself"));
        assert_eq!(logged.count(), 3, "{texts:?}");
    }

    fn texts(messages: &[LogMsg], path: &str) -> Vec<String> {
        let component = TextLog::descriptor_text().component;
        let mut texts = Vec::new();
        for chunk in chunks(messages, path) {
            let rows = chunk.iter_slices::<String>(component);
            texts.extend(rows.flatten().map(|text| text.to_string()));
        }
        texts
    }
}
