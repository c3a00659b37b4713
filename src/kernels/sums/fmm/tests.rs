use super::*;
use crate::curve::vector::per_axis;
use crate::kernels::sums::barnes_hut::{self, BarnesHut};
use crate::kernels::sums::direct::Scale;
use crate::kernels::tests::oracle;
use crate::kernels::tests::polygons::{
    LONG_RIBBONS, SCENES, check, exact_set_of, hopf, polylines, scene,
};
use crate::random::Random;

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

/// Returns all combinations of options.
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

/// Checks random walks of some hundred steps, which have several levels of leaves, with all
/// options. Returns the number of proven integers.
fn check_walks(pairs: usize, seed: u64) -> usize {
    let mut random = Random::new(seed);
    let ways = ways();
    let mut proven = 0;
    for k in 0..pairs {
        let size = [1000, 1 << 20][k % 2];
        let step = size / [1, 4, 16][k / 2 % 3];
        let [a, b] = [0; 2].map(|_| {
            let n = 100 + random.below(300);
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
    SCENES.into_iter().for_each(check_scene);
}

#[test]
#[ignore = "takes minutes"]
fn bounds_cover_the_error_on_long_ribbons() {
    LONG_RIBBONS.into_iter().for_each(check_scene);
}

fn check_scene(text: &str) {
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
    // The published method returns -999 for a ribbon like this one.
    let (set, lambda) = scene("ribbon:segments=200000,lambda=1000");
    let coarse = sum(&set, options(Some(2), Accept::Separation(0.7)));
    check(coarse, lambda, &"coarse");
    assert_eq!(coarse.integer(), None);
    assert_eq!(sum(&set, by_bound(None)).integer(), Some(lambda));
}

#[test]
fn the_error_decreases_with_the_order_as_a_power_of_the_separation() {
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
        // The larger error of two orders, because a single error may be small by coincidence.
        let error = |order| found(order).0.max(found(order + 1).0);
        let (low, high) = (error(2), error(8));
        // With a = b = 0.3 R one more degree reduces the error by 0.3 / 0.7 at least; most points
        // are nearer to the centre than the radius.
        assert!(low > 1e-7, "{text}: {low}");
        assert!(high < low * 0.43f64.powi(6), "{text}: {low} {high}");
        assert!(found(8).1 < found(2).1 * 0.5f64.powi(6), "{text}");
        assert!(
            error(14) < high * 0.05 || error(14) < 1e-9,
            "{text}: {high}"
        );
    }
}

/// The bound of the interaction of two leaves is within a factor of the actual error.
#[test]
fn the_bound_exceeds_the_error_by_a_limited_factor() {
    let mut random = Random::new(5);
    let mut closest = f64::INFINITY;
    for _ in 0..300 {
        // Two leaves for each curve, because the interaction of closed curves would be 0.
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
            walk.run(vec![(leaves[0], leaves[1])])
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
fn moments_of_parents_equal_those_of_their_segments() {
    let (set, _) = scene("torus_link:segments=2000,toroidal=5,poloidal=7");
    let fmm = Fmm::new(&set, by_bound(None));
    let tree = fmm.trees[0].as_ref().unwrap();
    for order in [2, 7, 20] {
        let mut shifted = Expansions::outline(tree, order);
        shifted.fill(tree, 1);
        let root = tree.balls[0];
        let mut buffers = [(); 2].map(|()| vec![[0.0]; harmonics::count(order)]);
        let mut direct = vec![[0.0]; 2 * harmonics::count(order)];
        let [starts, ends] = &tree.ends;
        for k in 0..starts[0].len() {
            let p = per_axis(|x| [(starts[x][k] - root.centre[x]) / root.size]);
            let e = per_axis(|x| [(ends[x][k] - starts[x][k]) / root.size]);
            harmonics::add_segments(order, &p, &e, &mut buffers, &mut direct);
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
fn reversing_a_curve_flips_the_sign_and_swapping_curves_does_not() {
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
fn scaling_does_not_change_the_result() {
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
    // Expansions too: scaling by a power of two changes no bit.
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
fn long_touching_curves_are_undecided() {
    let (set, _) = scene("ribbon:segments=4000,lambda=20");
    let curve: Vec<[f64; 3]> = (0..2000).map(|k| set.point(0, k)).collect();
    for way in ways() {
        assert_eq!(sum(&polylines(&[&curve, &curve]), way).integer(), None);
    }
}

#[test]
fn cancelled_sums_are_unknown() {
    let (set, _) = scene("chainmail");
    let mut fmm = Fmm::new(&set, by_bound(None));
    assert!(fmm.linking_number((0, 1)).bound.is_finite());
    fmm.cancel.insert(Cancel::default()).set();
    assert_eq!(fmm.linking_number((0, 1)), Estimate::UNKNOWN);
    // Walks visit no node pair.
    let trees = [0, 1].map(|i| fmm.trees[i].as_ref().unwrap());
    assert_eq!(Walk::magnitude(trees, fmm.cancel.as_ref()), 0.0);
}

#[test]
fn repeated_vertices_and_point_curves_are_no_contact() {
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
fn pairs_in_one_call_have_the_same_results_as_single_pairs() {
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

/// Returns a piece of a curve of a shape that is difficult for a bound.
fn piece(random: &mut Random, kind: usize) -> Vec<[f64; 3]> {
    let mut unit = || random.below(1 << 30) as f64 / (1u64 << 29) as f64 - 1.0;
    let n = tree::LEAF * (2 + (unit().abs() * 12.0) as usize);
    let axis = [unit(), unit(), unit()];
    let stretch = [unit(), unit(), unit()].map(|x| 2f64.powi((-9.9 * x.abs()) as i32));
    let mut points: Vec<[f64; 3]> = (0..n)
        .map(|k| {
            let t = k as f64 / n as f64;
            let free = [unit(), unit(), unit()];
            match kind {
                // Long segments, each of which crosses the whole piece; also flat and thin pieces.
                0 => free,
                1 => per_axis(|x| free[x] * stretch[x]),
                // On a sphere, so that all means are maximal; and at its six poles.
                2 => {
                    let r = free.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-9);
                    free.map(|x| x / r)
                }
                3 => {
                    let most =
                        (0..3).fold(0, |m, x| if free[x].abs() > free[m].abs() { x } else { m });
                    per_axis(|x| {
                        if x == most {
                            free[x].signum()
                        } else {
                            free[x] * 1e-3
                        }
                    })
                }
                // There and back on nearly the same way; strands side by side.
                4 | 5 => {
                    let way = if kind == 4 {
                        1.0 - (2.0 * t - 1.0).abs()
                    } else {
                        (n as f64 / 8.0 * t).fract()
                    };
                    per_axis(|x| way * axis[x] + free[x] * [1e-7, 0.05][kind - 4])
                }
                // Two distant clusters with long segments between them.
                6 => {
                    let end = if k % 2 == 0 { 1.0 } else { -1.0 };
                    per_axis(|x| end * axis[x] + 0.01 * free[x])
                }
                // A helix.
                _ => [
                    (40.0 * t).cos() * stretch[0],
                    (40.0 * t).sin() * stretch[0],
                    t,
                ],
            }
        })
        .collect();
    points.dedup();
    points
}

/// Returns a random node below the root.
fn some_node(random: &mut Random, tree: &Tree) -> crate::kernels::sums::barnes_hut::Node {
    let mut node = tree.root();
    while !node.is_leaf() {
        node = node.children()[random.below(2)];
        if random.one_in(2) {
            break;
        }
    }
    node
}

/// Compares node pairs at every distance, up to the nearest that are expanded, in every order, with
/// the exact sum of their segments.
fn check_nodes(cases: usize, seed: u64) -> [f64; 2] {
    let mut random = Random::new(seed);
    let [mut closest, mut rounding] = [f64::INFINITY, 0.0f64];
    for case in 0..cases {
        let kinds = [case % 8, case / 8 % 8];
        let curves = kinds.map(|kind| piece(&mut random, kind));
        let mut unit = || random.below(1 << 30) as f64 / (1u64 << 29) as f64 - 1.0;
        let ratio = [1.0, 1.0, 0.3, 1e-3][(unit().abs() * 4.0) as usize % 4];
        let far = [0.798, 0.79, 0.7, 0.5, 0.1, 1e-3][(unit().abs() * 6.0) as usize % 6];
        let offset = [0.0, 1.0, 1e3, 1e6][(unit().abs() * 4.0) as usize % 4];
        let towards = [unit(), unit(), unit()];
        let scaled = |c: &[[f64; 3]], f: f64, by: [f64; 3]| -> Vec<[f64; 3]> {
            c.iter().map(|p| per_axis(|x| p[x] * f + by[x])).collect()
        };
        let here = scaled(&curves[0], 1.0, [offset; 3]);
        let there = |by| scaled(&curves[1], ratio, by);
        // The first call determines the size of the nodes, the second one places them.
        let nodes = |random: &mut Random, by, at: Option<[_; 2]>| {
            let set = polylines(&[&here, &there(by)]);
            let fmm = Fmm::new(&set, by_bound(None));
            let trees = fmm.pair((0, 1)).expect("two curves");
            let nodes = at.unwrap_or_else(|| trees.map(|t| some_node(random, t)));
            let scale = Scale::new(set.max_abs()).apply(1.0);
            let balls = [0, 1].map(|x| trees[x].balls[nodes[x].place as usize]);
            (nodes, balls, scale, fmm)
        };
        let (at, [a, b], scale, _) = nodes(&mut random, [0.0; 3], None);
        let size = towards.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-3);
        // Mostly along an axis of the piece itself: from its centre to its first point.
        let distance = ((a.radius + b.radius) / far).max(2.0 / 0.899 * a.radius.max(b.radius));
        let by = per_axis(|x| (a.centre[x] - b.centre[x] + towards[x] / size * distance) / scale);
        let (at, _, _, fmm) = nodes(&mut random, by, Some(at));
        let trees = fmm.pair((0, 1)).expect("two curves");
        let run = |expansions: [Option<&Expansions>; 2], criterion| {
            Walk::new(trees, expansions, criterion).run(vec![(at[0], at[1])])
        };
        let direct = run([None; 2], Criterion::Share(0.0));
        for order in [2, 3, 5, 8, 13, 20] {
            let expansions = trees.map(|t| {
                let mut expansions = Expansions::outline(t, order);
                expansions.fill(t, 1);
                expansions
            });
            let found = run(
                expansions.each_ref().map(Some),
                Criterion::Separation(0.7999),
            );
            if found.expanded == 0 || found.summed > 0 {
                continue;
            }
            let [e, d] = [found.estimate(), direct.estimate()];
            let error = (e.value - d.value).abs();
            assert!(
                error <= e.bound + d.bound,
                "{case}, {kinds:?}, order {order}: {error} {found:?} {direct:?}"
            );
            let left = error - d.bound;
            if left > 1e-3 * found.bounds.tail && left > found.rounding {
                closest = closest.min(found.bounds.tail / left);
            }
            if found.rounding > 0.0 {
                rounding = rounding.max((left - found.bounds.tail).max(0.0) / found.rounding);
            }
        }
    }
    [closest, rounding]
}

#[test]
fn bounds_cover_the_error_of_node_pairs_at_the_limit() {
    let [closest, rounding] = check_nodes(400, 11);
    println!("tail by error: {closest}; rounding by its bound: {rounding}");
}

#[test]
#[ignore = "minutes"]
fn bounds_cover_the_error_of_many_node_pairs_at_the_limit() {
    let [closest, rounding] = check_nodes(100_000, 12);
    println!("tail by error: {closest}; rounding by its bound: {rounding}");
}

/// The rounding error of moments that were shifted through all levels is far below the bound,
/// relative to the norms in that bound; also if descendants reach far beyond the ball of their
/// ancestor.
#[test]
fn the_rounding_error_of_shifted_moments_is_within_the_bound() {
    let mut random = Random::new(3);
    for kind in [0, 1, 2, 3, 5, 6] {
        let mut curve = Vec::new();
        while curve.len() < 1 << 15 {
            curve.extend(piece(&mut random, kind));
        }
        let fmm = Fmm::new(&polylines(&[&curve]), by_bound(None));
        let tree = fmm.trees[0].as_ref().unwrap();
        let order = harmonics::MOST;
        let mut shifted = Expansions::outline(tree, order);
        shifted.fill(tree, 1);
        let (root, size) = (tree.balls[0], harmonics::count(order));
        let mut buffers = [(); 2].map(|()| vec![[0.0]; harmonics::count(order)]);
        let mut direct = vec![[0.0]; 2 * size];
        let [starts, ends] = &tree.ends;
        for k in 0..starts[0].len() {
            let p = per_axis(|x| [(starts[x][k] - root.centre[x]) / root.size]);
            let e = per_axis(|x| [(ends[x][k] - starts[x][k]) / root.size]);
            harmonics::add_segments(order, &p, &e, &mut buffers, &mut direct);
        }
        let (length, spread) = (root.length / root.size, root.spread / root.size);
        let off: Vec<f64> = shifted
            .of(0)
            .iter()
            .zip(&direct)
            .map(|(s, d)| s - d[0])
            .collect();
        let mut worst = 0f64;
        for n in 1..=order {
            let most = norms::most(n, length * spread.powi(n as i32 - 1), spread);
            let degree = ((n + 2) * (n + 2)) as f64;
            for (part, most) in off.chunks(size).zip(most) {
                worst = worst.max(norms::norm(part, n) / most / degree);
            }
        }
        println!("{kind}: {} units", worst / f64::EPSILON);
        assert!(worst < bound::ROUNDING, "{kind}: {worst}");
    }
}
