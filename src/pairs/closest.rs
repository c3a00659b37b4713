//! Point of closest approach (POCA) of two curves: the place of a pull-through.
//!
//! Branch and bound over both trees. For display and messages only: the distance is that of the
//! polylines (splines: eight chords per segment), in floating point, without an error bound.

use super::layout::Node;
use super::trees::{BoxTree, CurveTree, Trees};
use crate::curve::vector::{add_scaled, cross, distance, dot, half_difference, per_axis, sub};
use crate::curve::{BoxGroup, CurveSet, Point, point_at, pow2, smaller};
use crate::simd::LANES;
use crate::verdict::Place;
use std::ops::{Add, Mul, Sub};

/// Number of chords that approximate a spline segment.
const CHORDS: usize = 8;

/// Returns the place at which curves `i` and `j` are closest. Both must have a tree, so they must
/// be closed.
pub(crate) fn closest_approach(set: &CurveSet, trees: &Trees, i: usize, j: usize) -> Place {
    let mut best = Place {
        segments: [0, 0],
        point: set.knot(i, 0),
        distance: f64::INFINITY,
    };
    let (first, second) = (trees.of(set, i), trees.of(set, j));
    let mut stack = vec![(0.0, first.root(), second.root())];
    let mut next: Vec<(f64, Node, Node)> = Vec::new();
    // Squared distances that overflow or underflow must not prune a point that is nearer than the
    // best one.
    let farther = |bound_sq: f64, best: &Place| {
        let best_sq = best.distance * best.distance;
        bound_sq > best_sq.max(f64::MIN_POSITIVE)
    };
    while let Some((bound_sq, a, b)) = stack.pop() {
        if farther(bound_sq, &best) {
            continue;
        }
        // The node of the higher level is replaced by its children; both are if they are equal.
        let below = |tree: CurveTree<'_>, node: Node, splits: bool| match splits {
            true => {
                let mut leaf = BoxGroup::EMPTY;
                let group = *tree.children(node, &mut leaf);
                (0..8).map(|k| (k, group.lane(k as usize))).collect()
            }
            false => vec![(0, tree.node_box(node))],
        };
        let (a_splits, b_splits) = (a.level >= b.level, b.level >= a.level);
        let (below_a, below_b) = (below(first, a, a_splits), below(second, b, b_splits));
        for &(k, box_a) in &below_a {
            for &(l, box_b) in &below_b {
                let gap = box_a.dist_sq_below(&box_b);
                if gap.is_infinite() || farther(gap, &best) {
                    continue;
                }
                if a.level.max(b.level) > 0 {
                    let a = if a_splits { a.child(k) } else { a };
                    let b = if b_splits { b.child(l) } else { b };
                    next.push((gap, a, b));
                    continue;
                }
                let place = closest_of_segments(set, [i, j], [a.lane(k), b.lane(l)]);
                if place.distance < best.distance {
                    best = place;
                }
            }
        }
        // The nearest is on top of the stack. Empty lanes are infinitely far away.
        next.sort_by(|p, q| q.0.total_cmp(&p.0));
        stack.append(&mut next);
    }
    best
}

/// Returns the place at which two segments are closest, one of each curve.
pub(crate) fn closest_of_segments(set: &CurveSet, [i, j]: [usize; 2], segments: [u32; 2]) -> Place {
    let mut buffers = [[[0.0; 3]; CHORDS + 1]; 2];
    let [p, q] = &mut buffers;
    let p = chords(set, i, segments[0], p);
    let q = chords(set, j, segments[1], q);
    let mut best = ([0.0; 3], f64::INFINITY);
    for a in p.windows(2) {
        for b in q.windows(2) {
            let found = closest_place(a[0], a[1], b[0], b[1]);
            if found.1 < best.1 {
                best = found;
            }
        }
    }
    let (point, distance) = best;
    Place {
        segments,
        point,
        distance,
    }
}

