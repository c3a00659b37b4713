//! A sheet of chainmail, flat or crumpled.

use super::isotopy::Isotopy;
use super::pen::Pen;
use super::{Generated, Kind, Parameter, Scene, rounding};
use crate::curve::{Basis, Point};
use crate::error::Result;
use crate::verdict::Link;
use std::f64::consts::TAU;

pub(super) const KIND: Kind = Kind {
    name: "chainmail",
    purpose: "sheet of chainmail, flat or crumpled: very many small curves, few potential links \
              each",
    parameters: &[
        Parameter::integer("rows", 56, 1, 4000).is("rows of flat rings"),
        Parameter::integer("columns", 84, 1, 4000)
            .is("flat rings of a row; 3 * rows * columns rings in all"),
        Parameter::real("crumple", 0.0, 0.0, 1.0).is("degree of crumpling: 0 is flat"),
        Parameter::real("tilt", 2.0, 0.0, 5.0).is(
            "individual rotation of each ring in degrees: at 0 rings lie exactly in axis planes",
        ),
    ],
    build,
};

/// Number of segments of a ring, a regular polygon.
const SEGMENTS: usize = 15;

/// Distance of neighbouring flat rings, whose radius is 1.
const PITCH: f64 = 2.6;

/// Radius of the upright rings.
const CONNECTOR: f64 = 0.9;

/// Lower bound of the distance of any two rings of the flat sheet.
///
/// A flat ring and a connector through it, as circles: `3.5 + 2.34 v - 2.6 u - 1.8 u v` is the
/// squared distance of the points at angles with cosines `u` and `v`. It is linear in each of them,
/// so its minimum is at a corner: 0.6. Two connectors through one flat ring lie in orthogonal
/// planes, at least 0.4 from the common line of these planes, so 0.56 apart. Neighbouring flat
/// rings: 0.6; opposite connectors: 0.8. The distance of polygons from their circles is at most `1
/// - cos(pi / 15) < 0.022`.
const GAP: f64 = 0.52;

/// Builds Japanese 4-in-1 chainmail: flat rings on a square grid, and an upright ring, a connector,
/// through each pair of neighbours. The connectors at the end of a row or column link one flat ring
/// only, so that every flat ring has two connectors of its own, one along the row and one along the
/// column.
///
/// Flat rings run counterclockwise seen from above. The connectors go down through the first of
/// their two flat rings and up through the second.
fn build(scene: &Scene) -> Result<Generated> {
    let (rows, columns) = (scene.count("rows"), scene.count("columns"));
    let crumple = scene.real("crumple");
    // Waves along the diagonal of the sheet, and folds over one another.
    let isotopy = Isotopy::crossed([[60.0, crumple, 0.4], [45.0, 2.5 * crumple, 1.1]]);
    let (width, height) = (PITCH * columns as f64, PITCH * rows as f64);
    let edge = 2.0 * (TAU / 2.0 / SEGMENTS as f64).sin();
    let extent = width.max(height) / 2.0 + PITCH + isotopy.reach();
    // If a ring turns first about a diameter and then about its centre, both by at most the tilt,
    // no point moves further than this.
    let tilt = scene.real("tilt").to_radians();
    let off = 2.0 * (isotopy.sagitta(edge) + rounding(extent));
    let gap = (GAP - 4.0 * tilt) / isotopy.stretch();
    scene.check_gap(gap, off, "take a smaller sheet")?;

    let rings = 3 * rows * columns;
    let mut pen = Pen::new(Basis::Polyline, SEGMENTS * rings);
    let mut links = Vec::with_capacity(4 * rows * columns);
    for row in 0..rows {
        for column in 0..columns {
            let x = PITCH * column as f64 - width / 2.0;
            let y = PITCH * row as f64 - height / 2.0;
            let flat = 3 * (row * columns + column);
            // Converts points of a unit circle, `c` along the first axis of its plane and `s` along
            // the second, `h` out of the plane, to points of space.
            let mut ring = |ring: usize, place: &dyn Fn(f64, f64, f64) -> Point| {
                pen.closed(SEGMENTS, |k| {
                    let [c, s, h] = tilted(TAU * k as f64 / SEGMENTS as f64, ring, tilt);
                    isotopy.apply(place(c, s, h))
                })
            };
            let (half, r) = (PITCH / 2.0, CONNECTOR);
            ring(flat, &|c, s, h| [x + c, y + s, h])?;
            ring(flat + 1, &|c, s, h| [x + half + r * c, y - r * h, r * s])?;
            ring(flat + 2, &|c, s, h| [x + r * h, y + half + r * c, r * s])?;

            let mut link = |i: usize, j: usize, lambda| {
                let [i, j] = [i, j].map(|ring| ring as u32);
                links.push(Link { i, j, lambda });
            };
            link(flat, flat + 1, -1);
            link(flat, flat + 2, -1);
            if column + 1 < columns {
                link(flat + 1, flat + 3, 1);
            }
            if row + 1 < rows {
                link(flat + 2, flat + 3 * columns, 1);
            }
        }
    }
    Ok(Generated::new(pen.finish()?, links))
}

/// Returns the point of a unit circle at an angle, after the ring was turned by up to `tilt` in its
/// plane and about a diameter.
fn tilted(angle: f64, ring: usize, tilt: f64) -> Point {
    // Multiples of irrational numbers spread evenly, so that neighbouring rings differ.
    let spread = |step: f64| (ring as f64 * step).fract();
    let about = TAU * spread(0.618_033_988_749_894_9);
    let angle = angle + tilt * spread(0.414_213_562_373_095_1);
    // Coordinates along the diameter, and across it.
    let (across, along) = (angle - about).sin_cos();
    let (rise, flat) = tilt.sin_cos();
    let (s, c) = about.sin_cos();
    [
        c * along - s * flat * across,
        s * along + c * flat * across,
        rise * across,
    ]
}
