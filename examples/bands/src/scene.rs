//! Elastic closed bands that fall on an incline and slide to the floor.
//!
//! # Method
//!
//! Position-based dynamics with compliance (Macklin, Müller and Chentanez 2016, *XPBD*), with one
//! iteration a time step (Macklin et al. 2019, *Small Steps in Physics Simulation*). A band is a
//! closed chain of [`POINTS`] points. Neighbours keep their distance, and so do every second and
//! every fourth point, softly, which keeps a band round. Segments of bands that are closer than
//! their thickness are pushed apart at their closest points, with Coulomb friction. Points stay
//! above the incline and the floor.
//!
//! # Limits
//!
//! Contacts are found once a time step, at its end. If two bands move by more than their thickness
//! relative to one another in a time step, one may already be on the wrong side, and the contact
//! keeps it there. Nothing else in the scene links two bands.
//!
//! All loops are serial, so that a run repeats exactly.

use crate::contact::{Grid, closest};
use glam::{Quat, Vec3};
use sidecar::Scene;
use std::f32::consts::TAU;

/// Points of a band.
pub const POINTS: usize = 24;

/// Length of a frame in seconds.
pub const FRAME_DT: f32 = 1.0 / 30.0;

/// Frames until the bands have come to rest on the floor.
pub const FRAMES: usize = 120;

/// Thickness of a band: its centre line has the radius 1 at rest.
pub const THICKNESS: f32 = 0.14;

/// Downward acceleration.
const GRAVITY: f32 = 20.0;

/// Angle of the incline.
const INCLINE: f32 = 30.0 * TAU / 360.0;

/// Distance between the centres of the bands at the start. They are unlinked: each is inside a
/// ball of its own.
const SPACING: f32 = 2.3;

/// Bands side by side and above one another at the start.
const ACROSS: usize = 8;
const LAYERS: usize = 8;

/// Height of the lowest layer above the incline at the start.
const DROP_HEIGHT: f32 = 2.0;

/// Coulomb friction, of bands and of the ground.
const FRICTION: f32 = 0.2;

/// Damping of all velocities, in 1/s.
const DAMPING: f32 = 0.5;

/// Distances that a band keeps: between points this many places apart, with this compliance
/// (inverse stiffness, of points of mass 1).
const SPRINGS: [(usize, f32); 3] = [(1, 1e-5), (2, 3e-4), (4, 1e-3)];

/// All bands.
#[derive(Clone, Debug)]
pub struct Bands {
    positions: Vec<Vec3>,
    previous: Vec<Vec3>,
    velocities: Vec<Vec3>,
    grid: Grid,
    pairs: Vec<[u32; 2]>,
}

impl Bands {
    /// Places the bands, in random directions and at rest, above the incline.
    pub fn new(bands: usize) -> Bands {
        let mut random = Random(1);
        let mut positions = Vec::with_capacity(POINTS * bands);
        let [sin, cos] = [INCLINE.sin(), INCLINE.cos()];
        for k in 0..bands {
            let (across, layer) = (k % ACROSS, k / ACROSS % LAYERS);
            let along = k / (ACROSS * LAYERS);
            // Up the incline from its foot at x = 0.
            let up = SPACING * (along as f32 + 1.0) + 4.0;
            let high = DROP_HEIGHT + SPACING * (layer as f32 + 0.5);
            let center = Vec3::new(
                -up * cos,
                SPACING * (across as f32 - 0.5 * (ACROSS - 1) as f32),
                up * sin + high / cos,
            );
            let turn = random.rotation();
            positions.extend((0..POINTS).map(|k| {
                let (sin, cos) = (k as f32 / POINTS as f32 * TAU).sin_cos();
                center + turn * Vec3::new(cos, sin, 0.0)
            }));
        }
        Bands {
            previous: positions.clone(),
            velocities: vec![Vec3::ZERO; positions.len()],
            positions,
            grid: Grid::new(),
            pairs: Vec::new(),
        }
    }

    /// Returns the number of bands.
    pub fn bands(&self) -> usize {
        self.positions.len() / POINTS
    }

    /// Returns the length of the most stretched band, in lengths at rest.
    pub fn stretch(&self) -> f32 {
        let rest = POINTS as f32 * 2.0 * (0.5 * TAU / POINTS as f32).sin();
        let bands = self.positions.chunks_exact(POINTS);
        bands.fold(0.0, |longest, band| {
            let next = band.iter().cycle().skip(1);
            let length: f32 = band.iter().zip(next).map(|(a, b)| a.distance(*b)).sum();
            longest.max(length / rest)
        })
    }

