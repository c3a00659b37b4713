//! Fixed-point numbers, as programs sum them: exact in any order, so that a sum has the same bits on every run.
//!
//! A thread has 64 bits, which are 500,000 radians; the sum of a pair of curves has 96.

/// What one unit is worth.
pub(crate) const UNIT: f64 = 1.0 / (1u64 << 44) as f64;

/// An integer from its two halves.
pub(crate) fn whole([low, high]: [u32; 2]) -> i64 {
    (u64::from(high) << 32 | u64::from(low)) as i64
}

/// The number nearest to so many units, given in three words; the rounding is below `2^-52` of it.
pub(crate) fn number([low, middle, high]: [u32; 3]) -> f64 {
    let whole = i128::from(high as i32) << 64 | i128::from(middle) << 32 | i128::from(low);
    whole as f64 * UNIT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_make_signed_numbers() {
        assert_eq!(whole([1, 0]), 1);
        assert_eq!(whole([u32::MAX, u32::MAX]), -1);
        assert_eq!(whole([0, 1]), 1 << 32);
        assert_eq!(number([0, 1 << 12, 0]), 1.0);
        assert_eq!(number([0, u32::MAX << 12, u32::MAX]), -1.0);
        assert_eq!(number([0, 0, 1]), 1048576.0);
    }
}
