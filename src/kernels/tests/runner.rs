//! Conformance checks, each for any kernel.

use super::oracle;
use super::polygons::{Polygon, exact_set_of, floats, set_of, winding};
use super::table::Kernel;
use crate::curve::vector::per_axis;
use crate::curve::{Basis, CurveSet, Positions};
use crate::kernels::{Device, Estimate, Method};
use crate::random::Random;
use crate::scenes::Scene;
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use rayon::prelude::*;
use std::ops::AddAssign;

/// Counts of the outcomes of a check.
#[derive(Clone, Copy, Debug, Default)]
struct Outcomes {
    /// Number of pairs that do not touch.
    numbers: usize,
    /// Number of those that the kernel decided.
    decided: usize,
    touching: usize,
    linked: usize,
}

impl AddAssign for Outcomes {
    fn add_assign(&mut self, other: Outcomes) {
        self.numbers += other.numbers;
        self.decided += other.decided;
        self.touching += other.touching;
        self.linked += other.linked;
    }
}

impl Outcomes {
    fn share(&self) -> f64 {
        self.decided as f64 / self.numbers.max(1) as f64
    }
}

/// Asserts the contract of a kernel for the first two curves: a value within its bound of the
/// linking number, no other integer, and no integer if they touch.
fn check(
    kernel: &Kernel,
    set: &CurveSet,
    want: Option<i64>,
    what: &dyn std::fmt::Debug,
) -> Outcomes {
    let found = kernel.estimate(set);
    let integer = found.integer();
    let method = kernel.method;
    if let Some(n) = want {
        let off = (found.value - n as f64).abs();
        assert!(
            off <= found.bound,
            "{method}: {found:?}, expected {n}: {what:?}"
        );
        assert!(
            integer.is_none_or(|i| i == n),
            "{method}: {found:?}, expected {n}: {what:?}"
        );
    } else {
        assert_eq!(
            integer, None,
            "{method}: {found:?}, expected no integer, because the curves touch: {what:?}"
        );
    }
    Outcomes {
        numbers: usize::from(want.is_some()),
        decided: usize::from(integer.is_some()),
        touching: usize::from(want.is_none()),
        linked: usize::from(want.is_some_and(|n| n != 0)),
    }
}

fn check_polygons(kernel: &Kernel, a: &Polygon, b: &Polygon, scale: f64) -> Outcomes {
    let want = oracle::linking_number(a, b);
    check(kernel, &exact_set_of(a, b, scale), want, &(a, b, scale))
}

/// Checks random polygons of three kinds: in general position, walks, and on so few points that
/// nearly every case is degenerate.
pub fn random_polygons(kernel: &Kernel, pairs: usize, seed: u64) {
    /// Number of pairs for each seed.
    const ROUND: usize = 50;
    let round = |k: usize| -> [Outcomes; 2] {
        let mut random = Random::new(seed + k as u64);
        let (mut general, mut lattice) = (Outcomes::default(), Outcomes::default());
        for n in 0..ROUND {
            match n % 4 {
                0 => {
                    let (size, scale) =
                        random.pick(&[(1 << 12, 1.0), (1 << 24, 2f64.powi(-24)), (1 << 39, 2.0)]);
                    let [a, b] = [0; 2].map(|_| random.polygon(20, size));
                    general += check_polygons(kernel, &a, &b, scale);
                }
                1 => {
                    let most = random.pick(&[6, 30, 120]);
                    let size = random.pick(&[1000, 1 << 20]);
                    let step = size / random.pick(&[1, 4, 16]);
                    let [a, b] = [0; 2].map(|_| {
                        let n = 3 + random.below(most);
                        random.walk(n, size, step)
                    });
                    general += check_polygons(kernel, &a, &b, 1.0);
                }
                2 => {
                    let size = random.pick(&[3, 5, 9]);
                    let [a, b] = [0; 2].map(|_| random.polygon(9, size));
                    lattice += check_polygons(kernel, &a, &b, 0.125);
                }
                _ => {
                    // On one lattice most of them touch; on two disjoint lattices none.
                    let shift = random.below(2);
                    let [a, b] = [0, shift].map(|s| {
                        let n = 4 + random.below(10);
                        random.lattice(n, s)
                    });
                    lattice += check_polygons(kernel, &a, &b, 1.0);
                }
            }
        }
        [general, lattice]
    };
    let rounds: Vec<[Outcomes; 2]> = (0..pairs.div_ceil(ROUND))
        .into_par_iter()
        .map(round)
        .collect();
    let [mut general, mut lattice] = [Outcomes::default(); 2];
    for [g, l] in rounds {
        general += g;
        lattice += l;
    }
    println!("general: {general:?}; lattice: {lattice:?}");
    assert!(general.linked * 10 > general.numbers && lattice.linked * 50 > lattice.numbers);
    assert!(lattice.touching * 10 > lattice.numbers);
    let tolerance = &kernel.tolerance;
    assert!(general.share() >= tolerance.general, "{general:?}");
    assert!(lattice.share() >= tolerance.lattice, "{lattice:?}");
}

