//! Eight comparisons at once: one contract, a portable implementation and one for AVX2.
//!
//! An implementation is a token. The one for AVX2 exists only where the processor has it, so that whoever
//! holds it may use it. Code that takes a token is compiled once for each, inside a function that is allowed
//! the instructions: everything between that function and the comparisons is `#[inline(always)]`.

use super::LANES;

/// Comparisons of eight numbers with one. None of them is NaN.
pub(crate) trait Lanes: Copy {
    /// Lanes with `a < b`, a bit each.
    fn less(self, a: &[f32; LANES], b: f32) -> u32;
    /// Lanes with `a > b`, a bit each.
    fn greater(self, a: &[f32; LANES], b: f32) -> u32;
}

/// For every processor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Lanes for Portable {
    #[inline(always)]
    fn less(self, a: &[f32; LANES], b: f32) -> u32 {
        (0..LANES).fold(0, |m, k| m | u32::from(a[k] < b) << k)
    }

    #[inline(always)]
    fn greater(self, a: &[f32; LANES], b: f32) -> u32 {
        (0..LANES).fold(0, |m, k| m | u32::from(a[k] > b) << k)
    }
}

/// For processors with AVX2.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(());

#[cfg(target_arch = "x86_64")]
impl Avx2 {
    /// The token, where the processor has the instructions.
    pub fn detect() -> Option<Avx2> {
        std::arch::is_x86_feature_detected!("avx2").then_some(Avx2(()))
    }
}

#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "vector instructions")]
impl Lanes for Avx2 {
    #[inline(always)]
    fn less(self, a: &[f32; LANES], b: f32) -> u32 {
        use std::arch::x86_64::*;
        // SAFETY: the token exists only where AVX2 was detected; the load reads the eight numbers of `a` and
        // needs no alignment.
        unsafe {
            let a = _mm256_loadu_ps(a.as_ptr());
            _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a, _mm256_set1_ps(b))) as u32
        }
    }

    #[inline(always)]
    fn greater(self, a: &[f32; LANES], b: f32) -> u32 {
        use std::arch::x86_64::*;
        // SAFETY: as in `less`.
        unsafe {
            let a = _mm256_loadu_ps(a.as_ptr());
            _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(a, _mm256_set1_ps(b))) as u32
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(lanes: impl Lanes) {
        let special = [
            0.0,
            -0.0,
            1.0,
            -1.0,
            f32::MIN_POSITIVE / 4.0,
            f32::MAX,
            f32::INFINITY,
            f32::NEG_INFINITY,
        ];
        for shift in 0..LANES {
            let mut a = special;
            a.rotate_left(shift);
            for b in special {
                for k in 0..LANES {
                    assert_eq!(lanes.less(&a, b) >> k & 1 == 1, a[k] < b, "{} < {b}", a[k]);
                    assert_eq!(
                        lanes.greater(&a, b) >> k & 1 == 1,
                        a[k] > b,
                        "{} > {b}",
                        a[k]
                    );
                }
                assert!(lanes.less(&a, b) < 256 && lanes.greater(&a, b) < 256);
            }
        }
    }

    #[test]
    fn every_implementation_compares_alike() {
        check(Portable);
        #[cfg(target_arch = "x86_64")]
        match Avx2::detect() {
            Some(avx2) => check(avx2),
            None => eprintln!("skipped: no AVX2 here"),
        }
    }
}
