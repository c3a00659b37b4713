//! Tests of the invariant against the slow oracle, of the methods against one another, and of known
//! passages.

use super::exact::{MovingEdges, TRANSLATION, events};
use super::polynomial::{Interval, Polynomial, index};
use super::ring::Infinitesimal;
use super::*;
use crate::kernels::oracle;

/// A random number generator. Failed assertions print its seed.
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Self {
        Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn next(&mut self, n: u64) -> i64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) % n) as i64
    }

    fn polygon(&mut self, n: usize, range: u64) -> Polygon {
        (0..n).map(|_| [0; 3].map(|_| self.next(range))).collect()
    }

    /// Returns a number that is uniform in `[-size, size]`.
    fn float(&mut self, size: f64) -> f64 {
        size * (self.next(1 << 31) as f64 / f64::from(1 << 30) - 1.0)
    }

    fn vector(&mut self, size: f64) -> Point {
        [0; 3].map(|_| self.float(size))
    }
}

type Polygon = Vec<[i64; 3]>;

/// A polygon in both frames.
type Moving = [Polygon; 2];

fn edge(p: &Polygon, k: usize, scale: f64) -> [Point; 2] {
    [p[k], p[(k + 1) % p.len()]].map(|p| p.map(|x| x as f64 * scale))
}

/// Returns all pairs of edges of two polygons, in both frames.
fn pairs<'a>(
    i: &'a Moving,
    j: &'a Moving,
    scale: f64,
) -> impl Iterator<Item = (Edges, Edges)> + 'a {
    (0..i[0].len()).flat_map(move |k| {
        (0..j[0].len()).map(move |l| {
            let [before, after] = [0, 1].map(|f| [edge(&i[f], k, scale), edge(&j[f], l, scale)]);
            (before, after)
        })
    })
}

fn total(i: &Moving, j: &Moving, scale: f64) -> i64 {
    let mut sum = 0;
    for (before, after) in pairs(i, j, scale) {
        let mut last = 0.0;
        let decided = passages(&before, &after, Ties::Translate, &mut |p| {
            assert!((0.0..=1.0).contains(&p.time) && p.time >= last);
            match p.moment {
                Moment::Start => assert_eq!(p.time, 0.0),
                Moment::Within { .. } => assert_eq!(p.sign.abs(), 1),
                Moment::End => assert_eq!(p.time, 1.0),
            }
            assert!(p.at.iter().all(|t| (0.0..=1.0).contains(t)));
            last = p.time;
            sum += i64::from(p.sign);
        });
        assert_ne!(decided, Decided::Tie);
    }
    sum
}

