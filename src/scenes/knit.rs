//! A knitted tube.

use super::pen::Pen;
use super::{Generated, Kind, MOST_SEGMENTS, Parameter, Scene, rounding};
use crate::curve::Basis;
use crate::error::Result;
use std::f64::consts::TAU;

pub(super) const KIND: Kind = Kind {
    name: "knit",
    purpose: "knitted tube of stockinette, Catmull-Rom splines: a garment; every row in contact with two others",
    parameters: &[
        Parameter::integer(
            "rows",
            250,
            (1, 20_000),
            "rows, each a closed yarn around the tube",
        ),
        Parameter::integer("stitches", 90, (16, 20_000), "stitches of a row"),
        Parameter::integer(
            "segments",
            270_000,
            (128, MOST_SEGMENTS),
            "segments of all rows; the same 8 or more for each stitch",
        ),
        Parameter::real(
            "diameter",
            1.0,
            (1e-3, 1e3),
            "diameter of the yarn, in units of the scene",
        ),
    ],
    build,
};

/// A stitch is `(t + OVERHANG sin 2t, HEIGHT cos t, DEPTH cos 2t)` for a turn of `t`, after Leaf & Glaskin 1955: along the row,
/// along the tube, and out of it. Its legs are in front, its head and its feet behind.
const OVERHANG: f64 = 1.485;
const HEIGHT: f64 = 3.4;
const DEPTH: f64 = -1.25;

/// From one row to the next.
const ROW: f64 = 4.0;

/// Diameter of the yarn in the units of these constants. Centre lines are 1.3 of it apart where they come nearest: the
/// four strands that pass a stitch at any height have the width of a turn of `t`.
const DIAMETER: f64 = 1.2;

/// Each row goes through the loops of the row below: behind its head, in front of its legs.
///
/// No two rows are linked. The reflection that takes `t` to `-t` takes every row to itself, backwards. Linking numbers
/// change their sign in a mirror, and stay the same where both curves are reversed: they equal
/// their negatives. (Rows can be ravelled one by one, from the last.)
fn build(scene: &Scene) -> Result<Generated> {
    let (rows, stitches) = (scene.count("rows"), scene.count("stitches"));
    let segments = scene.count("segments");
    let each = segments / (rows * stitches);
    if each < 8 || segments % (rows * stitches) != 0 {
        return Err(scene.refuse(format!(
            "segments must be a multiple of rows * stitches = {}, 8 times it or more",
            rows * stitches
        )));
    }
    let scale = scene.real("diameter") / DIAMETER;
    // The circumference is a turn of `t` for every stitch.
    let radius = stitches as f64;
    let length = ROW * (rows - 1) as f64;
    let extent = (radius - DEPTH).max(length / 2.0 + HEIGHT);
    // Coarse splines are off the curve as well.
    let advice = "take fewer rows or stitches";
    scene.check_gap(0.1 * DIAMETER, 2.0 * rounding(extent), advice)?;

    let n = each * stitches;
    let mut pen = Pen::new(Basis::CatmullRom, rows, segments);
    for row in 0..rows {
        let start = ROW * row as f64 - length / 2.0;
        pen.closed(n, |k| {
            let t = TAU * k as f64 / each as f64;
            let along = (t + OVERHANG * (2.0 * t).sin()) / radius;
            let out = scale * (radius + DEPTH * (2.0 * t).cos());
            let up = scale * (start + HEIGHT * t.cos());
            [out * along.cos(), out * along.sin(), up]
        })?;
    }
    Ok(Generated::new(pen.finish()?, Vec::new()))
}
