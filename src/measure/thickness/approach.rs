//! Struts of splines: branch and bound over pairs of parts of cubic segments.
//!
//! A part is a cubic, given by its Bezier control points. The search halves parts, and discards a
//! pair of parts `p`, `q` if it contains no strut that can be the result:
//!
//! - **They are too far apart**: a cubic and its chord, at the same parameter, differ by at most
//!   the [`deviation`] of the cubic. So the distance of the parts is at least that of the chords
//!   minus both deviations.
//! - **The distance has no critical point.** The derivative of half its square along `p` is
//!   `(p - q) . p'`. As `p`, `q` and `p'` are convex combinations of control points, and of their
//!   differences `v`, the product is at least the least of all `(p_i - q_k) . v_j`. If that is
//!   positive, a local minimum can only be at the start of `p`, if the curve is open there or has
//!   a corner; if the greatest is negative, at the end of `p`.
//! - **A critical point is no minimum**: a second derivative, or the determinant of the Hessian
//!   matrix, is negative for all points. Its bounds follow from the control points as well.
//! - **They touch, and the curve does not turn back in between**: if all differences of control
//!   points of both are within 90 degrees of one another, then `p - q` at two points, an integral
//!   of tangents, has a positive product with the tangents at both.
//!
//! The upper limit comes from local minima, which Newton's method finds from the nearest points of
//! the chords. A pair is resolved if its lower bound is less than the limit by at most
//! [`ACCURACY`].

use super::splines::deviation;
use crate::curve::vector::{add, add_scaled, cross, dot, norm, sub};
use crate::curve::{Bezier, Point, point_at, sub_segment};
use crate::pairs::nearest;
use std::slice;

/// Relative error of the length of a strut.
pub(super) const ACCURACY: f64 = 1e-4;

/// A point is critical if the cosine of the angle between the tangent and the connection to the
/// other point is at most this. It exceeds the error of Newton's method and the kinks of splines in
/// single precision.
const CRITICAL: f64 = 2e-6;

/// A joint is a corner if the sine of its angle is at least this.
const CORNER: f64 = 1e-6;

/// Length of the shortest part, as a share of its segment. Parts of this length that touch are not
/// compared.
const SHORTEST: f64 = 1.0 / (1 << 20) as f64;

/// Maximum number of pairs of parts of a pair of segments.
const MOST_PAIRS: usize = 1 << 14;

/// Distances up to this share of the largest coordinate count as 0.
const ZERO: f64 = 1e-15;

/// Number of pairs of parts after which second derivatives are bounded as well.
const FEW_PAIRS: usize = 8;

/// A cubic segment, and the directions of its neighbours on the curve.
#[derive(Clone, Copy)]
pub(super) struct Side {
    pub hull: Bezier,
    /// Direction at the end of the segment before this one, and at the start of the one after it.
    /// `None` at the ends of an open curve.
    neighbours: [Option<Point>; 2],
    /// For the start and the end: true if a local minimum of a distance can be there although the
    /// derivative of the distance is not 0, because the curve is open or has a corner there.
    is_free: [bool; 2],
    /// Upper bound of the distance from the start of the segment to any of its points.
    size: f64,
}

/// How two segments of one curve are joined.
#[derive(Clone, Copy)]
pub(super) struct Joints {
    /// True if both are the same segment.
    pub is_same: bool,
    /// True if the second segment follows the first one; true if the first one follows the second
    /// one.
    pub follows: [bool; 2],
}

/// Nearest points of two segments: parameters, squared distance, and a lower bound of the distance
/// of all struts between them.
pub(super) struct Approach {
    pub at: [f64; 2],
    pub distance_sq: f64,
    pub least: f64,
}

/// A part of a segment.
#[derive(Clone, Copy)]
struct Part {
    hull: Bezier,
    range: [f64; 2],
    deviation: f64,
    /// See [`Side`].
    is_free: [bool; 2],
}

impl Part {
    fn whole(side: &Side) -> Part {
        Part {
            hull: side.hull,
            range: [0.0, 1.0],
            deviation: deviation(&side.hull),
            is_free: side.is_free,
        }
    }

