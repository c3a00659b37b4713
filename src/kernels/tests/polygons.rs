//! Random polygons on integer grids, on which the oracle is exact.

use crate::curve::{Basis, CurveSet, Positions};
use crate::kernels::Estimate;
use crate::random::Random;
use crate::scenes::Scene;
use std::fmt::Display;

/// Vertices of a closed polygon.
pub type Polygon = Vec<[i64; 3]>;

/// Random polygons.
impl Random {
    /// Returns `n` vertices anywhere in a cube of `size` points along each axis.
    pub fn points(&mut self, n: usize, size: i64) -> Polygon {
        (0..n).map(|_| [(); 3].map(|()| self.below(size))).collect()
    }

    /// Returns 3 to `most` vertices anywhere in such a cube.
    pub fn polygon(&mut self, most: usize, size: i64) -> Polygon {
        let n = 3 + self.below(most - 2);
        self.points(n, size)
    }

    /// Returns a closed walk along the axes between points of a lattice. `shift` moves it to a
    /// disjoint lattice.
    pub fn lattice(&mut self, steps: usize, shift: i64) -> Polygon {
        let mut p = [0; 3].map(|_| 2 * self.below(4) + shift);
        let first = p;
        let mut out = vec![p];
        for _ in 0..steps {
            p[self.below(3)] = 2 * self.below(4) + shift;
            out.push(p);
        }
        for x in 0..3 {
            p[x] = first[x];
            out.push(p);
        }
        out.pop();
        out
    }

    /// Returns a random walk in a cube. Neighbours along the polygon are near one another, as on a
    /// yarn.
    pub fn walk(&mut self, n: usize, size: i64, step: i64) -> Polygon {
        let mut at = [(); 3].map(|()| self.below(size));
        (0..n)
            .map(|_| {
                at = at.map(|x| (x + self.below(2 * step + 1) - step).clamp(0, size));
                at
            })
            .collect()
    }
}

/// Returns a polygon around a circle, and one that winds `turns` times around it.
pub fn winding(turns: i64, n: usize, phase: f64) -> [Polygon; 2] {
    let grid = |p: [f64; 3]| p.map(|x| (x * 65536.0).round() as i64);
    let angle = |k: usize| k as f64 / n as f64 * std::f64::consts::TAU;
    let core = (0..n / 8).map(|k| {
        let t = angle(8 * k);
        grid([t.cos(), t.sin(), 0.0])
    });
    let around = (0..n).map(|k| {
        let (t, s) = (angle(k), angle(k) * turns as f64 + phase);
        let r = 1.0 + 0.3 * s.cos();
        grid([r * t.cos(), r * t.sin(), 0.3 * s.sin()])
    });
    [core.collect(), around.collect()]
}

/// Returns the vertices multiplied by `scale`.
pub fn floats(p: &Polygon, scale: f64) -> Vec<[f64; 3]> {
    p.iter().map(|p| p.map(|x| x as f64 * scale)).collect()
}

/// Returns a set of two closed polylines, in single precision if `single`.
pub fn set_of(a: &[[f64; 3]], b: &[[f64; 3]], single: bool) -> CurveSet {
    let counts = [a, b].map(|c| -(c.len() as i32));
    let xyz: Vec<f64> = a.iter().chain(b).flatten().copied().collect();
    let narrow: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
    let positions = match single {
        true => Positions::F32(&narrow),
        false => Positions::F64(&xyz),
    };
    CurveSet::from_counts(Basis::Polyline, &counts, positions).expect("finite")
}

/// Returns a set of two closed polylines, in the lowest precision that is exact.
pub fn exact_set_of(a: &Polygon, b: &Polygon, scale: f64) -> CurveSet {
    let [a, b] = [a, b].map(|p| floats(p, scale));
    let fits = |x: &f64| f64::from(*x as f32) == *x;
    let single = a.iter().chain(&b).flatten().all(fits);
    set_of(&a, &b, single)
}

/// Returns a set of closed polylines with these vertices.
pub fn polylines(curves: &[&[[f64; 3]]]) -> CurveSet {
    let counts: Vec<i32> = curves.iter().map(|c| -(c.len() as i32)).collect();
    let flat: Vec<f64> = curves
        .iter()
        .copied()
        .flatten()
        .flatten()
        .copied()
        .collect();
    CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&flat)).expect("finite")
}

/// Scenes for kernels with bounds.
pub const SCENES: [&str; 4] = [
    "ribbon:segments=2000,lambda=10",
    "woundball:segments=4000,crossings=20",
    "torus_link:segments=4000,toroidal=10,poloidal=20",
    "torus_zero:segments=16000,periods=20",
];

/// Scenes that take minutes.
pub const LONG_RIBBONS: [&str; 2] = [
    "ribbon:segments=20000,lambda=-100",
    "ribbon:segments=60000,lambda=1000",
];

/// Returns the curves of a scene, and the linking number of the first pair.
pub fn scene(text: &str) -> (CurveSet, i64) {
    let generated = text
        .parse::<Scene>()
        .expect("a scene")
        .build()
        .expect("built");
    let lambda = generated.certificate.links.first().map_or(0, |l| l.lambda);
    (generated.curves, lambda)
}

/// Asserts that the bound covers the error, and that no other integer is returned.
pub fn check(found: Estimate, lambda: i64, what: &dyn Display) {
    let off = (found.value - lambda as f64).abs();
    assert!(off <= found.bound, "{what}: {found:?}, expected {lambda}");
    let integer = found.integer();
    assert!(integer.is_none_or(|n| n == lambda), "{what}: {found:?}");
}

/// Returns a square around the z axis, and one that passes through it.
pub fn hopf(scale: f64, offset: f64) -> [Vec<[f64; 3]>; 2] {
    let a = [[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]];
    let b = [[0, 0, -1], [0, 0, 1], [5, 0, 1], [5, 0, -1]];
    [a, b].map(|p| {
        let place = |x: i32| f64::from(x) * scale + offset;
        p.map(|p| p.map(place)).to_vec()
    })
}
