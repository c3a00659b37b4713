//! The double helix ribbon: two strands around one circle, twisted around each other.

use super::pen::{on_torus, polylines};
use super::{Generated, Kind, MOST_SEGMENTS, Parameter, Scene, rounding, sagitta};
use crate::error::Result;
use std::f64::consts::{PI, TAU};

pub(super) const KIND: Kind = Kind {
    name: "ribbon",
    purpose: "double helix ribbon: one pair of long curves, for the cost of a single pair by \
              length and twist",
    parameters: &[
        Parameter::integer("segments", 200_000, 6, MOST_SEGMENTS).is("segments of both strands"),
        Parameter::integer("lambda", 10, -1_000_000, 1_000_000).is("twists: the linking number"),
    ],
    build,
};

/// Half of the maximum width of the ribbon, unless the twist requires less; the radius of its
/// circle is 1.
const WIDEST: f64 = 0.05;

/// Length of a full twist in half widths, as in DNA (3.4 nm, and a radius of 1 nm).
const PITCH: f64 = 3.4;

/// Returns half of the width of a ribbon with this number of twists.
fn half_width(twist: f64) -> f64 {
    (TAU / (twist.abs() * PITCH)).min(WIDEST)
}

/// Builds the ribbon. Both strands wind `lambda` times around the circle, half a turn apart.
///
/// Distance of two points of a torus with tube radius `e`, whose toroidal angles differ by `2 x`
/// and whose poloidal angles by `2 y`: its square is at least `4 e^2 sin^2 y + 4 (1 - e)^2 sin^2
/// x`. On the strands `y = lambda x + pi / 2`, so with `u = 2 |x| / pi` and `|sin x| >= u` it is at
/// least `4 e^2 (1 - |lambda| u)^2 + 4 (1 - e)^2 u^2` up to `u = 1 / |lambda|`, and no smaller
/// beyond. The distance is at least twice that of the origin from the line through `(e, 0)` and
/// `(0, (1 - e) / |lambda|)`.
///
/// Second derivative: a strand is the unit circle and, with `w` for `lambda`, `e` times `(cos(w t)
/// cos t, cos(w t) sin t, sin(w t))`. The first two components together have a second derivative of
/// at most `1 + w^2`, the third one of at most `w^2`; `(1 + |w|)^2` is an upper bound of both.
fn build(scene: &Scene) -> Result<Generated> {
    let (segments, lambda) = (scene.count("segments"), scene.integer("lambda"));
    let twist = lambda as f64;
    let tube = half_width(twist);
    let reach = 1.0 - tube;
    let gap = 2.0 * tube * reach / (twist * tube).hypot(reach);
    let acceleration = 1.0 + 2f64.sqrt() * tube * (1.0 + twist.abs()).powi(2);
    let off = sagitta(TAU / (segments / 2) as f64, acceleration) + rounding(1.0 + tube);
    scene.check_gap(gap, 2.0 * off, "take more segments or a smaller lambda")?;

    let strands = polylines(2, segments, |strand, k, n| {
        // The vertices of the strands alternate, because crossing strands would otherwise have
        // vertices exactly above one another.
        let t = TAU * (k as f64 + 0.5 * strand as f64) / n as f64;
        on_torus(tube, t, twist * t + PI * strand as f64)
    });
    Ok(Generated::pair(strands?, lambda))
}
