//! Polylines that share a point or nearly do, and degenerate loops.

use crate::case::{Case, Polygon};
use crate::links::hopf_polygons;
use crate::support::random::Random;

pub fn cases() -> Vec<Case> {
    let square = vec![[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]];
    let mut cases = Vec::new();
    for (name, other) in others() {
        let pair = [square.clone(), other];
        cases.push(Case::integers(name, &pair));
        // An exact map that leaves no edge parallel to an axis.
        let skew = |[x, y, z]: [i64; 3]| [x + 2 * y + z, y - 3 * x, z + x + y].map(|v| v as f64);
        cases.push(Case::mapped(format!("{name}, skew"), &pair, skew));
        // Multiples of the smallest positive number, and of a number near the largest.
        let tiny = |p: [i64; 3]| p.map(|v| v as f64 * f64::from_bits(1));
        cases.push(Case::mapped(format!("{name}, subnormal"), &pair, tiny));
        let huge = |p: [i64; 3]| p.map(|v| v as f64 * 2f64.powi(1019));
        cases.push(Case::mapped(format!("{name}, huge"), &pair, huge));
    }
    cases.extend([
        degenerate_beside_good(),
        contact_hides_nothing(),
        random_contacts(),
    ]);
    cases
}

/// Loops that meet the square of side 4 at the origin in all possible ways, or miss it narrowly.
fn others() -> Vec<(&'static str, Polygon)> {
    let square = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]];
    let [a, b, c, d] = square;
    vec![
        ("vertex on vertex", vec![a, [-4, 0, 3], [0, -4, 3]]),
        (
            "vertex on vertex, through the disc",
            vec![a, [1, 1, 3], [2, 2, -3]],
        ),
        ("vertex on edge", vec![[2, 0, 0], [2, -4, 3], [3, -4, -3]]),
        (
            "vertex on edge, from below to above",
            vec![[2, 0, 0], [2, 1, 3], [3, -4, -3]],
        ),
        ("edge on vertex", vec![[-1, 1, -1], [1, -1, 1], [9, -9, -9]]),
        ("edge crosses edge", vec![[2, -2, -2], [2, 2, 2], [9, 9, 9]]),
        (
            "edge crosses edge in the plane",
            vec![[2, -2, 0], [2, 2, 0], [9, 9, 9]],
        ),
        ("edges overlap", vec![[2, 0, 0], [6, 0, 0], [5, -2, 5]]),
        (
            "edges overlap the other way",
            vec![[6, 0, 0], [2, 0, 0], [5, -2, 5]],
        ),
        ("edge within edge", vec![[1, 0, 0], [3, 0, 0], [2, 2, 5]]),
        ("edges end to end", vec![[4, 0, 0], [8, 0, 0], [6, 2, 5]]),
        (
            "edges on one line, apart",
            vec![[5, 0, 0], [8, 0, 0], [6, 2, 5]],
        ),
        (
            "in the plane, inside",
            vec![[1, 1, 0], [2, 1, 0], [1, 2, 0]],
        ),
        (
            "in the plane, around",
            vec![[-1, -1, 0], [9, -1, 0], [-1, 9, 0]],
        ),
        (
            "in the plane, beside",
            vec![[5, 1, 0], [6, 1, 0], [5, 3, 0]],
        ),
        ("vertex in the disc", vec![[2, 2, 0], [1, 1, 3], [2, 9, 3]]),
        (
            "vertex in the disc, through it",
            vec![[2, 2, 0], [1, 1, 3], [2, 9, 3], [2, 9, -3]],
        ),
        (
            "edge in the disc, through it",
            vec![[2, 2, 0], [1, 2, 0], [1, 1, 3], [9, 9, 3], [9, 9, -3]],
        ),
        ("identical", vec![a, b, c, d]),
        ("identical, shifted", vec![c, d, a, b]),
        ("identical, reversed", vec![d, c, b, a]),
        (
            "identical, other vertices",
            vec![a, [1, 0, 0], b, [4, 3, 0], c, d],
        ),
        ("its diagonal", vec![a, c, [2, 2, 0]]),
        (
            "a flat loop through it",
            vec![[2, 2, -3], [2, 2, 3], [2, 2, 1]],
        ),
        (
            "a flat loop on an edge",
            vec![[1, 0, 0], [2, 0, 0], [3, 0, 0]],
        ),
        (
            "twice through it and back",
            vec![[1, 1, -1], [1, 1, 1], [2, 2, 1], [2, 2, -1]],
        ),
        (
            "twice through it",
            vec![
                [1, 1, -1],
                [1, 1, 1],
                [9, 1, 1],
                [9, 2, -1],
                [2, 2, -1],
                [2, 2, 1],
                [9, 9, 1],
                [9, 9, -1],
            ],
        ),
    ]
}

/// Loops of one and of two distinct points near a Hopf link. They have no linking number, and the
/// link keeps its own.
fn degenerate_beside_good() -> Case {
    let [a, b] = hopf_polygons(1);
    let polygons = [
        vec![[0, 0, 0]],
        a,
        vec![[2, 2, 0]; 5],
        vec![[0, 0, -1], [0, 0, 1]],
        b,
        vec![[-2, -2, 0], [2, -2, 0], [2, -2, 0], [-2, -2, 0]],
        // Three distinct collinear points enclose no area either, but are a valid loop.
        vec![[0, 1, -3], [0, 1, 0], [0, 1, 3]],
    ];
    Case::integers("degenerate beside good", &polygons)
}

/// One pair touches, another is linked, and both contain one of the curves.
fn contact_hides_nothing() -> Case {
    let [a, b] = hopf_polygons(-1);
    let touching = vec![[2, 2, 0], [3, 3, 0], [3, 3, 9]];
    Case::integers("contact hides nothing", &[a, touching, b])
}

/// Random polygons with a vertex of each on an edge of the next one: a single contact among many
/// crossings, on lines in general position.
fn random_contacts() -> Case {
    let mut random = Random::new(1);
    let mut polygons: Vec<Polygon> = Vec::new();
    for k in 0..12 {
        let mut polygon = random.polygon(8 + k, 2000);
        if let Some(p) = polygons.last() {
            // At a third of the edge. This is exact, because coordinates are multiples of three.
            let (from, to) = (p[2], p[3]);
            polygon[5] = [0, 1, 2].map(|x| (2 * from[x] + to[x]) / 3);
        }
        polygon[2..4]
            .iter_mut()
            .flatten()
            .for_each(|x| *x -= *x % 3);
        polygons.push(polygon);
    }
    // Vertices 2 and 3 were rounded before their edge was divided, and vertex 5 is not an end of
    // it.
    Case::integers("random contacts", &polygons)
}
