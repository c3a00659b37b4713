//! Blocks and chunks of control points, in the order of the input, and operations on coordinates in
//! their own precision.

use crate::curve::{self, pow2};

/// Number of points in a block. All points of a block are compressed together.
pub(super) const BLOCK: usize = 64;

/// Number of coordinates of a block.
pub(super) const VALUES: usize = 3 * BLOCK;

/// Number of points in a chunk. If one of them moved too far, the whole chunk is marked.
pub(super) const CHUNK: usize = 8;

/// Operations on a floating-point type of coordinates.
pub(super) trait Real: curve::Real + Send + Sync {
    /// Half a unit in the last place of 1.
    const U: f64;
    /// The largest finite number.
    const MAX: Self;
    /// Largest coordinate whose squares can be added without overflow.
    const LARGEST: f64;
    /// A number far above the square root of the smallest positive number.
    const TINY: Self;
    fn from_f64(x: f64) -> Self;
    fn narrowed(self) -> f32;
}

impl Real for f32 {
    const U: f64 = f32::EPSILON as f64 / 2.0;
    const MAX: f32 = f32::MAX;
    const LARGEST: f64 = 1e18;
    const TINY: f32 = pow2(-70) as f32;
    #[inline(always)]
    fn from_f64(x: f64) -> f32 {
        x as f32
    }
    #[inline(always)]
    fn narrowed(self) -> f32 {
        self
    }
}

impl Real for f64 {
    const U: f64 = f64::EPSILON / 2.0;
    const MAX: f64 = f64::MAX;
    const LARGEST: f64 = 1e150;
    const TINY: f64 = pow2(-520);
    #[inline(always)]
    fn from_f64(x: f64) -> f64 {
        x
    }
    #[inline(always)]
    fn narrowed(self) -> f32 {
        self as f32
    }
}