    fn halves(&self) -> [Part; 2] {
        let [from, to] = self.range;
        let middle = 0.5 * (from + to);
        let half = |[s, t]: [f64; 2], range, is_free| Part {
            hull: sub_segment(&self.hull, s, t),
            range,
            // The bound of the second derivative of the whole holds for the halves.
            deviation: 0.25 * self.deviation,
            is_free,
        };
        [
            half([0.0, 0.5], [from, middle], [self.is_free[0], false]),
            half([0.5, 1.0], [middle, to], [false, self.is_free[1]]),
        ]
    }

    fn chord(&self) -> [Point; 2] {
        [self.hull[0], sub(self.hull[3], self.hull[0])]
    }

    fn parameter(&self, t: f64) -> f64 {
        self.range[0] + t * (self.range[1] - self.range[0])
    }

    /// Returns an upper bound of the distance from the start of the part to any of its points.
    fn size(&self) -> f64 {
        norm(self.chord()[1]) + self.deviation
    }

    fn is_divisible(&self) -> bool {
        self.range[1] - self.range[0] > SHORTEST
    }
}

/// Returns the differences of consecutive control points. A third of the derivative is a convex
/// combination of them. Differences of 0 have no direction.
pub(super) fn directions([a, b, c, d]: &Bezier) -> [Point; 3] {
    [sub(*b, *a), sub(*c, *b), sub(*d, *c)]
}

/// Returns the direction in which a segment starts.
pub(super) fn first_direction(hull: &Bezier) -> Option<Point> {
    directions(hull).into_iter().find(|v| *v != [0.0; 3])
}

/// Returns the direction in which a segment ends.
pub(super) fn last_direction(hull: &Bezier) -> Option<Point> {
    directions(hull).into_iter().rfind(|v| *v != [0.0; 3])
}

impl Side {
    pub fn new(hull: Bezier, [before, after]: [Option<Bezier>; 2]) -> Side {
        let neighbours = [
            before.and_then(|hull| last_direction(&hull)),
            after.and_then(|hull| first_direction(&hull)),
        ];
        let ends = [first_direction(&hull), last_direction(&hull)];
        let is_free = |k: usize| match (neighbours[k], ends[k]) {
            (Some(u), Some(v)) => is_corner(u, v),
            _ => true,
        };
        let distances = hull.iter().map(|p| norm(sub(*p, hull[0])));
        Side {
            hull,
            neighbours,
            is_free: [is_free(0), is_free(1)],
            size: distances.fold(0.0, f64::max),
        }
    }

    /// Returns true if a box, given by its centre and half of its size, may contain the other end
    /// of a strut that starts on the segment.
    pub fn may_face(&self, center: Point, half: Point) -> bool {
        let range = |v: Point| {
            let (middle, reach) = (dot(v, center), dot(v.map(f64::abs), half));
            [middle - reach, middle + reach]
        };
        let reach = norm(sub(center, self.hull[0])) + norm(half) + self.size;
        !is_one_sided(&self.hull, self.is_free, range, reach)
    }

    /// Returns true if the distance to another point does not decrease, to first order, if the
    /// point at parameter `t` moves along the segment. `away` is the vector from the other point.
    fn is_critical(&self, t: f64, tangent: Point, away: Point) -> bool {
        let slack = |v: Point| CRITICAL * norm(v) * norm(away);
        let slope = dot(tangent, away);
        let shrinks_before = |v: Point| dot(v, away) > slack(v);
        match t {
            0.0 => slope >= -slack(tangent) && !self.neighbours[0].is_some_and(shrinks_before),
            1.0 => {
                let shrinks_after = |v: Point| -dot(v, away) > slack(v);
                slope <= slack(tangent) && !self.neighbours[1].is_some_and(shrinks_after)
            }
            _ => slope.abs() <= slack(tangent),
        }
    }
}

/// The search in a pair of segments.
struct Search<'a> {
    sides: [&'a Side; 2],
    joints: Joints,
    /// Squared length of the shortest strut so far, and its parameters.
    limit_sq: f64,
    best: Option<[f64; 2]>,
    /// Squared lengths up to this count as 0.
    zero_sq: f64,
    /// Number of pairs of parts so far.
    count: usize,
}

