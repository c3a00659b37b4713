//! Yarn as chains of points: a plain position-based simulation (XPBD).
//!
//! A time step moves all points by their velocity, then passes once over the constraints: the
//! length of each segment (rigid), the distance of next but one points (bending, soft), obstacles,
//! and contacts. The velocity is the motion of the step. With one pass, the constraints are
//! the better satisfied the smaller the time step is: see Macklin, Müller & Chentanez 2016 (*XPBD*)
//! and Macklin et al. 2019 (*Small Steps in Physics Simulation*). The yarn is set: its shape
//! at the start is the one without bending forces, as after steaming. The topology is not checked.

use crate::contact::{Contacts, Segment};
use glam::Vec3;
use std::ops::Range;

/// Diameter of the yarn: the unit of length.
pub const DIAMETER: f32 = 1.0;

/// Compliance of the distance of next but one points: motion per force, for points of mass 1.
const BENDING: f32 = 2e-5;

/// Share of the sliding on an obstacle that its friction takes away in a time step.
const GRIP: f32 = 0.3;

/// A distance between two points that is kept, rigidly if the compliance is 0.
#[derive(Clone, Copy, Debug)]
struct Spring {
    ends: [u32; 2],
    rest: f32,
    compliance: f32,
}

/// Rows that are moved by a hand: they turn rigidly about the z axis.
#[derive(Clone, Copy, Debug)]
pub struct Grip {
    /// Points that are held.
    pub first: usize,
    pub last: usize,
    /// Angle at the end of the motion.
    pub angle: f32,
    /// Duration of the motion in seconds.
    pub duration: f32,
}

/// Closed loops of yarn, what acts on them, and their state.
#[derive(Clone)]
pub struct Yarn {
    /// Positions of all points.
    pub x: Vec<Vec3>,
    /// Their velocities.
    v: Vec<Vec3>,
    time: f64,
    /// Downward acceleration, in diameters per second squared.
    pub gravity: f32,
    /// Rate at which velocities decay, per second.
    pub drag: f32,
    /// A floor at z = 0, if there is one.
    pub floor: bool,
    /// A fixed ball.
    pub ball: Option<(Vec3, f32)>,
    loops: Vec<usize>,
    segments: Vec<Segment>,
    /// Length at rest of each segment.
    rest: Vec<f32>,
    springs: Vec<Spring>,
    inverse_mass: Vec<f32>,
    grips: Vec<(Grip, Vec<Vec3>)>,
    contacts: Contacts,
}

impl Yarn {
    /// Creates yarn at rest from closed loops of points.
    pub fn new(loops: &[Vec<Vec3>]) -> Yarn {
        let x = loops.concat();
        let (mut segments, mut springs) = (Vec::new(), Vec::new());
        let mut start = 0;
        for (row, points) in (0..).zip(loops) {
            let count = points.len() as u32;
            let point = |k: u32| start + k % count;
            let mut spring = |k: u32, far: u32, compliance| {
                let ends = [point(k), point(k + far)];
                let rest = x[ends[0] as usize].distance(x[ends[1] as usize]);
                springs.push(Spring {
                    ends,
                    rest,
                    compliance,
                });
            };
            for place in 0..count {
                segments.push(Segment {
                    ends: [point(place), point(place + 1)],
                    row,
                    place,
                    count,
                });
                spring(place, 1, 0.0);
                spring(place, 2, BENDING);
            }
            start += count;
        }
        Yarn {
            inverse_mass: vec![1.0; x.len()],
            v: vec![Vec3::ZERO; x.len()],
            x,
            time: 0.0,
            gravity: 0.0,
            drag: 0.0,
            floor: false,
            ball: None,
            loops: loops.iter().map(Vec::len).collect(),
            rest: springs.iter().step_by(2).map(|s| s.rest).collect(),
            segments,
            springs,
            grips: Vec::new(),
            contacts: Contacts::default(),
        }
    }

    /// Returns the number of points of each loop.
    pub fn loops(&self) -> &[usize] {
        &self.loops
    }

