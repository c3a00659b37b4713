//! The scenes in small, verified in this process.

use crate::contact::Segment;
use crate::scene::{garment, tube};
use crate::yarn::Yarn;
use linkwatch::{Basis, Events, FrameInfo, Positions, RawFrame, Session, SessionOptions, Verdict};
use sidecar::Scene;

/// Turns of the small tube that small time steps survive, and large ones do not.
const TURNS: f64 = 0.4;

/// Verifies the frames of a scene up to the first one that is not intact. Returns its number.
fn first_change(yarn: &mut Yarn, frames: u64, steps: usize) -> Option<u64> {
    let options = SessionOptions {
        events: Events::Between,
        ..SessionOptions::default()
    };
    let mut session = Session::new(options).unwrap();
    let counts: Vec<i32> = yarn.loops().iter().map(|n| -(*n as i32)).collect();
    let mut positions = vec![0.0; 3 * yarn.x.len()];
    for frame in 0..frames {
        if frame > 0 {
            yarn.advance(steps);
        }
        yarn.write_positions(&mut positions);
        let raw = RawFrame {
            basis: Basis::Polyline,
            counts: &counts,
            positions: Positions::F32(&positions),
        };
        let report = session.feed(FrameInfo::at(frame, 0.0), raw).unwrap();
        if frame == 0 {
            assert!(
                session.baseline().unwrap().links().is_empty(),
                "linked rows"
            );
        }
        if report.verdict != Verdict::Intact {
            assert_eq!(report.verdict, Verdict::Changed);
            assert!(!report.events.is_empty());
            return Some(frame);
        }
    }
    None
}

#[test]
fn a_wrung_tube_stays_intact_with_small_time_steps_only() {
    assert_eq!(first_change(&mut tube(12, 24, TURNS), 25, 8), None);
    assert!(first_change(&mut tube(12, 24, TURNS), 25, 1).is_some());
}

#[test]
fn a_dropped_garment_stays_intact_with_small_time_steps_only() {
    assert_eq!(first_change(&mut garment(10, 30), 100, 4), None);
    assert!(first_change(&mut garment(10, 30), 100, 1).is_some());
}

#[test]
fn a_tube_at_rest_keeps_its_shape() {
    let mut yarn = tube(8, 16, TURNS);
    let start = yarn.x.clone();
    // Before its ends have moved by more than a thousandth of a turn.
    yarn.step(1e-3);
    let far = yarn.x.iter().zip(&start).map(|(a, b)| a.distance(*b));
    assert!(far.fold(0.0, f32::max) < 0.05);
    assert!((yarn.stretch() - 1.0).abs() < 0.02);
}

/// Rolling back requires this: a clone moves like the original, whatever the age of its list of
/// contacts.
#[test]
fn a_state_leads_to_the_same_motion_again() {
    let mut yarn = tube(8, 16, TURNS);
    yarn.advance(5);
    let mut again = yarn.clone();
    yarn.advance(7);
    again.advance(7);
    assert_eq!(yarn.x, again.x);
    let mut fresh = tube(8, 16, TURNS);
    fresh.advance(5);
    fresh.advance(7);
    assert_eq!(yarn.x, fresh.x);
}

/// The grid against all pairs of segments.
#[test]
fn the_grid_finds_all_pairs_of_segments_that_are_near() {
    let mut yarn = tube(8, 16, TURNS);
    (0..20).for_each(|_| yarn.advance(4));
    let [found, expected] = yarn.near_pairs();
    assert!(expected.len() > 1000, "{}", expected.len());
    assert_eq!(found, expected);
}

#[test]
fn neighbors_along_the_yarn_do_not_collide() {
    let segment = |row, place| Segment {
        ends: [0, 0],
        row,
        place,
        count: 20,
    };
    assert!(segment(0, 1).ignores(&segment(0, 4)));
    assert!(segment(0, 1).ignores(&segment(0, 18)));
    assert!(!segment(0, 1).ignores(&segment(0, 17)));
    assert!(!segment(0, 1).ignores(&segment(1, 1)));
}
