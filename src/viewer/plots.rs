//! Plots of the counts and times of the frames.

use super::names::entity;
use super::stream::{log, log_static};
use super::style::{CYAN, DARK_GREEN, GREEN, ORANGE, QUIET, RED, VIOLET, YELLOW};
use crate::error::Result;
use crate::incremental::Route;
use crate::measure::REACH;
use crate::sinks::FrameRecord;
use crate::verdict::{ChangeKind, Verdict};
use crate::words::milliseconds;
use re_sdk::RecordingStream;
use re_sdk_types::archetypes::{Scalars, SeriesLines, SeriesPoints};
use re_sdk_types::components::{InterpolationMode, MarkerShape};

/// Path, colour and name of a series.
type Series = (&'static str, u32, &'static str);

const LINES: [Series; 15] = [
    ("links/lost", RED, "links lost"),
    ("links/gained", VIOLET, "links gained"),
    ("links/changed", ORANGE, "links changed"),
    ("check/time", DARK_GREEN, "check, ms a frame"),
    ("times/ingest", CYAN, "ingest"),
    ("times/verification", DARK_GREEN, "verification"),
    ("times/verification/boxes", QUIET, "boxes"),
    ("times/verification/pairs", ORANGE, "potential links"),
    ("times/verification/links", RED, "linking numbers"),
    (
        "times/verification/pull-throughs",
        GREEN,
        "search for pull-throughs",
    ),
    ("wait/time", VIOLET, "wait for the frame"),
    ("times/send", VIOLET, "verdict sent"),
    ("marked/blocks", ORANGE, "blocks marked, %"),
    ("recomputed/pairs", RED, "pairs recomputed"),
    (entity::SKIPPED, ORANGE, "frames skipped so far"),
];

/// Points of the time of the check, in the order of [`Route::ALL`].
const ROUTES: [Series; 3] = [
    ("check/full", RED, "full"),
    ("check/quiet", GREEN, "quiet"),
    ("check/partial", ORANGE, "partial"),
];

/// A point for each frame that has some, because a line would cover that of the links.
const EVENTS: Series = ("links/pull-throughs", CYAN, "pull-throughs");

/// Lines of the clearance, if it is measured.
const CLEARANCE: [Series; 3] = [
    ("clearance/closest", YELLOW, "clearance, diameters"),
    ("clearance/warning", RED, "warning"),
    ("times/verification/clearance", YELLOW, "clearance"),
];

/// Logs the names and colours of all series except for those of the clearance.
pub(super) fn describe(rec: &RecordingStream) -> Result<()> {
    for series in LINES {
        describe_line(rec, series)?;
    }
    let routes = ROUTES.map(|series| (series, MarkerShape::Circle, 3.5));
    let events = (EVENTS, MarkerShape::Diamond, 6.0);
    for ((path, color, name), shape, size) in routes.into_iter().chain([events]) {
        let style = SeriesPoints::new()
            .with_colors([color])
            .with_names([name])
            .with_markers([shape])
            .with_marker_sizes([size]);
        log_static(rec, path, &style)?;
    }
    Ok(())
}

/// Logs the names and colours of the series of the clearance.
pub(super) fn describe_clearance(rec: &RecordingStream) -> Result<()> {
    let mut series = CLEARANCE.into_iter();
    series.try_for_each(|series| describe_line(rec, series))
}

/// Logs the name and colour of a line.
fn describe_line(rec: &RecordingStream, (path, color, name): Series) -> Result<()> {
    // Counts change in steps; times and clearances are measured at single frames.
    let measured = ["check/", "clearance/", "times/", "wait/"];
    let mode = match measured.iter().any(|folder| path.starts_with(folder)) {
        true => InterpolationMode::Linear,
        false => InterpolationMode::StepAfter,
    };
    let style = SeriesLines::new()
        .with_colors([color])
        .with_names([name])
        .with_widths([2.5])
        .with_interpolation_mode(mode);
    log_static(rec, path, &style)
}

/// Logs one value per series for a frame. A series without a value gets NaN, which the viewer does
/// not draw.
///
/// Every frame logs all series, because the viewer reports an error for a series that has data, but
/// no data on the displayed timeline.
fn plot<const N: usize>(
    rec: &RecordingStream,
    series: [Series; N],
    values: [Option<f64>; N],
) -> Result<()> {
    for ((path, ..), value) in series.into_iter().zip(values) {
        log(rec, path, &Scalars::single(value.unwrap_or(f64::NAN)))?;
    }
    Ok(())
}

/// Logs the counts and times of a frame.
pub(super) fn add(rec: &RecordingStream, record: &FrameRecord) -> Result<()> {
    let (report, progress) = (&record.report, &record.progress);
    let (times, work) = (&progress.times, &progress.work);
    let changes = |kind| Some(report.count(kind) as f64);
    // A rejected frame was not verified.
    let verified = report.verdict != Verdict::Rejected;
    let stage = |time| verified.then(|| milliseconds(time));
    let live = times.live.as_ref();
    // A frame that was not compared with a reference frame has no blocks to mark.
    let marked = verified && work.blocks > 0;
    let values = [
        changes(ChangeKind::Lost),
        changes(ChangeKind::Gained),
        changes(ChangeKind::Changed),
        Some(milliseconds(times.check())),
        Some(milliseconds(times.ingest)),
        Some(milliseconds(times.verification)),
        stage(times.stages.boxes),
        stage(times.stages.pairs),
        stage(times.stages.links),
        stage(times.stages.events),
        live.map(|live| milliseconds(live.wait)),
        live.map(|live| milliseconds(live.send)),
        marked.then(|| 100.0 * work.marked as f64 / work.blocks as f64),
        verified.then_some(work.recomputed as f64),
        Some(progress.skipped as f64),
    ];
    plot(rec, LINES, values)?;
    let check = |route| (verified && work.route == route).then(|| milliseconds(times.check()));
    plot(rec, ROUTES, Route::ALL.map(check))?;
    let events = Some(report.events.len()).filter(|&n| n > 0);
    plot(rec, [EVENTS], [events.map(|n| n as f64)])
}

/// Logs the clearance of a frame, if it was measured, and the limit of the warning.
pub(super) fn add_clearance(rec: &RecordingStream, record: &FrameRecord, low: f64) -> Result<()> {
    let found = record.report.clearance.as_ref();
    let values = [
        found.map(|found| found.closest.map_or(REACH, |c| c.ratio)),
        found.map(|_| low),
        found.map(|_| milliseconds(record.progress.times.stages.clearance)),
    ];
    plot(rec, CLEARANCE, values)
}
