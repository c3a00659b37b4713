//! Operations on eight single-precision numbers at once: one trait, with a portable implementation
//! and one for AVX2.
//!
//! An implementation is a token type. A token for AVX2 exists only if the CPU has AVX2, so code
//! that has a token may use the instructions. Code that is generic over the token is compiled once
//! per implementation, inside a function with the right target features. Everything between that
//! function and the operations must be `#[inline(always)]`, and must not be a closure, because
//! closures are compiled without the target features.

use super::LANES;

/// A row of eight lanes.
type Row<T> = [T; LANES];

/// Operations on eight lanes. No number is NaN.
pub(crate) trait Lanes: Copy {
    /// Eight numbers.
    type Floats: Copy;
    /// Eight booleans.
    type Mask: Copy;
    /// Eight unsigned integers.
    type Words: Copy;

    fn load(self, row: &Row<f32>) -> Self::Floats;
    fn store_floats(self, x: Self::Floats, to: &mut Row<f32>);
    fn splat(self, x: f32) -> Self::Floats;
    /// `a < b`.
    fn less(self, a: Self::Floats, b: Self::Floats) -> Self::Mask;
    fn or(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Returns one bit per lane: 1 if the lane is set.
    fn bits(self, m: Self::Mask) -> u32;
    /// Returns the minimum of each row.
    fn least(self, rows: [Self::Floats; LANES]) -> Self::Floats;
    /// Returns the maximum of each row.
    fn greatest(self, rows: [Self::Floats; LANES]) -> Self::Floats;

    fn splat_word(self, x: u32) -> Self::Words;
    /// Returns `words` in the lanes that are not set in `m`, and 0 in the others.
    fn outside(self, m: Self::Mask, words: Self::Words) -> Self::Words;
    fn or_words(self, a: Self::Words, b: Self::Words) -> Self::Words;
    fn and_words(self, a: Self::Words, b: Self::Words) -> Self::Words;
    /// Returns one bit per lane: 1 if the lane is not 0.
    fn nonzero(self, words: Self::Words) -> u32;
    fn store(self, words: Self::Words, to: &mut Row<u32>);
    /// Returns the permutation for [`Lanes::permute`] that moves the lanes whose bit is set to the
    /// front. The order of the other lanes is unspecified.
    fn packed(self, bits: u32) -> Self::Words;
    /// Returns, in every lane, the lane of `words` with the index in `order`.
    fn permute(self, words: Self::Words, order: Self::Words) -> Self::Words;
    /// Returns `first`, `first + 1`, ..
    fn count_from(self, first: u32) -> Self::Words;
}

/// The implementation for every CPU.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Lanes for Portable {
    type Floats = Row<f32>;
    type Mask = Row<u32>;
    type Words = Row<u32>;

    #[inline(always)]
    fn load(self, row: &Row<f32>) -> Row<f32> {
        *row
    }

    #[inline(always)]
    fn splat(self, x: f32) -> Row<f32> {
        [x; LANES]
    }

    #[inline(always)]
    fn less(self, a: Row<f32>, b: Row<f32>) -> Row<u32> {
        let mut m = [0; LANES];
        for (m, (a, b)) in m.iter_mut().zip(a.iter().zip(b)) {
            *m = if *a < b { u32::MAX } else { 0 };
        }
        m
    }

    #[inline(always)]
    fn or(self, a: Row<u32>, b: Row<u32>) -> Row<u32> {
        self.or_words(a, b)
    }

    #[inline(always)]
    fn bits(self, m: Row<u32>) -> u32 {
        self.nonzero(m)
    }

    #[inline(always)]
    fn splat_word(self, x: u32) -> Row<u32> {
        [x; LANES]
    }

    #[inline(always)]
    fn outside(self, m: Row<u32>, words: Row<u32>) -> Row<u32> {
        let mut out = words;
        for (out, m) in out.iter_mut().zip(m) {
            *out &= !m;
        }
        out
    }

    #[inline(always)]
    fn or_words(self, a: Row<u32>, b: Row<u32>) -> Row<u32> {
        let mut out = a;
        for (out, b) in out.iter_mut().zip(b) {
            *out |= b;
        }
        out
    }

