//! Images whose coordinates are no floating-point numbers: the sums need one digit more.
//!
//! One curve has even coordinates near `2^53`, the other one small integers, and the cell has the
//! length `2^53 - 1`. The image of the second curve is near the first one, at integers, half of
//! which are odd and have no floating-point number. Relative to `2^53`, all coordinates are small
//! integers, of which the oracle and a plain verifier have exact results. The shapes are
//! degenerate: they touch, have common planes, and projections that coincide.

use crate::scene::{Point, Scene};
use crate::support::random::Random;
use linkwatch::kernels::oracle;
use linkwatch::{
    Basis, Cell, CurveSet, Events, Positions, PullThrough, Verdict, Verifier, VerifierOptions,
};
use std::sync::Arc;

/// `2^53`: beyond it, only even integers are floating-point numbers.
const FAR: f64 = 9_007_199_254_740_992.0;

/// Two curves with small integers as coordinates; those of the first one are even.
type Shapes = [Vec<[i64; 3]>; 2];

fn random_shapes(random: &mut Random) -> Shapes {
    let n = [0; 2].map(|_| 3 + random.below(4));
    let even = (0..n[0]).map(|_| [0; 3].map(|_| 2 * i64::from(random.below(5))));
    let even = even.collect();
    let any = (0..n[1]).map(|_| [0; 3].map(|_| i64::from(random.below(9))));
    [even, any.collect()]
}

/// Returns the scene in which the first curve, and the image of the second one by `(1, 1, 1)`, have
/// these coordinates relative to `2^53`.
fn far(shapes: &Shapes) -> Scene {
    let cell = Cell::orthogonal([0.0; 3], [FAR - 1.0; 3]);
    let first = shapes[0].iter().map(|p| p.map(|x| FAR + x as f64));
    let second = shapes[1].iter().map(|p| p.map(|x| (x + 1) as f64));
    Scene {
        cell,
        curves: vec![first.collect(), second.collect()],
        closed: true,
        reach: 1,
    }
}

/// Returns the linking number of the first curve and the image; `None` if they touch.
fn found(shapes: &Shapes) -> Option<i64> {
    let certificate = far(shapes).certificate();
    let mut images = certificate.images.iter().flatten();
    // The first curve comes first, so the image is that of the second one.
    let link = images.find(|l| (l.i, l.j, l.image) == (0, 1, [1; 3]));
    match link {
        Some(link) => link.lambda,
        None => Some(0),
    }
}

#[test]
fn linking_numbers_of_rounded_images_are_exact() {
    let mut random = Random::new(31);
    let (mut linked, mut touching, mut odd) = (0, 0, 0);
    for case in 0..3000 {
        let shapes = random_shapes(&mut random);
        let distinct = |c: &[[i64; 3]]| {
            let mut all = c.to_vec();
            all.sort_unstable();
            all.dedup();
            all.len() >= 3
        };
        if !shapes.iter().all(|c| distinct(c)) {
            continue;
        }
        let expected = match oracle::touch(&shapes[0], &shapes[1]) {
            true => None,
            false => oracle::linking_number(&shapes[0], &shapes[1]),
        };
        assert_eq!(found(&shapes), expected, "case {case}: {shapes:?}");
        linked += usize::from(expected.is_some_and(|l| l != 0));
        touching += usize::from(expected.is_none());
        odd += usize::from(shapes[1].as_flattened().iter().any(|x| x % 2 != 0));
    }
    println!("{linked} linked, {touching} touching, {odd} with rounded sums");
    assert!(linked > 50 && touching > 200 && odd > 2000);
}

/// Returns the pull-throughs and the verdict of a step.
fn step(frames: [CurveSet; 2], options: VerifierOptions) -> (Vec<PullThrough>, Verdict) {
    let mut verifier = Verifier::new(options).unwrap();
    let [first, second] = frames.map(Arc::new);
    let _ = verifier.step_shared(0, 0.0, &first).unwrap();
    let report = verifier.step_shared(1, 1.0, &second).unwrap();
    (report.events, report.verdict)
}

#[test]
fn pull_throughs_of_rounded_images_are_exact() {
    let mut random = Random::new(32);
    let mut total = 0;
    for case in 0..600 {
        let shapes = [random_shapes(&mut random), random_shapes(&mut random)];
        let n = [0, 1].map(|side| shapes[0][side].len().min(shapes[1][side].len()));
        let shapes = shapes.map(|[mut a, mut b]| {
            a.truncate(n[0]);
            b.truncate(n[1]);
            [a, b]
        });
        let near = |shapes: &Shapes| {
            let counts = [0, 1].map(|k| -(shapes[k].len() as i32));
            let points: Vec<Point> = shapes
                .iter()
                .flatten()
                .map(|p| p.map(|x| x as f64))
                .collect();
            let positions = Positions::F64(points.as_flattened());
            CurveSet::from_counts(Basis::Polyline, &counts, positions).unwrap()
        };
        let plain = VerifierOptions {
            events: Events::Between,
            motion_limit: Some(f64::INFINITY),
            ..VerifierOptions::default()
        };
        let mut periodic = plain.clone();
        periodic.cell = Some(far(&shapes[0]).cell);
        let (expected, verdict) = step(shapes.each_ref().map(near), plain);
        let (found, found_verdict) = step(shapes.each_ref().map(|s| far(s).set()), periodic);
        let of_image: Vec<_> = found.iter().filter(|e| e.image == [1; 3]).collect();
        let key = |e: &PullThrough| (e.segments, e.sign, (e.fraction * 1e6).round() as i64);
        let keys = |events: &[&PullThrough]| {
            let mut keys: Vec<_> = events.iter().map(|e| key(e)).collect();
            keys.sort_unstable();
            keys
        };
        let expected: Vec<_> = expected.iter().collect();
        assert_eq!(keys(&of_image), keys(&expected), "case {case}: {shapes:?}");
        assert_eq!(found_verdict, verdict, "case {case}");
        total += expected.len();
    }
    assert!(total > 300, "{total} pull-throughs");
}
