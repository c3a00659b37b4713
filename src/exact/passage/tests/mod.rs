//! Tests of passages: against the oracle, of the methods against one another, and of known ones.

mod known;
mod methods;
mod oracle;
mod speed;

use super::*;

/// A random number generator. Failed assertions print its seed.
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Self {
        Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn next(&mut self, n: u64) -> i64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % n) as i64
    }

    fn polygon(&mut self, n: usize, range: u64) -> Polygon {
        (0..n).map(|_| [0; 3].map(|_| self.next(range))).collect()
    }

    /// Returns a number that is uniform in `[-size, size]`.
    fn float(&mut self, size: f64) -> f64 {
        size * (self.next(1 << 31) as f64 / f64::from(1 << 30) - 1.0)
    }

    fn vector(&mut self, size: f64) -> Point {
        [0; 3].map(|_| self.float(size))
    }
}

type Polygon = Vec<[i64; 3]>;

/// Returns the passages in the order in which they are reported.
fn collect(before: &Edges, after: &Edges, ties: Ties) -> (Decided, Vec<Passage>) {
    let mut all = Vec::new();
    let decided = passages(before, after, ties, &mut |p| all.push(p));
    (decided, all)
}

fn collect_exactly(before: &Edges, after: &Edges, ties: Ties) -> (Decided, Vec<Passage>) {
    let mut all = Vec::new();
    let decided = exactly(before, after, ties, &mut |p| all.push(p));
    (decided, all)
}
