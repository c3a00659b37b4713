//! Contact between strands: pairs of segments that come closer than the diameter of the yarn.
//!
//! A uniform grid over the midpoints of the segments gives the pairs that are near. They are
//! searched again when a point has moved so far that a pair within [`REACH`] could be missing. At
//! the start of each time step the closest points of each pair are computed, and the direction
//! between them, and kept to its end. So a strand that moves past the centre line of another one
//! within a step is pushed back. One that is still on the wrong side at the end of the step is
//! pushed further away in the next one: it was pulled through. The pairs are moved apart one after
//! the other, always in the same order, so the result depends on nothing but the state.

use crate::yarn::DIAMETER;
use glam::{IVec3, Vec3};

/// Distance beyond the diameter up to which pairs of segments are kept in the list.
const MARGIN: f32 = 0.8;

/// Distance beyond the diameter up to which a pair takes part in a time step.
const REACH: f32 = 0.4;

/// Coulomb friction between strands.
const FRICTION: f32 = 0.2;

/// Segments of the same loop that are nearer to each other along the yarn do not collide: the yarn
/// between them cannot bend so sharply.
const NEIGHBORS: u32 = 3;

/// A segment: its two points, and its place in its loop.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    pub ends: [u32; 2],
    pub row: u32,
    /// Number of the segment in its loop, and number of segments of the loop.
    pub place: u32,
    pub count: u32,
}

impl Segment {
    pub fn ignores(&self, other: &Segment) -> bool {
        let apart = self.place.abs_diff(other.place);
        self.row == other.row && apart.min(self.count - apart) <= NEIGHBORS
    }
}

/// A pair of segments that are near: its points with their weights, positive on the first segment
/// and negative on the second, and the direction from the second to the first.
#[derive(Clone)]
struct Contact {
    points: [u32; 4],
    weights: [f32; 4],
    normal: Vec3,
}

/// All contacts of the strands.
#[derive(Clone, Default)]
pub struct Contacts {
    /// Pairs of segments that were near when the list was made, and the points at that time.
    pairs: Vec<[u32; 2]>,
    reference: Vec<Vec3>,
    active: Vec<Contact>,
    cells: Vec<([i32; 3], u32)>,
    /// The midpoint of each segment and half its length.
    balls: Vec<(Vec3, f32)>,
}

impl Contacts {
    /// Finds the contacts of a time step from the points at its start.
    pub fn find(&mut self, x: &[Vec3], segments: &[Segment]) {
        let limit = 0.25 * (MARGIN - REACH) * (MARGIN - REACH);
        let moved = |(a, b): (&Vec3, &Vec3)| a.distance_squared(*b) > limit;
        if self.reference.len() != x.len() || x.iter().zip(&self.reference).any(moved) {
            self.search(x, segments);
        }
        self.active.clear();
        for &[i, j] in &self.pairs {
            let ([a, b], [c, d]) = (segments[i as usize].ends, segments[j as usize].ends);
            let points = [a, b, c, d];
            let (s, t) = closest(points.map(|k| x[k as usize]));
            let weights = [1.0 - s, s, t - 1.0, -t];
            let apart = combine(x, points, weights);
            let length = apart.length();
            if length < DIAMETER + REACH && length > 0.0 {
                self.active.push(Contact {
                    points,
                    weights,
                    normal: apart / length,
                });
            }
        }
    }

    /// Moves the strands of each contact apart up to the diameter, and brakes their sliding since
    /// `start`, the points at the start of the time step.
    pub fn solve(&self, x: &mut [Vec3], start: &[Vec3], inverse_mass: &[f32]) {
        for contact in &self.active {
            let (points, weights) = (contact.points, contact.weights);
            let apart = combine(x, points, weights);
            let overlap = DIAMETER - apart.dot(contact.normal);
            if overlap <= 0.0 {
                continue;
            }
            let mut inertia = 0.0;
            for (k, w) in points.into_iter().zip(weights) {
                inertia += w * w * inverse_mass[k as usize];
            }
            if inertia <= 0.0 {
                continue;
            }
            let slide = apart - combine(start, points, weights);
            let slide = slide - slide.dot(contact.normal) * contact.normal;
            let brake = slide.clamp_length_max(FRICTION * overlap);
            let push = (overlap * contact.normal - brake) / inertia;
            for (k, w) in points.into_iter().zip(weights) {
                x[k as usize] += inverse_mass[k as usize] * w * push;
            }
        }
    }

