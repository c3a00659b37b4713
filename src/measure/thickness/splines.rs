//! Splines: bends by their curvature, and chords for their distances.

use super::{CurvePoint, MinRad, Strut};
use crate::curve::vector::{add, cross, distance, dot, norm, sub};
use crate::curve::{Basis, Bezier, Cell, CurveSet, Point, sub_segment};
use crate::discretize::chords;
use crate::error::Result;
use crate::pairs::Scale;
use crate::periodic::period;

/// Error of the distances, as a share of the distance that is looked for.
const ACCURACY: f64 = 1e-4;

/// Smallest and largest number of chords per segment, and largest number of all chords unless the
/// smallest number per segment makes more.
const CHORDS: [usize; 2] = [4, 128];
const MOST_CHORDS: usize = 1 << 22;

/// Relative error of the sharpest bend, and largest number of divisions of segments in addition to
/// four per segment.
const BEND_ACCURACY: f64 = 1e-4;
const DIVISIONS: usize = 1 << 20;

/// Sine of the angle at a joint from which on it is a corner.
const CORNER: f64 = 1e-6;

/// A polyline that replaces splines, with as many chords for each segment.
pub(super) struct Chords {
    pub polylines: CurveSet,
    per_segment: u32,
    /// Upper bound of the difference between a distance of chords and that of the splines at the
    /// same parameters.
    error: f64,
}

impl Chords {
    /// Returns as many chords as needed for a distance, which is a guess; `None`: no distance is
    /// known.
    pub fn new(set: &CurveSet, distance: Option<f64>) -> Result<Chords> {
        let segments = (0..set.len()).flat_map(|i| {
            let count = set.curve(i).segments as usize;
            (0..count).map(move |s| set.segment(i, s))
        });
        let deviation = segments.map(|hull| deviation(&hull)).fold(0.0, f64::max);
        let [least, most] = CHORDS;
        let needed = match distance {
            Some(distance) if distance > 0.0 => (2.0 * deviation / (ACCURACY * distance)).sqrt(),
            _ => 0.0,
        };
        let most = most.min(MOST_CHORDS / set.segments().max(1)).max(least);
        let n = (needed.ceil() as usize).clamp(least, most);
        Ok(Chords {
            polylines: chords(set, n)?,
            per_segment: n as u32,
            error: 2.0 * deviation / (n * n) as f64,
        })
    }

    /// Returns a strut between chords as one between splines, with its points on them.
    pub fn on_splines(&self, set: &CurveSet, cell: Option<&Cell>, strut: &Strut) -> Strut {
        let n = self.per_segment;
        let mut ends = strut.ends.map(|end| {
            let t = (f64::from(end.segment % n) + end.t) / f64::from(n);
            let segment = end.segment / n;
            CurvePoint {
                segment,
                t,
                point: set.eval(end.curve as usize, segment as usize, t),
                ..end
            }
        });
        if let Some(cell) = cell {
            ends[1].point = add(ends[1].point, cell.translation(strut.image));
        }
        let length = distance(ends[0].point, ends[1].point);
        Strut {
            ends,
            image: strut.image,
            length,
            error: (length - strut.length + self.error).max(self.error),
        }
    }
}

/// Returns an upper bound of the distance between a cubic segment and its chord, both at the same
/// parameter: an eighth of the largest second derivative, which is a combination of the second
/// differences of the control points with weights of 6 in all.
pub(super) fn deviation([a, b, c, d]: &Bezier) -> f64 {
    let second = |p: &Point, q: &Point, r: &Point| norm(sub(sub(*r, *q), sub(*q, *p)));
    0.75 * second(a, b, c).max(second(b, c, d)) * (1.0 + 1e-9)
}

/// A part of a segment: its curve, its number, and its ends.
type Part = (usize, usize, [f64; 2]);

