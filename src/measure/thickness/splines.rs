//! Bends and lengths of splines.

use super::MinRad;
use super::approach::{directions, first_direction, is_corner, last_direction};
use crate::curve::vector::{cross, dot, mix, norm, per_axis, sub};
use crate::curve::{Basis, Bezier, Cell, CurveSet, Point};
use crate::pairs::Scale;
use crate::periodic::period;

/// Relative error of the sharpest bend; maximum number of divisions of segments in addition to four
/// per segment.
const BEND_ACCURACY: f64 = 1e-4;
const DIVISIONS: usize = 1 << 20;

/// A part is not divided if its length and the sum of the lengths of its halves differ by at most
/// this share. The error of the latter is a 256th of the difference.
const LENGTH_ACCURACY: f64 = 1e-9;

/// A part of at most this share of a segment is not divided to measure its length. The length of
/// the tip of a cusp is quadratic in the size of the part.
const TIP: f64 = 1e-5;

/// Returns an upper bound of the distance between a cubic segment and its chord, both at the same
/// parameter: an eighth of the largest second derivative, which is a combination of the second
/// differences of the control points with weights of 6 in all.
pub(super) fn deviation([a, b, c, d]: &Bezier) -> f64 {
    let second = |p: &Point, q: &Point, r: &Point| norm(sub(sub(*r, *q), sub(*q, *p)));
    0.75 * second(a, b, c).max(second(b, c, d)) * (1.0 + 1e-9)
}

/// Returns the length of a segment. Parts are halved until the Gauss-Legendre rule with four points
/// gives the same length for a part and for its halves, or until the part is the tip of a cusp.
pub(super) fn length(hull: &Bezier) -> f64 {
    // The differences of the control points lose no digits if the segment is far from the origin.
    let directions = &directions(hull);
    let whole = [0.0, 1.0];
    length_of(directions, whole, by_four_points(directions, whole))
}

fn length_of(directions: &[Point; 3], [from, to]: [f64; 2], known: f64) -> f64 {
    let middle = 0.5 * (from + to);
    let halves =
        [[from, middle], [middle, to]].map(|part| (part, by_four_points(directions, part)));
    let sum = halves[0].1 + halves[1].1;
    if (sum - known).abs() <= LENGTH_ACCURACY * sum || to - from < TIP {
        return sum;
    }
    let lengths = halves.map(|(part, known)| length_of(directions, part, known));
    lengths.iter().sum()
}

/// Returns the length of a part by the Gauss-Legendre rule with four points.
fn by_four_points([u, v, w]: &[Point; 3], [from, to]: [f64; 2]) -> f64 {
    let nodes = [
        (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
        (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    ];
    let [middle, half] = [0.5 * (from + to), 0.5 * (to - from)];
    let speed = |x: f64| {
        let t = middle + half * x;
        3.0 * norm(mix(mix(*u, *v, t), mix(*v, *w, t), t))
    };
    let pair = |(x, weight): (f64, f64)| weight * (speed(-x) + speed(x));
    half * nodes.map(pair).iter().sum::<f64>()
}

/// A part of a segment: the curve, the segment, and the parameters of its ends.
type Part = (usize, usize, [f64; 2]);

/// Returns the sharpest bend: radius 0 at a corner between two segments, else the smallest radius
/// of curvature. Divides parts of segments whose lower bound is not close to the smallest radius
/// found so far.
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
            let (i, s, range) = part;
            let hull = set.segment(i, s).map(|p| scale.apply(p));
            let [least, radius] = radii(&hull, range);
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
            let bounds = open.iter().map(|(bound, _)| *bound);
            break bounds.fold(near, f64::min);
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

/// Returns a lower bound of the radius of curvature of a part of a cubic segment, and the radius in
/// its middle. The bound follows from the Bernstein coefficients of `|r'|^2` and of `r' x r''`,
/// which is quadratic. These polynomials are subdivided instead of the segment, because the
/// differences of the control points of a short part would lose all digits.
fn radii(hull: &Bezier, [from, to]: [f64; 2]) -> [f64; 2] {
    let [u, v, w] = directions(hull);
    let part = |[a, b, c]: [Point; 3]| {
        let polar = |s: f64, t: f64| mix(mix(a, b, s), mix(b, c, s), t);
        [polar(from, from), polar(from, to), polar(to, to)]
    };
    let first = part([u, v, w].map(|p| p.map(|x| 3.0 * x)));
    let half = cross(u, w).map(|x| 0.5 * x);
    let crossed = part([cross(u, v), half, cross(v, w)].map(|p| p.map(|x| 18.0 * x)));
    let third = 1.0 / 3.0;
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
        // Infinite if the part is straight. 0 if the derivative vanishes, so that there is no
        // direction.
        false if speed_sq > 0.0 => f64::INFINITY,
        false => 0.0,
    };
    let [velocity, turn] =
        [first, crossed].map(|[a, b, c]| per_axis(|x| 0.25 * (a[x] + 2.0 * b[x] + c[x])));
    let middle = quotient(dot(velocity, velocity), norm(turn));
    [quotient(slowest, most).min(middle), middle]
}

/// Returns a joint of two segments with different directions, if there is one.
fn corner(set: &CurveSet, cell: Option<&Cell>) -> Option<MinRad> {
    // Splines of other bases are smooth inside, but a yarn may continue in another direction at the
    // end of its period.
    let is_smooth = set.basis() != Basis::Bezier;
    for (i, curve) in set.curves().iter().enumerate() {
        let runs_through = cell.is_some_and(|cell| period(set, i, cell).is_some());
        let inside = (1..curve.segments).filter(|_| !is_smooth);
        let is_joined = curve.closed && !is_smooth || runs_through;
        let around = is_joined.then(|| [curve.segments - 1, 0]);
        for [s, next] in inside.map(|next| [next - 1, next]).chain(around) {
            let [before, after] = [s, next].map(|s| set.segment(i, s as usize));
            let directions = last_direction(&before).zip(first_direction(&after));
            if directions.is_some_and(|(u, v)| is_corner(u, v)) {
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