/// Returns the shortest strut between two segments whose squared length is less than `limit_sq`, if
/// there is one. If only parts remain that could not be resolved, returns points of one pair of
/// parts, with an infinite distance.
pub(super) fn approach(sides: [&Side; 2], joints: Joints, limit_sq: f64) -> Option<Approach> {
    let numbers = sides.iter().flat_map(|side| side.hull.as_flattened());
    let largest = numbers.fold(0.0, |most: f64, x| most.max(x.abs()));
    let mut search = Search {
        sides,
        joints,
        limit_sq,
        best: None,
        zero_sq: (ZERO * largest).powi(2),
        count: 0,
    };
    let (mut unresolved, mut place) = (f64::INFINITY, None);
    let mut open = Vec::new();
    let mut next = Some(sides.map(Part::whole));
    while let Some(pair) = next.take().or_else(|| open.pop()) {
        let touches = search.touches(&pair);
        let Some((least, near)) = search.bound(&pair, touches) else {
            continue;
        };
        search.count += 1;
        let is_divisible = pair.iter().any(Part::is_divisible);
        if is_divisible && search.count <= MOST_PAIRS {
            search.divide(&pair, touches, &mut open);
            continue;
        }
        if touches && !is_divisible {
            continue;
        }
        unresolved = unresolved.min(least);
        place.get_or_insert(near);
    }
    let (at, distance_sq) = match search.best {
        Some(at) => (at, search.limit_sq),
        None => (place?, f64::INFINITY),
    };
    Some(Approach {
        at,
        distance_sq,
        least: unresolved.min(distance_sq.sqrt() * (1.0 - ACCURACY)),
    })
}