/// Rigid motions of the grid: signed permutations of the axes, and translations.
#[derive(Clone, Copy, Debug)]
struct Motion {
    order: [usize; 3],
    signs: [i64; 3],
    by: [i64; 3],
}

impl Motion {
    fn is_mirror(&self) -> bool {
        let [i, j, k] = self.order;
        let even = (i + 1) % 3 == j && (j + 1) % 3 == k;
        even != (self.signs.iter().product::<i64>() == 1)
    }

    fn of(&self, p: &Polygon) -> Polygon {
        let place = |p: &[i64; 3]| per_axis(|x| self.signs[x] * p[self.order[x]] + self.by[x]);
        p.iter().map(place).collect()
    }
}

fn motion() -> impl Strategy<Value = Motion> {
    let orders = prop::sample::select(vec![
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
        [0, 2, 1],
        [2, 1, 0],
        [1, 0, 2],
    ]);
    let signs = prop::array::uniform3(prop::sample::select(vec![-1, 1]));
    let by = prop::array::uniform3(-1000i64..1000);
    (orders, signs, by).prop_map(|(order, signs, by)| Motion { order, signs, by })
}

fn polygon() -> impl Strategy<Value = Polygon> {
    prop_oneof![
        prop::collection::vec(prop::array::uniform3(0i64..1 << 20), 3..24),
        prop::collection::vec(prop::array::uniform3(0i64..8), 3..14),
    ]
}

/// Checks the properties by their numbers. 7 and 8 are part of every comparison with the oracle.
pub fn numbered_properties(kernel: &Kernel) {
    let cases = (kernel.tolerance.pairs / 10) as u32;
    // No regression file is written: a failure prints its input, shrunk.
    let config = Config {
        failure_persistence: None,
        ..Config::with_cases(cases)
    };
    let mut runner = TestRunner::new(config);
    let input = (polygon(), polygon(), motion(), 0usize..24, 1i64..1000);
    let run = runner.run(&input, |(a, b, motion, at, factor)| {
        let want = oracle::linking_number(&a, &b);
        let say = |property: &'static str, a: &Polygon, b: &Polygon, want: Option<i64>| {
            check(kernel, &exact_set_of(a, b, 1.0), want, &(property, a, b));
        };
        say("7: the sign of Arai's sum", &a, &b, want);
        say("1: symmetry", &b, &a, want);
        let reversed = |p: &Polygon| -> Polygon { p.iter().rev().copied().collect() };
        say("2: one reversed", &reversed(&a), &b, want.map(|n| -n));
        say("2: both reversed", &reversed(&a), &reversed(&b), want);
        let mut shifted = a.clone();
        shifted.rotate_left(at % a.len());
        say("3: cyclic shifts", &shifted, &b, want);
        let moved = if motion.is_mirror() {
            want.map(|n| -n)
        } else {
            want
        };
        say("4: motions", &motion.of(&a), &motion.of(&b), moved);
        let times =
            |p: &Polygon, f: i64| -> Polygon { p.iter().map(|p| p.map(|x| x * f)).collect() };
        say("4: scaling", &times(&a, factor), &times(&b, factor), want);
        // Doubled, so that the midpoint of an edge is on the grid.
        let (mut longer, other) = (times(&a, 2), times(&b, 2));
        let k = at % a.len();
        let (p, q) = (longer[k], longer[(k + 1) % a.len()]);
        longer.insert(k + 1, per_axis(|x| (p[x] + q[x]) / 2));
        longer.insert(k, p);
        say("5: vertices inserted, and repeated", &longer, &other, want);
        let along = |p: &[i64; 3]| (0..3).map(|x| motion.signs[x] * p[x]).sum::<i64>();
        let gap = a.iter().map(along).max().unwrap_or(0) - b.iter().map(along).min().unwrap_or(0);
        let by = gap.max(0) / 3 + 1;
        let push = |p: &[i64; 3]| per_axis(|x| p[x] + by * motion.signs[x]);
        let apart: Polygon = b.iter().map(push).collect();
        say("6: a plane between them", &a, &apart, Some(0));
        Ok(())
    });
    if let Err(e) = run {
        panic!("{e}");
    }
}

