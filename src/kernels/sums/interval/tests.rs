//! Arai's examples; intervals in comparison to the oracle; noise.

use super::*;
use crate::kernels::Linking;
use crate::kernels::crossings::{Input, Workspace, Workspaces};
use crate::kernels::tests::oracle;
use crate::kernels::tests::polygons::{floats, set_of};
use crate::pairs::Trees;
use crate::random::Random;
use crate::verdict::{DefectKind, Place};
use std::time::Instant;

/// Example 5 of Arai 2013.
const K: [[f64; 3]; 8] = [
    [1., 0., 0.],
    [1., 1., 0.],
    [0., 1., 0.],
    [-1., 1., 0.],
    [-1., 0., 0.],
    [-1., -1., 0.],
    [0., -1., 0.],
    [1., -1., 0.],
];
const L: [[f64; 3]; 8] = [
    [0., 0., 0.],
    [0., 0., 1.],
    [1., 0., 1.],
    [2., 0., 1.],
    [2., 0., 0.],
    [2., 0., -1.],
    [1., 0., -1.],
    [0., 0., -1.],
];

fn with_noise(set: &CurveSet, noise: f64) -> Linking {
    let mut trees = Trees::default();
    trees.refit(set);
    let input = Input {
        set,
        trees: &trees,
        workspaces: &Workspaces::default(),
    };
    noise::linking_number(input, (0, 1), noise, &mut Workspace::default())
}

fn undecided(found: Linking) -> Place {
    match found {
        Linking::Undefined(DefectKind::TooClose, place) => place,
        other => panic!("{other:?}"),
    }
}

#[test]
fn example_5_the_hopf_link() {
    let found = enclose(&set_of(&K, &L, false), (0, 1), 0.0);
    assert_eq!(found.integer(), Some(1));
    assert!(found.hi - found.lo < 1e-12, "{found:?}");
}

#[test]
fn example_6_a_trivial_link() {
    let aside = L.map(|[x, _, z]| [x, 2.0, z]);
    let found = enclose(&set_of(&K, &aside, false), (0, 1), 0.0);
    assert_eq!(found.integer(), Some(0));
    assert!(found.hi - found.lo < 1e-12, "{found:?}");
}

#[test]
fn example_7_the_hopf_link_with_noise() {
    let set = set_of(&K, &L, false);
    let [two, three] = [0.02, 0.03].map(|noise| enclose(&set, (0, 1), noise));
    // The paper has [0.324, 1.803] and [-0.013, 2.317].
    println!("{two:?} {three:?}");
    assert_eq!(two.integer(), Some(1), "{two:?}");
    assert_eq!(three.integer(), None, "{three:?}");
    assert!((two.lo - 0.324).abs() < 0.1 && (two.hi - 1.803).abs() < 0.1);
}

#[test]
fn example_8_random_links() {
    let mut random = Random::new(2013);
    for (n, m) in [(20, 20), (10, 40), (100, 100)] {
        let mut polygon = |n: usize| -> Vec<[i64; 3]> {
            (0..n)
                .map(|_| [0; 3].map(|_| random.below(1 << 30)))
                .collect()
        };
        let (a, b) = (polygon(n), polygon(m));
        let want = oracle::linking_number(&a, &b).unwrap();
        let scale = 2f64.powi(-30);
        let start = Instant::now();
        let found = enclose(
            &set_of(&floats(&a, scale), &floats(&b, scale), false),
            (0, 1),
            0.0,
        );
        println!("{n} x {m}: {found:?} in {:?}", start.elapsed());
        assert_eq!(found.integer(), Some(want));
        assert!(found.hi - found.lo < 1e-7);
    }
}

