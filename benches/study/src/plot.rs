//! Plots with two logarithmic axes, as SVG.

use linkwatch::{Error, Result};
use plotters::coord::Shift;
use plotters::coord::combinators::{BindKeyPoints, LogCoord, WithKeyPoints};
use plotters::prelude::*;
use std::path::Path;

/// A plot with two logarithmic axes.
pub struct Plot {
    pub title: String,
    /// Quantity of the horizontal axis, with its unit.
    pub x: &'static str,
    /// Quantity of the vertical axis, with its unit.
    pub y: &'static str,
    pub series: Vec<Series>,
}

/// Points of one colour, all coordinates above 0.
pub struct Series {
    name: String,
    pub points: Vec<(f64, f64)>,
    /// True for a dashed reference line.
    guide: bool,
}

impl Series {
    /// Creates a series of measured points, joined by a line.
    pub fn marks(name: &str, points: Vec<(f64, f64)>) -> Series {
        let (name, guide) = (name.to_owned(), false);
        Series {
            name,
            points,
            guide,
        }
    }

    /// Creates a dashed reference line.
    pub fn guide(name: &str, points: Vec<(f64, f64)>) -> Series {
        let guide = true;
        Series {
            guide,
            ..Series::marks(name, points)
        }
    }

    /// Groups points into series, in the order of their first points.
    pub fn grouped(points: impl Iterator<Item = (String, (f64, f64))>) -> Vec<Series> {
        let mut all: Vec<Series> = Vec::new();
        for (name, point) in points {
            match all.iter_mut().find(|s| s.name == name) {
                Some(series) => series.points.push(point),
                None => all.push(Series::marks(&name, vec![point])),
            }
        }
        all
    }

    /// Returns a guide that grows with the number of segments, from the lowest first point.
    pub fn proportional(all: &[Series]) -> Option<Series> {
        let points = || all.iter().flat_map(|s| &s.points);
        let first = points().map(|p| p.0).fold(f64::INFINITY, f64::min);
        let last = points().map(|p| p.0).fold(0.0, f64::max);
        let least = all.iter().filter_map(|s| s.points.first());
        let least = least.map(|p| p.1).fold(f64::INFINITY, f64::min);
        let grown = vec![(first, least), (last, least * last / first)];
        (first < last).then(|| Series::guide("∝ segments", grown))
    }
}

const SIZE: (u32, u32) = (1280, 760);
/// Width of the legend beside the data.
const LEGEND: u32 = 240;
const FONT: &str = "sans-serif";

/// Colours that most people can tell apart (Okabe & Ito 2008), without the yellow, which is pale on
/// white.
const COLORS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(110, 70, 40),
    RGBColor(120, 120, 0),
];
const GUIDES: [RGBColor; 2] = [RGBColor(60, 60, 60), RGBColor(150, 150, 150)];

type Drawn = Result<(), DrawingAreaErrorKind<<SVGBackend<'static> as DrawingBackend>::ErrorType>>;

impl Plot {
    /// Writes the plot to a file.
    pub fn write(&self, path: &Path) -> Result<()> {
        let mut svg = String::new();
        let drawn = self.draw(&SVGBackend::with_string(&mut svg, SIZE).into_drawing_area());
        drawn.map_err(|e| std::io::Error::other(e.to_string()))?;
        std::fs::write(path, svg).map_err(|source| Error::File {
            path: path.to_owned(),
            source,
        })
    }

