//! Floating point at its limits: gaps, offsets and scales.

use crate::case::{Answer, Case, Expected, Loop, Polygon};
use crate::links::hopf_polygons;
use crate::support::random::Random;
use linkwatch::Point;

pub fn cases() -> Vec<Case> {
    let mut cases = far_away();
    cases.extend(gaps());
    cases.extend(sheared_gaps());
    cases.extend(scales());
    cases.extend(monotone());
    cases.extend([tiny_through_huge(), tiny_beside_huge()]);
    cases
}

/// A square of half-width 1 in the xy plane, and a loop that passes upwards at `x` and downwards at
/// 3.
fn gate(x: f64) -> Vec<Loop> {
    let square = vec![
        [-1.0, -1.0, 0.0],
        [1.0, -1.0, 0.0],
        [1.0, 1.0, 0.0],
        [-1.0, 1.0, 0.0],
    ];
    let gate = vec![
        [x, 0.0, -1.0],
        [x, 0.0, 1.0],
        [3.0, 0.0, 1.0],
        [3.0, 0.0, -1.0],
    ];
    vec![square, gate]
}

/// Gaps from 0.1 down to one unit in the last place, on both sides of an edge: linked inside the
/// square, unlinked outside.
fn gaps() -> Vec<Case> {
    let gaps = (1..16).map(|k| 10f64.powi(-k));
    let ulps = [1.0, 2.0, 3.0, 5.0];
    let single = ulps.map(|n| n * f64::from(f32::EPSILON));
    let double = ulps.map(|n| n * f64::EPSILON);
    let all = gaps.chain(single).chain(double);
    let case = |gap: f64| {
        let (inside, outside) = (1.0 - gap, 1.0 + gap);
        assert!(inside < 1.0 && outside > 1.0);
        let linked = Expected::pair(Answer::Number(1));
        [
            Case::built(format!("{gap:e} inside"), &gate(inside), linked),
            Case::built(
                format!("{gap:e} outside"),
                &gate(outside),
                Expected::unlinked(),
            ),
        ]
    };
    all.flat_map(case).collect()
}

/// Gaps from a tenth of a square down to one unit of its integer coordinates. An exact linear map
/// of determinant 1 leaves no edge parallel to an axis. Linked, touching and unlinked pairs.
fn sheared_gaps() -> Vec<Case> {
    let mut cases = Vec::new();
    for bits in [20, 36] {
        let half = 1i64 << bits;
        let gaps = (0..bits - 2).step_by(3).map(|k| 1i64 << k);
        for gap in gaps.flat_map(|g| [g, -g]).chain([0]) {
            let x = half + gap;
            let square = vec![
                [-half, -half, 0],
                [half, -half, 0],
                [half, half, 0],
                [-half, half, 0],
            ];
            let gate = vec![
                [x, 3, -half],
                [x, 3, half],
                [2 * half, 3, half],
                [2 * half, 3, -half],
            ];
            let shear = |[x, y, z]: [i64; 3]| {
                let (y, z) = (y + x, z + 2 * x);
                [x + y + z, y + z, z].map(|v| v as f64)
            };
            let name = format!("sheared gap of {gap} at 2^{bits}");
            cases.push(Case::mapped(name, &[square, gate], shear));
        }
    }
    cases
}

/// A small link far from the origin: coordinates keep few bits of its shape, and differences
/// cancel.
fn far_away() -> Vec<Case> {
    let offset = |step: f64, offset: Point| {
        move |p: [i64; 3]| std::array::from_fn(|x| offset[x] + step * p[x] as f64)
    };
    let mut random = Random::new(1);
    let polygons = [12, 9, 20].map(|n| random.polygon(n, 12));
    // Units in the last place of 1e6, in single and in double precision.
    let [single, double] = [1.0 / 16.0, 2f64.powi(-33)];
    vec![
        Case::mapped(
            "Hopf link at 1e6 in single precision",
            &hopf_polygons(1),
            offset(single, [1e6; 3]),
        ),
        Case::mapped(
            "Hopf link at 1e6 in double precision",
            &hopf_polygons(-1),
            offset(double, [1e6; 3]),
        ),
        Case::mapped(
            "polygons at 1e6 in single precision",
            &polygons,
            offset(single, [1e6, -1e6, 9e5]),
        ),
        Case::mapped(
            "polygons at 1e6 in double precision",
            &polygons,
            offset(double, [1e6, -1e6, 9e5]),
        ),
    ]
}

