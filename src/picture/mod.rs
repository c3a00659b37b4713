//! Pictures of a model and of its links, as SVG files.
//!
//! The whole model is drawn along its thinnest axis, strands at the back lighter than those in
//! front, and marked curves red on top. Beside it is a part around the place where the first marked
//! pair is closest, from the same side: both curves in a colour of their own, lower strands
//! interrupted by upper ones.
//!
//! Cost: linear in the number of segments. A picture has at most about `MOST_POINTS` points per
//! panel: curves of large models lose detail.

use crate::certificate::Certificate;
use crate::curve::vector::sub;
use crate::curve::{CurveSet, Notation, Point};
use crate::pairs::{Trees, closest_approach};
use crate::svg::{escape, plain, px, round_below};
use crate::verdict::Place;

/// Approximate maximum number of points of a panel.
const MOST_POINTS: f64 = 40_000.0;

/// Smallest distance of successive points in pixels.
const SPACING: f64 = 1.2;

/// Size of a panel in pixels, and height of the title.
const PANEL: f64 = 560.0;
const TITLE: f64 = 64.0;

/// Number of points of a spline segment.
const SAMPLES: usize = 4;

/// Number of depths that are drawn one above the other.
const DEPTHS: usize = 24;

/// Half of the width of the second panel, in lengths of the longer segment at the place, and the
/// largest share of the model.
const SEGMENTS: f64 = 14.0;
const LARGEST: f64 = 0.1;

/// Attributes of a text that is legible above strands.
const HALO: &str = "stroke=\"#fff\" stroke-width=\"4\" stroke-linejoin=\"round\" \
                    paint-order=\"stroke\"";

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

/// Draws a model with marked pairs of curves, as an SVG file.
pub fn draw(set: &CurveSet, title: &str, subtitle: &str, marked: &[Marked]) -> String {
    let view = View::of(set);
    let zoomed = marked.iter().find_map(|m| Some((m, m.place?)));
    let width = match zoomed {
        Some(_) => 2.0 * PANEL + 12.0,
        None => PANEL,
    };
    let height = PANEL + TITLE;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"DejaVu Sans, sans-serif\" font-size=\"13\" fill=\"#1c2329\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n\
         <text x=\"12\" y=\"26\" font-size=\"16\" font-weight=\"bold\">{}</text>\n\
         <text x=\"12\" y=\"48\">{}</text>\n",
        escape(&plain(title, 100)),
        escape(&plain(subtitle, 140))
    );
    whole(set, &view, marked, &mut out);
    if let Some((pair, place)) = zoomed {
        part(set, &view, pair.curves, place, &mut out);
    }
    out += "</svg>\n";
    out
}

/// The axes of a picture: to the right, up, and towards the viewer; and what it shows.
#[derive(Clone, Copy)]
struct View {
    axes: [usize; 3],
    centre: Point,
    /// Half of the longest visible side.
    reach: f64,
    /// Half of the depth.
    depth: f64,
}

impl View {
    fn of(set: &CurveSet) -> View {
        let (low, high) = set.corners();
        let half = [0, 1, 2].map(|x| (0.5 * high[x] - 0.5 * low[x]).max(0.0));
        let thinnest = (0..3)
            .min_by(|&a, &b| half[a].total_cmp(&half[b]))
            .unwrap_or(2);
        // Right-handed, with z or else y up.
        let axes = [[1, 2, 0], [0, 2, 1], [0, 1, 2]][thinnest];
        let longest = half.into_iter().fold(0.0, f64::max);
        let least = |x: f64| if x > 0.0 { x } else { 1.0 };
        View {
            axes,
            centre: [0, 1, 2].map(|x| 0.5 * low[x] + 0.5 * high[x]),
            reach: least(longest),
            depth: least(half[thinnest]),
        }
    }

    /// Returns a point in pixels to the right and down, and its depth from -1 to 1.
    fn pixel(&self, p: Point) -> Point {
        let d = sub(p, self.centre);
        let [across, up, towards] = self.axes.map(|x| d[x]);
        // Looking along y, the right-handed axis points away.
        let sign = if self.axes[2] == 1 { -1.0 } else { 1.0 };
        let half = 0.5 * PANEL;
        [
            half + 0.94 * half * across / self.reach,
            half - 0.94 * half * up / self.reach,
            sign * towards / self.depth,
        ]
    }
}

