//! Curves of a set that are parts of one curve: a curve and itself, or a yarn that runs through a
//! periodic cell and one of its later or earlier periods.

use super::{Curve, CurveSet, Image};

/// Two parts of one curve, each of which has all segments of a curve of the set.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Parts {
    curve: Curve,
    /// Number of periods from the first part to the second one. 0: a curve and itself.
    periods: i32,
}

impl Parts {
    /// Returns true if this is a curve and itself.
    pub fn is_self(&self) -> bool {
        self.periods == 0
    }

    /// Returns the number of segments from segment `s` of the first part to segment `t` of the
    /// second one, along the curve.
    fn steps(&self, s: u32, t: u32) -> i64 {
        i64::from(self.periods) * i64::from(self.curve.segments) + i64::from(t) - i64::from(s)
    }

    /// Returns true if two segments are equal or consecutive.
    #[inline]
    pub fn adjacent(&self, s: u32, t: u32) -> bool {
        match self.periods {
            0 => self.curve.adjacent(s, t),
            _ => self.steps(s, t).abs() <= 1,
        }
    }

    /// Returns true if two intervals, one of each part, share an end. Positions are in segments
    /// from the start of a part.
    pub fn joined(&self, first: [f64; 2], second: [f64; 2]) -> bool {
        let n = f64::from(self.curve.segments);
        let second = second.map(|at| f64::from(self.periods) * n + at);
        let gaps = [second[0] - first[1], first[0] - second[1]];
        let closed = self.is_self() && self.curve.closed;
        let joined = |gap: f64| gap == 0.0 || closed && gap == -n;
        gaps.into_iter().any(joined)
    }

    /// Returns true if segment `t` of the second part follows segment `s` of the first one with a
    /// single segment in between.
    pub fn follows_after_one(&self, s: u32, t: u32) -> bool {
        self.is_second(self.steps(s, t))
    }

    /// Returns true if segment `t` of the second part precedes segment `s` of the first one with a
    /// single segment in between.
    pub fn precedes_before_one(&self, s: u32, t: u32) -> bool {
        self.is_second(-self.steps(s, t))
    }

    fn is_second(&self, steps: i64) -> bool {
        steps == 2 || self.curve.closed && steps + i64::from(self.curve.segments) == 2
    }

    /// Returns true if the second part continues the first one, at the end of that.
    pub fn is_continued(&self) -> bool {
        self.periods == 1
    }

    /// Returns the segments at which the parts are joined, if one continues the other: of the first
    /// and of the second part.
    pub fn joint(&self) -> Option<[u32; 2]> {
        let last = self.curve.segments - 1;
        match self.periods {
            1 => Some([last, 0]),
            -1 => Some([0, last]),
            _ => None,
        }
    }
}

/// Returns how many times a translation is a period, if it is a multiple.
pub(crate) fn multiple(image: Image, period: Image) -> Option<i32> {
    let x = (0..3).find(|&x| period[x] != 0)?;
    let times = image[x] / period[x];
    (image == period.map(|n| n.wrapping_mul(times))).then_some(times)
}

impl CurveSet {
    /// Returns the relation of two curves if they are parts of one curve.
    pub(crate) fn parts(&self, i: usize, j: usize) -> Option<Parts> {
        let periods = match i == j {
            true => 0,
            false => self.translated()?.periods_between(i, j)?,
        };
        let curve = self.curve(i);
        Some(Parts { curve, periods })
    }

    /// Returns the pairs of curves of which the second one continues the first one, a yarn that
    /// runs through the cell.
    pub(crate) fn joints(&self) -> &[(u32, u32)] {
        self.translated().map_or(&[], |curves| &curves.joints)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions, Translated};
    use std::sync::Arc;

    #[test]
    fn only_multiples_of_a_period_are_parts_of_one_curve() {
        for (image, period, expected) in [
            ([2, 0, 0], [1, 0, 0], Some(2)),
            ([-3, 0, 0], [1, 0, 0], Some(-3)),
            ([2, -2, 4], [-1, 1, -2], Some(-2)),
            ([3, 0, 0], [2, 0, 0], None),
            ([0, 1, 0], [1, 0, 0], None),
            ([1, 1, 0], [1, 0, 0], None),
        ] {
            assert_eq!(multiple(image, period), expected, "{image:?} {period:?}");
        }
    }

    /// Segments are adjacent as in the curve of three periods in a row.
    #[test]
    fn segments_are_adjacent_as_in_the_infinite_curve() {
        for n in 1..5_u32 {
            let xyz: Vec<f64> = (0..3 * (n + 1)).map(f64::from).collect();
            let positions = Positions::F64(&xyz);
            let frame = CurveSet::from_counts(Basis::Polyline, &[n as i32 + 1], positions).unwrap();
            let period = [0, -1, 0];
            let curves: Vec<_> = (0..3).map(|k| (0, period.map(|p| k * p))).collect();
            let curves = Translated::new(curves, &Arc::from([Some(period)]));
            assert_eq!(&*curves.joints, [(0, 1)]);
            let (mut set, cell) = (None, "9,9,9".parse().unwrap());
            CurveSet::translate(&Arc::new(frame), &curves, &cell, &mut set).unwrap();
            let set = set.unwrap();
            for (i, j) in [(0, 0), (0, 1), (0, 2), (1, 0), (2, 1), (2, 0)] {
                let parts = set.parts(i, j).unwrap();
                for (s, t) in (0..n).flat_map(|s| (0..n).map(move |t| (s, t))) {
                    let [p, q] =
                        [(i, s), (j, t)].map(|(i, s)| i as i64 * i64::from(n) + i64::from(s));
                    assert_eq!(parts.adjacent(s, t), (p - q).abs() <= 1);
                    assert_eq!(parts.follows_after_one(s, t), q - p == 2);
                    assert_eq!(parts.precedes_before_one(s, t), p - q == 2);
                    let joined = (q - p).abs() == 1 && i != j;
                    assert_eq!(parts.joint() == Some([s, t]), joined);
                    let [a, b] = [s, t].map(|s| [0.0, 1.0].map(|end| f64::from(s) + end));
                    assert_eq!(parts.joined(a, b), (q - p).abs() == 1);
                    assert_eq!(parts.is_continued(), j == i + 1);
                }
            }
        }
    }
}
