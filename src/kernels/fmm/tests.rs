use super::*;
use crate::kernels::barnes_hut::{self, BarnesHut};
use crate::kernels::conformance::polygons::{Random, check, exact_set_of, hopf, polylines, scene};
use crate::kernels::oracle;

fn options(order: Option<u32>, accept: Accept) -> Options {
    Options {
        order,
        accept,
        ..Options::default()
    }
}

fn by_bound(order: Option<u32>) -> Options {
    options(order, Accept::Bound(0.8))
}

/// Every way to sum.
fn ways() -> Vec<Options> {
    let mut ways = vec![by_bound(None)];
    for order in [2, 3, 6, 11, 20] {
        ways.push(by_bound(Some(order)));
        ways.extend([0.3, 0.6, 0.79].map(|q| options(Some(order), Accept::Separation(q))));
    }
    ways
}

fn sum(set: &CurveSet, options: Options) -> Estimate {
    Fmm::new(set, options).linking_number((0, 1))
}

/// Walks of some hundred steps, which have several levels of leaves, in every way; returns how many integers were proven.
fn check_walks(pairs: usize, seed: u64) -> usize {
    let mut random = Random::new(seed);
    let ways = ways();
    let mut proven = 0;
    for k in 0..pairs {
        let size = [1000, 1 << 20][k % 2];
        let step = size / [1, 4, 16][k / 2 % 3];
        let [a, b] = [0; 2].map(|_| {
            let n = 100 + random.next(300) as usize;
            random.walk(n, size, step)
        });
        let Some(lambda) = oracle::linking_number(&a, &b) else {
            continue;
        };
        let way = ways[k % ways.len()];
        let found = sum(&exact_set_of(&a, &b, 1.0), way);
        check(found, lambda, &format_args!("{way:?} of {a:?} and {b:?}"));
        proven += usize::from(found.integer().is_some());
        if way == by_bound(None) {
            assert_eq!(found.integer(), Some(lambda), "{found:?}");
        }
    }
    proven
}

#[test]
fn bounds_cover_the_error_on_walks() {
    let proven = check_walks(400, 1);
    assert!(proven > 60, "{proven}");
}

#[test]
#[ignore = "minutes"]
fn bounds_cover_the_error_on_many_walks() {
    println!("{} proven", check_walks(20_000, 2));
}

#[test]
fn bounds_cover_the_error_on_scenes() {
    for text in [
        "ribbon:segments=2000,lambda=10",
        "ribbon:segments=20000,lambda=-100",
        "ribbon:segments=60000,lambda=1000",
        "woundball:segments=4000,crossings=20",
        "torus_link:segments=4000,toroidal=10,poloidal=20",
        "torus_zero:segments=16000,periods=20",
    ] {
        let (set, lambda) = scene(text);
        for way in ways() {
            let fmm = Fmm::new(&set, way);
            let found = fmm.linking_number((0, 1));
            check(found, lambda, &format_args!("{text} {way:?}"));
            let back = fmm.linking_number((1, 0));
            check(back, lambda, &format_args!("{text} {way:?}, swapped"));
            if way == by_bound(None) {
                assert!(found.bound <= 0.8, "{text}: {found:?}");
                assert_eq!(found.integer(), Some(lambda), "{text}");
                assert_eq!(back.integer(), Some(lambda), "{text}");
            }
        }
    }
}

#[test]
fn strands_that_cancel_need_a_high_order() {
    let (set, lambda) = scene("woundball:segments=40000,crossings=400");
    let found = sum(&set, by_bound(None));
    assert!(found.bound <= 0.8, "{found:?}");
    assert_eq!(found.integer(), Some(lambda));
    let low = sum(&set, options(Some(3), Accept::Separation(0.5)));
    check(low, lambda, &"order 3");
    assert_eq!(low.integer(), None);
}

#[test]
fn a_large_linking_number_is_never_rounded_to_a_wrong_one() {
    // The published method's answer is -999 for a ribbon like this one.
    let (set, lambda) = scene("ribbon:segments=200000,lambda=1000");
    let coarse = sum(&set, options(Some(2), Accept::Separation(0.7)));
    check(coarse, lambda, &"coarse");
    assert_eq!(coarse.integer(), None);
    assert_eq!(sum(&set, by_bound(None)).integer(), Some(lambda));
}

