//! Pictures of a place: a frame from two sides, as SVG.
//!
//! Both curves of the finding are thick and have a colour each; their neighbours are thin and grey.
//! The lower strand of a crossing is interrupted. Strands whose radius is known have a pale band of
//! their diameter: bands that overlap from both sides show surfaces that overlap. A ring marks the
//! place, a bar shows the scale, and a small cross the axes of the simulation.

use super::gaps::{Line, visible};
use super::strands::{Part, Radii, Strand, Window};
use super::svg::{escape, px, round_below};
use super::view::View;
use crate::curve::{Notation, Point};

/// Width and height of a picture, in pixels.
pub(super) const SIZE: f64 = 300.0;

const HALF: f64 = SIZE / 2.0;

/// Widths of the lines.
const OWN: f64 = 4.5;
const OTHER: f64 = 1.4;

/// Radius of the mark of the place, and distance of the names of segments from it.
const MARK: f64 = 20.0;
const NAMES: f64 = 46.0;

/// Groups of strands and their classes, from back to front.
const GROUPS: [(Part, &str); 3] = [(Part::Other, "o"), (Part::First, "a"), (Part::Second, "b")];

/// Smallest distance of successive points, and largest deviation of a point that is omitted.
const SPACING: f64 = 0.5;
const DEVIATION: f64 = 0.12;

/// A segment to name: its number, its group and its middle.
pub(super) struct Named {
    pub segment: u32,
    pub part: Part,
    pub middle: Point,
}

/// Content of a picture.
pub(super) struct Panel<'a> {
    pub strands: &'a [Strand],
    pub window: Window,
    pub view: View,
    pub named: &'a [Named],
    pub radii: Radii<'a>,
    /// Description for readers who do not see it.
    pub label: String,
}

