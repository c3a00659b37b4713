//! The floating-point filter, exact arithmetic and the Cauchy index, compared with one another.

use super::*;
use crate::curve::vector::per_axis;
use crate::exact::passage::exact::{MovingEdges, TRANSLATION, events};
use crate::exact::passage::polynomial::{Interval, Polynomial, index};
use crate::exact::passage::ring::Infinitesimal;
use crate::exact::segments_touch;

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
        // A result that the filter decides has no ties, so it does not depend on which curve is
        // translated.
        assert_eq!(collect_exactly(before, after, Ties::Report).1, exact);
    }
    decided
}

#[test]
fn methods_agree_on_random_motions() {
    let mut r = Random::new(3);
    let (mut certified, mut several, n) = (0, 0, 4000);
    for _ in 0..n {
        let (gap, motion) = (r.pick(&[0.0, 0.1, 1.0]), r.pick(&[0.1, 1.0, 3.0]));
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
pub(super) fn meeting(r: &mut Random, gap: f64, motion: f64) -> (Edges, Edges) {
    let along = |p: Point, d: Point, t: f64| per_axis(|x| p[x] + t * d[x]);
    let place = r.point(10.0);
    let mut edge = |from: Point| {
        let (d, s) = (r.point(1.0), 0.5 + r.between(-0.4, 0.4));
        [along(from, d, -s), along(from, d, 1.0 - s)]
    };
    let first = edge(place);
    let second = edge(place);
    let off = r.point(gap);
    let half = r.point(motion);
    let middle = [first, second.map(|p| along(p, off, 1.0))];
    let mut moved = |t: f64| {
        let mut side = 0.0;
        middle.map(|e| {
            side += 1.0;
            e.map(|p| along(along(p, half, t * side), r.point(motion), 0.3))
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
        let ulps = r.pick(&[1, 3, 100, 1 << 20]);
        let mut frame = || {
            [0; 2].map(|_| {
                [0; 2].map(|_| {
                    [0; 3].map(|_| {
                        let x = (r.below(5) - 2) as f64 / 3.0;
                        let by = if r.one_in(3) {
                            r.below(2 * ulps + 1) - ulps
                        } else {
                            0
                        };
                        x * (1.0 + by as f64 * f64::EPSILON)
                    })
                })
            })
        };
        let (mut before, mut after) = (frame(), frame());
        if r.one_in(2) {
            // Exponents at which products underflow or overflow, with equal or different ones per
            // axis.
            const POWERS: [i32; 10] = [-1060, -500, -205, -190, -40, 0, 40, 190, 205, 500];
            let powers = match r.below(4) {
                0 => [0; 3].map(|_| POWERS[r.below(10)]),
                1 => [330 + r.below(20); 3],
                _ => [-(335 + r.below(30)); 3],
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

/// Same as [`assert_methods_agree`], for the signs only, because places near ties are inaccurate.
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
        let range = r.pick(&[2, 3, 4]);
        let frames =
            [0; 2].map(|_| [0; 2].map(|_| [0; 2].map(|_| [0; 3].map(|_| r.below(range) as f64))));
        let [before, after] = &frames;
        if frames.iter().any(segments_touch) {
            continue;
        }
        let motion = MovingEdges::new(before, after);
        let all = events(before, after, Ties::Translate).unwrap();
        let all: i32 = all.iter().map(|e| e.sign).sum();
        let count = |exponents: [u32; 3]| {
            let translated = motion.translated(exponents);
            let [x, y, z] = per_axis(|w| translated.net_passages(&Interval::step(), w));
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
        let ends = [0; 2].map(|_| [0; 3].map(|_| (r.below(9) - 4) as f64));
        let mut frames =
            [(-1.0, ends[0]), (1.0, ends[1])].map(|(y, end)| [[[0.0; 3], end], edge(y)]);
        if r.one_in(2) {
            frames.iter_mut().for_each(|f| f[0].reverse());
        }
        let translated = MovingEdges::new(&frames[0], &frames[1]).translated(TRANSLATION);
        let counts = per_axis(|w| translated.net_passages(&Interval::step(), w));
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
