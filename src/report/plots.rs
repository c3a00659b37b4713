//! Plots of figures over the frames, as SVG.

use super::axis::{Axis, WIDTH};
use super::facts::Facts;
use super::series::Bin;
use super::svg::{escape, px, ticks};
use crate::curve::significant;

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
    pub svg: String,
}

impl Facts {
    /// Returns the plots of the figures that are not 0 in all frames, and names of the others.
    pub fn plots(&self) -> (Vec<Plot>, Vec<&'static str>) {
        let bins = &self.series.bins;
        let each = |of: &dyn Fn(&Bin) -> f64| bins.iter().map(|b| Some(of(b))).collect::<Vec<_>>();
        let figures = |name, class, values| Figures {
            name,
            class,
            values,
        };
        let wide = self.series.width > 1;
        let of_bin = |what: &str, how: &str| match wide {
            true => format!("{what} ({how} of each {} frames)", self.series.width),
            false => what.to_owned(),
        };
        let (mut plots, mut zero) = (Vec::new(), Vec::new());
        let mut add = |what: &'static str, title: String, content: Vec<Figures>, kind: Kind| {
            let largest = content.iter().flat_map(|f| &f.values).flatten();
            match largest.fold(0.0, |a: f64, x| a.max(*x)) {
                x if x > 0.0 => plots.push(draw(&Axis::of(&self.series), title, &content, kind)),
                _ => zero.push(what),
            }
        };
        let links = |k: usize| {
            let count = |b: &Bin| Some(b.links?[k] as f64);
            bins.iter().map(count).collect::<Vec<_>>()
        };
        add(
            "changed links",
            of_bin("Links that differ from the baseline", "maximum"),
            vec![
                figures("lost", "k1", links(0)),
                figures("gained", "k2", links(1)),
                figures("other number", "k3", links(2)),
            ],
            Kind::Counts,
        );
        add(
            "pull-throughs",
            of_bin("Pull-throughs", "sum"),
            vec![
                figures("pull-throughs", "k4", each(&|b| b.pull_throughs as f64)),
                figures("unresolved", "k5", each(&|b| b.unresolved as f64)),
            ],
            Kind::Bars,
        );
        let mean = |b: &Bin| b.total_ms / b.frames as f64;
        let mut times = vec![figures("ms", "k4", each(&mean))];
        if wide {
            times = vec![
                figures("longest", "k5", each(&|b| b.max_ms)),
                figures("mean", "k4", each(&mean)),
            ];
        }
        add("time", "Milliseconds per frame".into(), times, Kind::Times);
        add(
            "skipped and missing frames",
            of_bin("Frames skipped or missing before a frame", "sum"),
            vec![
                figures("skipped", "k3", each(&|b| b.skipped as f64)),
                figures("missing", "k2", each(&|b| b.missing as f64)),
            ],
            Kind::Bars,
        );
        if self.clearances[0] > 0 {
            let percent = |b: &Bin| b.clearance.map(|c| 100.0 * c);
            let low = self.metadata.get("min_clearance");
            let low: Option<f64> = low.and_then(|low| low.parse().ok());
            let level = low.map(|low| 100.0 * low);
            let values = bins.iter().map(percent).collect();
            let mut content = vec![figures("closest strands", "k4", values)];
            if let Some(level) = level {
                content.push(figures("level of the warning", "k1", each(&|_| level)));
            }
            let title = "Clearance of the closest strands, % of their diameter";
            add("clearance", of_bin(title, "minimum"), content, Kind::Lines);
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

/// Vertical axis.
struct Scale {
    low: f64,
    high: f64,
    log: bool,
    /// True if the values are whole numbers.
    whole: bool,
}

impl Scale {
    fn of(content: &[&Figures], kind: Kind) -> Scale {
        let values = || content.iter().flat_map(|f| &f.values).flatten().copied();
        let values = || values().filter(|x| x.is_finite());
        let high = values().fold(0.0, f64::max);
        let low = values().filter(|x| *x > 0.0).fold(high, f64::min);
        match kind == Kind::Times && high > 20.0 * low {
            true => Scale {
                low: 10f64.powf(low.log10().floor()),
                high: 10f64.powf(high.log10().ceil()),
                log: true,
                whole: false,
            },
            false => Scale {
                low: 0.0,
                high: 1.05 * high,
                log: false,
                whole: matches!(kind, Kind::Counts | Kind::Bars),
            },
        }
    }

    fn y(&self, x: f64) -> f64 {
        let share = match self.log {
            true => (x.max(self.low) / self.low).log10() / (self.high / self.low).log10(),
            false => x / self.high,
        };
        BOTTOM - (BOTTOM - TOP) * share.clamp(0.0, 1.0)
    }

    fn ticks(&self) -> Vec<f64> {
        if !self.log {
            let ticks = ticks(self.high, 3).into_iter();
            return ticks.filter(|t| !self.whole || t.fract() == 0.0).collect();
        }
        let decades = (self.high / self.low).log10().round() as i32;
        let step = (decades / 5 + 1) as usize;
        (0..=decades)
            .step_by(step)
            .map(|k| self.low * 10f64.powi(k))
            .collect()
    }
}

fn draw(axis: &Axis<'_>, title: String, content: &[Figures], kind: Kind) -> Plot {
    let some = |f: &&Figures| f.values.iter().flatten().any(|x| *x > 0.0);
    let content: Vec<&Figures> = content.iter().filter(some).collect();
    let scale = Scale::of(&content, kind);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">\n",
        escape(&title)
    );
    let [left, right] = axis.ends();
    for tick in scale.ticks() {
        let y = scale.y(tick);
        svg += &format!(
            "<path class=\"g\" d=\"M{} {}H{}\"/><text class=\"t e d\" x=\"{}\" y=\"{}\">{}\
             </text>\n",
            px(left),
            px(y),
            px(right),
            px(left - 8.0),
            px(y + 4.0),
            significant(tick)
        );
    }
    for f in &content {
        let mut data = String::new();
        let mut open = false;
        for (k, value) in f.values.iter().enumerate() {
            let value = value.filter(|x| x.is_finite() && (kind != Kind::Bars || *x > 0.0));
            let Some(value) = value else {
                open = false;
                continue;
            };
            let (from, to, y) = (axis.x(k), axis.x(k + 1), scale.y(value));
            data += &match kind {
                Kind::Bars => {
                    let width = (to - from).clamp(1.5, 24.0);
                    let x = axis.middle(k) - 0.5 * width;
                    format!(
                        "M{} {}V{}h{}V{}Z",
                        px(x),
                        px(BOTTOM),
                        px(y),
                        px(width),
                        px(BOTTOM)
                    )
                }
                _ if open => format!("V{}H{}", px(y), px(to)),
                _ => format!("M{} {}H{}", px(from), px(y), px(to)),
            };
            open = true;
        }
        let fill = if kind == Kind::Bars { "f" } else { "n" };
        svg += &format!("<path class=\"{} {fill}\" d=\"{data}\"/>\n", f.class);
    }
    axis.draw(BOTTOM, &mut svg);
    svg += "</svg>\n";
    Plot {
        title,
        legend: content.iter().map(|f| (f.class, f.name)).collect(),
        svg,
    }
}