impl Panel<'_> {
    /// Returns the picture as SVG.
    pub fn svg(&self) -> String {
        let flat = |strand: &Strand| {
            let points = strand.points.iter().map(|p| self.pixel(*p)).collect();
            Line {
                points: simplify(points),
                closed: strand.closed,
                width: if strand.part == Part::Other {
                    OTHER
                } else {
                    OWN
                },
            }
        };
        let lines: Vec<Line> = self.strands.iter().map(flat).collect();
        let mut out = format!(
            "<svg viewBox=\"0 0 {SIZE} {SIZE}\" role=\"img\" aria-label=\"{}\">\n",
            escape(&self.label)
        );
        let visible = visible(&lines);
        for (part, class) in GROUPS {
            self.bands(part, class, &lines, &mut out);
        }
        for (part, class) in GROUPS {
            let own = self.strands.iter().zip(&visible).zip(&lines);
            let mut data = String::new();
            for ((_, pieces), line) in own.filter(|((strand, _), _)| strand.part == part) {
                path(pieces, line, &mut data);
            }
            if !data.is_empty() {
                out += &format!("<path class=\"{class}\" d=\"{data}\"/>\n");
            }
        }
        out += &format!("<circle class=\"m\" cx=\"{HALF}\" cy=\"{HALF}\" r=\"{MARK}\"/>\n");
        self.names(&mut out);
        self.scale(&mut out);
        self.axes(&mut out);
        out += "</svg>\n";
        out
    }

    /// Draws the bands of a group, which are wider than the lines.
    fn bands(&self, part: Part, class: &str, lines: &[Line], out: &mut String) {
        let own = self.strands.iter().zip(lines);
        for (strand, line) in own.filter(|(strand, _)| strand.part == part) {
            let width = 2.0 * self.radii.of(strand.curve) / self.window.reach * HALF;
            if width > line.width {
                let mut data = String::new();
                path(std::slice::from_ref(&line.points), line, &mut data);
                let width = px(width.min(2.0 * SIZE));
                *out += &format!(
                    "<path class=\"{class} w\" style=\"stroke-width:{width}\" d=\"{data}\"/>\n"
                );
            }
        }
    }

    /// Returns a point in pixels to the right and down, and its depth.
    fn pixel(&self, p: Point) -> Point {
        let [x, y, z] = self.view.project(p);
        [HALF + HALF * x, HALF - HALF * y, HALF * z]
    }

    /// Names the segments beside their middle, away from the place and from one another.
    fn names(&self, out: &mut String) {
        let mut taken: Vec<[f64; 2]> = Vec::new();
        for named in self.named {
            let [x, y, _] = self.pixel(named.middle);
            if !(0.0..=SIZE).contains(&x) || !(0.0..=SIZE).contains(&y) {
                continue;
            }
            let text = format!("segment {}", named.segment);
            let half = 4.0 * text.len() as f64;
            let [dx, dy] = [x - HALF, y - HALF];
            let length = dx.hypot(dy);
            // Strands that cross at the place itself: one name above, one below.
            let [dx, dy] = match length > 4.0 {
                true => [dx / length, dy / length],
                false => [0.0, if taken.is_empty() { -1.0 } else { 1.0 }],
            };
            let distance = (NAMES - length).max(18.0);
            let at = [
                (x + dx * (distance + half)).clamp(half + 3.0, SIZE - half - 3.0),
                (y + dy * distance + 4.0).clamp(14.0, SIZE - 34.0),
            ];
            let close =
                |t: &&[f64; 2]| (t[0] - at[0]).abs() < 2.0 * half && (t[1] - at[1]).abs() < 15.0;
            let shift = match taken.iter().find(close) {
                Some(t) if t[1] > 0.5 * SIZE => t[1] - 16.0 - at[1],
                Some(t) => t[1] + 16.0 - at[1],
                None => 0.0,
            };
            let at = [at[0], at[1] + shift];
            taken.push(at);
            let class = if named.part == Part::Second {
                "bt"
            } else {
                "at"
            };
            *out += &format!(
                "<circle class=\"{class}\" cx=\"{}\" cy=\"{}\" r=\"2.5\"/>\
                 <path class=\"{class} l\" d=\"M{} {}L{} {}\"/>\
                 <text class=\"{class}\" x=\"{}\" y=\"{}\">{text}</text>\n",
                px(x),
                px(y),
                px(x),
                px(y),
                px(at[0]),
                px(at[1] - 4.0),
                px(at[0]),
                px(at[1]),
            );
        }
    }

    /// Draws a bar with its length, a round number of at most a third of the width.
    fn scale(&self, out: &mut String) {
        let reach = self.window.reach;
        let length = round_below(0.66 * reach);
        if !(length > 0.0 && length.is_finite()) {
            return;
        }
        let end = 12.0 + length / reach * HALF;
        let words = Notation::of(length).length(length);
        *out += &format!(
            "<path class=\"s\" d=\"M12 282V288H{}V282\"/><text class=\"s\" x=\"{}\" y=\"278\">\
             {words}</text>\n",
            px(end),
            px(0.5 * (12.0 + end)),
        );
    }

    /// Draws the axes of the simulation.
    fn axes(&self, out: &mut String) {
        const AT: [f64; 2] = [SIZE - 30.0, SIZE - 28.0];
        for (k, name) in ["x", "y", "z"].into_iter().enumerate() {
            let mut axis = [0.0; 3];
            axis[k] = 1.0;
            let [x, y, _] = self.view.project(axis);
            // An axis that points to the viewer, or away, is a point.
            if x.hypot(y) < 0.3 {
                continue;
            }
            *out += &format!(
                "<path class=\"s\" d=\"M{} {}L{} {}\"/><text class=\"s\" x=\"{}\" y=\"{}\">{name}\
                 </text>\n",
                px(AT[0]),
                px(AT[1]),
                px(AT[0] + 15.0 * x),
                px(AT[1] - 15.0 * y),
                px(AT[0] + 22.0 * x),
                px(AT[1] - 22.0 * y + 3.5),
            );
        }
    }
}

/// Omits points that would not be visible.
fn simplify(points: Vec<Point>) -> Vec<Point> {
    let Some((&last, rest)) = points.split_last() else {
        return points;
    };
    let mut out: Vec<Point> = Vec::with_capacity(points.len());
    for (k, p) in rest.iter().enumerate() {
        let Some(kept) = out.last() else {
            out.push(*p);
            continue;
        };
        let next = points[k + 1];
        let [u, v] = [p, &next].map(|q| [q[0] - kept[0], q[1] - kept[1]]);
        let base = v[0].hypot(v[1]);
        let ahead = u[0] * v[0] + u[1] * v[1] > 0.0;
        let off = (u[0] * v[1] - u[1] * v[0]).abs() / base;
        let close = u[0].hypot(u[1]) < SPACING;
        // A NaN, if the next point is the kept one, omits nothing.
        if !(close || ahead && off < DEVIATION) {
            out.push(*p);
        }
    }
    out.push(last);
    out
}

/// Appends the pieces of a line as the data of a path.
fn path(pieces: &[Vec<Point>], line: &Line, out: &mut String) {
    let whole = pieces.len() == 1 && line.closed && pieces[0].first() == pieces[0].last();
    for piece in pieces {
        for (k, p) in piece.iter().enumerate() {
            let command = match k {
                0 => "M",
                1 => "L",
                _ => " ",
            };
            *out += &format!("{command}{} {}", px(p[0]), px(p[1]));
        }
        if whole {
            out.push('Z');
        }
    }
}