/// Points of a curve in pixels, no closer than the spacing, with those that `shown` refuses as
/// gaps.
fn pieces(
    set: &CurveSet,
    view: &View,
    i: usize,
    spacing: f64,
    shown: impl Fn(Point) -> bool,
) -> Vec<Vec<Point>> {
    let segments = set.curve(i).segments as usize;
    let steps = if set.basis().is_polyline() {
        1
    } else {
        SAMPLES
    };
    let mut out = vec![Vec::new()];
    let mut last: Option<Point> = None;
    for n in 0..=segments * steps {
        let (s, k) = (n / steps, n % steps);
        let p = match k {
            0 => set.knot(i, s),
            _ => set.eval(i, s, k as f64 / steps as f64),
        };
        let p = view.pixel(p);
        if !p.iter().all(|x| x.is_finite()) || !shown(p) {
            if !out[out.len() - 1].is_empty() {
                out.push(Vec::new());
            }
            last = None;
            continue;
        }
        let far = last.is_none_or(|q| (p[0] - q[0]).hypot(p[1] - q[1]) >= spacing);
        if far || n == segments * steps {
            let current = out.len() - 1;
            out[current].push(p);
            last = Some(p);
        }
    }
    out
}

/// Returns the spacing at which all curves have about [`MOST_POINTS`] points or fewer.
fn spacing(set: &CurveSet, view: &View, shown: impl Fn(Point) -> bool) -> f64 {
    let mut length = 0.0;
    for i in 0..set.len() {
        let mut last: Option<Point> = None;
        for s in 0..=set.curve(i).segments as usize {
            let p = view.pixel(set.knot(i, s));
            let p = Some(p).filter(|p| p.iter().all(|x| x.is_finite()) && shown(*p));
            if let (Some(p), Some(q)) = (p, last) {
                length += (p[0] - q[0]).hypot(p[1] - q[1]);
            }
            last = p;
        }
    }
    SPACING.max(length / MOST_POINTS)
}

/// Paths of one colour at all depths.
struct Layers {
    paths: Vec<String>,
}

impl Layers {
    fn new() -> Layers {
        Layers {
            paths: vec![String::new(); DEPTHS],
        }
    }

    /// Adds a line, cut if its depth changes.
    fn add(&mut self, points: &[Point]) {
        let layer = |e: &[Point]| {
            let depth = 0.25 * (e[0][2] + e[1][2]) + 0.5;
            ((depth * DEPTHS as f64) as usize).min(DEPTHS - 1)
        };
        let mut open = None;
        for e in points.windows(2) {
            let k = layer(e);
            let path = &mut self.paths[k];
            if open != Some(k) {
                *path += &format!("M{} {}", px(e[0][0]), px(e[0][1]));
                open = Some(k);
            }
            *path += &format!("L{} {}", px(e[1][0]), px(e[1][1]));
        }
    }
}

/// Draws the whole model.
fn whole(set: &CurveSet, view: &View, marked: &[Marked], out: &mut String) {
    let space = spacing(set, view, |_| true);
    let mut red = vec![false; set.len()];
    for i in marked.iter().flat_map(|m| m.curves) {
        if let Some(red) = red.get_mut(i as usize) {
            *red = true;
        }
    }
    let mut others = Layers::new();
    let mut own = String::new();
    for (i, red) in red.into_iter().enumerate() {
        for piece in pieces(set, view, i, space, |_| true) {
            if red {
                for (k, p) in piece.iter().enumerate() {
                    own += &format!(
                        "{}{} {}",
                        if k == 0 { "M" } else { "L" },
                        px(p[0]),
                        px(p[1])
                    );
                }
            } else {
                others.add(&piece);
            }
        }
    }
    *out += &format!(
        "<g transform=\"translate(0 {TITLE})\" fill=\"none\" stroke-linejoin=\"round\" \
         stroke-linecap=\"round\">\n"
    );
    for (k, path) in others
        .paths
        .iter()
        .enumerate()
        .filter(|(_, path)| !path.is_empty())
    {
        // From light at the back to dark in front.
        let grey = 215.0 - 150.0 * k as f64 / (DEPTHS - 1) as f64;
        *out += &format!(
            "<path stroke=\"rgb({g},{g},{b})\" stroke-width=\"1.1\" d=\"{path}\"/>\n",
            g = grey as u8,
            b = (grey + 12.0) as u8
        );
    }
    if !own.is_empty() {
        *out += &format!("<path stroke=\"#d21f1f\" stroke-width=\"1.5\" d=\"{own}\"/>\n");
    }
    for place in marked.iter().filter_map(|m| m.place) {
        let p = view.pixel(place.point);
        if p.iter().all(|x| x.is_finite()) {
            *out += &format!(
                "<circle cx=\"{}\" cy=\"{}\" r=\"11\" stroke=\"#a0007d\" stroke-width=\"2\"/>\n",
                px(p[0]),
                px(p[1])
            );
        }
    }
    *out += "</g>\n";
    scale(view, 12.0, out);
}

