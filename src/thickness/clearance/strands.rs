//! Blocks of eight segments, and the distance between two of them.

use super::REACH;
use crate::curve::vector::{add_scaled, distance, mix, norm, sub};
use crate::curve::{Curve, CurveSet, Point, Positions, point_at};
use crate::pairs::{first_blocks, nearest};
use crate::simd::LANES;
use crate::verdict::CloseStrands;
use std::f64::consts::PI;

/// Deviation of the chords of a spline, as a share of its radius, up to which they are not divided.
const DEVIATION: f64 = 0.005;

/// Maximum number of chords of a segment.
const CHORDS: usize = 8;

/// Positions along the curves.
#[derive(Debug)]
pub(super) struct Arcs {
    /// First block of each curve, and the number of all blocks.
    pub first: Vec<u32>,
    /// Length of the curve up to the start of each segment, eight per block.
    starts: Vec<f32>,
    /// Length of each curve.
    pub lengths: Vec<f32>,
}

impl Arcs {
    /// Measures the chords of all segments.
    pub fn new(set: &CurveSet) -> Arcs {
        let first = first_blocks(set);
        let blocks = *first.last().expect("the number of all blocks") as usize;
        let mut starts = vec![0.0; blocks * LANES];
        let mut lengths = Vec::with_capacity(set.len());
        for (i, curve) in set.curves().iter().enumerate() {
            let own = &mut starts[first[i] as usize * LANES..];
            let (mut length, mut from) = (0.0, set.knot(i, 0));
            for s in 0..curve.segments as usize {
                own[s] = length as f32;
                let to = set.knot(i, s + 1);
                length += distance(from, to);
                from = to;
            }
            lengths.push(length as f32);
        }
        Arcs {
            first,
            starts,
            lengths,
        }
    }

    /// Returns the start and the end of a segment along its curve.
    fn of(&self, i: usize, curve: &Curve, s: u32) -> [f64; 2] {
        let at = self.first[i] as usize * LANES + s as usize;
        let end = match s + 1 < curve.segments {
            true => self.starts[at + 1],
            false => self.lengths[i],
        };
        [self.starts[at], end].map(f64::from)
    }

    /// Returns the length along curve `i` between two segments, `s` before `t`.
    fn between(&self, i: usize, curve: &Curve, s: u32, t: u32) -> f64 {
        let [s, t] = [s, t].map(|s| self.of(i, curve, s));
        let forward = t[0] - s[1];
        let around = s[0] + f64::from(self.lengths[i]) - t[1];
        if curve.closed {
            forward.min(around)
        } else {
            forward
        }
    }

    /// Returns true if some segments of two blocks of curve `i` may be far enough from one another
    /// along it to be two strands.
    pub fn are_apart(&self, i: usize, curve: &Curve, [a, b]: [u32; 2], radius: f64) -> bool {
        let ends = |block: u32| {
            let first = block * LANES as u32;
            let last = (first + LANES as u32).min(curve.segments) - 1;
            [first, last].map(|s| self.of(i, curve, s))
        };
        let ([s, last_s], [t, last_t]) = (ends(a), ends(b));
        let forward = last_t[0] - s[1];
        let around = last_s[0] + f64::from(self.lengths[i]) - t[1];
        forward.min(if curve.closed { around } else { forward }) >= PI * radius
    }
}

/// Distance of two blocks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measured {
    /// Lower bound of the distance, as a share of the sum of the radii.
    pub bound: f64,
    /// Closest segments, if they were compared: they are not if all are beyond the reach.
    pub closest: Option<CloseStrands>,
}

impl Measured {
    /// Returns the distance as a share of the sum of the radii, or a lower bound if it is beyond
    /// the reach.
    pub fn ratio(&self) -> f64 {
        self.closest.map_or(self.bound, |c| c.ratio)
    }
}

/// A segment, and a sphere around it.
#[derive(Clone, Copy)]
struct Segment {
    middle: Point,
    radius: f64,
    /// Upper bound of the distance from its chord.
    deviation: f64,
    hull: [Point; 4],
}

