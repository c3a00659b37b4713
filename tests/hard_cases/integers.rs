//! Integer polygons, with the answers of the oracle.

use crate::case::{Case, Polygon};
use crate::support::random::Random;

pub fn cases() -> Vec<Case> {
    let mut cases = vec![shadows_on_shadows(), parity_lattice(), repeated_vertices()];
    cases.extend([2, 3, 5, 9].map(small_triangles));
    cases.extend([3, 6, 20].map(axis_aligned_polygons));
    cases.extend([4, 12].map(rectangles_on_a_lattice));
    cases.extend([0, 1, 2].map(coplanar));
    cases.extend([10, 1000, 1 << 20].map(random_polygons));
    cases.extend([20, 30].map(long_and_near));
    cases
}

/// Loops of three vertices in thousands of pairs. They share vertices, edges, lines and planes, and
/// some are collinear.
fn small_triangles(size: i64) -> Case {
    let mut random = Random::new(size as u64);
    let triangles: Vec<Polygon> = (0..70).map(|_| random.polygon(3, size)).collect();
    Case::integers(format!("triangles on a grid of {size}"), &triangles)
}

/// Edges along the axes with few different coordinates: every projection of the crossing kernel is
/// degenerate everywhere.
fn axis_aligned_polygons(size: i64) -> Case {
    let mut random = Random::new(100 + size as u64);
    let polygons: Vec<Polygon> = (4..20).map(|n| random.along_axes(n, size)).collect();
    Case::integers(
        format!("axis-aligned polygons on a grid of {size}"),
        &polygons,
    )
}

/// Many rectangles in axis planes: chains, contact and coplanar neighbours at once.
fn rectangles_on_a_lattice(size: i64) -> Case {
    let mut random = Random::new(200 + size as u64);
    let mut rectangle = || {
        let (axis, [x, y, z]) = (random.below(3), random.grid(size));
        let (w, h) = (1 + random.below(size), 1 + random.below(size));
        let mut points = vec![[x, y, z], [x + w, y, z], [x + w, y + h, z], [x, y + h, z]];
        points.iter_mut().for_each(|p| p.rotate_left(axis));
        points
    };
    let rectangles: Vec<Polygon> = (0..60).map(|_| rectangle()).collect();
    Case::integers(format!("rectangles on a lattice of {size}"), &rectangles)
}

/// All loops lie in one axis plane. Two of the three projections are lines, the third one has
/// self-crossings. Each pair touches or has linking number 0.
fn coplanar(axis: usize) -> Case {
    let mut random = Random::new(300 + axis as u64);
    let mut polygon = |n: usize| {
        let mut points = random.polygon(n, 40);
        points.iter_mut().for_each(|p| p[axis] = 7);
        points
    };
    let polygons: Vec<Polygon> = (0..30).map(|k| polygon(3 + k % 5)).collect();
    Case::integers(format!("coplanar, axis {axis}"), &polygons)
}

/// The loops of a triple have the same projection along one axis: every vertex is above a vertex,
/// every edge above an edge, and only the heights differ.
fn shadows_on_shadows() -> Case {
    let mut random = Random::new(400);
    let first = random.polygon(24, 50);
    let mut polygons = vec![first.clone()];
    for axis in 0..3 {
        let mut copy = first.clone();
        copy.iter_mut().for_each(|p| p[axis] = random.below(50));
        polygons.push(copy);
    }
    Case::integers("shadows on shadows", &polygons)
}

/// Loops on the even points of a small grid and loops on the odd ones. Along each axis, the
/// vertices of one loop project onto those of another one, but no vertex is shared.
fn parity_lattice() -> Case {
    let mut random = Random::new(500);
    let mut polygon = |parity: i64, n: usize| -> Polygon {
        let mut point = || loop {
            let p = random.grid(5);
            if p.iter().sum::<i64>() % 2 == parity {
                return p;
            }
        };
        (0..n).map(|_| point()).collect()
    };
    let polygons: Vec<Polygon> = (0..24)
        .map(|k| polygon(k % 2, 3 + k as usize % 4))
        .collect();
    Case::integers("parity lattice", &polygons)
}

/// The random polygons that kernels are compared by (Arai 2013, example 8): uniform vertices, large
/// numbers of crossings.
fn random_polygons(size: i64) -> Case {
    let mut random = Random::new(600 + size as u64);
    let polygons: Vec<Polygon> = [5, 20, 40, 80].map(|n| random.polygon(n, size)).into();
    Case::integers(format!("random polygons on a grid of {size}"), &polygons)
}

/// Equal consecutive vertices, up to four, also across the end, and edges that go back and forth.
fn repeated_vertices() -> Case {
    let mut random = Random::new(700);
    let mut polygon = || {
        let mut out = Polygon::new();
        for k in 0..9 {
            let p = random.grid(30);
            (0..=random.below(4)).for_each(|_| out.push(p));
            if k % 3 == 2 {
                out.extend([random.grid(30), p]);
            }
        }
        out.push(out[0]);
        out
    };
    let polygons: Vec<Polygon> = (0..8).map(|_| polygon()).collect();
    Case::integers("repeated vertices", &polygons)
}

/// Random polygons, stretched by `2^bits` along x and then sheared. Long segments are nearly
/// parallel, at distances that are tiny compared with their lengths.
fn long_and_near(bits: u32) -> Case {
    let mut random = Random::new(800 + u64::from(bits));
    let polygons: Vec<Polygon> = [3, 4, 12, 20].map(|n| random.polygon(n, 60)).into();
    let map = |[x, y, z]: [i64; 3]| {
        let long = x << bits;
        [long, y + long, z - 2 * long].map(|v| v as f64)
    };
    Case::mapped(format!("long and near, 2^{bits}"), &polygons, map)
}
