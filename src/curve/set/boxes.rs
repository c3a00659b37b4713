//! Axis-aligned boxes, single and in groups of eight.

use super::vector::{dot, per_axis};
use super::{Point, pow2};
use crate::simd::LANES;

/// A closed axis-aligned box in single precision. Values that are not representable are rounded
/// outward, so a box always contains what it bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Box3 {
    /// Smallest coordinates.
    pub lo: [f32; 3],
    /// Largest coordinates.
    pub hi: [f32; 3],
}

impl Box3 {
    /// The empty box: overlaps no box.
    pub const EMPTY: Box3 = Box3 {
        lo: [f32::INFINITY; 3],
        hi: [f32::NEG_INFINITY; 3],
    };

    /// Returns the box of some bounds, rounded outward. It is finite.
    pub fn around([lo, hi]: [Point; 2]) -> Box3 {
        Box3 {
            lo: lo.map(below),
            hi: hi.map(above),
        }
    }

    /// Returns true if the closed boxes share a point.
    pub fn overlaps(&self, other: &Box3) -> bool {
        (0..3).all(|x| self.lo[x] <= other.hi[x] && other.lo[x] <= self.hi[x])
    }

    /// Returns the box grown by `reach` on all sides, up to the range of single precision. The
    /// empty box stays empty.
    pub fn dilated(&self, reach: f32) -> Box3 {
        // As in `below`: a box with infinite bounds would overlap the empty box.
        let reach = reach.min(f32::MAX);
        Box3 {
            lo: self.lo.map(|x| (x - reach).max(f32::MIN)),
            hi: self.hi.map(|x| (x + reach).min(f32::MAX)),
        }
    }

    /// Returns the smallest box that contains both boxes.
    pub fn union(&self, other: &Box3) -> Box3 {
        Box3 {
            lo: per_axis(|x| smaller(self.lo[x], other.lo[x])),
            hi: per_axis(|x| larger(self.hi[x], other.hi[x])),
        }
    }

    /// Returns the largest difference between a bound of this box and the same bound of another
    /// one, over all axes.
    pub fn largest_shift(&self, other: &Box3) -> f32 {
        let shift = |x: usize| {
            let (lo, hi) = (self.lo[x] - other.lo[x], self.hi[x] - other.hi[x]);
            lo.abs().max(hi.abs())
        };
        shift(0).max(shift(1)).max(shift(2))
    }

    /// Returns the smallest translation along an axis after which the boxes no longer overlap, or 0
    /// if they do not overlap.
    pub fn overlap_depth(&self, other: &Box3) -> f32 {
        let depth = |x: usize| (self.hi[x] - other.lo[x]).min(other.hi[x] - self.lo[x]);
        depth(0).min(depth(1)).min(depth(2)).max(0.0)
    }

    /// Returns true if the box contains no point.
    fn is_empty(&self) -> bool {
        self.lo[0] > self.hi[0]
    }

    /// Returns a lower bound of the squared distance between the boxes (rounded down generously).
    pub(crate) fn dist_sq_below(&self, other: &Box3) -> f64 {
        // If the other box is infinite in all directions, the differences below are NaN.
        if self.is_empty() || other.is_empty() {
            return f64::INFINITY;
        }
        let wide = |p: &[f32; 3], x: usize| f64::from(p[x]);
        let gap = |a: &Box3, b: &Box3, x: usize| wide(&a.lo, x) - wide(&b.hi, x);
        let gap = per_axis(|x| gap(self, other, x).max(gap(other, self, x)).max(0.0));
        dot(gap, gap) * (1.0 - 1e-12)
    }
}

/// Eight boxes, structure of arrays: `lo[axis][lane]`.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct BoxGroup {
    pub lo: [[f32; LANES]; 3],
    pub hi: [[f32; LANES]; 3],
}

impl BoxGroup {
    /// Eight empty boxes.
    pub const EMPTY: BoxGroup = BoxGroup {
        lo: [[f32::INFINITY; LANES]; 3],
        hi: [[f32::NEG_INFINITY; LANES]; 3],
    };

    /// Returns the box in a lane.
    #[inline(always)]
    pub fn lane(&self, i: usize) -> Box3 {
        Box3 {
            lo: per_axis(|x| self.lo[x][i]),
            hi: per_axis(|x| self.hi[x][i]),
        }
    }