/// Returns two moving polygons, with a motion of one of the kinds that provoke ties.
fn scene(r: &mut Random) -> [Moving; 2] {
    let range = [2, 3, 4, 5, 8, 30, 1000, 1 << 20][r.next(8) as usize];
    let random = |r: &mut Random| {
        let n = 3 + r.next(4) as usize;
        let mut moving = [0, 1].map(|_| r.polygon(n, range));
        if r.next(3) == 0 {
            // Edges that are points, in one frame or in both.
            let k = r.next(n as u64) as usize;
            let frames = 1 + r.next(3) as usize;
            for (f, polygon) in moving.iter_mut().enumerate() {
                if frames >> f & 1 == 1 {
                    polygon[k] = polygon[(k + 1) % n];
                }
            }
        }
        moving
    };
    let mut scene = [random(r), random(r)];
    let vector = |r: &mut Random, size: i64| [0; 3].map(|_| r.next(2 * size as u64 + 1) - size);
    let moved = |p: &Polygon, v: [i64; 3]| -> Polygon {
        p.iter().map(|p| [0, 1, 2].map(|x| p[x] + v[x])).collect()
    };
    match r.next(8) {
        // Arbitrary motion.
        0 | 1 => {}
        // All vertices of one polygon, or of both, stay in a plane.
        2 => {
            let (axis, both) = (r.next(3) as usize, r.next(2) == 0);
            let heights = [r.next(3), r.next(3)];
            for moving in scene.iter_mut().take(1 + usize::from(both)) {
                for (polygon, height) in moving.iter_mut().zip(heights) {
                    polygon.iter_mut().for_each(|p| p[axis] = height);
                }
            }
        }
        // A translation of one polygon.
        3 => {
            let v = vector(r, 5);
            scene[0][1] = moved(&scene[0][0], v);
            scene[1][1] = scene[1][0].clone();
        }
        // A common translation.
        4 => {
            let v = vector(r, 5);
            scene.iter_mut().for_each(|m| m[1] = moved(&m[0], v));
        }
        // One polygon is at rest, and a few vertices of the other one move.
        5 => {
            scene[1][1] = scene[1][0].clone();
            for k in 0..scene[0][0].len() {
                if r.next(2) == 0 {
                    scene[0][1][k] = scene[0][0][k];
                }
            }
        }
        // One or two vertices move along the line of an edge of the other polygon, from beyond one
        // end to beyond the other.
        6 => {
            scene[1][1] = scene[1][0].clone();
            let l = r.next(scene[1][0].len() as u64) as usize;
            let (q, d) = (scene[1][0][l], scene[1][0][(l + 1) % scene[1][0].len()]);
            let on = |m: i64| [0, 1, 2].map(|x| q[x] + m * (d[x] - q[x]));
            let k = r.next(scene[0][0].len() as u64) as usize;
            (scene[0][0][k], scene[0][1][k]) = (on(-1), on(2));
            if r.next(2) == 0 {
                let k = (k + 1) % scene[0][0].len();
                (scene[0][0][k], scene[0][1][k]) = (on(-2), on(3));
            }
        }
        // A jump: the second frame is far and large, or mirrored.
        _ => {
            let v = vector(r, 1000);
            scene[0][1] = scene[0][0].iter().map(|p| p.map(|x| -x)).collect();
            scene[0][1] = moved(&scene[0][1], v);
        }
    }
    // The axes have different roles in the translation.
    let turn = r.next(3) as usize;
    scene
        .iter_mut()
        .flatten()
        .flatten()
        .for_each(|p| p.rotate_left(turn));
    scene
}

/// Compares the sum of the passages with the change of the oracle's linking number.
fn compare(count: u64, seed: u64) {
    let mut r = Random::new(seed);
    let (mut done, mut changed) = (0, 0);
    while done < count {
        let [i, j] = scene(&mut r);
        let numbers = [0, 1].map(|f| oracle::linking_number(&i[f], &j[f]));
        let [Some(before), Some(after)] = numbers else {
            continue;
        };
        done += 1;
        changed += u64::from(before != after);
        let want = after - before;
        assert_eq!(total(&i, &j, 1.0), want, "seed {seed}: {i:?} {j:?}");
        match r.next(6) {
            0 => assert_eq!(
                total(&j, &i, 1.0),
                want,
                "swapped, seed {seed}: {i:?} {j:?}"
            ),
            1 => {
                let back = |m: &Moving| [m[1].clone(), m[0].clone()];
                assert_eq!(
                    total(&back(&i), &back(&j), 1.0),
                    -want,
                    "backward: {i:?} {j:?}"
                );
            }
            2 => {
                let power = [-1074, -1022, -700, -300, 300, 700, 1000][r.next(7) as usize];
                // In two steps: the inverse of such a power may overflow.
                let scale = 2f64.powi(power / 2) * 2f64.powi(power - power / 2);
                assert_eq!(total(&i, &j, scale), want, "2^{power}: {i:?} {j:?}");
            }
            _ => {}
        }
    }
    assert!(changed > count / 20, "{changed} of {count} changed");
}

#[test]
fn the_sum_of_passages_is_the_change_of_the_linking_number() {
    compare(6000, 1);
}