/// Checks scales over nearly the whole range of numbers, and a Hopf link at an offset of a million.
pub fn scales_and_offsets(kernel: &Kernel) {
    // So few segments that each kernel sums them exactly, then so many that trees have levels.
    for (turns, n) in [(2, 24), (5, 250)] {
        let [a, b] = winding(turns, n, 0.2);
        let want = oracle::linking_number(&a, &b);
        let mut decided = 0;
        let powers = [-1050, -900, -500, -126, -40, 0, 40, 110, 127, 300, 1000];
        for power in powers {
            // In two steps, because the inverse of such a power may overflow.
            let scale = 2f64.powi(power / 2) * 2f64.powi(power - power / 2);
            decided += check(kernel, &exact_set_of(&a, &b, scale), want, &power).decided;
        }
        for scale in [1e-6, 1e6, 1e-300, 1e300] {
            // Coordinates are rounded, but not by enough to pull one curve through the other.
            let set = set_of(&floats(&a, scale), &floats(&b, scale), false);
            decided += check(kernel, &set, want, &scale).decided;
        }
        let away = |p: &Polygon| -> Vec<[f64; 3]> {
            let shift = |p: [f64; 3]| p.map(|x| x + 1e6);
            floats(p, 2f64.powi(-16)).into_iter().map(shift).collect()
        };
        decided += check(
            kernel,
            &set_of(&away(&a), &away(&b), false),
            want,
            &"offset",
        )
        .decided;
        let asked = kernel.tolerance.smooth * (powers.len() + 5) as f64;
        assert!(decided as f64 >= asked.floor(), "{decided} of {asked}");
    }
}

/// Checks scenes of several curves, with all of their pairs in one call.
pub fn scenes(kernel: &Kernel) {
    let all = [
        "ribbon:segments=1000,lambda=10",
        "ribbon:segments=5000,lambda=-33",
        "torus_link:segments=2000,toroidal=3,poloidal=-5",
        "woundball:segments=3001,crossings=20",
        "chainmail:rows=2,columns=3",
        "square_link:loops=6,segments=97",
        "torus_zero:segments=2001,periods=2",
    ];
    let (mut pairs, mut decided) = (0, 0);
    for text in all {
        let built = text
            .parse::<Scene>()
            .expect("a scene")
            .build()
            .expect("built");
        let set = &built.curves;
        assert!(set.basis().is_polyline());
        if kernel.method == Method::Interval && set.segments() > 2500 {
            continue;
        }
        let n = set.len() as u32;
        let all: Vec<_> = (0..n).flat_map(|j| (0..j).map(move |i| (i, j))).collect();
        for (&pair, found) in all.iter().zip(kernel.estimates(set, &all)) {
            let links = &built.certificate.links;
            let link = links.iter().find(|l| (l.i, l.j) == pair);
            let want = link.map_or(0, |l| l.lambda);
            let off = (found.value - want as f64).abs();
            assert!(
                off <= found.bound,
                "{text} {pair:?}: {found:?}, expected {want}"
            );
            let integer = found.integer();
            assert!(
                integer.is_none_or(|n| n == want),
                "{text} {pair:?}: {found:?}"
            );
            assert!(
                integer.is_none() || found.bound <= kernel.tolerance.bound,
                "{text}: {found:?}"
            );
            pairs += 1;
            decided += usize::from(integer.is_some());
        }
    }
    let share = decided as f64 / pairs as f64;
    assert!(share >= kernel.tolerance.smooth, "{decided} of {pairs}");
}

const SQUARE: [[f64; 3]; 4] = [[-2., -2., 0.], [2., -2., 0.], [2., 2., 0.], [-2., 2., 0.]];

