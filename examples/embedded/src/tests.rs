//! The scene in small, verified in this process.

use crate::cage::{Cage, FRAMES, points_of};
use linkwatch::{
    CurveSet, Events, FrameInfo, Positions, Session, SessionOptions, Strategy, Verdict,
};
use sidecar::Scene;

fn knit() -> CurveSet {
    let knit: linkwatch::scenes::Scene = "knit:rows=20,stitches=16,segments=2560".parse().unwrap();
    knit.build().unwrap().curves
}

fn positions(cage: &Cage, model: &CurveSet) -> Vec<f32> {
    let mut out = vec![0.0; 3 * model.points()];
    cage.write_positions(&mut out);
    out
}

/// First frames of a press with a tetrahedron that is turned inside out, and that are changed.
fn first_frames(depth: f64) -> [Option<usize>; 2] {
    let model = knit();
    let counts: Vec<i32> = model.counts().collect();
    let mut cage = Cage::around(&model, depth);
    let mut session = Session::new(SessionOptions {
        events: Events::Between,
        strategy: Strategy::Incremental,
        ..SessionOptions::default()
    })
    .unwrap();
    let [mut turned, mut changed] = [None; 2];
    for frame in 0..FRAMES {
        if frame > 0 {
            cage.advance(1);
        }
        let xyz = positions(&cage, &model);
        let curves = CurveSet::from_counts(model.basis(), &counts, Positions::F32(&xyz)).unwrap();
        let report = session
            .feed(FrameInfo::at(frame as u64, 0.0), curves)
            .unwrap();
        if cage.inverted() > 0 {
            turned.get_or_insert(frame);
        }
        if report.verdict != Verdict::Intact {
            assert_eq!(report.verdict, Verdict::Changed);
            changed.get_or_insert(frame);
        }
    }
    [turned, changed]
}

#[test]
fn a_gentle_press_keeps_the_topology() {
    assert_eq!(first_frames(0.25), [None, None]);
}

#[test]
fn a_press_through_the_cage_breaks_the_yarn_before_a_tetrahedron_is_turned_inside_out() {
    let [turned, changed] = first_frames(1.5).map(Option::unwrap);
    assert!(changed < turned, "{changed} and {turned}");
}

#[test]
fn an_undeformed_cage_keeps_every_point() {
    let knit = knit();
    let cage = Cage::around(&knit, 1.0);
    assert_eq!(cage.inverted(), 0);
    let xyz = positions(&cage, &knit);
    for (p, q) in points_of(&knit).iter().zip(xyz.chunks(3)) {
        assert!(
            (0..3).all(|x| (p[x] - f64::from(q[x])).abs() < 1e-4),
            "{p:?}, {q:?}"
        );
    }
}
