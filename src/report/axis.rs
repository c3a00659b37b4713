//! The horizontal axis of the timeline and of the plots: the frames in order, with their numbers
//! and simulation times.

use super::series::Series;
use super::svg::px;
use crate::curve::significant;

/// Width of a picture with a time axis, and its margins.
pub(super) const WIDTH: f64 = 1000.0;
const LEFT: f64 = 72.0;
const RIGHT: f64 = 14.0;

/// Maximum number of labels.
const LABELS: usize = 10;

/// Positions of bins.
pub(super) struct Axis<'a> {
    series: &'a Series,
    /// Width of a bin.
    pub step: f64,
}

impl<'a> Axis<'a> {
    pub fn of(series: &'a Series) -> Axis<'a> {
        let bins = series.bins.len().max(1);
        Axis {
            series,
            step: (WIDTH - LEFT - RIGHT) / bins as f64,
        }
    }

    /// Returns the left end of a bin, or the end of the last one, if `bin` is their number.
    pub fn x(&self, bin: usize) -> f64 {
        LEFT + self.step * bin as f64
    }

    /// Returns the middle of a bin.
    pub fn middle(&self, bin: usize) -> f64 {
        self.x(bin) + 0.5 * self.step
    }

    /// Returns the left and the right end of the axis.
    pub fn ends(&self) -> [f64; 2] {
        [LEFT, WIDTH - RIGHT]
    }

    /// Draws ticks below `y`, with the number of the first frame of a bin, and its time.
    pub fn draw(&self, y: f64, out: &mut String) {
        let bins = &self.series.bins;
        let step = round_above(bins.len().div_ceil(LABELS));
        let timed = bins.iter().any(|b| b.first.time != 0.0);
        for (k, bin) in bins.iter().enumerate().step_by(step) {
            let x = px(self.middle(k));
            *out += &format!(
                "<path class=\"x\" d=\"M{x} {}v5\"/><text class=\"t c\" x=\"{x}\" y=\"{}\">{}\
                 </text>\n",
                px(y),
                px(y + 17.0),
                bin.first.frame
            );
            if timed {
                *out += &format!(
                    "<text class=\"t c d\" x=\"{x}\" y=\"{}\">{} s</text>\n",
                    px(y + 30.0),
                    significant((bin.first.time * 1e6).round() / 1e6)
                );
            }
        }
        *out += &format!(
            "<text class=\"t d\" x=\"0\" y=\"{}\">frame</text>\n",
            px(y + 17.0)
        );
        if timed {
            *out += &format!(
                "<text class=\"t d\" x=\"0\" y=\"{}\">time</text>\n",
                px(y + 30.0)
            );
        }
    }
}

/// Returns the smallest of 1, 2 and 5 times a power of ten that is at least `n`.
fn round_above(n: usize) -> usize {
    let mut power = 1;
    loop {
        if let Some(step) = [1, 2, 5].map(|k| k * power).into_iter().find(|s| *s >= n) {
            return step;
        }
        power *= 10;
    }
}

#[cfg(test)]
mod tests {
    use super::round_above;

    #[test]
    fn steps_of_labels_are_round() {
        for (n, expected) in [(0, 1), (1, 1), (2, 2), (3, 5), (6, 10), (11, 20), (40, 50)] {
            assert_eq!(round_above(n), expected);
        }
    }
}
