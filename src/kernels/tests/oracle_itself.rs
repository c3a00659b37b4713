//! Tests of the oracle itself.

use super::oracle::{edges, linking_number, touch};
use crate::curve::vector::{cross, dot, norm, sub};
use crate::random::Random;

const A: [[i64; 3]; 4] = [[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]];
const B: [[i64; 3]; 4] = [[0, 0, -1], [0, 0, 1], [5, 0, 1], [5, 0, -1]];

/// Returns Arai's sum (Arai 2013, Theorem 1): two arctangents for every pair of edges.
fn arai(a: &[[i64; 3]], b: &[[i64; 3]]) -> f64 {
    let mut sum = 0.0;
    for (l0, l1) in edges(a) {
        for (k0, k1) in edges(b) {
            let v = [sub(l0, k0), sub(l0, k1), sub(l1, k1), sub(l1, k0)];
            let v = v.map(|p| p.map(|x| x as f64));
            let n = v.map(norm);
            let p = dot(v[0], cross(v[1], v[2]));
            let angle = |k: usize| {
                let d = n[0] * n[k] * n[2]
                    + dot(v[0], v[k]) * n[2]
                    + dot(v[k], v[2]) * n[0]
                    + dot(v[2], v[0]) * n[k];
                p.atan2(d)
            };
            sum += angle(1) + angle(3);
        }
    }
    sum / std::f64::consts::TAU
}

#[test]
fn the_oracle_has_the_sign_of_arais_sum() {
    let want = arai(&A, &B);
    assert!((want.abs() - 1.0).abs() < 1e-9);
    assert_eq!(linking_number(&A, &B), Some(want.round() as i64));
    assert_eq!(linking_number(&B, &A), Some(want.round() as i64));
    let mut reversed = B;
    reversed.reverse();
    assert_eq!(linking_number(&A, &reversed), Some(-want.round() as i64));
}

#[test]
fn the_oracle_agrees_with_arais_sum_on_random_polygons() {
    let mut random = Random::new(1);
    let mut linked = 0;
    for _ in 0..500 {
        let (a, b) = (random.points(12, 1000), random.points(9, 1000));
        if let Some(n) = linking_number(&a, &b) {
            assert!((arai(&a, &b) - n as f64).abs() < 1e-6);
            linked += usize::from(n != 0);
        }
    }
    assert!(linked > 100);
}

#[test]
fn touching_polygons_have_no_linking_number() {
    let touching = [[2, 0, 0], [5, 0, 1], [5, 0, -1]];
    assert!(touch(&A, &touching));
    assert_eq!(linking_number(&A, &touching), None);
    assert!(
        touch(&A, &[[-1, -2, 0], [1, -2, 0], [0, -5, 0]]),
        "overlapping edges"
    );
    assert!(
        touch(&A, &[[2, 2, 0], [3, 3, 0], [3, 3, 9]]),
        "vertex on vertex"
    );
    assert!(!touch(&A, &[[3, 3, 0], [4, 4, 0], [4, 4, 9]]));
    assert!(
        !touch(&A, &[[3, -2, 0], [4, -2, 0], [4, -2, 9]]),
        "on one line, apart"
    );
    assert!(!touch(&A, &B));
}
