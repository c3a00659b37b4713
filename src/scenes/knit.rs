//! A knitted tube.

use super::pen::Pen;
use super::{Generated, Kind, MOST_SEGMENTS, Parameter, Scene};
use crate::curve::Basis;
use crate::error::Result;
use std::f64::consts::TAU;

pub(super) const KIND: Kind = Kind {
    name: "knit",
    purpose: "knitted tube of stockinette, Catmull-Rom splines: a garment; rows go through the \
              loops of the row below",
    parameters: &[
        Parameter::integer("rows", 250, 1, 20_000).is("rows, each a closed yarn around the tube"),
        Parameter::integer("stitches", 90, 16, 20_000).is("stitches of a row"),
        Parameter::integer("segments", 270_000, 128, MOST_SEGMENTS)
            .is("segments of all rows; 8 or more, equal for all stitches"),
        Parameter::real("diameter", 1.0, 1e-3, 1e3)
            .is("diameter of the yarn, in units of the scene"),
    ],
    build,
};

/// Coefficients of a stitch: `(t + OVERHANG sin 2t, HEIGHT cos t, DEPTH cos 2t)` for a turn of `t`,
/// along the row, along the tube, and out of it (Crane, *A Simple Parametric Model of Plain-Knit
/// Yarns*). Its legs are in front, its head and its feet behind.
const OVERHANG: f64 = 1.485;
const HEIGHT: f64 = 3.4;
const DEPTH: f64 = -1.25;

/// Distance of two rows.
const ROW: f64 = 4.0;

/// Diameter of the yarn in the units of these constants. The four strands that pass a stitch at any
/// height share a turn of `t`. The minimum distance of centre lines is 1.3 diameters, or 1.2 for
/// coarse splines (fewer than twelve segments per stitch). Tested below.
const DIAMETER: f64 = 1.16;

/// Builds the tube. Each row goes through the loops of the row below: behind their legs, in front
/// of their heads.
///
/// No two rows are linked. The reflection that takes `t` to `-t` takes every row to itself,
/// backwards. Linking numbers change their sign in a mirror, and stay the same if both curves are
/// reversed, so they equal their negatives. (This is why knitting can be ravelled, from the last
/// row on.) Rounding moves points by less than a hundredth of the distance of rows, for all
/// parameters, because coordinates stay below 41,000 units of the constants.
fn build(scene: &Scene) -> Result<Generated> {
    let (rows, stitches) = (scene.count("rows"), scene.count("stitches"));
    let segments = scene.count("segments");
    let each = segments / (rows * stitches);
    if each < 8 || !segments.is_multiple_of(rows * stitches) {
        return Err(scene.error(format!(
            "segments must be a multiple of rows * stitches = {}, 8 times it or more",
            rows * stitches
        )));
    }
    let scale = scene.real("diameter") / DIAMETER;
    // The circumference is one turn of `t` per stitch.
    let radius = stitches as f64;
    let length = ROW * (rows - 1) as f64;
    let n = each * stitches;
    let mut pen = Pen::new(Basis::CatmullRom, segments);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::vector::{distance, per_axis, sub};
    use crate::curve::{CurveSet, Point};

    /// Returns points of a row, several per segment, with their values of `t`.
    fn samples(set: &CurveSet, row: usize, each: usize) -> Vec<(f64, Point)> {
        const FINE: usize = 8;
        let at = |s: usize, k: usize| {
            let t = k as f64 / FINE as f64;
            ((s as f64 + t) / each as f64, set.eval(row, s, t))
        };
        (0..set.curve(row).segments as usize)
            .flat_map(|s| (0..FINE).map(move |k| at(s, k)))
            .collect()
    }

    fn built(text: &str) -> CurveSet {
        text.parse::<Scene>().unwrap().build().unwrap().curves
    }

    #[test]
    fn strands_keep_their_distance() {
        let sizes = (8..=16).map(|each| (each, 16));
        for (each, stitches) in sizes.chain([(40, 30), (8, 90), (12, 90), (12, 400)]) {
            let segments = 3 * each * stitches;
            let set = built(&format!(
                "knit:rows=3,stitches={stitches},segments={segments},diameter=2"
            ));
            let rows = per_axis(|row| samples(&set, row, each));
            let two_stitches = &rows[0][..rows[0].len() / stitches * 2];
            for (row, all) in rows.iter().enumerate() {
                // Except neighbours along the yarn.
                let apart = |a: f64, b: f64| (a - b).abs().min(stitches as f64 - (a - b).abs());
                let pairs = two_stitches
                    .iter()
                    .flat_map(|p| all.iter().map(move |q| (p, q)))
                    .filter(|(p, q)| row > 0 || apart(p.0, q.0) > 0.2);
                let nearest = pairs
                    .map(|(p, q)| distance(p.1, q.1))
                    .fold(f64::MAX, f64::min);
                let diameters = if each < 12 { 1.2 } else { 1.3 };
                assert!(
                    nearest > 2.0 * diameters,
                    "{each} {stitches} {row}: {nearest}"
                );
            }
        }
    }

    /// Checks the pattern of stockinette, seen from outside: a yarn comes up behind the legs of the
    /// row below, goes over its head, and back the same way.
    #[test]
    fn rows_go_through_the_loops_of_the_row_below() {
        let (each, stitches) = (12, 16);
        let set = built(&format!(
            "knit:rows=2,stitches={stitches},segments={}",
            2 * each * stitches
        ));
        // The tube unrolled: around it in stitches, height, and outwards.
        let unrolled = |row| -> Vec<(f64, Point)> {
            let points = samples(&set, row, each);
            let unroll = |(t, [x, y, z]): (f64, Point)| {
                let around = y.atan2(x) / TAU * stitches as f64;
                // Into the turn of the yarn.
                let turns = ((t - around) / stitches as f64).round();
                (t, [around + turns * stitches as f64, z, x.hypot(y)])
            };
            points.into_iter().map(unroll).collect()
        };
        let (lower, upper) = (unrolled(0), unrolled(1));
        // From the middle of one foot of a stitch to the next.
        let stitch = upper.windows(2).filter(|w| (4.5..5.5).contains(&w[0].0));
        let mut pattern = String::new();
        for u in stitch {
            let mut crossings: Vec<(f64, char)> = lower
                .windows(2)
                .filter_map(|l| crossing([u[0].1, u[1].1], [l[0].1, l[1].1]))
                .map(|(at, out)| (at, if out > 0.0 { 'F' } else { 'B' }))
                .collect();
            crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
            pattern.extend(crossings.iter().map(|c| c.1));
        }
        assert_eq!(pattern, "BFFB");
    }

    /// Returns the position along segment `p` at which it crosses segment `q` seen along the third
    /// axis, and the distance by which `p` is farther out.
    fn crossing(p: [Point; 2], q: [Point; 2]) -> Option<(f64, f64)> {
        let cross = |a: Point, b: Point| a[0] * b[1] - a[1] * b[0];
        let (d, e, r) = (sub(p[1], p[0]), sub(q[1], q[0]), sub(q[0], p[0]));
        let area = cross(d, e);
        let (s, t) = (cross(r, e) / area, cross(r, d) / area);
        let within = (0.0..1.0).contains(&s) && (0.0..1.0).contains(&t);
        within.then(|| (s, p[0][2] + s * d[2] - q[0][2] - t * e[2]))
    }
}