impl Search<'_> {
    /// Returns true if two parts are the same, or one follows the other.
    fn touches(&self, [p, q]: &[Part; 2]) -> bool {
        let Joints { is_same, follows } = self.joints;
        let meets = |a: &Part, b: &Part| a.range[1] == b.range[0];
        let wraps = |a: &Part, b: &Part| a.range[1] == 1.0 && b.range[0] == 0.0;
        is_same && (p.range == q.range || meets(p, q) || meets(q, p))
            || follows[0] && wraps(p, q)
            || follows[1] && wraps(q, p)
    }

    /// Returns a lower bound of the distance of two parts, and parameters where they are near.
    /// `None` if the pair is discarded. Lowers the limit if it finds a strut.
    fn bound(&mut self, pair: &[Part; 2], touches: bool) -> Option<(f64, [f64; 2])> {
        let [p, q] = pair;
        if self.limit_sq <= self.zero_sq {
            return None;
        }
        if touches {
            let all = [directions(&p.hull), directions(&q.hull)];
            let goes_on = is_cone(all.as_flattened());
            return (!goes_on).then(|| (0.0, [p.range[0], q.range[1]]));
        }
        let chord = nearest(p.chord(), q.chord());
        let (apart, deviation) = (chord.distance_sq.sqrt(), p.deviation + q.deviation);
        let least = (apart - deviation).max(0.0);
        let near = |search: &Self| search.limit_sq.sqrt() * (1.0 - ACCURACY);
        if least >= near(self) {
            return None;
        }
        let reach = apart + p.size() + q.size();
        let faces = |p: &Part, q: &Part| {
            let range = |v: Point| range_along(&q.hull, v);
            !is_one_sided(&p.hull, p.is_free, range, reach)
        };
        if !faces(p, q) || !faces(q, p) || self.count > FEW_PAIRS && has_no_minimum(p, q) {
            return None;
        }
        let at = [p.parameter(chord.s), q.parameter(chord.t)];
        if self.distance_sq(at) < self.limit_sq {
            self.descend(at);
        }
        (least < near(self)).then_some((least, at))
    }

    /// Halves the longer one of two parts, or both if they touch, and adds the new pairs to `open`.
    fn divide(&self, [p, q]: &[Part; 2], touches: bool, open: &mut Vec<[Part; 2]>) {
        if self.joints.is_same && p.range == q.range {
            let [a, b] = p.halves();
            return open.extend([[a, a], [b, b], [a, b]]);
        }
        let is_first = p.is_divisible() && (!q.is_divisible() || p.size() >= q.size());
        let halves = [p.halves(), q.halves()];
        let of_p = match is_first || touches && p.is_divisible() {
            true => &halves[0][..],
            false => slice::from_ref(p),
        };
        let of_q = match !is_first || touches && q.is_divisible() {
            true => &halves[1][..],
            false => slice::from_ref(q),
        };
        for a in of_p {
            open.extend(of_q.iter().map(|b| [*a, *b]));
        }
    }

    fn distance_sq(&self, at: [f64; 2]) -> f64 {
        let [p, q] = [0, 1].map(|k| point_at(&self.sides[k].hull, at[k]));
        let d = sub(p, q);
        dot(d, d)
    }

    /// Runs Newton's method from two points. If it ends at a strut that is shorter than the limit,
    /// the strut becomes the new limit.
    fn descend(&mut self, start: [f64; 2]) {
        let mut at = start;
        let mut value = self.distance_sq(at);
        for _ in 0..40 {
            let [p, q] = [0, 1].map(|k| derivatives(&self.sides[k].hull, at[k]));
            let d = sub(p[0], q[0]);
            let gradient = [dot(d, p[1]), -dot(d, q[1])];
            let squares = [dot(p[1], p[1]), dot(q[1], q[1])];
            let is_fixed = [0, 1]
                .map(|k| at[k] == 0.0 && gradient[k] > 0.0 || at[k] == 1.0 && gradient[k] < 0.0);
            let bends = [squares[0] + dot(d, p[2]), squares[1] - dot(d, q[2])];
            let mixed = -dot(p[1], q[1]);
            let alone = |k: usize| match is_fixed[k] {
                true => 0.0,
                false if bends[k] > 1e-3 * squares[k] => -gradient[k] / bends[k],
                false if squares[k] > 0.0 => -0.5 * gradient[k] / squares[k],
                false => 0.0,
            };
            let determinant = bends[0] * bends[1] - mixed * mixed;
            let is_convex = bends[0] > 0.0 && determinant > 1e-9 * bends[0] * bends[1];
            let step = match is_convex && is_fixed == [false; 2] {
                true => [
                    (mixed * gradient[1] - bends[1] * gradient[0]) / determinant,
                    (mixed * gradient[0] - bends[0] * gradient[1]) / determinant,
                ],
                false => [alone(0), alone(1)],
            };
            // The distance decreases by less than its rounding error, so it cannot decide about
            // this step.
            if is_convex && step[0].abs().max(step[1].abs()) < 1e-7 {
                at = [0, 1].map(|k| (at[k] + step[k]).clamp(0.0, 1.0));
                value = self.distance_sq(at);
                break;
            }
            let mut shares = [1.0, 0.25, 0.0625, 1e-2, 1e-3].into_iter();
            let nearer = shares.find_map(|share| {
                let next = [0, 1].map(|k| (at[k] + share * step[k]).clamp(0.0, 1.0));
                let reached = self.distance_sq(next);
                (reached < value).then_some((next, reached))
            });
            let Some(nearer) = nearer else { break };
            (at, value) = nearer;
        }
        at = at.map(|t| if t > 1.0 - 1e-9 { 1.0 } else { t });
        if value < self.limit_sq && self.is_strut(at) {
            self.limit_sq = if value <= self.zero_sq { 0.0 } else { value };
            self.best = Some(at);
        }
    }

    /// Returns true if the distance of these points does not decrease, to first order, if one of
    /// them moves.
    fn is_strut(&self, at: [f64; 2]) -> bool {
        let Joints { is_same, follows } = self.joints;
        let step = 1e-6;
        let is_joint = |s: f64, t: f64| s > 1.0 - step && t < step;
        if is_same && (at[0] - at[1]).abs() < step
            || follows[0] && is_joint(at[0], at[1])
            || follows[1] && is_joint(at[1], at[0])
        {
            return false;
        }
        let [p, q] = [0, 1].map(|k| derivatives(&self.sides[k].hull, at[k]));
        let away = sub(p[0], q[0]);
        dot(away, away) <= self.zero_sq
            || self.sides[0].is_critical(at[0], p[1], away)
                && self.sides[1].is_critical(at[1], q[1], away.map(|x| -x))
    }
}