/// Returns the sharpest bend: 0 at a corner between two segments, else the smallest radius of
/// curvature. Parts of segments whose lower bound is not close to the smallest radius at a point
/// are divided.
pub(super) fn min_rad(set: &CurveSet, cell: Option<&Cell>) -> Option<MinRad> {
    if let Some(corner) = corner(set, cell) {
        return Some(corner);
    }
    let knots = (0..set.len()).flat_map(|i| {
        let last = set.curve(i).segments as usize;
        (0..=last).map(move |s| set.knot(i, s))
    });
    let scale = Scale::of(knots);
    let curves = set.curves().iter().enumerate();
    let mut parts: Vec<Part> = curves
        .flat_map(|(i, curve)| (0..curve.segments as usize).map(move |s| (i, s, [0.0, 1.0])))
        .collect();
    let mut divisions = DIVISIONS + 4 * parts.len();
    let mut best: Option<(f64, Part)> = None;
    let least = loop {
        let measure = |part: Part| {
            let (i, s, [from, to]) = part;
            let hull = set.segment(i, s).map(|p| scale.apply(p));
            let [least, radius] = radii(&sub_segment(&hull, from, to));
            if best.is_none_or(|(known, _)| radius < known) {
                best = Some((radius, part));
            }
            (least, part)
        };
        let mut open: Vec<(f64, Part)> = parts.drain(..).map(measure).collect();
        let near = best?.0 * (1.0 - BEND_ACCURACY);
        open.retain(|(least, _)| *least < near);
        let middle = |[from, to]: [f64; 2]| 0.5 * (from + to);
        let divides = |&(_, (.., [from, to])): &(f64, Part)| {
            let at = middle([from, to]);
            from < at && at < to
        };
        if open.is_empty() || open.len() > divisions || !open.iter().all(divides) {
            break open
                .iter()
                .fold(near, |least, (bound, _)| least.min(*bound));
        }
        divisions -= open.len();
        for (_, (i, s, [from, to])) in open {
            let at = middle([from, to]);
            parts.extend([(i, s, [from, at]), (i, s, [at, to])]);
        }
    };
    let (radius, (i, s, [from, to])) = best?;
    if !radius.is_finite() {
        return None;
    }
    let t = 0.5 * (from + to);
    Some(MinRad {
        radius: scale.undo(radius),
        error: scale.undo(radius - least),
        curve: i as u32,
        vertex: s as u32,
        t,
        point: set.eval(i, s, t),
    })
}

/// Returns a lower bound of the radius of curvature of a cubic segment, and the radius in its
/// middle. The bound follows from the Bernstein coefficients of `|r'|^2` and of `r' x r''`.
fn radii(hull: &Bezier) -> [f64; 2] {
    let [a, b, c, d] = *hull;
    let first = [sub(b, a), sub(c, b), sub(d, c)].map(|v| v.map(|x| 3.0 * x));
    let second = [sub(first[1], first[0]), sub(first[2], first[1])].map(|v| v.map(|x| 2.0 * x));
    let mix = |p: Point, u: f64, q: Point, v: f64| [0, 1, 2].map(|x| u * p[x] + v * q[x]);
    let third = 1.0 / 3.0;
    let crossed = [
        cross(first[0], second[0]),
        mix(
            cross(first[0], second[1]),
            third,
            cross(first[1], second[0]),
            2.0 * third,
        ),
        mix(
            cross(first[1], second[1]),
            2.0 * third,
            cross(first[2], second[0]),
            third,
        ),
        cross(first[2], second[1]),
    ];
    let most = crossed.map(norm).into_iter().fold(0.0, f64::max);
    let speeds = [
        dot(first[0], first[0]),
        dot(first[0], first[1]),
        third * (dot(first[0], first[2]) + 2.0 * dot(first[1], first[1])),
        dot(first[1], first[2]),
        dot(first[2], first[2]),
    ];
    let slowest = speeds.into_iter().fold(f64::INFINITY, f64::min).max(0.0);
    let quotient = |speed_sq: f64, turn: f64| match turn > 0.0 {
        true => speed_sq * speed_sq.sqrt() / turn,
        // Straight; or at rest, where there is no direction.
        false if speed_sq > 0.0 => f64::INFINITY,
        false => 0.0,
    };
    let velocity = [0, 1, 2].map(|x| 0.25 * (first[0][x] + 2.0 * first[1][x] + first[2][x]));
    let acceleration = [0, 1, 2].map(|x| 0.5 * (second[0][x] + second[1][x]));
    let middle = quotient(dot(velocity, velocity), norm(cross(velocity, acceleration)));
    [quotient(slowest, most).min(middle), middle]
}

/// Returns a joint of two segments with different directions, if there is one.
fn corner(set: &CurveSet, cell: Option<&Cell>) -> Option<MinRad> {
    for (i, curve) in set.curves().iter().enumerate() {
        let runs_through = cell.is_some_and(|cell| period(set, i, cell).is_some());
        for s in 0..curve.segments {
            // Splines of other bases are smooth, but need not go on as they began.
            let is_smooth = set.basis() != Basis::Bezier;
            let next = match s + 1 {
                next if next < curve.segments && !is_smooth => next,
                next if next < curve.segments => continue,
                _ if curve.closed && !is_smooth || runs_through => 0,
                _ => continue,
            };
            let [before, after] = [s, next].map(|s| set.segment(i, s as usize));
            let (u, v) = (sub(before[3], before[2]), sub(after[1], after[0]));
            let lengths = norm(u) * norm(v);
            if norm(cross(u, v)) > CORNER * lengths || dot(u, v) < 0.0 {
                return Some(MinRad {
                    radius: 0.0,
                    error: 0.0,
                    curve: i as u32,
                    vertex: next,
                    t: 0.0,
                    point: after[0],
                });
            }
        }
    }
    None
}
