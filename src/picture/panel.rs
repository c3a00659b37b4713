//! Pictures of a place: a frame from one side, as SVG.
//!
//! Both strands of the finding are thick and have a colour each; their neighbours, below them, are
//! thin and grey. The lower one of the two is interrupted at a crossing. If its radius is known, a
//! strand has a pale band of its diameter: bands that overlap show surfaces that overlap.
//! A ring marks the place, a bar shows the scale, and a small cross the axes of the simulation.

use super::gaps::{Line, visible};
use super::strands::{Part, Radii, Strand, Window, strands};
use super::view::{View, views};
use crate::curve::{CurveSet, Notation, Point};
use crate::picture::svg::{px, round_below};
use crate::verdict::Spot;
use maud::{Markup, html};

/// Width and height of a picture, and their half, in pixels.
pub(super) const SIZE: f64 = 300.0;
pub(super) const HALF: f64 = SIZE / 2.0;

/// Width of the lines of the finding.
const OWN: f64 = 4.5;

/// Radius of the mark of the place, and distance of the names of segments from it.
const MARK: f64 = 20.0;
const NAMES: f64 = 46.0;

/// Groups of the other strands and their classes, from back to front.
const OTHERS: [(Part, &str); 2] = [(Part::Other, "o"), (Part::Rest, "r")];

/// Returns the class of a strand of the finding.
fn class(strand: &Strand) -> &'static str {
    match strand.part {
        Part::Second => "b",
        _ => "a",
    }
}

/// Smallest distance of successive points, and largest deviation of a point that is omitted.
const SPACING: f64 = 0.5;
const DEVIATION: f64 = 0.12;

/// A segment to name: its number, its group and its middle.
struct Named {
    segment: u32,
    part: Part,
    middle: Point,
}

/// The strands of a frame in a window around a place.
pub(crate) struct Scene {
    strands: Vec<Strand>,
    named: Vec<Named>,
    window: Window,
}

impl Scene {
    pub fn of(set: &CurveSet, spot: Spot, window: Window) -> Scene {
        let ends = spot.curves.into_iter().zip(spot.segments);
        let ends = ends.zip([Part::First, Part::Second]);
        let named = ends.filter_map(|((i, segment), part)| {
            let curve = set.curves().get(i as usize)?;
            (segment < curve.segments).then(|| Named {
                segment,
                part,
                middle: window.local(set.eval(i as usize, segment as usize, 0.5)),
            })
        });
        let mut named: Vec<Named> = named.collect();
        // A curve alone is named twice.
        if spot.curves[0] == spot.curves[1] && spot.segments[0] == spot.segments[1] {
            named.truncate(1);
        }
        Scene {
            strands: strands(set, spot, window),
            named,
            window,
        }
    }

    pub fn strands(&self) -> &[Strand] {
        &self.strands
    }

    /// Returns true if other parts of the curves of the finding are in the window.
    pub fn has_rest(&self) -> bool {
        self.strands.iter().any(|s| s.part == Part::Rest)
    }

    /// Returns the points of the two strands of the finding.
    pub fn own(&self) -> impl Iterator<Item = &Point> {
        let own = self.strands.iter().filter(|strand| strand.is_own());
        own.flat_map(|strand| &strand.points)
    }

    /// Returns two directions from which the finding is clear.
    pub fn views(&self) -> [View; 2] {
        views(&self.strands)
    }

    /// Returns a picture. `label` describes it for readers who do not see it.
    pub fn svg(&self, view: View, radii: Radii<'_>, label: &str) -> Markup {
        let flat = |strand: &Strand| Line {
            points: simplify(view.pixels(&strand.points), SPACING),
            closed: strand.closed,
            width: OWN,
        };
        // Only the strands of the finding interrupt one another, so that every gap counts.
        let all = self.strands.iter();
        let (own, others): (Vec<&Strand>, Vec<_>) = all.partition(|strand| strand.is_own());
        let lines: Vec<Line> = own.iter().copied().map(flat).collect();
        let visible = visible(&lines);
        let wide = |strand: &Strand| view.length(2.0 * radii.of(strand.curve) / self.window.reach);
        let place = view.pixels(&[[0.0; 3]])[0];
        let content = html! {
            @for (group, class) in OTHERS {
                @let lines: Vec<Line> =
                    others.iter().filter(|s| s.part == group).map(|s| flat(s)).collect();
                @let data = path(lines.iter().map(|line| &line.points));
                @if !data.is_empty() { path class=(class) d=(data) {} }
            }
            // Bands that are wider than the lines, and do not fill the picture.
            @for (strand, line) in own.iter().zip(&lines) {
                @if (OWN..HALF).contains(&wide(strand)) {
                    @let style = format!("stroke-width:{}", px(wide(strand)));
                    path class={(class(strand)) " w"} style=(style) d=(path([&line.points])) {}
                }
            }
            @for (strand, pieces) in own.iter().zip(&visible) {
                path class=(class(strand)) d=(path(pieces)) {}
            }
            circle.m cx=(px(place[0])) cy=(px(place[1])) r=(MARK) {}
            (self.names(view, place))
        };
        frame(label, self.window.reach, view, &content)
    }

