//! Shows frames in the rerun viewer: in a running viewer, in one that is started here, or in a file
//! for later.
//!
//! The picture answers three questions at a glance: is the topology intact, which curves broke, and
//! since which frame. Intact curves are thin and muted, and more so beside a violation; curves of a
//! change are thick and red, and those without a verdict are orange. Marks name the pair, its
//! expected number and its current one. A pull-through is marked at its place, in its own colour; a
//! small mark stays on the curve from then on. Widths are in screen points, so that scenes of any
//! size look the same. The size of stars and the distance of labels follow from the curves around
//! them.
//!
//! The eye moves to the first violation, once; later the user controls it.
//!
//! Curves are one strip each: one strip per segment was measured to cost seven times as much. Those
//! that did not move are not logged again (see [`curves`]).
//!
//! A simulator that rolls back publishes times that were shown before. These frames are on the
//! timeline of frames only, because two runs would mix on the timeline of times.
//!
//! Only this module knows the crate `rerun`.

mod cell;
mod clearance;
#[cfg(test)]
mod curve_tests;
mod curves;
mod label;
mod layout;
mod local;
mod log;
mod names;
mod passed;
mod picture;
mod plots;
mod program;
mod status;
mod stream;
mod style;
mod target;
#[cfg(test)]
mod tests;
mod tubes;
mod view;

pub use target::ViewerTarget;

use self::cell::CellView;
use self::clearance::ClearanceView;
use self::curves::Curves;
use self::log::{Log, line};
use self::names::{FRAME, SIM_TIME, UNTIL, entity};
use self::passed::Passed;
use self::stream::{Drawing, failed, log, log_static, write};
use self::tubes::{MomentViews, Moments};
use self::view::View;
use crate::curve::Point;
use crate::error::Result;
use crate::measure::ClearanceOptions;
use crate::sinks::{BaselineRecord, FrameRecord, Sink};
use crate::verdict::Verdict;
use crate::words::plural_of;
use re_sdk::RecordingStream;
use re_sdk_types::archetypes::{TextDocument, TextLog, Transform3D};
use re_sdk_types::blueprint::archetypes::EyeControls3D;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::Duration;

/// Time limit of the viewer to accept all data so far: some 250 MB may wait for it.
const FLUSH_LIMIT: Duration = Duration::from_secs(60);

/// Number of frames after which a live viewer receives all curves again. A server drops its oldest
/// data at some time, and a browser that opens later would not show curves that are at rest.
const REPEAT: u64 = 1000;

