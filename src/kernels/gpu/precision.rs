//! The two precisions of the shaders, and the differences between them.

use bytemuck::Pod;

/// Precision in which an adapter computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum GpuPrecision {
    /// 32 bits; supported by every adapter.
    Single,
    /// 64 bits; used if the adapter supports them and its arithmetic passed the test.
    Double,
}

impl GpuPrecision {
    /// Returns the name of the precision.
    pub fn word(self) -> &'static str {
        match self {
            GpuPrecision::Single => "single",
            GpuPrecision::Double => "double",
        }
    }
}

/// A floating-point type that shaders compute in; they call it `real`.
pub(crate) trait Real: Pod + Default + Send + Sync + Into<f64> {
    /// The precision of the type.
    const PRECISION: GpuPrecision;
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

    /// Returns the nearest number of this precision.
    fn nearest(x: f64) -> Self;
}

impl Real for f32 {
    const PRECISION: GpuPrecision = GpuPrecision::Single;
    const SHADER: &'static str = include_str!("single.wgsl");
    const UNIT_ERROR: f64 = f32::EPSILON as f64;
    const SMALLEST: f64 = f32::MIN_POSITIVE as f64;
    const SLOWER: u64 = 1;

    fn nearest(x: f64) -> f32 {
        x as f32
    }
}

impl Real for f64 {
    const PRECISION: GpuPrecision = GpuPrecision::Double;
    const SHADER: &'static str = include_str!("double.wgsl");
    const UNIT_ERROR: f64 = f64::EPSILON;
    /// Twice the limit, because the CPU rounds below it.
    const SMALLEST: f64 = 2.0 * f64::MIN_POSITIVE;
    const SLOWER: u64 = 16;

    fn nearest(x: f64) -> f64 {
        x
    }
}
