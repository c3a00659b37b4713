//! The operations without special instructions.

use super::{LANES, Lanes, PACKED, Row, Simd};

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
