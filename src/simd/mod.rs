//! Vector instructions: the instruction sets, the choice between them, and operations on eight
//! single-precision numbers at once. No other module names an instruction set.
//!
//! An instruction set is a token type. A token exists only if the CPU has the instructions, so code
//! that has a token may use them. Code that is generic over the token ([`Simd`], [`Lanes`]) is
//! compiled once per instruction set. [`dispatch`] detects the CPU and calls the right version.
//!
//! Target features are a property of a function, here of the methods `call2`, `call3`, .. of a
//! token. Everything between them and the operations must be `#[inline(always)]`, so that it is
//! compiled as a part of them. This holds for generic functions, and for functions without any
//! token whose loops the compiler vectorizes. It does not hold for closures without that attribute:
//! they are compiled without the target features if the compiler does not inline them.
//!
//! No result depends on the instruction set, except where code asks for [`Simd::FMA`]: the compiler
//! never fuses operations by itself.

mod portable;
#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "vector instructions")]
mod x86;

pub(crate) use portable::Portable;
#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{avx2, avx512, prefetch};

#[cfg(not(target_arch = "x86_64"))]
mod other {
    use super::Portable;

    /// Returns `None`, because this architecture has no AVX2.
    pub fn avx2() -> Option<Portable> {
        None
    }

    /// Returns `None`, because this architecture has no AVX-512.
    pub fn avx512() -> Option<Portable> {
        None
    }

    /// Does nothing on this architecture.
    pub fn prefetch<T>(_: &T) {}
}
#[cfg(not(target_arch = "x86_64"))]
pub(crate) use other::{avx2, avx512, prefetch};

/// Number of lanes of a vector. Groups of boxes and the children of a tree node have the same
/// number.
pub(crate) const LANES: usize = 8;

/// A row of eight lanes.
type Row<T> = [T; LANES];

/// Returns the row whose lane `k` is `of(k)`. The compiler always inlines this, unlike the `map`
/// of an array.
#[inline(always)]
pub(crate) fn per_lane<T>(mut of: impl FnMut(usize) -> T) -> Row<T> {
    [of(0), of(1), of(2), of(3), of(4), of(5), of(6), of(7)]
}

/// Calls an `#[inline(always)]` function with the best instruction set of the CPU, AVX2 or none:
/// `dispatch!(simd => Sweep::run(sweep, simd, range))`, where `simd` names the token among the
/// arguments. A function whose loops the compiler vectorizes needs no token: `dispatch!(sum(v))`.
///
/// The function is named by its path, and a receiver is the first argument, because the arguments
/// become those of a function with target features. If a closure captured them, the compiler would
/// no longer know that no other reference overlaps a `&mut`, and would load values again.
macro_rules! dispatch {
    ($simd:ident => $($f:ident)::+ ($($arg:expr),+ $(,)?)) => {
        match $crate::simd::avx2() {
            #[cfg(target_arch = "x86_64")]
            Some($simd) => $crate::simd::call!($simd, ($($f)::+), $($arg),+),
            _ => {
                let $simd = $crate::simd::Portable;
                $($f)::+($($arg),+)
            }
        }
    };
    ($($f:ident)::+ ($($arg:expr),+ $(,)?)) => {
        $crate::simd::dispatch!(_simd => $($f)::+($($arg),+))
    };
}

/// Same as [`dispatch`], with AVX-512 if the CPU has it. That pays for long loops over
/// double-precision numbers only.
macro_rules! dispatch_wide {
    ($simd:ident => $($f:ident)::+ ($($arg:expr),+ $(,)?)) => {
        match $crate::simd::avx512() {
            #[cfg(target_arch = "x86_64")]
            Some($simd) => $crate::simd::call!($simd, ($($f)::+), $($arg),+),
            _ => $crate::simd::dispatch!($simd => $($f)::+($($arg),+)),
        }
    };
    ($($f:ident)::+ ($($arg:expr),+ $(,)?)) => {
        $crate::simd::dispatch_wide!(_simd => $($f)::+($($arg),+))
    };
}

/// Calls a function compiled for the instruction set of a token.
#[cfg(target_arch = "x86_64")]
macro_rules! call {
    ($simd:ident, ($($f:tt)+), $a:expr, $b:expr) => {
        $simd.call2(#[inline(always)] |a, b| $($f)+(a, b), $a, $b)
    };
    ($simd:ident, ($($f:tt)+), $a:expr, $b:expr, $c:expr) => {
        $simd.call3(#[inline(always)] |a, b, c| $($f)+(a, b, c), $a, $b, $c)
    };
    ($simd:ident, ($($f:tt)+), $a:expr, $b:expr, $c:expr, $d:expr) => {
        $simd.call4(#[inline(always)] |a, b, c, d| $($f)+(a, b, c, d), $a, $b, $c, $d)
    };
    ($simd:ident, ($($f:tt)+), $a:expr, $b:expr, $c:expr, $d:expr, $e:expr) => {
        $simd.call5(#[inline(always)] |a, b, c, d, e| $($f)+(a, b, c, d, e), $a, $b, $c, $d, $e)
    };
}

#[cfg(target_arch = "x86_64")]
pub(crate) use call;
pub(crate) use {dispatch, dispatch_wide};

/// An instruction set. A value is a token: the CPU has the instructions.
pub(crate) trait Simd: Copy {
    /// True if `a.mul_add(b, c)`, which rounds once, is a single instruction.
    const FMA: bool;
}

/// Operations on eight lanes. No number is NaN.
pub(crate) trait Lanes: Simd {
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
        match avx2() {
            Some(avx2) => check(avx2),
            None => eprintln!("skipped: this CPU has no AVX2"),
        }
        match avx512() {
            Some(avx512) => check(avx512),
            None => eprintln!("skipped: this CPU has no AVX-512"),
        }
    }
}
