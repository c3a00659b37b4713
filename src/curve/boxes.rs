//! Axis-aligned boxes, alone and eight at a time.

use super::Point;

/// Boxes in one [`BoxGroup`], and children of one tree node.
pub(crate) const LANES: usize = 8;

/// An axis-aligned box in single precision, closed; it always contains what it bounds (values are rounded
/// outward where they are no single-precision numbers).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box3 {
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

    /// Square of the distance between the boxes, a lower bound (rounded down generously) for what is in them.
    pub(crate) fn dist_sq_below(&self, other: &Box3) -> f64 {
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

    /// Centre, for messages.
    pub fn center(&self) -> Point {
        [0, 1, 2].map(|x| 0.5 * (f64::from(self.lo[x]) + f64::from(self.hi[x])))
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
    pub fn lane(&self, i: usize) -> Box3 {
        Box3 {
            lo: [0, 1, 2].map(|x| self.lo[x][i]),
            hi: [0, 1, 2].map(|x| self.hi[x][i]),
        }
    }

    /// Sets the box of one lane.
    pub fn set_lane(&mut self, i: usize, b: &Box3) {
        for x in 0..3 {
            self.lo[x][i] = b.lo[x];
            self.hi[x][i] = b.hi[x];
        }
    }

    /// Empties the lanes from `count` on.
    pub fn clear_from(&mut self, count: usize) {
        for x in 0..3 {
            self.lo[x][count..].fill(f32::INFINITY);
            self.hi[x][count..].fill(f32::NEG_INFINITY);
        }
    }

    /// The box around all eight.
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
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger of two numbers, neither of which is NaN.
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The largest single-precision number that is not above `x`.
pub(crate) fn round_down(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) > x { y.next_down() } else { y }
}

/// The smallest single-precision number that is not below `x`.
pub(crate) fn round_up(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) < x { y.next_up() } else { y }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_outward_at_the_ends_of_the_range() {
        for x in [
            0.1,
            -0.1,
            1e-300,
            -1e-300,
            1e300,
            -1e300,
            0.0,
            1.0,
            f64::from(f32::MAX) * 1.0000001,
        ] {
            assert!(f64::from(round_down(x)) <= x, "{x}");
            assert!(f64::from(round_up(x)) >= x, "{x}");
        }
        assert_eq!(round_down(1.0), 1.0);
        assert_eq!(round_up(1.0), 1.0);
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
}
