//! Single jersey: rows of stitches, each hooked through the row below.
//!
//! A row is `x = t + 1.2 sin 2t`, `y = 2 cos t`, `z = 0.6 cos 2t`, a stitch for each turn of `t`.
//! The next row is the same, moved by 2 along y. Seen along z, two rows cross four times in each
//! stitch: the head of the lower row, at `t = 0.46` and `-0.46`, passes over the legs of the upper
//! row, at `t = 1.68` and `-1.68`; and at the mirrored places, the legs of the lower row pass under
//! the feet of the upper one.

use crate::scene::{Point, Scene, translation};
use crate::support::random::Random;
use crate::support::session::Step;
use linkwatch::{
    Basis, Certifier, CurveSet, Events, Positions, PullThrough, Session, Strategy, Verdict,
};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Distance of two rows.
const ROW: f64 = 2.0;

/// Number of segments of a stitch.
const SEGMENTS: i32 = 64;

/// Parameters of a crossing of a head and a leg: of the lower and of the upper row.
const CROSSING: [f64; 2] = [0.46, 1.68];

/// Returns a point of a row. `lowered` is the distance by which the head is moved down along z,
/// where it crosses the next row; the legs stay.
fn stitch(row: i32, t: f64, lowered: f64) -> Point {
    let head = (t.cos() - 0.45).max(0.0) / (CROSSING[0].cos() - 0.45);
    [
        t + 1.2 * (2.0 * t).sin(),
        2.0 * t.cos() + f64::from(row) * ROW,
        0.6 * (2.0 * t).cos() - lowered * head,
    ]
}

/// Returns a part of a row.
fn part([from, to]: [f64; 2], point: impl Fn(f64) -> Point) -> Vec<Point> {
    let n = ((to - from) / TAU * f64::from(SEGMENTS)).round() as i32;
    let at = |k: i32| from + (to - from) * f64::from(k) / f64::from(n);
    (0..=n).map(|k| point(at(k))).collect()
}

/// Returns a unit cell of two rows. They start at these parameters, and the heads of the lower one
/// are lowered.
fn jersey(starts: [f64; 2], lowered: f64) -> Scene {
    let row = |row: i32, start: f64, lowered: f64| {
        part([start, start + TAU], |t| stitch(row, t, lowered))
    };
    Scene {
        cell: format!("{TAU},{},0", 2.0 * ROW).parse().unwrap(),
        curves: vec![row(0, starts[0], lowered), row(1, starts[1], 0.0)],
        closed: false,
        reach: 2,
    }
}

/// Returns the linking number of two closed polylines.
fn linking_number(loops: [Vec<Point>; 2]) -> i64 {
    let counts = loops.each_ref().map(|c| -(c.len() as i32));
    let points = loops.concat();
    let positions = Positions::F64(points.as_flattened());
    let set = CurveSet::from_counts(Basis::Polyline, &counts, positions).unwrap();
    let mut certifier = Certifier::default();
    let (certificate, _) = certifier.certify(&set);
    assert!(certificate.undefined().is_empty());
    certificate.links().first().map_or(0, |l| l.lambda)
}

/// Returns the linking number of the head of the lower row, closed below, and of a part of the
/// upper row, closed far above along z.
fn closed_by_hand(upper: [f64; 2], lowered: f64) -> i64 {
    let head = part([-2.2, 2.2], |t| stitch(0, t, lowered));
    let mut leg = part(upper, |t| stitch(1, t, 0.0));
    let ends = [leg[leg.len() - 1], leg[0]];
    leg.extend(ends.map(|[x, y, _]| [x, y, 10.0]));
    linking_number([head, leg])
}

#[test]
fn each_row_is_hooked_through_the_row_below() {
    let [right, left] = [[0.0, PI], [-PI, 0.0]];
    assert_eq!(closed_by_hand(right, 0.0).abs(), 1);
    assert_eq!(closed_by_hand(left, 0.0), -closed_by_hand(right, 0.0));
    // Both legs pass through the head, so the stitch as a whole is not linked with it.
    assert_eq!(closed_by_hand([-PI, PI], 0.0), 0);
    for half in [right, left] {
        assert_eq!(
            closed_by_hand(half, 1.5),
            0,
            "the head was lowered below the legs"
        );
    }
}