#[test]
fn the_error_falls_with_the_order_as_a_power_of_the_separation() {
    for text in [
        "ribbon:segments=20000,lambda=100",
        "woundball:segments=8000,crossings=40",
        "torus_link:segments=8000,toroidal=20,poloidal=40",
    ] {
        let (set, lambda) = scene(text);
        let found = |order| {
            let found = sum(&set, options(Some(order), Accept::Separation(0.6)));
            ((found.value - lambda as f64).abs(), found.bound)
        };
        // The larger of two orders: single errors have either sign.
        let error = |order| found(order).0.max(found(order + 1).0);
        let (low, high) = (error(2), error(8));
        // With a = b = 0.3 R a degree more is worth 0.3 / 0.7 at least; points are nearer to the centre than the radius.
        assert!(low > 1e-7, "{text}: {low}");
        assert!(high < low * 0.43f64.powi(6), "{text}: {low} {high}");
        assert!(found(8).1 < found(2).1 * 0.5f64.powi(6), "{text}");
        assert!(
            error(14) < high * 0.05 || error(14) < 1e-9,
            "{text}: {high}"
        );
    }
}

/// The bound of the interaction of two leaves is not absurdly far from the error.
#[test]
fn the_bound_is_attained_within_a_factor() {
    let mut random = Random::new(5);
    let mut closest = f64::INFINITY;
    for _ in 0..300 {
        // Leaves are no closed curves, whose interaction would be 0: two a curve.
        let mut curve = |centre: f64| -> Vec<[f64; 3]> {
            let place = |p: [i64; 3]| p.map(|x| x as f64 / 1000.0 + centre);
            random
                .walk(2 * tree::LEAF, 1000, 100)
                .into_iter()
                .map(place)
                .collect()
        };
        let set = polylines(&[&curve(0.0), &curve(2.0)]);
        let fmm = Fmm::new(&set, by_bound(None));
        let trees = fmm.pair((0, 1)).unwrap();
        let leaves = trees.map(|t| t.root().children()[0]);
        let run = |expansions: [Option<&Expansions>; 2], criterion| {
            let walk = Walk::new(trees, expansions, criterion);
            walk.run(&mut vec![(leaves[0], leaves[1])])
        };
        let direct = run([None; 2], Criterion::Share(0.0));
        assert_eq!((direct.expanded, direct.summed), (0, 1));
        for order in [2, 4, 8] {
            let expansions = trees.map(|t| {
                let mut expansions = Expansions::outline(t, order);
                expansions.fill(t, 1);
                expansions
            });
            let found = run(expansions.each_ref().map(Some), Criterion::Separation(0.79));
            assert_eq!(found.expanded, 1);
            let error = (found.estimate().value - direct.estimate().value).abs();
            assert!(error <= found.bounds.tail + 1e-12, "{error} {found:?}");
            if error > 1e-11 {
                closest = closest.min(found.bounds.tail / error);
            }
        }
    }
    println!("closest: {closest}");
    assert!((1.0..100.0).contains(&closest), "{closest}");
}

#[test]
fn moments_of_parents_are_those_of_their_segments() {
    let (set, _) = scene("torus_link:segments=2000,toroidal=5,poloidal=7");
    let fmm = Fmm::new(&set, by_bound(None));
    let tree = fmm.trees[0].as_ref().unwrap();
    for order in [2, 7, 20] {
        let mut shifted = Expansions::outline(tree, order);
        shifted.fill(tree, 1);
        let root = tree.balls[0];
        let mut room = harmonics::Room::<1>::new(order);
        let mut direct = vec![[0.0]; 2 * harmonics::count(order)];
        let [starts, ends] = &tree.ends;
        for k in 0..starts[0].len() {
            let p = [0, 1, 2].map(|x| [(starts[x][k] - root.centre[x]) / root.size]);
            let e = [0, 1, 2].map(|x| [(ends[x][k] - starts[x][k]) / root.size]);
            harmonics::add_segments(order, &p, &e, &mut room, &mut direct);
        }
        let length = root.length / root.size;
        for (shifted, direct) in shifted.of(0).iter().zip(&direct) {
            assert!(
                (shifted - direct[0]).abs() < 1e-14 * length,
                "order {order}"
            );
        }
    }
}

