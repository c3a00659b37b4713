//! The kernel against the oracle, in all six directions; and the numbered properties of [`crate::kernels`].

use super::*;
use crate::curve::{Basis, Positions};
use crate::kernels::oracle;
use rayon::prelude::*;

/// A generator of polygons with a seed that is printed where a test fails.
struct Random(u64);

impl Random {
    fn next(&mut self, n: u64) -> i64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % n) as i64
    }
}

type Polygon = Vec<[i64; 3]>;

/// Linking number by the kernel, in one direction or in the one that it chooses. Coordinates are integers
/// times `scale`, a power of two.
fn kernel(a: &Polygon, b: &Polygon, scale: f64, fixed: Option<Direction>) -> Linking {
    let counts = [-(a.len() as i32), -(b.len() as i32)];
    let xyz: Vec<f64> = a
        .iter()
        .chain(b)
        .flatten()
        .map(|&x| x as f64 * scale)
        .collect();
    let narrow: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
    let exact = narrow.iter().zip(&xyz).all(|(&n, &w)| f64::from(n) == w);
    let positions = if exact {
        Positions::F32(&narrow)
    } else {
        Positions::F64(&xyz)
    };
    let set = CurveSet::from_counts(Basis::Polyline, &counts, positions).unwrap();
    let mut trees = Trees::default();
    trees.refit(&set);
    let scene = Scene {
        set: &set,
        trees: &trees,
        workspaces: &Workspaces::default(),
    };
    let (mut workspace, mut portable) = (Workspace::default(), Workspace::default());
    let found = linking_number(scene, (0, 1), fixed, &mut workspace);
    // With the processor's vector instructions and without, to the last count.
    assert_eq!(
        compute(Portable, scene, (0, 1), fixed, &mut portable),
        found
    );
    assert_eq!(portable.take_stats(), workspace.take_stats());
    found
}

/// Compares all six directions and the chosen one with the oracle; returns the number, or `None` on contact.
fn check(a: &Polygon, b: &Polygon, scale: f64) -> Option<i64> {
    let want = oracle::linking_number(a, b);
    for fixed in Direction::ALL.map(Some).into_iter().chain([None]) {
        match (kernel(a, b, scale, fixed), want) {
            (Linking::Number(n), Some(w)) if n == w => {}
            (Linking::Undefined(DefectKind::Contact, _), None) => {}
            (got, want) => panic!("{fixed:?}: {got:?}, oracle {want:?}\n{a:?}\n{b:?}"),
        }
    }
    want
}

#[derive(Default, Debug)]
struct Tally {
    links: usize,
    linked: usize,
    touching: usize,
    largest: i64,
}

impl Tally {
    fn add(&mut self, outcome: Option<i64>) {
        match outcome {
            None => self.touching += 1,
            Some(n) => {
                self.links += 1;
                self.linked += usize::from(n != 0);
                self.largest = self.largest.max(n.abs());
            }
        }
    }

    fn merge(&mut self, other: &Tally) {
        self.links += other.links;
        self.linked += other.linked;
        self.touching += other.touching;
        self.largest = self.largest.max(other.largest);
    }
}

/// A closed walk along the axes between points of a lattice; `shift` moves it off another one.
fn lattice_polygon(random: &mut Random, steps: usize, shift: i64) -> Polygon {
    let mut p = [0; 3].map(|_| 2 * random.next(4) + shift);
    let first = p;
    let mut out = vec![p];
    for _ in 0..steps {
        p[random.next(3) as usize] = 2 * random.next(4) + shift;
        out.push(p);
    }
    for x in 0..3 {
        p[x] = first[x];
        out.push(p);
    }
    out.pop();
    out
}

/// What kinds of random links there are, each with its outcomes.
#[derive(Default, Debug)]
struct Tallies {
    /// Far from degenerate, up to a few dozen vertices.
    generic: Tally,
    /// On a grid so small that nearly every determinant is zero in some direction.
    integer: Tally,
    /// Along the axes, on two lattices that miss one another.
    lattice: Tally,
    /// Along the axes, on one lattice: most of them touch.
    shared: Tally,
}

impl Tallies {
    fn merged(mut self, other: Tallies) -> Tallies {
        self.generic.merge(&other.generic);
        self.integer.merge(&other.integer);
        self.lattice.merge(&other.lattice);
        self.shared.merge(&other.shared);
        self
    }

    fn total(&self) -> Tally {
        let mut total = Tally::default();
        for part in [&self.generic, &self.integer, &self.lattice, &self.shared] {
            total.merge(part);
        }
        total
    }
}