/// A part of a curve.
struct Block {
    curve: usize,
    first: u32,
    segments: [Segment; LANES],
    count: usize,
}

/// All strands of a frame.
pub(super) struct Strands<'a> {
    set: &'a CurveSet,
    positions: Positions<'a>,
    radii: &'a [f64],
    arcs: &'a Arcs,
}

impl<'a> Strands<'a> {
    /// `set` is only asked for its curves, so that a frame that was only compared stays as
    /// received; `positions` are its positions.
    pub fn new(
        set: &'a CurveSet,
        positions: Positions<'a>,
        radii: &'a [f64],
        arcs: &'a Arcs,
    ) -> Strands<'a> {
        Strands {
            set,
            positions,
            radii,
            arcs,
        }
    }

    /// Returns the number of segments.
    pub fn segments(&self) -> usize {
        self.set.segments()
    }

    /// Measures the distance of two blocks, each given by its curve and its number.
    pub fn measure(&self, [(i, a), (j, b)]: [(u32, u32); 2]) -> Measured {
        let (i, j) = (i as usize, j as usize);
        let radii = self.radii[i] + self.radii[j];
        let [a, b] = [self.block(i, a), self.block(j, b)];
        let mut bounds = [[f64::INFINITY; LANES]; LANES];
        let mut least = (f64::INFINITY, 0, 0);
        for (k, bounds) in bounds.iter_mut().enumerate().take(a.count) {
            let one = &a.segments[k];
            for (l, bound) in bounds.iter_mut().enumerate().take(b.count) {
                let other = &b.segments[l];
                let apart = distance(one.middle, other.middle);
                *bound = apart * (1.0 - 1e-12) - one.radius - other.radius;
            }
        }
        if i == j {
            self.exclude(&a, &b, &mut bounds);
        }
        for (k, row) in bounds.iter().enumerate() {
            for (l, &bound) in row.iter().enumerate() {
                if bound < least.0 {
                    least = (bound, k, l);
                }
            }
        }
        if least.0 >= REACH * radii {
            return Measured {
                bound: least.0 / radii,
                closest: None,
            };
        }
        let mut closest = self.closest([&a, &b], [least.1, least.2], radii);
        let mut bound = closest.ratio - closest.error;
        for (k, row) in bounds.iter().enumerate() {
            for (l, &lower) in row.iter().enumerate() {
                if lower >= closest.distance || (k, l) == (least.1, least.2) {
                    continue;
                }
                let found = self.closest([&a, &b], [k, l], radii);
                bound = bound.min(found.ratio - found.error);
                if found.distance < closest.distance {
                    closest = found;
                }
            }
        }
        Measured {
            bound: bound.min(closest.ratio),
            closest: Some(closest),
        }
    }

    /// Excludes pairs of segments of one curve that are near one another along it.
    fn exclude(&self, a: &Block, b: &Block, bounds: &mut [[f64; LANES]; LANES]) {
        let i = a.curve;
        let curve = self.set.curve(i);
        let apart = PI * self.radii[i];
        for k in 0..a.count {
            for l in 0..b.count {
                let (s, t) = (a.first + k as u32, b.first + l as u32);
                let near = || self.arcs.between(i, &curve, s, t) < apart;
                if s >= t || curve.adjacent(s, t) || near() {
                    bounds[k][l] = f64::INFINITY;
                }
            }
        }
    }

    /// Returns the closest points of two segments.
    fn closest(&self, [a, b]: [&Block; 2], [k, l]: [usize; 2], radii: f64) -> CloseStrands {
        let (one, other) = (&a.segments[k], &b.segments[l]);
        let mut best = (f64::INFINITY, [[0.0; 3]; 2]);
        let mut error = 0.0;
        if self.set.basis().is_polyline() {
            best = closest_of_chords([one.hull[0], one.hull[3]], [other.hull[0], other.hull[3]]);
        } else {
            let chords = [(a.curve, one), (b.curve, other)].map(|(i, segment)| {
                let parts = (segment.deviation / (DEVIATION * self.radii[i])).sqrt();
                (parts.ceil() as usize).clamp(1, CHORDS)
            });
            for (segment, n) in [one, other].iter().zip(chords) {
                error += segment.deviation / (n * n) as f64;
            }
            let [m, n] = chords;
            let point = |segment: &Segment, k: usize, n: usize| match k {
                0 => segment.hull[0],
                k if k == n => segment.hull[3],
                k => point_at(&segment.hull, k as f64 / n as f64),
            };
            let ends: [Point; CHORDS + 1] = std::array::from_fn(|q| point(other, q.min(n), n));
            let mut start = one.hull[0];
            for p in 1..=m {
                let end = point(one, p, m);
                for q in 0..n {
                    let found = closest_of_chords([start, end], [ends[q], ends[q + 1]]);
                    if found.0 < best.0 {
                        best = found;
                    }
                }
                start = end;
            }
        }
        let (distance, points) = best;
        CloseStrands {
            ratio: distance / radii,
            error: error / radii,
            i: a.curve as u32,
            j: b.curve as u32,
            segments: [a.first + k as u32, b.first + l as u32],
            points,
            distance,
        }
    }

    /// Reads a block of a curve.
    fn block(&self, i: usize, block: u32) -> Block {
        let curve = self.set.curve(i);
        let basis = self.set.basis();
        let first = block * LANES as u32;
        let count = (curve.segments - first).min(LANES as u32) as usize;
        let points = self.set.points_of(i);
        let (n, lead) = (points.len(), basis.lead(curve.closed));
        let control = |s: usize, k: usize| {
            let at = s * basis.stride() + k + n - lead;
            self.positions.point(points.start + at % n)
        };
        let mut segments = [Segment {
            middle: [0.0; 3],
            radius: 0.0,
            deviation: 0.0,
            hull: [[0.0; 3]; 4],
        }; LANES];
        let mut last: Option<Point> = None;
        for (k, segment) in segments.iter_mut().enumerate().take(count) {
            let s = first as usize + k;
            if basis.is_polyline() {
                let from = last.unwrap_or_else(|| control(s, 0));
                let to = control(s, 1);
                segment.hull = [from, from, to, to];
                last = Some(to);
            } else {
                let q = [0, 1, 2, 3].map(|k| control(s, k));
                let axes = [0, 1, 2].map(|x| basis.hull([q[0][x], q[1][x], q[2][x], q[3][x]]));
                let hull = [0, 1, 2, 3].map(|k| [0, 1, 2].map(|x| axes[x][k]));
                segment.deviation = deviation(&hull);
                segment.hull = hull;
            }
            let [from, .., to] = segment.hull;
            segment.middle = mix(from, to, 0.5);
            segment.radius = (0.5 * distance(from, to)) * (1.0 + 1e-12) + segment.deviation;
        }
        Block {
            curve: i,
            first,
            segments,
            count,
        }
    }
}

/// Returns an upper bound of the distance between a cubic segment and its chord, both at the same
/// parameter: an eighth of the largest second derivative, which is a combination of the second
/// differences of the control points with weights of 6 in all.
pub(super) fn deviation([a, b, c, d]: &[Point; 4]) -> f64 {
    let second = |p: &Point, q: &Point, r: &Point| norm(sub(sub(*r, *q), sub(*q, *p)));
    0.75 * second(a, b, c).max(second(b, c, d)) * (1.0 + 1e-9)
}

/// Returns the distance of two straight segments, and their nearest points.
fn closest_of_chords([p0, p1]: [Point; 2], [q0, q1]: [Point; 2]) -> (f64, [Point; 2]) {
    let (d, e) = (sub(p1, p0), sub(q1, q0));
    let near = nearest([p0, d], [q0, e]);
    let points = [add_scaled(p0, near.s, d), add_scaled(q0, near.t, e)];
    (near.distance_sq.sqrt(), points)
}