    /// Names the segments beside their middle, away from the place and from one another.
    fn names(&self, view: View, [x0, y0, _]: Point) -> Markup {
        let mut taken: Vec<[f64; 2]> = Vec::new();
        let mut place = |[x, y]: [f64; 2], half: f64| {
            let [dx, dy] = [x - x0, y - y0];
            let length = dx.hypot(dy);
            // Strands that cross at the place itself: one name above, one below.
            let [dx, dy] = match length > 4.0 {
                true => [dx / length, dy / length],
                false => [0.0, if taken.is_empty() { -1.0 } else { 1.0 }],
            };
            let distance = (NAMES - length).max(18.0);
            let [x, y] = [
                (x + dx * (distance + half)).clamp(half + 3.0, SIZE - half - 3.0),
                (y + dy * distance + 4.0).clamp(14.0, SIZE - 34.0),
            ];
            let close = |t: &&[f64; 2]| (t[0] - x).abs() < 2.0 * half && (t[1] - y).abs() < 15.0;
            let y = match taken.iter().find(close) {
                Some([_, t]) if *t > y0 => t - 16.0,
                Some([_, t]) => t + 16.0,
                None => y,
            };
            taken.push([x, y]);
            [x, y]
        };
        html! {
            @for named in &self.named {
                @let [x, y, _] = view.pixels(&[named.middle])[0];
                @if (0.0..=SIZE).contains(&x) && (0.0..=SIZE).contains(&y) {
                    @let text = format!("segment {}", named.segment);
                    @let at = place([x, y], 4.0 * text.len() as f64);
                    @let class = if named.part == Part::Second { "bt" } else { "at" };
                    @let ([x, y], [u, v, above]) =
                        ([x, y].map(px), [at[0], at[1], at[1] - 4.0].map(px));
                    circle class=(class) cx=(x) cy=(y) r="2.5" {}
                    path class={(class) " l"} d={"M" (x) " " (y) "L" (u) " " (above)} {}
                    text class=(class) x=(u) y=(v) { (text) }
                }
            }
        }
    }
}

/// Returns a picture with the axes of the simulation, and with a bar whose length is a round number
/// of at most a third of the width.
pub(super) fn frame(label: &str, reach: f64, view: View, content: &Markup) -> Markup {
    const AT: [f64; 2] = [SIZE - 30.0, SIZE - 28.0];
    let reach = reach / view.scale;
    let length = round_below(0.66 * reach);
    let end = 12.0 + length / reach * HALF;
    let axes = [("x", 0), ("y", 1), ("z", 2)].map(|(name, k)| {
        let [x, y] = [view.across[k], view.up[k]];
        (name, x.hypot(y), move |far: f64| {
            [AT[0] + far * x, AT[1] - far * y]
        })
    });
    html! {
        svg viewBox={"0 0 " (SIZE) " " (SIZE)} role="img" aria-label=(label) {
            "\n"
            (content)
            @if length > 0.0 && length.is_finite() {
                path.s d={"M12 282V288H" (px(end)) "V282"} {}
                text.s x=(px(0.5 * (12.0 + end))) y="278" { (Notation::of(length).length(length)) }
            }
            // An axis that points to the viewer, or away, is a point.
            @for (name, _, at) in axes.iter().filter(|(_, length, _)| *length >= 0.3) {
                @let ([x, y], [u, v]) = (at(15.0), at(22.0));
                @let [x0, y0, x, y] = [AT[0], AT[1], x, y].map(px);
                path.s d={"M" (x0) " " (y0) "L" (x) " " (y)} {}
                text.s x=(px(u)) y=(px(v + 3.5)) { (name) }
            }
        }
    }
}

/// Omits points closer than the spacing, and points of nearly straight parts.
pub(super) fn simplify(points: Vec<Point>, spacing: f64) -> Vec<Point> {
    let Some(&first) = points.first() else {
        return points;
    };
    let mut out = vec![first];
    // Bound of the deviation of the points that were omitted since the last one that was kept.
    let mut drift = 0.0;
    for pair in points[1..].windows(2) {
        let kept = out[out.len() - 1];
        let [u, v] = [0, 1].map(|k| [pair[k][0] - kept[0], pair[k][1] - kept[1]]);
        let ahead = u[0] * (v[0] - u[0]) + u[1] * (v[1] - u[1]) > 0.0;
        let off = (u[0] * v[1] - u[1] * v[0]).abs() / v[0].hypot(v[1]);
        if u[0].hypot(u[1]) < spacing {
            continue;
        }
        // A NaN, if the next point is the kept one, omits nothing.
        if ahead && drift + off < DEVIATION {
            drift += off;
        } else {
            out.push(pair[0]);
            drift = 0.0;
        }
    }
    out.extend(points[1..].last());
    out
}

/// Returns lines as the data of a path. A line whose last point is its first one is closed.
pub(super) fn path<'a>(lines: impl IntoIterator<Item = &'a Vec<Point>>) -> String {
    let mut data = String::new();
    for points in lines {
        for (k, p) in points.iter().enumerate() {
            let command = ["M", "L", " "][k.min(2)];
            data += &format!("{command}{} {}", px(p[0]), px(p[1]));
        }
        if points.len() > 2 && points.first() == points.last() {
            data.push('Z');
        }
    }
    data
}