/// Run with `cargo test --release --lib million -- --ignored`: three minutes on two cores.
#[test]
#[ignore = "long"]
fn a_million_sums_are_the_change_of_the_linking_number() {
    std::thread::scope(|s| {
        for thread in 0..2 {
            s.spawn(move || (0..50).for_each(|k| compare(10_000, 100 + 2 * k + thread)));
        }
    });
}

/// Compares the sum of the passages of two successive steps with the oracle, for any frame between
/// them. Returns the number of cases in which the polygons touch in that frame.
fn compare_two_steps(count: u64, seed: u64) -> u64 {
    let mut r = Random::new(seed);
    let (mut done, mut touching) = (0, 0);
    while done < count {
        let [i, j] = scene(&mut r);
        let range = [2, 3, 5, 30][r.next(4) as usize];
        let last = [&i, &j].map(|m| match r.next(3) {
            0 => m[0].clone(),
            1 => m[1].clone(),
            _ => r.polygon(m[0].len(), range),
        });
        let number = |i: &Polygon, j: &Polygon| oracle::linking_number(i, j);
        let ends = [number(&i[0], &j[0]), number(&last[0], &last[1])];
        let [Some(before), Some(after)] = ends else {
            continue;
        };
        done += 1;
        touching += u64::from(number(&i[1], &j[1]).is_none());
        let [mut p, mut q] = [
            [i[1].clone(), last[0].clone()],
            [j[1].clone(), last[1].clone()],
        ];
        let mut found = total(&i, &j, 1.0) + total(&p, &q, 1.0);
        assert_eq!(found, after - before, "seed {seed}: {i:?} {j:?} {last:?}");
        // Each pair of edges has its own unit of length, and the translation must be the same for
        // all.
        let scale = 2f64.powi(r.next(40) as i32 - 20);
        (p, q) = (q, p);
        found = total(&j, &i, scale) + total(&p, &q, scale);
        assert_eq!(
            found,
            after - before,
            "swapped, seed {seed}: {i:?} {j:?} {last:?}"
        );
    }
    touching
}

#[test]
fn a_passage_through_a_contact_in_a_frame_is_counted_once_over_both_steps() {
    let touching = compare_two_steps(6000, 2);
    assert!(touching > 300, "{touching} touch");
}

/// Run with `cargo test --release --lib hundred_thousand_contacts -- --ignored`.
#[test]
#[ignore = "long"]
fn hundred_thousand_contacts_in_a_frame_are_counted_once() {
    let touching: u64 = std::thread::scope(|s| {
        let threads = [0, 1].map(|thread| {
            s.spawn(move || {
                let seeds = (0..25).map(|k| 1000 + 2 * k + thread);
                seeds
                    .map(|seed| compare_two_steps(6_000, seed))
                    .sum::<u64>()
            })
        });
        threads.into_iter().map(|t| t.join().unwrap()).sum()
    });
    println!("{touching} of 300000 touch in the frame between");
    assert!(touching > 15_000, "{touching} touch");
}

/// Returns the passages in the order in which they are reported.
fn collect(before: &Edges, after: &Edges, ties: Ties) -> (Decided, Vec<Passage>) {
    let mut all = Vec::new();
    let decided = passages(before, after, ties, &mut |p| all.push(p));
    (decided, all)
}

fn collect_exactly(before: &Edges, after: &Edges, ties: Ties) -> (Decided, Vec<Passage>) {
    let mut all = Vec::new();
    let decided = exactly(before, after, ties, &mut |p| all.push(p));
    (decided, all)
}

