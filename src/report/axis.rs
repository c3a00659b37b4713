//! The horizontal axis of the timeline and of the plots: the frames in order, with their numbers
//! and simulation times.

use super::series::Bin;
use crate::curve::significant;
use crate::picture::svg::px;
use maud::{Markup, html};

/// Width of a picture with a time axis, and its margins.
pub(super) const WIDTH: f64 = 1000.0;
pub(super) const LEFT: f64 = 72.0;
pub(super) const RIGHT: f64 = WIDTH - 14.0;

/// Maximum number of labels.
const LABELS: usize = 10;

/// Positions of bins.
pub(super) struct Axis<'a> {
    bins: &'a [Bin],
    /// Width of a bin.
    pub step: f64,
}

impl<'a> Axis<'a> {
    pub fn of(bins: &'a [Bin]) -> Axis<'a> {
        let step = (RIGHT - LEFT) / bins.len().max(1) as f64;
        Axis { bins, step }
    }

    /// Returns the left end of a bin, or the end of the last one, if `bin` is their number.
    pub fn x(&self, bin: usize) -> f64 {
        LEFT + self.step * bin as f64
    }

    /// Returns the middle of a bin.
    pub fn middle(&self, bin: usize) -> f64 {
        self.x(bin) + 0.5 * self.step
    }

    /// Draws ticks below `y`, with the number of the first frame of a bin, and its time.
    pub fn draw(&self, y: f64) -> Markup {
        let bins = self.bins.iter().enumerate();
        let bins = bins.step_by(round_above(self.bins.len().div_ceil(LABELS)));
        let timed = self.bins.iter().any(|b| b.first.time != 0.0);
        let [tick, frame, time] = [y, y + 17.0, y + 30.0].map(px);
        html! {
            @for (k, bin) in bins {
                @let x = px(self.middle(k));
                path.x d={"M" (x) " " (tick) "v5"} {}
                text.t.c x=(x) y=(frame) { (bin.first.frame) }
                @if timed {
                    text.t.c.d x=(x) y=(time) {
                        (significant((bin.first.time * 1e6).round() / 1e6)) " s"
                    }
                }
            }
            text.t.d x="0" y=(frame) { "frame" }
            @if timed { text.t.d x="0" y=(time) { "time" } }
        }
    }
}

/// Returns the smallest of 1, 2 and 5 times a power of ten that is at least `n`.
fn round_above(n: usize) -> usize {
    let powers = std::iter::successors(Some(1), |power| Some(10 * power));
    let mut steps = powers.flat_map(|power| [power, 2 * power, 5 * power]);
    steps.find(|step| *step >= n).expect("steps grow")
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