#[test]
fn a_jersey_that_moves_a_little_is_intact() {
    for strategy in [Strategy::Full, Strategy::Incremental, Strategy::Paranoid] {
        let scene = jersey([0.3, -1.0], 0.0);
        let mut session = Session::new(scene.options(strategy, Events::Between)).unwrap();
        let mut random = Random::new(61);
        for seq in 0..20 {
            let mut frame = scene.clone();
            for row in &mut frame.curves {
                for p in row.iter_mut() {
                    *p = p.map(|x| x + 0.05 * (2.0 * random.unit() - 1.0));
                }
                let by = translation(&scene.cell, [1, 0, 0]);
                let last = row.len() - 1;
                row[last] = [0, 1, 2].map(|x| row[0][x] + by[x]);
            }
            session.settle();
            let set = Arc::new(frame.set());
            let verified = session.step(seq, &set);
            let report = verified.report;
            assert_eq!(report.verdict, Verdict::Intact, "{strategy:?}: {report:?}");
            assert!(!verified.work.disagreed);
        }
    }
}

/// The heads of the lower row are lowered through the legs of the upper row, step by step: both
/// legs are pulled out. Rows start anywhere, also in the middle of the head, so that legs and heads
/// are at the boundary of the cell.
#[test]
fn loops_pulled_out_of_the_row_below_are_found_at_their_places() {
    let [head, leg] = CROSSING;
    let starts = [-PI, -leg, -head, 0.0, head, leg, 2.5, 5.0];
    for (start, other) in starts.into_iter().flat_map(|a| starts.map(|b| (a, b))) {
        for strategy in [Strategy::Full, Strategy::Incremental] {
            let name = format!("starts {start} and {other}, {strategy:?}");
            let frames = (0..50).map(|k| jersey([start, other], 0.03 * f64::from(k)));
            let scene = jersey([start, other], 0.0);
            let options = scene.options(strategy, Events::Between);
            let mut session = Session::new(options).unwrap();
            let mut events = Vec::new();
            for (seq, frame) in frames.enumerate() {
                let set = Arc::new(frame.set());
                let report = session.step(seq as u64, &set).report;
                let expected = match report.events.is_empty() {
                    true => Verdict::Intact,
                    false => Verdict::Changed,
                };
                assert_eq!(report.verdict, expected, "{name}: {report:?}");
                events.extend(report.events);
            }
            let sides = events
                .iter()
                .map(|e| check(&scene, [start, other], e, &name));
            let mut sides: Vec<i64> = sides.collect();
            sides.sort_unstable();
            assert_eq!(sides, [-1, 1], "{name}: one for each leg: {events:?}");
        }
    }
}

/// Checks the place and the sign of a pull-through of a head and a leg. Returns the side of the
/// leg: 1 if it is on the right.
fn check(scene: &Scene, starts: [f64; 2], e: &PullThrough, name: &str) -> i64 {
    assert_eq!((e.i, e.j), (0, 1), "{name}: {e:?}");
    let step = TAU / f64::from(SEGMENTS);
    let t = [0, 1].map(|side| starts[side] + step * (f64::from(e.segments[side]) + 0.5));
    // The point is on both rows, of which the second one is translated.
    let by = translation(&scene.cell, e.image);
    let [lower, upper] = [stitch(0, t[0], 0.0), stitch(1, t[1], 0.0)];
    for x in 0..2 {
        assert!((e.point[x] - lower[x]).abs() < 0.2, "{name}: {e:?}");
        assert!((e.point[x] - upper[x] - by[x]).abs() < 0.2, "{name}: {e:?}");
    }
    // Parameters of the stitch, from -pi to pi.
    let [lower, upper] = t.map(|t| (t + PI).rem_euclid(TAU) - PI);
    let side = if lower > 0.0 { 1 } else { -1 };
    assert!(
        (lower.abs() - CROSSING[0]).abs() < step,
        "{name}: {lower} {e:?}"
    );
    assert!(
        (upper - f64::from(side) * CROSSING[1]).abs() < step,
        "{name}: {upper} {e:?}"
    );
    // The linking number of the leg closed by hand, which is 0 afterwards.
    let half = if side > 0 { [0.0, PI] } else { [-PI, 0.0] };
    assert_eq!(
        i64::from(e.sign),
        -closed_by_hand(half, 0.0),
        "{name}: {e:?}"
    );
    side.into()
}