/// Checks that both methods find the same events, if floating point decides.
fn assert_methods_agree(before: &Edges, after: &Edges) -> Decided {
    let (decided, fast) = collect(before, after, Ties::Translate);
    let (_, exact) = collect_exactly(before, after, Ties::Translate);
    let signs = |all: &[Passage]| all.iter().map(|p| p.sign).collect::<Vec<_>>();
    assert_eq!(signs(&fast), signs(&exact), "{before:?} {after:?}");
    for (p, q) in fast.iter().zip(&exact) {
        assert!((p.time - q.time).abs() < 1e-9, "{p:?} {q:?}");
        let size = [before, after].map(|e| e.as_flattened().as_flattened());
        let size = size
            .iter()
            .copied()
            .flatten()
            .fold(0.0, |m: f64, x| m.max(x.abs()));
        assert!(
            (0..3).all(|x| (p.point[x] - q.point[x]).abs() < 1e-5 * size),
            "{p:?} {q:?}"
        );
    }
    if decided != Decided::Exact {
        // A certain result has no ties, whichever curve is translated.
        assert_eq!(collect_exactly(before, after, Ties::Report).1, exact);
    }
    decided
}

#[test]
fn methods_agree_on_random_motions() {
    let mut r = Random::new(3);
    let (mut certified, mut several, n) = (0, 0, 4000);
    for _ in 0..n {
        let (gap, motion) = (
            [0.0, 0.1, 1.0][r.next(3) as usize],
            [0.1, 1.0, 3.0][r.next(3) as usize],
        );
        let (before, after) = meeting(&mut r, gap, motion);
        match assert_methods_agree(&before, &after) {
            Decided::Apart => {}
            d => certified += u64::from(d == Decided::Certified),
        }
        several += u64::from(collect(&before, &after, Ties::Translate).1.len() > 1);
    }
    println!("{certified} of {n} certified, {several} with several passages");
    assert!(certified > n / 2 && several > n / 500);
}

/// Returns two edges of length about 1. Inner points of them are within `gap` of each other before
/// every end moves by `motion`.
fn meeting(r: &mut Random, gap: f64, motion: f64) -> (Edges, Edges) {
    let along = |p: Point, d: Point, t: f64| [0, 1, 2].map(|x| p[x] + t * d[x]);
    let place = r.vector(10.0);
    let mut edge = |from: Point| {
        let (d, s) = (r.vector(1.0), 0.5 + r.float(0.4));
        [along(from, d, -s), along(from, d, 1.0 - s)]
    };
    let first = edge(place);
    let second = edge(place);
    let off = r.vector(gap);
    let half = r.vector(motion);
    let middle = [first, second.map(|p| along(p, off, 1.0))];
    let mut moved = |t: f64| {
        let mut side = 0.0;
        middle.map(|e| {
            side += 1.0;
            e.map(|p| along(along(p, half, t * side), r.vector(motion), 0.3))
        })
    };
    (moved(-0.5), moved(0.5))
}

/// Small integers and neighbouring floats, so that the bounds are barely met or barely missed.
#[test]
fn methods_agree_next_to_ties() {
    let mut r = Random::new(4);
    let mut decided = [0; 4];
    for _ in 0..6000 {
        let ulps = [1, 3, 100, 1 << 20][r.next(4) as usize];
        let mut frame = || {
            [0; 2].map(|_| {
                [0; 2].map(|_| {
                    [0; 3].map(|_| {
                        let x = (r.next(5) - 2) as f64 / 3.0;
                        let by = if r.next(3) == 0 {
                            r.next(2 * ulps + 1) - ulps as i64
                        } else {
                            0
                        };
                        x * (1.0 + by as f64 * f64::EPSILON)
                    })
                })
            })
        };
        let (mut before, mut after) = (frame(), frame());
        if r.next(2) == 0 {
            // Exponents at which products underflow or overflow, with equal or different ones per
            // axis.
            const POWERS: [i32; 10] = [-1060, -500, -205, -190, -40, 0, 40, 190, 205, 500];
            let powers = match r.next(4) {
                0 => [0; 3].map(|_| POWERS[r.next(10) as usize]),
                1 => [330 + r.next(20) as i32; 3],
                _ => [-(335 + r.next(30) as i32); 3],
            };
            for x in [&mut before, &mut after].into_iter().flatten().flatten() {
                for (x, power) in x.iter_mut().zip(powers) {
                    *x *= 2f64.powi(power / 2) * 2f64.powi(power - power / 2);
                }
            }
        }
        decided[assert_signs_agree(&before, &after) as usize] += 1;
    }
    println!("apart, certified, exact, tie: {decided:?}");
    assert!(decided[1] > 2000 && decided[2] > 200);
}