    #[inline(always)]
    fn and_words(self, a: Row<u32>, b: Row<u32>) -> Row<u32> {
        let mut out = a;
        for (out, b) in out.iter_mut().zip(b) {
            *out &= b;
        }
        out
    }

    #[inline(always)]
    fn nonzero(self, words: Row<u32>) -> u32 {
        let mut bits = 0;
        for (k, w) in words.into_iter().enumerate() {
            bits |= u32::from(w != 0) << k;
        }
        bits
    }

    #[inline(always)]
    fn store(self, words: Row<u32>, to: &mut Row<u32>) {
        *to = words;
    }

    #[inline(always)]
    fn packed(self, bits: u32) -> Row<u32> {
        let mut order = [0; LANES];
        for (to, from) in order.iter_mut().zip(PACKED[(bits & 0xff) as usize]) {
            *to = from.into();
        }
        order
    }

    #[inline(always)]
    fn permute(self, words: Row<u32>, order: Row<u32>) -> Row<u32> {
        let mut out = words;
        for (to, from) in out.iter_mut().zip(order) {
            *to = words[from as usize % LANES];
        }
        out
    }

    #[inline(always)]
    fn least(self, rows: [Row<f32>; LANES]) -> Row<f32> {
        let mut out = [f32::INFINITY; LANES];
        for (out, row) in out.iter_mut().zip(rows) {
            for x in row {
                *out = if x < *out { x } else { *out };
            }
        }
        out
    }

    #[inline(always)]
    fn greatest(self, rows: [Row<f32>; LANES]) -> Row<f32> {
        let mut out = [f32::NEG_INFINITY; LANES];
        for (out, row) in out.iter_mut().zip(rows) {
            for x in row {
                *out = if x > *out { x } else { *out };
            }
        }
        out
    }

    #[inline(always)]
    fn store_floats(self, x: Row<f32>, to: &mut Row<f32>) {
        *to = x;
    }

    #[inline(always)]
    fn count_from(self, first: u32) -> Row<u32> {
        let mut out = [first; LANES];
        for (k, out) in out.iter_mut().enumerate() {
            *out += k as u32;
        }
        out
    }
}

/// For every set of lanes: the indices of its lanes, in order.
const PACKED: [[u8; LANES]; 256] = {
    let mut table = [[0; LANES]; 256];
    let mut bits = 0;
    while bits < 256 {
        let (mut k, mut at) = (0, 0);
        while k < LANES {
            if bits >> k & 1 != 0 {
                table[bits][at] = k as u8;
                at += 1;
            }
            k += 1;
        }
        bits += 1;
    }
    table
};

/// The implementation for CPUs with AVX2.
#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "vector instructions")]
mod avx2 {
    use super::{LANES, Lanes, PACKED, Row};
    use std::arch::x86_64::*;

    /// Folds each of eight rows by three rounds of pairwise operations. (A macro, because a
    /// function could only take the operation as a closure.)
    macro_rules! fold_rows {
        ($rows:expr, $pick:ident) => {{
            let [a, b, c, d, e, f, g, h] = $rows;
            // For two rows: the folds of their lanes 0 and 2, and 1 and 3, side by side in each
            // half.
            let ab = fold_rows!(@two a, b, $pick);
            let cd = fold_rows!(@two c, d, $pick);
            let ef = fold_rows!(@two e, f, $pick);
            let gh = fold_rows!(@two g, h, $pick);
            let abcd = fold_rows!(@four ab, cd, $pick);
            let efgh = fold_rows!(@four ef, gh, $pick);
            $pick(
                _mm256_permute2f128_ps::<0x20>(abcd, efgh),
                _mm256_permute2f128_ps::<0x31>(abcd, efgh),
            )
        }};
        (@two $p:expr, $q:expr, $pick:ident) => {{
            let (p, q) = ($p, $q);
            $pick(_mm256_unpacklo_ps(p, q), _mm256_unpackhi_ps(p, q))
        }};
        (@four $p:expr, $q:expr, $pick:ident) => {{
            let (p, q) = (_mm256_castps_pd($p), _mm256_castps_pd($q));
            $pick(
                _mm256_castpd_ps(_mm256_unpacklo_pd(p, q)),
                _mm256_castpd_ps(_mm256_unpackhi_pd(p, q)),
            )
        }};
    }