/// Logs frames to rerun. Use it behind a [`crate::SinkQueue`], because a viewer that stops reading
/// blocks it.
pub struct ViewerSink {
    rec: RecordingStream,
    /// Message about the baseline. Logged with the first frame, because before it there is no time
    /// on the timelines.
    greeting: Option<String>,
    log: Log,
    is_file: bool,
    /// The curves of every n-th frame are shown.
    every: NonZeroU64,
    /// Number of frames so far.
    frames: u64,
    /// The latest simulation time so far, and true if that of the last frame was earlier.
    latest: f64,
    is_earlier: bool,
    /// True if the next picture has all curves, moved or not.
    redraws: bool,
    /// Pull-throughs of the frames so far.
    passed: Passed,
    /// Layout of the newest curves.
    layout: u32,
    curves: Curves,
    /// Factor by which curves are enlarged. Known with the first curves.
    scale: Option<f64>,
    /// The newest status.
    status: String,
    first: Option<First>,
    /// Moments of the first violation, until the next frame, and their views after it.
    moments: Option<Moments>,
    moment_views: Option<MomentViews>,
    cell: CellView,
    clearance: Option<ClearanceView>,
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

impl ViewerSink {
    /// Opens the viewer or the file, and lays out its views. `title` names the run.
    ///
    /// # Errors
    ///
    /// The viewer does not start or cannot be reached; the file cannot be created.
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
            log: Log::default(),
            is_file,
            every: NonZeroU64::MIN,
            frames: 0,
            latest: f64::NEG_INFINITY,
            is_earlier: false,
            redraws: false,
            passed: Passed::default(),
            layout: 0,
            curves: Curves::default(),
            scale: None,
            status: String::new(),
            first: None,
            moments: None,
            moment_views: None,
            cell: CellView::default(),
            clearance: None,
        };
        sink.layout(FRAME, None)?;
        let key = TextDocument::from_markdown(layout::KEY);
        log_static(&sink.rec, entity::KEY, &key)?;
        plots::describe(&sink.rec)?;
        Ok(sink)
    }

    /// Shows the curves of every n-th frame, and of each frame whose verdict is not intact or
    /// differs from that of the previous one. The log and the plots have all frames.
    pub fn with_every(mut self, every: NonZeroU64) -> ViewerSink {
        self.every = every;
        self
    }

    /// Also shows the clearance of strands, if the frames have it.
    ///
    /// # Errors
    ///
    /// The errors of [`ClearanceOptions`]: a length that is not positive.
    pub fn with_clearance(mut self, options: ClearanceOptions) -> Result<ViewerSink> {
        self.clearance = Some(ClearanceView::new(options));
        self.layout(FRAME, None)?;
        let key = format!("{}\n{}", layout::KEY, layout::CLEARANCE_KEY);
        log_static(&self.rec, entity::KEY, &TextDocument::from_markdown(key))?;
        plots::describe_clearance(&self.rec)?;
        Ok(self)
    }

    /// Shows the clearance of a frame, on its curves if they are drawn, and logs a line if it
    /// becomes low.
    fn add_clearance(&mut self, record: &FrameRecord, draws: bool) -> Result<()> {
        let Some(view) = &mut self.clearance else {
            return Ok(());
        };
        plots::add_clearance(&self.rec, record, view.options.low)?;
        let Some(found) = &record.report.clearance else {
            return Ok(());
        };
        let labels = &record.info.labels;
        if let Some(set) = record.curves.as_ref().filter(|_| draws) {
            let rec = &self.rec;
            view.draw(&Drawing { rec, set, record })?;
        }
        let becomes_low = view.becomes_low(found);
        match found.sentence_named(record.report.stats.extent, &labels.names) {
            Some(text) if becomes_low => {
                let text = format!("low clearance: {text}");
                self.log_line(&line(Verdict::Undecided, text))
            }
            _ => Ok(()),
        }
    }

    /// Logs a line. The lines of later frames are also at the end of the timeline of the first
    /// violation, so that the run opens with the whole log.
    fn log_line(&self, line: &TextLog) -> Result<()> {
        match &self.first {
            Some(first) => {
                self.rec.set_time_sequence(UNTIL, first.frame);
                let logged = log(&self.rec, entity::LOG, line);
                self.rec.disable_timeline(UNTIL);
                logged
            }
            None => log(&self.rec, entity::LOG, line),
        }
    }

    /// Places the following data at a simulation time.
    fn set_time(&mut self, time: f64) -> Result<()> {
        if !time.is_finite() {
            return Ok(());
        }
        let was_earlier = std::mem::replace(&mut self.is_earlier, time < self.latest);
        if self.is_earlier {
            self.rec.disable_timeline(SIM_TIME);
            return Ok(());
        }
        self.rec.set_duration_secs(SIM_TIME, time);
        self.latest = time;
        if was_earlier {
            // The timeline misses what was logged at earlier times.
            self.redraws = true;
            write(&self.rec, entity::STATUS, &self.status)?;
        }
        Ok(())
    }

    /// Returns true if the curves of the next frame are to be logged: those of every n-th frame,
    /// and if its verdict is not intact or differs from the previous one.
    fn is_drawn(&mut self, verdict: Verdict) -> bool {
        let turns = self.log.verdict != Some(verdict);
        let due = self.frames.is_multiple_of(self.every.get());
        self.frames += 1;
        self.redraws |= !self.is_file && self.frames.is_multiple_of(REPEAT);
        due || turns || verdict != Verdict::Intact
    }

    /// Returns an eye that sees all of the newest curves, or those around a place if one is given.
    fn eye(&self, place: Option<(Point, f64)>) -> Option<EyeControls3D> {
        let view = View::of(&self.curves.shown.as_ref()?.1)?;
        Some(view.eye(place, self.scale.unwrap_or(1.0)))
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
                self.layout(FRAME, eye.as_ref())?;
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

    /// Makes a run that has ended open at the first violation, or at its end if there is none.
    fn open_at_first(&mut self) -> Result<()> {
        if let (Some(_), Some(views)) = (&self.moments, &mut self.moment_views) {
            views.names[2] = None;
        }
        let (timeline, near) = match self.first.take() {
            Some(first) if first.later > 0 => {
                let follow = plural_of(first.later, "frame follows", "frames follow");
                let status = format!(
                    "{}
This is the first violation. {follow}: click on a frame of the log, or choose \
                     the timeline *{FRAME}* below.
",
                    first.status
                );
                self.rec.reset_time();
                self.rec.set_time_sequence(UNTIL, first.frame);
                write(&self.rec, entity::STATUS, &status)?;
                (UNTIL, first.eye)
            }
            Some(first) => (FRAME, first.eye),
            None => (FRAME, None),
        };
        let eye = near.or_else(|| self.eye(None));
        self.layout(timeline, eye.as_ref())
    }
}

