//! Random numbers that depend on a seed alone: they are the same on every machine. The programs in
//! `tests` compile this file, too.

#[cfg(test)]
use std::fmt::Debug;

/// SplitMix64 (Steele, Lea & Flood 2014, *Fast Splittable Pseudorandom Number Generators*).
pub struct Random(u64);

impl Random {
    /// Creates a generator. Neighbouring seeds give unrelated sequences.
    pub fn new(seed: u64) -> Random {
        Random(seed)
    }

    /// Creates an independent generator for each key.
    pub fn from_key<const N: usize>(key: [u64; N]) -> Random {
        Random(
            key.iter()
                .fold(0, |state, part| Random(state ^ part).next()),
        )
    }

    /// Returns 64 random bits.
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns a number from 0 to 1, without 1.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Support of the tests.
#[cfg(test)]
impl Random {
    /// Returns an integer from 0 to `n - 1`.
    pub fn below<T>(&mut self, n: T) -> T
    where
        T: TryInto<u64, Error: Debug> + TryFrom<u64, Error: Debug>,
    {
        let n: u64 = n.try_into().expect("at least 0");
        T::try_from((self.next() >> 1) % n).expect("less than n")
    }

    /// Returns true with a probability of one in `n`.
    pub fn one_in(&mut self, n: u64) -> bool {
        self.below(n) == 0
    }

    /// Returns one of some values.
    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }

    /// Returns a number from `lo` to `hi`.
    pub fn between(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.unit()
    }

    /// Returns a point of a cube around the origin, with edges of `2 * size`.
    pub fn point(&mut self, size: f64) -> [f64; 3] {
        [(); 3].map(|()| self.between(-size, size))
    }
}