/// Returns the vertices of the chords of segment `s` of curve `i`.
fn chords<'a>(
    set: &CurveSet,
    i: usize,
    s: u32,
    buffer: &'a mut [Point; CHORDS + 1],
) -> &'a [Point] {
    let s = s as usize;
    if set.basis().is_polyline() {
        buffer[..2].copy_from_slice(&[set.knot(i, s), set.knot(i, s + 1)]);
        return &buffer[..2];
    }
    let b = set.segment(i, s);
    for (k, p) in buffer.iter_mut().enumerate() {
        *p = point_at(&b, k as f64 / CHORDS as f64);
    }
    buffer
}

/// Returns midpoint and length of the shortest connection of two straight segments.
pub(crate) fn closest_place(p0: Point, p1: Point, q0: Point, q1: Point) -> (Point, f64) {
    let [a, b] = closest_points(p0, p1, q0, q1);
    // Halves are added, because the sum may overflow.
    let middle = per_axis(|x| 0.5 * a[x] + 0.5 * b[x]);
    let scale = Scale::of([a, b].into_iter());
    (middle, scale.undo(distance(scale.apply(a), scale.apply(b))))
}

/// A power of two that scales points so that products of four differences neither overflow nor
/// underflow. It is 1 except for extreme points. Scaling loses nothing that is significant relative
/// to the largest difference.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale([f64; 2]);

impl Scale {
    /// Exponents of differences that need no scaling.
    const ORDINARY: std::ops::RangeInclusive<i32> = -200..=200;

    pub fn of(points: impl Iterator<Item = Point> + Clone) -> Scale {
        let first = points.clone().next().unwrap_or_default();
        // Halves are subtracted, because the difference of two finite numbers may overflow.
        let halves = |p: Point| half_difference(p, first).map(f64::abs);
        let largest = points
            .flat_map(halves)
            .fold(0.0, |m: f64, x| if x > m { x } else { m });
        let biased = (largest.to_bits() >> 52) as i32;
        let exponent = (biased - 1023).clamp(-1022, 1022);
        if largest == 0.0 || Scale::ORDINARY.contains(&exponent) {
            return Scale([1.0; 2]);
        }
        Scale([pow2(-exponent), pow2(exponent)])
    }

    pub fn apply(self, p: Point) -> Point {
        p.map(|x| x * self.0[0])
    }

    pub fn undo(self, x: f64) -> f64 {
        x * self.0[1]
    }
}

/// Returns the ends of the shortest connection of two straight segments, in floating point.
pub(crate) fn closest_points(p0: Point, p1: Point, q0: Point, q1: Point) -> [Point; 2] {
    let scale = Scale::of([p0, p1, q0, q1].into_iter());
    let [p0, p1, q0, q1] = [p0, p1, q0, q1].map(|p| scale.apply(p));
    let (d, e) = (sub(p1, p0), sub(q1, q0));
    let Nearest { s, t, .. } = nearest([p0, d], [q0, e]);
    [add_scaled(p0, s, d), add_scaled(q0, t, e)].map(|p| p.map(|x| scale.undo(x)))
}

/// Nearest points of two straight segments.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest {
    /// Place on the first segment, from 0 to 1.
    pub s: f64,
    /// Place on the second segment, from 0 to 1.
    pub t: f64,
    /// Squared distance.
    pub distance_sq: f64,
}

/// Returns the nearest points of two segments, each given by its start and the vector to its end,
/// in floating point. Products of four coordinates must neither overflow nor underflow.
#[inline]
pub(crate) fn nearest(first: [Point; 2], second: [Point; 2]) -> Nearest {
    let mut best = Nearest {
        s: 0.0,
        t: 0.0,
        distance_sq: f64::INFINITY,
    };
    for [s, t] in candidates(first, second) {
        let distance_sq = squared_distance(first, second, [s, t]);
        if distance_sq < best.distance_sq {
            best = Nearest { s, t, distance_sq };
        }
    }
    best
}

/// Returns the squared distances of eight pairs of segments, each the same as by [`nearest`].
#[inline(always)]
pub(crate) fn squared_distances(first: [[Eight; 3]; 2], second: [[Eight; 3]; 2]) -> [f64; LANES] {
    let mut least = Eight([f64::INFINITY; LANES]);
    for places in candidates(first, second) {
        least = least.with(squared_distance(first, second, places), smaller);
    }
    least.0
}