/// Draws the part around a place.
fn part(set: &CurveSet, view: &View, curves: [u32; 2], place: Place, out: &mut String) {
    let long = |i: u32, s: u32| {
        let (i, s) = (i as usize, s as usize);
        let curve = set.curves().get(i).filter(|c| s < c.segments as usize);
        curve.map_or(0.0, |_| {
            let d = sub(set.knot(i, s + 1), set.knot(i, s));
            d[0].hypot(d[1]).hypot(d[2])
        })
    };
    let segment = long(curves[0], place.segments[0]).max(long(curves[1], place.segments[1]));
    let reach = (SEGMENTS * segment).min(LARGEST * view.reach);
    let reach = if reach > 0.0 {
        reach
    } else {
        LARGEST * view.reach
    };
    let near = View {
        centre: place.point,
        reach,
        depth: reach,
        ..*view
    };
    let inside = |p: Point| {
        let margin = 0.3 * PANEL;
        let beside = |x: f64| x > -margin && x < PANEL + margin;
        beside(p[0]) && beside(p[1]) && p[2].abs() <= 1.0
    };
    let space = spacing(set, &near, inside);
    let mut layers = [Layers::new(), Layers::new(), Layers::new()];
    for i in 0..set.len() {
        let group = match i as u32 {
            i if i == curves[0] => 1,
            i if i == curves[1] => 2,
            _ => 0,
        };
        for piece in pieces(set, &near, i, space, inside) {
            layers[group].add(&piece);
        }
    }
    let left = PANEL + 12.0;
    *out += &format!(
        "<svg x=\"{left}\" y=\"{TITLE}\" width=\"{PANEL}\" height=\"{PANEL}\" \
         viewBox=\"0 0 {PANEL} {PANEL}\">\n<rect width=\"{PANEL}\" height=\"{PANEL}\" \
         fill=\"#f7f8f9\"/>\n<g fill=\"none\" stroke-linejoin=\"round\">\n"
    );
    const COLOURS: [(&str, f64); 3] = [("#9aa4ad", 3.0), ("#0067b1", 6.0), ("#d35400", 6.0)];
    for k in 0..DEPTHS {
        for (group, (colour, width)) in layers.iter().zip(COLOURS) {
            let path = &group.paths[k];
            if path.is_empty() {
                continue;
            }
            *out += &format!(
                "<path stroke=\"#f7f8f9\" stroke-width=\"{}\" d=\"{path}\"/>\
                 <path stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linecap=\"round\" \
                 d=\"{path}\"/>\n",
                width + 4.0
            );
        }
    }
    let half = 0.5 * PANEL;
    *out += &format!(
        "<circle cx=\"{half}\" cy=\"{half}\" r=\"24\" stroke=\"#a0007d\" stroke-width=\"2\" \
         stroke-dasharray=\"5 4\"/>\n</g>\n</svg>\n\
         <text x=\"{}\" y=\"{}\" font-weight=\"bold\" {HALO}>\
         <tspan fill=\"#0067b1\">curve {}</tspan> \
         <tspan fill=\"#d35400\">curve {}</tspan></text>\n",
        left + 12.0,
        TITLE + 22.0,
        curves[0],
        curves[1]
    );
    scale(&near, left + 12.0, out);
}

/// Draws a bar with its length, a round number of about a fifth of the width.
fn scale(view: &View, left: f64, out: &mut String) {
    let length = round_below(0.4 * view.reach);
    let end = left + 0.94 * 0.5 * PANEL * length / view.reach;
    if !end.is_finite() {
        return;
    }
    let y = TITLE + PANEL - 14.0;
    *out += &format!(
        "<path d=\"M{left} {}V{y}H{}V{}\" fill=\"none\" stroke=\"#5c6770\" stroke-width=\"1.4\"/>\
         <text x=\"{left}\" y=\"{}\" fill=\"#5c6770\" {HALO}>{}</text>\n",
        y - 6.0,
        px(end),
        y - 6.0,
        y - 10.0,
        Notation::of(length).length(length)
    );
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
