//! Trend of the clearance over the last frames, and the number of frames until strands touch.

use std::collections::VecDeque;

/// Number of frames whose clearance is extrapolated.
const FRAMES: usize = 8;

/// Minimum number of frames for a trend.
const FEWEST: usize = 4;

/// Maximum number of frames until contact that is predicted.
const FURTHEST: f64 = 1000.0;

/// Numbers and clearances of the last frames.
#[derive(Debug, Default)]
pub(super) struct Trend {
    pub frames: VecDeque<(u64, f64)>,
}

impl Trend {
    /// Adds the clearance of a frame. Returns the predicted number of frames until the clearance is
    /// 1, by the least-squares line through the last frames; 0 if it is less than 1 already. `None`
    /// if the line does not decrease.
    pub fn frames_left(&mut self, seq: u64, ratio: Option<f64>) -> Option<f64> {
        let Some(ratio) = ratio else {
            self.frames.clear();
            return None;
        };
        // After a rollback of the simulation, the earlier frames do not belong to the trend.
        if self.frames.back().is_some_and(|&(last, _)| last >= seq) {
            self.frames.clear();
        }
        if self.frames.len() == FRAMES {
            self.frames.pop_front();
        }
        self.frames.push_back((seq, ratio));
        if self.frames.len() < FEWEST {
            return None;
        }
        let share = 1.0 / self.frames.len() as f64;
        let at = |s: u64| s as f64 - seq as f64;
        let mean: f64 = self.frames.iter().map(|&(s, _)| at(s) * share).sum();
        let height: f64 = self.frames.iter().map(|&(_, r)| r * share).sum();
        let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
            let frames = self.frames.iter();
            frames.map(|&(s, r)| f(at(s) - mean, r - height)).sum()
        };
        let slope = sum(&|s, r| s * r) / sum(&|s, _| s * s);
        let end = if ratio > 1.0 { 1.0 } else { 0.0 };
        let left = (ratio - end) / -slope;
        (slope < 0.0 && left <= FURTHEST).then_some(left)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_extrapolated_to_contact_and_then_to_the_center_lines() {
        let mut trend = Trend::default();
        let left: Vec<Option<f64>> = (0..8_u32)
            .map(|k| trend.frames_left(k.into(), Some(1.4 - 0.1 * f64::from(k))))
            .collect();
        assert_eq!(left[..3], [None; 3]);
        // 1.1, 0.9 and 0.7.
        for (k, expected) in [(3, 1.0), (5, 9.0), (7, 7.0)] {
            assert!((left[k].unwrap() - expected).abs() < 1e-9, "{left:?}");
        }
    }

    #[test]
    fn a_clearance_that_grows_or_rests_has_no_prediction() {
        for slope in [0.0, 0.01] {
            let mut trend = Trend::default();
            for k in 0..20_u32 {
                let ratio = 0.8 + slope * f64::from(k);
                assert_eq!(trend.frames_left(k.into(), Some(ratio)), None, "{slope}");
            }
        }
    }

    #[test]
    fn a_rollback_starts_a_new_trend() {
        let mut trend = Trend::default();
        for seq in [10, 11, 12, 13, 5, 6, 7] {
            trend.frames_left(seq, Some(1.0 - 0.01 * seq as f64));
        }
        assert_eq!(trend.frames.len(), 3);
    }
}