    /// Makes the boxes of all lanes from `count` on empty.
    #[inline(always)]
    pub fn clear_from(&mut self, count: usize) {
        for x in 0..3 {
            self.lo[x][count..].fill(f32::INFINITY);
            self.hi[x][count..].fill(f32::NEG_INFINITY);
        }
    }

    /// Returns the smallest box that contains all eight.
    #[inline(always)]
    pub fn bounds(&self) -> Box3 {
        #[inline(always)]
        fn fold(v: &[f32; LANES], pick: impl Fn(f32, f32) -> f32) -> f32 {
            let two = |i: usize| pick(v[i], v[i + 4]);
            pick(pick(two(0), two(1)), pick(two(2), two(3)))
        }
        Box3 {
            lo: per_axis(|x| fold(&self.lo[x], smaller)),
            hi: per_axis(|x| fold(&self.hi[x], larger)),
        }
    }
}

/// Returns the smaller of two numbers that are not NaN (one instruction, unlike `f32::min`).
#[inline(always)]
pub(crate) fn smaller<T: PartialOrd>(a: T, b: T) -> T {
    if a < b { a } else { b }
}

/// Returns the larger of two numbers that are not NaN.
#[inline(always)]
pub(crate) fn larger<T: PartialOrd>(a: T, b: T) -> T {
    if a > b { a } else { b }
}

/// Returns a finite single-precision number at or below `x`, or the smallest one if there is none.
///
/// The nearest single-precision number differs from `x` by at most `2^-24 |x|` (by `2^-150` if it
/// is subnormal). Twice that is subtracted first. The rounding error of this subtraction in double
/// precision is far below the difference.
///
/// Numbers beyond the range of single precision saturate. No overlap is lost by that, because boxes
/// are only ever compared, and clamping is monotone. Only empty boxes have infinite bounds.
#[inline(always)]
pub(crate) fn below(x: f64) -> f32 {
    ((x - x.abs() * OUTWARD - TINY) as f32).clamp(f32::MIN, f32::MAX)
}

/// Returns a finite single-precision number at or above `x`, or the largest one if there is none.
#[inline(always)]
pub(crate) fn above(x: f64) -> f32 {
    ((x + x.abs() * OUTWARD + TINY) as f32).clamp(f32::MIN, f32::MAX)
}

/// Relative outward rounding: `2^-23`.
const OUTWARD: f64 = f32::EPSILON as f64;

/// Absolute outward rounding: `2^-149`, the smallest single-precision number.
const TINY: f64 = pow2(-149);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_outward_and_saturates_at_the_ends_of_the_range() {
        let top = f64::from(f32::MAX);
        for x in [
            0.1,
            -0.1,
            1e-300,
            -1e-300,
            1e-40,
            -1e-45,
            0.0,
            1.0,
            0.999 * top,
            -0.999 * top,
        ] {
            assert!(f64::from(below(x)) <= x && x <= f64::from(above(x)), "{x}");
            let width = f64::from(above(x)) - f64::from(below(x));
            assert!(
                width <= 4.0 * f64::from(f32::EPSILON) * x.abs() + 1e-44,
                "{x}: {width}"
            );
        }
        // With infinite bounds, a box would overlap the empty one.
        for x in [top, 1.001 * top, 1e60, f64::MAX] {
            assert_eq!((above(x), below(-x)), (f32::MAX, f32::MIN));
            assert!(below(x).is_finite() && above(-x).is_finite());
        }
    }

    #[test]
    fn an_empty_box_overlaps_nothing() {
        let all = Box3 {
            lo: [f32::MIN; 3],
            hi: [f32::MAX; 3],
        };
        assert!(!Box3::EMPTY.overlaps(&all));
        assert!(!all.overlaps(&Box3::EMPTY));
        assert!(!Box3::EMPTY.overlaps(&Box3::EMPTY));
    }

    /// Regression: a sweep over boxes with infinite bounds read past its end.
    #[test]
    fn dilated_boxes_stay_finite_and_empty_boxes_stay_empty() {
        let all = Box3 {
            lo: [f32::MIN; 3],
            hi: [f32::MAX; 3],
        };
        for reach in [0.0, 1.0, f32::MAX, f32::INFINITY] {
            assert_eq!(all.dilated(reach), all);
            assert_eq!(Box3::EMPTY.dilated(reach), Box3::EMPTY);
        }
    }
}
