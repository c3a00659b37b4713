//! Exact but slow reference implementation ("oracle") that every kernel is tested against.
//!
//! Counts the crossings of integer polygons in 128-bit integers, along a random oblique direction,
//! and retries with another direction whenever a determinant is zero. It shares neither code nor
//! method with the crossing kernel: no trees, no floating point, no axis directions, no
//! tie-breaking rule.
//!
//! Cost: quadratic. The programs in `tests` compile this file, too.

use super::random::Random;

/// Maximum magnitude of a coordinate: `2^40`. Determinants then stay below `2^126`.
pub const LIMIT: i64 = 1 << 40;

/// Returns the linking number of two closed integer polygons, or `None` if they touch.
///
/// The sign is that of Arai's sum.
///
/// # Panics
///
/// If a coordinate exceeds [`LIMIT`], or if 1000 random directions are all degenerate (which
/// means a bug, because the degenerate directions lie on finitely many curves).
pub fn linking_number(a: &[[i64; 3]], b: &[[i64; 3]]) -> Option<i64> {
    let big = a.iter().chain(b).flatten().find(|x| x.abs() > LIMIT);
    assert!(big.is_none(), "coordinate {big:?} exceeds 2^40");
    if touch(a, b) {
        return None;
    }
    let mut random = Random::new(0);
    (0..1000)
        .find_map(|_| {
            let mut slope = || i128::from(random.next() % 512) - 256;
            count(a, b, slope(), slope())
        })
        .map(Some)
        .expect("one of 1000 random directions is in general position")
}

/// Returns the sum of the signs of the crossings at which `a` is above `b`, in projection along
/// `(p, q, 1)`. Returns `None` if that projection is degenerate.
fn count(a: &[[i64; 3]], b: &[[i64; 3]], p: i128, q: i128) -> Option<i64> {
    // Points on one line of sight have the same projection.
    let shadow = |[x, y, z]: [i64; 3]| {
        let (x, y, z) = (i128::from(x), i128::from(y), i128::from(z));
        [x - p * z, y - q * z]
    };
    let edges_of = |v: &[[i64; 3]]| -> Vec<_> {
        edges(v)
            .filter(|(p, q)| p != q)
            .map(|(p, q)| (p, q, shadow(p), shadow(q)))
            .collect()
    };
    let (a, b) = (edges_of(a), edges_of(b));
    let mut sum = 0;
    for &(t0, t1, t0_shadow, t1_shadow) in &a {
        for &(u0, u1, u0_shadow, u1_shadow) in &b {
            // Disjoint in projection: no determinant is needed.
            if (0..2).any(|x| {
                let range = |p: [i128; 2], q: [i128; 2]| (p[x].min(q[x]), p[x].max(q[x]));
                let (t, u) = (range(t0_shadow, t1_shadow), range(u0_shadow, u1_shadow));
                t.1 < u.0 || u.1 < t.0
            }) {
                continue;
            }
            let sides = [
                turn(t0_shadow, t1_shadow, u0_shadow),
                turn(t0_shadow, t1_shadow, u1_shadow),
                turn(u0_shadow, u1_shadow, t0_shadow),
                turn(u0_shadow, u1_shadow, t1_shadow),
            ];
            let [s0, s1, r0, r1] = sides.map(i128::signum);
            // One segment lies wholly on one side of the other. Tested first, because a vertex may
            // lie on the line of an edge in every projection.
            if s0 * s1 > 0 || r0 * r1 > 0 {
                continue;
            }
            if [s0, s1, r0, r1].contains(&0) {
                return None;
            }
            match volume(t0, t1, u0, u1).signum() {
                0 => unreachable!("touching polygons returned `None` before"),
                // The upper end of the line of sight is on t.
                s if s == s1 => {}
                _ => sum += s1 as i64,
            }
        }
    }
    Some(sum)
}

/// Returns the edges of a closed polygon.
pub fn edges<T: Copy>(v: &[T]) -> impl Iterator<Item = (T, T)> + '_ {
    (0..v.len()).map(|k| (v[k], v[(k + 1) % v.len()]))
}

/// Returns twice the signed area of a projected triangle.
fn turn(a: [i128; 2], b: [i128; 2], c: [i128; 2]) -> i128 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Returns six times the signed volume of a tetrahedron, `(a - d) . ((b - d) x (c - d))`.
fn volume(a: [i64; 3], b: [i64; 3], c: [i64; 3], d: [i64; 3]) -> i128 {
    let [a, b, c, d] = [a, b, c, d].map(|p| p.map(i128::from));
    dot(sub(a, d), cross(sub(b, d), sub(c, d)))
}

fn sub(a: [i128; 3], b: [i128; 3]) -> [i128; 3] {
    [0, 1, 2].map(|x| a[x] - b[x])
}

fn dot(a: [i128; 3], b: [i128; 3]) -> i128 {
    (0..3).map(|x| a[x] * b[x]).sum()
}

fn cross(a: [i128; 3], b: [i128; 3]) -> [i128; 3] {
    [(1, 2), (2, 0), (0, 1)].map(|(y, z)| a[y] * b[z] - a[z] * b[y])
}

/// Returns true if two closed polygons share a point.
pub fn touch(a: &[[i64; 3]], b: &[[i64; 3]]) -> bool {
    edges(a).any(|(p0, p1)| edges(b).any(|(q0, q1)| segments_touch(p0, p1, q0, q1)))
}

/// Returns true if two segments share a point, by solving `p0 + s d = q0 + t e` in rational
/// numbers.
fn segments_touch(p0: [i64; 3], p1: [i64; 3], q0: [i64; 3], q1: [i64; 3]) -> bool {
    let [a0, a1, b0, b1] = [p0, p1, q0, q1].map(|p| p.map(i128::from));
    let (d, e, r) = (sub(a1, a0), sub(b1, b0), sub(b0, a0));
    let n = cross(d, e);
    if n != [0; 3] {
        // Not parallel: r = s d - t e has a solution only if r lies in their plane; r x e = s n, r
        // x d = t n.
        let (s, t) = (cross(r, e), cross(r, d));
        let x = if n[0] != 0 {
            0
        } else if n[1] != 0 {
            1
        } else {
            2
        };
        // The segments are coplanar exactly if r is orthogonal to n. 3 * 2^41 * 2^83 fits into 128
        // bits.
        let coplanar = dot(r, n) == 0;
        let within = |v: i128| {
            if n[x] > 0 {
                (0..=n[x]).contains(&v)
            } else {
                (n[x]..=0).contains(&v)
            }
        };
        return coplanar && within(s[x]) && within(t[x]);
    }
    // Parallel, or one of them a point: they meet if they are on one line and their ranges overlap
    // on every axis.
    let on_line = |v: [i128; 3], d: [i128; 3]| cross(v, d) == [0; 3];
    let direction = if d == [0; 3] { e } else { d };
    let line = if direction == [0; 3] {
        r == [0; 3]
    } else {
        on_line(r, direction)
    };
    line && (0..3)
        .all(|x| p0[x].min(p1[x]) <= q0[x].max(q1[x]) && q0[x].min(q1[x]) <= p0[x].max(p1[x]))
}
