//! A pile of rubber bands.

use super::isotopy::Isotopy;
use super::pen::Pen;
use super::{Generated, Kind, Parameter, Scene, rounding};
use crate::curve::Basis;
use crate::error::Result;
use crate::random::Random;
use std::f64::consts::TAU;

pub(super) const KIND: Kind = Kind {
    name: "rubber_bands",
    purpose: "pile of rubber bands: many small curves and many potential links, none of them \
              linked",
    parameters: &[
        Parameter::integer("bands", 1024, 1, 1_000_000).is("bands, of 50 segments each"),
        Parameter::integer("seed", 1, 0, u32::MAX as i64)
            .is("seed of the shapes and places of the bands"),
    ],
    build,
};

/// Number of segments of a band.
const SEGMENTS: usize = 50;

/// Mean radius of a band.
const RADIUS: f64 = 0.8;

/// Relative amplitude of the radius of a band, with two periods around it.
const OVAL_AMPLITUDE: f64 = 0.25;

/// Side of the square cell of a band in its layer.
const CELL: f64 = 2.15;

/// Distance of layers.
const LAYER: f64 = 0.12;

/// Builds the pile. The bands lie flat in layers, each in its own cell. No two are linked, because
/// planes separate them. Then space is deformed, and the bands with it, until their boxes overlap.
fn build(scene: &Scene) -> Result<Generated> {
    let bands = scene.count("bands");
    // Four times as many layers as bands along a side.
    let is_enough = |side: &usize| 4 * side * side * side >= bands;
    let side = (1..).find(is_enough).unwrap_or(1);
    let layers = bands.div_ceil(side * side);
    // Waves a few bands long, which fold over one another.
    let isotopy = Isotopy::crossed([0.5, 0.9].map(|phase| [13.0, 1.55, phase]));
    let gap = LAYER.min(CELL - 2.0 * RADIUS * (1.0 + OVAL_AMPLITUDE));
    // The radius changes by up to twice `OVAL_AMPLITUDE` of itself per radian.
    let edge = TAU / SEGMENTS as f64 * RADIUS * (1.0 + OVAL_AMPLITUDE).hypot(2.0 * OVAL_AMPLITUDE);
    let extent = CELL * (side + 1) as f64 / 2.0 + isotopy.reach();
    let off = 2.0 * (isotopy.sagitta(edge) + rounding(extent));
    scene.check_gap(gap / isotopy.stretch(), off, "take fewer bands")?;

    let mut random = Random::new(scene.integer("seed") as u64);
    let mut pen = Pen::new(Basis::Polyline, SEGMENTS * bands);
    let middle = side as f64 / 2.0;
    for layer in 0..layers {
        let z = LAYER * (layer as f64 - layers as f64 / 2.0);
        let shift = [0; 2].map(|_: i32| random.unit() - middle);
        let first = layer * side * side;
        for band in first..bands.min(first + side * side) {
            let (row, column) = ((band - first) / side, (band - first) % side);
            let x = CELL * (column as f64 + shift[0]);
            let y = CELL * (row as f64 + shift[1]);
            let turned = TAU * random.unit();
            pen.closed(SEGMENTS, |k| {
                let t = TAU * k as f64 / SEGMENTS as f64;
                let r = RADIUS * (1.0 + OVAL_AMPLITUDE * (2.0 * (t - turned)).cos());
                isotopy.apply([x + r * t.cos(), y + r * t.sin(), z])
            })?;
        }
    }
    Ok(Generated::new(pen.finish()?, Vec::new()))
}
