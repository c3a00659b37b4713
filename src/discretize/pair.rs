//! Discretization of one pair of curves, only where they come near one another.

use super::halving::Halving;
use super::hulls::{Hull, separation_margin};
use crate::curve::CurveSet;
use std::ops::Range;

/// Are the hulls of two segments apart?
#[derive(Clone, Copy, Debug)]
pub(crate) struct Separation<'a> {
    set: &'a CurveSet,
    curves: [usize; 2],
    margin: f64,
}

impl<'a> Separation<'a> {
    pub fn new(set: &'a CurveSet, curves: [usize; 2]) -> Self {
        Separation {
            set,
            curves,
            margin: separation_margin(set.max_abs(), set.pad()),
        }
    }

    /// Keeps the segment pairs whose hulls are not known to be apart, and adds them to `close`.
    #[inline(always)]
    pub fn add_close(&self, pairs: &[(u32, u32)], close: &mut Vec<(u32, u32)>) {
        for &(s, t) in pairs {
            let [a, b] = [(self.curves[0], s), (self.curves[1], t)].map(|(i, s)| Hull {
                points: self.set.hull(i, s as usize),
            });
            if !a.separated(&b, self.margin) {
                close.push((s, t));
            }
        }
    }

    /// Splits segments until no two pieces' hulls meet.
    ///
    /// `close` lists all segment pairs whose hulls meet. Every piece of a split segment takes part in the final
    /// polyline of the pair, so candidates are evaluated only after this. On `Err`, the two segments that stay too
    /// close.
    pub fn refine(&self, close: &[(u32, u32)], halving: &mut Halving) -> Result<(), [u32; 2]> {
        let apart = |a: &Hull, b: &Hull| a.separated(b, self.margin);
        halving
            .halve(self.set, self.curves, close, Hull::of_piece, apart)
            .map(drop)
    }
}

/// Can two segments meet while their control points move from one frame to another, on straight lines at constant
/// speed?
#[derive(Clone, Copy, Debug)]
pub(crate) struct MovingSeparation<'a> {
    frames: [&'a CurveSet; 2],
    curves: [usize; 2],
    margin: f64,
}

impl<'a> MovingSeparation<'a> {
    pub fn new(frames: [&'a CurveSet; 2], curves: [usize; 2]) -> Self {
        let [m, n] = frames.map(|set| separation_margin(set.max_abs(), set.pad()));
        MovingSeparation {
            frames,
            curves,
            margin: m.max(n),
        }
    }

    /// Whether the hulls of two segments are apart at all times, and so are all pieces of them.
    #[inline(always)]
    pub fn apart(&self, s: u32, t: u32) -> bool {
        let [first, second] = [self.hulls(self.curves[0], s), self.hulls(self.curves[1], t)];
        let frames = [[&first[0], &second[0]], [&first[1], &second[1]]];
        Hull::separated_throughout(frames, self.margin)
    }

    /// Adds those of the segments of the first curve, with themselves and with the next ones, along which it is not
    /// known to run one way at all times: where it does, neither of them meets itself or the other, but where they are
    /// joined. `after` comes after the last one, and is the last one where the curve ends.
    #[inline(always)]
    pub fn add_turns(&self, segments: Range<u32>, after: u32, near: &mut Vec<(u32, u32)>) {
        let i = self.curves[0];
        let [mut before_s, mut after_s] = self.hulls(i, segments.start);
        for s in segments.clone() {
            let next = if s + 1 < segments.end { s + 1 } else { after };
            let [before_t, after_t] = self.hulls(i, next);
            let frames = [[before_s, before_t], [after_s, after_t]];
            if !Hull::run_one_way(&frames, self.margin) {
                near.push((s, s));
                if s != next {
                    near.push((s.min(next), s.max(next)));
                }
            }
            [before_s, after_s] = [before_t, after_t];
        }
    }

    /// The hull of a segment in both frames.
    #[inline(always)]
    fn hulls(&self, i: usize, s: u32) -> [Hull; 2] {
        let [before, after] = self.frames;
        let points = [before.hull(i, s as usize), after.hull(i, s as usize)];
        points.map(|points| Hull { points })
    }
}