    /// Returns the points of a loop.
    pub fn points_of(&self, row: usize) -> Range<usize> {
        let start = self.loops[..row].iter().sum();
        start..start + self.loops[row]
    }

    /// Sews two points together at the distance that they have.
    pub fn sew(&mut self, a: usize, b: usize) {
        self.springs.push(Spring {
            ends: [a as u32, b as u32],
            rest: self.x[a].distance(self.x[b]),
            compliance: 0.0,
        });
    }

    /// Holds some points from now on.
    pub fn hold(&mut self, grip: Grip) {
        let points = grip.first..grip.last;
        self.inverse_mass[points.clone()].fill(0.0);
        self.grips.push((grip, self.x[points].to_vec()));
    }

    /// Advances by one time step.
    pub fn step(&mut self, dt: f64) {
        self.time += dt;
        let (x, v, dt) = (&mut self.x, &mut self.v, dt as f32);
        let start = x.clone();
        self.contacts.find(x, &self.segments);
        let keep = (-self.drag * dt).exp();
        for (x, (v, w)) in x.iter_mut().zip(v.iter_mut().zip(&self.inverse_mass)) {
            v.z -= self.gravity * dt;
            *v *= keep;
            *x += *v * dt * *w;
        }
        for (grip, held) in &self.grips {
            let share = (self.time as f32 / grip.duration).min(1.0);
            let (sin, cos) = (share * grip.angle).sin_cos();
            for (x, h) in x[grip.first..grip.last].iter_mut().zip(held) {
                *x = Vec3::new(cos * h.x - sin * h.y, sin * h.x + cos * h.y, h.z);
            }
        }
        for spring in &self.springs {
            let [a, b] = spring.ends.map(|k| k as usize);
            let (wa, wb) = (self.inverse_mass[a], self.inverse_mass[b]);
            let apart = x[a] - x[b];
            let length = apart.length();
            let inertia = wa + wb + spring.compliance / (dt * dt);
            if length > 0.0 && inertia > 0.0 {
                let push = (spring.rest - length) / (length * inertia) * apart;
                x[a] += wa * push;
                x[b] -= wb * push;
            }
        }
        for (x, start) in x.iter_mut().zip(&start) {
            if let Some((center, radius)) = self.ball {
                collide(x, *start, *x - center, radius);
            }
            if self.floor {
                collide(x, *start, Vec3::new(0.0, 0.0, x.z), 0.0);
            }
        }
        self.contacts.solve(x, &start, &self.inverse_mass);
        for (v, (x, start)) in v.iter_mut().zip(x.iter().zip(&start)) {
            *v = (*x - start) / dt;
        }
    }

    /// Returns the largest ratio of the length of a segment to its length at rest.
    pub fn stretch(&self) -> f32 {
        let longest = |most: f32, (s, rest): (&Segment, &f32)| {
            let [a, b] = s.ends.map(|k| self.x[k as usize]);
            most.max(a.distance(b) / rest)
        };
        self.segments.iter().zip(&self.rest).fold(0.0, longest)
    }
}

#[cfg(test)]
impl Yarn {
    /// Returns the pairs of segments that the grid finds, and those among all pairs.
    pub fn near_pairs(&self) -> [Vec<[u32; 2]>; 2] {
        Contacts::default().near_pairs(&self.x, &self.segments)
    }
}

/// Moves a point out of an obstacle whose surface is at the distance `radius` along `out`, and
/// brakes its sliding. The floor has its normal upwards.
fn collide(x: &mut Vec3, start: Vec3, out: Vec3, radius: f32) {
    let normal = if radius > 0.0 {
        out.normalize_or(Vec3::Z)
    } else {
        Vec3::Z
    };
    let overlap = radius + 0.5 * DIAMETER - out.dot(normal);
    if overlap > 0.0 {
        let slide = *x - start;
        let slide = slide - slide.dot(normal) * normal;
        *x += overlap * normal - GRIP * slide;
    }
}
