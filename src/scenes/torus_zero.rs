//! Four curves on nested tori that turn back after every period.

use super::pen::{on_torus, polylines};
use super::{Generated, Kind, MOST_SEGMENTS, Parameter, Scene, rounding};
use crate::error::Result;
use std::f64::consts::TAU;

pub(super) const KIND: Kind = Kind {
    name: "torus_zero",
    purpose: "four curves on nested tori that turn back after every period: many crossings, all \
              of which cancel",
    parameters: &[
        Parameter::integer("segments", 400_000, 12, MOST_SEGMENTS).is("segments of all curves"),
        Parameter::integer("periods", 100, 2, 1_000_000)
            .is("periods of each curve; even, so that it closes"),
    ],
    build,
};

/// Tube radii; the radius of the circle is 1. The first curve goes back and forth the toroidal way,
/// the others are copies of one that goes back and forth the poloidal way.
const TUBES: [f64; 4] = [0.3, 0.4, 0.5, 0.6];

/// Builds the curves. For any two curves, the inner one has 0 toroidal turns in all, or the outer
/// one has 0 poloidal turns, so no pair is linked.
///
/// The distance of a chord from its arc is at most half the length of the arc, also if the curve
/// turns back in between.
fn build(scene: &Scene) -> Result<Generated> {
    let (segments, periods) = (scene.count("segments"), scene.count("periods"));
    if periods % 2 == 1 {
        return Err(scene.error("an odd number of periods leaves the curves open"));
    }
    let step = TAU / (segments / 4) as f64;
    let outermost = 1.0 + TUBES[3];
    let speed = (periods as f64 + 1.0) * outermost;
    let off = 2.0 * (step / 2.0 * speed + rounding(outermost));
    scene.check_gap(0.1, off, "take more segments or fewer periods")?;

    let curves = polylines(4, segments, |i, k, n| {
        let t = k as f64 / n as f64;
        let phase = (t * periods as f64).rem_euclid(2.0);
        let there_and_back = phase.min(2.0 - phase);
        match i {
            0 => on_torus(TUBES[i], TAU * there_and_back, TAU * t),
            _ => on_torus(TUBES[i], TAU * t, TAU * there_and_back),
        }
    });
    Ok(Generated::new(curves?, Vec::new()))
}