    #[derive(Clone, Copy, Debug)]
    pub(crate) struct Avx2(());

    impl Avx2 {
        /// Returns the token if the CPU has AVX2 and the bit manipulation instructions that came
        /// with it.
        pub fn detect() -> Option<Avx2> {
            let all = std::arch::is_x86_feature_detected!("avx2")
                && std::arch::is_x86_feature_detected!("bmi1")
                && std::arch::is_x86_feature_detected!("bmi2")
                && std::arch::is_x86_feature_detected!("popcnt");
            all.then_some(Avx2(()))
        }
    }

    // Every operation is sound because the token exists only if AVX2 was detected. Loads and stores
    // use references to eight elements and need no alignment.
    impl Lanes for Avx2 {
        type Floats = __m256;
        type Mask = __m256;
        type Words = __m256i;

        #[inline(always)]
        fn load(self, row: &Row<f32>) -> __m256 {
            // SAFETY: the token proves that AVX2 is available; eight numbers are read.
            unsafe { _mm256_loadu_ps(row.as_ptr()) }
        }

        #[inline(always)]
        fn splat(self, x: f32) -> __m256 {
            // SAFETY: the token proves that AVX2 is available.
            unsafe { _mm256_set1_ps(x) }
        }

        #[inline(always)]
        fn less(self, a: __m256, b: __m256) -> __m256 {
            // SAFETY: the token proves that AVX2 is available.
            unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(a, b) }
        }

        #[inline(always)]
        fn or(self, a: __m256, b: __m256) -> __m256 {
            // SAFETY: the token proves that AVX2 is available.
            unsafe { _mm256_or_ps(a, b) }
        }

        #[inline(always)]
        fn bits(self, m: __m256) -> u32 {
            // SAFETY: the token proves that AVX2 is available.
            unsafe { _mm256_movemask_ps(m) as u32 }
        }

        #[inline(always)]
        fn splat_word(self, x: u32) -> __m256i {
            // SAFETY: the token proves that AVX2 is available.
            unsafe { _mm256_set1_epi32(x as i32) }
        }

        #[inline(always)]
        fn outside(self, m: __m256, words: __m256i) -> __m256i {
            // SAFETY: the token proves that AVX2 is available.
            unsafe { _mm256_andnot_si256(_mm256_castps_si256(m), words) }
        }

        #[inline(always)]
        fn or_words(self, a: __m256i, b: __m256i) -> __m256i {
            // SAFETY: the token proves that AVX2 is available.
            unsafe { _mm256_or_si256(a, b) }
        }

        #[inline(always)]
        fn and_words(self, a: __m256i, b: __m256i) -> __m256i {
            // SAFETY: the token proves that AVX2 is available.
            unsafe { _mm256_and_si256(a, b) }
        }

        #[inline(always)]
        fn nonzero(self, words: __m256i) -> u32 {
            // SAFETY: the token proves that AVX2 is available.
            unsafe {
                let zero = _mm256_cmpeq_epi32(words, _mm256_setzero_si256());
                !_mm256_movemask_ps(_mm256_castsi256_ps(zero)) as u32 & 0xff
            }
        }

        #[inline(always)]
        fn store(self, words: __m256i, to: &mut Row<u32>) {
            // SAFETY: the token proves that AVX2 is available; eight words are written.
            unsafe { _mm256_storeu_si256(to.as_mut_ptr().cast(), words) }
        }

        #[inline(always)]
        fn packed(self, bits: u32) -> __m256i {
            let order = &PACKED[(bits & 0xff) as usize];
            // SAFETY: the token proves that AVX2 is available; eight bytes are read.
            unsafe { _mm256_cvtepu8_epi32(_mm_loadl_epi64(order.as_ptr().cast())) }
        }

        #[inline(always)]
        fn permute(self, words: __m256i, order: __m256i) -> __m256i {
            // SAFETY: the token proves that AVX2 is available.
            unsafe { _mm256_permutevar8x32_epi32(words, order) }
        }

        #[inline(always)]
        fn least(self, rows: [__m256; LANES]) -> __m256 {
            // SAFETY: the token proves that AVX2 is available.
            unsafe { fold_rows!(rows, _mm256_min_ps) }
        }

