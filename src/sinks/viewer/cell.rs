//! The periodic cell, and the images that take part in findings.

use super::names::entity;
use super::stream::log;
use super::style::{DIMMED, FAINT_RED, lines, narrow};
use crate::curve::{Cell, CurveSet, Image, Point};
use crate::error::Result;
use crate::verdict::Report;
use re_sdk::RecordingStream;
use re_sdk_types::archetypes::LineStrips3D;
use re_sdk_types::components::Radius;
use std::collections::BTreeSet;

/// Maximum number of images that are drawn; more would hide the curves.
const MOST: usize = 200;

/// Number of points per spline segment.
const POINTS: usize = 6;

/// Last cell that was drawn, and whether images are drawn.
#[derive(Debug, Default)]
pub(super) struct CellView {
    cell: Option<Cell>,
    images: bool,
}

impl CellView {
    /// Draws the cell if it changed, and the images of curves that take part in findings.
    pub fn draw(
        &mut self,
        rec: &RecordingStream,
        cell: Option<&Cell>,
        set: &CurveSet,
        report: &Report,
    ) -> Result<()> {
        let Some(cell) = cell else {
            return Ok(());
        };
        if self.cell.replace(*cell) != Some(*cell) {
            let edges = edges(cell).into_iter().map(|edge| edge.map(narrow));
            log(rec, entity::CELL, &lines(edges, 0.7).with_colors([DIMMED]))?;
        }
        let images = images_of(report);
        if images.is_empty() && !self.images {
            return Ok(());
        }
        self.images = !images.is_empty();
        let strips = images.iter().take(MOST).map(|&(curve, image)| {
            let by = narrow(cell.translation(image));
            let strip = set.display_polyline(curve as usize, POINTS).into_iter();
            strip.map(move |p| [0, 1, 2].map(|x| p[x] + by[x]))
        });
        let strips: Vec<Vec<[f32; 3]>> = strips.map(Iterator::collect).collect();
        let strips = LineStrips3D::new(strips)
            .with_radii([Radius::new_ui_points(1.0)])
            .with_colors([FAINT_RED]);
        log(rec, entity::IMAGES, &strips)
    }
}

/// Returns the translated curves of the findings of a report.
fn images_of(report: &Report) -> BTreeSet<(u32, Image)> {
    let changes = report.changes.iter().map(|c| (c.j, c.image));
    let passages = report.events.iter().chain(&report.unresolved);
    let passages = passages.map(|e| (e.j, e.image));
    let defects = report.defects.iter();
    let defects = defects.filter_map(|d| Some((d.j?, d.image)));
    let all = changes.chain(passages).chain(defects);
    all.filter(|(_, image)| *image != Image::default())
        .collect()
}

/// Returns the edges of a cell. Directions without repetition have none.
fn edges(cell: &Cell) -> Vec<[Point; 2]> {
    let mut edges = Vec::new();
    let directions: Vec<Point> = cell
        .vectors
        .into_iter()
        .filter(|v| *v != Point::default())
        .collect();
    for (k, along) in directions.iter().enumerate() {
        let others: Vec<&Point> = (0..directions.len())
            .filter(|&l| l != k)
            .map(|l| &directions[l])
            .collect();
        for subset in 0..1 << others.len() {
            let mut from = cell.origin;
            for (l, other) in others.iter().enumerate() {
                if subset >> l & 1 != 0 {
                    from = [0, 1, 2].map(|x| from[x] + other[x]);
                }
            }
            edges.push([from, [0, 1, 2].map(|x| from[x] + along[x])]);
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_has_an_edge_for_each_side() {
        for (text, count) in [("1,2,3", 12), ("1,2,0", 4), ("0,0,3", 1)] {
            assert_eq!(edges(&text.parse().unwrap()).len(), count);
        }
    }
}