/// [`assert_methods_agree`] for the signs only: near ties, places are inaccurate.
fn assert_signs_agree(before: &Edges, after: &Edges) -> Decided {
    let (decided, fast) = collect(before, after, Ties::Translate);
    let (_, exact) = collect_exactly(before, after, Ties::Translate);
    let signs = |all: &[Passage]| all.iter().map(|p| p.sign).collect::<Vec<_>>();
    assert_eq!(signs(&fast), signs(&exact), "{before:?} {after:?}");
    decided
}

/// The passages of lattice edges are the same for every way of counting.
#[test]
fn every_axis_and_the_cauchy_index_count_the_same() {
    let mut r = Random::new(5);
    let (mut ties, mut counted) = (0, 0);
    for _ in 0..200 {
        let range = [2, 3, 4][r.next(3) as usize];
        let frames =
            [0; 2].map(|_| [0; 2].map(|_| [0; 2].map(|_| [0; 3].map(|_| r.next(range) as f64))));
        let [before, after] = &frames;
        if frames.iter().any(|[p, q]| {
            super::super::segments_touch(
                p[0],
                p[1],
                q[0],
                q[1],
                &mut super::super::Predicates::default(),
            )
        }) {
            continue;
        }
        let motion = MovingEdges::new(before, after);
        let all = events(before, after, Ties::Translate).unwrap();
        let all: i32 = all.iter().map(|e| e.sign).sum();
        let count = |exponents: [u32; 3]| {
            let translated = motion.translated(exponents);
            let [x, y, z] = [0, 1, 2].map(|w| translated.net_passages(&Interval::step(), w));
            assert!(x == y && y == z, "{frames:?}: {x} {y} {z}");
            (translated, x)
        };
        assert_eq!(count(TRANSLATION).1, all, "{frames:?}");
        // A translation that is general enough here, with which the numbers of Sturm's theorem stay
        // short.
        let (translated, want) = count([1, 3, 9]);
        ties += u32::from(events(before, after, Ties::Report).is_none());
        if let Some(index) = cauchy(&translated) {
            assert_eq!(index, want, "{frames:?}");
            counted += u32::from(want != 0);
        }
    }
    println!("{ties} ties, {counted} passages");
    assert!(ties > 5 && counted > 10);
}

/// An end passes an edge that turns, so that their difference sweeps the surface `z = x y`. The tie
/// rule for frames at rest would translate along that surface, and the axes would give different
/// counts.
#[test]
fn the_translation_is_on_no_surface_of_an_end_and_an_edge() {
    let mut r = Random::new(7);
    let edge = |y: f64| [[-1.0, y, -y], [1.0, y, y]];
    for _ in 0..200 {
        let ends = [0; 2].map(|_| [0; 3].map(|_| (r.next(9) - 4) as f64));
        let mut frames =
            [(-1.0, ends[0]), (1.0, ends[1])].map(|(y, end)| [[[0.0; 3], end], edge(y)]);
        if r.next(2) == 0 {
            frames.iter_mut().for_each(|f| f[0].reverse());
        }
        let translated = MovingEdges::new(&frames[0], &frames[1]).translated(TRANSLATION);
        let counts = [0, 1, 2].map(|w| translated.net_passages(&Interval::step(), w));
        assert!(
            counts.iter().all(|&n| n == counts[0]),
            "{frames:?}: {counts:?}"
        );
    }
}