/// Returns five pairs of places on two segments. One of them has the nearest points.
#[inline(always)]
fn candidates<T: Number>([p0, d]: [[T; 3]; 2], [q0, e]: [[T; 3]; 2]) -> [[T; 2]; 5] {
    let r = sub(p0, q0);
    let (dd, de, ee, dr, er) = (dot(d, d), dot(d, e), dot(e, e), dot(d, r), dot(e, r));
    // The four ends with the other segment, and the interior. Nearly parallel segments need no
    // threshold, because an end finds their nearest points as well.
    let [start, end] = [T::all(0.0), T::all(1.0)];
    let nearest_to_start = [start, er.place(ee)];
    let nearest_to_end = [end, (er + de).place(ee)];
    let start_of_second = [(start - dr).place(dd), start];
    let end_of_second = [(de - dr).place(dd), end];
    // The shortest connection of two lines is parallel to the normal of both. Scalar products alone
    // would find its place with an error that grows with the inverse square of the angle between
    // the lines; with the normal, the distance is as precise as the coordinates.
    let normal = cross(d, e);
    let s = dot(cross(e, r), normal).place(dot(normal, normal));
    let interior = [s, (er + s * de).place(ee)];
    [
        nearest_to_start,
        nearest_to_end,
        start_of_second,
        end_of_second,
        interior,
    ]
}

/// Returns the squared distance of two places on segments.
#[inline(always)]
fn squared_distance<T: Number>([p0, d]: [[T; 3]; 2], [q0, e]: [[T; 3]; 2], [s, t]: [T; 2]) -> T {
    let c = sub(add_scaled(p0, s, d), add_scaled(q0, t, e));
    dot(c, c)
}

/// A number, or eight of them.
trait Number: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    fn all(x: f64) -> Self;

    /// Returns the quotient of two numbers, from 0 to 1; 0 if the denominator is not positive.
    fn place(self, denominator: Self) -> Self;
}

impl Number for f64 {
    #[inline(always)]
    fn all(x: f64) -> f64 {
        x
    }

    #[inline(always)]
    fn place(self, denominator: f64) -> f64 {
        let quotient = (self / denominator).clamp(0.0, 1.0);
        if denominator > 0.0 { quotient } else { 0.0 }
    }
}

impl Number for Eight {
    #[inline(always)]
    fn all(x: f64) -> Eight {
        Eight([x; LANES])
    }

    #[inline(always)]
    fn place(self, denominator: Eight) -> Eight {
        self.with(denominator, f64::place)
    }
}

/// Eight numbers. Loops over them are compiled to vector instructions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eight(pub [f64; LANES]);

impl Eight {
    /// Returns eight vectors that are all `v`.
    #[inline(always)]
    pub fn repeat(v: Point) -> [Eight; 3] {
        per_axis(|x| Eight::all(v[x]))
    }

    #[inline(always)]
    fn with(mut self, other: Eight, f: impl Fn(f64, f64) -> f64) -> Eight {
        for (a, b) in self.0.iter_mut().zip(other.0) {
            *a = f(*a, b);
        }
        self
    }
}

macro_rules! operators {
    ($($Operator:ident::$f:ident)+) => {$(
        impl $Operator for Eight {
            type Output = Eight;

            #[inline(always)]
            fn $f(self, other: Eight) -> Eight {
                self.with(other, f64::$f)
            }
        }
    )+};
}

