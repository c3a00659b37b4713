//! The scene in small, verified in this process.

use crate::scene::{Bands, POINTS};
use linkwatch::{Basis, Events, FrameInfo, Positions, RawFrame, Session, SessionOptions, Verdict};
use sidecar::Scene;

fn positions(bands: &Bands) -> Vec<f32> {
    let mut positions = vec![0.0; 3 * POINTS * bands.bands()];
    bands.write_positions(&mut positions);
    positions
}

/// Verifies the frames of a scene up to the first one that is not intact. Returns its number.
fn first_change(mut bands: Bands, frames: u64, steps: usize) -> Option<u64> {
    let options = SessionOptions {
        events: Events::Between,
        ..SessionOptions::default()
    };
    let mut session = Session::new(options).unwrap();
    let counts = vec![-(POINTS as i32); bands.bands()];
    for frame in 0..frames {
        if frame > 0 {
            bands.advance(steps);
        }
        let raw = RawFrame {
            basis: Basis::Polyline,
            counts: &counts,
            positions: Positions::F32(&positions(&bands)),
        };
        let report = session.feed(FrameInfo::at(frame, 0.0), raw).unwrap();
        if frame == 0 {
            assert!(
                session.baseline().unwrap().links().is_empty(),
                "linked bands"
            );
        }
        if report.verdict != Verdict::Intact {
            assert_eq!(report.verdict, Verdict::Changed);
            return Some(frame);
        }
    }
    None
}

#[test]
fn bands_stay_unlinked_with_small_time_steps_only() {
    assert_eq!(first_change(Bands::new(128), 60, 20), None);
    assert!(first_change(Bands::new(128), 60, 4).is_some());
}

/// Rolling back requires this.
#[test]
fn a_copy_of_the_bands_moves_as_the_bands_do() {
    let mut bands = Bands::new(64);
    (0..40).for_each(|_| bands.advance(8));
    let mut copy = bands.clone();
    bands.advance(16);
    copy.advance(16);
    assert_eq!(positions(&bands), positions(&copy));
}

#[test]
fn bands_stay_above_the_ground_and_unstretched() {
    let mut bands = Bands::new(64);
    (0..60).for_each(|_| bands.advance(20));
    let lowest = positions(&bands).into_iter().skip(2).step_by(3);
    assert!(lowest.fold(f32::MAX, f32::min) > 0.0);
    assert!((0.9..1.1).contains(&bands.stretch()), "{}", bands.stretch());
}
