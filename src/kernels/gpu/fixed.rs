//! Fixed-point numbers in which shaders sum. Their sums are exact in any order, so a sum has the
//! same bits on every run.
//!
//! A thread sums in 64 bits, which hold 500,000 radians; the sum of a pair of curves has 96 bits.

/// Value of the last bit.
pub(crate) const UNIT: f64 = 1.0 / (1u64 << 44) as f64;

/// Returns the integer with these halves, low and high.
pub(crate) fn whole([low, high]: [u32; 2]) -> i64 {
    (u64::from(high) << 32 | u64::from(low)) as i64
}

/// Returns the floating-point number nearest to three words in units of [`UNIT`]. The relative
/// rounding error is below `2^-52`.
pub(crate) fn number([low, middle, high]: [u32; 3]) -> f64 {
    let whole = i128::from(high as i32) << 64 | i128::from(middle) << 32 | i128::from(low);
    whole as f64 * UNIT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_combine_to_signed_numbers() {
        assert_eq!(whole([1, 0]), 1);
        assert_eq!(whole([u32::MAX, u32::MAX]), -1);
        assert_eq!(whole([0, 1]), 1 << 32);
        assert_eq!(number([0, 1 << 12, 0]), 1.0);
        assert_eq!(number([0, u32::MAX << 12, u32::MAX]), -1.0);
        assert_eq!(number([0, 0, 1]), 1048576.0);
    }
}