/// Returns the sum of the signs of the passages of a motion in general position, by Sturm's theorem
/// only. Returns `None` if the edges are parallel at a root, or the step starts or ends with a
/// root.
///
/// Let `f` be the volume, and let `g` and `h` be positive if the ends of either edge are on both
/// sides of the other. The sum, over the roots of `f` at which both are positive, of the direction
/// of the sign change of `f` is a quarter of the sum of the Cauchy indices of `1/f`, `g/f`, `h/f`
/// and `gh/f`.
fn cauchy(motion: &MovingEdges<Infinitesimal>) -> Option<i32> {
    let f = motion.volume();
    let step = Interval::step();
    if f.sign_at(&step.from) == 0 || f.sign_at(&step.to) == 0 {
        return None;
    }
    let w = (0..3).find(|&w| {
        let [a, b, _, _] = motion.sides(w);
        let normal = a.minus(&b);
        let common = f.signs_at_roots(&normal.times(&normal), &step);
        common == f.signs_at_roots(&Polynomial::new([Infinitesimal::term(0, 1.into())]), &step)
            && !normal.is_zero()
    })?;
    let [a, b, c, d] = motion.sides(w);
    let zero = Polynomial::new([]);
    let (g, h) = (zero.minus(&a.times(&b)), zero.minus(&c.times(&d)));
    let one = Polynomial::new([Infinitesimal::term(0, 1.into())]);
    let sum: i32 = [one, g.clone(), h.clone(), g.times(&h)]
        .iter()
        .map(|g| index(&f, g, &step))
        .sum();
    assert_eq!(sum % 4, 0);
    Some(-sum / 4)
}

/// A vertical edge at rest.
const POST: [Point; 2] = [[0.0, 0.0, -4.0], [0.0, 0.0, 4.0]];

#[test]
fn a_pull_through_has_its_time_place_and_sign() {
    let along_x = |y: f64| [[-1.0, y, 2.0], [3.0, y, 2.0]];
    let mut seen = Vec::new();
    for (from, to, time) in [(-3.0, 1.0, 0.75), (-1.0, 1.0, 0.5), (1.0, -7.0, 0.125)] {
        let (before, after) = ([along_x(from), POST], [along_x(to), POST]);
        for (decided, all) in [
            collect(&before, &after, Ties::Translate),
            collect_exactly(&before, &after, Ties::Translate),
        ] {
            assert_ne!(decided, Decided::Apart);
            let [p] = all[..] else { panic!("{all:?}") };
            let near = |a: f64, b: f64| (a - b).abs() < 1e-14;
            assert!(
                near(p.time, time) && near(p.at[0], 0.25) && near(p.at[1], 0.75),
                "{p:?}"
            );
            assert!(near(p.point[0], 0.0) && near(p.point[1], 0.0) && near(p.point[2], 2.0));
            seen.push(p.sign);
        }
    }
    // The oracle confirms the signs in `the_sum_of_passages_is_the_change_of_the_linking_number`.
    assert_eq!(seen, [-1, -1, -1, -1, 1, 1]);
}

/// The first edge turns as it moves, and passes the post twice: its projection contains the origin
/// if `a x b = -6 + 49 t - 49 t^2` is 0, at 1/7 and 6/7.
#[test]
fn finds_two_passages_that_cancel() {
    let before = [[[-6.0, -3.0, 0.0], [10.0, 6.0, 0.0]], POST];
    let after = [[[-6.0, -10.0, 0.0], [3.0, 6.0, 0.0]], POST];
    for (_, all) in [
        collect(&before, &after, Ties::Report),
        collect_exactly(&before, &after, Ties::Report),
    ] {
        let [p, q] = all[..] else { panic!("{all:?}") };
        assert!((p.time - 1.0 / 7.0).abs() < 1e-15 && (q.time - 6.0 / 7.0).abs() < 1e-15);
        assert_eq!(p.sign + q.sign, 0);
        assert!(
            [p, q]
                .iter()
                .all(|p| p.point.iter().all(|x| x.abs() < 1e-14))
        );
    }
}

