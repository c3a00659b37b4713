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
