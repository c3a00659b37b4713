//! The sums against the oracle and against constructions; the numbered properties of [`crate::kernels`]; what they cost.

use super::*;
use crate::curve::{Basis, Positions};
use crate::kernels::oracle;
use crate::scenes::Scene;
use std::time::Instant;

const FORMULAS: [Formula; 2] = [Formula::Arctangent, Formula::AngleSum];

pub(in crate::kernels) type Polygon = Vec<[i64; 3]>;

/// A generator of polygons.
pub(in crate::kernels) struct Random(pub u64);

impl Random {
    pub fn next(&mut self, n: u64) -> i64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % n) as i64
    }

    /// Up to `most` vertices in a cube of `size` points along each axis.
    pub fn polygon(&mut self, most: u64, size: u64) -> Polygon {
        let n = 3 + self.next(most - 2);
        (0..n).map(|_| [0; 3].map(|_| self.next(size))).collect()
    }
}

/// Two polygons, their coordinates times a scale; in single precision where that is asked for.
pub(in crate::kernels) fn set_of(a: &[[f64; 3]], b: &[[f64; 3]], single: bool) -> CurveSet {
    let counts = [-(a.len() as i32), -(b.len() as i32)];
    let xyz: Vec<f64> = a.iter().chain(b).flatten().copied().collect();
    let narrow: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
    let positions = match single {
        true => Positions::F32(&narrow),
        false => Positions::F64(&xyz),
    };
    CurveSet::from_counts(Basis::Polyline, &counts, positions).unwrap()
}

pub(in crate::kernels) fn floats(p: &Polygon, scale: f64) -> Vec<[f64; 3]> {
    p.iter().map(|p| p.map(|x| x as f64 * scale)).collect()
}

fn sums(set: &CurveSet) -> [Estimate; 2] {
    FORMULAS.map(|formula| Direct::new(set, formula).linking_number((0, 1)))
}

/// Asserts that both sums hold what they promise; returns by how many the integer is decided.
fn check(a: &[[f64; 3]], b: &[[f64; 3]], single: bool, want: Option<i64>) -> usize {
    let mut decided = 0;
    for found in sums(&set_of(a, b, single)) {
        let integer = found.integer();
        match want {
            Some(n) => {
                let off = (found.value - n as f64).abs();
                assert!(off <= found.bound, "{found:?}, {n}: {a:?} {b:?}");
                assert!(integer.is_none_or(|i| i == n));
            }
            None => {
                assert!(found.bound >= 0.5, "{found:?}: {a:?} {b:?}");
                assert_eq!(integer, None, "touching: {a:?} {b:?}");
            }
        }
        decided += usize::from(integer.is_some());
    }
    decided
}

/// Compares random polygons with the oracle: how many have a number, by how many sums it was decided, and how many
/// touch.
fn compare(seed: u64, pairs: usize, most: u64, size: u64, scale: f64) -> [usize; 3] {
    let mut random = Random(seed);
    let mut counts = [0; 3];
    for k in 0..pairs {
        let (a, b) = (random.polygon(most, size), random.polygon(most, size));
        let want = oracle::linking_number(&a, &b);
        let single = k % 2 == 0 && scale.log2().fract() == 0.0 && size <= 1 << 24;
        let decided = check(&floats(&a, scale), &floats(&b, scale), single, want);
        counts[0] += usize::from(want.is_some());
        counts[1] += decided;
        counts[2] += usize::from(want.is_none());
    }
    counts
}

#[test]
fn sums_are_within_their_bounds_of_the_oracle() {
    // In general position: all are decided.
    for (seed, size, scale) in [
        (1, 1000, 1.0),
        (2, 1 << 24, 2f64.powi(-40)),
        (3, 1 << 39, 2.0),
    ] {
        let [numbers, decided, touching] = compare(seed, 500, 20, size, scale);
        assert!(touching < 5);
        assert!(decided >= 2 * numbers - 2, "{decided} of {numbers}");
    }
    // On few points of a lattice: parallel, collinear, touching, repeated vertices.
    for (seed, size) in [(4, 3), (5, 5), (6, 9)] {
        let [numbers, decided, touching] = compare(seed, 1000, 7, size, 1.0);
        assert!(numbers > 50 && touching > 50, "{numbers} {touching}");
        assert!(decided > 2 * numbers * 9 / 10, "{decided} of {numbers}");
    }
}

#[test]
#[ignore = "half a minute"]
fn sums_are_within_their_bounds_of_the_oracle_a_hundred_thousand_times() {
    let rounds: Vec<(u64, u64, f64)> = (0..160u64)
        .map(|k| {
            (
                k + 100,
                [3, 5, 9, 20, 100, 1000, 1 << 20, 1 << 39][k as usize % 8],
                1.0,
            )
        })
        .collect();
    let counts: Vec<[usize; 3]> = rounds
        .into_par_iter()
        .map(|(seed, size, scale)| compare(seed, 1000, 12, size, scale))
        .collect();
    let total = |k: usize| counts.iter().map(|c| c[k]).sum::<usize>();
    println!(
        "{} numbers, {} decisions, {} touching",
        total(0),
        total(1),
        total(2)
    );
    assert!(total(0) > 80_000);
}

