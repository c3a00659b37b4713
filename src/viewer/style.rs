//! Colours, and styles of points, lines and series.

use crate::curve::Point;
use re_sdk_types::archetypes::{LineStrips3D, Points3D};
use re_sdk_types::components::{LineStrip3D, Radius};

pub(super) const QUIET: u32 = 0x6f809cff;
/// Colour of the curves beside a violation. Opaque, because viewers draw no transparent lines.
pub(super) const DIMMED: u32 = 0x394352ff;
/// Colour of the periodic images of violated curves.
pub(super) const FAINT_RED: u32 = 0x8f4a46ff;
pub(super) const RED: u32 = 0xff3b30ff;
/// Tubes of the first and the second curve of a finding.
pub(super) const FIRST: u32 = 0xff4d42ff;
pub(super) const SECOND: u32 = 0xffc08aff;
/// Colour of the curves of a change, beside the tubes of their strands.
pub(super) const DARK_RED: u32 = 0x7d3430ff;
pub(super) const ORANGE: u32 = 0xff9f0aff;
/// Marks are paler than the curves below them, and labels, which have the same colour, stay
/// readable.
pub(super) const PALE_RED: u32 = 0xffe3dfff;
pub(super) const PALE_ORANGE: u32 = 0xfff0d2ff;
pub(super) const YELLOW: u32 = 0xffd60aff;
pub(super) const VIOLET: u32 = 0xbf5af2ff;
pub(super) const GREEN: u32 = 0x30d158ff;
pub(super) const CYAN: u32 = 0x40d8ffff;
pub(super) const DARK_GREEN: u32 = 0x1d6b33ff;

/// Returns points with a size on the screen.
pub(super) fn points(points: impl IntoIterator<Item = [f32; 3]>, size: f32) -> Points3D {
    Points3D::new(points).with_radii([Radius::new_ui_points(size)])
}

/// Returns lines with a width on the screen.
pub(super) fn lines<L: Into<LineStrip3D>>(
    lines: impl IntoIterator<Item = L>,
    width: f32,
) -> LineStrips3D {
    LineStrips3D::new(lines).with_radii([Radius::new_ui_points(width)])
}

pub(super) fn narrow(p: Point) -> [f32; 3] {
    p.map(|x| x as f32)
}
