//! Marks and labels at the places of the findings of a frame.

use super::label::{self, Label};
use super::local::{self, Spot};
use super::names::entity;
use super::passed::{self, Passed};
use super::stream::Drawing;
use super::style::{CYAN, PALE_ORANGE, PALE_RED, lines, narrow, points};
use super::view::View;
use crate::curve::vector::{add_scaled, dot, sub};
use crate::curve::{AXES, Cell, is_home};
use crate::error::Result;
use crate::verdict::Finding;

/// Maximum number of findings of a kind with a mark and a table row, and of findings with a log
/// line, because more would hide one another.
pub(super) const SHOWN: usize = 20;

/// Maximum number of labels; the table has the other findings.
const LABELS: usize = 3;

/// Marks closer than this, in radii of the scene, share a label.
const NEAR: f64 = 0.12;

/// Length of the rays of a pull-through's star, in sizes of the feature there (see
/// [`local::feature`]): a fifth of the radius of a ring.
const STAR: f64 = 0.14;

/// Size of a feature without extent, in radii of the scene.
const DOT: f64 = 0.05;

/// Logs a dot on each curve of a finding, a star at each pull-through of this frame, and a label
/// beside each place, broken pairs first. Findings close together share a label, because labels
/// would cover one another.
pub(super) fn draw_places(drawing: &Drawing<'_>) -> Result<()> {
    let (set, report, info) = (drawing.set, &drawing.record.report, &drawing.record.info);
    let names = &info.labels.names;
    let spot = |finding: Finding| {
        let place = finding.spot()?;
        let translation = |cell: Cell| cell.translation(place.image);
        let by = info.cell.map_or([0.0; 3], translation);
        let mut spot = local::spot(set, place, by);
        let mut text = finding.label(names);
        let color = match finding {
            Finding::Change(_) | Finding::Invariant(_) => PALE_RED,
            Finding::Defect(_) | Finding::Unresolved(_) => PALE_ORANGE,
            Finding::PullThrough(e) => {
                spot.marks = vec![place.point];
                if e.i == e.j && is_home(&e.image) {
                    text = e.label(names);
                }
                CYAN
            }
        };
        Some((spot, text, color))
    };
    let is_event = |finding: &Finding| matches!(finding, Finding::PullThrough(_));
    let marked = report.first_findings(SHOWN).filter(|f| !is_event(f));
    let marked: Vec<(Spot, String, u32)> = marked.filter_map(spot).collect();
    let events = report.first_findings(passed::KEPT).filter(is_event);
    let events: Vec<(Spot, String, u32)> = events.filter_map(spot).collect();

    let dots = marked
        .iter()
        .flat_map(|(spot, _, color)| spot.marks.iter().map(|&p| (narrow(p), *color)));
    let (dots, colors): (Vec<_>, Vec<_>) = dots.unzip();
    drawing.log(entity::PLACES, &points(dots, 5.0).with_colors(colors))?;
    let centers = events.iter().map(|(spot, ..)| narrow(spot.marks[0]));
    let centers = points(centers, 6.5).with_colors([CYAN]);
    drawing.log(entity::EVENTS, &centers)?;

    let has_marks = !(marked.is_empty() && events.is_empty());
    let view = has_marks.then(|| View::of(set)).flatten();
    let radius = view.as_ref().map_or(0.0, |view| view.radius);
    let size = |spot: &Spot| match spot.size > 0.0 {
        true => spot.size.min(radius),
        false => DOT * radius,
    };
    let star = |(spot, ..): &(Spot, _, _)| {
        let (center, reach) = (spot.marks[0], STAR * size(spot));
        AXES.map(|axis| [-reach, reach].map(|t| narrow(add_scaled(center, t, axis))))
    };
    let rays = events.iter().flat_map(star);
    drawing.log(entity::STARS, &lines(rays, 2.0).with_colors([CYAN]))?;

    let near_sq = (NEAR * radius).powi(2);
    let mut labels: Vec<(Vec<&Spot>, Vec<&str>, u32)> = Vec::new();
    for (spot, text, color) in marked.iter().chain(events.iter().take(SHOWN)) {
        let point = spot.marks[0];
        let close = |other: &Spot| {
            let apart = sub(other.marks[0], point);
            dot(apart, apart) < near_sq
        };
        match labels.iter_mut().find(|(spots, ..)| close(spots[0])) {
            Some((spots, texts, _)) => {
                spots.push(spot);
                texts.push(text);
            }
            None => labels.push((vec![spot], vec![text], *color)),
        }
    }
    labels.truncate(LABELS);
    let colors: Vec<u32> = labels.iter().map(|(.., color)| *color).collect();
    let texts = labels.iter().map(|(_, texts, _)| texts.join("\n"));
    let texts: Vec<String> = texts.collect();
    let place = |((spots, ..), text): (&(Vec<&Spot>, Vec<&str>, u32), &String)| match &view {
        Some(view) => label::place(set, spots, view.unit(size(spots[0])), text, view),
        // Without extent.
        None => Label {
            anchor: spots[0].marks[0],
            leader: [spots[0].marks[0]; 2],
        },
    };
    let placed: Vec<Label> = labels.iter().zip(&texts).map(place).collect();
    let labelled = points(placed.iter().map(|label| narrow(label.anchor)), 0.0)
        .with_labels(texts)
        .with_colors(colors.clone())
        .with_show_labels(true);
    drawing.log(entity::LABELS, &labelled)?;
    let leaders = placed.iter().map(|label| label.leader.map(narrow));
    let leaders = lines(leaders, 0.6).with_colors(colors);
    drawing.log(entity::LEADERS, &leaders)
}

/// Logs a small mark on the curves for each pull-through of earlier frames.
pub(super) fn draw_passed(drawing: &Drawing<'_>, passed: &Passed) -> Result<()> {
    let before = points(passed.points(drawing.set).map(narrow), 5.0);
    drawing.log(entity::PASSED, &before.with_colors([CYAN]))
}