        #[inline(always)]
        fn greatest(self, rows: [__m256; LANES]) -> __m256 {
            // SAFETY: the token proves that AVX2 is available.
            unsafe { fold_rows!(rows, _mm256_max_ps) }
        }

        #[inline(always)]
        fn store_floats(self, x: __m256, to: &mut Row<f32>) {
            // SAFETY: the token proves that AVX2 is available; eight numbers are written.
            unsafe { _mm256_storeu_ps(to.as_mut_ptr(), x) }
        }

        #[inline(always)]
        fn count_from(self, first: u32) -> __m256i {
            const STEPS: Row<u32> = {
                let mut steps = [0; LANES];
                let mut k = 0;
                while k < LANES {
                    steps[k] = k as u32;
                    k += 1;
                }
                steps
            };
            // SAFETY: the token proves that AVX2 is available; eight words are read.
            unsafe {
                let steps = _mm256_loadu_si256(STEPS.as_ptr().cast());
                _mm256_add_epi32(_mm256_set1_epi32(first as i32), steps)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers that cover all results of a comparison.
    const SPECIAL: Row<f32> = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        f32::MIN_POSITIVE / 4.0,
        f32::MAX,
        f32::INFINITY,
        f32::NEG_INFINITY,
    ];

    fn words<L: Lanes>(lanes: L, w: L::Words) -> Row<u32> {
        let mut out = [7; LANES];
        lanes.store(w, &mut out);
        out
    }

    fn check<L: Lanes>(lanes: L) {
        for shift in 0..LANES {
            let mut a = SPECIAL;
            a.rotate_left(shift);
            for b in SPECIAL {
                let less = lanes.less(lanes.load(&a), lanes.splat(b));
                let greater = lanes.less(lanes.splat(b), lanes.load(&a));
                let either = lanes.bits(lanes.or(less, greater));
                let bits = lanes.bits(less);
                let outside = words(lanes, lanes.outside(less, lanes.count_from(1)));
                for k in 0..LANES {
                    assert_eq!(bits >> k & 1 == 1, a[k] < b, "{} < {b}", a[k]);
                    assert_eq!(either >> k & 1 == 1, a[k] != b, "{} != {b}", a[k]);
                    assert_eq!(outside[k], if a[k] < b { 0 } else { k as u32 + 1 });
                }
                assert!(bits < 256 && either < 256);
            }
        }
        let (five, count) = (lanes.splat_word(5), lanes.count_from(0));
        assert_eq!(
            words(lanes, lanes.or_words(five, count)),
            [5, 5, 7, 7, 5, 5, 7, 7]
        );
        let both = lanes.and_words(five, count);
        assert_eq!(words(lanes, both), [0, 1, 0, 1, 4, 5, 4, 5]);
        assert_eq!(lanes.nonzero(both), 0b1111_1010);
        for bits in 0..256 {
            let packed = words(
                lanes,
                lanes.permute(lanes.count_from(40), lanes.packed(bits)),
            );
            let want: Vec<u32> = (0..8)
                .filter(|k| bits >> k & 1 == 1)
                .map(|k| 40 + k)
                .collect();
            assert_eq!(packed[..want.len()], want);
        }
        let mut rows = [[0.0; LANES]; LANES];
        for (k, row) in rows.iter_mut().enumerate() {
            for (l, x) in row.iter_mut().enumerate() {
                *x = ((k * 31 + l * 17 + k * l * 5) % 64) as f32 - 32.0;
            }
        }
        let loaded = rows.each_ref().map(|row| lanes.load(row));
        let [mut least, mut greatest] = [[0.0; LANES]; 2];
        lanes.store_floats(lanes.least(loaded), &mut least);
        lanes.store_floats(lanes.greatest(loaded), &mut greatest);
        assert_eq!(
            least,
            rows.map(|row| row.into_iter().fold(f32::MAX, f32::min))
        );
        assert_eq!(
            greatest,
            rows.map(|row| row.into_iter().fold(f32::MIN, f32::max))
        );
    }

    #[test]
    fn all_implementations_agree() {
        check(Portable);
        #[cfg(target_arch = "x86_64")]
        match Avx2::detect() {
            Some(avx2) => check(avx2),
            None => eprintln!("skipped: this CPU has no AVX2"),
        }
    }
}
