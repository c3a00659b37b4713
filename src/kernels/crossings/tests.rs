//! Tests of the kernel against the oracle, in all six directions, with vector instructions and
//! without.

use super::*;
use crate::curve::{Basis, Positions};
use crate::kernels::tests::oracle;
use crate::kernels::tests::polygons::{Polygon, exact_set_of, floats, set_of, winding};
use crate::pairs::{LinkSearch, degenerate_curves};
use crate::random::Random;
use crate::simd::Portable;
use rayon::prelude::*;

/// Returns the linking number by the kernel, in one direction or in the one that it chooses.
/// Coordinates are integers times `scale`, a power of two.
fn kernel(a: &Polygon, b: &Polygon, scale: f64, fixed: Option<Direction>) -> Linking {
    let set = exact_set_of(a, b, scale);
    let mut trees = Trees::default();
    trees.refit(&set);
    let input = Input {
        set: &set,
        trees: &trees,
        workspaces: &Workspaces::default(),
    };
    let (mut workspace, mut portable) = (Workspace::default(), Workspace::default());
    let found = linking_number(input, (0, 1), fixed, &mut workspace);
    // With vector instructions and without: all results and counters are equal.
    assert_eq!(
        compute(Portable, input, (0, 1), fixed, &mut portable),
        found
    );
    assert_eq!(portable.take_stats(), workspace.take_stats());
    found
}

/// Compares all six directions and the chosen one with the oracle. Returns the linking number, or
/// `None` on contact.
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
struct Outcomes {
    links: usize,
    linked: usize,
    touching: usize,
    largest: i64,
}

impl Outcomes {
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

    fn merge(&mut self, other: &Outcomes) {
        self.links += other.links;
        self.linked += other.linked;
        self.touching += other.touching;
        self.largest = self.largest.max(other.largest);
    }
}

/// Kinds of random links, and the numbers of outcomes of each.
#[derive(Default, Debug)]
struct KindOutcomes {
    /// Few degeneracies, and up to a few dozen vertices.
    generic: Outcomes,
    /// On a grid so small that nearly every determinant is zero in some direction.
    integer: Outcomes,
    /// Along the axes, on two disjoint lattices.
    lattice: Outcomes,
    /// Along the axes, on one lattice: most of them touch.
    shared: Outcomes,
}

impl KindOutcomes {
    fn merged(mut self, other: KindOutcomes) -> KindOutcomes {
        self.generic.merge(&other.generic);
        self.integer.merge(&other.integer);
        self.lattice.merge(&other.lattice);
        self.shared.merge(&other.shared);
        self
    }

    fn total(&self) -> Outcomes {
        let mut total = Outcomes::default();
        for part in [&self.generic, &self.integer, &self.lattice, &self.shared] {
            total.merge(part);
        }
        total
    }
}

/// Compares random links of one seed with the oracle: some 215 that do not touch, and 85 that do.
fn check_random_links(seed: u64) -> KindOutcomes {
    let mut random = Random::new(seed);
    let mut outcomes = KindOutcomes::default();
    for _ in 0..20 {
        let sizes = [3 + random.below(40), 3 + random.below(90)];
        let [a, b] = sizes.map(|n| random.points(n, 1 << 24));
        outcomes.generic.add(check(&a, &b, 0.5f64.powi(24)));
    }
    for _ in 0..100 {
        let sizes = [3 + random.below(10), 3 + random.below(10)];
        let [a, b] = sizes.map(|n| random.points(n, 6));
        outcomes.integer.add(check(&a, &b, 1.0));
    }
    for _ in 0..100 {
        let sizes = [4 + random.below(16), 4 + random.below(16)];
        let a = random.lattice(sizes[0], 0);
        let b = random.lattice(sizes[1], 1);
        outcomes.lattice.add(check(&a, &b, 0.125));
    }
    for _ in 0..80 {
        let sizes = [3 + random.below(4), 3 + random.below(4)];
        let [a, b] = sizes.map(|n| random.lattice(n, 0));
        outcomes.shared.add(check(&a, &b, 1.0));
    }
    outcomes
}

/// Compares at least `links` random links with the oracle. Stops at the first wrong one.
fn check_many_random_links(links: usize) {
    // A seed has at least 200 links without contact; the exact number is counted.
    let seeds = links.div_ceil(200) as u64;
    let outcomes = (0..seeds)
        .into_par_iter()
        .map(check_random_links)
        .reduce(KindOutcomes::default, KindOutcomes::merged);
    println!("{outcomes:?}\nall: {:?}, none wrong", outcomes.total());
    assert!(outcomes.total().links >= links);
    let often = links / 50;
    assert!(outcomes.generic.linked > often && outcomes.lattice.linked > often);
    assert!(outcomes.integer.linked > often / 10);
    assert!(outcomes.integer.touching > often && outcomes.shared.touching > often);
}

