//! Random numbers that are the same on every machine.

/// SplitMix64 (Steele, Lea & Flood 2014, *Fast Splittable Pseudorandom Number Generators*).
pub(super) struct Random(u64);

impl Random {
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
