//! Clearance in the viewer: the strands that are close, in colours, with marks at the closest
//! places, and a plot.

use super::names::entity;
use super::stream::Drawing;
use super::style::{ORANGE, RED, YELLOW, lines, narrow, points};
use crate::curve::vector::{distance, per_axis};
use crate::curve::{Cell, CurveSet, Point};
use crate::error::Result;
use crate::measure::{ClearanceOptions, CloseBlock, REACH, close_blocks};
use crate::simd::LANES;
use crate::verdict::{Clearance, CloseStrands, label_of_pair};

/// Maximum number of marks.
const MARKS: usize = 20;

/// Marks closer than this to a closer place, in sums of the radii, are left out.
const APART: f64 = 4.0;

/// Least clearance up to which strands are drawn.
const LEAST_REACH: f64 = 0.25;

/// Number of points per segment of a spline.
const POINTS_PER_SEGMENT: usize = 4;

/// Colour of the strands at a clearance of [`REACH`], where they begin to be drawn.
const FAR: u32 = 0x3d7a8cff;

/// View of the clearance.
pub(super) struct ClearanceView {
    pub options: ClearanceOptions,
    /// True if the clearance of the last frame was low.
    was_low: bool,
    /// Clearance up to which strands are drawn.
    reach: f64,
}

impl ClearanceView {
    pub fn new(options: ClearanceOptions) -> ClearanceView {
        ClearanceView {
            options,
            was_low: false,
            reach: REACH,
        }
    }

    /// Returns true if the clearance of a frame is low and that of the previous one was not.
    pub fn becomes_low(&mut self, clearance: &Clearance) -> bool {
        let was_low = std::mem::replace(&mut self.was_low, clearance.low);
        clearance.low && !was_low
    }

    /// Draws the clearance of a frame with the radii of the curves, unless the options have one of
    /// all.
    pub fn draw(&mut self, drawing: &Drawing<'_>) -> Result<()> {
        let (set, info) = (drawing.set, &drawing.record.info);
        let radii: Vec<f64> = match self.options.radius {
            Some(radius) => vec![radius; set.len()],
            None => info.labels.radii.iter().map(|&r| r.into()).collect(),
        };
        let blocks = self.close_blocks(set, info.cell.as_ref(), &radii);
        draw_strands(drawing, &blocks, self.options.low)?;
        draw_marks(drawing, &blocks, self.options.low)
    }

    /// Returns the parts of curves that are close. If there are too many, only closer ones are
    /// drawn in this frame and all later ones, and none if that does not suffice.
    fn close_blocks(
        &mut self,
        set: &CurveSet,
        cell: Option<&Cell>,
        radii: &[f64],
    ) -> Vec<CloseBlock> {
        while self.reach >= LEAST_REACH {
            match close_blocks(set, cell, radii, self.reach) {
                Ok(blocks) => return blocks,
                Err(e) => {
                    tracing::warn!(
                        "strands closer than {:.0} % of their diameter are not drawn any more: {e}",
                        100.0 * self.reach
                    );
                    self.reach *= 0.5;
                }
            }
        }
        Vec::new()
    }
}

/// Logs the parts of curves that are close, from `FAR` over yellow, where strands touch, to red,
/// where the clearance is low.
fn draw_strands(drawing: &Drawing<'_>, blocks: &[CloseBlock], low: f64) -> Result<()> {
    let set = drawing.set;
    let strips = blocks.iter().map(|block| {
        let i = block.curve as usize;
        let last = (block.first as usize + LANES).min(set.curve(i).segments as usize);
        let parts = match set.basis().is_polyline() {
            true => 1,
            false => POINTS_PER_SEGMENT,
        };
        let mut strip = Vec::with_capacity(LANES * parts + 1);
        for s in block.first as usize..last {
            strip.push(narrow(set.knot(i, s)));
            let inner = (1..parts).map(|k| set.eval(i, s, k as f64 / parts as f64));
            strip.extend(inner.map(narrow));
        }
        strip.push(narrow(set.knot(i, last)));
        strip
    });
    let colors = blocks.iter().map(|block| color(block.closest.ratio, low));
    drawing.log(entity::CLOSE, &lines(strips, 1.6).with_colors(colors))
}

