//! Sums of passages of random polygons, compared with the linking numbers of the oracle.

use super::*;
use crate::curve::vector::per_axis;
use crate::kernels::tests::oracle;

/// A polygon in both frames.
type Moving = [Polygon; 2];

fn edge(p: &Polygon, k: usize, scale: f64) -> [Point; 2] {
    [p[k], p[(k + 1) % p.len()]].map(|p| p.map(|x| x as f64 * scale))
}

/// Returns all pairs of edges of two polygons, in both frames.
pub(super) fn pairs<'a>(
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
pub(super) fn scene(r: &mut Random) -> [Moving; 2] {
    let range = r.pick(&[2, 3, 4, 5, 8, 30, 1000, 1 << 20]);
    let random = |r: &mut Random| {
        let n = 3 + r.below(4);
        let mut moving = [0, 1].map(|_| r.points(n, range));
        if r.one_in(3) {
            // Edges that are points, in one frame or in both.
            let k = r.below(n);
            let frames = 1 + r.below(3);
            for (f, polygon) in moving.iter_mut().enumerate() {
                if frames >> f & 1 == 1 {
                    polygon[k] = polygon[(k + 1) % n];
                }
            }
        }
        moving
    };
    let mut scene = [random(r), random(r)];
    let vector = |r: &mut Random, size: i64| [0; 3].map(|_| r.below(2 * size + 1) - size);
    let moved = |p: &Polygon, v: [i64; 3]| -> Polygon {
        p.iter().map(|p| per_axis(|x| p[x] + v[x])).collect()
    };
    match r.below(8) {
        // Arbitrary motion.
        0 | 1 => {}
        // All vertices of one polygon, or of both, stay in a plane.
        2 => {
            let (axis, both) = (r.below(3), r.one_in(2));
            let heights = [r.below(3), r.below(3)];
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
                if r.one_in(2) {
                    scene[0][1][k] = scene[0][0][k];
                }
            }
        }
        // One or two vertices move along the line of an edge of the other polygon, from beyond one
        // end to beyond the other.
        6 => {
            scene[1][1] = scene[1][0].clone();
            let l = r.below(scene[1][0].len());
            let (q, d) = (scene[1][0][l], scene[1][0][(l + 1) % scene[1][0].len()]);
            let on = |m: i64| per_axis(|x| q[x] + m * (d[x] - q[x]));
            let k = r.below(scene[0][0].len());
            (scene[0][0][k], scene[0][1][k]) = (on(-1), on(2));
            if r.one_in(2) {
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
    let turn = r.below(3);
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
        match r.below(6) {
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
                let power = r.pick(&[-1074, -1022, -700, -300, 300, 700, 1000]);
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
        let range = r.pick(&[2, 3, 5, 30]);
        let last = [&i, &j].map(|m| match r.below(3) {
            0 => m[0].clone(),
            1 => m[1].clone(),
            _ => r.points(m[0].len(), range),
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
        let scale = 2f64.powi(r.below(40) - 20);
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
