//! Axis-aligned boxes, alone and eight at a time.

/// Boxes in one [`BoxGroup`], and children of one tree node.
pub(crate) const LANES: usize = 8;

/// An axis-aligned box in single precision, closed; it always contains what it bounds (values are rounded
/// outward where they are no single-precision numbers).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Box3 {
    /// Smallest coordinates.
    pub lo: [f32; 3],
    /// Largest coordinates.
    pub hi: [f32; 3],
}

impl Box3 {
    /// The box of nothing: overlaps no box.
    pub const EMPTY: Box3 = Box3 {
        lo: [f32::INFINITY; 3],
        hi: [f32::NEG_INFINITY; 3],
    };

    /// Whether the closed boxes share a point.
    pub fn overlaps(&self, other: &Box3) -> bool {
        (0..3).all(|x| self.lo[x] <= other.hi[x] && other.lo[x] <= self.hi[x])
    }

    /// A box around a point and everything within `slack` of it along an axis.
    pub fn around(p: [f64; 3], slack: f64) -> Box3 {
        Box3 {
            lo: p.map(|x| below(x - slack)),
            hi: p.map(|x| above(x + slack)),
        }
    }

    /// The box and everything within `reach` of it along an axis, up to the ends of the range; the empty box stays
    /// empty.
    pub fn dilated(&self, reach: f32) -> Box3 {
        // As in `below`: a box without bounds would overlap the empty one.
        let reach = reach.min(f32::MAX);
        Box3 {
            lo: self.lo.map(|x| (x - reach).max(f32::MIN)),
            hi: self.hi.map(|x| (x + reach).min(f32::MAX)),
        }
    }

    /// The box around both.
    pub fn union(&self, other: &Box3) -> Box3 {
        Box3 {
            lo: [0, 1, 2].map(|x| smaller(self.lo[x], other.lo[x])),
            hi: [0, 1, 2].map(|x| larger(self.hi[x], other.hi[x])),
        }
    }

    /// The largest distance that a bound has from that of another box, along an axis.
    pub fn largest_shift(&self, other: &Box3) -> f32 {
        let shift = |x: usize| {
            let (lo, hi) = (self.lo[x] - other.lo[x], self.hi[x] - other.hi[x]);
            lo.abs().max(hi.abs())
        };
        shift(0).max(shift(1)).max(shift(2))
    }

    /// How far one of two boxes must move along an axis to overlap the other no more.
    pub fn overlap_depth(&self, other: &Box3) -> f32 {
        let depth = |x: usize| (self.hi[x] - other.lo[x]).min(other.hi[x] - self.lo[x]);
        depth(0).min(depth(1)).min(depth(2)).max(0.0)
    }

    /// Returns true if the box contains no point.
    fn is_empty(&self) -> bool {
        self.lo[0] > self.hi[0]
    }

    /// Square of the distance between the boxes, a lower bound (rounded down generously) for what is in them.
    pub(crate) fn dist_sq_below(&self, other: &Box3) -> f64 {
        // If the other box is infinite in all directions, the differences below are NaN.
        if self.is_empty() || other.is_empty() {
            return f64::INFINITY;
        }
        let mut sum = 0.0;
        for x in 0..3 {
            let gap = f64::from(self.lo[x]) - f64::from(other.hi[x]);
            let gap = gap
                .max(f64::from(other.lo[x]) - f64::from(self.hi[x]))
                .max(0.0);
            sum += gap * gap;
        }
        sum * (1.0 - 1e-12)
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
    /// Eight boxes of nothing.
    pub const EMPTY: BoxGroup = BoxGroup {
        lo: [[f32::INFINITY; LANES]; 3],
        hi: [[f32::NEG_INFINITY; LANES]; 3],
    };

    /// The box of one lane.
    #[inline(always)]
    pub fn lane(&self, i: usize) -> Box3 {
        Box3 {
            lo: [0, 1, 2].map(|x| self.lo[x][i]),
            hi: [0, 1, 2].map(|x| self.hi[x][i]),
        }
    }

    /// In every lane the box around the boxes of both groups.
    #[inline(always)]
    pub fn union(&self, other: &BoxGroup) -> BoxGroup {
        let mut out = BoxGroup::EMPTY;
        for x in 0..3 {
            for k in 0..LANES {
                out.lo[x][k] = smaller(self.lo[x][k], other.lo[x][k]);
                out.hi[x][k] = larger(self.hi[x][k], other.hi[x][k]);
            }
        }
        out
    }

    /// Empties the lanes from `count` on.
    #[inline(always)]
    pub fn clear_from(&mut self, count: usize) {
        for x in 0..3 {
            self.lo[x][count..].fill(f32::INFINITY);
            self.hi[x][count..].fill(f32::NEG_INFINITY);
        }
    }

    /// The box around all eight.
    #[inline(always)]
    pub fn bounds(&self) -> Box3 {
        let fold = |v: &[f32; LANES], pick: fn(f32, f32) -> f32| {
            let four = [0, 1, 2, 3].map(|i| pick(v[i], v[i + 4]));
            pick(pick(four[0], four[1]), pick(four[2], four[3]))
        };
        Box3 {
            lo: [0, 1, 2].map(|x| fold(&self.lo[x], smaller)),
            hi: [0, 1, 2].map(|x| fold(&self.hi[x], larger)),
        }
    }
}

/// The smaller of two numbers, neither of which is NaN (one instruction, unlike `f32::min`).
#[inline(always)]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger of two numbers, neither of which is NaN.
#[inline(always)]
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// A finite single-precision number at or below `x`, or the least one where there is none.
///
/// The nearest single is off by at most `2^-24 |x|` (or `2^-150` where it is subnormal); twice that is taken off
/// first, and the rounding of the subtraction in double precision is far below the difference.
///
/// Numbers beyond the range of singles saturate: boxes are only ever compared, and clamping is monotone, so no
/// overlap is lost. Infinite bounds are kept for empty boxes alone.
#[inline(always)]
pub(crate) fn below(x: f64) -> f32 {
    ((x - x.abs() * OUTWARD - TINY) as f32).clamp(f32::MIN, f32::MAX)
}

/// A finite single-precision number at or above `x`, likewise.
#[inline(always)]
pub(crate) fn above(x: f64) -> f32 {
    ((x + x.abs() * OUTWARD + TINY) as f32).clamp(f32::MIN, f32::MAX)
}

/// `2^-23`.
const OUTWARD: f64 = f32::EPSILON as f64;

/// `2^-149`, the smallest single.
const TINY: f64 = f64::from_bits((1023 - 149) << 52);

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
        // Infinite bounds would make a box overlap the empty one.
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

    /// A sweep over boxes without bounds read past its end.
    #[test]
    fn a_box_that_grows_ends_at_the_range_and_the_empty_one_stays_empty() {
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
