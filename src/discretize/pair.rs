//! Discretization of one pair of curves, only where they come near one another.

use super::halving::Halving;
use super::hulls::{Hull, separation_margin};
use crate::curve::CurveSet;

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
        let [before, after] = self.frames.map(|set| {
            [(self.curves[0], s), (self.curves[1], t)].map(|(i, s)| Hull {
                points: set.hull(i, s as usize),
            })
        });
        Hull::separated_throughout([before.each_ref(), after.each_ref()], self.margin)
    }

    /// Whether the first curve runs one way along segments `s` and `t`, which follow one another: neither meets itself
    /// or the other one, but where they are joined.
    #[inline(always)]
    pub fn one_way(&self, s: u32, t: u32) -> bool {
        let frames = self.frames.map(|set| {
            [s, t].map(|s| Hull {
                points: set.hull(self.curves[0], s as usize),
            })
        });
        Hull::run_one_way(&frames, self.margin)
    }
}