#[test]
fn reversing_a_curve_changes_the_sign_and_swapping_nothing() {
    let (set, lambda) = scene("ribbon:segments=4000,lambda=20");
    let curve = |i: usize| -> Vec<[f64; 3]> {
        (0..set.curve(i).points as usize)
            .map(|k| set.point(i, k))
            .collect()
    };
    let (a, b) = (curve(0), curve(1));
    let back: Vec<_> = a.iter().rev().copied().collect();
    let found = |a: &[[f64; 3]], b: &[[f64; 3]]| sum(&polylines(&[a, b]), by_bound(None));
    assert_eq!(found(&a, &b).integer(), Some(lambda));
    assert_eq!(found(&b, &a).integer(), Some(lambda));
    assert_eq!(found(&back, &b).integer(), Some(-lambda));
}

#[test]
fn the_scale_does_not_matter() {
    for exponent in [-1074, -1070, -1022, -500, -50, 0, 50, 500, 1020] {
        let half = exponent / 2;
        let scale = 2f64.powi(half) * 2f64.powi(exponent - half);
        let [a, b] = hopf(scale, 0.0);
        let found = sum(&polylines(&[&a, &b]), by_bound(None));
        assert_eq!(
            found.integer().map(i64::abs),
            Some(1),
            "{exponent}: {found:?}"
        );
    }
    // Expansions too: powers of two change no bit.
    let (set, lambda) = scene("ribbon:segments=4000,lambda=20");
    let at = |scale: f64, offset: f64| {
        let curve = |i: usize| -> Vec<[f64; 3]> {
            let place = |k| set.point(i, k).map(|x| x * scale + offset);
            (0..set.curve(i).points as usize).map(place).collect()
        };
        sum(&polylines(&[&curve(0), &curve(1)]), by_bound(None))
    };
    let found = at(1.0, 0.0);
    for exponent in [-900, -300, -3, 1, 300, 900] {
        assert_eq!(at(2f64.powi(exponent), 0.0), found, "{exponent}");
    }
    for offset in [1.0, 1e3, 1e6] {
        assert_eq!(at(1.0, offset).integer(), Some(lambda), "{offset}");
    }
    // Far from the origin, and beside curves that are much larger.
    let [a, b] = hopf(2f64.powi(-40), 1.0);
    let [far, _] = hopf(1e9, 0.0);
    let found = sum(&polylines(&[&a, &b, &far]), by_bound(None));
    assert_eq!(found.integer().map(i64::abs), Some(1));
}

#[test]
fn long_curves_that_touch_have_no_integer() {
    let (set, _) = scene("ribbon:segments=4000,lambda=20");
    let curve: Vec<[f64; 3]> = (0..2000).map(|k| set.point(0, k)).collect();
    for way in ways() {
        assert_eq!(sum(&polylines(&[&curve, &curve]), way).integer(), None);
    }
}

#[test]
fn repeated_vertices_and_points_are_no_contact() {
    let [a, b] = hopf(1.0, 0.0);
    let mut repeated = b.clone();
    repeated.extend([b[3]; 500]);
    let point = vec![[0.5, 0.25, 0.0]; 400];
    let set = polylines(&[&a, &repeated, &point]);
    let sums = Fmm::new(&set, by_bound(None));
    assert_eq!(sums.linking_number((0, 1)).integer().map(i64::abs), Some(1));
    assert_eq!(sums.linking_number((0, 2)).integer(), Some(0));
    assert_eq!(sums.linking_number((1, 2)).integer(), Some(0));
}

#[test]
fn pairs_together_are_as_pairs_alone() {
    let (set, _) = scene("chainmail");
    let mut pairs = Vec::new();
    for i in 0..set.len().min(12) as u32 {
        pairs.extend((0..i).map(|j| (j, i)));
    }
    let fmm = Fmm::new(&set, by_bound(None));
    let together = fmm.linking_numbers(&pairs);
    for (&pair, found) in pairs.iter().zip(&together) {
        assert_eq!(fmm.linking_number(pair), *found);
        let other = BarnesHut::new(&set, barnes_hut::Options::default()).linking_number(pair);
        assert_eq!(other.integer(), found.integer());
    }
}
