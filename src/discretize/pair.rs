//! Discretization of one pair of curves, only where they come near one another.

use super::halving::{Splits, halve};
use super::hulls::{separated, separation_margin};
use crate::curve::{Bezier, CurveSet};

/// Splits segments of the curves `i` and `j` until no two pieces' hulls meet.
///
/// `overlaps` lists all segment pairs whose boxes meet in space; all others are apart already. Every piece of
/// a split segment takes part in the final polyline of the pair, so candidates are evaluated only after this.
/// On `Err`, the two segments that stay too close.
pub(crate) fn refine_pair(
    set: &CurveSet,
    curves: [usize; 2],
    overlaps: &[(u32, u32)],
    splits: &mut [Splits; 2],
) -> Result<(), [u32; 2]> {
    let margin = separation_margin(set.max_abs(), set.pad());
    let apart = |a: &Bezier, b: &Bezier| separated(a, b, margin);
    match halve(set, curves, overlaps, splits, |b| b, apart).too_close {
        None => Ok(()),
        Some(segments) => Err(segments),
    }
}
