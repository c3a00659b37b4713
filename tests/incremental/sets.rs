//! Random sets of curves.

use crate::support::random::Random;
use linkwatch::{Basis, CurveSet, Point, Positions, Precision};
use std::f64::consts::TAU;

/// Returns a number of control points that is valid for the basis. Some `large` curves have several
/// levels of boxes.
fn size(random: &mut Random, basis: Basis, closed: bool, large: bool) -> usize {
    let n: usize = match random.below(12) {
        0 if large => 60 + random.below(200),
        1 => 3,
        _ => 4 + random.below(24),
    };
    match (basis, closed) {
        (Basis::Bezier, true) => 3 * n.div_ceil(3),
        (Basis::Bezier, false) => 3 * n.div_ceil(3) + 1,
        (_, true) => n,
        (_, false) => n.max(4),
    }
}

/// Maximum number of curves of a set in which all curves may be tangled.
pub const MOST: usize = 7;

/// Returns random curves: a chain, rings anywhere, random polygons, strands side by side, or a
/// lattice with many ties.
pub fn random_set(
    random: &mut Random,
    basis: Basis,
    precision: Precision,
    curves: usize,
) -> CurveSet {
    let many = curves > MOST;
    let shape = match many {
        true => random.pick(&[0, 1, 3]),
        false => random.below(5),
    };
    // The density is that of a set of few curves.
    let room = (curves as f64 / MOST as f64).cbrt().max(1.0);
    // Tangled curves are short, because long ones take long to verify.
    let tangled = matches!(shape, 2 | 4);
    let mut counts = Vec::new();
    let mut xyz = Vec::new();
    for i in 0..curves {
        let closed = i < 2 || !random.one_in(5);
        let n = size(random, basis, closed, !tangled && !many);
        counts.push(if closed { -(n as i32) } else { n as i32 });
        let (centre, u, v) = match shape {
            // Each ring through the next.
            0 => {
                let (up, side) = ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]);
                let across = if i % 2 == 0 { side } else { up };
                ([1.3 * i as f64, 0.0, 0.0], [1.0, 0.0, 0.0], across)
            }
            // Nested, at a small distance.
            3 => {
                let r = 1.0 + 0.05 * i as f64;
                (
                    [0.0, 0.0, 0.03 * i as f64],
                    [r, 0.0, 0.0],
                    [0.0, r, 0.1 * r],
                )
            }
            _ => (random.point(room), random.point(1.2), random.point(1.2)),
        };
        let wobble = random.pick(&[0.0, 0.01, 0.2]);
        for k in 0..n {
            let (s, c) = (TAU * k as f64 / n as f64).sin_cos();
            let bump = random.point(wobble);
            let p: Point = match shape {
                2 => random.point(1.0),
                4 => random.point(3.0).map(f64::round),
                _ => std::array::from_fn(|x| centre[x] + c * u[x] + s * v[x] + bump[x]),
            };
            xyz.extend(p);
        }
    }
    match precision {
        Precision::F64 => CurveSet::from_counts(basis, &counts, Positions::F64(&xyz)),
        Precision::F32 => {
            let xyz: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
            CurveSet::from_counts(basis, &counts, Positions::F32(&xyz))
        }
    }
    .unwrap()
}

pub fn values(positions: Positions<'_>) -> Vec<f64> {
    match positions {
        Positions::F32(v) => v.iter().map(|&x| x.into()).collect(),
        Positions::F64(v) => v.to_vec(),
    }
}

pub fn update(set: &mut CurveSet, xyz: &[f64]) -> linkwatch::Result<()> {
    match set.precision() {
        Precision::F64 => set.update(Positions::F64(xyz)),
        Precision::F32 => {
            let xyz: Vec<f32> = xyz.iter().map(|&x| x as f32).collect();
            set.update(Positions::F32(&xyz))
        }
    }
}
