//! Two curves on two tori, one inside of the other.

use super::pen::{on_torus, polylines};
use super::{Generated, Kind, MOST_SEGMENTS, Parameter, Scene, rounding};
use crate::error::Result;
use std::f64::consts::TAU;

pub(super) const KIND: Kind = Kind {
    name: "torus_link",
    purpose: "two curves wound on nested tori: one pair with a huge linking number, toroidal * \
              poloidal",
    parameters: &[
        Parameter::integer("segments", 20_000_000, 6, MOST_SEGMENTS).is("segments of both curves"),
        Parameter::integer("toroidal", 1000, -1_000_000, 1_000_000)
            .is("toroidal periods of the inner curve"),
        Parameter::integer("poloidal", 1000, -1_000_000, 1_000_000)
            .is("poloidal periods of the outer curve"),
    ],
    build,
};

/// Tube radii; the radius of the circle is 1.
const TUBES: [f64; 2] = [0.3, 0.4];

/// Builds the curves. The inner curve winds once around the poloidal way, the outer one once around
/// the toroidal way.
///
/// The distance of a chord from its arc is at most half the length of the arc.
fn build(scene: &Scene) -> Result<Generated> {
    let segments = scene.count("segments");
    let (toroidal, poloidal) = (scene.integer("toroidal"), scene.integer("poloidal"));
    let turns = [(toroidal as f64, 1.0), (1.0, poloidal as f64)];
    let step = TAU / (segments / 2) as f64;
    let off = TUBES.iter().zip(turns).map(|(tube, (toroidal, poloidal))| {
        step / 2.0 * (toroidal * (1.0 + tube)).hypot(poloidal * tube) + rounding(1.0 + tube)
    });
    let advice = "take more segments or fewer periods";
    scene.check_gap(TUBES[1] - TUBES[0], off.sum(), advice)?;

    let curves = polylines(2, segments, |i, k, n| {
        let ((toroidal, poloidal), t) = (turns[i], TAU * k as f64 / n as f64);
        on_torus(TUBES[i], toroidal * t, poloidal * t)
    });
    Ok(Generated::pair(curves?, toroidal * poloidal))
}
