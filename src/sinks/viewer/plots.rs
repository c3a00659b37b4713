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

/// Logs the names and colours of all series except for those of the clearance.
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
        (entity::WAIT, VIOLET, "wait for the frame"),
        (entity::SEND, VIOLET, "verdict sent"),
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
    let events = series_points(CYAN, "pull-throughs", MarkerShape::Diamond, 6.0);
    log_static(rec, entity::EVENT_COUNT, &events)
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

/// Logs the name and colour of the time of the clearance, if it is measured.
pub(super) fn describe_clearance(rec: &RecordingStream) -> Result<()> {
    describe_line(rec, entity::MEASURE, YELLOW, "clearance")
}

/// Logs the value of a series in a frame; NaN, which is not drawn, if it has none.
///
/// Every frame logs all series, because the viewer reports an error for a series that has data, but
/// none on the timeline that is shown.
pub(super) fn plot(rec: &RecordingStream, path: &str, value: Option<f64>) -> Result<()> {
    log(rec, path, &Scalars::single(value.unwrap_or(f64::NAN)))
}

/// Logs the counts and times of a frame.
pub(super) fn add(rec: &RecordingStream, record: &FrameRecord) -> Result<()> {
    let FrameRecord {
        report,
        times,
        work,
        ..
    } = record;
    for (path, kind) in [
        (entity::LOST, ChangeKind::Lost),
        (entity::GAINED, ChangeKind::Gained),
        (entity::CHANGED, ChangeKind::Changed),
    ] {
        plot(rec, path, Some(report.count(kind) as f64))?;
    }
    // A point for each frame that has some, because a line would cover that of the links.
    let events = Some(report.events.len()).filter(|&n| n > 0);
    plot(rec, entity::EVENT_COUNT, events.map(|n| n as f64))?;
    let check = ms(times.check());
    let wait = times.live.map(|live| ms(live.wait));
    let send = times.live.map(|live| ms(live.send));
    for (path, time) in [
        (entity::CHECK, Some(check)),
        (entity::INGEST, Some(ms(times.ingest))),
        (entity::VERIFICATION, Some(ms(times.verification))),
        (entity::WAIT, wait),
        (entity::SEND, send),
    ] {
        plot(rec, path, time)?;
    }
    // A rejected frame was not verified.
    let verified = report.verdict != Verdict::Rejected;
    let stages = &times.stages;
    for (path, time) in [
        (entity::BOXES, stages.boxes),
        (entity::PAIRS, stages.pairs),
        (entity::LINKING, stages.links),
        (entity::SEARCH, stages.events),
    ] {
        plot(rec, path, verified.then(|| ms(time)))?;
    }
    for (path, route) in entity::ROUTES.into_iter().zip(Route::ALL) {
        plot(
            rec,
            path,
            (verified && work.route == route).then_some(check),
        )?;
    }
    // A frame that was not compared with a reference frame has no blocks to mark.
    let marked =
        (verified && work.blocks > 0).then(|| 100.0 * work.marked as f64 / work.blocks as f64);
    plot(rec, entity::MARKED, marked)?;
    let recomputed = verified.then_some(work.recomputed as f64);
    plot(rec, entity::RECOMPUTED, recomputed)?;
    plot(rec, entity::SKIPPED, Some(record.skipped as f64))
}

pub(super) fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