/// As above with `a x b = -(2 t - 1)^2`: the edges touch and separate again.
#[test]
fn contact_without_crossing_is_no_passage() {
    let before = [[[-2.0, -1.0, 0.0], [3.0, 2.0, 0.0]], POST];
    let after = [[[-2.0, -3.0, 0.0], [1.0, 2.0, 0.0]], POST];
    for ties in [Ties::Translate, Ties::Report] {
        assert_eq!(collect(&before, &after, ties), (Decided::Exact, vec![]));
    }
}

/// A passage exactly in a frame is in one of the adjacent steps. An edge that touches there and
/// turns back has none, or has one in both steps, and they cancel.
#[test]
fn contact_in_a_frame_is_decided_over_both_steps() {
    let frame = |y: f64| [[[-1.0, y, 2.0], [3.0, y, 2.0]], POST];
    for ties in [Ties::Translate, Ties::Report] {
        for (from, to, want) in [
            (-1.0, 1.0, -1),
            (1.0, -1.0, 1),
            (1.0, 1.0, 0),
            (-1.0, -1.0, 0),
        ] {
            let [first, second] = [(from, 0.0), (0.0, to)].map(|(from, to)| {
                let (decided, all) = collect(&frame(from), &frame(to), ties);
                assert_eq!(decided, Decided::Exact);
                let [p] = all[..] else { panic!("{all:?}") };
                p
            });
            assert_eq!((first.moment, first.time), (Moment::End, 1.0));
            assert_eq!((second.moment, second.time), (Moment::Start, 0.0));
            assert_eq!(first.sign + second.sign, want, "{from} {to}");
        }
    }
}

/// The tip of a wedge passes straight through an edge, from any side: one edge of the wedge has the
/// passage, or both edges have one and they cancel.
#[test]
fn a_tie_at_a_vertex_counts_once() {
    let wedge = |y: f64, bend: f64| [[-2.0, y + bend, 0.0], [0.0, y, 0.0], [2.0, y - 1.0, 0.0]];
    for turn in 0..3 {
        for (bend, want) in [(1.0, 1), (0.0, 1), (-1.0, 1)] {
            let turned = |mut p: Point| {
                p.rotate_left(turn);
                p
            };
            let mut sum = 0;
            for k in 0..2 {
                let frame = |y: f64| {
                    [[wedge(y, bend)[k], wedge(y, bend)[k + 1]], POST].map(|e| e.map(turned))
                };
                let (before, after) = (frame(-1.0), frame(1.0));
                let (decided, all) = collect(&before, &after, Ties::Translate);
                assert_eq!(decided, Decided::Exact);
                assert!(all.iter().all(|p| p.time == 0.5));
                sum += all.iter().map(|p| p.sign).sum::<i32>();
                assert_eq!(
                    collect(&before, &after, Ties::Report),
                    (Decided::Tie, vec![])
                );
            }
            assert_eq!(sum, -want, "{bend} {turn}");
        }
    }
}

