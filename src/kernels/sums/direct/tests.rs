//! Tests with and without vector instructions; timings in comparison to the published algorithm.

use super::*;
use crate::curve::vector::{cross, dot, sub};
use crate::scenes::Scene;
use crate::simd::{Portable, dispatch};
use std::time::Instant;

const FORMULAS: [Formula; 2] = [Formula::Arctangent, Formula::AngleSum];

#[test]
fn bounds_hold_without_vectors() {
    let scene: Scene = "torus_link:segments=3000,toroidal=2,poloidal=3"
        .parse()
        .unwrap();
    let vertices = Vertices::new(&scene.build().unwrap().curves);
    let (first, second) = (vertices.of(0).unwrap(), vertices.of(1).unwrap());
    for formula in FORMULAS {
        let portable = block::sum_all(Portable, formula, first, second);
        let narrow = dispatch!(simd => block::sum_all(simd, formula, first, second));
        let vectors = block::gauss_sum(formula, first, second);
        assert!(narrow == vectors);
        assert_eq!(portable.integer(), Some(6), "{portable:?}");
        assert!((portable.value - vectors.value).abs() <= portable.bound + vectors.bound);
    }
}

/// Algorithm 7 of Qu & James 2021, without vectors and without a bound: the reference for timings.
fn published(rows: Strip<'_>, columns: Strip<'_>) -> f64 {
    let at = |v: Strip<'_>, k: usize| [v[0][k], v[1][k], v[2][k]];
    let side = |x: f64, y: f64| {
        if y > 0.0 || (y == 0.0 && x < 0.0) {
            1.0
        } else {
            -1.0
        }
    };
    let mut sum = 0.0;
    for i in 0..rows[0].len() - 1 {
        let (k0, k1) = (at(rows, i), at(rows, i + 1));
        let (mut xs, mut ys, mut last) = (1.0, 0.0, -1.0);
        for j in 0..columns[0].len() - 1 {
            let (l0, l1) = (at(columns, j), at(columns, j + 1));
            let (a, b, c, d) = (sub(l0, k0), sub(l0, k1), sub(l1, k1), sub(l1, k0));
            let [na, nb, nc, nd] = [a, b, c, d].map(|v| dot(v, v).sqrt());
            let p = dot(a, cross(b, c));
            let d1 = na * nb * nc + dot(a, b) * nc + dot(b, c) * na + dot(c, a) * nb;
            let d2 = na * nd * nc + dot(a, d) * nc + dot(d, c) * na + dot(c, a) * nd;
            let (x, y) = (d1 * d2 - p * p, p * (d1 + d2));
            if side(d1, p) * side(d2, p) > 0.0 && side(d1, p) * side(x, y) < 0.0 {
                sum += side(d1, p);
            }
            let (u, v) = (xs * x - ys * y, xs * y + ys * x);
            if side(x, y) * last > 0.0 && side(u, v) * last < 0.0 {
                sum += last;
            }
            last = side(u, v);
            let most = u.abs().max(v.abs());
            (xs, ys) = (u / most, v / most);
        }
        sum += ys.atan2(xs) / std::f64::consts::TAU;
    }
    sum
}

#[test]
#[ignore = "a measurement"]
fn measure_a_pair_of_segments() {
    let median = |times: &mut Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    for n in [100, 1000, 3000] {
        let text = format!("torus_link:segments={},toroidal=1,poloidal=1", 2 * n);
        let set = text.parse::<Scene>().unwrap().build().unwrap().curves;
        let vertices = Vertices::new(&set);
        let (first, second) = (vertices.of(0).unwrap(), vertices.of(1).unwrap());
        let mut times = [const { Vec::new() }; 3];
        for _ in 0..(100_000_000 / (n * n)).clamp(9, 99) {
            let start = Instant::now();
            std::hint::black_box(published(first, second));
            times[0].push(start.elapsed().as_nanos() as f64);
            for (k, formula) in FORMULAS.into_iter().enumerate() {
                let start = Instant::now();
                std::hint::black_box(block::gauss_sum(formula, first, second));
                times[k + 1].push(start.elapsed().as_nanos() as f64);
            }
        }
        let [theirs, arctangent, product] =
            times.each_mut().map(|times| median(times) / (n * n) as f64);
        println!(
            "{n}: algorithm 7 {theirs:.1} ns per pair; \
             arctangents {arctangent:.1} ({:.1}x), angle sum {product:.1} ({:.1}x)",
            theirs / arctangent,
            theirs / product
        );
    }
}
