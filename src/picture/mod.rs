//! One drawing of curves as SVG: of a model and its links, and of the place of a finding.
//!
//! The whole model is drawn along its thinnest axis, strands at the back lighter than those in
//! front, and marked curves red on top. A place is drawn from a side from which both curves are
//! open, each in a colour of its own, lower strands interrupted by upper ones: see `panel`.
//!
//! Cost: linear in the number of segments. A picture has at most about `MOST_POINTS` points per
//! panel: curves of large models lose detail.

#![cfg_attr(
    not(all(feature = "cli", feature = "rerun")),
    allow(dead_code, unused_imports, reason = "both together use all")
)]

mod gaps;
mod panel;
mod strands;
pub(crate) mod svg;
mod view;

pub(crate) use self::panel::Scene;
pub(crate) use self::strands::{Part, Radii, Strand, Window, own as strands_of};

use self::panel::{HALF, frame, path, simplify};
use self::strands::clip;
use self::view::View;
use crate::certificate::Certificate;
use crate::curve::vector::{dot, per_axis};
use crate::curve::{CurveSet, Image, Point};
use crate::pairs::{Trees, closest_approach};
use crate::picture::svg::{plain, px};
use crate::verdict::{Place, Spot};
use maud::{Markup, PreEscaped, html};
use std::collections::BTreeSet;

/// Approximate maximum number of points of the picture of a model.
const MOST_POINTS: f64 = 40_000.0;

/// Smallest distance of successive points in it.
const SPACING: f64 = 0.6;

/// Share of the picture that the model fills.
const FILLED: f64 = 0.94;

/// Size of a panel of a file in pixels, its distance to the next one, and heights of the title and
/// of a caption.
const PANEL: f64 = 600.0;
const GAP: f64 = 12.0;
const STEP: f64 = PANEL + GAP;
const TITLE: f64 = 56.0;
const CAPTION: f64 = 28.0;

/// Number of depths that are drawn one above the other.
const DEPTHS: usize = 24;

/// Rules of style sheets for pictures. The colours are variables.
pub(crate) const STYLE: &str = include_str!("style.css");

/// Values of the colours in a file. Few programs but browsers know variables.
const COLOURS: [(&str, &str); 8] = [
    ("var(--text)", "#1c2329"),
    ("var(--dim)", "#5c6770"),
    ("var(--box)", "#f4f6f8"),
    ("var(--a)", "#0067b1"),
    ("var(--b)", "#d35400"),
    ("var(--mark)", "#a0007d"),
    ("var(--other)", "#9aa4ad"),
    ("var(--rest)", "#b0768f"),
];

/// Two curves to mark.
#[derive(Clone, Copy, Debug)]
pub struct Marked {
    /// The curves.
    pub curves: [u32; 2],
    /// Place at which they are closest.
    pub place: Option<Place>,
}

/// Returns the linked pairs of a model, the first `most` of them with the place at which they are
/// closest.
pub fn links(set: &CurveSet, certificate: &Certificate, most: usize) -> Vec<Marked> {
    let mut trees = Trees::default();
    if !certificate.links.is_empty() {
        trees.refit(set);
    }
    let place = |(k, link): (usize, &crate::verdict::Link)| Marked {
        curves: [link.i, link.j],
        place: (k < most).then(|| closest_approach(set, &trees, link.i as usize, link.j as usize)),
    };
    certificate.links.iter().enumerate().map(place).collect()
}

/// A picture with a caption.
pub(crate) type Panel = (Markup, Markup);

/// Returns an SVG file with a title and rows of panels.
pub(crate) fn sheet(title: &str, subtitle: &str, rows: &[Vec<Panel>]) -> String {
    let replace = |style: String, (name, value)| style.replace(name, value);
    let style = COLOURS.into_iter().fold(STYLE.to_owned(), replace);
    let most = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = most as f64 * STEP - GAP;
    // A text that fits in letters of this width.
    let fitted = |text: &str, letter: f64| plain(text, (width / letter) as usize);
    let height = TITLE + rows.len() as f64 * (CAPTION + PANEL);
    html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox={"0 0 " (width) " " (height)} {
            style { (PreEscaped(style)) }
            rect width=(width) height=(height) fill="#fff" {}
            text x="12" y="26" font-size="16" font-weight="bold" { (fitted(title, 9.5)) }
            text x="12" y="48" font-size="13" { (fitted(subtitle, 7.0)) }
            @for (row, panels) in rows.iter().enumerate() {
                @for (k, (caption, picture)) in panels.iter().enumerate() {
                    @let x = k as f64 * STEP;
                    @let y = TITLE + row as f64 * (CAPTION + PANEL) + CAPTION;
                    text x=(x + 12.0) y=(y - 9.0) font-size="13" { (caption) }
                    rect x=(x) y=(y) width=(PANEL) height=(PANEL) fill="#f4f6f8" {}
                    svg x=(x) y=(y) width=(PANEL) height=(PANEL) { (picture) }
                }
            }
        }
    }
    .into_string()
}

/// Draws a model with marked pairs of curves, and beside it the place of the first pair that has
/// one, as an SVG file.
pub fn draw(set: &CurveSet, title: &str, subtitle: &str, marked: &[Marked]) -> String {
    let place = marked.iter().find_map(|m| around(set, m.curves, m.place?));
    let caption = html! {
        @if !marked.is_empty() {
            tspan fill="#d21f1f" { "red" } ": curves of the links; grey: other curves"
        }
    };
    let panels = std::iter::once((caption, whole(set, marked))).chain(place);
    sheet(title, subtitle, &[panels.collect()])
}

