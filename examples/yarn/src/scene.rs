//! The scenes: a knitted tube that is wrung, and a garment that falls on a ball.
//!
//! Every row is a closed loop that goes through the stitches of the row below, as in the scene
//! `knit` of `linkwatch generate`, whose formula this is (Crane, *A Simple Parametric Model of
//! Plain-Knit Yarns*). The linking number of any two rows is 0: knitting can be ravelled from its
//! last row on. That row is held by the hands, or hemmed.

use crate::yarn::{DIAMETER, Grip, Yarn};
use glam::Vec3;
use std::f32::consts::TAU;

/// Points of a stitch.
const POINTS: usize = 12;

/// Coefficients of a stitch, its height and the diameter of the yarn in their unit.
const OVERHANG: f32 = 1.485;
const HEIGHT: f32 = 3.4;
const DEPTH: f32 = -1.25;
const ROW: f32 = 4.0;
const YARN: f32 = 1.16;

/// Radius of the ball.
const BALL: f32 = 20.0;

/// Speed at which the ends of the tube turn against each other, in turns per second.
pub const TURNS_PER_SECOND: f64 = 1.0;

/// Returns the rows of a knitted tube around the z axis, from z = 0 upwards.
fn knit(rows: usize, stitches: usize) -> Vec<Vec<Vec3>> {
    let radius = stitches as f32;
    let point = |row: usize, k: usize| {
        let t = TAU * k as f32 / POINTS as f32;
        let along = (t + OVERHANG * (2.0 * t).sin()) / radius;
        let out = radius + DEPTH * (2.0 * t).cos();
        let up = ROW * row as f32 + HEIGHT * t.cos();
        DIAMETER / YARN * Vec3::new(out * along.cos(), out * along.sin(), up)
    };
    (0..rows)
        .map(|row| (0..POINTS * stitches).map(|k| point(row, k)).collect())
        .collect()
}

/// Returns a tube whose first and last row are turned against each other, each by half of `turns`.
pub fn tube(rows: usize, stitches: usize, turns: f64) -> Yarn {
    let mut yarn = Yarn::new(&knit(rows, stitches));
    yarn.drag = 4.0;
    for (row, sign) in [(0, -0.5), (rows - 1, 0.5)] {
        let points = yarn.points_of(row);
        yarn.hold(Grip {
            first: points.start,
            last: points.end,
            angle: sign * TAU * turns as f32,
            duration: (turns / TURNS_PER_SECOND) as f32,
        });
    }
    yarn
}

/// Returns a garment over a ball: a body, and two sleeves that are sewn to it.
pub fn garment(rows: usize, stitches: usize) -> Yarn {
    let (sleeve_rows, sleeve_stitches) = ((rows / 2).max(2), (stitches / 2).max(8));
    let pitch = ROW * DIAMETER / YARN;
    let radius = |stitches: usize| stitches as f32 * DIAMETER / YARN;
    let length = pitch * (rows - 1) as f32;
    let height = radius(stitches) + 2.0 * BALL + 6.0;
    // The body lies along y, its neck at positive y; the sleeves lie along x.
    let lay = |p: Vec3| Vec3::new(p.x, p.z - length / 2.0, height - p.y);
    let mut loops: Vec<Vec<Vec3>> = knit(rows, stitches)
        .into_iter()
        .map(|row| row.into_iter().map(lay).collect())
        .collect();
    let shoulder = length / 2.0 - radius(sleeve_stitches) - pitch;
    for side in [1.0, -1.0] {
        let turn = |p: Vec3| {
            let x = radius(stitches) + 3.0 + p.z;
            Vec3::new(side * x, shoulder + side * p.x, height + p.y)
        };
        let sleeve = knit(sleeve_rows, sleeve_stitches);
        loops.extend(
            sleeve
                .into_iter()
                .map(|row| row.into_iter().map(turn).collect()),
        );
    }
    let mut yarn = Yarn::new(&loops);
    yarn.gravity = 100.0;
    yarn.drag = 1.0;
    yarn.floor = true;
    yarn.ball = Some((Vec3::new(0.0, 0.0, BALL), BALL));
    let body = 0..yarn.points_of(rows - 1).end;
    for first in [rows, rows + sleeve_rows] {
        // The feet of the first row of a sleeve, to the nearest points of the body.
        let feet = yarn.points_of(first).skip(POINTS / 2).step_by(POINTS);
        for foot in feet.collect::<Vec<_>>() {
            let distance = |k: &usize| yarn.x[*k].distance_squared(yarn.x[foot]);
            let nearest = body
                .clone()
                .min_by(|a, b| distance(a).total_cmp(&distance(b)));
            yarn.sew(foot, nearest.unwrap_or(foot));
        }
    }
    for last in [rows, rows + sleeve_rows, rows + 2 * sleeve_rows] {
        // The heads of a last row, one to the next.
        let heads: Vec<_> = yarn.points_of(last - 1).step_by(POINTS).collect();
        for (k, &head) in heads.iter().enumerate() {
            yarn.sew(head, heads[(k + 1) % heads.len()]);
        }
    }
    yarn
}
