//! Fixed-point numbers of 64 bits, as programs sum them: exact in any order, so that a sum has the same bits on every run.

/// What one unit is worth.
pub(crate) const UNIT: f64 = 1.0 / (1u64 << 44) as f64;

/// A number from its two halves, in units.
pub(crate) fn whole([low, high]: [u32; 2]) -> i64 {
    (u64::from(high) << 32 | u64::from(low)) as i64
}

/// The number nearest to so many units; the rounding is below `2^-53` of it.
pub(crate) fn number(halves: [u32; 2]) -> f64 {
    whole(halves) as f64 * UNIT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_make_signed_numbers() {
        assert_eq!(whole([1, 0]), 1);
        assert_eq!(whole([u32::MAX, u32::MAX]), -1);
        assert_eq!(whole([0, 1]), 1 << 32);
        assert_eq!(number([0, 1 << 12]), 1.0);
        assert_eq!(number([0, u32::MAX << 12]), -1.0);
    }
}
