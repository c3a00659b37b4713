//! Plots of the counts and times of the frames.

use super::names::entity;
use super::stream::{log, log_static};
use super::style::{CYAN, DARK_GREEN, GREEN, ORANGE, QUIET, RED, VIOLET, YELLOW, series_points};
use crate::error::Result;
use crate::incremental::Route;
use crate::sinks::FrameRecord;
use crate::verdict::{ChangeKind, Verdict};
use re_sdk::RecordingStream;
use re_sdk_types::archetypes::{Scalars, SeriesLines};
use re_sdk_types::components::{InterpolationMode, MarkerShape};
use std::time::Duration;

/// Logs the names and colours of all series except for the pull-throughs.
pub(super) fn describe(rec: &RecordingStream) -> Result<()> {
    let series = [
        (entity::LOST, RED, "links lost"),
        (entity::GAINED, VIOLET, "links gained"),
        (entity::CHANGED, ORANGE, "links changed"),
        (entity::CHECK, DARK_GREEN, "check, ms a frame"),
        (entity::INGEST, CYAN, "ingest"),
        (entity::VERIFICATION, DARK_GREEN, "verification"),
        (entity::BOXES, QUIET, "boxes"),
        (entity::PAIRS, ORANGE, "potential links"),
        (entity::LINKING, RED, "linking numbers"),
        (entity::SEARCH, GREEN, "search for pull-throughs"),
        (entity::MARKED, ORANGE, "blocks marked, %"),
        (entity::RECOMPUTED, RED, "pairs recomputed"),
        (entity::SKIPPED, ORANGE, "frames skipped so far"),
    ];
    for (path, color, name) in series {
        describe_line(rec, path, color, name)?;
    }
    for (path, route) in entity::ROUTES.into_iter().zip(Route::ALL) {
        let color = match route {
            Route::Full => RED,
            Route::Quiet => GREEN,
            Route::Partial => ORANGE,
        };
        let style = series_points(color, route.word(), MarkerShape::Circle, 3.5);
        log_static(rec, path, &style)?;
    }
    Ok(())
}

/// Logs the name and colour of a line.
fn describe_line(rec: &RecordingStream, path: &str, color: u32, name: &str) -> Result<()> {
    // Counts change in steps; times are measured at single frames.
    let mode = match path {
        _ if path.starts_with("times/") => InterpolationMode::Linear,
        entity::CHECK | entity::WAIT => InterpolationMode::Linear,
        _ => InterpolationMode::StepAfter,
    };
    let style = SeriesLines::new()
        .with_colors([color])
        .with_names([name])
        .with_widths([2.5])
        .with_interpolation_mode(mode);
    log_static(rec, path, &style)
}

/// Logs the names and colours of the times of live frames. Call it before the first one but no
/// earlier, because the viewer reports an error for a series without data.
pub(super) fn describe_live(rec: &RecordingStream) -> Result<()> {
    describe_line(rec, entity::WAIT, VIOLET, "wait for the frame")?;
    describe_line(rec, entity::SEND, VIOLET, "verdict sent")
}

/// Logs the name and colour of the time of the clearance, if it is measured.
pub(super) fn describe_clearance(rec: &RecordingStream) -> Result<()> {
    describe_line(rec, entity::MEASURE, YELLOW, "clearance")
}

/// Logs the name and colour of the pull-throughs. Call it before the first one but no earlier,
/// because the viewer reports an error for a series without data.
pub(super) fn describe_events(rec: &RecordingStream) -> Result<()> {
    let style = series_points(CYAN, "pull-throughs", MarkerShape::Diamond, 6.0);
    log_static(rec, entity::EVENT_COUNT, &style)
}

/// Logs the counts and times of a frame.
pub(super) fn add(rec: &RecordingStream, record: &FrameRecord) -> Result<()> {
    for (path, kind) in [
        (entity::LOST, ChangeKind::Lost),
        (entity::GAINED, ChangeKind::Gained),
        (entity::CHANGED, ChangeKind::Changed),
    ] {
        let count = record.report.count(kind) as f64;
        log(rec, path, &Scalars::single(count))?;
    }
    // A point for each frame that has some, because a line would cover that of the links.
    if !record.report.events.is_empty() {
        let events = record.report.events.len() as f64;
        log(rec, entity::EVENT_COUNT, &Scalars::single(events))?;
    }
    let times = &record.times;
    let check_ms = ms(times.check());
    log(rec, entity::CHECK, &Scalars::single(check_ms))?;
    log(rec, entity::INGEST, &Scalars::single(ms(times.ingest)))?;
    log(
        rec,
        entity::VERIFICATION,
        &Scalars::single(ms(times.verification)),
    )?;
    if let Some(live) = &times.live {
        log(rec, entity::WAIT, &Scalars::single(ms(live.wait)))?;
        log(rec, entity::SEND, &Scalars::single(ms(live.send)))?;
    }
    if record.report.verdict != Verdict::Rejected {
        let work = &record.work;
        let stages = &times.stages;
        for (path, time) in [
            (entity::BOXES, stages.boxes),
            (entity::PAIRS, stages.pairs),
            (entity::LINKING, stages.links),
            (entity::SEARCH, stages.events),
        ] {
            log(rec, path, &Scalars::single(ms(time)))?;
        }
        if record.report.clearance.is_some() {
            log(rec, entity::MEASURE, &Scalars::single(ms(stages.clearance)))?;
        }
        let route = entity::ROUTES[work.route as usize];
        log(rec, route, &Scalars::single(check_ms))?;
        // A frame that was not compared with a reference frame has no blocks to mark.
        if work.blocks > 0 {
            let marked = 100.0 * work.marked as f64 / work.blocks as f64;
            log(rec, entity::MARKED, &Scalars::single(marked))?;
        }
        log(
            rec,
            entity::RECOMPUTED,
            &Scalars::single(work.recomputed as f64),
        )?;
    }
    log(
        rec,
        entity::SKIPPED,
        &Scalars::single(record.skipped as f64),
    )
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
