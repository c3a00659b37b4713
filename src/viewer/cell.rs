//! The periodic cell, and the images that take part in findings.

use super::names::entity;
use super::stream::Drawing;
use super::style::{DIMMED, FAINT_RED, lines, narrow};
use crate::curve::vector::add;
use crate::curve::{Cell, Image, Point, is_home};
use crate::error::Result;
use crate::verdict::Report;
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
    pub fn draw(&mut self, drawing: &Drawing<'_>) -> Result<()> {
        let Some(cell) = &drawing.record.info.cell else {
            return Ok(());
        };
        if self.cell.replace(*cell) != Some(*cell) {
            let edges = edges(cell).into_iter().map(|edge| edge.map(narrow));
            drawing.log(entity::CELL, &lines(edges, 0.7).with_colors([DIMMED]))?;
        }
        let images = images_of(&drawing.record.report);
        if images.is_empty() && !self.images {
            return Ok(());
        }
        self.images = !images.is_empty();
        let strips = images.iter().take(MOST).map(|&(curve, image)| {
            let by = narrow(cell.translation(image));
            let mut strip = drawing.set.display_polyline(curve as usize, POINTS);
            strip.iter_mut().for_each(|p| *p = add(*p, by));
            strip
        });
        let images = lines(strips, 1.0).with_colors([FAINT_RED]);
        drawing.log(entity::IMAGES, &images)
    }
}

/// Returns the translated curves of the findings of a report.
fn images_of(report: &Report) -> BTreeSet<(u32, Image)> {
    let seconds = report.all_findings().filter_map(|finding| {
        let (_, j, image) = finding.pair();
        Some((j?, image))
    });
    seconds.filter(|(_, image)| !is_home(image)).collect()
}

/// Returns the edges of a cell. Directions without repetition have none.
fn edges(cell: &Cell) -> Vec<[Point; 2]> {
    let directions = cell.vectors.into_iter().filter(|v| *v != [0.0; 3]);
    let directions: Vec<Point> = directions.collect();
    // A corner is a set of directions.
    let corner = |set: usize| {
        let taken = (0..directions.len()).filter(|k| set >> k & 1 != 0);
        taken.fold(cell.origin, |p, k| add(p, directions[k]))
    };
    let corners = 0..1 << directions.len();
    let along = |k: usize| {
        let starts = corners.clone().filter(move |set| set >> k & 1 == 0);
        starts.map(move |set| [corner(set), corner(set | 1 << k)])
    };
    (0..directions.len()).flat_map(along).collect()
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
