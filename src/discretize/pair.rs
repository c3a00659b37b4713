//! Discretization of one pair of curves, only near each other.

use super::MAX_LEVEL;
use super::halving::{GRAZING, Halving, Subdivided};
use super::hulls::{Hull, separation_margin};
use crate::curve::{Bezier, CurveSet, Hulls, Parts};
use std::ops::Range;

/// Maximum number of pairs of pieces of two moving curves that may meet: a constant, and a number
/// per pair of segments. If there are more, no segments of the two curves are halved further.
const MAX_MOVING: [usize; 2] = [1 << 12, 2];

/// Fewest halvings of moving segments that may meet. With fewer, passages that cancel may be
/// missed.
const FEWEST_ROUNDS: u32 = 4;

// Segments that run along one another are halved as often, too.
const _: () = assert!(4usize.pow(FEWEST_ROUNDS - 1) <= GRAZING);

/// Separation test for the hulls of two segments. If there are two frames, the control points move
/// from one to the other, on straight lines at constant speed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Separation<'a, const N: usize = 1> {
    sets: [&'a CurveSet; N],
    frames: [Hulls<'a>; N],
    curves: [usize; 2],
    /// Covers rounding errors of the coordinates of all frames and of their heights along an axis
    /// ([`separation_margin`]).
    pub margin: f64,
}

/// Separation test for two moving segments.
pub(crate) type MovingSeparation<'a> = Separation<'a, 2>;

impl<'a, const N: usize> Separation<'a, N> {
    pub fn new(sets: [&'a CurveSet; N], curves: [usize; 2]) -> Self {
        let margins = sets.map(|set| separation_margin(set.max_abs(), set.pad()));
        Separation {
            sets,
            frames: sets.map(CurveSet::hulls),
            curves,
            margin: margins.into_iter().fold(0.0, f64::max),
        }
    }

    /// Returns true if the hulls of two segments are proven apart at all times. This holds for all
    /// pieces of the segments, too.
    #[inline(always)]
    pub fn apart(&self, s: u32, t: u32) -> bool {
        let [first, second] = [self.hulls(0, s), self.hulls(1, t)];
        let frames: [_; N] = std::array::from_fn(|k| [&first[k], &second[k]]);
        Hull::separated_throughout(frames, self.margin)
    }

    /// Returns the hulls of a segment of the first or of the second curve in all frames.
    #[inline(always)]
    fn hulls(&self, side: usize, s: u32) -> [Hull; N] {
        let i = self.curves[side];
        self.frames.map(|frame| Hull::new(frame.at(i, s as usize)))
    }
}

impl Separation<'_> {
    /// Adds the segment pairs whose hulls are not proven apart to `close`.
    #[inline(always)]
    pub fn add_close(&self, pairs: &[(u32, u32)], close: &mut Vec<(u32, u32)>) {
        for &(s, t) in pairs {
            if !self.apart(s, t) {
                close.push((s, t));
            }
        }
    }

    /// Splits segments until no hulls of two pieces meet. Returns two segments if they stay too
    /// close.
    ///
    /// `close` lists all segment pairs whose hulls meet. Every piece of a split segment is a part
    /// of the final polyline of the pair, so candidates must be evaluated after this.
    pub fn refine(&self, close: &[(u32, u32)], halving: &mut Halving) -> Result<(), [u32; 2]> {
        let volume = |[piece]: &[Bezier; 1], _| Hull::of_piece(piece);
        let apart = |a: &Hull, b: &Hull| a.separated(b, self.margin);
        let subdivided = Subdivided {
            frames: self.sets,
            curves: self.curves,
            most_rounds: MAX_LEVEL,
            most_overlaps: None,
        };
        halving.halve(subdivided, close, volume, apart)
    }
}

impl MovingSeparation<'_> {
    /// Splits segments where they may meet at some time, until their pieces are proven apart at all
    /// times or were halved `rounds` times. Pieces of one curve that are joined count as apart if
    /// the curve is monotonic along them ([`Self::add_turns`]).
    ///
    /// `near` lists all segment pairs that may meet, sorted. Segments that run along one another
    /// are not halved further, nor any if more than [`MAX_MOVING`] pieces may meet. Returns true if
    /// all segments whose pieces may still meet were halved [`FEWEST_ROUNDS`] times or more.
    pub fn refine(
        &self,
        near: &[(u32, u32)],
        parts: Option<Parts>,
        rounds: u32,
        halving: &mut Halving,
    ) -> bool {
        type Piece = ([f64; 2], [Hull; 2]);
        let volume = |frames: &[Bezier; 2], ends| (ends, frames.each_ref().map(Hull::of_piece));
        let apart = |(ends, p): &Piece, (other_ends, q): &Piece| {
            if let Some(parts) = parts {
                if parts.is_self() && other_ends[0] < ends[0] {
                    return true; // The same pieces in the other order.
                }
                if parts.is_self() && ends == other_ends || parts.joined(*ends, *other_ends) {
                    return Hull::are_monotonic(&[[p[0], q[0]], [p[1], q[1]]], self.margin);
                }
            }
            Hull::separated_throughout([[&p[0], &q[0]], [&p[1], &q[1]]], self.margin)
        };
        let subdivided = Subdivided {
            frames: self.sets,
            curves: self.curves,
            most_rounds: rounds,
            most_overlaps: Some(MAX_MOVING[0] + MAX_MOVING[1] * near.len()),
        };
        let apart = halving.halve(subdivided, near, volume, apart);
        apart.is_ok() || halving.rounds >= FEWEST_ROUNDS
    }

    /// Returns true if two consecutive segments, one of each curve, are not proven monotonic
    /// together at all times ([`MovingSeparation::add_turns`]).
    pub fn may_turn(&self, s: u32, t: u32) -> bool {
        let [first, second] = [self.hulls(0, s), self.hulls(1, t)];
        let frames = [[first[0], second[0]], [first[1], second[1]]];
        !Hull::are_monotonic(&frames, self.margin)
    }

    /// Adds the pairs of segments of the first curve with themselves and with their successors
    /// along which the curve is not proven monotonic at all times. If it is monotonic, neither
    /// segment meets itself or the other one, except at their joint. `after` is the segment after
    /// the last one of the range, or the last one itself if the curve ends there.
    #[inline(always)]
    pub fn add_turns(&self, segments: Range<u32>, after: u32, near: &mut Vec<(u32, u32)>) {
        let [mut before_s, mut after_s] = self.hulls(0, segments.start);
        for s in segments.clone() {
            let next = if s + 1 < segments.end { s + 1 } else { after };
            let [before_t, after_t] = self.hulls(0, next);
            let frames = [[before_s, before_t], [after_s, after_t]];
            if !Hull::are_monotonic(&frames, self.margin) {
                near.push((s, s));
                if s != next {
                    near.push((s.min(next), s.max(next)));
                }
            }
            [before_s, after_s] = [before_t, after_t];
        }
    }
}
