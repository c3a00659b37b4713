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
        let (bins, frames) = (&self.series.bins, self.series.width());
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
            ("time", "Milliseconds per frame", "", times, Kind::Times),
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
    /// Lines on a logarithmic axis if the values differ by much.
    Times,
}

/// Vertical axis from the power of ten `low` to `high` if it is logarithmic, and else from 0.
struct Scale {
    low: Option<f64>,
    high: f64,
}

impl Scale {
    fn of(content: &[Figures], kind: Kind) -> Scale {
        let values = content.iter().flat_map(|f| &f.values).flatten().copied();
        let values: Vec<f64> = values.filter(|x| x.is_finite()).collect();
        let high = values.iter().copied().fold(0.0, f64::max);
        let low = values.into_iter().filter(|x| *x > 0.0).fold(high, f64::min);
        match kind == Kind::Times && high > 20.0 * low {
            true => Scale {
                low: Some(10f64.powf(low.log10().floor())),
                high: 10f64.powf(high.log10().ceil()),
            },
            false => Scale {
                low: None,
                high: 1.05 * high,
            },
        }
    }

    fn y(&self, x: f64) -> f64 {
        let share = match self.low {
            Some(low) => (x.max(low) / low).log10() / (self.high / low).log10(),
            None => x / self.high,
        };
        BOTTOM - (BOTTOM - TOP) * share.clamp(0.0, 1.0)
    }

    fn ticks(&self, kind: Kind) -> Vec<f64> {
        let Some(low) = self.low else {
            let whole = matches!(kind, Kind::Counts | Kind::Bars);
            let ticks = ticks(self.high, 3).into_iter();
            return ticks.filter(|t| !whole || t.fract() == 0.0).collect();
        };
        let decades = (self.high / low).log10().round() as i32;
        let powers = (0..=decades).step_by((decades / 5 + 1) as usize);
        powers.map(|k| low * 10f64.powi(k)).collect()
    }
}

fn draw(axis: &Axis<'_>, title: String, content: Vec<Figures>, kind: Kind) -> Plot {
    let scale = Scale::of(&content, kind);
    let is_bar = kind == Kind::Bars;
    let data = |f: &Figures| {
        let mut data = String::new();
        let mut open = false;
        for (k, value) in f.values.iter().enumerate() {
            let value = value.filter(|x| x.is_finite() && (!is_bar || *x > 0.0));
            let Some(y) = value.map(|value| px(scale.y(value))) else {
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
            @for tick in scale.ticks(kind) {
                @let y = scale.y(tick);
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
