//! Curves with known linking numbers, for the tests of kernels that sum.

use super::{Estimate, oracle};
use crate::curve::{Basis, CurveSet, Positions};
use crate::scenes::Scene;
use std::fmt::Display;

/// Closed polylines with these vertices.
pub fn polylines(curves: &[&[[f64; 3]]]) -> CurveSet {
    let counts: Vec<i32> = curves.iter().map(|c| -(c.len() as i32)).collect();
    let flat: Vec<f64> = curves
        .iter()
        .copied()
        .flatten()
        .flatten()
        .copied()
        .collect();
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&flat)).unwrap()
}

/// The curves of a scene, and the linking number of the first pair.
pub fn scene(text: &str) -> (CurveSet, i64) {
    let generated = text.parse::<Scene>().unwrap().build().unwrap();
    let lambda = generated.certificate.links.first().map_or(0, |l| l.lambda);
    (generated.curves, lambda)
}

/// The bound covers the error, and no other integer is given.
pub fn check(found: Estimate, lambda: i64, what: &dyn Display) {
    let off = (found.value - lambda as f64).abs();
    assert!(off <= found.bound, "{what}: {found:?}, not {lambda}");
    let integer = found.integer();
    assert!(integer.is_none_or(|n| n == lambda), "{what}: {found:?}");
}

/// A reproducible sequence.
pub struct Random(pub u64);

impl Random {
    /// A number from 0 on, below `n`.
    pub fn below(&mut self, n: i64) -> i64 {
        let Random(seed) = self;
        *seed = seed
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        ((*seed >> 33) as i64) % n
    }

    /// A polygon whose sides are steps of a walk in a box: coherent, as curves are.
    pub fn polygon(&mut self, n: usize, size: i64, step: i64) -> Vec<[i64; 3]> {
        let mut at = [0; 3].map(|_: i64| self.below(size));
        (0..n)
            .map(|_| {
                at = at.map(|x| (x + self.below(2 * step + 1) - step).clamp(0, size));
                at
            })
            .collect()
    }
}

/// Sums of random pairs of integer polygons by some kernel, which says how it was set; returns how many integers were
/// proven, and how many are not 0.
pub fn random_pairs(
    pairs: usize,
    seed: u64,
    sum: impl Fn(usize, &CurveSet) -> (Estimate, String),
) -> (usize, usize) {
    let mut random = Random(seed);
    let (mut proven, mut linked) = (0, 0);
    for k in 0..pairs {
        let sizes = [6, 30, 300];
        let size = [20, 1000, 1 << 20][k % 3];
        let step = size / [1, 4, 16][k / 3 % 3] + 1;
        let mut polygon = |n| {
            let n = 3 + random.below(n) as usize;
            random.polygon(n, size, step)
        };
        let n = sizes[k / 9 % 3];
        let (a, b) = (polygon(n), polygon(n));
        let lambda = oracle::linking_number(&a, &b);
        let real = |p: &[[i64; 3]]| p.iter().map(|p| p.map(|x| x as f64)).collect::<Vec<_>>();
        let set = polylines(&[&real(&a), &real(&b)]);
        let (found, way) = sum(k, &set);
        match lambda {
            Some(lambda) => {
                check(found, lambda, &format_args!("{way} of {a:?} and {b:?}"));
                proven += usize::from(found.integer().is_some());
                linked += usize::from(lambda != 0);
            }
            None => assert_eq!(found.integer(), None, "touching: {a:?} and {b:?}"),
        }
    }
    (proven, linked)
}

/// A square about the z axis, and one through it.
pub fn hopf(scale: f64, offset: f64) -> [Vec<[f64; 3]>; 2] {
    let a = [[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]];
    let b = [[0, 0, -1], [0, 0, 1], [5, 0, 1], [5, 0, -1]];
    [a, b].map(|p| {
        let place = |x: i32| f64::from(x) * scale + offset;
        p.map(|p| p.map(place)).to_vec()
    })
}
