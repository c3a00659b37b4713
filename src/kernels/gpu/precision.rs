//! The two precisions that programs are written in: what differs between them.

use bytemuck::Pod;

/// How finely an adapter computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// 32 bits: every adapter does.
    Single,
    /// 64 bits, where the adapter offers them and its arithmetic passed the test.
    Double,
}

impl Precision {
    /// Its name.
    pub fn word(self) -> &'static str {
        match self {
            Precision::Single => "single",
            Precision::Double => "double",
        }
    }
}

/// The numbers of a precision; programs call them `real`.
pub(crate) trait Real: Pod + Default + Send + Sync + Into<f64> {
    /// Which one it is.
    const PRECISION: Precision;
    /// What programs of this precision have in front.
    const PROGRAM: &'static str;
    /// More than the relative error of an addition, a subtraction or a multiplication, whichever way they round.
    const UNIT_ERROR: f64;
    /// A number that is smaller may count as 0.
    const SMALLEST: f64;
    /// How many times longer a program runs than in single precision, on adapters that have few units for this one.
    const SLOWER: u64;

    /// The nearest one.
    fn nearest(x: f64) -> Self;
}

impl Real for f32 {
    const PRECISION: Precision = Precision::Single;
    const PROGRAM: &'static str = include_str!("single.wgsl");
    const UNIT_ERROR: f64 = f32::EPSILON as f64;
    const SMALLEST: f64 = f32::MIN_POSITIVE as f64;
    const SLOWER: u64 = 1;

    fn nearest(x: f64) -> f32 {
        x as f32
    }
}

impl Real for f64 {
    const PRECISION: Precision = Precision::Double;
    const PROGRAM: &'static str = include_str!("double.wgsl");
    const UNIT_ERROR: f64 = f64::EPSILON;
    /// Twice the limit, since the processor rounds below it.
    const SMALLEST: f64 = 2.0 * f64::MIN_POSITIVE;
    const SLOWER: u64 = 16;

    fn nearest(x: f64) -> f64 {
        x
    }
}
