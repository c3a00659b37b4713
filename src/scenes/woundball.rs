//! Two balls of yarn, one inside of the other.

use super::pen::polylines;
use super::{Generated, Kind, MOST_SEGMENTS, Parameter, Scene, rounding};
use crate::error::Result;
use std::f64::consts::TAU;

pub(super) const KIND: Kind = Kind {
    name: "woundball",
    purpose: "two concentric spherical curves, one half the size of the other: long segments, \
              unlinked",
    parameters: &[
        Parameter::integer("segments", 1_000_000, 6, MOST_SEGMENTS).is("segments of both curves"),
        Parameter::integer("crossings", 1000, 1, 10_000_000)
            .is("times that each curve crosses the north pole"),
    ],
    build,
};

/// Builds the curves. A curve goes around the poles `crossings` times while it goes around the axis
/// once.
///
/// The inner curve and its chords lie in the ball of radius 1. A chord of the outer one spans an
/// angle of at most `step sqrt(crossings^2 + 1)`, so its distance from the centre is at least twice
/// the cosine of half of it. A sphere between the curves separates them, so they are not linked.
fn build(scene: &Scene) -> Result<Generated> {
    let (segments, crossings) = (scene.count("segments"), scene.real("crossings"));
    let angle = TAU / (segments / 2) as f64 * crossings.hypot(1.0);
    let advice = "take more segments or fewer crossings";
    // Beyond a quarter turn the cosine gives no bound.
    let cosine = if angle < 1.0 {
        (angle / 2.0).cos()
    } else {
        0.0
    };
    let depth = 2.0 - 2.0 * cosine;
    scene.check_gap(1.0, depth + rounding(1.0) + rounding(2.0), advice)?;

    let curves = polylines(2, segments, |i, k, n| {
        let (radius, t) = ([2.0, 1.0][i], TAU * k as f64 / n as f64);
        let ((s, c), (sp, cp)) = (t.sin_cos(), (crossings * t).sin_cos());
        [radius * sp * c, radius * sp * s, radius * cp]
    });
    Ok(Generated::pair(curves?, 0))
}
