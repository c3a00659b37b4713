//! Curves of the picture, in groups: those of the findings, those that move, and blocks of curves
//! at rest. A group is an entity, and is logged only if one of its curves moved, joined or left.
//!
//! A curve at rest that moves leaves its block for the group of moving curves. It returns with
//! others after [`REST`] frames at rest. Every curve is in one group at most, so a frame never
//! takes more than all curves once, and a row per group.
//!
//! Cost: a comparison of all points with those of the previous frame, which is exact, and the
//! points of the groups that changed. If curves move by turns, different ones in each frame, most
//! blocks are logged in each.

use super::names::entity;
use super::stream::Drawing;
use super::style::{DARK_RED, DIMMED, ORANGE, QUIET};
use crate::curve::CurveSet;
use crate::error::Result;
use crate::verdict::Report;
use re_sdk_types::archetypes::LineStrips3D;
use re_sdk_types::components::Radius;
use std::sync::Arc;

/// Number of frames that a curve must be at rest to join its block again. Curves join every so many
/// frames.
const REST: u64 = 30;

/// Number of points of a block, and maximum number of blocks, because viewers draw many entities
/// slowly.
const BLOCK_POINTS: usize = 8192;
const MOST_BLOCKS: usize = 64;

/// Number of curves from which on intact ones are drawn thinner, because they would merge into a
/// surface.
const MANY: usize = 2000;

/// Maximum number of points per segment of a spline, and approximate number of points in all.
const POINTS_PER_SEGMENT: usize = 6;
const POINTS: usize = 400_000;

/// Groups. Blocks have the following numbers.
const BROKEN: u32 = 0;
const UNDECIDED: u32 = 1;
const MOVING: u32 = 2;
const BLOCKS: u32 = 3;
/// Group of the curves that were not shown so far.
const HIDDEN: u32 = u32::MAX;

/// Colour, and width on the screen.
type Style = (u32, f32);

/// A frame, and its number.
pub(super) type Numbered = (u64, Arc<CurveSet>);

/// Curves as they were last logged.
#[derive(Default)]
pub(super) struct Curves {
    pub shown: Option<Numbered>,
    /// Number of frames so far.
    frames: u64,
    /// Group of each curve, and the frame in which it last moved.
    groups: Vec<u32>,
    moved: Vec<u64>,
    /// Block of each curve.
    blocks: Vec<u32>,
    /// Style of each group that was ever logged.
    styles: Vec<Option<Style>>,
}

impl Curves {
    /// Logs the groups that changed; `all`: all groups. Curves are thin lines also if they have a
    /// radius, because thick ones hide the marks.
    pub fn draw(&mut self, drawing: &Drawing<'_>, all: bool) -> Result<()> {
        let (set, report) = (drawing.set, &drawing.record.report);
        self.frames += 1;
        let mut changed = vec![all; self.styles.len()];
        let before = self.shown.take();
        let moved = match before.filter(|(_, before)| before.same_layout(set)) {
            Some((_, before)) => set.moved_since(&before),
            None => {
                // Clears the groups of other curves.
                changed.fill(true);
                self.divide(set);
                vec![false; set.len()]
            }
        };
        let groups = self.arrange(report, &moved);
        changed.resize(self.styles.len(), all);
        for (k, (&new, &old)) in groups.iter().zip(&self.groups).enumerate() {
            for group in [new, old] {
                if (new != old || moved[k]) && group != HIDDEN {
                    changed[group as usize] = true;
                }
            }
        }
        self.groups = groups;
        self.shown = Some((report.seq, Arc::clone(set)));
        self.log_groups(drawing, &changed)
    }

    /// Divides new curves into blocks. All are at rest.
    fn divide(&mut self, set: &CurveSet) {
        let size = BLOCK_POINTS.max(set.points().div_ceil(MOST_BLOCKS));
        let block = |i| BLOCKS + (set.points_of(i).start / size) as u32;
        self.blocks = (0..set.len()).map(block).collect();
        self.groups = vec![HIDDEN; set.len()];
        self.moved = vec![0; set.len()];
        let groups = self.blocks.last().map_or(BLOCKS, |last| last + 1) as usize;
        if self.styles.len() < groups {
            self.styles.resize(groups, None);
        }
    }

    /// Returns the groups of the curves in this frame.
    fn arrange(&mut self, report: &Report, moved: &[bool]) -> Vec<u32> {
        let now = self.frames;
        let returns = now.is_multiple_of(REST);
        let mut groups: Vec<u32> = Vec::with_capacity(moved.len());
        for (k, last) in self.moved.iter_mut().enumerate() {
            if moved[k] {
                *last = now;
            }
            let rested = now - *last >= REST;
            let at_rest = match self.groups[k] {
                // Since the first frame.
                _ if *last == 0 => true,
                MOVING => returns && rested,
                BROKEN | UNDECIDED | HIDDEN => rested,
                _ => !moved[k],
            };
            groups.push(if at_rest { self.blocks[k] } else { MOVING });
        }
        for finding in report.all_findings() {
            let group = match finding.is_change() {
                true => BROKEN,
                false => UNDECIDED,
            };
            for i in finding.curves() {
                if let Some(g) = groups.get_mut(i as usize) {
                    *g = group.min(*g);
                }
            }
        }
        groups
    }

    fn log_groups(&mut self, drawing: &Drawing<'_>, changed: &[bool]) -> Result<()> {
        let set = drawing.set;
        let detail = (POINTS / set.segments().max(1)).clamp(1, POINTS_PER_SEGMENT);
        let mut members: Vec<Vec<usize>> = vec![Vec::new(); changed.len()];
        for (k, &group) in self.groups.iter().enumerate() {
            members[group as usize].push(k);
        }
        let violation = [BROKEN, UNDECIDED]
            .iter()
            .any(|&k| !members[k as usize].is_empty());
        let many = set.len() >= MANY;
        for (group, members) in (0..).zip(members) {
            let (known, changed) = (&mut self.styles[group as usize], changed[group as usize]);
            let style = match group {
                BROKEN => (DARK_RED, 1.2),
                UNDECIDED => (ORANGE, 2.0),
                _ if violation => (DIMMED, if many { 0.3 } else { 0.7 }),
                _ => (QUIET, if many { 0.35 } else { 0.8 }),
            };
            let mut lines = LineStrips3D::update_fields();
            // An empty group is styled when it gets its first curve. Until then it is not logged,
            // because the viewer has nothing to replace.
            let restyled = !members.is_empty() && *known != Some(style);
            if !restyled && (known.is_none() || !changed) {
                continue;
            }
            if changed {
                let strips = members.iter().map(|&i| set.display_polyline(i, detail));
                lines = lines.with_strips(strips);
            }
            if restyled {
                let (color, width) = style;
                let radii = [Radius::new_ui_points(width)];
                lines = lines.with_colors([color]).with_radii(radii);
                *known = Some(style);
            }
            drawing.log(&path(group), &lines)?;
        }
        Ok(())
    }
}

/// Returns the path of a group.
fn path(group: u32) -> String {
    match group {
        BROKEN => entity::BROKEN.into(),
        UNDECIDED => entity::UNDECIDED.into(),
        MOVING => entity::MOVING.into(),
        block => format!("{}/{}", entity::AT_REST, block - BLOCKS),
    }
}