operators! { Add::add Sub::sub Mul::mul }

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{Basis, Positions};
    use crate::random::Random;
    use num_bigint::BigInt;

    #[test]
    fn branch_and_bound_equals_all_pairs() {
        for basis in [Basis::Polyline, Basis::BSpline, Basis::CatmullRom] {
            let n = 150;
            let ring = |phase: f64, z: f64| {
                (0..n).flat_map(move |k| {
                    let t = f64::from(k) / f64::from(n) * std::f64::consts::TAU;
                    [t.cos() + phase, t.sin(), z + 0.2 * (7.0 * t + phase).sin()]
                })
            };
            let xyz: Vec<f64> = ring(0.0, 0.0).chain(ring(0.7, 0.31)).collect();
            let set = CurveSet::from_counts(basis, &[-n, -n], Positions::F64(&xyz)).unwrap();
            let mut trees = Trees::default();
            trees.refit(&set);
            let found = closest_approach(&set, &trees, 0, 1);
            let mut want = f64::INFINITY;
            for s in 0..n as u32 {
                for t in 0..n as u32 {
                    want = want.min(closest_of_segments(&set, [0, 1], [s, t]).distance);
                }
            }
            assert_eq!(found.distance, want, "{basis:?}");
            assert_eq!(closest_of_segments(&set, [0, 1], found.segments), found);
        }
    }

    #[test]
    fn eight_squared_distances_are_those_of_the_nearest_points() {
        let mut random = Random::new(5);
        for k in 0..1000 {
            // Some vectors are parallel, orthogonal, or zero.
            let mut segments = || {
                let mut eight = [[Eight([0.0; LANES]); 3]; 2];
                for (v, x) in eight.as_flattened_mut().iter_mut().zip(0..) {
                    v.0 = v.0.map(|_| match (k + x) % 4 {
                        0 => random.below(3_usize) as f64 - 1.0,
                        _ => random.between(-1.0, 1.0),
                    });
                }
                if k % 10 == 0 {
                    eight[1] = Eight::repeat([1.0, -2.0, f64::from(k % 3)]);
                }
                eight
            };
            let (one, other) = (segments(), segments());
            let found = squared_distances(one, other);
            for (l, found) in found.into_iter().enumerate() {
                let lane = |v: [Eight; 3]| per_axis(|x| v[x].0[l]);
                assert_eq!(
                    found,
                    nearest(one.map(lane), other.map(lane)).distance_sq,
                    "{k} {l}"
                );
            }
        }
    }

    /// Returns a number as a multiple of `2^-200`, exactly.
    fn exact(x: f64) -> BigInt {
        let bits = x.to_bits();
        let exponent = (bits >> 52 & 0x7ff) as i64;
        let mantissa = bits & ((1 << 52) - 1) | if exponent > 0 { 1 << 52 } else { 0 };
        let shift = exponent.max(1) - 1075 + 200;
        let magnitude =
            BigInt::from(mantissa) << u64::try_from(shift).expect("a number of this test");
        if x < 0.0 { -magnitude } else { magnitude }
    }

    fn exact_dot(a: &[BigInt; 3], b: &[BigInt; 3]) -> BigInt {
        a.iter().zip(b).map(|(x, y)| x * y).sum()
    }

    /// Returns the distance of two segments, from exact squares of all candidates.
    fn exact_distance([p0, d]: [Point; 2], [q0, e]: [Point; 2]) -> f64 {
        let [p0, d, q0, e] = [p0, d, q0, e].map(|v| v.map(exact));
        let minus =
            |a: &[BigInt; 3], b: &[BigInt; 3]| -> [BigInt; 3] { per_axis(|x| &a[x] - &b[x]) };
        let plus =
            |a: &[BigInt; 3], b: &[BigInt; 3]| -> [BigInt; 3] { per_axis(|x| &a[x] + &b[x]) };
        // Squared distances as fractions.
        let mut all: Vec<(BigInt, BigInt)> = Vec::new();
        let mut point_and_segment = |point: &[BigInt; 3], start: &[BigInt; 3], v: &[BigInt; 3]| {
            let w = minus(point, start);
            let (vv, wv, ww) = (exact_dot(v, v), exact_dot(&w, v), exact_dot(&w, &w));
            let zero = BigInt::default();
            if wv > zero && wv < vv {
                all.push((&ww * &vv - &wv * &wv, vv));
            } else {
                let end = minus(&w, v);
                let one = BigInt::from(1);
                all.push((ww, one.clone()));
                all.push((exact_dot(&end, &end), one));
            }
        };
        for point in [p0.clone(), plus(&p0, &d)] {
            point_and_segment(&point, &q0, &e);
        }
        for point in [q0.clone(), plus(&q0, &e)] {
            point_and_segment(&point, &p0, &d);
        }
        let r = minus(&p0, &q0);
        let [dd, de, ee] = [(&d, &d), (&d, &e), (&e, &e)].map(|(a, b)| exact_dot(a, b));
        let (dr, er) = (exact_dot(&d, &r), exact_dot(&e, &r));
        let determinant = &dd * &ee - &de * &de;
        let inside = |x: &BigInt| *x > BigInt::default() && *x < determinant;
        if inside(&(&de * &er - &ee * &dr)) && inside(&(&dd * &er - &de * &dr)) {
            let cross = |a: &[BigInt; 3], b: &[BigInt; 3]| -> [BigInt; 3] {
                [(1, 2), (2, 0), (0, 1)].map(|(x, y)| &a[x] * &b[y] - &a[y] * &b[x])
            };
            let volume = exact_dot(&r, &cross(&d, &e));
            all.push((&volume * &volume, determinant));
        }
        // The root of the quotient, with 80 binary digits beyond the unit of `2^-200`.
        let root = |(numerator, denominator): &(BigInt, BigInt)| {
            ((numerator << 160_u32) / denominator).sqrt()
        };
        let least = all.iter().map(root).min().expect("candidates");
        let digits = least.bits().saturating_sub(60);
        let leading = (least >> digits)
            .to_string()
            .parse::<f64>()
            .expect("a number");
        leading * 2f64.powi(digits as i32 - 280)
    }

    /// The distance has the error of the coordinates only, for segments that are nearly parallel,
    /// tiny, far apart or almost in contact, in both precisions.
    #[test]
    fn distances_of_segments_are_as_precise_as_their_coordinates() {
        let mut random = crate::random::Random::new(1);
        let mut worst = 0.0_f64;
        for k in 0..20_000 {
            let mut magnitude = |low: f64, high: f64| 10f64.powf(random.between(low, high));
            let scale = magnitude(-6.0, 6.0);
            let lengths = [magnitude(-4.0, 0.0), magnitude(-4.0, 0.0)];
            let (gap, angle) = (magnitude(-12.0, 0.0), magnitude(-9.0, 0.0));
            let mut vector = || [0.0; 3].map(|_: f64| random.between(-1.0, 1.0));
            let unit = |v: Point| v.map(|x| x / distance(v, [0.0; 3]));
            let (d, other) = (unit(vector()), unit(vector()));
            let across = unit(cross(d, other));
            let e = unit(add_scaled(d, angle, unit(cross(d, across))));
            let normal = unit(cross(d, across));
            let normal = if k % 2 == 0 { across } else { normal };
            let [s, t] = [random.between(-0.5, 1.5), random.between(-0.5, 1.5)];
            let p0 = add_scaled([0.0; 3], -s * lengths[0], d);
            let q0 = add_scaled(add_scaled([0.0; 3], gap, normal), -t * lengths[1], e);
            let value = |v: Point| match k % 3 {
                0 => v.map(|x| f64::from((scale * x) as f32)),
                _ => v.map(|x| scale * x),
            };
            let first = [value(p0), value(d.map(|x| x * lengths[0]))];
            let second = [value(q0), value(e.map(|x| x * lengths[1]))];
            let found = nearest(first, second).distance_sq.sqrt();
            let wanted = exact_distance(first, second);
            let sizes = [first[0], second[0], first[1], second[1]];
            let size: f64 = sizes.map(|v| distance(v, [0.0; 3])).iter().sum();
            worst = worst.max((found - wanted).abs() / size);
        }
        assert!(worst < 4.0 * f64::EPSILON, "{worst:e}");
    }

    /// Regression: if squares overflowed, the place was the origin and the distance infinite; if
    /// they underflowed, the distance was 0.
    #[test]
    fn finds_the_place_and_distance_of_extreme_coordinates() {
        for k in [1e200, 1e300, 1e-200, 1e-300, 1e150, 1e-150, 1.0] {
            let v = |p: [f64; 3]| p.map(|x| x * k);
            let (point, distance) = closest_place(
                v([-1., 0.25, 0.]),
                v([1., 0.25, 0.]),
                v([0.5, -1., 0.25]),
                v([0.5, 1., 0.25]),
            );
            let near = |found: f64, want: f64| (found / k - want).abs() < 1e-15;
            assert!(near(distance, 0.25), "{k:e}: {distance:e}");
            let want = [0.5, 0.25, 0.125];
            assert!((0..3).all(|x| near(point[x], want[x])), "{k:e}: {point:?}");
        }
        // Mixed: a tiny segment beside a huge one, and both far from the origin.
        let (point, distance) = closest_place(
            [-1e200, 0.0, 0.0],
            [1e200, 0.0, 0.0],
            [1e-200, 3e-200, 0.0],
            [1e-200, 3e-200, 1e199],
        );
        assert!(
            distance < 1e185 && point[0].abs() < 1e185,
            "{point:?} {distance:e}"
        );
        let far = [f64::MAX, -f64::MAX].map(|x| [x, 0.0, 0.0]);
        let (point, distance) = closest_place(far[0], far[0], far[1], far[1]);
        assert_eq!((point, distance), ([0.0; 3], f64::INFINITY));
        let tiny = f64::from_bits(4);
        let (point, distance) = closest_place([tiny; 3], [tiny; 3], [0.0; 3], [0.0; 3]);
        assert_eq!(point, [tiny / 2.0; 3]);
        assert!(distance > tiny && distance < 2.0 * tiny, "{distance:e}");
    }

    #[test]
    fn scaling_by_a_power_of_two_scales_the_place() {
        let n = 37;
        let ring = |k: f64, phase: f64, shift: f64| {
            (0..n).flat_map(move |m| {
                let t = f64::from(m) / f64::from(n) * std::f64::consts::TAU;
                [t.cos() + shift, t.sin(), (t + phase).sin() + shift].map(|x| x * k)
            })
        };
        let place = |k: f64| {
            let xyz: Vec<f64> = ring(k, 0.0, 0.0).chain(ring(k, 1.0, 0.7)).collect();
            let positions = Positions::F64(&xyz);
            let set = CurveSet::from_counts(Basis::Polyline, &[-n, -n], positions).unwrap();
            let mut trees = Trees::default();
            trees.refit(&set);
            closest_approach(&set, &trees, 0, 1)
        };
        let want = place(1.0);
        for exponent in [660, 900, 1000, -660, -900] {
            let k = 2f64.powi(exponent);
            let found = place(k);
            assert_eq!(found.segments, want.segments, "2^{exponent}");
            assert_eq!(found.distance, want.distance * k, "2^{exponent}");
            assert_eq!(found.point, want.point.map(|x| x * k), "2^{exponent}");
        }
    }

    #[test]
    fn finds_the_distance_of_parallel_crossing_and_degenerate_segments() {
        let d = |p0, p1, q0, q1| closest_place(p0, p1, q0, q1).1;
        let o = [0.0; 3];
        for k in [1.0, 1e-3, 1e-12, 1e9] {
            let v = |p: [f64; 3]| p.map(|x| x * k);
            let far = |a: f64, b: f64| (a - b * k).abs() <= 1e-12 * k;
            assert!(far(
                d(
                    v([-1., 0., 0.]),
                    v([1., 0., 0.]),
                    v([0., -1., 0.25]),
                    v([0., 1., 0.25])
                ),
                0.25
            ));
            assert!(far(
                d(o, v([1., 0., 0.]), v([0.5, 0.125, 0.]), v([7., 0.125, 0.])),
                0.125
            ));
            assert!(far(d(o, o, v([3., 4., 0.]), v([3., 4., 0.])), 5.0));
            assert!(far(
                d(o, v([1., 0., 0.]), v([2., 0., 0.]), v([3., 0., 0.])),
                1.0
            ));
        }
    }
}