/// Returns a point of a cubic, and its first and second derivatives.
pub(super) fn derivatives(hull: &Bezier, t: f64) -> [Point; 3] {
    let mix = |a: Point, b: Point| add_scaled(a, t, sub(b, a));
    let [a, b, c, d] = *hull;
    let [ab, bc, cd] = [mix(a, b), mix(b, c), mix(c, d)];
    let [abc, bcd] = [mix(ab, bc), mix(bc, cd)];
    let second = add(sub(bc, ab), sub(bc, cd)).map(|x| -6.0 * x);
    [mix(abc, bcd), sub(bcd, abc).map(|x| 3.0 * x), second]
}

/// Returns true if all these directions are within 90 degrees of one another. Zeros are ignored.
fn is_cone(directions: &[Point]) -> bool {
    let zero = |v: &&Point| **v != [0.0; 3];
    let mut known = directions.iter().filter(zero);
    while let Some(v) = known.next() {
        if known.clone().any(|w| dot(*v, *w) <= 0.0) {
            return false;
        }
    }
    true
}

/// Returns true if two directions differ by more than the tolerance of a joint.
pub(super) fn is_corner(u: Point, v: Point) -> bool {
    dot(u, v) < 0.0 || norm(cross(u, v)) > CORNER * norm(u) * norm(v)
}

fn range_along(hull: &Bezier, v: Point) -> [f64; 2] {
    let [a, b, c, d] = hull.map(|point| dot(point, v));
    [a.min(b).min(c.min(d)), a.max(b).max(c.max(d))]
}

/// Returns true if the distance from a cubic to a set of points has no local minimum along it.
/// `range` returns the smallest and largest products of a vector with the points, which are at most
/// `reach` away from the cubic.
fn is_one_sided(
    hull: &Bezier,
    is_free: [bool; 2],
    range: impl Fn(Point) -> [f64; 2],
    reach: f64,
) -> bool {
    let [mut is_ahead, mut is_behind] = is_free.map(|is_free| !is_free);
    for v in directions(hull).into_iter().filter(|v| *v != [0.0; 3]) {
        let ([least, most], [least_of_others, most_of_others]) = (range_along(hull, v), range(v));
        let margin = CRITICAL * reach * norm(v);
        is_ahead &= least - most_of_others > margin;
        is_behind &= most - least_of_others < -margin;
        if !is_ahead && !is_behind {
            return false;
        }
    }
    true
}

/// Returns true if no critical point of the distance of two parts is a local minimum. Returns false
/// if a part has a free end, where a minimum need not be a critical point.
fn has_no_minimum(p: &Part, q: &Part) -> bool {
    if p.is_free.contains(&true) || q.is_free.contains(&true) {
        return false;
    }
    let [u, v] = [p, q].map(|part| directions(&part.hull).map(|v| v.map(|x| 3.0 * x)));
    let products = |u: &[Point], v: &[Point]| {
        let all = u.iter().flat_map(|a| v.iter().map(|b| dot(*a, *b)));
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], x| {
            [lo.min(x), hi.max(x)]
        })
    };
    // The largest second derivative along a part: the square of its tangent, and the product of
    // its own second derivative with the vector from the other part.
    let most = |u: &[Point; 3], p: &Part, q: &Part| {
        let bends = [sub(u[1], u[0]), sub(u[2], u[1])].map(|v| v.map(|x| 2.0 * x));
        let toward = |bend: Point| range_along(&p.hull, bend)[1] - range_along(&q.hull, bend)[0];
        products(u, u)[1] + toward(bends[0]).max(toward(bends[1]))
    };
    let second = [most(&u, p, q), most(&v, q, p)];
    let [least, greatest] = products(&u, &v);
    // The least magnitude.
    let mixed = least.max(-greatest).max(0.0);
    second.iter().any(|x| *x < 0.0) || second[0] * second[1] < mixed * mixed
}
