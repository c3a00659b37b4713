//! Images whose coordinates are not floating-point numbers: the sums need one more digit.
//!
//! One curve has even coordinates near `2^53`, the other one small integers, and the cell has the
//! length `2^53 - 1`. The image of the second curve is near the first one, at integers half of
//! which are odd and so have no floating-point representation. Relative to `2^53`, all coordinates
//! are small integers, for which the oracle and a session without a cell give exact results. The
//! shapes are degenerate: they touch, have common planes, and have projections that coincide.

use crate::scene::{Point, Scene};
use crate::support::oracle;
use crate::support::random::Random;
use crate::support::session::Step;
use linkwatch::{
    Basis, Cell, CurveSet, Events, FrameInfo, Positions, PullThrough, Session, SessionOptions,
    Verdict,
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

/// Returns a scene in which the first curve and the image of the second one by `(1, 1, 1)` have
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
    let mut images = certificate.images().into_iter().flatten();
    // The first curve comes first, so the image is that of the second one.
    let link = images.find(|l| (l.i, l.j, l.image) == (0, 1, [1; 3]));
    let mut undefined = certificate.undefined().iter();
    match undefined.any(|d| (d.i, d.j, d.image) == (0, Some(1), [1; 3])) {
        true => None,
        false => Some(link.map_or(0, |link| link.lambda)),
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
fn step(frames: [CurveSet; 2], options: SessionOptions) -> (Vec<PullThrough>, Verdict) {
    let mut session = Session::new(options).unwrap();
    let [first, second] = frames.map(Arc::new);
    session.step(0, &first);
    let report = session.step_at(FrameInfo::at(1, 1.0), &second).report;
    (report.events, report.verdict)
}

#[test]
fn pull_throughs_of_rounded_images_are_exact() {
    let mut random = Random::new(32);
    let mut total = 0;
    for case in 0..300 {
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
        let plain = SessionOptions {
            events: Events::Between,
            wrapped: Some(false),
            motion_limit: Some(f64::INFINITY),
            keep_open: true,
            ..SessionOptions::default()
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
    assert!(total > 100, "{total} pull-throughs");
}

/// A yarn from small integers to even integers near `2^53`. Its next period begins where it ends,
/// and half of its coordinates there have no floating-point representation.
struct FarYarn {
    /// Its first vertices, relative to `2^53` in the next period. The first one is even.
    head: Vec<[i64; 3]>,
    /// Its last vertices but one, relative to `2^53`: even, the first one is 0.
    tail: Vec<[i64; 3]>,
}

impl FarYarn {
    fn random(random: &mut Random, sizes: [usize; 2], largest: i32) -> FarYarn {
        let mut any = |k: usize| match k {
            0 => [0; 3].map(|_| 2 * i64::from(random.below(largest / 2))),
            _ => [0; 3].map(|_| i64::from(random.below(largest))),
        };
        let head = (0..sizes[0]).map(&mut any).collect();
        let mut tail: Vec<[i64; 3]> = (0..sizes[1]).map(|_| any(0)).collect();
        tail[0] = [0; 3];
        FarYarn { head, tail }
    }

    /// Returns the yarn as it is given.
    fn set(&self) -> CurveSet {
        let head = self.head.iter().map(|p| p.map(|x| (x + 1) as f64));
        let tail = self.tail.iter().chain(&self.head[..1]);
        let points = head.chain(tail.map(|p| p.map(|x| FAR + x as f64)));
        open(points.collect())
    }

    /// Returns the end of a period and the start of the next one, in small integers.
    fn near(&self) -> CurveSet {
        let first = self.head[self.head.len() - 1].map(|x| (x + 1) as f64 - FAR);
        let near = self.tail.iter().chain(&self.head);
        let near = near.map(|p| p.map(|x| x as f64));
        let points = [first].into_iter().chain(near).chain([[FAR - 1.0; 3]]);
        open(points.collect())
    }

    /// Returns the segments of the yarn and of its next period that correspond to two segments of
    /// [`FarYarn::near`], if these are on both sides of the joint.
    fn segments(&self, [s, t]: [u32; 2]) -> Option<[u32; 2]> {
        let [m, l] = [self.head.len(), self.tail.len()].map(|n| n as u32);
        (s <= l && t > l).then(|| [s + m - 1, t - l - 1])
    }
}

fn open(points: Vec<Point>) -> CurveSet {
    let positions = Positions::F64(points.as_flattened());
    CurveSet::from_counts(Basis::Polyline, &[points.len() as i32], positions).unwrap()
}

/// A yarn and its next period, whose coordinates must be rounded. The pull-throughs are those of
/// the same curve in small integers.
#[test]
fn pull_throughs_of_rounded_periods_of_a_yarn_are_exact() {
    let mut random = Random::new(33);
    let (mut total, mut decided, mut undecided) = (0, 0, 0);
    for case in 0..300 {
        let sizes = [2 + random.below(4) as usize, 1 + random.below(4) as usize];
        let largest = random.pick(&[8, 30, 200]);
        let frames = [0; 2].map(|_| FarYarn::random(&mut random, sizes, largest));
        let plain = SessionOptions {
            events: Events::All,
            wrapped: Some(false),
            motion_limit: Some(f64::INFINITY),
            keep_open: true,
            ..SessionOptions::default()
        };
        let mut periodic = plain.clone();
        periodic.cell = Some(Cell::orthogonal([0.0; 3], [FAR - 1.0; 3]));
        periodic.events = Events::Between;
        let report = |frames: [CurveSet; 2], options: SessionOptions| {
            let mut session = Session::new(options).unwrap();
            let [first, second] = frames.map(Arc::new);
            session.step(0, &first);
            session.step_at(FrameInfo::at(1, 1.0), &second).report
        };
        let near = report(frames.each_ref().map(FarYarn::near), plain);
        let found = report(frames.each_ref().map(FarYarn::set), periodic);
        let yarn = &frames[0];
        let across = |segments: [u32; 2]| yarn.segments(segments);
        if near
            .defects
            .iter()
            .any(|d| across(d.place.segments).is_some())
        {
            assert_ne!(found.verdict, Verdict::Intact, "case {case}");
            assert!(!found.defects.is_empty(), "case {case}: {near:?}");
        }
        if !found.defects.is_empty() {
            undecided += 1;
            continue;
        }
        let key = |segments, e: &PullThrough| (segments, e.sign, (e.fraction * 1e6).round() as i64);
        let expected = near.events.iter();
        let expected = expected.filter_map(|e| Some(key(across(e.segments)?, e)));
        let mut expected: Vec<_> = expected.collect();
        let found = found.events.iter().filter(|e| e.image == [1; 3]);
        let mut found: Vec<_> = found.map(|e| key(e.segments, e)).collect();
        expected.sort_unstable();
        found.sort_unstable();
        assert_eq!(found, expected, "case {case}");
        total += expected.len();
        decided += 1;
    }
    println!("{total} pull-throughs, {decided} decided, {undecided} undecided");
    assert!(total > 30 && decided > 100 && undecided > 15);
}