#[test]
fn random_polygons_match_the_oracle_in_all_six_directions() {
    check_many_random_links(50_000);
}

/// Twenty times as many random links: about a minute on two cores.
#[test]
#[ignore = "a long run: cargo test --release a_million -- --ignored --nocapture"]
fn a_million_random_polygons_match_the_oracle() {
    check_many_random_links(1_000_000);
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
fn only_degenerate_links_need_exact_arithmetic() {
    let exact = |a: &Polygon, b: &Polygon| {
        let set = set_of(&floats(a, 1.0), &floats(b, 1.0), false);
        let mut trees = Trees::default();
        trees.refit(&set);
        let mut workspace = Workspace::default();
        let input = Input {
            set: &set,
            trees: &trees,
            workspaces: &Workspaces::default(),
        };
        linking_number(input, (0, 1), None, &mut workspace);
        workspace.take_stats().exact
    };
    let [a, b] = winding(7, 512, 0.1);
    assert_eq!(exact(&a, &b), 0);
    let mut random = Random::new(5);
    let lattices = (0..100).map(|_| {
        let [a, b] = [0, 0].map(|shift| random.lattice(12, shift));
        exact(&a, &b)
    });
    assert!(lattices.filter(|&n| n > 0).count() > 50);
}

/// Regression test: with these sizes, lanes of the last group are empty. Boxes with infinite bounds
/// overlapped these lanes.
#[test]
fn far_and_tiny_scales_do_not_change_the_result() {
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
            // In two steps, because the inverse of such a power may overflow.
            let scale = 2f64.powi(power / 2) * 2f64.powi(power - power / 2);
            assert_eq!(
                kernel(&a, &b, scale, None),
                Linking::Number(want.unwrap()),
                "{n}, scale 2^{power}"
            );
        }
    }
}

/// Pairs that the search discards, because a plane orthogonal to a diagonal separates them, have
/// the linking number 0 and no contact: for tilted rings in a tangle, on a lattice and off it.
#[test]
fn discarded_pairs_of_small_rings_are_not_linked() {
    let mut random = Random::new(11);
    let (mut discarded, mut linked, mut touching) = (0, 0, 0);
    for case in 0..60 {
        let rings = 40;
        let size = 2.0 + 2.0 * random.unit();
        let mut xyz = Vec::new();
        for _ in 0..rings {
            let center = random.point(size);
            let (u, v) = (random.point(1.0), random.point(1.0));
            for k in 0..8 {
                let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 8.0).sin_cos();
                for x in 0..3 {
                    let p = center[x] + 0.8 * (cos * u[x] + sin * v[x]);
                    xyz.push(if case % 3 == 0 {
                        (2.0 * p).round() / 2.0
                    } else {
                        p
                    });
                }
            }
        }
        let set = CurveSet::from_counts(Basis::Polyline, &vec![-8; rings], Positions::F64(&xyz));
        let set = set.unwrap();
        let mut trees = Trees::default();
        trees.refit(&set);
        let input = Input {
            set: &set,
            trees: &trees,
            workspaces: &Workspaces::default(),
        };
        let whole = |i: u32| set.has_three_distinct_points(i as usize);
        let mut search = LinkSearch::default();
        let degenerate: Vec<_> = degenerate_curves(&set).collect();
        let near = search.find_links(&set, trees.roots(), &degenerate).clone();
        let count = search.discarded;
        let mut all = search.find(trees.roots()).clone();
        all.retain(|&(i, j)| whole(i) && whole(j));
        assert_eq!(near.len() + count, all.len());
        for pair in all {
            let linking = linking_number(input, pair, None, &mut Workspace::default());
            if near.binary_search(&pair).is_err() {
                assert_eq!(linking, Linking::Number(0), "case {case}, {pair:?}");
                discarded += 1;
            } else {
                linked += usize::from(!matches!(linking, Linking::Number(0)));
                touching += usize::from(matches!(linking, Linking::Undefined(..)));
            }
        }
    }
    assert!(
        discarded > 300 && linked > 300 && touching > 50,
        "{discarded} {linked} {touching}"
    );
}