#[test]
fn scales_and_offsets_of_the_input_do_not_matter() {
    let mut random = Random(77);
    for k in 0..200 {
        let (a, b) = (random.polygon(12, 1 << 16), random.polygon(12, 1 << 16));
        let want = oracle::linking_number(&a, &b);
        for scale in [1e-6, 1e6, 1e-300, 1e300, 2f64.powi(-1060)] {
            // Coordinates round: not by enough to pull one through the other, in this many points.
            let round = |p: &Polygon| floats(p, scale);
            let decided = check(&round(&a), &round(&b), false, want);
            assert!(decided == 2 || want.is_none(), "{k}: {scale}");
        }
        // Exact at an offset of a million: these coordinates have 37 bits.
        let shifted = |p: &Polygon| {
            let shift = |p: [f64; 3]| p.map(|x| x + 1e6);
            floats(p, 2f64.powi(-16))
                .into_iter()
                .map(shift)
                .collect::<Vec<_>>()
        };
        let decided = check(&shifted(&a), &shifted(&b), false, want);
        assert!(decided == 2 || want.is_none());
    }
}

#[test]
fn scenes_have_the_numbers_of_their_constructions() {
    for text in [
        "ribbon:segments=1000,lambda=10",
        "ribbon:segments=5000,lambda=-33",
        "torus_link:segments=2000,toroidal=3,poloidal=-5",
        "woundball:segments=3001,crossings=100",
        "knit:rows=1,stitches=16,segments=128",
        "chainmail:rows=2,columns=3",
        "square_link:loops=6,segments=97",
        "rubber_bands:bands=10",
        "torus_zero:segments=2001,periods=2",
    ] {
        let scene: Scene = text.parse().unwrap();
        let built = scene.build().unwrap();
        if !built.curves.basis().is_polyline() {
            let direct = Direct::new(&built.curves, Formula::AngleSum);
            assert_eq!(direct.linking_number((0, 1)), Estimate::UNKNOWN);
            continue;
        }
        for formula in FORMULAS {
            let direct = Direct::new(&built.curves, formula);
            let n = built.curves.len() as u32;
            for pair in (0..n).flat_map(|i| (0..i).map(move |j| (j, i))) {
                let links = &built.certificate.links;
                let link = links.iter().find(|l| (l.i, l.j) == pair);
                let want = link.map_or(0, |l| l.lambda);
                let found = direct.linking_number(pair);
                assert!((found.value - want as f64).abs() <= found.bound, "{text}");
                assert_eq!(found.integer(), Some(want), "{text}: {found:?}");
                assert!(found.bound < 1e-6, "{text}: {found:?}");
            }
        }
    }
}

#[test]
fn curves_that_nearly_touch_are_right_or_undecided() {
    // A square, and a triangle that goes through it at a distance from an edge, a vertex or the middle of one.
    let square = [[-2., -2., 0.], [2., -2., 0.], [2., 2., 0.], [-2., 2., 0.]];
    let mut decided = 0;
    for size in [1.0, 1e-6, 1e6] {
        let square = square.map(|p| p.map(|x| x * size));
        for place in [[2.0, 0.3], [2.0, 2.0], [0.3, 2.0]] {
            for exponent in 1..60 {
                for side in [-1.0, 1.0] {
                    let gap = side * 0.5f64.powi(exponent);
                    let at = [place[0] + gap, place[1] + gap];
                    let through = [[at[0], at[1], -1.0], [at[0], at[1], 1.0], [9.0, 7.0, 0.5]];
                    let through = through.map(|p| p.map(|x| x * size));
                    // Where the gap is lost in rounding, the curves touch.
                    let inside = |x: usize| through[0][x].abs() < square[2][x];
                    let touching = (0..2).any(|x| through[0][x] == square[2][x])
                        && (0..2).all(|x| through[0][x] <= square[2][x]);
                    let want = match touching {
                        true => None,
                        false => Some(i64::from(inside(0) && inside(1))),
                    };
                    decided += check(&square, &through, false, want);
                }
            }
        }
    }
    assert!(decided > 3 * 3 * 40 * 2 * 2, "{decided}");
}

#[test]
fn touching_curves_have_no_integer() {
    let square = [[-2., -2., 0.], [2., -2., 0.], [2., 2., 0.], [-2., 2., 0.]];
    for other in [
        // Inside of an edge by a vertex, by an edge, vertex on vertex, along an edge, at an edge from aside.
        vec![[2.0, 0.3, 0.0], [5.0, 0.0, 1.0], [5.0, 1.0, -1.0]],
        vec![[2.0, 0.3, -1.0], [2.0, 0.3, 1.0], [7.0, 7.0, 0.0]],
        vec![[2.0, 2.0, 0.0], [3.0, 3.0, 1.0], [3.0, 2.0, 5.0]],
        vec![[2.0, -1.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 3.0]],
        vec![[1.0, 0.3, 0.0], [3.0, 0.3, 0.0], [0.0, 0.0, 3.0]],
    ] {
        check(&square, &other, false, None);
        check(&other, &square, true, None);
        check(&square, &square, true, None);
    }
}

