//! Curves by their arc length.
//!
//! Lengths are measured along chords, so that places at equal distances are equal up to the
//! difference of a chord and its arc. Cost: a table of 16 lengths per spline segment.

use crate::curve::vector::{hypot, mix, sub};
use crate::curve::{Basis, CurveSet, Point};
use crate::error::{Error, Result};

/// Number of chords of a spline segment.
const CHORDS: usize = 16;

/// A curve by its arc length.
pub(super) struct Along<'a> {
    set: &'a CurveSet,
    curve: usize,
    /// Number of chords of a segment.
    chords: usize,
    /// Length up to each chord; the last one is that of the whole curve.
    lengths: Vec<f64>,
}

impl<'a> Along<'a> {
    pub fn of(set: &'a CurveSet, curve: usize) -> Result<Along<'a>> {
        let chords = if set.basis().is_polyline() { 1 } else { CHORDS };
        let segments = set.curve(curve).segments as usize;
        let mut lengths = Vec::with_capacity(segments * chords + 1);
        let (mut sum, mut last) = (0.0, set.knot(curve, 0));
        lengths.push(sum);
        for s in 0..segments {
            for k in 1..=chords {
                let p = match k == chords {
                    true => set.knot(curve, s + 1),
                    false => set.eval(curve, s, k as f64 / chords as f64),
                };
                sum += hypot(sub(p, last));
                lengths.push(sum);
                last = p;
            }
        }
        if !sum.is_finite() {
            let what = format!(
                "the length of curve {curve} is not finite: its coordinates are too \
                                large to resample it"
            );
            return Err(Error::Usage(what));
        }
        Ok(Along {
            set,
            curve,
            chords,
            lengths,
        })
    }

    pub fn basis(&self) -> Basis {
        self.set.basis()
    }

    pub fn is_closed(&self) -> bool {
        self.set.curve(self.curve).closed
    }

    pub fn segments(&self) -> usize {
        self.set.curve(self.curve).segments as usize
    }

    /// Returns the length up to the start of segment `s`.
    pub fn start(&self, s: usize) -> f64 {
        self.lengths[s * self.chords]
    }

    pub fn length(&self) -> f64 {
        self.lengths[self.lengths.len() - 1]
    }

    /// Returns the segment and the parameter at a length.
    pub fn at(&self, length: f64) -> (usize, f64) {
        let last = self.lengths.len() - 2;
        let after = self.lengths.partition_point(|l| *l <= length);
        let chord = after.saturating_sub(1).min(last);
        let (from, to) = (self.lengths[chord], self.lengths[chord + 1]);
        let share = match to > from {
            true => ((length - from) / (to - from)).clamp(0.0, 1.0),
            false => 0.0,
        };
        let t = ((chord % self.chords) as f64 + share) / self.chords as f64;
        (chord / self.chords, t)
    }

    pub fn point(&self, (s, t): (usize, f64)) -> Point {
        match self.set.basis().is_polyline() {
            true => mix(
                self.set.knot(self.curve, s),
                self.set.knot(self.curve, s + 1),
                t,
            ),
            false if t == 0.0 => self.set.knot(self.curve, s),
            false if t == 1.0 => self.set.knot(self.curve, s + 1),
            false => self.set.eval(self.curve, s, t),
        }
    }

    /// Returns the unit tangent of a spline; 0 if it has none.
    pub fn tangent(&self, (s, t): (usize, f64)) -> Point {
        let b = self.set.segment(self.curve, s);
        let d = [0, 1, 2].map(|k| sub(b[k + 1], b[k]));
        let along = mix(mix(d[0], d[1], t), mix(d[1], d[2], t), t);
        let length = hypot(along);
        match length > 0.0 {
            true => along.map(|x| x / length),
            false => [0.0; 3],
        }
    }
}