/// Random polygons multiplied by powers of two: determinants overflow, underflow or both, except in
/// exact arithmetic.
fn scales() -> Vec<Case> {
    let mut random = Random::new(2);
    let polygons = [5, 9, 14, 20].map(|n| random.polygon(n, 30));
    let scaled = |exponents: [i32; 3]| {
        let name = format!("times 2^{exponents:?}");
        let factors = exponents.map(|e| 2f64.powi(e / 2) * 2f64.powi(e - e / 2));
        Case::mapped(name, &polygons, |p| {
            std::array::from_fn(|x| p[x] as f64 * factors[x])
        })
    };
    let mut exponents: Vec<[i32; 3]> = [
        -1074, -997, -400, -149, -60, -20, 20, 60, 119, 400, 997, 1019,
    ]
    .map(|e| [e; 3])
    .into();
    exponents.extend([
        [-1074, 1019, 0],
        [-149, 119, 0],
        [400, -400, 1],
        [997, 997, -997],
    ]);
    exponents.into_iter().map(scaled).collect()
}

/// Axis-aligned polygons whose coordinates are replaced, axis by axis, by others in the same order.
/// This is an isotopy, and exact for any coordinates.
fn monotone() -> Vec<Case> {
    const SIZE: usize = 16;
    type Table = [f64; SIZE];
    let table = |f: &dyn Fn(i32) -> f64| -> Table { std::array::from_fn(|k| f(k as i32 - 8)) };
    let after =
        |start: f64| table(&|k| f64::from_bits((start.to_bits() as i64 + i64::from(k)) as u64));
    let single =
        |start: f32| table(&|k| f64::from(f32::from_bits((start.to_bits() as i32 + k) as u32)));
    let signed = |f: &dyn Fn(i32) -> f64| table(&|k| f(k.abs()) * f64::from(k.signum()));
    let tables: Vec<(&str, [Table; 3])> = vec![
        ("neighbours of 1", [after(1.0); 3]),
        ("single neighbours of 1", [single(1.0); 3]),
        ("single neighbours of 1e6", [single(1e6); 3]),
        (
            "subnormal",
            [table(&|k| f64::from(k) * f64::from_bits(1)); 3],
        ),
        (
            "single subnormal",
            [table(&|k| f64::from(k) * f64::from(f32::from_bits(1))); 3],
        ),
        ("about the least normal", [after(f64::MIN_POSITIVE); 3]),
        ("times 1e-6", [table(&|k| f64::from(k) * 1e-6); 3]),
        ("times 1e6", [table(&|k| f64::from(k) * 1e6); 3]),
        ("times 1e-300", [table(&|k| f64::from(k) * 1e-300); 3]),
        ("times 1e300", [table(&|k| f64::from(k) * 1e300); 3]),
        (
            "the whole range",
            [table(&|k| f64::from(k) / 8.0 * f64::MAX); 3],
        ),
        (
            "the whole single range",
            [table(&|k| f64::from(k) / 8.0 * f64::from(f32::MAX)); 3],
        ),
        ("powers of 1e37", [signed(&|k| 1e37f64.powi(k)); 3]),
        ("powers of 1e-37", [signed(&|k| 1e37f64.powi(k - 8)); 3]),
        ("powers of 1e4", [signed(&|k| f64::from(1e4f32.powi(k))); 3]),
        (
            "gaps of all sizes",
            [signed(&|k| 1.0 + 10f64.powi(k - 17)); 3],
        ),
        (
            "an axis each",
            [
                after(1.0),
                signed(&|k| 1e37f64.powi(k)),
                table(&|k| f64::from(k) * f64::from_bits(1)),
            ],
        ),
    ];
    let mut random = Random::new(3);
    let polygons: Vec<Polygon> = (0..8)
        .map(|k| random.along_axes(6 + 3 * k, SIZE as i64))
        .collect();
    let case = |(name, tables): (&str, [Table; 3])| {
        assert!(
            tables.iter().all(|t| t.is_sorted_by(|a, b| a < b)),
            "{name}"
        );
        Case::mapped(name, &polygons, |p| {
            std::array::from_fn(|x| tables[x][p[x] as usize])
        })
    };
    tables.into_iter().map(case).collect()
}

/// A loop of size 1e-30 around an edge of a loop of size 1e30: their boxes share only a tiny
/// region.
fn tiny_through_huge() -> Case {
    let (s, h) = (1e-30, 1e30);
    let tiny = vec![[-s, -s, 0.0], [s, -s, 0.0], [s, s, 0.0], [-s, s, 0.0]];
    let huge = vec![[0.0, 0.0, -h], [0.0, 0.0, h], [h, 0.0, h], [h, 0.0, -h]];
    Case::built(
        "tiny around huge",
        &[tiny, huge],
        Expected::pair(Answer::Number(1)),
    )
}

/// The same, with the edge outside the tiny loop by less than its size, in a skew direction.
fn tiny_beside_huge() -> Case {
    let (s, h) = (2f64.powi(-100), 2f64.powi(100));
    let tiny = vec![[-s, -s, 0.0], [s, -s, 0.0], [s, s, 0.0], [-s, s, 0.0]];
    // The edge meets the plane of the tiny loop at x = 1.5 s.
    let x = 1.5 * s;
    let huge = vec![[x, -h, -h], [x, h, h], [h, h, h], [h, -h, -h]];
    Case::built("tiny beside huge", &[tiny, huge], Expected::unlinked())
}