/// Draws the surroundings of a place.
fn around(set: &CurveSet, curves: [u32; 2], place: Place) -> Option<Panel> {
    let spot = Spot {
        curves,
        image: Image::default(),
        segments: place.segments,
        point: place.point,
    };
    let [_, window, _] = Window::around([None, Some((set, spot)), None], 0.0);
    let scene = Scene::of(set, spot, window?);
    let [i, j] = curves;
    let caption = html! {
        tspan.at { "curve " (i) } " and " tspan.bt { "curve " (j) } " where they are closest"
        @if scene.has_rest() { ", and their other parts (" tspan.rt { "thin" } ")" }
    };
    let view = scene.views()[0].fitted(scene.own());
    let picture = scene.svg(view, Radii::default(), "the place of a link");
    Some((caption, picture))
}

/// Draws the whole model.
fn whole(set: &CurveSet, marked: &[Marked]) -> Markup {
    let [low, high] = set.corners();
    let half = per_axis(|x| (0.5 * high[x] - 0.5 * low[x]).max(0.0));
    let view = View::along_thinnest(half);
    let reach = match half.into_iter().fold(0.0, f64::max) / FILLED {
        0.0 => 1.0,
        reach => reach.min(f64::MAX),
    };
    let window = Window {
        centre: per_axis(|x| 0.5 * low[x] + 0.5 * high[x]),
        reach,
        apart: 0.0,
    };
    let deep = dot(view.towards.map(f64::abs), half) / reach;
    let deep = deep.max(f64::MIN_POSITIVE);
    let lines = |i: usize| {
        let mut strands = Vec::new();
        // A ball that has the whole model.
        clip(set, i, window, 2.0, |_| Part::Other, &mut strands);
        strands.into_iter().map(|s| view.pixels(&s.points))
    };
    let length = |e: &[Point]| (e[1][0] - e[0][0]).hypot(e[1][1] - e[0][1]);
    let all = (0..set.len()).flat_map(lines);
    let all: f64 = all.map(|l| l.windows(2).map(length).sum::<f64>()).sum();
    let spacing = SPACING.max(all / MOST_POINTS);
    let red: BTreeSet<u32> = marked.iter().flat_map(|m| m.curves).collect();
    // The last path is that of marked curves.
    let mut paths = vec![String::new(); DEPTHS + 1];
    for i in 0..set.len() {
        let is_red = red.contains(&(i as u32));
        let layer = |e: &[Point; 2]| {
            let depth = 0.5 + 0.25 * (e[0][2] + e[1][2]) / (HALF * deep);
            let layer = ((depth * DEPTHS as f64) as usize).min(DEPTHS - 1);
            if is_red { DEPTHS } else { layer }
        };
        for line in lines(i) {
            let line = simplify(line, spacing);
            let edges: Vec<&[Point; 2]> = line.array_windows().collect();
            for edges in edges.chunk_by(|e, f| layer(e) == layer(f)) {
                let ends = edges.iter().map(|e| e[1]);
                let points: Vec<Point> = std::iter::once(edges[0][0]).chain(ends).collect();
                paths[layer(edges[0])] += &path([&points]);
            }
        }
    }
    let places = marked.iter().filter_map(|m| m.place);
    let places = places.map(|place| view.pixels(&[window.local(place.point)])[0]);
    let places = places.filter(|p| p.iter().all(|x| x.is_finite()));
    let content = html! {
        @for (k, data) in paths.iter().enumerate().filter(|(_, data)| !data.is_empty()) {
            // From light at the back to dark in front.
            @let grey = (215.0 - 150.0 * k as f64 / DEPTHS as f64) as u8;
            @let colour = match k {
                DEPTHS => "#d21f1f".to_owned(),
                _ => format!("rgb({grey},{grey},{})", grey + 12),
            };
            path stroke=(colour) stroke-width=".6" stroke-linejoin="round" d=(data) {}
        }
        @for [x, y, _] in places { circle.m cx=(px(x)) cy=(px(y)) r="6" {} }
    };
    frame("the whole model", reach, view, &content)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};
    use crate::scenes::Scene;

    #[test]
    fn linked_curves_are_red_and_shown_closely() {
        let scene: Scene = "chainmail:rows=2,columns=2".parse().unwrap();
        let scene = scene.build().unwrap();
        let linked = links(&scene.curves, &scene.certificate, 3);
        assert_eq!(linked.len(), scene.certificate.links.len());
        assert_eq!(linked.iter().filter(|m| m.place.is_some()).count(), 3);
        let svg = draw(&scene.curves, "a <b>", "links", &linked);
        assert!(svg.contains("a &lt;b&gt;") && svg.contains("#d21f1f"));
        assert!(svg.contains(">curve 0<") && !svg.contains("NaN"));
        let none = draw(&scene.curves, "", "", &[]);
        assert!(!none.contains("#d21f1f") && !none.contains(">curve"));
    }

    #[test]
    fn pictures_of_large_models_are_small() {
        let scene: Scene = "knit:rows=40,stitches=100,segments=96000".parse().unwrap();
        let svg = draw(&scene.build().unwrap().curves, "", "", &[]);
        assert!(svg.len() < 1_500_000, "{}", svg.len());
    }

    #[test]
    fn extreme_coordinates_have_a_picture() {
        for size in [0.0, 1e-300, f64::MAX] {
            let xyz = [-size, 0., 0., size, 0., 0., 0., size, 0.];
            let set = CurveSet::from_counts(Basis::Polyline, &[-3], Positions::F64(&xyz)).unwrap();
            let svg = draw(&set, "", "", &[]);
            assert!(
                !svg.contains("NaN") && !svg.contains("inf"),
                "{size}: {svg}"
            );
        }
    }
}