#[test]
fn the_numbered_properties_hold() {
    let mut random = Random(9);
    for _ in 0..100 {
        let (a, b) = (random.polygon(80, 1000), random.polygon(150, 1000));
        let Some(want) = oracle::linking_number(&a, &b) else {
            continue;
        };
        let integer = |a: &Polygon, b: &Polygon| {
            let found = sums(&set_of(&floats(a, 1.0), &floats(b, 1.0), true));
            assert_eq!(found[0].integer(), found[1].integer());
            found[0].integer()
        };
        let with = |p: &Polygon, change: fn([i64; 3]) -> [i64; 3]| -> Polygon {
            p.iter().map(|&p| change(p)).collect()
        };
        assert_eq!(integer(&a, &b), Some(want), "7: the sign of the oracle");
        assert_eq!(integer(&b, &a), Some(want), "1: symmetry");
        let backwards: Polygon = b.iter().rev().copied().collect();
        assert_eq!(integer(&a, &backwards), Some(-want), "2: reversal");
        let mut shifted = b.clone();
        shifted.rotate_left(1);
        assert_eq!(integer(&a, &shifted), Some(want), "3: cyclic shifts");
        let turn = |[x, y, z]: [i64; 3]| [-4 * y + 7, 4 * x, 4 * z - 300];
        assert_eq!(
            integer(&with(&a, turn), &with(&b, turn)),
            Some(want),
            "4: motions"
        );
        let twice = |p: [i64; 3]| p.map(|x| 2 * x);
        let mut refined = with(&b, twice);
        refined.insert(1, [0, 1, 2].map(|x| b[0][x] + b[1][x]));
        refined.insert(1, [0, 1, 2].map(|x| 2 * b[0][x]));
        assert_eq!(
            integer(&with(&a, twice), &refined),
            Some(want),
            "5: inserted vertices"
        );
        let away = |[x, y, z]: [i64; 3]| [x, y, z + 1000];
        assert_eq!(integer(&a, &with(&b, away)), Some(0), "6: a plane between");
        let set = set_of(&floats(&a, 1.0), &floats(&b, 1.0), false);
        for formula in FORMULAS {
            let direct = Direct::new(&set, formula);
            let both = [(0, 1), (1, 0)].map(|pair| direct.linking_number(pair));
            assert_eq!(both[0], both[1], "1: symmetry, to the last bit");
            assert_eq!(direct.linking_number((0, 0)), Estimate::UNKNOWN);
            assert_eq!(direct.linking_number((0, 2)), Estimate::UNKNOWN);
        }
    }
}

#[test]
fn sums_have_the_same_bits_for_any_number_of_threads_and_bounds_hold_without_vectors() {
    let scene: Scene = "torus_link:segments=3000,toroidal=2,poloidal=3"
        .parse()
        .unwrap();
    let set = scene.build().unwrap().curves;
    let found = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| sums(&set).map(|e| [e.value.to_bits(), e.bound.to_bits()]))
    });
    assert_eq!(found[0], found[1]);
    let vertices = Vertices::new(&set);
    let (first, second) = (vertices.of(0).unwrap(), vertices.of(1).unwrap());
    for formula in FORMULAS {
        let (portable, avx2) = block::narrower(formula, first, second);
        let vectors = block::gauss_sum(formula, first, second);
        assert!(avx2.is_none_or(|found| found == vectors));
        assert_eq!(portable.integer(), Some(6), "{portable:?}");
        assert!((portable.value - vectors.value).abs() <= portable.bound + vectors.bound);
    }
}

#[test]
fn open_curves_and_splines_have_no_sum() {
    let xyz: Vec<f64> = (0..24).map(|k| f64::from(k * k % 11)).collect();
    for (basis, counts) in [(Basis::Polyline, [4, -4]), (Basis::CatmullRom, [-4, -4])] {
        let set = CurveSet::from_counts(basis, &counts, Positions::F64(&xyz)).unwrap();
        assert_eq!(sums(&set), [Estimate::UNKNOWN; 2]);
    }
}

/// Algorithm 7 of Qu & James 2021, without vectors and without a bound: what the sums are measured against.
fn published(rows: Strip<'_>, columns: Strip<'_>) -> f64 {
    let at = |v: Strip<'_>, k: usize| [v[0][k], v[1][k], v[2][k]];
    let minus = |p: [f64; 3], q: [f64; 3]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
    let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
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
            let (a, b, c, d) = (minus(l0, k0), minus(l0, k1), minus(l1, k1), minus(l1, k0));
            let [na, nb, nc, nd] = [a, b, c, d].map(|v| dot(v, v).sqrt());
            let cross = [
                b[1] * c[2] - b[2] * c[1],
                b[2] * c[0] - b[0] * c[2],
                b[0] * c[1] - b[1] * c[0],
            ];
            let p = dot(a, cross);
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
            "{n}: algorithm 7 {theirs:.1} ns a pair; arctangents {arctangent:.1} ({:.1}x), angle sum {product:.1} ({:.1}x)",
            theirs / arctangent,
            theirs / product
        );
    }
}