/// Compares random links of one seed with the oracle: some 215 that do not touch, and 85 that do.
fn check_random_links(seed: u64) -> Tallies {
    // Neighbouring seeds are far apart; 0 would be a fixed point.
    let mut random = Random((seed + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let mut tallies = Tallies::default();
    let polygon = |random: &mut Random, n: usize, range: u64| -> Polygon {
        (0..n)
            .map(|_| [0; 3].map(|_: i64| random.next(range)))
            .collect()
    };
    for _ in 0..20 {
        let sizes = [3 + random.next(40) as usize, 3 + random.next(90) as usize];
        let [a, b] = sizes.map(|n| polygon(&mut random, n, 1 << 24));
        tallies.generic.add(check(&a, &b, 0.5f64.powi(24)));
    }
    for _ in 0..100 {
        let sizes = [3 + random.next(10) as usize, 3 + random.next(10) as usize];
        let [a, b] = sizes.map(|n| polygon(&mut random, n, 6));
        tallies.integer.add(check(&a, &b, 1.0));
    }
    for _ in 0..100 {
        let sizes = [4 + random.next(16) as usize, 4 + random.next(16) as usize];
        let a = lattice_polygon(&mut random, sizes[0], 0);
        let b = lattice_polygon(&mut random, sizes[1], 1);
        tallies.lattice.add(check(&a, &b, 0.125));
    }
    for _ in 0..80 {
        let sizes = [3 + random.next(4) as usize, 3 + random.next(4) as usize];
        let [a, b] = sizes.map(|n| lattice_polygon(&mut random, n, 0));
        tallies.shared.add(check(&a, &b, 1.0));
    }
    tallies
}

/// Compares at least `links` random links with the oracle. Stops at the first wrong one.
fn check_many_random_links(links: usize) {
    // More than a seed has without contact, to be sure; the tally counts.
    let seeds = links.div_ceil(200) as u64;
    let tallies = (0..seeds)
        .into_par_iter()
        .map(check_random_links)
        .reduce(Tallies::default, Tallies::merged);
    println!("{tallies:?}\nall: {:?}, none wrong", tallies.total());
    assert!(tallies.total().links >= links);
    let often = links / 50;
    assert!(tallies.generic.linked > often && tallies.lattice.linked > often);
    assert!(tallies.integer.linked > often / 10);
    assert!(tallies.integer.touching > often && tallies.shared.touching > often);
}

#[test]
fn random_polygons_equal_the_oracle_in_all_six_directions() {
    check_many_random_links(50_000);
}

/// The same and twenty times as long: about a minute on two cores.
#[test]
#[ignore = "a long run: cargo test --release a_million -- --ignored --nocapture"]
fn a_million_random_polygons_equal_the_oracle() {
    check_many_random_links(1_000_000);
}

/// A polygon around a circle, and one that winds `turns` times around it, on an integer grid.
fn winding(turns: i64, n: usize, phase: f64) -> [Polygon; 2] {
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

#[test]
fn windings_up_to_thirty_are_counted() {
    for turns in -30..=30 {
        let [a, b] = winding(turns, 512, 0.1 + turns as f64);
        let n = check(&a, &b, 0.5f64.powi(16)).expect("no contact");
        assert_eq!(n.abs(), turns.abs());
        assert_eq!(
            n.signum(),
            check(&winding(1, 512, 0.3)[0], &winding(1, 512, 0.3)[1], 1.0).unwrap()
                * turns.signum()
        );
    }
}

#[test]
fn a_generic_link_needs_no_exact_arithmetic_and_a_lattice_does() {
    let exact = |a: &Polygon, b: &Polygon| {
        let xyz: Vec<f64> = a.iter().chain(b).flatten().map(|&x| x as f64).collect();
        let counts = [-(a.len() as i32), -(b.len() as i32)];
        let set = CurveSet::from_counts(Basis::Polyline, &counts, Positions::F64(&xyz)).unwrap();
        let mut trees = Trees::default();
        trees.refit(&set);
        let mut workspace = Workspace::default();
        let scene = Scene {
            set: &set,
            trees: &trees,
            workspaces: &Workspaces::default(),
        };
        linking_number(scene, (0, 1), None, &mut workspace);
        workspace.take_stats().exact
    };
    let [a, b] = winding(7, 512, 0.1);
    assert_eq!(exact(&a, &b), 0);
    let mut random = Random(5);
    let lattices = (0..100).map(|_| {
        let [a, b] = [0, 0].map(|shift| lattice_polygon(&mut random, 12, shift));
        exact(&a, &b)
    });
    assert!(lattices.filter(|&n| n > 0).count() > 50);
}

/// Sizes that leave lanes of the last group empty: boxes with infinite bounds once overlapped those.
#[test]
fn far_and_tiny_scales_change_nothing() {
    for n in [56, 250] {
        let [a, b] = winding(5, n, 0.2);
        let want = check(&a, &b, 1.0);
        for power in [
            -1074 + 20,
            -900,
            -500,
            -300,
            -126,
            -40,
            0,
            40,
            100,
            110,
            127,
            140,
            300,
            900,
            1000,
        ] {
            // In two steps: the inverse of such a power may overflow.
            let scale = 2f64.powi(power / 2) * 2f64.powi(power - power / 2);
            assert_eq!(
                kernel(&a, &b, scale, None),
                Linking::Number(want.unwrap()),
                "{n}, scale 2^{power}"
            );
        }
    }
}

mod properties {
    use super::*;
    use proptest::prelude::*;

    fn polygon() -> impl Strategy<Value = Polygon> {
        prop_oneof![
            prop::collection::vec(prop::array::uniform3(0i64..1 << 20), 3..24),
            prop::collection::vec(prop::array::uniform3(0i64..8), 3..14),
        ]
    }

    fn number(a: &Polygon, b: &Polygon) -> Linking {
        match kernel(a, b, 1.0, None) {
            // Places differ with the order of the vertices; that there is contact does not.
            Linking::Undefined(kind, mut place) => {
                place.segments = [0, 0];
                place.point = [0.0; 3];
                place.distance = 0.0;
                Linking::Undefined(kind, place)
            }
            n => n,
        }
    }

    fn negated(l: Linking) -> Linking {
        match l {
            Linking::Number(n) => Linking::Number(-n),
            other => other,
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(600))]

        #[test]
        fn swapping_changes_nothing(a in polygon(), b in polygon()) {
            prop_assert_eq!(number(&a, &b), number(&b, &a));
        }

        #[test]
        fn reversal_changes_the_sign(a in polygon(), b in polygon()) {
            let reversed: Polygon = a.iter().rev().copied().collect();
            prop_assert_eq!(number(&reversed, &b), negated(number(&a, &b)));
        }

        #[test]
        fn cyclic_shifts_change_nothing(a in polygon(), b in polygon(), by in 0usize..24) {
            let mut shifted = a.clone();
            shifted.rotate_left(by % a.len());
            prop_assert_eq!(number(&shifted, &b), number(&a, &b));
        }

        /// Motions that are exact on the grid: translations and signed permutations of the axes.
        #[test]
        fn rigid_motions_change_nothing_and_mirrors_the_sign(
            a in polygon(), b in polygon(), t in prop::array::uniform3(-1000i64..1000), axes in 0usize..6, flips in 0u8..8
        ) {
            const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
            let order = ORDERS[axes];
            let mirrored = (axes >= 3) ^ (flips.count_ones() % 2 == 1);
            let moved = |v: &Polygon| -> Polygon {
                v.iter().map(|p| [0, 1, 2].map(|x| {
                    let y = p[order[x]];
                    t[x] + if flips >> x & 1 == 1 { -y } else { y }
                })).collect()
            };
            let want = number(&a, &b);
            let want = if mirrored { negated(want) } else { want };
            prop_assert_eq!(number(&moved(&a), &moved(&b)), want);
        }

        #[test]
        fn scaling_changes_nothing(a in polygon(), b in polygon(), factor in 1i64..1000) {
            let scaled = |v: &Polygon| -> Polygon { v.iter().map(|p| p.map(|x| x * factor)).collect() };
            prop_assert_eq!(number(&scaled(&a), &scaled(&b)), number(&a, &b));
        }

        #[test]
        fn inserted_vertices_change_nothing(a in polygon(), b in polygon(), at in 0usize..24, repeat in 0usize..3) {
            // Doubled coordinates, so that the middle of an edge is on the grid.
            let doubled = |v: &Polygon| -> Polygon { v.iter().map(|p| p.map(|x| 2 * x)).collect() };
            let (a, b) = (doubled(&a), doubled(&b));
            let k = at % a.len();
            let (p, q) = (a[k], a[(k + 1) % a.len()]);
            let mut longer = a.clone();
            longer.insert(k + 1, [0, 1, 2].map(|x| (p[x] + q[x]) / 2));
            for _ in 0..repeat {
                longer.insert(k, p);
            }
            prop_assert_eq!(number(&longer, &b), number(&a, &b));
        }

        #[test]
        fn zero_when_a_plane_separates(a in polygon(), b in polygon(), n in prop::array::uniform3(-3i64..=3)) {
            // Push b along n until the plane with that normal lies between.
            let along = |p: &[i64; 3]| (0..3).map(|x| n[x] * p[x]).sum::<i64>();
            let length_sq = along(&n);
            prop_assume!(length_sq > 0);
            let gap = a.iter().map(along).max().unwrap() - b.iter().map(along).min().unwrap();
            let by = gap.max(0) / length_sq + 1;
            let moved: Polygon = b.iter().map(|p| [0, 1, 2].map(|x| p[x] + by * n[x])).collect();
            prop_assert_eq!(kernel(&a, &moved, 1.0, None), Linking::Number(0));
        }
    }
}