/// Checks contact of every kind.
pub fn contact(kernel: &Kernel) {
    let others: [&[[f64; 3]]; 7] = [
        // A vertex on an edge, an edge through an edge, vertex on vertex, overlapping edges,
        // collinear edges, an edge that touches from the side.
        &[[2.0, 0.3, 0.0], [5.0, 0.0, 1.0], [5.0, 1.0, -1.0]],
        &[[2.0, 0.3, -1.0], [2.0, 0.3, 1.0], [7.0, 7.0, 0.0]],
        &[[2.0, 2.0, 0.0], [3.0, 3.0, 1.0], [3.0, 2.0, 5.0]],
        &[[2.0, -1.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 3.0]],
        &[[-1.0, -2.0, 0.0], [1.0, -2.0, 0.0], [0.0, -5.0, 1.0]],
        &[[1.0, 0.3, 0.0], [3.0, 0.3, 0.0], [0.0, 0.0, 3.0]],
        &SQUARE,
    ];
    for other in others {
        for scale in [1.0, 1e-3, 2f64.powi(-1000)] {
            let times =
                |p: &[[f64; 3]]| -> Vec<_> { p.iter().map(|p| p.map(|x| x * scale)).collect() };
            let (square, other) = (times(&SQUARE), times(other));
            check(kernel, &set_of(&square, &other, false), None, &other);
            check(kernel, &set_of(&other, &square, false), None, &other);
        }
    }
}

/// Checks a square, and a triangle through it at a small distance from an edge, a vertex or the
/// midpoint of an edge.
pub fn near_contact(kernel: &Kernel) {
    let (mut numbers, mut decided) = (0, 0);
    // On an adapter the round trip takes longer than any of these pairs, so fewer are tested.
    let step = if kernel.device == Device::Cpu { 1 } else { 5 };
    for size in [1.0, 1e-6, 1e6] {
        let square = SQUARE.map(|p| p.map(|x| x * size));
        for place in [[2.0, 0.3], [2.0, 2.0], [0.3, 2.0]] {
            for exponent in (1..60).step_by(step) {
                for side in [-1.0, 1.0] {
                    let gap = side * 0.5f64.powi(exponent);
                    let at = [place[0] + gap, place[1] + gap];
                    let through = [[at[0], at[1], -1.0], [at[0], at[1], 1.0], [9.0, 7.0, 0.5]];
                    let through = through.map(|p| p.map(|x| x * size));
                    // If rounding removes the gap, the curves touch.
                    let inside = |x: usize| through[0][x].abs() < square[2][x];
                    let touching = (0..2).any(|x| through[0][x] == square[2][x])
                        && (0..2).all(|x| through[0][x] <= square[2][x]);
                    let want = match touching {
                        true => None,
                        false => Some(i64::from(inside(0) && inside(1))),
                    };
                    let set = set_of(&square, &through, false);
                    let outcomes = check(kernel, &set, want, &through);
                    numbers += outcomes.numbers;
                    decided += outcomes.decided;
                }
            }
        }
    }
    let share = decided as f64 / numbers as f64;
    assert!(share > kernel.tolerance.close, "{decided} of {numbers}");
}

/// Checks long curves, which are split into parallel tasks, with several numbers of threads.
pub fn threads(kernel: &Kernel) {
    let segments = if kernel.method == Method::Interval {
        1000
    } else {
        6000
    };
    let text = format!("torus_link:segments={segments},toroidal=2,poloidal=3");
    let set = text
        .parse::<Scene>()
        .expect("a scene")
        .build()
        .expect("built")
        .curves;
    let found = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pairs = [(0, 1), (1, 0)];
        let found = pool
            .expect("threads")
            .install(|| kernel.estimates(&set, &pairs));
        found
            .into_iter()
            .map(|e| [e.value.to_bits(), e.bound.to_bits()])
            .collect::<Vec<_>>()
    });
    assert_eq!(found[0], found[1]);
}

/// Checks open curves, splines, a curve paired with itself, and curves that do not exist. Crossings
/// are counted for splines too, and callers of the counting kernel skip the other cases.
pub fn other_curves(kernel: &Kernel) {
    if kernel.method == Method::Crossings {
        return;
    }
    let xyz: Vec<f64> = (0..24).map(|k| f64::from(k * k % 11)).collect();
    for (basis, counts) in [
        (Basis::Polyline, [4, -4]),
        (Basis::Polyline, [-4, 4]),
        (Basis::CatmullRom, [-4, -4]),
        (Basis::BSpline, [-4, -4]),
    ] {
        let set = CurveSet::from_counts(basis, &counts, Positions::F64(&xyz)).expect("finite");
        assert_eq!(
            kernel.estimate(&set),
            Estimate::UNKNOWN,
            "{basis:?} {counts:?}"
        );
    }
    let set = set_of(&SQUARE, &SQUARE.map(|[x, y, z]| [x, z, y]), false);
    for found in kernel.estimates(&set, &[(0, 0), (0, 2), (2, 0)]) {
        assert_eq!(found.integer(), None);
    }
}
