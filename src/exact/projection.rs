//! Predicates of a projection along any direction, exact on the input floats.
//!
//! The signed area of a triangle `a b c`, seen against a direction `d`, is the determinant of
//! `b - a`, `c - a` and `d`, up to a positive factor. It needs no projected points.

use super::big::{self, BigPoint};
use super::predicates::{Predicates, determinant};
use crate::curve::vector::{add, per_axis, sub};
use crate::curve::{Point, pow2, single};
use num_bigint::BigInt;
use std::cmp::Ordering;

/// A direction of projection with integer components. The viewer looks against it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Direction([i32; 3]);

/// A signed area in floating point, with a bound of its error.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    pub value: f64,
    pub bound: f64,
    /// The exact sign: -1, 0 or 1.
    pub sign: i32,
}

impl Direction {
    /// Returns a direction; not all components are 0.
    pub fn new(components: [i32; 3]) -> Direction {
        Direction(components)
    }

    /// Returns linear functions that are constant along the direction, and any two of which are
    /// independent if the component along `axis` is not 0. Their coefficients are exact, and of the
    /// order of 1 for components of the order of `2^30`.
    pub fn functions(&self, axis: usize) -> [Point; 3] {
        let d = self.0.map(|x| f64::from(x) * pow2(-30));
        let [f, g] = [(axis + 1) % 3, (axis + 2) % 3].map(|x| {
            let mut f = [0.0; 3];
            (f[x], f[axis]) = (d[axis], -d[x]);
            f
        });
        [f, g, add(f, g)]
    }

    /// Returns the area of a triangle: positive if it is counterclockwise, 0 if its projection is
    /// on a line.
    #[inline(always)]
    pub fn area(&self, [a, b, c]: [Point; 3]) -> Seen {
        let (value, bound) = determinant([sub(b, a), sub(c, a), self.0.map(f64::from)]);
        let sign = match value.abs() > bound {
            true => value.signum() as i32,
            false => self.exact_sign([a, b, c]),
        };
        Seen { value, bound, sign }
    }

    #[cold]
    #[inline(never)]
    fn exact_sign(&self, points: [Point; 3]) -> i32 {
        let [a, b, c] = big::points(points.map(|p| p.map(single)));
        big::sign(&self.exact_area(&a, &b, &c))
    }

    fn exact_area(&self, a: &BigPoint, b: &BigPoint, c: &BigPoint) -> BigInt {
        let from_a = |p: &BigPoint| per_axis(|x| &p[x] - &a[x]);
        let (u, v) = (from_a(b), from_a(c));
        let minor = |x: usize, y: usize| &u[x] * &v[y] - &u[y] * &v[x];
        minor(1, 2) * self.0[0] + minor(2, 0) * self.0[1] + minor(0, 1) * self.0[2]
    }

    /// Compares the parameters on edge `p` at which the projections of edges `q` and `r` cross it.
    ///
    /// The parameter is `A / (A - B)`, with the areas `A` and `B` of the triangles of the crossing
    /// edge and the start and the end of `p`.
    #[cold]
    pub fn compare_along(&self, p: [Point; 2], q: [Point; 2], r: [Point; 2]) -> Ordering {
        let points = [p[0], p[1], q[0], q[1], r[0], r[1]].map(|p| p.map(single));
        let [p0, p1, q0, q1, r0, r1] = big::points(points);
        let fraction = |a: &BigPoint, b: &BigPoint| {
            let (start, end) = (self.exact_area(a, b, &p0), self.exact_area(a, b, &p1));
            let whole = &start - end;
            match big::sign(&whole) {
                -1 => (-start, -whole),
                _ => (start, whole),
            }
        };
        let ((q, of_q), (r, of_r)) = (fraction(&q0, &q1), fraction(&r0, &r1));
        (q * of_r).cmp(&(r * of_q))
    }
}

/// Returns true if three points lie on one line in space: their projections along all axes do.
pub(crate) fn are_collinear([a, b, c]: [Point; 3], predicates: &mut Predicates) -> bool {
    (0..3).all(|x| {
        let [a, b, c] = [a, b, c].map(|p| [p[x], p[(x + 1) % 3]]);
        predicates.orient2d(a, b, c) == 0
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::vector::{cross, dot};
    use crate::random::Random;

    /// Along the axes, the area has the sign of the two-dimensional predicate.
    #[test]
    fn areas_along_an_axis_agree_with_the_plane() {
        let mut random = Random::new(1);
        for _ in 0..2000 {
            let points = [(); 3].map(|()| [(); 3].map(|()| f64::from(random.below(5))));
            let axis = random.below(3usize);
            let mut d = [0; 3];
            d[axis] = 7;
            let seen = Direction::new(d).area(points);
            let plane = points.map(|p| [p[(axis + 1) % 3], p[(axis + 2) % 3]]);
            let expected = Predicates::default().orient2d(plane[0], plane[1], plane[2]);
            assert_eq!(seen.sign, expected, "{points:?}");
            assert!((seen.value - f64::from(seen.value as i32)).abs() <= seen.bound);
        }
    }

    #[test]
    fn functions_are_constant_along_the_direction() {
        let direction = Direction::new([3, -5, 11]);
        for axis in 0..3 {
            let functions = direction.functions(axis);
            assert!(functions.iter().all(|f| dot(*f, [3.0, -5.0, 11.0]) == 0.0));
            assert_ne!(cross(functions[0], functions[1]), [0.0; 3]);
        }
    }

    #[test]
    fn crossings_along_an_edge_are_compared_exactly() {
        let direction = Direction::new([0, 0, 1]);
        let p = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]];
        let at = |x: f64| [[x, -1.0, 5.0], [x, 2.0, 5.0]];
        let tilted = [[0.0, -1.0, -3.0], [2.0, 1.0, -3.0]];
        let compare = |q, r| direction.compare_along(p, q, r);
        assert_eq!(compare(at(1.0), tilted), Ordering::Equal);
        assert_eq!(compare(at(1.0f64.next_up()), tilted), Ordering::Greater);
        assert_eq!(compare(tilted, at(1.0f64.next_up())), Ordering::Less);
        let [a, b] = at(2.0);
        assert_eq!(compare([b, a], tilted), Ordering::Greater);
    }
}