#[test]
fn enclosures_contain_the_number_of_the_oracle_and_of_noisy_positions() {
    let mut random = Random::new(31);
    for k in 0..400 {
        let size = [4, 50, 100_000][k % 3];
        let (a, b) = (random.polygon(8, size), random.polygon(8, size));
        let (x, y) = (floats(&a, 1.0), floats(&b, 1.0));
        let want = oracle::linking_number(&a, &b);
        let found = enclose(&set_of(&x, &y, k % 2 == 0), (0, 1), 0.0);
        match want {
            Some(n) => assert!(found.contains(n as f64), "{found:?} {n}"),
            None => assert_eq!(found.integer(), None, "{found:?}"),
        }
        // Each vertex moved by one along each axis, which is within the noise.
        let noise = 1.0;
        let mut moved = |p: &Vec<[i64; 3]>| -> Vec<[i64; 3]> {
            p.iter()
                .map(|p| p.map(|x| x + random.below(3) - 1))
                .collect()
        };
        let (a, b) = (moved(&a), moved(&b));
        let set = set_of(&x, &y, false);
        let found = enclose(&set, (0, 1), noise);
        let sharp = with_noise(&set, noise);
        match (oracle::linking_number(&a, &b), sharp) {
            (Some(n), sharp) => {
                assert!(found.contains(n as f64), "{found:?} {n}");
                assert!(
                    !matches!(sharp, Linking::Number(m) if m != n),
                    "{sharp:?} {n}"
                );
            }
            (None, Linking::Number(n)) => panic!("they may touch, but {n}"),
            (None, _) => assert_eq!(found.integer(), None),
        }
        // `noise::linking_number` decides every pair that `enclose` decides.
        if let Some(n) = found.integer() {
            assert_eq!(sharp, Linking::Number(n));
        }
    }
    let set = set_of(&K, &L, true);
    assert_eq!(enclose(&set, (0, 1), f64::NAN), Interval::ENTIRE);
    assert_eq!(enclose(&set, (0, 1), -1.0), Interval::ENTIRE);
    assert_eq!(enclose(&set, (1, 1), 0.0), Interval::ENTIRE);
    assert_eq!(enclose(&set, (0, 2), 0.0), Interval::ENTIRE);
}

#[test]
fn noise_is_decided_up_to_half_the_distance_of_the_loops() {
    for scale in [1.0, 2f64.powi(-20), 2f64.powi(40)] {
        let times = |p: [[f64; 3]; 8]| p.map(|p| p.map(|x| x * scale));
        let set = set_of(&times(K), &times(L), false);
        for noise in [0.0, 0.02, 0.03, 0.3, 0.499, 0.5f64.next_down()] {
            assert_eq!(
                with_noise(&set, noise * scale),
                Linking::Number(1),
                "{noise}"
            );
        }
        for noise in [
            0.5,
            0.5f64.next_up(),
            0.7,
            1.0,
            100.0,
            f64::INFINITY,
            f64::NAN,
            -1.0,
        ] {
            let place = undecided(with_noise(&set, noise * scale));
            assert!(place.distance <= 2.0 * scale, "{noise}: {place:?}");
        }
        let place = undecided(with_noise(&set, 0.5 * scale));
        assert_eq!(place.distance, scale);
    }
    // A touching pair has no linking number for any noise.
    let touching = L.map(|[x, y, z]| [x + 1.0, y, z]);
    for noise in [0.0, 0.1] {
        let found = with_noise(&set_of(&K, &touching, false), noise);
        assert!(matches!(found, Linking::Undefined(DefectKind::Contact, _)));
    }
}

#[test]
#[ignore = "a measurement"]
fn measure_noise() {
    let ring = |n: usize, flat: bool| -> Vec<[f64; 3]> {
        let turn = |k: usize| (k as f64 / n as f64 * std::f64::consts::TAU).sin_cos();
        (0..n)
            .map(|k| match (turn(k), flat) {
                ((s, c), true) => [c, s, 0.0],
                ((s, c), false) => [1.0 + c, 0.0, s],
            })
            .collect()
    };
    let mut random = Random::new(8);
    let mut tangled = |n: usize| -> Vec<[f64; 3]> {
        let unit = |x: i64| x as f64 / f64::from(1 << 30);
        (0..n)
            .map(|_| [0; 3].map(|_| unit(random.below(1 << 30))))
            .collect()
    };
    for (name, set, noise) in [
        (
            "rings",
            set_of(&ring(100, true), &ring(100, false), false),
            0.25,
        ),
        ("random", set_of(&tangled(100), &tangled(100), false), 1e-6),
    ] {
        let mut trees = Trees::default();
        trees.refit(&set);
        let mut times: Vec<_> = (0..99)
            .map(|_| {
                let start = Instant::now();
                std::hint::black_box(with_noise(&set, noise));
                start.elapsed()
            })
            .collect();
        times.sort();
        let start = Instant::now();
        let interval = enclose(&set, (0, 1), 1e-9);
        println!(
            "{name}, 100 x 100: {:?} by {:?}; intervals {interval:?} by {:?}",
            with_noise(&set, noise),
            times[49],
            start.elapsed()
        );
    }
}