impl Sink for ViewerSink {
    fn begin(&mut self, baseline: &BaselineRecord) -> Result<()> {
        let c = &baseline.certificate;
        self.greeting = Some(format!(
            "baseline ({}): {} curves, {} linked pairs, {} without a number",
            baseline.origin,
            c.curves,
            c.links.len() + c.images.as_ref().map_or(0, Vec::len),
            c.undefined.len()
        ));
        Ok(())
    }

    fn frame(&mut self, record: &FrameRecord) -> Result<()> {
        let report = record.report.as_ref();
        let seq = i64::try_from(report.seq).unwrap_or(i64::MAX);
        self.rec.set_time_sequence(FRAME, seq);
        match &self.first {
            None => self.rec.set_time_sequence(UNTIL, seq),
            Some(_) => self.rec.disable_timeline(UNTIL),
        }
        self.set_time(report.time)?;
        if let Some(text) = self.greeting.take() {
            self.log_line(&line(Verdict::Intact, text))?;
        }
        let draws = self.is_drawn(report.verdict);
        if let Some(set) = record.curves.as_ref().filter(|_| draws) {
            if std::mem::replace(&mut self.layout, record.info.layout) != record.info.layout {
                // The marks are on curves with other indices.
                self.passed.marks.clear();
            }
            if self.scale.is_none() {
                let scale = view::scale(set);
                let larger = Transform3D::from_scale(scale as f32);
                log_static(&self.rec, entity::CURVES, &larger)?;
                self.scale = Some(scale);
            }
            let redraws = std::mem::take(&mut self.redraws);
            let rec = &self.rec;
            let drawing = Drawing { rec, set, record };
            let scale = self.scale.unwrap_or(1.0);
            if let Some(moments) = self.moments.take() {
                let after = Some((report.seq, Arc::clone(set)));
                self.moment_views = moments.draw(&drawing, after, scale)?;
            } else if self.first.is_none()
                && report.verdict != Verdict::Intact
                && let Some(moments) = Moments::of(&drawing, self.curves.shown.clone())
            {
                self.moment_views = moments.draw(&drawing, None, scale)?;
                // A live viewer gets its layout only once, so it gets the view "after" now, which
                // stays empty until the next frame.
                if let Some(views) = &mut self.moment_views {
                    views.names[2] = Some("after".into());
                }
                self.moments = Some(moments);
            }
            self.curves.draw(&drawing, redraws)?;
            tubes::draw(&drawing)?;
            self.cell.draw(&drawing)?;
            picture::draw_places(&drawing)?;
            picture::draw_passed(&drawing, &self.passed)?;
        }
        self.passed.add(report, record.curves.as_deref());
        plots::add(&self.rec, record)?;
        self.add_clearance(record, draws)?;
        let names = &record.info.labels.names;
        let news = self.log.news(report, names, &self.passed);
        for line in &news.lines {
            self.log_line(line)?;
        }
        if let Some(status) = news.status {
            write(&self.rec, entity::STATUS, &status)?;
            self.status = status;
        }
        self.note_first(seq, record)
    }

    /// Waits for the viewer or the disk: what was not accepted is lost if either fails.
    fn flush(&mut self) -> Result<()> {
        let flushed = self.rec.flush_with_timeout(FLUSH_LIMIT);
        flushed.map_err(|e| match self.is_file {
            // The library has logged the error of the system.
            true => failed(format_args!(
                "its file is not complete: see the error above ({e})"
            )),
            false => failed(e),
        })
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.open_at_first()?;
        self.flush()
    }
}
