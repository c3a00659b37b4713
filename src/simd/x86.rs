//! The instructions of x86-64 beyond its baseline.

use super::{LANES, Lanes, PACKED, Row, Simd};
use std::arch::is_x86_feature_detected as has;
use std::arch::x86_64::*;
use std::sync::LazyLock;

/// AVX2, and the instructions for bits and FMA that came with it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(());

/// AVX-512, in addition to [`Avx2`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx512(());

/// Returns the token if the CPU has AVX2.
pub(crate) fn avx2() -> Option<Avx2> {
    static FOUND: LazyLock<bool> = LazyLock::new(|| {
        has!("avx2") && has!("fma") && has!("bmi1") && has!("bmi2") && has!("popcnt")
    });
    FOUND.then_some(Avx2(()))
}

/// Returns the token if the CPU has AVX-512.
pub(crate) fn avx512() -> Option<Avx512> {
    static FOUND: LazyLock<bool> = LazyLock::new(|| {
        let parts = has!("avx512f") && has!("avx512dq") && has!("avx512bw") && has!("avx512vl");
        avx2().is_some() && parts
    });
    FOUND.then_some(Avx512(()))
}

impl Simd for Avx2 {
    const FMA: bool = true;
}

impl Simd for Avx512 {
    const FMA: bool = true;
}

/// Defines methods of a token that call a function, compiled with these target features. The
/// function must be `#[inline(always)]`.
macro_rules! calls {
    ($token:ident: $features:literal, $($name:ident($($x:ident: $X:ident),+))+) => {
        impl $token {$(
            #[inline(always)]
            pub(crate) fn $name<$($X,)+ R>(self, f: impl FnOnce($($X),+) -> R, $($x: $X),+) -> R {
                #[target_feature(enable = $features)]
                fn call<$($X,)+ R>(f: impl FnOnce($($X),+) -> R, $($x: $X),+) -> R {
                    f($($x),+)
                }
                // SAFETY: the token proves that the CPU has these instructions.
                unsafe { call(f, $($x),+) }
            }
        )+}
    };
}

calls! {
    Avx2: "avx2,fma,bmi1,bmi2,popcnt",
    call2(a: A, b: B)
    call3(a: A, b: B, c: C)
    call4(a: A, b: B, c: C, d: D)
    call5(a: A, b: B, c: C, d: D, e: E)
}

calls! {
    Avx512: "avx2,fma,bmi1,bmi2,popcnt,avx512f,avx512dq,avx512bw,avx512vl",
    call3(a: A, b: B, c: C)
    call4(a: A, b: B, c: C, d: D)
    call5(a: A, b: B, c: C, d: D, e: E)
}

/// Prefetches a value. The hardware prefetcher stops at page boundaries.
#[inline(always)]
pub(crate) fn prefetch<T>(value: &T) {
    let start: *const T = value;
    for line in (0..size_of::<T>()).step_by(64) {
        // SAFETY: a prefetch reads nothing.
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(start.cast::<i8>().wrapping_add(line));
        }
    }
}

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

/// Defines operations of a token by intrinsics.
macro_rules! operations {
    ($(fn $name:ident($($arg:ident: $type:ty),*) $(-> $out:ty)? $body:block)*) => {$(
        #[inline(always)]
        fn $name(self, $($arg: $type),*) $(-> $out)? {
            // SAFETY: the token proves that the CPU has the instructions. Loads and stores are of
            // references to as many numbers as they read or write, and need no alignment.
            unsafe { $body }
        }
    )*};
}

/// Implements [`Lanes`] for a token with AVX2.
macro_rules! lanes {
    ($($token:ident)+) => {$(
        impl Lanes for $token {
            type Floats = __m256;
            type Mask = __m256;
            type Words = __m256i;

            operations! {
                fn load(row: &Row<f32>) -> __m256 { _mm256_loadu_ps(row.as_ptr()) }
                fn store_floats(x: __m256, to: &mut Row<f32>) {
                    _mm256_storeu_ps(to.as_mut_ptr(), x)
                }
                fn splat(x: f32) -> __m256 { _mm256_set1_ps(x) }
                fn less(a: __m256, b: __m256) -> __m256 { _mm256_cmp_ps::<_CMP_LT_OQ>(a, b) }
                fn or(a: __m256, b: __m256) -> __m256 { _mm256_or_ps(a, b) }
                fn bits(m: __m256) -> u32 { _mm256_movemask_ps(m) as u32 }
                fn least(rows: [__m256; LANES]) -> __m256 { fold_rows!(rows, _mm256_min_ps) }
                fn greatest(rows: [__m256; LANES]) -> __m256 { fold_rows!(rows, _mm256_max_ps) }

                fn splat_word(x: u32) -> __m256i { _mm256_set1_epi32(x as i32) }
                fn outside(m: __m256, words: __m256i) -> __m256i {
                    _mm256_andnot_si256(_mm256_castps_si256(m), words)
                }
                fn or_words(a: __m256i, b: __m256i) -> __m256i { _mm256_or_si256(a, b) }
                fn and_words(a: __m256i, b: __m256i) -> __m256i { _mm256_and_si256(a, b) }
                fn nonzero(words: __m256i) -> u32 {
                    let zero = _mm256_cmpeq_epi32(words, _mm256_setzero_si256());
                    !_mm256_movemask_ps(_mm256_castsi256_ps(zero)) as u32 & 0xff
                }
                fn store(words: __m256i, to: &mut Row<u32>) {
                    _mm256_storeu_si256(to.as_mut_ptr().cast(), words)
                }
                fn packed(bits: u32) -> __m256i {
                    let order = &PACKED[(bits & 0xff) as usize];
                    _mm256_cvtepu8_epi32(_mm_loadl_epi64(order.as_ptr().cast()))
                }
                fn permute(words: __m256i, order: __m256i) -> __m256i {
                    _mm256_permutevar8x32_epi32(words, order)
                }
                fn count_from(first: u32) -> __m256i {
                    let steps = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
                    _mm256_add_epi32(_mm256_set1_epi32(first as i32), steps)
                }
            }
        }
    )+};
}

lanes! { Avx2 Avx512 }
