//! Picture of a frame: its curves in groups, and marks and labels at the places of its findings.

use super::local::{self, Spot};
use super::names::entity;
use super::passed::{self, Passed};
use super::stream::log;
use super::style::{CYAN, ORANGE, PALE_ORANGE, PALE_RED, QUIET, RED, lines, narrow, points};
use super::view::View;
use crate::curve::CurveSet;
use crate::error::Result;
use crate::verdict::Report;
use re_sdk::RecordingStream;
use re_sdk_types::archetypes::LineStrips3D;
use re_sdk_types::components::Radius;

/// Maximum number of findings of a kind with a mark and a table row, and of findings with a log
/// line, because more would hide one another.
pub(super) const SHOWN: usize = 20;

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

/// Maximum number of points per segment of a spline, and approximate number of points in all.
const POINTS_PER_SEGMENT: usize = 6;
const POINTS: usize = 400_000;

/// Logs all curves, each in its group. Empty groups are logged too, which clears those of the
/// previous frame. Curves are thin lines also if they have a radius, because thick ones hide the
/// marks.
pub(super) fn draw_curves(rec: &RecordingStream, set: &CurveSet, report: &Report) -> Result<()> {
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
        log(rec, path, &strips)?;
    }
    Ok(())
}

/// Logs a dot on each curve of a finding, a star at each pull-through of this frame, and a
/// label beside each place, broken pairs first. Findings close together share a label, because
/// labels would cover one another.
pub(super) fn draw_places(rec: &RecordingStream, set: &CurveSet, report: &Report) -> Result<()> {
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
    log(rec, entity::PLACES, &points(dots, 5.0).with_colors(colors))?;
    let centers = events.iter().map(|(spot, ..)| narrow(spot.marks[0]));
    log(
        rec,
        entity::EVENTS,
        &points(centers, 6.5).with_colors([CYAN]),
    )?;

    let view = match marked.is_empty() && events.is_empty() {
        true => None,
        false => View::of(set),
    };
    let (radius, down) = view.map_or((0.0, [0.0; 3]), |v| (v.radius, v.down()));
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
    log(rec, entity::STARS, &lines(rays, 2.0).with_colors([CYAN]))?;

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
    log(rec, entity::LABELS, &labelled)?;
    log(
        rec,
        entity::LEADERS,
        &lines(leaders, 0.6).with_colors(colors),
    )
}

/// Logs a small mark on the curves for each pull-through of earlier frames.
pub(super) fn draw_passed(rec: &RecordingStream, passed: &Passed, set: &CurveSet) -> Result<()> {
    let before = passed.points(set).map(narrow);
    log(
        rec,
        entity::PASSED,
        &points(before, 5.0).with_colors([CYAN]),
    )
}