/// Logs a line with two dots at the closest place, and at others whose clearance is low.
fn draw_marks(drawing: &Drawing<'_>, blocks: &[CloseBlock], low: f64) -> Result<()> {
    let closest = drawing.record.report.clearance.and_then(|c| c.closest);
    let others = blocks.iter().map(|block| block.closest);
    let mut others: Vec<CloseStrands> = others.filter(|c| c.ratio < low).collect();
    others.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    let mut marks: Vec<CloseStrands> = Vec::new();
    for place in closest.into_iter().chain(others) {
        let near = |other: &CloseStrands| {
            let diameter = other.distance / other.ratio.max(0.1);
            distance(middle(other), middle(&place)) < APART * diameter
        };
        if marks.len() < MARKS && !marks.iter().any(near) {
            marks.push(place);
        }
    }
    let colors: Vec<u32> = marks.iter().map(|m| color(m.ratio, low)).collect();
    let between = lines(marks.iter().map(|m| m.points.map(narrow)), 1.5);
    let between = between.with_colors(colors.clone());
    drawing.log(entity::CLOSEST_LINES, &between)?;
    let dots = marks.iter().flat_map(|m| m.points.map(narrow));
    let dots = points(dots, 3.5).with_colors(colors.iter().flat_map(|&c| [c; 2]));
    drawing.log(entity::CLOSEST, &dots)?;
    let label = closest.map(|c| {
        let names = &drawing.record.info.labels.names;
        let (pair, share) = (label_of_pair((c.i, c.j), c.image, names), 100.0 * c.ratio);
        let share = format!("{pair}: {share:.0} % of the diameter");
        points([narrow(middle(&c))], 0.0)
            .with_labels([share])
            .with_colors([color(c.ratio, low)])
            .with_show_labels(true)
    });
    let label = label.unwrap_or_else(|| points([], 0.0));
    drawing.log(entity::CLOSEST_LABEL, &label)
}

fn middle(strands: &CloseStrands) -> Point {
    let [p, q] = strands.points;
    per_axis(|x| p[x] + 0.5 * (q[x] - p[x]))
}

/// Returns the colour of a clearance: [`FAR`] at the reach, yellow where strands touch, orange
/// between that and `low`, and red from there on.
fn color(ratio: f64, low: f64) -> u32 {
    let mix = |from: u32, to: u32, share: f64| {
        let [from, to] = [from, to].map(u32::to_be_bytes);
        let part = |k: usize| {
            let (a, b) = (f64::from(from[k]), f64::from(to[k]));
            (a + (b - a) * share.clamp(0.0, 1.0)).round() as u8
        };
        u32::from_be_bytes([part(0), part(1), part(2), 0xff])
    };
    if ratio >= 1.0 {
        return mix(YELLOW, FAR, (ratio - 1.0) / (REACH - 1.0));
    }
    // Halfway from contact to the warning.
    let half = 0.5 * (1.0 + low);
    match ratio >= half {
        true => mix(ORANGE, YELLOW, (ratio - half) / (1.0 - half)),
        false if ratio > low => mix(RED, ORANGE, (ratio - low) / (half - low)),
        false => RED,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};

    #[test]
    fn too_many_close_strands_are_not_drawn_and_stop_nothing() {
        // Each segment is a block: 6,000 blocks within a unit cube.
        let mut random = crate::random::Random::new(3);
        let count = 6000;
        let xyz: Vec<f64> = (0..3 * count).flat_map(|_| random.point(1.0)).collect();
        let counts = vec![-3; count];
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap();
        let mut view = ClearanceView::new(ClearanceOptions::new(Some(10.0)));
        // The limit is exceeded at every distance.
        assert!(view.close_blocks(&set, None, &vec![10.0; count]).is_empty());
        assert!(view.reach < LEAST_REACH);
    }

    #[test]
    fn colours_go_from_far_over_contact_to_the_warning() {
        for (ratio, expected) in [(REACH, FAR), (1.0, YELLOW), (0.75, ORANGE), (0.5, RED)] {
            assert_eq!(color(ratio, 0.5), expected, "{ratio}");
        }
        assert_eq!(color(0.2, 0.5), RED);
        // The warning at contact.
        assert_eq!(color(1.0, 1.0), YELLOW);
        assert_eq!(color(0.99, 1.0), RED);
    }
}
