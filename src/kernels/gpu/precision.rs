//! The two precisions of the shaders, and the differences between them.

use bytemuck::Pod;

/// A floating-point type that shaders compute in; they call it `real`. Every adapter has 32 bits;
/// 64 bits are used if the adapter supports them and its arithmetic passed the test.
pub(crate) trait Real: Pod + Default + Send + Sync + Into<f64> {
    /// Name of the test of the arithmetic, and names of the direct sums of small and large tiles.
    const SELF_TEST: &'static str;
    const DIRECT: [&'static str; 2];
    /// Source code that precedes every shader of this precision.
    const SHADER: &'static str;
    /// Upper bound of the relative error of an addition, a subtraction or a multiplication, in any
    /// rounding mode.
    const UNIT_ERROR: f64;
    /// Smaller numbers may be flushed to 0.
    const SMALLEST: f64;
    /// Factor by which a shader is slower than in single precision, on adapters that have few units
    /// for this precision.
    const SLOWER: u64;
    /// Number that direct sums add to the length of a segment.
    const TINY_LENGTH: f64;
    /// Square of the distance below which a segment pair of a direct sum is undecided.
    const TINY_SQUARE: f64;

    /// Returns the nearest number of this precision.
    fn nearest(x: f64) -> Self;
}

impl Real for f32 {
    const SELF_TEST: &'static str = "self test";
    const DIRECT: [&'static str; 2] = ["direct, small", "direct"];
    const SHADER: &'static str = include_str!("single.wgsl");
    const UNIT_ERROR: f64 = f32::EPSILON as f64;
    const SMALLEST: f64 = f32::MIN_POSITIVE as f64;
    const SLOWER: u64 = 1;
    const TINY_LENGTH: f64 = 1e-15;
    const TINY_SQUARE: f64 = 1e-16;

    fn nearest(x: f64) -> f32 {
        x as f32
    }
}

impl Real for f64 {
    const SELF_TEST: &'static str = "self test, double";
    const DIRECT: [&'static str; 2] = ["direct, small, double", "direct, double"];
    const SHADER: &'static str = include_str!("double.wgsl");
    const UNIT_ERROR: f64 = f64::EPSILON;
    /// Twice the limit, because the CPU rounds below it.
    const SMALLEST: f64 = 2.0 * f64::MIN_POSITIVE;
    const SLOWER: u64 = 16;
    const TINY_LENGTH: f64 = 1e-18;
    const TINY_SQUARE: f64 = 1e-36;

    fn nearest(x: f64) -> f64 {
        x
    }
}
