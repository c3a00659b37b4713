//! Plots with two logarithmic axes, as PNG and SVG. The font is embedded.

use crate::Result;
use plotters::coord::Shift;
use plotters::coord::combinators::{BindKeyPoints, LogCoord, WithKeyPoints};
use plotters::prelude::*;
use plotters::style::register_font;
use std::fs::File;
use std::io::{BufWriter, Error};
use std::path::Path;
use std::sync::Once;

/// A plot with two logarithmic axes.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Title above the plot.
    pub title: String,
    /// Quantity of the horizontal axis, with its unit.
    pub x: String,
    /// Quantity of the vertical axis, with its unit.
    pub y: String,
    /// Points and reference lines.
    pub series: Vec<Series>,
}

/// Points of one colour, all coordinates above 0.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// The points.
    pub points: Vec<(f64, f64)>,
    /// True for a dashed reference line.
    guide: bool,
}

impl Series {
    /// Creates a series of measured points, joined by a line.
    pub fn marks(name: String, points: Vec<(f64, f64)>) -> Series {
        Series {
            name,
            points,
            guide: false,
        }
    }

    /// Creates a dashed reference line.
    pub fn guide(name: String, points: Vec<(f64, f64)>) -> Series {
        Series {
            name,
            points,
            guide: true,
        }
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

impl Plot {
    /// Writes `PATH.png` and `PATH.svg`.
    ///
    /// Errors: a file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        static REGISTERED: Once = Once::new();
        REGISTERED.call_once(|| {
            let font = dejavu::sans::regular();
            if register_font(FONT, FontStyle::Normal, font).is_err() {
                unreachable!("the font is constant and valid");
            }
        });
        let svg = path.with_extension("svg");
        self.draw(&SVGBackend::new(&svg, SIZE).into_drawing_area())?;

        let (width, height) = SIZE;
        let mut pixels = vec![0; (3 * width * height) as usize];
        self.draw(&BitMapBackend::with_buffer(&mut pixels, SIZE).into_drawing_area())?;
        let file = BufWriter::new(File::create(path.with_extension("png"))?);
        let mut png = png::Encoder::new(file, width, height);
        png.set_color(png::ColorType::Rgb);
        let mut writer = png.write_header().map_err(Error::other)?;
        writer.write_image_data(&pixels).map_err(Error::other)?;
        Ok(writer.finish().map_err(Error::other)?)
    }

    fn draw<B: DrawingBackend>(&self, root: &DrawingArea<B, Shift>) -> Result<()> {
        // The error types of backends differ; all of them are failures to write.
        self.try_draw(root)
            .map_err(|e| Error::other(e.to_string()).into())
    }

    fn try_draw<B: DrawingBackend>(
        &self,
        root: &DrawingArea<B, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
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
            .x_desc(&self.x)
            .y_desc(&self.y)
            .x_label_formatter(&|&v| label(v))
            .y_label_formatter(&|&v| label(v))
            .draw()?;
        let mut colors = COLORS.iter().cycle();
        let mut guides = GUIDES.iter().cycle();
        for (k, series) in self.series.iter().enumerate() {
            let color = match series.guide {
                true => guides.next(),
                false => colors.next(),
            };
            let color = color.copied().unwrap_or(BLACK);
            let at = 60 + 34 * k as i32;
            let line = [(8, at), (52, at)];
            let points = series.points.iter().copied();
            if series.guide {
                chart.draw_series(DashedLineSeries::new(points, 9, 6, color.stroke_width(2)))?;
                for x in [8, 25, 42] {
                    let dash = [(x, at), (x + 10, at)];
                    right.draw(&PathElement::new(dash, color.stroke_width(2)))?;
                }
            } else {
                chart.draw_series(LineSeries::new(points.clone(), color.stroke_width(2)))?;
                chart.draw_series(points.map(|p| Circle::new(p, 6, color.filled())))?;
                if series.points.len() > 1 {
                    right.draw(&PathElement::new(line, color.stroke_width(2)))?;
                }
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
        let (lo, hi) = (
            values().fold(f64::INFINITY, f64::min),
            values().fold(0.0, f64::max),
        );
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
    let decades = (hi / lo).log10();
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
    match decades {
        d if d < 1.2 => (at(&[1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0], 1), at(&EVERY, 1)),
        d if d < 3.0 => (at(&[1.0, 2.0, 5.0], 1), at(&EVERY, 1)),
        d if d < 7.0 => (at(&[1.0], 1), at(&EVERY, 1)),
        d => (at(&[1.0], (d / 8.0).ceil() as i32), at(&[1.0], 1)),
    }
}

/// Formats a value at an axis, as a power of ten if it is far from 1.
fn label(v: f64) -> String {
    if (0.01..10_000.0).contains(&v) {
        return format!("{}", (v * 1e4).round() / 1e4);
    }
    let text = format!("{v:.0e}");
    let Some((digit, power)) = text.split_once('e') else {
        return text;
    };
    let raised = |c| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32(digit as u32 - '0' as u32 + '⁰' as u32).unwrap_or(digit),
    };
    let power: String = power.chars().map(raised).collect();
    match digit {
        "1" => format!("10{power}"),
        _ => format!("{digit}·10{power}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_contain_their_values_and_are_not_empty() {
        let of = |points: &[(f64, f64)]| Plot {
            title: String::new(),
            x: String::new(),
            y: String::new(),
            series: vec![Series::marks(String::new(), points.to_vec())],
        };
        let (lo, hi) = of(&[(1.0, 2.0), (8.0, 3.0)]).range(|p| p.0);
        assert!(lo < 1.0 && hi > 8.0);
        let (lo, hi) = of(&[(4.0, 2.0)]).range(|p| p.0);
        assert!(lo < 4.0 && hi > 4.0);
        assert_eq!(of(&[]).range(|p| p.0), (0.1, 10.0));
    }

    #[test]
    fn labels_are_short() {
        assert_eq!(
            [0.01, 0.1, 3.0, 1000.0, 1e-16, 2e5].map(label),
            ["0.01", "0.1", "3", "1000", "10⁻¹⁶", "2·10⁵"]
        );
    }
    #[test]
    fn axes_have_a_few_round_labels() {
        assert_eq!(ticks(1.4, 8.5).0, [1.5, 2.0, 3.0, 4.0, 6.0, 8.0]);
        assert_eq!(ticks(0.03, 3.0).0, [0.05, 0.1, 0.2, 0.5, 1.0, 2.0]);
        for (lo, hi) in [
            (1e-17, 2.0),
            (0.5, 1e5),
            (3.0, 4.5),
            (9e-5, 1.1e5),
            (1e-300, 1e300),
        ] {
            let (bold, light) = ticks(lo, hi);
            assert!((1..=10).contains(&bold.len()), "{lo} {hi}: {bold:?}");
            assert!(light.len() >= bold.len());
        }
    }
}
