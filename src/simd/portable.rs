//! Portable implementation of the vector operations, without intrinsics.

use super::{LANES, Lanes, PACKED, Row, Simd};
use std::array::from_fn;

/// The instructions that every CPU has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Simd for Portable {
    const FMA: bool = false;
}

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
        from_fn(|k| if a[k] < b[k] { u32::MAX } else { 0 })
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
        from_fn(|k| words[k] & !m[k])
    }

    #[inline(always)]
    fn or_words(self, a: Row<u32>, b: Row<u32>) -> Row<u32> {
        from_fn(|k| a[k] | b[k])
    }

    #[inline(always)]
    fn and_words(self, a: Row<u32>, b: Row<u32>) -> Row<u32> {
        from_fn(|k| a[k] & b[k])
    }

    #[inline(always)]
    fn nonzero(self, words: Row<u32>) -> u32 {
        (0..LANES).fold(0, |bits, k| bits | u32::from(words[k] != 0) << k)
    }

    #[inline(always)]
    fn store(self, words: Row<u32>, to: &mut Row<u32>) {
        *to = words;
    }

    #[inline(always)]
    fn packed(self, bits: u32) -> Row<u32> {
        PACKED[(bits & 0xff) as usize].map(u32::from)
    }

    #[inline(always)]
    fn permute(self, words: Row<u32>, order: Row<u32>) -> Row<u32> {
        order.map(|k| words[k as usize % LANES])
    }

    #[inline(always)]
    fn least(self, rows: [Row<f32>; LANES]) -> Row<f32> {
        let least = |a, b| if b < a { b } else { a };
        rows.map(|row| row.into_iter().fold(f32::INFINITY, least))
    }

    #[inline(always)]
    fn greatest(self, rows: [Row<f32>; LANES]) -> Row<f32> {
        let greatest = |a, b| if b > a { b } else { a };
        rows.map(|row| row.into_iter().fold(f32::NEG_INFINITY, greatest))
    }

    #[inline(always)]
    fn store_floats(self, x: Row<f32>, to: &mut Row<f32>) {
        *to = x;
    }

    #[inline(always)]
    fn count_from(self, first: u32) -> Row<u32> {
        from_fn(|k| first + k as u32)
    }
}