/// MovingEdges in one plane at all times is reported as a tie only if the edges meet.
#[test]
fn motion_in_one_plane_is_a_tie_only_if_edges_meet() {
    let at = |x: f64, y: f64| [x, y, x + y];
    let first = [at(0.0, 0.0), at(4.0, 4.0)];
    let cases = [
        // Boxes that overlap, but separated by the sides; apart on one line; through each other; in
        // contact in the first frame only.
        (
            [at(1.0, 0.0), at(3.0, 1.0)],
            [at(1.0, 0.0), at(3.0, 2.0)],
            false,
        ),
        (
            [at(5.0, 5.0), at(6.0, 6.0)],
            [at(7.0, 7.0), at(4.5, 4.5)],
            false,
        ),
        (
            [at(1.0, 0.0), at(3.0, 1.0)],
            [at(0.0, 1.0), at(3.0, 4.0)],
            true,
        ),
        (
            [at(1.0, 1.0), at(3.0, 0.0)],
            [at(1.0, 0.0), at(3.0, 0.0)],
            false,
        ),
    ];
    for (from, to, meet) in cases {
        let (before, after) = ([first, from], [first, to]);
        let (decided, all) = collect_exactly(&before, &after, Ties::Report);
        let contacts = [&before, &after].map(|edges| usize::from(exact::touch(edges)));
        let expected = match meet {
            true => (Decided::Tie, 0),
            false => (Decided::Exact, contacts[0] + contacts[1]),
        };
        assert_eq!((decided, all.len()), expected);
        assert!(all.iter().all(|p| p.moment == Moment::Start));
        collect(&before, &after, Ties::Translate);
    }
}

/// Run with `cargo test --release --lib passage::tests::speed -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn speed() {
    use std::hint::black_box;
    use std::time::Instant;
    let mut r = Random::new(6);
    let n = 20_000;
    let far = |(before, after): &(Edges, Edges)| filter::apart(before, after);
    let quiet = |m: &(Edges, Edges)| collect(&m.0, &m.1, Ties::Translate).1.is_empty();
    let mut scene = |gap: f64, motion: f64, keep: &dyn Fn(&(Edges, Edges)) -> bool| {
        let all = (0..n).map(|_| meeting(&mut r, gap, motion));
        all.filter(|m| keep(m)).collect::<Vec<_>>()
    };
    let mut scenes = vec![
        ("far", scene(6.0, 0.1, &far)),
        (
            "near, motion 0.01",
            scene(0.3, 0.01, &|m| !far(m) && quiet(m)),
        ),
        (
            "near, motion 0.1",
            scene(0.3, 0.1, &|m| !far(m) && quiet(m)),
        ),
        ("near, motion 1", scene(1.0, 1.0, &|m| !far(m) && quiet(m))),
        ("crossing, motion 0.3", scene(0.1, 0.3, &|m| !quiet(m))),
        ("crossing, motion 3", scene(1.0, 3.0, &|m| !quiet(m))),
    ];
    // Ties of short numbers and of long ones: multiples of a number of 50 bits.
    for (name, factor) in [
        ("ties", 1.0),
        ("ties, long numbers", 1_000_000_007.0 * 1_000_003.0),
    ] {
        let mut lattice = Vec::new();
        while lattice.len() < 2000 {
            let [i, j] = self::scene(&mut r);
            let exact =
                |m: &(Edges, Edges)| collect(&m.0, &m.1, Ties::Translate).0 == Decided::Exact;
            lattice.extend(pairs(&i, &j, factor).filter(exact));
        }
        scenes.push((name, lattice));
    }
    println!(
        "{:24}{:>8}{:>12}{:>12}{:>10}",
        "", "pairs", "ns a pair", "exactly", "by exact"
    );
    for (name, pairs) in &scenes {
        let mut best = f64::INFINITY;
        let mut exact = 0;
        for _ in 0..if pairs.len() > 2000 { 20 } else { 3 } {
            exact = 0;
            let start = Instant::now();
            for (before, after) in pairs {
                let decided = passages(before, after, Ties::Translate, &mut |p| {
                    black_box(p);
                });
                exact += u64::from(decided == Decided::Exact);
            }
            best = best.min(start.elapsed().as_nanos() as f64 / pairs.len() as f64);
        }
        let few = &pairs[..pairs.len().min(1000)];
        let start = Instant::now();
        for (before, after) in few {
            exactly(before, after, Ties::Translate, &mut |p| {
                black_box(p);
            });
        }
        let exactly = start.elapsed().as_nanos() as f64 / few.len() as f64;
        println!(
            "{name:24}{:8}{best:12.1}{exactly:12.0}{exact:10}",
            pairs.len()
        );
    }
}