    fn draw(&self, root: &DrawingArea<SVGBackend<'_>, Shift>) -> Drawn {
        root.fill(&WHITE)?;
        let (left, right) = root.split_horizontally(SIZE.0 - LEGEND);
        let (x, y) = (self.range(|p| p.0), self.range(|p| p.1));
        let mut chart = ChartBuilder::on(&left)
            .caption(&self.title, (FONT, 26))
            .margin(16)
            .x_label_area_size(64)
            .y_label_area_size(92)
            .build_cartesian_2d(axis(x), axis(y))?;
        chart
            .configure_mesh()
            .bold_line_style(BLACK.mix(0.16))
            .light_line_style(BLACK.mix(0.05))
            .label_style((FONT, 18))
            .axis_desc_style((FONT, 20))
            .x_desc(self.x)
            .y_desc(self.y)
            .x_label_formatter(&|&v| label(v))
            .y_label_formatter(&|&v| label(v))
            .draw()?;
        let (mut colors, mut guides) = (COLORS.iter().cycle(), GUIDES.iter().cycle());
        for (series, at) in self.series.iter().zip((60..).step_by(34)) {
            let points = series.points.iter().copied();
            if series.guide {
                let color = guides.next().unwrap_or(&BLACK);
                chart.draw_series(DashedLineSeries::new(points, 9, 6, color.stroke_width(2)))?;
                for x in [8, 25, 42] {
                    let dash = [(x, at), (x + 10, at)];
                    right.draw(&PathElement::new(dash, color.stroke_width(2)))?;
                }
            } else {
                let color = colors.next().unwrap_or(&BLACK);
                chart.draw_series(LineSeries::new(points.clone(), color.stroke_width(2)))?;
                chart.draw_series(points.map(|p| Circle::new(p, 6, color.filled())))?;
                let line = [(8, at), (52, at)];
                right.draw(&PathElement::new(line, color.stroke_width(2)))?;
                right.draw(&Circle::new((30, at), 6, color.filled()))?;
            }
            let text = (FONT, 18).into_text_style(&right);
            right.draw(&Text::new(series.name.clone(), (64, at - 9), text))?;
        }
        root.present()
    }

    /// Returns the range of the values, with a margin. Never empty.
    fn range(&self, of: impl Fn(&(f64, f64)) -> f64) -> (f64, f64) {
        let values = || self.series.iter().flat_map(|s| &s.points).map(&of);
        let lo = values().fold(f64::INFINITY, f64::min);
        let hi = values().fold(0.0, f64::max);
        match lo <= hi && lo > 0.0 {
            true => {
                let room = (hi / lo).powf(0.05).max(1.1);
                (lo / room, hi * room)
            }
            false => (0.1, 10.0),
        }
    }
}

/// Creates a logarithmic axis whose labels are round numbers.
fn axis((lo, hi): (f64, f64)) -> WithKeyPoints<LogCoord<f64>> {
    let axis: LogCoord<f64> = (lo..hi).log_scale().into();
    let (bold, light) = ticks(lo, hi);
    axis.with_key_points(bold).with_light_points(light)
}

/// Returns round numbers between two values above 0: at most ten with a label, and those with a
/// line.
fn ticks(lo: f64, hi: f64) -> (Vec<f64>, Vec<f64>) {
    let (first, last) = (lo.log10().floor() as i32, hi.log10().ceil() as i32);
    let at = |digits: &[f64], each: i32| -> Vec<f64> {
        let powers = (first..=last).filter(|power| power % each == 0);
        let values = powers.flat_map(|power| {
            // Parsed, because a computed power of ten is not the nearest number.
            let unit: f64 = format!("1e{power}").parse().unwrap_or(f64::NAN);
            digits.iter().map(move |d| d * unit)
        });
        values.filter(|v| (lo..=hi).contains(v)).collect()
    };
    const EVERY: [f64; 9] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
    match (hi / lo).log10() {
        d if d < 1.2 => (at(&[1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0], 1), at(&EVERY, 1)),
        d if d < 3.0 => (at(&[1.0, 2.0, 5.0], 1), at(&EVERY, 1)),
        d if d < 7.0 => (at(&[1.0], 1), at(&EVERY, 1)),
        d => (at(&[1.0], (d / 8.0).ceil() as i32), at(&[1.0], 1)),
    }
}

/// Formats a value at an axis, as a power of ten if it is far from 1.
fn label(v: f64) -> String {
    match (0.01..10_000.0).contains(&v) {
        true => format!("{}", (v * 1e4).round() / 1e4),
        false => format!("{v:.0e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_short() {
        assert_eq!(
            [0.01, 0.1, 3.0, 1000.0, 1e-16, 2e5].map(label),
            ["0.01", "0.1", "3", "1000", "1e-16", "2e5"]
        );
    }

    #[test]
    fn axes_have_a_few_round_labels() {
        assert_eq!(ticks(1.4, 8.5).0, [1.5, 2.0, 3.0, 4.0, 6.0, 8.0]);
        assert_eq!(ticks(0.03, 3.0).0, [0.05, 0.1, 0.2, 0.5, 1.0, 2.0]);
        for (lo, hi) in [(1e-17, 2.0), (0.5, 1e5), (3.0, 4.5), (1e-300, 1e300)] {
            let (bold, light) = ticks(lo, hi);
            assert!((1..=10).contains(&bold.len()), "{lo} {hi}: {bold:?}");
            assert!(light.len() >= bold.len());
        }
    }
}
