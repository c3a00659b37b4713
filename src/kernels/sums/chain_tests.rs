//! Gauss integrals in comparison to each other and to high-precision values.

use super::*;
use crate::curve::vector::per_axis;
use crate::random::Random;

fn random_walk(random: &mut Random, n: usize, step: f64) -> Vec<Point> {
    let mut at = random.point(0.3);
    (0..n)
        .map(|_| {
            let d = random.point(step);
            at = per_axis(|x| 0.8 * at[x] + d[x]);
            at
        })
        .collect()
}

fn torus_knot(n: usize, p: f64, q: f64) -> Vec<Point> {
    let vertex = |k: usize| {
        let t = k as f64 / n as f64 * std::f64::consts::TAU;
        let r = 0.6 + 0.2 * (q * t).cos();
        [r * (p * t).cos(), r * (p * t).sin(), 0.2 * (q * t).sin()]
    };
    (0..n).map(vertex).collect()
}

fn check(found: Estimate, enclosed: Interval, tolerance: f64) {
    let other = enclosed.estimate();
    assert!(
        (found.value - other.value).abs() <= found.bound + other.bound,
        "{found:?} {other:?}"
    );
    assert!(found.bound <= tolerance, "{found:?}");
}

#[test]
fn writhe_by_trees_agrees_with_intervals() {
    let mut random = Random::new(8);
    for n in [49, 50, 51, 52, 97, 200, 601] {
        for closed in [true, false] {
            for (points, tolerance) in [
                (random_walk(&mut random, n, 0.2), 1e-6),
                (torus_knot(n, 2.0, 5.0), 1e-7),
                (torus_knot(n, 2.0, 5.0), 1e-2),
            ] {
                let chain = Chain::new(points, closed);
                check(chain.writhe(tolerance), chain.enclose_writhe(), tolerance);
            }
        }
    }
}

/// Large enough for expansions of several orders, in trees of several levels.
#[test]
fn writhe_of_many_segments_agrees_with_intervals() {
    let mut random = Random::new(10);
    let mut at = [0.0; 3];
    let loose: Vec<Point> = (0..1800)
        .map(|_| {
            let d = random.point(0.02);
            at = per_axis(|x| (at[x] + d[x]).clamp(-0.9, 0.9));
            at
        })
        .collect();
    for points in [
        loose,
        torus_knot(1800, 2.0, 45.0),
        torus_knot(1801, 7.0, 12.0),
    ] {
        for closed in [true, false] {
            let chain = Chain::new(points.clone(), closed);
            let enclosed = chain.enclose_writhe();
            for tolerance in [1.0, 1e-2, 1e-4, 1e-6] {
                check(chain.writhe(tolerance), enclosed, tolerance);
            }
        }
    }
}

#[test]
fn linking_integrals_by_all_kernels_agree_with_intervals() {
    let mut random = Random::new(9);
    for (n, m) in [(2, 2), (2, 9), (33, 70), (300, 301)] {
        for closed in [[true, false], [false, false], [true, true]] {
            let [a, b] = [(n, closed[0]), (m, closed[1])]
                .map(|(n, closed)| Chain::new(random_walk(&mut random, n, 0.2), closed));
            let enclosed = a.enclose(&b);
            check(a.integral(&b, 1e-8), enclosed, 1e-8);
            check(b.integral(&a, 1e-8), enclosed, 1e-8);
            let both = [&a, &b].map(|chain| (&chain.points[..], chain.closed));
            for tolerance in [1e-2, 1e-6] {
                check(between(both, tolerance), enclosed, tolerance);
            }
        }
    }
}

#[test]
fn repeated_vertices_and_points_contribute_nothing() {
    let mut points = torus_knot(60, 2.0, 3.0);
    let expected = Chain::new(points.clone(), true).enclose_writhe();
    points.insert(7, points[7]);
    points.push(points[0]);
    check(
        Chain::new(points.clone(), true).writhe(1e-9),
        expected,
        1e-9,
    );
    let point = Chain::new(vec![[0.1; 3]; 5], true);
    assert_eq!(point.writhe(1e-9).value, 0.0);
    assert_eq!(Chain::new(points, true).integral(&point, 1e-9).value, 0.0);
}

#[test]
fn a_mirror_image_has_the_negative_writhe_and_a_plane_curve_none() {
    let points = torus_knot(300, 2.0, 3.0);
    let mirrored: Vec<Point> = points.iter().map(|&[x, y, z]| [x, y, -z]).collect();
    let flat: Vec<Point> = points.iter().map(|&[x, y, _]| [x, y, 0.0]).collect();
    let [a, b] = [points, mirrored].map(|p| Chain::new(p, true).writhe(1e-9));
    assert!((a.value + b.value).abs() <= a.bound + b.bound);
    assert!(a.value.abs() > 3.0, "{a:?}");
    // A trefoil that is projected to a plane meets itself three times.
    let flat = Chain::new(flat, true).writhe(1e-9);
    assert!(
        flat.value.abs() <= flat.bound && flat.bound >= 2.0,
        "{flat:?}"
    );
}

#[test]
fn curves_that_touch_are_undecided() {
    let [a, b] = [
        vec![[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]],
        vec![[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]],
    ]
    .map(|points| Chain::new(points, false));
    let found = a.integral(&b, 1e-9);
    assert!(
        found.bound >= 0.5 && found.admits(0.5) && found.admits(-0.5),
        "{found:?}"
    );
}