    /// Advances the scene by one time step of `h` seconds.
    fn step(&mut self, h: f32) {
        self.previous.copy_from_slice(&self.positions);
        for (x, v) in self.positions.iter_mut().zip(&mut self.velocities) {
            v.z -= GRAVITY * h;
            *v *= 1.0 / (1.0 + DAMPING * h);
            *x += *v * h;
        }
        self.keep_distances(h);
        self.push_bands_apart();
        self.push_above_ground();
        for ((x, p), v) in self
            .positions
            .iter()
            .zip(&self.previous)
            .zip(&mut self.velocities)
        {
            *v = (x - p) / h;
        }
    }

    /// Corrects the distances of neighbours in each band.
    fn keep_distances(&mut self, h: f32) {
        for (apart, compliance) in SPRINGS {
            let rest = 2.0 * (0.5 * apart as f32 * TAU / POINTS as f32).sin();
            let softness = compliance / (h * h);
            for band in self.positions.chunks_exact_mut(POINTS) {
                for k in 0..POINTS {
                    let l = (k + apart) % POINTS;
                    let d = band[l] - band[k];
                    let length = d.length().max(f32::MIN_POSITIVE);
                    let pull = (length - rest) / (2.0 + softness) / length * d;
                    band[k] += pull;
                    band[l] -= pull;
                }
            }
        }
    }

    /// Pushes segments in contact apart, with friction.
    fn push_bands_apart(&mut self) {
        let x = &self.positions;
        let ends = |segment: usize| {
            let first = segment - segment % POINTS;
            [segment, first + (segment - first + 1) % POINTS]
        };
        let segment = |k: usize| ends(k).map(|k| x[k]);
        self.grid
            .pairs(x.len(), THICKNESS, segment, &mut self.pairs);
        let (x, previous) = (&mut self.positions, &self.previous);
        for &[i, j] in &self.pairs {
            let [i, j] = [i as usize, j as usize];
            // Near segments of one band touch without contact.
            let steps = (j - i).min(POINTS - (j - i).min(POINTS));
            if i / POINTS == j / POINTS && steps <= 3 {
                continue;
            }
            let ([a, b], [c, d]) = (ends(i), ends(j));
            let [s, t] = closest([x[a], x[b]], [x[c], x[d]]);
            let apart = x[a].lerp(x[b], s) - x[c].lerp(x[d], t);
            let distance = apart.length();
            if distance >= THICKNESS || distance <= f32::MIN_POSITIVE {
                continue;
            }
            let normal = apart / distance;
            let push = THICKNESS - distance;
            let moved = |k: usize| x[k] - previous[k];
            let slip = moved(a).lerp(moved(b), s) - moved(c).lerp(moved(d), t);
            let correction = push * normal - friction(slip, normal, push);
            let shares = [1.0 - s, s, t - 1.0, -t];
            let total: f32 = shares.iter().map(|w| w * w).sum();
            for (k, share) in [a, b, c, d].into_iter().zip(shares) {
                x[k] += share / total * correction;
            }
        }
    }

    /// Pushes points above the floor and the incline, with friction.
    fn push_above_ground(&mut self) {
        let incline = Vec3::new(INCLINE.sin(), 0.0, INCLINE.cos());
        for (x, previous) in self.positions.iter_mut().zip(&self.previous) {
            for normal in [incline, Vec3::Z] {
                let push = 0.5 * THICKNESS - x.dot(normal);
                if push > 0.0 {
                    *x += push * normal - friction(*x - previous, normal, push);
                }
            }
        }
    }
}

impl Scene for Bands {
    fn advance(&mut self, steps: usize) {
        for _ in 0..steps {
            self.step(FRAME_DT / steps as f32);
        }
    }

    fn write_positions(&self, out: &mut [f32]) {
        for (x, out) in self.positions.iter().zip(out.chunks_exact_mut(3)) {
            out.copy_from_slice(&x.to_array());
        }
    }
}

/// Returns the part of a slip that friction undoes, at a contact that was pushed apart by `push`.
fn friction(slip: Vec3, normal: Vec3, push: f32) -> Vec3 {
    let tangential = slip - slip.dot(normal) * normal;
    let length = tangential.length().max(f32::MIN_POSITIVE);
    tangential * (FRICTION * push / length).min(1.0)
}

/// Pseudo-random numbers: a linear congruential generator.
struct Random(u64);

impl Random {
    /// Returns a number from -1 to 1.
    fn next(&mut self) -> f32 {
        let state = self.0.wrapping_mul(6_364_136_223_846_793_005);
        self.0 = state.wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    /// Returns a rotation of no preferred direction: a random point of the unit ball in 4D.
    fn rotation(&mut self) -> Quat {
        loop {
            let q = Quat::from_array([0.0; 4].map(|_: f32| self.next()));
            if (0.01..1.0).contains(&q.length_squared()) {
                return q.normalize();
            }
        }
    }
}