    /// Lists the pairs of segments whose distance is at most the diameter and the margin.
    fn search(&mut self, x: &[Vec3], segments: &[Segment]) {
        self.reference.clear();
        self.reference.extend_from_slice(x);
        let ends = |s: &Segment| s.ends.map(|k| x[k as usize]);
        self.balls.clear();
        self.balls.extend(segments.iter().map(|s| {
            let [a, b] = ends(s);
            ((a + b) / 2.0, a.distance(b) / 2.0)
        }));
        let balls = &self.balls;
        let near = DIAMETER + MARGIN;
        // Midpoints of segments at this distance are in the same cell or in adjacent ones.
        let size = 2.0 * balls.iter().map(|b| b.1).fold(0.0, f32::max) + near;
        let cells = balls
            .iter()
            .map(|b| (b.0 / size).floor().as_ivec3().to_array());
        self.cells.clear();
        self.cells.extend(cells.zip(0..));
        self.cells.sort_unstable();
        self.pairs.clear();
        let (cells, pairs) = (&self.cells, &mut self.pairs);
        let mut first = 0;
        while first < cells.len() {
            let here = cells[first].0;
            let run = |from: usize, cell: [i32; 3]| cells[from..].partition_point(|c| c.0 == cell);
            let end = first + run(first, here);
            for around in neighbors() {
                let there = (IVec3::from(here).saturating_add(around)).to_array();
                let from = match around {
                    IVec3::ZERO => first,
                    _ => end + cells[end..].partition_point(|c| c.0 < there),
                };
                let to = from + run(from, there);
                for (k, &(_, i)) in cells[first..end].iter().enumerate() {
                    // Each pair within the cell once.
                    let from = from + if around == IVec3::ZERO { k + 1 } else { 0 };
                    for &(_, j) in &cells[from..to] {
                        let (m, n) = (balls[i as usize], balls[j as usize]);
                        let reach = m.1 + n.1 + near;
                        if m.0.distance_squared(n.0) > reach * reach {
                            continue;
                        }
                        let (p, q) = (&segments[i as usize], &segments[j as usize]);
                        let ([a, b], [c, d]) = (ends(p), ends(q));
                        let (s, t) = closest([a, b, c, d]);
                        let apart = a.lerp(b, s).distance_squared(c.lerp(d, t));
                        if apart < near * near && !p.ignores(q) {
                            pairs.push([i.min(j), i.max(j)]);
                        }
                    }
                }
            }
            first = end;
        }
        pairs.sort_unstable();
    }
}

#[cfg(test)]
impl Contacts {
    /// Returns the pairs of segments that the grid finds, and those among all pairs.
    pub fn near_pairs(&mut self, x: &[Vec3], segments: &[Segment]) -> [Vec<[u32; 2]>; 2] {
        self.search(x, segments);
        let near = |i: u32, j: u32| {
            let (p, q) = (&segments[i as usize], &segments[j as usize]);
            let [a, b] = p.ends.map(|k| x[k as usize]);
            let [c, d] = q.ends.map(|k| x[k as usize]);
            let (s, t) = closest([a, b, c, d]);
            a.lerp(b, s).distance(c.lerp(d, t)) < DIAMETER + MARGIN && !p.ignores(q)
        };
        let count = segments.len() as u32;
        let all = (0..count).flat_map(|i| (i + 1..count).map(move |j| [i, j]));
        [
            self.pairs.clone(),
            all.filter(|&[i, j]| near(i, j)).collect(),
        ]
    }
}

/// Returns the cell itself and the 13 adjacent ones that come after it in the order of the list.
fn neighbors() -> impl Iterator<Item = IVec3> {
    (0..27)
        .map(|k| IVec3::new(k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1))
        .filter(|d| d.to_array() >= [0, 0, 0])
}

/// Returns the sum of some points with these weights.
fn combine(x: &[Vec3], points: [u32; 4], weights: [f32; 4]) -> Vec3 {
    let [a, b, c, d] = points.map(|k| x[k as usize]);
    weights[0] * a + weights[1] * b + weights[2] * c + weights[3] * d
}

/// Returns where on segment `a b` and on segment `c d` they are closest to each other, from 0 to 1
/// (Ericson, *Real-Time Collision Detection*, 5.1.9).
fn closest([a, b, c, d]: [Vec3; 4]) -> (f32, f32) {
    let (u, v, w) = (b - a, d - c, a - c);
    let (uu, vv, uv) = (u.dot(u), v.dot(v), u.dot(v));
    let (uw, vw) = (u.dot(w), v.dot(w));
    let part = |x: f32, of: f32| {
        if of > 0.0 {
            (x / of).clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    let s = part(uv * vw - uw * vv, uu * vv - uv * uv);
    let t = part(uv * s + vw, vv);
    (part(uv * t - uw, uu), t)
}
