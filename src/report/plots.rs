//! Plots of figures over the frames, as SVG.

use super::axis::{Axis, LEFT, RIGHT, WIDTH};
use super::facts::Facts;
use super::series::Bin;
use crate::curve::significant;
use crate::picture::svg::{px, ticks};
use maud::{Markup, html};

/// Vertical positions.
const TOP: f64 = 8.0;
const BOTTOM: f64 = 118.0;
const HEIGHT: f64 = 154.0;

/// A curve or bars of a plot.
struct Figures {
    name: &'static str,
    class: &'static str,
    values: Vec<Option<f64>>,
}

/// A plot: its title, and its content as SVG.
pub(super) struct Plot {
    pub title: String,
    /// Class and name of each curve.
    pub legend: Vec<(&'static str, &'static str)>,
    pub svg: Markup,
}

impl Facts {
    /// Returns the plots of the figures that are not 0 in all frames, and names of the others.
    pub fn plots(&self) -> (Vec<Plot>, Vec<&'static str>) {
        let (bins, frames) = (&self.series.bins, self.series.width);
        let each = |name, class, of: &dyn Fn(&Bin) -> Option<f64>| {
            let values = bins.iter().map(of).collect();
            Figures {
                name,
                class,
                values,
            }
        };
        let sum = |name, class, of: fn(&Bin) -> u64| each(name, class, &|b| Some(of(b) as f64));
        let links = |name, class, k| each(name, class, &move |b| Some(b.links?[k] as f64));
        let mean = |b: &Bin| Some(b.total_ms / b.frames as f64);
        let times = match frames {
            1 => vec![each("ms", "k4", &mean)],
            _ => vec![
                each("longest", "k5", &|b| Some(b.max_ms)),
                each("mean", "k4", &mean),
            ],
        };
        let percent = |b: &Bin| b.clearance.map(|c| 100.0 * c);
        let mut clearance = vec![each("closest strands", "k4", &percent)];
        let level = self.metadata.get("min_clearance");
        let level = level.filter(|_| self.clearances[0] > 0);
        let level = level.and_then(|low| low.parse::<f64>().ok());
        clearance.extend(level.map(|x| each("level of the warning", "k1", &|_| Some(100.0 * x))));
        let (mut plots, mut zero) = (Vec::new(), Vec::new());
        for (what, title, how, content, kind) in [
            (
                "changed links",
                "Links that differ from the baseline",
                "maximum",
                vec![
                    links("lost", "k1", 0),
                    links("gained", "k2", 1),
                    links("other number", "k3", 2),
                ],
                Kind::Counts,
            ),
            (
                "pull-throughs",
                "Pull-throughs",
                "sum",
                vec![
                    sum("pull-throughs", "k4", |b| b.pull_throughs),
                    sum("unresolved", "k5", |b| b.unresolved),
                ],
                Kind::Bars,
            ),
            ("time", "Milliseconds per frame", "", times, Kind::Lines),
            (
                "skipped and missing frames",
                "Frames skipped or missing before a frame",
                "sum",
                vec![
                    sum("skipped", "k3", |b| b.skipped),
                    sum("missing", "k2", |b| b.missing),
                ],
                Kind::Bars,
            ),
            (
                "clearance",
                "Clearance of the closest strands, % of their diameter",
                "minimum",
                clearance,
                Kind::Lines,
            ),
        ] {
            let title = match frames > 1 && !how.is_empty() {
                true => format!("{title} ({how} of each {frames} frames)"),
                false => title.to_owned(),
            };
            let some = |f: &Figures| f.values.iter().flatten().any(|x| *x > 0.0);
            if content.iter().any(some) {
                let content = content.into_iter().filter(some).collect();
                plots.push(draw(&Axis::of(bins), title, content, kind));
            } else if what != "clearance" || self.clearances[0] > 0 {
                zero.push(what);
            }
        }
        (plots, zero)
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Lines,
    /// Lines of whole numbers.
    Counts,
    /// Bars of whole numbers.
    Bars,
}

fn draw(axis: &Axis<'_>, title: String, content: Vec<Figures>, kind: Kind) -> Plot {
    let values = content.iter().flat_map(|f| &f.values).flatten();
    let highest = values.filter(|x| x.is_finite()).fold(0.0, |a, b| b.max(a));
    let high = 1.05 * highest;
    let y = |x: f64| BOTTOM - (BOTTOM - TOP) * (x / high).clamp(0.0, 1.0);
    let is_tick = |tick: &f64| kind == Kind::Lines || tick.fract() == 0.0;
    let is_bar = kind == Kind::Bars;
    let data = |f: &Figures| {
        let mut data = String::new();
        let mut open = false;
        for (k, value) in f.values.iter().enumerate() {
            let value = value.filter(|x| x.is_finite() && (!is_bar || *x > 0.0));
            let Some(y) = value.map(|value| px(y(value))) else {
                open = false;
                continue;
            };
            let (from, to) = (px(axis.x(k)), px(axis.x(k + 1)));
            data += &if is_bar {
                let width = axis.step.clamp(1.5, 24.0);
                let x = px(axis.middle(k) - 0.5 * width);
                format!("M{x} {BOTTOM}V{y}h{}V{BOTTOM}Z", px(width))
            } else if open {
                format!("V{y}H{to}")
            } else {
                format!("M{from} {y}H{to}")
            };
            open = true;
        }
        data
    };
    let svg = html! {
        svg viewBox={"0 0 " (WIDTH) " " (HEIGHT)} role="img" aria-label=(title) {
            @for tick in ticks(high, 3).into_iter().filter(is_tick) {
                @let y = y(tick);
                path.g d={"M" (LEFT) " " (px(y)) "H" (RIGHT)} {}
                text.t.e.d x=(LEFT - 8.0) y=(px(y + 4.0)) { (significant(tick)) }
            }
            @for f in &content {
                path class={(f.class) " " (if is_bar { "f" } else { "n" })} d=(data(f)) {}
            }
            (axis.draw(BOTTOM))
        }
    };
    Plot {
        title,
        legend: content.iter().map(|f| (f.class, f.name)).collect(),
        svg,
    }
}
